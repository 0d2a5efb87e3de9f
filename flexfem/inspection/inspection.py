# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inspection of a model: serial data, rigid-body parts and joints, each computed on first use."""

from functools import cached_property
from typing import Self

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.analyses.relaxation import RelaxationOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.inspection.body_facts import BodyFacts, body_facts
from flexfem.inspection.joint_facts import JointFacts, joint_facts, turning_rows
from flexfem.kinematics.rigid_parts import RigidParts
from flexfem.kinematics.start_rows import StartRows
from flexfem.layout.mesh_facts import MeshFacts
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.model import Model
from flexfem.options import Settings

__all__ = ["Inspection"]


class Inspection:
    """Model data that summary and checks look at, the same on every rank.

    Attributes:
        model: the model, validated.
        serial: its serial data.
        options: those of the analysis that it is for, None where that is not known.
    """

    def __init__(self, model: Model, options: Settings | None = None) -> None:
        """Validate the model and place its joints.

        Raises:
            InputError: a mistake in the model (a ValueError).
            TypeError: it is no model, or these are no options.
        """
        _checks.instance("check", "model", model, Model)
        if options is not None:
            _checks.instance("check", "options", options, Settings)
        try:
            model.validate()
            self.serial: NumberedModel = NumberedModel(model)
            self.model, self.options = model, options
            self.rows  # noqa: B018 - joints that cannot be placed are mistakes in the model
        except ValueError as error:
            raise InputError(str(error)) from error

    @classmethod
    def of(cls, serial: NumberedModel, options: Settings) -> Self:
        """Look at a model that an analysis has validated and numbered already.

        Raises:
            ValueError: a joint cannot be placed.
        """
        inspection = cls.__new__(cls)
        inspection.model, inspection.serial, inspection.options = serial.model, serial, options
        return inspection

    @property
    def moves(self) -> bool | None:
        """True if inertia counts, as it does not for equilibria; None where that is not known."""
        if self.options is None:
            return None
        return not isinstance(self.options, (StaticOptions, RelaxationOptions))

    @cached_property
    def rows(self) -> StartRows:
        """Its joints at the start."""
        return StartRows(self.serial, self.parts)

    @cached_property
    def turning(self) -> BoolArray:
        """Rows (r,) of the joints that are about directions, not positions."""
        return turning_rows(self.rows)

    @cached_property
    def parts(self) -> RigidParts:
        """The rigid-body parts: bodies with common nodes are one."""
        return RigidParts(self.serial)

    @cached_property
    def bodies(self) -> list[BodyFacts]:
        """Facts of each body and point mass."""
        return body_facts(self.serial)

    @cached_property
    def joints(self) -> list[JointFacts]:
        """Facts of each joint."""
        return joint_facts(self.rows, self.model.joints)

    @cached_property
    def meshes(self) -> list[MeshFacts]:
        """Sizes of the elements of each flexible body."""
        serial = self.serial
        facts = [serial.family_of(body.name).mesh_facts(body) for body in serial.model.bodies]
        return [one for one in facts if one is not None]

    @cached_property
    def points(self) -> FloatArray:
        """Positions (n, 3) of all nodes, of rigid bodies and of the joints' markers, m."""
        places = [pose.position for poses in self.rows.poses for pose in poses]
        return np.concatenate([np.array(places).reshape(-1, 3), self.serial.points])

    @cached_property
    def extent(self) -> float:
        """Characteristic length: diagonal of the box about all points, m; 0 for a single point."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    @property
    def scale(self) -> float:
        """Length by which rotations are compared with displacements, m: the extent, or 1."""
        return self.extent or 1.0
