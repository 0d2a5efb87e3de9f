# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoint files: independent of the ranks, atomic, and any damage is noticed."""

import json
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import h5py
import numpy as np
import pytest

import flexfem.io.hdf5.checkpoint as module
from flexfem.core.state import Numbering, State
from flexfem.io.hdf5.checkpoint import Checkpoint, write_checkpoint
from tests.unit.forged import each_kind

COMM = MPI.COMM_WORLD


def scattered(count: int = 23) -> tuple[State, dict[str, Numbering]]:
    """Rows dealt out to the ranks like cards, each rank with ghosts of its neighbour's."""
    every = np.random.default_rng(3).permutation(count)
    mine = every[COMM.rank :: COMM.size]
    ghosts = np.setdiff1d(every[(COMM.rank + 1) % COMM.size :: COMM.size][:3], mine)
    numbers = np.concatenate([mine, ghosts])
    owned = np.arange(len(numbers)) < len(mine)
    rows = numbers[:, np.newaxis] + np.array([0.0, 0.25, 0.5])
    rows[~owned] = np.nan  # never written
    state = State({"time": np.array([0.1])}, {"nodes": {"x": rows}, "rows": {"y": rows[:, 0]}})
    return state, {name: Numbering(numbers, owned, count) for name in ("nodes", "rows")}


