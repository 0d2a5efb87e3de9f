# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions by four formalisms: against an integrator of another kind, and energies."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexfem as ff
from flexfem import research
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import accelerations, consistent_start
from flexfem.research.formalisms.runs.comparison import compare_formalisms, simulate_mechanism
from flexfem.research.formalisms.runs.findings import findings
from flexfem.research.formalisms.runs.motion import SideBySide
from flexfem.research.formalisms.runs.paired_timing import REPEATS, ratio_range, timed_in_turns
from tests.unit import elastic_bodies as eb
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial
END = 0.02
# a kept matrix is not part of a checkpoint: what it leaves open would part the runs
EXACT = {"iteration_matrix": "updated"}


def options(dt, t_end=END, **more):
    given = {"dt": dt, "t_end": t_end, "rho_inf": 1.0, "tolerance": 1e-11, "quiet": True}
    return ff.RunOptions(**given, **EXACT, **more)


def mechanism(spatial, **more):
    """Two beams that fall and turn, without applied forces."""
    spin = np.array([0.0, 0.0, 6.0])
    both = eb.pair("beam", spatial)
    first = replace(both.bodies[0], angular_velocity=spin)
    second = replace(
        both.bodies[1], velocity=np.cross(spin, (0.5, 0.0, 0.0)),
        angular_velocity=spin + ((1.0, 4.0, -3.0) if spatial else (0.0, 0.0, -3.0)),
    )  # fmt: skip
    return replace(both, bodies=(first, second), forces=(), **more)


def reference(equations):
    """Place of the observed end at the end, by an explicit method of order 8."""
    q, v = consistent_start(equations)
    n = equations.size

    def rates(t, y):
        return np.concatenate([y[n:], accelerations("lagrange", equations, y[:n], y[n:], t)])

    end = solve_ivp(rates, (0.0, END), np.r_[q, v], method="DOP853", rtol=1e-9, atol=1e-11)
    return equations.position(equations.mechanism.observed, end.y[:n, -1])


