# SPDX-License-Identifier: LGPL-3.0-or-later
"""MPI hygiene and fixtures of all tests."""

import contextlib
import gc
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

# The PyPI wheels of DOLFINx need this import before dolfinx and petsc4py; other builds have no such
# module. Tests that need neither must also run where no DOLFINx is installed.
with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401
# Tests that import dolfinx.fem.petsc make another HDF5 library global, which h5py would then use.
with contextlib.suppress(ImportError):
    import h5py  # noqa: F401

# Several processes of tests compile already.
os.environ.setdefault("FLEXFEM_COMPILE_BESIDE", "0")

#: Seconds that a rank on which a test failed waits for the others.
PATIENCE = 60.0
#: Whether a test failed on this rank, and the communicator on which ranks meet after each.
FAILED, MEETING = pytest.StashKey[bool](), pytest.StashKey[Any]()
#: Modules after the last test, and whether objects of the present file are hidden from the search.
MODULES, HIDDEN = pytest.StashKey[int](), pytest.StashKey[bool]()
#: The line of a file all of whose tests need one process.
FOR_ONE = "\npytestmark = pytest.mark.serial\n"
LAUNCHED = any(name in os.environ for name in ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK"))


def _communicator() -> Any:
    """COMM_WORLD when MPI is in use, else None: a serial test must not pay for loading it."""
    if LAUNCHED or "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI

        return MPI.COMM_WORLD
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Give each rank a root of temporary folders of its own, removed at the end.

    In the root that processes share by default, two of them that end at the same time remove the
    folders of earlier runs under each other's hands, and the one that loses ends with an error.
    """
    if LAUNCHED and config.option.basetemp is None:
        root = tempfile.mkdtemp(prefix="flexfem-tests-of-a-rank-")
        config.option.basetemp = root
        config.add_cleanup(lambda: shutil.rmtree(root, ignore_errors=True))


@pytest.fixture
def command_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory for command lines; what they change of Python is put back."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    return tmp_path


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files without a test for several ranks: to read one is quicker than to import it.

    Half of the files have none, and each rank would import them.
    """
    comm = _communicator() if LAUNCHED else None
    if comm is None or comm.size == 1 or not collection_path.match("test_*.py"):
        return None
    text = collection_path.read_text()
    without = config.option.markexpr.startswith("three_ranks") and "three_ranks" not in text
    return True if without or FOR_ONE in text else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests of one process on several ranks, and put those of cases before the last ones.

    Several processes of tests take file after file: those of cases take longest, and the programs
    that they start find compiled what tests before them have used.
    """
    items.sort(key=lambda item: {"cases": 1, "verification": 2}.get(item.path.parent.name, 0))
    comm = _communicator()
    if comm is not None and comm.size > 1:
        for item in items:
            if item.get_closest_marker("serial"):
                item.add_marker(pytest.mark.skip(reason="needs one process"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show at once what fails on a rank: the others may wait for it in a collective call."""
    report = yield
    if LAUNCHED and report.failed:
        comm = _communicator()
        item.stash[FAILED] = True
        text = f"\nrank {comm.rank}, {report.when} of {item.nodeid}:\n{report.longreprtext}"
        print(text, file=sys.stderr, flush=True)
    return report


def wait_for_others(item: pytest.Item, comm: Any) -> None:
    """Wait for the end of a test on all ranks; one on which it failed ends them after some time."""
    meeting = item.session.stash.setdefault(MEETING, None) or comm.Dup()
    item.session.stash[MEETING] = meeting
    request, begin = meeting.Ibarrier(), time.monotonic()
    while not request.Test():
        if item.stash.get(FAILED, False) and time.monotonic() > begin + PATIENCE:
            comm.Abort(1)
        time.sleep(1e-3)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(
    item: pytest.Item, nextitem: pytest.Item | None
) -> Generator[None, None, None]:
    """Destructors of PETSc and DOLFINx objects are collective: run them on all ranks together.

    What has survived once, imported modules above all, is not searched again: that took most of
    the time. What a file's fixtures hold is searched at its end, and let go: MPI has about two
    thousand communicators, and PETSc's objects hold some.
    """
    comm = _communicator() if LAUNCHED else None  # tests of one process may replace MPI
    if comm is None or comm.size == 1:
        return (yield)
    wait_for_others(item, comm)
    yield
    stash, last = item.session.stash, nextitem is None or nextitem.path != item.path
    if last and stash.get(HIDDEN, False):
        gc.unfreeze()
    gc.collect()
    if petsc := sys.modules.get("petsc4py.PETSc"):
        petsc.garbage_cleanup(comm)
    # modules are hidden from the search when they are new, with the fixtures that are there
    if last or stash.get(MODULES, 0) != len(sys.modules):
        gc.freeze()
        stash[HIDDEN] = not last
    stash[MODULES] = len(sys.modules)
    comm.Barrier()


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every run and on every rank."""
    return np.random.default_rng(20240229)


@pytest.fixture
def shared_tmp_path() -> Iterator[Path]:
    """An empty folder, the same one on all ranks, removed after the test."""
    comm = _communicator()
    first = comm is None or comm.rank == 0
    name = tempfile.mkdtemp(prefix="flexfem-test-") if first else ""
    if comm is not None:
        name = comm.bcast(name)
    yield Path(name)
    if comm is not None:
        comm.Barrier()
    if first:
        shutil.rmtree(name, ignore_errors=True)
