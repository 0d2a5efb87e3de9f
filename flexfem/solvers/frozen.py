# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton steps with frozen body factors and a dual Schur complement on the interface.

In local frames the iteration matrix ``A`` of a flexible body hardly changes, so its factors are
kept. Joints touch few nodes, where the response ``Z = A^-1 J^T`` of each body is known once and for
all, so that a step costs one residual, one product ``Z^T r``, a small system
``S dL = Phi - G~ A^-1 r`` with ``S = G~ A^-1 G^T + compliance``, and one solve with the factors.
Where Z has more numbers than the factors, it is not kept, and a step costs two solves.
Rigid bodies are always exact: their 6x6 matrices are inverted at every step.

A rank eliminates the multipliers that only it evaluates. What remains between ranks is summed by
one reduction and solved on all of them alike.

Where old factors contract slowly, steps can be refined by the action of the exact tangent, which
needs no new factors either.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from itertools import pairwise

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.row import LawKind
from flexfem.core.runs import starts
from flexfem.core.state import State
from flexfem.elements.request import TangentRequest
from flexfem.la.dense import inverted
from flexfem.solvers.frozen_bodies import Bodies, FlexibleBodies, KeptFactor
from flexfem.solvers.interface_system import InterfaceSystem
from flexfem.solvers.minimal_residual import minimal_residual
from flexfem.solvers.schur_kernels import (
    multiply_blocks,
    rigid_responses,
    row_products,
    schur,
)
from flexfem.system.system import BlockPart, PartStrains, Shifts, System

__all__ = ["FrozenSolver", "Worst"]

#: Step sizes whose factors are kept, the latest used: each costs the memory of all factors.
_KEPT = 6
#: A refined step solves the linearised equations to this relative accuracy, in at most so many
#: sweeps of action and solve.
_INNER, _SWEEPS = 0.02, 8
#: Bodies whose part of the square of what the frozen operator missed is above this are the worst.
_SHARE = 0.01
#: The multipliers' system is kept within a step while iterations contract like this, or, where
#: steps are refined, while they are smaller than this, m or rad.
_WELL, _NEAR = 0.02, 0.01


@dataclass(frozen=True)
class _Kept:
    """Factors of all flexible bodies for one step size, one entry a part.

    ``numbers`` are those of ``Mechanics.origin``.
    """

    parts: list[KeptFactor]
    numbers: FloatArray


@dataclass(frozen=True)
class Worst:
    """Bodies with factors to be renewed.

    Attributes:
        pieces: numbers of this rank's pieces of every flexible part, which may be none, or None
            where there are none on any rank.
        share: their part of all unknowns on all ranks.
    """

    pieces: list[list[int] | None]
    share: float


