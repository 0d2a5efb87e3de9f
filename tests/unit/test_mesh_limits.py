# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh files that ask for more than they hold: memory, time, other files, points that are none."""

import base64
import cProfile
import os
import resource
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from flexfem.mesh.imported import limits
from tests.unit.mesh_texts import VTK_SHEET

NODES = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n"
BAR = NODES + "*ELEMENT, TYPE=B31, ELSET=BAR\n1, 1, 2\n2, 2, 3\n"
GRID = "GRID,1\nGRID,2,,1.\nGRID,3,,1.,1.\nCROD,1,1,1,2\nCROD,2,1,2,3\n"
MEMORY = "would need more memory than a file of this size may ask for"


def chain(length: int) -> str:
    """Coordinate systems each of which stands in the one before."""
    rows = [f"CORD2R,{i + 1},{i},1.,0.,0.,1.,0.,1.\n,2.,0.,0." for i in range(length)]
    return "\n".join([*rows, f"GRID,1,{length}", "GRID,2,,-1.", "CROD,1,1,1,2\n"])


def sets_of_sets(depth: int) -> str:
    """Each has the one before twice; as lists, the last would have 2 to the power of depth."""
    rows = [f"*NSET, NSET=N{i + 1}\nN{i}, N{i}" for i in range(depth)]
    return BAR + "*NSET, NSET=N0\n1, 2\n" + "\n".join(rows) + "\n"


def ranges(count: int) -> str:
    """Different ranges of nodes that are there: quadratic in the size of the file."""
    nodes = "".join(f"{i}, {i}., 0., 0.\n" for i in range(1, count + 1))
    rows = "".join(f"{1 + i // 1000}, {count - i % 1000}\n" for i in range(20 * count))
    return f"*NODE\n{nodes}*ELEMENT, TYPE=B31\n1, 1, 2\n*NSET, NSET=N, GENERATE\n{rows}"


def instances(count: int) -> str:
    """A part of 1000 nodes, placed many times."""
    nodes = "".join(f"{i}, {i}., 0., 0.\n" for i in range(1, 1001))
    rows = "".join(f"*INSTANCE, NAME=I{i}, PART=P\n" for i in range(count))
    return f"*PART, NAME=P\n*NODE\n{nodes}*END PART\n{rows}"


def vtu(cells: str, points: str = "", more: str = "") -> str:
    """A line in a file of XML."""
    points = points or ">0 0 0 1 0 0"
    return f"""<VTKFile type="UnstructuredGrid" compressor="vtkZLibDataCompressor"{more}>
<UnstructuredGrid><Piece NumberOfPoints="2" NumberOfCells="1"><Points>
<DataArray type="Float64" Name="Points" {points}</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity">{cells}</DataArray>
<DataArray type="Int64" Name="offsets">2</DataArray>
<DataArray type="UInt8" Name="types">3</DataArray>
</Cells></Piece></UnstructuredGrid></VTKFile>"""


def packed(size: int) -> str:
    """An array of zeros, compressed; it says that it has the right size."""
    data = zlib.compress(bytes(size), 9)
    head = np.array([1, 48, 0, len(data)], dtype="<u4").tobytes()
    return f'format="binary">{(base64.b64encode(head) + base64.b64encode(data)).decode()}'


