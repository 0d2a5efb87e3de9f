# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of first and second rates of rows by positions and velocities.

Along the path ``q exp(t v + t^2/2 w)`` of all nodes a rate of a row is a derivative of its value at
``t = 0``, for which differences of eighth order need the values at a few places. The derivative of
these differences by q, v and w needs the gradients of the row at these places, instead of third
derivatives of its function.
"""

from collections.abc import Iterator

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.system.system import System

__all__ = ["RowPaths"]

#: Weights of differences at 0, and at 1 to 4 steps on either side, of the first and second order.
_FIRST = (0.0, 4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
_SECOND = (-205.0 / 72.0, 8.0 / 5.0, -1.0 / 5.0, 8.0 / 315.0, -1.0 / 560.0)
#: Motions over a step of the differences, m or rad, of which the best is taken.
_MOTIONS = (0.1, 0.03, 0.01, 3e-3, 1e-3)
#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
_REST = np.zeros(2)


class RowPaths:
    """Differences along the path of the accepted state of a system.

    The system is at another trial state after each call, and its rows are evaluated there.
    """

    def __init__(self, system: System, order: int, rates: FloatArray) -> None:
        """Choose the step (collective).

        Args:
            system: at its accepted state.
            order: 1 or 2, of the rates.
            rates: (r,) of the rows at fixed time, by which the step is chosen.
        """
        self._system, self._order = system, order
        weights = _FIRST if order == 1 else _SECOND
        sign = -1.0 if order == 1 else 1.0
        self._stencil = [(0, weights[0])] if order == 2 else []
        for k, weight in enumerate(weights[1:], start=1):
            self._stencil += [(k, weight), (-k, sign * weight)]
        size, least = self._size(), np.inf
        rigid = system.constraints.rigid
        for motion in _MOTIONS:
            step, found = motion / size, np.zeros(len(rates))
            for _, weight in self._places(step):
                found += weight * system.constraints.sums()
            off = float(np.abs(found - rates)[rigid].max(initial=0.0))
            off = system.comm.allreduce(off, op=MPI.MAX)
            if off < least:
                self._step, least = step, off

    def _size(self) -> float:
        """Largest rate of the nodes, 1/s."""
        sizes = [1e-3]
        for part in self._system.parts:
            state = part.block.state()
            sizes.append(float(np.abs(state["velocity"]).max(initial=0.0)))
            if self._order == 2:
                sizes.append(float(np.sqrt(np.abs(state["acceleration"]).max(initial=0.0))))
        largest: float = self._system.comm.allreduce(max(sizes), op=MPI.MAX)
        return largest

    def _places(self, step: float) -> Iterator[tuple[float, float]]:
        """Go to all places of the path; yields their times, s, and weights."""
        system = self._system
        for k, weight in self._stencil:
            t = k * step
            curved = 0.5 * t * t if self._order == 2 else 0.0
            system.predict(np.array([t, curved, 1.0, 0.0, 0.0, 0.0, 1.0]), _REST)
            system.interface.update()
            system.constraints.evaluate(_UNSCALED, elements=False)
            yield t, weight / step**self._order

    def transposed(self, factors: FloatArray) -> tuple[BlockVectors, BlockVectors]:
        """Factors (r,) of rows times derivatives of their rates (collective).

        Returns:
            For each block, (n_owned, w) by local twists of the positions and by the rates of the
            increments.
        """
        parts = self._system.parts
        q, v = ([np.zeros_like(part.block.owned_step) for part in parts] for _ in range(2))
        for t, weight in self._places(self._step):
            for part in parts:
                part.block.residual[:] = 0.0
            self._system.add_constraint_forces(factors)
            for k, part in enumerate(parts):
                maps = StepMaps.of(part.block, part.block.frames)
                forces = weight * part.block.owned_residual
                q[k] += maps.before.transposed(forces)
                v[k] += t * maps.by_increment.transposed(forces)
        return q, v

    def changes(self, q: BlockVectors, v: BlockVectors) -> FloatArray:
        """Changes (r,) of the rates of rows, see :meth:`transposed` (collective)."""
        system = self._system
        found = np.zeros(system.constraints.size)
        for t, weight in self._places(self._step):
            for part, own_q, own_v in zip(system.parts, q, v, strict=True):
                maps = StepMaps.of(part.block, part.block.frames)
                moved = maps.before(own_q) + t * maps.by_increment(own_v)
                part.block.owned_step[:] = moved
                part.block.spread_step()
            system.interface.update_steps()
            found += weight * system.constraints.changes(system.interface.steps)
        return found
