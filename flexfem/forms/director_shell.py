# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL form of the geometrically exact shell with a director.

With the position z, quadratic on each triangle, and a director d, linear and given at the midpoints
of the edges (Crouzeix, Raviart), Z and D their values at the start and ``,a`` derivatives along the
surface, the strains (Simo, Fox, Comput. Methods Appl. Mech. Eng. 72 (1989) 267-304) are

    eps_ab   = (z,a . z,b - Z,a . Z,b) / 2,
    kappa_ab = sym(z,a . d,b - Z,a . D,b),
    gamma_a  = z,a . d - Z,a . D,

in axes e1, e2 of the start, and the energy per area is ``(e^T S e + gamma^T C gamma) / 2`` with e =
(eps, kappa). The directors are unit vectors at the midpoints of the edges; their rotation is no
part of the form. Two things are done against locking:

- The membrane strains, quadratic on a triangle, are interpolated by linear ones, into Regge
  elements of degree 1: same tangential strains at two Gauss points of each edge, same mean
  (Neunteufel, Schoeberl, J. Comput. Phys. 426 (2021) 109933).
- The shear strains are split into those of the lowest edge element with the same tangential strains
  at the midpoints of the edges, ``gamma_r``, and the rest, whose energy is multiplied by
  ``1 / (1 + c A tr C / (S_44 + S_55))``, A being the triangle's area and c = 0.05. The former alone
  make a thin plate the triangle of Morley, which converges on any mesh; the latter would bind the
  gradient of the deflection all along the edges, too many conditions where triangles are few, but
  keeps the midpoints of the edges in place. The factor tends to one with refinement, as in the
  stabilised elements of Brezzi, Fortin and Stenberg (Math. Models Methods Appl. Sci. 1 (1991)
  125-151), and linear deflections and rotations have no rest, so that patch tests hold.

Quadrature: the three inner points of degree 2 for membrane and bending, the midpoints of the edges
for the shear, exact for flat triangles.

