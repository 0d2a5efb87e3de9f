# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command line: wrong input gives one line and exit code 2, nothing heavy is imported for help."""

import json
import os
import re
import signal
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import pytest

import flexfem as ff
from flexfem import cli, launch, resources
from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.modes import MODES, ModeOptions
from flexfem.case import Case
from flexfem.cli.commands import list as listing
from flexfem.options import Option

pytestmark = pytest.mark.serial

OWN_CASE = """\
import sys

import flexfem as ff


def build(count, length, shape, damped):
    if length == 3.0:
        raise ValueError("Beam 'rod': length 3.0 is unlucky")
    if length == 4.0:
        raise RuntimeError("a bug")
    if length == 5.0:
        raise KeyboardInterrupt
    return None if length == 6.0 else ff.Model()


CASE = ff.Case(
    name="own",
    summary="a case of the tests",
    build=build,
    options=(
        ff.Option("count", int, 4, "how many", minimum=1, maximum=100),
        ff.Option("length", float, 1.5, "100 % of the length", unit="m"),
        ff.Option("shape", str, "round", "form", choices=("round", "square")),
        ff.Option("damped", bool, False, "with a damper"),
    ),
    dt=1e-3,
    t_end=0.1,
    smoke={"count": 1, "t_end": 2e-3},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
"""

NO_MODES = """\
    if length == 7.0:
        from flexfem._checks import NumericalError

        raise NumericalError("body: only 1 of 9 modes were found")
"""

BAD = {
    "--dt 0": ("--dt", "'0'"),
    "--dt -1e-3": ("--dt", "'-1e-3'"),
    "--dt nan": ("--dt", "'nan'"),
    "--dt=inf": ("--dt", "'inf'"),
    "--dt 1e999": ("--dt", "'1e999'"),
    "--dt abc": ("--dt", "'abc'"),
    "--dt=": ("--dt", "''"),
    "--dt": ("--dt", "expected one argument"),
    "--dt 1": ("dt 1 s exceeds t_end 0.1 s",),
    "--dt 1e-300": ("dt", "t_end", "steps"),
    "--t-end -0.5": ("--t-end", "'-0.5'"),
    "--t-end -inf": ("--t-end", "'-inf'"),
    "--rho-inf 1.5": ("--rho-inf", "'1.5'"),
    "--rho-inf -0.1": ("--rho-inf", "'-0.1'"),
    "--every 0": ("--every", "'0'"),
    "--every 2.5": ("--every", "'2.5'"),
    "--tolerance 0": ("--tolerance", "'0'"),
    "--iteration-matrix often": ("--iteration-matrix", "'often'", "frozen"),
    "--count 0": ("--count", "'0'"),
    "--count 1e2": ("--count", "'1e2'"),
    "--count 101": ("--count", "'101'"),
    "--length nan": ("--length", "'nan'"),
    "--shape oval": ("--shape", "'oval'", "round, square"),
    "--damped=1": ("--damped",),
    "--unknown 3": ("--unknown",),
    "--ev 3": ("--ev",),
    "stray": ("stray",),
    "--quiet=yes": ("--quiet",),
    "--length 3": ("Beam 'rod': length 3.0 is unlucky",),
    "--length 6": ("case 'own'", "None"),
    "--output=": ("--output", "''"),
    "--output own.py": ("--output", "own.py"),
    "--output own.py/below": ("--output", "own.py"),
    "--output /proc/self/nothing": ("/proc/self/nothing",),
}


