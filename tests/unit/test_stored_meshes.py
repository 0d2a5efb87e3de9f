# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stored meshes of solids: the same figures as of whole meshes, and refusals."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.inspection.check import findings
from flexfem.inspection.description import description_of
from flexfem.inspection.inspection import Inspection
from flexfem.inspection.text import findings_text
from flexfem.mesh.array_folder import ArrayFolder, write_arrays
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

SIZES = np.array((0.4, 0.05, 0.06))
SOFT, STIFF = (ff.laws.NeoHookean.from_young(modulus, 0.3) for modulus in (1e6, 3e6))
PLACES = np.random.default_rng(1).random((15, 3)) * SIZES


def whole_mesh(cell: str, curved: int) -> ff.SolidMesh:
    """A box, bent if it is curved, with two regions and a set of one node."""
    mesh = ff.SolidMesh.box(SIZES, (8, 2, 2), cell).raised(curved)
    x = mesh.points
    if curved > 1:
        mesh = mesh.moved(x + 0.002 * np.sin(20.0 * x[:, [1, 2, 0]]))
    left = x[mesh.corners].mean(axis=1)[:, 0] < 0.2
    return ff.SolidMesh(
        mesh.points, mesh.cells, cell, degree=curved, surfaces=mesh.surfaces,
        regions={"left": np.flatnonzero(left), "right": np.flatnonzero(~left),
                 "all": np.arange(len(left))},
        nodes={"corner": [int(np.argmax(x.sum(axis=1)))]},
    )  # fmt: skip


def solid(mesh: Any, degree: int = 1, **options: Any) -> ff.Solid:
    """A body of two materials, clamped."""
    given = {"density": {"left": 1100.0, "right": 900.0}, "fixed": {"x0": "xyz", "y1": "y"}}
    laws = {"left": SOFT, "right": STIFF}
    return ff.Solid("j", laws, mesh, degree=degree, **given | options)


def moments(body: ff.Solid) -> list[np.ndarray]:
    """Mass, and its first and second moments."""
    points, masses = body.masses
    return [masses.sum(), masses @ points, points.T @ (masses[:, np.newaxis] * points)]


@pytest.mark.parametrize(
    ("cell", "degree", "curved", "pieces"),
    [("hexahedron", 1, 1, 10_000), ("hexahedron", 2, 1, 7), ("tetrahedron", 2, 2, 11),
     ("tetrahedron", 3, 1, 13), ("hexahedron", 2, 2, 5)],
)  # fmt: skip
def test_figures_are_those_of_the_whole_mesh(
    tmp_path: Path, cell: str, degree: int, curved: int, pieces: int
) -> None:
    """A piece that is not read, or read from a wrong row, moves what is compared by a cell."""
    mesh = whole_mesh(cell, curved)
    stored = ff.store_solid_mesh(mesh, tmp_path / "mesh", degree=degree, pieces=pieces)
    assert stored.pieces <= pieces
    whole, read = solid(mesh, degree), solid(stored, degree)
    for one, other in zip(moments(whole), moments(read), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-15)
    assert (read.elements, read.holds) == (whole.elements, whole.holds)
    a, b = whole.figure, read.figure
    every = np.arange(whole.elements)
    assert (a.count, a.straight) == (b.count, b.straight)
    for region in ("left", "right", "all"):
        middles = [
            f.cell_places(every[f.in_region(region, every)]).mean(axis=1).round(9) for f in (a, b)
        ]
        first, second = (np.unique(one, axis=0) for one in middles)
        np.testing.assert_array_equal(first, second)
    for surface in ("x0", "y1", "boundary"):
        first, second = (
            np.unique(np.column_stack([f.places(nodes), 1e3 * weights]).round(10), axis=0)
            for f in (a, b) for nodes, weights in [f.area_weights("j", surface)]
        )  # fmt: skip
        np.testing.assert_array_equal(first, second)
    assert len(a.boundary_of(every[3:9])) > 0
    assert len(np.unique(b.boundary_of(every))) == len(np.unique(a.boundary_of(every)))
    for place in PLACES:
        points, gaps = [], []
        for body in (whole, read):
            marker = body.point_marker(place)
            points.append(np.array(marker.weights) @ body.figure.places(np.array(marker.nodes)))
            nearest = body.figure.places(np.array(body.node(ff.Marker("j", tuple(place)))))
            gaps.append(np.linalg.norm(nearest - place))
        np.testing.assert_allclose(points[1], points[0], atol=1e-12)
        np.testing.assert_allclose(gaps[1], gaps[0], atol=1e-15)


