# SPDX-License-Identifier: LGPL-3.0-or-later
"""Requirements of other packages: found and checked in one place, refused in one line.

DOLFINx and its PETSc come in many builds (wheels, conda-forge, Debian, containers). With a wrong
one a run would fail somewhere deep, or each rank would compute by itself; here they are looked at
before anything is computed.
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import numpy as np

from flexfem import launch
from flexfem._packages import InstallationError, missing, one_line, require

__all__ = ["DOLFINX", "InstallationError", "check_packages", "load_dolfinx", "require"]

#: The series of DOLFINx, and of Basix, that flexfem is written for; any release of it is accepted.
DOLFINX = "0.11"
#: Sources of DOLFINx, for messages about a missing or another version.
_SOURCES = (
    'pip install "flexfem[dolfinx]", or fenics-dolfinx=0.11 of conda-forge, or '
    "python3-dolfinx-real of Debian"
)
#: Packages without which no analysis gets to its end, h5py when the first checkpoint is due.
_PACKAGES = ("scipy", "numba", "h5py", "tqdm", "threadpoolctl")


@cache
def check_packages() -> None:
    """Check the other required packages besides DOLFINx: Python packages, UFL and Basix.

    Raises:
        InstallationError: one is missing, or belongs to another DOLFINx.
    """
    for name in _PACKAGES:
        if find_spec(name) is None:
            raise missing(name)
    for name in ("ufl", "basix"):
        if find_spec(name) is None:
            raise InstallationError(f"DOLFINx is not installed (there is no {name}): {_SOURCES}")
    _check_version("Basix", require("basix"))


@cache
def load_dolfinx() -> None:
    """Import DOLFINx and PETSc in the order that their wheels need, and check them.

    Raises:
        InstallationError: they are missing, of another version, built for complex or single
            numbers, without MUMPS or SLEPc, or with another MPI than that which started the ranks.
    """
    if find_spec("dolfinx_solver") is not None:  # the binary wheel, which must come first
        try:
            import_module("dolfinx_solver")
        except Exception as error:  # it has several of its own, and names the one to uninstall
            raise InstallationError(f"dolfinx_solver: {one_line(error)}") from error
    for name in ("mpi4py", "dolfinx"):
        if find_spec(name) is None:
            raise InstallationError(f"DOLFINx is not installed (there is no {name}): {_SOURCES}")
    _check_mpi(require("mpi4py.MPI"))
    if launch.ranks() > 1:
        launch.meet()  # PETSc starts on all ranks together
    _start_petsc()
    dolfinx = require("dolfinx")
    _check_version("DOLFINx", dolfinx)
    if find_spec("petsc4py") is None or not getattr(dolfinx, "has_petsc4py", True):
        raise InstallationError(
            f"the DOLFINx in {_place(dolfinx)} was built without petsc4py: {_SOURCES}"
        )
    _check_petsc(require("petsc4py.PETSc"))
    if find_spec("slepc4py") is None:
        raise InstallationError(
            "slepc4py is not installed, but required for modes: slepc4py of conda-forge or "
            "python3-slepc4py-real of Debian; the wheels of flexfem[dolfinx] contain it"
        )
    check_packages()


def _start_petsc() -> None:
    """Keep PETSc from ``.petscrc`` of the working folder, which may name libraries to load.

    There is one switch for that of the home folder and of the working folder; options in the
    variable PETSC_OPTIONS are taken.
    """
    if find_spec("petsc4py") is None:
        return  # told below
    petsc4py = require("petsc4py")
    try:
        with launch.signals_kept():  # PETSc's own end all with pages about debuggers
            petsc4py.init(["flexfem", "-skip_petscrc"])
    except (ImportError, OSError, RuntimeError):
        return  # so is any error in it


def _check_version(what: str, module: ModuleType) -> None:
    found = str(getattr(module, "__version__", "of an unknown version"))
    if found.split(".")[:2] != DOLFINX.split("."):
        raise InstallationError(
            f"{what} {found} is installed in {_place(module)}, flexfem needs {DOLFINX}: {_SOURCES}"
        )


def _check_petsc(petsc: Any) -> None:
    """Refuse numbers that are not real and double, and a PETSc without its direct solver."""
    place, scalar = _place(petsc), np.dtype(petsc.ScalarType)
    if scalar != np.float64:
        kind = "complex" if scalar.kind == "c" else "single"
        raise InstallationError(
            f"the PETSc in {place} computes with {kind} numbers ({scalar}), flexfem needs real "
            'double ones: dolfinx-solver-real of PyPI, "petsc=*=real*" of conda-forge, '
            "python3-dolfinx-real of Debian (PETSC_DIR chooses among those installed)"
        )
    if not petsc.Sys.hasExternalPackage("mumps"):
        raise InstallationError(
            f"the PETSc in {place} was built without MUMPS: configure it with "
            f"--download-mumps --download-scalapack, or {_SOURCES}"
        )


def _check_mpi(mpi: Any) -> None:
    """Refuse ranks that MPI does not connect: each would compute, and write, everything."""
    started, seen = launch.ranks_started(), mpi.COMM_WORLD.size
    if started is not None and started > 1 and seen == 1:
        name, numbers = mpi.get_vendor()
        version = ".".join(map(str, numbers))
        raise InstallationError(
            f"{started} ranks were started, but {name} {version} sees one only: "
            "start them with the mpirun of that MPI (that of the wheels is beside python in the "
            "virtual environment)"
        )


def _place(module: Any) -> str:
    """Folder that a module was found in."""
    return str(getattr(module, "__file__", "an unknown place")).rpartition("/")[0]
