# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs in which a function of the user's, or a file, fails: they end in good order on all ranks."""

import errno
import gc
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import research
from flexfem._faults import ReturnError
from flexfem.core.pose import Pose
from flexfem.io import read_history
from flexfem.io.folder_lock import FolderLock
from flexfem.io.tables.history import HistoryWriter
from tests.unit.elastic_bodies import pair
from tests.unit.refusals import assert_on_page

COMM = MPI.COMM_WORLD
#: Time (s) from which on a function fails, between two steps.
WHEN = 0.0055
#: Time (s) that is looked at for the start already, to see how forces change.
SOON = 1e-5
EVERY, LAST = None, COMM.size - 1


class Failing:
    """Failure in a test: of one function, on all ranks or on one."""

    def __init__(self, what: str, only: int | None = EVERY, when: float = WHEN) -> None:
        self.what, self.only, self.when = what, only, when

    def __call__(self, what: str, t: float) -> bool:
        here = self.only is EVERY or COMM.rank == self.only
        return what == self.what and here and t >= self.when


def pendulum(fails: Failing) -> ff.Model:
    """Two bodies with all kinds of functions that a run calls, of which one fails."""

    def amplitude(t: float) -> float:
        return {}["no key"] if fails("amplitude", t) else 1.0

    def shape(t: float) -> Any:
        return np.zeros(2) if fails("shape", t) else 0.0

    def endless(t: float) -> float:
        return np.inf if fails("endless", t) else 1.0

    def leaves(t: float) -> float:
        return exit(0) if fails("exit", t) else 1.0

    def motion(t: float) -> float:
        return 1.0 / (0.0 if fails("motion", t) else np.inf)

    def sampled(t: float, y: Any) -> float:
        return list[float]().pop() if fails("sampled", t) else 0.0

    def continuous(t: float, y: Any) -> Any:
        return (1.0, 2.0) if fails("continuous", t) else 0.0

    def watched(t: float, bob: ff.MarkerState) -> Any:
        return "high" if fails("event", t) else t - WHEN

    def act(mechanism: Any) -> None:
        if fails("action", WHEN):
            raise ValueError("two\nlines")

    def shown(t: float, bob: ff.MarkerState) -> list[float]:
        return [0.0] if fails("probe", t) else [0.0, t]

    bob, weight, model = ff.Marker("bob"), ff.Marker("weight"), ff.Model("faulty")
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(0.6, 0.0, -0.8)),
        ff.RigidBody("weight", 1.0, (0.1, 0.1, 0.1), position=(1.6, 0.0, -0.8)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Spherical("pin", ff.Ground(), ff.Marker("bob", offset=(-0.6, 0.0, 0.8))),
        ff.PrescribedTranslation(
            "drive", ff.Ground((1.6, 0.0, -0.8)), weight, motion, axis=(1.0, 0.0, 0.0)
        ),
        ff.PointForce("push", bob, (1.0, 0.0, 0.0), amplitude=amplitude),
        ff.PointForce("pull", bob, (1.0, 0.0, 0.0), amplitude=shape),
        ff.PointForce("hold", weight, (1.0, 0.0, 0.0), amplitude=leaves),
        ff.PointForce("blow", weight, (1.0, 0.0, 0.0), amplitude=endless),
        ff.PointForce("kept", bob, (1.0, 0.0, 0.0)),
        ff.PointForce("steered", bob, (1.0, 0.0, 0.0)),
        ff.PositionProbe("path", bob),
        ff.Probe("own", bob, ["none", "time"], shown),
        ff.Event("passes", bob, watched, act),
        ff.Controller("computer", ["path_x"], ["kept"], sampled, sample_time=1e-3),
        ff.Controller("wire", ["path_x"], ["steered"], continuous),
    )
    return model


