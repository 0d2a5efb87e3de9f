# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sequences of compiled loops: their results are those of the single calls, with fewer of these."""

import gc
import sys
import weakref

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.kernels import sequence as sequences
from flexfem.kernels.sequence import (
    Call,
    Check,
    ForeignCall,
    Number,
    all_true,
    clear,
    copy,
    in_one_array,
    largest_entry,
    sequence,
)
from flexfem.la.factor import Factor
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.frozen.sequences import FrozenSequences
from flexfem.solvers.linear.banded import band_factor
from flexfem.solvers.linear.schur_kernels import invert_blocks, multiply_blocks
from flexfem.system.mechanics import EndPoint
from tests.benchmarks.robot import robot


@pytest.mark.serial
def test_arguments_and_results():
    rng = np.random.default_rng(1)
    A, b = rng.normal(size=(3, 6, 6)), rng.normal(size=(3, 6))
    inverses, work, x, seen = np.zeros_like(A), np.zeros_like(b), np.zeros_like(b), []
    smallest = Number(1e-14)
    largest, regular = Call(largest_entry, x[0]), Call(invert_blocks, A, inverses, smallest)
    run = sequence(
        [
            Call(copy, b, work), regular, Call(multiply_blocks, inverses, work, x), largest,
            lambda: seen.append(x.copy()), Call(clear, work),
        ]
    )  # fmt: skip
    run()
    np.testing.assert_allclose(np.einsum("kij,kj->ki", A, x), b, atol=1e-12)  # conditions below 1e3
    assert largest.result[0] == np.abs(x[0]).max()
    assert regular.result.dtype == bool
    assert regular.result[0]
    assert (work == 0.0).all()
    smallest.set(1.0)  # too strict a test of the pivots, as an argument of the same call
    b[:] *= 2.0
    run()
    assert not regular.result[0]
    np.testing.assert_array_equal(seen[1], 2.0 * seen[0])
    alone = Call(largest_entry, x[1])
    alone()
    assert alone.result[0] == np.abs(x[1]).max()


@pytest.mark.serial
def test_checks_and_results_in_one_array():
    flags, x, seen = np.array([True, True]), np.array([[1.0, -2.0], [3.0, 0.0]]), []
    parts = [Call(largest_entry, row) for row in x]
    sizes = in_one_array(parts)
    whole = Call(largest_entry, sizes)
    # a check in the middle: what follows it in a sequence is done before
    check = Check(lambda: seen.append(whole.result[0]), all_true, flags)
    run = sequence([*parts, check, whole])
    run()
    np.testing.assert_array_equal(sizes, [2.0, 3.0])
    assert (whole.result[0], seen) == (3.0, [])
    flags[1], x[0, 0] = False, np.nan
    run()
    assert np.isnan(whole.result[0])
    assert len(seen) == 1
    assert np.isnan(seen[0])
    check()
    assert len(seen) == 2
    parts[1]()
    assert sizes[1] == parts[1].result[0] == 3.0


@pytest.mark.serial
def test_singular_blocks_and_bands():
    A = np.array([np.eye(6), np.eye(6)])
    A[1, 5, 5] = 0.0
    assert not invert_blocks(A, np.zeros_like(A), 1e-14)
    A[1, 5, 5] = np.nan
    assert not invert_blocks(A, np.zeros_like(A), 1e-14)
    band = Call(band_factor, np.array([1, 4]), np.array([1.0, 0.0]), np.zeros((2, 3)))
    sequence([band])()
    assert not band.result[0]


@pytest.mark.serial
def test_arrays_must_be_contiguous():
    with pytest.raises(TypeError, match="contiguous"):
        Call(copy, np.zeros((4, 3)).T, np.zeros((3, 4)))


@pytest.mark.serial
def test_a_failing_call_raises_its_error():
    def fail():
        raise ValueError("no solution")

    exit_code = Call(largest_entry, np.ones(2))  # any function in C that returns another number
    run = sequence([exit_code, ForeignCall(_abs(), [3], fail)])
    with pytest.raises(ValueError, match="no solution"):
        run()


def _abs():
    import ctypes

    return ctypes.cast(ctypes.CDLL(None).abs, ctypes.c_void_p).value


def chain():
    mesh = ff.LineMesh.straight({"a": [(0, 0, 0), (1, 0, 0)], "b": [(1, 0, 0), (2, 0, 0)]}, 3)
    section = ff.Section.circle(0.02, ff.Material(1e8, 0.3, 1e3))
    model = ff.Model("chain", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        *(ff.Beam(name, section, orientation=(0.0, 1.0, 0.0)) for name in "ab"),
        ff.Spherical("top", ff.Ground(), ff.Marker("a", "start")),
        ff.Spherical("middle", ff.Marker("a", "end"), ff.Marker("b", "start")),
        ff.RigidBody("bob", 0.5, (1e-3, 2e-3, 3e-3), position=(2.0, 0.0, 0.0)),
        ff.Rigid("weld", ff.Marker("b", "end"), ff.Marker("bob")),
        ff.SpringDamper("spring", ff.Ground(), ff.Marker("bob"), stiffness=20.0, damping=1.0),
        ff.Force("drag", [ff.Marker("bob")], lambda t, ends, z: -0.3 * ends.velocities),
        ff.PointForce("push", ff.Marker("b", "end"), (0.0, 0.5, 0.0)),
        ff.PositionProbe("tip", ff.Marker("bob")),
    )
    return model


