# SPDX-License-Identifier: LGPL-3.0-or-later
"""Objects whose fields say how they are checked."""

from dataclasses import FrozenInstanceError, dataclass, fields, replace

import pytest

import flexfem as ff
from flexfem._fields import declared, number, one_of, time_function


@declared
class _Base:
    name: str
    size: float = number(default=1.0, positive=True)

    def __post_init__(self) -> None:
        assert isinstance(self.size, float)  # fields are checked by then


@declared
class _Derived(_Base):
    kind: str = one_of(("round", "flat"), default="flat")
    drive: object = time_function(3, default=lambda t: (0.0, 0.0, t))


def test_fields_are_checked_in_derived_classes():
    made = _Derived("a", 2)
    assert isinstance(made.size, float)
    assert [one.name for one in fields(made)] == ["name", "size", "kind", "drive"]
    with pytest.raises(FrozenInstanceError):
        made.size = 3.0
    for bad, message in {
        "size": '_Derived "a": size must be a number, got []',
        "kind": '_Derived "a": kind must be one of round, flat, got []',
        "drive": '_Derived "a": drive must be a function of time, got []',
    }.items():
        with pytest.raises((TypeError, ValueError)) as error:
            _Derived("a", **{bad: []})
        assert str(error.value) == message


def test_a_plain_dataclass_may_derive():
    @dataclass(frozen=True, eq=False)
    class Own(_Derived):
        more: int = 0

        def __post_init__(self) -> None:
            super().__post_init__()
            assert self.more >= 0

    assert Own("a", more=1).size == 1.0
    with pytest.raises(ValueError, match='Own "a": size must be positive, got -1'):
        Own("a", -1)


def test_replace_keeps_what_is_stored():
    body = ff.RigidBody("b", 1.0, (1.0, 1.0, 1.0), local_angular_velocity=(0.0, 0.0, 2.0))
    heavy = replace(body, mass=2.0)
    assert heavy.mass == 2.0
    assert heavy.angular_velocity.tolist() == [0.0, 0.0, 2.0]
    force = ff.PointForce("f", ff.Marker("b"), (1.0, 0.0, 0.0), follower=True)
    assert replace(force, force=(2.0, 0.0, 0.0)).follower


def test_a_constant_of_the_class_is_no_value_of_the_object():
    """Checkpoints are compared by the values of objects."""
    places = [ff.Marker(name) for name in "abcd"]
    assert "motions" in vars(ff.Coupling("c", *places))
    assert "motions" not in vars(ff.Gear("g", *places))
