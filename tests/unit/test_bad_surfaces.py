# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in surface meshes are refused in one line that names object and value."""

import re
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff

pytestmark = pytest.mark.serial

NAN = float("nan")
POINTS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
TRIANGLES = [[0, 1, 2], [0, 2, 3]]
BOTH = {"plate": [0, 1]}
FAN = [[0, 0, 0], [0, 0, 2.5], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]]


def mesh(points=POINTS, triangles=TRIANGLES, bodies=BOTH, **more):
    return ff.SurfaceMesh(points, triangles, bodies, **more)


def line(pairs):
    return mesh(lines={"hinge": pairs})


def grid(u=(0, 1), v=(0, 1), surface=None, **more):
    return ff.SurfaceMesh.grid("plate", u, v, surface, **more)


def rectangle(size=(1, 1), cells=(2, 2), **more):
    return ff.SurfaceMesh.rectangle("plate", size, cells, **more)


def moebius():
    """A band of ten triangles whose ends meet the wrong way round."""
    angle = np.arange(5) * 2.0 * np.pi / 5.0
    centre = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    across = 0.2 * np.column_stack([centre[:, :2] * np.cos(angle / 2)[:, None], np.sin(angle / 2)])
    triangles = [[i, i + 1, i + 6] for i in range(4)] + [[i, i + 6, i + 5] for i in range(4)]
    triangles += [[4, 5, 0], [4, 0, 9]]
    return mesh(np.concatenate([centre - across, centre + across]), triangles, {"band": range(10)})


def inner_pole():
    """A hemisphere whose last row shrinks to a point."""
    return grid(
        np.linspace(0, 1, 4), np.linspace(0, 1, 3),
        lambda p: np.column_stack([(1 - p[:, 1]) * p[:, 0], p[:, 1], 0 * p[:, 0]]),
    )  # fmt: skip


ARRAYS = [
    (lambda: mesh([[0, 0], [1, 0], [0, 1]]), "SurfaceMesh: points must hold n x 3 numbers"),
    (lambda: mesh([[0, 0, NAN], *POINTS[1:]]), "SurfaceMesh: points must be finite, got .*nan"),
    (lambda: mesh("abc"), "SurfaceMesh: points must hold n x 3 numbers, got 'abc'"),
    (lambda: mesh(triangles=[[0, 1, 2, 3]]), "SurfaceMesh: triangles must hold n x 3 indices"),
    (lambda: mesh(triangles=[[0, 1, 2], [0, 1]]), "SurfaceMesh: triangles must be indices"),
    (lambda: mesh(triangles=[[0, 1, 4]]), "SurfaceMesh: triangles must lie in 0 to 3, got 4"),
    (lambda: mesh(triangles=[[0, 1, -2]]), "SurfaceMesh: triangles must lie in 0 to 3, got -2"),
    (lambda: mesh(triangles=[[0.0, 1.0, 2.0]]), "SurfaceMesh: triangles must be whole numbers"),
    (lambda: mesh(triangles=[], bodies={}), "triangles must hold at least one triangle, got none"),
    (
        lambda: mesh(triangles=[[0, 1, 2], [0, 3, 3]]),
        r"triangle 1 between nodes 0, 3, 3 has no area: 0 m\^2 with edges up to 1 m",
    ),
    (
        lambda: mesh([*POINTS[:3], [3, 3, 1e-12]]),
        r"SurfaceMesh: triangle 1 between nodes 0, 2, 3 has no area: 7.07e-13 m\^2 with edges up",
    ),
    (
        lambda: mesh(triangles=[[0, 1, 2], [0, 2, 3], [2, 1, 0]], bodies={"plate": [0, 1, 2]}),
        "SurfaceMesh: triangles 0 and 2 have the same nodes 0, 1, 2",
    ),
    (
        lambda: mesh([*POINTS, [5, 5, 5]]),
        "SurfaceMesh: node 4 belongs to no triangle",
    ),
]

