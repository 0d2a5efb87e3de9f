# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of gmsh, which the package reads itself: as gmsh reads them, and never executed."""

import struct
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem.mesh.imported.gmsh_types import CELLS, ELEMENTS
from flexfem.mesh.imported.mesh_file import KINDS
from flexfem.mesh.imported.read import read_mesh_file


def solids(model, order: int) -> None:
    """A box of hexahedra beside one of wedges, with groups that overlap and some without names."""
    import gmsh

    occ = model.occ
    both, _ = occ.fragment(
        [(2, occ.addRectangle(0, 0, 0, 2, 1))], [(2, occ.addRectangle(2, 0, 0, 1, 1))]
    )
    occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", float(order == 2))
    model.mesh.setTransfiniteSurface(1)
    model.mesh.setRecombine(2, 1)
    occ.extrude(both, 0, 0, 1, [2], recombine=True)
    occ.synchronize()
    model.addPhysicalGroup(3, [1, 2], name="all of it")
    model.addPhysicalGroup(3, [2], tag=5)
    model.addPhysicalGroup(2, [2, 1], name="floor")
    model.addPhysicalGroup(1, [1], name='"ünder"')
    model.addPhysicalGroup(0, [1, 3], name="corners")
    model.mesh.generate(3)
    model.mesh.setOrder(order)


def numbers_and_cells(model) -> tuple[dict[int, tuple[float, ...]], dict[str, Counter]]:
    """Corners of the elements of each group by their places, from gmsh."""
    tags, xyz, _ = model.mesh.getNodes()
    xyz = np.round(xyz, 12).reshape(-1, 3) + 0.0  # texts have 16 digits
    place = dict(zip(tags.tolist(), map(tuple, xyz.tolist()), strict=True))
    groups: dict[str, Counter] = {}
    for dimension, tag in model.getPhysicalGroups():
        name = model.getPhysicalName(dimension, tag) or f"physical_{tag}"
        found = groups.setdefault(name, Counter())
        for entity in model.getEntitiesForPhysicalGroup(dimension, tag):
            parts = model.mesh.getElements(dimension, entity)
            for kind, _, nodes in zip(*parts, strict=True):
                for row in nodes.reshape(-1, ELEMENTS[kind][2]).tolist():
                    corners = row[: KINDS[CELLS[kind]].corners] if dimension else row
                    found[tuple(place[node] for node in corners)] += 1
    return place, groups


@pytest.mark.serial
@pytest.mark.parametrize(
    ("form", "binary", "parametric", "order"),
    [
        (2.2, 0, 0, 1),
        (2.2, 1, 1, 2),
        (2.2, 0, 1, 1),
        (4.0, 0, 1, 2),
        (4.1, 0, 1, 2),
        (4.1, 1, 0, 1),
    ],
)
def test_read_as_gmsh_reads(form, binary, parametric, order, gmsh_model, tmp_path) -> None:
    """Nodes, and the elements of each group, are those that gmsh itself has."""
    import gmsh

    solids(gmsh_model, order)
    for name, value in (
        ("MshFileVersion", form),
        ("Binary", binary),
        ("SaveParametric", parametric),
    ):
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.write(str(tmp_path / "solids.msh"))
    file = read_mesh_file(tmp_path / "solids.msh")
    file = replace(file, points=np.round(file.points, 12) + 0.0)
    place, groups = numbers_and_cells(gmsh_model)
    assert sorted(map(tuple, file.points.tolist())) == sorted(place.values())
    assert set(file.element_sets) | set(file.node_sets) == set(groups)
    for name, rows in file.element_sets.items():
        assert file_cells(file, rows) == groups[name], name
    corners = Counter((tuple(place),) for place in file.points[file.node_sets["corners"]].tolist())
    assert corners == groups["corners"]