@pytest.mark.serial
def test_checkpoints_are_written_by_the_library_of_h5py() -> None:
    """A script that has made PETSc's HDF5 library global would lend h5py another version."""
    program = """
import warnings
import flexfem
import flexfem.simulation
import dolfinx.fem.petsc
from flexfem.io.hdf5.arrays import load_h5py
warnings.simplefilter("error")  # h5py warns of another version
version = load_h5py().version
assert version.hdf5_version_tuple == version.hdf5_built_version_tuple
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.three_ranks
def test_rows_come_back_in_any_distribution(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "c.h5"
    state, numberings = scattered()
    write_checkpoint(path, COMM, {"step": 7}, state, numberings)
    assert [p.name for p in shared_tmp_path.iterdir()] == ["c.h5"]
    # a plain HDF5 file in the order of the model
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["rows/nodes/x"][:, 1], np.arange(23) + 0.25)
        np.testing.assert_array_equal(file["rows/rows/y"], np.arange(23))
    checkpoint = Checkpoint(path, COMM)
    assert checkpoint.header == {"step": 7}
    other = {
        "nodes": Numbering(np.arange(23)[::-1], np.ones(23, dtype=bool), 23),
        "rows": Numbering(np.arange(COMM.rank, 23, 4), np.ones(6, dtype=bool), 23),
    }
    back = checkpoint.read(other)
    assert back.values["time"] == 0.1
    np.testing.assert_array_equal(back.rows["nodes"]["x"][:, 2], np.arange(23)[::-1] + 0.5)
    np.testing.assert_array_equal(back.rows["rows"]["y"], np.arange(COMM.rank, 23, 4))
    wrong = {"nodes": Numbering(np.arange(22), np.ones(22, dtype=bool), 22)}
    with pytest.raises(ValueError, match="has 23 rows, not 22"):
        checkpoint.read(wrong)


def flip(position: float) -> Callable[[bytes], bytes]:
    def damage(data: bytes) -> bytes:
        at = int(position * (len(data) - 1)) if position < 1.0 else int(position)
        return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]

    return damage


DAMAGES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "empty": (lambda d: b"", "is not a checkpoint of flexfem"),
    "text": (lambda d: b"t,x\n0,1\n" * 100, "is not a checkpoint of flexfem"),
    "zeros": (lambda d: bytes(len(d)), "is not a checkpoint of flexfem"),
    "half": (lambda d: d[: len(d) // 2], "is damaged: .* bytes instead of"),
    "short by one byte": (lambda d: d[:-1], "is damaged: .* bytes instead of"),
    "cut in the first block": (lambda d: d[:300], "damaged in its first 512 bytes"),
    "only the first line": (lambda d: d[:19], "damaged in its first 512 bytes"),
    "longer": (lambda d: d + b"\0", "is damaged: .* bytes instead of"),
    "mark flipped": (flip(3), "is not a checkpoint of flexfem"),
    "size flipped": (flip(35), "is damaged: .* bytes instead of"),
    "checksum flipped": (
        lambda d: d.replace(d[60:62], b"00" if d[60:62] != b"00" else b"11", 1),
        "damaged",
    ),
    "padding flipped": (flip(511), "damaged in its first 512 bytes"),
    "signature flipped": (flip(513), "checksum"),
    "header flipped": (flip(0.5), "checksum"),
    "row flipped": (flip(0.8), "checksum"),
    "last byte flipped": (lambda d: d[:-1] + bytes([d[-1] ^ 128]), "checksum"),
    "blocks swapped": (lambda d: d[:512] + d[1024:2048] + d[512:1024] + d[2048:], "checksum"),
    "other format": (lambda d: d.replace(b"format 1", b"format 2", 1), "has format 2"),
}


@pytest.mark.parametrize("kind", each_kind(DAMAGES, "text", "half", "row flipped", "other format"))
def test_damage_is_named(kind: str, shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "c.h5"
    write_checkpoint(path, COMM, {"step": 7}, *scattered())
    damage, reason = DAMAGES[kind]
    data = path.read_bytes()
    COMM.barrier()
    if COMM.rank == 0:
        path.write_bytes(damage(data))
    COMM.barrier()
    with pytest.raises(ValueError, match=rf"^checkpoint '.*c\.h5': .*{reason}") as caught:
        Checkpoint(path, COMM)
    assert "\n" not in str(caught.value)


@pytest.mark.serial
def test_any_flipped_bit_is_noticed(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "c.h5"
    write_checkpoint(path, COMM, {}, *scattered())
    data = path.read_bytes()
    for at in [*range(0, 700, 7), *rng.integers(0, len(data), 100)]:
        path.write_bytes(data[:at] + bytes([data[at] ^ (1 << at % 8)]) + data[at + 1 :])
        with pytest.raises(ValueError, match=r"c\.h5"):
            Checkpoint(path, COMM)


def test_what_is_no_checkpoint(shared_tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"missing\.h5': No such file"):
        Checkpoint(shared_tmp_path / "missing.h5", COMM)
    with pytest.raises(ValueError, match=r"': Is a directory"):
        Checkpoint(shared_tmp_path, COMM)
    path = shared_tmp_path / "other.h5"
    if COMM.rank == 0:
        with h5py.File(path, "w") as file:
            file["rows"] = np.arange(3.0)
    COMM.barrier()
    with pytest.raises(ValueError, match=r"other\.h5': is not a checkpoint of flexfem"):
        Checkpoint(path, COMM)


def checkpoint_of(step: int, path: Path, count: int = 2000) -> None:
    write_checkpoint(path, COMM, {"step": step}, *scattered(count))


def assert_whole(folder: Path, step: int) -> None:
    """The only file is the checkpoint of that step."""
    assert [p.name for p in folder.iterdir()] == ["c.h5"]
    assert Checkpoint(folder / "c.h5", COMM).header == {"step": step}


@pytest.mark.parametrize("limit", each_kind((0, 100, 600, 5000, 40000), 40000))
def test_full_disk_leaves_the_former_checkpoint(limit: int, shared_tmp_path: Path) -> None:
    """A limit on the size of files stands for a full disk."""
    path = shared_tmp_path / "c.h5"
    checkpoint_of(1, path)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        with pytest.raises(OSError, match=r"File too large: '.*c\.h5'"):
            checkpoint_of(2, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    COMM.barrier()
    assert_whole(shared_tmp_path, 1)
    COMM.barrier()
    checkpoint_of(3, path)
    assert_whole(shared_tmp_path, 3)


@pytest.mark.three_ranks
def test_error_of_one_rank_is_raised_on_all(shared_tmp_path: Path, monkeypatch: Any) -> None:
    def fail(self: Any) -> None:
        raise OSError(5, "E")

    path = shared_tmp_path / "c.h5"
    checkpoint_of(1, path)
    if COMM.rank == COMM.size - 1:
        monkeypatch.setattr(module._Stream, "seal", fail)
    with pytest.raises(OSError, match=r"\[Errno 5\] E: '.*c\.h5'"):
        checkpoint_of(2, path)
    COMM.barrier()
    assert_whole(shared_tmp_path, 1)


def test_killed_write_leaves_the_former_checkpoint(shared_tmp_path: Path) -> None:
    """Whatever a killed process left under the temporary name is no obstacle."""
    path = shared_tmp_path / "c.h5"
    checkpoint_of(1, path)
    if COMM.rank == 0:
        (shared_tmp_path / ".c.h5.tmp").write_bytes(b"half a file" * 1000)
    COMM.barrier()
    assert Checkpoint(path, COMM).header == {"step": 1}
    checkpoint_of(2, path)
    assert_whole(shared_tmp_path, 2)


def test_header_survives_as_json(shared_tmp_path: Path) -> None:
    header = {"dt": 0.1 + 0.2, "name": 'Beam "träger"', "grid": [1e-300, 7]}
    write_checkpoint(shared_tmp_path / "c.h5", COMM, header, *scattered())
    assert Checkpoint(shared_tmp_path / "c.h5", COMM).header == json.loads(json.dumps(header))
