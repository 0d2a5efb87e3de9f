# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smooth NURBS beams whose elements are too long for their thickness.

In smooth splines the stretch of a bent element cannot vanish at all its quadrature points: bending
stores stretching energy, ``(l/d)^2`` times as much as is due for elements of length l and depth d,
and times a power of the angle a by which an element rotates. Computed cantilevers (arcs of 90 and
215 degrees, an elastica; slenderness 100 and 1000; 4 to 32 elements) are too stiff by
``c (l/d)^2 a^m`` within a factor of three, m and c by the degree.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.beam_nurbs.curves import NurbsLines
from flexfem.families.beam_nurbs.family import NurbsBeamFamily
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.layout.mesh_facts import section_depth
from flexfem.lie import se3
from flexfem.materials.section import Section
from flexfem.mesh.nurbs.elements import NurbsElements, evaluate
from flexfem.model.bodies.basic import Beam

__all__ = ["curve_excess", "excess", "find", "locked", "percent", "stiffened"]

#: Exponent m and factor c of degrees 2, 3, 4 and above.
_LAWS = {2: (4, 3e-2), 3: (4, 3e-3), 4: (6, 1e-3), 5: (8, 3e-4)}
#: Angle by which any beam may come to bend, rad.
_BENT = 0.5
#: Excess stiffness, relative, from which on it is reported.
_STIFF = 5e-3


def find(inspection: Inspection) -> Iterator[Finding]:
    """At most one finding for each beam."""
    family = inspection.serial.family(NurbsBeamFamily)
    if family is None:
        return
    curves = family.curves
    for beam, share in stiffened(curves, excess(curves, se3.position(curves.frames), _BENT)):
        index = curves.index(beam.name)
        parts = curves.parts[index]
        depth = _thinnest(curves.middle_section(index))
        yield Finding(
            "locking", owner_of(beam),
            f"smooth elements of degree {parts.nodes.shape[1] - 1} that are up to "
            f"{parts.lengths.max() / depth:.2g} times as long as thick lock: it "
            f"is too stiff, by about {percent(share)} % once it has bent by half a "
            "radian",
            "take its curve with_continuity(0), more elements or a higher degree",
        )  # fmt: skip


def stiffened(curves: NurbsLines, energies: FloatArray) -> Iterator[tuple[Beam, float]]:
    """Beams that lock, and by which share they are too stiff.

    Args:
        curves: of all beams.
        energies: (n, 2) of each, as :func:`excess` gives them.
    """
    for beam, own in zip(curves.beams, energies, strict=True):
        share = locked(own)
        if share > _STIFF:
            yield beam, share


def locked(energies: FloatArray) -> float:
    """Share by which smooth elements are too stiff, mean over the energy; 0 without any."""
    return float(energies[0] / energies[1]) if energies[1] > 0.0 else 0.0


def percent(share: float) -> str:
    """In per cent, with one significant digit: laws of locking are no more accurate."""
    return f"{float(f'{100.0 * min(share, 1.0):.1g}'):g}"


def _thinnest(section: Section) -> float:
    """Depth of the section across the axis about which it bends most easily, m."""
    D = section.stiffness
    if D is None or D[0, 0] <= 0.0:
        return section_depth(section)
    return float(np.sqrt(12.0 * min(D[4, 4], D[5, 5]) / D[0, 0]))


def excess(
    curves: NurbsLines, points: FloatArray, bent: float, cells: Sequence[IntArray] | None = None
) -> FloatArray:
    """Energies of each beam (n, 2): stretching that is too much, bending; in one scale for both.

    Args:
        curves: of all beams.
        points: (c, 3) their control points, m; others than those of the elements are ignored.
        bent: angle by which each will bend beyond that, rad.
        cells: elements of each beam, all without.
    """
    found = np.zeros((len(curves.beams), 2))
    for index, parts in enumerate(curves.parts):
        chosen = np.arange(len(parts.nodes)) if cells is None else cells[index]
        own = points[curves.first_node[index] : curves.first_node[index + 1]]
        found[index] = curve_excess(
            parts, own, _thinnest(curves.middle_section(index)), bent, chosen
        )
    return found


def curve_excess(
    parts: NurbsElements, points: FloatArray, depth: float, bent: float, index: IntArray
) -> FloatArray:
    """The same of one curve (2,).

    Args:
        parts: elements of the curve.
        points: (n, 3) its control points, m.
        depth: of the section, m.
        bent: angle by which the curve will bend beyond that, rad.
        index: the elements to be counted.
    """
    degree, count = parts.nodes.shape[1] - 1, len(parts.nodes)
    if degree < 2 or count < 2:
        return np.zeros(2)
    # neighbours share p + 1 - k control points at a knot of multiplicity k, one where it is C^0
    shared = np.array([np.isin(a, b).sum() for a, b in pairwise(parts.nodes)])
    smooth = (np.append(False, shared > 1) | np.append(shared > 1, False))[index]
    ends = [evaluate(parts, points, index, np.full(len(index), x), 1)[1] for x in (0.0, 1.0)]
    a, b = (v / np.linalg.norm(v, axis=1)[:, np.newaxis] for v in ends)
    lengths = np.asarray(parts.lengths)[index]
    turn = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    turn += bent * lengths / np.asarray(parts.lengths).sum()
    power, factor = _LAWS[min(degree, max(_LAWS))]
    shares = factor * (lengths / depth) ** 2 * turn**power * smooth
    energy = turn**2 / lengths
    return np.array([(shares * energy).sum(), energy.sum()])
