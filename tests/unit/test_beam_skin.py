# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of beams: closed, where the sections are, with the stresses of the sections."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.io import BeamFields, BeamWriter
from flexfem.io.vtu.beam_skin import BeamSkin, SkinSection
from flexfem.io.vtu.polygons import cut
from flexfem.materials.material import Material
from flexfem.materials.section import Section
from flexfem.materials.section_wall import SectionWall

COMM = MPI.COMM_WORLD
STEEL = Material(2.1e11, 0.3, 7850.0)
# walls of 1 and 2, both flanges 6 wide, 8 high
I_SECTION = [
    [-3, -4], [3, -4], [3, -3], [1, -3], [1, 3], [3, 3],
    [3, 4], [-3, 4], [-3, 3], [-1, 3], [-1, -3], [-3, -3],
]  # fmt: skip
CHANNEL = [[-2, -3], [3, -3], [3, -2], [-1, -2], [-1, 2], [3, 2], [3, 3], [-2, 3]]


def straight(walls: Any, n: int = 3, turn: np.ndarray | None = None) -> BeamFields:
    """A beam along x of length 2 on every rank, with numbers for resultants."""
    x = np.zeros((n + 1, 3))
    x[:, 0] = np.linspace(0.0, 2.0, n + 1)
    x[:, 1] = 100.0 * COMM.rank
    cells = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    axes, zero = np.broadcast_to(np.eye(3), (n + 1, 3, 3)), np.zeros((n + 1, 3))
    turns = np.broadcast_to(np.eye(3) if turn is None else turn, (n, 2, 3, 3))
    resultant = 1.0 + np.arange(6.0 * n).reshape(n, 6) + COMM.rank
    none = np.zeros(n, dtype=np.int64)
    return BeamFields(
        x, zero, axes, zero, zero, cells, none, resultant, resultant, none, turns
    )  # fmt: skip


def volume(points: np.ndarray, quads: np.ndarray) -> float:
    """Inside a closed surface, by the divergence theorem; negative if it is inside out."""
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    a, b, c = points[triangles].transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def area(p: np.ndarray) -> float:
    q = np.roll(p, -1, axis=0)
    return float(0.5 * np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]))


@pytest.mark.serial
@pytest.mark.parametrize(
    ("walls", "expected"),
    [
        (Section.circle(0.4, STEEL).walls, None),
        (Section.tube(0.3, 0.4, STEEL).walls, None),
        (Section.rectangle(0.2, 0.3, STEEL).walls, 0.06),
        (Section.hollow_rectangle(0.4, 0.6, 0.05, STEEL).walls, 0.09),
        ([SectionWall(np.array(I_SECTION, dtype=float))], 24.0),
        ([SectionWall(np.array(CHANNEL, dtype=float))], 14.0),
    ],
    ids=["circle", "tube", "rectangle", "box", "I", "channel"],
)
def test_surfaces_enclose_the_material(walls: Any, expected: float | None) -> None:
    beams = straight(walls)
    skin = BeamSkin(beams, [SkinSection(walls)])
    section = area(walls[0].points) - sum(area(wall.points) for wall in walls[1:])
    if expected is not None:
        assert section == pytest.approx(expected, rel=1e-12)
    # a face left out, doubled or inside out changes the sum by its share, at least some per cent
    assert volume(skin.points(beams) + 7.0, skin.quads) == pytest.approx(2.0 * section, rel=1e-10)
    assert len(skin.quads) == len(skin.owner)


@pytest.mark.serial
@pytest.mark.parametrize("outline", [I_SECTION, CHANNEL], ids=["I", "channel"])
def test_ends_of_open_sections_stay_inside(outline: list[list[int]]) -> None:
    p = np.array(outline, dtype=float)
    faces = cut(p)
    parts = [area(p[face]) for face in faces]
    # overlapping or outer triangles would be negative, or too much in sum
    assert min(parts) > 0.0
    assert sum(parts) == pytest.approx(area(p), rel=1e-12)
    assert len(faces) == len(p) - 2


@pytest.mark.serial
def test_sections_turn_against_the_axes_of_their_nodes() -> None:
    walls = Section.rectangle(0.2, 0.6, STEEL).walls
    quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    for turn, sides in ((np.eye(3), [0.2, 0.6]), (quarter, [0.6, 0.2])):
        beams = straight(walls, turn=turn)
        points = BeamSkin(beams, [SkinSection(walls)]).points(beams)
        assert np.ptp(points, axis=0)[1:] == pytest.approx(sides, rel=1e-12)


