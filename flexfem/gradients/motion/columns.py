# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of columns of the history by the motion of nodes.

Columns are functions of markers' states (``Probe``). These are differentiated by central
differences of fourth order with the longest step that suits them: a deflection of a micrometre is
a norm with a kink nearby. From the markers to their nodes all is exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Ground
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_maps import rotations, transposed
from flexfem.gradients.motion.functionals import Functional
from flexfem.lie import so3
from flexfem.model.model import Model
from flexfem.model.probes.base import MarkerState, Probe
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["ColumnDerivatives", "NodeSeeds", "Recorded", "history_weights"]

#: Differences, in m, rad, m/s and so on, the longest first.
_STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
#: Difference from a shorter step, relative to the largest changes, up to which a step suits, and up
#: to which the best one does.
_SUITS, _ENOUGH = 1e-7, 1e-5
#: Places in steps, with weights.
_STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
#: Position, rotation, velocity, angular velocity and both accelerations of a marker.
_COMPONENTS = 18


@dataclass(frozen=True)
class NodeSeeds:
    """Derivatives of a functional by the motion of nodes of a block at an accepted state.

    Attributes:
        nodes: (k,) owned nodes.
        twists, velocities, accelerations: (k, 6) by local twists of the configuration, by local
            velocities and by their rates.
    """

    nodes: IntArray
    twists: FloatArray
    velocities: FloatArray
    accelerations: FloatArray


class Recorded(Protocol):
    """States with a history: a motion, or a path of equilibria.

    Attributes:
        system: at one of the states.
        recorder: of the columns of the history.
        columns: names of these.
        times: (n,) of all states.
    """

    system: System
    recorder: ProbeRecorder
    columns: list[str]
    times: FloatArray

    @property
    def model(self) -> Model:
        """The model with its probes."""
        ...


def history_weights(
    functionals: Sequence[Functional], names: Sequence[str], rows: int,
    history: Mapping[str, FloatArray], comm: MPI.Intracomm,
) -> FloatArray:  # fmt: skip
    """Derivatives (functionals, columns, rows) by the columns of a history (collective).

    Args:
        functionals: the functionals.
        names: of the columns; others count as given.
        rows: number of rows.
        history: columns by name on the first rank, none on the others.
        comm: communicator.
    """
    found = np.zeros((len(functionals), len(names), rows))
    for own, one in zip(found, functionals, strict=True) if history else ():
        for name, row in zip(one.columns, one.derivative(history), strict=True):
            if name in names:
                own[names.index(name)] += row
    comm.Bcast(found)
    return found


class ColumnDerivatives:
    """Derivatives of some columns of a history, at accepted states."""

    def __init__(self, states: Recorded, columns: Sequence[str]) -> None:
        """Find the probes of the columns.

        Raises:
            InputError: one is a function of a marker that is not at a node.
        """
        self._states, self._columns = states, list(columns)
        model = states.model
        self._probes: list[tuple[Probe, int, list[tuple[int, int]]]] = []
        at, inside = 0, self._inside()
        for probe in model.probes:
            own = [(k, columns.index(c)) for k, c in enumerate(probe.columns) if c in columns]
            if isinstance(probe, Probe):
                places = range(at, at + len(probe.markers))
                if own and inside.intersection(places):
                    raise InputError(
                        f'gradient: Probe "{probe.name}" has a marker between nodes; take one at '
                        "a node"
                    )
                if own:
                    self._probes.append((probe, at, own))
                at += len(probe.markers)
        self._count = at

    def _inside(self) -> set[int]:
        """Places of markers that are neither at nodes nor on the ground, on any rank."""
        comm = self._states.system.comm
        own = [k for *_, places in self._states.recorder.sources for k in places.tolist()]
        at_nodes = {k for part in comm.allgather(own) for k in part}
        model = self._states.model
        markers = [m for p in model.probes if isinstance(p, Probe) for m in p.markers]
        every = [m for p in model.probes for m in p.markers]
        if len(every) != len(markers):
            raise InputError("gradient: a probe other than Probe has markers; leave it out")
        return {k for k, m in enumerate(markers) if k not in at_nodes and not isinstance(m, Ground)}

    def every(self, weights: FloatArray) -> FloatArray:
        """Weights (k, all columns of the motion) of those of these columns, (k, columns)."""
        found = np.zeros((len(weights), len(self._states.columns)))
        for k, name in enumerate(self._columns):
            found[:, self._states.columns.index(name)] = weights[:, k]
        return found

    def seeds(self, step: int, weights: FloatArray) -> list[NodeSeeds]:
        """Derivatives of ``weights @ columns`` by nodes, at the accepted state (collective).

        Args:
            step: number of the step, at whose accepted state the system is.
            weights: (columns,) on the first rank.

        Raises:
            InputError: a column has no derivative there.
        """
        recorder, comm = self._states.recorder, self._states.system.comm
        states = recorder.states()
        found, refusal = np.zeros((self._count, _COMPONENTS)), ""
        if comm.rank == 0:
            try:
                self._by_markers(self._states.times[step], states, weights, found)
            except InputError as error:
                refusal = str(error)
        if refusal := comm.bcast(refusal):
            raise InputError(refusal)
        comm.Bcast(found)
        return [
            _of_nodes(block, nodes, offsets, found[places])
            for block, nodes, offsets, places in recorder.sources
        ]

    def each(self, step: int) -> list[list[NodeSeeds]]:
        """Derivatives of each column, see :meth:`seeds` (collective)."""
        return [self.seeds(step, weights) for weights in np.eye(len(self._columns))]

    def _by_markers(
        self, t: float, states: Sequence[MarkerState], weights: FloatArray, found: FloatArray
    ) -> None:
        """Write derivatives of ``weights @ columns`` by all markers (markers, 18)."""
        for probe, at, own in self._probes:
            factors = np.zeros(len(probe.columns))
            for k, column in own:
                factors[k] = weights[column]
            if factors.any():
                places = slice(at, at + len(probe.markers))
                found[places] = _differences(probe, t, states[places], factors)