#: Failures: words of the line with owner and name of the function, and the reason.
LINES = {
    "amplitude": "PointForce \"push\": amplitude (…): KeyError: 'no key'",
    "shape": 'PointForce "pull": amplitude must return a number, got shape (2,), from shape (…)',
    "endless": 'PointForce "blow": amplitude is inf at t = ',
    "exit": 'PointForce "hold": leaves (…): sys.exit(0)',
    "motion": 'PrescribedTranslation "drive": motion (…): ZeroDivisionError: float division',
    "sampled": 'Controller "computer": sampled (…): IndexError: pop from empty list',
    "continuous": 'Controller "wire": law must return 1 number, got (1.0, 2.0) at t = ',
    "event": "Event \"passes\": function must return a number, got 'high', from watched (…)",
    "action": 'Event "passes": act (…): ValueError: two lines',
    "probe": 'Probe "own": function must return 2 numbers, got shape (1,), from shown (…)',
}
#: Tried on three ranks as well: a load, and a probe.
ON_THREE = ("amplitude", "probe")


def assert_told(line: str, what: str) -> None:
    """The line names object, function, file and line, and is one."""
    begin, _, end = LINES[what].partition("(…)")
    assert line.startswith(begin)
    if end or "(…)" in LINES[what]:
        place, _, rest = line[len(begin) :].partition(")")
        assert place.startswith("(test_faults.py, line ")
        assert rest.startswith(end)
    assert "\n" not in line


def options(folder: Path | None, **more: Any) -> ff.RunOptions:
    given = {"dt": 1e-3, "t_end": 1.5e-2, "every": 3, "quiet": True, "output": folder}
    return ff.RunOptions(**given | more)


@pytest.mark.parametrize(
    "what",
    [
        pytest.param(what, marks=[pytest.mark.three_ranks] if what in ON_THREE else [])
        for what in LINES
    ],
)
@pytest.mark.parametrize("only", [EVERY, LAST], ids=["everywhere", "on one rank"])
def test_a_function_fails_during_the_run(
    what: str, only: int | None, shared_tmp_path: Path
) -> None:
    if only is not EVERY and (COMM.size == 1 or what in ("motion", "sampled", "probe", "exit")):
        pytest.skip("is called on one rank anyway")
    with pytest.raises(ff.FunctionError) as raised:
        ff.simulate(pendulum(Failing(what, only)), options(shared_tmp_path))
    assert_told(str(raised.value), what)
    assert "Traceback" in raised.value.trace
    outcome = raised.value.outcome
    assert outcome.status.startswith(f"{raised.value} after t = ")
    COMM.barrier()
    assert json.loads((shared_tmp_path / "summary.json").read_text())["status"] == outcome.status
    # the last state before the failure, or that of the last table written, is kept
    (checkpoint,) = shared_tmp_path.glob("checkpoint_*.h5")
    reached = int(checkpoint.stem[-6:]) * 1e-3
    assert 0.005 <= reached <= 0.0061
    assert read_history(shared_tmp_path / "history.csv")["t"][-1] >= reached * (1.0 - 1e-12)
    assert not (shared_tmp_path / ".flexfem_run").exists()


def test_a_probe_ends_the_run_in_its_step(shared_tmp_path: Path) -> None:
    """Not at the next fields or checkpoint, with rows of nan until then."""
    given = options(shared_tmp_path, every=100, t_end=0.1)
    with pytest.raises(ff.FunctionError) as raised:
        ff.simulate(pendulum(Failing("probe")), given)
    assert raised.value.outcome.status.endswith(" after t = 0.006 s")
    COMM.barrier()
    history = read_history(shared_tmp_path / "history.csv")
    np.testing.assert_allclose(history["t"][-1], 0.006)
    assert np.flatnonzero(np.isnan(history["time"])).tolist() == [len(history["t"]) - 1]


