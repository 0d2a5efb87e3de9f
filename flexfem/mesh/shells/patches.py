# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curvatures of triangles from the positions of patches of nodes.

A triangle and the neighbours over its three edges have six nodes, which is what a complete
quadratic ``q(x, y) = [1, x, y, x^2, xy, y^2] c`` needs (Phaal, Calladine, Int. J. Numer. Methods
Eng. 35 (1992) 955-977). Its second derivatives are the curvature vectors ``k = B q`` of the
triangle, in R^3 each; along the unit normal n they are the curvatures ``n . k``. The coordinates
(x, y) are those of the nodes at the start after the neighbours have been rotated about the shared
edges into the plane of the triangle: neither bending of the start nor a kink makes a patch bad.

With these curvatures alone, deflections converge to the right limit where the mesh is, up to few
places, one of parallel diagonals. Elsewhere forces of constant moments do not cancel at the nodes,
and the shell gives way by ripples from node to node (``patch_checks``). They do cancel once both
triangles at an edge use the same slope across it: with the mean of the slopes that the
quadratics of both have at the edge's midpoint, the mean second derivatives of a triangle are

    k = 1/A sum over edges of l sym(nu (x) grad q) = B q + sum of l/(2A) nu (x) nu [slope],

[slope] being the neighbour's slope less the own, nu the outward normal and l the length of an edge.
Quadratics are still met exactly, and deflections converge to the right limit on any mesh; a
triangle then depends on the twelve nodes of its own patch and those of its neighbours. On meshes
of parallel diagonals the slopes agree and nothing changes.

The membrane's strains follow from the derivatives f of the triangle alone, or from smoothed ones,
means over the three edges of those of the triangles on both sides:
``f = f_own / 2 + sum of f_k / 6`` over the neighbours k, where all are there. A triangle then also
takes account of the change of the membrane around it (Flores, Onate, Comput. Methods Appl. Mech.
Eng. 194 (2005) 907-932, there from quadratics of the patch), which does away with most of the
stiffness of coarse meshes that bend without stretching; see ``forms.shell``.

Where a neighbour is missing, its node gives no value to interpolate:

* free, hinged: the undetermined part minimises the bending energy, so that no moment acts across
  the edge and its own curvature follows from the rest of the patch. The ghost nodes of the
  literature, wherever they lie, are eliminated to the same result. A hinge also shares the
  positions of its edge; whether the edge stays straight depends on its joints.
* clamped: the derivative of q across the edge, outwards, is a given unit vector t at the edge's
  midpoint, hence ``k = B q + S t``; t may move. Energies there have weights, see ``clamp_weights``.
