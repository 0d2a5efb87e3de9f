# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraint equations and force laws (rows) of all joints of this rank, as one batch."""

import weakref
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np

from flexfem._faults import FAILURES, ReturnError, noted
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.function_checks import Functions
from flexfem.constraints.interface import Interface
from flexfem.constraints.numbered_rows import NumberedRows
from flexfem.constraints.rows.data import RowArrays
from flexfem.constraints.rows.hessians import (
    add_dampers,
    add_hessians,
    second_rates,
    velocity_changes,
)
from flexfem.constraints.rows.kernels import (
    ON_LINES,
    add_forces,
    evaluate_rows,
    marker_poses,
    marker_wrenches,
    sums_of_terms,
    update_angles,
    update_wraps,
)
from flexfem.constraints.rows.laws import elastic_part, static_forces
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.laws import APPLIED, DAMPED_BY_COEFFICIENT, STORING_FUNCTIONS, LawKind
from flexfem.core.nodes.action_kernels import add_turning_forces
from flexfem.core.row import Row, RowKind
from flexfem.core.state import State
from flexfem.kernels.sequence import Call, Number, Step, sequence

__all__ = ["Constraints"]

#: (kinds, 2) of ``RowKind.axes``
_BY_AXES = np.array([kind.axes for kind in RowKind])
#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])


