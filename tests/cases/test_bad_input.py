# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wrong input of every kind: one line that names the culprit, exit code 2, nothing written."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexfem import cli
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

OWN_CASE = """\
import sys

import flexfem as ff
from flexfem import launch


def link(model, name="link_1", section=None):
    material = ff.Material(youngs_modulus=1e9, poisson_ratio=0.3, density=1000.0)
    model.add(ff.Beam(name, section or ff.Section.rectangle(0.01, 0.01, material), group="link_1"))
    return ff.Marker(name, "start")


def bob(model, *joints):
    model.add(ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)), *joints)


def pin(name, kind=ff.Spherical, y=0.0, **more):
    return kind(name, ff.Ground((0.0, y, 0.0)), ff.Marker("bob", offset=(-1.0, y, 0.0)), **more)


def build(what, mesh, size):
    model = ff.Model("m", mesh=None if mesh else ff.build_mesh("chain", links=1, elements=2))
    if mesh:
        model = ff.Model("m", mesh=ff.read_mesh(mesh))
        model.add(ff.Beam("rod", ff.Section.general([1.0] * 6, [1.0] * 6)))
    elif what == "good":
        bob(model, pin("pin"))
    elif what == "value on rank 1" and launch.rank() == 1:
        raise ValueError('Beam "rod": only on rank 1')
    elif what == "folder on rank 1" and launch.rank() == 1:
        open("/nothing/here")
    elif what == "bug on rank 1" and launch.rank() == 1:
        raise RuntimeError("a bug")
    elif what == "nothing":
        return None
    elif what == "type":
        model.add(ff.RigidBody("bob", "heavy", (1.0, 1.0, 1.0)))
    elif what == "negative mass":
        model.add(ff.RigidBody("bob", -2.0, (1.0, 1.0, 1.0)))
    elif what == "section":
        link(model, section=ff.Section.general([1.0, 1.0, 1.0, 0.0, 1.0, 1.0], [1.0] * 6))
    elif what == "group":
        model.add(ff.Beam("rod", ff.Section.general([1.0] * 6, [1.0] * 6), group="road"))
    elif what == "same name":
        bob(model, pin("bob"))
    elif what == "unknown body":
        bob(model, ff.Spherical("pin", ff.Ground(), ff.Marker("bib")))
    elif what == "unknown point":
        link(model)
        model.add(ff.Spherical("pin", ff.Ground(), ff.Marker("link_1", "middle")))
    elif what == "empty":
        pass
    elif what == "apart":
        bob(model, pin("pin"), ff.Spherical("far", ff.Ground((0.0, 0.0, 1.0)), ff.Marker("bob")))
    elif what == "beam twice":
        start = link(model)
        model.add(ff.Spherical("a", ff.Ground(), start), ff.Spherical("b", ff.Ground(), start))
    elif what == "pins twice":
        bob(model, pin("one"), pin("two"))
    elif what == "hinges":
        axis = (0.0, 1.0, 0.0)
        bob(model, *(pin(f"hinge_{i}", ff.Revolute, 0.1 * i, axis=axis) for i in range(6)))
    elif what == "inside":
        model.add(ff.RigidBody("crate", 9.0, (1, 1, 1), shape=ff.Box((3.0, 3.0, 3.0))))
        model.add(ff.RigidBody("bob", 1.0, (1, 1, 1), shape=ff.Sphere(0.1)), ff.Contact("all"))
    elif what == "stretched":
        drive = ff.PrescribedTranslation(
            "drive", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("bob"), lambda t: t, axis=(1.0, 0.0, 0.0)
        )
        bob(model, pin("pin"), drive)
    elif what == "drive":
        bob(model, pin("pin", ff.PrescribedTranslation, displacement=lambda t: (0.0, 0.0)))
    elif what == "mesh parameter":
        ff.build_mesh("chain", links=1, elements=0)
    elif what == "mesh name":
        ff.build_mesh("chains")
    else:
        bob(model, pin("pin"))
    return model


CASE = ff.Case(
    name="own", summary="", build=build, dt=1e-3, t_end=3e-3,
    options=(
        ff.Option("what", str, "good", "mistake"),
        ff.Option("mesh", str, "", "mesh file"),
        ff.Option("size", float, 1.0, "size", unit="m", above=0),
    ),
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
"""

