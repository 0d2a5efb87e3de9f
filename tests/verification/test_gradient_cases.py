# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cases whose parameters are found by gradients, in short forms: closed forms, tables, ranks."""

import csv
import json
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.core.differences import STENCIL
from tests.histories import columns
from tests.unit.refusals import assert_on_page

COMM = MPI.COMM_WORLD


def table(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text().splitlines()))


@pytest.mark.slow
@pytest.mark.slow_on_ranks
def test_strongest_column(shared_tmp_path: Path) -> None:
    """Keller's 4/3, and his areas between the thin ends; the tables and both runs are there."""
    case, count = load_case("optimal_column"), 12
    outcome = case.run(
        elements=count, iterations=3, load_steps=1, split_above=1, output=shared_tmp_path
    )
    assert outcome.status == "ok"
    load = COMM.bcast(outcome.summary["results"])["load"]
    # the same on any number of ranks, to the rounding of differences of matrices
    assert load == pytest.approx(1.3267861, abs=1e-6)
    # 12 elements of constant areas lack 1 %; the uniform column has 1
    assert load == pytest.approx(4.0 / 3.0, rel=0.02)
    if COMM.rank:
        return
    rows = table(shared_tmp_path / "parameters.csv")
    assert [row["name"] for row in rows] == ["areas"] * (count // 2)
    assert {float(row["start"]) for row in rows} == {1e-4}
    found = np.array([float(row["found"]) for row in rows])
    a = np.linspace(0.0, 0.5 * np.pi, 501)
    keller = 4.0 / 3.0 * np.sin(a) ** 2
    x = (a - 0.5 * np.sin(2.0 * a)) / np.pi
    ends = 0.5 * np.linspace(0.0, 1.0, count // 2 + 1) ** 1.7
    middles = np.interp(0.5 * (ends[1:] + ends[:-1]), x, keller)
    # a uniform column is off by a third there; elements have the mean of a curved profile
    np.testing.assert_allclose(found[2:] / 1e-4, middles[2:], rtol=0.03)
    assert len(table(shared_tmp_path / "iterations.csv")) == 3
    loads = [
        json.loads((shared_tmp_path / folder / "summary.json").read_text())["buckling"][0]
        for folder in ("start", ".")
    ]
    assert loads == pytest.approx([1.0, load], rel=0.01)


@pytest.mark.slow
@pytest.mark.serial
def test_blade_of_uniform_stress(shared_tmp_path: Path) -> None:
    """All elements reach the stress, and areas are those of the formula at their middles."""
    outcome = load_case("uniform_stress_blade").run(elements=4, output=shared_tmp_path)
    assert outcome.status == "ok"
    found = COMM.bcast(outcome.summary["results"])
    # four elements of constant areas: 3.5 %, by the square of their length; the uniform blade is
    # heavier by a third, and its areas are off by the whole difference
    assert found["mass_over_best"] == pytest.approx(1.0, rel=0.05)
    assert found["areas_off"] < 0.05
    if COMM.rank:
        return
    stresses = [row["stress"] for row in table(shared_tmp_path / "history.csv")]
    # a search that ends early leaves one below its limit, or above it
    assert float(stresses[-1]) == pytest.approx(2e8, rel=1e-6)


@pytest.mark.slow
def test_profile_of_a_flexure(shared_tmp_path: Path) -> None:
    """Less stress at the same turn; the round notch turns as by Paros' and Weisbord's formula."""
    outcome = load_case("design_of_a_flexure").run(
        numbers=4, gradients=3, along=8, output=shared_tmp_path
    )
    assert outcome.status == "ok"
    found = COMM.bcast(outcome.summary["results"])
    # of a thin beam: 2 to 4 %; others of its terms left out are 10 % and more
    assert found["angle_of_round_over_formula"] == pytest.approx(1.02, abs=0.01)
    # derivatives of another sign, or of a mesh that does not follow, leave it as it was
    assert found["stress_ratio"] < 0.98
    assert found["angle_ratio"] > 0.999
    if not COMM.rank:
        assert len(table(shared_tmp_path / "parameters.csv")) == 4
        assert len(table(shared_tmp_path / "iterations.csv")) == 3


@pytest.mark.slow
def test_torques_that_keep_a_path(shared_tmp_path: Path) -> None:
    """Errors of the flexible manipulator off its path are less by a digit, with a coarse spline.

    Derivatives by another coefficient, or a torque that is not that of the run, leave it as it was.
    """
    outcome = load_case("optimal_manipulator").run(
        coefficients=10, elements=2, samples=21, duration=0.1, t_end=0.1, dt=4e-3, motions=3,
        output=shared_tmp_path,
    )  # fmt: skip
    assert outcome.status == "ok"
    found = COMM.bcast(outcome.summary["results"])
    assert found["improvement"] > 8.0
    assert found["largest_error"] * found["improvement"] == pytest.approx(
        found["largest_error_before"], rel=1e-3
    )
    if not COMM.rank:
        assert len(table(shared_tmp_path / "parameters.csv")) == 30


@pytest.mark.slow
@pytest.mark.slow_on_ranks
def test_stiffnesses_from_the_path_of_a_tip(shared_tmp_path: Path) -> None:
    """All elements as they were made, from 30 % aside, and the truth within their errors.

    With derivatives of one element by another, or a part of the path that is cut elsewhere than its
    motion, none is found to a digit; a noise that does not count, or counts twice, moves the
    errors.
    """
    outcome = load_case("identification_twin").run(
        elements=5, dt=1.6e-3, noise=1e-3, output=shared_tmp_path
    )
    assert outcome.status == "ok"
    if COMM.rank:
        return
    rows = table(shared_tmp_path / "parameters.csv")
    assert {float(row["start"]) for row in rows} == {1.0}
    off = [float(row["found"]) - float(row["truth"]) for row in rows]
    assert np.abs(off).max() < 1e-4
    ratios = np.abs(off) / [float(row["error"]) for row in rows]
    # of five numbers one is beyond three deviations once in seventy times; all are the same here
    assert 0.05 < ratios.max() < 3.0


@pytest.mark.slow
def test_forty_stiffnesses_from_the_path_of_a_tip(shared_tmp_path: Path) -> None:
    """A fit to the whole path at once is off by tens of per cent in a wrong minimum."""
    outcome = load_case("identification_twin").run(
        elements=40, dt=2.0729e-4, output=shared_tmp_path
    )
    found = COMM.bcast(outcome.summary["results"])
    assert found["largest_error"] < 1e-4
    assert found["motions"] <= 60


@pytest.mark.slow_on_ranks
@pytest.mark.several_ranks
def test_what_is_known_before_on_ranks() -> None:
    """A prior, scales and motions that become longer, on all ranks as on one.

    A prior that counts once on each rank, or steps from other differences, moves all levels.
    """
    case = load_case("identification_twin")
    search = case.build(**case.prepare({"elements": 3})[0])
    options = ff.RunOptions(dt=1.6e-3, t_end=1.6e-2, rho_inf=1.0, tolerance=1e-12, quiet=True)
    column = COMM.bcast(ff.simulate(search.model({"levels": [1.2, 0.8, 1.1]}), options).history)
    one, every = (
        ff.identify(
            search.build, {"tip_x": column["tip_x"]}, search.start, options, noise={"tip_x": 1e-5},
            prior={"levels": (1.0, [0.3, 0.2, 0.1])}, scale={"levels": 0.5}, advance=6.4e-3,
            most=5, comm=comm,
        )
        for comm in (MPI.COMM_SELF, COMM)
    )  # fmt: skip
    assert one.motions == every.motions
    np.testing.assert_allclose(every.values["levels"], one.values["levels"], rtol=1e-9)
    np.testing.assert_allclose(every.errors["levels"], one.errors["levels"], rtol=1e-8)


@pytest.mark.slow
def test_tubes_of_a_truss(shared_tmp_path: Path) -> None:
    """A truss that deploys fast is lighter by a half, with no larger stress or deviation."""
    outcome = load_case("truss_design").run(
        bays=1, elements=1, deployment=2.0, dt=0.2, t_end=2.0, gradients=5, accuracy=1e-2,
        output=shared_tmp_path,
    )  # fmt: skip
    assert outcome.status == "ok"
    found = COMM.bcast(outcome.summary["results"])
    assert found["mass_over_start"] < 0.8
    if COMM.rank:
        return
    start, end = (table(shared_tmp_path / name / "history.csv") for name in ("start", "."))
    # bounds of smooth maxima that are not moved to the largest values leave some per cent, and
    # derivatives that lack a part as much as there is
    for names in (["stress"], ["error_x", "error_z"]):
        before, after = (
            max(sum(float(row[name]) ** 2 for name in names) for row in rows)
            for rows in (start, end)
        )
        assert after < 1.01 * before
    diameters = [float(row["diameter_found"]) for row in table(shared_tmp_path / "parameters.csv")]
    assert len(diameters) == 8
    assert min(diameters) == pytest.approx(30.0)


@pytest.mark.serial
def test_digits_by_a_length() -> None:
    """Stiff bodies whose nodes move: forces are small differences of what is rounded.

    Differences of two models close to each other have 5e-9 here, those of four farther away 1e-11.
    """
    case = load_case("flying_spaghetti")
    given, options = case.prepare({}, smoke=True)
    options = replace(options, tolerance=1e-13, t_end=10 * options.dt, quiet=True, output=None)

    def build(base: float) -> ff.Model:
        return case.build(**{**given, "base": base})

    base, slope = given["base"], 0.0
    for k, weight in STENCIL:
        history = columns(ff.simulate(build(base * (1.0 + 1e-3 * k)), options))
        slope += weight / (1e-3 * base) * history["lower_x"][-1]
    found = ff.gradient(build, "final:lower_x", {"base": base}, options, accuracy=1e-12)
    assert found.gradient["final:lower_x"]["base"] == pytest.approx(slope, rel=2e-10)


def searched(start: float, **more: object) -> ff.ParameterSearch:
    """A weight whose search is a given function."""

    def build(mass: float) -> ff.Model:
        model = ff.Model("weight")
        model.add(
            ff.RigidBody("bob", mass, (0.1, 0.1, 0.1)),
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.PositionProbe("path", ff.Marker("bob")),
        )
        return model

    return ff.ParameterSearch("weight", build, {"mass": start}, **more)


def test_search_that_fails_and_what_is_refused(shared_tmp_path: Path) -> None:
    """A failed search ends with its reason, and leaves the rows that it has reported."""
    from flexfem.gradients.motion.trajectory import StoppedError
    from flexfem.gradients.parameter_search import search_and_run

    def find(search, options, report):
        assert options.output is None
        report({"value": 3.0})
        raise StoppedError("no motion")

    options = ff.RunOptions(dt=0.1, t_end=0.2, quiet=True, output=shared_tmp_path)
    outcome = search_and_run(searched(1.0, find=find), options)
    assert outcome.status == "no motion"
    if not COMM.rank:
        assert json.loads((shared_tmp_path / "summary.json").read_text())["status"] == "no motion"
        assert table(shared_tmp_path / "iterations.csv") == [{"iteration": "0", "value": "3.0"}]
    with pytest.raises(ValueError, match="analysis must be one of") as told:
        searched(1.0, find=find, analysis="relaxation").validate()
    assert_on_page(str(told.value))
    again = ff.RunOptions(dt=0.1, t_end=0.2, quiet=True, restart=shared_tmp_path / "a.h5")
    with pytest.raises(ValueError, match="cannot go on from a checkpoint") as told:
        search_and_run(searched(1.0, find=find), again)
    assert_on_page(str(told.value))
