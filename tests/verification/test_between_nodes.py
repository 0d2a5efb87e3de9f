# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads, joints and probes between the nodes of two-node elements, on several ranks."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build
from flexfem.system.measure.probe_rates import probe_rates

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
SECTION = ff.Section.circle(0.02, STEEL)
EI = 2.1e11 * np.pi * 0.02**4 / 64.0
PLACE = 0.37
SOFT = ff.Section.circle(0.02, ff.Material(2.1e8, 0.3, 7850.0))


def _cantilever(elements: int) -> ff.Model:
    mesh = ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, elements)
    model = ff.Model("cantilever", mesh=mesh)
    model.add(
        ff.Beam("rod", SECTION),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
        ff.PositionProbe("loaded", ff.Marker("rod", PLACE)),
        ff.ReactionProbe("held", "clamp"),
    )
    return model


@pytest.mark.three_ranks
def test_deflection_under_a_force_at_a_fraction():
    """Against the closed form of a slender cantilever, second order in the elements' length."""
    errors = []
    for elements in (5, 20):
        model = _cantilever(elements)
        model.add(ff.PointForce("push", ff.Marker("rod", PLACE), (0.0, 0.0, -10.0)))
        options = ff.StaticOptions(load_steps=1, split_above=2, quiet=True)
        outcome = ff.solve_static(model, options)
        assert outcome.status == "ok"
        if COMM.rank:
            continue
        last = {name: values[-1] for name, values in outcome.history.items()}
        tip = -10.0 * PLACE**2 * (3.0 - PLACE) / (6.0 * EI)
        errors.append(abs(last["tip_z"] / tip - 1.0))
        # shear adds 2e-4 of the deflection; a force at the nearest node has another lever arm
        assert last["held_my"] == pytest.approx(-10.0 * PLACE, rel=1e-6)
        assert last["held_fz"] == pytest.approx(10.0, rel=1e-9)
    if errors:
        # 2 % on five elements: a force at 0.4 would be 16 % off, and 4 % off at 0.35
        assert errors[0] < 0.025
        assert errors[1] < 0.0025


def _swing(comm: MPI.Comm, **more: object) -> dict[str, np.ndarray]:
    """A beam hung up between its nodes, with loads and a spring between them."""
    model = ff.Model("swing", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 7))
    spot, slowly = ff.Marker("rod", 0.61, offset=(0.0, 0.02, 0.01)), ff.SmoothStep(0.0, 0.03)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rod", SOFT, angular_velocity=(0.0, 1.0, 0.0)),
        ff.Revolute("pin", ff.Ground((0.25, 0.0, 0.0)), ff.Marker("rod", 0.25), axis=(0, 1, 0)),
        ff.SpringDamper(
            "spring", ff.Ground((0.9, 0.0, 1.0)), ff.Marker("rod", 0.9), stiffness=50.0,
        ),
        ff.PointForce("push", spot, (0.0, 3.0, 9.0), follower=True, amplitude=slowly),
        ff.PointForce("hang", ff.Marker("rod", 0.83), (0.0, 0.0, -4.0), amplitude=slowly),
        ff.PointMoment("twist", spot, (0.0, 0.0, 2.0), amplitude=slowly),
        ff.PositionProbe("spot", spot),
        ff.PositionProbe("pinned", ff.Marker("rod", 0.25)),
        ff.ReactionProbe("held", "pin"),
        ff.EnergyProbe("energy"),
    )  # fmt: skip
    settings = {"dt": 1e-3, "t_end": 0.05, "rho_inf": 1.0, "tolerance": 1e-10, "quiet": True}
    outcome = ff.simulate(model, ff.RunOptions(**(settings | more)), comm=comm)
    assert outcome.status == "ok"
    return outcome.history


def test_any_number_of_ranks_gives_the_same_motion():
    found = _swing(COMM, split_above=2)
    alone = _swing(MPI.COMM_SELF)
    if COMM.rank:
        return
    for name, values in alone.items():
        family = [v for k, v in alone.items() if k.rpartition("_")[0] == name.rpartition("_")[0]]
        error = np.abs(values - found[name]).max()
        # round-off; a place whose element two ranks hold, or none, changes the first digits
        assert error <= 1e-9 * max(np.abs(v).max() for v in family), name
    # round-off of the constraint; the nearest node begins 36 mm away
    assert np.abs(alone["pinned_x"] - 0.25).max() < 1e-12
    # second order of the step; of the loads' work, 0.03 J, another place would take some percents
    assert np.abs(alone["energy_balance"]).max() < 1e-4


@pytest.mark.serial
def test_rates_of_probes_between_nodes(rng):
    """Derivatives of a position along motions of the nodes, against differences."""
    points = [(0, 0, 0), (1, 0, 0), (2, 1, 0), (2, 2, 1)]
    mesh = ff.LineMesh(points, [[0, 1], [1, 2], [2, 3]], {"beam": [0, 1, 2]})
    model = ff.Model("kinked", mesh=mesh)
    spot = ff.Marker("beam", 0.43, offset=(0.3, -0.5, 0.8))
    model.add(ff.Beam("beam", SECTION), ff.PositionProbe("spot", spot))
    model.validate()
    serial = NumberedModel(model)
    system = build(serial, MPI.COMM_SELF, split_above=1)
    block, eps = system.parts[0].block, 1e-6
    motion = rng.normal(size=block.step.shape)

    def split(values):
        return [values.reshape(-1, 6)]

    _, by_q, _ = probe_rates(system, serial, split, motion.reshape(1, -1))
    ends = []
    for sign in (1.0, -1.0):
        block.step[:] = sign * eps * motion
        block.correct(1.0)
        ends.append(probe_rates(system, serial, split, motion.reshape(1, -1))[0])
        block.reset()
    # differences are good to 1e-9; sections taken for nodes are wrong in the first digit
    np.testing.assert_allclose(by_q[:, 0], (ends[0] - ends[1]) / (2.0 * eps), atol=1e-7)
