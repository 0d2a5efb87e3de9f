# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kept factors: responses of bodies, the multipliers' system, continued stresses, renewal."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem._types import IndexArray, IntArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.families.shell_rotation_free import triangles as rotation_free
from flexfem.la.factor import Factor
from flexfem.simulation.dynamics import simulate
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.frozen import bodies as frozen_bodies
from flexfem.solvers.frozen import interface
from flexfem.solvers.frozen.solver import FrozenSolver, Worst
from flexfem.solvers.linear.condensed import CondensedFactor
from flexfem.solvers.linear.multiplier_system import InterfaceSystem
from flexfem.solvers.linear.schur_kernels import BodyColumns
from flexfem.solvers.linear.symmetric_fronts import NodeTree
from flexfem.system.system import BlockPart, Shifts, System

COMM = MPI.COMM_WORLD


def _folded(damping: float = 0.0) -> ff.Model:
    """Two panels hinged along a line, one of them on the ground, a body and a beam on the other."""
    first = ff.SurfaceMesh.grid("a", np.linspace(0, 1, 5), np.linspace(0, 0.4, 3))
    second = ff.SurfaceMesh.grid(
        "b", np.linspace(0, 1, 5), np.linspace(0.4, 0.8, 3),
        lambda p: np.column_stack([p, 0.5 * (p[:, 1] - 0.4)]),
    )  # fmt: skip
    section = ff.ShellSection.isotropic(2e-3, ff.Material(7e9, 0.3, 2000.0))
    model = ff.Model("folded", surface=ff.SurfaceMesh.join([first, second]))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("a", section, edges={"a_bottom": "hinged"}, damping=damping),
        ff.Shell("b", section, damping=damping),
        ff.HingeLine("hinge", ff.ShellLine("a", "a_top"), ff.ShellLine("b", "b_bottom")),
        ff.RigidBody("bar", 1.0, (0.1, 0.01, 0.1), position=(0.5, 0.8, 0.2)),
        ff.HingeLine("hanger", ff.ShellLine("b", "b_top"), ff.Marker("bar")),
        ff.SpringDamper("spring", ff.Ground((0.5, 2.0, 1.0)), ff.Marker("bar"), stiffness=50.0),
        ff.PositionProbe("bar_at", ff.Marker("bar")),
    )
    return model


def _run(model: ff.Model, policy: str = "auto", steps: int = 30, dt: float = 5e-3, **options):
    return simulate(model, RunOptions(dt=dt, t_end=steps * dt, iteration_matrix=policy, **options))


@pytest.mark.three_ranks
def test_bodies_respond_by_kept_rows_or_by_another_solve(monkeypatch):
    """Or by half a solve; the cheapest depends on the sizes, the motion does not."""
    histories, made = [], list[CondensedFactor | None]()
    for entries in (0, 10**12):  # any rows are more, none are
        monkeypatch.setattr(Factor, "entries", property(lambda self, n=entries: n))
        histories.append(_run(_folded(), "frozen").history)
    condensed = CondensedFactor.of
    for name in ("_ALONE", "_CONDENSED"):
        monkeypatch.setattr(frozen_bodies, name, 1)
    monkeypatch.setattr(
        CondensedFactor, "of", lambda *args: made.append(condensed(*args)) or made[-1]
    )
    histories.append(_run(_folded(), "frozen").history)
    assert all(made)
    assert COMM.allreduce(len(made)) == 2  # one for each panel
    for history in histories[1:]:
        for name in history:
            # all converge to 1e-6; a force of a joint left out moves the bar by 1e-2
            np.testing.assert_allclose(histories[0][name], history[name], rtol=0.0, atol=1e-9)