@pytest.mark.three_ranks
def test_stresses_are_those_of_every_cell(shared_tmp_path: Path) -> None:
    pv = pytest.importorskip("pyvista")
    d = 0.04
    circle, box = (
        Section.circle(d, STEEL),
        Section.general(np.ones(6), np.ones(6), np.eye(3)[:, :2]),
    )
    writer = BeamWriter(shared_tmp_path, COMM, [circle.walls, box.walls])
    beams = straight(circle.walls)
    section = np.array([0, 0, 1])
    writer.write(0.0, 0, BeamFields(**{**beams.__dict__, "section": section}))
    writer.close()
    file = ET.parse(shared_tmp_path / "beam_surfaces.pvd").getroot().find(".//DataSet")
    assert file is not None
    mesh = pv.read(shared_tmp_path / file.attrib["file"])
    for rank in range(COMM.size):
        mine = np.abs(mesh.points[:, 1] - 100.0 * rank) < 1.0
        for cell in range(2):
            resultant = 1.0 + np.arange(6.0) + 6.0 * cell + rank
            centre = (cell + 0.5) * 2.0 / 3.0
            here = mine & (np.abs(mesh.points[:, 0] - centre) < 0.34)
            axial = mesh.point_data["axial_stress"][here]
            # neighbours share places, not stresses: of both, the cell's own are there
            y, z = 2.0 / d * circle.walls[0].points.T
            bending = 32.0 / (np.pi * d**3) * (z * resultant[4] - y * resultant[5])
            expected = bending + 4.0 * resultant[0] / (np.pi * d**2)
            missed = np.nanmin(np.abs(axial[:, None] - expected), axis=0)
            # single precision; the next cell has other resultants by tens of per cent
            assert missed.max() < 1e-6 * np.abs(expected).max()
            shear = mesh.point_data["shear_stress"][here]
            tau = 16.0 * resultant[3] / (np.pi * d**3)
            assert np.isclose(shear, tau, rtol=1e-6).sum() >= 48
    # single precision: the sum of squares of others than these two would not fit
    mises = np.sqrt(mesh["axial_stress"] ** 2 + 3.0 * mesh["shear_stress"] ** 2)
    known = np.isfinite(mises)
    assert np.allclose(mesh["von_mises"][known], mises[known], rtol=1e-5)
    assert (~known).sum() == 6 * COMM.size  # of the section of matrices nothing is known


@pytest.mark.serial
def test_beams_that_taper_are_drawn_from_end_to_end(tmp_path: Path) -> None:
    """A cone of a function and of a table: volume, one cap at each end, stresses at both ends."""
    pv = pytest.importorskip("pyvista")
    length, force = 2.0, 1e4

    def cone(s: float) -> Section:
        return Section.circle(0.2 - 0.05 * s, STEEL)

    table = ff.SectionTable.of([0.0, length], [cone(0.0), cone(length)])
    for section in (cone, table):
        mesh = ff.LineMesh.straight({"beam": [(0, 0, 0), (length, 0, 0)]}, 4)
        model = ff.Model("cone", mesh=mesh)
        model.add(
            ff.Beam("beam", section),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
            ff.PointForce("pull", ff.Marker("beam", "end"), (force, 0.0, 0.0)),
        )
        ff.solve_static(model, ff.StaticOptions(quiet=True, output=tmp_path, load_steps=1))
        file = ET.parse(tmp_path / "beam_surfaces.pvd").getroot().findall(".//DataSet")[-1]
        found = pv.read(tmp_path / file.attrib["file"])
        quads = found.cells.reshape(-1, 5)[:, 1:]
        corners = len(Section.circle(0.2, STEEL).walls[0].points)
        polygon = 0.5 * corners * np.sin(2.0 * np.pi / corners)
        radii = 0.1 - 0.025 * np.array([0.0, length])
        expected = polygon * length / 3.0 * (radii @ radii + radii.prod())
        # steps from element to element, or caps inside, change it by per cents
        assert volume(np.asarray(found.points), quads) == pytest.approx(expected, rel=2e-3)
        radius = np.hypot(found.points[:, 1], found.points[:, 2])
        assert radius.min() == pytest.approx(radii[1], rel=1e-4)
        if section is cone:
            stress = found["axial_stress"] * np.pi * radius**2
            # single precision; that of the middle of an element is 6 per cent off at its ends
            np.testing.assert_allclose(stress, force, rtol=1e-3)
