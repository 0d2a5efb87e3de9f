# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers that Python takes and nobody means: truth values, huge integers, 1_0, tiny directions."""

from collections.abc import Callable
from typing import Any

import pytest

import flexfem as ff
from flexfem.cli import command
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

HUGE, ENDLESS = 10**400, 10**5000
GROUND, BODY = ff.Ground(), ff.Marker("b")
CURVE = ff.NurbsCurve.line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
LINE = {"a": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}
COUNT, SIZE = ff.Option("count", int, 1, "number"), ff.Option("size", float, 1.0, "length")


def body(**given: Any) -> ff.RigidBody:
    return ff.RigidBody("b", **{"mass": 1.0, "inertia": (1.0, 1.0, 1.0)} | given)


def hinge(*axis: float) -> ff.Revolute:
    return ff.Revolute("r", GROUND, BODY, axis=axis)


REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: body(mass=HUGE), "mass must be finite, got 1000"),
    (lambda: body(mass=ENDLESS), "mass must be finite, got an integer of thousands of digits"),
    (lambda: body(inertia=(1, 1, HUGE)), "inertia must hold 3 numbers"),
    (lambda: body(position=(0, 0, -HUGE)), "position must hold 3 numbers"),
    (lambda: ff.SmoothStep(0, 1, HUGE, 2), "must be finite"),
    (lambda: ff.RunOptions(dt=HUGE, t_end=1.0), "dt must be a finite number"),
    (lambda: ff.RunOptions(dt=0.1, t_end=1.0, every=HUGE), "every must be a whole number >= 1"),
    (lambda: ff.RunOptions(dt=0.1, t_end=1.0, every=ENDLESS), "every must be a whole number"),
    (lambda: ff.RunOptions(dt=0.1, t_end=1.0, every=2**63), "every must be a whole number"),
    (
        lambda: ff.LineMesh.straight(LINE, elements=True),
        "elements must be a whole number, got True",
    ),
    (lambda: ff.LineMesh.straight(LINE, elements=2.0), "elements must be a whole number, got 2.0"),
    (
        lambda: ff.LineMesh.straight(LINE, HUGE),
        "elements must be a whole number of 64 bits, got 1000",
    ),
    (
        lambda: ff.LineMesh.straight(LINE, -ENDLESS),
        "64 bits, got an integer of thousands of digits",
    ),
    (lambda: ff.LineMesh.straight(LINE, 2**63), "elements must be a whole number of 64 bits"),
    (lambda: CURVE.with_continuity(HUGE), "continuity must be a whole number of 64 bits"),
    (lambda: CURVE.refine(HUGE), "elements must be a whole number of 64 bits"),
    (lambda: ff.build_mesh("chain", links=HUGE), "links must be finite"),
    (lambda: ff.build_mesh("chain", links=10**30), "links must be a whole number of 64 bits"),
    (lambda: ff.RunOptions(dt=0.1, t_end=1.0, every=True), "every must be a whole number"),
    (lambda: ff.Event("e", BODY, lambda t, b: t, ff.Stop(), direction=True), "must be -1, 0 or 1"),
    (lambda: hinge(1e-300, 0.0, 0.0), "axis must be of a length between 1e-150 and 1e+150"),
    (lambda: hinge(0.0, 1e300, 1.0), "axis must be of a length between 1e-150 and 1e+150"),
    (lambda: ff.ModeOptions(axis="1e-300,0,0"), "axis must be of a length between"),
    (lambda: ff.ModeOptions(axis="1_0,0,0"), "axis must be x, y, z or three finite numbers"),
    (lambda: COUNT.parse("1_0"), "must be a whole number, got '1_0'"),
    (lambda: COUNT.parse("٣"), "must be a whole number, got '٣'"),
    (lambda: COUNT.parse("1" + 400 * "0"), "must be a whole number, got '1000"),
    (lambda: SIZE.parse("1_0.5"), "must be a finite number, got '1_0.5'"),
    (lambda: SIZE.parse("1\0"), "must be a finite number"),
]


@pytest.mark.parametrize(("make", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_refused_in_one_line(make: Callable[[], object], words: str) -> None:
    with pytest.raises((ValueError, TypeError)) as raised:
        make()
    text = str(raised.value)
    assert words in text
    assert "\n" not in text
    assert_on_page(text if ":" in text else f"argument --x: {text}")


def test_what_is_meant_is_taken() -> None:
    assert hinge(0.0, 0.0, 1e-140).direction == pytest.approx((0.0, 0.0, 1.0), abs=1e-15)
    assert (COUNT.parse("10"), COUNT.parse("-3"), SIZE.parse("1e-3")) == (10, -3, 1e-3)


def test_case_run_takes_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    """Progress is shown on demand, by lines here."""

    def build() -> ff.Model:
        model = ff.Model("falls")
        model.add(body(), ff.Gravity((0.0, 0.0, -9.81)), ff.PositionProbe("path", BODY))
        return model

    case = ff.Case(name="falls", summary="", build=build, dt=1e-2, t_end=5e-2)
    assert case.run(quiet=True).status == "ok"
    assert capfd.readouterr().err == ""
    assert case.run(quiet=False, progress="lines").status == "ok"
    assert "t = 0.05 of 0.05 s" in capfd.readouterr().err
    with pytest.raises(TypeError, match="case 'falls': quiet must be a bool, got 1"):
        case.run(quiet=1)


@pytest.mark.parametrize("name", ["r\udce9sultats", "a\0b"])
def test_names_that_are_no_text_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match="is not UTF-8; rename the file or folder") as raised:
        ff.RunOptions(dt=0.1, t_end=1.0, output=f"/tmp/{name}/out")
    assert str(raised.value).isascii()
    assert_on_page(str(raised.value))


@pytest.mark.usefixtures("command_folder")
def test_command_line_that_is_no_text_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["run", "heavy_top", "--output", "r\udce9sultats"]
    assert command(line) == 2
    assert capsys.readouterr().err == (
        "error: 'r\\udce9sultats' is not UTF-8; rename the file or folder\n"
    )