BODIES = [
    (lambda: mesh(bodies={"plate": [0]}), "SurfaceMesh: triangle 1 belongs to no body"),
    (
        lambda: mesh(bodies={"plate": [0, 1], "rim": [1]}),
        'SurfaceMesh: triangle 1 belongs to body "plate" and to body "rim"',
    ),
    (lambda: mesh(bodies={"plate": []}), 'body "plate" must hold at least one triangle, got none'),
    (lambda: mesh(bodies={"plate": [0, 2]}), 'SurfaceMesh: body "plate" must lie in 0 to 1, got 2'),
    (lambda: mesh(bodies={"": [0, 1]}), "SurfaceMesh: name of a body must be a non-empty"),
    (lambda: mesh(bodies={3: [0, 1]}), "SurfaceMesh: name of a body must be a string, got 3"),
    (
        lambda: mesh(FAN, [[0, 1, 2], [1, 0, 3], [0, 1, 4]], {"fan": [0, 1, 2]}),
        r'SurfaceMesh: body "fan" branches at the edge between nodes 0 and 1, from \(0, 0, 0\) and '
        r"\(0, 0, 2.5\): triangles 0, 1, 2 meet there, at most two may",
    ),
    (moebius, 'body "band" has one side only: the triangles joined to triangle 0 cannot be turned'),
]

NAMES = [
    (lambda: line([]), 'SurfaceMesh: line "hinge" must hold at least one node pair, got none'),
    (lambda: line([[0, 1, 2]]), 'SurfaceMesh: line "hinge" must hold n x 2 indices'),
    (lambda: line([[0, 9]]), 'SurfaceMesh: line "hinge" must lie in 0 to 3, got 9'),
    (lambda: line([[0, 1], [1, 3]]), 'line "hinge": nodes 1 and 3 are no edge of a triangle'),
    (
        lambda: line([[0, 2], [2, 0]]),
        'line "hinge": the edge between nodes 0 and 2 occurs twice',
    ),
    (lambda: line([[0, 1], [2, 3]]).line_nodes("hinge"), 'line "hinge" branches or falls apart'),
    (lambda: line([[0, 1], [0, 2], [0, 3]]).line_nodes("hinge"), '"hinge" branches or falls apart'),
    (
        lambda: line([[0, 1]]).line_nodes("lid"),
        "SurfaceMesh: line \"lid\" is not in the mesh, which has 'hinge'",
    ),
    (lambda: mesh().line_nodes("lid"), "line \"lid\" is not in the mesh, which has 'none'"),
    (lambda: mesh().body_nodes("lid"), "body \"lid\" is not in the mesh, which has 'plate'"),
    (lambda: mesh().boundary_lines("lid"), 'SurfaceMesh: body "lid" is not in the mesh'),
    (lambda: mesh(nodes={"tip": 4}), 'SurfaceMesh: node "tip" must lie in 0 to 3, got 4'),
    (lambda: mesh(nodes={"tip": 0.5}), 'SurfaceMesh: node "tip" must be whole numbers'),
    (lambda: mesh(nodes={"tip": [0, 1]}), 'SurfaceMesh: node "tip" must hold n x 1 indices'),
    (lambda: mesh().closest_node([0, 0]), "SurfaceMesh.closest_node: position must hold 3 numbers"),
    (lambda: mesh().closest_node([0, 0, 0], "lid"), 'SurfaceMesh: body "lid" is not in the mesh'),
]