FILES = {
    "range of nodes": (BAR + "*NSET, NSET=N, GENERATE\n1, 1000000000\n", "a.inp",
                       'node set "N": node 4 is not in the file'),
    "range of elements": (BAR + "*ELSET, ELSET=E, GENERATE\n2, 2000000000, 2\n", "a.inp",
                          'element set "E": element 4 is not in the file'),
    "nodes of elements": (BAR + "*ELSET, ELSET=E, GENERATE\n1, 1000000000\n*NSET, NSET=N, ELSET=E",
                          "a.inp", r"line 10: \*NSET: element 3 is not in the file up to here"),
    "sets of sets": (sets_of_sets(60), "a.inp", ""),
    "many ranges": (ranges(2000), "a.inp", "sets of ranges " + MEMORY),
    "instances": (instances(3000), "a.inp", "the instances of its parts " + MEMORY),
    "include itself": ("*INCLUDE, INPUT=a.inp\n", "a.inp", "INCLUDE without end$"),
    "include twice": ("INCLUDE 'b.bdf'\nINCLUDE 'b.bdf'\n", "a.bdf", "INCLUDE of more than 1000"),
    "include a device": ("*INCLUDE, INPUT=/dev/zero\n", "a.inp",
                         r'line 1: \*INCLUDE: file "/dev/zero" is a pipe or a device'),
    "include a folder": ("INCLUDE '.'\n", "a.bdf", r'line 1: INCLUDE: file "\." is a folder'),
    "range in a case": ("SET 1 = 1 THRU 1000000000\nBEGIN BULK\n" + GRID, "a.bdf", ""),
    "range in the bulk": (GRID + "SET3,1,ELEM,1,THRU,1000000000,EXCEPT,2\n", "a.bdf", ""),
    "range in two lines": (GRID + "SET1,1,1,THRU\n,1000000000\n", "a.bdf", ""),
    "chain of systems": (chain(1000), "a.bdf", "depends on more than 50 others"),
    "short chain": (chain(40), "a.bdf", ""),
    "a long line": (BAR + "*NSET, NSET=N\n" + "1, " * 400000, "a.inp",
                    "line 9: more than 1000000 characters"),
    "a zero byte": (BAR.replace("1, 1, 2", "1, 1, 2\0"), "a.inp", "line 6: no text, it has a zero"),
    "other digits": (BAR.replace("1, 1, 2", "\u0661, 1, 2"), "a.inp", "needs whole numbers, got"),
    "underscores": (BAR.replace("2, 1, 0", "2, 1_0, 0"), "a.inp", "needs numbers, got '1_0, 0, 0'"),
    "many digits": (BAR.replace("2, 1, 0", f"2, 1{'0' * 400}, 0"), "a.inp", "needs numbers, got"),
    "a number of a megabyte": (BAR.replace("2, 1, 0", f"2, 1{'2' * 500000}x, 0"), "a.inp",
                               "needs numbers, got '12222"),
    "a large number": (GRID.replace("GRID,3", f"GRID,3{'0' * 30}"), "a.bdf", "field 2 must be the"),
    "index -1": (VTK_SHEET.replace("3 0 2 3", "3 0 2 -1"), "a.vtk", "a cell has node -1 of 0 to 5"),
    "index 6": (VTK_SHEET.replace("3 0 2 3", "3 0 2 6"), "a.vtk", "a cell has node 6 of 0 to 5"),
    "a billion": (VTK_SHEET.replace("POINTS 6", "POINTS 1000000000"), "a.vtk", "before 3000000000"),
    "rows": ("# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\n"
             "DIMENSIONS 10000 10000 10000\nORIGIN 0 0 0\nSPACING 1 1 1\n", "a.vtk",
             "a grid of points " + MEMORY),
    "a grid": ("# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\n"
               "DIMENSIONS 3 1 1\nORIGIN 0 0 0\nSPACING 1 1 1\n", "a.vtk", ""),
    "XML": (vtu("0 1"), "a.vtu", ""),
    "XML, index -1": (vtu("0 -1"), "a.vtu", "a cell has a node that is not one of 0 to 1"),
    "compressed": (vtu("0 1", packed(10**8)), "a.vtu", 'array "Points" has not the 48 bytes'),
    "entities": ('<!DOCTYPE a [<!ENTITY b "bb">]>' + vtu("0 1"), "a.vtu", "declarations of XML"),
    "blocks": (vtu("0 1", f'format="binary">{base64.b64encode(b"\\xff" * 12).decode()}'), "a.vtu",
               'array "Points" is cut off or damaged'),
    "cubes of letters": (vtu("0 1", more=' byte_order="?"'), "a.vtu", "order of bytes"),
}  # fmt: skip


