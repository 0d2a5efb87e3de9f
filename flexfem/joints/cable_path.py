# SPDX-License-Identifier: LGPL-3.0-or-later
"""Path of a cable over its guides: parts under one tension, straight parts, those around."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import unit
from flexfem.core.pose import Pose
from flexfem.core.row import RowKind, Term
from flexfem.joints.cable_guides import Guide, Sheave, grips

__all__ = ["Around", "Course", "Part", "Path", "course", "path_at_start"]

#: Angle (rad) by which a cable may leave the plane of a sheave at the start.
_FLEET = np.pi / 4.0
#: Points around a sheave in pictures.
_ARC = 49
#: Newton steps for a straight part, and its change relative to all lengths at convergence.
_STEPS, _SMALL = 50, 1e-14


@dataclass(frozen=True)
class Around:
    """The part of a cable around a sheave between two straight parts.

    Attributes:
        guide: number of the sheave in the path.
        angle: at the start, rad.
        touches: where its two ends are: numbers of the part under one tension, and of the term
            there.
    """

    guide: int
    angle: float
    touches: tuple[tuple[int, int], tuple[int, int]]

    @property
    def lowest(self) -> float:
        """Lowest angle, rad, of a range of a full turn that has that at the start well inside.

        Where a cable may leave the sheave it is negative.
        """
        turns, part = divmod(self.angle, 2.0 * np.pi)
        return 2.0 * np.pi * turns - (0.5 * np.pi if part < 1.25 * np.pi else 0.0)


@dataclass(frozen=True)
class Part:
    """Part of a cable under one tension, between two places where it does not slide.

    Attributes:
        guides: numbers of the guides at its ends and between, in order.
        spans: terms of its straight parts, each the length and touching angles at its ends, whose
            sum changes as the length, m.
        lengths: of its straight parts at the start, m, to which this sum is equal then.
        length: length at the start, m.
        bends: angles (rad) between the straight parts before and after inner guides.
    """

    guides: tuple[int, ...]
    spans: tuple[tuple[Term, ...], ...]
    lengths: tuple[float, ...]
    length: float
    bends: tuple[float, ...]

    def start_of(self, count: int | None = None) -> float:
        """Sum of the terms of all straight parts, or of so many from the start, at the start, m."""
        return sum(self.lengths[:count])

    def terms(self, count: int | None = None) -> tuple[Term, ...]:
        """Those of all straight parts, or of so many from the start."""
        return tuple(term for span in self.spans[:count] for term in span)


@dataclass(frozen=True)
class Path:
    """A cable at the start.

    Attributes:
        parts: its parts under one tension each.
        wraps: its parts around sheaves.
    """

    parts: tuple[Part, ...]
    wraps: tuple[Around, ...]

    @property
    def length(self) -> float:
        """Length that is not wound on drums, m."""
        return sum(part.length for part in self.parts)


@dataclass(frozen=True)
class Course:
    """Points along a cable, as many at all times.

    Attributes:
        points: (n, 3) m, inertial axes.
        spans: (n - 1,) number of the straight part of each line between neighbours, or of that
            after it around a sheave.
    """

    points: FloatArray
    spans: IntArray


def course(
    owner: str, path: Sequence[Guide], closed: bool, starts: Sequence[Pose],
    poses: Sequence[Pose], angles: Mapping[int, float],
) -> Course:  # fmt: skip
    """Points along a cable, for pictures.

    Args:
        owner: the cable in messages.
        path: its guides.
        closed: True for a belt.
        starts: poses of its markers at the start.
        poses: present ones.
        angles: present angles (rad) around sheaves, by their numbers.

    Raises:
        ValueError: there is no straight part between two guides.
    """
    turned = [
        replace(guide, axis=now.rotation @ then.rotation.T @ guide.axis)
        if isinstance(guide, Sheave)
        else guide
        for guide, then, now in zip(path, starts, poses, strict=True)
    ]
    points, numbers = [], []
    for n, pair in enumerate(neighbours(len(path), closed)):
        span, (i, j) = _Span.between(owner, turned, poses, pair), pair
        ends = [poses[k].position + _size(turned[k]) * span.arms[s] for s, k in ((0, i), (1, j))]
        points += ends
        numbers += [n, n]  # the first of them ends the part before
        if j in angles:
            inner = np.linspace(0.0, 1.0, _ARC)[1:-1, np.newaxis] * angles[j]
            arm, axis = ends[1] - poses[j].position, unit(_axis(turned[j]))
            around = np.cos(inner) * arm + np.sin(inner) * np.cross(axis, arm)
            points += list(poses[j].position + around)
            numbers += [n + 1] * len(around)
    if closed:
        points.append(points[0])
        numbers.append(0)
    return Course(np.array(points), np.array(numbers[1:], dtype=np.int64))


def neighbours(count: int, closed: bool) -> list[tuple[int, int]]:
    """Guides at the ends of the straight parts of a cable of so many guides."""
    return [(i, (i + 1) % count) for i in range(count if closed else count - 1)]


@lru_cache(maxsize=1024)
def path_at_start(
    owner: str, path: tuple[Guide, ...], poses: tuple[Pose, ...], closed: bool
) -> Path:
    """A cable at the start; a drive asks for it at every step.

    Raises:
        ValueError: neighbours coincide, their sheaves overlap or are not in the plane of the
            cable, or the cable does not touch one.
    """
    ends = neighbours(len(path), closed)
    spans = [_Span.between(owner, path, poses, pair) for pair in ends]
    for span in spans:
        for k, axis in zip(span.pair, span.axes, strict=True):
            _check_fleet(f"{owner}: path[{k}]", span.vector, axis)
    breaks = [k for k, (i, _) in enumerate(ends) if grips(path[i])] or [0]
    first = breaks[0]
    spans = spans[first:] + spans[:first]
    limits = pairwise([*(k - first for k in breaks), len(spans)])
    groups = [spans[i:j] for i, j in limits]
    wraps = _wraps(owner, path, groups)
    parts = []
    for n, group in enumerate(groups):
        lengths = tuple(span.length for span in group)
        around = sum(
            _size(path[wrap.guide]) * wrap.angle
            for wrap in wraps
            if wrap.touches[0][0] == n and not grips(path[wrap.guide])
        )
        numbers = (group[0].pair[0], *(span.pair[1] for span in group))
        terms = tuple(span.terms for span in group)
        bends = tuple(_bend(one.vector, two.vector) for one, two in pairwise(group))
        parts.append(Part(numbers, terms, lengths, sum(lengths) + around, bends))
    return Path(tuple(parts), wraps)


@dataclass(frozen=True)
class _Span:
    """A straight part between two guides.

    Attributes:
        pair: their numbers.
        poses: of their markers.
        axes: their axes times their radii (m) in inertial axes, zero for points.
        vector: the straight part, m.
        arms: unit vectors from their centres to where it touches them.
    """

    pair: tuple[int, int]
    poses: tuple[Pose, Pose]
    axes: tuple[FloatArray, FloatArray]
    vector: FloatArray
    arms: tuple[FloatArray, FloatArray]

    @classmethod
    def between(
        cls, owner: str, path: Sequence[Guide], poses: Sequence[Pose], pair: tuple[int, int]
    ) -> _Span:
        """The straight part between two guides.

        Raises:
            ValueError: there is none.
        """
        i, j = pair
        ends = poses[i], poses[j]
        gap, axes = ends[1].position - ends[0].position, (_axis(path[i]), _axis(path[j]))
        apart = float(np.linalg.norm(gap))
        if apart == 0.0:
            raise ValueError(f"{owner}: path[{i}] and path[{j}] coincide at the start")
        found = _straight(gap, *axes)
        if found is None:
            radii = " and ".join(f"{np.linalg.norm(axis):.6g}" for axis in axes)
            raise ValueError(
                f"{owner}: no straight part touches path[{i}] and path[{j}], which are {apart:.6g} "
                f"m apart at the start, with radii of {radii} m"
            )
        arms = _touch(found, axes[0])[0], _touch(found, axes[1])[0]
        return cls(pair, ends, axes, found, arms)

    @property
    def length(self) -> float:
        """Its length, m."""
        return float(np.linalg.norm(self.vector))

    def local(self, side: int, vector: FloatArray) -> FloatArray:
        """Components of a vector in the axes of one of its markers."""
        return self.poses[side].rotation.T @ vector

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its length, and the growth of the parts around its sheaves since the start."""
        touches = (self._touch_term(side) for side in range(2) if self.axes[side].any())
        return self._straight_term, *touches

    @property
    def _straight_term(self) -> Term:
        i, j = self.pair
        u, v = (self.local(side, self.axes[side]) for side in range(2))
        if not (u.any() or v.any()):
            return Term(RowKind.DISTANCE, a=i, b=j)
        return Term(RowKind.SPAN, u=u, v=v, a=i, b=j)

    def _touch_term(self, side: int) -> Term:
        """Growth of the part around one of its sheaves since the start.

        At its end the cable arrives: seen from there it runs back, about the opposite axis.
        """
        sign = 1.0 if side == 0 else -1.0
        u = sign * self.local(side, self.axes[side])
        v = sign * self.local(1 - side, self.axes[1 - side])
        return Term(
            RowKind.TOUCH, u=u, v=v, p=self.local(side, self.arms[side]), a=self.pair[side],
            b=self.pair[1 - side], factor=float(np.linalg.norm(u)),
        )  # fmt: skip


