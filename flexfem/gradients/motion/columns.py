# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of columns of the history by the motion of nodes.

Columns are functions of markers' states (``Probe``), or of measurements that depend on few nodes
each. These are differentiated by central differences of fourth order with the longest step that
suits them: a deflection of a micrometre is a norm with a kink nearby. From the markers at nodes to
these all is exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.differences import ENOUGH, slopes
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_functions import NodeFunctions
from flexfem.gradients.equations.node_maps import rotations, transposed
from flexfem.gradients.equations.step_tangent import BlockVectors, forces_on_blocks
from flexfem.gradients.forces.accepted import ForceDerivatives, hold_applied
from flexfem.gradients.forces.columns import ForceColumns
from flexfem.gradients.forces.energies import BodyDerivatives
from flexfem.gradients.forces.sliders import SlidingMarkers
from flexfem.gradients.motion.functionals import Functional
from flexfem.integrators.accepted_forces import AcceptedForces
from flexfem.layout.elements import one_width
from flexfem.layout.family import NodalSensor, Sensor
from flexfem.lie import se3, so3
from flexfem.model.model import Model
from flexfem.model.probes.base import AnyProbe, MarkerState, Probe
from flexfem.model.probes.measured import EnergyProbe, MomentumProbe
from flexfem.system.measure.energies import EnergyMeter
from flexfem.system.measure.momenta import MomentumMeter
from flexfem.system.measure.probes import ROW, MarkersInside, ProbeRecorder
from flexfem.system.measure.sensors import RowSensor
from flexfem.system.system import System

__all__ = ["ColumnDerivatives", "NodeSeeds", "Recorded", "Seeds", "history_weights"]

#: Position, rotation, velocity, angular velocity and both accelerations of a marker, arc length of
#: a slider and its rate; those of markers at nodes.
_COMPONENTS, _AT_NODES = 20, 18


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


