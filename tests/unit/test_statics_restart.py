# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load steps that go on from a checkpoint."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.io import read_history
from flexfem.launch import Interrupted

COMM = MPI.COMM_WORLD
STEPS = {"load_steps": 8, "quiet": True}


def bars(grows: Callable[[float], float] | None = None) -> ff.Model:
    """Two cantilevers whose ends are pulled together by a spring, and bent under their weight."""
    lines = {"low": [(0.0, 0, 0), (1.0, 0, 0)], "high": [(0.0, 0, 0.5), (1.0, 0, 0.5)]}
    rubber = ff.Material(5e7, 0.4, 1100.0)
    ends = ff.Marker("low", "end"), ff.Marker("high", "end")
    model = ff.Model("bars", mesh=ff.LineMesh.straight(lines, elements=4))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        *(ff.Beam(name, ff.Section.rectangle(0.04, 0.04, rubber)) for name in lines),
        ff.Rigid("first", ff.Ground(), ff.Marker("low", "start")),
        ff.Rigid("second", ff.Ground((0.0, 0.0, 0.5)), ff.Marker("high", "start")),
        ff.SpringDamper("spring", *ends, stiffness=20.0, damping=0.0, rest_length=0.5),
        ff.PointForce("pull", ends[1], (0.0, 3.0, 1.0), amplitude=grows or (lambda t: t)),
        ff.PositionProbe("tip", ends[1]),
        ff.ReactionProbe("hold", "second"),
        ff.EnergyProbe(),
    )
    return model


def _run(model: ff.Model, **options: Any) -> ff.Outcome:
    outcome = ff.solve_static(model, ff.StaticOptions(**(STEPS | options)))
    assert outcome.status == "ok", outcome.status
    return outcome


@pytest.mark.parametrize("gravity", ["proportional", "constant"])
def test_the_rest_is_as_if_nothing_had_been(shared_tmp_path: Path, gravity: str) -> None:
    whole = _run(bars(), gravity_load=gravity, buckling_modes=1)
    folder = shared_tmp_path / gravity
    _run(bars(), gravity_load=gravity, t_end=0.5, load_steps=4, output=folder, checkpoint_every=3)
    assert sorted(p.name for p in folder.glob("*.h5")) == [
        "checkpoint_000003.h5", "checkpoint_000004.h5",
    ]  # fmt: skip
    file = folder / "checkpoint_000003.h5"
    rest = _run(bars(), gravity_load=gravity, output=folder, restart=file, buckling_modes=1)
    assert rest.summary["restarted_at_step"] == 3
    assert rest.summary["steps"] == whole.summary["steps"] == 8
    # linearised at the first equilibrium and the last one, not at the checkpoint
    assert rest.summary["buckling"] == pytest.approx(whole.summary["buckling"], rel=1e-6)
    if COMM.rank:
        return
    written = read_history(folder / "history.csv")
    for name, column in whole.history.items():
        # gravity or forces that are missing, or work that starts again, change the first digits
        largest = max(np.abs(column).max(), 1e-3)
        assert np.abs(rest.history[name] - column).max() < 1e-9 * largest, name
        assert np.array_equal(written[name], rest.history[name])
    assert np.abs(whole.history["tip_y"]).max() > 0.05


@pytest.mark.slow_on_ranks
def test_an_interruption_leaves_a_checkpoint(shared_tmp_path: Path) -> None:
    """The last rank gets a signal; the run continues with steps of another size."""
    sent: list[float] = []

    def grows(t: float) -> float:
        if COMM.rank == COMM.size - 1 and 0.3 < t < 0.4 and not sent:
            sent.append(t)
            os.kill(os.getpid(), signal.SIGINT)
        return t

    with pytest.raises(Interrupted, match=r'at t = 0.375, go on with restart="') as caught:
        ff.solve_static(bars(grows), ff.StaticOptions(**STEPS, output=shared_tmp_path / "a"))
    assert caught.value.outcome.status == "interrupted at t = 0.375"
    file, output = caught.value.checkpoint, shared_tmp_path / "b"
    assert file is not None
    rest = _run(bars(grows), load_steps=16, output=output, restart=file)
    whole = _run(bars(), load_steps=16)
    if COMM.rank == 0:
        assert rest.history["t"] == pytest.approx(np.arange(6, 17) / 16, abs=1e-9)
        # an equilibrium does not depend on the steps to it
        assert rest.history["tip_y"][-1] == pytest.approx(whole.history["tip_y"][-1], rel=1e-6)
    with pytest.raises(ValueError, match=r"is at t = 0.375 already, t_end = 0.3 leaves nothing"):
        _run(bars(), t_end=0.3, restart=file)
    with pytest.raises(
        ValueError, match=r"was written with gravity_load = proportional, not constant"
    ):
        _run(bars(), gravity_load="constant", restart=file)


@pytest.mark.serial
def test_critical_points_are_kept(tmp_path: Path) -> None:
    """A column that buckles in the first part of the steps is reported at the end of the second."""

    def column() -> ff.Model:
        model = ff.Model(
            "column", mesh=ff.LineMesh.straight({"bar": [(0.0, 0, 0), (0, 0, 1.0)]}, elements=6)
        )
        end = ff.Marker("bar", "end")
        steel = ff.Material(2.1e11, 0.3, 7850.0)
        model.add(
            ff.Beam("bar", ff.Section.rectangle(0.01, 0.02, steel)),
            ff.Rigid("foot", ff.Ground(), ff.Marker("bar", "start")),
            ff.PointForce("weight", end, (0.0, 0.0, -1500.0)),
            ff.PositionProbe("top", end),
        )
        return model

    options: dict[str, Any] = {"critical_points": True, "quiet": True, "load_steps": 4}
    whole = ff.solve_static(column(), ff.StaticOptions(**options))
    assert [point["kind"] for point in whole.summary["critical_points"]] == ["bifurcation"]
    ff.solve_static(
        column(), ff.StaticOptions(**options, output=tmp_path, checkpoint_every=4, t_end=0.9)
    )
    rest = ff.solve_static(
        column(), ff.StaticOptions(**options, output=tmp_path,
                                   restart=max(tmp_path.glob("checkpoint_*.h5")))
    )  # fmt: skip
    assert rest.status == "ok"
    (first,), (second,) = (x.summary["critical_points"] for x in (whole, rest))
    assert (second["kind"], second["unstable"]) == ("bifurcation", [0, 1])
    # Euler's load of a cantilever, with six elements; one found again would be beyond t = 0.9
    euler = 0.25 * np.pi**2 * 2.1e11 * 0.02 * 0.01**3 / 12.0 / 1500.0
    assert second["t"] == pytest.approx(first["t"], rel=1e-5)
    assert second["t"] == pytest.approx(euler, rel=1e-2)
    assert second["top_z"] == pytest.approx(first["top_z"], rel=1e-9)
    assert (tmp_path / "modes").exists()


@pytest.mark.serial
def test_paths_by_arc_length_have_none() -> None:
    for given in ({"checkpoint_every": 2}, {"restart": "checkpoint_000001.h5"}):
        with pytest.raises(ValueError, match=r"a path by arc_length 0\.1 has none"):
            ff.StaticOptions(arc_length=0.1, **given)