def _accordion(panels: int = 6) -> ff.Model:
    """Hinged panels folded this way and that, the mirror images of one another."""
    x, y = np.linspace(0, 1, 5), np.linspace(0, 0.4, 4)
    meshes = [
        ff.SurfaceMesh.grid(
            f"p{k}", x, y + 0.4 * k,
            lambda p, k=k: np.column_stack([p, 0.5 * (p[:, 1] - 0.4 * k if k % 2 else
                                                      0.4 * (k + 1) - p[:, 1])]),
        ) for k in range(panels)
    ]  # fmt: skip
    section = ff.ShellSection.isotropic(2e-3, ff.Material(7e9, 0.3, 2000.0))
    model = ff.Model("accordion", surface=ff.SurfaceMesh.join(meshes))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for k in range(panels):
        edges = {"p0_bottom": "hinged"} if k == 0 else {}
        model.add(ff.Shell(f"p{k}", section, edges=edges))
    for k in range(1, panels):
        model.add(
            ff.HingeLine(
                f"h{k}", ff.ShellLine(f"p{k - 1}", f"p{k - 1}_top"),
                ff.ShellLine(f"p{k}", f"p{k}_bottom"),
            )
        )  # fmt: skip
    model.add(ff.PositionProbe("tip", ff.Marker(f"p{panels - 1}", (0.5, 0.4 * panels, 0.2))))
    return model


@pytest.mark.three_ranks
def test_congruent_panels_share_factors_until_one_is_factorised_again(monkeypatch):
    """The motion and the iterations are those of panels with factors of their own."""
    for name in ("_ALONE", "_CONDENSED"):
        monkeypatch.setattr(frozen_bodies, name, 1)
    begin, fronts, found = FrozenSolver.begin_step, [], []

    def begin_step(solver: FrozenSolver) -> None:
        begin(solver)
        (panels,) = solver._flexible
        if len(fronts) == 4:
            solver.renew(Worst([[1]], 0.3))
        if panels._kept is not None:
            fronts.append(COMM.allreduce(len({one.fronts for one in panels._kept.factors})))

    monkeypatch.setattr(FrozenSolver, "begin_step", begin_step)
    for shared in (True, False):
        if not shared:
            monkeypatch.setattr(NodeTree, "signs", lambda *args: None)
        fronts.clear()
        outcome = _run(_accordion(), "frozen", 8)
        found.append((outcome.history, outcome.summary["newton_iterations"], list(fronts)))
    (history, count, some), (others, iterations, every) = found
    assert set(every) == {6}
    assert max(some[:4]) < 6  # all but the first and the last panel have the same matrix
    assert min(some[4:]) > max(some[:4])  # one that shared on a rank does not any more
    # factors that are those of another panel would contract more slowly
    assert count == iterations
    for name in history:
        # round-off; steps themselves are below 1e-6
        np.testing.assert_allclose(history[name], others[name], rtol=0.0, atol=1e-11)


def test_multipliers_keep_their_factors_within_a_refined_step(monkeypatch):
    """And the motion is that of fresh matrices."""
    calls = []
    factor = InterfaceSystem.factor
    monkeypatch.setattr(
        InterfaceSystem, "factor", lambda self, *args: calls.append(1) or factor(self, *args)
    )
    outcome = _run(_folded(1e-3), "frozen", tolerance=1e-9)
    counts = outcome.summary
    assert counts["fallbacks"] == 0
    # one at the start of a step; one in each iteration would be more than twice as many
    assert len(calls) <= 1.3 * counts["steps"] < 0.6 * counts["newton_iterations"]
    fresh = _run(_folded(1e-3), "updated", tolerance=1e-9)
    for name, column in outcome.history.items():
        # steps below 1e-9; constraints that the kept factors miss would drift by 1e-6
        np.testing.assert_allclose(column, fresh.history[name], rtol=0.0, atol=1e-8)


@pytest.mark.three_ranks
def test_nodes_that_masses_do_not_couple_are_left_out_of_reported_forces(monkeypatch):
    """Of lumped masses; the forces are those of the whole system."""
    found, counts = [], []
    pairs_of = interface._coupled_pairs

    def watched(own: BodyColumns, whole: bool) -> tuple[IndexArray, IntArray] | None:
        pairs, every = pairs_of(own), int((np.diff(own.side_start) ** 2).sum())
        counts.append([every if whole or pairs is None else len(pairs.sides), every])
        return None if whole else pairs

    for whole in (True, False):
        monkeypatch.setattr(
            interface, "_coupled_pairs", lambda own, whole=whole: watched(own, whole)
        )
        model = _folded()
        model.add(ff.ReactionProbe("hanger_force", "hanger"))
        counts.clear()
        found.append(_run(model, "frozen", 5).history)
    coupled, every = COMM.allreduce(np.sum(counts, axis=0))
    assert coupled < 0.4 * every  # all of them if zeros were kept
    for name in found[0]:
        # round-off; without the couplings between rows they are off by 4e-8
        np.testing.assert_allclose(found[0][name], found[1][name], rtol=0.0, atol=1e-9)


