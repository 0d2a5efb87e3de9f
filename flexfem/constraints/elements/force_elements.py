# SPDX-License-Identifier: LGPL-3.0-or-later
"""All force elements of a rank, as rows of the table of constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.elements.group import ElementGroup
from flexfem.constraints.elements.kernels import add_slopes, write_rows
from flexfem.constraints.elements.marker_changes import MarkerChanges, marker_changes
from flexfem.constraints.elements.states import AT_REST, StateStep
from flexfem.constraints.rows.data import RowArrays
from flexfem.constraints.rows.placed_joint import RowLayout
from flexfem.core.laws import ElementLaw, ElementMotion
from flexfem.core.state import State

__all__ = ["ElementSlopes", "ForceElements"]

_STATES = ("z0", "g0", "w0")


class Rows(Protocol):
    """The table of all rows, see ``Constraints``, in which the elements' equations are written."""

    own: RowArrays
    instant: float
    poses: FloatArray
    force_jacobian: FloatArray
    step_jacobian: FloatArray

    def node_velocities(self) -> FloatArray:
        """(n + 1, 6) local twists of the interface nodes, and of the ground."""
        ...

    def velocity_changes(self, velocity: float) -> FloatArray:
        """(n, 6, 6) their derivatives by steps; ``velocity``: dv/dn, 1/s."""
        ...

    def rate_changes(self, slopes: FloatArray, velocity: float, *, held: bool) -> FloatArray:
        """(t, 2, 6) changes of rates of rows along steps."""
        ...


@dataclass(frozen=True)
class ElementSlopes:
    """Derivatives of the laws of all elements along local twists of the nodes.

    Attributes:
        position, velocity: (t, 2, 6) of the forces at fixed local velocities, and by these.
        states: for each set of elements of ``ForceElements.sets``, those of the rates of their
            states, (k, n, t, 2, 6) each, and (k, r + n, n) of forces and rates by the states.
    """

    position: FloatArray
    velocity: FloatArray
    states: list[tuple[FloatArray, FloatArray, FloatArray]]


