# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Saint-Venant's solutions of a prismatic beam by finite elements over its section.

Displacements are a rigid motion of the section, with the strain measures psi = (gamma, kappa), and
a warping w(x1, y, z) of three components. With the strain of the solid
`eps = E1 (Z psi + w') + B w`, where Z psi = gamma + kappa x (0, y, z), E1 a the strain by a
derivative `a` along the beam and B w that by derivatives in the section, the matrices are

`M(a, a) = int E1 a : C E1 a`,  `G(a, w) = int E1 a : C B w`,  `K(w, w) = int B w : C B w`.

Equilibrium of the section, with the warping linear along the beam as under constant forces, reads
with the resultants theta = (n, m), theta' = T theta, R = G^T Z, L = M Z, A = Z^T M Z

`K w' + R psi' = 0`,  `R^T w' + A psi' = T theta`,
`K w + R psi = (G - G^T) w' + L psi'`,  `R^T w + A psi = theta - L^T w'`,

where w and w' have no mean rigid motion. The flexibility is the energy of the strains of unit
resultants. See V. Giavotto et al. (1983, doi:10.1016/0045-7949(83)90179-7), J. P. Blasques,
M. Stolpe (2012, doi:10.1016/j.compstruct.2012.05.026), M. Morandini, M. Chierichetti, P. Mantegazza
(2010, doi:10.1016/j.ijsolstr.2010.01.018).
"""

from functools import cached_property
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, mesh
from scipy.sparse import block_array, csc_array
from scipy.sparse.linalg import splu

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.ffcx_options import compile_options, compiled_form

__all__ = ["Warping"]

#: theta' = T theta: forces are constant, and bending moments change by shear forces.
_ALONG = np.zeros((6, 6))
_ALONG[4, 2], _ALONG[5, 1] = 1.0, -1.0


class Warping:
    """Warping, strains and energy of unit resultants, in units of the caller's choice.

    Every rank solves for itself, so that all have the same and none waits for another.

    Attributes:
        flexibility: Strain measures of unit resultants, shape (6, 6).
        inertia: Momentum of unit velocities, shape (6, 6).
    """

    flexibility: FloatArray
    inertia: FloatArray

    def __init__(
        self,
        points: FloatArray,
        cells: IntArray,
        elastic: FloatArray,
        density: FloatArray,
        degree: int,
    ) -> None:
        """Solve for the six unit resultants.

        Args:
            points: Nodes (y, z), shape (n, 2).
            cells: Triangles, or quadrilaterals counterclockwise.
            elastic: Elastic matrices of the cells, shape (m, 6, 6).
            density: Of the cells, shape (m,).
            degree: Of the displacements.
        """
        kind = "triangle" if cells.shape[1] == 3 else "quadrilateral"
        order = [0, 1, 2] if cells.shape[1] == 3 else [0, 1, 3, 2]  # as tensor products
        element: Any = basix.ufl.element("Lagrange", kind, 1, shape=(2,))
        self._domain = mesh.create_mesh(MPI.COMM_SELF, cells[:, order], element, points)
        self._original = self._domain.topology.original_cell_index
        self._elastic = self._constant((6, 6), elastic)
        self._space = fem.functionspace(self._domain, ("Lagrange", degree, (3,)))
        a, v = ufl.TrialFunction(self._space), ufl.TestFunction(self._space)
        stress_along, stress_across = self._elastic * _along(a), self._elastic * _across(a)
        m = _matrix(ufl.inner(_along(v), stress_along))
        g = _matrix(ufl.inner(_along(v), stress_across))
        k = _matrix(ufl.inner(_across(v), stress_across))
        rigid = self._rigid()
        mass = _matrix(self._constant((), density) * ufl.inner(v, a))
        self.inertia = rigid.T @ (mass @ rigid)
        means = _matrix(ufl.inner(v, a)) @ rigid

        to_warp, to_strain = g.T @ rigid, m @ rigid
        stiff = rigid.T @ to_strain
        bordered = csc_array(
            block_array(
                [
                    [k, csc_array(to_warp), csc_array(means)],
                    [csc_array(to_warp.T), csc_array(stiff), None],
                    [csc_array(means.T), None, csc_array((6, 6))],
                ]
            )
        )
        # Minimum degree of A + A^T eliminates the twelve full rows last: 22 times faster than the
        # columns' ordering for 6000 cubic triangles, where 5 s are left. The refinement makes up
        # for pivots on the diagonal.
        factors = splu(
            bordered, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )  # fmt: skip

        def solve(forces: FloatArray, resultants: FloatArray) -> tuple[FloatArray, FloatArray]:
            right = np.vstack([forces, resultants, np.zeros((6, 6))])
            found = factors.solve(right)
            found += factors.solve(right - bordered @ found)
            return found[:-12], found[-12:-6]

        slope, change = solve(np.zeros_like(rigid), _ALONG)
        forces = g @ slope - g.T @ slope + to_strain @ change
        self._warp, strain = solve(forces, np.eye(6) - to_strain.T @ slope)
        #: Derivatives of displacements along the beam.
        self._rate = rigid @ strain + slope
        cross = self._rate.T @ (g @ self._warp)
        energy = self._rate.T @ (m @ self._rate) + cross + cross.T + self._warp.T @ (k @ self._warp)
        self.flexibility = 0.5 * (energy + energy.T)

    @cached_property
    def nodes(self) -> FloatArray:
        """Points (y, z) of the displacements, shape (k, 2)."""
        result: FloatArray = self._space.tabulate_dof_coordinates()[:, :2]
        return result

    def displacement(self, resultants: FloatArray) -> FloatArray:
        """Warping at the points `nodes` under given resultants, shape (k, 3)."""
        return np.asarray(self._warp @ resultants).reshape(-1, 3)

    def stress(self, resultants: FloatArray) -> FloatArray:
        """Stresses (11, 22, 33, 23, 13, 12) in the middle of the cells, shape (m, 6)."""
        rate, warp, expression = self._stress
        rate.x.array[:] = self._rate @ resultants
        warp.x.array[:] = self._warp @ resultants
        cells = np.arange(len(self._original), dtype=np.int32)
        values = np.empty((len(cells), 6))
        values[self._original] = expression.eval(self._domain, cells).reshape(-1, 6)
        return values

    @cached_property
    def _stress(self) -> tuple[fem.Function, fem.Function, fem.Expression]:
        rate, warp = fem.Function(self._space), fem.Function(self._space)
        middle = basix.geometry(self._domain.basix_cell()).mean(axis=0)[None]
        stress = self._elastic * (_along(rate) + _across(warp))
        options = compile_options(MPI.COMM_SELF)
        return rate, warp, fem.Expression(stress, middle, **options)

    def _constant(self, shape: tuple[int, ...], values: FloatArray) -> fem.Function:
        """Return a function of constant values in the cells, given in the order of the input."""
        space = fem.functionspace(self._domain, ("DG", 0, shape) if shape else ("DG", 0))
        result = fem.Function(space)
        size = int(np.prod(shape))
        result.x.array.reshape(-1, size)[space.dofmap.list[:, 0]] = values.reshape(-1, size)[
            self._original
        ]
        return result

    def _rigid(self) -> FloatArray:
        """Return Z: displacements gamma + kappa x (0, y, z), shape (3 k, 6)."""
        y, z = self.nodes.T
        zero, one = np.zeros_like(y), np.ones_like(y)
        rows = np.array(
            [
                [one, zero, zero, zero, z, -y],
                [zero, one, zero, -z, zero, zero],
                [zero, zero, one, y, zero, zero],
            ]
        )
        return rows.transpose(2, 0, 1).reshape(-1, 6)


def _along(a: Any) -> Any:
    """Strain by the derivative `a` of displacements along the beam."""
    return ufl.as_vector([a[0], 0, 0, 0, a[2], a[1]])


def _across(u: Any) -> Any:
    """Strain by the derivatives of displacements in the section."""
    y, z = u.dx(0), u.dx(1)
    return ufl.as_vector([0, y[1], z[2], z[1] + y[2], z[0], y[0]])


def _matrix(integrand: Any) -> Any:
    """Return an assembled form as a scipy matrix."""
    return csc_array(fem.assemble_matrix(compiled_form(integrand * ufl.dx)).to_scipy())
