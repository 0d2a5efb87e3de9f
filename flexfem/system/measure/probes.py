# SPDX-License-Identifier: LGPL-3.0-or-later
"""Recording of the model's probes.

Each rank buffers for some steps the motion of its own probe markers, and its share of the
measurements of sensors; then the first rank receives all at once and evaluates the columns. The
messages have a few numbers per probe. With functions of the user's it does so at every record, as
one that fails ends the run.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Ground, Observed
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.kernels.compiled import kernel
from flexfem.layout.element_places import ElementPlaces, places_on_rank
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.lie.se3 import compose_into
from flexfem.model.probes.base import AnyProbe, MarkerState, Probe
from flexfem.system.measure.aggregate import Aggregate
from flexfem.system.measure.energies import EnergyMeter
from flexfem.system.measure.marker_states import without_spin
from flexfem.system.measure.sensors import create_sensor
from flexfem.system.measure.sliders import Sliders
from flexfem.system.system import BlockPart, System

__all__ = ["ROW", "MarkersInside", "ProbeRecorder"]

#: Numbers of the motion of a marker:
ROW = 26  # frame, velocities, arc length of a slider and its rate, accelerations


@kernel
def _record(
    frames: FloatArray, velocity: FloatArray, acceleration: FloatArray, nodes: IntArray,
    offsets: FloatArray, places: IntArray, out: FloatArray,
) -> None:  # fmt: skip
    """States of markers on the nodes of one block into the rows ``places`` of ``out``."""
    for k in range(nodes.size):
        H, v, o, row = frames[nodes[k]], velocity[nodes[k]], offsets[k], out[places[k]]
        w = acceleration[nodes[k]]
        compose_into(H, o, row)
        # velocity of the marker in the node's axes, then inertial
        p0 = v[0] + v[4] * o[2] - v[5] * o[1]
        p1 = v[1] + v[5] * o[0] - v[3] * o[2]
        p2 = v[2] + v[3] * o[1] - v[4] * o[0]
        # its rate there, and the term of the rotating axes
        a0 = w[0] + w[4] * o[2] - w[5] * o[1] + v[4] * p2 - v[5] * p1
        a1 = w[1] + w[5] * o[0] - w[3] * o[2] + v[5] * p0 - v[3] * p2
        a2 = w[2] + w[3] * o[1] - w[4] * o[0] + v[3] * p1 - v[4] * p0
        for i in range(3):
            r0, r1, r2 = H[3 + 3 * i], H[4 + 3 * i], H[5 + 3 * i]
            row[12 + i] = r0 * p0 + r1 * p1 + r2 * p2
            row[15 + i] = r0 * v[3] + r1 * v[4] + r2 * v[5]
            row[20 + i] = r0 * a0 + r1 * a1 + r2 * a2
            row[23 + i] = r0 * w[3] + r1 * w[4] + r2 * w[5]


@dataclass(frozen=True)
class MarkersInside:
    """Markers between nodes, in elements of this rank.

    Attributes:
        block: of the elements' nodes.
        points: places of the markers.
        offsets: (k, 12) from the sections there.
        places: (k,) numbers of the markers among those of all probes.
    """

    block: FrameBlock
    points: ElementPlaces
    offsets: FloatArray
    places: IntArray

    def rows(self) -> FloatArray:
        """Motion of the markers at the trial state, (k, 26)."""
        found, every = np.zeros((len(self.places), ROW)), np.arange(len(self.places))
        frames, twists = self.points.motion(self.block)
        _record(
            frames, twists, self.points.twist_rates(self.block), every, self.offsets, every, found
        )  # fmt: skip
        return found


class ProbeRecorder:
    """Buffer of the probes' markers and measurements.

    Attributes:
        columns: names of all columns; unwrap: names of those that are angles.
        sources: block, owned nodes, offsets (k, 12) and places of the markers at nodes of each
            part.
        inside: markers between nodes.
        sensors: those of probes that are no functions of markers, by the probes' names.
    """

    def __init__(self, system: System, serial: NumberedModel, depth: int = 64) -> None:
        """Find the markers on this rank and start the sensors (collective).

        Args:
            system: the system.
            serial: serial data of its model.
            depth: number of steps after which the buffer is full.
        """
        self._probes = serial.model.probes
        self.columns = [c for p in self._probes for c in p.columns]
        self.unwrap = [c for p in self._probes for c in p.unwrap]
        markers = [m for p in self._probes for m in p.markers]
        self._comm = system.comm
        offsets = np.array([serial.marker_frame(m) for m in markers]).reshape(-1, 12)
        self._start = [serial.marker_pose(m).rotation for m in markers]
        self._bare = np.flatnonzero(without_spin(serial, markers))
        self._buffer = np.zeros((depth, len(markers), ROW))
        ground = [k for k, m in enumerate(markers) if isinstance(m, Ground)]
        self._buffer[:, ground, :12] = offsets[ground]
        self.sources = [self._source(part, serial, markers, offsets) for part in system.parts]
        self.inside = [
            MarkersInside(part.block, points, offsets[places], places)
            for part in system.parts
            for points, places in places_on_rank(serial, part.kind, part.block, markers)
        ]
        self._sliders = Sliders(system, markers)
        mine = [places for *_, places in self.sources]
        mine += [one.places for one in self.inside]
        mine.append(self._sliders.places)
        self._places = np.concatenate([np.empty(0, dtype=np.int64), *mine])
        sensors = [create_sensor(probe, system, serial) for probe in self._probes]
        self.sensors = {
            probe.name: sensor
            for probe, sensor in zip(self._probes, sensors, strict=True)
            if sensor is not None
        }
        self._sensors = list(self.sensors.values())
        self._meters = [sensor for sensor in sensors if isinstance(sensor, EnergyMeter)]
        width = sum(
            len(p.columns) for p, g in zip(self._probes, sensors, strict=True) if g is not None
        )
        self._shares = np.zeros((depth, width))
        self._times: list[float] = []
        # a function of the user's that fails must end the run at once, not when the buffer is full
        self._at_once = any(map(_of_a_user, self._probes))
        self._evaluated: list[tuple[float, FloatArray]] = []
        self._count = 0  # of records since the last flush

    @staticmethod
    def _source(
        part: BlockPart, serial: NumberedModel, markers: list[Observed], offsets: FloatArray
    ) -> tuple[FrameBlock, IntArray, FloatArray, IntArray]:
        """Block, nodes, offsets and places of the markers that this rank owns in a part."""
        block = part.block
        local = [serial.local_node(marker, part.kind, block) for marker in markers]
        places = np.array([k for k, node in enumerate(local) if node >= 0], dtype=np.int64)
        nodes = np.array([local[k] for k in places], dtype=np.int64)
        return block, nodes, offsets[places], places

    def state(self) -> FloatArray:
        """Return the sums of energies so far, over all ranks (collective)."""
        shares = [m.state() for m in self._meters]
        total = np.concatenate([np.empty(0), *shares])
        self._comm.Allreduce(MPI.IN_PLACE, total)
        return total

    def restore(self, state: FloatArray) -> None:
        """Restore a result of :meth:`state`.

        Raises:
            InputError: it is not a state of the probes of this model.
        """
        count = len(self._meters) * EnergyMeter.SHARES
        if state.shape != (count,) or not np.isfinite(state).all():
            raise InputError(f'checkpoint: "sums" does not hold {count} finite numbers')
        shares = state.reshape(len(self._meters), EnergyMeter.SHARES) * float(self._comm.rank == 0)
        for meter, share in zip(self._meters, shares, strict=True):
            meter.restore(share)

    @property
    def energies(self) -> EnergyMeter | None:
        """Energies of the whole model, if a probe records them."""
        return next((meter for meter in self._meters if meter.whole), None)

    @property
    def full(self) -> bool:
        """True if the buffer must be emptied before the next record."""
        return self._count == len(self._buffer)

    def follow(self) -> None:
        """Sum the work up to an accepted state that is not recorded."""
        for meter in self._meters:
            meter.update()

    def record(self, t: float) -> None:
        """Buffer the accepted state at time ``t`` (collective with functions of the user's)."""
        row = self._buffer[len(self._times)]
        self._record_markers(row)
        if self._sensors:
            self._shares[len(self._times)] = np.concatenate([g.update() for g in self._sensors])
        self._times.append(t)
        self._count += 1
        if self._at_once:
            self._evaluate_records()

    def _record_markers(self, row: FloatArray) -> None:
        """Motion of this rank's markers."""
        for block, nodes, offsets, places in self.sources:
            if len(nodes):
                _record(
                    block.frames, block.velocity, block.acceleration, nodes, offsets, places, row
                )  # fmt: skip
        for one in self.inside:
            row[one.places] = one.rows()
        if len(self._sliders.places):
            self._record_sliders(row)

    def _record_sliders(self, row: FloatArray) -> None:
        """Sections at sliders, their arc lengths and rates."""
        motion, places = self._sliders.motion(), self._sliders.places
        unmoved = np.tile(se3.frame(np.zeros(3), np.eye(3)), (len(places), 1))
        frames, twists = motion[:, :12].copy(), motion[:, 12:18].copy()
        unknown = np.full_like(twists, np.nan)
        _record(frames, twists, unknown, np.arange(len(places)), unmoved, places, row)
        row[places, 18:20] = motion[:, 18:]

    def check(self, t: float) -> None:
        """Call the functions of all probes at the accepted state, time ``t`` (collective)."""
        self._record_markers(self._buffer[0])
        for row in self._gathered(1)[0]:
            self._evaluate(t, row, np.zeros(self._shares.shape[1]))
        for sensor in self._sensors:
            if isinstance(sensor, Aggregate):
                sensor.update()

    def states(self) -> list[MarkerState]:
        """States of all probes' markers now, on the first rank only (collective)."""
        self._record_markers(self._buffer[0])
        return [state for row in self._gathered(1)[0] for state in self._states(row)]

    def flush(self) -> Iterator[tuple[float, FloatArray]]:
        """Empty the buffer (collective): times and column values on the first rank."""
        if self._times:
            self._evaluate_records()
        found, self._evaluated, self._count = self._evaluated, [], 0
        return iter(found)

    def _evaluate_records(self) -> None:
        """Evaluate the buffered states on the first rank (collective)."""
        times, self._times = self._times, []
        rows = zip(times, *self._gathered(len(times)), strict=False)
        self._evaluated += [(t, self._evaluate(t, row, numbers)) for t, row, numbers in rows]

    def _gathered(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Markers and measurements of records, on the first rank only (collective)."""
        every, measured = self._buffer[:count].copy(), self._shares[:count].copy()
        if self._comm.size > 1:
            parts = self._comm.gather((self._places, every[:, self._places], measured))
            if parts is None:
                return self._buffer[:0], self._shares[:0]
            for places, values, shares in parts[1:]:
                every[:, places] = values
                measured += shares
        if len(self._bare):
            for rates in (every[..., 15:18], every[..., 23:]):
                rates[:, self._bare] = np.nan
        return every, measured

    def _states(self, row: FloatArray) -> list[MarkerState]:
        """States of all markers of a record."""
        return [
            MarkerState(
                r[:3], r[3:12].reshape(3, 3), r[12:15], r[15:18], *arc, start, r[20:23], r[23:]
            )
            for r, arc, start in zip(row, map(_arc, row), self._start, strict=True)
        ]

    def _evaluate(self, t: float, row: FloatArray, measured: FloatArray) -> FloatArray:
        states = self._states(row)
        values, at, read = [np.empty(0)], 0, 0
        for probe in self._probes:
            if isinstance(probe, Probe):
                count = len(probe.markers)
                values.append(probe.evaluate(t, states[at : at + count]))
                at += count
            else:
                count = len(probe.columns)
                values.append(measured[read : read + count])
                read += count
        return np.concatenate(values)


def _of_a_user(probe: AnyProbe) -> bool:
    """Return True if the columns are computed by a function of the user's."""
    module = str(getattr(getattr(probe, "function", None), "__module__", ""))
    return isinstance(probe, Probe) and not module.startswith("flexfem.")


def _arc(row: FloatArray) -> tuple[float, float]:
    """Arc length of a slider and its rate."""
    return float(row[18]), float(row[19])