@pytest.mark.parametrize(
    "what",
    [
        "sampled",
        "event",
        *(pytest.param(w, marks=pytest.mark.serial) for w in ("amplitude", "action")),
    ],
)
def test_a_mended_function_goes_on(what: str, shared_tmp_path: Path) -> None:
    """The samples and events that failed are made by the restart."""
    sound = ff.simulate(pendulum(Failing("nothing")), options(None))
    with pytest.raises(ff.FunctionError):
        ff.simulate(pendulum(Failing(what)), options(shared_tmp_path))
    (checkpoint,) = COMM.bcast(list(shared_tmp_path.glob("checkpoint_*.h5")))
    last = ff.simulate(pendulum(Failing("nothing")), options(shared_tmp_path, restart=checkpoint))
    assert last.status == "ok"
    fired = [[event["t"] for event in run.summary["events"]] for run in (last, sound)]
    # an event that is made again lies within its tolerance of 1e-9 s; half a step off is 5e-4
    np.testing.assert_allclose(*fired, atol=1e-8)
    if COMM.rank == 0:
        # a lost sample or a step of other size would be off by 1e-7 at least
        for name in ("path_x", "path_z"):
            np.testing.assert_allclose(last.history[name][-1], sound.history[name][-1], atol=1e-10)


@pytest.mark.parametrize("what", [w for w in LINES if w != "action"])
def test_a_function_that_fails_at_once_is_wrong_input(what: str, shared_tmp_path: Path) -> None:
    with pytest.raises((ValueError, TypeError)) as raised:
        ff.simulate(pendulum(Failing(what, when=0.0)), options(shared_tmp_path / "new"))
    if what != "motion":  # that is called where the joint is made
        assert_told(str(raised.value), what)
    COMM.barrier()
    assert list(shared_tmp_path.iterdir()) == []


@pytest.mark.serial
@pytest.mark.parametrize("value", ["1.5", b"1", None, 1j, ["1.5", "2"], [1.0, None]])
def test_what_is_no_number(value: Any) -> None:
    """Text is none, though NumPy reads it; nor is None, of which it makes nan."""
    hub, ground = ff.Marker("hub"), ff.Ground()
    line = r"must return (a|2) numbers?, got .*, from later \(test_faults.py, line \d+\)$"

    def later(t: float, *states: object) -> Any:
        return value if t else 0.0

    for call in (
        ff.PointForce("push", hub, (1.0, 0.0, 0.0), amplitude=later).factor,
        partial(ff.Event("passes", hub, later, ff.Stop()).evaluate, states=[]),
        partial(ff.Probe("own", hub, ["x", "y"], later).evaluate, states=[]),
    ):
        with pytest.raises(ff.FunctionError, match=line):
            call(1.0)
    place = Pose()
    for drive in (
        ff.PrescribedAngle("turn", ground, hub, axis=(0.0, 0.0, 1.0), angle=later),
        ff.PrescribedDisplacement("go", ground, hub, axis=(0.0, 0.0, 1.0), displacement=later),
        ff.Actuator("pull", ground, hub, axis=(0.0, 0.0, 1.0), force=later),
    ):
        with pytest.raises(ReturnError, match=r"^(angle|displacement|force) must return a number"):
            drive.rows((place, place), 1.0)


@pytest.mark.serial
def test_a_load_along_a_beam_fails() -> None:
    """Its function is called where elements are made, in no run yet."""
    bar = ff.LineMesh.straight({"bar": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=2)
    model = ff.Model(mesh=bar)
    model.add(
        ff.Beam("bar", ff.Section.circle(0.01, ff.Material(2.1e11, 0.3, 7850.0))),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "start")),
        ff.LineLoad("snow", "bar", lambda s: (0.0, 0.0, 1.0 / (s - s))),
    )
    line = r'LineLoad "snow": force_per_length: lambda \(test_faults.py, line \d+\): ZeroDivision'
    with pytest.raises(ValueError, match=line):
        ff.solve_static(model, ff.StaticOptions(quiet=True))


