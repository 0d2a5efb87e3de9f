# SPDX-License-Identifier: LGPL-3.0-or-later
"""Histories in HDF5 files: the rows of CSV, bit for bit, whatever ends the run."""

import subprocess
import sys
import tracemalloc
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem._types import FloatArray
from flexfem.cli.postprocessing import script
from flexfem.io.hdf5.arrays import load_h5py
from flexfem.io.tables import compressed_history
from flexfem.io.tables.compressed_history import CompressedHistoryWriter
from flexfem.io.tables.history import history_columns
from flexfem.io.tables.history_files import history_file, open_history
from tests.unit.swing import mechanism

SELF, WORLD = MPI.COMM_SELF, MPI.COMM_WORLD
#: Writes rows of 300 columns until something ends it, one at a time.
WRITES = """
import os, resource, signal, sys
import numpy as np
from mpi4py import MPI
from pathlib import Path
from flexfem.io.tables.compressed_history import CompressedHistoryWriter

path, what = Path(sys.argv[1]), sys.argv[2]
if what == "full":
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))
writer = CompressedHistoryWriter(path, [f"c{k}" for k in range(299)], MPI.COMM_SELF)
rng = np.random.default_rng(3)
for row in range(300):
    try:
        writer.extend([np.append(float(row), rng.standard_normal(299))])
    except OSError as error:
        print(row, error)
        break
    if what == "kill" and row == 200:
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of four rows, chunks of two columns."""
    monkeypatch.setattr(compressed_history, "_NUMBERS", 1)
    monkeypatch.setattr(compressed_history, "_LEAST", 4)
    monkeypatch.setattr(compressed_history, "_COLUMNS", 2)


def made(count: int, columns: int = 5) -> FloatArray:
    """Rows with times, and with numbers that are none."""
    table = np.random.default_rng(1).standard_normal((count, 1 + columns))
    table[:, 0] = 0.5 * np.arange(count)
    if count > 2:
        table[2, 1:4] = np.nan, -np.inf, -0.0
    return table


def names(columns: int = 5) -> list[str]:
    return [f"Größe {k}" for k in range(columns)]


def read(path: Path) -> FloatArray:
    return np.column_stack([*ff.read_history(path).values()])


def same(one: FloatArray, other: FloatArray) -> bool:
    """Every bit: a number that went through single precision, or a stale row, differs."""
    return one.shape == other.shape and one.tobytes() == other.tobytes()


@pytest.mark.serial
@pytest.mark.usefixtures("_small_blocks")
@pytest.mark.parametrize("count", [0, 13])
def test_rows_are_readable_as_they_are_written_and_in_the_end(tmp_path: Path, count: int) -> None:
    table, path = made(count), tmp_path / "history.h5"
    writer = CompressedHistoryWriter(path, names(), SELF)
    for k in range(count):
        writer.extend([table[k]])
        if k in (3, 9):
            assert same(read(path), table[: k + 1])
    writer.close()
    assert same(read(path), table)
    assert history_columns(path) == ["t", *names()]
    with load_h5py().File(path) as file:  # what other programs see
        np.testing.assert_array_equal(file["values"][()], table)


@pytest.mark.serial
@pytest.mark.usefixtures("_small_blocks")
def test_some_columns_are_those_of_the_file(tmp_path: Path) -> None:
    table, path = made(10), tmp_path / "history.h5"
    writer = CompressedHistoryWriter(path, names(), SELF)
    writer.extend(list(table))
    found = ff.read_history(path, ["Größe 4", "t", "Größe 0"])
    assert [*found] == ["t", "Größe 0", "Größe 4"]
    assert same(np.column_stack([*found.values()]), table[:, [0, 1, 5]])
    with pytest.raises(ValueError, match="no column 'x'"):
        ff.read_history(path, ["x"])
    writer.close()


@pytest.mark.serial
@pytest.mark.parametrize("what", ["kill", "full"])
def test_what_was_written_outlives_the_process(tmp_path: Path, what: str) -> None:
    """A kill loses no row, a full disk those of a block at most, and Python ends in order."""
    path = tmp_path / "history.h5"
    run = subprocess.run(
        [sys.executable, "-c", WRITES, path, what], capture_output=True, text=True, check=False
    )
    rows = np.random.default_rng(3).standard_normal((300, 299))
    table = np.column_stack([np.arange(300.0), rows])
    found = read(path)
    assert same(found, table[: len(found)])
    if what == "kill":
        assert (run.returncode, len(found)) == (-9, 201)
        return
    assert run.returncode == 0, run.stderr
    row, _, message = run.stdout.strip().partition(" ")
    assert message == f"[Errno 27] File too large: '{path}'"
    assert run.stderr == ""
    assert max(64, int(row) - 63) <= len(found) <= int(row)


@pytest.mark.serial
@pytest.mark.usefixtures("_small_blocks")
@pytest.mark.parametrize("before", ["csv", "hdf5"])
@pytest.mark.parametrize("after", ["csv", "hdf5"])
def test_a_restart_continues_in_either_format(tmp_path: Path, before: str, after: str) -> None:
    table = made(11)
    first = open_history(tmp_path, before, names(), SELF, None)
    first.extend(list(table[:9]))  # and is killed
    second = open_history(tmp_path, after, names(), SELF, table[6, 0])
    assert same(second.kept[-1], table[6])
    second.extend(list(table[7:]))
    second.close()
    file = history_file(tmp_path)
    assert file is not None
    assert [file] == list(tmp_path.iterdir())  # one table, and nothing beside it
    assert file.suffix == {"csv": ".csv", "hdf5": ".h5"}[after]
    assert same(read(file), table)
    first.close()