def _wraps(
    owner: str, path: Sequence[Guide], groups: Sequence[Sequence[_Span]]
) -> tuple[Around, ...]:
    """The parts of the cable around the sheaves that are not its ends."""
    arrived: dict[int, tuple[_Span, tuple[int, int]]] = {}
    left: dict[int, tuple[_Span, tuple[int, int]]] = {}
    for n, group in enumerate(groups):
        count = 0
        for span in group:
            count += 1  # its length
            for side, seen in ((0, left), (1, arrived)):
                if span.axes[side].any():
                    seen[span.pair[side]] = span, (n, count)
                    count += 1
    wraps = []
    for k, (after, leaves) in left.items():
        guide = path[k]
        if k in arrived and isinstance(guide, Sheave):
            before, arrives = arrived[k]
            angle = _angle(f"{owner}: path[{k}]", guide, before, after)
            wraps.append(Around(k, angle, (arrives, leaves)))
    return tuple(wraps)


def _bend(one: FloatArray, two: FloatArray) -> float:
    """Angle (rad) between two vectors."""
    return float(np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two))


def _angle(what: str, guide: Sheave, before: _Span, after: _Span) -> float:
    """Angle (rad) around a sheave from where the cable arrives to where it leaves.

    Beyond half a turn the tangents meet at ``r tan(angle / 2)`` outside the sheave, where the cable
    crosses itself if it is that long: as one does that does not touch the sheave, or passes it on
    the other side. Only a belt between two wheels is crossed.

    Args:
        what: the sheave in messages.
        guide: the sheave.
        before: straight part that arrives there.
        after: straight part that leaves it.

    Raises:
        ValueError: it crosses itself, and turns are not given.
    """
    axis, arriving, leaving = unit(guide.axis), before.arms[1], after.arms[0]
    sine, cosine = np.cross(arriving, leaving) @ axis, arriving @ leaving
    angle = float(np.arctan2(sine, cosine)) % (2.0 * np.pi)
    if angle > np.pi and guide.turns is None and before.pair[0] != after.pair[1]:
        meet = -guide.radius * np.tan(0.5 * angle)
        if min(np.linalg.norm(np.cross(span.vector, axis)) for span in (before, after)) > meet:
            raise ValueError(
                f"{what}: the cable would cross itself there and run round by "
                f"{np.rad2deg(angle):.4g} deg at the start: it does not touch this sheave, or "
                "passes it on the other side; turn its axis round, or give its turns"
            )
    return angle + 2.0 * np.pi * (guide.turns or 0)