def test_an_aggregate_that_fails_at_once_is_wrong_input(shared_tmp_path: Path) -> None:
    """Its function is called on the ranks that have its elements."""
    bar = ff.LineMesh.straight({"bar": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=4)
    model = ff.Model(mesh=bar)
    model.add(
        ff.Beam("bar", ff.Section.circle(0.01, ff.Material(2.1e11, 0.3, 7850.0))),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "start")),
        ff.AggregateProbe("worst", ["bar"], lambda strains, resultants, places: {}["no key"]),
    )
    line = r"""^AggregateProbe "worst": lambda \(test_faults.py, line \d+\): KeyError: 'no key'$"""
    with pytest.raises(ValueError, match=line):
        ff.simulate(model, options(shared_tmp_path / "new"))
    COMM.barrier()
    assert list(shared_tmp_path.iterdir()) == []


def test_results_fail(shared_tmp_path: Path) -> None:
    """The run is kept, and says what is missing."""
    run = partial(ff.simulate, pendulum(Failing("nothing")), options(shared_tmp_path), case="own")
    with pytest.raises(ff.FunctionError) as raised:
        run(results=lambda history: {"x": history["nothing"][-1]})
    assert str(raised.value).startswith("results of case 'own': lambda (test_faults.py, line ")
    COMM.barrier()
    summary = json.loads((shared_tmp_path / "summary.json").read_text())
    assert summary["status"] == str(raised.value)
    assert summary["steps"] == 16  # 15, of which the event divides one


def test_statics_and_relaxation_and_modes(shared_tmp_path: Path) -> None:
    """The other analyses of models."""

    def strip(amplitude: Callable[[float], float]) -> ff.Model:
        mesh = ff.LineMesh.straight({"strip": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=4)
        model = ff.Model("strip", mesh=mesh)
        section = ff.Section.rectangle(0.01, 0.01, ff.Material(2e11, 0.3, 7800.0))
        tip = ff.Marker("strip", "end")
        model.add(
            ff.Beam("strip", section),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("strip", "start")),
            ff.PointForce("push", tip, (0.0, 0.0, -1.0), amplitude=amplitude),
            ff.PositionProbe("tip", tip),
        )
        return model

    def amplitude(t: float) -> float:
        return t / (not 0.55 < t < 0.65 and t != late)

    late = np.inf  # statics look at the end first, whether the load grows
    line = r'PointForce "push": amplitude \(test_faults.py, line \d+\): ZeroDivisionError: '
    statics = ff.StaticOptions(load_steps=10, output=shared_tmp_path / "statics", quiet=True)
    with pytest.raises(ff.FunctionError, match=line) as raised:
        ff.solve_static(strip(amplitude), statics)
    assert raised.value.outcome.status.endswith(" after t = 0.5")
    COMM.barrier()
    assert [p.name for p in statics.output.glob("checkpoint_*")] == ["checkpoint_000005.h5"]
    late = 1.0
    modes = ff.ModeOptions(modes=2, time=1.0, start="equilibrium", output=shared_tmp_path / "modes")
    with pytest.raises(ValueError, match=line):
        ff.find_modes(strip(amplitude), modes)
    relaxed = ff.RelaxationOptions(at_time=1.0, output=shared_tmp_path / "relaxed", quiet=True)
    with pytest.raises(ValueError, match=line):
        ff.relax(strip(amplitude), relaxed)
    COMM.barrier()
    assert [path.name for path in shared_tmp_path.iterdir()] == ["statics"]


