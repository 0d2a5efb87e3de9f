# SPDX-License-Identifier: LGPL-3.0-or-later
"""STL and OBJ files: what they hold is read, what they only claim is refused in one line."""

import re
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from flexfem.mesh.imported.surface_files import read_surface

pytestmark = pytest.mark.serial

CORNERS = "".join(f"vertex {x} {y} -1e-1\n" for x, y in ((0, 0), (1, 0), (0, 0.25)))
FACET = f"facet normal 0 0 1\nouter loop\n{CORNERS}endloop\nendfacet\n"
SOLID = f"solid a plate\n{FACET}{FACET.replace('0.25', '2.5E-1')}endsolid a plate\n"
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def binary(count: int, head: bytes = b"solid by a program") -> bytes:
    """An STL file that says how many triangles it has, and has four."""
    held = b"".join(struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[f].ravel(), 7) for f in FACES)
    return head.ljust(80) + struct.pack("<I", count) + held


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_binary_stl_with_the_head_of_a_text(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(binary(4))
    points, triangles = read_surface(tmp_path / "a.stl")
    assert points.shape == (4, 3)  # corners in one place are one point
    assert volume(points, triangles) == pytest.approx(1 / 6, rel=1e-12)


def test_as_an_independent_reader_reads_it(tmp_path: Path) -> None:
    """The corners of all triangles, in order."""
    from meshio import obj, stl

    (tmp_path / "a.stl").write_text(SOLID)
    (tmp_path / "b.stl").write_bytes(binary(4, b"made by a program"))
    lines = "".join("v {} {} {}\n".format(*x) for x in TETRAHEDRON)
    (tmp_path / "c.obj").write_text(f"# comment\n{lines}o a\ns off\nf 1 3 2\nf 1 2 4\n")
    for name, reader in (("a.stl", stl), ("b.stl", stl), ("c.obj", obj)):
        points, triangles = read_surface(tmp_path / name)
        with np.errstate(over="ignore"):
            other = reader.read(tmp_path / name)
        assert np.array_equal(points[triangles], other.points[other.cells[0].data][..., :3])


def test_polygons_and_numbers_from_the_end(tmp_path: Path) -> None:
    lines = "".join("v {} {} {} 1.0\n".format(*x) for x in TETRAHEDRON)
    (tmp_path / "a.obj").write_text(
        f"{lines}f -4/1 -2/1/1 \\\n-3\nf 1 2 4\nf 1 4 3\nf 2 3 4\nv 1 1 0\nf 1 2 5 3\n"
    )
    points, triangles = read_surface(tmp_path / "a.obj")
    assert len(points) == 5
    assert volume(points, triangles[:4]) == pytest.approx(1 / 6, rel=1e-12)
    assert triangles[4:].tolist() == [[0, 1, 4], [0, 4, 2]]  # the square as a fan


REFUSED = {
    "count": (".stl", binary(10**9, b"x"), "it is to have 1000000000 triangles and has room for 4"),
    "cut off": (".stl", binary(4, b"x")[:-1], "it is to have 4 triangles and has room for 3"),
    "more than said": (".stl", binary(2, b"x"), "it is to have 2 triangles and has room for 4"),
    "nothing in it": (".stl", binary(4)[:80] + bytes(4), "it has no triangles"),
    "not a number": (
        ".stl", binary(4, b"x").replace(struct.pack("<f", 1.0), struct.pack("<f", np.nan), 1),
        "its points are not all finite",
    ),
    "signalling NaN": (
        ".stl", binary(4, b"x").replace(struct.pack("<f", 1.0), b"\1\0\x80\x7f", 1),
        "its points are not all finite",
    ),
    "neither": (".stl", b"no triangles", "it is neither a binary nor an ASCII STL file"),
    "ends early": (
        ".stl", SOLID.removesuffix("endsolid a plate\n").encode(),
        "line 15: the file ends before its solid does",
    ),
    "corner lost": (
        ".stl", SOLID.replace(CORNERS, CORNERS[:-17], 1).encode(), "line 6: vertex must come here"
    ),
    "behind the end": (".stl", (SOLID + FACET).encode(), "line 17: solid must come here"),
    "coordinate": (
        ".stl", SOLID.replace("0.25", "1e400").encode(), "line 6: coordinates must be finite"
    ),
    "two coordinates": (
        ".stl", SOLID.replace("0.25 -1e-1", "0.25").encode(), "line 6: vertex must have three"
    ),
    "zero byte": (".stl", SOLID.replace("0.25", "0\0").encode(), "line 6: it has a zero byte"),
    "no points": (".obj", b"o thing\nf 1 2 3\n", "line 2: there is no point 1 among the 0 so far"),
    "last point": (".obj", b"v 0 0 0\nf 1 1 0\n", "line 2: there is no point 0 among the 1 so far"),
    "far from the end": (".obj", b"v 0 0 0\nf 1 1 -2\n", "line 2: there is no point -2 among"),
    "word": (".obj", b"v 0 0 0\nf 1 1 1_0\n", "line 2: corners must be numbers of points"),
    "two corners": (".obj", b"v 0 0 0\nf 1 1\n", "line 2: a face needs three corners, got 2"),
    "points only": (".obj", b"v 0 0 0\n", "it has no triangles"),
    "nothing": (".obj", b"", "it has no triangles"),
    "another": (".dae", b"", '".dae" files are not read, .stl and .obj are'),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_what_it_says(case: str, tmp_path: Path) -> None:
    suffix, content, line = REFUSED[case]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=re.escape(line)) as refused:
            read_surface(path)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert "\n" not in str(refused.value)
    assert most < 1e6  # a thousand million triangles would be 50 GB


def test_files_are_of_bounded_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexfem.mesh.imported.surface_files._LARGEST", 100)
    (tmp_path / "a.stl").write_bytes(binary(4))
    with pytest.raises(ValueError, match="it has 284 bytes, at most 100 are read"):
        read_surface(tmp_path / "a.stl")
