# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions whose steps differ: between kinks and jumps of loads, and adaptive ones."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.gradients.motion.records import Storage
from flexfem.gradients.motion.trajectory import Motion
from tests.contract.gradient_examples import NUMBERS, PARTS, body, mechanism
from tests.contract.test_gradients import errors


def pushed(kind, times=(0.0013, 0.0041), **numbers):
    """A body with a force that has kinks within steps, which it is cut at."""
    model, bob = body(kind, **numbers), ff.Marker("bob")
    force = ff.Table([0.0, *times, 1.0], [0.0, 1.0, 0.3, 0.3])
    model.add(ff.PointForce("push", bob, (0.0, 3.0, 40.0), amplitude=force))
    return model


def switched(kind, time=0.0023, **numbers):
    """A body with a force that is switched off, where accelerations are computed again."""
    model = body(kind, **numbers)
    tip = next(probe for probe in model.of(ff.PositionProbe) if probe.name == "tip").markers[0]
    force = ff.TimeFunction(lambda t: float(t < time), [time])
    model.add(
        ff.PointForce("push", tip, (0.0, 1.0, 4.0), amplitude=force),
        ff.Probe("lifted", tip, ("lifted",), lambda t, end: (end.acceleration[2],)),
    )
    return model


def compare(build, numbers, of, options, accuracy, step=1e-3):
    """Adjoint, tangent, and differences of motions that end with Newton steps of 1e-13."""
    found = ff.gradient(build, of, numbers, options, accuracy=1e-13, check=True)
    # a lead of accelerations, or a turning of masses at a jump, that one of both lacks gives 1e-8
    # and more
    assert max(found.check.values()) < 1e-12
    # the same; coefficients of a whole step in one of its parts give 1e-2
    assert errors(found.gradient, build, numbers, of, options, step).max() < accuracy
    return found


@pytest.mark.serial
@pytest.mark.parametrize("kind", [pytest.param("se3", marks=pytest.mark.slow), "damped"])
def test_kinks_of_loads_within_steps(kind):
    options = ff.RunOptions(dt=1e-3, t_end=6e-3, tolerance=1e-13)
    of = ["final:tip_z", "mean:speed"]
    found = compare(partial(pushed, kind), NUMBERS, of, options, 1e-8)
    # four sizes of parts, whose factors the motion does not keep
    assert found.factorizations_backward <= 4


@pytest.mark.serial
def test_adaptive_steps():
    """Histories of adaptive motions have all steps; those of the differences are the same ones."""
    options = ff.RunOptions(
        dt=4e-3, t_end=12e-3, tolerance=1e-13, adaptive=True, error_tolerance=1e-5
    )
    of = ["final:tip_z", "mean:speed"]
    found = compare(partial(body, "se3"), NUMBERS, of, options, 1e-8, step=1e-4)
    assert len(np.unique(np.diff(found.history["t"]).round(9))) > 1
    assert found.factorizations_backward == 0


