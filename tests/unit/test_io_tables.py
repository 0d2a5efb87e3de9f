# SPDX-License-Identifier: LGPL-3.0-or-later
"""History, summary and progress bar: all digits, atomic replacement, killed and continued runs."""

import io
import json
import math
import sys
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

from flexfem.io import HistoryWriter, Progress, read_history, write_summary
from flexfem.io.atomic import replace_file
from flexfem.io.tables.history import AngleColumns
from flexfem.io.tables.table import write_table

COMM = MPI.COMM_WORLD


# -- history ---


def test_history_keeps_all_digits(shared_tmp_path: Path, rng: np.random.Generator) -> None:
    path = shared_tmp_path / "new" / "history.csv"
    rows = np.concatenate([rng.normal(size=(20, 2)), [[math.nan, -math.inf], [1e-300, 0.1 + 0.2]]])
    writer = HistoryWriter(path, ["a", "b"], COMM)
    for i, row in enumerate(rows):
        writer.write(i / 3.0, row if COMM.rank == 0 else ())
        if COMM.rank == 0:  # on disk before close
            assert len(path.read_text().splitlines()) == i + 2
    writer.close()
    COMM.barrier()
    table = read_history(path)
    assert list(table) == ["t", "a", "b"]
    assert np.array_equal(table["t"], np.arange(len(rows)) / 3.0)
    assert np.array_equal(np.stack([table["a"], table["b"]], axis=1), rows, equal_nan=True)


def test_angles_are_continued() -> None:
    true = np.linspace(0.5, -40.0, 60)
    wrapped = np.angle(np.exp(1j * true))
    angles = AngleColumns(["phi", "raw"], ["phi"])
    lost = np.where(np.arange(60) == 7, math.nan, wrapped)
    table = np.array([angles.unwrap(row) for row in zip(lost, wrapped, strict=True)])
    keep = np.arange(60) != 7
    assert math.isnan(table[7, 0])
    assert np.allclose(table[keep, 0], true[keep], rtol=0.0, atol=1e-13)
    assert np.array_equal(table[:, 1], wrapped)
    with pytest.raises(ValueError, match="no column 'b'"):
        AngleColumns(["a"], ["b"])