def file_cells(file, rows) -> Counter:
    """Corners of cells by their places."""
    found: Counter = Counter()
    for kind, nodes in file.cells.items():
        own = nodes[np.isin(file.numbered(kind), rows), : KINDS[kind].corners]
        found.update(tuple(map(tuple, cell)) for cell in file.points[own].tolist())
    return found


HEAD = "$MeshFormat\n{} 0 8\n$EndMeshFormat\n"
RING = (
    HEAD.format("2.2")
    + "$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
    + "$Elements\n3\n1 1 2 1 1 1 2\n2 1 2 1 1 2 3\n3 1 2 1 1 3 1\n$EndElements\n"
)
NODES_41 = "$Nodes\n1 2 1 2\n1 1 0 2\n1\n2\n0 0 0\n1 0 0\n$EndNodes\n"
BAR_41 = HEAD.format("4.1") + NODES_41 + "$Elements\n1 1 1 1\n1 1 1 1\n1 1 2\n$EndElements\n"

SCRIPTS = {
    "call": 'SystemCall "touch made";\n',
    "exit": "Exit;\n",
    "print": 'Printf("x") > "made";\n',
    "late": "// " + RING.replace("\n", "\n// ") + '\nSystemCall "touch made";\n',
    "geometry": "Point(1) = {0, 0, 0};\n",
}

READERS = (ff.read_mesh, ff.read_surface_mesh, ff.read_body_mesh)


@pytest.mark.parametrize("kind", SCRIPTS)
def test_scripts_are_not_executed(kind, shared_tmp_path, monkeypatch) -> None:
    """The same on all ranks; gmsh would run them, and end the process with exit code 0."""
    monkeypatch.chdir(shared_tmp_path)
    path = shared_tmp_path / "script.msh"
    path.write_text(SCRIPTS[kind])
    for read in READERS:
        with pytest.raises(ValueError, match=r"scripts of gmsh are not executed$"):
            read(path)
    assert [found.name for found in shared_tmp_path.iterdir()] == ["script.msh"]


