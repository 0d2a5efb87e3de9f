# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of joints along lines of shells."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.core.marker import ShellLine
from flexfem.model.structure.marker_places import node_row

pytestmark = pytest.mark.serial
SECTION = ff.ShellSection.isotropic(0.01, ff.Material(2e9, 0.3, 1000.0))


def _rows(cells: int, other: int, lift: float = 0.0, curve: float = 0.0):
    """Two rectangles, one beyond the other, and their rows along x at y = 1."""

    def bent(u):
        return np.stack([u[:, 0], u[:, 1], curve * u[:, 0] ** 2], axis=1)

    x, y = np.linspace(0.0, 2.0, cells + 1), np.linspace(0.0, 1.0, 3)
    first = ff.SurfaceMesh.grid("near", x, y, bent)
    x = np.linspace(0.0, 2.0, other + 1)
    second = ff.SurfaceMesh.grid("far", x, 1.0 + y, lambda u: bent(u) + lift * np.eye(3)[2])
    mesh = ff.SurfaceMesh.join([first, second])
    near, far = ShellLine("near", "near_top"), ShellLine("far", "far_bottom")
    rows = [node_row(mesh, ff.Shell(line.body, SECTION), line) for line in (near, far)]
    return mesh, near, far, rows


def test_rows():
    mesh, _, _, (near, far) = _rows(4, 4)
    np.testing.assert_array_equal(near.nodes, [10, 11, 12, 13, 14])
    assert near.count == 5
    assert near.length == pytest.approx(2.0)
    # cells are cut from bottom left to top right: the upper triangle has its corner on the left
    np.testing.assert_array_equal(near.apexes, [5, 6, 7, 8])
    assert {int(n) for n in far.apexes} <= set(mesh.body_nodes("far").tolist())
    np.testing.assert_allclose(mesh.points[far.apexes][:, 1], 1.5)


def test_matching_nodes():
    _, near, far, rows = _rows(4, 4)
    parts = ff.HingeLine("hinge", near, far).parts(rows)
    assert len(parts) == 5
    for part, a, b in zip(parts, rows[0].nodes, rows[1].nodes, strict=True):
        assert {part.a.nodes, part.b.nodes} == {(int(a),), (int(b),)}
        assert part.name == "hinge"
        assert part.owner == 'HingeLine "hinge"'


@pytest.mark.parametrize("counts", [(4, 6), (6, 4)])
def test_places_on_the_coarser_line(counts):
    mesh, near, far, rows = _rows(*counts)
    parts = ff.HingeLine("hinge", near, far).parts(rows)
    assert len(parts) == 7
    fine, coarse = ("far", "near") if counts[1] == 6 else ("near", "far")
    for part in parts:
        assert (part.a.body, part.b.body) == (coarse, fine)
        x, y = (np.array(m.weights) @ mesh.points[list(m.nodes)] for m in (part.a, part.b))
        # round-off; a place on another edge is 0.1 away
        np.testing.assert_allclose(x, y, atol=1e-15)
        assert not part.a.offset.any()
    # at 0, 1 and 2 there are nodes
    assert sorted(len(part.a.nodes) for part in parts) == [1, 1, 1, 2, 2, 2, 2]


def test_gaps_of_curved_lines():
    """Chords of different lengths: refused as a gap, or kept as an offset."""
    mesh, near, far, rows = _rows(4, 6, curve=0.1)
    with pytest.raises(ValueError, match=r'HingeLine "hinge": node \d+ of line "far_bottom"') as e:
        ff.HingeLine("hinge", near, far).parts(rows)
    assert 'away from line "near_top" of Shell "near"' in str(e.value)
    parts = ff.HingeLine("hinge", near, far, tolerance=0.01).parts(rows)
    for part in parts:
        x, y = (np.array(m.weights) @ mesh.points[list(m.nodes)] for m in (part.a, part.b))
        # the marker is where the node is: nothing moves when the joint begins to hold
        np.testing.assert_allclose(x + part.a.offset, y, atol=1e-15)
        assert (len(part.a.nodes) == 1) != part.a.offset.any()


def test_far_lines():
    _, near, far, rows = _rows(4, 4, lift=0.1)
    with pytest.raises(ValueError, match=r"is 0\.1 m away from"):
        ff.HingeLine("hinge", near, far).parts(rows)


def test_on_a_body():
    _, near, _, rows = _rows(4, 4)
    hub = ff.Marker("hub")
    parts = ff.HingeLine("hinge", near, hub).parts((rows[0], None))
    assert [part.b.nodes for part in parts] == [(int(n),) for n in rows[0].nodes]
    assert all(part.a is hub for part in parts)


