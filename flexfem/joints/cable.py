# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cable over eyelets and sheaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._faults import ReturnError
from flexfem._fields import declared, flag, number
from flexfem._types import FloatArray
from flexfem.core.joint import Joint, unit
from flexfem.core.laws import Law, capstan, spring
from flexfem.core.marker import Attachment, Ground, Marker
from flexfem.core.pose import Pose
from flexfem.core.row import Row, Wrap
from flexfem.core.runs import starts
from flexfem.joints.cable_guides import (
    Eyelet,
    Guide,
    Sheave,
    check_path,
    grips,
    marker_of,
    rubs,
)
from flexfem.joints.cable_path import Part, Path, path_at_start
from flexfem.materials.section import Section

__all__ = ["Cable"]

#: Step of time (s) for the rate of a rest length, and that of five points for both rates of one
#: with mass; the polynomial through these.
_STEP, _SPAN = 1e-5, 1e-3
_THROUGH = np.linalg.inv(np.vander(np.arange(-2.0, 3.0), increasing=True))


@declared
class Cable(Joint):
    """A cable that runs through eyelets and over sheaves, from one end to the other.

    It pulls with ``EA (L - L_0) / L_0 + c d(L - L_0)/dt`` where it is longer than its rest length
    ``L_0``; L is the length of its straight parts and of those around sheaves. One tension acts
    along all of it, but for sheaves with ``grip``, where it does not slip: there it is divided, and
    each part has its own, and its own share of the rest length. A straight part touches a sheave
    where its projection on the sheave's plane is a tangent (Pott 2018, "Cable-Driven Parallel
    Robots", for planes that contain the cable). A damper acts softly where the cable begins to
    pull, and never makes it press, as that of ``SpringDamper``.

    Friction at guides divides the tension, too: it changes by ``exp(mu theta)`` against the sliding
    of the cable, whose speed is that of one that does not stretch, and which stretches by the
    tension at the end of its part. Statics and modes leave friction out.

    With ``mass_per_length`` it has inertia and weight. All of it has one stretch, its parts between
    guides stay straight, and its material flows through guides without friction; see
    ``families.cable.inertia`` for the equations. Its tension is that of the stretch then, the mean
    along it; where weight bends a part much a warning says so.

    Attributes:
        path: its guides in order: a marker or a Sheave with ``grip`` (a drum) at each end, and
            ``Eyelet`` and ``Sheave`` between.
        axial_stiffness: EA, N; or
        stiffness: of the whole cable at the start, N/m; or
        section: section whose axial stiffness it has. None of the three: it does not stretch.
        rest_length: of the parts that are not wound on drums, m, at the start or as a function of
            time (s). None for the length at the start, less the stretch of the preload.
        paid_out: function of time (s), m: what a winch at the first end adds to the rest length,
            negative where it hauls in; in place of a rest length that is a function.
        preload: tension at the start, N; in place of a rest length.
        damping: of the whole cable, N s/m.
        mass_per_length: of the unstretched cable, kg/m.
        tension_only: True if it is slack where it would press.
        closed: True for a belt: the last guide is followed by the first one.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: guides do not suit, two of the stiffnesses, a number that is negative or not
            positive, preload and rest length, a cable that cannot stretch and would be slack; mass
            with friction, on a Sheave with ``grip``, or of a closed cable.
    """

    a: Attachment = field(init=False)
    b: Attachment = field(init=False)
    path: Sequence[Guide]
    axial_stiffness: float | None = number(default=None, positive=True)
    stiffness: float | None = number(default=None, positive=True)
    section: Section | None = None
    rest_length: float | Callable[[float], float] | None = None
    paid_out: Callable[[float], float] | None = None
    preload: float = number(default=0.0, nonnegative=True)
    damping: float = number(default=0.0, nonnegative=True)
    tension_only: bool = flag(default=True)
    closed: bool = flag(default=False)
    mass_per_length: float = number(default=0.0, nonnegative=True)

    def __post_init__(self) -> None:
        """Check guides and numbers against one another."""
        check_path(self.owner, self.path, self.closed)
        _checks.assign(self, path=tuple(self.path))
        _checks.assign(self, a=marker_of(self.path[0]), b=marker_of(self.path[-1]))
        super().__post_init__()
        self._check_stretch()
        self._check_rest()
        self._check_mass()
        # of this cable, not of all
        _checks.assign(self, driven=callable(self.rest_length) or self.paid_out is not None)
        if self.closed and any(map(rubs, self.path)) and not any(map(grips, self.path)):
            raise ValueError(f"{self.owner}: friction in a closed cable needs a Sheave with grip")
        if not self.pairs:
            raise ValueError(f"{self.owner}: its guides cannot move relative to one another")

    def _check_stretch(self) -> None:
        """Check what says how it stretches."""
        if self.section is not None:
            _checks.instance(self.owner, "section", self.section, Section)
            if self.section.stiffness is None:
                raise ValueError(f"{self.owner}: section must have a stiffness, not a law")
        names = "axial_stiffness", "stiffness", "section"
        given = [name for name in names if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{self.owner}: give {given[0]} or {given[1]}, not both")
        if given:
            return
        for what, value in (("preload", self.preload), ("damping", self.damping)):
            if value:
                raise ValueError(f"{self.owner}: {what} needs a stiffness, got {value:g} alone")
        if self.tension_only:
            raise ValueError(
                f"{self.owner}: give axial_stiffness, stiffness or section; one that does not "
                "stretch cannot be slack, and needs tension_only=False"
            )

    def _check_rest(self) -> None:
        """Check the rest length, and what changes it."""
        if self.paid_out is not None:
            _checks.function(self.owner, "paid_out", self.paid_out, ())
            if callable(self.rest_length):
                raise ValueError(f"{self.owner}: give paid_out or rest_length, not both")
        if self.rest_length is None:
            return
        if self.preload:
            raise ValueError(f"{self.owner}: give preload or rest_length, not both")
        if callable(self.rest_length):
            _checks.function(self.owner, "rest_length", self.rest_length, ())
            _checks.number(self.owner, "rest_length(0)", self.rest_length(0.0), positive=True)
        else:
            _checks.number(self.owner, "rest_length", self.rest_length, positive=True)

    def _check_mass(self) -> None:
        """Check that a cable with mass flows through its guides freely."""
        if not self.mass_per_length:
            return
        given = f"{self.owner}: mass_per_length of {self.mass_per_length:g} kg/m"
        if self.closed:
            raise ValueError(f"{given} needs closed=False")
        for k, guide in enumerate(self.path):
            if isinstance(guide, Sheave) and guide.grip:
                raise ValueError(
                    f"{given} needs path[{k}] without grip; a drum at the first end is a marker "
                    "with a rest_length or paid_out that is a function of time"
                )
            if rubs(guide):
                raise ValueError(f"{given} needs path[{k}] without friction")

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        return tuple((f"path[{k}]", marker_of(guide)) for k, guide in enumerate(self.path))

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`; neighbours on one body are left out."""
        markers = self.markers
        ends = [(k, k + 1) for k in range(len(markers) - 1)]
        if self.closed:
            ends.append((len(markers) - 1, 0))
        return tuple((i, j) for i, j in ends if not _together(markers[i], markers[j]))

    @property
    def part_count(self) -> int:
        """Number of its parts under one tension each."""
        return len(self.part_rows)

    @property
    def part_rows(self) -> list[int]:
        """Numbers of the rows of its parts; those of friction at their guides are between."""
        if self.closed:
            firsts = [k for k, guide in enumerate(self.path) if grips(guide)] or [0]
            inner = [*self.path[firsts[0] :], *self.path[: firsts[0]]]
        else:
            inner = list(self.path[:-1])
        numbers, count = [], 0
        for k, guide in enumerate(inner):
            if k == 0 or grips(guide):
                numbers.append(count)
                count += 1
            count += rubs(guide)
        return numbers

    @property
    def second(self) -> int:
        """See :attr:`Joint.second`."""
        return len(self.path) - 1

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, Any]:
        """See :meth:`Joint.turned`."""
        guides = [
            replace(guide, axis=turn @ unit(guide.axis)) if isinstance(guide, Sheave) else guide
            for guide, turn in zip(self.path, turns, strict=True)
        ]
        return {"path": guides}

    def shape(self, poses: Sequence[Pose]) -> Path:
        """Its course at the start.

        Raises:
            ValueError: it does not fit its guides there.
        """
        return path_at_start(self.owner, tuple(self.path), tuple(poses), self.closed)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError where it does not fit its guides."""
        shape = self.shape(poses)
        rests, rates = self._rests(shape, t)
        rows: list[Row] = []
        for part, rest, rate in zip(shape.parts, rests, rates, strict=True):
            target, law = part.start_of() + rest - part.length, self._law(rest, shape.length)
            rows.append(Row(part.terms(), target, law, target_rate=rate))
            rows += self._friction(shape, part, len(rows) - 1, rate)
        return tuple(rows)

    def _friction(self, shape: Path, part: Part, row: int, rate: float) -> list[Row]:
        """Rows of the guides of a part at which the cable slides with friction.

        Each acts on the length from the start of the part to where the cable arrives there.

        Args:
            shape: the cable at the start.
            part: the part.
            row: number of its own row within the joint.
            rate: at which cable is paid out at its start, which slides over all its guides, m/s.
        """
        rows = []
        around = {wrap.guide: wrap for wrap in shape.wraps}
        first = starts([len(span) for span in part.spans])
        for n, k in enumerate(part.guides[1:-1]):
            guide = self.path[k]
            if not rubs(guide):
                continue
            assert isinstance(guide, (Eyelet, Sheave))
            if isinstance(guide, Sheave):
                start: float | None = around[k].angle
                terms = tuple((row, term) for _, term in around[k].touches)
            else:
                start, terms = None, ((row, int(first[n])), (row, int(first[n + 1])))
            law = capstan(guide.friction, guide.velocity, start or part.bends[n])
            wrap = Wrap(guide.friction, (terms[0], terms[1]), start)
            # zero at the start: statics take friction for a very soft spring
            target = part.start_of(n + 1)
            rows.append(Row(part.terms(n + 1), target, law, target_rate=rate, wrap=wrap))
        return rows

    def targets(self, poses: Sequence[Pose], t: float) -> Sequence[float] | None:
        """See :meth:`Joint.targets`; a law of one that stretches changes with its length."""
        if self._stretches or not self.driven:
            return None
        shape = self.shape(poses)
        rests, _ = self._rests(shape, t)
        return [p.start_of() + rest - p.length for p, rest in zip(shape.parts, rests, strict=True)]

    @property
    def _stretches(self) -> bool:
        kinds = self.axial_stiffness, self.stiffness, self.section
        return any(kind is not None for kind in kinds)

    def _axial_stiffness(self, length: float) -> float:
        """EA, N, of a cable of a length (m) at the start."""
        if self.section is not None and self.section.stiffness is not None:
            return float(self.section.stiffness[0, 0])
        if self.stiffness is not None:
            return self.stiffness * self._start_length(length)
        return self.axial_stiffness or 0.0

    def _start_length(self, length: float) -> float:
        """Rest length at the start, m, of a cable of such a length."""
        if callable(self.rest_length):
            return float(self.rest_length(0.0))
        if self.rest_length is not None:
            return self.rest_length
        if not self.preload:
            return length
        if self.stiffness is not None:
            return length - self.preload / self.stiffness
        return length / (1.0 + self.preload / self._axial_stiffness(length))

    def _rests(self, shape: Path, t: float) -> tuple[list[float], list[float]]:
        """Rest lengths of the parts, m, at time t, and their rates, m/s."""
        length = shape.length
        whole = self._start_length(length)
        if whole <= 0.0:
            raise ValueError(
                f"{self.owner}: preload of {self.preload:g} N leaves a rest length of {whole:.6g} m"
            )
        rests = [part.length / length * whole for part in shape.parts]
        rates = [0.0] * len(rests)
        if self.driven:
            rests[0] += self._fed(t)
            rates[0] = self._rate(t) if self.damping or any(map(rubs, self.path)) else 0.0
        if rests[0] <= 0.0:
            raise ReturnError(
                f"the winch leaves {rests[0]:.6g} m of the first part at t = {t:.6g} s, which must "
                "be positive"
            )
        return rests, rates

    def rest_with_rates(self, length: float, t: float) -> FloatArray:
        """Rest length of a cable in one part, m, with its first two rates.

        Args:
            length: of the cable at the start, m.
            t: time, s.

        Raises:
            ReturnError: it is not positive.
        """
        rest = self._start_length(length)
        if not self.driven:
            return np.array([rest, 0.0, 0.0])
        middle = max(t, 2.0 * _SPAN)  # a motion need not be defined before the start
        values = [self._fed(middle + n * _SPAN) for n in range(-2, 3)]
        # the polynomial through them
        found = np.polynomial.Polynomial(_THROUGH @ values)
        at = (t - middle) / _SPAN
        first, second = found.deriv()(at) / _SPAN, found.deriv(2)(at) / _SPAN**2
        return np.array([rest + self._fed(t), first, second])

    def _fed(self, t: float) -> float:
        """What has been added to the rest length, m."""
        if self.paid_out is not None:
            return _checks.returned_number("paid_out", self.paid_out(t))
        assert callable(self.rest_length)
        return _checks.returned_number("rest_length", self.rest_length(t) - self.rest_length(0.0))

    def _rate(self, t: float) -> float:
        """Rate of the rest length, m/s."""
        first, last = max(t - _STEP, 0.0), t + _STEP
        return (self._fed(last) - self._fed(first)) / (last - first)

    def _law(self, rest: float, length: float) -> Law | None:
        """Law of a part of a rest length (m) of a cable of a length (m) at the start."""
        if not self._stretches:
            return None
        share = self._start_length(length) / rest
        stiffness = self._axial_stiffness(length) / rest
        return spring(stiffness, self.damping * share, tension_only=self.tension_only)


def _together(a: Attachment, b: Attachment) -> bool:
    """True if two markers cannot move relative to one another."""
    if isinstance(a, Ground) or isinstance(b, Ground):
        return isinstance(a, Ground) and isinstance(b, Ground)
    return isinstance(a, Marker) and a.body == b.body and a.point == b.point
