# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables that make no sense, and cables whose results would be wrong in silence."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page, assert_refused

A, B, C = ff.Ground(), ff.Marker("one"), ff.Marker("two")
Y = (0.0, 1.0, 0.0)
WHEEL = ff.Sheave(B, 0.1, Y)
ANY: Any = None


def one(t: float) -> float:
    """A function of time."""
    return 1.0


ALONE: dict[str, tuple[Callable[[], object], str]] = {
    "no list": (lambda: ff.Cable("j", ANY, stiffness=1.0), "path must be a list or tuple, got N"),
    "one guide": (lambda: ff.Cable("j", [A], stiffness=1.0), "two guides at least, got 1"),
    "no guide": (lambda: ff.Cable("j", [A, "b"], stiffness=1.0), r"path\[1\] must be a Marker or"),
    "line": (
        lambda: ff.Cable("j", [A, ff.Carrier("beam")], stiffness=1.0),
        r"path\[1\] must be at a place, not on a whole line",
    ),
    "end": (
        lambda: ff.Cable("j", [A, WHEEL], stiffness=1.0),
        r"path\[1\] is an end: it must be a marker or a Sheave with grip=True, got Sheave",
    ),
    "inner": (lambda: ff.Cable("j", [A, B, C], stiffness=1.0), r"path\[1\] must be an Eyelet, .*"),
    "two stiffnesses": (
        lambda: ff.Cable("j", [A, B], stiffness=1.0, axial_stiffness=2.0),
        "give axial_stiffness or stiffness, not both",
    ),
    "stiffness": (
        lambda: ff.Cable("j", [A, B], stiffness=0.0), "stiffness must be positive, got 0.0"
    ),
    "section": (
        lambda: ff.Cable("j", [A, B], section=ANY or 3.0), "section must be a Section, got 3.0"
    ),
    "slack": (lambda: ff.Cable("j", [A, B]), "one that does not stretch cannot be slack"),
    "damping": (
        lambda: ff.Cable("j", [A, B], damping=2.0, tension_only=False),
        "damping needs a stiffness, got 2 alone",
    ),
    "rest": (
        lambda: ff.Cable("j", [A, B], stiffness=1.0, rest_length=-1.0),
        "rest_length must be positive, got -1.0",
    ),
    "rest at the start": (
        lambda: ff.Cable("j", [A, B], stiffness=1.0, rest_length=lambda t: t),
        r"rest_length\(0\) must be positive, got 0.0",
    ),
    "two winches": (
        lambda: ff.Cable("j", [A, B], stiffness=1.0, rest_length=one, paid_out=one),
        "give paid_out or rest_length, not both",
    ),
    "preload": (
        lambda: ff.Cable("j", [A, B], stiffness=1.0, preload=1.0, rest_length=1.0),
        "give preload or rest_length, not both",
    ),
    "ground": (lambda: ff.Cable("j", [A, A], stiffness=1.0), "its guides cannot move relative"),
    "one body": (lambda: ff.Cable("j", [B, B], stiffness=1.0), "its guides cannot move relative"),
}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize(("make", "message"), ALONE.values(), ids=ALONE)
def test_a_cable_that_is_refused(make: Callable[[], object], message: str) -> None:
    assert_refused(make, message)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ff.Sheave(B, -0.1, Y), "Sheave: radius must be positive, got -0.1"),
        (lambda: ff.Sheave(B, 0.1, (0, 0, 0)), "Sheave: axis must not be zero"),
        (lambda: ff.Sheave(B, 0.1, Y, turns=-1), "Sheave: turns must not be negative, got -1"),
        (lambda: ff.Eyelet(ANY), "Eyelet: marker must be a Marker or Ground, got None"),
    ],
)
def test_a_guide_that_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=f"^{message}"):
        make()


def over(
    radius: float = 0.1, axis: Any = Y, place: Any = (0.5, 0.0, 0.1), **given: Any
) -> ff.Model:
    """A load on a cable that runs from the origin over a sheave."""
    model = ff.Model("over")
    wheel = ff.Sheave(ff.Ground(place), radius, axis)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("load", 1.0, (0.01,) * 3, position=(0.6, 0.0, -0.5)),
        ff.Cable("j", [ff.Ground(), wheel, ff.Marker("load")], stiffness=1e4),
        ff.CableProbe("pull", "j"),
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"place": (0.0, 0.0, 0.0)}, r"path\[0\] and path\[1\] coincide at the start"),
        (
            {"radius": 0.6},
            r"no straight part touches path\[0\] and path\[1\], which are 0.509902 m apart at the "
            "start, with radii of 0 and 0.6 m",
        ),
        (
            {"axis": (0.3, 0.1, 0.0)},
            r"path\[1\]: the cable leaves the plane of the sheave by .* deg at the start, which m",
        ),
        (
            {"place": (0.35, 0.0, -0.55)},
            r"path\[1\]: the cable would cross itself there and run round by 3.* deg at the start",
        ),
        (
            {"axis": (0.0, -1.0, 0.0)},
            r"path\[1\]: the cable would cross itself there and run round by 2.* deg at the start",
        ),
    ],
    ids=["coincide", "overlap", "fleet", "beside", "sense"],
)
def test_a_path_that_does_not_fit(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f'^Cable "j": {message}') as raised:
        ff.simulate(over(**given), ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True))
    assert_on_page(str(raised.value))


