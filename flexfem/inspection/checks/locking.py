# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smooth NURBS beams whose elements are too long for their thickness.

In smooth splines the stretch of a bent element cannot vanish at all its quadrature points: bending
stores stretching energy, ``(l/d)^2`` times as much as is due for elements of length l and depth d,
and times a power of the angle a by which an element turns. Computed cantilevers (arcs of 90 and 215
degrees, an elastica; slenderness 100 and 1000; 4 to 32 elements) are too stiff by ``c (l/d)^2 a^m``
within a factor of three, m and c by the degree.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from flexfem._types import FloatArray
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.inspection.mesh_facts import section_depth
from flexfem.lie import se3
from flexfem.materials.section import Section
from flexfem.mesh.nurbs_elements import NurbsElements, evaluate
from flexfem.model.bodies import Beam
from flexfem.system.nurbs_lines import NurbsLines

__all__ = ["find", "locked", "stiffened"]

#: Exponent m and factor c of degrees 2, 3, 4 and above.
_LAWS = {2: (4, 3e-2), 3: (4, 3e-3), 4: (6, 1e-3), 5: (8, 3e-4)}
#: Angle by which any beam may come to bend, rad.
_BENT = 0.5
#: Share that is too stiff to be said.
_STIFF = 5e-3


def find(inspection: Inspection) -> Iterator[Finding]:
    """At most one finding for each beam."""
    curves = inspection.serial.curves
    if curves is None:
        return
    for beam, share in stiffened(curves, se3.position(curves.frames), _BENT):
        parts = curves.parts[curves.index(beam.name)]
        yield Finding(
            "locking", owner_of(beam),
            f"smooth elements of degree {parts.nodes.shape[1] - 1} that are up to "
            f"{parts.lengths.max() / _thinnest(beam.section):.2g} times as long as thick lock: it "
            f"is too stiff, by about {100.0 * min(share, 1.0):.1g} % once it has bent by half a "
            "radian",
            "take its curve with_continuity(0), more elements or a higher degree",
        )  # fmt: skip


def stiffened(curves: NurbsLines, points: FloatArray, bent: float) -> Iterator[tuple[Beam, float]]:
    """Beams that lock, and by which share they are too stiff.

    Args:
        curves: of all beams.
        points: (c, 3) their control points, m.
        bent: angle by which each will bend beyond that, rad.
    """
    for index, beam in enumerate(curves.beams):
        own = points[curves.first_node[index] : curves.first_node[index + 1]]
        share = locked(curves.parts[index], own, _thinnest(beam.section), bent)
        if share > _STIFF:
            yield beam, share


def _thinnest(section: Section) -> float:
    """Depth of the section across the axis about which it bends most easily, m."""
    D = section.stiffness
    if D is None or D[0, 0] <= 0.0:
        return section_depth(section)
    return float(np.sqrt(12.0 * min(D[4, 4], D[5, 5]) / D[0, 0]))


def locked(parts: NurbsElements, points: FloatArray, depth: float, bent: float) -> float:
    """Share by which smooth elements are too stiff, mean over the energy; 0 without any.

    Args:
        parts: elements of one curve.
        points: (n, 3) its control points, m.
        depth: of the section, m.
        bent: angle by which the curve will bend beyond that, rad.
    """
    degree, count = parts.nodes.shape[1] - 1, len(parts.nodes)
    if degree < 2 or count < 2:
        return 0.0
    # neighbours share p + 1 - k control points at a knot of multiplicity k, one where it is C^0
    shared = np.array([np.isin(a, b).sum() for a, b in pairwise(parts.nodes)])
    smooth = np.append(False, shared > 1) | np.append(shared > 1, False)
    index = np.arange(count)
    ends = [evaluate(parts, points, index, np.full(count, x), 1)[1] for x in (0.0, 1.0)]
    a, b = (v / np.linalg.norm(v, axis=1)[:, np.newaxis] for v in ends)
    lengths = np.asarray(parts.lengths)
    turn = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
    turn += bent * lengths / lengths.sum()
    power, factor = _LAWS[min(degree, max(_LAWS))]
    shares = factor * (lengths / depth) ** 2 * turn**power * smooth
    energy = turn**2 / lengths
    return float((shares * energy).sum() / energy.sum()) if energy.any() else 0.0
