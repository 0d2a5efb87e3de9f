# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in the files of other programs, on any number of ranks."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh

import flexfem as ff
from tests.unit import mesh_texts

COMM = MPI.COMM_WORLD


def written(folder: Path, name: str, text: str) -> Path:
    """A file that the first rank writes; reading begins on the first rank."""
    if COMM.rank == 0:
        (folder / name).write_text(text)
    return folder / name


def measures(body: ff.BodyMesh) -> dict[str, float]:
    """Volumes and areas of the groups (collective)."""
    found = {}
    for name, (dimension, tag) in sorted(body.groups.items()):
        whole = dimension == body.mesh.topology.dim
        tags = body.cell_tags if whole else body.facet_tags
        part = ufl.Measure("dx" if whole else "ds", body.mesh, subdomain_data=tags)(tag)
        value = fem.assemble_scalar(fem.form(fem.Constant(body.mesh, 1.0) * part))
        found[name] = COMM.allreduce(value)
    return found


def tagged(body: ff.BodyMesh, dimension: int, tags: mesh.MeshTags) -> list[tuple[float, ...]]:
    """Midpoint and tag of all tagged entities of all ranks, each once."""
    middles = mesh.compute_midpoints(body.mesh, dimension, tags.indices)
    rows = np.column_stack([middles.round(9), tags.values]).tolist()
    return sorted({tuple(row) for part in COMM.allgather(rows) for row in part})


@pytest.mark.three_ranks
def test_hexahedra_and_their_faces(shared_tmp_path) -> None:
    path = written(shared_tmp_path, "block.inp", mesh_texts.ABAQUS_BLOCK)
    body = ff.read_body_mesh(path, scale=0.1)
    assert body.mesh.topology.index_map(3).size_global == 2
    sizes = {"LOWER": 2e-3, "UPPER": 6e-3, "BOTTOM": 0.02, "TOP": 0.02, "SIDE": 0.04}
    assert measures(body) == pytest.approx(sizes, rel=1e-12)
    numbers = {name: tag for name, (_, tag) in body.groups.items()}
    assert tagged(body, 3, body.cell_tags) == [
        (0.05, 0.1, 0.05, numbers["LOWER"]),
        (0.05, 0.1, 0.25, numbers["UPPER"]),
    ]
    assert tagged(body, 2, body.facet_tags) == [
        (0.05, 0.0, 0.05, numbers["SIDE"]),
        (0.05, 0.0, 0.25, numbers["SIDE"]),
        (0.05, 0.1, 0.0, numbers["BOTTOM"]),
        (0.05, 0.1, 0.4, numbers["TOP"]),
    ]
    upper = ff.read_body_mesh(path, bodies=["UPPER"], facets=["TOP"])
    assert measures(upper) == pytest.approx({"UPPER": 6.0, "TOP": 2.0}, rel=1e-12)


@pytest.mark.three_ranks
def test_mixed_cells_become_tetrahedra_that_fit(shared_tmp_path) -> None:
    path = written(shared_tmp_path, "mixed.inp", mesh_texts.ABAQUS_MIXED)
    body = ff.read_body_mesh(path)
    assert body.mesh.topology.cell_name() == "tetrahedron"
    # hexahedron 6 tetrahedra, wedges 3, pyramid 2, tetrahedron 1
    assert body.mesh.topology.index_map(3).size_global == 15
    # pyramid 1/3, tetrahedron: base 1/2 |(1, 0, 0) x (0.5, 0.5, 1)| with the corner at y = -1
    last = abs(np.linalg.det([[1, 0, 0], [0.5, 0.5, 1], [0.5, -1, 0.5]])) / 6.0
    expected = {"ALL": 2.0 + 1.0 / 3.0 + last, "END": 1.0, "FRONT": 2.0}
    assert measures(body) == pytest.approx(expected, rel=1e-12)
    # a face cut differently on its two sides would be at the boundary twice
    ones = fem.Constant(body.mesh, 1.0)
    area = COMM.allreduce(fem.assemble_scalar(fem.form(ones * ufl.ds(body.mesh))))
    a, b, c, d = np.array([[0, 0, 1], [1, 0, 1], [0.5, 0.5, 2], [0.5, -1, 1.5]])
    faces = [(a, b, d), (a, c, d), (b, c, d)]  # of the tetrahedron that are free
    ear = sum(0.5 * np.linalg.norm(np.cross(q - p, r - p)) for p, q, r in faces)
    # two ends, floor, two sides, the roof of the wedges, three sides of the pyramid
    box = 2.0 + 2.0 + 4.0 + 1.0 + 3.0 * 0.5 * np.hypot(1.0, 0.5)
    assert area == pytest.approx(box + ear, rel=1e-12)


