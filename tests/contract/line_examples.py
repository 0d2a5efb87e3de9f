# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with markers on lines: SE(3) elements with rotated sections, NURBS, lines of bodies."""

from dataclasses import dataclass, field
from math import comb
from typing import Any

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.constraints.batch import Constraints
from flexfem.constraints.lines.data import ON_LINE
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.joint import Joint
from flexfem.core.places.line_points import BODY, NURBS, SE3, line_pose, turn_frames
from flexfem.core.pose import Pose
from flexfem.layout.lines import Line, Rail, RailPoint
from flexfem.lie import se3, so3
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


def _carried(functions: int, size: float = 1.0) -> np.ndarray:
    """Two elements of a line that a body carries, of which the second continues the first.

    It bends; so many coordinates displace and rotate it.
    """
    rng = np.random.default_rng(3)
    cubic = np.zeros((1 + functions, 7, 4))
    cubic[0, :4] = [[0.2, 1.0, 0.0, 0.0], [0.1, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, 0.02], [1, 0, 0, 0]]
    cubic[0, 4:] = [[0.1, 0.05, 0.0, 0.0], [0.0, 0.0, -0.03, 0.0], [0.0, 0.1, 0.0, 0.0]]
    cubic[1:] = size * rng.normal(size=(functions, 7, 4)) * [0.3, 0.3, 0.1, 0.05]
    shift = np.array([[comb(m, r) for r in range(4)] for m in range(4)])  # xi becomes xi + 1
    return np.stack([cubic, cubic @ shift]).reshape(2, 1 + functions, 28)


#: Interpolations of frames, nodes of the elements, coefficients.
LINES = {
    "se3": (SE3, [[0, 1], [1, 2]], None),
    "nurbs": (NURBS, [[0, 1, 2], [1, 2, 3]], QUADRATIC),
    "rational": (NURBS, [[0, 1, 2], [1, 2, 3]], RATIONAL),
    "rigid": (BODY, [[0], [0]], _carried(0)),
    "floating": (BODY, [[0, 1, 2, 3], [0, 1, 2, 3]], _carried(15)),
    "nonlinear": (BODY, [[0, 1, 2, 3], [0, 1, 2, 3]], _carried(28, 0.3)),
}
CARRIED = ("floating", "nonlinear")


class PlacedOnLine(Placed):
    """One joint between a line of two elements and a node of its own."""

    def __init__(self, example: LineExample, line: str, rng: np.random.Generator) -> None:
        self.element, cells, self.shape = LINES[line]
        self.cells = np.array(cells)
        nodes = _line_nodes(self.cells.max() + 1, rng)
        if line in CARRIED:  # two interfaces near the frame's own, and three amplitudes
            nodes[1:3] = se3.retract(nodes[:1], 0.3 * rng.normal(size=(2, 6)))
            nodes[3] = se3.frame(0.2 * rng.normal(size=3), np.eye(3))
        free = se3.exp(np.array([0.2, 0.1, -0.3, 0.4, 0.1, 0.7]))
        self.start = np.concatenate([nodes, free[np.newaxis]])
        self.count = len(self.start)
        self.spatial = np.arange(self.count) != (3 if line in CARRIED else -1)
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

    def _rail(self) -> Rail:
        arc = np.array([[0.0, 0.8, 0.1], [0.0, 1.0, -0.2]])
        turns = self.turns if self.shape is None else None
        starts = np.array([0.0, 0.9])
        elements = np.arange(2)
        line = Line(0, self.cells, elements, self.shape, turns, starts, arc, self.element)
        return Rail(line, self.cells)

    def section(self, frames: np.ndarray, element: int, xi: float) -> np.ndarray:
        """Frame of a section."""
        own, H = frames[self.cells[element]].copy(), np.empty(12)
        if self.shape is None:
            turn_frames(own, self.turns[element], own)
        shape = np.empty((0, 0)) if self.shape is None else self.shape[element]
        line_pose(self.element, own, shape, xi, H)
        return H

    def disturb(self, rng: np.random.Generator) -> None:
        n = self.count
        steps, self.face.velocities[:] = 0.05 * rng.normal(size=(n, 6)), rng.normal(size=(n, 6))
        self.face.increments[:] = 0.2 * rng.normal(size=(n, 6))
        for values in (steps, self.face.velocities, self.face.increments):
            values[~self.spatial, 3:] = 0.0
        self.face.frames[:] = se3.retract(self.start, steps)

    def move(self, motion: np.ndarray) -> None:
        """Move everything by a rigid motion; amplitudes do not take part."""
        frames = self.face.frames
        frames[self.spatial] = se3.compose(motion, frames[self.spatial])

    def nodal_forces(self) -> tuple[np.ndarray, np.ndarray]:
        force, moment = super().nodal_forces()
        return force * self.spatial[:, np.newaxis], moment * self.spatial[:, np.newaxis]


def _line_nodes(count: int, rng: np.random.Generator) -> np.ndarray:
    """Frames of a line that bends and twists."""
    frames = [se3.exp(rng.normal(size=6))]
    for _ in range(count - 1):
        step = np.array([2.0 / (count - 1), 0.0, 0.0, 0.2, 0.3, -0.2])
        frames.append(se3.retract(frames[-1], step))
    return np.array(frames)
