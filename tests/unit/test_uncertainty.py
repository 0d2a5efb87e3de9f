# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uncertainty to first order: closed forms, samples, and where it is not to be trusted."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli.command import command
from flexfem.gradients.motion.functionals import parse
from tests.histories import columns
from tests.unit.refusals import assert_on_page
from tests.unit.test_fits import MASS, OPTIONS, oscillator

T, AT, SPREAD = 0.6, {"force": 3.0, "speed": 0.5}, {"force": 0.2, "speed": 0.04}
#: Derivatives of the place at the end by force and speed, which are exact.
SLOPES = np.array([T**2 / (2.0 * MASS), T])


def thrown(force, speed):
    """A mass on a slide under a constant force: its place is linear in force and speed."""
    model, bob = ff.Model("thrown"), ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", MASS, (0.1, 0.1, 0.1), velocity=(speed, 0.0, 0.0)),
        ff.Prismatic("slide", ff.Ground(), bob, axis=(1.0, 0.0, 0.0)),
        ff.PointForce("push", bob, (force, 0.0, 0.0)),
        ff.Probe("path", bob, ("x", "square"), lambda t, s: (s.position[0], s.position[0] ** 2)),
    )
    return model


@pytest.mark.three_ranks
def test_linear_motion():
    """Deviation and shares in closed form, of independent parameters and of correlated ones."""
    found = ff.uncertainty(thrown, "final:x", AT, SPREAD, OPTIONS)
    parts = (SLOPES * list(SPREAD.values())) ** 2
    # a deviation that is not squared, or a share of the wrong parameter, is off by a tenth
    assert found.deviation["final:x"] == pytest.approx(parts.sum() ** 0.5, rel=1e-7)
    assert [*found.share["final:x"].values()] == pytest.approx(parts / parts.sum(), rel=1e-7)
    assert found.nonlinearity["final:x"] < 1e-6
    assert not found.warnings
    covariance = np.array([[0.04, -0.007], [-0.007, 0.0016]])
    both = ff.uncertainty(thrown, "final:x", AT, covariance, OPTIONS)
    variance = SLOPES @ covariance @ SLOPES
    assert both.deviation["final:x"] == pytest.approx(variance**0.5, rel=1e-7)
    expected = SLOPES * (covariance @ SLOPES) / variance
    assert [*both.share["final:x"].values()] == pytest.approx(expected, rel=1e-7)
    assert expected.min() < 0.0  # the case is one of shares that are negative
    assert both.nonlinearity["final:x"] < 1e-6


@pytest.mark.serial
def test_samples_have_the_same_deviation():
    """Nine runs at the points of Gauss and Hermite, exact for polynomials of fifth degree."""
    at, spread = {"damping": 12.0, "stiffness": 400.0}, {"damping": 0.6, "stiffness": 12.0}
    found = ff.uncertainty(oscillator, "rms:x", at, spread, OPTIONS)
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    values = [
        parse("rms:x").value(columns(ff.simulate(oscillator(12.0 + 0.6 * a, 400.0 + 12.0 * b),
                                                 OPTIONS)))
        for a in nodes for b in nodes
    ]  # fmt: skip
    both = np.outer(weights, weights).ravel() / weights.sum() ** 2
    mean = both @ values
    # the curvature of the number: first order leaves 0.3 % of the deviation; a derivative by the
    # wrong parameter changes it by more than half
    assert found.deviation["rms:x"] == pytest.approx((both @ (values - mean) ** 2) ** 0.5, rel=5e-3)
    assert abs(found.value["rms:x"] - mean) < 0.1 * found.deviation["rms:x"]
    assert not found.warnings


