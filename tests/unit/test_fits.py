# SPDX-License-Identifier: LGPL-3.0-or-later
"""Minimisation over parameters and identification: an oscillator with closed forms."""

import sys
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.io.evaluations import read_evaluations
from tests.histories import columns
from tests.unit.refusals import assert_on_page

MASS, OPTIONS = 2.0, ff.RunOptions(dt=0.01, t_end=0.6, rho_inf=1.0)
COARSE = ff.RunOptions(dt=0.02, t_end=0.5, rho_inf=1.0)


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


@pytest.mark.slow
@pytest.mark.serial
def test_minimum_between_bounds():
    """The best damper is sqrt(k m) = 28.3 N s/m; with less allowed it is the most."""
    found = ff.minimize(oscillator, "integral:square", {"damping": 12.0}, OPTIONS)
    assert found.success
    # steps of 10 ms and the end at 0.6 s are off by 1 %; a gradient of the wrong sign ends at 0
    assert found.values["damping"] == pytest.approx(28.28, rel=0.02)
    held = ff.minimize(
        oscillator, "integral:square", {"damping": 19.0}, OPTIONS, bounds={"damping": (0.0, 20.0)}
    )
    assert held.values["damping"] == pytest.approx(20.0, abs=1e-9)
    assert held.value > found.value


