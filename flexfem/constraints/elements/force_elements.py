# SPDX-License-Identifier: LGPL-3.0-or-later
"""All force elements of a rank, as rows of the table of constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.elements.group import ElementGroup, Slopes
from flexfem.constraints.elements.states import AT_REST, StateStep
from flexfem.constraints.rows.placed_joint import RowLayout
from flexfem.core.laws import ElementLaw, ElementMotion
from flexfem.core.state import State

__all__ = ["Alike", "ElementSlopes", "ForceElements"]

_STATES = ("z0", "g0", "w0")


class Rows(Protocol):
    """The table of all rows, see ``Constraints``, in which the elements' equations are written."""

    instant: float
    poses: FloatArray
    targets: FloatArray
    active: BoolArray
    multipliers: FloatArray
    values: FloatArray
    compliance: FloatArray
    force_jacobian: FloatArray
    step_jacobian: FloatArray

    def sums(self) -> FloatArray:
        """(r,) sums of the rows' terms."""
        ...

    def rates(self) -> FloatArray:
        """(r,) their rates."""
        ...

    def rate_changes(self, slopes: FloatArray, velocity: float, *, held: bool) -> FloatArray:
        """(t, 2, 6) changes of the rates along steps."""
        ...


@dataclass(frozen=True)
class Alike:
    """Elements of a group whose rows have equally many terms.

    Attributes:
        members: (k,) their places in the group.
        terms: (k, r, t) terms of their rows, which have the same nodes at the same places.
    """

    members: IntArray
    terms: IntArray


@dataclass(frozen=True)
class ElementSlopes:
    """Derivatives of the laws of all elements along local twists of the nodes.

    Attributes:
        position, velocity: (t, 2, 6) of the forces at fixed local velocities, and by these.
        states: for each set of elements of ``ForceElements.alike``, those of the rates of their
            states, (k, n, t, 2, 6) each, and (k, r + n, n) of forces and rates by the states.
    """

    position: FloatArray
    velocity: FloatArray
    states: list[tuple[FloatArray, FloatArray, FloatArray]]


