# SPDX-License-Identifier: LGPL-3.0-or-later
"""One convention for all bodies: angular velocities at the start are given in inertial axes."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.lie import so3
from tests.unit.particle_body import bar
from tests.unit.refusals import assert_on_page

SPIN, VELOCITY = np.array([1.0, -2.0, 3.0]), np.array([0.5, 0.0, -0.5])
TURN = so3.exp(np.array([0.4, -1.1, 0.7]))
STEEL = ff.Material(2e11, 0.3, 7800.0)


def started(model: ff.Model, *markers: ff.Marker) -> list[np.ndarray]:
    """Angular velocity of each marker at the start, as a probe sees it; on the first rank."""
    for k, marker in enumerate(markers):
        names = [f"{k}_{axis}" for axis in "xyz"]
        model.add(ff.Probe(f"spin_{k}", marker, names, lambda t, s: s.angular_velocity))
    history = ff.simulate(model, ff.RunOptions(dt=1e-6, t_end=1e-6, quiet=True)).history
    return [
        np.array([history[f"{k}_{axis}"][0] for axis in "xyz"])
        for k in range(len(markers) if history else 0)
    ]


def test_all_bodies_begin_with_the_same() -> None:
    """Rigid, floating, beam: all turned, all with the same numbers; body axes go by their name."""
    model = ff.Model(
        "turned", mesh=ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), TURN[:, 0].tolist()]}, 2)
    )
    given = {"rotation": TURN, "velocity": VELOCITY}
    reduced = bar()
    model.add(
        ff.Beam("rod", ff.Section.circle(0.01, STEEL), angular_velocity=SPIN),
        ff.RigidBody("rigid", 1.0, (1.0, 2.0, 2.5), angular_velocity=SPIN, **given),
        ff.RigidBody("local", 1.0, (1.0, 2.0, 2.5), local_angular_velocity=TURN.T @ SPIN, **given),
        ff.FloatingBody("elastic", reduced, angular_velocity=SPIN, **given),
        ff.FloatingBody("own", reduced, local_angular_velocity=TURN.T @ SPIN, **given),
    )
    names = ("rigid", "local", "elastic", "own")
    found = started(model, ff.Marker("rod", "start"), *map(ff.Marker, names))
    for spin in found:
        # taken for body axes, the numbers would differ by more than one
        np.testing.assert_allclose(spin, SPIN, atol=1e-9)


@pytest.mark.serial
def test_both_are_refused() -> None:
    with pytest.raises(ValueError, match='RigidBody "b": give angular_velocity') as raised:
        ff.RigidBody(
            "b", 1.0, (1, 1, 1), angular_velocity=(0, 0, 0), local_angular_velocity=(0, 0, 1)
        )
    assert_on_page(str(raised.value))
