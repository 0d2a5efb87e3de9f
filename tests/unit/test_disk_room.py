# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warning of fields for which the disk has no room."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI

import pytest

import flexfem as ff

COMM = MPI.COMM_WORLD


class _Usage(NamedTuple):
    free: int


def _bar() -> ff.Model:
    """A bar that falls."""
    mesh = ff.LineMesh.straight({"bar": [(0, 0, 0), (1, 0, 0)]}, elements=40)
    model = ff.Model("bar", mesh=mesh)
    section = ff.Section.circle(0.05, ff.Material(1e9, 0.3, 1e3))
    model.add(ff.Beam("bar", section), ff.Gravity((0.0, 0.0, -9.81)))
    return model


@pytest.fixture
def warned(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[int], tuple[list[str], int]]:
    """Run with so many bytes free: warnings of the disk, and bytes of all fields at the end."""

    def run(free: int, **options: Any) -> tuple[list[str], int]:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: _Usage(free))
        given = ff.RunOptions(
            dt=1e-3, t_end=0.023, every=5, quiet=True, output=shared_tmp_path, **options
        )
        outcome = ff.simulate(_bar(), given)
        assert outcome.status == "ok"
        files = list(shared_tmp_path.glob("*/*.vtu"))
        texts = [text for text in outcome.summary["warnings"] if "are free" in text]
        COMM.Barrier()  # none removes the folder that another one looks at
        return texts, sum(path.stat().st_size for path in files)

    return run


def test_fields_without_room_are_told(
    warned: Callable[..., tuple[list[str], int]], shared_tmp_path: Path
) -> None:
    (text,), written = warned(10_000)
    instants, each, needed = re.match(
        r"(\d+) further instants of fields of ([\d.]+) MB each will take about ([\d.]+) MB, "
        r"0.01 MB are free in output folder '.*';", text,
    ).groups()  # type: ignore[union-attr]  # fmt: skip
    assert f"'{shared_tmp_path}'" in text
    assert int(instants) == 5  # after 5, 10, 15, 20 and, at the end, 23 steps
    # one rank's files alone would be half, files of an earlier run twice as much
    assert 6 * float(each) == pytest.approx(written / 1e6, rel=0.02)
    assert float(needed) == pytest.approx(5 * float(each), rel=0.02)


def test_nothing_is_told_where_there_is_room(
    warned: Callable[..., tuple[list[str], int]],
) -> None:
    _, written = warned(10_000)
    assert warned(written)[0] == []
    assert warned(10, fields="none")[0] != []  # places are left
