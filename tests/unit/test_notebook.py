# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interactive work: bars, interruption with results kept, runs on several ranks."""

import signal
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import flexfem as ff
from flexfem import launch
from flexfem.io.progress import Progress
from flexfem.studies.progress import SweepProgress

CASE = '''
"""A pendulum."""
import flexfem as ff


def build(length):
    model = ff.Model("pendulum")
    model.add(
        ff.RigidBody("rod", 1.0, (0.1, 0.1, 0.1), position=(length, 0.0, 0.0)),
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", offset=(-length, 0.0, 0.0))),
        ff.PositionProbe("tip", ff.Marker("rod")),
    )
    return model


LENGTH = ff.Option("length", float, 1.0, "of the rod", unit="m", above=0)
CASE = ff.Case("pendulum", "a pendulum", build, [LENGTH], dt=0.01, t_end=0.1)
'''


@pytest.mark.serial
def test_bar_is_shown_in_a_notebook(monkeypatch, capsys):
    """The streams of a kernel are no terminals."""
    with Progress(1.0, True) as bar:
        bar.update(0.5, 1, 1)
    assert capsys.readouterr().err == ""
    monkeypatch.setitem(sys.modules, "ipykernel.zmqshell", ModuleType("ipykernel.zmqshell"))
    with Progress(1.0, True) as bar:
        bar.update(0.5, 1, 1)
    # without ipywidgets, whose absence is no reason for a warning: those are errors here
    assert "t = 0.5 of 1 s" in capsys.readouterr().err
    bar = SweepProgress(3, 1, "auto")
    bar.ended("dt=1", {"status": "ok"})
    bar.close()
    assert "2 of 3 runs" in capsys.readouterr().err


@pytest.mark.serial
def test_summary_of_a_model_is_shown_as_a_table():
    """As the value of a cell; its representation would be that of all it consists of."""
    shown: list[str] = []
    printer = ModuleType("printer")
    printer.__dict__["text"] = shown.append
    summary = ff.describe(_pendulum(lambda t, at: [0.0]))
    summary._repr_pretty_(printer, False)
    assert shown == [str(summary)]


def _pendulum(function) -> ff.Model:
    model = ff.Model("pendulum")
    model.add(
        ff.RigidBody("rod", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", offset=(-1.0, 0.0, 0.0))),
        ff.Probe("turn", ff.Marker("rod"), ["y"], function),
        ff.Controller("watch", ["turn"], ["push"], lambda t, y: 0.0),
        ff.PointForce("push", ff.Marker("rod"), (1.0, 0.0, 0.0)),
    )
    return model


@pytest.mark.serial
def test_interrupted_run_keeps_its_results():
    """As a kernel does: the signal comes to the main thread, and the process continues."""
    options = ff.RunOptions(dt=0.01, t_end=1.0, quiet=True)

    def height(t: float, s: ff.MarkerState) -> list[float]:
        if t == 0.05:
            signal.raise_signal(signal.SIGINT)
        return [s.position[1]]

    with pytest.raises(KeyboardInterrupt) as stop:
        ff.simulate(_pendulum(height), options)
    assert isinstance(stop.value, launch.Interrupted)
    outcome = stop.value.outcome
    assert outcome.status == "interrupted at t = 0.05 s"
    assert outcome.history["t"] == pytest.approx(np.arange(6) * 0.01)
    assert repr(outcome) == (
        "Outcome('interrupted at t = 0.05 s', 5 steps, history of 6 rows: t, watch_push, y)"
    )
    again = ff.simulate(_pendulum(lambda t, s: [s.position[1]]), options)
    assert again.status == "ok"
    assert np.array_equal(again.history["y"][:6], outcome.history["y"])


@pytest.mark.serial
def test_exception_leaves_the_process_alive():
    """One process alone is not ended for the sake of others."""
    launch.abort(3)
    with pytest.raises(ff.FunctionError, match="ZeroDivisionError"):
        ff.simulate(
            _pendulum(lambda t, s: [1.0 / (t < 0.03)]),
            ff.RunOptions(dt=0.01, t_end=0.1, quiet=True),
        )
    model = _pendulum(lambda t, s: [0.0])
    outcome = ff.simulate(model, ff.RunOptions(dt=0.01, t_end=0.05, quiet=True))
    assert outcome.status == "ok"


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "swing.py"
    file.write_text(CASE)
    return file


@pytest.mark.serial
@pytest.mark.slow
def test_case_runs_in_a_process_of_its_own(case):
    """On one rank; an example of the guide starts two."""
    outcome = ff.run_case(case, length=2.0, dt=0.02)
    assert outcome.status == "ok"
    assert outcome.summary["ranks"] == 1
    assert outcome.history["t"] == pytest.approx(np.arange(6) * 0.02)
    # the option is taken: it falls as a rod of 2 m does, g t^2/2 / (1 + J/(m l^2)), less curvature
    assert outcome.history["tip_y"][-1] == pytest.approx(-0.5 * 9.81 * 0.01 / 1.025, rel=1e-2)
    assert (case.parent / "results" / "swing" / "summary.json").exists()


@pytest.mark.serial
def test_mistakes_of_a_run_are_told(case):
    with pytest.raises(ValueError, match="run_case: ranks must be a whole number above 0, got 0"):
        ff.run_case(case, ranks=0)
    with pytest.raises(TypeError, match="run_case: case must be a str or Path, got 3"):
        ff.run_case(3)
    with pytest.raises(ValueError, match=r"^argument --length: must be .* > 0 \[m\], got '-1.0'"):
        ff.run_case(case, length=-1.0)
    # a summary that an earlier run has left is none of this one
    (case.parent / "results" / "swing").mkdir(parents=True)
    (case.parent / "results" / "swing" / "summary.json").write_text('{"status": "ok"}')
    case.write_text(CASE.replace("model.add(", "model.add(1 / 0,"))
    with pytest.raises(ValueError, match=r"^build \(swing.py, line 8\): ZeroDivisionError"):
        ff.run_case(case)
