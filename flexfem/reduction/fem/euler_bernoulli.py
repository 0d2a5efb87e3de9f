# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of Euler–Bernoulli beam elements with all their coordinates, as textbooks have them.

In an element displacements along the axis and twists are linear, transverse displacements cubic
(Hermite), and sections stay perpendicular to the axis: matrices are the classic ones of frames in
space (J. S. Przemieniecki, Theory of Matrix Structural Analysis (1968), sections 5.6 and 11.6).
"""

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy.linalg

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.materials.section import Section
from flexfem.reduction.fem.beam import mass_points
from flexfem.reduction.fem.prepare import without_rigid_forces
from flexfem.reduction.reduced_body import Interface, Recovery, ReducedBody

__all__ = ["euler_bernoulli_body"]

#: Points and weights on [0, 1] that integrate products of three cubics' derivatives exactly.
_GAUSS = np.polynomial.legendre.leggauss(4)
#: Straight pieces that show an element.
_PIECES = 4


def euler_bernoulli_body(
    nodes: npt.ArrayLike,
    section: Section,
    interfaces: Mapping[str, int],
    *,
    orientation: npt.ArrayLike,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    name: str = "beam",
) -> ReducedBody:
    """Data of a body of Euler–Bernoulli beam elements, none of whose coordinates is left out.

    Its amplitudes are all modes with the interfaces at rest, so that with one element after the
    other along a line, and the frame of the first node, it is the classic finite-element model of a
    link in a floating frame. Elements are linear: a body does not get shorter as it bends, and has
    no data for geometric stiffening (``reduce_body`` of a ``beam_body`` has).

    Args:
        nodes: (n, 3) that elements join one after the other, body axes, m.
        section: linear section of all elements; its shear stiffness does not count.
        interfaces: numbers of nodes by the names of their frames, at least one.
        orientation: (3,) approximate direction of the section's e2.
        comm: communicator whose ranks share the pictures.
        name: for messages.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: fewer than two nodes or equal neighbours, an element along the orientation, a
            section with a law of its own, without mass or with an inertia that masses cannot have,
            no interface, or one at a node that there is not or that another one has.
    """
    owner = f'euler_bernoulli_body "{name}"'
    _checks.instance(owner, "section", section, Section)
    if section.stiffness is None:
        raise ValueError(f"{owner}: the section must be linear, not have a law of its own")
    points = mass_points(owner, section.inertia)
    x, axes = _elements(owner, nodes, orientation)
    outer = _outer(owner, interfaces, len(x))
    inner = np.setdiff1d(np.arange(len(x)), outer)
    nodal, weights, stiffness = _fields(x, axes, section, points)
    own = (6 * np.concatenate([outer, inner])[:, np.newaxis] + np.arange(6)).ravel()
    own_stiffness, moved = stiffness[np.ix_(own, own)], nodal[:, :, 1 + own]
    k = 6 * len(outer)
    functions, frequencies = _functions(
        own_stiffness, np.einsum("q,qai,qaj->ij", weights, moved, moved, optimize=True), k
    )
    fields = np.concatenate([nodal[:, :, :1], moved @ functions], axis=2)
    reduced = functions.T @ own_stiffness @ functions
    reduced[:k, k:] = reduced[k:, :k] = 0.0  # static functions do no work on amplitudes
    frames = tuple(Interface(key, x[node]) for key, node in interfaces.items())
    held = np.zeros(k, dtype=np.bool_)
    shown = np.zeros_like(functions)
    shown[own] = functions
    return ReducedBody(
        frames,
        section.mass_per_length * float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()),
        np.tensordot(weights, fields, 1),
        _products(fields, weights),
        without_rigid_forces(0.5 * (reduced + reduced.T), frames, held),
        np.zeros_like(reduced),
        held,
        frequencies,
        recovery=_recovery(x, axes, shown, comm),
    )


def _elements(
    owner: str, nodes: npt.ArrayLike, orientation: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Nodes (n, 3) and the sections' axes (n - 1, 3, 3) in columns."""
    x = _checks.array(owner, "nodes", nodes, (-1, 3))
    along = np.diff(x, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    if not len(along) or not (lengths > 0.0).all():
        raise ValueError(f"{owner}: nodes must be at least two, neighbours at different places")
    direction = _checks.vector(owner, "orientation", orientation, nonzero=True)
    e1 = along / lengths[:, np.newaxis]
    e3 = np.cross(e1, direction)
    sizes = np.linalg.norm(e3, axis=1)
    if not (sizes > 1e-8 * np.linalg.norm(direction)).all():
        raise ValueError(
            f"{owner}: orientation must not be along an element, got {_checks.show(orientation)}"
        )
    e3 /= sizes[:, np.newaxis]
    return x, np.stack([e1, np.cross(e3, e1), e3], axis=-1)


def _outer(owner: str, interfaces: Mapping[str, int], count: int) -> IntArray:
    """Nodes of the interfaces."""
    if not isinstance(interfaces, Mapping):
        raise TypeError(f"{owner}: interfaces must be a dictionary, got {_checks.show(interfaces)}")
    if not interfaces:
        raise ValueError(f"{owner}: interfaces must hold at least one node, got none")
    found: list[int] = []
    for key, node in interfaces.items():
        _checks.text(owner, "name of an interface", key)
        if isinstance(node, bool) or not isinstance(node, (int, np.integer)):
            raise TypeError(f'{owner}: node of "{key}" must be a number, got {_checks.show(node)}')
        if not 0 <= node < count:
            raise ValueError(f'{owner}: node of "{key}" must lie in [0, {count - 1}], got {node}')
        found.append(int(node))
    if len(set(found)) < len(found):
        raise ValueError(f"{owner}: nodes of interfaces must differ, got {found}")
    return np.array(found, dtype=np.int64)


def _shapes(xi: float, length: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Displacement (3, 12), rotation (3, 12) and strains (6, 12) by an element's unknowns.

    Those are displacement and rotation of the first and of the second node, section axes.
    """
    u, theta, strain = np.zeros((3, 12)), np.zeros((3, 12)), np.zeros((6, 12))
    u[0, [0, 6]] = theta[0, [3, 9]] = 1.0 - xi, xi
    strain[0, [0, 6]] = strain[3, [3, 9]] = -1.0 / length, 1.0 / length
    # by displacement and slope at either end: values, slopes and curvatures
    values = [
        1.0 - 3.0 * xi**2 + 2.0 * xi**3, length * xi * (1.0 - xi) ** 2,
        3.0 * xi**2 - 2.0 * xi**3, length * xi**2 * (xi - 1.0),
    ]  # fmt: skip
    slopes = [
        6.0 * xi * (xi - 1.0) / length, (1.0 - xi) * (1.0 - 3.0 * xi),
        6.0 * xi * (1.0 - xi) / length, xi * (3.0 * xi - 2.0),
    ]  # fmt: skip
    curvatures = [
        (12.0 * xi - 6.0) / length**2, (6.0 * xi - 4.0) / length,
        (6.0 - 12.0 * xi) / length**2, (6.0 * xi - 2.0) / length,
    ]  # fmt: skip
    # along e2 the slope is the rotation about e3, along e3 minus that about e2
    for row, turn, sign in ((1, 2, 1.0), (2, 1, -1.0)):
        at = [row, 3 + turn, 6 + row, 9 + turn]
        signs = np.array([1.0, sign, 1.0, sign])
        u[row, at] = signs * values
        theta[turn, at] = sign * signs * slopes
        strain[3 + turn, at] = sign * signs * curvatures
    return u, theta, strain


def _fields(
    x: FloatArray, axes: FloatArray, section: Section, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places and displacements (q, 3, 1 + n) of masses by nodal unknowns, masses (q,), stiffness.

    The masses are points of sections at the points of Gauss.
    """
    n, count = 6 * len(x), len(points) * len(_GAUSS[0])
    fields, weights = np.zeros((count * len(axes), 3, n + 1)), np.empty(count * len(axes))
    stiffness, q = np.zeros((n, n)), 0
    for e, R in enumerate(axes):
        length = float(np.linalg.norm(x[e + 1] - x[e]))
        own = slice(6 * e, 6 * e + 12)
        turned = np.kron(np.eye(4), R.T)  # unknowns in section axes
        for xi, weight in zip(0.5 * (1.0 + _GAUSS[0]), 0.5 * length * _GAUSS[1], strict=True):
            u, theta, strain = _shapes(float(xi), length)
            strain = strain @ turned
            stiffness[own, own] += weight * strain.T @ section.stiffness @ strain
            for place in points:
                fields[q, :, 0] = x[e] + xi * (x[e + 1] - x[e]) + R @ place
                across = np.cross(theta.T, place).T
                fields[q, :, 1 + 6 * e : 13 + 6 * e] = R @ (u + across) @ turned
                weights[q] = weight * section.mass_per_length / len(points)
                q += 1
    return fields, weights, stiffness


def _products(fields: FloatArray, weights: FloatArray) -> FloatArray:
    """Integrals (3, 3, n + 1, n + 1), symmetric and positive semidefinite to the last digit."""
    count = fields.shape[2]
    rows = (np.sqrt(weights)[:, np.newaxis, np.newaxis] * fields).reshape(len(weights), -1)
    products: FloatArray = (rows.T @ rows).reshape(3, count, 3, count).transpose(0, 2, 1, 3).copy()
    return products


def _functions(stiffness: FloatArray, mass: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    """Static functions of k unknowns at interfaces, then modes with these at rest (n, n).

    Also the angular frequencies of the modes, rad/s.
    """
    n = len(stiffness)
    functions = np.eye(n)
    if n == k:
        return functions, np.zeros(0)
    functions[k:, :k] = -np.linalg.solve(stiffness[k:, k:], stiffness[k:, :k])
    squares, functions[k:, k:] = scipy.linalg.eigh(stiffness[k:, k:], mass[k:, k:])
    return functions, np.sqrt(squares)


def _recovery(
    x: FloatArray, axes: FloatArray, functions: FloatArray, comm: MPI.Intracomm
) -> Recovery:
    """This rank's part of the axis, each element in some straight pieces."""
    points: list[FloatArray] = []
    cells: list[tuple[int, int]] = []
    moves: list[FloatArray] = []
    for e in np.array_split(np.arange(len(axes)), comm.size)[comm.rank]:
        length, turned = float(np.linalg.norm(x[e + 1] - x[e])), np.kron(np.eye(4), axes[e].T)
        for k in range(_PIECES + 1):
            xi = k / _PIECES
            if k:
                cells.append((len(points) - 1, len(points)))
            points.append(x[e] + xi * (x[e + 1] - x[e]))
            u = axes[e] @ _shapes(xi, length)[0] @ turned
            moves.append(u @ functions[6 * e : 6 * e + 12])
    n = functions.shape[1]
    return Recovery(
        np.array(points).reshape(-1, 3), np.array(cells, dtype=np.int64).reshape(-1, 2),
        np.array(moves).reshape(-1, 3, n),
    )  # fmt: skip