def test_info_is_that_of_the_whole_mesh(tmp_path: Path) -> None:
    """Masses, unknowns, entries of the matrix and findings do not need the whole mesh."""
    mesh = whole_mesh("hexahedron", 1)
    texts = []
    for one in (mesh, ff.store_solid_mesh(mesh, tmp_path / "mesh", degree=1)):
        model = ff.Model("m")
        model.add(solid(one), ff.Gravity((0.0, 0.0, -9.81)))
        inspection = Inspection(model)
        text = str(description_of(inspection)) + findings_text(findings(inspection))
        texts.append([line for line in text.splitlines() if "are left" not in line])  # of memory
    assert texts[0] == texts[1]
    assert len(texts[0]) > 10


MESH = whole_mesh("hexahedron", 1)
PLANE = ff.SolidMesh.box((1, 1), (1, 1), "quadrilateral")

#: What is refused, of a body on a stored mesh.
REFUSED: dict[str, tuple[Callable[[Any], object], str]] = {
    "degree": (lambda mesh: solid(mesh, 2), "stored for cells of degree 1, got degree 2"),
    "contact": (lambda mesh: solid(mesh, touching="x1"), r"contact \(touching\) needs the whole"),
    "velocities": (
        lambda mesh: solid(mesh, start_velocities=lambda x: x), "start_velocities needs the whole"
    ),
    "numbers": (
        lambda mesh: ff.Solid("j", ff.laws.NeoHookean([1e6] * 32, [2e6] * 32), mesh, density=1.0,
                              degree=1),
        'the parameter "mu" of each cell needs the whole mesh',
    ),
    "regions": (
        lambda mesh: solid(mesh, density={"left": 1.0, "all": 2.0}), "a cell has more than one reg"
    ),
    "few regions": (lambda mesh: solid(mesh, density={"left": 1.0}), "a cell has no region of"),
    "moved": (
        lambda mesh: ff.Solid("j", SOFT, mesh, density=1.0, degree=1).moved(
            ff.Pose((1, 0, 0), np.eye(3))),
        '"moved" needs the whole mesh',
    ),
    "nodes": (lambda mesh: np.asarray(solid(mesh).points), "this needs the places of all nodes"),
    "surface": (lambda mesh: solid(mesh).surface_marker("top"), "no surface or set of nodes 'top'"),
    "outside": (lambda mesh: solid(mesh).point_marker((3, 0, 0)), r"\[3.0, 0.0, 0.0\] is outside"),
    "again": (
        lambda mesh: ff.store_solid_mesh(MESH, mesh._files.path), "the folder .* is not empty"
    ),
    "wedges": (lambda mesh: ff.store_solid_mesh(PLANE, "x"), "cells must be tetrahedron or hexah"),
    "curved": (
        lambda mesh: ff.store_solid_mesh(MESH.raised(2), "x", degree=3), "degree must be 1 to 3"
    ),
    "missing": (lambda mesh: ff.StoredSolidMesh("nowhere"), "cannot be read: No such file"),
}  # fmt: skip


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> ff.StoredSolidMesh:
    """The mesh of the refusals."""
    return ff.store_solid_mesh(MESH, tmp_path_factory.mktemp("stored") / "mesh", degree=1)


@pytest.mark.parametrize("name", REFUSED)
def test_what_needs_the_whole_mesh_is_refused(stored: ff.StoredSolidMesh, name: str) -> None:
    """In one line that is on the page of errors."""
    make, message = REFUSED[name]
    with pytest.raises(ValueError, match=message) as raised:
        make(stored)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


def _another(folder: Path) -> None:
    facts = json.loads((folder / "facts.json").read_text())
    (folder / "facts.json").write_text(json.dumps(facts | {"format": "other"}))


def _cut(folder: Path) -> None:
    with (folder / "cells.npy").open("r+b") as file:
        file.truncate(1000)