@pytest.mark.slow
@pytest.mark.serial
def test_minimum_with_a_constraint_and_a_cost(shared_tmp_path):
    """The cheapest damper for which the mass does not overshoot by more than 20 mm."""
    found = ff.minimize(
        oscillator, ff.Functional("none", (), lambda h: 0.0, lambda h: np.zeros((0, len(h["t"])))),
        {"damping": 30.0}, OPTIONS, constraints=[("min:x", -0.02, None), ("min:x", None, 0.2)],
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


def braked(damping):
    """With a column for the deflection below zero."""
    model = oscillator(damping)
    model.add(ff.Probe("under", ff.Marker("bob"), ("below",), lambda t, s: (1.0 - s.position[0],)))
    return model


def cheapest(*, build=braked, of=("ks:below", None, 0.02), start=30.0, **more):
    """The weakest damper with which the mass overshoots by no more than is allowed."""
    return ff.minimize(
        build, None, {"damping": start}, COARSE, constraints=[of], ks_rho=2000.0, tolerance=1e-8,
        cost=lambda damping: (damping, {"damping": 1.0}), **more,
    )  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize(
    ("method", "package"), [("SLSQP", "scipy"), ("MMA", "nlopt"), ("IPOPT", "cyipopt")]
)
def test_constraint_over_all_times(method, package):
    """A smooth maximum, which is below the largest value by log(26)/2000 at most."""
    pytest.importorskip(package)
    found = cheapest(method=method)
    assert found.success
    below = columns(ff.simulate(braked(found.values["damping"]), COARSE))["below"]
    smooth = below.max() + np.log(np.exp(2000.0 * (below - below.max())).mean()) / 2000.0
    # the bound is active, and is that of the smooth maximum: the largest value is 10 % more
    assert smooth == pytest.approx(0.02, rel=1e-4)
    assert 0.021 < below.max() < 0.02 + np.log(26) / 2000.0


@pytest.mark.serial
def test_best_of_few_gradients_keeps_the_constraint():
    """Of points that keep it the best one, although others are better without it."""
    found = cheapest(start=45.0, most=4)
    kept = [row for row in found.history if row["ks:below"] <= 0.02 * (1.0 + 1e-6)]
    assert 0 < len(kept) < len(found.history)
    assert found.value == min(row["objective"] for row in kept)


@pytest.mark.slow
def test_interrupted_minimisation_goes_on(shared_tmp_path):
    """The way is the same to the last digit, and no gradient is computed twice."""
    straight = cheapest(output=shared_tmp_path / "straight")
    built, folder = [], shared_tmp_path / "folder"

    def stopped(damping):
        built.append(damping)
        if len(built) == 8:  # in the third gradient, each of which takes a model and two beside it
            raise KeyboardInterrupt
        return braked(damping)

    with pytest.raises(KeyboardInterrupt):
        cheapest(build=stopped, output=folder)
    built.clear()

    def counted(damping):
        built.append(damping)
        return braked(damping)

    on = cheapest(build=counted, output=folder, restart=folder / "optimisation.jsonl")
    assert on.values == straight.values
    assert on.history == straight.history
    # the first evaluation is compared
    assert len(built) == 1 + 3 * (len(on.history) - 2)
    if MPI.COMM_WORLD.rank == 0:
        texts = [one.read_text() for one in shared_tmp_path.glob("*/optimisation.jsonl")]
        assert texts[0] == texts[1]
        broken = folder / "broken.jsonl"  # ended in the middle of a line
        broken.write_text(texts[0][:-10])
        assert len(read_evaluations(broken)[1]) == len(on.history) - 1
    MPI.COMM_WORLD.Barrier()


@pytest.mark.serial
def test_file_of_another_minimisation(shared_tmp_path):
    file = shared_tmp_path / "optimisation.jsonl"
    cheapest(most=1, output=shared_tmp_path)
    refused = [
        (
            {"build": lambda damping: oscillator(damping, 410.0), "of": ("min:x", -0.02, None)},
            "is of 'ks:below' by 1 numbers, not of min:x by 1",
        ),
        (
            {"build": lambda damping: braked(1.01 * damping)},
            "is of another model or other options: ks:below is",
        ),
    ]
    for given, text in refused:
        with pytest.raises(ValueError, match=r"^minimize: restart '") as raised:
            cheapest(**given, restart=file)
        assert text in str(raised.value)
        assert_on_page(str(raised.value))


@pytest.mark.serial
@pytest.mark.parametrize(("method", "package"), [("MMA", "nlopt"), ("IPOPT", "cyipopt")])
def test_methods_whose_package_is_missing(method, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"^{package} is not installed, but required") as raised:
        cheapest(method=method)
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_most_gradients():
    found = ff.minimize(oscillator, "integral:square", {"damping": 12.0}, OPTIONS, most=2)
    assert not found.success
    assert found.message == "2 gradients were computed"
    assert found.gradients <= 3


@pytest.mark.serial
def test_what_measurements_do_not_tell():
    """Of two springs side by side they tell the sum: both have infinite errors, the damper has not.

    The pseudoinverse of the normal equations gives errors of the sum to each of them.
    """

    def build(damping, first, second):
        return oscillator(damping, first + second[0])

    exact = columns(ff.simulate(oscillator(15.0, 380.0), COARSE))["x"]
    start = {"damping": 12.0, "first": 200.0, "second": [170.0, 1.0]}
    found = ff.identify(build, {"x": exact}, start, COARSE, noise={"x": 1e-3}, most=6)
    assert found.values["damping"] == pytest.approx(15.0, rel=1e-6)
    assert found.values["first"] + found.values["second"][0] == pytest.approx(380.0, rel=1e-6)
    assert np.isinf(found.errors["first"])
    assert np.isinf(found.errors["second"]).all()
    # that of the damper alone and the sum
    assert 0.0 < found.errors["damping"] < 0.1
    assert [text.split('"')[1] for text in found.warnings] == ["first", "second"]
    assert "[0, 1]" in found.warnings[1]
    for text in found.warnings:
        assert_on_page(text)


def test_measurements_that_tell_nothing():
    """A parameter that does not reach the model keeps its start, with an infinite error."""
    measured = {"x": np.zeros(4)}
    options = ff.RunOptions(dt=0.02, t_end=0.06, rho_inf=1.0)
    found = ff.identify(lambda forgotten: oscillator(15.0), measured, {"forgotten": 3.0}, options)
    assert not found.success
    assert found.message == "the measurements do not change with any parameter"
    assert (found.values["forgotten"], found.errors["forgotten"]) == (3.0, np.inf)
    assert found.motions == 1
    (text,) = found.warnings
    assert 'do not tell "forgotten"' in text


@pytest.mark.slow
@pytest.mark.serial
def test_the_end_of_a_fit_does_not_depend_on_units():
    """Of a motion without noise, as if it were measured in km: values to ten digits all the same.

    A bound on the gradient of the sum of squares, which has units, ends the search after a digit.
    """
    exact = 1e-3 * columns(ff.simulate(oscillator(15.0), COARSE))["x"]

    def build(damping):
        model, bob = oscillator(damping), ff.Marker("bob")
        model.add(ff.Probe("far", bob, ("km",), lambda t, s: (1e-3 * (s.position[0] - 1.0),)))
        return model

    found = ff.identify(build, {"km": exact}, {"damping": 10.0}, COARSE)
    assert found.values["damping"] == pytest.approx(15.0, rel=1e-7)


@pytest.mark.slow_on_ranks
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
    given = ff.identify(oscillator, {"x": measured}, found.values, OPTIONS, noise={"x": 2e-3})
    ratio = given.errors["damping"] / found.errors["damping"]
    assert ratio == pytest.approx(2e-3 / found.noise, rel=1e-3)


@pytest.mark.slow
@pytest.mark.serial
def test_what_is_known_before():
    """Two springs side by side, of which one is known: means and errors of linear Gaussian theory.

    A prior in other units than the scaled parameters, or one that does not count among the
    measurements, moves the values by parts of them, and the errors by factors.
    """

    def build(first, second):
        return oscillator(15.0, first + second)

    exact = columns(ff.simulate(oscillator(15.0, 380.0), COARSE))["x"]
    noise, start = {"x": 1e-3}, {"first": 210.0, "second": 160.0}
    (total,) = ff.identify(
        partial(oscillator, 15.0), {"x": exact}, {"stiffness": 370.0}, COARSE, noise=noise
    ).errors.values()
    found = ff.identify(
        build, {"x": exact}, start, COARSE, noise=noise, scale={"first": 100.0},
        prior={"first": (200.0, 5.0)},
    )  # fmt: skip
    assert found.warnings == ()
    assert found.values["first"] == pytest.approx(200.0, rel=1e-6)
    assert found.values["second"] == pytest.approx(180.0, rel=1e-6)
    assert found.errors["first"] == pytest.approx(5.0, rel=1e-6)
    assert found.errors["second"] == pytest.approx(np.hypot(5.0, total), rel=1e-4)
    # exact measurements, and a prior that agrees, leave nothing over
    assert found.noise < 1e-3


#: A spring that is softer by a third at the start: after 2.5 s its mass is a period behind.
LONG = ff.RunOptions(dt=0.05, t_end=2.5, rho_inf=1.0)
BEHIND = {"damping": 1.0, "stiffness": 270.0}
ROUGHLY = {"damping": (1.0, 1.0), "stiffness": (270.0, 200.0)}


def behind(**more):
    """The fit to the exact motion."""
    exact = columns(ff.simulate(oscillator(0.5, 400.0), LONG))["x"]
    return ff.identify(
        oscillator, {"x": exact}, BEHIND, LONG, noise={"x": 1e-4}, prior=ROUGHLY, **more
    )


@pytest.mark.slow
def test_a_fit_to_the_whole_motion_at_once():
    """It ends in a minimum with another number of periods."""
    assert abs(behind(most=8).values["stiffness"] / 400.0 - 1.0) > 0.05


@pytest.mark.slow
@pytest.mark.slow_on_ranks
def test_a_fit_that_advances():
    """One whose motions all have the full length, or that forgets what it has found, ends there."""
    found = behind(advance=0.5)
    # motions become longer, the last ones have all rows and the result
    ends = [row["t_end"] for row in found.history]
    assert ends[:3] == pytest.approx([0.5, 1.0, 1.5])
    assert ends == sorted(ends)
    assert ends[-1] == 2.5
    assert len(ends) == found.motions
    assert found.history[0]["change"] == 0.0 < found.history[1]["change"]
    # the prior moves it by less than its deviation of 1e-2 over 200
    assert found.values["stiffness"] == pytest.approx(400.0, rel=1e-5)
    assert found.success
    assert found.motions < 20


@pytest.mark.slow
@pytest.mark.slow_on_ranks
def test_samples_that_are_missing():
    """A column from 0.9 s on, every other row: as if nothing else had been computed.

    Rows that count as zero, or motions without samples, move the stiffness by per cents.
    """
    options = ff.RunOptions(dt=0.05, t_end=2.5, rho_inf=1.0)
    exact = columns(ff.simulate(oscillator(0.5, 400.0), options))["x"]
    exact[:18] = exact[1::2] = np.nan
    found = ff.identify(
        oscillator, {"x": exact}, {"damping": 0.6, "stiffness": 380.0}, options, advance=0.5,
        noise={"x": 1e-4}, prior={"damping": (0.6, 1.0), "stiffness": (380.0, 200.0)},
    )  # fmt: skip
    assert found.values["stiffness"] == pytest.approx(400.0, rel=1e-5)
    # the first motion has samples
    assert found.history[0]["t_end"] == pytest.approx(1.35)


ZEROS = {"x": np.zeros(61)}
WRONG = [
    (lambda: ff.misfit({}), "give values of a column at least"),
    (lambda: ff.misfit({"x": [1.0]}, {"x": 0.0}), "scale of x must be positive, got 0.0"),
    (lambda: _minimize(objective=ff.misfit({"x": [1.0]})), "x has 61 rows, got 1 values"),
    (lambda: _minimize(bounds={"mass": (0, 1)}), 'bounds names "mass", which is no parameter'),
    (lambda: _minimize(bounds={"damping": (20, 30)}), "damping must lie within its bounds"),
    (lambda: _minimize(scale={"damping": -1.0}), "scale of damping must be positive, got"),
    (lambda: _minimize(method="BFGS"),
     'method must be one of "L-BFGS-B", "SLSQP", "MMA", "IPOPT", got'),
    (lambda: _minimize(method="L-BFGS-B", constraints=[("min:x", 0.0, None)]),
     'method must be one of "SLSQP", "MMA", "IPOPT", got'),
    (lambda: _minimize(objective=None), "without an objective give a cost and constraints"),
    (lambda: _minimize(objective="ks:x"), "gradient: ks:x needs a positive ks_rho, got None"),
    (lambda: _minimize(restart="nowhere"), "optimisation 'nowhere': No such file"),
    (lambda: _minimize(restart=__file__), "holds no evaluations of an optimisation"),
    (lambda: _identify({}), "give measured values of a column at least"),
    (lambda: _identify({"x": [1.0]}), "x has 61 rows, got 1 values"),
    (lambda: _identify({"x": [1.0]}, noise={"v": 1.0}), 'noise names "v", which is not measured'),
    (lambda: _identify({"x": [1.0]}, noise={"x": 0.0}), "noise of x must be positive, got 0.0"),
    (lambda: _identify({"x": [1.0]}, bounds={"q": (0, 1)}), 'bounds names "q", which is no'),
    (lambda: _identify({"x": [1.0]}, scale={"q": 1.0}), 'scale names "q", which is no parameter'),
    (lambda: _identify({"x": [1.0]}, scale={"damping": 0.0}), "scale of damping must be positive"),
    (lambda: _identify({"x": [1.0]}, prior={"damping": (12.0, 1.0)}), "a prior needs noise"),
    (lambda: _known(q=(12.0, 1.0)), 'prior names "q", which is no parameter'),
    (lambda: _known(damping=([12.0], 1.0)), "prior of damping must be numbers or have the shape"),
    (lambda: _known(damping=(12.0, 0.0)), "prior of damping must have finite means and positive"),
    (lambda: _known(damping=(np.nan, 1.0)), "prior of damping must have finite means and"),
    (lambda: _identify({"x": [np.nan]}), "measured values of x must be finite numbers, NaN where"),
    (lambda: _identify({"x": [np.inf]}), "measured values of x must be finite numbers, NaN where"),
    (lambda: _identify({"x": ["one"]}), "measured values of x must be finite numbers, NaN where"),
    (lambda: _minimize(report=3), "report must be a function, got 3"),
    (lambda: _minimize(cost={"damping": 1.0}), "cost must be a function, got "),
    (lambda: _minimize(start={"mass": 1.0}), "start names mass, but build takes damping, "),
    (lambda: _identify(ZEROS, report="print"), "report must be a function, got 'print'"),
    (lambda: _identify(ZEROS, start={"damping": 1.0, "mass": 1.0}), "start names damping, mass, "),
    (lambda: _identify({"x": [1.0]}, most=0), "most must be at least 1, got 0"),
    (lambda: _identify({"x": [1.0]}, tolerance=0.0), "tolerance must be positive, got 0.0"),
    (lambda: _identify(ZEROS, bounds={"damping": 3.0}), "bounds of damping must be a least and"),
    (lambda: _identify(ZEROS, bounds={"damping": (20, 3)}), "bounds of damping must be a least"),
    (lambda: _identify(ZEROS, bounds={"damping": (20, 30)}), "damping must lie within its bounds"),
    (lambda: _known(damping=12.0), "prior of damping must be a mean and a deviation, got 12.0"),
    # of half as many samples, the motion would have steps of twice the size
    (lambda: _known({"x": np.zeros(31)}, 0.1, damping=(12.0, 1.0)), "x has 61 rows, got 31"),
    (lambda: _minimize(cost=lambda damping: 1.0), "cost must return a finite number and its"),
    (lambda: _minimize(cost=lambda damping: (np.nan, {})), "cost must return a finite number and"),
    # the derivative would count as zero
    (lambda: _minimize(cost=lambda damping: (1.0, {"mass": 1.0})),
     'the derivative of cost names "mass", which is no parameter'),
    (lambda: _minimize(most=0), "most must be at least 1, got 0"),
    (lambda: _minimize(tolerance=np.nan), "tolerance must be finite, got nan"),
    (lambda: _minimize(bounds={"damping": (np.nan, 20)}), "bounds of damping must be a least and"),
    (lambda: _minimize(constraints=[("min:x", 0.0)]), "bounds of 'min:x' must be a least and a"),
    (lambda: _minimize(constraints=[("min:x", 1.0, 0.0)]), "bounds of 'min:x' must be a least"),
    (lambda: _identify({"x": [1.0]}, advance=0.1), "an advance needs a prior of every parameter"),
    (lambda: _identify({"x": [1.0]}, advance=0.001), "an advance must be a step at least, got"),
    (lambda: _identify({"x": [1.0]}, noise={"x": 1.0}, prior={"damping": (12.0, 1.0)}, advance=0.1,
                       bounds={"damping": (0, 20)}), "an advance takes neither bounds nor"),
]  # fmt: skip


def _minimize(objective="final:x", start=None, **more):
    return ff.minimize(oscillator, objective, start or {"damping": 12.0}, OPTIONS, **more)


def _identify(measured, start=None, **more):
    return ff.identify(oscillator, measured, start or {"damping": 12.0}, OPTIONS, **more)


def _known(measured=None, advance=None, **prior):
    measured = measured or {"x": [1.0]}
    return _identify(measured, noise={"x": 1.0}, prior=prior, advance=advance)


@pytest.mark.serial
@pytest.mark.parametrize(("make", "text"), WRONG, ids=[text[:20] for _, text in WRONG])
def test_wrong_arguments(make, text):
    with pytest.raises(
        (TypeError, ValueError), match=r"^(misfit|minimize|identify|gradient|optim\w+)\b"
    ) as raised:
        make()
    assert text in str(raised.value)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


@pytest.mark.serial
@pytest.mark.parametrize(
    ("value", "by", "text"),
    [
        (np.nan, 1.0, '"mine" is nan'),
        (1.0, np.nan, 'the derivative of "mine" by "x" is no number'),
    ],
)
def test_functionals_that_are_no_numbers(value, by, text):
    """A search that takes them for numbers ends with success where it began."""
    mine = ff.Functional(
        "mine", ("x",), lambda history: value, lambda history: by * history["x"][np.newaxis]
    )
    with pytest.raises((RuntimeError, ValueError), match=text) as told:
        ff.minimize(oscillator, mine, {"damping": 10.0}, COARSE)
    assert_on_page(str(told.value))
