# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that end early and go on, as a user starts them: signals, kills, other numbers of ranks."""

import json
import os
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexfem.io import read_history

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
SPAGHETTI = ROOT / "cases" / "flying_spaghetti.py"

# From a checkpoint with models of the restart tests, whose rows and bodies are divided in another
# way by another number of ranks.
STAGE = """\
import importlib.util, sys
from pathlib import Path
import flexfem as ff

spec = importlib.util.spec_from_file_location("models", sys.argv[1])
models = importlib.util.module_from_spec(spec)
spec.loader.exec_module(models)
for name in ("bouncing", "sliding", "sheet", "heated"):
    build, values = models.MODELS[name]
    steps = round(values["t_end"] / values["dt"])
    half = steps // 2
    folder, file = Path(sys.argv[2]) / name, None
    folder.mkdir(parents=True, exist_ok=True)
    if len(sys.argv) > 3:
        file = Path(sys.argv[3]) / name / f"checkpoint_{half:06d}.h5"
    options = models.options(
        name, folder, t_end=steps * values["dt"], checkpoint_every=half, restart=file
    )
    assert ff.simulate(build(), options).status == "ok"
"""


def assert_same(folder: Path, reference: Path) -> None:
    """Histories agree to 1e-9, from a restart on: forgotten state shows as 1e-8 and more."""
    one, other = (read_history(f / "history.csv") for f in (reference, folder))
    assert list(one) == list(other)
    count = len(other["t"])
    assert count > 0.4 * len(one["t"])
    one = {name: values[-count:] for name, values in one.items()}
    for column, values in one.items():
        family = [v for k, v in one.items() if k.rpartition("_")[0] == column.rpartition("_")[0]]
        error = np.abs(values - other[column]).max()
        assert error <= 1e-9 * max(np.abs(v).max() for v in family), (folder.name, column)


@pytest.mark.slow
def test_other_numbers_of_ranks(tmp_path: Path, run: Callable[..., object]) -> None:
    """1 -> 2 ranks, beams split and whole; the policy's own memory included."""
    script = tmp_path / "stage.py"
    script.write_text(STAGE)
    models = ROOT / "tests" / "unit" / "test_restart.py"
    full, part = tmp_path / "full", tmp_path / "part"
    for ranks, folders in (1, [full]), (2, [part, full]):
        ended = run(ranks, script, models, *folders, timeout=600)
        assert (ended.returncode, ended.stderr) == (0, "")
    references = sorted(full.iterdir())
    assert len(references) == 4
    for reference in references:
        assert_same(part / reference.name, reference)


