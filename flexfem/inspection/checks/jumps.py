# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of sections that jump where the elements of a NURBS beam are smooth.

The strain jumps with the section, and smooth shape functions have no jump: deflections converge
with the first order of the size of the elements there. Of degree 1 all elements may have a strain
of their own, and within them parts on both sides deform one after the other.
"""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.beam_nurbs.along import CurveSection
from flexfem.families.beam_nurbs.family import NurbsBeamFamily
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.materials.section_table import SectionTable
from flexfem.mesh.nurbs.curve import NurbsCurve

#: Change of a diagonal entry of the stiffness at a jump, relative, from which on it is reported.
_JUMP = 0.02
#: Distance of a knot from a jump, relative to the length, that counts as none.
_THERE = 1e-6


def find(inspection: Inspection) -> Iterator[Finding]:
    """At most one finding for each beam, about its first jump."""
    family = inspection.serial.family(NurbsBeamFamily)
    if family is None:
        return
    for along in family.curves.along:
        curve = inspection.serial.model.curve(along.beam)
        places = _smooth_jumps(along, curve)
        if len(places):
            more = f" and {len(places) - 1} more" if len(places) > 1 else ""
            yield Finding(
                "jumps", owner_of(along.beam),
                f"its section jumps at s = {places[0]:.4g} m{more}, where its elements are smooth: "
                "deflections converge with the first order of their size only",
                f"repeat a knot of its curve {curve.degree} times there (NurbsCurve.insert)",
            )  # fmt: skip


def _smooth_jumps(along: CurveSection, curve: NurbsCurve) -> FloatArray:
    """Arc lengths, m, of jumps of a table where no knot is repeated as often as the degree."""
    table = along.beam.section
    if not isinstance(table, SectionTable) or curve.degree == 1:
        return np.empty(0)
    first = np.flatnonzero(np.diff(table.stations) == 0.0)
    before, after = (np.diagonal(table.stiffness[i], axis1=1, axis2=2) for i in (first, first + 1))
    places = along.unit * table.stations[first][(np.abs(after / before - 1.0) > _JUMP).any(axis=1)]
    arcs = curve.arc_length(curve.knots)
    at = np.abs(arcs - places[:, np.newaxis]) < _THERE * along.length
    smooth: FloatArray = places[at.sum(axis=1) < curve.degree]
    return smooth
