# SPDX-License-Identifier: LGPL-3.0-or-later
"""Torsion and shear of prismatic bars after Saint-Venant, for sections without holes.

A section is a set of quadrilateral cells, with polynomials of high degree in each (spectral
elements). With the origin at the centroid:

Torsion: the warping function omega has `div (grad omega + (-z, y)) = 0` and no stress on the
boundary. Torsion constant `J = integral of |grad omega + (-z, y)|^2`; shear stress per torque
`(grad omega + (-z, y))/J`. The shear centre is that of Trefftz (1935), about which a warping
without resultants remains; its integral of the square is the warping constant.

Shear: the stress of a force along the bar's changing bending, `tau = grad chi` with
`div grad chi = -(alpha y + beta z)`, alpha and beta from the force and the second moments, and no
stress on the boundary. This is Saint-Venant's flexure without lateral contraction (nu = 0), as in
Gruttmann and Wagner (2001, doi:10.1007/s004660100239); shear factors follow from the energy.

`flexfem.sections` solves the same problems by DOLFINx for sections of any shape, with the lateral
contraction. This one stays for the profiles of `Section`: a model is built without DOLFINx, which
takes two seconds to load. A channel with sharp corners takes 0.03 s, with errors of 6e-5 of the
torsion constant and 3e-4 of the shear factors; quadratic triangles as fine take 0.2 s.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from flexfem._types import FloatArray, IntArray

__all__ = ["Cell", "SectionSolution", "solve_section"]

#: Degree of the polynomials: with cells of about a wall's thickness where stresses change, the
#: constants of rounded sections have six digits, those of sharp ones three to four.
DEGREE = 6


@dataclass(frozen=True)
class Cell:
    """A quadrilateral with anticlockwise corners, the third of whose sides may be an arc.

    Attributes:
        corners: (4, 2), m.
        centre: of the arc from the third to the fourth corner; None for a straight side.
    """

    corners: FloatArray
    centre: FloatArray | None = None


@dataclass(frozen=True)
class SectionSolution:
    """Constants of a section and the shear stresses on its boundary.

    Attributes:
        area: m^2.
        centroid: (2,) where the cells are measured, m; the origin of the other data.
        moments: (2, 2) integral of the products of y and z, m^4.
        torsion_constant: m^4.
        warping_constant: about the shear centre, m^6.
        shear_centre: (2,) m.
        shear_factors: (2, 2) matrix of the shear stiffness divided by G and the area.
        points: (k, 2) vertices of the boundary, anticlockwise, m.
        torsion: (k,) shear stress along the boundary per torque, 1/m^3.
        shear: (k, 2) the same per force along e2 and e3 through the shear centre, 1/m^2.
    """

    area: float
    centroid: FloatArray
    moments: FloatArray
    torsion_constant: float
    warping_constant: float
    shear_centre: FloatArray
    shear_factors: FloatArray
    points: FloatArray
    torsion: FloatArray
    shear: FloatArray


def solve_section(cells: Sequence[Cell]) -> SectionSolution:
    """Solve the problems of torsion and shear; cells must meet at whole sides."""
    nodes, numbers = _nodes(cells)
    base = _Basis.of(_gauss(DEGREE + 3))
    weight, _ = base.measure(nodes)
    area = float(weight.sum())
    centroid: FloatArray = np.einsum("mq,mqi->i", weight, base.at(nodes)) / area
    nodes = nodes - centroid
    weight, slope = base.measure(nodes)
    y, z = np.moveaxis(base.at(nodes), -1, 0)
    place = np.stack([y, z])
    moments: FloatArray = np.einsum("mq,imq,jmq->ij", weight, place, place)

    turned = np.stack([z, -y], axis=-1)
    loads = np.stack([
        np.einsum("mq,mqi,mqai->ma", weight, turned, slope),
        *np.einsum("mq,imq,qa->ima", weight, place, base.values),
    ])  # fmt: skip
    found = _solve(numbers, np.einsum("mq,mqai,mqbi->mab", weight, slope, slope), loads)
    warping, flexure = found[0], found[1:]
    stress = np.einsum("mqai,ma->mqi", slope, warping) - turned
    torsion_constant = float(np.einsum("mq,mqi,mqi->", weight, stress, stress))
    # of unit forces: their bending changes by the inverse second moments
    chi = np.einsum("ij,jma->ima", np.linalg.inv(moments), flexure)
    field = np.einsum("mqai,kma->kmqi", slope, chi)
    compliance = np.einsum("mq,kmqi,lmqi->kl", weight, field, field)

    omega = warping @ base.values.T
    omega -= np.einsum("mq,mq->", weight, omega) / area
    first = np.einsum("mq,mq,imq->i", weight, omega, place)
    pole = np.linalg.solve(moments, first)  # (z_P, -y_P): omega - z_P y + y_P z is left
    shear_centre = np.array([-pole[1], pole[0]])
    left = omega - np.einsum("i,imq->mq", pole, place)
    points, values = _boundary(nodes, numbers, np.concatenate([[warping], chi]))
    return SectionSolution(
        area=area,
        centroid=centroid,
        moments=moments,
        torsion_constant=torsion_constant,
        warping_constant=float(np.einsum("mq,mq,mq->", weight, left, left)),
        shear_centre=shear_centre,
        shear_factors=np.linalg.inv(compliance) / area,
        points=points,
        torsion=values[:, 0] / torsion_constant,
        shear=values[:, 1:],
    )


class _Basis:
    """Values and slopes of the polynomials of a cell at some points of the reference square.

    Attributes:
        values: (q, n) at each point.
        slopes: (2, q, n) along both directions.
    """

    def __init__(self, first: FloatArray, second: FloatArray, weights: FloatArray) -> None:
        (f, df), (s, ds) = _lagrange(first), _lagrange(second)
        count = len(first)
        self.weights = weights
        self.values = np.einsum("qi,qj->qij", f, s).reshape(count, -1)
        self.slopes = np.stack([
            np.einsum("qi,qj->qij", df, s).reshape(count, -1),
            np.einsum("qi,qj->qij", f, ds).reshape(count, -1),
        ])  # fmt: skip

    @classmethod
    def of(cls, rule: tuple[FloatArray, FloatArray]) -> "_Basis":
        """At the points of a rule in both directions."""
        x, w = rule
        first, second = np.meshgrid(x, x, indexing="ij")
        return cls(first.ravel(), second.ravel(), np.outer(w, w).ravel())

    def at(self, nodes: FloatArray) -> FloatArray:
        """Places (m, q, 2)."""
        places: FloatArray = np.einsum("qa,mai->mqi", self.values, nodes)
        return places

    def measure(self, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Area of each point (m, q), and slopes along y and z (m, q, n, 2)."""
        jacobian = np.einsum("dqa,mai->mqid", self.slopes, nodes)
        weight = self.weights * np.linalg.det(jacobian)
        return weight, np.einsum("dqa,mqdi->mqai", self.slopes, np.linalg.inv(jacobian))