@pytest.mark.serial
@pytest.mark.parametrize("after", ["csv", "hdf5"])
def test_a_table_of_another_run_is_refused_and_left(tmp_path: Path, after: str) -> None:
    writer = open_history(tmp_path, "hdf5", names(), SELF, None)
    writer.extend(list(made(3)))
    writer.close()
    kept = (tmp_path / "history.h5").read_bytes()
    with pytest.raises(ValueError, match="cannot be continued, it has other columns"):
        open_history(tmp_path, after, ["other"], SELF, 1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["history.h5"]
    assert (tmp_path / "history.h5").read_bytes() == kept


@pytest.mark.serial
def test_a_removed_table_is_written_anew(tmp_path: Path) -> None:
    table, path = made(7), tmp_path / "results" / "history.h5"
    writer = CompressedHistoryWriter(path, names(), SELF)
    writer.extend(list(table[:5]))
    path.unlink()
    path.parent.rmdir()
    assert writer.lost
    writer.write_anew([])
    assert not writer.lost
    writer.extend(list(table[5:]))
    writer.close()
    assert same(read(path), table)


@pytest.mark.serial
def test_thousands_of_columns_take_the_memory_of_a_block(tmp_path: Path) -> None:
    """Of the 61 MB that are written; rows kept in memory, as those of CSV are, would be as much."""
    path, columns = tmp_path / "history.h5", [f"c{k}" for k in range(3000)]
    writer = CompressedHistoryWriter(path, columns, SELF)
    rows = np.cumsum(np.full((32, 1 + len(columns)), 1e-3), axis=0)
    tracemalloc.start()
    for k in range(80):
        writer.extend(list(rows + k))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    writer.close()
    assert peak < 3 * 8 * 64 * (1 + len(columns))  # three blocks of 64 rows, 4.6 MB


@pytest.mark.serial
@pytest.mark.parametrize("damage", ["empty", "text", "cut", "chunk", "other"])
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "history.h5"
    writer = CompressedHistoryWriter(path, names(), SELF)
    writer.extend(list(made(3000)))
    writer.close()
    with load_h5py().File(path) as file:  # the middle of compressed numbers
        chunk = file["values"].id.get_chunk_info(0)
    whole, at = path.read_bytes(), chunk.byte_offset + chunk.size // 2
    damaged = {
        "empty": b"",
        "text": b"t,a\n0.0,1.0\n",
        "cut": whole[:-5000],
        "chunk": whole[:at] + bytes(1000) + whole[at + 1000 :],
    }
    if damage == "other":
        with load_h5py().File(path, "w") as file:
            file["values"] = np.zeros(3)
    else:
        path.write_bytes(damaged[damage])
    with pytest.raises(ValueError, match="history '") as caught:
        ff.read_history(path)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.three_ranks
def test_runs_record_the_same_in_both_formats(shared_tmp_path: Path) -> None:
    """And a restarted one goes on, with its history read from the file."""
    steps = {"dt": 0.02, "every": 3, "quiet": True, "split_above": 1}
    text, packed = shared_tmp_path / "text", shared_tmp_path / "packed"
    ff.simulate(mechanism(), ff.RunOptions(output=text, t_end=0.2, **steps))
    steps |= {"output": packed, "history_format": "hdf5"}
    ff.simulate(mechanism(), ff.RunOptions(t_end=0.08, checkpoint_every=4, **steps))
    last = packed / "checkpoint_000004.h5"
    outcome = ff.simulate(mechanism(), ff.RunOptions(t_end=0.2, restart=last, **steps))
    WORLD.barrier()
    assert outcome.status == "ok"
    one = ff.read_history(text / "history.csv")
    other = ff.read_history(packed / "history.h5")
    recorded = np.array(outcome.history["t"]) if WORLD.rank == 0 else other["t"]
    WORLD.barrier()
    assert not (packed / "history.csv").exists()
    assert [*one] == [*other]
    for name, values in one.items():
        # a restart rounds anew; a row of another step is off by 1e-3 and more
        np.testing.assert_allclose(other[name], values, rtol=1e-9, atol=1e-12)
    assert same(recorded, other["t"])


@pytest.mark.serial
@pytest.mark.usefixtures("_small_blocks")
def test_scripts_of_figures_read_a_table_that_is_written(tmp_path: Path) -> None:
    """They know the format, not the package."""
    pytest.importorskip("matplotlib")
    plots, table = script("plot_history"), made(10)
    writer = CompressedHistoryWriter(tmp_path / "history.h5", names(), SELF)
    writer.extend(list(table))
    path = plots.table_of(tmp_path)
    assert same(np.column_stack([*plots.read_table(path).values()]), table)
    writer.close()
    assert same(np.column_stack([*plots.read_table(path).values()]), table)
    path.write_bytes(b"t,a")
    with pytest.raises(ValueError, match="not a history table"):
        plots.read_table(path)


@pytest.mark.serial
def test_unknown_formats_are_refused() -> None:
    with pytest.raises(ValueError, match="history_format must be one of csv, hdf5"):
        ff.RunOptions(dt=0.1, t_end=1.0, history_format="parquet")
