# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static modal derivatives and the elastic polynomial of a nonlinear body.

As functions ``phi_i`` bend a body by ``eta_i``, its stiffness changes, and forces of second order
``1/2 sum_ij D3(phi_i, phi_j) eta_i eta_j`` are left, with the third derivative D3 of the energy.
The body answers by the static modal derivatives ``theta_ij = -K^-1 D3(phi_i, phi_j)``, interfaces
at rest (Idelsohn, Cardona 1985; Wu, Tiso 2016): a bent beam by membrane displacements.

There are as many as pairs of functions. As Barbic and James (2005) do, modes are weighted by the
inverse squares of their frequencies, as they answer to random forces in proportion to the mass;
then those are kept that relieve most energy, the eigenvectors of the largest eigenvalues of the
Gram matrix of all derivatives in the metric of the stiffness. They do not depend on how the
functions are combined.
"""

from functools import cached_property
from itertools import permutations

import numpy as np
import scipy.linalg

from flexfem._memory import available, shown
from flexfem._types import FloatArray, IntArray
from flexfem.reduction.elastic_polynomial import ElasticPolynomial, pair_numbers
from flexfem.reduction.fem.body.blocks import multiply, projected, same_everywhere
from flexfem.reduction.fem.body.cell_gradients import CellGradients
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.fem.body.ties import rigid_motions, second_order
from flexfem.reduction.fem.modes.internal import Pieces, orthonormal, ritz

__all__ = ["NonlinearBasis"]

#: Relative eigenvalues of the Gram matrix of derivatives that are zero.
_NONE = 1e-10
#: Bytes of an entry of the tensor of third order in all arrays that are made of it.
_TENSORS = 40.0
#: Functions in which the residual is measured.
_MEASURED = 10


class NonlinearBasis:
    """Functions of a body with their modal derivatives, and its polynomial in them.

    The coordinates are those of the body without those of the first interface.
    """

    def __init__(self, owner: str, body: LinearBody, pieces: Pieces, inner: FloatArray) -> None:
        """Take the functions of linear reduction (collective).

        Args:
            owner: for messages.
            body: with an energy.
            pieces: of the reduction.
            inner: (rows, m) internal functions.

        Raises:
            ValueError: the body has no coordinates, or its law is not smooth at rest.
        """
        assert body.energy is not None
        self._owner, self._body, self._pieces = owner, body, pieces
        self._cells = CellGradients(body, body.energy)
        self._comm = body.space.mesh.comm
        self._static = pieces.static[:, 6:]
        functions = np.hstack([self._static, inner])
        if not functions.shape[1]:
            raise ValueError(f"{owner}: derivatives need modes, or a second interface")
        self._linear = self._cells.of(self._weighted(functions))
        i, j = np.triu_indices(self._linear.shape[2])
        weights = np.where(i == j, 1.0, 2.0**0.5)
        self._forces, self._answers = self._responses(self._linear, i, j, weights)
        self._size = float(np.max(-projected(self._comm, self._answers, self._forces).diagonal()))
        self.inner = inner

    def _weighted(self, functions: FloatArray) -> FloatArray:
        """The same space, in the functions' own modes over the squared frequencies (collective).

        The largest has unit energy.
        """
        k = projected(self._comm, functions, multiply(self._pieces.stiffness, functions))
        m = projected(self._comm, functions, multiply(self._pieces.mass, functions))
        scale = 1.0 / np.sqrt(np.diagonal(k))
        k, m = (scale[:, np.newaxis] * (0.5 * (x + x.T)) * scale for x in (k, m))
        inverse, vectors = scipy.linalg.eigh(m, k)
        weights = np.sqrt(np.maximum(inverse, 0.0) / inverse[-1])
        return functions @ (scale[:, np.newaxis] * same_everywhere(self._comm, vectors * weights))

    def _responses(
        self, second: FloatArray, i: IntArray, j: IntArray, weights: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Forces of second order of pairs of functions, and the responses to them (collective).

        Args:
            second: gradients of functions j; functions i are the linear ones.
            i: first functions.
            j: second functions.
            weights: of the pairs in sums over both.
        """
        forces = weights * self._cells.forces(self._linear, second, i, j)
        return forces, -self._pieces.response.respond(forces)

    def add_derivatives(self, count: int) -> None:
        """Add so many derivatives to the internal functions (collective).

        Raises:
            ValueError: there are fewer.
        """
        pieces, modes = self._pieces, self.inner.shape[1]
        if not count:
            return
        found = self._leading(self._forces, self._answers, count)
        if found.shape[1] < count:
            raise ValueError(
                f"{self._owner}: derivatives must be at most {found.shape[1]}, got {count}"
            )
        new = orthonormal(pieces, np.hstack([self.inner, found]))[:, modes:]
        values, new = ritz(pieces, new)
        self.inner = np.hstack([self.inner, pieces.orientation.turn(new, values)])
        derived = self._cells.of(new / np.sqrt(values))
        i, j = (x.ravel() for x in np.indices((self._linear.shape[2], derived.shape[2])))
        forces, answers = self._responses(derived, i, j, 2.0**0.5)
        self._forces = np.hstack([self._forces, forces])
        self._answers = np.hstack([self._answers, answers])

    def _leading(self, forces: FloatArray, answers: FloatArray, count: int) -> FloatArray:
        """Directions of unit energy that relieve most of the energy, at most so many."""
        gram = -projected(self._comm, answers, forces)
        values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
        values = same_everywhere(self._comm, values[::-1])
        vectors = same_everywhere(self._comm, vectors[:, ::-1])
        values = values[values > _NONE * self._size]
        families = self._pieces.orientation.families(1.0 / values)
        last = next((f.stop for f in families if f.stop >= count), len(values))
        directions = answers @ (vectors[:, :last] / np.sqrt(values[:last]))
        turned = self._pieces.orientation.turn(directions, 1.0 / values[:last])
        return turned[:, :count]

    def _measured(self) -> FloatArray:
        """Functions of the residual: what is left of the answers beside the internal functions."""
        return self._leading(*self._beside(self._forces, self._answers), _MEASURED)

    def _beside(self, forces: FloatArray, answers: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What is left of forces and of the answers ``-K^-1`` times these (collective)."""
        inner = self.inner
        if not inner.shape[1]:
            return forces, answers
        own = multiply(self._pieces.stiffness, inner)
        gram = projected(self._comm, inner, own)
        parts = np.linalg.solve(0.5 * (gram + gram.T), projected(self._comm, own, answers))
        return forces + own @ parts, answers - inner @ parts

    def _loaded(
        self, loads: FloatArray, functions: FloatArray, measured: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Inertia forces on the functions of the residual, and what they do beside (collective).

        Returns:
            ``load_residual`` and ``load_gram`` of the polynomial.
        """
        forces = np.hstack([loads, multiply(self._pieces.mass, functions)])
        left, answers = self._beside(forces, -self._pieces.response.respond(forces))
        work = projected(self._comm, measured, left)
        gram = -projected(self._comm, answers, left)
        return work, 0.5 * (gram + gram.T) - work.T @ work

    def polynomial(
        self, functions: FloatArray, loads: FloatArray, moments: FloatArray, products: FloatArray
    ) -> ElasticPolynomial:
        """Elastic forces in the coordinates (collective).

        Args:
            functions: static, internal and turned ones (rows, n); those of the first interface,
                which are not deformations, come first.
            loads: of ``MassIntegrals.loads``.
            moments: (3, n + 1) of ``MassIntegrals.products``.
            products: (3, 3, n + 1, n + 1) likewise.

        Raises:
            ValueError: the tensors need more memory than there is.
        """
        functions, first = functions[:, 6:], 1 + functions.shape[1] - self.turned.shape[1]
        self._check_room(functions.shape[1])
        measured = self._measured()
        own, beside = self._cells.of(functions), self._cells.of(measured)
        n, s = functions.shape[1], measured.shape[1]
        number, (i, j) = pair_numbers(n), np.triu_indices(n)
        third = self._cells.third(own, own, np.concatenate([own, beside], axis=2))
        stiffness = projected(self._comm, functions, multiply(self._pieces.stiffness, functions))
        # what should be zero is round-off without any symmetry
        quadratic = _symmetric(third[:, :, :n]) / 2.0
        cubic = _symmetric(self._cells.fourth(own, own, True)[number][:, :, number]) / 6.0
        residual_cubic = (
            self._cells.fourth(own, beside, False).T.reshape(s, n, n * (n + 1) // 2) / 6.0
        )
        return ElasticPolynomial(
            self._static.shape[1] // 6,
            0.5 * (stiffness + stiffness.T),
            quadratic[i, j],
            cubic[i, j][:, i, j],
            third[i, j, n:].T / 2.0,
            residual_cubic,
            moments[:, first:],
            np.delete(products[..., first:], slice(1, 7), axis=2),
            *self._loaded(loads, functions, measured),
            np.array([self._cells.unit_strain()]),
        )

    def _check_room(self, size: int) -> None:
        """Refuse more coordinates than have room (collective)."""
        needed, room = _TENSORS * float(size) ** 4, min(self._comm.allgather(available()))
        if needed > room:
            raise ValueError(
                f"{self._owner}: forces of third order in {size} coordinates need "
                f"{shown(needed)} of memory, {shown(room)} are available; keep fewer modes or "
                "derivatives"
            )

    @cached_property
    def turned(self) -> FloatArray:
        """Static functions (rows, 6 k) of the products of rotations (collective).

        They answer to the displacement ``1/2 (e_p x (e_q x r) + e_q x (e_p x r))`` of the region
        of an interface, half of that where p = q.
        """
        ties, functions = self._pieces.ties, [np.zeros((len(self._static), 0))]
        for number, interface in enumerate(ties.interfaces[1:], 1):
            own = slice(6 * number, 6 * number + 6)
            field = second_order(rigid_motions(self._body, interface.position)[:, 3:])
            means = projected(self._comm, ties.conditions, field)
            means[ties.condition_of != number] = 0.0
            field[~ties.motion[:, own].any(axis=1)] = 0.0
            functions.append(self._pieces.response.move(field, means))
        return np.hstack(functions)


def _symmetric(tensor: FloatArray) -> FloatArray:
    """Mean over all orders of the indices."""
    orders = list(permutations(range(tensor.ndim)))
    total = np.zeros_like(tensor)
    for order in orders:
        total += tensor.transpose(order)
    mean: FloatArray = total / len(orders)
    return mean