All takes place on the reference triangle with corners (0, 0), (1, 0), (0, 1), edge k opposite to
corner k.
"""

from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
import ufl

from flexfem.forms.lie import Expr

__all__ = [
    "MEMBRANE_PLACES",
    "RELAXATION",
    "DirectorFields",
    "curvature_products",
    "director_energy",
    "membrane_weights",
    "shear_products",
    "stretch_products",
]

#: Factor c of the shear beyond the edge element. Square plates of thickness 1e-4, clamped and
#: hinged, under uniform loads and forces at their centres, on regular, perturbed, union-jack and
#: crossed meshes deflect within 6 % with 8 cells a side and 1 % with 16. With 0.02 it is up to 7 %
#: too little with 8 cells, with 0.1 up to 12 % too much, and more on shells under forces at points.
RELAXATION = 0.05

_MIDDLES = ((0.5, 0.5), (0.0, 0.5), (0.5, 0.0))
_EDGES = ((-1.0, 1.0), (0.0, -1.0), (1.0, 0.0))


def stretch_products(g1: Expr, g2: Expr) -> list[Expr]:
    """Products g_1.g_1/2, g_2.g_2/2 and g_1.g_2, whose changes are membrane strains."""
    return [ufl.dot(g1, g1) / 2, ufl.dot(g2, g2) / 2, ufl.dot(g1, g2)]


def curvature_products(g1: Expr, g2: Expr, d1: Expr, d2: Expr) -> list[Expr]:
    """Products g_1.d,1, g_2.d,2 and g_1.d,2 + g_2.d,1, whose changes are curvatures."""
    return [ufl.dot(g1, d1), ufl.dot(g2, d2), ufl.dot(g1, d2) + ufl.dot(g2, d1)]


def shear_products(g1: Expr, g2: Expr, d: Expr) -> list[Expr]:
    """Products g_1.d and g_2.d, whose changes are shear strains."""
    return [ufl.dot(g1, d), ufl.dot(g2, d)]


#: Distance from the middle of an edge to its Gauss points, in lengths of the edge.
_GAUSS = 12**-0.5


#: Two on each edge, then the midpoints of the edges: where products make up the membrane strains.
MEMBRANE_PLACES = np.array([
    *(
        np.add(middle, sign * np.array(edge))
        for middle, edge in zip(_MIDDLES, _EDGES, strict=True)
        for sign in (-_GAUSS, _GAUSS)
    ),
    *_MIDDLES,
])  # fmt: skip


def membrane_weights(place: tuple[Expr, Expr]) -> list[list[list[Expr]]]:
    """Weights (3, 9, 3) of the products at the places in the three membrane strains at a point.

    The Regge element of degree 1: linear functions with the same tangential strains at the places
    on the edges and the same mean as the products.

    Args:
        place: reference coordinates of the point.
    """
    along = [[e[0] ** 2, e[1] ** 2, e[0] * e[1]] for e in _EDGES for _ in range(2)]
    ends = zip(along, MEMBRANE_PLACES[:6], strict=True)
    rows = [np.kron(weights, [1.0, x, y]) for weights, (x, y) in ends]
    rows += [np.kron(np.eye(3)[c], [1.0, 1.0 / 3.0, 1.0 / 3.0]) for c in range(3)]
    maps = np.linalg.inv(np.array(rows)).reshape(3, 3, 9)
    monomials = [1.0, *place]

    def value(c: int, r: int) -> Expr:
        return sum(float(maps[c, k, r]) * monomials[k] for k in range(3))

    return [
        [[value(c, r) * along[r][i] for i in range(3)] for r in range(6)]
        + [[value(c, 6 + i) / 3 for i in range(3)] for _ in range(3)]
        for c in range(3)
    ]


@dataclass(frozen=True)
class DirectorFields:
    """Position and director of a triangle, seen from one of its points.

    Attributes:
        slope: derivatives of the position by the reference coordinates, (3, 2).
        bend: its second derivatives, (3, 2, 2).
        director: director, (3,).
        turn: its derivatives, (3, 2).
        place: the point's reference coordinates, (2,).
    """

    slope: Expr
    bend: Expr
    director: Expr
    turn: Expr
    place: Expr

    @classmethod
    def of(cls, position: Expr, director: Expr, jacobian: Expr, place: Expr) -> Self:
        """Fields on a flat mesh of parameters.

        Args:
            position: quadratic on the triangles of the mesh, (3,).
            director: linear on them, (3,).
            jacobian: of the map from the reference triangle, (2, 2).
            place: reference coordinates, (2,).
        """
        i, a, b, c, d = ufl.indices(5)
        second = ufl.grad(ufl.grad(position))
        bend = ufl.as_tensor(second[i, c, d] * jacobian[c, a] * jacobian[d, b], (i, a, b))
        slope, turn = (ufl.dot(ufl.grad(f), jacobian) for f in (position, director))
        return cls(slope, bend, director, turn, place)

    def base(self, at: tuple[float, float] | None = None) -> list[Expr]:
        """Derivatives of the position at reference coordinates, at the point itself when None."""
        slopes = [ufl.as_vector([self.slope[i, a] for i in range(3)]) for a in range(2)]
        for a, b in product(range(2), repeat=2):
            step = 0.0 if at is None else at[b] - self.place[b]
            slopes[a] += step * ufl.as_vector([self.bend[i, a, b] for i in range(3)])
        return slopes

    def turns(self) -> list[Expr]:
        """Derivatives of the director."""
        return [ufl.as_vector([self.turn[i, a] for i in range(3)]) for a in range(2)]

    def director_at(self, at: tuple[float, float]) -> Expr:
        """Director at reference coordinates."""
        return self.director + sum(
            (at[b] - self.place[b]) * turn for b, turn in enumerate(self.turns())
        )

    def stretch(self, at: tuple[float, float]) -> list[Expr]:
        """Products g_1.g_1/2, g_2.g_2/2 and g_1.g_2 at reference coordinates."""
        return stretch_products(*self.base(at))

    def membrane(self) -> Expr:
        """Interpolated products at the point, (3,)."""
        products = [self.stretch((x, y)) for x, y in MEMBRANE_PLACES.tolist()]
        return ufl.as_vector([
            sum(
                weight * product
                for row, values in zip(rows, products, strict=True)
                for weight, product in zip(row, values, strict=True)
            )
            for rows in membrane_weights((self.place[0], self.place[1]))
        ])  # fmt: skip

    def curvature(self) -> Expr:
        """Products g_1.d,1, g_2.d,2 and g_1.d,2 + g_2.d,1 at the point, (3,)."""
        return ufl.as_vector(curvature_products(*self.base(), *self.turns()))

    def shear(self, k: int) -> Expr:
        """Products g_1.d, g_2.d in the middle of edge k, (2,)."""
        at = _MIDDLES[k]
        g1, g2 = self.base(at)
        return ufl.as_vector(shear_products(g1, g2, self.director_at(at)))


@dataclass(frozen=True)
class _Surface:
    """Components of e_1, e_2 in the base vectors of the start, (2, 2), and area per reference area.

    e_1 is along the projection of a direction.
    """

    maps: Expr
    area: Expr

    @classmethod
    def of(cls, base: list[Expr], direction: Expr) -> Self:
        normal = ufl.cross(*base)
        area = ufl.sqrt(ufl.dot(normal, normal))
        normal /= area
        first = direction - ufl.dot(direction, normal) * normal
        first /= ufl.sqrt(ufl.dot(first, first))
        axes = first, ufl.cross(normal, first)
        maps = ufl.inv(ufl.as_matrix([[ufl.dot(g, e) for e in axes] for g in base]))
        return cls(maps, area)

    def strain(self, covariant: Expr) -> list[Expr]:
        """Strains along e1, e2 from covariant ones: 11, 22 and twice 12."""
        e = ufl.as_matrix([
            [covariant[0], covariant[2] / 2], [covariant[2] / 2, covariant[1]]
        ])  # fmt: skip
        turned = self.maps * e * self.maps.T
        return [turned[0, 0], turned[1, 1], 2 * turned[0, 1]]


def director_energy(
    start: DirectorFields, present: DirectorFields, stiffness: Expr, shear: Expr,
    direction: Expr | None = None,
) -> Expr:  # fmt: skip
    """Energy per area of the reference triangle, J.

    Args:
        start: fields at the start.
        present: fields now.
        stiffness: of membrane and bending, (6, 6), N/m, N and N m.
        shear: across the thickness, (2, 2), N/m.
        direction: vector whose projection is e1, (3,); None for the direction from corner 0 to
            corner 1.
    """
    along = start.base(_MIDDLES[2])[0] if direction is None else direction
    here = _Surface.of(start.base(), along)
    membrane = here.strain(present.membrane() - start.membrane())
    bending = here.strain(present.curvature() - start.curvature())
    strain = ufl.as_vector([*membrane, *bending])
    plane = here.area * ufl.dot(strain, stiffness * strain) / 2
    return plane + _shear_energy(start, present, stiffness, shear, along)


def _shear_energy(
    start: DirectorFields, present: DirectorFields, stiffness: Expr, shear: Expr, along: Expr
) -> Expr:
    """Energy of both parts of the shear per area of the reference triangle."""
    whole = [present.shear(k) - start.shear(k) for k in range(3)]
    # edge element a + b (-y, x) from its integrals along the edges
    tangential = [ufl.dot(ufl.as_vector(t), g) for t, g in zip(_EDGES, whole, strict=True)]
    b = sum(tangential)
    a = ufl.as_vector([tangential[2], -tangential[1]])
    surfaces = [_Surface.of(start.base(at), along) for at in _MIDDLES]
    slender = sum(s.area for s in surfaces) / 6 * ufl.tr(shear)
    factor = 1 / (1 + RELAXATION * slender / (stiffness[3, 3] + stiffness[4, 4]))
    energy = 0
    for (x, y), surface, strain in zip(_MIDDLES, surfaces, whole, strict=True):
        edge = a + b * ufl.as_vector([-y, x])
        for part, weight in ((edge, 1), (strain - edge, factor)):
            local = surface.maps * part
            energy += weight * surface.area / 3 * ufl.dot(local, shear * local) / 2
    return energy
