# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with markers on lines: on SE(3) elements with turned sections, on NURBS elements."""

from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.core.joint import Joint
from flexfem.core.line_points import NURBS, SE3, line_pose, turn_frames
from flexfem.core.pose import Pose
from flexfem.lie import se3, so3
from flexfem.system.constraints import Constraints
from flexfem.system.line_data import ON_LINE
from flexfem.system.lines import Line, Rail, RailPoint
from flexfem.system.row_table import PlacedJoint
from tests.contract.joint_examples import Placed, interface

#: Quadratic B-spline with knots 0 0 0 1 2 2 2: shape functions of both elements in powers of xi.
QUADRATIC = np.array(
    [
        [[1.0, -2.0, 1.0], [0.0, 2.0, -1.5], [0.0, 0.0, 0.5]],
        [[0.5, -1.0, 0.5], [0.5, 1.0, -1.5], [0.0, 0.0, 1.0]],
    ]
)
#: and with weights
RATIONAL = QUADRATIC * np.array([[[1.0], [1.3], [0.8]], [[1.3], [0.8], [1.1]]])


@dataclass(frozen=True)
class LineExample:
    """A joint whose first marker is on a line, and its second on a node of its own or on the line.

    Attributes:
        cls: its class.
        rows: number of its constraints.
        arguments: all but name and markers.
        action: it acts on a sliding joint.
        slides: its first marker slides.
        elastic: it has laws.
    """

    cls: type[Joint]
    rows: int
    arguments: dict[str, Any] = field(default_factory=dict)
    action: bool = False
    slides: bool = True
    elastic: bool = False

    def joint(self) -> Joint:
        if not self.slides:
            return self.cls("joint", ff.Ground(), ff.Ground(), **self.arguments)
        slide = ff.Sliding(
            "slide", ff.Carrier("line"), ff.Ground(), **({} if self.action else self.arguments)
        )
        return self.cls("joint", slide, **self.arguments) if self.action else slide


SLIDING = {
    "Sliding": LineExample(ff.Sliding, 2),
    "Sliding-tied": LineExample(ff.Sliding, 5, {"tied": True}),
    "PrescribedSlide": LineExample(
        ff.PrescribedSlide, 1, {"zeta": lambda t: 0.3 + t}, action=True
    ),
    "SlideStop": LineExample(
        ff.SlideStop, 1, {"upper": 0.1, "stiffness": 70.0, "damping": 9.0}, action=True,
        elastic=True,
    ),
    "Lock": LineExample(ff.Lock, 1, {"locked": True}, action=True),
    "JointFriction": LineExample(
        ff.JointFriction, 1, {"coefficient": 0.6, "velocity": 0.8, "viscous": 0.3}, action=True,
        elastic=True,
    ),
}  # fmt: skip
FIXED = {
    "Spherical": LineExample(ff.Spherical, 3, slides=False),
    "Revolute": LineExample(ff.Revolute, 5, {"axis": (0.6, -0.3, 0.8)}, slides=False),
    "Distance": LineExample(ff.Distance, 1, slides=False),
    "TorsionalSpringDamper": LineExample(
        ff.TorsionalSpringDamper, 1,
        {"axis": (0.6, -0.3, 0.8), "stiffness": 7.0, "damping": 4.0}, slides=False, elastic=True,
    ),
}  # fmt: skip
LINES = {"se3": None, "nurbs": QUADRATIC, "rational": RATIONAL}


class PlacedOnLine(Placed):
    """One joint between a line of two elements and a node of its own."""

    def __init__(self, example: LineExample, line: str, rng: np.random.Generator) -> None:
        self.shape = LINES[line]
        nodes = _line_nodes(3 if self.shape is None else 4, rng)
        free = se3.exp(np.array([0.2, 0.1, -0.3, 0.4, 0.1, 0.7]))
        self.start = np.concatenate([nodes, free[np.newaxis]])
        self.count = len(self.start)
        self.turns = so3.exp(0.4 * rng.normal(size=(2, 2, 3))).reshape(2, 2, 9)
        if self.shape is not None:
            self.turns[:] = np.eye(3).ravel()
        place = (0, 0.93)
        section = self.section(self.start, *place)
        offset = se3.frame(np.array([0.0, 0.1, 0.05]), so3.exp(np.array([0.3, 0.1, -0.2])))
        first = section if example.slides else se3.compose(section, offset)
        gap = np.zeros(3) if example.rows > 1 else np.array([0.1, 0.5, 0.2]) * (not example.slides)
        second = se3.frame(first[:3] + gap, so3.exp(np.array([0.3, -0.5, 0.4])))
        self.offsets = np.array(
            [
                se3.frame(np.zeros(3), np.eye(3)) if example.slides else offset,
                se3.compose(se3.inverse(free), second),
            ]
        )
        self.face = interface(self.start)
        point = RailPoint(self._rail(), *place, slides=example.slides)
        poses = tuple(Pose(H[:3], se3.rotation(H)) for H in (first, second))
        joint = example.joint()
        every = [joint] if joint.partner is None else [joint.partner, joint]
        placed = [
            PlacedJoint(
                one, k, poses, (ON_LINE, self.count - 1), self.offsets, (point, None),
                owned=True, shared=False,
            )
            for k, one in enumerate(every)
        ]  # fmt: skip
        self.rows = Constraints(MPI.COMM_SELF, placed, self.face)

    def _cells(self) -> np.ndarray:
        width = 2 if self.shape is None else 3
        return np.array([np.arange(e, e + width) for e in range(2)])

    def _rail(self) -> Rail:
        nodes = self._cells()
        arc = np.array([[0.0, 0.8, 0.1], [0.0, 1.0, -0.2]])
        turns = self.turns if self.shape is None else None
        starts = np.array([0.0, 0.9])
        element = SE3 if self.shape is None else NURBS
        return Rail(Line(0, nodes, np.arange(2), self.shape, turns, starts, arc, element), nodes)

    def section(self, frames: np.ndarray, element: int, xi: float) -> np.ndarray:
        """Frame of a section."""
        own, H = frames[self._cells()[element]].copy(), np.empty(12)
        if self.shape is None:
            turn_frames(own, self.turns[element], own)
            line_pose(SE3, own, np.empty((0, 0)), xi, H)
        else:
            line_pose(NURBS, own, self.shape[element], xi, H)
        return H

    def disturb(self, rng: np.random.Generator) -> None:
        n = self.count
        self.face.frames[:] = se3.retract(self.start, 0.05 * rng.normal(size=(n, 6)))
        self.face.velocities[:] = rng.normal(size=(n, 6))
        self.face.increments[:] = 0.2 * rng.normal(size=(n, 6))


def _line_nodes(count: int, rng: np.random.Generator) -> np.ndarray:
    """Frames of a line that bends and twists."""
    frames = [se3.exp(rng.normal(size=6))]
    for _ in range(count - 1):
        step = np.array([2.0 / (count - 1), 0.0, 0.0, 0.2, 0.3, -0.2])
        frames.append(se3.retract(frames[-1], step))
    return np.array(frames)
