# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton steps with frozen body factors and a dual Schur complement on the interface.

In local frames the iteration matrix ``A`` of a flexible body hardly changes, so its factors are
kept. Joints act on few nodes, for which the response ``Z = A^-1 J^T`` of each body is computed
once, so that a step costs one residual, one product ``Z^T r``, a small system ``S dL = Phi - G~
A^-1 r`` with ``S = G~ A^-1 G^T + compliance``, and one solve with the factors. If Z has more
entries than the factors, it is not stored, and a step costs two solves, or one with factors in
which the interface comes last (``condensed``). Rigid bodies are always
exact: their 6x6 matrices are inverted at every step.

A rank eliminates the multipliers that only it evaluates. Those shared by ranks are eliminated by
levels of a tree of the ranks.

Closed contacts are stiff springs beside the factors, which leave them out (``stiff_rows``).

If old factors contract slowly, steps can be refined by the action of the exact tangent, without new
factors.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.state import State
from flexfem.layout.tangent_request import TangentRequest
from flexfem.solvers.frozen.bodies import FlexibleBodies, RigidBodies
from flexfem.solvers.frozen.interface import MultiplierSystem
from flexfem.solvers.frozen.pieces import KeptFactor
from flexfem.solvers.frozen.refine import KeptOperator, Refined, Refinement
from flexfem.solvers.frozen.secants import Secants
from flexfem.solvers.frozen.sequences import FrozenSequences
from flexfem.solvers.frozen.stiff_rows import StiffRows
from flexfem.solvers.frozen.vectors import StepVectors
from flexfem.solvers.linear.iterative import iterates
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import MASS, BlockPart, PartStrains, Shifts, System

__all__ = ["FrozenSolver", "Worst"]

#: Number of step sizes whose factors are kept, the latest used: each needs the memory of all
#: factors.
_KEPT = 6
#: The same of bodies that are solved iteratively: large matrices, which are kept beside.
_KEPT_MATRICES = 2
#: Contraction of an iteration from which on the contacts are those of the last one, about.
_ALIKE = 0.1
#: Part of the squared error of the frozen operator above which a body is one of the worst.
_SHARE = 0.01


@dataclass(frozen=True)
class _Kept:
    """Factors of all flexible bodies for one step size, one entry for each part.

    ``numbers`` are those of ``Mechanics.origin``.
    """

    parts: list[KeptFactor]
    numbers: FloatArray


@dataclass(frozen=True)
class Worst:
    """Bodies with factors to be renewed.

    Attributes:
        pieces: numbers of this rank's pieces of every flexible part, maybe empty, or None if there
            are none on any rank.
        share: their share of all unknowns on all ranks.
    """

    pieces: list[list[int] | None]
    share: float


