# SPDX-License-Identifier: LGPL-3.0-or-later
"""ParaView series: what is written is what is read, on any number of ranks and after a kill."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

from mpi4py import MPI

import numpy as np
import pytest

from flexfem.io import (
    BeamFields,
    BeamWriter,
    JointFields,
    JointWriter,
    RigidBodyFields,
    RigidBodyWriter,
    VtuSeries,
    body_surface,
)
from flexfem.io.vtu.field_choice import FieldChoice
from flexfem.io.vtu.shell_fields import ShellFields, ShellWriter
from flexfem.io.vtu.surfaces import Surface, cylinder, frames_along, sphere
from flexfem.la.counting_comm import CountingComm

COMM = MPI.COMM_WORLD
# Fields are stored in single precision: relative rounding 6e-8.
SINGLE = 1e-7


def read(path: Path) -> Any:
    return pytest.importorskip("pyvista").read(path)


def pvd(path: Path) -> list[tuple[float, str]]:
    sets = ET.parse(path).getroot().iter("DataSet")
    return [(float(s.attrib["timestep"]), s.attrib["file"]) for s in sets]


def segment(rank: int, n: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """A straight line of n cells on each rank."""
    x = np.zeros((n + 1, 3))
    x[:, 0], x[:, 1] = np.linspace(0.0, 1.0, n + 1), 10.0 * rank
    return x, np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)


def beam(rank: int = 0, n: int = 4) -> BeamFields:
    x, cells = segment(rank, n)
    m = len(cells)
    strain = np.arange(6.0 * m).reshape(m, 6) + 100.0 * rank
    frames = np.broadcast_to(np.eye(3), (n + 1, 3, 3))
    kind, body = np.zeros(m, dtype=np.int64), np.full(m, rank)
    turn = np.broadcast_to(np.eye(3), (m, 2, 3, 3))
    motion = (x, 2.0 * x, frames, 3.0 * x, 4.0 * x)
    return BeamFields(*motion, cells, body, strain, 2 * strain, kind, turn)


def test_joined_beams_keep_the_fields_of_all_groups() -> None:
    one, two = beam(0, 4), beam(1, 3)
    both = BeamFields.joined([one, two])
    ends = np.concatenate([group.position[group.cells] for group in (one, two)])
    # cells of the second group point at its own nodes, after those of the first
    np.testing.assert_array_equal(both.position[both.cells], ends)
    np.testing.assert_array_equal(both.body, [0] * 4 + [1] * 3)
    assert BeamFields.joined([one]) is one


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Volume inside a closed surface; negative if it is inside out."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6.0)


# -- series ---


def test_series_gives_back_points_cells_and_arrays(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    series = VtuSeries(shared_tmp_path, "lines", COMM, components={"strain": tuple("abcdef")})
    rotation = np.arange(9.0 * len(x)).reshape(-1, 3, 3)
    strain = np.linspace(-1.0, 1.0, 6 * len(cells)).reshape(-1, 6)
    for step, time in ((0, 0.0), (10, 0.1)):
        series.write(
            time,
            step,
            x + time / 3.0,
            cells,
            "line",
            {"rotation": rotation, "temperature": x[:, 0]},
            {"strain": strain, "body": np.full(len(cells), COMM.rank)},
        )
    series.close()
    entries = pvd(shared_tmp_path / "lines.pvd")
    assert [t for t, _ in entries] == [0.0, 0.1]
    mesh = read(shared_tmp_path / entries[-1][1])
    assert mesh.n_cells == 3 * COMM.size
    assert set(mesh.celltypes) == {3}
    expected = np.concatenate([segment(r)[0] for r in range(COMM.size)]) + 0.1 / 3.0
    assert np.array_equal(np.asarray(mesh.points), expected)  # positions keep all digits
    assert mesh.point_data["rotation"].shape == (4 * COMM.size, 9)
    assert np.array_equal(mesh.point_data["rotation"][:4], rotation.reshape(-1, 9))
    assert np.allclose(mesh.cell_data["strain"][:3], strain, rtol=SINGLE, atol=0.0)
    assert np.array_equal(mesh.cell_data["body"], np.repeat(np.arange(COMM.size), 3))
    array = mesh.GetCellData().GetArray("strain")
    assert [array.GetComponentName(i) for i in range(6)] == list("abcdef")


@pytest.mark.parametrize(
    ("kind", "cells", "vtk"),
    [
        ("vertex", [[0]], 1),
        ("triangle", [[0, 1, 2]], 5),
        ("quad", [[0, 1, 2, 3]], 9),
        ("tetra", [[0, 1, 2, 3]], 10),
    ],
)
def test_series_writes_other_cells(
    shared_tmp_path: Path, kind: str, cells: list[list[int]], vtk: int
) -> None:
    x = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    series = VtuSeries(shared_tmp_path, kind, COMM)
    series.write(0.0, 0, x, cells, kind)
    series.close()
    mesh = read(shared_tmp_path / pvd(shared_tmp_path / f"{kind}.pvd")[0][1])
    assert mesh.celltypes.tolist() == [vtk] * COMM.size
    assert mesh.get_cell(0).point_ids == cells[0]


def test_series_with_cells_on_the_last_rank_only(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    if COMM.rank != COMM.size - 1:
        x, cells = x[:0], cells[:0]
    series = VtuSeries(shared_tmp_path, "part", COMM)
    series.write(0.5, 1, x, cells, "line", {"v": x}, {"body": cells[:, 0]})
    series.close()
    pieces = sorted(p.name for p in (shared_tmp_path / "part").glob("*.vtu"))
    assert pieces == [f"part_000001_{COMM.size - 1}.vtu"]
    assert read(shared_tmp_path / pvd(shared_tmp_path / "part.pvd")[0][1]).n_cells == 3


@pytest.mark.three_ranks
def test_ranks_that_have_cells_may_change(shared_tmp_path: Path) -> None:
    """Also after an instant that a mistake on one rank has left out."""
    x, cells = segment(COMM.rank)
    series = VtuSeries(shared_tmp_path, "s", COMM)
    last = COMM.size - 1
    for step, having in enumerate(([last], [0], range(COMM.size), [last])):
        mine = cells if COMM.rank in having else cells[:0]
        if step == 2:
            with pytest.raises(ValueError, match="a cell names point 4"):
                series.write(0.5, 9, x, cells + (COMM.rank == 0), "line", {"w": x})
        series.write(float(step), step, x, mine, "line", {"v": x} | ({"u": x} if step > 1 else {}))
    series.close()
    for step, count in enumerate((1, 1, COMM.size, 1)):
        time, file = pvd(shared_tmp_path / "s.pvd")[step]
        grid = read(shared_tmp_path / file)
        assert (time, grid.n_cells) == (step, 3 * count)
        assert set(grid.point_data) == ({"v", "u"} if step > 1 else {"v"})
    COMM.barrier()


@pytest.mark.three_ranks
def test_ranks_send_each_other_a_few_numbers_only(shared_tmp_path: Path) -> None:
    """Not their arrays, nor descriptions of them, which 1000 ranks would send to 1000."""

    class Watched(CountingComm):
        others = 0

        def allgather(self, sendobj: Any) -> Any:
            self.others += 1
            return super().allgather(sendobj)

        def gather(self, *args: Any, **kwargs: Any) -> Any:
            self.others += 1
            return super().gather(*args, **kwargs)

        def bcast(self, *args: Any, **kwargs: Any) -> Any:
            self.others += 1
            return super().bcast(*args, **kwargs)

    comm = Watched(COMM)
    x, cells = segment(COMM.rank, 1000)
    series = VtuSeries(shared_tmp_path, "s", comm)
    series.write(0.0, 0, x, cells, "line", {f"v{i}": x for i in range(20)})
    before, comm.others = comm.sent, 0
    series.write(1.0, 1, x, cells, "line", {f"v{i}": x for i in range(20)})
    after = comm.sent
    assert comm.others == 0
    # two errors and five numbers to agree on; descriptions of the arrays alone are 1 kB a rank
    assert after.reduced_bytes - before.reduced_bytes <= 56
    assert after.messages == before.messages
    series.close()


def test_series_without_cells_anywhere_leaves_nothing(shared_tmp_path: Path) -> None:
    series = VtuSeries(shared_tmp_path, "none", COMM)
    series.write(0.0, 0, np.zeros((0, 3)), np.zeros((0, 2)), "line")
    series.close()
    assert list(shared_tmp_path.iterdir()) == []


def test_series_without_cells_removes_that_of_an_earlier_run(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    for n in (3, 0):
        series = VtuSeries(shared_tmp_path, "s", COMM)
        series.write(0.0, 0, x, cells[:n], "line")
        series.close()
    assert [p for p in shared_tmp_path.rglob("*") if p.is_file()] == []


def test_series_is_readable_after_every_write(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    series = VtuSeries(shared_tmp_path, "s", COMM)
    for step in range(3):
        series.write(0.1 * step, step, x, cells, "line")
        COMM.barrier()
        entries = pvd(shared_tmp_path / "s.pvd")
        assert len(entries) == step + 1
        assert all((shared_tmp_path / file).is_file() for _, file in entries)
        COMM.barrier()
    assert not [p for p in shared_tmp_path.rglob("*") if p.name.endswith(".tmp")]
    series.close()


def test_an_index_that_was_cut_off_or_lost_is_mended(shared_tmp_path: Path) -> None:
    """A machine that fails may leave half an index; users may remove one that is being written."""
    x, cells = segment(COMM.rank)
    index = shared_tmp_path / "s.pvd"
    series = VtuSeries(shared_tmp_path, "s", COMM)
    for step, loss in enumerate((None, "all", "end", None)):
        series.write(0.1 * step, step, x, cells, "line")
        COMM.barrier()
        assert len(pvd(index)) == step + 1
        COMM.barrier()
        if COMM.rank == 0 and loss == "all":
            index.unlink()
        elif COMM.rank == 0 and loss == "end":
            index.write_bytes(index.read_bytes()[:-9])
        COMM.barrier()
    series.close()
    if COMM.rank == 0:
        text = index.read_bytes()
        index.write_bytes(text[: text.rindex(b"<DataSet") + 20] + bytes(50))
    COMM.barrier()
    VtuSeries(shared_tmp_path, "s", COMM, resume=1.0).close()
    # the half line goes, those before it stay
    assert [time for time, _ in pvd(index)] == pytest.approx([0.0, 0.1, 0.2])


def test_series_replaces_a_step_written_twice(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    series = VtuSeries(shared_tmp_path, "s", COMM)
    series.write(0.0, 0, x, cells, "line")
    series.write(0.25, 0, 2.0 * x, cells, "line")
    series.close()
    ((time, file),) = pvd(shared_tmp_path / "s.pvd")
    assert time == 0.25
    assert read(shared_tmp_path / file).bounds[1] == 2.0


def test_series_removes_its_own_old_files_only(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    folder = shared_tmp_path / "s"
    foreign = [folder / "s_notes.txt", folder / "s_other_000001_0.vtu", shared_tmp_path / "t.pvd"]
    if COMM.rank == 0:
        folder.mkdir()
        old = ["s_000099_0.vtu", "s_000099_7.vtu", "s_000099.pvtu", ".s_000099_0.vtu.tmp"]
        for path in (*foreign, *(folder / name for name in old)):
            path.write_text("old")
        (shared_tmp_path / "s.pvd").write_text("not even XML")
    COMM.barrier()
    series = VtuSeries(shared_tmp_path, "s", COMM)
    series.write(0.0, 1, x, cells, "line")
    series.close()
    assert all(path.is_file() for path in foreign)
    assert not list(folder.glob("*000099*"))
    assert not list(folder.glob(".*"))
    assert len(pvd(shared_tmp_path / "s.pvd")) == 1


def test_series_goes_on_after_a_restart(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    for resume, steps in ((None, range(5)), (0.2, range(3, 4))):
        series = VtuSeries(shared_tmp_path, "s", COMM, resume=resume)
        for step in steps:
            series.write(step * 0.1 + (0.05 if resume else 0.0), step, x, cells, "line")
        series.close()
    assert [t for t, _ in pvd(shared_tmp_path / "s.pvd")] == pytest.approx([0.0, 0.1, 0.2, 0.35])
    assert not list((shared_tmp_path / "s").glob("s_000004*"))


@pytest.mark.parametrize(("resume", "kept"), [(0.0, 1), (0.5, 2), (0.75, 2), (1.0, 3)])
def test_series_is_cut_behind_the_instant_of_the_restart(
    resume: float, kept: int, shared_tmp_path: Path
) -> None:
    x, cells = segment(COMM.rank)
    for moment, times in ((None, (0.0, 0.5, 1.0)), (resume, (2.0,))):
        series = VtuSeries(shared_tmp_path, "s", COMM, resume=moment)
        for step, t in enumerate(times):
            series.write(t, step + 10 * (moment is not None), x, cells, "line")
        series.close()
    assert [t for t, _ in pvd(shared_tmp_path / "s.pvd")] == [*[0.0, 0.5, 1.0][:kept], 2.0]


#: Names of the entries of an array in writers, in the order of the laws of sections.
NAMES = {
    ("beams", "strain"): "gamma1 gamma2 gamma3 kappa1 kappa2 kappa3",
    ("beams", "resultant"): "N Q2 Q3 T M2 M3",
    ("shells", "strain"): "eps11 eps22 gamma12 kappa11 kappa22 2kappa12",
    ("shells", "resultant"): "n11 n22 n12 m11 m22 m12",
}


@pytest.mark.serial
def test_entries_of_strains_and_resultants_have_their_names(tmp_path: Path) -> None:
    square = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]
    writer = BeamWriter(tmp_path, COMM, [square])
    writer.write(0.0, 0, beam())
    writer.close()
    x, six = np.eye(3), np.arange(6.0).reshape(1, 6)
    triangle, body = np.array([[0, 1, 2]]), np.zeros(1, dtype=np.int64)
    shells = ShellWriter(tmp_path, COMM)
    shells.write(
        0.0, 0, ShellFields(x, x, x, triangle, body, six, six, np.ones(1), np.zeros((1, 3)))
    )
    shells.close()
    for (series, array), names in NAMES.items():
        data = read(tmp_path / pvd(tmp_path / f"{series}.pvd")[0][1])
        written = data.GetCellData().GetArray(array)
        assert [written.GetComponentName(i) for i in range(6)] == names.split(), (series, array)
        assert np.array_equal(data.cell_data[array][0], np.arange(6.0) * (1 + (
            series == "beams" and array == "resultant")))  # fmt: skip


def test_a_mistake_on_one_rank_is_raised_on_all(shared_tmp_path: Path) -> None:
    x, cells = segment(COMM.rank)
    series = VtuSeries(shared_tmp_path, "s", COMM)
    wrong = cells + 1 if COMM.rank == COMM.size - 1 else cells
    with pytest.raises(ValueError, match="'s': a cell names point 4"):
        series.write(0.0, 0, x, wrong, "line")
    with pytest.raises(ValueError, match=r"array 'v': shape \(2,\), expected 4 rows"):
        series.write(0.0, 0, x, cells, "line", {"v": [1.0, 2.0]})
    with pytest.raises(ValueError, match="unknown cell type 'hexagon'"):
        series.write(0.0, 0, x, cells, "hexagon")
    with pytest.raises(TypeError, match="array 'v'"):
        series.write(0.0, 0, x, cells, "line", {"v": np.array(["a"] * 4)})
    series.close()
    with pytest.raises(ValueError, match="after close"):
        series.write(0.0, 0, x, cells, "line")


def test_an_unwritable_folder_is_an_error_on_all_ranks(shared_tmp_path: Path) -> None:
    if COMM.rank == 0:
        (shared_tmp_path / "s").write_text("a file in the way")
    COMM.barrier()
    x, cells = segment(COMM.rank)
    with pytest.raises(OSError, match="s"):
        VtuSeries(shared_tmp_path, "s", COMM).write(0.0, 0, x, cells, "line")


@pytest.mark.parametrize(
    ("precision", "places", "fields"),
    [("mixed", "f8", "f4"), ("single", "f4", "f4"), ("double", "f8", "f8")],
)
def test_numbers_have_the_chosen_precision(
    shared_tmp_path: Path, precision: str, places: str, fields: str
) -> None:
    x, cells = segment(COMM.rank)
    x, v = x + 1.0 / 3.0, x + 0.1
    series = VtuSeries(shared_tmp_path, "s", COMM, fields=FieldChoice(precision=precision))
    series.write(0.0, 0, x, cells, "line", {"v": v}, {"body": cells[:, 0], "e": v[:3, 0]})
    series.close()
    grid = read(shared_tmp_path / pvd(shared_tmp_path / "s.pvd")[0][1])
    COMM.barrier()
    assert grid.points.dtype == places
    assert [grid.point_data["v"].dtype, grid.cell_data["e"].dtype] == [fields, fields]
    mine = slice(4 * COMM.rank, 4 * COMM.rank + 4)  # pieces in the order of ranks
    # every bit of what is written; numbers that went through single precision are off by 1e-8
    np.testing.assert_array_equal(grid.points[mine], x.astype(places))
    np.testing.assert_array_equal(grid.point_data["v"][mine], v.astype(fields))


# -- beams, bodies, joints ---


def test_beams_as_lines_and_surfaces(shared_tmp_path: Path) -> None:
    square = [[-0.1, -0.2], [-0.1, 0.2], [0.1, 0.2], [0.1, -0.2], [-0.1, -0.2]]  # clockwise, closed
    writer = BeamWriter(shared_tmp_path, COMM, [square])
    writer.write(0.0, 0, beam(COMM.rank))
    writer.close()
    lines = read(shared_tmp_path / pvd(shared_tmp_path / "beams.pvd")[0][1])
    own = beam(0)
    assert np.array_equal(lines.cell_data["resultant"][:4], own.resultant)
    moment = np.hypot(own.resultant[:, 4], own.resultant[:, 5])
    assert np.allclose(lines.cell_data["bending_moment"][:4], moment, rtol=SINGLE)
    assert np.array_equal(lines.point_data["e2"][0], [0.0, 1.0, 0.0])
    skin = read(shared_tmp_path / pvd(shared_tmp_path / "beam_surfaces.pvd")[0][1])
    assert skin.n_points == 4 * 2 * 4 * COMM.size  # every cell has both its ends
    assert skin.n_cells == (4 * 4 + 2) * COMM.size
    assert np.allclose(skin.bounds[2:], [-0.1, 10.0 * (COMM.size - 1) + 0.1, -0.2, 0.2])
    quads = skin.cells.reshape(-1, 5)[:18, 1:]
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    # Closed and outward: the divergence theorem gives the volume of the beam. Positions are of
    # single precision; a face that is missing or reversed changes it by a tenth at least.
    assert volume(np.asarray(skin.points, float), triangles) == pytest.approx(0.08, rel=1e-4)
    assert set(skin.cell_data["body"]) == set(range(COMM.size))


@pytest.mark.parametrize("corners", [3, 4, 5, 6, 16])
def test_swept_polygon_is_closed(shared_tmp_path: Path, corners: int) -> None:
    phi = 2.0 * np.pi * np.arange(corners) / corners
    outline = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    writer = BeamWriter(shared_tmp_path, COMM, [None, outline])
    b = beam(COMM.rank)
    # The first cell has no outline, so the surface starts at the second node.
    section = np.array([0, 1, 1, 1])
    b = BeamFields(**{**b.__dict__, "section": section})
    writer.write(0.0, 0, b)
    writer.close()
    skin = read(shared_tmp_path / pvd(shared_tmp_path / "beam_surfaces.pvd")[0][1])
    quads = skin.cells.reshape(-1, 5)[:, 1:]
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    area = 0.5 * corners * math.sin(2.0 * math.pi / corners)
    found = volume(np.asarray(skin.points, float), triangles)
    assert found == pytest.approx(0.75 * area * COMM.size, rel=1e-4)  # see above


def test_writers_accept_ranks_with_nothing(shared_tmp_path: Path) -> None:
    last = COMM.rank == COMM.size - 1
    beams = BeamWriter(shared_tmp_path, COMM, [[[0, 0], [1, 0], [0, 1]]])
    beams.write(0.0, 0, beam() if last else BeamFields.empty())
    bodies = RigidBodyWriter(shared_tmp_path, COMM, [sphere(1.0)])
    one, i = np.ones((1, 3)), np.zeros(1, dtype=np.int64)
    own = RigidBodyFields(one, np.eye(3)[None], one, one, i, one, np.eye(3)[None])
    bodies.write(0.0, 0, own if last else RigidBodyFields.empty())
    joints = JointWriter(shared_tmp_path, COMM, ["Revolute"], 0.1)
    held = JointFields(one, 2 * one, one, one, one, i, one)
    joints.write(0.0, 0, held if last else JointFields.empty())
    for writer in (beams, bodies, joints):
        writer.close()
    for name in ("beams", "beam_surfaces", "rigid_bodies", "joints", "reactions"):
        assert read(shared_tmp_path / pvd(shared_tmp_path / f"{name}.pvd")[0][1]).n_cells > 0


def test_beam_fields_with_a_wrong_shape() -> None:
    with pytest.raises(ValueError, match=r"'strain': shape \(3, 6\), expected \(4, 6\)"):
        BeamFields(**{**beam().__dict__, "strain": np.zeros((3, 6))})
    with pytest.raises(ValueError, match="outline 0"):
        BeamWriter(Path(), COMM, [[[0.0, 0.0], [1.0, 0.0]]])


def test_rigid_bodies_move_and_carry_velocities(shared_tmp_path: Path) -> None:
    surface = body_surface(SimpleNamespace(sizes=(2.0, 4.0, 6.0)), 1.0, np.ones(3), (9.0, 0.0, 0.0))
    writer = RigidBodyWriter(shared_tmp_path, COMM, [sphere(1.0), surface])
    turn = np.array([[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])  # x -> y
    z = np.array([[0.0, 0.0, 1.0]])
    x = np.array([[10.0, 0.0, 0.0]])
    before = np.eye(3)[None]
    writer.write(0.0, 0, RigidBodyFields(x, turn, 0.0 * z, z, np.array([1]), 2.0 * x, before))
    writer.close()
    mesh = read(shared_tmp_path / pvd(shared_tmp_path / "rigid_bodies.pvd")[0][1])
    assert np.allclose(mesh.bounds, [8.0, 12.0, -1.0, 1.0, -3.0, 3.0])
    points = np.asarray(mesh.points)
    assert np.allclose(mesh.point_data["velocity"], np.cross(z, points - x), rtol=SINGLE, atol=1e-6)
    assert set(mesh.cell_data["body"]) == {1}
    began = (points - x) @ turn[0] - x  # turned back, and moved back by 2 x
    assert np.allclose(mesh.point_data["displacement"], points - began, rtol=SINGLE, atol=1e-6)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (SimpleNamespace(sizes=(1.0, 2.0, 3.0)), 6.0),
        (SimpleNamespace(radius=1.0, length=2.0, axis=(1.0, 1.0, 0.0)), 2.0 * math.pi),
        (SimpleNamespace(radius=1.0), 4.0 / 3.0 * math.pi),
    ],
)
def test_shapes_are_closed_and_outward(shape: object, expected: float) -> None:
    surface = body_surface(shape, 1.0, np.eye(3), (5.0, 0.0, 0.0))
    # Inscribed polyhedra are a few per cent smaller; an open or inverted face would be far off.
    assert 0.94 * expected < volume(surface.points, surface.triangles) <= expected * (1 + 1e-12)
    with pytest.raises(TypeError, match="int is not a shape"):
        body_surface(3, 1.0, np.eye(3))


def test_box_of_a_body_without_shape_has_its_inertia() -> None:
    mass, (a, b, c) = 2.0, (1.0, 2.0, 3.0)
    moments = mass / 12.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    q = frames_along(np.array([[1.0, 2.0, 3.0]]))[0]
    surface = body_surface(None, mass, q @ np.diag(moments) @ q.T, (1.0, 2.0, 3.0))
    assert volume(surface.points, surface.triangles) == pytest.approx(a * b * c, rel=1e-10)
    assert np.allclose(
        np.abs((surface.points - [1.0, 2.0, 3.0]) @ q).max(axis=0),
        [a / 2, b / 2, c / 2],
        rtol=1e-10,
    )


def test_box_of_a_body_without_shape_is_not_larger_than_allowed() -> None:
    """A flywheel's inertia without its mass would fill the picture."""
    surface = body_surface(None, 1.0, (1.0, 1.0, 1.0), (1.0, 2.0, 3.0), 0.5)
    # the side of the equivalent cube is 2.4 m
    assert np.allclose(np.ptp(surface.points, axis=0), 0.5, rtol=1e-12)
    assert np.allclose(surface.points.mean(axis=0), [1.0, 2.0, 3.0])
    small = body_surface(None, 1.0, (1e-4, 1e-4, 1e-4), (0.0, 0.0, 0.0), 0.5)
    assert np.ptp(small.points) == pytest.approx(6e-4**0.5, rel=1e-12)


