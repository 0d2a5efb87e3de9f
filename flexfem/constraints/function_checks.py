# SPDX-License-Identifier: LGPL-3.0-or-later
"""User-defined functions in rows: checks of the model and monitoring of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem._faults import FAILURES, ReturnError, noted
from flexfem._types import FloatArray, IntArray
from flexfem.constraints.terms.compiled_functions import check, kind_number
from flexfem.constraints.terms.dispatch import term as evaluate_term
from flexfem.core.laws import STORING_FUNCTIONS, Law, LawKind
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind
from flexfem.core.user_function import FunctionKind, UserFunction
from flexfem.kernels.compiled import kernel
from flexfem.kernels.sequence import Check
from flexfem.lie import se3

if TYPE_CHECKING:
    from flexfem.constraints.numbered_rows import NumberedRows

__all__ = ["Functions", "check_functions"]

#: Depth (m or rad) at which the function of a stop or of a slack spring is tried.
_TRIED = 1e-3


def check_functions(rows: Sequence[Row], poses: Sequence[Pose]) -> None:
    """Call and compile the functions of a joint's rows and check their derivatives at the start.

    Args:
        rows: rows of the joint.
        poses: poses of its markers at the start.

    Raises:
        ValueError: a function fails, does not compile, or is not smooth there; the message names
            it.
    """
    if not any(row.calls for row in rows):
        return
    frames = [se3.frame(pose.position, pose.rotation) for pose in poses]
    for row in rows:
        for term in row.terms:
            if term.function is not None:
                relative = se3.compose(se3.inverse(frames[term.a]), frames[term.b])
                values = term.function.tried(*_pose_arguments(relative))
                if term.component >= len(values):
                    raise ValueError(
                        f"{term.function.owner}: {term.function.what}: {term.function.place}: "
                        f"returned {len(values)} numbers at the start, and other ones before"
                    )
                check(term.function, np.append(relative, 1.0), term.data.ravel())
        if row.law is not None and row.law.function is not None:
            user, data = row.law.function, np.zeros(9)
            data[1 : 1 + len(user.parameters)] = user.parameters
            value = sum(_value(term, frames) for term in row.terms) - row.target
            if user.kind in (FunctionKind.FORCE, FunctionKind.CURVE):
                place = _beyond(row.law, value)
                user.tried(place, 0.0, 0.0)
                check(user, np.array([place, 0.0]), data)
            else:
                user.tried(row.law.second)
                check(user, np.array([row.law.second]), data)


def _beyond(law: Law, value: float) -> float:
    """Argument of a law's function: the value, or how far it is beyond a slack range.

    Within the range it is not called; a small one beyond is tried.
    """
    if law.kind not in STORING_FUNCTIONS:
        return value
    beyond = value - min(max(value, law.first), law.second)
    if beyond == 0.0 and law.first < law.second:
        return _TRIED
    return abs(beyond) if law.kind is LawKind.PRESS else beyond


def _value(term: Any, frames: Sequence[FloatArray]) -> float:
    """Value of a term at the start; zero for an arc length, which is unknown here."""
    if term.kind == RowKind.ARC:
        return 0.0
    number, g, scratch = kind_number(term), np.empty(12), np.empty((5, 3))
    a, b = frames[term.a], frames[term.b]
    return float(term.factor * evaluate_term(number, a, b, term.data, 0.0, g, scratch))


def _pose_arguments(H: FloatArray) -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]:
    """Position and rotation of a frame (12,) as arguments of functions."""
    x = H.tolist()
    return tuple(x[:3]), (tuple(x[3:6]), tuple(x[6:9]), tuple(x[9:12]))


@dataclass(frozen=True)
class _Place:
    """Use of a function: its row, and its first term there, -1 for that of a law."""

    user: UserFunction
    row: int
    term: int


class Functions:
    """The user-defined functions in the rows of a rank.

    Attributes:
        places: the rows and terms that use them.
    """

    def __init__(self, table: NumberedRows) -> None:
        """Find the functions in the rows."""
        self.places: list[_Place] = []
        for i in table.calling:
            placed = table.joints[i]
            for r, row in enumerate(placed.rows(0.0), start=int(table.start[i])):
                for k, term in enumerate(row.terms):
                    if term.function is not None:
                        t = -1 if placed.on_lines else int(table.term_start[r]) + k
                        self.places.append(_Place(term.function, r, t))
                if row.law is not None and row.law.function is not None:
                    self.places.append(_Place(row.law.function, r, -1))
        self._rows = np.array([place.row for place in self.places], dtype=np.int64)
        inside = np.isin(table.row_of_term, self._rows)
        self._terms = np.flatnonzero(inside)

    def watch(self, rows: Any) -> Check:
        """Check that their values are finite at an evaluation of ``rows``.

        Others are recorded. The rows are left not finite, which makes the step fail on all ranks.
        """
        return Check(
            lambda: self._record(rows), _finite, rows.values, self._rows, rows.force_jacobian,
            self._terms,
        )  # fmt: skip

    def _record(self, rows: Any) -> None:
        """Record the functions whose values were not finite at the last evaluation of ``rows``."""
        velocities, sums, rates = rows.interface.velocities, rows.sums(), rows.rates()
        if not (np.isfinite(rows.poses).all() and np.isfinite(velocities).all()):
            return  # the motion was not finite before
        for place in self.places:
            arguments = self._arguments(place, rows, sums, rates)
            bad = ~np.isfinite(rows.values[place.row])
            bad |= not np.isfinite(rows.force_jacobian[self._terms]).all()
            if arguments and bad:
                _blame(place.user, arguments)

    def _arguments(
        self, place: _Place, rows: Any, sums: FloatArray, rates: FloatArray
    ) -> tuple[Any, ...]:
        """Arguments of the call of the function; empty if they are unknown."""
        r = place.row
        if place.user.kind is FunctionKind.POSE:
            if place.term < 0:
                return ()
            a, b = rows.poses[rows.term_marker[place.term]]
            return _pose_arguments(se3.compose(se3.inverse(a), b))
        rate = float(rates[r])
        if place.user.kind is FunctionKind.SPEED:
            return (abs(rate),) if np.isfinite(rate) else ()
        value = float(sums[r] - rows.targets[r])
        known = np.isfinite(value) and np.isfinite(rate)
        return (value, rate, float(rows.function_data[r, 0])) if known else ()


@kernel
def _finite(values: FloatArray, rows: IntArray, gradients: FloatArray, terms: IntArray) -> bool:
    """True if values of some rows, and gradients (t, 2, 6) of some terms, are finite."""
    total = 0.0
    for r in rows:
        total += 0.0 * values[r]
    for t in terms:
        for side in range(2):
            for i in range(6):
                total += 0.0 * gradients[t, side, i]
    return total == 0.0


def _blame(user: UserFunction, arguments: tuple[Any, ...]) -> None:
    """Record the error of a function at these arguments, if there is one."""
    try:
        values = user(*arguments)
    except FAILURES as error:
        noted(user.owner, user.function, error)
        return
    shown = ", ".join(_shown(one) for one in arguments)
    if np.isfinite(values).all():
        what = f"{user.what} has no finite derivatives at ({shown})"
    else:
        what = f"{user.what} returned {values.tolist()} at ({shown})"
    noted(user.owner, user.function, ReturnError(what))


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return "(" + ", ".join(_shown(one) for one in value) + ")"
    return f"{value:.6g}"
