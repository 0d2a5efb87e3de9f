# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sizes and stiffnesses of the elements of a flexible body, as checks of a model need them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.materials.section import Section

__all__ = ["MeshFacts", "beam_facts", "section_depth"]


@dataclass(frozen=True)
class MeshFacts:
    """A flexible body in numbers.

    Attributes:
        body: a beam, a shell or a body of another family.
        lengths: (m,) lengths of a beam's elements, or the shortest edge of each triangle, m.
        longest: (m,) the same of beams; the longest edge of each triangle, m.
        length: length of a beam, m; root of the area of a shell.
        area: of a shell, m^2; 0 for beams.
        depth: of the section or the shell, m; NaN where unknown.
        centroids: (m, 3) of the elements, m.
        axial: stiffness of the softest element against stretching, N/m: EA/l, of shells E h.
        section: of the beam or shell; of a beam whose section varies that in its middle.
    """

    body: Any
    lengths: FloatArray
    longest: FloatArray
    length: float
    area: float
    depth: float
    centroids: FloatArray
    axial: float
    section: Any

    @property
    def slenderness(self) -> float:
        """Length by depth; NaN where the depth is not known."""
        return self.length / self.depth


def beam_facts(
    body: Any, section: Section, lengths: FloatArray, centroids: FloatArray
) -> MeshFacts:
    """Facts of a beam from the lengths (m,) and centroids (m, 3) of its elements."""
    D = section.stiffness
    axial = np.nan if D is None else float(D[0, 0] / lengths.max())
    return MeshFacts(
        body, lengths, lengths, float(lengths.sum()), 0.0, section_depth(section), centroids, axial,
        section,
    )  # fmt: skip


def section_depth(section: Section) -> float:
    """Largest distance of two points of a section, m; NaN where unknown.

    Without an outline that of the rectangle with the same radius of gyration.
    """
    if section.outline is not None:
        return float(np.ptp(section.outline, axis=0).max())
    if section.stiffness is not None:
        D = section.stiffness
        return float(np.sqrt(12.0 * max(D[4, 4], D[5, 5]) / D[0, 0]))
    mass = section.mass_per_length
    J = np.diag(section.inertia)[4:]
    return float(np.sqrt(12.0 * J.max() / mass)) if mass > 0.0 and J.max() > 0.0 else np.nan
