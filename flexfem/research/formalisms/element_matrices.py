# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of finite elements in a frame that moves: m, c, k, k(eps), k(omega), q_i, m_Oi.

With a the local position of a point, N its derivative with respect to the nodal displacements
delta, and omega, epsilon angular velocity and acceleration of the frame, all in local components,

    m = int rho N^T N                     c = 2 int rho N^T [omega x] N
    k(eps) = int rho N^T [eps x] N        k(omega) = int rho N^T [omega x][omega x] N
    q_i(eps) = int rho N^T [eps x] a      q_i(omega) = int rho N^T [omega x][omega x] a
    m_Oi = int rho N^T  (here m_origin)

    m delta'' + c delta' + [k + k(eps) + k(omega)] delta
        = q + q* - q_i(eps) - q_i(omega) - m_Oi a_O

with a_O the acceleration of the frame's origin in local components, q the forces on the element and
q* those of its neighbours. All of it follows from the integrals of rho N_i N_j, rho N_i a_j and rho
N_i over the undeformed element, which do not depend on the frame's motion: they are taken once, and
combined for as many motions as one likes.

Vlase, Marin, Negrean, Mathematics 10 (2022) 257. There c is written without its 2, which the
equations of motion then have.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import ufl

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.kernels.driver import CellKernel, add_entries, plain_cells
from flexfem.research.formalisms.compiled import energies_of
from flexfem.research.formalisms.coordinates import Coordinates, coordinate_kernel
from flexfem.research.formalisms.derivation import BodyEnergies
from flexfem.research.formalisms.description.mechanism import EnergyBody
from flexfem.research.formalisms.nodes import BodyNodes

__all__ = ["ElementMatrices", "InertiaIntegrals", "element_matrices"]


@dataclass(frozen=True)
class ElementMatrices:
    """Matrices of an element or a body in a moving frame, n displacements in its own axes.

    Attributes:
        m: (n, n) mass matrix.
        c: (n, n) gyroscopic matrix, skew-symmetric: Coriolis' accelerations.
        k: (n, n) stiffness matrix.
        k_epsilon: (n, n) skew-symmetric: accelerations of the displaced points by the angular one.
        k_omega: (n, n) symmetric: centrifugal accelerations of the displaced points.
        q_epsilon: (n,) inertia forces of the undeformed element by the angular acceleration.
        q_omega: (n,) the same by the angular velocity.
        m_origin: (n, 3) forces by a unit acceleration of the frame's origin along each local axis.
        points: (n, 3) nodes of the displacements, local, m.
        components: (n,) which displacement of its node each is, from 0.
        free: (n,) free coordinates in the frame.
    """

    m: FloatArray
    c: FloatArray
    k: FloatArray
    k_epsilon: FloatArray
    k_omega: FloatArray
    q_epsilon: FloatArray
    q_omega: FloatArray
    m_origin: FloatArray
    points: FloatArray
    components: IntArray
    free: BoolArray

    def of_free(self) -> "ElementMatrices":
        """Those of the displacements that are free in the frame."""
        parts = {}
        for one in fields(self):
            value = getattr(self, one.name)[self.free]
            square = value.ndim == 2 and value.shape[1] == len(self.free) and one.name not in _ROWS
            parts[one.name] = value[:, self.free] if square else value
        return ElementMatrices(**parts)


#: Matrices with a row for each displacement, and three columns.
_ROWS = ("m_origin", "points")


#: Kernels and the names of their constants, by the identity of energies, which live on.
_KERNELS: dict[int, list[tuple[CellKernel, tuple[str, ...]]]] = {}


def _kernels(energies: BodyEnergies) -> list[tuple[CellKernel, tuple[str, ...]]]:
    """Kernels of the inertia's matrix, of its vector and of the stiffness (collective).

    The matrix is sum W_ij rho N_i N_j and the vector sum W_ij rho N_i a_j + w_i rho N_i, with W and
    w the constants "weights" and "of_origin".
    """
    if id(energies) in _KERNELS:
        return _KERNELS[id(energies)]
    space = ufl.FunctionSpace(energies.mesh, energies.elastic_element)
    u, w, du = ufl.Coefficient(space), ufl.TestFunction(space), ufl.TrialFunction(space)
    weights = ufl.Constant(energies.mesh, shape=(3, 3))
    of_origin = ufl.Constant(energies.mesh, shape=(3,))
    x, matter = ufl.SpatialCoordinate(energies.mesh), energies.matter
    matrix, vector = 0, 0
    for density, a, bound in matter.inertia(x, u, energies.constants):
        local = _in_space(a)
        N, change = ufl.derivative(local, u, w), ufl.derivative(local, u, du)
        matrix += density * ufl.dot(N, weights * change)
        vector += density * ufl.dot(N, weights * local)
        if bound:
            vector += density * ufl.dot(N, of_origin)
    dx = ufl.dx(metadata={"quadrature_degree": 2 * matter.degree})
    strain = matter.strain_energy(u, energies.constants)
    strain *= ufl.dx(metadata={"quadrature_degree": matter.strain_degree})
    stiffness = ufl.derivative(ufl.derivative(strain, u, w), u, du)
    forms = (matrix * dx, vector * dx, stiffness)
    names = {c: name for name, c in energies.constants.items()}
    names |= {weights: "weights", of_origin: "of_origin"}
    _KERNELS[id(energies)] = [
        (coordinate_kernel(form, (u,)), tuple(names[c] for c in form.constants())) for form in forms
    ]
    return _KERNELS[id(energies)]


def _in_space(a: Any) -> Any:
    """A local vector of two or three components with three."""
    return ufl.as_vector([a[i] if i < a.ufl_shape[0] else 0.0 for i in range(3)])