@dataclass(frozen=True)
class Seeds:
    """Derivatives of a functional by an accepted state.

    Attributes:
        blocks: those by the motion of nodes of each block.
        forces: (r,) by the multipliers of rows, N or N m, on all ranks that have a row.
    """

    blocks: list[NodeSeeds]
    forces: FloatArray


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

    @property
    def accepted(self) -> AcceptedForces | None:
        """Computation of reported forces of rows, None where these are the multipliers."""
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

    Raises:
        InputError: one is no finite number.
    """
    found = np.zeros((len(functionals), len(names), rows))
    for own, one in zip(found, functionals, strict=True) if history else ():
        for name, row in zip(one.columns, one.derivative(history), strict=True):
            if name in names:
                own[names.index(name)] += row
    comm.Bcast(found)
    for number, column, _ in np.argwhere(~np.isfinite(found))[:1]:
        raise InputError(
            f'gradient: the derivative of "{functionals[number].name}" by "{names[column]}" is no '
            "number"
        )
    return found


class ColumnDerivatives:
    """Derivatives of some columns of a history, at accepted states."""

    def __init__(self, states: Recorded, columns: Sequence[str]) -> None:
        """Find the probes of the columns.

        Raises:
            InputError: one has no derivatives.
        """
        self._states, self._columns = states, list(columns)
        self._probes: list[tuple[Probe, int, list[tuple[int, int]]]] = []
        self._sensors: list[tuple[_Sensor, list[tuple[int, int]]]] = []
        self._bodies: list[tuple[BodyDerivatives, int, list[tuple[int, int]]]] = []
        self._joints: list[tuple[ForceColumns, int, list[tuple[int, int]]]] = []
        at, recorder = 0, states.recorder
        for probe in states.model.probes:
            own = [(k, columns.index(c)) for k, c in enumerate(probe.columns) if c in columns]
            if own and isinstance(probe, Probe):
                self._probes.append((probe, at, own))
            elif own:
                sensor = recorder.sensors[probe.name]
                if isinstance(sensor, (EnergyMeter, MomentumMeter)):
                    assert isinstance(probe, (EnergyProbe, MomentumProbe))
                    if isinstance(probe, EnergyProbe) and states.accepted is None:
                        _check_at_rest(probe, columns)
                    bodies = BodyDerivatives(_owner(probe), states.system, sensor, probe.bodies)
                    self._bodies.append((bodies, len(probe.columns), own))
                elif isinstance(sensor, RowSensor):
                    joint = ForceColumns(_owner(probe), states.system, sensor)
                    self._joints.append((joint, sensor.width, own))
                else:
                    self._sensors.append((_Sensor(probe, sensor), own))
            at += len(probe.markers)
        self._count = at
        markers = [marker for probe in states.model.probes for marker in probe.markers]
        self._sliding = SlidingMarkers(states.system, markers)
        if any(k < joint.forced for joint, _, own in self._joints for k, _ in own):
            self._forces = ForceDerivatives(
                states.system, states.accepted, controlled=bool(states.model.controllers)
            )
        self._inside = [_Inside(part.block, recorder.inside) for part in states.system.parts]

    def every(self, weights: FloatArray) -> FloatArray:
        """Weights (k, all columns of the motion) of those of these columns, (k, columns)."""
        found = np.zeros((len(weights), len(self._states.columns)))
        for k, name in enumerate(self._columns):
            found[:, self._states.columns.index(name)] = weights[:, k]
        return found

    def seeds(self, step: int, weights: FloatArray) -> Seeds:
        """Derivatives of ``weights @ columns`` by the accepted state (collective).

        Args:
            step: number of the step, at whose accepted state the system is.
            weights: (columns,) the same on all ranks.

        Raises:
            InputError: a column has no derivative there.
        """
        recorder, comm = self._states.recorder, self._states.system.comm
        forces = np.zeros(self._states.system.constraints.size)
        if not weights.any():
            return Seeds([_nothing() for _ in recorder.sources], forces)
        self._sliding.place()
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
        every = _Sums.of(self._states.system)
        for one in self._inside:
            one.add(found, every)
        for kind, face in enumerate(self._sliding.back(found)):
            every.add_blocks(self._states.system, kind, forces_on_blocks(self._states.system, face))
        for sensor, own in self._sensors:
            sensor.add(np.array([weights[c] for _, c in own]), [k for k, _ in own], every)
        for bodies, width, own in self._bodies:
            for kind, changes in enumerate(bodies.back(_spread(weights, width, own))):
                every.add_blocks(self._states.system, kind, changes)
        if self._joints:
            forces = self._add_forces(weights, every)
        blocks = [
            every.seeds(_of_nodes(block, nodes, offsets, found[places]), block)
            for block, nodes, offsets, places in recorder.sources
        ]
        return Seeds(blocks, forces)

    def _add_forces(self, weights: FloatArray, sums: _Sums) -> FloatArray:
        """Add derivatives of columns of joints; returns those by multipliers (r,) (collective)."""
        system, factors = self._states.system, np.zeros(self._states.system.constraints.size)
        hold_applied(system.constraints)
        forces = system.reported_forces()
        for joint, width, own in self._joints:
            twists, by_forces = joint.back(_spread(weights, width, own), forces)
            factors += by_forces
            sums.add_blocks(system, 0, forces_on_blocks(system, twists))
        if not system.comm.allreduce(bool(factors.any()), op=MPI.LOR):
            return factors
        found = self._forces.back(factors)
        for kind, blocks in enumerate(found.motion):
            sums.add_blocks(system, kind, blocks)
        return found.forces

    def each(self, step: int) -> list[Seeds]:
        """Derivatives of each column, see :meth:`seeds` (collective)."""
        return [self.seeds(step, weights) for weights in np.eye(len(self._columns))]

    def _by_markers(
        self, t: float, states: Sequence[MarkerState], weights: FloatArray, found: FloatArray
    ) -> None:
        """Write derivatives of ``weights @ columns`` by all markers (markers, 20)."""
        for probe, at, own in self._probes:
            factors = np.zeros(len(probe.columns))
            for k, column in own:
                factors[k] = weights[column]
            if factors.any():
                places = slice(at, at + len(probe.markers))
                found[places] = _differences(probe, t, states[places], factors)


def _check_at_rest(probe: EnergyProbe, columns: Sequence[str]) -> None:
    """Refuse the potential of a weight that may grow along a path of equilibria.

    Raises:
        InputError: it is one of the columns.
    """
    if probe.columns[2] in columns:
        raise InputError(
            f'gradient: column "{probe.columns[2]}" of {_owner(probe)} has no derivatives in '
            "equilibria yet"
        )


def _nothing() -> NodeSeeds:
    """Derivatives by no node."""
    return NodeSeeds(np.empty(0, dtype=np.int64), *np.zeros((3, 0, 6)))


class _Sums:
    """Derivatives by the motion of all owned nodes of blocks."""

    def __init__(self, sums: dict[str, FloatArray]) -> None:
        self._sums = sums

    @classmethod
    def of(cls, system: System) -> _Sums:
        """Nothing so far."""
        return cls({part.block.name: np.zeros((3, part.block.owned, 6)) for part in system.parts})

    def add(self, block: FrameBlock, kind: int, values: FloatArray) -> None:
        """Add derivatives (n_owned, 6) by local twists, velocities or accelerations (0, 1, 2)."""
        self._sums[block.name][kind] += values

    def add_blocks(self, system: System, kind: int, values: BlockVectors) -> None:
        """Add derivatives (n_owned, w) of all blocks, see :meth:`add`."""
        for part, own in zip(system.parts, values, strict=True):
            self._sums[part.block.name][kind][:, : own.shape[1]] += own

    def seeds(self, others: NodeSeeds, block: FrameBlock) -> NodeSeeds:
        """These and others."""
        own = self._sums[block.name]
        nodes = np.flatnonzero(own.any(axis=(0, 2)))
        return NodeSeeds(
            np.concatenate([others.nodes, nodes]),
            *(
                np.concatenate([first, second[nodes]])
                for first, second in zip(
                    (others.twists, others.velocities, others.accelerations), own, strict=True
                )
            ),
        )


class _Inside:
    """Markers between nodes of a block, as functions of these."""

    #: What the components of a marker depend on, and the first component that does.
    _BY = (("frames", 0), ("velocity", 6), ("acceleration", 12))

    def __init__(self, block: FrameBlock, markers: Sequence[MarkersInside]) -> None:
        """Find those of the block (collective)."""
        self._block, self._markers = block, [one for one in markers if one.block is block]
        support = one_width([one.points.nodes for one in self._markers])
        self._places = np.concatenate([np.empty(0, np.int64), *(m.places for m in self._markers)])
        functions = NodeFunctions("a marker between nodes", block, support)
        self._functions = [copy(functions) for _ in self._BY]  # with steps of their own

    def add(self, found: FloatArray, sums: _Sums) -> None:
        """Add derivatives of all markers (markers, 20) by their nodes (collective)."""
        own = found[self._places]
        used = np.array([own.any(), own[:, 6:].any(), own[:, 12:].any()])
        self._block.comm.Allreduce(MPI.IN_PLACE, used, op=MPI.LOR)
        if not used[0]:
            return
        rotation = se3.rotation(self._rows()[:, :12])
        # accelerations of the markers are differences themselves
        last = _AT_NODES if used[2] else 12
        for kind, (name, first) in enumerate(self._BY):

            def values(first: int = first) -> FloatArray:
                return _components(self._rows(), rotation)[:, first:last]

            if used[kind]:
                change = self._functions[kind].derivatives(values, own[:, first:last], name)
                sums.add(self._block, kind, change)

    def _rows(self) -> FloatArray:
        """Motion of the markers at the trial state, (k, 26)."""
        return np.concatenate([np.empty((0, ROW)), *(one.rows() for one in self._markers)])


def _components(rows: FloatArray, rotation: FloatArray) -> FloatArray:
    """Motion (k, 18) of markers, with turns from rotations (k, 3, 3), inertial axes."""
    R = se3.rotation(rows[:, :12])
    turns = so3.log(R @ rotation.transpose(0, 2, 1))
    return np.concatenate([rows[:, :3], turns, rows[:, 12:18], rows[:, 20:]], axis=1)


def _spread(weights: FloatArray, width: int, own: Sequence[tuple[int, int]]) -> FloatArray:
    """Weights (width,) of all columns of a probe, of which some are chosen ones."""
    found = np.zeros(width)
    found[[k for k, _ in own]] = [weights[c] for _, c in own]
    return found


def _owner(probe: AnyProbe) -> str:
    """Name in messages."""
    return f'{type(probe).__name__} "{probe.name}"'


class _Sensor:
    """A measurement as a function of nodes."""

    def __init__(self, probe: AnyProbe, sensor: Sensor) -> None:
        """Find the nodes.

        Raises:
            InputError: it has no derivatives.
        """
        owner = _owner(probe)
        if not isinstance(sensor, NodalSensor):
            raise InputError(f"gradient: {owner} has no derivatives yet")
        self._sensor, self._columns = sensor, len(probe.columns)
        self._parts = [
            (one.block, NodeFunctions(owner, one.block, one.support)) for one in sensor.nodal
        ]

    def add(self, weights: FloatArray, columns: Sequence[int], sums: _Sums) -> None:
        """Add derivatives of weighted columns by their nodes (collective)."""
        if not weights.any():
            return
        every = np.zeros(self._columns)
        every[list(columns)] = weights
        linear = self._sensor.linearised(every)
        for (block, functions), (values, own) in zip(self._parts, linear, strict=True):
            sums.add(block, 0, functions.derivatives(values, own, "frames"))


def _differences(
    probe: Probe, t: float, states: Sequence[MarkerState], factors: FloatArray
) -> FloatArray:
    """Derivatives (markers, 20) of ``factors @ columns``.

    Raises:
        InputError: there are none.
    """
    found = np.zeros((len(states), _COMPONENTS))
    for m in range(len(states)):

        def value(way: FloatArray, m: int = m) -> float:
            """The weighted columns where the motion of a marker changes by (20,)."""
            moved = [*states]
            moved[m] = _moved(states[m], way)
            return float(factors @ probe.evaluate(t, moved))

        found[m], off = slopes(value, _COMPONENTS)
        if not off <= ENOUGH:
            raise InputError(
                f'gradient: a column of Probe "{probe.name}" has a kink or jumps at t = {t:.6g} s, '
                "and has no derivative there"
            )
    return found


def _moved(state: MarkerState, by: FloatArray) -> MarkerState:
    """A marker whose motion (20,) is changed."""
    place, turn, velocity, spin, acceleration, twirl = by[:_AT_NODES].reshape(6, 3)
    return replace(
        state, position=state.position + place, rotation=so3.exp(turn) @ state.rotation,
        velocity=state.velocity + velocity, angular_velocity=state.angular_velocity + spin,
        acceleration=state.acceleration + acceleration,
        angular_acceleration=state.angular_acceleration + twirl,
        arc=state.arc + by[18], arc_rate=state.arc_rate + by[19],
    )  # fmt: skip


def _of_nodes(
    block: FrameBlock, nodes: IntArray, offsets: FloatArray, found: FloatArray
) -> NodeSeeds:
    """From derivatives by markers (k, 20), inertial axes, to those by their nodes, local axes."""
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
