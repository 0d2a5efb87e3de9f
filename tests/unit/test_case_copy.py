# SPDX-License-Identifier: LGPL-3.0-or-later
"""Copies of cases run by their own files; nothing of the user's is replaced."""

import re
from pathlib import Path

import pytest

import flexfem as ff
from flexfem import cli
from flexfem.case import load_case
from flexfem.resources import shipped_files

pytestmark = pytest.mark.serial

#: A rod along x. Parameters of the library are positive, those of a user's script may be negative.
MESH = """\
import gmsh


def build(*, length: float = 1.0) -> None:
    ends = [gmsh.model.geo.addPoint(x, 0.0, 0.0) for x in (0.0, length)]
    line = gmsh.model.geo.addLine(*ends)
    gmsh.model.geo.addPhysicalGroup(1, [line], name="rod")
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(1)
"""


@pytest.mark.parametrize("name", shipped_files("cases"))
def test_every_case(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The copy is a case of the name of its file, and names no mesh of the library."""
    file = tmp_path / "own.py"
    assert cli.command(["copy", name, str(file)]) == 0
    written = capsys.readouterr().out.split()
    assert written == [str(file), *(str(p) for p in sorted(tmp_path.glob("own_*_mesh.py")))]
    assert load_case(file).name == "own"
    text = file.read_text()
    assert all(f'mesh("{mesh}"' not in text for mesh in shipped_files("meshes"))
    assert f"cases/{name}.py" not in text
    # commands of its text run the copy: a sweep of the shipped case would leave changes out
    assert re.search(rf"(run|sweep) {name}\b|results/{name}\b", text) is None


def test_copy_follows_its_mesh(tmp_path: Path) -> None:
    """A change of the copied script is in the model."""
    file = tmp_path / "own.py"
    assert cli.command(["copy", "slider_crank", str(file)]) == 0
    before = load_case(file).model(elements=4).mesh
    script = tmp_path / "own_slider_crank_mesh.py"
    script.write_text(script.read_text().replace("total = length_1", "total = 1.0 + length_1"))
    after = load_case(file).model(elements=4).mesh
    assert after.points[:, 0].max() == pytest.approx(before.points[:, 0].max() + 1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["slider"], "unknown case 'slider': did you mean slider_crank"),
        (["./own.py"], "'./own.py' is a file: copies are made of shipped cases"),
        (["chain", "chain.msh"], "'chain.msh' must be a Python file"),
        (["chain", "a chain.py"], "'a chain.py' must be a Python file"),
        (["chain", "none/chain.py"], "No such file or directory: 'none/chain.py'"),
        (["chain", "taken.py"], "'taken.py' exists, a copy does not replace it"),
        (["chain", "own.py"], "'own_chain_mesh.py' exists, a copy does not replace it"),
    ],
)
def test_refused(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("taken.py").write_text("mine")
    Path("own_chain_mesh.py").write_text("mine")
    assert cli.command(["copy", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {
        "taken.py": "mine",
        "own_chain_mesh.py": "mine",
    }


def test_script_of_a_mesh(tmp_path: Path) -> None:
    script = tmp_path / "rod.py"
    script.write_text(MESH)
    assert ff.build_mesh(script, length=3.0).points[:, 0].max() == 3.0
    assert ff.build_mesh(str(script), length=-2.0).points[:, 0].min() == -2.0
    with pytest.raises(ValueError, match='has no parameter "width"'):
        ff.build_mesh(script, width=3.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("build = 3", "does not define a function build"),
        ("def build(:", "line 1"),
        ("raise SystemExit(0)", r"line 1\): sys.exit\(0\)"),
    ],
)
def test_bad_scripts(text: str, message: str, tmp_path: Path) -> None:
    script = tmp_path / "bad.py"
    script.write_text(text)
    with pytest.raises(ValueError, match=message):
        ff.build_mesh(script)


def test_missing_script() -> None:
    with pytest.raises((OSError, ValueError), match=r"gone\.py"):
        ff.build_mesh("gone.py")
