# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled code is taken only from folders where no one else can have put something."""

import os
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import flexfem._trust as module
from flexfem._trust import private_folder, trusted
from flexfem.kernels.ffcx_options import kernel_folder

pytestmark = pytest.mark.serial

ME = os.geteuid()


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """Forget the results for folders that were checked before."""
    for memory in (module._tell, module._user, module._group, kernel_folder):
        memory.cache_clear()
    module._GOOD.clear()
    yield
    module._GOOD.clear()
    kernel_folder.cache_clear()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of the user's own, in another."""
    (tmp_path / "around" / "kept").mkdir(parents=True)
    for path in (tmp_path, tmp_path / "around", tmp_path / "around" / "kept"):
        path.chmod(0o755)
    return tmp_path / "around" / "kept"


def said(folder: Path, capsys: Any) -> str:
    """Message about a folder that others can write into; empty for a good one."""
    good = trusted(folder, "X names a folder of your own")
    text: str = capsys.readouterr().err
    assert good == (not text)
    assert text.count("\n") <= 1
    return text


#: Changes of a folder, and the message.
WAYS: dict[str, tuple[Callable[[Path], object], str]] = {
    "everybody": (lambda f: f.chmod(0o777), 'all users may write into "{0}"'),
    "everybody but sticky": (lambda f: f.chmod(0o1777), 'all users may write into "{0}"'),
    "everybody around": (lambda f: f.parent.chmod(0o777), 'all users may write into "{1}"'),
    "a file for everybody": (
        lambda f: ((f / "x.nbc").touch(), (f / "x.nbc").chmod(0o666)),
        'all users may write into "{0}/x.nbc"',
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_folders_that_others_can_write(way: str, folder: Path, capsys: Any) -> None:
    change, reason = WAYS[way]
    change(folder)
    text = said(folder, capsys)
    assert text.startswith(
        "warning: compiled code in folders that other users can write to is not used"
    )
    assert reason.format(folder, folder.parent) in text
    assert "chmod go-w" in text
    assert "X names a folder of your own" in text
    # said once
    assert not trusted(folder, "X names a folder of your own")
    assert capsys.readouterr().err == ""


def test_links_that_others_can_lead_elsewhere(folder: Path, capsys: Any) -> None:
    """The target of a link is safe, but not its folder."""
    place = folder.parents[1] / "open"
    place.mkdir()
    (place / "link").symlink_to(folder)
    place.chmod(0o777)
    assert f'all users may write into "{place}"' in said(place / "link", capsys)


#: Changes of a folder that leave it safe.
GOOD: dict[str, Callable[[Path], object]] = {
    "own": lambda f: f.chmod(0o755),
    "nothing there yet": lambda f: f.rmdir(),
    "as in /tmp": lambda f: f.parent.chmod(0o1777),
    "readable": lambda f: f.chmod(0o755),
    "files": lambda f: (f / "a.nbi").touch(),
    "link": lambda f: (f / "a").symlink_to("b"),
}


@pytest.mark.parametrize("way", GOOD)
def test_folders_of_ones_own(way: str, folder: Path, capsys: Any) -> None:
    GOOD[way](folder)
    assert said(folder, capsys) == ""


@pytest.mark.parametrize(
    ("name", "members", "good"),
    [
        ("me", [], True),  # what useradd makes for everyone: umask 002 is usual then
        ("me", ["me"], True),
        ("me", ["me", "other"], False),
        ("users", [], False),  # the first group of everybody: its members are in no list
        ("root", [], True),
        ("root", ["other"], False),
    ],
)
def test_groups(
    name: str, members: list[str], good: bool, folder: Path, capsys: Any, monkeypatch: Any
) -> None:
    group = SimpleNamespace(gr_name=name, gr_mem=members)
    monkeypatch.setattr(module.grp, "getgrgid", lambda number: group)
    monkeypatch.setattr(module, "_user", lambda number: "me")
    folder.chmod(0o775)
    (folder / "a.nbi").touch()
    (folder / "a.nbi").chmod(0o664)
    text = said(folder, capsys)
    assert (text == "") == good
    assert good or f'the group {name} may write into "{folder}"' in text


def test_groups_without_a_name(folder: Path, monkeypatch: Any) -> None:
    """A container whose user is in no list."""

    def unknown(number: int) -> None:
        raise KeyError

    monkeypatch.setattr(module.grp, "getgrgid", unknown)
    folder.chmod(0o775)
    assert not trusted(folder, "")


def test_what_belongs_to_others(folder: Path, capsys: Any, monkeypatch: Any) -> None:
    """Whoever else owns a folder may do in it as he likes; the owner of the program does so."""
    program = folder.parent / "program"
    program.mkdir()
    monkeypatch.setattr(module.os, "geteuid", lambda: ME + 1)  # all of ours is another's now
    if ME:
        text = said(folder, capsys)
        assert " belongs to " in text
    else:  # the administrator's are anybody's
        assert trusted(folder, "")
        os.chown(folder, 12345, 0)
        module._GOOD.clear()
        assert f'"{folder}" belongs to user 12345' in said(folder, capsys)
        os.chown(program, 12345, 0)
    assert trusted(folder, "", program)


def test_one_rank_speaks(folder: Path, capsys: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(module.launch, "rank", lambda: 1)
    folder.chmod(0o777)
    assert not trusted(folder, "")
    assert capsys.readouterr().err == ""


def test_a_folder_of_this_process() -> None:
    folder = private_folder()
    assert private_folder() == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert trusted(folder, "")


def test_forms_go_elsewhere(folder: Path, capsys: Any, monkeypatch: Any) -> None:
    """The folder that XDG_CACHE_HOME names, that below the home, or one of this process."""
    import dolfinx.jit

    monkeypatch.setitem(dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (folder, ""))
    assert kernel_folder() == folder
    folder.chmod(0o777)
    module._GOOD.clear()
    home = folder.parent / "home"
    home.mkdir()
    monkeypatch.setattr(Path, "home", lambda: home)
    kernel_folder.cache_clear()
    assert kernel_folder() == home / ".cache" / "fenics"
    assert "XDG_CACHE_HOME names a folder of your own" in capsys.readouterr().err
    home.chmod(0o777)
    kernel_folder.cache_clear()
    assert kernel_folder() == private_folder() / "fenics"


CASE = """
import json
import flexfem as ff
import parts_of_mine

def build():
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, 2)
    section = ff.Section.circle(0.02, ff.Material(2e11, 0.3, 7800.0))
    model = ff.Model("m", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, parts_of_mine.G)),
        ff.Beam("rod", section, orientation=(0.0, 1.0, 0.0)),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )
    return model

CASE = ff.Case("own", "own", build, dt=1e-3, t_end=1e-3)
"""
#: Contents of the working folder, by file.
TRAPS = {
    **dict.fromkeys(
        ["numpy.py", "json.py", "h5py.py", "numba.py", "sitecustomize.py"],
        "raise SystemExit('taken from the working folder')",
    ),
    "parts_of_mine.py": "G = -9.81",
    "case.py": CASE,
    ".petscrc": "-log_view :petsc.txt",
    "petscrc": "-log_view :petsc.txt",
    "dolfinx_jit_options.json": '{"cache_dir": "jit", "cffi_libraries": ["no_such"]}',
    "ffcx_options.json": '{"language": "no_such", "epsilon": 1e6}',
    ".numba_config.yaml": "cache_dir: numba\ncache_locator_classes: no.such",
}


def test_the_working_folder_is_no_library(tmp_path: Path) -> None:
    """Neither modules nor options of libraries are read there; a case finds its own modules."""
    for name, text in TRAPS.items():
        (tmp_path / name).write_text(text)
    flexfem = Path(sys.executable).with_name("flexfem")
    command = [flexfem, "run", "case.py", "--output", "out"]
    if not flexfem.exists():  # not installed
        command = [sys.executable, "-P", "-m", "flexfem", *command[1:]]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == "results are in out\n"
    (line,) = [line for line in ended.stderr.splitlines() if " imports " in line]
    assert line.startswith(f"warning: '{tmp_path}/case.py' imports json of ")
    assert line.endswith("not the file beside it, which needs another name")
    left = {path.name for path in tmp_path.iterdir()}
    assert left - {"__pycache__"} == {*TRAPS, "out"}


def test_processes_of_studies_leave_it_alone() -> None:
    from flexfem.studies.processes import python_command

    assert python_command(["-m", "flexfem"], 1)[1:4] == ["-P", "-m", "flexfem"]
