# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the families of beams have in common, whatever their elements."""

from __future__ import annotations

from typing import ClassVar, Protocol, override

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.layout.family import Family
from flexfem.layout.numbered_model import NumberedModel
from flexfem.materials.section import Section
from flexfem.materials.section_wall import SectionWall
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model

__all__ = ["BeamFamily", "BeamNodes"]


class BeamNodes(Protocol):
    """Serial data of the nodes of all beams of a family."""

    @property
    def frames(self) -> FloatArray:
        """(n, 12) at the start."""

    @property
    def velocities(self) -> FloatArray:
        """(n, 6) local twists at the start."""

    @property
    def body_of_node(self) -> IntArray:
        """(n,) number of the beam in the model."""

    @property
    def sections(self) -> list[Section]:
        """The beams' different sections."""


class BeamFamily(Family):
    """Beams of one formulation; bodies count all beams of the model.

    Attributes:
        formulation: that of the beams in the model.
    """

    formulation: ClassVar[str]
    noun = "beam"
    series = "flexfem.io.paraview.family_series:BeamSeries"

    serial: NumberedModel

    @classmethod
    def members(cls, model: Model) -> list[Beam]:
        """Bodies of a model that belong to the family."""
        return model.beams_of(cls.formulation)

    def __init__(self, serial: NumberedModel, kind: int, nodes: BeamNodes) -> None:
        """Lay out the beams with these nodes."""
        super().__init__(serial, kind)
        self._nodes = nodes

    @property
    @override
    def bodies(self) -> list[Beam]:
        return self.serial.model.beams

    @property
    def sections(self) -> list[Section]:
        """The different sections of the beams, or of their elements."""
        return self._nodes.sections

    @property
    def walls(self) -> list[tuple[tuple[SectionWall, ...], ...]]:
        """Boundaries of these sections at both ends of their elements."""
        return [(section.walls, section.walls) for section in self.sections]

    @property
    @override
    def frames(self) -> FloatArray:
        return self._nodes.frames

    @property
    @override
    def velocities(self) -> FloatArray:
        return self._nodes.velocities

    @property
    @override
    def body_of_node(self) -> IntArray:
        return self._nodes.body_of_node

    @override
    def surface_numbers(self, body: Beam, radius: float) -> tuple[float, float]:
        section, diameter = self.section_of(body), 2.0 * radius
        stiffness = np.inf if section.stiffness is None else float(section.stiffness[0, 0])
        return stiffness / (0.25 * np.pi * diameter**3), section.mass_per_length / diameter

    def section_of(self, body: Beam) -> Section:
        """Section of a beam, that in its middle if it varies."""
        raise NotImplementedError