* symmetric: the same, t being the normal of the plane. Positions of the edge move in the plane.
"""

import dataclasses
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Self

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.mesh.shells.patch_membrane import plane_gradients, smoothed_gradients

__all__ = ["EdgeRule", "Patches", "curvature_patches"]

# patches beyond this condition number have no digits left
_SINGULAR = 1e12
# curvatures (c_xx, c_yy, 2 c_xy) from the coefficients of the quadratic
_CURVATURE = np.zeros((3, 6))
_CURVATURE[[0, 1, 2], [3, 5, 4]] = 2.0


class EdgeRule(IntEnum):
    """Boundary condition of an edge without a neighbour."""

    FREE = 0
    CLAMPED = 1
    SYMMETRIC = 2
    HINGED = 3


@dataclass(frozen=True)
class Patches:
    """Triangles with the maps from nodal positions to derivatives, p = 6 or 12 nodes each.

    Attributes:
        nodes: the triangle's own nodes, those opposite to its edges and, for p = 12, the two others
            opposite to the edges of the neighbour over each edge; -1 if missing, (m, p).
        axes: unit vectors e1, e2 in the triangle and its normal e3 at the start, (m, 3, 3).
        areas: area at the start, m^2, (m,).
        gradients: derivatives of the three shape functions along e1 and e2, 1/m, (m, 2, 3).
        membrane: the same of all nodes for the strains of the membrane: those of the triangle, of
            three nodes, or smoothed ones of the first six, 1/m, (m, 2, 3) or (m, 2, 6).
        curvatures: B, from positions to (k_11, k_22, 2 k_12), 1/m^2, (m, 3, p); zero columns for
            missing nodes. NaN where the nodes of a patch of six lie on one conic.
        slopes: S, from the tangents of clamped edges, 1/m, (m, 3, p - 3); zero columns otherwise.
        clamps: edge numbers, 3 x triangle + edge, (m, p - 3); 0 where there is none.
        tangents: unit vectors t at the start, outwards across clamped edges, (m, 3, 3), else 0.
        conditions: condition number of the own quadratic in coordinates scaled by the size of the
            triangle, (m,); infinite where it has no solution. About 10 for good meshes.
        weights: factors of ``curvatures`` and ``slopes``, (m,).
        uniform: curvatures of a surface with uniform ones, (m, 3, 3): unit matrices but at free and
            hinged edges, where the patch has those without a moment across the edge.
    """

    nodes: IndexArray
    axes: FloatArray
    areas: FloatArray
    gradients: FloatArray
    membrane: FloatArray
    curvatures: FloatArray
    slopes: FloatArray
    clamps: IntArray
    tangents: FloatArray
    conditions: FloatArray
    weights: FloatArray
    uniform: FloatArray

    def offsets(self, tangents: FloatArray | None = None) -> FloatArray:
        """Part ``b0 = S t`` (m, 3, 3) of the curvature vectors, row by row, 1/m.

        Args:
            tangents: present unit vectors of clamped edges (m, 3, 3), None for those of the start.
        """
        vectors = (self.tangents if tangents is None else tangents).reshape(-1, 3)
        offsets: FloatArray = self.slopes @ vectors[self.clamps]
        return offsets

    def first(self, count: int) -> Self:
        """The first triangles alone, without ghosts; their tangents are still those of all."""
        fields = [field.name for field in dataclasses.fields(self) if field.name != "tangents"]
        parts = {name: getattr(self, name)[:count] for name in fields}
        return replace(self, **parts)


def curvature_patches(
    points: FloatArray,
    triangles: IndexArray,
    opposites: IndexArray,
    bending: FloatArray,
    *,
    neighbours: IndexArray | None = None,
    rules: IndexArray | None = None,
    tangents: FloatArray | None = None,
    directions: FloatArray | None = None,
    weights: FloatArray | None = None,
    smoothed: bool = False,
) -> Patches:
    """Derive the maps of triangles from the start.

    With averaged slopes, the triangles of a rank include the neighbours of its own as ghosts, and
    the points include the nodes opposite to all edges of these; see ``Patches.first``.

    Args:
        points: positions (n, 3), m.
        triangles: own nodes (m, 3), counterclockwise about the normal; edge k lies
            opposite to node k.
        opposites: node of the neighbour over edge k that is not on the edge, -1 if there is none,
            (m, 3).
        bending: bending stiffness D_b in the axes of the triangle, N m, (3, 3) or (m, 3, 3).
        neighbours: the neighbour over edge k, -1 if there is none or it is not among the
            triangles, (m, 3): slopes are averaged, patches have twelve nodes. None: they have six.
        rules: an ``EdgeRule`` for every edge without a neighbour, (m, 3); None for free edges.
        tangents: directions of the shell across clamped edges or the normals of planes of
            symmetry, (m, 3, 3), of any length and either sign; None, or 0 for an edge: in the
            plane of its triangle, perpendicular to the edge.
        directions: material directions, the projections of which are e1, (m, 3); None for the
            direction from node 0 to node 1.
        weights: factors of the maps to the curvatures, see ``clamp_weights``, (m,); None for 1.
        smoothed: derivatives for the membrane are means over the triangle and its neighbours.
    """
    corners = points[triangles]
    axes, areas = _axes(corners, directions)
    local = np.einsum("mia,mba->mib", corners - corners.mean(1)[:, None], axes[:, :2])
    sloped = np.zeros(opposites.shape, dtype=np.bool_)
    if rules is not None:
        sloped = (opposites < 0) & np.isin(rules, (EdgeRule.CLAMPED, EdgeRule.SYMMETRIC))
    around = _unfolded(points, corners, local, opposites)
    fit = _fit(local, around, opposites >= 0, sloped, bending)
    owners, places, maps = _columns(fit, local, triangles, opposites, neighbours)
    factors = np.ones(len(triangles)) if weights is None else weights
    maps *= factors[:, None, None]
    uniform = _uniform(fit, local, around, sloped, opposites, triangles, neighbours)

    # meaning of a column: the position of a node, or the tangent of an edge
    tangential = (places >= 3) & sloped[owners, np.maximum(places, 3) - 3]
    clamps = np.where(tangential, 3 * owners + places - 3, 0)
    outwards = np.einsum("mka,mab->mkb", _edge_normals(local), axes[:, :2])
    nodes = np.concatenate([triangles, opposites], 1)
    gradients = plane_gradients(local)
    return Patches(
        nodes=np.where(tangential | (places < 0), -1, nodes[owners, places]),
        axes=axes,
        areas=areas,
        gradients=gradients,
        membrane=smoothed_gradients(local, around, opposites >= 0) if smoothed else gradients,
        curvatures=np.where(tangential[:, None], 0.0, maps),
        slopes=np.where(tangential[:, None], maps, 0.0)[:, :, 3:],
        clamps=clamps[:, 3:],
        tangents=np.where(sloped[:, :, None], _oriented(tangents, outwards), 0.0),
        conditions=fit.conditions,
        weights=factors,
        uniform=uniform,
    )


def _axes(corners: FloatArray, directions: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (m, 3, 3) and areas (m,)."""
    along = corners[:, 1] - corners[:, 0]
    normal = np.cross(along, corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normal, axis=1)
    normal /= doubled[:, None]
    first = along if directions is None else directions
    first = first - np.einsum("ma,ma->m", first, normal)[:, None] * normal
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normal, first), normal], 1), doubled / 2