NODES = "$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 2 0 0\n$EndNodes\n"
HEAD = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
ROD = '$PhysicalNames\n1\n1 1 "rod"\n$EndPhysicalNames\n'
LINES = "$Elements\n2\n1 1 2 1 1 1 2\n2 1 2 1 1 2 3\n$EndElements\n"
MESHES = {
    "rod.msh": HEAD + ROD + NODES + LINES,
    "rod.txt": HEAD + ROD + NODES + LINES,
    "rod.msh.opt": 'SystemCall "touch made_by_options";\n',
    "script.msh": 'SystemCall "touch made_by_a_script";\nExit;\n',
    "printf.msh": 'Printf("x") > "made_by_a_script";\n',
    "old.msh": HEAD.replace("2.2", "3.0") + ROD + NODES + LINES,
    "empty.msh": "",
    "noise.msh": "\x01\x02\x7f no mesh\n" * 20,
    "truncated.msh": (HEAD + ROD + NODES + LINES)[:105],
    "halved.msh": (HEAD + ROD + NODES + LINES)[:-32],
    "unnamed.msh": HEAD + NODES + LINES,
    "other.msh": HEAD + ROD.replace("rod", "bar") + NODES + LINES,
    "point.msh": HEAD
    + ROD.replace("1 1", "0 1")
    + NODES
    + "$Elements\n1\n1 15 2 1 1 1\n$EndElements\n",
    "cubic.msh": HEAD + ROD + NODES + "$Elements\n1\n1 26 2 1 1 1 3 2 2\n$EndElements\n",
    "short.msh": HEAD + ROD + NODES.replace("2 1 0 0", "2 0 0 0") + LINES,
    "nan.msh": HEAD + ROD + NODES.replace("2 1 0 0", "2 nan 0 0") + LINES,
}

