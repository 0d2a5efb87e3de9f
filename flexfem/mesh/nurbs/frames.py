# SPDX-License-Identifier: LGPL-3.0-or-later
"""Section frames along NURBS curves, and the frames of their control points."""

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.frames import CORNER_ANGLE, Orientation, section_frames
from flexfem.mesh.geometry.normals import angle_about, any_normal, projected, reflect
from flexfem.mesh.nurbs.basis import greville, power_table, rational
from flexfem.mesh.nurbs.checks import OWNER
from flexfem.mesh.nurbs.elements import evaluate

if TYPE_CHECKING:
    from flexfem.mesh.nurbs.curve import NurbsCurve

# Angle of the tangent at a knot, radians, above which it is a corner (degree 2 and higher)
_KINK = np.deg2rad(1.0)
# Steps of an element when a normal is carried along the curve: the error of the double
# reflection falls with their fourth power
_STEPS = 32
# Chords shorter than this, relative to the curve's size, have no direction but round-off's
_SHORT = 1e-6
# Distances of control points from a straight line, relative to their coordinates, that are taken
# for rounding errors
_ROUND_OFF = 1e-14
# The frames of the control points are found when the rotations differ by less, radians
_TOLERANCE = 1e-13
_ITERATIONS = 60
# Frames of curves, with the direction for which they are: models are validated before they are
# numbered, and once more where a run is set up
_KNOWN: WeakKeyDictionary["NurbsCurve", tuple[object, FloatArray]] = WeakKeyDictionary()


def section_rotations(
    curve: "NurbsCurve", u: npt.ArrayLike, orientation: Orientation = None
) -> FloatArray:
    """Return the section frames of a smooth curve at given parameters.

    e1 is the tangent, e2 the part of the orientation vector normal to it. Without one, e2 is
    carried along the curve with no rotation about the tangent (double reflection, Wang et al.
    2008, doi:10.1145/1330511.1330513), starting horizontally, or near ey where the curve starts
    vertically.

    Args:
        curve: The curve, of degree 2 at least where it is not straight.
        u: Parameters in rising order, shape (n,).
        orientation: Approximate direction of e2 in inertial axes: a vector, or a function of
            points (k, 3) that returns vectors (k, 3); None for rotation-minimising frames.

    Returns:
        Rotation matrices [e1 e2 e3] (columns), shape (n, 3, 3).

    Raises:
        TypeError: the orientation does not consist of numbers.
        ValueError: the curve has a corner, or the orientation has the wrong shape, is not finite,
            or is parallel to the tangent somewhere.
    """
    places = np.asarray(u, dtype=np.float64)
    if not callable(orientation) and (axis := _straight(curve)) is not None:
        return np.repeat(_axes(curve.points[:1], axis, orientation), len(places), axis=0)
    refuse_corners(curve)
    if orientation is None:
        e1, e2 = _carried(curve, places)
        return np.stack([e1, e2, np.cross(e1, e2)], axis=-1)
    return _axes(curve.position(places), _tangents(curve, places), orientation)


def _straight(curve: "NurbsCurve") -> FloatArray | None:
    """Direction (1, 3) of a straight curve that never turns back; None for all others."""
    points = curve.points
    steps, chord = np.diff(points, axis=0), points[-1] - points[0]
    length = np.linalg.norm(chord)
    if length == 0.0:
        return None
    axis = chord / length
    forth = steps @ axis
    beside = np.abs(points - points[0] - np.outer((points - points[0]) @ axis, axis)).max()
    straight = forth.min() > 0.0 and beside <= _ROUND_OFF * np.abs(points).max()
    return axis[np.newaxis] if straight else None


def _axes(x: FloatArray, e1: FloatArray, orientation: Orientation) -> FloatArray:
    """Frames (n, 3, 3) of tangents at points, e2 near the orientation, horizontal without one."""
    if orientation is None:
        e2 = any_normal(e1)
    elif callable(orientation):
        what = "result of the function"
        e2 = projected(_checks.array("orientation", what, orientation(x), (len(x), 3)), e1, x)
    else:
        vector = _checks.vector("orientation", "vector", orientation, nonzero=True)
        e2 = projected(np.broadcast_to(vector, x.shape), e1, x)
    return np.stack([e1, e2, np.cross(e1, e2)], axis=-1)


