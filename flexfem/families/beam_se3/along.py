# SPDX-License-Identifier: LGPL-3.0-or-later
"""What varies along SE(3) beams, as the two-node element takes it: means over each cell.

The strain is constant in an element: its energy is that of the mean stiffness of its sections, and
of the mean initial strain. Parts on both sides of a jump deform one after the other, their
compliances are added: the strain jumps there as the section does. The inertia is a mean, so that
masses are exact. Means are Gauss quadratures between the ends of elements and the stations of
tables, between which tables are smooth. Deflections and frequencies converge with the square of the
size of the elements, as those of uniform beams do.
"""

import numpy as np

from flexfem._fields import owner_of
from flexfem._types import FloatArray
from flexfem.families.common.along import (
    Places,
    called_section,
    present_prestrains,
    prestrains,
    rest_curvatures,
    table_stiffness,
)
from flexfem.materials.section import Section
from flexfem.materials.section_table import SectionTable
from flexfem.model.bodies.basic import Beam

__all__ = ["cell_sections", "initial_strains", "present_strains", "rest_twists"]


def cell_sections(beam: Beam, arcs: FloatArray) -> list[Section]:
    """The mean section of each cell of a beam whose section varies.

    Args:
        beam: the beam.
        arcs: (m + 1,) arc lengths of its nodes, m.

    Raises:
        TypeError: a function of the section returns no Section.
        ValueError: it fails, or returns a section with a law of its own; or a table ends elsewhere.
    """
    owner, section, middle = owner_of(beam), beam.section, 0.5 * (arcs[1:] + arcs[:-1])
    if isinstance(section, SectionTable):
        unit = section.scale(owner, float(arcs[-1]))
        stiffness = table_stiffness(section, unit, arcs)
        places = Places.of(arcs, unit * section.stations)
        inertia = places.means(section.at(places.at / unit)[1])
        outlines = [section.outline_at(s / unit) for s in middle]
        whole: list[Section | None] = [None for _ in middle]
    else:
        assert callable(section)
        places = Places.of(arcs)
        found = [called_section(owner, section, s) for s in places.at.tolist()]
        stiffness = places.means(np.array([one.stiffness for one in found]))
        inertia = places.means(np.array([one.inertia for one in found]))
        centres = [called_section(owner, section, s) for s in middle.tolist()]
        outlines = [one.outline for one in centres]
        whole = [*centres]  # of cells with one section, which may be many
        for cell, one in zip(places.cell.tolist(), found, strict=True):
            if one is not centres[cell]:
                whole[cell] = None
    every = zip(whole, stiffness, inertia, outlines, strict=True)
    return [one or Section(*given) for one, *given in every]


def rest_twists(beam: Beam, arcs: FloatArray, twists: FloatArray) -> FloatArray:
    """Relative twists (m, 6) of the ends of the cells without stress, for constant prestrain.

    Args:
        beam: the beam.
        arcs: (m + 1,) arc lengths of its nodes, m.
        twists: (m, 6) those of the initial configuration.

    Raises:
        TypeError: a function along the beam does not return numbers.
        ValueError: it fails or returns something else.
    """
    if beam.rest_curvature is None and (beam.prestrain is None or beam.timed):
        return twists
    rest, places = twists.copy(), Places.of(arcs)
    lengths = np.linalg.norm(twists[:, :3], axis=1)
    if beam.rest_curvature is not None:
        bent = rest_curvatures(beam, places.at)
        rest[:, 3:] = lengths[:, np.newaxis] * places.means(bent)
        rest[:, :3] = lengths[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    if beam.prestrain is not None and not beam.timed:
        rest += lengths[:, np.newaxis] * initial_strains(beam, places, 0.0)
    return rest


def initial_strains(beam: Beam, places: Places, time: float) -> FloatArray:
    """Mean initial strains (m, 6) of cells at a time, s; raises as ``prestrains``."""
    return places.means(prestrains(beam, places.at, time))


def present_strains(beam: Beam, places: Places, time: float) -> FloatArray:
    """The same in a run, see ``present_prestrains``."""
    return places.means(present_prestrains(beam, places.at, time))