class ForceElements:
    """Force elements: all forces of a joint by one law of its motion and of its states.

    The equation of a row is ``scale (L - lambda / s) = 0``, see ``rows.kernels``, with the force L
    of the law. Along a displacement of the nodes, L changes by the derivatives of the law times
    the changes of all rows of the element and of their rates, ``(K G + C dG/dt)``.

    Attributes:
        groups: those of each law.
        alike: the elements of each group, in sets.
        step: step of their states; that at rest outside of steps.
    """

    def __init__(self, table: RowLayout) -> None:
        """Collect the elements."""
        self.step: StateStep = AT_REST
        self._joints = len(table.joints)
        laws: dict[int, ElementLaw] = {}
        members: dict[int, list[tuple[int, int]]] = {}
        for i, placed in enumerate(table.joints):
            if placed.joint.element is not None:
                law, number = placed.joint.element
                laws[id(law)] = law
                members.setdefault(id(law), []).append((i, number))
        self.groups, self.alike = list[ElementGroup](), list[list[Alike]]()
        self._place = dict[int, tuple[int, int]]()  # joint of the table: group, place in it
        for g, (key, found) in enumerate(members.items()):
            joints = [i for i, _ in found]
            rows = np.array([np.arange(*table.start[i : i + 2]) for i in joints])
            markers = np.array([np.arange(*table.marker_start[i : i + 2]) for i in joints])
            numbers = np.array([number for _, number in found])
            self.groups.append(ElementGroup(laws[key], numbers, rows, markers))
            self.alike.append(_by_terms(table, rows))
            self._place.update({i: (g, k) for k, i in enumerate(joints)})
        self._slopes = np.zeros((int(table.start[-1]), 2))
        for group in self.groups:
            self._slopes[group.rows, 1] = 1.0

    def __len__(self) -> int:
        """Number of laws."""
        return len(self.groups)

    def begin(self, step: StateStep) -> None:
        """Begin a step of the states, or begin it again."""
        self.step = step
        for group in self.groups:
            group.begin()

    def reset(self) -> None:
        """Return to the accepted states."""
        self.begin(AT_REST)

    def accept(self, rows: Rows) -> None:
        """Accept the states at the accepted motion."""
        for group in self.groups:
            group.accept(self._motion(rows, group), self.step)
        self.step = AT_REST

    def start(self, rows: Rows) -> None:
        """Begin a motion at the accepted state."""
        for group in self.groups:
            group.start(self._motion(rows, group))

    def evaluate(self, rows: Rows, dynamics: FloatArray) -> None:
        """Write the equations of the elements' rows at the trial state.

        Args:
            rows: all rows, evaluated but for these.
            dynamics: (2,) ``gamma/(beta h)``, zero for equilibrium, and ``beta h^2``.
        """
        steady = dynamics[0] == 0.0
        step = None if steady else self.step
        wanted = steady or step is not AT_REST
        changes = self._rate_changes(rows, dynamics[0]) if wanted else None
        for group, alike in zip(self.groups, self.alike, strict=True):
            slopes = group.evaluate(self._motion(rows, group), step, slopes=wanted)
            scale = self._write(rows, group, slopes, dynamics)
            if changes is not None:
                _combine(alike, slopes, scale, (rows.force_jacobian, changes), rows.step_jacobian)

    def _write(
        self, rows: Rows, group: ElementGroup, slopes: Slopes, dynamics: FloatArray
    ) -> FloatArray:
        """Values and compliances of a group's rows; the scales (e, r) of the equations."""
        own = group.rows
        sizes = np.abs(slopes.by_place).sum(axis=2)
        sizes += dynamics[0] * np.abs(slopes.by_rate).sum(axis=2)
        active = rows.active[own]
        scale: FloatArray = active / (1.0 / dynamics[1] + sizes)
        force = group.forces - rows.multipliers[own] / dynamics[1]
        rows.values[own] = np.where(active, scale * force, rows.values[own])
        rows.compliance[own] = np.where(active, scale / dynamics[1], rows.compliance[own])
        return scale

    def linearize(self, rows: Rows) -> ElementSlopes:
        """Derivatives of all forces and of rates of states at the state evaluated last.

        States are steady first, and are accepted.
        """
        changes = self._rate_changes(rows, 0.0, held=True)
        position, velocity = np.zeros((2, *rows.force_jacobian.shape))
        states = []
        for group, alike in zip(self.groups, self.alike, strict=True):
            r, whole = group.rows.shape[1], group.linearized(self._motion(rows, group))
            for some in alike:
                every = whole[some.members]
                gradient, turning = rows.force_jacobian[some.terms], changes[some.terms]
                place, rate = every[:, :, :r], every[:, :, r : 2 * r]
                by_place = _along(place, gradient) + _along(rate, turning)
                by_rate = _along(rate, gradient)
                position[some.terms], velocity[some.terms] = by_place[:, :r], by_rate[:, :r]
                states.append((by_place[:, r:], by_rate[:, r:], every[:, :, 2 * r :]))
        return ElementSlopes(position, velocity, states)

    def settle(self, rows: Rows, *, still: bool) -> None:
        """Set the states to steady ones at the state evaluated last, and accept them.

        ``still``: of a model at rest, whatever its velocities.
        """
        for group in self.groups:
            motion = self._motion(rows, group)
            group.accept(_at_rest(motion) if still else motion, None)

    def static_forces(self, rows: Rows, out: FloatArray) -> None:
        """Forces at rest in ``out`` (r, 2), and the sizes of their derivatives."""
        for group in self.groups:
            slopes = group.evaluate(_at_rest(self._motion(rows, group)), None, slopes=True)
            out[group.rows, 0] = group.forces
            out[group.rows, 1] = np.abs(slopes.by_place).sum(axis=2)

    def _motion(self, rows: Rows, group: ElementGroup) -> ElementMotion:
        """Motion of a group's elements at the interface's state; markers are placed."""
        values, rates = rows.sums() - rows.targets, rows.rates()
        return ElementMotion(
            rows.instant, rows.poses[group.markers], values[group.rows], rates[group.rows]
        )

    def _rate_changes(self, rows: Rows, velocity: float, held: bool = False) -> FloatArray:
        """(t, 2, 6) derivatives of the elements' rates along steps; ``velocity``: dv/dn."""
        return rows.rate_changes(self._slopes, velocity, held=held)

    def counts(self, what: str) -> IntArray:
        """Number of "element_states" or "element_slopes" of every joint of the table."""
        counts = np.zeros(self._joints, dtype=np.int64)
        for i, (g, _) in self._place.items():
            group = self.groups[g]
            counts[i] = (group.z0 if what == "element_states" else group.kept).shape[1]
        return counts

    def state(self) -> State:
        """States of all elements with their rates, derivatives in use, and held forces."""
        held = np.zeros(len(self._slopes))
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
    """The same places without rates."""
    return replace(motion, rates=np.zeros_like(motion.rates))


def _by_terms(table: RowLayout, rows: IntArray) -> list[Alike]:
    """Elements by the number of terms of their rows (e, r)."""
    first = table.term_start[rows]
    counts = table.term_start[rows[:, 0] + 1] - first[:, 0]
    found = []
    for count in np.unique(counts):
        members = np.flatnonzero(counts == count)
        terms = first[members][:, :, np.newaxis] + np.arange(count)
        found.append(Alike(members, terms))
    return found


def _combine(
    alike: list[Alike], slopes: Slopes, scale: FloatArray,
    changes: tuple[FloatArray, FloatArray], out: FloatArray,
) -> None:  # fmt: skip
    """Set ``out`` (t, 2, 6) of elements' rows: scaled changes of their forces along steps.

    Args:
        alike: the elements.
        slopes: derivatives of their forces.
        scale: (e, r) of the equations.
        changes: (t, 2, 6) of the rows and of their rates.
        out: the result.
    """
    for some in alike:
        total = _along(slopes.by_place[some.members], changes[0][some.terms])
        total += _along(slopes.by_rate[some.members], changes[1][some.terms])
        out[some.terms] = total * scale[some.members][:, :, np.newaxis, np.newaxis, np.newaxis]


def _along(slopes: FloatArray, changes: FloatArray) -> FloatArray:
    """Changes (e, a, t, 2, 6) along steps by slopes (e, a, r) from those of rows (e, r, ...)."""
    product = slopes @ changes.reshape(*changes.shape[:2], -1)
    return product.reshape(*slopes.shape[:2], *changes.shape[2:])
