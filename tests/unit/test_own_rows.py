# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in joints of a script are told in one line: compiled loops trust what rows hold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import flexfem as ff

pytestmark = pytest.mark.serial

X = np.array([1.0, 0.0, 0.0])
NOTHING: Any = None


@dataclass(frozen=True, eq=False)
class Mine(ff.Joint):
    """Its rows are those of a function."""

    made: Callable[[float], Any] = lambda t: ()

    def rows(self, poses: Sequence[ff.Pose], t: float) -> tuple[ff.Row, ...]:
        """See ``Joint.rows``."""
        rows: tuple[ff.Row, ...] = self.made(t)
        return rows


@dataclass(frozen=True, eq=False)
class Driven(Mine):
    """The same with rows that change."""

    driven = True


@dataclass(frozen=True, eq=False)
class Empty(ff.Joint):
    """A class without rows."""


def along(**what: Any) -> ff.Term:
    """A term along x."""
    return ff.Term(ff.RowKind.INERTIAL, **({"u": X} | what))


def run(joint: ff.Joint) -> Any:
    """A body on the joint, for five steps."""
    model = ff.Model("own")
    model.add(ff.RigidBody("body", 1.0, (1.0, 1.0, 1.0)), joint)
    return ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=0.05, quiet=True))


def row(law: Any = None, **term: Any) -> Callable[[float], Any]:
    """Function that makes one row of one term."""
    return lambda t: (ff.Row((along(**term),), law=law),)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda t: None, "rows must be a tuple of Row, got None"),
        (lambda t: ff.Row((along(),)), r"rows must be a tuple of Row, got Row\("),
        (lambda t: (ff.Row(NOTHING),), "row 0: terms must be a tuple of Term, got None"),
        (lambda t: (ff.Row(()),), "row 0: it has no terms"),
        (lambda t: (ff.Row((along(),), np.nan),), "row 0: target must be finite, got nan"),
        (lambda t: (ff.Row((along(),), t),), "its rows change with time; set driven = True"),
        (
            lambda t: (ff.Row((along(),), law=ff.laws.limit(None, 1.0 + t, 9.0, 0.0)),),
            "its rows change with time; set driven = True",
        ),
        (row(u=np.ones(2)), "row 0: u must hold 3 numbers"),
        (row(u=np.zeros(3)), "row 0: u must not be zero"),
        (row(factor=np.inf), "row 0: factor must be finite, got inf"),
        (row(b=2), "row 0: b must be the number of one of 2 markers, got 2"),
        (row(a=-1), "row 0: a must be the number of one of 2 markers, got -1"),
        (lambda t: (ff.Row((ff.Term(NOTHING, u=X),)),), "row 0: kind must be a RowKind, got None"),
        (
            lambda t: (ff.Row((ff.Term(ff.RowKind.FUNCTION),)),),
            "row 0: a function belongs to the kind FUNCTION",
        ),
        (row(law="spring"), "row 0: law must be one of flexfem.laws, got 'spring'"),
        (row(law=ff.laws.spring(-5.0)), "row 0: stiffness must not be negative, got -5.0"),
        (row(law=ff.laws.spring(1.0, np.nan)), "row 0: damping must be finite, got nan"),
        (row(law=ff.laws.spring(0.0, backlash=0.1)), "row 0: stiffness must be positive, got 0.0"),
        (row(law=ff.laws.applied(np.nan)), "row 0: a number of its law is nan"),
        (
            row(law=ff.laws.Law(ff.laws.LawKind.POTENTIAL)),
            "row 0: a row that is an energy is that of a Catenary alone",
        ),
        (row(law=ff.laws.capstan(0.1, 1.0, 1.0)), "row 0: friction around guides is that of a Cab"),
        (lambda t: 1 / 0, r"lambda \(test_own_rows.py, line \d+\): ZeroDivisionError: division"),
    ],
)
def test_rows_that_are_refused(made: Callable[[float], Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=f'^Mine "joint": {message}'):
        run(Mine("joint", ff.Ground(), ff.Marker("body"), made))


def test_a_class_without_rows() -> None:
    with pytest.raises(ValueError, match=r'^Empty "joint": its class has no method rows$'):
        run(Empty("joint", ff.Ground(), ff.Marker("body")))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        # more rows would be written over those of the next joint
        (lambda t: (1 + (t > 0.02)) * (ff.Row((along(),)),), "rows must be as many"),
        (lambda t: (ff.Row((1 + (t > 0.02)) * (along(),)),), "rows must be as many"),
        (lambda t: (ff.Row((along(),), 0.0 / (t < 0.025)),), "ZeroDivisionError"),
    ],
)
def test_rows_that_fail_later(made: Callable[[float], Any], message: str) -> None:
    with pytest.raises(ff.FunctionError, match=f'^Driven "joint": .*{message}') as raised:
        run(Driven("joint", ff.Ground(), ff.Marker("body"), made))
    assert raised.value.outcome.summary["steps"] == 2
