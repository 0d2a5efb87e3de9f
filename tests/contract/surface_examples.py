# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with markers on triangles and edges of shells."""

from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.constraints.batch import Constraints
from flexfem.constraints.lines.data import ON_LINE
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.layout.lines import Rail, RailPoint
from flexfem.layout.surface_places import SurfacePlace, carrier_frame
from flexfem.lie import se3, so3
from tests.contract.joint_examples import UNIT, Placed, interface

CORNERS = np.array([[0.1, 0.2, -0.3], [1.4, 0.5, 0.1], [0.3, 1.2, 0.6]])
OTHERS = np.array([[0.1, 0.2, -0.3], [-0.6, 1.1, 0.2], [-0.8, -0.4, 0.9]])


@dataclass(frozen=True)
class SurfaceExample:
    """A joint whose first marker is on a surface, and its second there or on a node of its own.

    Attributes:
        cls: its class.
        rows: number of its constraints.
        arguments: all but name and markers.
        gap: vector from marker a to marker b at the start.
        axes: the markers have the axes of triangles.
    """

    cls: type[Joint]
    rows: int
    arguments: dict[str, Any] = field(default_factory=dict)
    gap: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: bool = True


EXAMPLES = {
    "Spherical": SurfaceExample(ff.Spherical, 3, axes=False),
    "Distance": SurfaceExample(ff.Distance, 1, gap=(0.4, 1.1, -0.7), axes=False),
    "Revolute": SurfaceExample(ff.Revolute, 5, {"axis": UNIT}),
    "Rigid": SurfaceExample(ff.Rigid, 6),
    "PrescribedAngle": SurfaceExample(ff.PrescribedAngle, 1, {"axis": UNIT}),
    "PointOnLine": SurfaceExample(ff.PointOnLine, 2, {"axis": UNIT}),
}


class PlacedOnSurface(Placed):
    """One joint between a surface and a node of its own, or another surface."""

    def __init__(self, example: SurfaceExample, both: bool, rng: np.random.Generator) -> None:
        weights = (1.0, 0.0, 0.0) if example.axes else (0.3, 0.7)
        k = len(weights)
        x = np.array(weights) @ CORNERS[:k]
        other = OTHERS[:k] - np.array(weights) @ OTHERS[:k] + x + example.gap
        positions = np.concatenate([CORNERS[:k], other if both else x[np.newaxis] + 0.2])
        self.start = se3.frame(positions, so3.exp(rng.normal(size=(len(positions), 3))))
        self.count = len(self.start)
        self.face = interface(self.start, width=3)
        poses = [Pose(p, so3.exp(rng.normal(size=3))) for p in (x, x + example.gap)]
        points, offsets = [], []
        for first, pose in zip((0, k), poses, strict=True):
            frame = se3.frame(pose.position, pose.rotation)
            if first and not both:
                points.append(None)
                offsets.append(se3.compose(se3.inverse(self.start[-1]), frame))
                continue
            nodes = tuple(range(first, first + k))
            point = SurfacePlace(0, nodes, weights).carrier(example.axes)
            points.append(RailPoint(Rail(point.line, point.line.nodes), 0, 0.0))
            offsets.append(se3.compose(se3.inverse(carrier_frame(point, positions)), frame))
        slots = (ON_LINE, ON_LINE if both else self.count - 1)
        joint = example.cls("joint", ff.Ground(), ff.Ground(), **example.arguments)
        placed = PlacedJoint(
            joint, 0, tuple(poses), slots, np.array(offsets), tuple(points), owned=True,
            shared=False,
        )  # fmt: skip
        self.rows = Constraints(MPI.COMM_SELF, [placed], self.face)

    def disturb(self, rng: np.random.Generator) -> None:
        super().disturb(rng)
        n = self.count
        self.face.frames[:] = se3.retract(self.start, 0.1 * rng.normal(size=(n, 6)))