def _check_fleet(what: str, straight: FloatArray, axis: FloatArray) -> None:
    """Check that a straight part is near the plane of a sheave."""
    if not axis.any():
        return
    across = float(abs(straight @ axis) / (np.linalg.norm(straight) * np.linalg.norm(axis)))
    fleet = float(np.arcsin(min(across, 1.0)))
    if fleet > _FLEET:
        raise ValueError(
            f"{what}: the cable leaves the plane of the sheave by {np.rad2deg(fleet):.4g} deg at "
            f"the start, which may be {np.rad2deg(_FLEET):.4g} deg; is its axis right?"
        )


def _size(guide: Guide) -> float:
    """Radius of a guide, m; zero for a point."""
    return guide.radius if isinstance(guide, Sheave) else 0.0


def _axis(guide: Guide) -> FloatArray:
    """Axis of a guide times its radius in inertial axes at the start; zero for a point."""
    return guide.radius * unit(guide.axis) if isinstance(guide, Sheave) else np.zeros(3)


def _touch(s: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vector from a sheave's centre to where ``s`` touches it, and r times its slope by s."""
    normal = np.cross(s, axis)
    size = float(np.linalg.norm(normal))
    if size == 0.0:
        return np.zeros(3), np.zeros((3, 3))
    e = normal / size
    turns = np.stack([np.cross(one, axis) for one in np.eye(3)], axis=1)
    slope = (turns - np.outer(e, e @ turns)) * np.linalg.norm(axis) / size
    return e, slope


def _straight(gap: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray | None:
    """Straight part between two sheaves, see ``constraints.terms.span``; None if there is none."""
    w, radii = v - u, (float(np.linalg.norm(u)), float(np.linalg.norm(v)))
    square = float(gap @ gap) - float(w @ w)
    scale = float(np.linalg.norm(gap)) + sum(radii)
    if square <= (1e-9 * scale) ** 2:
        return None
    length = np.sqrt(square)
    s = (length * gap + np.cross(gap, w)) / float(gap @ gap) * length
    for _ in range(_STEPS):
        (first, by_first), (second, by_second) = _touch(s, u), _touch(s, v)
        error = s + radii[0] * first - radii[1] * second - gap
        step = np.linalg.lstsq(np.eye(3) + by_first - by_second, error)[0]
        s = s - step
        if np.abs(step).sum() <= _SMALL * scale:
            return np.asarray(s)
    return None