class Constraints(NumberedRows):
    """Rows of all joints of this rank, their values, derivatives and multipliers.

    Its arrays are updated in place and never replaced, since ``own`` passes them to compiled loops.

    ``targets``, ``active``, ``held``, ``angles`` and ``forces`` are the state of the rows in a
    checkpoint.

    Attributes:
        interface: nodes to which joints are attached.
        own: markers, terms and rows in the format of the compiled loops.
        multipliers: (r,) trial values, scaled by ``beta h^2``.
        forces: (r,) accepted multipliers, not scaled (N or N m for rows in m or rad).
        impulses: (r,) forces besides, means over the last step: of unilateral rows, and what other
            rows take of these and of contacts, see ``integrators.split``.
        entering: (r,) those with which the last step began: ``forces`` of the step before, or other
            ones where unilateral rows have begun or ceased to act by impulses.
        settled: (r,) steps for which a row that acts by impulses has been closed.
        unilateral: (r,) rows that are slack between limits, but for normal forces and tensions of
            friction. Released rows count as well.
        split: True if unilateral rows may act by impulses.
        slack: True if none of them on any rank has a force at the accepted state, as is known after
            a step without.
        poses: (m, 12) frames of the markers at the last evaluation, see ``marker_start``.
        mean_forces: True if ``forces`` are means over the last step, not those at its end.
        damped: True if a row of this rank may have a force by its rate.
        consistent: True if ``forces`` belong to accelerations that satisfy the constraints, as at a
            start.
        reported: (r,) such forces, once they are computed, see ``System.reported_forces``.
        held: (r,) True for locked rows: their target is a value from the motion, not that of a
            drive.
        values, compliance: (r,) residuals and compliances of the last evaluation.
        coupling: (k,) compliances between the multipliers of ``coupled`` rows.
        instant: time of drives and laws, s.
        slopes: (r, 2) derivatives of ``values`` by a row's sum and its rate.
        force_jacobian: (t, 2, 6) gradients with respect to the nodes' local twists.
        step_jacobian: (t, 2, 6) derivatives of ``values`` along these twists.
    """

    def __init__(
        self, comm: MPI.Intracomm, joints: Sequence[PlacedJoint], interface: Interface
    ) -> None:
        """Collect the rows (collective: numbers the multipliers)."""
        super().__init__(comm, joints)
        self.interface = interface
        total, terms = len(self.targets), len(self.row_of_term)
        self._driven = [(i, j) for i, j in enumerate(self.joints) if j.joint.driven]
        self._room: dict[int, list[int] | None] = {
            i: None
            if joint.on_lines
            else np.diff(self.term_start[self.start[i] : self.start[i + 1] + 1]).tolist()
            for i, joint in self._driven
        }
        self._parts = {i: slice(*self.start[i : i + 2].tolist()) for i, _ in self._driven}
        self._prescribed = [
            (i, joint)
            for i, joint in self._driven
            if (self.elastic[self._parts[i], 0] == LawKind.RIGID).any()
        ]
        self.multipliers, self.forces = np.zeros(total), np.zeros(total)
        self.values, self.compliance = np.zeros(total), np.zeros(total)
        self.coupling, self.slopes = np.zeros(len(self.coupled)), np.zeros((total, 2))
        self.force_jacobian, self.step_jacobian = np.zeros((terms, 2, 6)), np.zeros((terms, 2, 6))
        self.impulses, self.entering, self.settled = np.zeros((3, total))
        # impulses of rows over the steps of one row of the history, N s, and the span of these, s
        self.passed, self.span = np.zeros(total), 0.0
        self.mean_forces = self.consistent = self.split = self.slack = False
        self.unilateral = self._slack()
        self.has_unilateral: bool = comm.allreduce(bool(self.unilateral.any()), op=MPI.LOR)
        self.instant = 0.0
        self.reported: FloatArray | None = None
        self.held: BoolArray = np.zeros(total, dtype=np.bool_)
        self.poses = np.zeros((len(self.marker_node), 12))
        # twists of the interface nodes, and that of the ground, whose number is -1
        self._padded = np.zeros((len(interface.keys) + 1, 6))
        self.own = RowArrays(
            marker_node=self.marker_node, marker_offset=self.marker_offset, poses=self.poses,
            term_marker=self.term_marker, term_nodes=self.term_nodes,
            row_of_term=self.row_of_term, pair_of_term=self.pair_of_term, kinds=self.kinds,
            directions=self.directions, factors=self.factors, angles=self.angles,
            force_jacobian=self.force_jacobian, step_jacobian=self.step_jacobian,
            term_start=self.term_start, targets=self.targets,
            target_rates=self.target_rates, active=self.active, elastic=self.elastic,
            functions=self.functions, function_data=self.function_data,
            multipliers=self.multipliers, values=self.values, compliance=self.compliance,
            slopes=self.slopes, line_sums=self.lines.sums, relaxation=0.0, coupled=self.coupled,
            wrapped_rows=self.wrapped_rows, wrap_terms=self.wrap_terms, wraps=self.wraps,
            coupling=self.coupling, excess=np.zeros(total),
        )  # fmt: skip
        of_rate = ~np.isin(self.elastic[:, 0], (*DAMPED_BY_COEFFICIENT, LawKind.ELEMENT))
        damping = (self.elastic[:, 2] != 0.0) | of_rate
        self.damped = bool(damping.any())
        self._dynamics, self._velocity = np.ones(2), Number(1.0)
        self._holds = bool(interface.held.any())
        self._functions = Functions(self)

    @property
    def mean_impulses(self) -> FloatArray:
        """Impulses (r,) over a row of the history, as mean forces, N."""
        return self.passed / self.span if self.span > 0.0 else self.impulses

    @property
    def relaxation(self) -> float:
        """Compliance of rigid rows, 1/kg; zero unless constraints may be redundant."""
        return self.own.relaxation

    @relaxation.setter
    def relaxation(self, value: float) -> None:
        self.own.relaxation = value

    def state(self) -> State:
        """State of the rows at the accepted step: forces, targets, active and locked rows."""
        active, held = self.active.astype(np.float64), self.held.astype(np.float64)
        rows = {"forces": self.forces, "targets": self.targets, "active": active, "held": held}
        if self.has_unilateral or self.split:
            rows |= {"impulses": self.impulses, "settled": self.settled}
        values = {"relaxation": np.array([self.relaxation])}
        lines = {
            "places": {"places": self.lines.accepted_places()},
            "line_terms": {"line_angles": self.lines.angles},
        }
        state = State(values, {"rows": rows, "terms": {"angles": self.angles}, **lines})
        return state | self.elements.state() if self.has_elements else state

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state`."""
        rows = state.rows["rows"]
        self.forces[:], self.targets[:] = rows["forces"], rows["targets"]
        self.active[:], self.held[:] = rows["active"] > 0.0, rows["held"] > 0.0
        if self.has_unilateral or self.split:
            self.impulses[:], self.settled[:] = rows["impulses"], rows["settled"]
        self.angles[:] = state.rows["terms"]["angles"]
        self.lines.restore_places(state.rows["places"]["places"])
        self.lines.angles[:] = state.rows["line_terms"]["line_angles"]
        self.relaxation = float(state.values["relaxation"][0])
        if self.has_elements:
            self.elements.restore(state)
        self.consistent, self.slack, self.reported = False, False, None

    def active_components(self) -> IntArray:
        """(n_nodes,) 3 where joint forces act at the node's origin only, else all its unknowns."""
        active = np.full(len(self.interface.keys), 3, dtype=np.int64)
        for side in range(2):
            marker, node = self.term_marker[:, side], self.term_nodes[:, side]
            turning = _BY_AXES[np.minimum(self.kinds, RowKind.FUNCTION), side]
            turning |= np.any(self.marker_offset[marker, :3] != 0.0, axis=1)
            turning |= self.kinds == ON_LINES
            active[node[turning & (node >= 0)]] = 6
        active[self.lines.nodes] = 6
        return np.minimum(active, self.interface.width)

    def reactions(self, forces: FloatArray) -> FloatArray:
        """(m, 6) wrenches that the joints exert on the bodies at their markers.

        Force (N) and moment (N m) about the marker's origin, in inertial axes, at the last
        evaluation; markers ``marker_start[i]`` to ``marker_start[i + 1]`` belong to joint i. A
        wrench on the ground counts like any other.

        Args:
            forces: (r,) of all rows, see ``System.reported_forces``.
        """
        out = np.zeros((len(self.marker_node), 6))
        marker_wrenches(self.own.memory, forces, out)
        self.lines.add_wrenches(forces, out)
        return out

    def angles_of(self, joint: int) -> FloatArray:
        """Continuous angles (rad) of all terms of a joint at the accepted state, row after row."""
        if self.joints[joint].on_lines:
            return self.lines.angles_of(joint)
        rows = self.term_start[self.start[joint : joint + 2]]
        return self.angles[rows[0] : rows[1]]

    def lock(self, name: str) -> None:
        """Lock the switchable rows of a joint at their present values (collective).

        The accepted positions stay as they are; velocities must be made consistent by the caller.

        Raises:
            ValueError: there is no such joint, or nothing to lock in it; on all ranks.
        """
        rows = self._switchable(name)
        self.targets[rows] = self.sums()[rows]
        self._switch(rows, True)

    def release(self, name: str) -> None:
        """Release the switchable rows of a joint (collective).

        Raises:
            ValueError: there is no such joint, or nothing to release in it; on all ranks.
        """
        self._switch(self._switchable(name), False)

    def rows_of(self, name: str) -> IntArray:
        """Rows of a joint that can be switched, all if none is marked as switchable.

        There are none on a rank that does not evaluate it.
        """
        own = self._named(name)
        chosen = own & self.switchable if (own & self.switchable).any() else own
        return np.flatnonzero(chosen).astype(np.int64)

    def set_active(self, name: str, active: bool, hold: bool = False) -> None:
        """Activate or release a joint's rows; velocities must be made consistent by the caller.

        Args:
            name: of any joint; a rank that does not evaluate it does nothing.
            active: True to enforce its rows, False to release them.
            hold: True to lock the rows at their present values, of the interface's state, instead
                of targets and drives.
        """
        rows = self.rows_of(name)
        self.held[rows] = hold
        if hold:
            self.place_markers()
            self.targets[rows] = self.sums()[rows]
        self._switch(rows, active)

    def _named(self, name: str) -> BoolArray:
        named = [i for i, placed in enumerate(self.joints) if placed.joint.name == name]
        return np.isin(self.joint_of_row, named)

    def _switchable(self, name: str) -> IntArray:
        rows = np.flatnonzero(self.switchable & self._named(name)).astype(np.int64)
        if self.comm.allreduce(len(rows)) == 0:
            raise ValueError(f'joint "{name}": no such joint can be locked and released')
        return rows

    def _switch(self, rows: IntArray, active: bool) -> None:
        self.active[rows] = active
        self.multipliers[rows] = self.forces[rows] = self.impulses[rows] = 0.0
        self.settled[rows] = 0.0

    @property
    def rigid(self) -> BoolArray:
        """(r,) True for constraint equations; the other rows have a force law, or are released."""
        held: BoolArray = self.active & (self.elastic[:, 0] == LawKind.RIGID)
        return held

    def _slack(self) -> BoolArray:
        """(r,) see ``unilateral``."""
        kinds, lower, upper = self.elastic[:, 0], self.elastic[:, 3], self.elastic[:, 4]
        slack = np.isin(kinds, (LawKind.LIMIT, LawKind.PRESS))
        slack |= (kinds == LawKind.CURVE) & (lower < upper)
        slack[self.coupled[:, 1]] = False
        found: BoolArray = slack
        return found

    @property
    def apart(self) -> BoolArray:
        """(r,) rows that act by ``impulses`` alone: unilateral ones without part in ``forces``."""
        found: BoolArray = self.unilateral & (self.forces == 0.0) & self.split
        return found

    def laws_forces(self) -> FloatArray:
        """(r,) forces of laws at the last evaluation, with unscaled multipliers; zero if rigid."""
        law = self.compliance > 0.0
        found: FloatArray = np.divide(
            self.values, self.compliance, out=np.zeros(self.size), where=law
        )
        return (found + self.multipliers) * (law & ~self.rigid)

    @property
    def of_elements(self) -> BoolArray:
        """(r,) active rows of force elements."""
        found: BoolArray = self.active & (self.elastic[:, 0] == LawKind.ELEMENT)
        return found

    @property
    def pulling(self) -> BoolArray:
        """(r,) rows with forces that depend on positions: springs, stops, functions of forces.

        Forces of whole elements, which may act along all motions, do not count.
        """
        nonlinear = ~self.linear & self._forces_alone().any(axis=1)
        hanging = self.elastic[:, 0] == LawKind.POTENTIAL
        pulls: BoolArray = (self.elastic[:, 1] > 0.0) | nonlinear | hanging
        return self.active & pulls

    @property
    def working(self) -> BoolArray:
        """(r,) rows whose forces do work on the model: drives, and functions of forces.

        Friction of a cable on a winch dissipates what it takes.
        """
        driven = np.array([j.joint.driven for j in self.joints], dtype=np.bool_)
        drives = driven[self.joint_of_row] & (self.elastic[:, 0] != LawKind.CAPSTAN)
        free = np.isin(self.elastic[:, 0], (LawKind.FUNCTION, LawKind.ELEMENT))
        works: BoolArray = drives | free
        return works

    @property
    def storing(self) -> BoolArray:
        """(r,) drives that move the rest of a spring or stop, which works on what it stores."""
        kinds, stiff = self.elastic[:, 0], self.elastic[:, 1] > 0.0
        sprung = stiff & np.isin(kinds, (LawKind.SPRING, LawKind.LIMIT))
        stores: BoolArray = self.working & (sprung | np.isin(kinds, STORING_FUNCTIONS))
        return stores

    @property
    def size(self) -> int:
        """Number of rows of this rank, shared ones included."""
        return len(self.values)

    @property
    def driven(self) -> bool:
        """True if a row of this rank depends on time."""
        return bool(self._driven)

    def set_time(self, t: float) -> None:
        """Update the rows of driven joints and the data of force functions to time ``t``."""
        self.instant = t
        self.function_data[:, 0] = t
        for i, joint in self._driven:
            if not self.held[self._parts[i].start]:
                self._drive(i, joint, t)

    def _drive(self, i: int, joint: PlacedJoint, t: float) -> None:
        """Rows of a driven joint, not finite where its function fails."""
        try:
            self._write_drive(i, joint, t)
        except FAILURES as error:
            functions = filter(callable, vars(joint.joint).values())
            noted(joint.joint.owner, next(functions, joint.joint.rows), error)
            self.targets[self._parts[i]] = np.nan

    def _write_drive(self, i: int, joint: PlacedJoint, t: float) -> None:
        forces = joint.joint.applied(t)
        if forces is not None:
            self.elastic[self._parts[i], APPLIED] = forces
            return
        targets = joint.targets(t)
        if targets is not None:
            self.targets[self._parts[i]] = targets
            return
        rows = joint.rows(t)
        if not self._fit(i, rows):
            raise ReturnError("rows must be as many, of as many terms, at all times")
        self.write(i, rows)

    def _fit(self, i: int, rows: Sequence[Row]) -> bool:
        """True if there is room for these rows of a joint, as there was for the first ones."""
        room = self._room[i]
        if room is None:  # lines have room for rows, whatever their terms
            return len(rows) == int(self.start[i + 1]) - int(self.start[i])
        return [len(row.terms) for row in rows] == room

    def set_drives(self, t: float) -> None:
        """Update the constraint equations of driven joints to time ``t``, without force laws."""
        for i, joint in self._drives():
            self._write_drive(i, joint, t)

    def drives_at(self, times: Sequence[float]) -> tuple[FloatArray, BoolArray]:
        """Targets (k, r) of all rows at k times (s), and (r,) True where terms depend on time."""
        targets = np.empty((len(times), self.size))
        targets[:] = self.targets
        differing: BoolArray = np.zeros(self.size, dtype=np.bool_)
        for i, joint in self._drives():
            own = self._parts[i]
            alone = [joint.targets(t) for t in times]
            if alone[0] is not None:
                targets[:, own] = alone
                continue
            seen = [joint.rows(t) for t in times]
            targets[:, own] = [[row.target for row in rows] for rows in seen]
            data = np.array([[term.data for row in rows for term in row.terms] for rows in seen])
            of_row = np.repeat(np.arange(len(seen[0])), [len(row.terms) for row in seen[0]])
            differing[own][of_row[(data != data[0]).any(axis=(0, 2, 3))]] = True
        return targets, differing

    def _drives(self) -> Iterator[tuple[int, PlacedJoint]]:
        """Driven joints with constraint equations, with their numbers."""
        for i, joint in self._prescribed:
            if not self.held[self._parts[i].start]:
                yield i, joint

    def evaluate(self, dynamics: FloatArray, *, elements: bool = True) -> None:
        """Evaluate all rows at the interface's state.

        Args:
            dynamics: (2,) ``gamma/(beta h)`` and ``beta h^2``.
            elements: False to leave out the laws of force elements.
        """
        self.use(dynamics)
        self._evaluate_rows()
        if elements and self.elements.groups:
            self.evaluate_elements()

    def use(self, dynamics: FloatArray) -> None:
        """Use these factors, see :meth:`evaluate`, in :attr:`steps` from now on."""
        self._dynamics[:] = dynamics
        self._velocity.set(float(dynamics[0]))

    @property
    def steps(self) -> list[Step]:
        """What :meth:`evaluate` does besides :attr:`checks`, for sequences that contain it."""
        every, own = self._steps_of_rows(), weakref.proxy(self)
        return [*every, _later(own, "evaluate_elements")] if self.elements.groups else every

    def _steps_of_rows(self) -> list[Step]:
        """Steps of all rows, without the laws of force elements."""
        # they have no references to those who hold them, which would outlive their runs
        own: Constraints = weakref.proxy(self)
        frames, nodes = self.interface.frames, self.interface.interface_nodes.memory
        steps: list[Step] = []
        if self.lines.joints:
            steps.append(lambda: own.lines.evaluate(frames, own.poses, own.force_jacobian))
        steps.append(Call(evaluate_rows, self.own.memory, nodes, self._dynamics))
        if self.damped:
            given = self._velocity, False, self.slopes, self.step_jacobian
            steps.append(Call(add_dampers, self.own.memory, nodes, *given))
            if self.lines.joints:
                steps.append(lambda: own._add_line_dampers(own.slopes[:, 1], own._velocity.value))
        if self._holds:
            steps.append(_later(own, "hold_gradients"))
        return steps

    @property
    def checks(self) -> list[Step]:
        """What follows :attr:`steps` anywhere in a sequence: values of functions are watched."""
        own: Constraints = weakref.proxy(self)
        return [self._functions.watch(own)] if self._functions.places else []

    @cached_property
    def _evaluate_rows(self) -> Callable[[], None]:
        return sequence([*self._steps_of_rows(), *self.checks])

    def evaluate_elements(self) -> None:
        """Write the equations of force elements."""
        self.elements.evaluate(self, self._dynamics)
        self.hold_gradient(self.step_jacobian)

    def node_velocities(self) -> FloatArray:
        """(n + 1, 6) local twists of the interface nodes, and of the ground, whose number is -1."""
        self._padded[:-1] = self.interface.velocities
        return self._padded

    def velocity_changes(self, velocity: float) -> FloatArray:
        """(n, 6, 6) derivatives of these by steps of the nodes; ``velocity``: dv/dn, 1/s."""
        return velocity_changes(self.interface.interface_nodes.memory, velocity)

    def rate_changes(self, slopes: FloatArray, velocity: float, *, held: bool) -> FloatArray:
        """(t, 2, 6) changes of the rates of rows along steps, times their slopes.

        Args:
            slopes: (r, 2) derivatives by sums, which are not used, and by rates.
            velocity: dv/dn of the time integrator, 1/s.
            held: True if the nodes' velocities do not depend on steps.
        """
        out, face = np.zeros_like(self.step_jacobian), self.interface
        add_dampers(self.own.memory, face.interface_nodes.memory, velocity, held, slopes, out)
        if self.lines.joints:
            memory = face.interface_nodes.memory
            by_step = (
                np.zeros((len(face.keys), 6, 6)) if held else velocity_changes(memory, velocity)
            )
            self.lines.add_dampers(slopes[:, 1], face.velocities, by_step, self.force_jacobian, out)
        self.hold_gradient(out)
        return out

    def static_forces(self) -> FloatArray:
        """(r, 2) forces at rest and their slopes; zero for rigid rows and for friction."""
        out = self._forces_alone()
        if self.elements.groups:
            self.elements.static_forces(self, out)
        return out

    def _forces_alone(self) -> FloatArray:
        """The same without those of force elements."""
        out = np.zeros((self.size, 2))
        values = self.sums() - self.targets
        static_forces(self.elastic, self.functions, self.function_data, values, out)
        return out

    def stored(self) -> tuple[FloatArray, FloatArray]:
        """(r,) energy stored in rows, and their elastic force; zero for rigid and released ones."""
        energies, pulls = np.zeros((2, self.size))
        if self.elastic[:, 0].any():  # else all are rigid
            values = self.sums() - self.targets
            elastic_part(
                self.elastic, self.functions, self.function_data, self.active, values, energies,
                pulls,
            )  # fmt: skip
        return energies, pulls

    def hold_gradients(self) -> None:
        """Set all gradients to zero along fixed unknowns."""
        self.hold_gradient(self.force_jacobian)
        self.hold_gradient(self.step_jacobian)

    def hold_gradient(self, gradient: FloatArray) -> None:
        """Set gradients (t, 2, 6) to zero along fixed unknowns."""
        if self._holds:
            held = np.concatenate([self.interface.held, np.zeros((1, 6), dtype=np.bool_)])
            gradient[held[self.term_nodes]] = 0.0  # the ground's interface node is -1

    def yielding(self, multipliers: FloatArray, *, transposed: bool = False) -> FloatArray:
        """(r,) contribution of multipliers (r,) to the residuals of rows with laws.

        With ``transposed`` by the transposed matrix of compliances and couplings.
        """
        values = self.compliance * multipliers
        if len(self.coupling):
            i, j = self.coupled.T[::-1] if transposed else self.coupled.T
            np.add.at(values, i, self.coupling * multipliers[j])
        return values

    def use_rates(
        self, velocity: float, by_time: tuple[FloatArray, FloatArray], over: float
    ) -> FloatArray:
        """Replace the values of the rigid rows by their rates, with exact derivatives.

        Args:
            velocity: dv/dn, 1/s.
            by_time: (r,) rate of every row at fixed positions, from drives, and (t, 2, 6) that of
                its gradients.
            over: what rates are divided by, 1/s.

        Returns:
            The values of the rigid rows (r,), zero for the others.
        """
        face, rigid = self.interface, self.rigid
        values = self.values * rigid
        rates = (self.rates() + by_time[0]) / over - self.relaxation * self.multipliers
        self.values[:] = np.where(rigid, rates, self.values)
        slopes = np.zeros((self.size, 2))
        slopes[rigid, 1] = 1.0 / over
        terms = rigid[self.row_of_term]
        self.step_jacobian[terms] = by_time[1][terms] / over
        add_dampers(
            self.own.memory,
            face.interface_nodes.memory,
            velocity,
            False,
            slopes,
            self.step_jacobian,
        )
        self._add_line_dampers(slopes[:, 1], velocity)
        self.hold_gradient(self.step_jacobian)
        return values

    def changes(self, twists: FloatArray, sides: BoolArray | None = None) -> FloatArray:
        """(r,) change of every row along local twists of the interface nodes.

        Args:
            twists: (n_nodes, 6) of the interface nodes.
            sides: (t, 2) sides of the terms that move, all if None.
        """
        change = self.side_changes(twists)
        return self.of_rows(change if sides is None else change * sides)

    def value_changes(self, twists: FloatArray) -> FloatArray:
        """(r,) change of ``values`` along local twists (n_nodes, 6) at fixed multipliers."""
        return self.of_rows(self._side_changes(twists, self.step_jacobian))

    def mobilities(self, nodes: FloatArray) -> FloatArray:
        """(r,) of all rows, ``sum g^2 / m``, by those (n_nodes, 6) of the interface nodes, 1/m."""
        return self.of_rows(self._side_changes(nodes, self.force_jacobian**2))

    def side_changes(self, twists: FloatArray) -> FloatArray:
        """(t, 2) change of every term by the motion of each of its sides, see :meth:`changes`."""
        return self._side_changes(twists, self.force_jacobian)

    def _side_changes(self, twists: FloatArray, gradient: FloatArray) -> FloatArray:
        """The same with any gradient (t, 2, 6)."""
        self._padded[:-1] = twists
        sides = self._padded.take(self.term_nodes, axis=0)
        change: FloatArray = np.einsum("tsi,tsi->ts", gradient, sides)
        return change

    def of_rows(self, sides: FloatArray) -> FloatArray:
        """(r,) sums over the sides (t, 2) of all terms of a row."""
        return np.bincount(self.row_of_term, sides[:, 0] + sides[:, 1], minlength=self.size)

    def add_forces(self, multipliers: FloatArray, local: IntArray, residual: FloatArray) -> None:
        """Add ``G^T multipliers`` to the owned nodes of one block; ``local`` node of each node."""
        add_forces(self.own.memory, multipliers, local, residual)

    def forces_call(self, multipliers: FloatArray, local: IntArray, residual: FloatArray) -> Call:
        """Call of the loop of :meth:`add_forces`."""
        return Call(add_forces, self.own.memory, multipliers, local, residual)

    def leave_out(self, chosen: BoolArray) -> None:
        """Replace the equations of rows (r,) that have been evaluated by zero forces."""
        self.values[chosen] = -self.multipliers[chosen]
        self.compliance[chosen], self.slopes[chosen] = 1.0, 0.0
        self.step_jacobian[chosen[self.row_of_term]] = 0.0

    def accept(self) -> None:
        """Store the present angles, so that later ones are continuous."""
        self.consistent, self.reported = False, None
        update_angles(self.own.memory, self.interface.frames)
        if len(self.wrapped_rows):
            update_wraps(self.own.memory)
        if self.lines.joints:
            self.lines.evaluate(self.interface.frames, self.poses, self.force_jacobian)
            self.hold_gradient(self.force_jacobian)
            self.lines.accept()
        if self.elements.groups:
            evaluate_rows(self.own.memory, self.interface.interface_nodes.memory, _UNSCALED)
            self.elements.accept(self)

    def follow_wraps(self) -> None:
        """Angles of cables around guides with friction at a restored state."""
        if len(self.wrapped_rows):
            marker_poses(self.own.memory, self.interface.frames, self.poses)
            update_wraps(self.own.memory)

    def place_markers(self) -> None:
        """Poses of all markers at the interface's state."""
        frames = self.interface.frames
        marker_poses(self.own.memory, frames, self.poses)
        self.lines.evaluate(frames, self.poses, self.force_jacobian)
        self.hold_gradient(self.force_jacobian)

    def _add_line_dampers(self, slopes: FloatArray, velocity: float) -> None:
        """The part of ``constraints.rows.hessians.add_dampers`` of joints on lines."""
        if self.lines.joints:
            face = self.interface
            by_step = velocity_changes(face.interface_nodes.memory, velocity)
            self.lines.add_dampers(
                slopes, face.velocities, by_step, self.force_jacobian, self.step_jacobian
            )

    def hessians(self, factor: FloatArray) -> FloatArray:
        """``sum_rows factor d(gradient)`` along local twists of the nodes, (n_pairs, 12, 12)."""
        out = np.zeros((len(self.pair_nodes), 12, 12))
        add_hessians(self.own.memory, factor[self.row_of_term] * self.factors, out)
        self.lines.add_hessians(factor, out)
        self.hold_hessians(out)
        return out

    def hold_hessians(self, out: FloatArray) -> None:
        """Set second derivatives (n_pairs, 12, 12) to zero along fixed unknowns."""
        if self._holds:
            held = np.concatenate([self.interface.held, np.zeros((1, 6), dtype=np.bool_)])
            pairs = held[self.pair_nodes].reshape(-1, 12)
            out[pairs] = 0.0
            out.transpose(0, 2, 1)[pairs] = 0.0

    def local_jacobian(self) -> FloatArray:
        """(t, 2, 6) derivatives of ``values`` along local twists at fixed local velocities.

        Those of force elements are left out.
        """
        rigid = self.rigid[self.row_of_term]
        slope = np.where(rigid, 1.0, self.slopes[self.row_of_term, 0])
        jacobian: FloatArray = self.force_jacobian * slope[:, np.newaxis, np.newaxis]
        face = self.interface
        if self.damped:
            add_dampers(
                self.own.memory, face.interface_nodes.memory, 0.0, True, self.slopes, jacobian
            )
            # at fixed velocities
            held = np.zeros((len(face.keys), 6, 6))
            self.lines.add_dampers(
                self.slopes[:, 1], face.velocities, held, self.force_jacobian, jacobian
            )
            self.hold_gradient(jacobian)
        return jacobian

    def sums(self) -> FloatArray:
        """(r,) sums of the rows' terms at the present marker frames, targets not subtracted."""
        out = np.zeros(self.size)
        sums_of_terms(self.own.memory, out)
        return out + self.lines.sums

    def turning_forces(self, hessians: FloatArray, steps: FloatArray) -> FloatArray:
        """(n_nodes, 6) change of the constraint forces along steps: geometric stiffness.

        Args:
            hessians: (n_pairs, 12, 12) derivatives of the forces.
            steps: (n_nodes, 6) local twists.
        """
        out = np.zeros_like(steps)
        add_turning_forces(hessians, self.pair_nodes, steps, out)
        return out

    def second_rates(self) -> FloatArray:
        """(r,) second time derivative of every row at constant local velocities."""
        out = np.zeros(self.size)
        second_rates(self.own.memory, self.interface.velocities, out)
        self.lines.add_second_rates(self.interface.velocities, out)
        return out

    def rigid_jacobian(self) -> FloatArray:
        """(t, 2, 6) gradients of the rigid rows with respect to local twists, zero for others."""
        return self.gradients_of(self.rigid)

    def gradients_of(self, rows: BoolArray) -> FloatArray:
        """(t, 2, 6) gradients of some rows (r,) with respect to local twists, zero for others."""
        return self.force_jacobian * rows.take(self.row_of_term)[:, np.newaxis, np.newaxis]

    def rates(self) -> FloatArray:
        """(r,) time derivative of every row at the interface's velocities, drives fixed."""
        return self.changes(self.interface.velocities)


def _later(own: Constraints, name: str) -> Callable[[], None]:
    """A method of a weak reference, which is looked up when it is called: it would be strong."""

    def call() -> None:
        getattr(own, name)()

    return call
