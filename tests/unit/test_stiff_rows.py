# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed contacts beside kept factors: their rows, their forces, and no factorisation for them."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.contact.law.data import GAP
from flexfem.lie import se3
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.frozen import stiff_rows
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import Shifts
from tests.unit.contact_motion import moved, same_on_ranks, sheet

THICK = 1e-3
SECTION = ff.ShellSection.isotropic(THICK, ff.Material(2e8, 0.3, 1000.0))
ALUMINIUM = ff.Material(2e9, 0.3, 1200.0)


def between() -> ff.Model:
    """A sheet between another one, which flies down onto it, and a ball, which flies up."""
    meshes = [sheet("low", 6, 0.2, (0, 0, 0)), sheet("up", 5, 0.15, (0.013, 0.021, 1.2e-3), 5e-3)]
    model = ff.Model("between", surface=ff.SurfaceMesh.join(meshes))
    model.add(ff.Shell("low", SECTION), ff.Shell("up", SECTION, velocity=(0.3, 0.0, -1.0)))
    at = (0.021, 0.018, -0.05 - THICK / 2 - 1e-4)
    model.add(ff.RigidBody("ball", 0.05, 3 * (1e-4,), position=at, velocity=(0, 0, 1.0)))
    ball = ff.RigidSphere(ff.Marker("ball"), 0.05)
    model.add(ff.Contact("hit", "up", "low", stiffness=1e9))
    model.add(ff.Contact("rolls", "low", surfaces=ball, stiffness=1e7))
    model.add(ff.ContactProbe("touch", "hit"), ff.ContactProbe("rests", "rolls"))
    return model


def strip(tilt: float = 3e-3, count: int = 20) -> ff.Model:
    """A strip that lands on a stiff plane."""
    s = np.linspace(0, 1, count + 1)
    points = np.c_[0.5 * s, 0 * s, 5.5e-3 + tilt * s]
    cells = np.c_[np.arange(count), np.arange(1, count + 1)]
    model = ff.Model("strip", mesh=ff.LineMesh(points, cells, {"strip": np.arange(count)}))
    section = ff.Section.rectangle(0.1, 1e-3, ALUMINIUM)
    model.add(ff.Beam("strip", section, orientation=(0.0, 1.0, 0.0), velocity=(0, 0, -0.63)))
    plane = ff.RigidPlane(ff.Ground((0, 0, 0)))
    model.add(ff.Contact("floor", "strip", surfaces=plane, stiffness=1e12, radius=0.5e-3))
    model.add(ff.ContactProbe("touch", "floor"), ff.PositionProbe("tip", ff.Marker("strip", "end")))
    return model


def _gaps(contacts) -> np.ndarray:
    """Gaps of the closed contacts of this rank in the order of the rows."""
    made = [one for one, _ in contacts.triangles()] + [one for _, one, _ in contacts.rigid()]
    return np.concatenate([one.contacts[:, GAP] for one in made])


def _random_steps(system, h: float) -> None:
    """Steps of all blocks, the same on any number of ranks."""
    rng = np.random.default_rng(0)
    for part in system.parts:
        steps = h * rng.normal(size=(200, 6))[part.block.node_ids]
        part.block.step[:, : part.block.width] = steps[:, : part.block.width]


def test_rows_are_the_derivatives_of_the_gaps():
    simulation, _ = moved(between(), 3)
    system = simulation.system
    (contacts,) = system.contacts
    starts = [part.block.frames.copy() for part in system.parts]
    gaps, h = [], 1e-9
    for sign in (1.0, -1.0, 0.0):
        _random_steps(system, sign * h)
        for part, start in zip(system.parts, starts, strict=True):
            steps = np.zeros((len(start), 6))
            steps[:, : part.block.width] = part.block.step[:, : part.block.width]
            part.block.frames[:] = se3.retract(start, steps)
        contacts.evaluate()
        gaps.append(_gaps(contacts))
    _random_steps(system, 1.0)
    rows = contacts.rows()
    motions = rows.motions()
    closed = [contacts.measure(name)[5] for name in ("hit", "rolls")]
    assert min(MPI.COMM_WORLD.allreduce(np.array(closed))) > 0
    # differences of 1e-9 m in gaps of 1e-5 m; a wrong arm of the ball changes 1e-1
    np.testing.assert_allclose((gaps[0] - gaps[1]) / (2 * h), motions, atol=1e-5)
    # forces are the transpose: their work is that of the blocks' residuals
    for part in system.parts:
        part.block.residual[:] = 0.0
    rows.push(rows.slopes)
    work = sum(np.sum(part.block.owned_residual * part.block.owned_step) for part in system.parts)
    expected = MPI.COMM_WORLD.allreduce(rows.slopes @ motions)
    # rounding
    assert MPI.COMM_WORLD.allreduce(work) == pytest.approx(expected, rel=1e-11)