class ForceElements:
    """Force elements: all forces of a joint by one law of the motion of its markers, and of states.

    The equation of a row is ``scale (L - lambda / s) = 0``, see ``rows.kernels``, with the force L
    of the law. Along a displacement of the nodes, L changes by the derivatives of the law times
    the displacements of the markers and the changes of their twists.

    Attributes:
        groups: those of each law.
        sets: the elements of each group with equally many terms a row.
        step: step of their states; that at rest outside of steps.
        exact: True if derivatives are wanted of the accepted states, too, as they are.
    """

    def __init__(self, table: RowLayout) -> None:
        """Collect the elements."""
        self.step: StateStep = AT_REST
        self.exact = False
        self._joints, self._rows = len(table.joints), int(table.start[-1])
        laws: dict[int, ElementLaw] = {}
        members: dict[int, list[tuple[int, int]]] = {}
        for i, placed in enumerate(table.joints):
            if placed.joint.element is not None:
                law, number = placed.joint.element
                laws[id(law)] = law
                members.setdefault(id(law), []).append((i, number))
        self.groups, self.sets = list[ElementGroup](), list[list[MarkerChanges]]()
        self._place = dict[int, tuple[int, int]]()  # joint of the table: group, place in it
        for g, (key, found) in enumerate(members.items()):
            law, joints = laws[key], [i for i, _ in found]
            rows = np.array([np.arange(*table.start[i : i + 2]) for i in joints])
            markers = table.marker_start[joints][:, np.newaxis] + np.arange(law.size)
            numbers = np.array([number for _, number in found])
            self.groups.append(ElementGroup(law, numbers, rows, markers))
            self.sets.append(marker_changes(table, joints, rows, markers))
            self._place.update({i: (g, k) for k, i in enumerate(joints)})

    def __len__(self) -> int:
        """Number of laws."""
        return len(self.groups)

    def begin(self, step: StateStep, *, exact: bool = False) -> None:
        """Begin a step of the states, or begin it again; ``exact``: see ``ElementGroup``."""
        self.step, self.exact = step, exact
        for group in self.groups:
            group.exact = exact
            group.begin(step)

    def forget(self) -> None:
        """Drop the derivatives of the laws: the next evaluation computes them."""
        for group in self.groups:
            group.kept[:] = 0.0

    def reset(self) -> None:
        """Return to the accepted states."""
        self.begin(AT_REST)

    def accept(self, rows: Rows) -> None:
        """Accept the states at the accepted motion."""
        for group, motion in self.motions(rows):
            group.accept(motion, self.step)
        self.step = AT_REST

    def start(self, rows: Rows) -> None:
        """Begin a motion at the accepted state."""
        for group, motion in self.motions(rows):
            group.start(motion)

    def settle(self, rows: Rows, *, still: bool) -> None:
        """Set the states to steady ones at the state evaluated last, and accept them.

        ``still``: of a model at rest, whatever its velocities.
        """
        for group, motion in self.motions(rows):
            group.accept(_at_rest(motion) if still else motion, None)

    def evaluate(self, rows: Rows, dynamics: FloatArray) -> None:
        """Write the equations of the elements' rows at the trial state.

        Args:
            rows: all rows, evaluated but for these.
            dynamics: (2,) ``gamma/(beta h)``, zero for equilibrium or derivatives at fixed rates,
                and ``beta h^2``.
        """
        steady = dynamics[0] == 0.0 and self.step is AT_REST and not self.exact
        step = None if steady else self.step
        wanted = steady or self.exact or step is not AT_REST
        changes = rows.velocity_changes(dynamics[0]) if wanted else None
        for (group, motion), sets in zip(self.motions(rows), self.sets, strict=True):
            slopes = group.evaluate(motion, step, slopes=wanted)
            place, twist, scale = slopes.by_place, slopes.by_twist, np.empty(group.rows.shape)
            write_rows(rows.own.memory, group.rows, group.forces, place, twist, dynamics, scale)
            if changes is None:
                continue
            for some in sets:
                rates = self._rate_changes(rows, some, dynamics)
                total = some.along(place, twist, rows.force_jacobian, changes, rates)
                add_slopes(some.members, some.terms, scale, total, rows.step_jacobian)

    def linearize(self, rows: Rows) -> ElementSlopes:
        """Derivatives of all forces and of rates of states at the state evaluated last.

        States are steady first, and are accepted.
        """
        position, velocity = np.zeros((2, *rows.force_jacobian.shape))
        states, unchanged = [], 0.0 * rows.velocity_changes(1.0)
        for (group, motion), sets in zip(self.motions(rows), self.sets, strict=True):
            r, count, whole = group.rows.shape[1], 6 * group.law.size, group.linearized(motion)
            place = np.ascontiguousarray(whole[:, :, :count])
            twist = np.ascontiguousarray(whole[:, :, count : 2 * count])
            for some in sets:
                every = whole[some.members]
                given = rows.force_jacobian, unchanged, self._rate_changes(rows, some)
                by_place = some.along(place, twist, *given)
                by_twist = some.along(twist, 0.0 * twist, *given)
                position[some.terms], velocity[some.terms] = by_place[:, :r], by_twist[:, :r]
                states.append((by_place[:, r:], by_twist[:, r:], every[:, :, 2 * count :]))
        return ElementSlopes(position, velocity, states)

    def along(
        self, rows: Rows, place: FloatArray, twist: FloatArray, some: MarkerChanges,
        dynamics: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """(k, a, t, 2, 6) changes of some numbers of elements along steps of the nodes.

        Args:
            rows: all rows, at the state evaluated last.
            place: (e, a, 6 m) derivatives of the numbers of all elements of a group by
                displacements of the markers.
            twist: (e, a, 6 m) those by their twists.
            some: a set of these elements.
            dynamics: see :meth:`evaluate`.
        """
        changes = rows.velocity_changes(dynamics[0])
        rates = self._rate_changes(rows, some, dynamics)
        return some.along(place, twist, rows.force_jacobian, changes, rates)

    def _rate_changes(
        self, rows: Rows, some: MarkerChanges, dynamics: FloatArray | None = None
    ) -> FloatArray | None:
        """(t, 2, 6) changes of the rates of rows along steps, for elements on lines.

        At fixed velocities without ``dynamics``.
        """
        if not some.on_lines:
            return None
        slopes = np.zeros((self._rows, 2))
        slopes[some.rows, 1] = 1.0
        velocity = 0.0 if dynamics is None else dynamics[0]
        return rows.rate_changes(slopes, velocity, held=dynamics is None)

    def static_forces(self, rows: Rows, out: FloatArray) -> None:
        """Forces at rest in ``out`` (r, 2), and the sizes of their derivatives."""
        for group, motion in self.motions(rows):
            slopes = group.evaluate(_at_rest(motion), None, slopes=True)
            out[group.rows, 0] = group.forces
            out[group.rows, 1] = np.abs(slopes.by_place).sum(axis=2)

    def motions(self, rows: Rows) -> list[tuple[ElementGroup, ElementMotion]]:
        """Motions of all groups at the interface's state; markers are placed."""
        found, velocities = [], rows.node_velocities()
        for group, sets in zip(self.groups, self.sets, strict=True):
            twists = np.empty((*group.markers.shape, 6))
            for some in sets:
                some.put_twists(rows.force_jacobian, velocities, twists)
            poses = rows.poses.take(group.markers, axis=0)
            found.append((group, ElementMotion(rows.instant, poses, twists)))
        return found

    def counts(self, what: str) -> IntArray:
        """Number of "element_states" or "element_slopes" of every joint of the table."""
        counts = np.zeros(self._joints, dtype=np.int64)
        for i, (g, _) in self._place.items():
            group = self.groups[g]
            counts[i] = (group.z0 if what == "element_states" else group.kept).shape[1]
        return counts

    def state(self) -> State:
        """States of all elements with their rates, derivatives in use, and held forces."""
        held = np.zeros(self._rows)
        for group in self.groups:
            held[group.rows] = group.held
        states = {name: self._flat(name) for name in _STATES}
        return State({}, {
            "rows": {"element_forces": held}, "element_states": states,
            "element_slopes": {"kept": self._flat("kept")},
        })  # fmt: skip

    def _flat(self, name: str) -> FloatArray:
        """An array of all elements, joint by joint."""
        parts = [getattr(self.groups[g], name)[k] for _, (g, k) in sorted(self._place.items())]
        return np.concatenate([np.zeros(0), *parts])

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state`."""
        for name, group in (*((n, "element_states") for n in _STATES), ("kept", "element_slopes")):
            values, at = state.rows[group][name], 0
            for _, (g, k) in sorted(self._place.items()):
                own = getattr(self.groups[g], name)[k]
                own[:] = values[at : at + len(own)]
                at += len(own)
        for one in self.groups:
            one.held[:] = state.rows["rows"]["element_forces"][one.rows]
        self.reset()


def _at_rest(motion: ElementMotion) -> ElementMotion:
    """The same places without twists."""
    return replace(motion, twists=np.zeros_like(motion.twists))