@pytest.mark.parametrize("spatial", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_all_formalisms_converge_to_the_same_motion(spatial):
    own = mechanism(spatial)
    model = MechanismEquations(own)
    expected = reference(model)
    ends, drifts = [], []
    for steps in (40, 80):
        both = SideBySide(model, research.FORMALISMS)
        settings = options(END / steps)
        assert both.stepper.begin(both, settings).value == "ok"
        first = np.array(both.observe(both.stepper.motion)).reshape(4, 4)
        for _ in range(steps):
            assert both.stepper.step(END / steps).value == "ok"
        last = np.array(both.observe(both.stepper.motion)).reshape(4, 4)
        ends.append(np.linalg.norm(last[:, :3] - expected, axis=1))
        drifts.append(np.abs(last[:, 3] - first[:, 3]) / np.abs(first[:, 3]))
        for stepper in both.stepper.steppers:
            q, v = stepper.motion.q, stepper.motion.v
            assert np.abs(model.gaps(q, END)).max() < 1e-9  # a drift of the constraints is 1e-5
            if stepper is not both.stepper.steppers[0] and stepper is not both.stepper.steppers[1]:
                assert np.abs(model.jacobian(q) @ v).max() < 1e-9  # so are the velocities here
    # 0.1 m are travelled; the first order would halve the error only
    assert (ends[0] < 1e-3).all()
    assert (ends[0] / ends[1] > 3.2).all(), ends
    # second order in the energy too, or round-off
    assert (drifts[1] < np.maximum(0.35 * drifts[0], 1e-7)).all(), drifts


def test_a_run_leaves_complete_results_and_goes_on(tmp_path):
    own = mechanism(False, formalism="maggi")
    whole = simulate_mechanism(own, options(1e-3, output=tmp_path / "whole", checkpoint_every=4))
    assert whole.status == "ok"
    summary = json.loads((tmp_path / "whole" / "summary.json").read_text())
    assert (summary["formalism"], summary["multipliers"], summary["steps"]) == ("maggi", 0, 20)
    assert (tmp_path / "whole" / "bodies_line.pvd").is_file()
    short = options(1e-3, output=tmp_path / "part", checkpoint_every=4, t_end=8e-3)
    part = simulate_mechanism(own, short)
    assert part.status == "ok"
    restart = tmp_path / "part" / "checkpoint_000008.h5"
    rest = simulate_mechanism(own, options(1e-3, output=tmp_path / "part", restart=restart))
    for name, values in whole.history.items():
        # nothing of the state is left out of the checkpoint
        np.testing.assert_allclose(rest.history[name], values, rtol=1e-11, atol=1e-12, err_msg=name)


@pytest.mark.slow
def test_a_study_restarts_all_its_formalisms(tmp_path):
    names = ("lagrange", "gibbs_appell", "hamilton")
    study = research.FormalismStudy({("beam",): mechanism(False)}, ("element",), names, steps=1)
    whole = compare_formalisms(study, options(1e-3, t_end=4e-3))
    compare_formalisms(study, options(1e-3, t_end=2e-3, output=tmp_path, checkpoint_every=2))
    restart = tmp_path / "checkpoint_000002.h5"
    rest = compare_formalisms(study, options(1e-3, t_end=4e-3, output=tmp_path, restart=restart))
    for name, values in whole.history.items():
        np.testing.assert_allclose(rest.history[name], values, rtol=1e-11, atol=1e-12, err_msg=name)
    rows = (tmp_path / "table.csv").read_text().splitlines()
    assert rows[0].startswith("element,formalism,derivatives,nodes,terms,operations,unknowns,")
    assert len(rows) == 4
    assert "Gibbs-Appell takes" in rest.summary["findings"]
    energies = (tmp_path / "energies.csv").read_text().splitlines()
    kinetic, accelerations = (line.split(",") for line in energies[1:])
    assert (kinetic[1], accelerations[1]) == ("kinetic", "of_accelerations")
    assert int(accelerations[5]) > int(kinetic[5]) > 0  # the acceleration has more terms


def test_findings_say_what_the_figures_say():
    def row(formalism, operations, unknowns, step=(1.0, 1.0), element="beam"):
        return {
            "element": element, "formalism": formalism, "operations": operations,
            "unknowns": unknowns, "multipliers": 2, "microseconds_per_cell": 1.0,
            "milliseconds_per_step": 0.5 * sum(step), "cell_ratio_low": 1.0, "cell_ratio_high": 1.0,
            "step_ratio_low": step[0], "step_ratio_high": step[1],
        }  # fmt: skip

    rows = [
        row("lagrange", 100, 10), row("gibbs_appell", 150, 10, (0.6, 1.4)),
        row("hamilton", 90, 20, (1.2, 1.6)),
    ]  # fmt: skip

    def said(*arguments):
        return " ".join(findings(*arguments).split())

    text = said(rows, ["element"])
    assert "1.50 times the operations per cell" in text
    assert '"Gibbs-Appell takes fewer operations than Lagrange" does not hold' in text
    assert '"Hamilton takes the most operations" does not hold' in text
    assert '"Hamilton has the most unknowns" holds' in text
    # a ratio of times that repeats place on both sides of one is no finding
    assert "1.00 times the time per step (not told apart)" in text
    assert "1.40 times the time per step." in text
    assert '"Hamilton takes the longest per step" is open' in text
    assert "Maggi" not in text
    assert "nothing to compare" in findings(rows[2:], ["element"])
    rows[1] = row("gibbs_appell", 150, 10, (0.6, 1.1))
    assert '"Hamilton takes the longest per step" holds' in said(rows, ["element"])
    energies = [
        {"element": "beam", "energy": name, "operations": operations, "microseconds_per_cell": 1.0,
         "ratio_low": 0.9, "ratio_high": 1.2}
        for name, operations in (("kinetic", 100), ("of_accelerations", 250))
    ]  # fmt: skip
    text = said(rows, ["element"], energies)
    assert "2.50 times the operations and 1.00 times the time (not told apart)" in text


def test_times_are_taken_in_turns():
    calls = []
    times = timed_in_turns({"one": lambda: calls.append(1), "two": lambda: calls.append(2)})
    assert len(times["one"]) == len(times["two"]) == REPEATS
    # the load of the machine meets both: neither is measured as a whole before the other
    changes = sum(a != b for a, b in pairwise(calls))
    assert changes >= REPEATS
    assert ratio_range([1.0, 2.0, 3.0, 4.0, 90.0], [1.0] * 5) == (2.0, 4.0)
    assert all(np.isnan(bound) for bound in ratio_range([1.0], []))


BAD = {
    'there is no body "third"': {
        "joints": (
            research.Constraint("a", (research.End("third"),), research.end_position, (0.0,) * 3),
        )
    },
    'the name "first" is used twice': {
        "joints": (
            research.Constraint(
                "first", (research.End("first"),), research.end_position, (0.0,) * 3
            ),
        )
    },
    "formalism must be one of": {"formalism": "newton"},
    "gravity must hold 3 numbers": {"gravity": (0.0, 1.0)},
    "has no node at": {
        "joints": (
            research.Constraint(
                "a", (research.End("first", (0.1, 0.0, 0.0)),), research.end_position, (0.0,) * 3
            ),
        )
    },
    "constrain the same motion twice": {
        "joints": tuple(
            research.Constraint(n, (research.End("first"),), research.end_position, (0.0,) * 3)
            for n in "ab"
        )
    },
    "must return numbers": {
        "joints": (
            research.Constraint("a", (research.End("first"),), lambda end, data: [end.position]),
        )
    },
}


@pytest.mark.parametrize("message", BAD)
def test_mistakes_are_named_before_anything_is_written(message, tmp_path):
    own = replace(mechanism(False), observed=None, **BAD[message])
    with pytest.raises(ValueError, match=message) as raised:
        simulate_mechanism(own, options(1e-3, output=tmp_path / "results"))
    assert_on_page(str(raised.value))
    assert not (tmp_path / "results").exists()


def test_bodies_that_slip_in_their_frames_are_refused():
    own = mechanism(False)
    loose = replace(own.bodies[0], held=lambda x: np.zeros(len(x), dtype=bool))
    with pytest.raises(ValueError, match="mass matrix is singular"):
        simulate_mechanism(replace(own, bodies=(loose, own.bodies[1])), options(1e-3))
    wrong = replace(own.bodies[0], held=lambda x: np.zeros(1, dtype=bool))
    with pytest.raises(ValueError, match="held must return 2 or 2 x 3 truth values"):
        simulate_mechanism(replace(own, bodies=(wrong, own.bodies[1])), options(1e-3))
    with pytest.raises(ValueError, match="out of the plane"):
        replace(own.bodies[0], velocity=(0.0, 0.0, 1.0))
    other = replace(own.bodies[0], mesh=eb.mesh("plane", 0.5))
    with pytest.raises(ValueError, match="must have interval cells in 1 dimensions"):
        simulate_mechanism(replace(own, bodies=(other, own.bodies[1])), options(1e-3))


@pytest.mark.parametrize("formalism", research.FORMALISMS)
def test_applied_forces_change_the_momentum_by_their_impulse(formalism):
    """A free beam that starts at rest; forces linear in time, of which no scheme misses a part."""
    start, rate, spans = np.array([3.0, -5.0]), np.array([4e3, 2e3]), 5
    push = research.AppliedForce(
        "push", (research.End("rod", (0.5, 0.0, 0.0)),), research.end_position,
        lambda t: start + rate * t, (0.0, 0.0),
    )  # fmt: skip
    rod = eb.body("rod", "beam", False, 0.5)
    model = MechanismEquations(
        research.Mechanism("free", (rod,), (), (push,), observed=push.ends[0])
    )
    both, h = SideBySide(model, (formalism,)), 2e-4
    assert both.stepper.begin(both, options(h, spans * h)).value == "ok"
    for k in range(spans):
        assert both.stepper.step(h).value == "ok"
        motion, t = both.stepper.steppers[0].motion, (k + 1) * h
        momentum = model.vector("momentum", motion.q, motion.v)[:2]
        # what the iteration leaves is 1e-6; forces at another time than the middle of a step, or
        # five per cent more of them, are per cents
        np.testing.assert_allclose(momentum, start * t + 0.5 * rate * t * t, rtol=1e-4)