def test_steps_solve_the_equations_with_the_springs(monkeypatch):
    monkeypatch.setattr(stiff_rows, "_ACCURACY", 1e-10)
    simulation, _ = moved(between(), 3)
    system, solver = simulation.system, FrozenSolver(simulation.system)
    shifts = Shifts(velocity=1e4, acceleration=2e7, scale=2.5e-8)
    END_POINT.evaluate(system, shifts)
    solver.factor(shifts)
    loads = [part.block.residual.copy() for part in system.parts]
    assert solver.step(shifts, system.present)[0]
    steps = [part.block.owned_step.copy() for part in system.parts]
    rows = system.contacts[0].rows()
    forces = shifts.scale * rows.slopes * rows.motions()
    for part, load in zip(system.parts, loads, strict=True):
        # residuals are not changed
        np.testing.assert_array_equal(part.block.residual, load)
    rows.push(-forces)
    solver._solve(system.constraints.values)
    for part, step in zip(system.parts, steps, strict=True):
        size = MPI.COMM_WORLD.allreduce(abs(step).max(initial=0.0), op=MPI.MAX)
        # measured 1e-12; without springs the steps differ by their size
        np.testing.assert_allclose(part.block.owned_step, step, atol=1e-8 * size)


@pytest.mark.three_ranks
def test_same_motion_on_any_number_of_ranks():
    alone = same_on_ranks(between(), 5, tolerance=1e-11)
    if MPI.COMM_WORLD.rank == 0:
        assert alone["touch_closed"].max() > 4
        assert alone["rests_closed"].max() > 0


@pytest.mark.serial
@pytest.mark.parametrize("tilt", [0.0, 3e-3])
def test_stiff_contacts_ask_for_no_factors(tilt):
    """Nodes touch at once, or one after the other with hard blows."""
    simulation, history = moved(strip(tilt), 30, dt=1e-3, tolerance=1e-9)
    _, fresh = moved(strip(tilt), 30, dt=1e-3, tolerance=1e-9, iteration_matrix="updated")
    counters = simulation.system.counters
    # one at the start; without the springs 22 with tilt, and 4 fallbacks
    assert (counters.factorizations, counters.fallbacks, simulation.rejected) == (1, 0, 0)
    assert history["touch_closed"].max() == (21 if tilt == 0.0 else pytest.approx(6, abs=3))
    # Newton's tolerance over 30 steps with blows; another set of contacts changes 1e-4
    np.testing.assert_allclose(history["tip_z"], fresh["tip_z"], atol=1e-6)


def grid(count: int = 8, elements: int = 9) -> ff.Model:
    """Two layers of crossing ropes, of which the upper one flies down onto the other."""
    random, lines, speeds = np.random.default_rng(1), {}, {}
    for k, at in enumerate(0.05 + 0.03 * np.cumsum(random.uniform(0.6, 2.0, count))):
        lines[f"x{k}"] = np.array([(0.0, at, 0.0), (0.6, at, 0.0)])
        lines[f"y{k}"] = np.array([(at, 0.0, 0.0106), (at, 0.6, 0.0106)])
        speeds[f"x{k}"], speeds[f"y{k}"] = 0.0, -random.uniform(0.5, 1.5)
    model = ff.Model("grid", mesh=ff.LineMesh.straight(lines, elements))
    section = ff.Section.circle(0.01, ff.Material(1e7, 0.45, 1000.0))
    model.add(*(ff.Beam(name, section, velocity=(0, 0, v)) for name, v in speeds.items()))
    model.add(ff.Contact("all"), ff.ContactProbe("touch", "all"))
    return model