class FrozenSolver:
    """Newton steps with kept factors of the flexible bodies.

    Steps of several sizes, halved ones for example, keep their factors side by side.

    Attributes:
        shifts: those of the factors in use, None before the first factorisation.
        refine: correct every step by the exact tangent's action.
        keep_interface: the next iteration keeps the factors of the multipliers' system.
        defect: relative size of what the frozen operator missed in the last refined step.
        exact: the last step solved the linearised equations: fresh factors would not do better.
    """

    def __init__(self, system: System) -> None:
        """Set up patterns (collective)."""
        self.system = system
        self.shifts: Shifts | None = None
        self._kept: dict[Shifts, _Kept] = {}
        self.refine = False
        self.defect, self.exact = 0.0, False
        self._missed: FloatArray | None = None
        rows, face = system.constraints, system.interface
        self._slot_column = np.zeros(len(face.keys), dtype=np.int64)
        self._slot_active = np.zeros(len(face.keys), dtype=np.int64)
        self._local_slot = np.zeros(len(face.keys), dtype=np.bool_)
        self._owned_slot = (face.local >= 0)[:, np.newaxis]
        self._response, self._beyond = np.zeros((2, len(face.keys), 6))
        active = rows.active_components()
        self._groups = [self._describe(part, active) for part in system.parts]
        self._rigid = [g for g in self._groups if g.part.elements is None]
        self._flexible = [
            FlexibleBodies(system, g) for g in self._groups if g.part.elements is not None
        ]
        self._bodies: list[Bodies | FlexibleBodies] = [*self._rigid, *self._flexible]
        self._interface = self._pattern()
        self._sizes = starts([p.block.sizes[0] for p in system.parts])
        linear = bool((rows.elastic[:, 0] <= LawKind.SPRING).all())
        self._keepable = bool(system.comm.allreduce(linear, op=MPI.LAND))
        self.keep_interface = False
        self._version = rows.lines.version

    def _describe(self, part: BlockPart, active: IntArray) -> Bodies:
        """Interface columns of a part's bodies and the sides of terms that act on them."""
        bodies, nodes, node_start = part.clusters()
        slots = np.flatnonzero(self.system.part_of_slot == self.system.parts.index(part))
        slots = slots[np.isin(self.system.cluster_of_slot[slots], bodies)]
        number = np.searchsorted(bodies, self.system.cluster_of_slot[slots])
        widths = np.bincount(number, weights=active[slots], minlength=len(bodies)).astype(np.int64)
        column_start = starts(widths)
        order = np.argsort(number, kind="stable")
        columns = [(slot, k) for slot in slots[order] for k in range(active[slot])]
        first = starts(active[slots[order]])[:-1] - column_start[number[order]]
        self._slot_column[slots[order]] = first
        self._slot_active[slots], self._local_slot[slots] = active[slots], True
        sides, per_body = self._sides(slots, number, len(bodies))
        ranges, range_start = self._ranges(sides, starts(per_body))
        lengths = part.block.width * np.diff(node_start) * widths
        return Bodies(
            part=part,
            nodes=nodes,
            node_start=node_start,
            columns=np.array(columns, dtype=np.int64).reshape(-1, 2),
            column_start=column_start,
            sides=sides,
            side_start=starts(per_body),
            ranges=ranges,
            range_start=range_start,
            compliance_start=starts(widths**2),
            response_start=starts(lengths),
            compliances=np.zeros(int((widths**2).sum())),
            responses=np.zeros(0 if part.elements is not None else int(lengths.sum())),
            entries=np.zeros(int((per_body**2).sum())),
        )

    def _sides(self, slots: IntArray, number: IntArray, count: int) -> tuple[IntArray, IntArray]:
        """Sides of terms (term, side, slot) on the given slots by body, and their numbers."""
        body_of_slot = np.full(len(self._slot_column) + 1, -1, dtype=np.int64)
        body_of_slot[slots] = number
        slot = self.system.constraints.term_slots
        term, side = np.nonzero(body_of_slot[slot] >= 0)  # slot -1 is the last entry, -1
        sides = np.stack([term, side, slot[term, side]], axis=1).astype(np.int64)
        body = body_of_slot[sides[:, 2]]
        sides = np.ascontiguousarray(sides[np.lexsort((sides[:, 2], body))])
        return sides, np.bincount(body, minlength=count).astype(np.int64)

    def _ranges(self, sides: IntArray, start: IntArray) -> tuple[IntArray, IntArray]:
        """Columns that sides act on, in ranges of consecutive ones, and where each body's begin."""
        ranges, counts = [np.empty((0, 2), dtype=np.int64)], []
        for a, b in pairwise(start):
            slots = np.unique(sides[a:b, 2])
            first, active = self._slot_column[slots], self._slot_active[slots]
            order = np.argsort(first)
            first, end = first[order], (first + active)[order]
            begins = np.append(True, first[1:] > end[:-1])[: len(first)]
            ends = np.append(begins[1:], True)[: len(first)]
            ranges.append(np.stack([first[begins], end[ends]], axis=1))
            counts.append(int(begins.sum()))
        return np.concatenate(ranges), starts(counts)

    def _pattern(self) -> InterfaceSystem:
        """Row and column of every entry of the Schur complement on this rank."""
        rows = self.system.constraints
        first, second = [], []
        for group in self._groups:
            for start, end in pairwise(group.side_start):
                r = rows.row_of_term[group.sides[start:end, 0]]
                first.append(np.tile(r, len(r)))
                second.append(np.repeat(r, len(r)))
        every = np.arange(rows.size)
        i = np.concatenate([*first, every, rows.coupled[:, 0]]).astype(np.int64)
        j = np.concatenate([*second, every, rows.coupled[:, 1]]).astype(np.int64)
        self._values, self._right = np.zeros(len(i)), np.zeros(rows.size)
        ends = np.cumsum([*(len(group.entries) for group in self._groups), rows.size])
        *parts, self._diagonal, self._coupling = np.split(self._values, ends)
        for group, entries in zip(self._groups, parts, strict=True):
            group.entries = entries
        return InterfaceSystem(
            self.system.comm, i, j, rows.interior, rows.shared_numbers, rows.shared_size
        )

    def use(self, shifts: Shifts, strains: PartStrains) -> None:
        """Take the kept factors of a step size, or factorise at the trial state (collective)."""
        kept = self._kept.pop(shifts, None)
        if kept is None:
            self.factor(shifts, strains)
            return
        self._kept[shifts] = kept  # the latest used is the last
        self.shifts = shifts
        for flexible, one in zip(self._flexible, kept.parts, strict=True):
            flexible.use(one)

    def factor(self, shifts: Shifts, strains: PartStrains | None = None) -> None:
        """Factorise the flexible bodies at the trial state and compute their compliances.

        Args:
            shifts: factors of the scheme.
            strains: of each part, whose stresses count; None for the present ones.
        """
        self.shifts = shifts
        if not self._flexible:
            return
        system = self.system
        if shifts.stiffness:
            system.counters.factorizations += 1
        else:
            system.counters.mass_factorizations += 1
        self._kept.pop(shifts, None)
        while len(self._kept) >= _KEPT:
            del self._kept[next(iter(self._kept))]
        requests = self._requests(shifts, strains)
        parts = [
            flexible.factorise(shifts, request)
            for flexible, request in zip(self._flexible, requests, strict=True)
        ]
        _, numbers = system.mechanics.origin(system, self._flexible[0].group.part)
        self._kept[shifts] = _Kept(parts, numbers.copy())

    def _requests(self, shifts: Shifts, strains: PartStrains | None) -> list[TangentRequest]:
        """Of the matrices of the flexible parts, without compression, which comes and goes."""
        pairs = zip(self.system.parts, strains or self.system.present, strict=True)
        return [
            shifts.request(own, drop_compression=True)
            for part, own in pairs
            if part.elements is not None
        ]

    def worst(self) -> Worst:
        """Bodies that hold most of what the frozen operator missed in the last step (collective).

        All of them, if the step was not refined.
        """
        if self._missed is None:
            return Worst([flexible.every for flexible in self._flexible], 1.0)
        limit = _SHARE * self._squares(self._missed)[0]
        pieces: list[list[int] | None] = []
        rows = np.zeros((2, len(self._flexible)))
        for i, flexible in enumerate(self._flexible):
            part = flexible.group.part
            start = self._sizes[self.system.parts.index(part)]
            missed = self._missed[start:][: part.block.sizes[0]].reshape(-1, part.block.width)
            worst = flexible.worst(missed, limit)
            pieces.append(worst)
            rows[:, i] = flexible.rows(worst), missed.size
        self.system.comm.Allreduce(MPI.IN_PLACE, rows)
        for i, flexible in enumerate(self._flexible):
            if rows[0, i] == 0.0:
                pieces[i] = None
            elif flexible.split:
                pieces[i], rows[0, i] = flexible.every, rows[1, i]
        return Worst(pieces, float(rows[0].sum() / rows[1].sum()))

    def renew(self, worst: Worst, strains: PartStrains | None = None) -> None:
        """Factorise these bodies anew at the trial state, with the shifts in use (collective)."""
        assert self.shifts is not None
        if worst.share == 1.0:
            self.factor(self.shifts, strains)
            return
        self.system.counters.factorizations += 1
        requests = self._requests(self.shifts, strains)
        for flexible, request, chosen in zip(self._flexible, requests, worst.pieces, strict=True):
            if chosen is not None:
                flexible.factorise(self.shifts, request, chosen)

    def state(self) -> State:
        """Where and with which shifts factors were computed, and whether steps are refined."""
        shifts = np.array([astuple(s) for s in self._kept], dtype=np.float64)
        values = {
            "frozen_shifts": shifts.reshape(-1, 5),
            "frozen_numbers": np.array([kept.numbers for kept in self._kept.values()]),
            "refine": np.array([float(self.refine), self.defect]),
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
        """Take back what :meth:`state` returned; factorises anew (collective).

        The system's state is lost. What another solver left changes nothing.
        """
        if "frozen_shifts" not in state.values:
            return
        if self._flexible:
            numbers = state.values["frozen_numbers"]
            for k, (v, a, scale, stiffness, local) in enumerate(state.values["frozen_shifts"]):
                self._recall(state, f"frozen_{k}_", numbers[k])
                self.factor(Shifts(float(v), float(a), float(scale), float(stiffness), bool(local)))
        self.refine, self.defect = bool(state.values["refine"][0]), float(state.values["refine"][1])

    def _recall(self, state: State, first: str, numbers: FloatArray) -> None:
        """Put all flexible parts where arrays whose names begin with ``first`` were kept."""
        for flexible in self._flexible:
            part = flexible.group.part
            rows = state.rows[part.block.name]
            nodes = {n.removeprefix(first): x for n, x in rows.items() if n.startswith(first)}
            self.system.mechanics.recall(self.system, part, nodes, numbers)

    def step(self, shifts: Shifts, strains: PartStrains) -> tuple[bool, FloatArray]:
        """One Newton step from the evaluated residuals (collective).

        Args:
            shifts: factors of the scheme.
            strains: of each part, whose stresses the exact tangent takes.

        Returns:
            Success, and the step of the multipliers (r,); both it and the blocks' steps are to be
            subtracted.
        """
        rows = self.system.constraints
        if rows.lines.version != self._version:
            self._follow_sliders()
        if not (self.keep_interface or self._factor_interface(shifts)):
            return False, np.zeros(rows.size)
        self._solve(rows.values)
        self.exact, self._missed = False, None
        if not self.refine:
            return True, -self._right
        solution = self._collect()
        solution += self._refinement(shifts, strains, solution)
        return True, self._put(solution)

    def constrain(self, shifts: Shifts, keep: bool, flexible: bool) -> tuple[bool, FloatArray]:
        """Multipliers as of :meth:`step`, and the steps of rigid bodies (collective).

        Flexible bodies stay where they are.

        Args:
            shifts: of the factors in use.
            keep: the factors of the multipliers' system are still good.
            flexible: flexible bodies have residuals, too.
        """
        rows = self.system.constraints
        if rows.lines.version != self._version:
            self._follow_sliders()
        if not (keep or self._factor_interface(shifts)):
            return False, np.zeros(rows.size)
        self._response[:] = 0.0
        self._solve_interface(rows.values, self._bodies if flexible else self._rigid, False)
        self._solve_rigid()
        for bodies in self._flexible:
            bodies.group.part.block.step[:] = 0.0
        return True, -self._right

    def observe(self, size: float, contraction: float, tolerance: float) -> None:
        """Keep the factors of the multipliers' system in the next iteration, or not.

        What they miss after a step is of second order in its size (m, rad), and refinement corrects
        it. All ranks decide alike.
        """
        good = size <= _NEAR if self.refine else contraction < _WELL and size * size <= tolerance
        self.keep_interface = self._keepable and good

    def again(self, values: FloatArray) -> bool:
        """Blocks' steps for their residuals and given row values (r,), after :meth:`step`."""
        self._solve(values)
        return True

    def _refinement(self, shifts: Shifts, strains: PartStrains, solution: FloatArray) -> FloatArray:
        """Correction that the exact tangent asks for: GMRES, preconditioned by the frozen solve."""
        count, hessians = self._sizes[-1], self.system.hessians()

        def apply(vector: FloatArray) -> FloatArray:
            multipliers = self._put(vector)
            for part in self.system.parts:
                part.block.residual[:] = 0.0
            self.system.subtract_tangent(shifts, hessians, strains)
            self.system.add_constraint_forces(-multipliers)
            self._solve(self.system.constraints.yielding(multipliers), beyond=True)
            return -self._collect()

        # the blocks hold the first solution s as their steps, and as their residuals A_0 s, which
        # has the forces of the multipliers in it
        self.system.subtract_tangent(shifts, hessians, strains)
        rows = self.system.constraints
        self._solve(rows.values + rows.yielding(solution[count:]), beyond=True)
        self._missed = residual = self._collect()
        size, missed = np.sqrt(self._squares(solution, residual)).tolist()
        self.defect = missed / size if size > 0.0 else 0.0
        correction, self.exact = minimal_residual(
            apply, residual, missed, self._products, _INNER * size, _SWEEPS
        )
        return correction

    def _products(self, rows: FloatArray, vector: FloatArray) -> FloatArray:
        """Inner products (k,) of rows (k, n) with a vector: the blocks' parts, over all ranks."""
        count = self._sizes[-1]
        return self._sum(rows[:, :count] @ vector[:count])

    def _squares(self, *vectors: FloatArray) -> FloatArray:
        """Squares of the norms of the blocks' parts over all ranks."""
        count = self._sizes[-1]
        return self._sum(np.array([v[:count] @ v[:count] for v in vectors]))

    def _sum(self, values: FloatArray) -> FloatArray:
        if self.system.comm.size > 1:
            self.system.comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def _put(self, solution: FloatArray) -> FloatArray:
        """Write the blocks' parts of a solution to their steps; the multipliers' part."""
        for part, (start, end) in zip(self.system.parts, pairwise(self._sizes), strict=True):
            part.block.owned_step[:] = solution[start:end].reshape(-1, part.block.width)
        return solution[self._sizes[-1] :]

    def _factor_interface(self, shifts: Shifts) -> bool:
        """Invert the rigid bodies, assemble and factorise the multipliers' system."""
        rows, regular = self.system.constraints, True
        for group in self._rigid:
            regular = self._invert_rigid(group, shifts)
        for group in self._groups:
            schur(
                group.sides, group.side_start, self._slot_column, self._slot_active,
                group.column_start, group.compliances, group.compliance_start,
                rows.force_jacobian, rows.step_jacobian, group.entries,
            )  # fmt: skip
        np.multiply(rows.owned, rows.compliance, out=self._diagonal)
        if len(rows.coupling):
            self._coupling[:] = rows.owned[rows.coupled[:, 0]] * rows.coupling
        if rows.size_global:
            regular = self._interface.factor(self._values, regular)
        return regular

    def _follow_sliders(self) -> None:
        """Take the nodes that sliders act on now; the bodies stay the same."""
        rows = self.system.constraints
        self._version = rows.lines.version
        for group in self._groups:
            group.sides[:, 2] = rows.term_slots[group.sides[:, 0], group.sides[:, 1]]
            group.ranges, group.range_start = self._ranges(group.sides, group.side_start)

    def _collect(self) -> FloatArray:
        """Steps of the owned nodes of all blocks, then of this rank's multipliers, as a vector."""
        steps = [p.block.owned_step.ravel() for p in self.system.parts]
        # S dL = Phi - G~ y is the correction; steps are to be subtracted
        return np.concatenate([*steps, -self._right])

    def _solve(self, values: FloatArray, *, beyond: bool = False) -> None:
        """Solve with the frozen operator for the blocks' residuals and the given row values.

        The residuals get the constraint forces added that the solution implies; the steps are left
        in the blocks, the correction of the multipliers in ``_right``.

        Args:
            values: Of this rank's rows, shape (r,).
            beyond: The solution is one beyond the steps that the interface holds.
        """
        if self.system.constraints.size_global:
            self._solve_interface(values, self._bodies, beyond)
        for flexible in self._flexible:
            flexible.solve()
        self._solve_rigid()

    def _solve_interface(
        self, values: FloatArray, bodies: Sequence[Bodies | FlexibleBodies], beyond: bool
    ) -> None:
        """Correction of the multipliers to ``_right``, its forces to the residuals.

        Args:
            values: as in :meth:`_solve`.
            bodies: those with residuals.
            beyond: as in :meth:`_solve`.
        """
        rows = self.system.constraints
        for one in bodies:
            one.respond(self._response)
        self._beyond[:] = 0.0
        if beyond:
            np.multiply(self._owned_slot, self.system.interface.steps, out=self._beyond)
        self._beyond += self._response
        row_products(
            rows.term_slots, rows.row_of_term, self._local_slot, rows.step_jacobian,
            self._beyond, rows.owned, values, self._right,
        )  # fmt: skip
        self._interface.solve(self._right)
        self.system.add_constraint_forces(self._right)

    def _solve_rigid(self) -> None:
        for group in self._rigid:
            block = group.part.block
            multiply_blocks(self._inverses, block.residual, block.step)

    def _invert_rigid(self, group: Bodies, shifts: Shifts) -> bool:
        """Fresh inverses of the rigid bodies' matrices and their compliances."""
        part = group.part
        blocks = np.zeros((part.block.owned, 6, 6))
        masses = self.system.mechanics.masses(self.system, part, shifts)
        np.add.at(blocks, part.masses.nodes, masses)
        if len(part.forces.nodes):
            forces = self.system.mechanics.forces(self.system, part, shifts)
            np.add.at(blocks, part.forces.nodes, forces)
        self._inverses, regular = inverted(blocks)
        rigid_responses(
            self._inverses, group.columns, group.column_start, group.response_start,
            group.compliance_start, group.responses, group.compliances,
        )  # fmt: skip
        return regular
