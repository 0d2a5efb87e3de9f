# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of a system for a time integrator, and their derivatives.

Most schemes state equilibrium at the end of a step: :class:`EndPoint`. A scheme with other
equations derives a class from :class:`Mechanics`, which is an argument of solvers and policies.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from math import isnan, nan

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.action_kernels import add_products, subtract_forces
from flexfem.layout.tangent_request import Strains, TangentRequest
from flexfem.system.moving_apart import Moved, move_apart
from flexfem.system.system import MASS, BlockPart, PartStrains, Shifts, System

__all__ = [
    "END_POINT", "VISCOUS", "EndPoint", "KeptAction", "Mechanics", "SolveAgain",
]  # fmt: skip

#: Adds a factor times a kept matrix of a part times its steps to its residual; False without one.
KeptAction = Callable[[BlockPart, float], bool]
#: Solves for the steps of blocks (stored there) and multipliers (returned, with success) with the
#: matrix of the last iteration, given the blocks' residuals (stored there) and values of rows (r,).
SolveAgain = Callable[[FloatArray], tuple[bool, FloatArray]]


class Mechanics(ABC):
    """Residuals of blocks and rows at the trial state, and their derivatives along local twists.

    They are ``solvers.newton.iteration.Equations``: dynamics with constraints on positions.
    """

    @abstractmethod
    def evaluate(self, system: System, shifts: Shifts, strains: PartStrains | None = None) -> None:
        """Residuals of blocks, with constraint forces, and of rows (collective).

        Args:
            system: at the trial state.
            shifts: factors of the scheme.
            strains: strains of each part whose stresses are used; None for the present ones.
        """

    def correct(self, system: System, again: SolveAgain | None) -> Moved:
        """Subtract the blocks' steps (collective)."""
        return Moved(self.move(system, -1.0))

    def subtract_tangent(
        self, system: System, shifts: Shifts, hessians: FloatArray,
        strains: PartStrains | None = None, kept: KeptAction | None = None,
    ) -> None:  # fmt: skip
        """Subtract the tangent's action on the blocks' steps from the residuals (collective).

        Residuals of ghosts must be zero.

        Args:
            system: at the trial state.
            shifts: factors of the scheme.
            hessians: result of :meth:`hessians` for the multipliers.
            strains: strains of each part whose stresses are used; None for the present ones.
            kept: takes the place of the parts' own tangents, without contacts, where it can.
        """
        self._add_action(system, shifts, -1.0, strains, kept)
        system.interface.update_steps()
        turning = system.constraints.turning_forces(hessians, system.interface.steps)
        for part in system.parts:
            if len(part.interface_nodes):
                subtract_forces(turning, part.interface_nodes, part.block.residual)

    def multiply_mass(self, system: System, factor: float, shifts: Shifts = MASS) -> None:
        """Set the residuals to ``factor`` times mass matrix times steps (collective).

        With other ``shifts`` without stiffness, damping is a part of the matrix.
        """
        for part in system.parts:
            part.block.residual[:] = 0.0
        self._add_action(system, shifts, factor)

    def _add_action(
        self, system: System, shifts: Shifts, factor: float, strains: PartStrains | None = None,
        kept: KeptAction | None = None,
    ) -> None:  # fmt: skip
        """Add ``factor`` times the blocks' own tangents times their steps to the residuals."""
        for part, own in zip(system.parts, strains or system.present, strict=True):
            if kept is None or not kept(part, factor):
                self.add_own_action(system, part, shifts, factor, own)
            if part.contacts is not None and shifts.stiffness:
                part.contacts.add_action(factor * shifts.scale * shifts.stiffness)

    def add_own_action(
        self,
        system: System,
        part: BlockPart,
        shifts: Shifts,
        factor: float,
        strains: Strains | None,
    ) -> None:
        """Add the same of elements, masses and forces of one part."""
        block = part.block
        block.spread_step()
        if part.elements is not None:
            block.residual[block.owned :] = 0.0
            self.add_cells(system, part, shifts, shifts.request(strains), factor)
            block.add_ghosts()
        for nodes, tangent in (
            (part.masses.nodes, self.masses), (part.forces.nodes, self.forces),
        ):  # fmt: skip
            if len(nodes):
                matrices = tangent(system, part, shifts)
                add_products(matrices, nodes, block.step, factor, block.residual)

    @abstractmethod
    def move(self, system: System, sign: float) -> float:
        """Move by ``sign`` times the blocks' steps; largest entry on this rank (collective)."""

    @abstractmethod
    def cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """Entries of the matrices of a part's elements and of forces inside them, flat."""

    @abstractmethod
    def masses(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """Matrices (k, 6, 6) of a part's masses."""

    @abstractmethod
    def forces(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """Matrices (k, 6, 6) of a part's forces."""

    def row_gradients(self, system: System, shifts: Shifts) -> FloatArray:
        """Derivatives (t, 2, 6) of the values of rows; masses have those of constraints alone."""
        rows = system.constraints
        return rows.step_jacobian if shifts.stiffness else rows.rigid_jacobian()

    @abstractmethod
    def hessians(self, system: System, factor: FloatArray) -> FloatArray:
        """``sum_rows factor d(force gradient)``, (n_pairs, 12, 12)."""

    @abstractmethod
    def add_cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest,
        factor: float,
    ) -> None:  # fmt: skip
        """Add ``factor`` times the action of these matrices on a part's steps to its residual."""

    @abstractmethod
    def origin(self, system: System, part: BlockPart) -> tuple[dict[str, FloatArray], FloatArray]:
        """Return a snapshot of the state of a part's matrices: nodal arrays, and numbers.

        The arrays are not copied; the numbers are the same on all ranks.
        """

    @abstractmethod
    def recall(
        self, system: System, part: BlockPart, nodes: Mapping[str, FloatArray], numbers: FloatArray
    ) -> None:
        """Restore a part from a result of :meth:`origin`; the accepted state may be overwritten."""


class EndPoint(Mechanics):
    """Equilibrium at the end of the step."""

    def evaluate(self, system: System, shifts: Shifts, strains: PartStrains | None = None) -> None:
        """See :class:`Mechanics`."""
        system.begin_evaluation(shifts.acceleration)
        if strains is None and system.modal_dampers is None:
            self._evaluate_at_once(system, shifts)
            return
        for part, own in zip(system.parts, system.damped(strains or system.present), strict=True):
            part.add_residual(system.gravity, system.factors, shifts.scale, own)
        system.interface.update()
        self.evaluate_rows(system, shifts)
        system.add_constraint_forces(system.constraints.multipliers)

    def _evaluate_at_once(self, system: System, shifts: Shifts) -> None:
        """The same with the present stresses."""
        evaluation = system.evaluation
        evaluation.use(shifts.scale, shifts.dynamics)
        if type(self).evaluate_rows is EndPoint.evaluate_rows:
            evaluation.whole()
            return
        evaluation.before()
        self.evaluate_rows(system, shifts)
        evaluation.after()

    def evaluate_rows(self, system: System, shifts: Shifts) -> None:
        """Equations and gradients of all rows at the interface's state."""
        system.constraints.evaluate(shifts.dynamics)

    def correct(self, system: System, again: SolveAgain | None) -> Moved:
        """See :class:`Mechanics`."""
        if not system.contacts:
            return Moved(self.move(system, -1.0))
        return move_apart(system, lambda: self.move(system, -1.0))

    def move(self, system: System, sign: float) -> float:
        """See :class:`Mechanics`."""
        if sign == -1.0:
            return system.evaluation.move()
        sizes = [part.block.correct(sign) for part in system.parts]
        # the maximum alone may drop a NaN
        return nan if any(map(isnan, sizes)) else max(sizes, default=0.0)

    def cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """See :class:`Mechanics`."""
        values = self.element_values(system, part, shifts, request)
        if not part.line_forces:
            return values
        block, scale = part.block, shifts.scale * shifts.stiffness
        own = [forces.tangent(block, system.factors, scale) for forces in part.line_forces]
        return np.concatenate([values, *(matrices.ravel() for matrices in own)])

    def element_values(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """Entries of the matrices of a part's elements, flat."""
        assert part.elements is not None
        return part.elements.values(part.block, system.gravity, shifts.array, shifts.scale, request)

    def masses(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`Mechanics`."""
        return part.masses.tangent(
            part.block, system.gravity, shifts.array, shifts.scale, shifts.local
        )

    def forces(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`Mechanics`."""
        scale = shifts.scale * shifts.stiffness
        return part.forces.tangent(part.block, system.factors, scale)

    def hessians(self, system: System, factor: FloatArray) -> FloatArray:
        """See :class:`Mechanics`."""
        return system.constraints.hessians(factor)

    def add_cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest,
        factor: float,
    ) -> None:  # fmt: skip
        """See :class:`Mechanics`."""
        assert part.elements is not None
        scale = factor * shifts.scale
        part.elements.add_action(part.block, system.gravity, shifts.array, scale, request)
        for forces in part.line_forces:
            forces.add_action(part.block, system.factors, scale * shifts.stiffness)

    def origin(self, system: System, part: BlockPart) -> tuple[dict[str, FloatArray], FloatArray]:
        """See :class:`Mechanics`."""
        return part.block.trial(), system.factors

    def recall(
        self, system: System, part: BlockPart, nodes: Mapping[str, FloatArray], numbers: FloatArray
    ) -> None:
        """See :class:`Mechanics`."""
        for name, values in part.block.trial().items():
            values[:] = nodes[name]
        system.factors[:] = numbers


class _Viscous(EndPoint):
    """Equations of masses and of the linear damping of elements, without gyroscopic terms."""

    def masses(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`Mechanics`."""
        return super().masses(system, part, replace(shifts, velocity=0.0))

    def row_gradients(self, system: System, shifts: Shifts) -> FloatArray:
        """See :class:`Mechanics`; dampers may be among the equations of rows."""
        return system.constraints.step_jacobian

    def element_values(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """See :class:`EndPoint`."""
        with _at_rest(part):
            return super().element_values(system, part, shifts, request)

    def add_cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest,
        factor: float,
    ) -> None:  # fmt: skip
        """See :class:`Mechanics`."""
        with _at_rest(part):
            super().add_cells(system, part, shifts, request, factor)


@contextmanager
def _at_rest(part: BlockPart) -> Iterator[None]:
    """Let derivatives be those at zero velocities."""
    velocity = part.block.velocity.copy()
    part.block.velocity[:] = 0.0
    yield
    part.block.velocity[:] = velocity


#: Equilibrium at the end of a step: the equations of all analyses save other schemes.
END_POINT = EndPoint()
#: Masses and linear damping, for shifts without stiffness.
VISCOUS = _Viscous()
