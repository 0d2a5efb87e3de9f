# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies of networks and cables that go slack and taut in coarse steps."""

import numpy as np
import pytest

import flexfem as ff
from tests.histories import columns

ENERGIES = ("kinetic", "strain", "gravity", "work")


def struck_line(damping: float) -> ff.Model:
    """Two masses and three taut cables on a line, which is struck sideways."""
    model, side = ff.Model("line"), 0.3
    ends = [ff.Ground(), ff.Marker("left"), ff.Marker("right"), ff.Ground((3.0 * side, 0.0, 0.0))]
    for i, name in enumerate(("left", "right")):
        model.add(
            ff.RigidBody(
                name, 2e-3, (1e-6,) * 3, position=((i + 1) * side, 0.0, 0.0),
                velocity=(0.0, 0.0, 5.0),
            )
        )  # fmt: skip
    for i in range(3):
        model.add(
            ff.SpringDamper(
                f"cable_{i}", ends[i], ends[i + 1], 3e4, damping, rest_length=0.99 * side,
                tension_only=True,
            )
        )  # fmt: skip
    model.add(ff.EnergyProbe())
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize("rho", [1.0, 0.9, 0.7, 0.5])
def test_a_taut_line_in_coarse_steps_dissipates_what_it_loses(rho: float) -> None:
    """Steps are longer than its periods; dampers lose no more than there is to be lost."""
    options = ff.RunOptions(dt=2e-2, t_end=0.4, rho_inf=rho, quiet=True)
    found = columns(ff.simulate(struck_line(30.0), options))
    given = found["energy_kinetic"][0]
    # the mean of forces and rates at both ends claimed a loss of the energy of the blow
    assert found["energy_balance"].max() < 0.02 * given
    # it may be negative where the rates at both ends leave the way
    assert np.diff(found["energy_dissipation"]).min() > -1e-9 * given


def winch(damping: float) -> ff.Model:
    """A load on a cable over an eyelet, hauled up and down so that the cable goes slack."""
    model = ff.Model("winch")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("load", 2.0, (0.1, 0.1, 0.1), position=(0.0, 0.0, -1.0)),
        ff.Cable(
            "pull", [ff.Ground((1.0, 0.0, 0.0)), ff.Eyelet(ff.Ground()), ff.Marker("load")],
            axial_stiffness=4e4, damping=damping,
            paid_out=lambda t: -0.15 * np.sin(12.0 * np.pi * t) ** 2,
        ),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize("integrator", ["generalized_alpha", "energy_momentum"])
@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_a_hauled_cable_that_goes_slack_keeps_the_balance(integrator: str, damping: float) -> None:
    options = ff.RunOptions(
        dt=2e-3, t_end=0.4, integrator=integrator, rho_inf=1.0, quiet=True
    )  # fmt: skip
    found = columns(ff.simulate(winch(damping), options))
    largest = max(np.abs(found[f"energy_{name}"]).max() for name in ENERGIES)
    assert largest > 50.0
    # work and dissipation by means of both ends are off by 5e-3 of it
    assert np.abs(found["energy_balance"]).max() < 1e-9 * largest
    # which was -1.5 J without a damper
    assert np.diff(found["energy_dissipation"]).min() > -1e-10 * largest
    if damping == 0.0:
        assert np.abs(found["energy_dissipation"]).max() < 1e-9 * largest