@lru_cache(maxsize=1)
def _lobatto() -> FloatArray:
    """Nodes of Lobatto's rule on [-1, 1]."""
    inner = legendre.Legendre.basis(DEGREE).deriv().roots()
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])


def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    points, weights = legendre.leggauss(count)
    return points, weights


def _lagrange(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and slopes (q, n) of the polynomials that are one at one of Lobatto's nodes."""
    nodes = _lobatto()
    inverse = np.linalg.inv(legendre.legvander(nodes, DEGREE))
    values = legendre.legvander(x, DEGREE) @ inverse
    slopes = legendre.legvander(x, DEGREE - 1) @ legendre.legder(np.eye(DEGREE + 1)) @ inverse
    return values, slopes


def _nodes(cells: Sequence[Cell]) -> tuple[FloatArray, IntArray]:
    """Nodes of each cell (m, n, 2), and their numbers (m, n): one where cells meet."""
    from scipy.spatial import cKDTree

    s = 0.5 * (1.0 + _lobatto())
    u, v = (x[..., np.newaxis] for x in np.meshgrid(s, s, indexing="ij"))
    found = []
    for cell in cells:
        a, b, c, d = cell.corners
        points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
        if cell.centre is not None:  # the arc's distance from its chord, fading away from it
            from_c, from_d = c - cell.centre, d - cell.centre
            angle = np.arctan2(
                from_d[0] * from_c[1] - from_d[1] * from_c[0], from_d @ from_c
            ) * s[:, np.newaxis]  # fmt: skip
            side = np.stack([-from_d[1], from_d[0]])
            arc = cell.centre + np.cos(angle) * from_d + np.sin(angle) * side
            chord = s[:, np.newaxis] * c + (1 - s[:, np.newaxis]) * d
            points += v * (arc - chord)[:, np.newaxis]
        found.append(points.reshape(-1, 2))
    nodes = np.stack(found)
    every = nodes.reshape(-1, 2)
    # shared places are equal but for round-off
    near = cKDTree(every).query_ball_point(every, 1e-9 * np.ptp(every, axis=0).max())
    _, numbers = np.unique([min(same) for same in near], return_inverse=True)
    return nodes, numbers.reshape(nodes.shape[:2])


def _solve(numbers: IntArray, stiffness: FloatArray, loads: FloatArray) -> FloatArray:
    """Solution of each load (l, m, n), zero at the first node."""
    from scipy import sparse
    from scipy.sparse.linalg import splu

    size, n = int(numbers.max()) + 1, numbers.shape[1]
    rows, columns = np.repeat(numbers, n, axis=1), np.tile(numbers, n)
    matrix = sparse.coo_array(
        (stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)
    ).tocsc()
    right = np.stack([np.bincount(numbers.ravel(), one.ravel(), size) for one in loads], axis=1)
    solution = np.zeros_like(right)
    solution[1:] = splu(matrix[1:, 1:], permc_spec="MMD_AT_PLUS_A").solve(right[1:])
    return solution.T[:, numbers]


@dataclass(frozen=True)
class _Side:
    """A side of a cell on the boundary: places, directions and stresses at start, middle, end."""

    points: FloatArray  # (3, 2)
    tangents: FloatArray  # (3, 2)
    values: FloatArray  # (3, fields)
    bowed: bool  # whether the middle is needed


def _boundary(
    nodes: FloatArray, numbers: IntArray, fields: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vertices of the boundary (k, 2) and the stresses along it there (k, fields)."""
    n = DEGREE + 1
    corners = numbers.reshape(-1, n, n)[:, [0, -1, -1, 0], [0, 0, -1, -1]]
    following = np.roll(corners, -1, axis=1)
    inner = {(int(a), int(b)) for a, b in zip(corners.ravel(), following.ravel(), strict=True)}
    sides: dict[int, tuple[int, _Side]] = {}
    for m, side in np.ndindex(*corners.shape):
        a, b = int(corners[m, side]), int(following[m, side])
        if (b, a) not in inner:
            sides[a] = b, _side(side, nodes[m], fields[:, m])
    start = at = min(sides)
    chain: list[_Side] = []
    while not chain or at != start:
        at, one = sides[at]
        chain.append(one)
    points, values = [], []
    for before, after in zip([chain[-1], *chain[:-1]], chain, strict=True):
        points.append(after.points[0])
        values.append(_at_vertex(before, after))
        if after.bowed:
            points.append(after.points[1])
            values.append(after.values[1])
    return np.array(points), np.array(values)


def _side(number: int, nodes: FloatArray, fields: FloatArray) -> _Side:
    """One side of a cell; the first field is the warping, the others are potentials of shear."""
    s, one = np.array([-1.0, 0.0, 1.0]), np.ones(3)
    first, second = ((s, -one), (one, s), (-s, one), (-one, -s))[number]
    base = _Basis(first, second, one)
    points = base.at(nodes[np.newaxis])[0]
    _, slope = base.measure(nodes[np.newaxis])
    along = base.slopes[number % 2] * (1.0, 1.0, -1.0, -1.0)[number]
    tangents = along @ nodes
    tangents /= np.linalg.norm(tangents, axis=1)[:, np.newaxis]
    stress = np.einsum("qai,fa->qfi", slope[0], fields)
    stress[:, 0] += np.stack([-points[:, 1], points[:, 0]], axis=1)
    corner = nodes.reshape(DEGREE + 1, DEGREE + 1, 2)[[0, -1, -1, 0], [0, 0, -1, -1]]
    length, across = (
        np.linalg.norm(corner[(i + 1) % 4] - corner[i]) for i in (number, (number + 1) % 4)
    )
    bowed = tangents[0] @ tangents[2] < 1.0 - 1e-9 or length > 2.001 * across
    values: FloatArray = np.einsum("qfi,qi->qf", stress, tangents)
    return _Side(points, tangents, values, bool(bowed))


def _at_vertex(before: _Side, after: _Side) -> FloatArray:
    """Stresses where two sides meet: none in corners that stick out.

    In sharp re-entrant ones theory has no bound: there the mean of the adjacent values on both
    sides.
    """
    a, b = before.tangents[2], after.tangents[0]
    turn = float(a[0] * b[1] - a[1] * b[0])
    if turn > 1e-3:
        return np.zeros_like(after.values[0])
    at = 1 if turn < -1e-3 else 0
    mean: FloatArray = 0.5 * (before.values[2 - at] + after.values[at])
    return mean