GENERATORS = [
    (lambda: grid([0]), r'SurfaceMesh.grid "plate": u must hold at least 2 ascending numbers'),
    (lambda: grid(v=[0, 1, 1]), "v must hold at least 2 ascending numbers, got .0, 1, 1."),
    (lambda: grid([0, 1], closed=True), "u must hold at least 3 ascending numbers"),
    (lambda: grid([0, NAN]), 'SurfaceMesh.grid "plate": u must be finite'),
    (
        lambda: grid(diagonal="both"),
        "diagonal must be one of right, left, right_left, left_right, got .both.",
    ),
    (lambda: grid(surface=3), 'SurfaceMesh.grid "plate": surface must be a function, got 3'),
    (
        lambda: grid(surface=lambda p: p),
        r'SurfaceMesh.grid "plate": surface\(u, v\) must hold 4 x 3 numbers',
    ),
    (
        lambda: grid(surface=lambda p: np.full((4, 3), NAN)),
        r'SurfaceMesh.grid "plate": surface\(u, v\) must be finite',
    ),
    (inner_pole, "SurfaceMesh: triangle 7 between nodes 4, 9, 8 has no area: 0 m"),
    (lambda: ff.SurfaceMesh.grid("", [0, 1], [0, 1]), "SurfaceMesh.grid: name must be a non-empty"),
    (lambda: rectangle(size=(1, 0)), r"size must be positive, got \(1, 0\)"),
    (lambda: rectangle(size=(1, 2, 3)), 'SurfaceMesh.rectangle "plate": size must hold 2 numbers'),
    (lambda: rectangle(cells=(0, 3)), r"cells must be two positive whole numbers, got \(0, 3\)"),
    (lambda: rectangle(cells=(3,)), r"cells must be two positive whole numbers, got \(3,\)"),
    (lambda: rectangle(cells=(2, 2.5)), r"cells must be whole numbers, got \(2, 2.5\)"),
    (lambda: rectangle(diagonal=1), "diagonal must be one of right, left, .*, got 1"),
    (
        lambda: grid(u=[0, 1, 2], closed=True, diagonal="left_right"),
        'diagonal "left_right" does not close around 3 columns, an odd number',
    ),
    (lambda: ff.SurfaceMesh.join([]), "SurfaceMesh.join: meshes must hold at least one mesh"),
    (lambda: ff.SurfaceMesh.join([3]), "SurfaceMesh.join: each mesh must be a SurfaceMesh, got 3"),
    (
        lambda: ff.SurfaceMesh.join([mesh(), mesh()]),
        'SurfaceMesh.join: bodies: the name "plate" is used twice',
    ),
    (
        lambda: ff.SurfaceMesh.join([mesh(nodes={"a": 0}), mesh(bodies={"b": BOTH["plate"]},
                                                                 nodes={"a": 0})]),
        'SurfaceMesh.join: nodes: the name "a" is used twice',
    ),
]  # fmt: skip


def _expect(message, function) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        function()
    text = str(caught.value)
    assert re.search(message, text), text
    assert "\n" not in text


@pytest.mark.parametrize(("function", "message"), ARRAYS + BODIES + NAMES + GENERATORS)
def test_meshes_are_refused(function, message) -> None:
    _expect(message, function)


def gmsh_model(*, dimension=2, group=True, order=1, recombine=False):
    """Take the surfaces of a gmsh model with something missing or too much."""

    def read(_):
        import gmsh

        gmsh.initialize(interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            square = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
            gmsh.model.occ.synchronize()
            if group:
                gmsh.model.addPhysicalGroup(2, [square], name="sheet")
            if recombine:
                gmsh.model.mesh.setRecombine(2, square)
            gmsh.model.mesh.generate(dimension)
            gmsh.model.mesh.setOrder(order)
            ff.SurfaceMesh.from_gmsh_model()
        finally:
            gmsh.finalize()

    return read


FILES = [
    (gmsh_model(group=False), "gmsh model: the mesh has no named physical group of surfaces"),
    (gmsh_model(group=False, dimension=1), "gmsh model: the mesh has no triangles of first order"),
    (gmsh_model(dimension=1), 'gmsh model: group "sheet" has no triangles'),
    (gmsh_model(order=2), '"sheet" has elements "Triangle 6", only triangles of first order'),
    (gmsh_model(recombine=True), '"sheet" has elements "Quadrilateral 4", only'),
    (lambda folder: ff.read_surface_mesh(folder / "none.msh"), 'none.msh" does not exist'),
    (lambda _: ff.read_surface_mesh(Path(__file__)), 'mesh file ".*py" must end in .msh, .in'),
]


@pytest.mark.parametrize(("read", "message"), FILES)
def test_files_are_refused(read, message, tmp_path) -> None:
    _expect(message, lambda: read(tmp_path))
