# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic forces of a reduced body as a polynomial of third order in its coordinates.

Inertia of the functions that it has beside those of linear bodies is here as well.

The energy is ``1/2 K x x + 1/3 Q x x x + 1/4 C x x x x`` with symmetric tensors. Symmetric pairs of
indices are kept once, in the order of ``numpy.triu_indices``: with ``s_kl = x_k x_l``, counted
twice where k and l differ, the products ``z = Q x`` and ``y = C s`` are symmetric matrices, by
which the forces are ``(K + z + y) x`` and their derivatives ``K + 2 z + 3 y``.
"""

from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray

__all__ = ["ARRAYS", "ElasticPolynomial", "pair_count", "pair_numbers", "pairs_of"]

#: Names of the arrays of a polynomial.
ARRAYS = (
    "stiffness", "quadratic", "cubic", "residual_quadratic", "residual_cubic", "moments",
    "products", "load_residual", "load_gram", "unit_strain",
)  # fmt: skip

#: Relative asymmetry of tensors that is round-off.
_ROUND_OFF = 1e-8


def pair_count(size: int) -> int:
    """Number of symmetric pairs of so many indices."""
    return size * (size + 1) // 2


def pair_numbers(size: int) -> IntArray:
    """Number (n, n) of the pair of two indices, in either order."""
    numbers = np.empty((size, size), dtype=np.int64)
    i, j = np.triu_indices(size)
    numbers[i, j] = numbers[j, i] = np.arange(len(i))
    return numbers


def pairs_of(coordinates: FloatArray) -> FloatArray:
    """Products (..., P) of the pairs of coordinates (..., n), twice where they are two."""
    first, second = np.triu_indices(coordinates.shape[-1])
    weight = np.where(first == second, 1.0, 2.0)
    products: FloatArray = weight * coordinates[..., first] * coordinates[..., second]
    return products


@dataclass(frozen=True, eq=False)
class ElasticPolynomial:
    """Nonlinear elastic forces of a :class:`ReducedBody`, and what these leave out of balance.

    Inertia forces are those of the displacements in the same coordinates.

    Its coordinates x are those of the body without the first interface's, whose frame is that of
    the body, and six more for each of the other interfaces, the products of its rotations tt_xx,
    tt_xy, tt_xz, tt_yy, tt_yz, tt_zz: a region that turns by the rotation vector t moves by
    ``a t x r + b/2 t x (t x r)``, ``a = sin|t|/|t|``, ``b = 2 (1 - cos|t|)/|t|^2``, which is rigid.
    The coordinates of its rotation are ``a t``, the six products ``b t_p t_q``.

    The residual is the force of the deformed body on s functions that are not coordinates, those
    that answer best to what the coordinates leave out of balance: in them the body would go on to
    deform. They have unit energy each and no linear coupling with the coordinates, so that the norm
    of the residual is that of this further displacement in the metric of the stiffness. Beside
    the nonlinear forces the residual has the inertia forces, weight included, by 12 + n amplitudes:
    the acceleration of the body's shape at rest in twelve fields as in ``ReducedBody``, and those
    of the coordinates. What they do on other functions is kept by its Gram matrix.

    Attributes:
        turning: k, the number of interfaces after the first.
        stiffness: (n, n) K of the n coordinates.
        quadratic: (P, n) the tensor Q by ``P = n (n + 1)/2`` pairs.
        cubic: (P, P) the tensor C.
        residual_quadratic: (s, P) second-order part of the residual by pairs.
        residual_cubic: (s, n, P) third-order part by a coordinate and pairs.
        moments: (3, 6 k) integrals of rho Phi_j over the functions of the products, kg.
        products: (3, 3, n+1, 6 k); [a, b, i, j] is the integral of rho Phi_ia Phi_jb with these
            functions j, Phi_0 = r, then all coordinates.
        load_residual: (s, 12 + n) inertia forces on the s functions.
        load_gram: (12 + n, 12 + n) products, in the metric of the stiffness, of the displacements
            that these forces cause beside coordinates and functions.
        unit_strain: (1,) norm of a displacement with strains of one in the whole body.
    """

    turning: int
    stiffness: FloatArray
    quadratic: FloatArray
    cubic: FloatArray
    residual_quadratic: FloatArray
    residual_cubic: FloatArray
    moments: FloatArray
    products: FloatArray
    load_residual: FloatArray
    load_gram: FloatArray
    unit_strain: FloatArray

    def __post_init__(self) -> None:
        """Check the arrays against each other.

        Raises:
            TypeError: an array does not consist of numbers.
            ValueError: shapes that do not belong together, values that are not finite, or tensors
                that are not symmetric.
        """
        owner = "ElasticPolynomial"
        turning = _checks.count(owner, "turning", self.turning, 0)
        stiffness = _checks.array(owner, "stiffness", self.stiffness, (-1, -1))
        n = len(stiffness)
        pairs, least = pair_count(n), 12 * turning
        if stiffness.shape[1] != n or n < least:
            raise ValueError(
                f"{owner}: stiffness must be square with {least} rows at least, got "
                f"{stiffness.shape}"
            )
        second = _checks.array(owner, "residual_quadratic", self.residual_quadratic, (-1, pairs))
        fields = {
            "quadratic": _checks.array(owner, "quadratic", self.quadratic, (pairs, n)),
            "cubic": _checks.array(owner, "cubic", self.cubic, (pairs, pairs)),
            "residual_cubic": _checks.array(
                owner, "residual_cubic", self.residual_cubic, (len(second), n, pairs)
            ),
            "moments": _checks.array(owner, "moments", self.moments, (3, 6 * turning)),
            "products": _checks.array(owner, "products", self.products, (3, 3, n + 1, 6 * turning)),
            "load_residual": _checks.array(
                owner, "load_residual", self.load_residual, (len(second), 12 + n)
            ),
            "load_gram": _checks.array(owner, "load_gram", self.load_gram, (12 + n, 12 + n)),
            "unit_strain": _checks.array(owner, "unit_strain", self.unit_strain, (1,)),
        }
        _checks.assign(
            self, turning=turning, stiffness=stiffness, residual_quadratic=second, **fields
        )
        number, own = pair_numbers(n), self.products[:, :, n + 1 - 6 * turning :]
        whole = {
            "stiffness": stiffness,
            "quadratic": self.quadratic[number],
            "cubic": self.cubic[number][:, :, number],
            "products": own.transpose(0, 2, 1, 3).reshape(18 * turning, 18 * turning),
            "load_gram": self.load_gram,
        }
        for name, tensor in whole.items():
            defect = np.abs(tensor - tensor.swapaxes(0, -1)).max(initial=0.0)
            if defect > _ROUND_OFF * np.abs(tensor).max(initial=0.0):
                raise ValueError(f"{owner}: {name} must be symmetric, it deviates by {defect:.3g}")

    @property
    def size(self) -> int:
        """Number of coordinates of the body, without the products of rotations."""
        return len(self.stiffness) - 6 * self.turning

    @property
    def turned_masses(self) -> FloatArray:
        """(k, 6) masses of the products of rotations, kg m^2."""
        count = 6 * self.turning
        last = self.products[:, :, self.products.shape[2] - count :]
        masses: FloatArray = np.einsum("aaii->i", last).reshape(-1, 6)
        return masses

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """All arrays by name."""
        return {name: getattr(self, name) for name in ARRAYS}

    def with_products(
        self, moments: FloatArray, products: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Integrals (3, n + 1) and (3, 3, n + 1, n + 1) of r and all n functions.

        Args:
            moments: those of r and the body's own coordinates.
            products: of the same.
        """
        own, every = products.shape[3], len(self.stiffness) + 1
        whole = np.empty((3, 3, every, every))
        whole[:, :, :own, :own], whole[:, :, :, own:] = products, self.products
        whole[:, :, own:, :own] = self.products[:, :, :own].transpose(1, 0, 3, 2)
        return np.hstack([moments, self.moments]), whole

    def forces(self, coordinates: FloatArray) -> FloatArray:
        """Elastic forces (n,) on all coordinates (n,)."""
        number = pair_numbers(len(coordinates))
        packed = self.quadratic @ coordinates + self.cubic @ pairs_of(coordinates)
        forces: FloatArray = (self.stiffness + packed[number]) @ coordinates
        return forces

    def energies(self, coordinates: FloatArray) -> FloatArray:
        """Strain energies (m,), J, of all coordinates (m, n)."""
        x, pairs = coordinates, pairs_of(coordinates)
        slopes = x @ self.stiffness / 2.0 + pairs @ self.quadratic / 3.0
        cubic = ((pairs @ self.cubic) * pairs).sum(axis=1)
        energies: FloatArray = (slopes * x).sum(axis=1) + cubic / 4.0
        return energies

    def displacements(
        self, coordinates: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Displacement that is missing, and that of the body, each (m,), in the energy norm.

        The squares are twice energies, J: that which the body would release, and that which it has.
        Missing is the displacement of the residual, see the class.

        Args:
            coordinates: (m, n) of the polynomial.
            accelerations: (m, 12 + n) amplitudes of the inertia forces.
        """
        pairs = pairs_of(coordinates)
        triples = (coordinates[:, :, np.newaxis] * pairs[:, np.newaxis]).reshape(len(pairs), -1)
        residual = triples @ self.residual_cubic.reshape(-1, triples.shape[1]).T
        residual += pairs @ self.residual_quadratic.T + accelerations @ self.load_residual.T
        beside = (accelerations @ self.load_gram) * accelerations
        squares = (residual**2).sum(axis=1) + beside.sum(axis=1)
        missing: FloatArray = np.sqrt(np.maximum(squares, 0.0))
        moved: FloatArray = np.sqrt(np.maximum(2.0 * self.energies(coordinates), 0.0))
        return missing, moved