@pytest.mark.three_ranks
def test_lumped_masses_are_factorised_node_by_node(monkeypatch):
    """Start and reported forces are those of matrices with the entries of the elements."""
    found, sizes = [], []
    pattern = frozen_bodies.part_pattern

    def watched(part, **kind):
        entries = pattern(part, **kind)
        if part.lumped:
            sizes.append(len(entries[0]) / max(part.block.owned, 1))
        return entries

    monkeypatch.setattr(frozen_bodies, "part_pattern", watched)
    for lumped in (True, False):
        if not lumped:
            monkeypatch.setattr(BlockPart, "lumped", False)
        model = _folded(1e-3)
        model.add(ff.PointMass("lamp", 0.3, ff.Marker("b", (0.5, 0.8, 0.2))))
        model.add(ff.ReactionProbe("hanger_force", "hanger"))
        found.append(_run(model, "frozen", 5).history)
    # 9 of a node, besides held ones and the lamp; with pairs of nodes there are more than 50
    assert COMM.allreduce(min(sizes), op=MPI.MAX) < 12
    for name in found[0]:
        # round-off of forces of 10 N, of which the lamp has 3 N
        np.testing.assert_allclose(found[0][name], found[1][name], rtol=0.0, atol=1e-9)


@pytest.mark.three_ranks
def test_damping_at_the_start_by_bodies_equals_that_of_the_whole_system(monkeypatch):
    """Accelerations of a motion that has just begun, by factors of bodies and of all at once."""
    accelerations = []
    for whole in (False, True):
        if whole:
            monkeypatch.setattr(FrozenSolver, "prepare", lambda self, shifts: False)
        simulation = Simulation(_folded(1e-2), RunOptions(dt=5e-3, t_end=5e-3))
        accelerations.append(
            [part.block.acceleration[: part.block.owned].copy() for part in simulation.system.parts]
        )
    for one, other in zip(*accelerations, strict=True):
        # round-off of 10 m/s^2; without damping the panels' differ by 0.1, and by 0.01 the bar's
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)


def _taut() -> ff.Model:
    """A foil that falls between two walls: it stretches far less than it moves."""
    mesh = ff.SurfaceMesh.grid(
        "foil", np.linspace(0, 1, 11), np.linspace(0, 0.2, 3),
        lambda p: np.column_stack([p, 0.02 * np.sin(9.0 * p[:, 0]) * (1.0 + p[:, 1])]),
    )  # fmt: skip
    section = ff.ShellSection.isotropic(1e-4, ff.Material(5e9, 0.3, 1400.0))
    model = ff.Model("taut", surface=mesh)
    edges = {"foil_left": "hinged", "foil_right": "hinged"}
    model.add(ff.Gravity((0.0, 0.0, -50.0)), ff.Shell("foil", section, edges=edges))
    return model


def test_continued_stresses_save_iterations(monkeypatch):
    """Rotating elements stretch within an iteration; stresses from that would lead astray."""
    iterations = []
    for continued in (True, False):
        if not continued:
            for name in ("accepted_strains", "continued_strains"):
                monkeypatch.setattr(System, name, lambda self, thin: self.present)
        summary = _run(_taut(), "updated", steps=40, dt=2e-3).summary
        iterations.append(summary["newton_iterations"] / summary["steps"])
    # 3.2 instead of 5.0 a step; without any effect they would be equal
    assert iterations[0] < 0.75 * iterations[1]


#: of the pull
RISE = ff.SmoothStep(0.0, 0.02)