def control_rotations(curve: "NurbsCurve", orientation: Orientation = None) -> FloatArray:
    """Return the section frames of the control points.

    They are those at the Greville abscissae; with degree 1, those of the polygon's corners as in
    `flexfem.mesh.geometry.frames.section_frames`. Needs no compiled code.

    Args:
        curve: The curve.
        orientation: As for `section_rotations`.

    Returns:
        Rotation matrices, shape (n, 3, 3).

    Raises:
        TypeError: as for `section_rotations`.
        ValueError: as for `section_rotations`.
    """
    if callable(orientation):
        return _control_rotations(curve, orientation)
    direction = None if orientation is None else tuple(np.ravel(orientation).tolist())
    known = _KNOWN.get(curve)
    if known is None or known[0] != direction:
        rotations = _control_rotations(curve, orientation)
        rotations.setflags(write=False)
        known = _KNOWN[curve] = direction, rotations
    return known[1]


def _control_rotations(curve: "NurbsCurve", orientation: Orientation) -> FloatArray:
    """See :func:`control_rotations`."""
    if curve.degree > 1:
        return section_rotations(curve, greville(curve.degree, curve.knots), orientation)
    refuse_corners(curve)
    cells = curve.elements.nodes
    frames = section_frames(curve.points, cells, orientation)
    return np.concatenate([frames[:, 0], frames[-1:, 1]])


def control_frames(
    curve: "NurbsCurve", orientation: Orientation = None, vectors: bool = False,
    twists: FloatArray | None = None,
) -> FloatArray:  # fmt: skip
    """Return frames of the control points whose interpolation gives the section frames.

    In an element rotations are interpolated by the sum of the control points' unit quaternions,
    normalised (see `flexfem.forms.nurbs_beam`), or by relative rotation vectors. The frames R_I
    make this the section frame at the Greville abscissa of every control point; they are found by
    corrections with the matrix N_I at these places, which would be exact if rotations were numbers.

    Args:
        curve: The curve.
        orientation: As for `section_rotations`.
        vectors: True if relative rotation vectors are interpolated.
        twists: Angles of the section axes about e1 at the Greville abscissae, shape (n,), radians;
            None for zero.

    Returns:
        Frames [x, R row by row], shape (n, 12), x the control points.

    Raises:
        TypeError: as for `section_rotations`.
        ValueError: as for `section_rotations`, or the frames rotate too much inside an element.
    """
    from flexfem.lie import so3

    wanted = control_rotations(curve, orientation)
    if twists is not None:
        wanted = wanted @ so3.exp(np.outer(twists, np.eye(3)[0]))
    rotations = wanted if curve.degree == 1 else _control_points(curve, wanted, vectors)
    return np.concatenate([curve.points, rotations.reshape(-1, 9)], axis=1)


def refuse_corners(curve: "NurbsCurve") -> None:
    """Check that the tangent has a kink at no knot.

    Section frames follow the tangent, and at a corner there are two of them. With degree 1 turns
    up to `flexfem.mesh.geometry.frames.CORNER_ANGLE` are those of a smooth curve's polygon.

    Raises:
        ValueError: the curve has a corner.
    """
    parts = curve.elements
    before, after = _unit_slopes(curve, parts.spans[1:, 0])
    turns = np.arctan2(
        np.linalg.norm(np.cross(before, after), axis=1), np.einsum("ij,ij->i", before, after)
    )
    limit = CORNER_ANGLE if curve.degree == 1 else _KINK
    if turns.max(initial=0.0) > limit:
        worst = int(np.argmax(turns))
        raise ValueError(
            f"{OWNER}: the curve turns by {np.rad2deg(turns[worst]):.3g} degrees at parameter "
            f"{parts.spans[worst + 1, 0]:g}, cut it there and join the bodies"
        )


