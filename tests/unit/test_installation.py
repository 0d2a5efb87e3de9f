# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unsupported installations are refused in one line; modules here replace installed ones."""

import importlib.machinery
import os
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexfem import installation
from flexfem.installation import InstallationError

pytestmark = pytest.mark.serial

#: A DOLFINx that can be used, as far as it is looked at.
FITS: dict[str, dict[str, Any]] = {
    "dolfinx_solver": {},
    "mpi4py": {},
    "mpi4py.MPI": {
        "COMM_WORLD": types.SimpleNamespace(size=1),
        "get_vendor": lambda: ("MPICH", (5, 0, 1)),
    },
    "dolfinx": {"__version__": "0.11.0.post0", "has_petsc4py": True},
    "petsc4py": {"init": lambda args: None},
    "petsc4py.PETSc": {
        "ScalarType": np.float64,
        "Sys": types.SimpleNamespace(hasExternalPackage=lambda name: True),
    },
    "slepc4py": {},
    "ufl": {},
    "basix": {"__version__": "0.11.0"},
    "scipy": {},
    "numba": {},
    "h5py": {},
    "tqdm": {},
    "threadpoolctl": {},
}
COMPLEX = {"ScalarType": np.complex128}
SINGLE = {"ScalarType": np.float32}
WITHOUT_MUMPS = {"Sys": types.SimpleNamespace(hasExternalPackage=lambda name: name != "mumps")}
#: Modules that differ (None: missing), and parts of the message.
MISFITS: dict[str, tuple[dict[str, dict[str, Any] | None], tuple[str, ...]]] = {
    "older": ({"dolfinx": {"__version__": "0.9.0"}}, ("DOLFINx 0.9.0", "/there", "needs 0.11")),
    "newer": ({"dolfinx": {"__version__": "0.12.0.dev0"}}, ("DOLFINx 0.12.0.dev0", "needs 0.11")),
    "longer number": ({"dolfinx": {"__version__": "0.110.0"}}, ("DOLFINx 0.110.0",)),
    "none": ({"dolfinx": None}, ("DOLFINx is not installed", "flexfem[dolfinx]", "conda-forge")),
    "no MPI": ({"mpi4py": None}, ("DOLFINx is not installed", "mpi4py")),
    "no petsc4py": ({"petsc4py": None}, ("without petsc4py",)),
    "without PETSc": ({"dolfinx": {"has_petsc4py": False}}, ("without petsc4py", "/there")),
    "complex": ({"petsc4py.PETSc": COMPLEX}, ("complex128", "real", "PETSC_DIR")),
    "single": ({"petsc4py.PETSc": SINGLE}, ("float32", "double")),
    "no MUMPS": ({"petsc4py.PETSc": WITHOUT_MUMPS}, ("without MUMPS", "--download-mumps")),
    "no SLEPc": ({"slepc4py": None}, ("slepc4py is not installed",)),
    "no UFL": ({"ufl": None}, ("there is no ufl",)),
    "other Basix": ({"basix": {"__version__": "0.10.0"}}, ("Basix 0.10.0", "needs 0.11")),
    "no numba": ({"numba": None}, ("numba is not installed",)),
    "no h5py": ({"h5py": None}, ("h5py is not installed",)),
}


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Puts modules in place of those that are installed; returns the function that checks them."""
    for name in ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)

    def put(changes: dict[str, dict[str, Any] | None]) -> Any:
        for name, usual in FITS.items():
            change = changes.get(name, {})
            if change is None:
                monkeypatch.setitem(sys.modules, name, None)
                continue
            module = types.ModuleType(name)
            module.__spec__ = importlib.machinery.ModuleSpec(name, None)
            module.__file__ = f"/there/{name}/__init__.py"
            vars(module).update(usual | change)
            monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setattr(installation, "check_packages", installation.check_packages.__wrapped__)
        return installation.load_dolfinx.__wrapped__

    return put


def refusal(load: Any) -> str:
    with pytest.raises(InstallationError) as raised:
        load()
    text = str(raised.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize("version", ["0.11.0", "0.11.0.post0", "0.11.3"])
def test_every_release_of_the_series_will_do(version: str, install: Any) -> None:
    install({"dolfinx": {"__version__": version}, "dolfinx_solver": None})()


@pytest.mark.parametrize("kind", MISFITS)
def test_misfits(kind: str, install: Any) -> None:
    changes, parts = MISFITS[kind]
    text = refusal(install(changes))
    for part in parts:
        assert part in text


@pytest.mark.parametrize("variable", ["PMI_SIZE", "OMPI_COMM_WORLD_SIZE"])
def test_launcher_of_another_mpi(
    variable: str, install: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = install({})
    monkeypatch.setenv(variable, "1")
    load()
    monkeypatch.setenv(variable, "2")
    assert "2 ranks were started, but MPICH 5.0.1 sees one only" in refusal(load)


def test_shared_library_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "half_installed.py").write_text(
        "raise OSError('libGLU.so.1: cannot open shared object file')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    text = refusal(lambda: installation.require("half_installed"))
    assert text.startswith("half_installed cannot be imported: libGLU.so.1")


def test_command_line_refuses_before_anything_is_written(tmp_path: Path) -> None:
    """A DOLFINx of another version is found first; the model is fine."""
    (tmp_path / "dolfinx.py").write_text("__version__ = '0.10.1'\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    ended = subprocess.run(
        [sys.executable, "-c", "import sys; from flexfem.cli import command; sys.exit(command())",
         "run", "heavy_top", "--smoke", "--output", "new/results"],
        env=os.environ | {"PYTHONPATH": path}, cwd=tmp_path, capture_output=True, text=True,
        check=False, timeout=60,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith(f"error: DOLFINx 0.10.1 is installed in {tmp_path}")
    assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "new").exists()