def _unended(folder: Path) -> None:
    """A header that Python's tokenizer does not read to its end."""
    file = folder / "points.npy"
    file.write_bytes(file.read_bytes().replace(b"}", b"'", 1))


def _nested(folder: Path) -> None:
    (folder / "facts.json").write_text("[" * 1_000_000)


def _forged(folder: Path) -> None:
    """Numbers that were never those of a mesh, with a digest."""
    facts = json.loads((folder / "facts.json").read_text())
    arrays = {name: np.load(folder / f"{name}.npy") for name in facts.pop("blocks")}
    del facts["digest"]
    shutil.rmtree(folder)
    write_arrays("forged", folder, facts, arrays | {"cells": arrays["cells"] + 70})


def _moments(folder: Path) -> None:
    """One digit of the inertia."""
    facts = json.loads((folder / "facts.json").read_text())
    facts["moments"][0][4] *= 1.001
    (folder / "facts.json").write_text(json.dumps(facts))


def _bit(folder: Path) -> None:
    """The lowest bit of the last coordinate."""
    content = bytearray((folder / "points.npy").read_bytes())
    content[-8] ^= 1
    (folder / "points.npy").write_bytes(content)


def _other_kind(folder: Path) -> None:
    np.save(folder / "points.npy", np.zeros((81, 3), dtype=np.float32))


@pytest.mark.parametrize(
    ("damage", "message"),
    [(_another, "its format is 'other'"), (_cut, "cells.npy is damaged"),
     (_unended, "points.npy is damaged"),
     (_nested, "facts.json is damaged"),
     (_moments, "facts.json is damaged: it does not have the digest"),
     (_bit, "points.npy is damaged: its numbers are not those that were written, from byte 0 on"),
     (_forged, "cells.npy is damaged: it has the number"), (_other_kind, "points.npy is damaged")],
)  # fmt: skip
def test_damaged_folders_are_refused(
    tmp_path: Path, damage: Callable[[Path], None], message: str
) -> None:
    """Before any number of theirs is used."""
    folder = tmp_path / "mesh"
    ff.store_solid_mesh(MESH, folder, degree=1)
    damage(folder)
    with pytest.raises(ValueError, match=message) as raised:
        ff.StoredSolidMesh(folder).figure(1).cell_places(np.arange(32))
    assert_on_page(str(raised.value))


def test_arrays_have_no_more_rows_than_their_files(tmp_path: Path) -> None:
    """A header of more rows than any computer has memory for."""
    folder = tmp_path / "mesh"
    ff.store_solid_mesh(MESH, folder, degree=1)
    file = folder / "firsts.npy"
    file.write_bytes(file.read_bytes().replace(b"(", b"(9999999999999", 1))
    with pytest.raises(ValueError, match=r"firsts\.npy is damaged: it does not have the") as raised:
        ArrayFolder("mesh", folder).rows("firsts", (-1,), np.int64)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("row", [0, 4095, 4096, 5000])
def test_a_changed_bit_is_found_in_the_rows_that_are_read(tmp_path: Path, row: int) -> None:
    """Blocks of 4096 rows of two numbers have a checksum each, the last one has fewer rows."""
    values = np.random.default_rng(1).integers(0, 99, (5001, 2))
    write_arrays("mesh", tmp_path / "mesh", {}, {"values": values, "empty": values[:0]})
    folder = ArrayFolder("mesh", tmp_path / "mesh")
    assert folder.rows("empty", (-1, 2), np.int64).shape == (0, 2)
    file = tmp_path / "mesh" / "values.npy"
    content = bytearray(file.read_bytes())
    content[-16 * (5001 - row)] ^= 1
    file.write_bytes(content)
    chosen = np.array([row, 2, 5000 if row < 4096 else 100])
    with pytest.raises(ValueError, match=f"from byte {65536 * (row // 4096)} on"):
        folder.chosen("values", (-1, 2), np.int64, chosen)
    other = slice(4096, 5001) if row < 4096 else slice(0, 4096)  # the other block is whole
    assert np.array_equal(
        folder.rows("values", (-1, 2), np.int64, other.start, other.stop), values[other]
    )