def _doubled(local: FloatArray) -> FloatArray:
    """Twice the areas (m,) of plane triangles (m, 3, 2)."""
    (a, b), (c, d) = (local[:, 1] - local[:, 0]).T, (local[:, 2] - local[:, 0]).T
    doubled: FloatArray = a * d - b * c
    return doubled


def _edge_normals(local: FloatArray) -> FloatArray:
    """Outward unit normals (m, 3, 2) of the edges of plane triangles (m, 3, 2)."""
    edges = np.roll(local, -2, 1) - np.roll(local, -1, 1)
    edges /= np.linalg.norm(edges, axis=2)[:, :, None]
    return np.stack([edges[:, :, 1], -edges[:, :, 0]], 2)


def _unfolded(
    points: FloatArray, corners: FloatArray, local: FloatArray, opposites: IndexArray
) -> FloatArray:
    """Coordinates (m, 3, 2) of opposite nodes, neighbours rotated into the triangle's plane."""
    start, end = np.roll(corners, -1, 1), np.roll(corners, -2, 1)
    edge = end - start
    edge /= np.linalg.norm(edge, axis=2)[:, :, None]
    away = points[opposites] - start
    along = np.einsum("mka,mka->mk", away, edge)
    height = np.linalg.norm(away - along[:, :, None] * edge, axis=2)
    normals, edges = _edge_normals(local), _tangents(local)
    places = np.roll(local, -1, 1) + along[:, :, None] * edges + height[:, :, None] * normals
    unfolded: FloatArray = places
    return unfolded


def _values(places: FloatArray) -> FloatArray:
    """Monomials (m, k, 6) at places (m, k, 2)."""
    x, y = places[:, :, 0], places[:, :, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], 2)


def _slopes(places: FloatArray, normals: FloatArray) -> FloatArray:
    """Derivatives (m, k, 6) of the monomials along unit vectors (m, k, 2)."""
    (x, y), (a, b) = np.moveaxis(places, 2, 0), np.moveaxis(normals, 2, 0)
    return np.stack([np.zeros_like(x), a, b, 2 * a * x, a * y + b * x, 2 * b * y], 2)


