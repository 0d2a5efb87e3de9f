# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of joints and drives at accepted states, from constraints on accelerations.

Multipliers of index 3 belong to the scheme's own accelerations w, which satisfy the constraints
only on average: with generalized-alpha and a radius of 0.9 they oscillate for tens of steps after
every jerk, and with energy-momentum they are means over steps. The reported forces solve at the
accepted positions

``[[M, G^T], [G, 0]] (a, lambda) = -(f(q, v'), gamma(q, v'))``,
``v' = v - M^-1 G^T S^-1 (G v + b)``, ``S = G M^-1 G^T``,

with b the rates and gamma the second rates of the rows at zero velocities and accelerations: the
equations of a consistent start. The scheme leaves ``M w + f(q, v) + G^T
lambda_0 = 0``, and so they are solved for the difference to lambda_0, without the forces f:

``lambda = lambda_0 + S^-1 (G w + gamma(q, v') - G M^-1 C (v' - v))``

The difference is an acceleration times the mass at a joint: that of whole rigid bodies, but only of
the node of a flexible one, and of the order of the scheme's error. Velocities change for rigid
bodies alone, with C their gyroscopic terms: the damping of an element would give forces for a
change at one of its nodes. Without rigid bodies at a joint, the reported force is nearly lambda_0,
and vibrations of flexible bodies that the steps do not resolve remain in it.