@pytest.mark.serial
def test_surfaces_of_a_file_without_solids(shared_tmp_path) -> None:
    path = written(shared_tmp_path, "frame.bdf", mesh_texts.NASTRAN_FRAME)
    body = ff.read_body_mesh(path, scale=1e-3, bodies=["property_8"], facets=["set_9"])
    assert body.mesh.topology.cell_name() == "quadrilateral"
    assert measures(body) == pytest.approx({"property_8": 1.0, "set_9": 1.0}, rel=1e-12)
    both = ff.read_body_mesh(path, scale=1e-3, facets=["property_7"])
    assert both.mesh.topology.cell_name() == "triangle"
    assert measures(both)["property_9"] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["tetrahedra", "hexahedra", "serendipity"])
def test_curved_cells_stay_curved(kind, tmp_path, gmsh_model) -> None:
    """A quarter of a thick ring: its volume by gmsh's own quadrature."""
    import gmsh

    occ = gmsh_model.occ
    face = occ.addRectangle(1.0, 0.0, 0.0, 1.0, 0.5)
    swept = occ.revolve(
        [(2, face)], 0, 0, 0, 0, 1, 0, np.pi / 2, [2] if kind != "tetrahedra" else [],
        recombine=kind != "tetrahedra",
    )  # fmt: skip
    occ.synchronize()
    if kind != "tetrahedra":
        for _, tag in gmsh_model.getEntities(1):
            gmsh_model.mesh.setTransfiniteCurve(tag, 3)
        gmsh_model.mesh.setTransfiniteSurface(face)
        gmsh_model.mesh.setRecombine(2, face)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", float(kind == "serendipity"))
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
    ((_, volume),) = [entity for entity in swept if entity[0] == 3]
    gmsh_model.addPhysicalGroup(3, [volume], name="ring")
    gmsh_model.addPhysicalGroup(2, [face], name="start")
    gmsh_model.mesh.generate(3)
    gmsh_model.mesh.setOrder(2)
    gmsh.write(str(tmp_path / "ring.msh"))
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0.0)
    ((number,), _, _) = gmsh_model.mesh.getElements(3)
    points, weights = gmsh_model.mesh.getIntegrationPoints(int(number), "Gauss8")
    _, determinants, _ = gmsh_model.mesh.getJacobians(int(number), points)
    reference = float((determinants.reshape(-1, len(weights)) @ weights).sum())
    body = ff.read_body_mesh(tmp_path / "ring.msh")
    assert body.mesh.geometry.cmaps[0].degree == 2
    found = measures(body)
    # straight cells have 1 to 10 per cent less, a wrong order of nodes anything
    assert found["ring"] == pytest.approx(reference, rel=1e-10)
    assert found["start"] == pytest.approx(0.5, rel=1e-12)
    exact = 0.25 * np.pi * 3.0 * 0.5
    assert found["ring"] == pytest.approx(exact, rel=5e-3)


CORNERS = np.array([
    [-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1],
    [-1, 1, 1],
])  # fmt: skip
BOTTOM, TOP, UPRIGHT = (
    [(0, 1), (1, 2), (2, 3), (3, 0)],
    [(4, 5), (5, 6), (6, 7), (7, 4)],
    [(0, 4), (1, 5), (2, 6), (3, 7)],
)


def bent(places: np.ndarray) -> np.ndarray:
    """A cube (n, 3) bent so that the middle of each edge is off its chord in its own way."""
    x, y, z = places.T
    return np.column_stack([
        x + 0.1 * z * z * (2 + y), y + 0.07 * x * x - 0.05 * z * z, z + 0.06 * y * y * (1 + x)
    ])  # fmt: skip