@pytest.mark.serial
def test_options_beside_a_mesh_are_not_executed(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ring.msh").write_text(RING)
    for name in ("ring.msh.opt", ".gmshrc", ".gmsh-options", "gmshrc"):
        (tmp_path / name).write_text(f'SystemCall "touch made_by_{name}";\nGeneral.Terminal = 1;\n')
    before = set(tmp_path.iterdir())
    assert len(ff.read_mesh(tmp_path / "ring.msh").cells) == 3
    assert set(tmp_path.iterdir()) == before


@pytest.mark.serial
def test_other_programs_groups_are_those_of_the_elements(tmp_path) -> None:
    """Formats before 4 have the group with each element: one entity may be in parts of several."""
    text = RING.replace("2 1 2 1 1 2 3", "2 1 2 4 1 2 3")
    (tmp_path / "ring.msh").write_text(text)
    groups = ff.read_mesh(tmp_path / "ring.msh").line_groups
    assert {name: rows.tolist() for name, rows in groups.items()} == {
        "physical_1": [0, 2],
        "physical_4": [1],
    }


@pytest.mark.serial
@pytest.mark.parametrize(("binary", "order"), [(0, 1), (1, 2)])
def test_an_element_in_two_groups_is_one_element(binary, order, gmsh_model, tmp_path) -> None:
    """Format 2.2 writes it once for each: read twice, the body would have twice its mass."""
    import gmsh

    solids(gmsh_model, order)
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.write(str(tmp_path / "solids.msh"))
    file = read_mesh_file(tmp_path / "solids.msh")
    count = sum(len(found) for found in gmsh_model.mesh.getElements(3)[1])
    assert (file.dimensions == 3).sum() == count
    assert len(file.element_sets["all of it"]) == count


BAD = {
    "ring without its end": (RING[:-13], r"section \$Elements has no end where it should be"),
    "ring without its last element": (RING.replace("3 1 2 1 1 3 1\n", ""), "fewer elements than"),
    "one node too few": (RING.replace("3 0 1 0\n", ""), "it ends before 3 rows that it says"),
    "one node too many": (RING.replace("$Nodes\n3", "$Nodes\n2"), "it has 4 numbers more than it"),
    "a node that is not there": (RING.replace("1 3 1\n", "1 3 4\n"), "has node 4, which is not in"),
    "a node twice": (RING.replace("3 0 1 0", "2 0 1 0"), "node 2 occurs twice, at different"),
    "numbers that are none": (RING.replace("0 1 0", "0 1_0 0"), "'_' is in place of numbers"),
    "two numbers in one": (RING.replace("0 1 0", "0 1-1 0"), "it has something else than numbers"),
    "half a number": (RING.replace("2 3\n3", "2 2.5\n3"), "2.5 is no whole number"),
    "a billion": (RING.replace("$Nodes\n3", "$Nodes\n1000000000"), "before 1000000000 rows"),
    "a billion in 4.1": (BAR_41.replace("1 1 0 2\n1", "1 1 0 1000000000\n1"), "before 1000000000"),
    "another total": (BAR_41.replace("$Nodes\n1 2", "$Nodes\n1 3"), "there are 3 nodes, and has 2"),
    "a type": (RING.replace("1 1 2 1 1 1 2", "1 141 2 1 1 1 2"), "elements of type 141 cannot be"),
    "no nodes": (HEAD.format("2.2"), r"it has no section \$Nodes; was it written to its end"),
    "nodes twice": (BAR_41 + NODES_41, r"it has section \$Nodes twice"),
    "format 1": ("$NOD\n1\n1 0 0 0\n$ENDNOD\n", "format 1.0 of gmsh is not supported; save it in"),
    "format 3": (RING.replace("2.2 ", "3 "), "format 3 of gmsh is not supported; save it in"),
    "format 5": (RING.replace("2.2 ", "5.0 "), "format 5.0 of gmsh is not supported"),
    "binary 4.0": (BAR_41.replace("4.1 0 8", "4.0 1 8"), "files of format 4.0 are text only"),
    "size of numbers": (BAR_41.replace("4.1 0 8", "4.1 0 16"), "no version, kind and size of numb"),
    "order of bytes": (BAR_41.replace("4.1 0 8", "4.1 1 8"), "its byte order is unknown"),
    "something at the end": (RING + "SystemCall;\n", "'SystemCall;' is in place of a section"),
}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_files_of_either_order_of_bytes(order, tmp_path) -> None:
    """A bar as programs on other machines write it: gmsh here writes one order only."""

    def packed(kinds: str, *values: float) -> bytes:
        return struct.pack(order + kinds, *values)

    nodes = packed("4Q3iQ", 1, 2, 1, 2, 1, 1, 0, 2) + packed("2Q6d", 1, 2, 0, 0, 0, 3, 4, 0)
    content = b"$MeshFormat\n4.1 1 8\n" + packed("i", 1) + b"\n$EndMeshFormat\n"
    content += b"$Nodes\n" + nodes + b"\n$EndNodes\n"
    bar = packed("4Q3iQ3Q", 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2)
    (tmp_path / "bar.msh").write_bytes(content + b"$Elements\n" + bar + b"\n$EndElements\n")
    mesh = ff.read_mesh(tmp_path / "bar.msh")
    assert mesh.points.tolist() == [[0, 0, 0], [3, 4, 0]]
    assert mesh.cells.tolist() == [[0, 1]]


@pytest.mark.serial
@pytest.mark.parametrize("kind", BAD)
def test_damaged_files_are_refused_in_one_line(kind, tmp_path) -> None:
    assert len(_read(tmp_path, RING).cells) == 3
    assert len(_read(tmp_path, BAR_41).cells) == 1
    text, message = BAD[kind]
    with pytest.raises(ValueError, match=message) as caught:
        _read(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith('mesh file "')


def _read(folder: Path, text: str) -> ff.LineMesh:
    (folder / "mesh.msh").write_text(text)
    return ff.read_mesh(folder / "mesh.msh")
