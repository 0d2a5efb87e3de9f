# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinematic assembly: a start at which all joints hold, from bodies that do not fit together."""

from collections.abc import Sequence

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.kinematics.mechanism import RigidMechanism
from flexfem.kinematics.moved_model import moved_model
from flexfem.kinematics.rigid_parts import RigidParts, part_numbers
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.model import Model

__all__ = ["assemble"]

_MEASURES = ("inertia", "distance")
#: Least moment of inertia of a part relative to the sum of its three.
_THIN = 1e-6


def assemble(
    model: Model, *, keep: Sequence[str] = (), also: Sequence[Joint] = (),
    measure: str = "inertia", tolerance: float = 1e-9,
) -> Model:  # fmt: skip
    """Move the bodies of a model so that its joints hold at the start.

    Gauss-Newton steps on the rigid rows of all joints that are not released, each the smallest
    motion that closes them to first order. Flexible bodies move rigidly, those with common nodes
    together. Data that a joint takes from the start (directions of axes in bodies, relative
    rotations, distances, the zero of a drive) are taken from the start as given, so that a revolute
    joint on two bodies turns its axis with them. Redundant joints may be among them.

    Args:
        model: the model, which stays as it is.
        keep: names of bodies that stay where they are.
        also: joints outside the model that must hold at the start as well, such as those that bring
            the output of a mechanism to its place.
        measure: "inertia": small is a motion of little kinetic energy; "distance": motions of all
            bodies count equally; a rotation counts by the path of a point one radius of gyration
            away.
        tolerance: largest gap that may be left, m or rad.

    Returns:
        A new model with bodies, markers, joints and meshes moved.

    Raises:
        InputError: a mistake in the model, a joint that slides along a line, or joints that cannot
            be closed: the one with the largest gap is named, with the gap left (a ValueError).
        TypeError: an argument has the wrong type.

    Source: P. E. Nikravesh, Computer-Aided Analysis of Mechanical Systems (1988), section 3.4;
    E. J. Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems (1989), section 4.3.
    """
    _checks.instance("assemble", "model", model, Model)
    if measure not in _MEASURES:
        raise InputError(f"assemble: measure must be one of {', '.join(_MEASURES)}, got {measure}")
    for joint in also:
        _checks.instance("assemble", "also", joint, Joint)
    _checks.number("assemble", "tolerance", tolerance, positive=True)
    try:
        model.validate()
        serial = NumberedModel(model)
        parts = RigidParts(serial)
        mechanism = RigidMechanism(serial, parts, [*serial.body_joints, *also])
        moving = np.ones(len(parts), dtype=np.bool_)
        moving[part_numbers(parts, keep, "assemble: keep")] = False
    except ValueError as error:
        raise InputError(str(error)) from error
    mechanism.close(0.0, mechanism.rows.rigid, _weights(parts, measure), moving, iterations=200)
    _check_closed(mechanism, tolerance, "cannot be closed")
    motions = se3.compose(mechanism.frames, se3.inverse(parts.frames))
    poses = [Pose(se3.position(motion), se3.rotation(motion)) for motion in motions]
    moved = moved_model(model, {name: poses[i] for name, i in parts.number.items()})
    _check_start(moved, tolerance)
    return moved


def _weights(parts: RigidParts, measure: str) -> FloatArray:
    """Block-diagonal matrix (6 n, 6 n) that measures motions of the parts."""
    blocks = parts.inertia.copy()
    masses = np.trace(blocks[:, :3, :3], axis1=1, axis2=2) / 3.0
    if measure == "distance":
        blocks /= masses[:, np.newaxis, np.newaxis]
    # thin bodies have no inertia about their own line
    moments = np.trace(blocks[:, 3:, 3:], axis1=1, axis2=2)
    blocks[:, 3:, 3:] += _THIN * moments[:, np.newaxis, np.newaxis] * np.eye(3)
    full = np.zeros((6 * len(parts), 6 * len(parts)))
    for i, block in enumerate(blocks):
        full[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = block
    return full


def _check_closed(mechanism: RigidMechanism, tolerance: float, what: str) -> None:
    """Raise for the joint with the largest gap above the tolerance.

    Raises:
        InputError: names it, with its gap.
    """
    rows = mechanism.rows
    gaps = np.where(rows.rigid, np.abs(rows.values), 0.0)
    worst = int(np.argmax(gaps)) if len(gaps) else 0
    if len(gaps) and not gaps[worst] <= tolerance:
        joint = mechanism.joints[int(rows.joint_of_row[worst])]
        raise InputError(
            f"{joint.owner}: it {what}, a gap of {gaps[worst]:.6g} remains; place the bodies "
            "closer to a position in which joints hold, or check lengths and axes"
        )


def _check_start(model: Model, tolerance: float) -> None:
    """Raise for joints that do not hold where the model starts now.

    Raises:
        InputError: a drive contradicts the start at t = 0, for example.
    """
    serial = NumberedModel(model)
    parts = RigidParts(serial)
    mechanism = RigidMechanism(serial, parts, serial.body_joints)
    _check_closed(mechanism, 10.0 * tolerance, "does not hold at t = 0 in the assembled position")
