# SPDX-License-Identifier: LGPL-3.0-or-later
"""Redundant constraints: found and named, or carried with the least multipliers."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.la.dependence import NodeRows, dependence_count, groups, null_vectors
from flexfem.lie import se3, so3
from flexfem.simulation.motion.stepping import Simulation

POLICIES = ("auto", "updated", "frozen")
X = np.array([1.0, 0.0, 0.0])
GRAVITY = ff.Gravity((0.3, -9.81, 0.4))


def _simulation(model: ff.Model, **options: object) -> Simulation:
    settings = {"rho_inf": 1.0, "tolerance": 1e-10, "redundant_constraints": "least_norm"} | options
    simulation = Simulation(model, RunOptions(dt=1e-3, t_end=1.0, **settings))
    assert simulation.status is Status.OK
    return simulation


def _rod(name: str, start: np.ndarray, end: np.ndarray) -> ff.RigidBody:
    """Slender rod of 1 kg/m, its reference point in the middle."""
    arm = end - start
    length = float(np.linalg.norm(arm))
    inertia = length / 12.0 * (arm @ arm * np.eye(3) - np.outer(arm, arm)) + 1e-4 * np.eye(3)
    return ff.RigidBody(name, length, inertia, position=0.5 * (start + end))


def _loop(points: np.ndarray, axes: np.ndarray) -> ff.Model:
    """Closed chain of rods between points, the first rod on the ground, a hinge at each point."""
    model, count = ff.Model("loop"), len(points)
    model.add(GRAVITY)
    centres = [0.5 * (points[i] + points[(i + 1) % count]) for i in range(count)]

    def marker(rod: int, point: int) -> ff.Marker | ff.Ground:
        if rod == 0:
            return ff.Ground(points[point])
        return ff.Marker(f"rod_{rod}", offset=points[point] - centres[rod])

    for i in range(1, count):
        model.add(_rod(f"rod_{i}", points[i], points[(i + 1) % count]))
    for i in range(count):
        model.add(ff.Revolute(f"hinge_{i}", marker((i - 1) % count, i), marker(i, i), axis=axes[i]))
    return model


def _door(hinges: int) -> ff.Model:
    model = ff.Model("door")
    model.add(ff.RigidBody("door", 12.0, (3.0, 1.0, 4.0), position=(0.5, 0.0, 1.0)), GRAVITY)
    for i, z in enumerate(np.linspace(0.2, 1.8, hinges)):
        marker = ff.Marker("door", offset=(-0.5, 0.0, z - 1.0))
        model.add(ff.Revolute(f"hinge_{i}", ff.Ground((0.0, 0.0, z)), marker, axis=(0, 0, 1)))
    return model


FOUR = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.2, 1.1, 0.0], [1.0, 0.0, 0.0]])
#: Bricard's mechanism: along six edges of a cube, each hinge perpendicular to both of its rods
SIX = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], dtype=float)
EDGES = np.roll(SIX, -1, axis=0) - SIX
MODELS = {
    "door-2": (lambda: _door(2), 5),
    "door-3": (lambda: _door(3), 10),
    "four-bar": (lambda: _loop(FOUR, np.tile([0.0, 0.0, 1.0], (4, 1))), 3),
    "bricard": (lambda: _loop(SIX, np.cross(np.roll(EDGES, 1, axis=0), EDGES)), 1),
}


def _table(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Gradients of all rows over all unknowns, and the multipliers, on every rank."""
    system = simulation.system
    rows, count = system.constraints, system.unknowns
    matrix, forces = np.zeros((rows.size_global, count)), np.zeros(rows.size_global)
    for t, r in enumerate(rows.row_of_term):
        for side, slot in enumerate(rows.term_nodes[t]):
            if slot >= 0 and rows.owned[r]:
                at = 6 * system.interface.number[slot]
                matrix[rows.numbers[r], at : at + 6] += rows.force_jacobian[t, side]
    forces[rows.numbers] = rows.owned * rows.forces
    return system.comm.allreduce(matrix), system.comm.allreduce(forces)


def _energy(simulation: Simulation) -> float:
    total = 0.0
    for part in simulation.system.parts:
        n = part.block.owned
        v, x = part.block.velocity[:n], se3.position(part.block.frames[:n])
        masses = np.zeros((n, 6, 6))
        np.add.at(masses, part.masses.nodes, part.masses.matrices)
        total += 0.5 * np.einsum("ni,nij,nj->", v, masses, v)
        total -= np.einsum("n,ni,i->", masses[:, 0, 0], x, GRAVITY.acceleration)
    return simulation.system.comm.allreduce(total)


