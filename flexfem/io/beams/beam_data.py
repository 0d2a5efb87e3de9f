# SPDX-License-Identifier: LGPL-3.0-or-later
"""A beam as a file describes it: a curved axis with sections, twist and damping along it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from flexfem import _checks
from flexfem._memory import LINE_NODE, check_run
from flexfem._types import FloatArray
from flexfem.materials.section_table import SectionTable
from flexfem.mesh.line_mesh import LineMesh
from flexfem.model.bodies.basic import Beam

__all__ = ["BeamData", "arc_fractions", "axis_spline"]

#: Points and weights of Gauss for arc lengths between two key points.
_POINTS, _WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(6))


def axis_spline(points: FloatArray) -> CubicSpline:
    """Cubic spline through points (k, 3), with the chord length as its parameter, m.

    Raises:
        ValueError: There are fewer than two, or neighbours at one place, to the digits of all.
    """
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.append(0.0, np.cumsum(chords))
    if len(points) < 2 or not (np.diff(at) > 0.0).all():
        raise ValueError("points of the axis must be at least two, neighbours at different places")
    return CubicSpline(at, points)


def arc_fractions(points: FloatArray) -> FloatArray:
    """Arc length (k,) of the spline at the points it goes through, relative to its end.

    Raises:
        ValueError: As for :func:`axis_spline`.
    """
    arcs = _arcs(axis_spline(points))
    fractions: FloatArray = arcs / arcs[-1]
    return fractions


def _arcs(spline: CubicSpline) -> FloatArray:
    """Arc lengths at the key points of a spline, m."""
    ends = spline.x
    half = np.diff(ends)[:, np.newaxis]
    at = 0.5 * (ends[1:] + ends[:-1])[:, np.newaxis] + half * _POINTS
    speed = np.linalg.norm(spline(at, 1), axis=-1)
    return np.append(0.0, np.cumsum((half * speed) @ _WEIGHTS))


@dataclass(frozen=True, eq=False)
class BeamData:
    """A beam as a file describes it.

    Axes are those of the file. Section axes are e1 along the axis, e2 normal to it and to `across`,
    and e3 towards `across`, rotated about e1 by the twist of the sections.

    Attributes:
        points: Key points of the axis, shape (k, 3), metres; a cubic spline goes through them.
        sections: Stiffness, inertia and twist at fractions of the length.
        damping: Stiffness-proportional damping of each strain, shape (6,), seconds, as
            :class:`Beam` takes it.
        across: Direction of e3 without twist, shape (3,).
    """

    points: FloatArray
    sections: SectionTable
    damping: FloatArray
    across: FloatArray

    @property
    def _spline(self) -> CubicSpline:
        return axis_spline(self.points)

    @property
    def length(self) -> float:
        """Arc length of the axis, metres."""
        return float(_arcs(self._spline)[-1])

    def _parameters(self, fractions: FloatArray) -> FloatArray:
        """Parameters (n,) of the spline at fractions of its arc length."""
        spline = self._spline
        arcs = _arcs(spline)
        wanted = fractions * arcs[-1]
        found = np.interp(wanted, arcs, spline.x)
        for _ in range(4):  # Newton's iteration from a chord that is off by its square
            i = np.clip(np.searchsorted(spline.x, found, "right") - 1, 0, len(arcs) - 2)
            start = spline.x[i]
            half = (found - start)[:, np.newaxis]
            at = 0.5 * (found + start)[:, np.newaxis] + half * _POINTS
            reached = arcs[i] + (half * np.linalg.norm(spline(at, 1), axis=-1)) @ _WEIGHTS
            found = found - (reached - wanted) / np.linalg.norm(spline(found, 1), axis=-1)
            found = np.clip(found, spline.x[0], spline.x[-1])
        parameters: FloatArray = found
        return parameters

    def mesh(self, name: str, elements: int) -> LineMesh:
        """Mesh of a line group along the axis, elements of equal arc length.

        Raises:
            TypeError: `elements` is no whole number, or the name no string.
            ValueError: There is no element, or the name is unusable.
        """
        _checks.instance("BeamData", "elements", elements, int)
        if elements < 1:
            raise ValueError(f"BeamData: elements must be at least 1, got {elements}")
        check_run(f"BeamData: a step with {elements} elements", elements, LINE_NODE)
        nodes = self._spline(self._parameters(np.linspace(0.0, 1.0, elements + 1)))
        cells = np.arange(elements)[:, np.newaxis] + np.arange(2)
        ends = {f"{name}_start": 0, f"{name}_end": elements}
        return LineMesh(nodes, cells, {name: np.arange(elements)}, ends)

    def orientation(self, points: FloatArray) -> FloatArray:
        """Directions (n, 3) of e2 without twist at points (n, 3) near the axis."""
        spline = self._spline
        fine = np.linspace(spline.x[0], spline.x[-1], 20 * len(self.points))
        on_axis = spline(fine)
        nearest = [int(np.argmin(np.sum((on_axis - x) ** 2, axis=1))) for x in points]
        return np.cross(self.across, spline(fine[nearest], 1))

    def beam(self, name: str, **given: Any) -> Beam:
        """Beam along the group of this name, see :meth:`mesh`.

        Args:
            name: Unique name in the model.
            **given: Further arguments of :class:`Beam`, or others in place of `section`,
                `orientation` and `damping`.
        """
        own: dict[str, Any] = {
            "section": self.sections, "orientation": self.orientation, "damping": self.damping,
        }  # fmt: skip
        return Beam(name, **(own | given))