def test_shared_nodes():
    _, near, _, rows = _rows(4, 4)
    with pytest.raises(ValueError, match="share node 10, where they are hinged without a joint"):
        ff.HingeLine("hinge", near, near).parts((rows[0], rows[0]))


@pytest.mark.parametrize("counts", [(4, 4), (4, 6)])
def test_angles(counts):
    _, near, far, rows = _rows(*counts)
    parts = ff.ClampedLine("clamp", near, far).parts(rows)
    angles = [part for part in parts if len(part.b.nodes) == 3]
    # one for each segment of the finer line
    assert len(angles) == max(counts)
    assert len(parts) - len(angles) == max(counts) + 1
    body = ff.ClampedLine("clamp", near, ff.Ground()).parts((rows[0], None))
    assert len(body) == counts[0] + 1 + counts[0]


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0)])
def test_stiffness_of_angles(direction):
    """``D l / d`` between two triangles of height d, 2 D l / d on the ground, D across the line."""
    mesh, near, far, _ = _rows(4, 6)
    plane = np.array([[9.0, 1.0, 0.5], [1.0, 4.0, -0.3], [0.5, -0.3, 2.0]])
    section = ff.ShellSection(np.kron(np.eye(2), plane), 1.0, 0.1)
    shells = [ff.Shell(name, section, direction=direction) for name in ("near", "far")]
    rows = [node_row(mesh, s, line) for s, line in zip(shells, (near, far), strict=True)]
    # across the line, along y, which is a direction of the material at 90 or 45 degrees
    across = np.array([0.0, 1.0, 0.0] if direction[1] == 0.0 else [0.5, 0.5, 1.0])
    stiffness = across @ plane @ across
    parts = ff.ClampedLine("clamp", near, ff.Ground()).parts((rows[0], None))
    # exact; a stiffness along the line, or one of the whole height, is off by a factor
    assert parts[-1].law.law.stiffness == pytest.approx(2.0 * stiffness * 0.5 / 0.5, rel=1e-12)
    both = ff.ClampedLine("clamp", near, far).parts(rows)
    assert both[-1].law.law.stiffness == pytest.approx(stiffness / 3.0 / 0.5, rel=1e-12)


def test_slopes_follow_the_place_in_a_segment():
    """Of a twisted sheet z = x y, by the rotations of the triangles beside its edge."""
    mesh, _, _, rows = _rows(4, 4)
    for row in rows:
        for k, along in ((0, 0.5), (1, 0.2), (3, 0.5), (2, 0.9)):
            slope = 0.0
            for marker, weight in row.tilted(k, along):
                x = mesh.points[list(marker.nodes)].copy()
                x[:, 2] = x[:, 0] * x[:, 1]
                n = np.cross(x[1] - x[0], x[2] - x[0])
                slope -= weight * n[1] / n[2]  # dz/dy = x
            # exact; the slope of the triangle at the segment alone is off by half its length, 0.25
            expected = row.points[k, 0] + along * 0.5
            assert slope == pytest.approx(expected, abs=1e-12)


def test_angles_that_follow_from_others():
    """Both segments at y = 1 have one triangle's corner below them: one angle is enough."""
    points = [[0, 1, 0], [1, 1, 0], [2, 1, 0], [1, 0, 0], [0, 0, 0], [2, 0, 0]]
    triangles = [[3, 1, 0], [3, 2, 1], [4, 3, 0], [3, 5, 2]]
    mesh = ff.SurfaceMesh(points, triangles, {"fan": [0, 1, 2, 3]}, {"top": [[0, 1], [1, 2]]})
    line = ShellLine("fan", "top")
    row = node_row(mesh, ff.Shell("fan", SECTION, element="director"), line)
    np.testing.assert_array_equal(row.apexes, [3, 3])
    parts = ff.ClampedLine("clamp", line, ff.Ground()).parts((row, None))
    assert len(parts) == 3 + 1


def test_bad_lines():
    mesh, *_ = _rows(4, 4)
    for line, message in (
        ("far_bottom", 'ShellLine on "near": line "far_bottom" is not on this shell'),
        ("missing", 'ShellLine on "near": SurfaceMesh: line "missing" is not in the mesh'),
    ):
        with pytest.raises(ValueError, match=message):
            node_row(mesh, ff.Shell("near", SECTION), ShellLine("near", line))
    with pytest.raises(TypeError, match='HingeLine "hinge": a must be a ShellLine'):
        ff.HingeLine("hinge", ff.Ground(), ff.Marker("hub"))
    with pytest.raises(ValueError, match="tolerance must be positive"):
        ff.HingeLine("hinge", ShellLine("near", "top"), ff.Ground(), tolerance=0.0)