def _strips() -> ff.Model:
    """A strip that is pulled along, more and more, and so gets stiff across; one hangs on it."""
    first = ff.SurfaceMesh.grid("slack", np.linspace(0, 1, 9), np.linspace(0, 0.2, 4))
    second = ff.SurfaceMesh.grid("pulled", np.linspace(0, 1, 9), np.linspace(0.2, 0.4, 4))
    section = ff.ShellSection.isotropic(1e-3, ff.Material(7e9, 0.3, 2000.0))
    model = ff.Model("strips", surface=ff.SurfaceMesh.join([first, second]))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("slack", section),
        ff.Shell("pulled", section, edges={"pulled_left": "hinged"}),
        ff.Spherical(
            "hook",
            ff.Marker("pulled", "pulled_bottom_right"),
            ff.Marker("slack", "slack_top_right"),
        ),
        ff.EdgeLoad("pull", "pulled", "pulled_right", (1e5, 0.0, 0.0), amplitude=RISE),
        ff.PositionProbe("slack_at", ff.Marker("slack", "slack_bottom_right")),
        ff.PositionProbe("pulled_at", ff.Marker("pulled", "pulled_top_right")),
    )
    return model


def test_bodies_that_changed_are_renewed_alone(monkeypatch):
    """Their compliances are those of fresh factors of all bodies, and the motion is the same."""
    monkeypatch.setattr(frozen_bodies, "_ALONE", 30)
    shares, renew = [], FrozenSolver.renew

    def checked(self, worst, strains):
        renew(self, worst, strains)
        shares.append(worst.share)
        if worst.share == 1.0:
            return
        (bodies,), (pieces,) = self._flexible, worst.pieces
        group = bodies.group.own
        at = [
            np.arange(*group.compliance_start[[b, b + 1]])
            for k in pieces
            for b in bodies.pieces[k].bodies
        ]
        renewed = group.compliances.copy()
        counted = self.system.counters.factorizations
        self.factor(self.shifts, strains)
        self.system.counters.factorizations = counted
        for chosen in at:
            # old ones differ by a third
            np.testing.assert_allclose(renewed[chosen], group.compliances[chosen], rtol=1e-9)

    monkeypatch.setattr(FrozenSolver, "renew", checked)
    outcome = _run(_strips(), steps=40, dt=2e-3, tolerance=1e-9)
    assert min(shares) < 1.0
    fresh = _run(_strips(), "updated", steps=40, dt=2e-3, tolerance=1e-9)
    for name, column in outcome.history.items():
        # steps below 1e-9; a residual that is left out moves the corners by 1e-3
        np.testing.assert_allclose(column, fresh.history[name], rtol=0.0, atol=1e-7)


@pytest.mark.three_ranks
def test_large_matrices_are_made_again_for_new_factors(monkeypatch):
    """They are released beside the factors, which are the same."""
    monkeypatch.setattr(frozen_bodies, "_ALONE", 30)
    made, pattern = [], frozen_bodies.part_pattern
    monkeypatch.setattr(
        frozen_bodies, "part_pattern", lambda part, **kind: made.append(1) or pattern(part, **kind)
    )
    system = Simulation(_strips(), RunOptions(dt=2e-3, t_end=2e-3)).system
    found = []
    for large in (10**9, 0):
        monkeypatch.setattr(frozen_bodies, "_LARGE", large)
        solver = FrozenSolver(system)
        made.clear()
        for velocity in (1e3, 2e3):
            solver.factor(Shifts(velocity, velocity**2, 1.0 / velocity**2))
            found.append(solver._flexible[0].group.own.compliances.copy())
        assert len(made) == (1 if large or solver._flexible[0].split else 2)
    np.testing.assert_array_equal(found[:2], found[2:])
    # of another step size: kept ones would be the same, or four times as large
    assert not np.array_equal(found[0], found[1]) or not found[0].size


@pytest.mark.serial
def test_compression_that_comes_and_goes_is_not_kept(monkeypatch):
    """Factors of a moment of compression are worse than those without it."""
    counts = []
    for pull in (rotation_free._pull, lambda stresses: None):
        monkeypatch.setattr(rotation_free, "_pull", pull)
        summary = _run(_taut(), steps=60, dt=2e-3).summary
        counts.append((summary["factorizations"], summary["fallbacks"]))
    # (26, 1) and (45, 5); without any effect they would be equal
    assert counts[0][0] < 0.75 * counts[1][0]
    assert counts[0][1] < counts[1][1]