def descendants(pid: int) -> list[int]:
    """Processes started by a process, and by those."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except FileNotFoundError:
        return []
    return [p for child in map(int, children) for p in (child, *descendants(child))]


def ranks_of(process: subprocess.Popen[str]) -> list[int]:
    """Processes that run Python: all but those of the launcher."""
    family = [process.pid, *descendants(process.pid)]
    return [p for p in family if "python" in (Path(f"/proc/{p}/exe").resolve().name)]


def start(command: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + 120.0
    while time.monotonic() < end and process.poll() is None:
        if condition():
            return
        time.sleep(0.01)
    process.kill()
    pytest.fail(f"nothing happened: {process.communicate()}")


@pytest.mark.slow
def test_killed_at_a_random_moment(
    tmp_path: Path, environment: dict[str, str], command_line: Callable[..., list[str]],
    run: Callable[..., subprocess.CompletedProcess[str]], rng: np.random.Generator,
) -> None:  # fmt: skip
    """kill -9 of two ranks, most of whose time goes into checkpoints; the end on three."""
    options = ["--elements", "6", "--dt", "0.1", "--split-above", "1", "--t-end", "5", "--quiet"]
    reference, folder = tmp_path / "reference", tmp_path / "killed"
    ended = run(1, SPAGHETTI, *options, "--output", reference)
    assert ended.returncode == 0
    options += ["--output", str(folder), "--checkpoint-every"]

    def newest() -> int:
        return max((int(p.stem[-6:]) for p in folder.glob("checkpoint_*.h5")), default=0)

    goal = int(rng.integers(1, 9))
    process = start(command_line(2, SPAGHETTI, *options, 1), environment)
    wait_for(lambda: newest() >= goal, process)
    time.sleep(float(rng.uniform(0.0, 0.02)))
    for pid in ranks_of(process):
        os.kill(pid, signal.SIGKILL)
    process.communicate(timeout=60)
    assert process.returncode != 0, "killed too late"
    files = sorted(folder.glob("checkpoint_*.h5"))
    assert 1 <= len(files) <= 3  # the oldest one may not have been removed yet
    ended = run(3, SPAGHETTI, *options, 100, "--restart", files[-1])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert_same(folder, reference)
    assert len(read_history(folder / "history.csv")["t"]) == 51
    assert len(list(folder.glob("checkpoint_*.h5"))) == 2
    assert not list(folder.glob(".*"))


@pytest.mark.parametrize(
    ("ranks", "number", "target", "on"),
    [
        pytest.param(1, signal.SIGINT, "all", True, marks=pytest.mark.slow),
        (1, signal.SIGHUP, "all", False),
        pytest.param(2, signal.SIGTERM, "last rank", True, marks=pytest.mark.slow),
    ],
)
def test_signals_end_in_order(
    ranks: int, number: signal.Signals, target: str, on: bool, tmp_path: Path,
    environment: dict[str, str], command_line: Callable[..., list[str]],
    run: Callable[..., subprocess.CompletedProcess[str]],
) -> None:  # fmt: skip
    """One line says how to go on, and doing so continues history and fields.

    Signals end a run alike: with ``on``, one of them for each number of ranks, it goes on.
    """
    folder = tmp_path / "results"
    options = ["--elements", "4", "--dt", "1e-4", "--every", "5", "--output", str(folder)]
    process = start(command_line(ranks, SPAGHETTI, *options), environment)
    table = folder / "history.csv"  # before its first rows a rank may not be listening yet
    wait_for(lambda: table.exists() and table.read_text().count("\n") > 5, process)
    pids = ranks_of(process)
    os.kill(process.pid if target == "all" else pids[-1], number)
    text = "".join(process.communicate(timeout=60))
    assert process.returncode == 128 + number
    # one beam on two ranks is warned of
    lines = [line for line in text.splitlines() if not line.startswith(("[mpiexec@", "warning: "))]
    assert len(lines) == 1
    found = re.fullmatch(
        r"interrupted at t = (\S+) s, go on with: (.+) --restart (\S+/checkpoint_(\d{6,})\.h5)",
        lines[0],
    )
    assert found
    launched, _, _ = found[2].partition(str(SPAGHETTI))  # mpirun and python, by name or path
    assert ("mpirun -n 2 " in launched) is (ranks == 2)
    assert found[2].endswith(shlex.join([str(SPAGHETTI), *options]))
    step = int(found[4])
    assert float(found[1]) == pytest.approx(1e-4 * step, rel=1e-5)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"] == f"interrupted at t = {found[1]} s"
    assert summary["steps"] == step
    assert len(read_history(folder / "history.csv")["t"]) == step + 1
    if not on:
        assert Path(found[3]).is_file()
        return
    end = 1e-4 * (step + 20)
    ended = run(3 - ranks, SPAGHETTI, *options, "--restart", found[3], "--t-end", end)
    assert ended.returncode == 0
    assert all(line.startswith("warning: ") for line in ended.stderr.splitlines())
    times = read_history(folder / "history.csv")["t"]
    np.testing.assert_allclose(times, 1e-4 * np.arange(step + 21), rtol=1e-12)
    text = (folder / "beams.pvd").read_text()
    steps = {round(float(t) / 1e-4) for t in re.findall(r'timestep="(\S+)"', text)}
    assert steps == {*range(0, step + 20, 5), step + 20}


def test_second_signal_ends_at_once(
    tmp_path: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    script = tmp_path / "hang.py"
    script.write_text(
        "import os, signal, time\nfrom flexfem.launch import StopSignals\n"
        "with StopSignals() as signals:\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    os.kill(os.getpid(), signal.SIGTERM)  # at once: passed on twice\n"
        "    assert signals.received == signal.SIGTERM\n"
        "    time.sleep(1.1)\n"
        "    try:\n        os.kill(os.getpid(), signal.SIGINT)\n        time.sleep(5)\n"
        "    except KeyboardInterrupt:\n        print('ended')\n"
        "assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does\n"
        "with StopSignals() as signals:\n    os.kill(os.getpid(), signal.SIGHUP)\n"
        "assert signals.received == 0\n"
    )
    ended = run(1, script, timeout=30)
    assert (ended.stdout, ended.stderr) == ("ended\n", "")


@pytest.mark.parametrize("ranks", [1, 2])
def test_signals_before_the_first_step_end_in_one_line(
    tmp_path: Path, ranks: int, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    """While loops are compiled, too: PETSc's own handlers print pages about debuggers."""
    script = tmp_path / "setting_up.py"
    script.write_text(
        "import os, signal, sys, time\nfrom flexfem.cli.usage import exit_code\n"
        "from flexfem.installation import load_dolfinx\n"
        "def long():\n"
        "    load_dolfinx()\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    time.sleep(20)\n"
        "sys.exit(exit_code(long, []))\n"
    )
    ended = run(ranks, script, timeout=60)
    assert ended.returncode == 128 + signal.SIGTERM
    assert (ended.stdout, ended.stderr) == ("", "interrupted\n")