@pytest.mark.serial
def test_what_is_not_to_be_trusted():
    """The difference is that of the run one deviation aside; a gradient of zero says nothing."""
    at = {"damping": 12.0, "stiffness": 400.0}
    found = ff.uncertainty(oscillator, "final:x", at, {"stiffness": 150.0}, OPTIONS)
    slope = found.gradient.gradient["final:x"]["stiffness"]
    off = [
        columns(ff.simulate(oscillator(12.0, 400.0 + change), OPTIONS))["x"][-1]
        - found.value["final:x"] - slope * change
        for change in (150.0, -150.0)
    ]  # fmt: skip
    ratios = np.abs(off) / found.deviation["final:x"]
    # motions of the check are computed to 1e-9 m; another point gives another ratio
    assert np.abs(ratios - found.nonlinearity["final:x"]).min() < 1e-5
    assert "final:x: a run one standard deviation aside differs by 0.52" in found.warnings[0]
    still = {"force": 0.0, "speed": 0.0}
    flat = ff.uncertainty(thrown, ["final:square", "final:x"], still, SPREAD, OPTIONS)
    assert flat.nonlinearity["final:square"] == np.inf
    assert [text.split(":")[1] for text in flat.warnings] == ["square"]
    blind = ff.uncertainty(oscillator, "final:x", at, {"stiffness": 150.0}, OPTIONS, check=False)
    assert np.isnan(blind.nonlinearity["final:x"])
    assert not blind.warnings


@pytest.mark.serial
def test_frequencies():
    """They are as the root of the stiffness."""

    def build(stiffness):
        return oscillator(0.0, stiffness)

    options = ff.ModeOptions(modes=1)
    found = ff.uncertainty(build, "frequency:1", {"stiffness": 400.0}, {"stiffness": 4.0}, options)
    # derivatives of modes have six digits
    assert found.deviation["frequency:1"] / found.value["frequency:1"] == pytest.approx(
        0.005, rel=1e-5
    )
    # the second derivative of the root: a quarter of the relative deviation
    assert found.nonlinearity["frequency:1"] == pytest.approx(0.0025, rel=0.02)


WRONG = [
    ({"mass": 1.0}, 'spread names "mass", which is no parameter'),
    ({"force": -1.0}, "spread of force must be one standard deviation or 1, none negative, got -1"),
    ({"force": [1.0, 2.0]}, "spread of force must be one standard deviation or 1, none negative"),
    ({"force": np.inf}, "spread of force must be finite, got inf"),
    (np.eye(3), "a covariance matrix must be (2, 2) and finite, got"),
    ([[1.0, 2.0], [2.0, 1.0]], "a covariance matrix must be symmetric without negative"),
    ([[1.0, 0.5], [0.0, 1.0]], "a covariance matrix must be symmetric without negative"),
]


@pytest.mark.serial
@pytest.mark.parametrize(("spread", "text"), WRONG, ids=[text[:24] for _, text in WRONG])
def test_wrong_spreads(spread, text):
    with pytest.raises(ValueError, match=r"^uncertainty: ") as raised:
        ff.uncertainty(thrown, "final:x", AT, spread, OPTIONS)
    assert text in str(raised.value)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_the_command(command_folder, capsys):
    """The table, the file, and one line with exit code 2 for what is wrong."""
    line = ["uncertainty", "tutorial_1_pendulum", "--t-end", "0.01", "--elements", "2"]
    line += ["--of", "final:path_z"]
    assert command([*line, "--std", "gravity=2%", "--within", "rod.velocity[0]=0.1"]) == 0
    printed = capsys.readouterr().out
    assert "0.1962" in printed  # 2 % of gravity
    assert "0.05774" in printed  # 0.1 over the root of 3
    assert "differ from what is linear by" in printed
    assert (command_folder / "results/tutorial_1_pendulum_uncertainty/uncertainty.json").is_file()
    for more, text in (
        ([], "gradient: nothing to derive by, name parameters"),
        (["--std", "gravity"], "--std 'gravity' is not of the form name=0.1 or name=5%"),
        (["--std", "gravity=1", "--within", "gravity=1"], "--within gravity is given twice"),
        (["--std", "gravity=-1%"], "uncertainty: spread of gravity must be"),
    ):
        assert command([*line, *more]) == 2
        error = capsys.readouterr().err.strip().removeprefix("error: ")
        assert error.startswith(text)
        assert "\n" not in error
        assert_on_page(error)