def test_frames_along_all_directions(rng: np.random.Generator) -> None:
    axes = np.concatenate([rng.normal(size=(20, 3)), np.eye(3), -np.eye(3), np.zeros((1, 3))])
    frames = frames_along(axes)
    eye = np.einsum("nji,njk->nik", frames, frames)
    assert np.allclose(eye, np.eye(3), atol=100 * np.finfo(float).eps)
    assert np.allclose(np.linalg.det(frames), 1.0)
    directions = axes[:-1] / np.linalg.norm(axes[:-1], axis=1)[:, None]
    assert np.allclose(frames[:-1, :, 2], directions)


def test_joints_show_glyph_and_link(shared_tmp_path: Path) -> None:
    kinds = ["Spherical", "Revolute", "Prismatic", "SpringDamper"]
    writer = JointWriter(shared_tmp_path, COMM, kinds, [0.1, 0.2, 0.2, 0.1])
    n = len(kinds)
    a = np.zeros((n, 3))
    a[:, 0] = np.arange(n)
    b = a + np.array([0.0, 2.0, 0.0])
    b[1] = a[1]  # an ideal joint: both markers at one place
    axis = np.tile([0.0, 0.0, 1.0], (n, 1))
    force = np.tile([3.0, 4.0, 0.0], (n, 1))
    writer.write(0.0, 0, JointFields(a, b, axis, force, 2.0 * force, np.arange(n), 3.0 * a))
    writer.close()
    mesh = read(shared_tmp_path / pvd(shared_tmp_path / "joints.pvd")[0][1])
    assert np.isfinite(mesh.points).all()
    assert mesh.bounds[3] == pytest.approx(2.0)
    assert set(mesh.cell_data["joint"]) == set(range(n))
    assert np.allclose(mesh.cell_data["force_magnitude"], 5.0)
    revolute = mesh.extract_cells(np.flatnonzero(mesh.cell_data["joint"] == 1))
    assert revolute.bounds[5] == pytest.approx(0.12)  # 0.6 of the size along the axis
    arrows = read(shared_tmp_path / pvd(shared_tmp_path / "reactions.pvd")[0][1])
    assert np.array_equal(arrows.points[:n], a)
    assert np.allclose(arrows.point_data["force"][:n], force)
    assert np.allclose(arrows.point_data["moment_magnitude"], 10.0)


def test_cylinder_radius_is_about_its_axis() -> None:
    surface: Surface = cylinder(0.5, 4.0, (2.0, 0.0, 0.0))
    assert surface.points[:, 0].max() == pytest.approx(2.0)
    assert np.linalg.norm(surface.points[:, 1:], axis=1).max() == pytest.approx(0.5)
