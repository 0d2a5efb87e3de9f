# SPDX-License-Identifier: LGPL-3.0-or-later
"""Installable archives: the wheel has all that runs need, the sdist all that the wheel has."""

import importlib.util
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]


def build(source: Path, target: Path, kind: str) -> Path:
    """Build one distribution without network or isolation."""
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(target)],
        cwd=source, check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    [made] = target.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return made


def shipped_folders() -> dict[str, str]:
    """Folders beside the package that the build hook puts into it."""
    spec = importlib.util.spec_from_file_location("build_hook", ROOT / ".ci" / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    data: dict[str, dict[str, str]] = {"force_include": {}}
    hook.ShippedFiles.initialize(None, "standard", data)
    return data["force_include"]


def files(folder: Path, pattern: str) -> set[str]:
    """Files below a folder, but for the sources of the documentation, which runs do not need."""
    found = (path.relative_to(folder) for path in folder.rglob(pattern))
    return {str(path) for path in found if path.parts[0] != "docs"}


def test_wheel_and_sdist_hold_everything(tmp_path: Path) -> None:
    """A folder that the hook forgets, or files that the sdist leaves out, would be missed here."""
    pytest.importorskip("hatchling")
    sdist = build(ROOT, tmp_path / "sdist", "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    [source] = (tmp_path / "source").iterdir()
    with zipfile.ZipFile(build(source, tmp_path / "wheel", "wheel")) as archive:
        names = set(archive.namelist())
        scripts = archive.read(next(n for n in names if n.endswith("entry_points.txt")))
    assert b"flexfem = flexfem.cli:command" in scripts
    assert any(n.endswith("licenses/LICENSE") for n in names)
    package = {n.removeprefix("flexfem/") for n in names if n.startswith("flexfem/")}
    assert files(ROOT / "flexfem", "*.py") <= package
    folders = shipped_folders()
    assert {"cases", "meshes"} <= set(folders)
    for folder, place in folders.items():
        found = files(ROOT / folder, "*.py")
        assert found
        assert {f"{place}/{name}" for name in found} <= names, folder


def test_copies_do_not_hide_what_is_edited() -> None:
    """An editable installation takes cases and meshes from where they are."""
    assert not (ROOT / "flexfem" / "cases").exists()
    assert not (ROOT / "flexfem" / "meshes").exists()
