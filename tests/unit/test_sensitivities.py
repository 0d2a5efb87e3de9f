# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensitivities: derivatives with closed forms, their errors and warnings, wrong input."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.studies import sensitivities as module
from flexfem.studies.differences import OFFSETS, derivative

pytestmark = pytest.mark.serial

# A spring under a load: deflection = load / stiffness.
SPRING = """\
import flexfem as ff


def build(*, stiffness, load, note, place):
    bob = ff.Marker("bob")
    model = ff.Model("spring")
    model.add(
        ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
        ff.Prismatic("slide", ff.Ground(), bob, axis=(1.0, 0.0, 0.0)),
        ff.SpringDamper("spring", ff.Ground(), bob, stiffness=stiffness, rest_length=1.0),
        ff.PointForce("pull", bob, (load, 0.0, 0.0)),
        ff.Probe("path", bob, ("deflection",), lambda t, at: (at.position[0] - 1.0,)),
    )
    return model


CASE = ff.Case(
    name="spring", summary="", build=build, analysis=ff.STATICS,
    options=(
        ff.Option("stiffness", float, 400.0, "", above=0.0),
        ff.Option("load", float, 40.0, ""),
        ff.Option("note", int, 1, ""),
        ff.VectorOption("place", (1.0, 0.0), ""),
    ),
    results=lambda history: {"tip": history["deflection"][-1]},
)
"""


@pytest.fixture
def spring(command_folder: Path) -> str:
    """The case file, in the working directory."""
    (command_folder / "spring.py").write_text(SPRING)
    return "spring.py"


def test_a_deflection_has_the_derivatives_of_its_closed_form(
    spring: str, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "--of tip,final:deflection --wrt stiffness,load,place[0] --output out --jobs 1"
    assert cli.command(["sensitivities", spring, *line.split()]) == 0
    told = capsys.readouterr()
    assert (told.err, len(told.out.splitlines())) == ("", 7)
    found = json.loads(Path("out", "sensitivities.json").read_text())["sensitivities"]
    assert [(one["of"], one["wrt"]) for one in found[:3]] == [
        ("tip", "stiffness"), ("tip", "load"), ("tip", "place[0]"),
    ]  # fmt: skip
    exact = 2 * [-40.0 / 400.0**2, 1.0 / 400.0, 0.0]
    for one, right in zip(found, exact, strict=True):
        assert one["value"] == pytest.approx(0.1, rel=1e-9)
        # a one-sided difference would be off by 1e-2, one without extrapolation by 1e-4
        assert one["derivative"] == pytest.approx(right, rel=1e-8)
        assert abs(one["derivative"] - right) <= one["error"] <= 1e-4 * abs(right)
        assert one["relative"] == pytest.approx(right * one["at"] / 0.1, rel=1e-7)
        assert one["warning"] == ""
    assert Path("out", "sensitivities.csv").read_text().count("\n") == 7


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("--of tip", "nothing to derive"),
        ("--wrt load", "nothing to derive"),
        ("--of max:x --wrt load", "no column 'x'"),
        ("--of top:x --wrt load", "not of the form"),
        ("--of tip --wrt laod", "no option 'laod', did you mean load"),
        ("--of tip --wrt note", "note must be a real number, it is a whole number"),
        ("--of tip --wrt place", "place has components: give place[0] and so on"),
        ("--of tip --wrt place[1]", "place[1] is 0, give the step"),
        ("--of tip --wrt load,load", "load comes twice"),
        ("--of tip --wrt load --step load=x", "--step 'load=x' is not of the form"),
        ("--of tip --wrt load --step load=0", "the step of load must be above 0, got 0.0"),
        ("--of tip --wrt load --step load=1e-12", "lost in the digits of 40"),
        ("--of tip --wrt load --step note=1", "a step of note, which is not among the options"),
        (
            "--of max:t --wrt stiffness --step stiffness=500",
            "stiffness must be a finite number",
        ),
        ("--of tip --wrt load --restart x.h5", "does not take --restart"),
    ],
)
def test_wrong_input_is_one_line(
    line: str, part: str, spring: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def refuse(*_: Any) -> None:  # in place of a process that builds all models
        raise ValueError("no column 'x'")

    monkeypatch.setattr("flexfem.studies.sweep.check_models", refuse)
    assert cli.command(["sensitivities", spring, *line.split(), "--output", "out"]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert part in captured.err
    assert not Path("out").exists()


def test_errors_of_differences() -> None:
    """The error is that of the value, by truncation or noise; a kink is noticed."""

    def of(function: Callable[[Any], Any], step: float = 0.1) -> Any:
        places = 1.0 + step * np.array(OFFSETS)
        return derivative(list(places), list(function(places)))

    quartic = of(lambda x: x**4)
    assert quartic.value == pytest.approx(4.0, rel=1e-12)  # exact up to the fifth power
    assert quartic.truncation == pytest.approx(0.01, rel=1e-6)  # 4 x h^2 / 4
    assert not of(np.exp).poor
    fast = of(lambda x: np.sin(20.0 * x))
    assert fast.poor
    assert abs(fast.value - 20.0 * np.cos(20.0)) < fast.error
    rng = np.random.default_rng(1)
    rough = of(lambda x: x + 1e-6 * rng.standard_normal(5), 1e-5)
    assert rough.poor
    assert rough.noisy
    assert of(lambda x: abs(x - 1.0)).poor
    flat = of(lambda x: 0.0 * x + 3.0)
    assert (flat.value, flat.error, flat.poor) == (0.0, 0.0, False)


def test_a_second_step_and_failed_runs(spring: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps become longer where noise counts; runs that fail are named, and only theirs fail."""

    def runs(case: str, vary: dict[str, list[float]], **_: Any) -> Iterator[Any]:
        for load, stiffness in zip(vary["load"], vary["stiffness"], strict=True):
            tip = round(load / 399.0, 4) + stiffness
            failed = stiffness > 401.0
            yield {}, {"status": "failed: no" if failed else "ok", "deflection_final": tip}

    monkeypatch.setattr(module, "sweep", runs)
    found = ff.sensitivities(spring, ["final:deflection"], ["load", "stiffness"])
    assert (found[0].step, found[1].step) == (2.0, 4.0)
    assert found[0].derivative == pytest.approx(1.0 / 399.0, abs=found[0].error)
    assert "drowns in deviations" in found[0].warning
    assert np.isnan(found[1].derivative)
    assert found[1].warning == "stiffness=402.0: failed: no"
    given = ff.sensitivities(
        spring, ["final:deflection"], ["load", "stiffness"], steps={"load": 0.1, "stiffness": 1.0}
    )
    assert given[0].step == 0.1
    assert given[1].derivative == pytest.approx(1.0, rel=1e-9)
    with pytest.raises(RuntimeError, match="as they are: failed: no"):
        ff.sensitivities(
            spring, ["final:deflection"], ["load", "stiffness"], options={"stiffness": 500.0}
        )
