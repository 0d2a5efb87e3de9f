# SPDX-License-Identifier: LGPL-3.0-or-later
"""Minimisation over parameters and identification: an oscillator with closed forms."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.histories import columns
from tests.unit.refusals import assert_on_page

MASS, OPTIONS = 2.0, ff.RunOptions(dt=0.01, t_end=0.6, rho_inf=1.0)


def oscillator(damping, stiffness=400.0) -> ff.Model:
    model, bob = ff.Model("oscillator"), ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", MASS, (0.1, 0.1, 0.1), position=(1.2, 0.0, 0.0)),
        ff.Prismatic("slide", ff.Ground(), bob, axis=(1.0, 0.0, 0.0)),
        ff.SpringDamper(
            "buffer", ff.Ground(), bob, stiffness=stiffness, damping=damping, rest_length=1.0
        ),
        ff.Probe("path", bob, ("x", "v"), lambda t, s: (s.position[0] - 1.0, s.velocity[0])),
        ff.Probe("square", bob, ("square",), lambda t, s: ((s.position[0] - 1.0) ** 2,)),
    )
    return model


def test_minimum_between_bounds():
    """The best damper is sqrt(k m) = 28.3 N s/m; with less allowed it is the most."""
    found = ff.minimize(oscillator, "integral:square", {"damping": 12.0}, OPTIONS)
    assert found.success
    # steps of 10 ms and the end at 0.6 s are off by 1 %; a gradient of the wrong sign ends at 0
    assert found.values["damping"] == pytest.approx(28.28, rel=0.02)
    held = ff.minimize(
        oscillator, "integral:square", {"damping": 12.0}, OPTIONS, bounds={"damping": (0.0, 20.0)}
    )
    assert held.values["damping"] == pytest.approx(20.0, abs=1e-9)
    assert held.value > found.value


def test_minimum_with_a_constraint_and_a_cost(shared_tmp_path):
    """The cheapest damper for which the mass does not overshoot by more than 20 mm."""
    found = ff.minimize(
        oscillator, ff.Functional("none", (), lambda h: 0.0, lambda h: np.zeros((0, len(h["t"])))),
        {"damping": 30.0}, OPTIONS, constraints=[("min:x", -0.02, None)],
        cost=lambda damping: (damping, {"damping": 1.0}), tolerance=1e-8, output=shared_tmp_path,
    )  # fmt: skip
    ratio = float(found.values["damping"]) / (2.0 * np.sqrt(400.0 * MASS))
    overshoot = 0.2 * np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2))
    # the least of the rows is 1 % less than the least of the motion
    assert overshoot == pytest.approx(0.02, rel=0.03)
    if MPI.COMM_WORLD.rank == 0:
        lines = (shared_tmp_path / "optimisation.csv").read_text().splitlines()
        assert len(lines) == 1 + found.gradients
        assert lines[0] == "objective,min:x"


def test_most_gradients():
    found = ff.minimize(oscillator, "integral:square", {"damping": 12.0}, OPTIONS, most=2)
    assert not found.success
    assert found.message == "2 gradients were computed"
    assert found.gradients <= 3


def test_identified_parameters_lie_within_their_errors():
    """Damping and stiffness of a noisy measurement, and the noise itself."""
    truth = {"damping": 15.0, "stiffness": 380.0}
    exact = columns(ff.simulate(oscillator(**truth), OPTIONS))["x"]
    noise = 1e-3 * np.random.default_rng(3).standard_normal(len(exact))
    measured = exact + noise
    measured[5] = np.nan  # a value that is missing
    start = {"damping": 10.0, "stiffness": 420.0}
    found = ff.identify(oscillator, {"x": measured}, start, OPTIONS)
    assert found.success
    # the standard deviation of 59 free numbers is known to 10 %
    assert found.noise == pytest.approx(1e-3, rel=0.25)
    for name, value in truth.items():
        low, high = found.interval(name, 0.999)
        assert low < value < high
        # errors that are ten times too large would hide anything
        assert high - low < 0.4 * value
    given = ff.identify(oscillator, {"x": measured}, start, OPTIONS, noise={"x": 2e-3})
    ratio = given.errors["damping"] / found.errors["damping"]
    assert ratio == pytest.approx(2e-3 / found.noise, rel=1e-3)


WRONG = [
    (lambda: ff.misfit({}), "give values of a column at least"),
    (lambda: ff.misfit({"x": [1.0]}, {"x": 0.0}), "scale of x must be positive, got 0.0"),
    (lambda: _minimize(objective=ff.misfit({"x": [1.0]})), "x has 61 rows, got 1 values"),
    (lambda: _minimize(bounds={"mass": (0, 1)}), 'bounds names "mass", which is no parameter'),
    (lambda: _minimize(bounds={"damping": (20, 30)}), "damping must lie within its bounds"),
    (lambda: _minimize(scale={"damping": -1.0}), "scale of damping must be positive, got"),
    (lambda: _minimize(method="BFGS"), 'method must be "L-BFGS-B" or "SLSQP", got'),
    (lambda: _identify({}), "give measured values of a column at least"),
    (lambda: _identify({"x": [1.0]}), "x has 61 rows, got 1 values"),
    (lambda: _identify({"x": [1.0]}, noise={"v": 1.0}), 'noise names "v", which is not measured'),
    (lambda: _identify({"x": [1.0]}, noise={"x": 0.0}), "noise of x must be positive, got 0.0"),
    (lambda: _identify({"x": [1.0]}, bounds={"q": (0, 1)}), 'bounds names "q", which is no'),
]  # fmt: skip


def _minimize(objective="final:x", **more):
    return ff.minimize(oscillator, objective, {"damping": 12.0}, OPTIONS, **more)


def _identify(measured, **more):
    return ff.identify(oscillator, measured, {"damping": 12.0}, OPTIONS, **more)


@pytest.mark.serial
@pytest.mark.parametrize(("make", "text"), WRONG, ids=[text[:20] for _, text in WRONG])
def test_wrong_arguments(make, text):
    with pytest.raises(ValueError, match=r"^(misfit|minimize|identify): ") as raised:
        make()
    assert text in str(raised.value)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))
