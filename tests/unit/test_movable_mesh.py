# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes whose nodes follow those that are moved."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

SELF = MPI.COMM_SELF


def notched(degree: int = 1) -> ff.SolidMesh:
    """A block of tetrahedra, a part of whose upper side is called "notch"."""
    mesh = ff.SolidMesh.box((1.0, 0.2, 0.1), (10, 3, 1), "tetrahedron").raised(degree)
    return mesh.with_surfaces(notch=lambda x: (x[:, 1] > 0.2 - 1e-9) & (abs(x[:, 0] - 0.5) < 0.25))


def dent(x: np.ndarray) -> np.ndarray:
    return np.outer(-0.05 * np.cos(2.0 * np.pi * (x[:, 0] - 0.5)) ** 2, (0.0, 1.0, 0.0))


@pytest.mark.parametrize("degree", [1, 2])
def test_inner_nodes_follow_by_parts_of_what_is_moved(degree: int) -> None:
    """Along its direction, by less than it, linearly; held sides stay, and cells are whole."""
    mesh = notched(degree)
    block = ff.MovableMesh(mesh, moving="notch", held=("x0", "x1", "y0"))
    made = block.moved(dent)
    by = made.points - mesh.points
    np.testing.assert_array_equal(made.cells, mesh.cells)
    np.testing.assert_allclose(by[block.nodes], dent(block.places), atol=1e-15)
    assert not by[:, [0, 2]].any()
    # a discrete maximum principle: nodes that overtake their neighbours turn cells inside out
    assert by[:, 1].min() >= -0.05 - 1e-15
    assert by[:, 1].max() <= 1e-15
    for side in ("x0", "x1", "y0"):
        assert not by[mesh.named_nodes("", side)].any()
    inside = (mesh.points[:, 1] > 0.05) & (mesh.points[:, 1] < 0.15)
    assert (by[inside, 1] < -0.01).any()
    half = block.moved(0.5 * dent(block.places)).points - mesh.points
    np.testing.assert_allclose(half, 0.5 * by, atol=1e-15)
    if degree == 2:  # the middle between corners that follow, of straight edges
        edge = mesh.cells[:, [4, 2, 3]]  # opposite to the first one in the order of Basix
        free = ~np.isin(edge[:, 0], block.nodes)
        middles = made.points[edge[free, 1:]].mean(axis=1)
        np.testing.assert_allclose(made.points[edge[free, 0]], middles, atol=1e-15)


def test_lines_and_surfaces() -> None:
    """Names of all kinds; what nothing joins to what is moved stays."""
    lines = {"a": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], "b": [(0.0, 1.0, 0.0), (1.0, 1.0, 0.0)]}
    mesh = ff.LineMesh.straight(lines, elements=4)
    mesh = ff.LineMesh(mesh.points, mesh.cells, mesh.line_groups, {"root": 0, "end": 4})
    made = ff.MovableMesh(mesh, "end", held="root").moved([[0.0, 0.0, 0.4]])
    np.testing.assert_allclose(made.points[:5, 2], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-15)
    np.testing.assert_array_equal(made.points[5:], mesh.points[5:])
    grid = ff.SurfaceMesh.grid("sheet", np.linspace(0.0, 1.0, 5), np.linspace(0.0, 0.5, 3))
    sheet = ff.MovableMesh(grid, "sheet_top", held="sheet_bottom")
    bent = sheet.moved(lambda x: np.outer(0.1 * x[:, 0], (0.0, 0.0, 1.0)))
    np.testing.assert_array_equal(bent.triangles, grid.triangles)
    assert 0.02 < bent.points[grid.points[:, 1] == 0.25, 2].max() < 0.08


def test_refusals() -> None:
    mesh = notched()
    for call, message in (
        (lambda: ff.MovableMesh(mesh, "hole"), "MovableMesh: no surface 'hole'; there are"),
        (lambda: ff.MovableMesh(mesh, ()), "MovableMesh: moving must name something"),
    ):
        with pytest.raises(ValueError, match=message) as told:
            call()
        assert_on_page(str(told.value))
    with pytest.raises(TypeError, match="MovableMesh: mesh must be"):
        ff.MovableMesh(mesh.points, "notch")
    with pytest.raises(ValueError, match="displacements must hold 10 x 3"):
        ff.MovableMesh(mesh, "notch").moved(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="is inside out"):
        ff.MovableMesh(mesh, "notch", held="y0").moved(lambda x: np.outer(x[:, 0], (0, -1, 0)))


@pytest.mark.slow
def test_size_of_a_hole_of_gmsh_has_a_derivative() -> None:
    """The mesh generator's own inner nodes jump with the size, and gradients refuse that.

    Compared with differences of fourth order of equilibria.
    """
    gmsh = ff.build_body_mesh("plate_with_hole", SELF, size=0.25, hole_size=0.08)
    mesh = ff.SolidMesh.from_dolfinx(gmsh.mesh, gmsh.cell_tags, gmsh.facet_tags, gmsh.groups)
    plate = ff.MovableMesh(mesh, "hole", held=("left", "right", "top", "bottom"))
    law = ff.laws.SaintVenantKirchhoff(2.1e11, 0.3)

    def build(radius: float, height: float) -> ff.Model:
        """With an elliptic hole of two half axes, 0.1 m at the start."""
        made = plate.moved(lambda x: x * (radius / 0.1 - 1.0, height / 0.1 - 1.0, 0.0))
        model = ff.Model("plate")
        model.add(
            ff.Solid("plate", law, made, density=7850.0, plane="stress", thickness=0.01,
                     fixed={"left": "xy"}),
            ff.SurfaceTraction("pull", "plate", "right", (1e7, 0.0, 0.0)),
            ff.SolidProbe("end", "plate", "right", measures="displacement"),
        )  # fmt: skip
        return model

    start = {"radius": 0.1, "height": 0.1}
    options = ff.StaticOptions(load_steps=1, quiet=True)
    found = ff.gradient(build, "final:end_ux", start, options, comm=SELF)
    exact = ff.StaticOptions(load_steps=1, quiet=True, tolerance=1e-12)
    for name in start:
        ends = [
            ff.solve_static(build(**{**start, name: 0.1 + k * 1e-3}), exact, comm=SELF)
            for k in (-2, -1, 1, 2)
        ]
        a, b, c, d = (one.history["end_ux"][-1] for one in ends)
        expected = (a - 8.0 * b + 8.0 * c - d) / 12e-3
        # nodes inside that do not follow change the stiffness by some per cent of this
        assert found.gradient["final:end_ux"][name] == pytest.approx(expected, rel=1e-6)