@dataclass(frozen=True)
class _Fit:
    """Quadratics of patches of six values: positions, or tangents of edges.

    Attributes:
        curvatures: maps to the second derivatives (m, 3, 6).
        slopes: maps to the outward slopes at the midpoints of the edges (m, 3, 6).
        conditions: condition numbers (m,).
    """

    curvatures: FloatArray
    slopes: FloatArray
    conditions: FloatArray


def _fit(
    local: FloatArray,
    around: FloatArray,
    present: BoolArray,
    sloped: BoolArray,
    bending: FloatArray,
) -> _Fit:
    """Quadratics from the coordinates of own nodes and opposite ones, (m, 3, 2) each."""
    size = np.sqrt(_doubled(local))[:, None, None]
    normals, local, around = _edge_normals(local), local / size, around / size
    across = _slopes((np.roll(local, -1, 1) + np.roll(local, -2, 1)) / 2, normals)
    rows = np.concatenate([_values(local), _values(around)], 1)
    rows[:, 3:][sloped] = across[sloped]
    known = np.concatenate([np.ones_like(sloped), present | sloped], 1)
    rows[~known] = 0.0
    maps, conditions = _coefficients(rows, known, np.broadcast_to(bending, (len(rows), 3, 3)))
    maps[:, :, 3:] *= np.where(sloped[:, None], size, 1.0)
    return _Fit(_CURVATURE @ maps / size**2, across @ maps / size, conditions)