def serendipity_volume(places: np.ndarray) -> float:
    """Volume of the cell of 20 nodes at bent places, by its textbook shape functions."""
    nodes = bent(places)
    ticks, weights = np.polynomial.legendre.leggauss(6)
    at = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).ravel()

    def shape(point: np.ndarray) -> np.ndarray:
        """Of all nodes: corners 1/8 ... (a + b + c - 2), midpoints of edges 1/4 (1 - a^2) ..."""
        terms = 1.0 + places * point
        corner = 0.125 * terms.prod(axis=1) * ((places * point).sum(axis=1) - 2.0)
        edge = 0.25 * np.where(places == 0, 1.0 - point**2, terms).prod(axis=1)
        return np.where((places == 0).any(axis=1), edge, corner)

    step = 1e-30j  # derivatives to the last digit
    slopes = [
        np.stack([(shape(point + step * axis) @ nodes).imag / 1e-30 for axis in np.eye(3)])
        for point in at
    ]
    return float(weight @ np.linalg.det(np.array(slopes)))


@pytest.mark.serial
def test_nodes_of_hexahedra_in_the_orders_of_the_manuals(tmp_path) -> None:
    """Abaqus: edges below, above, upright. Nastran: below, upright, above."""
    for name, edges in (
        ("cell.inp", BOTTOM + TOP + UPRIGHT),
        ("cell.bdf", BOTTOM + UPRIGHT + TOP),
    ):
        middles = [CORNERS[list(edge)].mean(axis=0) for edge in edges]
        places = np.concatenate([CORNERS, middles])
        rows = [", ".join(f"{x!r}" for x in point) for point in bent(places).tolist()]
        if name.endswith("inp"):
            lines = ["*NODE", *(f"{i}, {row}" for i, row in enumerate(rows, 1))]
            lines += ["*ELEMENT, TYPE=C3D20R, ELSET=C", f"1, {', '.join(map(str, range(1, 16)))},"]
            lines += [", ".join(map(str, range(16, 21)))]
        else:
            lines = [f"GRID,{i},,{row.replace(' ', '')}" for i, row in enumerate(rows, 1)]
            lines += ["CHEXA,1,1,1,2,3,4,5,6,+", "+,7,8,9,10,11,12,13,14,+", "+,15,16,17,18,19,20"]
        (tmp_path / name).write_text("\n".join(lines) + "\n")
        body = ff.read_body_mesh(tmp_path / name)
        (volume,) = measures(body).values()
        # straight edges have 0.4 less of 8, edges in a wrong order anything
        assert volume == pytest.approx(serendipity_volume(places), rel=1e-10)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (mesh_texts.ABAQUS_FRAME, {}, "no solid elements; it has 3 lines, 1 lines of second"),
        (mesh_texts.ABAQUS_BLOCK, {"bodies": ["MID"]}, 'no element set "MID"; sets with solid'),
        (mesh_texts.ABAQUS_BLOCK, {"facets": ["MID"]}, 'facets "MID": there is no such set of f'),
        (mesh_texts.ABAQUS_BLOCK, {"facets": ["LOWER"]}, 'facets "LOWER": a body has this name'),
        (mesh_texts.ABAQUS_BLOCK, {"facets": "TOP"}, "facets must be a list of names, got 'TOP'"),
        (
            mesh_texts.ABAQUS_BLOCK,
            {"bodies": ["LOWER"], "facets": ["TOP"]},
            'facets "TOP": 1 of its 1 faces are none of the body; sets with facets are BOTTOM',
        ),
        (
            mesh_texts.ABAQUS_BLOCK + "*NSET, NSET=EDGE\n1, 2\n",
            {"facets": ["EDGE"]},
            'facets "EDGE": no face at the boundary of the body has all of its nodes in this set',
        ),
        (
            mesh_texts.ABAQUS_BLOCK + "*NSET, NSET=OUTER\n1, 2, 3, 4, 5, 6\n",
            {},
            r'"SIDE" and "BOTTOM|sets "\w+" and "OUTER" share faces: choose .* facets=\[...\]',
        ),
        (
            mesh_texts.ABAQUS_BLOCK + "*SURFACE, NAME=FREE\nLOWER\n",
            {"facets": ["FREE"]},
            r'facets "FREE": its surface names no face \(S1\) or edge',
        ),
        (mesh_texts.ABAQUS_BLOCK, {"scale": -1}, "scale must be positive, got -1"),
    ],
)
def test_bad_bodies_are_refused_on_all_ranks(text, options, message, shared_tmp_path) -> None:
    path = written(shared_tmp_path, "bad.inp", text)
    with pytest.raises((ValueError, TypeError), match=message) as caught:
        ff.read_body_mesh(path, **options)
    assert "\n" not in str(caught.value)
