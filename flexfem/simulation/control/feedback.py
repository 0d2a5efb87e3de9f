# SPDX-License-Identifier: LGPL-3.0-or-later
"""Implicit feedback: actuators whose forces a continuous law computes from the trial motion.

The law's measurements are functions of the motion of markers, which are known at every iterate, so
that stiff gains on light bodies need no small steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.joint import Joint
from flexfem.core.laws import ElementLaw, ElementMotion, element
from flexfem.core.marker import Attachment, Ground, Marker, Observed
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.joints.actuator import Actuator
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.controller import Controller
from flexfem.model.model import Model
from flexfem.model.probes.base import MarkerState, Probe

__all__ = ["DrivenActuator", "FeedbackLaw", "feedback"]

#: Arc lengths and their rates: no marker slides.
_NO_ARCS = repeat((0.0, 0.0))


class FeedbackLaw:
    """The `ElementLaw` of a controller: its elements are its actuators.

    Attributes:
        markers: those of the probes that it measures.
        previous: (inputs,) measurements at the last accepted state, with which angles are
            continuous; None before the first.
        follows: True if they are known at an iterate: no probe uses accelerations.
    """

    states, explicit = 0, False

    def __init__(
        self, controller: Controller, probes: Sequence[tuple[Probe, int]],
        actuators: Sequence[Actuator], call: Callable[[float, FloatArray], FloatArray],
        held: Callable[[float], FloatArray],
    ) -> None:  # fmt: skip
        """Store the parts.

        Args:
            controller: the controller.
            probes: probe and number of the column of every input.
            actuators: those that it drives.
            call: checked outputs of its law at a time (s) and measurements.
            held: outputs at a time by the last accepted states, where it measures accelerations.
        """
        self.owner = f'{type(controller).__name__} "{controller.name}"'
        self.function: Callable[..., Any] = controller.law  # type: ignore[assignment]
        self._call, self._held, self._actuators = call, held, list(actuators)
        self._probes = list(dict.fromkeys(probe for probe, _ in probes))
        first = np.cumsum([0, *(len(probe.columns) for probe in self._probes)])
        columns = [int(first[self._probes.index(probe)]) + k for probe, k in probes]
        self._columns: IntArray = np.array(columns, dtype=np.int64)
        angles = [probe.columns[k] in probe.unwrap for probe, k in probes]
        self._angles: BoolArray = np.array(angles, dtype=np.bool_)
        self.markers = [
            marker
            for probe in self._probes
            for marker in probe.markers
            if isinstance(marker, (Marker, Ground))
        ]
        self.previous: FloatArray | None = None
        self._starts = np.tile(np.eye(3), (len(self.markers), 1, 1))
        self.follows = True
        # time, poses and twists of the markers, and columns of each probe
        self._last: tuple[float, FloatArray, list[FloatArray]] | None = None

    @property
    def size(self) -> int:
        """See :attr:`ElementLaw.size`."""
        return len(self.markers)

    def begin(self, poses: Sequence[Pose]) -> None:
        """Take the poses of the markers at the start."""
        self._starts = np.array([pose.rotation for pose in poses])
        frames = [np.concatenate([pose.position, pose.rotation.ravel()]) for pose in poses]
        motion = ElementMotion(0.0, np.array([frames]), np.zeros((1, len(poses), 6)))
        # accelerations are not known at an iterate
        self.follows = bool(np.isfinite(self._measured(motion)).all())

    def place(self, *, at_nodes: bool) -> None:
        """See :meth:`ElementLaw.place`: actuators have their own rows."""

    def initial(self, elements: IntArray) -> FloatArray:
        """See :meth:`ElementLaw.initial`."""
        return np.zeros((len(elements), 0))

    def forces(
        self, elements: IntArray, motion: ElementMotion, z: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """See :meth:`ElementLaw.forces`: an actuator's own force and the output for it."""
        t = motion.time
        outputs = self._call(t, self._measured(motion)) if self.follows else self._held(t)
        own = [float(self._actuators[k].force(t)) for k in elements.tolist()]
        return -(np.array(own) + outputs[elements])[:, np.newaxis], z

    def derivatives(
        self, elements: IntArray, motion: ElementMotion, z: FloatArray
    ) -> FloatArray | None:
        """See :meth:`ElementLaw.derivatives`."""
        if self.follows:
            return None
        return np.zeros((len(elements), 1, 12 * self.size))

    def _measured(self, motion: ElementMotion) -> FloatArray:
        """Measurements of a motion, angles next to those at the last accepted state."""
        y: FloatArray = np.concatenate(self._values(motion))[self._columns]
        if self.previous is not None:
            turns = np.round((self.previous - y) / (2.0 * np.pi))
            y = y + np.where(self._angles & np.isfinite(turns), 2.0 * np.pi * turns, 0.0)
        return y

    def _values(self, motion: ElementMotion) -> list[FloatArray]:
        """Columns of each probe; of those whose markers have not moved, the ones found before.

        Differences move one marker at a time.
        """
        now = np.concatenate([motion.poses[0], motion.twists[0]], axis=1)
        last = self._last
        known = last is not None and last[0] == motion.time
        moved = (now != last[1]).any(axis=1) if known and last is not None else None
        values, at, motions = [], 0, self._motions(now)
        for k, probe in enumerate(self._probes):
            own = slice(at, at + len(probe.markers))
            at = own.stop
            if last is not None and moved is not None and not moved[own].any():
                values.append(last[2][k])
            else:
                states = MarkerState.of_motions(motions[own], self._starts[own], _NO_ARCS)
                values.append(probe.evaluate(motion.time, states))
        if moved is None or moved.sum() > 1:
            self._last = motion.time, now, values
        return values

    def _motions(self, now: FloatArray) -> FloatArray:
        """Motions (n, 33), see ``MarkerState.of_motions``, of poses and twists (n, 18)."""
        R = now[:, 3:12].reshape(-1, 3, 3)
        motions = np.empty((len(now), 33))
        motions[:, :12] = now[:, :12]
        motions[:, 12:18] = (now[:, 12:].reshape(-1, 2, 3) @ R.transpose(0, 2, 1)).reshape(-1, 6)
        motions[:, 18:24] = np.nan
        motions[:, 24:] = (R @ self._starts.transpose(0, 2, 1)).reshape(-1, 9)
        return motions