@pytest.fixture
def own_case(command_folder: Path) -> Path:
    """A case file in an otherwise empty working directory; hooks are put back afterwards."""
    path = command_folder / "own.py"
    path.write_text(OWN_CASE)
    return path


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Replace the simulation by a recorder of its arguments; it fails for t_end = 7."""
    calls: list[dict[str, Any]] = []

    def simulate(model: Any, options: RunOptions, **more: Any) -> types.SimpleNamespace:
        calls.append({"model": model, "options": options, **more})
        status = "no convergence at t = 1 s" if options.t_end == 7 else "ok"
        return types.SimpleNamespace(status=status, summary={})

    module = types.ModuleType("flexfem.simulation.dynamics")
    module.simulate = simulate  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "flexfem.simulation.dynamics", module)
    monkeypatch.setattr(ff.Model, "validate", lambda self: None)
    return calls


def run_python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(Path(ff.__file__).parents[1]), **environment},
    )


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """The only line on stderr; stdout must be empty."""
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.endswith("\n")
    return captured.err


@pytest.mark.parametrize("line", BAD)
def test_wrong_input_is_one_line(
    line: str,
    own_case: Path,
    runs: list[dict[str, Any]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.command(["run", str(own_case), *line.split()]) == 2
    message = one_line(capsys)
    assert message.startswith("error: ")
    for part in BAD[line]:
        assert part in message
    assert not runs
    assert {path.name for path in own_case.parent.iterdir()} <= {"own.py", "__pycache__"}


def test_newlines_in_values_stay_in_one_line(
    own_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["run", str(own_case), "--dt", "1\n2"]) == 2
    one_line(capsys)


def test_defaults_reach_the_simulation(
    own_case: Path, runs: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["run", str(own_case)]) == 0
    (call,) = runs
    assert call["case"] == "own"
    assert call["options"] == RunOptions(dt=1e-3, t_end=0.1, output=Path("results/own"))
    assert capsys.readouterr().out == "results are in results/own\n"


def test_given_values_win_over_smoke_values(own_case: Path) -> None:
    case = cli.load_case(str(own_case))
    line = "--smoke --dt 1e-4 --count 7 --length -2e-1 --damped --quiet --output a/b"
    _, parameters, options = cli.parse(case, line.split())
    assert parameters == {"count": 7, "length": -0.2, "shape": "round", "damped": True}
    assert options == RunOptions(dt=1e-4, t_end=2e-3, output=Path("a/b"), quiet=True)


def test_presets_come_with_a_choice(own_case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = cli.load_case(str(own_case))
    case.presets = {"shape": {"square": {"dt": 2e-3, "count": 9}}}
    seen = {}
    for line in ("", "--shape square", "--shape square --dt 3e-3", "--shape square --smoke"):
        _, parameters, options = cli.parse(case, line.split())
        seen[line] = options.dt, parameters["count"]
    assert list(seen.values()) == [(1e-3, 4), (2e-3, 9), (3e-3, 9), (2e-3, 1)]
    with pytest.raises(SystemExit):
        cli.parse(case, ["--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "(default: 0.001; 0.002 with --shape square)" in text


def test_failed_computation_gives_exit_code_1(
    own_case: Path, runs: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["run", str(own_case), "--t-end", "7"]) == 1
    assert one_line(capsys) == "failed: no convergence at t = 1 s\n"


def test_interrupt(
    own_case: Path, runs: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["run", str(own_case), "--length", "5"]) == 128 + signal.SIGINT
    assert one_line(capsys) == "interrupted\n"


def test_failure_while_the_model_is_made(
    own_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = own_case.read_text().replace("    return None if", NO_MODES + "    return None if")
    own_case.write_text(text)
    assert cli.command(["run", str(own_case), "--length", "7", "--output", "a/b"]) == 1
    assert one_line(capsys) == "failed: body: only 1 of 9 modes were found\n"
    assert not (own_case.parent / "a").exists()


def test_case_that_imports_what_is_not_there(
    own_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own_case.write_text("import not_installed\n" + own_case.read_text())
    assert cli.command(["run", str(own_case)]) == 2
    message = one_line(capsys)
    assert "own.py" in message
    assert "not_installed" in message


def test_who_reads_no_further_does_not_end_a_run() -> None:
    """Like ``| head``: the pipe is closed before anything is said."""
    program = (
        "import os, sys\n"
        "read, write = os.pipe(); os.dup2(write, 1); os.close(write); os.close(read)\n"
        "from flexfem import launch\n"
        "launch.say('lost'); launch.say('lost, too'); launch.say('heard', error=True)\n"
    )
    ended = run_python("-c", program)
    assert (ended.returncode, ended.stderr) == (0, "heard\n")


def test_errors_of_own_functions_are_one_line(own_case: Path) -> None:
    given = [str(own_case), "--length", "4", "--output", str(own_case.parent / "out")]
    line = r"error: build \(own.py, line \d+\): RuntimeError: a bug\n"
    done = run_python(*given)
    assert done.returncode == 2
    assert re.fullmatch(line, done.stderr)
    assert not (own_case.parent / "out").exists()
    done = run_python(*given, "--traceback")
    assert done.returncode == 2
    assert done.stderr.startswith("Traceback")
    assert re.fullmatch(line, done.stderr.splitlines(keepends=True)[-1])


def test_unexpected_error_ends_all_ranks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    aborted: list[int] = []
    world = types.SimpleNamespace(size=2, Abort=aborted.append)
    monkeypatch.setitem(sys.modules, "mpi4py", types.ModuleType("mpi4py"))
    sys.modules["mpi4py"].MPI = types.SimpleNamespace(COMM_WORLD=world)  # type: ignore[attr-defined]
    monkeypatch.setenv("PMI_SIZE", "2")
    launch.excepthook(RuntimeError, RuntimeError("a bug"), None)
    assert aborted == [1]
    assert "RuntimeError: a bug" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    ["run {own} --help", "run {own} --dt 0", "list", "run nothing", "sweep --help",
     "sweep {own} --vary count=1:9:4"],
)  # fmt: skip
def test_answers_without_importing_heavy_modules(own_case: Path, arguments: str) -> None:
    """Imports make --help slow; a clock would depend on the load of the machine."""
    program = (
        "import json, sys\nfrom flexfem.cli import command\n"
        "try:\n    command(sys.argv[1:])\n"
        "except SystemExit:\n    pass\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    done = run_python("-c", program, *arguments.format(own=own_case).split())
    loaded = set(json.loads(done.stdout.splitlines()[-1]))
    assert not loaded & {"dolfinx", "petsc4py", "mpi4py", "numba", "gmsh", "ufl", "h5py", "pyvista"}


def test_help_explains_options_with_units_and_defaults(
    own_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.command(["run", str(own_case), "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "--length X 100 % of the length [m] (default: 1.5)" in text
    assert "--t-end X end of the simulated time [s] (default: 0.1)" in text
    assert "--output DIR folder of the results (default: results/own)" in text


def test_list_names_every_shipped_case(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.command(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(resources.shipped_files("cases"))


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.command(["--version"])
    assert capsys.readouterr().out == f"flexfem {ff.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ([], "COMMAND"),
        (["walk"], "walk"),
        (["run"], "NAME"),
        (["run", "--dt", "1"], "--dt"),
        (["list", "all"], "all"),
        (["run", "slider_crnk"], "slider_crank"),
        (["run", "qqqqqq"], "slider_crank"),
        (["run", "missing.py"], "missing.py"),
        (["run", "./data.msh"], "data.msh"),
        (["run", "broken.py"], "broken.py', line 2"),
        (["run", "empty.py"], "does not define CASE"),
        (["run", "folder.py"], "folder.py"),
    ],
)
def test_what_cannot_be_run(
    arguments: list[str],
    part: str,
    own_case: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(listing, "shipped_files", lambda _: {"slider_crank": own_case})
    Path("data.msh").touch()
    Path("empty.py").touch()
    Path("broken.py").write_text("x = 1\nx +\n")
    Path("folder.py").mkdir()
    assert cli.command(arguments) == 2
    assert part in one_line(capsys)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"name": "Two words"}, "Two words"),
        ({"options": (ff.Option("dt", float, 1.0, ""),)}, "'dt'"),
        ({"options": (ff.Option("a", int, 1, ""), ff.Option("a", int, 1, ""))}, "'a'"),
        ({"smoke": {"elments": 1}}, "elments"),
        ({"smoke": {"t_end": -1.0}}, "t_end"),
        ({"presets": {"form": {"round": {"dt": 1.0}}}}, "form"),
        ({"presets": {"every": {1: {"elments": 1}}}}, "elments"),
        ({"presets": {"every": {0: {"dt": 1.0}}}}, "every"),
        ({"presets": {"every": {1: {"dt": -1.0}}}}, "dt"),
        ({"dt": float("nan")}, "nan"),
        ({"rho_inf": 2.0}, "2.0"),
    ],
)
def test_case_declarations_are_checked(changes: dict[str, Any], part: str) -> None:
    valid = {"name": "own", "summary": "", "build": lambda: None, "dt": 1e-3, "t_end": 1.0}
    with pytest.raises(ValueError, match=part):
        ff.Case(**(valid | changes))


@pytest.mark.parametrize(
    "changes",
    [{"dt": "1"}, {"dt": True}, {"every": 2.0}, {"rho_inf": None}, {"iteration_matrix": 1}],
)
def test_run_options_refuse_wrong_types(changes: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=f"RunOptions: {next(iter(changes))} must be"):
        RunOptions(**({"dt": 1e-3, "t_end": 1.0} | changes))


def test_another_analysis_has_its_own_options_and_folder(own_case: Path) -> None:
    case = cli.load_case(str(own_case))
    chosen, parameters, options = cli.parse(
        case, ["--analysis", "modes", "--count", "7", "--modes", "3"]
    )
    assert chosen.analysis is MODES
    assert parameters["count"] == 7
    assert options == ModeOptions(modes=3, output=Path("results/own_modes"))
    assert cli.parse(case, ["--analysis", "dynamics"])[0] is case


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ("--analysis wave", ["--analysis", "'wave'", "'modes'"]),
        ("--analysis", ["--analysis"]),
        ("--analysis modes --dt 1e-3", ["--dt"]),
        ("--state file.h5", ["--state"]),
    ],
)
def test_other_analyses_that_will_not_do(
    own_case: Path, capsys: pytest.CaptureFixture[str], line: str, parts: list[str]
) -> None:
    assert cli.command(["run", str(own_case), *line.split()]) == 2
    message = one_line(capsys)
    assert all(part in message for part in parts)


def test_names_of_options_that_clash_with_those_of_the_analysis(own_case: Path) -> None:
    case = cli.load_case(str(own_case))
    clashing = Case("own", "", case.build, [Option("target", int, 1, "of it")], dt=1.0, t_end=1.0)
    with pytest.raises(cli.UsageError, match="--analysis: Case 'own': option name 'target'"):
        cli.parse(clashing, ["--analysis", "modes"])