class FrozenSolver:
    """Newton steps with kept factors of the flexible bodies.

    Factors of several step sizes, e.g. of halved steps, are kept at the same time. A solve depends
    on its arguments only; residuals are not changed.

    Attributes:
        shifts: factors of the scheme of the factors in use, None before the first factorisation.
        keepable: True if factors of the multipliers' system may serve several iterations.
        rigid, bodies: rigid bodies, and all of them.
        secants: acceleration of the iteration of a step.
    """

    def __init__(
        self, system: System, mechanics: Mechanics = END_POINT, *, constant: bool = False
    ) -> None:
        """Set up patterns for the matrices of ``mechanics`` (collective).

        ``constant`` is True if flexible bodies are factorised once only.
        """
        self.system, self._mechanics = system, mechanics
        self.shifts: Shifts | None = None
        self._kept: dict[Shifts, _Kept] = {}
        self._multipliers = MultiplierSystem(system, constant=constant)
        self.keepable = self._multipliers.keepable
        groups = self._multipliers.groups
        self.rigid = [RigidBodies(system, g, mechanics) for g in groups if g.part.elements is None]
        self._flexible = [
            FlexibleBodies(system, g, mechanics) for g in groups if g.part.elements is not None
        ]
        # right-hand side, residual, and local node of each interface node, of every part
        self._loads = [(g.own.right, g.part.block.residual, g.part.interface_nodes) for g in groups]
        self._nothing = np.zeros(0)
        self.bodies: list[RigidBodies | FlexibleBodies] = [*self.rigid, *self._flexible]
        self._vectors = StepVectors(system)
        self._refinement = Refinement(system, mechanics, self._vectors)
        self._stiff = StiffRows(system, self._vectors)
        self.secants = Secants(self._vectors)
        self._sequences: FrozenSequences | None = None
        # by step size, where they have been made; of rigid bodies alone they serve all sizes
        self._often: dict[Shifts | None, FrozenSequences | None] = {}

    @classmethod
    def of_masses(cls, system: System) -> "FrozenSolver":
        """Solver with the factors of the masses at the start (collective)."""
        made, blocks = cls(system, constant=True), [part.block for part in system.parts]
        present = [block.frames.copy() for block in blocks]
        for block in blocks:
            block.frames[:] = block.start_frames
        made.factor(MASS)
        for block, frames in zip(blocks, present, strict=True):
            block.frames[:] = frames
        return made

    @property
    def exact(self) -> bool:
        """True if there are rigid bodies alone, whose matrices are never kept."""
        return not self._flexible

    def use(self, shifts: Shifts, strains: PartStrains) -> None:
        """Use the kept factors of a step size, or factorise at the trial state (collective)."""
        kept = self._kept.pop(shifts, None)
        if kept is None:
            self.factor(shifts, strains)
            return
        self._kept[shifts] = kept  # the latest used is the last
        self._stiff.forget()
        self.shifts, self._sequences = shifts, self._often.get(shifts)
        for flexible, one in zip(self._flexible, kept.parts, strict=True):
            flexible.use(one)

    def factor(self, shifts: Shifts, strains: PartStrains | None = None) -> None:
        """Factorise the flexible bodies at the trial state and compute their compliances.

        Args:
            shifts: factors of the scheme.
            strains: strains of each part whose stresses are used; None for the present ones.
        """
        self.shifts = shifts
        self._stiff.forget()
        if not self._flexible:
            return
        self._sequences = None
        system = self.system
        if shifts.stiffness:
            system.counters.factorizations += 1
        else:
            system.counters.mass_factorizations += 1
        self._kept.pop(shifts, None)
        self._often.pop(shifts, None)
        large = any(iterates(system, part, shifts) for part in system.parts)
        while len(self._kept) >= (_KEPT_MATRICES if large else _KEPT):
            oldest = next(iter(self._kept))
            del self._kept[oldest]
            self._often.pop(oldest, None)
        requests = self._requests(shifts, strains)
        parts = [
            flexible.factorise(shifts, request)
            for flexible, request in zip(self._flexible, requests, strict=True)
        ]
        _, numbers = self._mechanics.origin(system, self._flexible[0].group.part)
        self._kept[shifts] = _Kept(parts, numbers.copy())

    def _requests(self, shifts: Shifts, strains: PartStrains | None) -> list[TangentRequest]:
        """Requests for the matrices of the flexible parts, without transient compression."""
        pairs = zip(self.system.parts, strains or self.system.present, strict=True)
        return [
            shifts.request(own, drop_compression=True)
            for part, own in pairs
            if part.elements is not None
        ]

    def worst(self, refined: Refined | None) -> Worst:
        """Bodies with most of the error of the frozen operator in a step (collective).

        All of them, if the step was not refined. Which ones they are is no matter of how whole
        bodies are distributed: those without factors of their own count as one on all ranks.
        """
        if refined is None:
            return Worst([flexible.every for flexible in self._flexible], 1.0)
        limit = _SHARE * self._vectors.squares(refined.missed)[0]
        own: list[list[int]] = []
        # unknowns of large bodies with errors, and of all; of others, and their squared errors
        found = np.zeros((4, len(self._flexible)))
        for i, flexible in enumerate(self._flexible):
            part, common = flexible.group.part, flexible.common
            start = self._vectors.sizes[self.system.parts.index(part)]
            missed = refined.missed[start:][: part.block.sizes[0]].reshape(-1, part.block.width)
            squares = flexible.squares(missed)
            own.append([k for k in flexible.every if k != common and squares[k] > limit])
            found[:2, i] = flexible.rows(own[i]), missed.size
            if common is not None:
                found[2:, i] = flexible.rows([common]), squares[common]
        self.system.comm.Allreduce(MPI.IN_PLACE, found)
        pieces: list[list[int] | None] = []
        renewed = 0.0
        for flexible, chosen, (large, _, small, square) in zip(
            self._flexible, own, found.T.tolist(), strict=True
        ):
            together = square > limit
            if together and flexible.common is not None:
                chosen.insert(0, flexible.common)
            rows = large + small * together
            pieces.append(chosen if rows else None)
            renewed += rows
        return Worst(pieces, renewed / max(float(found[1].sum()), 1.0))

    def renew(self, worst: Worst, strains: PartStrains | None = None) -> None:
        """Factorise these bodies again at the trial state, with the shifts in use (collective)."""
        assert self.shifts is not None
        if worst.share == 1.0:
            self.factor(self.shifts, strains)
            return
        self.system.counters.factorizations += 1
        self._stiff.forget()
        self._sequences = self._often[self.shifts] = None
        requests = self._requests(self.shifts, strains)
        for flexible, request, chosen in zip(self._flexible, requests, worst.pieces, strict=True):
            if chosen is not None:
                flexible.factorise(self.shifts, request, chosen)

    def begin_step(self) -> None:
        """Begin the iterations of a step: nothing is used again of the last one's."""
        self._stiff.forget()
        self.secants.forget()

    def unspring(self) -> None:
        """Solve without the springs of contacts from now on, until the next :meth:`step`."""
        self._stiff.active = False

    @property
    def sprung(self) -> bool:
        """True if contacts were closed on any rank in the last step."""
        return self._stiff.active

    @property
    def rubbing(self) -> bool:
        """True if there was friction in these, of which assembled matrices have nothing."""
        return self._stiff.active and self._stiff.rub

    def state(self) -> State:
        """Return the states and shifts at which factors were computed."""
        shifts = np.array([astuple(s) for s in self._kept], dtype=np.float64)
        values = {
            "frozen_shifts": shifts.reshape(-1, 5),
            "frozen_numbers": np.array([kept.numbers for kept in self._kept.values()]),
        }
        rows = {
            flexible.group.part.block.name: {
                f"frozen_{k}_{name}": array
                for k, kept in enumerate(self._kept.values())
                for name, array in kept.parts[i].nodes.items()
            }
            for i, flexible in enumerate(self._flexible)
        }
        return State(values, rows, optional=frozenset(values))

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state`, by new factorisations (collective).

        The system's state is overwritten. Results of other solvers have no effect.
        """
        if "frozen_shifts" not in state.values:
            return
        if self._flexible:
            numbers = state.values["frozen_numbers"]
            for k, (v, a, scale, stiffness, local) in enumerate(state.values["frozen_shifts"]):
                self._recall(state, f"frozen_{k}_", numbers[k])
                self.factor(Shifts(float(v), float(a), float(scale), float(stiffness), bool(local)))

    def _recall(self, state: State, first: str, numbers: FloatArray) -> None:
        """Restore all flexible parts from arrays whose names begin with ``first``."""
        for flexible in self._flexible:
            part = flexible.group.part
            rows = state.rows[part.block.name]
            nodes = {n.removeprefix(first): x for n, x in rows.items() if n.startswith(first)}
            self._mechanics.recall(self.system, part, nodes, numbers)

    def step(
        self, shifts: Shifts, strains: PartStrains, *, keep_interface: bool = False,
        refine: bool = False, contraction: float = 1.0,
    ) -> tuple[bool, FloatArray, Refined | None]:  # fmt: skip
        """One Newton step from the evaluated residuals (collective).

        Args:
            shifts: factors of the scheme.
            strains: strains of each part whose stresses are used in the exact tangent.
            keep_interface: True to keep the factors of the multipliers' system.
            refine: True to correct the step by the exact tangent's action; residuals are
                overwritten.
            contraction: of the last iteration, by which steps of contacts are refined.

        Returns:
            Success, the step of the multipliers (r,) - both it and the blocks' steps are to be
            subtracted - and the result of the refinement.
        """
        rows = self.system.constraints
        if rows.size_global and not (keep_interface or self.system.contacts):
            found = self._prepare_and_solve(shifts)
            if found is None:
                return False, np.zeros(rows.size), None
            correction = found
        else:
            if keep_interface:
                self._multipliers.follow_sliders()
            elif not self.prepare(shifts):
                return False, np.zeros(rows.size), None
            for contacts in self.system.contacts:
                alike = contraction < _ALIKE
                self._stiff.take(contacts.rows(), shifts, self._compliances, alike=alike)
            correction = self._with_springs(self._solve(rows.values), refine=refine)
        refined = None
        if refine:
            kept = KeptOperator(self._add_kept, self._solve, self._solve_beyond)
            correction, refined = self._refinement.correct(
                shifts, strains, correction, kept, contraction
            )
        return True, -correction, refined

    def _add_kept(self, part: BlockPart, factor: float) -> bool:
        """See ``KeptAction``."""
        return any(one.add_product(factor) for one in self._flexible if one.group.part is part)

    def _compliances(self, block: FrameBlock) -> FloatArray | None:
        """Motions (n_owned, k, w, w) of nodes of a block and the next ones; None if unknown."""
        bodies = next(one for one in self.bodies if one.group.part.block is block)
        return bodies.of_nodes()

    def constrain(
        self, shifts: Shifts, values: FloatArray, keep: bool, flexible: bool
    ) -> tuple[bool, FloatArray]:
        """Multipliers as of :meth:`step`, and the steps of rigid bodies (collective).

        Flexible bodies are not moved.

        Args:
            shifts: of the factors in use.
            values: (r,) of the rows.
            keep: True to keep the factors of the multipliers' system.
            flexible: True if flexible bodies have residuals, too.
        """
        rows = self.system.constraints
        self._multipliers.follow_sliders()
        if not (keep or self.prepare(shifts)):
            return False, np.zeros(rows.size)
        self._multipliers.forget_responses()
        bodies = self.bodies if flexible else self.rigid
        correction = self._load(values, bodies, beyond=False)
        for rigid in self.rigid:
            rigid.solve()
        for bodies_at_rest in self._flexible:
            bodies_at_rest.group.part.block.step[:] = 0.0
        return True, -correction

    def again(self, values: FloatArray) -> tuple[bool, FloatArray]:
        """Steps as of :meth:`step` for the blocks' residuals and given row values (r,)."""
        for contacts in self.system.contacts:
            if self._stiff.active and not contacts.evaluated and self.shifts is not None:
                contacts.evaluate()  # other pairs are near since
                self._stiff.take(contacts.rows(), self.shifts, self._compliances)
        return True, -self._with_springs(self._solve(values))

    def prepare(self, shifts: Shifts) -> bool:
        """Invert the rigid bodies, assemble and factorise the multipliers' system (collective).

        False if it is singular. The residuals are evaluated; :meth:`again` solves after it.
        """
        self._multipliers.follow_sliders()
        sequences = self._sequences_of(shifts)
        if sequences is not None:
            return sequences.prepare(shifts)
        return self._multipliers.factor(self._invert(shifts))

    def _prepare_and_solve(self, shifts: Shifts) -> FloatArray | None:
        """What :meth:`prepare` and :meth:`_solve` for the rows do, with fewer messages."""
        self._multipliers.follow_sliders()
        rows, sequences = self.system.constraints, self._sequences_of(shifts)
        if sequences is not None:
            return sequences.prepare_and_solve(shifts)
        regular = self._invert(shifts)
        self._take_residuals()
        correction = self._multipliers.factor_and_solve(regular, rows.values, self.bodies)
        if correction is not None:
            self._add_forces(correction)
            self._finish()
        return correction

    def _invert(self, shifts: Shifts) -> bool:
        """Invert the rigid bodies' matrices; False if one is singular."""
        regular = True
        for rigid in self.rigid:
            regular = rigid.invert(shifts) and regular
        return regular

    def _sequences_of(self, shifts: Shifts) -> FrozenSequences | None:
        """Sequences for the factors in use, if there are any: from their second use on."""
        if not shifts.stiffness:
            return None
        if self._sequences is None:
            key = self.shifts if self._flexible else None
            if key in self._often:
                self._sequences = self._make_sequences()
            self._often[key] = self._sequences
        return self._sequences

    def _make_sequences(self) -> FrozenSequences | None:
        return FrozenSequences.of(self.system, self._multipliers, self.rigid, self._flexible)

    def _solve(self, values: FloatArray, *, beyond: bool = False) -> FloatArray:
        """Solve with the frozen operator for the blocks' residuals and the given row values.

        The steps are left in the blocks.

        Args:
            values: of this rank's rows, shape (r,).
            beyond: True for a correction of the steps already applied at the interface.

        Returns:
            Correction of the multipliers (r,), always the same array.
        """
        if self._sequences is not None:
            return self._sequences.solve(values, beyond=beyond)
        correction = self._load(values, self.bodies, beyond=beyond)
        self._finish()
        return correction

    def _finish(self) -> None:
        """Steps of the bodies from their right-hand sides, after their responses to these."""
        responded = self.system.constraints.size_global > 0
        for flexible in self._flexible:
            (flexible.complete if responded else flexible.solve)()
        for rigid in self.rigid:
            rigid.solve()

    def _with_springs(self, correction: FloatArray, *, refine: bool = False) -> FloatArray:
        """Add stiff springs, if there are any, to the solve that gave a correction (r,)."""
        if not self._stiff.active:
            return correction
        return self._stiff.correct(correction, self._solve, refine=refine)

    def _solve_beyond(self, values: FloatArray) -> FloatArray:
        """Solve for a correction of steps; soft springs are left to the refinement."""
        correction = self._solve(values, beyond=True)
        return correction if self._stiff.soft else self._with_springs(correction)

    def _load(
        self, values: FloatArray, bodies: Sequence[RigidBodies | FlexibleBodies], *, beyond: bool
    ) -> FloatArray:
        """Write the right-hand sides of bodies: residuals, forces of the multipliers' correction.

        Returns:
            The correction (r,).
        """
        self._take_residuals()
        if not self.system.constraints.size_global:
            return self._nothing
        correction = self._multipliers.solve(values, bodies, beyond=beyond)
        self._add_forces(correction)
        return correction

    def _take_residuals(self) -> None:
        for right, residual, _ in self._loads:
            right[:] = residual

    def _add_forces(self, correction: FloatArray) -> None:
        for right, _, nodes in self._loads:
            self.system.constraints.add_forces(correction, nodes, right)