@dataclass(frozen=True, eq=False)
class DrivenActuator(Joint):
    """An actuator with feedback.

    Attributes:
        actuator: the actuator.
        law: law of the controller.
        number: of the output.
    """

    actuator: Actuator
    law: FeedbackLaw
    number: int

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`: the measured markers come first."""
        sensed = tuple((f"measured {k}", marker) for k, marker in enumerate(self.law.markers))
        return (*sensed, ("a", self.a), ("b", self.b))

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`."""
        return ((self.law.size, self.law.size + 1),)

    @property
    def second(self) -> int:
        """See :attr:`Joint.second`."""
        return self.law.size + 1

    @property
    def owner(self) -> str:
        """See :attr:`Joint.owner`."""
        return self.actuator.owner

    @property
    def direction(self) -> FloatArray | None:
        """See :attr:`Joint.direction`."""
        return self.actuator.direction

    @property
    def element(self) -> tuple[ElementLaw, int]:
        """See :attr:`Joint.element`."""
        return self.law, self.number

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`: that of the actuator, with terms for the measured markers."""
        count = self.law.size
        self.law.begin(poses[:count])
        term = replace(self.actuator.coordinate(poses[count:]), a=count, b=count + 1)
        sensed = tuple(
            Term(RowKind.TWIST, a=k, b=min(k + 1, count - 1), factor=0.0)
            for k in range(0, count, 2)
        )
        return (Row((*sensed, term), law=element()),)


def feedback(
    model: Model, controller: Controller, call: Callable[[float, FloatArray], FloatArray],
    held: Callable[[float], FloatArray],
) -> dict[str, DrivenActuator]:  # fmt: skip
    """Actuators with implicit feedback by name; none where the controller cannot have it.

    It measures functions of markers at nodes of beams, floating bodies and rigid bodies, and drives
    actuators.
    """
    measured = controller.measured(model)
    probes = [(probe, k) for probe, k in measured if isinstance(probe, Probe)]
    at_nodes = all(_is_at_node(model, m) for probe, _ in probes for m in probe.markers)
    actuators = [model.get(name) for name in controller.outputs]
    driven = [one for one in actuators if isinstance(one, Actuator)]
    if not (probes and at_nodes) or len(probes) < len(measured) or len(driven) < len(actuators):
        return {}
    law = FeedbackLaw(controller, probes, driven, call, held)
    return {
        one.name: DrivenActuator(one.name, one.a, one.b, one, law, k)
        for k, one in enumerate(driven)
    }


def _is_at_node(model: Model, marker: Observed) -> bool:
    """True on the ground and at nodes with axes."""
    if type(marker) is Ground:
        return True
    if type(marker) is not Marker:
        return False
    body = model.get(marker.body)
    if isinstance(body, RigidBody):
        return True
    place = model.marker_place(marker)
    return isinstance(body, (Beam, FloatingBody)) and place is not None and place.node is not None