# Arguments on the command line, and parts of the message.
COMMANDS = {
    "run slider_crank --elements 1": ("--elements", "'1'"),
    "run slider_crank --elements 2.0": ("--elements", "'2.0'"),
    "run slider_crank --dt 1e-3 --t-end 1e-4": ("dt 0.001 s exceeds t_end 0.0001 s",),
    "run slider_crank --links 3": ("--links",),
    "run chain --links 0": ("--links", "'0'"),
    "run solar_array --panels 1000000000": ("--panels", "<= 1000", "'1000000000'"),
    "run mesh_reflector --bays 6 --rings 1000000": ("--rings", "<= 1000", "'1000000'"),
    "run chain --elements many": ("--elements", "'many'"),
    "run heavy_top --spin slowly": ("--spin", "'slowly'", "fast, slow"),
    "run heavy_top --rho-inf 1.01": ("--rho-inf", "'1.01'"),
    "run heavy_top --tolerance 0.2": ("--tolerance", "'0.2'"),
    "run heavy_top --split-above 0": ("--split-above", "'0'"),
    "run heavy_top --every -1": ("--every", "'-1'"),
    "run heavy_top fast": ("fast",),
    "run heavy_top --start resting": ("--start", "'resting'", "given, equilibrium"),
    "run lee_frame --load-steps 0": ("--load-steps", "'0'"),
    "run lee_frame --arc-length 2": ("--arc-length", "'2'"),
    "run lee_frame --dt 1e-3": ("--dt",),
    "run lee_frame --arc-length 0 --branch 0.1": ("branch 0.1", "arc_length"),
    "run lee_frame --stop-column up --stop-value 1": ("stop_column 'up'", "down, right"),
    "run deep_arch --elements 5": ("elements must be even", "5"),
    "run bend_45 --torsion none": ("--torsion", "'none'", "square, polar"),
    "run parallel_manipulator --mode 4": ("--mode", "'4'", "1, 2, 3, torque"),
    "run parallel_manipulator --links rubber": ("--links", "'rubber'", "segments"),
    "run parallel_manipulator --flexible some": ("--flexible", "'some'"),
    "run parallel_manipulator --in-plane-height 0": ("--in-plane-height", "'0'"),
    "run parallel_manipulator --samples 5": ("--samples", "'5'"),
    "run parallel_manipulator --closure open": ("--closure", "'open'", "reduced"),
    "run parallel_manipulator --duration -1": ("--duration", "'-1'"),
    "run parallel_manipulator --base -1": ("--base", "'-1'"),
    "run parallel_manipulator --end-x 700": ("path must be in reach of all links", "A3"),
    "run parallel_manipulator --links fem --stiffening": ("(fem) must be without stiffening",),
    "run parallel_manipulator --path file": ("--path file and --path-file must go together",),
    "run parallel_manipulator --path file --path-file no.csv": ("history 'no.csv'",),
    "run manipulator_deployment --theory naive": ("--theory", "'naive'", "consistent"),
    "run manipulator_deployment --assumed-modes 0": ("--assumed-modes", "'0'"),
    "run spin_up --hub-radius -1": ("--hub-radius", "'-1'"),
    "run spin_up --bodies 0": ("--bodies", "'0'"),
    "run connecting_rod --frame middle": ("--frame", "'middle'", "mean_axes"),
    "run connecting_rod --internal-modes -1": ("--internal-modes", "'-1'"),
    "run connecting_rod --reduced nowhere/rod.h5": ("nowhere/rod.h5", "no such folder"),
    "run formalisms --formalism newton": ("--formalism", "'newton'", "maggi"),
    "run formalisms --elements 0": ("--elements", "'0'"),
    "run formalisms --rod-length 0.2": ("--rod-length", "above 0.259808 m", "got 0.2"),
    "run heavytop": ("heavytop", "heavy_top"),
    "run own": ("'own'", "own.py"),
    "run unlike": ("'unlike'", "chain"),
    "run nowhere/own.py": ("nowhere/own.py",),
    "run own.py --size 0": ("--size", "'0'"),
    "run own.py --size": ("--size",),
    "go heavy_top": ("'go'",),
}
FILES = {
    "--mesh missing.msh": ("missing.msh", "does not exist"),
    "--mesh folder.msh": ("folder.msh", "is a folder"),
    "--mesh rod.txt": ("rod.txt", ".msh"),
    "--mesh script.msh": ("script.msh", "scripts of gmsh are not executed"),
    "--mesh printf.msh": ("printf.msh", "scripts of gmsh are not executed"),
    "--mesh old.msh": (
        "old.msh",
        "format 3.0 of gmsh is not supported; save it in format 2.2, 4.0",
    ),
    "--mesh empty.msh": ("empty.msh",),
    "--mesh noise.msh": ("noise.msh",),
    "--mesh truncated.msh": ("truncated.msh",),
    "--mesh halved.msh": ("halved.msh",),
    "--mesh unnamed.msh": ('"rod"', "physical_1"),
    "--mesh other.msh": ('"rod"', "bar"),
    "--mesh point.msh": ("point.msh", "no lines"),
    "--mesh cubic.msh": ("cubic.msh", "no lines; it has 1 Line 4 (not used)"),
    "--mesh short.msh": ("short.msh", '"rod"', "zero length"),
    "--mesh nan.msh": ("nan.msh", "nan"),
    "--restart missing.h5": ("checkpoint 'missing.h5'", "No such file"),
    "--restart folder.msh": ("checkpoint 'folder.msh'", "Is a directory"),
    "--restart taken": ("checkpoint 'taken'", "is not a checkpoint of flexfem"),
    "--restart own.py": ("checkpoint 'own.py'", "is not a checkpoint of flexfem"),
    "--restart taken/below": ("checkpoint 'taken/below'", "Not a directory"),
    "--restart=": ("--restart", "''"),
    "--checkpoint-every -1": ("--checkpoint-every", "'-1'"),
    "--output taken": ("--output", "'taken'", "not a folder"),
    "--output taken/below": ("--output", "'taken/below'", "taken' is not a folder"),
    "--output ./folder.msh/../taken": ("--output", "taken", "not a folder"),
    "--output=": ("--output", "''"),
    f"--output {'x' * 300}": ("x" * 300,),
    "--output /proc/self/results": ("/proc/self/results",),
}
MODELS = {
    "nothing": ("case 'own'", "None"),
    "type": ('RigidBody "bob"', "mass", "'heavy'"),
    "negative mass": ('RigidBody "bob"', "mass", "-2.0"),
    "section": ("Section", "stiffness"),
    "group": ('Beam "rod"', '"road"'),
    "same name": ('Spherical "bob"', "RigidBody"),
    "unknown body": ('Spherical "pin"', '"bib"'),
    "unknown point": ("link_1", '"middle"'),
    "empty": ("no bodies",),
    "apart": ('Spherical "far"', "1"),
    "beam twice": ('Spherical "a", Spherical "b"', "3 of 6 constraints are redundant"),
    "pins twice": ('Spherical "one", Spherical "two"', "3 of 6 constraints are redundant"),
    "hinges": ('Revolute "hinge_3" and 2 more', "25 of 30 constraints are redundant"),
    "inside": ('Contact "all"', 'RigidBody "bob" is inside of RigidBody "crate" at (0, 0, 0) m'),
    "stretched": ('Spherical "pin", PrescribedTranslation "drive"', "1 of 4", "singular"),
    "drive": ('PrescribedTranslation "pin"', "displacement"),
    "mesh parameter": ('mesh "chain"', "elements", "0"),
    "mesh name": ('"chains"', "chain, "),
}
# Tried on two ranks as well: what each stage of a run refuses; the last two go wrong on one of them
# only.
ON_TWO_RANKS = {
    "--mesh script.msh": FILES["--mesh script.msh"],
    "--output taken": FILES["--output taken"],
    "--restart own.py": FILES["--restart own.py"],
    "--what=hinges": MODELS["hinges"],
    "--what=value on rank 1": ('Beam "rod": only on rank 1',),
    "--what=folder on rank 1": ("/nothing/here",),
}