MODELS = {
    "chain": chain,
    "compiled arm": lambda: robot("compiled", "arm"),
    "sampled tool": lambda: robot("sampled", "tool", 2e-3),
}
#: Their names; several ranks have a part of the chain each.
ON_RANKS = [
    name if name == "chain" else pytest.param(name, marks=pytest.mark.serial) for name in MODELS
]


def motion(model, steps=12):
    """Frames of all nodes after some steps, two sizes in turns so that factors are exchanged."""
    simulation = Simulation(model, ff.RunOptions(dt=2e-3, t_end=1.0, quiet=True))
    for k in range(steps):
        assert simulation.advance(1e-3 if k % 4 == 3 else 2e-3).name == "OK"
    frames = [part.block.frames.ravel() for part in simulation.system.parts]
    return np.concatenate([*frames, simulation.system.constraints.forces])


@pytest.mark.three_ranks
def test_some_ranks_may_have_none(monkeypatch):
    found, made, usual = motion(chain()), [], FrozenSequences.of

    def of(*given):
        made.append(usual(*given) if MPI.COMM_WORLD.rank == 0 else None)
        return made[-1]

    # other messages, or in another order, would be waited for
    monkeypatch.setattr(FrozenSequences, "of", of)
    np.testing.assert_allclose(motion(chain()), found, rtol=1e-10, atol=1e-10)
    assert made
    assert (made[0] is None) == (MPI.COMM_WORLD.rank > 0)


@pytest.mark.three_ranks
@pytest.mark.parametrize("name", ON_RANKS)
def test_motions_are_those_of_single_calls(name, monkeypatch):
    found = motion(MODELS[name]())
    # the same calls, one by one from Python: another byte would be another argument
    monkeypatch.setattr(sequences._Table, "__call__", lambda self: [one() for one in self._calls])
    np.testing.assert_array_equal(motion(MODELS[name]()), found)
    # without sequences of the solver, and residuals part by part
    monkeypatch.setattr(FrozenSequences, "of", lambda *given: None)
    usual = EndPoint.evaluate

    def evaluate(self, system, shifts, strains=None):
        usual(self, system, shifts, strains or system.present)

    monkeypatch.setattr(EndPoint, "evaluate", evaluate)
    # a lost or doubled term would be a part of the forces, of up to 1e3 N
    np.testing.assert_allclose(motion(MODELS[name]()), found, rtol=1e-10, atol=1e-10)


@pytest.mark.serial
def test_a_solve_is_petscs(monkeypatch):
    found, usual = [], Factor.foreign_solver

    def foreign_solver(self, *given):
        found.append(usual(self, *given))
        return found[-1]

    monkeypatch.setattr(Factor, "foreign_solver", foreign_solver)
    motion(chain())
    assert found
    assert None not in found


def calls_of_a_step(model):
    """Calls of Python functions, of functions in C, and iterations, of a step."""
    simulation = Simulation(model, ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True))
    for _ in range(5):
        simulation.advance(1e-3)
    counts = {"call": 0, "c_call": 0}

    def count(frame, event, argument):
        if event in counts:
            counts[event] += 1

    before = simulation.system.counters.newton_iterations
    sys.setprofile(count)
    try:
        for _ in range(10):
            simulation.advance(1e-3)
    finally:
        sys.setprofile(None)
    iterations = (simulation.system.counters.newton_iterations - before) / 10
    return counts["call"] / 10, counts["c_call"] / 10, iterations


@pytest.mark.serial
@pytest.mark.serial
@pytest.mark.parametrize(
    # bounds a fifth above what they are: a loop over parts or rows in Python that comes back, or a
    # property that is asked for once more in each iteration, adds as much
    ("name", "functions", "builtins"),
    [("compiled", 175, 50), ("sampled", 330, 170)],
)
def test_few_calls_from_python(name, functions, builtins):
    called, others, iterations = calls_of_a_step(robot(name, "tool"))
    assert iterations <= 2.0  # the bounds are those of two
    assert called < functions
    assert others < builtins


@pytest.mark.parametrize("name", ON_RANKS)
def test_nothing_outlives_its_run(name):
    simulation = Simulation(MODELS[name](), ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True))
    for _ in range(3):
        simulation.advance(1e-3)
    block = weakref.ref(simulation.system.parts[0].block)
    gc.collect()
    gc.disable()
    try:
        del simulation
        # a cycle would wait for the collector, with vectors whose destruction is collective
        assert block() is None
    finally:
        gc.enable()
