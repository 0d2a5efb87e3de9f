# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines attached to rigid and floating bodies, as elements with cubic functions."""

import numpy as np
from numpy.polynomial import chebyshev

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Carrier
from flexfem.core.places.body_points import POWERS
from flexfem.core.places.line_points import BODY
from flexfem.layout.lines import Line
from flexfem.lie import so3
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.reduction.body_line import rest_axes

__all__ = ["floating_line", "rigid_line"]

#: Chebyshev points for the speed along an element.
_SAMPLES = 10


def rigid_line(kind: int, number: int, carrier: Carrier) -> Line:
    """Line through points of a rigid body.

    Args:
        kind: block of the rigid bodies.
        number: of the body in it.
        carrier: marker of the body and its points.
    """
    points = np.asarray(carrier.line)
    none = np.empty((len(points), 3, 0))
    return _line(kind, np.array([number]), points, none, none)


def floating_line(kind: int, first: int, body: FloatingBody, carrier: Carrier) -> Line:
    """Line of a body in a floating frame; the frame must be that of an interface.

    Args:
        kind: block of the bodies in floating frames.
        first: number of the body's first node in it, that of the frame.
        body: the body.
        carrier: marker of the body and its line.
    """
    line = body.reduced.lines[str(carrier.line)]
    own, inner = body.coordinates, 3 * body.amplitude_nodes
    count, size = 6 * len(body.relative), body.reduced.size
    beside = body.reduced.functions - size
    nonlinear = body.reduced.polynomial is not None
    width = count + inner + beside + (1 if nonlinear else 0)  # see core.places.body_points
    moves, turns = np.zeros((2, len(line.points), 3, width))
    for values, functions in ((moves, line.displacement), (turns, line.rotation)):
        values[..., : len(own)] = functions[..., own]
        values[..., count + inner : count + inner + beside] = functions[..., size:]
    points = line.points - body.origin
    # coordinates of interfaces are their positions, not their displacements
    for i, place in enumerate(body.places[1:] - body.origin):
        points = points - moves[..., 6 * i : 6 * i + 3] @ place
    rest = line.points - body.origin
    nodes = first + np.arange(body.nodes)
    return _line(kind, nodes, rest, moves, turns, points)


def _line(
    kind: int, nodes: IntArray, rest: FloatArray, moves: FloatArray, turns: FloatArray,
    free: FloatArray | None = None,
) -> Line:  # fmt: skip
    """Cubic spline through points (p, 3) ``rest``, their motion and rotation (p, 3, n).

    ``free`` (p, 3) are the positions where all coordinates are zero, ``rest`` if not given.
    """
    from scipy.interpolate import CubicSpline

    lengths = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(lengths)])
    curve = CubicSpline(way, rest)
    q = _quaternions(rest_axes(curve(way, 1)))
    p, _, n = moves.shape
    values = np.zeros((p, 1 + n, 7))
    values[:, 0, :3], values[:, 0, 3:] = rest if free is None else free, q
    values[:, 1:, :3] = moves.transpose(0, 2, 1)
    half, scalar, vector = 0.5 * turns.transpose(0, 2, 1), q[:, :1], q[:, np.newaxis, 1:]
    values[:, 1:, 3] = -(half * vector).sum(axis=2)
    values[:, 1:, 4:] = scalar[:, np.newaxis] * half + np.cross(half, vector)
    # highest power of the arc length first
    powers = CubicSpline(way, values).c[::-1] * lengths[:, np.newaxis, np.newaxis] ** (
        np.arange(POWERS).reshape(-1, 1, 1, 1)
    )
    shape = np.moveaxis(powers, 0, -1).reshape(p - 1, 1 + n, 7 * POWERS)
    angle = np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    xi = 0.5 * (1.0 + np.cos(angle))
    at = way[:-1, np.newaxis] + lengths[:, np.newaxis] * xi
    speeds = np.linalg.norm(curve(at, 1), axis=-1) * lengths[:, np.newaxis]
    arc = np.array([_integral(row, angle) for row in speeds])
    whole = arc.sum(axis=1)
    return Line(
        kind=kind,
        nodes=np.tile(nodes.astype(np.int64), (p - 1, 1)),
        cells=np.zeros(p - 1, dtype=np.int64),
        shape=np.ascontiguousarray(shape),
        turns=None,
        starts=np.cumsum(whole) - whole,
        arc=arc,
        element=BODY,
    )


def _quaternions(axes: FloatArray) -> FloatArray:
    """Unit quaternions (p, 4) of matrices, with signs that make neighbours close to each other."""
    turn = 0.5 * so3.log(axes)
    angle = np.linalg.norm(turn, axis=1)[:, np.newaxis]
    q = np.concatenate([np.cos(angle), np.sinc(angle / np.pi) * turn], axis=1)
    signs = np.where((q[:-1] * q[1:]).sum(axis=1) < 0.0, -1.0, 1.0)
    q[1:] *= np.cumprod(signs)[:, np.newaxis]
    return q


def _integral(speeds: FloatArray, angle: FloatArray) -> FloatArray:
    """Arc length in powers of xi from the speeds at the Chebyshev points of [0, 1]."""
    count = len(angle)
    series = np.cos(np.outer(np.arange(count), angle)) @ speeds * (2.0 / count)
    series[0] *= 0.5
    series[np.abs(series) < 1e-15 * series[0]] = 0.0
    integral = chebyshev.Chebyshev(series, domain=[0.0, 1.0]).integ(lbnd=0.0)
    powers = integral.convert(kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1])
    out = np.zeros(count + 1)
    out[: len(powers.coef)] = powers.coef
    return out
