# SPDX-License-Identifier: LGPL-3.0-or-later
"""Display during a run, and runs that a signal ends; the same on any number of ranks."""

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.io import progress, read_history
from flexfem.launch import Interrupted
from flexfem.options import progress_kind

COMM = MPI.COMM_WORLD
STIFFNESS = 400.0


def bouncer(probed: bool, amplitude: Callable[[float], float] | None = None) -> ff.Model:
    """A mass of 2 kg on a slide with a spring of 400 N/m to the ground, pulled by 40 N."""
    at_rest = ff.Ground((-1.0, 0.0, 0.0))
    model = ff.Model("bouncer")
    model.add(
        ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1)),
        ff.Prismatic("slide", ff.Ground(), ff.Marker("bob"), axis=(1.0, 0.0, 0.0)),
        ff.SpringDamper(
            "spring", at_rest, ff.Marker("bob"), stiffness=STIFFNESS, rest_length=1.0
        ),
        ff.PointForce("pull", ff.Marker("bob"), (40.0, 0.0, 0.0), amplitude=amplitude),
        ff.PositionProbe("path", ff.Marker("bob")),
    )  # fmt: skip
    if probed:
        model.add(ff.EnergyProbe())
    return model


@pytest.fixture
def every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """All states are shown, however quickly they come."""
    monkeypatch.setattr(progress.Progress, "due", property(lambda self: self.enabled))


def told(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Lines on stderr but for warnings."""
    return [
        line for line in capsys.readouterr().err.splitlines() if not line.startswith("warning: ")
    ]


def shown(text: str, word: str) -> float:
    """The number after a word in a line."""
    found = re.search(rf"{word} (\S+)( J|,|$)", text)
    assert found, (word, text)
    return float(found[1])


@pytest.mark.parametrize("probed", [False, True])
@pytest.mark.parametrize("adaptive", [False, True])
def test_lines_show_energies(
    probed: bool, adaptive: bool, every_step: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Energies by closed form; looking at them changes nothing of the motion."""
    numbers: dict[str, Any] = {
        "dt": 0.01, "t_end": 0.1, "adaptive": adaptive, "error_tolerance": 1e-4,
    }  # fmt: skip
    quiet = ff.simulate(bouncer(probed), ff.RunOptions(**numbers))
    assert told(capsys) == []
    loud = ff.simulate(bouncer(probed), ff.RunOptions(**numbers, progress="lines"))
    lines = told(capsys)
    if COMM.rank:
        assert not lines
        return
    for name, column in quiet.history.items():
        np.testing.assert_array_equal(column, loud.history[name])  # to the last bit
    assert len(lines) == 12  # eleven instants and the end
    assert "starts: t = 0 of 0.1 s, 0 iterations" in lines[0]
    assert re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d  50.0% 0:00:0\d, 0:00:0\d left: ", lines[5])
    x = loud.history["path_x"][np.isclose(loud.history["t"], 0.05)][0]
    strain, kinetic = shown(lines[5], "strain"), shown(lines[5], "kinetic")
    # four digits are shown; half the energy or that of another instant would be off by a tenth
    assert strain == pytest.approx(0.5 * STIFFNESS * x**2, rel=1e-3)
    # the force's work is shared; the scheme's own error is about 1e-3 of it
    assert kinetic == pytest.approx(40.0 * x - strain, rel=2e-2)
    assert ("step 0.0" in lines[5]) is adaptive
    assert ("balance" in lines[5]) is probed
    assert "contacts" not in lines[5]


def test_lines_show_contacts(every_step: None, capsys: pytest.CaptureFixture[str]) -> None:
    """A square of four nodes that falls flat on a plane: no contact, then four that rub."""
    u = np.array([-0.05, 0.05])
    mesh = ff.SurfaceMesh.grid("sheet", u, u, lambda p: np.c_[p, np.full(len(p), 1e-3 + 5e-4)])
    material = ff.Material(1e6, 0.3, 1000.0)

    def landing(progress: str) -> Any:
        model = ff.Model("landing", surface=mesh)
        model.add(
            ff.Gravity((2.0, 0.0, -9.81)),
            ff.Shell("sheet", ff.ShellSection.isotropic(1e-3, material)),
            ff.Contact("landing", "sheet", surfaces=ff.RigidPlane(ff.Ground()), friction=0.1),
            ff.MomentumProbe("sum"),
        )
        return ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=0.04, progress=progress)).history

    quiet = landing("none")
    assert told(capsys) == []
    loud = landing("lines")
    lines = told(capsys)
    for name, column in quiet.items():
        np.testing.assert_array_equal(column, loud[name])  # to the last bit
    if COMM.rank == 0:
        counts = [int(one) for one in re.findall(r"(\d+) contacts", "\n".join(lines))]
        assert counts[0] == 0
        assert max(counts) == 4, counts


@pytest.mark.serial
def test_what_costs_time_is_shown_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    bar = progress.Progress(1.0, True, how="lines:10")
    assert bar.due
    bar.update(0.1, 1, 1, cost=0.1)
    now[0] = 9.9
    assert not bar.due
    now[0] = 10.1
    assert bar.due
    bar.update(0.2, 1, 1, cost=0.4)  # at most a fiftieth of the time
    now[0] = 30.0
    assert not bar.due
    now[0] = 30.2
    assert bar.due
    bar.update(0.3, 1, 1, cost=7.0)  # but a user wants to see something
    now[0] = 60.1
    assert not bar.due
    now[0] = 60.3
    assert bar.due


@pytest.mark.serial
@pytest.mark.parametrize("text", ["often", "bar:3", "lines:", "lines:x", "lines:0", "lines:nan"])
def test_ways_that_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=f'^progress.*got "{text}"'):
        progress_kind(text)
    with pytest.raises(ValueError, match="RunOptions: progress must be auto, bar, lines"):
        ff.RunOptions(dt=0.1, t_end=1.0, progress=text)


def test_statics_end_in_order(shared_tmp_path: Path) -> None:
    """The step during which the last rank gets a signal is the last one."""

    def grows(t: float) -> float:
        if COMM.rank == COMM.size - 1 and 0.45 < t < 0.55 and not sent:
            sent.append(t)
            os.kill(os.getpid(), signal.SIGTERM)
        return t

    sent: list[float] = []
    options = ff.StaticOptions(load_steps=10, output=shared_tmp_path / "path")
    with pytest.raises(
        Interrupted, match=r"^interrupted at t = 0\.5, go on with restart="
    ) as caught:
        ff.solve_static(bouncer(False, grows), options)
    assert caught.value.code == 128 + signal.SIGTERM
    assert caught.value.checkpoint == options.output / "checkpoint_000005.h5"
    assert caught.value.outcome.status == "interrupted at t = 0.5"  # for interactive work
    COMM.Barrier()
    history = read_history(options.output / "history.csv")
    np.testing.assert_allclose(history["t"], np.arange(6) / 10, atol=1e-12)
    # equilibrium of spring and force, to the tolerance of 1e-9 or so
    np.testing.assert_allclose(history["path_x"], 40.0 / STIFFNESS * history["t"], atol=1e-7)
    assert "interrupted at t = 0.5" in (options.output / "summary.json").read_text()
