# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probe columns differentiated along motions of the nodes."""

from collections.abc import Callable

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.marker import Attachment, Ground, SlidingMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import find_jacobian, turn_columns
from flexfem.layout.element_places import holds
from flexfem.layout.lines import ElementPlace
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.probes.base import MarkerState, Probe
from flexfem.system.measure.marker_states import without_spin
from flexfem.system.system import System

__all__ = ["probe_rates"]

#: Step of the central differences of probe functions; markers are moved exactly.
_STEP = 1e-6


def probe_rates(
    system: System, serial: NumberedModel, split: Callable[[FloatArray], list[FloatArray]],
    motions: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Columns of markers' probes and their derivatives by coordinates of motions (collective).

    With ``u = sum_j motion_j q_j`` a node's twist changes by ``u' + ad_v u``; markers follow their
    nodes exactly, and the probe functions of the markers' states are differentiated numerically.

    Args:
        system: in the state the motions belong to.
        serial: serial data of its model.
        split: from an array of this rank's unknowns to (n_owned, width) of each part.
        motions: (k, n_local) local twists of this rank's nodes.

    Returns:
        Values (p,), derivatives by q and by its rate (p, k), on every rank.
    """
    probes = [probe for probe in serial.model.probes if isinstance(probe, Probe)]
    markers = [marker for probe in probes for marker in probe.markers]
    count = len(motions)
    states, twists = np.zeros((len(markers), 18)), np.zeros((len(markers), 6, count))
    starts = [serial.marker_pose(marker).rotation for marker in markers]
    rotates = ~without_spin(serial, markers)
    for m, marker in enumerate(markers):
        if isinstance(marker, SlidingMarker):
            raise InputError(f'SlidingMarker "{marker.joint}": linear models have no sliders')
        states[m], twists[m] = _motion(system, serial, split, motions, marker)
    states, twists = system.comm.allreduce(states), system.comm.allreduce(twists)
    values, by_q, by_rate = [np.zeros(0)], [np.zeros((0, count))], [np.zeros((0, count))]
    at = 0
    for probe in probes:
        own = slice(at, at + len(probe.markers))
        at += len(probe.markers)

        def columns(table: FloatArray, probe: Probe = probe, own: slice = own) -> FloatArray:
            states = list(map(_state, table, starts[own], rotates[own]))
            return probe.evaluate(system.time, states)

        values.append(columns(states[own]))
        if np.isnan(values[-1]).any():
            raise InputError(
                f'{type(probe).__name__} "{probe.name}": columns of a linear model must be numbers '
                "that do not depend on accelerations, nor on turns of nodes that have no rotations"
            )
        for moving, found in ((False, by_q), (True, by_rate)):
            found.append(_derivative(columns, states[own], twists[own], moving))
    return np.concatenate(values), np.concatenate(by_q), np.concatenate(by_rate)


def _motion(
    system: System, serial: NumberedModel, split: Callable[[FloatArray], list[FloatArray]],
    motions: FloatArray, marker: Attachment,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """This rank's share in the state (18,) of a marker and its twists (6, k) along the motions."""
    offset = serial.marker_frame(marker)
    state, twists = np.zeros(18), np.zeros((6, len(motions)))
    if isinstance(marker, Ground):
        state[:12] = offset if system.comm.rank == 0 else 0.0
        return state, twists
    to_marker, place = se3.adjoint(se3.inverse(offset)), serial.place(marker)
    for p, part in enumerate(system.parts):
        block = part.block
        if place is None:
            nodes = np.array([serial.local_node(marker, part.kind, block)])
            J = to_marker
            if nodes[0] >= 0:
                state[:12] = se3.compose(block.frames[nodes[0]], offset)
                state[12:] = to_marker @ block.velocity[nodes[0]]
        elif place.kind == part.kind:
            state, J = _inside(block, place, offset)
            nodes, J = block.owned_index(place.nodes), to_marker @ J
        else:
            continue
        for k in np.flatnonzero(nodes >= 0):
            for j, motion in enumerate(motions):
                moved = split(motion)[p][nodes[k]]
                twists[:, j] += J[:, 6 * k : 6 * k + len(moved)] @ moved
    return state, twists


def _inside(
    block: FrameBlock, place: ElementPlace, offset: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """State (18,) of a marker inside an element on the rank of that, else zero.

    Also, on all ranks, the local twist of the point by those of its nodes (collective).
    """
    k = len(place.nodes)
    J, state = np.zeros((6, 6 * k + 1)), np.zeros(18)
    if holds(block, place):
        nodes, H = block.local_index(place.nodes), np.empty(12)
        sections = place.sections(block.frames[nodes])
        find_jacobian(place.element, sections, place.shape, place.xi, H, J)
        turn_columns(place.turns, J)
        state[:12] = se3.compose(H, offset)
        twist = J[:, :-1] @ block.velocity[nodes].ravel()
        state[12:] = se3.adjoint(se3.inverse(offset)) @ twist
    return state, block.comm.allreduce(J)


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


def _state(row: FloatArray, start: FloatArray, rotates: bool) -> MarkerState:
    """State of a marker; derivatives by rotations are zero if nodes do not rotate."""
    R = row[3:12].reshape(3, 3)
    unknown = np.full(3, np.nan)
    return MarkerState(
        row[:3], R if rotates else np.full((3, 3), np.nan), R @ row[12:15],
        R @ row[15:] if rotates else unknown, start=start, acceleration=unknown,
        angular_acceleration=unknown,
    )  # fmt: skip
