# SPDX-License-Identifier: LGPL-3.0-or-later
"""What users give along beams: sections, their twist and boundaries, and initial strains."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem._fields import owner_of
from flexfem._types import FloatArray, IntArray
from flexfem.families.common.given_values import present_values, values_at
from flexfem.materials.section import Section
from flexfem.materials.section_table import SectionTable
from flexfem.materials.section_wall import SectionWall
from flexfem.model.bodies.basic import Beam

__all__ = [
    "Places",
    "Walls",
    "called_section",
    "end_walls",
    "present_prestrains",
    "prestrains",
    "refuse_large_twists",
    "rest_curvatures",
    "table_stiffness",
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


def called_section(owner: str, section: Callable[[float], Section], s: float) -> Section:
    """Section that a function of the arc length returns.

    Raises:
        TypeError: it returns no Section.
        ValueError: it fails, or returns a section with a law of its own.
    """
    try:
        found = section(s)
    except FAILURES as error:
        raise ValueError(f"{owner}: section({s:g}): {located(section, error)}") from error
    if not isinstance(found, Section):
        _checks.instance(owner, f"section({s:g})", found, Section)
    if found.law is not None:
        raise ValueError(
            f"{owner}: a section that varies must be linear, section({s:g}) has a {found.law.owner}"
        )
    return found


def table_stiffness(section: SectionTable, unit: float, arcs: FloatArray) -> FloatArray:
    """Mean stiffness (m, 6, 6) between arc lengths (m + 1,); parts beside a jump are in series.

    Args:
        section: the table.
        unit: that of its stations, m.
        arcs: the arc lengths, m.
    """
    inside = np.clip(unit * section.jumps, arcs[0], arcs[-1])
    ends = np.union1d(arcs, inside)
    parts = Places.of(ends, unit * section.stations)
    return _in_series(arcs, ends, parts.means(section.at(parts.at / unit)[0]))


def end_walls(beam: Beam, arcs: FloatArray) -> list[Walls]:
    """Boundaries of the section at both ends of each cell, as pictures show them."""
    section = beam.section
    if isinstance(section, SectionTable):
        if section.outlines is None:
            return [((), ())] * (len(arcs) - 1)
        places = arcs / section.scale(owner_of(beam), float(arcs[-1]))
        return [
            tuple(_wall(section.outline_at(s, before=bool(i))) for i, s in enumerate(ends))
            for ends in pairwise(places.tolist())
        ]
    assert callable(section)
    walls = [called_section(owner_of(beam), section, s).walls for s in arcs.tolist()]
    return list(pairwise(walls))


def twists_at(beam: Beam, arcs: FloatArray, length: float) -> FloatArray:
    """Angles (n,) of the section axes about e1 at arc lengths (n,), rad.

    Args:
        beam: the beam.
        arcs: the arc lengths, m.
        length: that of the beam, m.

    Raises:
        TypeError: a function of the twist does not return numbers.
        ValueError: it fails or returns something else; or a table ends elsewhere than the beam.
    """
    owner, section = owner_of(beam), beam.section
    angles = np.zeros(len(arcs))
    if beam.twist is not None:
        angles += values_at(owner, "twist", beam.twist, (arcs,), ())
    if isinstance(section, SectionTable):
        places = arcs / section.scale(owner, length)
        if callable(section.twist):
            angles += values_at(owner, "twist of its section", section.twist, (places,), ())
        else:
            angles += section.twist_at(places)
    return angles


def refuse_large_twists(beam: Beam, angles: FloatArray) -> None:
    """Check the angles (m, k) of the section axes at the nodes of all elements, rad.

    Rotations relative to the node in the middle are unique up to half a turn.

    Raises:
        ValueError: an angle is not below that.
    """
    turns = np.abs(angles - angles[:, angles.shape[1] // 2, np.newaxis]).max(axis=1)
    if turns.max() >= np.pi:
        raise ValueError(
            f"{owner_of(beam)}: its twist turns by {turns.max():.3g} rad inside element "
            f"{int(np.argmax(turns))}, use more elements"
        )


def rest_curvatures(beam: Beam, at: FloatArray) -> FloatArray:
    """Twist and curvatures (k, 3) without stress at arc lengths (k,), 1/m; raises as the next."""
    return values_at(owner_of(beam), "rest_curvature", beam.rest_curvature, (at,), (3,))


def prestrains(beam: Beam, at: FloatArray, time: float) -> FloatArray:
    """Initial strains (k, 6) at arc lengths (k,) and a time, s.

    Raises:
        TypeError: the function does not return numbers.
        ValueError: it fails or returns something else.
    """
    return values_at(owner_of(beam), "prestrain", beam.prestrain, (at, time), (6,))


def present_prestrains(beam: Beam, at: FloatArray, time: float) -> FloatArray:
    """The same in a run; nan where the function fails, which is noted.

    Raises:
        FunctionError: it fails outside of a run.
    """
    return present_values(owner_of(beam), "prestrain", beam.prestrain, (at, time), (6,))


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