@pytest.mark.serial
def test_steps_that_are_cut():
    """Newton's method fails with whole steps: the bob turns by three radians in each."""

    def thrown(**numbers):
        model, arm = body("se3", **numbers), ff.Marker("bob", offset=(0.1, 0.1, 0.0))
        model.add(ff.PointForce("throw", arm, (0.0, 60.0, 200.0)))
        return model

    options = ff.RunOptions(dt=0.02, t_end=0.02, tolerance=1e-13, quiet=True)
    motion = Motion(thrown(**NUMBERS), options, None, Storage())
    assert motion.simulation.rejected > 0
    assert motion.steps > 1
    compare(thrown, NUMBERS, ["final:tip_z", "mean:speed"], options, 1e-8, step=1e-4)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("kind", "time"),
    [("se3", 0.002), ("damped", 0.0023), pytest.param("slider", 0.0023, marks=pytest.mark.slow)],
)
def test_jumps_of_loads(kind, time):
    """At the end of a step and within it, with rows of several kinds that are differentiated.

    Accelerations that damping ends within a step, and were kept, would be wrong by 0.1.
    """
    options = ff.RunOptions(dt=1e-3, t_end=4e-3, tolerance=1e-13)
    of = ["final:tip_z", "final:lifted", "mean:speed"]
    compare(partial(switched, kind, time), NUMBERS, of, options, 1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_jumps_with_dampers_of_modes():
    """Damping of modes that counted as that of elements would be wrong by 1e-3."""

    def build(ratio, **numbers):
        model = switched("damped", **numbers)
        model.joints.remove(next(one for one in model.joints if one.name == "spring"))
        model.add(ff.ModalDamping("dampers", ratio, modes=3))
        return model

    options = ff.RunOptions(dt=1e-3, t_end=4e-3, tolerance=1e-13)
    of = ["final:tip_z", "final:lifted", "mean:speed"]
    compare(build, {**NUMBERS, "ratio": 0.03}, of, options, 1e-8)


@pytest.mark.serial
def test_jumps_in_a_mechanism():
    """Velocities that index 3 lets leave the constraints are projected, with a drive among them."""

    def build(**numbers):
        model = mechanism(**numbers)
        force = ff.TimeFunction(lambda t: float(t < 0.0133), [0.0133])
        model.add(ff.PointForce("kick", ff.Marker("second"), (4.0, 3.0, 40.0), amplitude=force))
        return model

    options = ff.RunOptions(dt=2e-3, t_end=0.018, tolerance=1e-13)
    compare(build, PARTS, ["final:p_x", "final:p_z", "mean:own"], options, 2e-8)


def doubled(**numbers):
    """A body with a second hinge and a second pin beside the first ones."""
    model, root, tip = (
        switched("se3", **numbers),
        ff.Marker("rod", "start"),
        ff.Marker("rod", "end"),
    )
    model.add(
        ff.Revolute("hinge_again", ff.Ground(), root, axis=(0.0, 1.0, 0.0)),
        ff.Spherical("pin_again", tip, ff.Marker("bob", offset=(-0.05, 0.0, 0.0))),
    )
    return model


@pytest.mark.serial
def test_redundant_constraints():
    """Their compliance is relative to the mass of the model, and so to two of the numbers."""
    options = ff.RunOptions(
        dt=1e-3, t_end=4e-3, tolerance=1e-13, redundant_constraints="least_norm"
    )
    compare(doubled, NUMBERS, ["final:tip_z", "mean:speed"], options, 1e-8)


def compare_memories(build, options, few):
    """Gradients with all states, and with few bytes for them."""
    whole, parts = (
        ff.gradient(build, "mean:tip_z", NUMBERS, options, accuracy=1e-12, memory=most)
        for most in (2e9, few)
    )
    for name, value in whole.gradient["mean:tip_z"].items():
        # a part that is taken again with the size of a whole step is 1e-3
        assert parts.gradient["mean:tip_z"][name] == pytest.approx(value, rel=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("build", [pushed, pytest.param(switched, marks=pytest.mark.slow)])
def test_states_that_do_not_fit(build):
    """They are computed again, part by part and jump by jump."""
    options = ff.RunOptions(dt=1e-3, t_end=0.012, tolerance=1e-13)
    compare_memories(partial(build, "se3"), options, 2.4e4)


@pytest.mark.slow
@pytest.mark.serial
def test_many_more_states_than_expected_do_not_fit():
    """Two steps become 32: first all are kept, then each second, then each fourth."""
    options = ff.RunOptions(
        dt=4e-3, t_end=8e-3, tolerance=1e-13, adaptive=True, error_tolerance=1e-6
    )
    compare_memories(partial(body, "se3"), options, 4.6e4)


@pytest.mark.several_ranks
@pytest.mark.parametrize("build", [pushed, pytest.param(switched, marks=pytest.mark.three_ranks)])
def test_ranks_agree(build):
    """All ranks together find what each finds by itself."""
    options = ff.RunOptions(dt=1e-3, t_end=4e-3, tolerance=1e-13, split_above=1)
    alone, together = (
        ff.gradient(
            partial(build, "se3"), "mean:tip_z", NUMBERS, options, accuracy=1e-13, comm=comm
        )
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for name, value in alone.gradient["mean:tip_z"].items():
        # a share that is missing, or counted twice, is a tenth and more
        assert together.gradient["mean:tip_z"][name] == pytest.approx(value, rel=1e-9)