@contextmanager
def little_memory() -> Iterator[None]:
    """A gigabyte more than there is now, which each of these files would have exceeded."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    room = pages * resource.getpagesize() + 2**30
    resource.setrlimit(resource.RLIMIT_AS, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.serial
@pytest.mark.parametrize("kind", FILES)
def test_a_file_gets_no_more_than_it_holds(kind, tmp_path) -> None:
    """Read, where there is no message, or refused, in little memory."""
    text, name, message = FILES[kind]
    (tmp_path / name).write_text(text)
    double = "".join(f"INCLUDE '{x}.bdf'\n" for x in "cc")
    for i, letter in enumerate("bcdefghijklmno"):
        following = "cdefghijklmnop"[i]
        (tmp_path / f"{letter}.bdf").write_text(double.replace("c", following))
    (tmp_path / "p.bdf").write_text("$ nothing\n")
    with little_memory():
        if not message:
            assert len(ff.read_mesh(tmp_path / name).cells)
            return
        with pytest.raises(ValueError, match=message) as caught:
            ff.read_mesh(tmp_path / name)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 400


@pytest.mark.serial
def test_a_mesh_has_as_many_files_as_the_message_says(tmp_path, monkeypatch) -> None:
    """The limit counts the file that includes the others; the last one within it is read."""
    monkeypatch.setattr(limits, "_FILES", 3)
    for letter in "bcd":
        (tmp_path / f"{letter}.bdf").write_text("$ nothing\n")
    rows = [f"INCLUDE '{letter}.bdf'\n" for letter in "bcd"]
    path = tmp_path / "a.bdf"
    path.write_text("".join(rows[:2]) + GRID)
    # refused if one file too many were counted
    assert len(ff.read_mesh(path).cells) == 2
    path.write_text("".join(rows) + GRID)
    with pytest.raises(ValueError, match=r'd\.bdf": INCLUDE of more than 3 files$'):
        ff.read_mesh(path)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "message"),
    [("a.msh", "does not begin with"), ("a.vtk", "does not begin with"), ("a.vtu", "well-formed")],
)
def test_of_what_is_no_mesh_only_the_beginning_is_read(name, message, tmp_path) -> None:
    """A hole of 8 GB, which takes no room on the disk, was read to its end."""
    with (tmp_path / name).open("wb") as file:
        file.truncate(8_000_000_000)
    with little_memory(), pytest.raises(ValueError, match=f"{message}|declarations of XML"):
        ff.read_mesh(tmp_path / name)


def many_instances(count: int) -> str:
    """A bar that is placed many times."""
    part = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n*ELEMENT, TYPE=B31\n1, 1, 2\n"
    rows = "".join(f"*INSTANCE, NAME=I{i}, PART=P\n" for i in range(count))
    return f"*PART, NAME=P\n{part}*END PART\n*ASSEMBLY, NAME=A\n{rows}*END ASSEMBLY\n"


@pytest.mark.serial
def test_time_grows_with_the_size_of_a_file(tmp_path) -> None:
    """Calls of functions, which are counted for they do not depend on the machine."""
    calls = []
    for count in (200, 800):
        (tmp_path / "a.inp").write_text(many_instances(count))
        profile = cProfile.Profile()
        profile.enable()
        ff.read_mesh(tmp_path / "a.inp")
        profile.disable()
        calls.append(sum(entry.callcount for entry in profile.getstats()))
    # a look at all instances for each of them: 9 times, half an hour for a file of 4 MB
    assert calls[1] < 5.0 * calls[0]


@pytest.mark.parametrize("name", ["pipe.msh", "pipe.inp", "pipe.bdf", "pipe.vtk", "pipe.vtu"])
def test_pipes_are_not_waited_for(name, shared_tmp_path) -> None:
    """The same on all ranks: nobody ever writes into it."""
    path = shared_tmp_path / name
    with suppress(FileExistsError):  # another rank was first
        os.mkfifo(path)
    with pytest.raises(ValueError, match=r"is a pipe or a device$"):
        ff.read_body_mesh(path)
    with pytest.raises(ValueError, match=r"is a pipe or a device$"):
        ff.read_mesh(path)


@pytest.mark.three_ranks
def test_all_ranks_hear_of_a_failure_on_the_first(shared_tmp_path, monkeypatch) -> None:
    """Whatever kind it is: the others would wait for ever."""

    def no_room(*_: object) -> None:
        raise MemoryError("no room")

    monkeypatch.setattr("flexfem.mesh.body_mesh._read", no_room)
    with pytest.raises(MemoryError, match="no room"):
        ff.read_body_mesh(shared_tmp_path / "a.inp")


@pytest.mark.serial
def test_sets_in_ranges_are_what_the_file_has(tmp_path) -> None:
    """THRU leaves out what is not there, GENERATE must find all; names outside of UTF-8 differ."""
    (tmp_path / "a.bdf").write_text(
        "SET 4 = 1 THRU 5 EXCEPT 2, 11 THRU 900000000\nBEGIN BULK\n"
        + GRID
        + "GRID,11,,9.\nCROD,9,1,3,11\nSET1,5,3,THRU,1000000\nENDDATA\n"
    )
    mesh = ff.read_mesh(tmp_path / "a.bdf", points=["set_4", "set_5"])
    places = {name: mesh.points[node].tolist() for name, node in mesh.point_groups.items()}
    assert places == {
        "set_4_1": [0, 0, 0],
        "set_4_2": [1, 1, 0],
        "set_4_3": [9, 0, 0],
        "set_5_1": [1, 1, 0],
        "set_5_2": [9, 0, 0],
    }
    text = BAR + "*NSET, NSET=N\xe4, GENERATE\n1, 3, 2\n*NSET, NSET=N\xf6\n2\n"
    (tmp_path / "a.inp").write_bytes(text.encode("latin-1"))
    mesh = ff.read_mesh(tmp_path / "a.inp", points=["N\xe4", "N\xf6"])
    assert dict(mesh.point_groups) == {"N\xe4_1": 0, "N\xe4_2": 2, "N\xf6": 1}
