# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of static paths at given load factors and values of columns; the largest step."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.options import target_values

COMM = MPI.COMM_WORLD


def _bent() -> ff.Model:
    """A cantilever that is bent far by a dead force at its end."""
    model = ff.Model("bent", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 10))
    section = ff.Section.circle(0.01, ff.Material(2.1e11, 0.3, 7850.0))
    model.add(
        ff.Beam("rod", section),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PointForce("push", ff.Marker("rod", "end"), (0.0, 0.0, -500.0)),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )
    return model


def _solve(**more: object) -> ff.Outcome:
    return ff.solve_static(_bent(), ff.StaticOptions(split_above=3, quiet=True, **more))


@pytest.mark.parametrize(
    "steps",
    [{"load_steps": 3}, {"arc_length": 0.2}],
    ids=["load", "arc"],
)
def test_path_meets_load_factors_and_values_of_columns(steps, shared_tmp_path: Path) -> None:
    wanted = {"t": [0.5, 0.77, 1.0], "tip_z": [-0.3, -0.31, -3.0]}
    outcome = _solve(output_at=wanted, output=shared_tmp_path / "run", every=100, **steps)
    assert outcome.status == "ok"
    assert outcome.summary["warnings"][-1] == "output_at: tip_z = -3 was not reached"
    met = outcome.summary["output_at"]
    assert [(entry["column"], entry["value"]) for entry in met] == [
        ("tip_z", -0.3), ("tip_z", -0.31), ("t", 0.5), ("t", 0.77), ("t", 1.0)
    ]  # fmt: skip
    if COMM.rank:
        return
    history = outcome.history
    for entry in met:
        row = np.argmin(np.abs(history["t"] - entry["t"]))
        # searched to 1e-10 of the step; the nearest row without it is a tenth away
        assert history[entry["column"]][row] == pytest.approx(entry["value"], abs=1e-9)
    # the start, five values, of which the last is the end
    fields = list((shared_tmp_path / "run" / "beams").glob("*_0.vtu"))
    assert len(fields) == 6, fields


@pytest.mark.serial
def test_values_are_those_of_a_run_that_ends_there() -> None:
    path = _solve(output_at="t=0.41;tip_z=-0.6", load_steps=5).history
    ended = _solve(t_end=0.41, load_steps=5).history
    row = int(np.flatnonzero(np.isclose(path["t"], 0.41, rtol=1e-12))[0])
    # Newton's tolerance is 1e-8, and the last iteration much better
    assert path["tip_x"][row] == pytest.approx(ended["tip_x"][-1], abs=1e-10)
    stopped = _solve(load_steps=5, stop_column="tip_z", stop_value=-0.6).history
    row = int(np.argmin(np.abs(path["tip_z"] + 0.6)))
    assert path["t"][row] == pytest.approx(stopped["t"][-1], rel=1e-8)


@pytest.mark.serial
def test_arc_length_steps_are_no_longer_than_asked() -> None:
    coarse, fine = (_solve(arc_length=0.05, max_step=size).summary["steps"] for size in (0.3, 0.05))
    # the end of the beam turns by 1.2 rad: at least 24 steps of 0.05, and a few of 0.3
    assert fine >= 20
    assert coarse < 12


@pytest.mark.serial
def test_mistakes_are_named() -> None:
    assert target_values("t=0.5,1;tip_z=-0.1") == {"t": (0.5, 1.0), "tip_z": (-0.1,)}
    for text in ("t", "t=", "=1", "t=nan", "t=0.5,x"):
        with pytest.raises(ValueError, match="output_at must be values of columns such as"):
            ff.StaticOptions(output_at=text)
    with pytest.raises(ValueError, match=r"max_step 0\.05 needs an arc_length above 0"):
        ff.StaticOptions(max_step=0.05)
    with pytest.raises(ValueError, match="output_at names the column 'tipp', the history has t, "):
        _solve(output_at="tipp=1")
    with pytest.raises(ValueError, match="output_at t = 2 is not between 0 and 1"):
        _solve(output_at="t=2")
