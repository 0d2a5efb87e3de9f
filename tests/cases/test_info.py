# SPDX-License-Identifier: LGPL-3.0-or-later
"""``flexfem info``: every shipped case, its options, exit codes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import flexfem as ff
from flexfem import cli
from flexfem.resources import shipped_files

pytestmark = pytest.mark.serial

CASES = sorted(shipped_files("cases"))
#: Findings of the checks in shipped cases, which are intended: drives of the truss with linear
#: control start at once.
EXPECTED = {
    "deployable_truss": {"velocities"},
    "sliding_beam": {"locking"},  # of the few elements of smoke runs
    "solar_array": {"locking"},
}
#: Cases with equations of their own.
NO_MODEL = {"formalisms", "manipulator_deployment", "spin_up"}

OWN = """\
import flexfem as ff


def build(mass):
    model = ff.Model("own")
    model.add(ff.RigidBody("bob", mass, (1, 1, 1)))
    model.add(ff.Spherical("pin", ff.Ground(), ff.Marker("bob")))
    return model


CASE = ff.Case(
    name="own",
    summary="a pendulum that nothing moves",
    build=build,
    options=(ff.Option("mass", float, 2.0, "of the bob", unit="kg", above=0),),
    dt=1e-3,
    t_end=1.0,
)
"""


@pytest.fixture
def own_case(command_folder: Path) -> Path:
    path = command_folder / "own.py"
    path.write_text(OWN)
    return path


@pytest.mark.parametrize("name", CASES)
def test_shipped_cases(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    assert cli.command(["info", name, "--smoke", "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert {finding["check"] for finding in values["warnings"]} == EXPECTED.get(name, set())
    if name not in NO_MODEL:
        assert values["total"]["mass"] > 0.0
        assert values["degrees_of_freedom"] > 0
    assert not list(tmp_path.iterdir())


def test_text_of_a_case(own_case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.command(["info", "own.py", "--mass", "3"]) == 0
    text = capsys.readouterr().out
    assert 'Model "own"' in text
    assert "together 3 kg" in text
    assert "warnings: 1\n  [loads]" in text
    assert cli.command(["info", "own.py", "--strict"]) == 1
    # other analyses than the case's own have other checks, options and folders
    assert cli.command(["info", "own.py", "--analysis", "statics", "--strict"]) == 1
    assert "3 ways" in capsys.readouterr().out
    assert cli.command(["info", "own.py", "--analysis", "modes", "--strict"]) == 0
    assert sorted(path.name for path in own_case.parent.iterdir()) in (
        ["own.py"], ["__pycache__", "own.py"],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["own.py", "--mass", "-1"], "mass"),
        (["own.py", "--masses", "1"], "--masses"),
        (["nothing"], "unknown case"),
        ([], "NAME"),
        (["--strict"], "NAME"),
    ],
)
def test_wrong_input_is_one_line(
    arguments: list[str], words: str, own_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.command(["info", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert words in captured.err


#: A beam under a load whose function fails, which the check of the model calls.
LOADED = """\
    line = ff.NurbsCurve.line((0, 0, 0), (1, 0, 0))
    section = ff.Section.circle(0.1, ff.Material(1e9, 0.3, 1e3))
    model.add(ff.Beam("rod", section, curve=line, formulation="nurbs"))
    model.add(ff.LineLoad("load", "rod", lambda s: 1 / 0))
"""


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("    1 / 0\n", "build (own.py, line 8): ZeroDivisionError"),
        ("    raise SystemExit(0)\n", "build (own.py, line 8): sys.exit(0)"),
        (LOADED, "lambda (own.py, line 11): ZeroDivisionError"),
    ],
    ids=["fault", "exit", "function of a load"],
)
def test_faults_of_a_case_file_are_one_line(
    lines: str, words: str, own_case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They ended with Python's traceback, or with exit code 0 and nothing said."""
    own_case.write_text(OWN.replace("    return model", f"{lines}    return model"))
    assert cli.command(["info", "own.py"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert words in captured.err


def test_help_tells_the_flags(own_case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--help"], ["own.py", "--help"]):
        with pytest.raises(SystemExit) as done:
            cli.command(["info", *arguments])
        assert done.value.code == 0
        text = capsys.readouterr().out
        assert "--strict" in text
        assert "--json" in text


def test_dolfinx_and_petsc_are_not_needed(own_case: Path) -> None:
    program = (
        "import sys\nfrom flexfem import cli\ncli.command(['info', 'own.py'])\n"
        "print('imported:', *(set(sys.modules) & {'dolfinx', 'petsc4py', 'gmsh'}))"
    )
    root = str(Path(ff.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": root, "PATH": "/usr/bin:/bin", "HOME": str(own_case.parent)},
    )
    assert done.stdout.splitlines()[-1] == "imported:"
