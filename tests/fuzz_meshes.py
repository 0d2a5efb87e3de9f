# SPDX-License-Identifier: LGPL-3.0-or-later
"""The readers of mesh files, and small valid files of each format, for ``tests.fuzz_readers``."""

from collections.abc import Sequence
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flexfem.mesh import body_mesh
from flexfem.mesh.imported.gmsh_model import session
from flexfem.mesh.line_mesh import read_mesh
from flexfem.mesh.surface_mesh import read_surface_mesh
from tests.fuzz_readers import Reader, any_of
from tests.unit import mesh_texts

__all__ = ["READERS"]


def _texts(*names: str) -> Sequence[bytes]:
    return [getattr(mesh_texts, name).encode() for name in names]


def _body(path: Path) -> object:
    """Mesh that the first rank makes of a file."""
    return body_mesh._read(path, 1.0, None, None, None)


@cache
def _gmsh() -> Sequence[bytes]:
    """A square and a bar with groups in all forms that gmsh writes."""
    import gmsh

    found = []
    with session("fuzz"), TemporaryDirectory() as folder:
        _gmsh_model()
        for form, order in product((2.2, 4.0, 4.1), (1, 2)):
            for binary in (0, 1) if form != 4.0 else (0,):
                gmsh.model.mesh.setOrder(order)
                gmsh.option.setNumber("Mesh.MshFileVersion", form)
                gmsh.option.setNumber("Mesh.Binary", binary)
                gmsh.option.setNumber("Mesh.SaveParametric", order - 1)
                path = Path(folder) / "sample.msh"
                gmsh.write(str(path))
                found.append(path.read_bytes())
    return found


def _gmsh_model() -> None:
    import gmsh

    occ, model = gmsh.model.occ, gmsh.model
    square = occ.addRectangle(0.0, 0.0, 0.0, 1.0, 1.0)
    bar = occ.addLine(occ.addPoint(2.0, 0.0, 0.0), occ.addPoint(3.0, 0.0, 0.0))
    occ.synchronize()
    model.addPhysicalGroup(2, [square], name="plate")
    model.addPhysicalGroup(1, [bar], name="bar")
    model.addPhysicalGroup(1, [1], tag=7)
    model.addPhysicalGroup(0, [1], name="corner")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 1.0)
    model.mesh.generate(2)


@cache
def _vtk(ending: str) -> Sequence[bytes]:
    """Cells of several kinds with data, in all forms that meshio writes."""
    import meshio

    mesh = meshio.Mesh(
        np.linspace(0.0, 1.0, 30).reshape(10, 3) ** [1, 2, 3],
        [("triangle", [[0, 1, 2], [2, 3, 4]]), ("tetra", [[0, 1, 2, 5]]), ("line", [[6, 7]])],
        point_data={"mark": np.arange(10) % 3, "heat": np.arange(10.0)},
        cell_data={"part": [np.array([1, 2]), np.array([2]), np.array([3])]},
    )
    forms: Sequence[dict[str, object]] = [
        {"binary": binary, "fmt_version": form} for binary, form in product((0, 1), ("4.2", "5.1"))
    ]
    if ending == ".vtu":
        forms = [{"binary": False}, *({"compression": kind} for kind in (None, "zlib", "lzma"))]
    write = meshio.vtu.write if ending == ".vtu" else meshio.vtk.write
    found = []
    with TemporaryDirectory() as folder:
        for options in forms:
            write(str(Path(folder) / f"sample{ending}"), mesh, **options)
            found.append((Path(folder) / f"sample{ending}").read_bytes())
    return [*found, mesh_texts.VTK_SHEET.encode()] if ending == ".vtk" else found


_READ = any_of(read_mesh, read_surface_mesh, _body)

READERS = {
    "gmsh": Reader(
        ".msh",
        _gmsh,
        _READ,
        (
            b'SystemCall "touch made_by_a_script";\n',
            b'Printf("x") > "made_by_a_script";\n',
            b"Exit;\n",
            b"$Nodes\n1000000000 1000000000 1 1000000000\n",
            b"$Elements\n1000000000\n",
            b"$EndNodes\n",
            b"$EndElements\n",
            b"$Comments\n",
            b"$Entities\n0 0 0 1000000000\n",
        ),
    ),
    "abaqus": Reader(
        ".inp",
        lambda: _texts(
            "ABAQUS_FRAME",
            "ABAQUS_ASSEMBLY",
            "ABAQUS_INSTANCES",
            "ABAQUS_PLATES",
            "ABAQUS_BLOCK",
            "ABAQUS_MIXED",
        ),
        _READ,
        (
            b"*NSET, NSET=N, GENERATE\n1, 1000000000\n",
            b"*ELSET, ELSET=E, GENERATE\n1, 4000000000000, 2\n",
            b"*INCLUDE, INPUT=input.inp\n*INCLUDE, INPUT=input.inp\n",
            b"*INCLUDE, INPUT=/dev/zero\n",
            b"*NGEN\n1, 1000000000\n",
            b"*NODE, NSET=N\n",
            b"*ELEMENT, TYPE=C3D20\n",
            b"*PART, NAME=ROD\n",
            b"*END PART\n",
            b"*INSTANCE, NAME=I, PART=ROD\n",
            b"*END INSTANCE\n",
        ),
    ),
    "nastran": Reader(
        ".bdf",
        lambda: _texts("NASTRAN_FRAME"),
        _READ,
        (
            b"SET 1 = 1 THRU 1000000000\n",
            b"SET1,1,1,THRU,1000000000\n",
            b"SET3,1,ELEM,1,THRU,1000000000,EXCEPT,5\n",
            b"INCLUDE 'input.bdf'\nINCLUDE 'input.bdf'\n",
            b"INCLUDE '/dev/zero'\n",
            b"CORD2R,1,2,1.,0.,0.,0.,0.,1.\n,1.,0.,0.\n",
            b"GRDSET,,1\n",
            b"BEGIN BULK\n",
            b"ENDDATA\n",
        ),
    ),
    "vtk": Reader(
        ".vtk",
        lambda: _vtk(".vtk"),
        _READ,
        (
            b"DATASET STRUCTURED_POINTS\n",
            b"DIMENSIONS 10000 10000 10000\nORIGIN 0 0 0\nSPACING 1 1 1\n",
            b"POINTS 1000000000 double\n",
            b"CELLS 1000000000 4000000000\n",
            b"FIELD F 1000000000\n",
            b"LOOKUP_TABLE a 1000000000\n",
            b"POINT_DATA 1000000000\n",
            b"SCALARS s double 1000000000\n",
            b"METADATA\n",
            b"BINARY\n",
        ),
    ),
    "vtu": Reader(
        ".vtu",
        lambda: _vtk(".vtu"),
        _READ,
        (
            b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">]>\n',
            b'<Piece NumberOfPoints="1000000000" NumberOfCells="1000000000">\n',
            b'<DataArray type="Int64" Name="offsets" format="appended" offset="9999">\n',
            b'<AppendedData encoding="raw">_',
            b"</AppendedData>",
            b"</Piece><Piece>",
        ),
    ),
}