def test_a_first_step_that_fails_leaves_columns_without_rows() -> None:
    """A script that reads a column after its run does not end in a KeyError."""
    steel = ff.Material(2.1e11, 0.3, 7850.0)
    model = ff.Model("arm", mesh=ff.LineMesh.straight({"arm": [(0, 0, 0), (1, 0, 0)]}, elements=4))
    end = ff.Marker("arm", "end")
    model.add(
        ff.Gravity((0.0, 0.0, -1e10)),
        ff.Beam("arm", ff.Section.circle(0.02, steel)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("arm", "start")),
        ff.PositionProbe("tip", end),
        ff.EnergyProbe(),
    )
    seen: list[Any] = []
    options = ff.StaticOptions(gravity_load="constant", quiet=True)
    outcome = ff.solve_static(model, options, results=lambda history: seen.append(history) or {})
    assert outcome.status.startswith("the Newton iteration diverged at t = 0")
    assert {len(values) for values in outcome.history.values()} <= {0}
    assert ("tip_z" in outcome.history) == (COMM.rank == 0)
    assert not seen


def test_column_that_the_history_does_not_have() -> None:
    """It is named with those that there are, or with the rank that has them."""
    model = ff.Model("ball")
    model.add(ff.RigidBody("ball", 1.0, (1.0, 1.0, 1.0)), ff.PositionProbe("at", ff.Marker("ball")))
    history = ff.simulate(model, ff.RunOptions(dt=0.1, t_end=0.1, quiet=True)).history
    near, others = "did you mean at_z or at_y or at_x", "there are t, at_x, at_y, at_z"
    empty = "it is empty here, of several ranks the first has all columns"
    for name, known in (("at_zz", near), ("speed", others)):
        with pytest.raises(KeyError) as raised:
            history[name]
        (text,) = raised.value.args
        assert text == f'the history has no column "{name}": {empty if COMM.rank else known}'
        assert_on_page(text)


def test_speeds_before_one_that_fails(shared_tmp_path: Path) -> None:
    """Of a Campbell diagram: a probe, which one rank calls, fails at the third of five speeds."""

    def seen(t: float, hub: ff.MarkerState) -> list[float]:
        spin = float(hub.angular_velocity[2])
        return [{}["no key"] if spin > 2.5 else spin]

    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=4)
    hub, model = ff.Marker("rod", "start"), ff.Model("rotor", mesh=mesh)
    axis = (0.0, 0.0, 1.0)
    model.add(
        ff.Beam("rod", ff.Section.rectangle(0.01, 0.01, ff.Material(2e11, 0.3, 7800.0))),
        ff.Revolute("bearing", ff.Ground(), hub, axis=axis),
        ff.PrescribedAngle("drive", ff.Ground(), hub, axis=axis),
        ff.Probe("hub", hub, ["spin"], seen),
    )
    options = ff.CampbellOptions(
        modes=2, spin=1.0, spin_end=5.0, speeds=5, output=shared_tmp_path, quiet=True
    )
    with pytest.raises(ff.FunctionError) as raised:
        ff.sweep_spin(model, options)
    line = r"Probe \"hub\": seen \(test_faults.py, line \d+\): KeyError: 'no key'"
    assert re.fullmatch(line, str(raised.value))
    outcome = raised.value.outcome
    assert outcome.status == f"{raised.value} at the spin 3 rad/s"
    COMM.barrier()
    assert json.loads((shared_tmp_path / "summary.json").read_text())["status"] == outcome.status
    history = read_history(shared_tmp_path / "history.csv")
    # steady rotation: the speed to rounding; the failed one would be a third row
    np.testing.assert_allclose(history["spin"], [1.0, 2.0], rtol=1e-12)


# --- folders -------------------------------------------------------------------------------------


