# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear statics against closed forms, and what it says of what it neglects."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
EI = 2.1e11 * np.pi * 0.01**4 / 64.0


def _cantilever(force: float, elements: int = 40) -> ff.Model:
    model = ff.Model("rod", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, elements))
    model.add(
        ff.Beam("rod", ff.Section.circle(0.01, STEEL)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PointForce("push", ff.Marker("rod", "end"), (0.0, 0.0, -force)),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
        ff.ReactionProbe("held", "clamp"),
        ff.StrainProbe("middle", "rod", 0.5),
    )
    return model


def _linear(force: float, **more: object) -> ff.Outcome:
    options = ff.StaticOptions(linear=True, split_above=10, quiet=True, **more)
    return ff.solve_static(_cantilever(force), options)


@pytest.mark.three_ranks
def test_cantilever_by_one_linear_solution() -> None:
    """Deflection F L^3 / (3 EI), the same for any load; no shortening, no normal force."""
    for force in (1e-3, 3000.0):
        outcome = _linear(force, output_at="t=0.25")
        assert outcome.status == "ok"
        assert outcome.summary["newton_iterations"] == 4  # a solution and a look beyond, twice
        if COMM.rank:
            continue
        last = {name: values[-1] for name, values in outcome.history.items()}
        deflection = -force / (3.0 * EI)
        # forty elements lose 2e-4 and shear adds 5e-5; nonlinear displacements end at 1 m
        assert last["tip_z"] == pytest.approx(deflection, rel=1e-3)
        # differences are good to 1e-7 of the deflection; 3000 N draw the end in by metres
        assert last["tip_x"] == pytest.approx(1.0, abs=1e-6 * abs(deflection) + 1e-11)
        assert last["held_fz"] == pytest.approx(force, rel=1e-7)
        assert last["held_my"] == pytest.approx(-force, rel=1e-6)
        # from the moved shape it would be EA = 1.6e7 N times half the square of the rotation, 4e9 N
        # of the larger force; rounding of differences is 1e-7 N
        assert abs(last["middle_n1"]) < 1e-5 * force + 1e-6
        assert outcome.history["t"].tolist() == [0.0, 0.25, 1.0]
        assert outcome.history["tip_z"][1] == pytest.approx(0.25 * last["tip_z"], rel=1e-7)


@pytest.mark.serial
def test_small_loads_agree_with_the_nonlinear_solution() -> None:
    linear = _linear(1e-2).history
    exact = ff.solve_static(_cantilever(1e-2), ff.StaticOptions(load_steps=1, quiet=True)).history
    for name, values in linear.items():
        # of second order: the rotation at the end is 5e-5 rad; rounding of differences is 1e-6 N
        assert values[-1] == pytest.approx(exact[name][-1], rel=1e-6, abs=2e-6), name


@pytest.mark.serial
def test_what_is_neglected_is_told() -> None:
    small, large = _linear(1.0), _linear(300.0)
    assert small.summary["warnings"] == []
    # the end turns by F L^2 / (2 EI), and is drawn in by a part of this of its deflection
    assert small.summary["linear"]["largest"] == pytest.approx(0.5 / EI, rel=1e-2)
    assert small.summary["linear"]["neglected"] < 0.01
    assert large.summary["linear"]["neglected"] > 0.1
    assert "linear: the next iteration would change" in large.summary["warnings"][-1]
    unloaded = _linear(0.0).summary
    # rounding, of which the next iteration changes most
    assert unloaded["linear"]["largest"] < 1e-12
    assert unloaded["linear"]["neglected"] == 0.0
    assert unloaded["warnings"] == []


@pytest.mark.serial
def test_mistakes_are_named() -> None:
    with pytest.raises(ValueError, match=r"linear takes no arc_length, got 0\.1"):
        ff.StaticOptions(linear=True, arc_length=0.1)
    with pytest.raises(ValueError, match="output_at names 'tip_z'"):
        _linear(1.0, output_at="tip_z=-0.1")
    model = _cantilever(1.0)
    model.add(ff.EnergyProbe("energy"))
    with pytest.raises(ValueError, match=r'^EnergyProbe "energy": linear statics has'):
        ff.solve_static(model, ff.StaticOptions(linear=True, quiet=True))
