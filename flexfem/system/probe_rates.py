# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probe columns differentiated along motions of the nodes."""

from collections.abc import Callable

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie import se3
from flexfem.model.probe import MarkerState, Probe
from flexfem.system.assembly import Assembly
from flexfem.system.system import System

__all__ = ["probe_rates"]

#: Step of the central differences of probe functions; markers are moved exactly.
_STEP = 1e-6


def probe_rates(
    system: System, serial: Assembly, split: Callable[[FloatArray], list[FloatArray]],
    motions: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Columns of markers' probes and their derivatives by coordinates of motions (collective).

    With ``u = sum_j motion_j q_j`` a node's twist changes by ``u' + ad_v u``; markers follow their
    nodes exactly, and the probe functions of the markers' states are differentiated numerically.

    Args:
        system: in the state the motions belong to.
        serial: serial data of its model.
        split: from an array of this rank's unknowns to (n_owned, 6) of each part.
        motions: (k, n_local) local twists of this rank's nodes.

    Returns:
        Values (p,), derivatives by q and by its rate (p, k), on every rank.
    """
    probes = [probe for probe in serial.model.probes if isinstance(probe, Probe)]
    markers = [marker for probe in probes for marker in probe.markers]
    count = len(motions)
    states, twists = np.zeros((len(markers), 18)), np.zeros((len(markers), 6, count))
    first = system.comm.rank == 0
    for m, marker in enumerate(markers):
        offset = serial.marker_frame(marker)
        if serial.key(marker) is None:
            states[m, :12] = offset if first else 0.0
            continue
        to_marker = se3.adjoint(se3.inverse(offset))
        for p, part in enumerate(system.parts):
            node = serial.local_node(marker, part.kind, part.block)
            if node >= 0:
                states[m, :12] = se3.compose(part.block.frames[node], offset)
                states[m, 12:] = to_marker @ part.block.velocity[node]
                for j, motion in enumerate(motions):
                    twists[m, :, j] = to_marker @ split(motion)[p][node]
    states, twists = system.comm.allreduce(states), system.comm.allreduce(twists)
    values, by_q, by_rate = [np.zeros(0)], [np.zeros((0, count))], [np.zeros((0, count))]
    at = 0
    for probe in probes:
        own = slice(at, at + len(probe.markers))
        at += len(probe.markers)

        def columns(table: FloatArray, probe: Probe = probe) -> FloatArray:
            return probe.evaluate(system.time, [_state(row) for row in table])

        values.append(columns(states[own]))
        for moving, found in ((False, by_q), (True, by_rate)):
            found.append(_derivative(columns, states[own], twists[own], moving))
    return np.concatenate(values), np.concatenate(by_q), np.concatenate(by_rate)


def _derivative(
    columns: Callable[[FloatArray], FloatArray], states: FloatArray, twists: FloatArray,
    moving: bool,
) -> FloatArray:  # fmt: skip
    """Derivative of columns by the coordinates of the markers' twists, or by their rates."""
    total: FloatArray | None = None
    for m in range(len(states)):
        for i in range(6):
            ends = []
            for sign in (1.0, -1.0):
                table = states.copy()
                table[m] = _moved(states[m], sign * _STEP * np.eye(6)[i], moving)
                ends.append(columns(table))
            slope = (ends[0] - ends[1]) / (2.0 * _STEP)
            change = np.outer(slope, twists[m, i])
            total = change if total is None else total + change
    return np.zeros((len(columns(states)), twists.shape[2])) if total is None else total


def _moved(state: FloatArray, step: FloatArray, moving: bool) -> FloatArray:
    """State of a marker whose local twist, or its rate, has the value ``step``."""
    moved = state.copy()
    if moving:
        moved[12:] += step
        return moved
    v, omega = state[12:15], state[15:]
    moved[:12] = se3.retract(state[:12], step)
    moved[12:15] += np.cross(omega, step[:3]) + np.cross(v, step[3:])
    moved[15:] += np.cross(omega, step[3:])
    return moved


def _state(row: FloatArray) -> MarkerState:
    R = row[3:12].reshape(3, 3)
    return MarkerState(row[:3], R, R @ row[12:15], R @ row[15:])