@pytest.mark.serial
@pytest.mark.parametrize(
    ("probe", "message"),
    [
        (ff.CableProbe("p", "load"), 'no cable "load"'),
        (ff.CableProbe("p", "j", part=1), 'part must be 0, the only one of Cable "j", got 1'),
    ],
)
def test_a_probe_that_is_refused(probe: ff.CableProbe, message: str) -> None:
    model = over()
    model.add(probe)
    with pytest.raises(ValueError, match=message) as raised:
        ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True))
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_a_winch_that_hauls_in_more_than_there_is() -> None:
    model = ff.Model("winch")
    model.add(
        ff.RigidBody("load", 1.0, (0.01,) * 3, position=(0.0, 0.0, -0.5)),
        ff.Cable("j", [A, ff.Marker("load")], stiffness=10.0, rest_length=lambda t: 0.5 - 50.0 * t),
    )
    with pytest.raises(ff.FunctionError, match=r'^Cable "j": .*the winch leaves -.* m of the f'):
        ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.05, quiet=True))


def warnings_of(model: ff.Model, dt: float, t_end: float) -> list[str]:
    """Those of a run about the cable."""
    outcome = ff.simulate(model, ff.RunOptions(dt=dt, t_end=t_end, quiet=True))
    texts: list[str] = [text for text in outcome.summary["warnings"] if '"j"' in text]
    for text in texts:
        assert_on_page(text)
    return texts


def test_a_cable_that_leaves_its_sheave_is_told() -> None:
    """A load that is thrown over the sheave: the cable comes off it; one that hangs does not."""
    assert warnings_of(over(), 2e-3, 0.1) == []
    model = over()
    model.add(ff.PointForce("throw", ff.Marker("load"), (5.0, 0.0, 60.0)))
    texts = warnings_of(model, 2e-3, 0.4)
    assert any(
        text.startswith('Cable "j": path[1]: the cable has left this sheave at t = 0.')
        for text in texts
    )


@pytest.mark.parametrize(
    ("rest_length", "speed", "told"), [(0.8, 5.0, True), (0.8, 0.0, False), (2.6, 5.0, False)]
)
def test_a_load_that_is_pulled_through_its_eyelet_is_told(
    rest_length: float, speed: float, told: bool
) -> None:
    """By a taut cable; one that bounces before it, or flies by a slack cable, is not."""
    model, load = ff.Model("eyelet"), ff.Marker("load")
    model.add(
        ff.RigidBody("load", 1.0, (1.0,) * 3, position=(0, 0, -0.5), velocity=(0, 0, speed)),
        ff.Prismatic("guide", ff.Ground((0.0, 0.0, -0.5)), load, axis=(0.0, 0.0, 1.0)),
        ff.Cable(
            "j",
            [ff.Ground((-1.0, 0.0, 0.0)), ff.Eyelet(ff.Ground()), load],
            axial_stiffness=50.0,
            rest_length=rest_length,
        ),
        ff.SpringDamper("weight", ff.Ground((0.0, 0.0, -9.0)), load, 1.0, preload=12.0),
    )
    texts = warnings_of(model, 1e-2, 0.16)
    start = 'Cable "j": from path[1] to path[2] it turns round in the step to t = 0.09, as where'
    assert [text.startswith(start) for text in texts] == [True] * told


def test_a_cable_that_turns_too_far_in_a_step_is_told() -> None:
    """A wheel whose cable goes round more than two radians a step cannot be followed."""
    model = ff.Model("fast")
    arm = ff.Marker("arm", offset=(1.0, 0.0, 0.0))
    model.add(
        ff.RigidBody("arm", 1.0, (1.0,) * 3, angular_velocity=(0.0, 0.0, 25.0)),
        ff.Revolute("bearing", A, ff.Marker("arm")),
        ff.RigidBody("drum", 1.0, (1.0,) * 3),
        ff.Revolute("still", A, ff.Marker("drum")),
        ff.Cable(
            "j",
            [
                arm,
                ff.Sheave(ff.Ground(), 0.1, (0.0, 0.0, -1.0)),
                ff.Marker("drum", offset=(0.0, 2.0, 0.0)),
            ],
            stiffness=1e-3,
            rest_length=2.0,
        ),
    )
    assert [text for text in warnings_of(model, 0.1, 0.3) if "changes by 2.5 rad" in text]
    assert not np.any(["changes by" in text for text in warnings_of(model, 0.01, 0.05)])