@pytest.mark.parametrize(
    "policy", ["auto", *(pytest.param(p, marks=pytest.mark.serial) for p in POLICIES[1:])]
)
@pytest.mark.parametrize("name", MODELS)
def test_least_norm(name, policy):
    """Constraints hold, energy stays, and multipliers are those of the pseudo-inverse."""
    make, excess = MODELS[name]
    simulation = _simulation(make(), iteration_matrix=policy)
    before = _energy(simulation)
    start = [p.block.frames.copy() for p in simulation.system.parts]
    for _ in range(60):
        assert simulation.advance(1e-3) is Status.OK
    matrix, forces = _table(simulation)
    sizes = np.linalg.svd(matrix)[1]
    assert len(forces) - int(np.sum(sizes > 1e-6)) == excess
    smallest = np.linalg.lstsq(matrix.T, matrix.T @ forces, rcond=1e-6)[0]
    # a solution of some factorisation has a part of order 1 among the dependent rows
    np.testing.assert_allclose(forces, smallest, atol=1e-4 * np.abs(forces).max())
    # an unrelaxed or drifting constraint would open by 1e-6 and more
    rows = simulation.system.constraints
    gaps = rows.values + rows.relaxation * rows.multipliers
    assert np.abs(gaps).max(initial=0.0) < 1e-9
    moved = [np.abs(p.block.frames - f).max(initial=0.0)
             for p, f in zip(simulation.system.parts, start, strict=True)]  # fmt: skip
    assert simulation.system.comm.allreduce(max(moved)) > 1e-3
    # multipliers that did work would change the energy at the rate of the weight's
    assert _energy(simulation) == pytest.approx(before, abs=1e-5)
    assert simulation.rejected == 0


def test_hinges_carry_the_same_as_one():
    """The sum of the wrenches of three hinges is that of one, at rest and in motion."""
    totals = []
    for hinges in (1, 3):
        simulation = _simulation(_door(hinges), rho_inf=0.5)
        for _ in range(50):
            assert simulation.advance(1e-3) is Status.OK
        rows = simulation.system.constraints
        total = np.zeros(6)
        for i, placed in enumerate(rows.joints):
            if placed.owned:
                m = rows.marker_start[i] + 1
                w, x = rows.reactions(rows.forces)[m], rows.poses[m, :3]
                total += np.concatenate([w[:3], w[3:] + np.cross(x, w[:3])])
        totals.append(simulation.system.comm.allreduce(total))
    # 118 N of weight and its moment; the compliance starts with a transient, damped by then
    np.testing.assert_allclose(totals[1], totals[0], atol=1e-5)


@pytest.mark.parametrize("name", MODELS)
def test_refused_by_default(name):
    make, excess = MODELS[name]
    with pytest.raises(ValueError, match=rf'"hinge_0".* {excess} of \d+ constraints are redundant'):
        Simulation(make(), RunOptions(dt=1e-3, t_end=1.0))


def _long_chain(links: int, doubled: int | None) -> ff.Model:
    """Rigid links on revolute joints; one joint may be doubled by a pin at the same place."""
    model = ff.Model("chain")
    previous: ff.Marker | ff.Ground = ff.Ground()
    for i in range(links):
        start, name = np.array([i, 0.0, 0.0]), f"link_{i}"
        model.add(_rod(name, start, start + X))
        first = ff.Marker(name, offset=(-0.5, 0.0, 0.0))
        model.add(ff.Revolute(f"joint_{i}", previous, first, axis=(0.0, np.cos(i), np.sin(i))))
        if i == doubled:
            model.add(ff.Spherical("pin", previous, first))
        previous = ff.Marker(name, offset=(0.5, 0.0, 0.0))
    return model


@pytest.mark.serial
def test_long_chains_are_looked_at_too():
    """More rows than singular values can be computed of, in a time linear in their number."""
    options = RunOptions(dt=1e-3, t_end=1.0)
    Simulation(_long_chain(100, None), options)
    with pytest.raises(ValueError, match="redundant") as raised:
        Simulation(_long_chain(100, 60), options)
    # only the guilty ones, not their neighbours
    text = str(raised.value)
    assert text.startswith('Revolute "joint_60", Spherical "pin": 3 of 8 constraints are redundant')


def _chain_rows(links: int, twice: tuple[int, ...] = ()) -> NodeRows:
    """Five rows of each hinge about e2 of links of 1 m in a row; some hinges are there twice."""
    gradient = np.zeros((5, 2, 6))
    for side, sign in enumerate((-1.0, 1.0)):
        arm = np.array([-0.5 * sign, 0.0, 0.0])
        gradient[:3, side, :3] = sign * np.eye(3)
        gradient[:3, side, 3:] = -sign * so3.skew(arm)
        gradient[3:, side, 3:] = sign * np.eye(3)[[0, 2]]
    hinges = np.array([*range(links), *twice])
    nodes = np.repeat(np.stack([hinges - 1, hinges], axis=1), 5, axis=0)
    return NodeRows(np.arange(5 * len(hinges)), nodes, np.tile(gradient, (len(hinges), 1, 1)))


@pytest.mark.serial
def test_long_chains_are_not_taken_for_redundant():
    """The smallest singular value of n links is (pi / 2)^2 / n^2, where it is clamped at one end.

    With squares of singular values 6e3 links and more were refused, and redundant hinges of long
    chains not told from the chain itself.
    """
    links = 8000
    (terms,) = groups(_chain_rows(links))
    _, none = null_vectors(_chain_rows(links), terms)
    assert none.shape[1] == 0
    assert dependence_count(_chain_rows(links)) == 0
    rows = _chain_rows(links, (17,))
    (terms,) = groups(rows)
    group, null = null_vectors(rows, terms)
    assert null.shape[1] == 5
    # the rows of hinge 17 and its copy, and no others: parts of others are round-off
    part = np.abs(null).max(axis=1) > 1e-6
    assert set(group[part].tolist()) == {*range(85, 90), *range(5 * links, 5 * links + 5)}
    assert dependence_count(rows) == 5
    # more than the inverse iteration has vectors
    assert dependence_count(_chain_rows(1000, (17, 300, 600))) == 15
