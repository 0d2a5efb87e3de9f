# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tangents and section frames of lines given by their nodes."""

from collections import defaultdict, deque
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.normals import angle_about, any_normal, dot, projected, reflect, turn
from flexfem.mesh.geometry.topology import Line, meeting_ends, trace_lines

#: Direction for e2: a vector, a function of points (n, 3), or None for rotation-minimising frames.
Orientation = npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike] | None

#: Largest angle between neighbouring cells, radians, that is still taken for a smooth curve.
#: A full circle of eight cells turns by 45 degrees at each node.
CORNER_ANGLE = np.deg2rad(60.0)


def node_tangents(
    points: FloatArray, cells: IntArray, corner_angle: float = CORNER_ANGLE
) -> FloatArray:
    """Return the unit tangents of a curve through the nodes, at both ends of every cell.

    At a node where two cells meet smoothly, both get the tangent of the circle through the three
    nodes, `(l2 t1 + l1 t2)` normalised, t and l being direction and length of the cells. At free
    ends, branching nodes and corners (a turn by more than `corner_angle`) a cell whose other end
    is smooth gets the circle's tangent by reflection, `2 (t.t1) t1 - t`, any other its own
    direction. Circular arcs and straight lines are therefore exact.

    Args:
        points: Node positions, shape (n, 3), metres.
        cells: Node indices, shape (m, 2); tangents point from the first node to the second.
        corner_angle: Largest angle of a smooth turn, radians.

    Returns:
        Tangents at first and second node of each cell, shape (m, 2, 3).
    """
    chords = points[cells[:, 1]] - points[cells[:, 0]]
    lengths = np.linalg.norm(chords, axis=1)
    chords /= lengths[:, None]
    tangents = np.repeat(chords[:, None, :], 2, axis=1)
    flat = tangents.reshape(-1, 3)

    ends = meeting_ends(cells)  # cell ends 2 c + s, two of them at each node
    # Through the node: arriving along the first cell, leaving along the second
    arrive = np.where(ends[:, 0] % 2 == 1, 1.0, -1.0)[:, None]
    leave = np.where(ends[:, 1] % 2 == 0, 1.0, -1.0)[:, None]
    t1, t2 = arrive * chords[ends[:, 0] // 2], leave * chords[ends[:, 1] // 2]
    smooth = np.einsum("ij,ij->i", t1, t2) >= np.cos(corner_angle)
    ends, t1, t2, arrive, leave = (x[smooth] for x in (ends, t1, t2, arrive, leave))
    mean = lengths[ends[:, 1] // 2][:, None] * t1 + lengths[ends[:, 0] // 2][:, None] * t2
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    flat[ends[:, 0]], flat[ends[:, 1]] = arrive * mean, leave * mean

    known = np.zeros((len(cells), 2), dtype=bool)
    known.reshape(-1)[ends] = True
    for side in (0, 1):
        one_sided = known[:, 1 - side] & ~known[:, side]
        t, chord = tangents[one_sided, 1 - side], chords[one_sided]
        tangents[one_sided, side] = 2.0 * dot(t, chord) * chord - t
    return tangents


def section_frames(
    points: FloatArray,
    cells: IntArray,
    orientation: Orientation = None,
    corner_angle: float = CORNER_ANGLE,
) -> FloatArray:
    """Return the section frames at both ends of every cell.

    e1 is the tangent (`node_tangents`). e2 is the part of the orientation vector normal to it;
    without one, frames are carried along each line with no rotation about the tangent (double
    reflection, Wang et al. 2008, doi:10.1145/1330511.1330513; across corners by the smallest
    rotation), starting from e2 horizontal, i.e. along `ez x e1`, or near ey where the line is
    vertical. Branches continue the frame of the line they start from. On closed lines that are
    not plane the two frames at the seam may differ by a rotation about the tangent.

    Args:
        points: Node positions, shape (n, 3), metres.
        cells: Node indices of one body, shape (m, 2).
        orientation: Approximate direction of e2 in inertial axes: a vector, or a function of
            points (k, 3) that returns vectors (k, 3); None for rotation-minimising frames.
        corner_angle: Largest angle of a smooth turn, radians.

    Returns:
        Rotation matrices [e1 e2 e3] (columns) at first and second node, shape (m, 2, 3, 3).

    Raises:
        TypeError: The orientation does not consist of numbers.
        ValueError: The orientation has the wrong shape, is not finite, or is parallel to the
            tangent somewhere.
    """
    e1 = node_tangents(points, cells, corner_angle)
    if orientation is None:
        e2 = _rotation_minimising(points, cells, e1)
    else:
        e2 = projected(_orientation_vectors(points, cells, orientation), e1, points[cells])
    return _completed(e1, e2)


def frames_of_lines(
    points: FloatArray, lines: Sequence[IntArray], orientations: Sequence[Orientation]
) -> list[FloatArray]:
    """Return the section frames of each of many lines that have no node in common.

    Lines with an orientation are done at once: a call for each takes as long as some hundred cells.

    Args:
        points: Node positions, shape (n, 3), metres.
        lines: Node indices of the cells of each line, shape (m, 2).
        orientations: That of each line, see `section_frames`.

    Returns:
        What `section_frames` returns, for each line.

    Raises:
        TypeError: See `section_frames`, of any of the lines.
        ValueError: Likewise.
    """
    given = list(zip(lines, orientations, strict=True))
    oriented = [(line, one) for line, one in given if one is not None]
    done = iter(list[FloatArray]())
    if oriented:
        cells = np.concatenate([line for line, _ in oriented])
        vectors = [_orientation_vectors(points, line, one) for line, one in oriented]
        e1 = node_tangents(points, cells)
        e2 = projected(np.concatenate(vectors), e1, points[cells])
        ends = np.cumsum([len(line) for line, _ in oriented])[:-1]
        done = iter(np.split(_completed(e1, e2), ends))
    return [section_frames(points, line) if one is None else next(done) for line, one in given]


def _completed(e1: FloatArray, e2: FloatArray) -> FloatArray:
    """Return rotation matrices [e1 e2 e3] (columns)."""
    return np.stack([e1, e2, np.cross(e1, e2)], axis=-1)


def _orientation_vectors(
    points: FloatArray, cells: IntArray, orientation: npt.ArrayLike | Callable[..., npt.ArrayLike]
) -> FloatArray:
    """Return the orientation at both ends of every cell, shape (m, 2, 3)."""
    if not callable(orientation):
        vector = _checks.vector("orientation", "vector", orientation, nonzero=True)
        return np.broadcast_to(vector, (len(cells), 2, 3))
    nodes, index = np.unique(cells, return_inverse=True)
    values = _checks.array(
        "orientation", "result of the function", orientation(points[nodes]), (len(nodes), 3)
    )
    return values[index.reshape(cells.shape)]


def _rotation_minimising(points: FloatArray, cells: IntArray, tangents: FloatArray) -> FloatArray:
    """Return e2 of rotation-minimising frames at both ends of every cell, shape (m, 2, 3).

    Frames relative to an arbitrary normal at every cell end differ by one angle. Carrying that
    angle from end to end is a sum, so that a line costs no Python loop.
    """
    lines = trace_lines(cells)
    leaving: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for k, line in enumerate(lines):
        leaving[int(line.nodes[0])].append((k, 0))
        leaving[int(line.nodes[-1])].append((k, -1))
    e2 = np.empty_like(tangents)
    done = [False] * len(lines)
    for first in range(len(lines)):
        # The frame (tangent, normal) that a line takes over at one of its ends
        queue: deque[tuple[int, int, FloatArray | None]] = deque([(first, 0, None)])
        while queue:
            k, side, frame = queue.popleft()
            if done[k]:
                continue
            done[k] = True
            ends = _carry(lines[k], points, tangents, e2, side, frame)
            for node, end in zip((0, -1), ends, strict=True):
                queue.extend((j, s, end) for j, s in leaving[int(lines[k].nodes[node])])
    return e2


def _carry(
    line: Line,
    points: FloatArray,
    tangents: FloatArray,
    e2: FloatArray,
    side: int,
    frame: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Fill `e2` along one line and return (tangent, e2) at its two ends, each of shape (2, 3).

    `frame` is the (tangent, e2) to start from at the line's first (side 0) or last (-1) node.
    """
    sides = np.where(line.reversed[:, None], [1, 0], [0, 1])
    sign = np.where(line.reversed, -1.0, 1.0)[:, None, None]
    t = sign * tangents[line.cells[:, None], sides]  # (k, 2, 3), along the line
    normals = any_normal(t)
    # Inside a cell by double reflection, from one cell to the next by the smallest rotation
    chord = np.diff(points[line.nodes], axis=0)
    mirrored = reflect(t[:, 0], chord)
    inside = reflect(reflect(normals[:, 0], chord), t[:, 1] - mirrored)
    across = turn(normals[:-1, 1], t[:-1, 1], t[1:, 0])
    steps = np.zeros((len(t), 2))
    steps[:, 1] = angle_about(inside, normals[:, 1], t[:, 1])
    steps[1:, 0] = angle_about(across, normals[1:, 0], t[1:, 0])
    angle = np.cumsum(steps.ravel()).reshape(steps.shape)
    if frame is not None:
        end = (side, side)  # first end of the first cell or second end of the last
        start = turn(frame[1], frame[0], t[end])
        angle += angle_about(start, normals[end], t[end]) - angle[end]
    normal = np.cos(angle)[..., None] * normals + np.sin(angle)[..., None] * np.cross(t, normals)
    e2[line.cells[:, None], sides] = normal
    return np.stack([t[0, 0], normal[0, 0]]), np.stack([t[-1, -1], normal[-1, -1]])
