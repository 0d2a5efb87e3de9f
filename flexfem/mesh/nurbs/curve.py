# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS curves: geometry of isogeometric beams.

Notation of Piegl, Tiller, The NURBS Book (1997): degree p, knots t, control points x_I, weights
w_I, `x(u) = sum_I w_I N_I(u) x_I / sum_I w_I N_I(u)`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.nurbs import fit as nurbs_fit
from flexfem.mesh.nurbs import refine as nurbs_refine
from flexfem.mesh.nurbs import shapes as nurbs_shapes
from flexfem.mesh.nurbs.basis import greville, uniform_knots
from flexfem.mesh.nurbs.checks import (
    OWNER,
    check_degree,
    check_knots,
    check_order,
    check_speed,
    count,
)
from flexfem.mesh.nurbs.elements import NurbsElements, evaluate, make_elements


@dataclass(frozen=True, eq=False, init=False)
class NurbsCurve:
    """A rational B-spline curve in space; its control points are the nodes of a beam.

    `refine` and `insert` (h) and `elevate` (p) change the basis, never the curve. For
    k-refinement elevate first and cut afterwards: `line.elevate(2).refine(8)` is smooth at the
    new knots, `line.refine(8).elevate(2)` keeps the lower continuity of the coarse basis.

    Attributes:
        degree: Degree p, 1 to 7.
        knots: Knot vector, shape (n + p + 1,): p + 1 equal knots at both ends, inside none more
            than p times. At a knot of multiplicity k the basis is C^(p - k).
        points: Control points, shape (n, 3), metres.
        weights: Positive weights of the control points, shape (n,).
    """

    degree: int
    knots: FloatArray
    points: FloatArray
    weights: FloatArray

    def __init__(
        self,
        degree: int,
        knots: npt.ArrayLike,
        points: npt.ArrayLike,
        weights: npt.ArrayLike | None = None,
    ) -> None:
        """Check and store the attributes; weights are 1 if left out.

        Raises:
            TypeError: something does not consist of numbers.
            ValueError: shapes do not match, the knots are not clamped, decrease or are repeated
                too often inside, weights are not positive, or the derivative of the curve
                vanishes somewhere.
        """
        p = check_degree(degree)
        x = _checks.array(OWNER, "points", points, (-1, 3))
        t = check_knots(p, knots, len(x))
        ones = np.ones(len(x)) if weights is None else weights
        w = _checks.array(OWNER, "weights", ones, (-1,))
        if len(w) != len(x):
            raise ValueError(f"{OWNER}: weights must be {len(x)}, one per point, got {len(w)}")
        if w.min() <= 0.0:
            raise ValueError(f"{OWNER}: weights must be positive, got {_checks.show(w.tolist())}")
        check_speed(p, t, x, w)
        _checks.assign(self, degree=p, knots=t, points=x, weights=w)

    @classmethod
    def line(
        cls, start: npt.ArrayLike, end: npt.ArrayLike, *, degree: int = 3, elements: int = 1
    ) -> Self:
        """Return a straight line with uniform speed, cut into equal elements.

        Args:
            start: First point, metres.
            end: Last point, metres.
            degree: Degree p.
            elements: Number of elements.

        Raises:
            TypeError: an argument is not a number.
            ValueError: both points are the same, or a number is out of range.
        """
        knots = uniform_knots(check_degree(degree), count("elements", elements))
        a, b = _checks.vector(OWNER, "start", start), _checks.vector(OWNER, "end", end)
        along = greville(degree, knots)[:, None]
        return cls(degree, knots, (1.0 - along) * a + along * b)

    @classmethod
    def arc(
        cls,
        centre: npt.ArrayLike,
        start: npt.ArrayLike,
        axis: npt.ArrayLike,
        angle: float,
        *,
        degree: int = 2,
        elements: int | None = None,
    ) -> Self:
        """Return the exact arc on which `start` rotates about an axis.

        The arc consists of as few rational pieces of at most 120 degrees as divide `elements`;
        where they meet the basis is only C0 (the curve stays smooth), at all other knots
        C^(p - 1).

        Args:
            centre: Point of the axis, metres.
            start: First point, metres.
            axis: Direction of the axis.
            angle: Angle of the rotation, right-handed about the axis, radians; at most 2 pi,
                negative for the other direction.
            degree: Degree p, at least 2.
            elements: Number of elements; one per quarter turn if left out.

        Raises:
            TypeError: an argument is not a number.
            ValueError: the start lies on the axis, the angle is zero or too large, the degree is
                1, or the elements are too few (each turns by 120 degrees at most).
        """
        if check_degree(degree) < 2:
            raise ValueError(f"{OWNER}: an exact arc has degree 2 at least, got {degree}")
        number = nurbs_shapes.arc_elements(angle, elements)
        coarse = cls(2, *nurbs_shapes.arc(centre, start, axis, angle, number))
        return (coarse.elevate(degree - 2) if degree > 2 else coarse).refine(number)

    @classmethod
    def circle(
        cls, centre: npt.ArrayLike, start: npt.ArrayLike, axis: npt.ArrayLike, *, degree: int = 2,
        elements: int = 4,
    ) -> Self:  # fmt: skip
        """Return an exact full circle, as `arc`; its first and last control points coincide."""
        return cls.arc(centre, start, axis, 2.0 * np.pi, degree=degree, elements=elements)

    @classmethod
    def helix(
        cls,
        centre: npt.ArrayLike,
        start: npt.ArrayLike,
        axis: npt.ArrayLike,
        angle: float,
        pitch: float,
        *,
        degree: int = 3,
        elements: int | None = None,
        tolerance: float | None = None,
    ) -> Self:
        """Return a fitted helix: `start` rotates about an axis and moves along it.

        A helix is not rational: no NURBS curve is exact. The distance from the exact helix falls
        with the power p + 1 of the element length and is kept below the tolerance.

        Args:
            centre: Point of the axis, metres.
            start: First point, metres.
            axis: Direction of the axis.
            angle: Angle of the whole rotation, right-handed about the axis, radians; any size,
                negative for the other direction.
            pitch: Rise along the axis per full turn, metres; may be negative.
            degree: Degree p.
            elements: Number of elements; as many as the tolerance requires if left out.
            tolerance: Largest distance from the exact helix, metres; 1e-4 of the radius if left
                out together with the elements, not checked if only the elements are given.

        Raises:
            TypeError: an argument is not a number.
            ValueError: the start lies on the axis, the angle is zero, or the tolerance is not
                reached.
        """
        helix = nurbs_shapes.Helix.checked(centre, start, axis, angle, pitch)
        if elements is None and tolerance is None:
            tolerance = 1e-4 * helix.radius
        return cls.fit(helix, degree=degree, elements=elements, tolerance=tolerance)

    @classmethod
    def through(
        cls, points: npt.ArrayLike, *, degree: int = 3, corners: Sequence[int] | None = None
    ) -> Self:
        """Return the curve through points, one element for each segment.

        The parameter is the chord length from 0 to 1. Inside, the curve is C^(p - 1), and the free
        coefficients make the jumps of the p-th derivative as small as possible, so that
        polynomials of degree p, straight lines above all, are reproduced (straight lines with
        constant speed). At corners it is C0. Chord lengths differ from arc lengths, so that the
        error of a smooth curve falls with the power min(p + 1, 4) of the distance of the points.

        Args:
            points: The points in order, shape (n, 3), metres.
            degree: Degree p.
            corners: Indices of the points that are corners; if left out, those where the chords
                turn by more than `flexfem.mesh.geometry.frames.CORNER_ANGLE`.

        Raises:
            TypeError: the points do not consist of numbers.
            ValueError: there is one point only, neighbours coincide, or a corner is no inner point.
        """
        x = nurbs_fit.check_points(points)
        sharp = nurbs_fit.corner_points(x, corners)
        return cls(degree, *nurbs_fit.through(x, check_degree(degree), sharp))

    @classmethod
    def fit(
        cls,
        path: Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike,
        *,
        degree: int = 3,
        elements: int | None = None,
        tolerance: float | None = None,
    ) -> Self:
        """Return a curve of equal elements close to a function or to points.

        A function is interpolated at the Greville abscissae, points in order by least squares with
        both ends exact (parameter: chord length). For smooth functions the error falls with the
        power p + 1 of the element length; `deviation` returns it.

        Args:
            path: Function of u (n,) in [0, 1] that returns points (n, 3), metres; or points.
            degree: Degree p.
            elements: Number of elements; as many as the tolerance requires if left out.
            tolerance: Largest distance, metres; not checked if left out.

        Raises:
            TypeError: the path is neither a function nor numbers.
            ValueError: neither elements nor tolerance are given, the points are too few, or the
                tolerance is not reached.
        """
        return cls(
            degree, *nurbs_fit.fit(nurbs_fit.Path(path), check_degree(degree), elements, tolerance)
        )

    def insert(self, knots: npt.ArrayLike) -> Self:
        """Return the same curve with more knots (h-refinement).

        Args:
            knots: New knots between the ends, shape (k,); repeated ones lower the continuity.

        Raises:
            TypeError: the knots do not consist of numbers.
            ValueError: a knot is not inside, or would be repeated more than p times.
        """
        new = np.sort(_checks.array(OWNER, "inserted knots", knots, (-1,)))
        outside = (new <= self.knots[0]) | (new >= self.knots[-1])
        if outside.any():
            raise ValueError(
                f"{OWNER}: inserted knots must lie between {self.knots[0]:g} and "
                f"{self.knots[-1]:g}, got {float(new[outside][0]):g}"
            )
        knots = check_knots(
            self.degree, np.sort(np.append(self.knots, new)), len(self.points) + len(new)
        )
        return self._with_basis(self.degree, knots)

    def with_continuity(self, order: int) -> Self:
        """Return the same curve with a basis that is C^order at most between elements.

        Smooth elements lock while they are much longer than thick. With order 0 they do not, for
        more control points: a slender elastica on 8 cubics is 2e-1 off in C^2 and 2e-7 in C^0.

        Raises:
            TypeError, ValueError: the order is not a whole number between 0 and p - 1.
        """
        check_order(self.degree, order)
        return self.insert(nurbs_refine.missing_knots(self.degree, self.knots, order))

    def refine(self, elements: int) -> Self:
        """Return the same curve cut into more elements (h-refinement) by simple knots.

        If `elements` is a multiple of the present number, each element is cut into equal parts of
        its parameter; otherwise those with the longest parts get one more.

        Args:
            elements: New number of elements.

        Raises:
            TypeError: the number is no integer.
            ValueError: it is smaller than the present number.
        """
        wanted = count("elements", elements)
        spans = self.elements.spans
        if wanted < len(spans):
            raise ValueError(f"{OWNER}: elements must be {len(spans)} at least, got {elements}")
        new = nurbs_refine.cuts(spans, self.elements.lengths, wanted)
        return self.insert(new) if len(new) else self

    def elevate(self, times: int = 1) -> Self:
        """Return the same curve with a higher degree and the same continuity (p-refinement).

        Args:
            times: Increase of the degree.

        Raises:
            TypeError: the number is no integer.
            ValueError: it is not positive, or the degree becomes too large.
        """
        degree = check_degree(self.degree + count("times", times))
        breaks, multiplicity = np.unique(self.knots, return_counts=True)
        return self._with_basis(degree, np.repeat(breaks, multiplicity + times))

    def _with_basis(self, degree: int, knots: FloatArray) -> Self:
        """Return the same curve on a basis that contains the present one."""
        points, weights = nurbs_refine.represent(
            (self.degree, self.knots), self.points, self.weights, (degree, knots)
        )
        return type(self)(degree, knots, points, weights)

    @cached_property
    def elements(self) -> NurbsElements:
        """The elements; see `flexfem.mesh.nurbs.elements.make_elements`."""
        return make_elements(self.degree, self.knots, self.points, self.weights)

    @property
    def length(self) -> float:
        """Arc length, metres."""
        return float(self.elements.lengths.sum())

    def derivatives(self, u: npt.ArrayLike, order: int) -> FloatArray:
        """Return position and derivatives by the parameter.

        At a knot they are those of the element that begins there.

        Args:
            u: Parameters of any shape.
            order: Highest derivative.

        Returns:
            Shape (order + 1, ..., 3), metres.

        Raises:
            ValueError: a parameter lies outside the curve.
        """
        places = np.asarray(u, dtype=np.float64)
        index, xi = self.places(places.ravel())
        values = evaluate(self.elements, self.points, index, xi, order)
        size = np.diff(self.elements.spans[index])
        scaled: FloatArray = values / size ** np.arange(order + 1)[:, None, None]
        return scaled.reshape(order + 1, *places.shape, 3)

    def position(self, u: npt.ArrayLike) -> FloatArray:
        """Return the points at parameters of any shape, shape (..., 3), metres."""
        points: FloatArray = self.derivatives(u, 0)[0]
        return points

    def arc_length(self, u: npt.ArrayLike) -> FloatArray:
        """Return the arc lengths from the start at parameters of any shape, metres."""
        places = np.asarray(u, dtype=np.float64)
        index, xi = self.places(places.ravel())
        before = np.append(0.0, np.cumsum(self.elements.lengths))[index]
        powers = xi[:, None] ** np.arange(self.elements.arc.shape[1])
        along = before + np.einsum("nj,nj->n", powers, self.elements.arc[index])
        return np.reshape(along, places.shape)

    def parameter_at(self, fraction: npt.ArrayLike) -> FloatArray:
        """Return the parameters at fractions of the arc length, of any shape.

        Raises:
            ValueError: a fraction is not between 0 and 1.
        """
        wanted = np.asarray(fraction, dtype=np.float64)
        if not ((wanted >= 0.0) & (wanted <= 1.0)).all():
            raise ValueError(
                f"{OWNER}: fraction must be between 0 and 1, got {_checks.show(fraction)}"
            )
        return nurbs_refine.parameters(self.elements, wanted.ravel()).reshape(wanted.shape)

    def deviation(self, path: Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike) -> float:
        """Return the largest distance from the fitted points, metres.

        Args:
            path: Function or points as for `fit`, compared at the same parameters, which bounds
                the distance from above.
        """
        first, size = self.knots[0], self.knots[-1] - self.knots[0]
        return nurbs_fit.deviation(
            nurbs_fit.Path(path),
            (np.unique(self.knots) - first) / size,
            lambda u: self.position(first + size * u),
        )

    def places(self, u: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return elements and places xi in them of parameters (n,)."""
        spans = self.elements.spans
        first, last = spans[0, 0], spans[-1, 1]
        outside = ~((u >= first) & (u <= last))
        if outside.any():
            raise ValueError(
                f"{OWNER}: parameter must be between {first:g} and {last:g}, "
                f"got {float(u[outside][0]):g}"
            )
        index = np.searchsorted(spans[:, 0], u, side="right").astype(np.int64) - 1
        return index, (u - spans[index, 0]) / (spans[index, 1] - spans[index, 0])
