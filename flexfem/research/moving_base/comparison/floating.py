# SPDX-License-Identifier: LGPL-3.0-or-later
"""The same beam on the same base as a chain of bodies in floating frames.

Every segment of the beam is one or several bodies, rigidly joined, each reduced to the motion of
its ends and some modes, with geometric stiffening: within a body displacements are small relative
to the frame at its start, from body to body they add up. A body leaves out deformations beyond
second order in its own displacements: more bodies bend and twist further.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.marker import Marker
from flexfem.joints.rigid import Rigid
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.model import Model
from flexfem.model.probes.base import MarkerState, Probe
from flexfem.reduction.fem.beam import beam_body
from flexfem.reduction.fem.reduce import reduce_body
from flexfem.reduction.reduced_body import ReducedBody
from flexfem.research.moving_base.base import PrescribedBase
from flexfem.research.moving_base.comparison.exact import (
    TIP_COLUMNS,
    Segment,
    drive_root,
    segment_sections,
    tip_in_base,
)
from flexfem.research.moving_base.properties import BeamProperties

__all__ = ["floating_model"]


def floating_model(
    properties: BeamProperties, base: PrescribedBase, *, bodies: int = 2, modes: int = 4,
    elements: int = 24, warping: bool = True, stiffening: bool = True, name: str = "moving_base",
) -> Model:  # fmt: skip
    """Model of the beam as bodies in floating frames, its root moved as the base (collective).

    The probe ``tip`` has the columns u2, u3, theta1 and s of the assumed-modes theories; s is the
    stretch of the cubics that the ends of the bodies have in common with beams, so that it is the
    better the more bodies there are.

    Args:
        properties: the beam, each property a number or piecewise.
        base: its motion with ``position`` and ``rotation``.
        bodies: so many in each segment.
        modes: of each body, with its ends fixed.
        elements: about as many along the beam.
        warping: whether torsion constants include restrained warping.
        stiffening: whether forces and accelerations change the stiffness.
        name: of the model.

    Raises:
        ValueError: a property is a function, or the base has no position or rotation.
    """
    segments = segment_sections(properties, warping=warping)
    frame = base.frame(0.0)
    origin, axes = frame[:3], frame[3:].reshape(3, 3)
    model = Model(name)
    ends: list[Marker] = []
    lengths = []
    for k, segment in enumerate(segments):
        length = (segment.end - segment.start) / bodies
        cells = max(1, round(elements * length / properties.length))
        reduced = _reduced(segment, length, cells, modes, stiffening)
        for i in range(bodies):
            body = f"segment_{k + 1}_{i + 1}"
            place = origin + (segment.start + i * length) * axes[:, 0]
            model.add(
                FloatingBody(body, reduced, position=place, rotation=axes, stiffening=stiffening)
            )
            if ends:
                model.add(Rigid(f"{body}_root", ends[-1], Marker(body, "start", rotation=axes)))
            ends += [Marker(body, end, rotation=axes) for end in ("start", "end")]
            lengths.append(length)

    def observe(t: float, *states: MarkerState) -> Sequence[float]:
        return [*tip_in_base(base, t, states[-1]), _stretch(lengths, states)]

    root = Marker(ends[0].body, "start", rotation=np.eye(3))
    model.add(*drive_root(base, root))
    model.add(Probe("tip", ends, TIP_COLUMNS, observe, unwrap=("theta1",)))
    return model


def _reduced(
    segment: Segment, length: float, cells: int, modes: int, stiffening: bool
) -> ReducedBody:
    """A piece of a segment."""
    line = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], cells + 1)
    return reduce_body(
        beam_body(line, segment.section, orientation=(0.0, 1.0, 0.0)),
        {"start": line[0], "end": line[-1]},
        modes=modes,
        geometric_stiffness=stiffening,
    )


def _stretch(lengths: Sequence[float], states: Sequence[MarkerState]) -> float:
    """Sum over the bodies of the chord's part along the axis, and of its reduction by bending.

    A cubic that leaves its start straight and ends at w with slope q is shorter by
    ``(3/5) w^2/L - w q/10 + L q^2/15``.
    """
    total = 0.0
    for length, (a, b) in zip(lengths, list(pairwise(states))[::2], strict=True):
        x, y, z = a.rotation.T @ (b.position - a.position)
        turned: FloatArray = a.rotation.T @ b.rotation
        total += x - length
        for w, slope in ((y, turned[1, 0]), (z, turned[2, 0])):
            total += 0.6 * w**2 / length - 0.1 * w * slope + length * slope**2 / 15.0
    return float(total)
