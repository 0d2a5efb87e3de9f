# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of runs that end early."""

from dataclasses import replace
from pathlib import Path

import pytest

import flexfem as ff
from flexfem.simulation.run.checkpoints import Checkpoints

SECTION = ff.Section.circle(0.02, ff.Material(5e7, 0.49, 1100.0))
#: Options of each analysis for a run that writes a checkpoint.
ANALYSES = {
    "dynamics": ff.RunOptions(dt=1e-3, t_end=2e-3, checkpoint_every=1),
    "statics": ff.StaticOptions(load_steps=2, checkpoint_every=1),
    "relaxation": ff.RelaxationOptions(checkpoint_every=20),
}
DRIVERS = {"dynamics": ff.simulate, "statics": ff.solve_static, "relaxation": ff.relax}


def cantilever() -> ff.Model:
    """A rubber rod of two elements that hangs from one end."""
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, 2)
    model = ff.Model("cantilever", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rod", SECTION, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize("name", ANALYSES)
def test_an_unexpected_error_leaves_a_closed_table(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other errors than of files or functions pass through; the history so far can be read."""

    def fail(*_: object) -> None:
        raise ImportError("no library for checkpoints")

    monkeypatch.setattr(Checkpoints, "write", fail)
    options = replace(ANALYSES[name], output=tmp_path)
    with pytest.raises(ImportError, match="no library for checkpoints"):
        DRIVERS[name](cantilever(), options)
    # an open file would be a ResourceWarning, which is an error here
    lines = (tmp_path / "history.csv").read_text().splitlines()
    assert lines[0].startswith("t,")
    assert len(lines) >= 2


@pytest.mark.serial
def test_a_load_step_that_fails_leaves_the_pictures_before_it(tmp_path: Path) -> None:
    """The picture of the last equilibrium has the number of its step."""
    options = ff.StaticOptions(max_iterations=1, output=tmp_path)
    assert ff.solve_static(cantilever(), options).status != "ok"
    assert [path.name for path in (tmp_path / "beams").iterdir()] == ["beams_000000_0.vtu"]


@pytest.mark.serial
def test_a_path_that_runs_out_of_steps_keeps_its_pictures(tmp_path: Path) -> None:
    """The last point is not shown in place of the one before it."""
    model = cantilever()
    options = ff.StaticOptions(arc_length=0.1, max_steps=3, output=tmp_path)
    outcome = ff.solve_static(model, options)
    assert outcome.status.startswith("not at the end after 3 arc-length steps")
    series = (tmp_path / "beams.pvd").read_text()
    shown = [float(part.split('"')[0]) for part in series.split('timestep="')[1:]]
    assert shown == pytest.approx(outcome.history["t"].tolist(), rel=1e-12)
