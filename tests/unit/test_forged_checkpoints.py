# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whatever a checkpoint with a right checksum holds: it is refused in one line, on all ranks."""

import os
import re
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import pytest

import flexfem as ff
from flexfem.io.hdf5 import structure as hdf5_structure
from tests.unit.forged import FORGERIES, HEADERS, each_kind, endless, forge, seal, with_header
from tests.unit.refusals import assert_on_page

COMM = MPI.COMM_WORLD

OPTIONS: dict[str, Any] = {"dt": 1e-2, "t_end": 0.05, "quiet": True}


def falling() -> ff.Model:
    """Two bodies that fall, one after a jump; energies are summed up."""
    model = ff.Model("falling")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("a", 1.0, (0.1, 0.1, 0.1)),
        ff.RigidBody("b", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
        ff.Spherical("pin", ff.Ground((0.0, 0.5, 0.0)), ff.Marker("a", offset=(0.0, 0.5, 0.0))),
        ff.Event("low", ff.Marker("b"), lambda t, s: s.position[2] + 100.0, ff.Stop()),
        ff.PositionProbe("path", ff.Marker("a")),
        ff.EnergyProbe("energy"),
    )
    return model


@pytest.fixture(scope="module")
def written(tmp_path_factory: Any) -> Path:
    """The checkpoint of a run, the same for all ranks."""
    folder = COMM.bcast(str(tmp_path_factory.mktemp("run")))
    out = Path(folder) / "out"
    options = ff.RunOptions(**OPTIONS, output=out, checkpoint_every=5)
    assert ff.simulate(falling(), options).status == "ok"
    COMM.barrier()
    return out / "checkpoint_000005.h5"


def refused(path: Path, folder: Path) -> str:
    """Message about a checkpoint; nothing is written."""
    options = ff.RunOptions(**(OPTIONS | {"t_end": 0.1}), output=folder / "next", restart=path)
    with pytest.raises(ValueError) as caught:  # noqa: PT011 the caller looks at the message
        ff.simulate(falling(), options)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 500
    assert len(set(COMM.allgather(text))) == 1
    assert not (folder / "next").exists() or not any((folder / "next").iterdir())
    COMM.barrier()  # the next run locks the folder
    return text


def forged(written: Path, folder: Path, change: Callable[[Any], object]) -> Path:
    """A copy that was changed, with a renewed checksum."""
    path = folder / "c.h5"
    if COMM.rank == 0:
        shutil.copy(written, path)
        forge(path, change)
    COMM.barrier()
    return path


# data that each rank reads, that the first one reads for all, and that all check
PARTS = (
    "no frames",
    "rows of another shape",
    "fewer rows",
    "a row without rows",
    "frames are none",
)
WHOLE = ("rows without end", "rotations are none", "virtual", "another time", "no such event")


@pytest.mark.parametrize("kind", each_kind(FORGERIES, *PARTS, *WHOLE))
def test_forged_contents(kind: str, written: Path, shared_tmp_path: Path) -> None:
    change, reason = FORGERIES[kind]
    text = refused(forged(written, shared_tmp_path, change), shared_tmp_path)
    assert_matches(reason, text)
    assert_on_page(text)


@pytest.mark.parametrize("kind", each_kind(HEADERS, "not JSON", "model is a list", "other step"))
def test_forged_headers(kind: str, written: Path, shared_tmp_path: Path) -> None:
    change, reason = HEADERS[kind]
    text = refused(forged(written, shared_tmp_path, with_header(change)), shared_tmp_path)
    assert_matches(reason, text)


def assert_matches(reason: str, text: str) -> None:
    assert re.search(reason, text), text
    assert text.startswith("checkpoint")


@pytest.mark.three_ranks
def test_what_is_left_alone_goes_on(written: Path, shared_tmp_path: Path) -> None:
    """Sealing alone changes nothing: the refusals above are of what was changed."""
    path = forged(written, shared_tmp_path, lambda file: None)
    options = ff.RunOptions(**(OPTIONS | {"t_end": 0.1}), restart=path)
    assert ff.simulate(falling(), options).status == "ok"


def test_a_pipe_is_not_waited_for(shared_tmp_path: Path) -> None:
    """Nor is a device read."""
    pipe, device = shared_tmp_path / "pipe", shared_tmp_path / "device"
    if COMM.rank == 0:
        os.mkfifo(pipe)
        device.symlink_to("/dev/zero")
    COMM.barrier()
    for path in (pipe, device):
        text = refused(path, shared_tmp_path)
        assert text == f"checkpoint '{path}': is not a regular file but a pipe or a device"
    assert refused(shared_tmp_path, shared_tmp_path).endswith("': Is a directory")


@pytest.mark.slow_on_ranks
def test_what_the_library_never_ends_with(
    written: Path, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without another process that goes first, this one would read without end."""
    monkeypatch.setattr(hdf5_structure, "_SECONDS", 1)
    path = shared_tmp_path / "c.h5"
    if COMM.rank == 0:
        shutil.copy(written, path)
        endless(path)
        seal(path)
    COMM.barrier()
    text = refused(path, shared_tmp_path)
    assert text.endswith("is damaged: the HDF5 library has not read it after 1 s")
    assert_on_page(text)


def test_what_the_library_crashes_on(
    written: Path, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process that goes first ends by a signal; no file does it with all versions."""
    crashed = subprocess.CompletedProcess([], -signal.SIGSEGV)
    monkeypatch.setattr(hdf5_structure.subprocess, "run", lambda *_, **__: crashed)
    text = refused(written, shared_tmp_path)
    assert text.endswith("is damaged: the HDF5 library crashes on it (SIGSEGV)")
    assert_on_page(text)
