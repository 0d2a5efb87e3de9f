# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the rows that joints of a script return: compiled loops trust what is in them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem.core.joint import Joint
from flexfem.core.laws import Law, LawKind
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["rows_at_start"]

#: Directions of a term that must not be zero, by its kind.
_DIRECTIONS = {
    RowKind.INERTIAL: "u",
    RowKind.ALONG: "u",
    RowKind.AXES: "uv",
    RowKind.ANGLE: "uvp",
    RowKind.TOUCH: "up",
}


def rows_at_start(joint: Joint, poses: Sequence[Pose]) -> Sequence[Row]:
    """Rows of a joint at the start; those of a class outside the package are checked.

    Raises:
        ValueError: the joint has no rows there, or what a class returns is not usable.
    """
    if type(joint).rows is Joint.rows:
        raise ValueError(f"{joint.owner}: its class has no method rows")
    if type(joint).rows.__module__.startswith("flexfem."):
        return joint.rows(poses, 0.0)
    try:
        rows = joint.rows(poses, 0.0)
    except FAILURES as error:
        raise ValueError(f"{joint.owner}: {located(joint.rows, error)}") from error
    for i, row in enumerate(_several(f"{joint.owner}: rows", rows, Row)):
        owner = f"{joint.owner}: row {i}"
        _checks.number(owner, "target", row.target)
        _checks.number(owner, "target_rate", row.target_rate)
        terms = _several(f"{owner}: terms", row.terms, Term)
        if not terms:
            raise ValueError(f"{owner}: it has no terms")
        for term in terms:
            _check_term(owner, term, len(poses))
        if row.law is not None:
            _check_law(owner, row.law)
    if not joint.driven and _changes(joint, poses, rows):
        raise ValueError(
            f"{joint.owner}: its rows change with time; set driven = True in its class"
        )
    return rows


def _changes(joint: Joint, poses: Sequence[Pose], rows: Sequence[Row]) -> bool:
    """True if targets, terms or numbers of laws differ at other times, where there are rows."""
    try:
        others = [joint.rows(poses, t) for t in (0.37, 1.61)]
        return any(_numbers(other) != _numbers(rows) for other in others)
    except FAILURES:  # a table may end before
        return False


def _numbers(rows: Sequence[Row]) -> list[Any]:
    """All numbers of rows, to be compared."""
    return [
        (
            row.target,
            row.target_rate,
            [(term.factor, term.data.tolist()) for term in row.terms],
            # functions are left out: a lambda is another one at each call
            row.law and replace(row.law, function=None),
        )
        for row in rows
    ]


def _several(what: str, values: Any, kind: type) -> Any:
    """Return a checked tuple or list of objects."""
    if not isinstance(values, (tuple, list)) or not all(isinstance(v, kind) for v in values):
        raise ValueError(f"{what} must be a tuple of {kind.__name__}, got {_checks.show(values)}")
    return values


def _check_term(owner: str, term: Term, markers: int) -> None:
    if not isinstance(term.kind, RowKind):
        raise ValueError(f"{owner}: kind must be a RowKind, got {_checks.show(term.kind)}")
    for name in ("a", "b"):
        value = getattr(term, name)
        if not isinstance(value, int) or not 0 <= value < markers:
            raise ValueError(
                f"{owner}: {name} must be the number of one of {markers} markers, got "
                f"{_checks.show(value)}"
            )
    _checks.number(owner, "factor", term.factor)
    for name in "uvp":
        nonzero = name in _DIRECTIONS.get(term.kind, "")
        _checks.vector(owner, name, getattr(term, name), nonzero=nonzero)
    if (term.kind is RowKind.FUNCTION) is (term.function is None):
        raise ValueError(f"{owner}: a function belongs to the kind FUNCTION, and to no other")


def _check_law(owner: str, law: Law) -> None:
    if not isinstance(law, Law):
        raise ValueError(f"{owner}: law must be one of flexfem.laws, got {_checks.show(law)}")
    if law.kind is LawKind.POTENTIAL:
        raise ValueError(f"{owner}: a row that is an energy is that of a Catenary alone")
    if law.kind is LawKind.CAPSTAN:
        raise ValueError(f"{owner}: friction around guides is that of a Cable alone")
    stop = law.kind is LawKind.LIMIT
    _checks.number(owner, "stiffness", law.stiffness, nonnegative=not stop, positive=stop)
    _checks.number(owner, "damping", law.damping, nonnegative=True)
    if np.isnan([law.first, law.second]).any():
        raise ValueError(f"{owner}: a number of its law is nan")
