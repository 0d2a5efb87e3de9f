# SPDX-License-Identifier: LGPL-3.0-or-later
"""The same beam on the same base as a multibody model of geometrically exact elements.

The model has no terms for centrifugal forces or stiffening: only the motion of the root is
prescribed. Elements have no warping freedom: beams with a warping constant get the torsion constant
that twists as much under an end torque (Vlasov, warping held at the segment's start).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Ground, Marker
from flexfem.joints.prescribed_rotation import PrescribedRotation
from flexfem.joints.prescribed_translation import PrescribedTranslation
from flexfem.joints.rigid import Rigid
from flexfem.materials.section import Section
from flexfem.mesh.line_mesh import LineMesh
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model
from flexfem.model.probes.base import MarkerState, Probe
from flexfem.research.moving_base.base import PrescribedBase
from flexfem.research.moving_base.effects import Effects
from flexfem.research.moving_base.fields import section_values
from flexfem.research.moving_base.properties import (
    BeamProperties,
    Piecewise,
    effective_torsion_constant,
)
from flexfem.research.moving_base.space import divide

__all__ = ["TIP_COLUMNS", "Segment", "drive_root", "exact_model", "segment_sections", "tip_in_base"]

#: Of the tip, in the axes of the base: displacements (m), twist (rad), stretch (m).
TIP_COLUMNS = ("u2", "u3", "theta1", "s")


@dataclass(frozen=True, eq=False)
class Segment:
    """A segment of uniform section.

    Attributes:
        start, end: along the beam, m.
        section: of the beam there.
    """

    start: float
    end: float
    section: Section


def segment_sections(properties: BeamProperties, *, warping: bool = True) -> list[Segment]:
    """Segments of a beam, in order.

    Args:
        properties: the beam, each property a number or piecewise.
        warping: whether torsion constants include restrained warping.

    Raises:
        ValueError: a property is a function.
    """
    for field in fields(properties)[1:]:
        value = getattr(properties, field.name)
        if callable(value) and not isinstance(value, Piecewise):
            raise ValueError(
                f"BeamProperties: {field.name} is a function, beam elements take numbers and "
                "Piecewise"
            )
    out = []
    breaks = properties.breaks
    for start, end in pairwise(breaks):
        x = np.array([0.5 * (start + end)])
        at = {name: float(value[0]) for name, value in properties.at(x).items()}
        if warping:
            torsion = effective_torsion_constant(
                at["torsion_constant"], at["warping_constant"], end - start,
                at["youngs_modulus"] / at["shear_modulus"],
            )  # fmt: skip
            stiff = replace(properties, torsion_constant=torsion)
        else:
            stiff = properties
        s = section_values(stiff, Effects(), x)
        inertia = _section_inertia(float(s.mass[0]), s.eccentricity[:, 0], s.rotary[:, 0])
        section = Section.general(s.stiffness[:, 0], inertia)
        out.append(Segment(float(start), float(end), section))
    return out


def _section_inertia(mass: float, centre: FloatArray, rotary: FloatArray) -> FloatArray:
    """Inertia (6, 6) about the axis from moments of inertia (3,) about the mass centre."""
    c = np.cross(centre, np.eye(3)).T  # its product with a vector is the vector product
    first = mass * c
    return np.block([[mass * np.eye(3), -first], [first, np.diag(rotary) - first @ c]])


def tip_in_base(base: PrescribedBase, t: float, tip: MarkerState) -> FloatArray:
    """Displacements u2, u3 (m) and twist theta1 (rad) of the tip relative to the base.

    The twist is that of the rotation's part about a1: the tip section rotates by theta1 about a1,
    then its axis is swung to where it points.
    """
    frame = base.frame(t)
    R = frame[3:].reshape(3, 3)
    u = R.T @ (tip.position - frame[:3])
    turned = R.T @ tip.rotation
    twist = 2.0 * np.arctan2(turned[2, 1] - turned[1, 2], 1.0 + np.trace(turned))
    return np.array([u[1], u[2], twist])


def _stretch(length: float, states: Sequence[MarkerState]) -> float:
    """Sum of the elements' extensions, strain gamma1 times length: arc length minus the first one.

    The relative motion of two nodes is the helix that the element follows.
    """
    from flexfem.lie import se3  # compiled code, which building a model does without

    x = np.array([state.position for state in states])
    R = np.array([state.rotation for state in states])
    steps = np.einsum("nba,nb->na", R[:-1], x[1:] - x[:-1])
    turns = np.swapaxes(R[:-1], 1, 2) @ R[1:]
    d = se3.log(np.concatenate([steps, turns.reshape(-1, 9)], axis=1))
    return float(d[:, 0].sum() - length)


def exact_model(
    properties: BeamProperties, base: PrescribedBase, *, elements: int = 24,
    warping: bool = True, name: str = "moving_base",
) -> Model:  # fmt: skip
    """Model of the beam with the motion of its root prescribed.

    The probe ``tip`` has the columns u2, u3, theta1 and s of the assumed-modes theories; s is the
    sum of the elements' extensions.

    Args:
        properties: the beam, each property a number or piecewise.
        base: its motion with ``position`` and ``rotation``.
        elements: about as many two-node SE(3) elements.
        warping: whether torsion constants include restrained warping.
        name: of the model.

    Raises:
        ValueError: a property is a function, or the base has no position or rotation.
    """
    segments = segment_sections(properties, warping=warping)
    edges = divide(properties.breaks, elements)
    frame = base.frame(0.0)
    origin, axes = frame[:3], frame[3:].reshape(3, 3)
    # segments have nodes of their own, rigidly joined
    parts = [edges[(edges >= one.start) & (edges <= one.end)] for one in segments]
    first = np.cumsum([0, *(len(part) for part in parts)])
    cells = [np.arange(a, b - 1) for a, b in pairwise(first)]
    at = np.cumsum([0, *(len(c) for c in cells)])
    names = [f"segment_{k + 1}" for k in range(len(parts))]
    groups = {name: np.arange(at[k], at[k + 1]) for k, name in enumerate(names)}
    starts = np.concatenate(cells)
    mesh = LineMesh(
        origin + np.concatenate(parts)[:, None] * axes[:, 0],
        np.stack([starts, starts + 1], axis=1), groups,
    )  # fmt: skip
    model = Model(name, mesh=mesh)
    nodes = []
    for k, (group, segment) in enumerate(zip(names, segments, strict=True)):
        model.add(Beam(group, segment.section, orientation=tuple(axes[:, 1])))
        count = len(cells[k])
        nodes += [Marker(group, float(i / count), rotation=axes) for i in range(count)]
        if k:
            model.add(Rigid(f"joint_{k}", Marker(names[k - 1], "end"), Marker(group, "start")))
    nodes.append(Marker(names[-1], "end", rotation=axes))

    def observe(t: float, *states: MarkerState) -> Sequence[float]:
        tip = tip_in_base(base, t, states[-1])
        return [*tip, _stretch(properties.length, states)]

    model.add(*drive_root(base, Marker("segment_1", "start", rotation=np.eye(3))))
    model.add(Probe("tip", nodes, TIP_COLUMNS, observe, unwrap=("theta1",)))
    return model


def drive_root(base: PrescribedBase, root: Marker) -> tuple[Joint, Joint]:
    """Joints that move a root as a base moves.

    Args:
        base: its motion with ``position`` and ``rotation``.
        root: marker with inertial axes at the start, where the base is then.

    Raises:
        ValueError: the base has no position or rotation.
    """
    if base.position is None or base.rotation is None:
        raise ValueError("PrescribedBase: a beam of finite elements needs position and rotation")
    frame = base.frame(0.0)
    origin, axes = frame[:3], frame[3:].reshape(3, 3)
    ground = Ground(tuple(origin))

    def moved(t: float) -> FloatArray:
        return base.frame(t)[:3] - origin

    def turned(t: float) -> FloatArray:
        # without compiled code, which building a model does without
        rotation = Rotation.from_matrix(base.frame(t)[3:].reshape(3, 3) @ axes.T)
        vector: FloatArray = rotation.as_rotvec()
        return vector

    return (
        PrescribedTranslation("base_translation", ground, root, moved),
        PrescribedRotation("base_rotation", ground, root, turned),
    )