def test_history_goes_on_after_a_restart(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "history.csv"
    for resume, first in ((None, 0), (0.3, 4)):
        writer = HistoryWriter(path, ["phi"], COMM, resume=resume)
        if COMM.rank == 0:
            assert np.array_equal(writer.kept[:, 1], 2.0 * np.arange(first))
        for i in range(first, first + 6):
            writer.write(0.1 * i, [2.0 * i])
        writer.sync()
        writer.close()
        COMM.barrier()
    table = read_history(path)
    assert np.allclose(table["t"], 0.1 * np.arange(10))
    assert np.array_equal(table["phi"], 2.0 * np.arange(10))
    COMM.barrier()
    with pytest.raises(ValueError, match="other columns"):
        HistoryWriter(path, ["psi"], COMM, resume=0.3)


@pytest.mark.parametrize(("resume", "kept"), [(0.0, 1), (0.5, 2), (0.75, 2), (1.0, 3), (9.0, 3)])
def test_history_is_cut_behind_the_instant_of_the_restart(
    resume: float, kept: int, shared_tmp_path: Path
) -> None:
    """The row of the restart itself stays, that of the start too."""
    path = shared_tmp_path / "history.csv"
    for moment, rows in ((None, (0.0, 0.5, 1.0)), (resume, ())):
        writer = HistoryWriter(path, ["phi"], COMM, resume=moment)
        for t in rows:
            writer.write(t, [t])
        writer.close()
        COMM.barrier()
    assert read_history(path)["t"].tolist() == [0.0, 0.5, 1.0][:kept]


def test_history_of_a_killed_run_is_readable(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "history.csv"
    if COMM.rank == 0:
        path.write_text("t,a\n0.0,1.0\n0.1,2.0\n0.2,3.12345")
    COMM.barrier()
    assert read_history(path)["a"].tolist() == [1.0, 2.0]
    COMM.barrier()
    writer = HistoryWriter(path, ["a"], COMM, resume=1.0)
    writer.write(0.2, [3.0])
    writer.close()
    COMM.barrier()
    assert read_history(path)["a"].tolist() == [1.0, 2.0, 3.0]


def test_history_without_rows_or_columns(shared_tmp_path: Path) -> None:
    HistoryWriter(shared_tmp_path / "a.csv", ["a"], COMM).close()
    bare = HistoryWriter(shared_tmp_path / "b.csv", [], COMM)
    bare.write(0.5, [])
    bare.close()
    COMM.barrier()
    assert read_history(shared_tmp_path / "a.csv")["a"].shape == (0,)
    assert read_history(shared_tmp_path / "b.csv")["t"].tolist() == [0.5]


@pytest.mark.parametrize("columns", [["t"], ["a", "a"], ["a,b"], [""], ["a\n"]])
def test_history_refuses_unusable_names(shared_tmp_path: Path, columns: list[str]) -> None:
    with pytest.raises(ValueError, match="HistoryWriter"):
        HistoryWriter(shared_tmp_path / "h.csv", columns, COMM)
    assert not (shared_tmp_path / "h.csv").exists()


def test_history_refuses_wrong_rows(shared_tmp_path: Path) -> None:
    writer = HistoryWriter(shared_tmp_path / "h.csv", ["a"], COMM)
    if COMM.rank == 0:
        with pytest.raises(ValueError, match="2 values for 1 columns"):
            writer.write(0.0, [1.0, 2.0])
    writer.close()


# -- summary, atomic files, progress ---


def test_summary_is_sorted_plain_json(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "new" / "summary.json"
    data = {
        "status": "completed",
        "results": {"b": np.float64("nan"), "a": np.array([1.0, math.inf]), "n": np.int64(3)},
        "case": None,
        "folder": Path("x"),
        "converged": np.bool_(True),
    }
    write_summary(path, data, COMM)
    COMM.barrier()
    text = path.read_text()
    assert json.loads(text) == {
        "status": "completed",
        "results": {"b": None, "a": [1.0, None], "n": 3},
        "case": None,
        "folder": "x",
        "converged": True,
    }
    assert text.index('"case"') < text.index('"results"') < text.index('"status"')


def test_a_failed_summary_leaves_the_old_one(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / f"summary_{COMM.rank}.json"
    write_summary(path, {"a": 1})
    with pytest.raises(TypeError, match=r"summary\.b\.c: a object"):
        write_summary(path, {"a": 2, "b": {"c": object()}})
    assert json.loads(path.read_text()) == {"a": 1}


def test_replace_file_keeps_the_old_version_on_failure(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / f"file_{COMM.rank}"
    replace_file(path, [b"old"])

    def broken() -> Any:
        yield b"half of the new"
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        replace_file(path, broken())
    assert path.read_bytes() == b"old"
    assert not path.with_name(f".{path.name}.tmp").exists()


def test_progress_is_silent_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(1.0, True) as bar:
        bar.update(0.5, 10, 1)
    assert capsys.readouterr().err == ""


def test_progress_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    stream.isatty = lambda: True  # type: ignore[method-assign]
    monkeypatch.setattr(sys, "stderr", stream)
    with Progress(2.0, False) as bar:
        bar.update(1.0, 1, 1)
    assert stream.getvalue() == ""
    with Progress(2.0, True, t_start=0.5) as bar:
        bar.update(1.0, 12, 3)
        bar.update(2.0 + 1e-9, 15, 3)
    text = stream.getvalue()
    assert "t = 2 of 2 s, 15 iterations, 3 factorisations" in text
    assert "100%" in text
    with Progress(2.0, True, unit="") as bar:  # a load factor
        bar.update(1.0, 4, 4)
    assert "t = 1 of 2, 4 iterations" in stream.getvalue()


# -- tables of words and numbers ---


def test_table_keeps_words_and_digits(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "new" / "table.csv"
    rows = [{"name": "a, b", "value": 0.1 + 0.2}, {"name": "c", "value": 3}]
    write_table(path, rows, COMM)
    write_table(path, rows, COMM)  # replaced, not appended to
    assert path.read_text() == 'name,value\n"a, b",0.30000000000000004\nc,3\n'
    with pytest.raises(ValueError, match="the same columns"):
        write_table(path, [*rows, {"name": "d"}], COMM)
    with pytest.raises(ValueError, match="there must be rows"):
        write_table(path, [], COMM)