@pytest.fixture
def here(command_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with an own case and wrong files."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "own.py").write_text(OWN_CASE)
    for name, text in MESHES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "taken").touch()
    (tmp_path / "folder.msh").mkdir()
    return tmp_path


def contents(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if "__pycache__" not in path.parts}


def check_message(text: str, parts: tuple[str, ...]) -> None:
    assert text.count("\n") == 1
    assert text.startswith("error: ")
    for part in parts:
        assert part in text


def refused(
    arguments: list[str], parts: tuple[str, ...], here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Run in this process: the message comes from compiled libraries as well as from Python."""
    before = contents(here)
    assert cli.command(arguments) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    check_message(captured.err, parts)
    assert_on_page(captured.err.removeprefix("error: ").rstrip())
    assert contents(here) == before


@pytest.mark.parametrize("line", COMMANDS)
def test_command_lines(line: str, here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    refused(line.split(), COMMANDS[line], here, capfd)


@pytest.mark.parametrize("line", FILES)
def test_meshes_and_outputs(line: str, here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    refused(["run", "own.py", *line.split()], FILES[line], here, capfd)


def test_info_does_not_execute_scripts(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    refused(["info", "own.py", "--mesh", "script.msh"], FILES["--mesh script.msh"], here, capfd)


@pytest.mark.parametrize("what", MODELS)
def test_models(what: str, here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    refused(["run", "own.py", "--what", what, "--output", "a/b"], MODELS[what], here, capfd)


@pytest.mark.parametrize("line", ON_TWO_RANKS)
def test_on_two_ranks(line: str, here: Path, run: Callable[..., Any]) -> None:
    before = contents(here)
    option, _, value = line.replace(" ", "=", 1 if "=" not in line else 0).partition("=")
    ended = run(2, here / "own.py", f"{option}={value}", cwd=here, timeout=60)
    assert (ended.returncode, ended.stdout) == (2, ""), ended.stderr
    check_message(ended.stderr, ON_TWO_RANKS[line])
    assert contents(here) == before


@pytest.mark.parametrize("where", ["build", "module"])
def test_bug_on_one_rank_ends_both(where: str, here: Path, run: Callable[..., Any]) -> None:
    script = here / "own.py"
    if where == "module":
        script.write_text(
            script.read_text().replace(
                "CASE =", "if launch.rank() == 1:\n    raise RuntimeError('a bug')\nCASE ="
            )
        )
    ended = run(2, script, "--what", "bug on rank 1", cwd=here, timeout=60)
    assert ended.returncode != 0
    assert ended.stderr.count("RuntimeError: a bug") == 1


def test_case_that_fails_on_one_rank_only(here: Path, run: Callable[..., Any]) -> None:
    (here / "half.py").write_text(
        "from flexfem import launch\nif launch.rank() == 1:\n    raise ValueError('half a case')\n"
        + OWN_CASE
    )
    (here / "flexfem_command.py").write_text(
        "import sys\nfrom flexfem.cli import command\nsys.exit(command())\n"
    )
    for more in ([], ["--help"]):
        ended = run(2, here / "flexfem_command.py", "run", "half.py", *more, cwd=here, timeout=60)
        assert ended.returncode == 2
        check_message(ended.stderr, ("half.py", "half a case"))


@pytest.mark.parametrize("arguments", [["--help"], ["--size", "0"]])
def test_one_rank_speaks_for_all(arguments: list[str], here: Path, run: Callable[..., Any]) -> None:
    ended = run(2, here / "own.py", *arguments, cwd=here, timeout=60)
    text = ended.stdout + ended.stderr
    assert text.count("--size") >= 1
    assert text.count("usage:") + text.count("error:") == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (here / "folder.msh").chmod(0o500)
    parts = ("--output", "no permission", "folder.msh")
    refused(["run", "own.py", "--output", "folder.msh/below"], parts, here, capfd)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_checkpoint_without_permission(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (here / "taken").chmod(0)
    refused(["run", "own.py", "--restart", "taken"], ("'taken'", "Permission denied"), here, capfd)


def test_relative_folders_are_created(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.command(["run", "own.py", "--quiet", "--output", "some/../new/folder"]) == 0
    assert (here / "new" / "folder" / "history.csv").is_file()
    assert capfd.readouterr() == ("", "")


def test_mesh_file_that_is_fine(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The options beside it stay unread."""
    assert cli.command(["run", "own.py", "--quiet", "--mesh", "rod.msh"]) == 0
    assert capfd.readouterr() == ("", "")
    assert not (here / "made_by_options").exists()