class InertiaIntegrals:
    """Integrals over a body or one of its elements that do not depend on the frame's motion.

    Their size is nine matrices of all displacements.

    Attributes:
        products: (3, 3, n, n) integrals of rho N_i N_j.
        moments: (3, 3, n) of rho N_i a_j, a the place in the undeformed body.
        masses: (3, n) of rho N_i, of positions only.
        stiffness: (n, n) second derivative of the strain energy.
    """

    def __init__(self, body: EnergyBody, element: int | None = None) -> None:
        """Integrate (collective: kernels are compiled when first used).

        Args:
            body: the body; its joints, loads and motion do not matter.
            element: number of one element of its mesh; None for all of them together.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: there is no such element, or the mesh does not fit the matter.
        """
        _checks.instance("InertiaIntegrals", "body", body, EnergyBody)
        nodes = BodyNodes(body, 0)
        dofs = np.asarray(nodes.space.dofmap.list, dtype=np.int64)
        entries, points = self._chosen(body, dofs, nodes.points, element)
        used, local = np.unique(entries, return_inverse=True)
        if element is not None:  # in the order of the element's own nodes
            used, local = entries[0], np.arange(entries.shape[1])[None]
        count = body.matter.components
        self.points: FloatArray = np.repeat(nodes.x[used], count, axis=0)
        self.components: IntArray = np.tile(np.arange(count), len(used))
        self.free: BoolArray = (nodes.elastic[used] >= 0).ravel()
        places = local.reshape(entries.shape)[:, :, None] * count + np.arange(count)
        self._integrate(body, places.reshape(len(places), -1), points)

    @staticmethod
    def _chosen(
        body: EnergyBody, dofs: IntArray, points: FloatArray, element: int | None
    ) -> tuple[IntArray, FloatArray]:
        if element is None:
            return dofs, points
        _checks.instance(f'EnergyBody "{body.name}"', "element", element, int)
        if not 0 <= element < len(dofs):
            raise InputError(
                f'EnergyBody "{body.name}": there is no element {element}, the mesh has '
                f"{len(dofs)}, numbered from 0"
            )
        return dofs[element : element + 1], points[element : element + 1]

    def _integrate(self, body: EnergyBody, entries: IntArray, points: FloatArray) -> None:
        """Take the integrals; ``entries`` (m, k) are the places of each element's displacements."""
        matrix, vector, stiffness = _kernels(energies_of(body.matter, body.frame))
        n = len(self.points)
        numbers = {name: np.array([value]) for name, value in body.matter.parameters.items()}
        undeformed, nothing = Coordinates.zeros(n), np.empty((len(entries), 0))
        cells = plain_cells(nothing, entries.astype(np.int32), np.ascontiguousarray(points))

        def sum_up(
            compiled: tuple[CellKernel, tuple[str, ...]], W: FloatArray, w: FloatArray
        ) -> FloatArray:
            kernel, names = compiled
            given = numbers | {"weights": W.ravel(), "of_origin": w}
            constants = np.concatenate([*(given[name] for name in names), np.zeros(1)])
            out = np.zeros((n + 1, 1 if compiled is vector else n + 1))
            add_entries(kernel.memory, cells.memory, undeformed.memory, constants, out)
            return out[:-1, 0] if compiled is vector else out[:-1, :-1]

        unit, none = np.zeros((3, 3)), np.zeros(3)
        self.products: FloatArray = np.empty((3, 3, n, n))
        self.moments: FloatArray = np.empty((3, 3, n))
        for i in range(3):
            for j in range(3):
                unit[i, j] = 1.0
                self.products[i, j] = sum_up(matrix, unit, none)
                self.moments[i, j] = sum_up(vector, unit, none)
                unit[i, j] = 0.0
        self.masses: FloatArray = np.array([sum_up(vector, unit, axis) for axis in np.eye(3)])
        self.stiffness: FloatArray = sum_up(stiffness, unit, none)

    def at(self, omega: Any, epsilon: Any) -> ElementMatrices:
        """Combine them for a motion of the frame.

        Args:
            omega: angular velocity of the frame, local components, rad/s.
            epsilon: its angular acceleration, local components, rad/s^2.

        Raises:
            TypeError: an argument does not consist of numbers.
            ValueError: it has not three of them, or they are not finite.
        """
        spin = _cross(_checks.vector("InertiaIntegrals", "omega", omega))
        change = _cross(_checks.vector("InertiaIntegrals", "epsilon", epsilon))
        turn = spin @ spin

        def weighted(W: FloatArray, integrals: FloatArray) -> FloatArray:
            result: FloatArray = np.einsum("ij,ij...->...", W, integrals)
            return result

        return ElementMatrices(
            m=weighted(np.eye(3), self.products), c=2.0 * weighted(spin, self.products),
            k=self.stiffness.copy(), k_epsilon=weighted(change, self.products),
            k_omega=weighted(turn, self.products), q_epsilon=weighted(change, self.moments),
            q_omega=weighted(turn, self.moments), m_origin=self.masses.T.copy(),
            points=self.points, components=self.components, free=self.free,
        )  # fmt: skip


def element_matrices(
    body: EnergyBody, omega: Any, epsilon: Any, element: int | None = None
) -> ElementMatrices:
    """Matrices and inertia forces of a body or one of its elements in a moving frame (collective).

    For many motions take :class:`InertiaIntegrals` once.

    Args:
        body: the body.
        omega: angular velocity of the frame, local components, rad/s.
        epsilon: its angular acceleration, local components, rad/s^2.
        element: number of one element of its mesh; None for all of them together.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: a value is not admissible.
    """
    return InertiaIntegrals(body, element).at(omega, epsilon)


def _cross(a: FloatArray) -> FloatArray:
    """The matrix of a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