def interpolated_rotations(
    curve: "NurbsCurve", rotations: FloatArray, index: IntArray, xi: FloatArray,
    vectors: bool = False,
) -> FloatArray:  # fmt: skip
    """Return the interpolated rotations at one place in each of the given elements.

    Args:
        curve: The curve.
        rotations: Rotation matrices of the control points, shape (n, 3, 3).
        index: Elements, shape (k,).
        xi: Places in them, shape (k,).
        vectors: As for `control_frames`.

    Returns:
        Rotation matrices, shape (k, 3, 3).
    """
    from flexfem.lie import so3

    nodes = curve.elements.nodes[index]
    R = rotations[nodes[:, nodes.shape[1] // 2]]
    theta = so3.log(np.swapaxes(R, 1, 2)[:, None] @ rotations[nodes])
    functions = _functions(curve, index, xi)
    if vectors:
        return np.asarray(R @ so3.exp(np.einsum("nI,nIi->ni", functions, theta)))
    half = 0.5 * np.linalg.norm(theta, axis=-1)
    scalar = np.einsum("nI,nI->n", functions, np.cos(half))
    vector = 0.5 * np.einsum("nI,nI,nIi->ni", functions, np.sinc(half / np.pi), theta)
    size = np.linalg.norm(vector, axis=-1)
    # rotation vector over the quaternion's vector part
    factor = 2.0 / scalar
    np.divide(2.0 * np.arctan2(size, scalar), size, out=factor, where=size > 0.0)
    return np.asarray(R @ so3.exp(factor[:, None] * vector))


def _control_points(curve: "NurbsCurve", wanted: FloatArray, vectors: bool) -> FloatArray:
    """Return rotations of the control points that give the wanted ones by interpolation."""
    from scipy import sparse
    from scipy.sparse.linalg import splu

    from flexfem.lie import so3

    if (wanted == wanted[0]).all():
        return wanted  # those of straight curves
    index, xi = curve.places(greville(curve.degree, curve.knots))
    nodes = curve.elements.nodes[index]
    rows = np.repeat(np.arange(len(nodes)), nodes.shape[1])
    entries = _functions(curve, index, xi).ravel(), (rows, nodes.ravel())
    factor = splu(sparse.csc_array(entries, shape=(len(nodes), len(nodes))))
    rotations = wanted
    for _ in range(_ITERATIONS):
        now = interpolated_rotations(curve, rotations, index, xi, vectors)
        missing = so3.log(np.swapaxes(now, 1, 2) @ wanted)
        if np.abs(missing).max() < _TOLERANCE:
            return rotations
        rotations = rotations @ so3.exp(factor.solve(missing))
    raise ValueError(
        f"{OWNER}: the frames rotate too much inside the element at parameter "
        f"{curve.elements.spans[index[int(np.argmax(np.abs(missing).max(axis=1)))], 0]:g}, "
        "refine the curve"
    )


def _functions(curve: "NurbsCurve", index: IntArray, xi: FloatArray) -> FloatArray:
    """Return the shape functions at one place in each of the given elements, shape (k, p + 1)."""
    powers = power_table(curve.degree + 1, xi, 0)
    weighted = np.einsum("dkj,kIj->dkI", powers, curve.elements.shape[index])
    functions: FloatArray = rational(weighted)[0]
    return functions


def _unit_slopes(curve: "NurbsCurve", u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit tangents on both sides of parameters (n,), shape (n, 3) each."""
    parts = curve.elements
    after, xi = curve.places(u)
    first = (xi == 0.0) & (after > 0)
    before, xi_before = np.where(first, after - 1, after), np.where(first, 1.0, xi)
    left = evaluate(parts, curve.points, before, xi_before, 1)[1]
    right = evaluate(parts, curve.points, after, xi, 1)[1]
    left /= np.linalg.norm(left, axis=1)[:, None]
    right /= np.linalg.norm(right, axis=1)[:, None]
    return left, right


def _tangents(curve: "NurbsCurve", u: FloatArray) -> FloatArray:
    """Return the unit tangents at parameters (n,), the mean at a knot, shape (n, 3)."""
    mean = np.add(*_unit_slopes(curve, u))
    result: FloatArray = mean / np.linalg.norm(mean, axis=1)[:, None]
    return result


def _carried(curve: "NurbsCurve", u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return e1 and e2 of rotation-minimising frames at parameters (n,), shape (n, 3) each.

    Frames relative to an arbitrary normal at every place differ by one angle, whose steps add up.
    """
    spans = curve.elements.spans
    inside = np.linspace(0.0, 1.0, _STEPS, endpoint=False)
    grid = np.append(spans[:, :1] + np.diff(spans) * inside, [spans[-1, 1], *u])
    grid, back = np.unique(grid, return_inverse=True)
    x, t = curve.position(grid), _tangents(curve, grid)
    normals = any_normal(t)
    chords = np.diff(x, axis=0)
    # places may differ by round-off only, and the chord of a short step is along both tangents
    short = np.linalg.norm(chords, axis=1) < _SHORT * np.ptp(x, axis=0).max()
    chords[short] = t[:-1][short] + t[1:][short]
    moved = reflect(reflect(normals[:-1], chords), t[1:] - reflect(t[:-1], chords))
    angle = np.append(0.0, np.cumsum(angle_about(moved, normals[1:], t[1:])))[:, None]
    e2 = np.cos(angle) * normals + np.sin(angle) * np.cross(t, normals)
    here = back[len(back) - len(u) :]
    return t[here], e2[here]
