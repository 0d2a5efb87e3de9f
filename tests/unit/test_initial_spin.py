# SPDX-License-Identifier: LGPL-3.0-or-later
"""One convention for all bodies: angular velocities at the start are given in inertial axes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl

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
    """Rigid, floating, beam: all rotated, all with the same numbers; body axes go by their name."""
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


def sheet(name: str, element: str) -> tuple[ff.Model, ff.Body]:
    """A shell in a plane through the origin."""
    ticks = np.linspace(0.2, 1.0, 4)
    mesh = ff.SurfaceMesh.grid(
        name, ticks, ticks, lambda p: np.column_stack([p, 0 * p[:, 0]]) @ TURN.T
    )
    section = ff.ShellSection.isotropic(0.01, STEEL)
    return ff.Model(name, surface=mesh), ff.Shell(
        name, section, element=element, velocity=VELOCITY, angular_velocity=SPIN
    )


def rod(name: str, formulation: str) -> tuple[ff.Model, ff.Body]:
    """A beam away from the origin, not along an axis."""
    ends = {name: [(0.3, 0.1, 0.0), (np.array([0.3, 0.1, 0.0]) + TURN[:, 0]).tolist()]}
    return ff.Model(name, mesh=ff.LineMesh.straight(ends, 3)), ff.Beam(
        name, ff.Section.circle(0.01, STEEL), formulation=formulation, velocity=VELOCITY,
        angular_velocity=SPIN,
    )  # fmt: skip


def membrane(name: str) -> tuple[ff.Model, ff.Body]:
    """Finite elements with an energy in UFL, in a plane."""
    ticks = np.linspace(0.2, 1.0, 4)
    surface = ff.SurfaceMesh.grid(
        name, ticks, ticks, lambda p: np.column_stack([p, 0 * p[:, 0]]) @ TURN.T
    )
    return ff.Model(name), ff.UFLBody(
        name, ff.ElementMesh.from_surface(surface), stretched, density=10.0,
        velocity=VELOCITY, angular_velocity=SPIN,
    )  # fmt: skip


def stretched(x: Any, X: Any, p: Any) -> Any:
    """Energy of a membrane, of no meaning: it only starts."""
    F = ufl.grad(x)
    return 1e3 * (ufl.inner(F, F) - 2.0) ** 2


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["se3", "nurbs", "rotation_free", "director", "ufl", "rigid"])
def test_written_velocities_are_those_of_one_rigid_motion(kind: str, tmp_path: Path) -> None:
    """Every point of ParaView's files at x moves with ``velocity + angular_velocity x x``."""
    import pyvista  # its plotting, which pytest would load with the name of a module, takes seconds

    if kind in ("se3", "nurbs"):
        model, body = rod("body", kind)
    elif kind in ("rotation_free", "director"):
        model, body = sheet("body", kind)
    elif kind == "ufl":
        model, body = membrane("body")
    else:
        model, body = (
            ff.Model("body"),
            ff.RigidBody(
                "body",
                1.0,
                (1.0, 2.0, 2.5),
                rotation=TURN,
                velocity=VELOCITY,
                angular_velocity=SPIN,
            ),
        )
    model.add(body)
    ff.simulate(model, ff.RunOptions(dt=1e-7, t_end=1e-7, output=tmp_path, quiet=True))
    seen = 0
    for file in tmp_path.rglob("*_000000_0.vtu"):
        if file.parent.name == "beam_surfaces":
            continue  # its points have the velocities of their nodes on the axis
        fields = pyvista.read(file)
        data = fields.point_data
        if not fields.n_points or "velocity" not in data:
            continue
        expected = VELOCITY + np.cross(SPIN, fields.points)
        np.testing.assert_allclose(data["velocity"], expected, atol=1e-5)
        if "angular_velocity" in data:
            turned = np.broadcast_to(SPIN, data["angular_velocity"].shape)
            np.testing.assert_allclose(data["angular_velocity"], turned, atol=1e-5)
        seen += 1
    assert seen


def test_markers_on_curves_see_it() -> None:
    """At its ends and inside, where no node is."""
    model, body = rod("body", "nurbs")
    model.add(body)
    for spin in started(model, *(ff.Marker("body", at) for at in ("start", 0.37, "end"))):
        np.testing.assert_allclose(spin, SPIN, atol=1e-6)


@pytest.mark.parametrize("kind", ["rotation_free", "director", "ufl"])
def test_nodes_without_rotations_have_no_angular_velocity(kind: str) -> None:
    """Their axes rotate with the elements around them, velocity and acceleration are known."""
    model, body = membrane("body") if kind == "ufl" else sheet("body", kind)
    place = TURN @ (1.0, 0.2, 0.0)
    model.add(body, ff.Probe("seen", ff.Marker("body", tuple(place)), COLUMNS, motion))
    history = ff.simulate(model, ff.RunOptions(dt=1e-7, t_end=1e-7, quiet=True)).history
    if history:
        found = np.array([history[name][0] for name in COLUMNS])
        np.testing.assert_allclose(found[:3], VELOCITY + np.cross(SPIN, place), atol=1e-9)
        assert np.isfinite(found[3:6]).all()
        rotation = so3.log(found[6:15].reshape(3, 3))
        np.testing.assert_allclose(rotation, 0.0, atol=1e-12)
        assert np.isnan(found[15:]).all()
        later = np.array([history[name][-1] for name in COLUMNS])[6:15]
        # the step turns by 1e-7 |SPIN|; axes of the director element do not rotate about its normal
        turned = so3.log(later.reshape(3, 3)) - 1e-7 * SPIN
        np.testing.assert_allclose(np.cross(turned, TURN[:, 2]), 0.0, atol=1e-9)
        assert kind == "director" or abs(turned @ TURN[:, 2]) < 1e-9


COLUMNS = [f"c{k}" for k in range(21)]


def motion(t: float, s: ff.MarkerState) -> list[float]:
    """Velocity, acceleration, then everything that rotates."""
    return [*s.velocity, *s.acceleration, *s.rotation.ravel(), *s.angular_velocity,
            *s.angular_acceleration]  # fmt: skip


@pytest.mark.serial
def test_both_are_refused() -> None:
    with pytest.raises(ValueError, match='RigidBody "b": give angular_velocity') as raised:
        ff.RigidBody(
            "b", 1.0, (1, 1, 1), angular_velocity=(0, 0, 0), local_angular_velocity=(0, 0, 1)
        )
    assert_on_page(str(raised.value))
