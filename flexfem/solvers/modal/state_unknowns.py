# SPDX-License-Identifier: LGPL-3.0-or-later
"""States of force elements as unknowns of linearised equations.

With rates ``dz/dt = g(motion, z)`` and forces ``f(motion, z)`` of an element,
``z' - g_v u' - g_q u - g_z z = 0`` and ``dlambda = f_v u' + f_q u + f_z z``. The unknowns are z in
units of their own, in which pressures (Pa) are as large as displacements (m).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.elements.force_elements import ElementSlopes
from flexfem.layout.node_key import NodeKey
from flexfem.system.system import System

__all__ = ["StateUnknowns"]


@dataclass(frozen=True)
class _Set:
    """Elements of this rank with states, of one of ``ForceElements.sets``.

    Attributes:
        at: number of the set.
        members: (k,) places in the set of those whose multipliers this rank owns.
        rows: (k, r) their rows.
        nodes: (k, 2 t) interface nodes of the terms of a row, -1 for none.
        first: (k,) number of the first of their states on this rank.
        states: number of states of each.
    """

    at: int
    members: IntArray
    rows: IntArray
    nodes: IntArray
    first: IntArray
    states: int


class StateUnknowns:
    """The states of the elements that this rank owns.

    Attributes:
        count: their number.
        units: (count,) the size of one of each unknown.
    """

    def __init__(self, system: System) -> None:
        """Number the states."""
        self._system, self.count = system, 0
        rows, at = system.constraints, 0
        self._sets: list[_Set] = []
        for group, sets in zip(rows.elements.groups, rows.elements.sets, strict=True):
            for some in sets:
                own = some.rows
                chosen = np.flatnonzero(rows.owned[own[:, 0]] > 0.0)
                n = group.law.states
                if n:
                    first = self.count + n * np.arange(len(chosen))
                    nodes = some.nodes[chosen].reshape(len(chosen), -1)
                    self._sets.append(_Set(at, chosen, own[chosen], nodes, first, n))
                    self.count += n * len(chosen)
                at += 1
        self.units = np.ones(self.count)

    def places(self) -> Iterator[tuple[str, int, list[NodeKey], IntArray]]:
        """Owner of the law, number in it, nodes, and numbers of the states of every element."""
        elements, interface, at = self._system.constraints.elements, self._system.interface, 0
        for group, sets in zip(elements.groups, elements.sets, strict=True):
            chosen = {some.at: some for some in self._sets}
            for every in sets:
                some = chosen.get(at)
                at += 1
                if some is None:
                    continue
                numbers = group.elements[every.members[some.members]]
                for element, nodes, own in zip(
                    numbers.tolist(), some.nodes.tolist(), self._own(some), strict=True
                ):
                    keys = [interface.keys[node] for node in sorted(set(nodes)) if node >= 0]
                    yield group.law.owner, element, keys, own

    def scale(self, slopes: ElementSlopes) -> None:
        """Choose the units: the change of a state by one along its most effective motion."""
        for some in self._sets:
            by_place, by_rate, _ = (np.abs(x[some.members]) for x in slopes.states[some.at])
            largest = np.maximum(by_place, by_rate).max(axis=(2, 3, 4))
            self.units[self._own(some)] = np.where(largest > 0.0, largest, 1.0)

    def _own(self, some: _Set) -> IntArray:
        """(k, n) numbers of the states of a set on this rank."""
        found: IntArray = some.first[:, np.newaxis] + np.arange(some.states)
        return found

    def pattern(
        self, first: int, unknown: Callable[[int, IntArray], IntArray],
        multiplier: Callable[[IntArray], IntArray],
    ) -> tuple[IntArray, IntArray]:  # fmt: skip
        """Entries of the matrices.

        Args:
            first: number of the first state of this rank among all unknowns.
            unknown: numbers of a part's unknowns given by its own global ones.
            multiplier: numbers of multipliers given by their own global ones.
        """
        rows, i, j = self._system.constraints, [_NONE], [_NONE]
        for some in self._sets:
            own = first + self._own(some)
            for part, element, side in self._sides(some):
                width = self._system.parts[part].block.width
                node = self._system.interface.number[some.nodes[element, side]]
                columns = unknown(part, width * node[:, np.newaxis] + np.arange(width))
                shape = len(element), some.states, width
                i.append(np.broadcast_to(own[element][:, :, np.newaxis], shape).ravel())
                j.append(np.broadcast_to(columns[:, np.newaxis], shape).ravel())
            forces_and_rates = np.concatenate([multiplier(rows.numbers[some.rows]), own], axis=1)
            shape = *forces_and_rates.shape, some.states
            i.append(np.broadcast_to(forces_and_rates[:, :, np.newaxis], shape).ravel())
            j.append(np.broadcast_to(own[:, np.newaxis], shape).ravel())
        return np.concatenate(i), np.concatenate(j)

    def damping(self, slopes: ElementSlopes) -> FloatArray:
        """Values of the entries by rates, of :meth:`pattern`."""
        values = [np.zeros(0)]
        for some in self._sets:
            _, by_rate, by_state = (x[some.members] for x in slopes.states[some.at])
            corner = np.zeros(by_state.shape)
            corner[:, -some.states :] = np.eye(some.states)
            values += [*self._of_sides(some, by_rate), corner.ravel()]
        return np.concatenate(values)

    def stiffness(self, slopes: ElementSlopes) -> FloatArray:
        """Values of the entries by positions and states, of :meth:`pattern`."""
        values = [np.zeros(0)]
        for some in self._sets:
            by_place, _, by_state = (x[some.members] for x in slopes.states[some.at])
            unit, n = self.units[self._own(some)], some.states
            corner = by_state * unit[:, np.newaxis]
            corner[:, -n:] /= -unit[:, :, np.newaxis]
            values += [*self._of_sides(some, by_place), corner.ravel()]
        return np.concatenate(values)

    def eigenvalues(self, slopes: ElementSlopes) -> npt.NDArray[np.complex128]:
        """(count,) eigenvalues of the states of each element where nothing moves, 1/s."""
        found = np.zeros(self.count, dtype=np.complex128)
        for some in self._sets:
            by_state = slopes.states[some.at][2][some.members]
            found[self._own(some)] = np.linalg.eigvals(by_state[:, -some.states :])
        return found

    def stiffness_of_rows(self, slopes: ElementSlopes) -> FloatArray:
        """(r,) sizes of the stiffness of rows by states that integrate rates: oil columns."""
        found = np.zeros(self._system.constraints.size)
        for some in self._sets:
            _, by_rate, by_state = (np.abs(x[some.members]) for x in slopes.states[some.at])
            largest = by_rate.max(axis=(2, 3, 4))
            found[some.rows] = np.einsum("ern,en->er", by_state[:, : -some.states], largest)
        return found

    def _sides(self, some: _Set) -> Iterator[tuple[int, IntArray, IntArray]]:
        """Elements and sides of terms with nodes in each part."""
        part_of_node = np.append(self._system.part_of_node, -1)  # the ground
        for part in range(len(self._system.parts)):
            element, side = np.nonzero(part_of_node[some.nodes] == part)
            yield part, element, side

    def _of_sides(self, some: _Set, changes: FloatArray) -> Iterator[FloatArray]:
        """Entries of changes (k, n, t, 2, 6) of rates along steps of the nodes."""
        unit = self.units[self._own(some)][:, :, np.newaxis, np.newaxis]
        flat = -changes.reshape(*changes.shape[:2], -1, 6) / unit
        for part, element, side in self._sides(some):
            width = self._system.parts[part].block.width
            yield flat[element, :, side, :width].ravel()


_NONE: IntArray = np.empty(0, dtype=np.int64)