Masses of rigid bodies are exact. Those of flexible ones hardly change in the nodes' own axes: the
factors are those of the start, which are the same after every restart and on any number of ranks,
and the change by bent elements is a part of the difference.
"""

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.laws import LawKind
from flexfem.core.nodes.action_kernels import add_products
from flexfem.integrators.drive_rates import DriveRates, drive_rates
from flexfem.integrators.start import laws_settled
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import GYROSCOPIC, MASS, System

__all__ = ["AcceptedForces"]

#: Rows are evaluated as they are, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
#: Largest number of iterations for friction that depends on joint forces.
_SWEEPS = 25


class AcceptedForces:
    """Computation of all rows' forces at the accepted state; see ``System.reported_forces``."""

    def __init__(self, system: System, tangent: TangentSolver, span: float, end: float) -> None:
        """Store the arguments; masses are factorised at the first call (collective).

        Args:
            system: system of the forces.
            tangent: exact solver, for masses that cannot be inverted body by body.
            span: interval for the differentiation of drives, s.
            end: end of the motion, s, after which drives are not evaluated.
        """
        self._system, self._tangent = system, tangent
        self.span, self._end = span, end
        self._frozen: FrozenSolver | None = None
        self._inverted = True  # masses of bodies are regular
        # of the rows at the last factorisation of their system
        self._compliance, self._coupling = np.zeros((2, 0))
        kinds = system.constraints.elastic[:, 0]
        self._laws = self._any(np.any(kinds != LawKind.RIGID))
        self._turning = any(part.elements is None for part in system.parts)  # rigid bodies
        self._rubbing = self._any(system.constraints.frictional.any())
        self._nothing = [np.zeros_like(part.block.owned_residual) for part in system.parts]

    def drives(self) -> DriveRates:
        """Derivatives of the drives by time, now."""
        return drive_rates(self._system.constraints, self._system.time, self.span, self._end)

    def __call__(self) -> FloatArray:
        """Forces (r,) of all rows, N or N m (collective).

        The accepted state is not changed; poses and gradients of the rows are then those of it.
        """
        system = self._system
        rows, face = system.constraints, system.interface
        rigid = rows.rigid
        if not rows.size_global or not (rows.mean_forces or self._any(rigid.any())):
            return rows.forces
        face.update()
        rows.multipliers[:], velocities = rows.forces, face.velocities.copy()
        drives = self.drives()
        self._evaluate()
        right, gradients = self.out_of_balance(), rows.gradients_of(rigid)
        if self._turning:
            self._project(-(rows.rates() + drives.first) * rigid, gradients, right)
        gaps = drives.second + 2.0 * drives.of_rates(rows)
        if self._laws:
            self._evaluate()
        gaps += rows.second_rates() + self._second_rates()
        found = self._forces(rigid, gaps, gradients, right)
        face.velocities[:] = velocities
        return found

    def _evaluate(self) -> None:
        """Evaluate all rows; forces of those that act by impulses alone are zero.

        Normal forces of friction have the mean forces of impulses in them.
        """
        rows = self._system.constraints
        if rows.split:
            np.negative(rows.impulses, out=rows.own.excess)
        rows.evaluate(_UNSCALED)
        if rows.split:
            rows.leave_out(rows.apart)

    def _any(self, mine: np.bool_) -> bool:
        """Return True if a flag is set on any rank (collective)."""
        comm = self._system.comm
        return bool(comm.allreduce(bool(mine), op=MPI.LOR) if comm.size > 1 else mine)

    def _project(self, rates: FloatArray, gradients: FloatArray, right: list[FloatArray]) -> None:
        """Move the interface's velocities of rigid bodies onto the constraints.

        Args:
            rates: (r,) rates by which the rows are violated.
            gradients: (t, 2, 6) of the rigid rows.
            right: forces (n_owned, width) of each block that are to be balanced; gyroscopic ones
                are added.
        """
        system = self._system
        self._solve(self._nothing, rates, gradients, False)
        for k, part in enumerate(system.parts):
            block = part.block
            if part.elements is None:
                block.residual[:] = 0.0
                matrices = END_POINT.masses(system, part, GYROSCOPIC)
                add_products(matrices, part.masses.nodes, block.step, -1.0, block.residual)
                right[k] += block.owned_residual
        system.interface.update_steps()
        system.interface.velocities += system.interface.steps

    def out_of_balance(self) -> list[FloatArray]:
        """Residuals (n_owned, width) of blocks, zero if equilibrium is that of the step's end."""
        system, rows = self._system, self._system.constraints
        for part in system.parts:
            part.block.residual[:] = 0.0
        if rows.mean_forces:
            for part, own in zip(system.parts, system.damped(system.present), strict=True):
                part.add_residual(system.gravity, system.factors, 1.0, own)
            system.add_constraint_forces(rows.forces)
        return [-part.block.owned_residual for part in system.parts]

    def _second_rates(self) -> FloatArray:
        """(r,) second rates of the rows by the accelerations of the accepted state."""
        system = self._system
        for part in system.parts:
            width = part.block.width
            part.block.step[:, :width] = part.block.acceleration[:, :width]
        system.interface.update_steps()
        return system.constraints.changes(system.interface.steps)

    def _forces(
        self, rigid: BoolArray, gaps: FloatArray, gradients: FloatArray, right: list[FloatArray]
    ) -> FloatArray:
        """Forces (r,) of all rows, those of laws at the projected velocities.

        Args:
            rigid: (r,) True for constraint equations.
            gaps: (r,) their second rates.
            gradients: (t, 2, 6) of their terms.
            right: (n_owned, width) forces of each block that are to be balanced.
        """
        rows, start, values = self._system.constraints, self._system.constraints.forces, gaps
        whole = bool(rigid.all())
        for _ in range(_SWEEPS):
            if not whole:
                yielding = rows.values + rows.yielding(rows.multipliers - start)
                values = np.where(rigid, gaps, yielding)
            keep = self._turning and not (self._laws and self._any(self._yield_otherwise()))
            found = start + self._solve(right, -values, gradients, keep)
            if not self._rubbing or laws_settled(self._system, found):
                break
            rows.multipliers[:] = found
            self._evaluate()
        return found

    def _yield_otherwise(self) -> np.bool_:
        """True if laws of this rank have other derivatives than at the last factorisation."""
        rows = self._system.constraints
        same = np.array_equal(rows.compliance, self._compliance)
        return np.bool_(not (same and np.array_equal(rows.coupling, self._coupling)))

    def _solve(
        self, right: list[FloatArray], values: FloatArray, gradients: FloatArray, keep: bool
    ) -> FloatArray:
        """Solve for accelerations of rigid bodies, and multipliers (r,), which are returned.

        Args:
            right: (n_owned, width) right-hand sides of the blocks.
            values: (r,) of the rows.
            gradients: (t, 2, 6) of the rigid rows.
            keep: True if rows and bodies are those of the last call.
        """
        system, rows = self._system, self._system.constraints
        if self._inverted:
            for part, forces in zip(system.parts, right, strict=True):
                part.block.owned_residual[:] = forces
            own = rows.step_jacobian.copy()
            rows.step_jacobian[:] = gradients
            if not keep:
                self._compliance, self._coupling = rows.compliance.copy(), rows.coupling.copy()
            self._inverted, found = self.masses.constrain(MASS, values, keep, rows.mean_forces)
            rows.step_jacobian[:] = own
            if self._inverted:
                return found
        system.counters.mass_factorizations += 1
        self._tangent.assemble(MASS)
        self._tangent.factor()
        self._tangent.solve(right, values)
        return self._tangent.multiplier_step

    @property
    def masses(self) -> FrozenSolver:
        """Solver with the factors of the masses at the start (collective)."""
        if self._frozen is None:
            self._frozen = FrozenSolver.of_masses(self._system)
        return self._frozen
