# SPDX-License-Identifier: LGPL-3.0-or-later
"""What will not fit into memory is refused before room is made for it."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import _memory
from flexfem._memory import available, check_room, shown
from flexfem.system import memory

COMM = MPI.COMM_WORLD


def rod(elements: int) -> ff.Model:
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements)
    section = ff.Section.circle(0.02, ff.Material(2e11, 0.3, 7800.0))
    model = ff.Model("m", mesh=mesh)
    model.add(ff.Beam("rod", section, orientation=(0.0, 1.0, 0.0)), ff.Gravity((0.0, 0.0, -9.81)))
    return model


#: Meshes that were not meant: a quadrillion of elements is 500 PB.
MESHES = {
    "LineMesh: 1000000000000000 elements a line": lambda: rod(10**15),
    "NurbsCurve: 1000000000000000 elements": lambda: ff.NurbsCurve.line(
        (0, 0, 0), (1, 0, 0), elements=10**15
    ),
}


@pytest.mark.serial
@pytest.mark.parametrize("owner", MESHES)
def test_meshes_that_were_not_meant(owner: str) -> None:
    with pytest.raises(ValueError, match=r"of memory, .* are left; were so many meant") as caught:
        MESHES[owner]()
    assert str(caught.value).startswith(f"{owner} would need about ")


@pytest.mark.three_ranks
def test_models_that_do_not_fit_are_refused_on_all_ranks(monkeypatch: Any) -> None:
    """A step of 30001 nodes takes 0.8 GB with the program; there is only half a GB, on one rank."""
    rest = 5e8 if COMM.rank == COMM.size - 1 else 1e15
    monkeypatch.setattr(memory, "available", lambda: rest)
    monkeypatch.setattr(memory, "_LINE", 2.6e4)  # as if it were ten times as large
    with pytest.raises(ValueError, match=r'^Model "m": a step would need about [34].*GB') as caught:
        ff.simulate(rod(30_000), ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True))
    assert len(set(COMM.allgather(str(caught.value)))) == 1


@pytest.mark.serial
def test_small_models_are_not_asked_for(monkeypatch: Any) -> None:
    monkeypatch.setattr(memory, "available", lambda: 0.0)
    memory.check_memory(rod(1000), COMM)


@pytest.mark.serial
def test_estimates_grow_as_memory_does() -> None:
    """Motions with 20,000 and 60,000 elements took 0.59 and 1.23 GB, a sheet of 121x61 0.61 GB."""
    # within a third: a factor of one unknown instead of six, or of ten, is beyond
    assert memory.memory_of_run(rod(20_000)) == pytest.approx(0.59e9, rel=0.33)
    assert memory.memory_of_run(rod(60_000)) == pytest.approx(1.23e9, rel=0.33)
    grid = ff.SurfaceMesh.grid("s", np.linspace(0, 1, 121), np.linspace(0, 1, 61))
    sheet = ff.Model("sheet", surface=grid)
    sheet.add(ff.Shell("s", ff.ShellSection.isotropic(2e-3, ff.Material(5e6, 0.45, 1100.0))))
    assert memory.memory_of_run(sheet) == pytest.approx(0.61e9, rel=0.33)


@pytest.mark.serial
def test_what_is_there(tmp_path: Path, monkeypatch: Any) -> None:
    """The least of what the computer, the container and the limit of the process leave."""
    assert 1e6 < available() < 1e16
    files = {"meminfo": "MemTotal: 9 kB\nMemAvailable:  2000000 kB\n", "max": "max", "used": "0"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    texts = {"/proc/meminfo": tmp_path / "meminfo"}
    original = _memory._text
    monkeypatch.setattr(_memory, "_GROUP", ((str(tmp_path / "max"), str(tmp_path / "used")),))
    monkeypatch.setattr(_memory, "_text", lambda path: original(str(texts.get(path, path))))
    monkeypatch.setattr(
        _memory.resource, "getrlimit", lambda _: (_memory.resource.RLIM_INFINITY, 0)
    )
    assert available() == 2.048e9
    (tmp_path / "max").write_text("3000000000\n")
    (tmp_path / "used").write_text("2500000000\n")
    assert available() == 5e8
    with pytest.raises(ValueError, match=r"x would need about 1.5 GB of memory, 500 MB are left"):
        check_room("x", 1.5e9)
    check_room("x", 0.9e9)  # so little is never asked for


def test_sizes_in_words() -> None:
    assert [shown(x) for x in (5e5, 2.5e8, 1.6e10, 5e14)] == ["0.5 MB", "250 MB", "16 GB", "500 TB"]