def _coefficients(
    rows: FloatArray, known: BoolArray, bending: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Maps (m, 6, 6) from the known values to coefficients, and condition numbers (m,).

    ``rows`` (m, 6, 6) are what the values say of the coefficients; rows that are not ``known`` are
    zero. The coefficients minimise the bending energy under the others, with multipliers.
    """
    rank = known.sum(1)
    singular = np.linalg.svd(rows, compute_uv=False)
    smallest = np.take_along_axis(singular, rank[:, None] - 1, 1)[:, 0]
    conditions = np.full(len(rows), np.inf)
    np.divide(singular[:, 0], smallest, out=conditions, where=smallest > singular[:, 0] / _SINGULAR)
    maps = np.full((len(rows), 6, 6), np.nan)
    solvable = np.isfinite(conditions)

    full = solvable & (rank == 6)
    maps[full] = np.linalg.inv(rows[full])
    part = np.flatnonzero(solvable & (rank < 6))
    system = np.zeros((len(part), 12, 12))
    scale = np.trace(bending[part], axis1=1, axis2=2)[:, None, None]
    system[:, :6, :6] = _CURVATURE.T @ (bending[part] / scale) @ _CURVATURE
    system[:, :6, 6:] = np.swapaxes(rows[part], 1, 2)
    system[:, 6:, :6] = rows[part]
    diagonal = np.arange(6)
    system[:, 6 + diagonal, 6 + diagonal] = ~known[part]
    given = np.zeros((len(part), 12, 6))
    given[:, 6 + diagonal, diagonal] = known[part]
    maps[part] = np.linalg.solve(system, given)[:, :6]
    return maps, conditions


def _slope_weights(local: FloatArray) -> FloatArray:
    """Weights (m, 3, 3) of the jumps of slopes at the edges in the curvatures."""
    lengths = np.linalg.norm(np.roll(local, -2, 1) - np.roll(local, -1, 1), axis=2)
    a, b = np.moveaxis(_edge_normals(local), 2, 0)
    weights: FloatArray = np.stack([a * a, b * b, 2 * a * b], 2)
    weights *= (lengths / _doubled(local)[:, None])[:, :, None]
    return weights


def _facing(
    triangles: IndexArray, opposites: IndexArray, neighbours: IndexArray, k: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Triangles with a neighbour over their edge k, the neighbour, and its number of that edge."""
    own = np.flatnonzero(neighbours[:, k] >= 0)
    other = neighbours[own, k].astype(np.int64)
    return own, other, np.argmax(triangles[other] == opposites[own, k, None], 1)


def _uniform(
    fit: _Fit, local: FloatArray, around: FloatArray, sloped: BoolArray, opposites: IndexArray,
    triangles: IndexArray, neighbours: IndexArray | None,
) -> FloatArray:  # fmt: skip
    """Curvatures (m, 3, 3) that the maps find on surfaces with unit curvatures."""
    unit = _CURVATURE.T / 4.0  # coefficients of quadratics with one curvature each
    middles = (np.roll(local, -1, 1) + np.roll(local, -2, 1)) / 2
    across = _slopes(middles, _edge_normals(local)) @ unit
    outer = np.where(sloped[:, :, None], across, _values(around) @ unit)
    values = np.concatenate([_values(local) @ unit, outer], 1)
    found: FloatArray = fit.curvatures @ values
    if neighbours is None:
        return found
    # slopes that the quadratics of triangles do not have because they lack a value
    missed, weights, edges = fit.slopes @ values - across, _slope_weights(local), _tangents(local)
    for k in range(3):
        own, other, facing = _facing(triangles, opposites, neighbours, k)
        turned = _turn(-edges[other, facing], edges[own, k])
        jump = missed[own, k] + np.einsum("mj,mji->mi", missed[other, facing], turned)
        found[own] -= weights[own, k, :, None] * jump[:, None]
    return found


def _tangents(local: FloatArray) -> FloatArray:
    """Unit vectors (m, 3, 2) along the edges of plane triangles (m, 3, 2)."""
    normals = _edge_normals(local)
    return np.stack([-normals[:, :, 1], normals[:, :, 0]], 2)


def _turn(to: FloatArray, of: FloatArray) -> FloatArray:
    """Maps (m, 3, 3) of curvatures between axes in which one direction is ``of`` and ``to``."""
    c = (of * to).sum(1)
    s = of[:, 0] * to[:, 1] - of[:, 1] * to[:, 0]
    # a direction (x, y) of the first axes is (c x - s y, s x + c y) in the others
    rows = [[c * c, s * s, -c * s], [s * s, c * c, c * s], [2 * c * s, -2 * c * s, c * c - s * s]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def _columns(
    fit: _Fit, local: FloatArray, triangles: IndexArray, opposites: IndexArray,
    neighbours: IndexArray | None,
) -> tuple[IntArray, IntArray, FloatArray]:  # fmt: skip
    """Maps (m, 3, p) to the curvatures, and whose values (m, p) they act on.

    These are, for each column, a triangle and the place among its own six, -1 without any. The
    neighbour over edge k adds the columns 6 + 2 k and 7 + 2 k.
    """
    count = 6 if neighbours is None else 12
    maps = np.zeros((len(triangles), 3, count))
    maps[:, :, :6] = fit.curvatures
    owners = np.repeat(np.arange(len(triangles))[:, None], count, 1)
    places = np.full((len(triangles), count), -1)
    places[:, :6] = np.arange(6)
    if neighbours is None:
        return owners, places, maps
    weights = _slope_weights(local)
    for k in range(3):
        own, other, facing = _facing(triangles, opposites, neighbours, k)
        weight = weights[own, k]
        maps[own, :, :6] -= weight[:, :, None] * fit.slopes[own, None, k]
        for i, column in enumerate((3 + k, (k + 2) % 3, (k + 1) % 3, k, 6 + 2 * k, 7 + 2 * k)):
            place = (facing + i) % 3 + 3 * (i >= 3)
            # the outward normals of both are opposite
            maps[own, :, column] -= weight * fit.slopes[other, facing, place][:, None]
            if column >= 6:
                owners[own, column], places[own, column] = other, place
    return owners, places, maps


def _oriented(tangents: FloatArray | None, outwards: FloatArray) -> FloatArray:
    """Unit vectors (m, 3, 3) along given directions, pointing outwards."""
    if tangents is None:
        return outwards
    lengths = np.linalg.norm(tangents, axis=2)
    given = lengths > 0
    units = np.where(given[:, :, None], tangents, outwards)
    units /= np.where(given, lengths, 1.0)[:, :, None]
    signs = np.where(np.einsum("mka,mka->mk", units, outwards) < 0, -1.0, 1.0)
    oriented: FloatArray = signs[:, :, None] * units
    return oriented