def test_one_run_in_a_folder(shared_tmp_path: Path) -> None:
    """A second one is refused and changes nothing; what a dead one leaves bars nobody."""
    other = FolderLock(shared_tmp_path)
    if COMM.rank == 0:
        other.take()
    COMM.barrier()
    before = sorted(path.name for path in shared_tmp_path.iterdir())
    other_run = r"another run, process \d+ on host \".+\"; wait"
    line = rf"output folder '{shared_tmp_path}' is in use by {other_run}"
    with pytest.raises(ValueError, match=line):
        ff.simulate(pendulum(Failing("nothing")), options(shared_tmp_path))
    assert sorted(path.name for path in shared_tmp_path.iterdir()) == before
    COMM.barrier()
    other.release()
    if COMM.rank == 0:
        (shared_tmp_path / ".flexfem_run").write_text("elsewhere\n1\n")  # of a run that was killed
    COMM.barrier()
    assert ff.simulate(pendulum(Failing("nothing")), options(shared_tmp_path)).status == "ok"
    COMM.barrier()
    assert not (shared_tmp_path / ".flexfem_run").exists()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("text", "free"),
    [("", True), (f"{os.uname().nodename}\n{2**22 + 1}\n", True), ("elsewhere\n1\n", False),
     (f"{os.uname().nodename}\n{os.getpid()}\n", False)],
    ids=["nobody's", "ended", "elsewhere", "running"],
)  # fmt: skip
def test_file_systems_without_locks(
    text: str, free: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process that the file names counts, if it is not known to have ended."""

    def flock(file: int, how: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("flexfem.io.folder_lock.fcntl.flock", flock)
    (tmp_path / ".flexfem_run").write_text(text)
    lock = FolderLock(tmp_path)
    if free:
        lock.take()
        lock.release()
        assert list(tmp_path.iterdir()) == []
    else:
        with pytest.raises(ValueError, match=r"is in use by .* \(remove '.*' if it has ended\)"):
            lock.take()
        assert (tmp_path / ".flexfem_run").read_text() == text


def removing(folder: Path, then: Callable[[], None]) -> ff.Model:
    """A run whose folder is removed after half of it."""

    def shown(t: float, bob: ff.MarkerState) -> list[float]:  # called on the first rank
        if 0.0065 < t < 0.0075:
            shutil.rmtree(folder)
            then()
        return [t]

    model = pendulum(Failing("nothing"))
    model.add(ff.Probe("removes", ff.Marker("bob"), ["gone"], shown))
    return model


def test_folder_is_removed(shared_tmp_path: Path) -> None:
    """The table is written again with all its rows, a checkpoint and the summary with it."""
    folder = shared_tmp_path / "results"
    sound = ff.simulate(pendulum(Failing("nothing")), options(None))
    with pytest.raises(OSError, match="was removed during the run, the table, a ch") as raised:
        ff.simulate(removing(folder, lambda: None), options(folder))
    COMM.barrier()
    status = f"{raised.value} after t = 0.009 s"
    assert json.loads((folder / "summary.json").read_text())["status"] == status
    table = read_history(folder / "history.csv")
    np.testing.assert_allclose(1e3 * table["t"], np.arange(10.0), atol=1e-5)
    if COMM.rank == 0:
        rows = len(table["t"])
        np.testing.assert_allclose(table["path_z"], sound.history["path_z"][:rows], atol=1e-12)
    names = {path.name for path in folder.iterdir()}
    assert names == {"summary.json", "history.csv", "checkpoint_000009.h5"}


def test_folder_is_anothers(shared_tmp_path: Path) -> None:
    """A run in its place by another process is not touched."""
    folder = shared_tmp_path / "results"

    def begin_another() -> None:
        folder.mkdir()
        (folder / "history.csv").write_text("t\n")

    with pytest.raises(OSError, match="it holds other results now, which are left as they are"):
        ff.simulate(removing(folder, begin_another), options(folder))
    COMM.barrier()
    assert [path.name for path in folder.iterdir()] == ["history.csv"]
    assert (folder / "history.csv").read_text() == "t\n"


def full_disk(name: str, after: int) -> Callable[..., Any]:
    """Function that opens files on a disk that is full after ``after`` files of a kind."""
    opened, usual = [0], Path.open

    def open_file(path: Path, mode: str = "r", *more: Any, **named: Any) -> Any:
        if name in path.name and "r" not in mode:
            opened[0] += 1
            if opened[0] > after:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return usual(path, mode, *more, **named)

    return open_file


@pytest.mark.parametrize(("name", "after"), [(".vtu", 6), (".pvd", 1), ("summary", 0)])
def test_disk_is_full(
    name: str, after: int, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "open", full_disk(name, after))
    with pytest.raises(OSError, match="No space left on device") as raised:
        ff.simulate(pendulum(Failing("nothing")), options(shared_tmp_path, checkpoint_every=2))
    assert raised.value.outcome.status.startswith(str(raised.value))
    COMM.barrier()
    assert not list(shared_tmp_path.rglob(".*"))  # nothing torn is left
    table = read_history(shared_tmp_path / "history.csv")
    assert np.isfinite(list(table.values())).all()
    checkpoint = COMM.bcast(max(shared_tmp_path.glob("checkpoint_*.h5")))
    COMM.barrier()
    monkeypatch.undo()
    more = options(shared_tmp_path, restart=checkpoint, t_end=2e-2)
    assert ff.simulate(pendulum(Failing("nothing")), more).status == "ok"


@pytest.mark.serial
def test_torn_row_is_cut(tmp_path: Path) -> None:
    """A row that the disk takes in part is removed; the table ends with a whole one."""
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    table = HistoryWriter(tmp_path / "history.csv", ["x"], MPI.COMM_SELF)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            table.write(0.0, [1.0 / 3.0])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (tmp_path / "history.csv").read_text() == "t,x\n"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # open files
@pytest.mark.parametrize(
    "where",
    [
        "run.recording.HistoryWriter.__init__",
        "run.recording.Recorder._continue",
        "motion.stepping.Simulation.advance",
    ],
)
@pytest.mark.filterwarnings("ignore:.*history.csv:pytest.PytestUnraisableExceptionWarning")
def test_restart_that_is_killed_works_again(
    where: str, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed at the table or at the first step."""
    sound = pendulum(Failing("nothing"))
    with pytest.raises(ff.FunctionError):
        ff.simulate(pendulum(Failing("motion")), options(shared_tmp_path))
    (checkpoint,) = COMM.bcast(list(shared_tmp_path.glob("checkpoint_*.h5")))
    more = options(shared_tmp_path, restart=checkpoint)

    def killed(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"flexfem.simulation.{where}", killed)
    with pytest.raises(KeyboardInterrupt):
        ff.simulate(sound, more)
    monkeypatch.undo()
    gc.collect()  # a process that is killed leaves no open files
    assert ff.simulate(sound, more).status == "ok"
    COMM.barrier()
    times = read_history(shared_tmp_path / "history.csv")["t"]
    # no row is missing or there twice
    np.testing.assert_allclose(times, 1e-3 * np.arange(16), atol=1e-9)


@pytest.mark.parametrize("start", [0.0, SOON, WHEN])
@pytest.mark.parametrize("only", [EVERY, LAST], ids=["everywhere", "on one rank"])
def test_equations_of_mechanisms(start: float, only: int | None, shared_tmp_path: Path) -> None:
    """Every rank solves them; a force fails at once or later, on all or on the last one."""

    def force(t: float) -> float:
        return {}["no key"] if t >= start and only in (EVERY, COMM.rank) else 0.3

    model = pair("beam", False)
    model = replace(model, forces=(replace(model.forces[0], force=force),))
    folder = shared_tmp_path / "new"
    with pytest.raises((ff.FunctionError, ValueError)) as raised:
        research.simulate_mechanism(model, options(folder))
    owner, late = "SchemedMotion" if start else model.forces[0].owner, start == WHEN
    words = re.escape(owner) + r": force \(test_faults.py, line \d+\): KeyError: 'no key'"
    assert re.fullmatch(words, str(raised.value))
    assert isinstance(raised.value, ValueError) is not late
    COMM.barrier()
    assert folder.exists() is late
    if late:
        status = json.loads((folder / "summary.json").read_text())["status"]
        assert status == raised.value.outcome.status
        assert len(list(folder.glob("checkpoint_*.h5"))) == 1