@pytest.mark.serial
def test_many_contacts_are_coupled_by_the_compliances_of_nodes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same motion with fewer directions, and without a factorisation for contacts."""
    found, added = [], stiff_rows._Forces._append
    monkeypatch.setattr(stiff_rows, "_SOFT", 0.0)
    for many in (1, 10**9):
        count: list[int] = []
        monkeypatch.setattr(stiff_rows, "_MANY", many)
        monkeypatch.setattr(
            stiff_rows._Forces, "_append", lambda *given, of=count: (of.append(1), added(*given))[1]
        )
        motion = Simulation(grid(), ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True), MPI.COMM_SELF)
        closed = 0
        for _ in range(4):
            motion.advance(1e-3)
            closed = max(closed, motion.system.contacts[0].closed)
        counters, frames = motion.system.counters, motion.system.parts[0].block.frames.copy()
        found.append((len(count) / counters.newton_iterations, counters, frames, closed))
    (coupled, counters, frames, closed), (plain, _, other, _) = found
    assert closed >= 40
    # a matrix without the coupling takes as many directions as none
    assert coupled < 0.75 * plain
    assert counters.factorizations == 1
    assert counters.fallbacks == 0
    # what the iteration leaves; another solution is off by 1e-4
    np.testing.assert_allclose(frames, other, rtol=0.0, atol=1e-8)


@pytest.mark.serial
def test_the_ground_does_not_couple_what_lies_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The matrix of a heap's contacts would be full of zeros."""
    found, couple = [], stiff_rows._Forces.couple
    monkeypatch.setattr(
        stiff_rows._Forces,
        "couple",
        lambda own, entries: (found.append(entries), couple(own, entries)),
    )
    ends = {f"rope{k}": [(0.0, 0.1 * k, 0.0056), (0.3, 0.1 * k, 0.0056)] for k in range(3)}
    lines = {name: np.array(points) for name, points in ends.items()}
    model = ff.Model("apart", mesh=ff.LineMesh.straight(lines, 5))
    section = ff.Section.circle(0.01, ff.Material(1e7, 0.45, 1000.0))
    model.add(*(ff.Beam(name, section, velocity=(0, 0, -0.5)) for name in lines))
    model.add(ff.Contact("all", surfaces=ff.RigidPlane(ff.Ground())))
    motion = Simulation(model, ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True), MPI.COMM_SELF)
    motion.advance(1e-3)
    rows, columns, _ = found[-1]
    count = rows.max() + 1
    assert count >= 15
    # of a node with itself and four on each side, not with all
    assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) <= 9 * count < count**2


@pytest.mark.serial
@pytest.mark.parametrize("dense", [0, 2])
@pytest.mark.parametrize("coupling", [[[1.0, 1.0], [1.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]])
def test_springs_with_wild_couplings_end_no_run(coupling, dense, monkeypatch):
    """Singular, as of a rope that is flung in steps of 5 ms, and negative ones."""
    monkeypatch.setattr(stiff_rows, "_DENSE", dense)
    made = stiff_rows._Forces(None, np.full(2, 1e300), SimpleNamespace(sum=lambda values: values))
    i, j = np.divmod(np.arange(4), 2)
    made.couple((i, j, np.ravel(coupling)))
    assert np.isfinite(made._direct(np.ones(2))).all()


def test_weak_couplings_do_not_fill_the_factors_of_many_springs():
    """Those of distant nodes, of which there are many."""
    matrix = np.array([[1.0, 0.5, 5e-3], [0.5, 1.0, 0.0], [5e-3, 0.0, 1.0]])
    i, j = np.divmod(np.arange(9), 3)
    solve = stiff_rows._sparse(3, (i, j, matrix.ravel()))
    np.testing.assert_array_equal(solve(np.array([0.0, 0.0, 1.0])), [0.0, 0.0, 1.0])
    # those that matter are kept: without them it would be (1, 0, 0)
    np.testing.assert_allclose(solve(np.array([1.0, 0.0, 0.0])), [4 / 3, -2 / 3, 0.0], rtol=1e-14)


def test_directions_serve_the_next_iteration():
    """Other slopes, one spring less and one more: forces of the springs that are there, exactly."""
    rng = np.random.default_rng(3)
    whole = rng.standard_normal((9, 9))
    compliance = whole @ whole.T + np.eye(9)
    responses = np.zeros((stiff_rows._MOST, 9))  # motions of all nine
    solves = []

    def solve(keys, slopes, motions, earlier=None):
        keys = np.array(keys)
        rows = SimpleNamespace(motions=lambda: motions[keys])
        made = stiff_rows._Forces(rows, slopes, SimpleNamespace(sum=lambda v: v), keys)
        if earlier is not None:
            made.follow(earlier)

        def respond(forces, number):
            solves.append(number)
            responses[number] = compliance[:, keys] @ forces
            return responses[number, keys]

        def recall(number, new):
            responses[new] = responses[number]
            return responses[new, keys]

        parts = made.solve(respond, recall, leave_soft=False)
        moved = parts @ responses[: len(parts)]
        exact = np.linalg.solve(compliance[np.ix_(keys, keys)] + np.diag(1 / slopes), motions[keys])
        # 1e-2 of the springs' forces is what a solve leaves; forces of the spring that has gone,
        # left in the directions, would be off by a tenth
        np.testing.assert_allclose(
            moved, compliance[:, keys] @ exact, atol=0.03 * np.abs(moved).max()
        )
        return made

    motions = rng.standard_normal(9)
    first = solve(range(8), np.geomspace(1e2, 1e4, 8), motions)
    count = len(solves)
    solve([0, 1, 2, 3, 5, 6, 7, 8], np.geomspace(1e4, 1e3, 8), motions, first)
    # without the directions there are as many again
    assert count >= 6
    assert len(solves) - count <= 3
