# SPDX-License-Identifier: LGPL-3.0-or-later
"""What varies along SE(3) beams, as the two-node element takes it: means over each cell.

The strain is constant in an element: its energy is that of the mean stiffness of its sections, and
of the mean initial strain. Parts on both sides of a jump deform one after the other, their
compliances are added: the strain jumps there as the section does. The inertia is a mean, so that
masses are exact. Means are Gauss quadratures between the ends of elements and the stations of
tables, between which tables are smooth. Deflections and frequencies converge with the square of the
size of the elements, as those of uniform beams do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem._types import FloatArray, IntArray
from flexfem.families.common.given_values import present_values, values_at
from flexfem.materials.section import Section
from flexfem.materials.section_table import SectionTable
from flexfem.materials.section_wall import SectionWall
from flexfem.model.bodies.basic import Beam

__all__ = [
    "Places",
    "Walls",
    "cell_sections",
    "end_walls",
    "initial_strains",
    "present_strains",
    "rest_twists",
    "twists_at",
]

#: Boundaries of a section at the first and at the second end of cells.
Walls = tuple[tuple[SectionWall, ...], ...]
#: Gauss points between two kinks.
_POINTS, _WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(4))


@dataclass(frozen=True)
class Places:
    """Quadrature points of cells that follow one another.

    Attributes:
        cell: (q,) number of the cell of each point; at: (q,) arc lengths, m.
        weight: (q,) their weights, whose sum over a cell is one.
        count: number of cells.
    """

    cell: IntArray
    at: FloatArray
    weight: FloatArray
    count: int

    @classmethod
    def of(cls, arcs: FloatArray, kinks: FloatArray | None = None) -> "Places":
        """Points between the arc lengths (m + 1,) of nodes, and kinks of what is evaluated."""
        ends = arcs if kinks is None else np.union1d(arcs, np.clip(kinks, arcs[0], arcs[-1]))
        sizes = np.diff(ends)
        middle = 0.5 * (ends[1:] + ends[:-1])
        piece = np.searchsorted(arcs, middle) - 1
        at = (middle[:, np.newaxis] + sizes[:, np.newaxis] * _POINTS).ravel()
        weight = (sizes / np.diff(arcs)[piece])[:, np.newaxis] * _WEIGHTS
        return cls(np.repeat(piece, len(_POINTS)), at, weight.ravel(), len(arcs) - 1)

    @classmethod
    def inside(cls, ends: FloatArray) -> "Places":
        """Points in cells anywhere, between the arc lengths (m, 2) of their ends."""
        first, size = ends[:, :1], ends[:, 1:] - ends[:, :1]
        at = first + size * (0.5 + _POINTS)
        cell = np.repeat(np.arange(len(ends)), len(_POINTS))
        return cls(cell, at.ravel(), np.tile(_WEIGHTS, len(ends)), len(ends))

    def means(self, values: FloatArray) -> FloatArray:
        """Means (m, ...) over the cells of values (q, ...) at the points; exact for equal ones."""
        weights = self.weight.reshape(-1, *(1 for _ in values.shape[1:]))
        total = values[np.searchsorted(self.cell, np.arange(self.count))]
        np.add.at(total, self.cell, weights * (values - total[self.cell]))
        return total


def cell_sections(beam: Beam, arcs: FloatArray) -> list[Section]:
    """The mean section of each cell of a beam whose section varies.

    Args:
        beam: the beam.
        arcs: (m + 1,) arc lengths of its nodes, m.

    Raises:
        TypeError: a function of the section returns no Section.
        ValueError: it fails, or returns a section with a law of its own; or a table ends elsewhere.
    """
    owner, section, middle = f'Beam "{beam.name}"', beam.section, 0.5 * (arcs[1:] + arcs[:-1])
    if isinstance(section, SectionTable):
        unit = section.scale(owner, float(arcs[-1]))
        ends = np.union1d(arcs, np.clip(unit * section.jumps, 0.0, arcs[-1]))
        parts = Places.of(ends, unit * section.stations)
        stiffness = _in_series(arcs, ends, parts.means(section.at(parts.at / unit)[0]))
        places = Places.of(arcs, unit * section.stations)
        inertia = places.means(section.at(places.at / unit)[1])
        outlines = [section.outline_at(s / unit) for s in middle]
    else:
        assert callable(section)
        places = Places.of(arcs)
        found = [_called(owner, section, s) for s in places.at.tolist()]
        stiffness = places.means(np.array([one.stiffness for one in found]))
        inertia = places.means(np.array([one.inertia for one in found]))
        outlines = [_called(owner, section, s).outline for s in middle.tolist()]
    return [Section(*given) for given in zip(stiffness, inertia, outlines, strict=True)]


def end_walls(beam: Beam, arcs: FloatArray) -> list[Walls]:
    """Boundaries of the section at both ends of each cell, as pictures show them."""
    section = beam.section
    if isinstance(section, SectionTable):
        if section.outlines is None:
            return [((), ())] * (len(arcs) - 1)
        places = arcs / section.scale(f'Beam "{beam.name}"', float(arcs[-1]))
        return [
            tuple(_wall(section.outline_at(s, before=bool(i))) for i, s in enumerate(ends))
            for ends in pairwise(places.tolist())
        ]
    assert callable(section)
    owner = f'Beam "{beam.name}"'
    walls = [_called(owner, section, s).walls for s in arcs.tolist()]
    return list(pairwise(walls))


def twists_at(beam: Beam, arcs: FloatArray) -> FloatArray:
    """Angles (n,) of the section axes about e1 at arc lengths (n,), rad.

    Raises:
        TypeError: a function of the twist does not return numbers.
        ValueError: it fails or returns something else; or a table ends elsewhere than the beam.
    """
    owner, section = f'Beam "{beam.name}"', beam.section
    angles = np.zeros(len(arcs))
    if beam.twist is not None:
        angles += values_at(owner, "twist", beam.twist, (arcs,), ())
    if isinstance(section, SectionTable):
        places = arcs / section.scale(owner, float(arcs[-1]))
        if callable(section.twist):
            angles += values_at(owner, "twist of its section", section.twist, (places,), ())
        else:
            angles += section.twist_at(places)
    return angles


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
    owner, rest, places = f'Beam "{beam.name}"', twists.copy(), Places.of(arcs)
    lengths = np.linalg.norm(twists[:, :3], axis=1)
    if beam.rest_curvature is not None:
        bent = values_at(owner, "rest_curvature", beam.rest_curvature, (places.at,), (3,))
        rest[:, 3:] = lengths[:, np.newaxis] * places.means(bent)
        rest[:, :3] = lengths[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    if beam.prestrain is not None and not beam.timed:
        rest += lengths[:, np.newaxis] * initial_strains(beam, places, 0.0)
    return rest


def initial_strains(beam: Beam, places: Places, time: float) -> FloatArray:
    """Mean initial strains (m, 6) of cells at a time, s.

    Raises:
        TypeError: the function does not return numbers.
        ValueError: it fails or returns something else.
    """
    owner = f'Beam "{beam.name}"'
    return places.means(values_at(owner, "prestrain", beam.prestrain, (places.at, time), (6,)))


def present_strains(beam: Beam, places: Places, time: float) -> FloatArray:
    """Mean initial strains (m, 6) of cells in a run; nan where the function fails, which is noted.

    Raises:
        FunctionError: it fails outside of a run.
    """
    owner, arguments = f'Beam "{beam.name}"', (places.at, time)
    return places.means(present_values(owner, "prestrain", beam.prestrain, arguments, (6,)))


def _called(owner: str, section: Callable[[float], Section], s: float) -> Section:
    """Section that a function of the arc length returns."""
    try:
        found = section(s)
    except FAILURES as error:
        raise ValueError(f"{owner}: section({s:g}): {located(section, error)}") from error
    _checks.instance(owner, f"section({s:g})", found, Section)
    if found.law is not None:
        raise ValueError(
            f"{owner}: a section that varies must be linear, section({s:g}) has a {found.law.owner}"
        )
    return found


def _in_series(arcs: FloatArray, ends: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Stiffness (m, 6, 6) of cells of some parts that deform one after the other.

    Args:
        arcs: (m + 1,) ends of the cells.
        ends: (p + 1,) ends of the parts, those of the cells among them.
        stiffness: (p, 6, 6) of the parts.
    """
    cell = np.searchsorted(arcs, 0.5 * (ends[1:] + ends[:-1])) - 1
    share = np.diff(ends) / np.diff(arcs)[cell]
    found = stiffness[np.searchsorted(cell, np.arange(len(arcs) - 1))]
    for i in np.flatnonzero(np.bincount(cell) > 1):
        parts, weights = stiffness[cell == i], share[cell == i]
        # newtons and newton metres squared comparable
        roots = np.sqrt(np.diag(parts[0]))
        scale = np.outer(roots, roots)
        mean = scale * np.linalg.inv(np.tensordot(weights, np.linalg.inv(parts / scale), 1))
        found[i] = 0.5 * (mean + mean.T)
    return found


def _wall(outline: FloatArray | None) -> tuple[SectionWall, ...]:
    return () if outline is None else (SectionWall(outline),)