def _differences(
    probe: Probe, t: float, states: Sequence[MarkerState], factors: FloatArray
) -> FloatArray:
    """Derivatives (markers, 18) of ``factors @ columns``.

    Raises:
        InputError: there are none.
    """
    found = np.zeros((len(states), _COMPONENTS))
    still = float(factors @ probe.evaluate(t, states))
    along = np.random.default_rng(3).standard_normal(_COMPONENTS)
    for m in range(len(states)):

        def slope(direction: FloatArray, step: float, m: int = m) -> tuple[float, float]:
            """Derivative along a direction (18,) of the motion of a marker, and largest change."""
            total, largest = 0.0, 0.0
            for part, weight in _STENCIL:
                moved = [*states]
                moved[m] = _moved(states[m], part * step * direction)
                change = float(factors @ probe.evaluate(t, moved)) - still
                total += weight / step * change
                largest = max(largest, abs(change) / step)
            return total, largest

        least = inf
        for step in _STEPS:
            own, changes = np.array([slope(one, step) for one in np.eye(_COMPONENTS)]).T
            # the components together, with a tenth of the step
            off = abs(slope(along, 0.1 * step)[0] - float(own @ along))
            off /= float(changes @ np.abs(along)) or 1.0
            if off < least:
                found[m], least = own, off
            if off <= _SUITS:
                break
        if not least <= _ENOUGH:
            raise InputError(
                f'gradient: a column of Probe "{probe.name}" has a kink or jumps at t = {t:.6g} s, '
                "and has no derivative there"
            )
    return found


def _moved(state: MarkerState, by: FloatArray) -> MarkerState:
    """A marker whose motion (18,) is changed."""
    place, turn, velocity, spin, acceleration, twirl = by.reshape(6, 3)
    return replace(
        state, position=state.position + place, rotation=so3.exp(turn) @ state.rotation,
        velocity=state.velocity + velocity, angular_velocity=state.angular_velocity + spin,
        acceleration=state.acceleration + acceleration,
        angular_acceleration=state.angular_acceleration + twirl,
    )  # fmt: skip


def _of_nodes(
    block: FrameBlock, nodes: IntArray, offsets: FloatArray, found: FloatArray
) -> NodeSeeds:
    """From derivatives by markers (k, 18), inertial axes, to those by their nodes, local axes."""
    R, o = rotations(block.frames[nodes]), offsets[:, :3]
    v, w = block.velocity[nodes], block.acceleration[nodes]
    # inertial derivatives in the node's axes
    p, turn, velocity, spin, acceleration, twirl = (
        transposed(R, found[:, 3 * k : 3 * k + 3]) for k in range(6)
    )
    V, omega, dV, domega = v[:, :3], v[:, 3:], w[:, :3], w[:, 3:]
    cross = np.cross
    arm = V + cross(omega, o)
    speed = dV + cross(domega, o) + cross(omega, arm)
    twists, velocities, accelerations = np.zeros((3, len(nodes), 6))
    twists[:, :3] = p
    # R y turns by R (theta x y), whose product with b is theta . (y x R^T b)
    twists[:, 3:] = cross(o, p) + turn + cross(arm, velocity) + cross(omega, spin)
    twists[:, 3:] += cross(speed, acceleration) + cross(domega, twirl)
    velocities[:, :3] = velocity + cross(acceleration, omega)
    velocities[:, 3:] = cross(o, velocities[:, :3]) + spin + cross(arm, acceleration)
    accelerations[:, :3] = acceleration
    accelerations[:, 3:] = cross(o, acceleration) + twirl
    return NodeSeeds(nodes, twists, velocities, accelerations)
