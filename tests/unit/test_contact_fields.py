# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of points with obstacles by their signed distance: work, tangents, safe motions."""

from functools import cache

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem._faults import watched
from flexfem.contact.fields.ccd import safe_part
from flexfem.contact.fields.data import FIELD_NUMBERS, FieldPairs
from flexfem.contact.fields.obstacles import Obstacle, Obstacles, arms_of
from flexfem.contact.fields.search import Stations, find_pairs
from flexfem.contact.fields.shapes import distance_of
from flexfem.contact.fields.statics import forces_at_rest
from flexfem.contact.fields.steps import forces_of_step
from flexfem.contact.fields.tangents import add_actions, blocks_into
from flexfem.contact.primitives.data import GAP, NORMAL, POTENTIAL, SLOPE, Pairs, Response
from flexfem.contact.primitives.tangents import add_actions as add_actions_of_cells
from flexfem.contact.primitives.tangents import add_forces, potential
from flexfem.lie import se3
from tests.unit.primitive_pairs import alone, at_rest, of_step

pytestmark = pytest.mark.serial
RNG = np.random.default_rng
GROUND = ff.Ground()
RADIUS, DHAT = 0.05, 0.2


def torus(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.3


def torus_in_ufl(x):
    return ufl.sqrt((ufl.sqrt(x[0] ** 2 + x[1] ** 2) - 1.0) ** 2 + x[2] ** 2) - 0.3


def ellipsoid(points):
    """Not quite a distance: its slope is 1 at the surface only."""
    axes = np.array([1.0, 0.6, 0.4])
    inner = np.linalg.norm(points / axes, axis=1)
    outer = np.linalg.norm(points / axes**2, axis=1)
    return inner * (inner - 1.0) / np.maximum(outer, 1e-12)


def block(points):
    beside = np.abs(points) - [0.5, 0.3, 0.2]
    return np.linalg.norm(np.maximum(beside, 0.0), axis=1) + np.minimum(beside.max(axis=1), 0.0)


@cache
def surfaces():
    """One of each kind."""
    return {
        "plane": ff.RigidPlane(GROUND),
        "sphere": ff.RigidSphere(GROUND, 0.7),
        "hollow": ff.RigidSphere(GROUND, 1.5, inside=True),
        "rod": ff.RigidCylinder(GROUND, 0.5),
        "disc": ff.RigidCylinder(GROUND, 0.6, 0.8),
        "bore": ff.RigidCylinder(GROUND, 1.2, inside=True),
        "ring": ff.RigidCylinder(GROUND, 0.9, 1.0, inside=True),
        "torus": ff.RigidObstacle(GROUND, torus, [(-1.4, -1.4, -0.4), (1.4, 1.4, 0.4)]),
        "UFL": ff.RigidObstacle(GROUND, torus_in_ufl, [(-1.4, -1.4, -0.4), (1.4, 1.4, 0.4)]),
        "ellipsoid": ff.RigidObstacle(GROUND, ellipsoid, [(-1.1, -0.7, -0.5), (1.1, 0.7, 0.5)]),
        "block": ff.RigidObstacle(GROUND, block, [(-0.6, -0.4, -0.3), (0.6, 0.4, 0.3)]),
    }


KINDS = [
    "plane", "sphere", "hollow", "rod", "disc", "bore", "ring", "torus", "UFL", "ellipsoid",
    "block",
]  # fmt: skip


def scene(names, rng, count=100, twist=0.05, way=0.08):
    """Turned obstacles with points near them, then their own points, and a motion of all."""
    frames = se3.exp(rng.uniform(-1.0, 1.0, (len(names), 6)))
    every = Obstacles([
        Obstacle(distance_of(surfaces()[name]), count + 4 * f + np.arange(4), 0.5 + f)
        for f, name in enumerate(names)
    ])  # fmt: skip
    fields = rng.integers(0, len(names), count)
    arms = rng.uniform(-1.6, 1.6, (count, 3))
    _, feet = every.closest(fields, arms)
    ways = (arms - feet) / np.linalg.norm(arms - feet, axis=1)[:, None]
    points = placed(frames[fields], feet + rng.uniform(0.04, 0.4, (count, 1)) * ways)
    after = se3.retract(frames, twist * rng.standard_normal((len(names), 6)))
    moved = points + way * rng.standard_normal((count, 3))
    return every, fields, with_axes(every, points, frames), with_axes(every, moved, after)


def placed(frames, arms):
    return frames[:, :3] + np.einsum("kab,kb->ka", se3.rotation(frames), arms)


def with_axes(every, points, frames):
    """Positions of points and of those of the obstacles, whose frames are given."""
    own = [
        placed(np.broadcast_to(frame, (4, 12)), one.size * np.eye(4)[:, 1:])
        for one, frame in zip(every.every, frames, strict=True)
    ]
    at = every.placed(np.concatenate([points, *own]))
    np.testing.assert_allclose(at.frames, frames, atol=1e-14)
    return at


def pairs_of(every, fields, rows=None):
    """Pairs of all points, or of some, with their obstacles."""
    rows, n = np.arange(len(fields)) if rows is None else rows, len(fields)
    points = np.column_stack([rows, every.points[fields[rows]]])
    return FieldPairs.of(
        points, fields[rows].astype(np.int64), np.linspace(0.5, 2.0, n)[rows],
        *(np.full(len(rows), value) for value in (RADIUS, DHAT, 3e3)),
    )  # fmt: skip


def free(every, fields, *ends):
    """The pairs that touch at no instant, nor on half of the way."""
    keep = np.ones(len(fields), bool)
    for one in ends:
        arms = arms_of(one.points[: len(fields)], one.frames[fields])
        keep &= every.closest(fields, arms)[0] > RADIUS + 5e-3
    return pairs_of(every, fields, np.flatnonzero(keep))


def rest(every, found, at, bends=True):
    state, response = every.state(found, at), Response.of(found.pairs, FIELD_NUMBERS)
    second = every.bends(found, at, state) if bends else np.zeros((found.count, 9))
    forces_at_rest(found.pairs.memory, state.memory, second, response.memory)
    return response


def stepped(every, found, before, after):
    response = Response.of(found.pairs, FIELD_NUMBERS)
    start, end = (every.state(found, at) for at in (before, after))
    forces_of_step(found.pairs.memory, start.memory, end.memory, response.memory)
    return response


@pytest.mark.parametrize("name", KINDS)
def test_steps_do_exactly_the_work_of_the_potential(name):
    rng = RNG(sum(map(ord, name)))
    # fourth-order differences of the block miss its edges by some 1e-12
    exact = 1e-10 if name == "block" else 1e-12
    every, fields, before, after = scene([name, name], rng)
    pairs = free(every, fields, before, after)
    response = stepped(every, pairs, before, after)
    rows, numbers, forces = response.rows()
    assert len(rows) > 10
    assert numbers[:, SLOPE].min() >= 0.0
    u0, u1 = (potential(rest(every, pairs, x, False).memory) for x in (before, after))
    np.testing.assert_allclose(potential(response.memory), u1, rtol=exact)
    moves = (after.points - before.points)[pairs.pairs.points[rows]]
    size = np.abs(forces * moves).sum()
    # forces at one end miss a tenth of it
    assert abs((forces * moves).sum() + u1 - u0) < exact * size
    largest = np.abs(forces).max()
    np.testing.assert_allclose(forces.sum(axis=1), 0.0, atol=1e-13 * largest)
    middles = 0.5 * (before.points + after.points)[pairs.pairs.points[rows]]
    np.testing.assert_allclose(np.cross(middles, forces).sum(axis=1), 0.0, atol=1e-12 * largest)
    along = np.cross(numbers[:, None, NORMAL : NORMAL + 3], forces)
    np.testing.assert_allclose(along, 0.0, atol=1e-13 * largest)


def forces_at(every, found, points):
    at = every.placed(points)
    response, sums = rest(every, found, at, False), np.zeros_like(points)
    add_forces(found.pairs.memory, response.memory, 1.0, sums)
    return sums, potential(response.memory)


@pytest.mark.parametrize("name", KINDS)
def test_forces_at_rest_are_gradients_with_their_tangents(name):
    """Of all motions in which obstacles stay rigid."""
    rng = RNG(len(name))
    every, fields, at, _ = scene([name, name], rng)
    pairs = free(every, fields, at)
    response, n = rest(every, pairs, at), len(fields)
    assert response.count[0] > 5
    steps, twists = rng.standard_normal((n, 3)), rng.standard_normal((2, 6))
    h = 1e-6
    ends = [
        with_axes(every, at.points[:n] + s * steps, se3.retract(at.frames, s * twists)).points
        for s in (h, -h)
    ]
    ways = (ends[0] - ends[1]) / (2 * h)
    found = [forces_at(every, pairs, end) for end in ends]
    sums, _ = forces_at(every, pairs, at.points)
    change = (found[0][1] - found[1][1]) / (2 * h)
    # differences; a force at the wrong place misses much more
    np.testing.assert_allclose((sums * ways).sum(), -change, rtol=1e-5,
                               atol=1e-7 * np.abs(sums).sum())  # fmt: skip
    action = np.zeros_like(sums)
    add_actions(pairs.pairs.memory, response.memory, 1.0, ways, action)
    wanted = (found[1][0] - found[0][0]) / (2 * h)
    # second differences of the closest points; without the curvature of the obstacle 1e-1 is off
    np.testing.assert_allclose(action, wanted, atol=2e-4 * np.abs(wanted).max())
    _same_as_blocks(pairs, response, ways, action)


def _same_as_blocks(found, response, steps, action):
    blocks, sums = np.zeros((int(response.count[0]), 15, 15)), np.zeros_like(action)
    blocks_into(response.memory, 1.0, blocks)
    rows = found.pairs.points[response.rows()[0]]
    moved = np.einsum("cpq,cq->cp", blocks, steps[rows].reshape(-1, 15))
    np.add.at(sums, rows.ravel(), moved.reshape(-1, 3))
    np.testing.assert_allclose(sums, action, atol=1e-12 * np.abs(action).max())
    np.testing.assert_allclose(blocks, blocks.swapaxes(1, 2), rtol=1e-12, atol=1e-12 * blocks.max())


def test_the_slope_of_a_step_is_that_of_the_approach():
    rng = RNG(4)
    every, fields, before, after = scene(["plane", "plane"], rng, twist=0.0, way=0.03)
    found = free(every, fields, before, after)
    response = stepped(every, found, before, after)
    rows, numbers, _ = response.rows()
    n = numbers[:, NORMAL : NORMAL + 3]
    steps, h, points = np.zeros_like(after.points), 1e-7, found.pairs.points[:, 0]
    steps[points[rows]] = n
    forces = []
    for sign in (1, -1):
        other = every.placed(after.points + sign * h * steps)
        kept, _, each = stepped(every, found, before, other).rows()
        forces.append(dict(zip(kept.tolist(), each[:, 0], strict=True)))
    both = [k for k, p in enumerate(rows) if p in forces[0] and p in forces[1]]
    slopes = [(forces[1][rows[k]] - forces[0][rows[k]]) @ n[k] / (2 * h) for k in both]
    scale = numbers[:, SLOPE].max()
    np.testing.assert_allclose(numbers[both, SLOPE], slopes, rtol=1e-4, atol=1e-5 * scale)
    action = np.zeros_like(steps)
    add_actions(found.pairs.memory, response.memory, 1.0, steps, action)
    wanted = numbers[:, SLOPE, None] * n
    np.testing.assert_allclose(action[points[rows]], wanted, atol=1e-9 * scale)
    _same_as_blocks(found, response, steps, action)


def test_a_sphere_is_a_point_with_a_radius():
    rng, n = RNG(5), 200
    every = Obstacles([Obstacle(distance_of(surfaces()["sphere"]), n + np.arange(4), 1.0)])
    directions = rng.standard_normal((n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = directions * rng.uniform(0.76, 1.0, (n, 1))
    found = pairs_of(every, np.zeros(n, int))
    other = alone(np.zeros(n, int), 0.7 + RADIUS, DHAT)
    other = Pairs(
        kind=other.kind, points=other.points, weight=found.pairs.weight, touch=other.touch,
        dhat=other.dhat, kappa=found.pairs.kappa, starts=other.starts,
        keys=other.keys,
    )  # fmt: skip

    def vertices(x):
        whole = np.zeros((4 * n, 3))
        whole[0::4] = x
        return whole

    def at(x):
        return with_axes(every, x, se3.exp(np.zeros((1, 6))))

    forces, known = at_rest(other, vertices(points))
    response = rest(every, found, at(points))
    rows, numbers, own = response.rows()
    np.testing.assert_allclose(own[:, 0], forces[0::4][rows], rtol=1e-9)
    np.testing.assert_array_equal(rows, known.rows()[0])
    steps, tangents = np.zeros((n + 4, 3)), (np.zeros((n + 4, 3)), np.zeros((4 * n, 3)))
    steps[:n] = rng.standard_normal(points.shape)
    add_actions(found.pairs.memory, response.memory, 1.0, steps, tangents[0])
    add_actions_of_cells(other.memory, known.memory, 1.0, vertices(steps[:n]), tangents[1])
    np.testing.assert_allclose(
        tangents[0][:n], tangents[1][0::4], atol=1e-5 * np.abs(tangents[0]).max()
    )
    after = points * rng.uniform(0.99, 1.02, (n, 1))  # along the radius mean lines are the same
    forces, known = of_step(other, vertices(points), vertices(after))
    rows, numbers, own = stepped(every, found, at(points), at(after)).rows()
    np.testing.assert_allclose(
        own[:, 0], forces[0::4][rows], rtol=1e-9, atol=1e-9 * np.abs(own).max()
    )
    for column, exact in ((GAP, 1e-9), (POTENTIAL, 1e-9), (SLOPE, 1e-6)):
        same = known.rows()[1][:, column]
        np.testing.assert_allclose(numbers[:, column], same, rtol=exact, atol=1e-12)


def test_a_function_in_python_is_that_in_ufl():
    points = RNG(1).uniform(-1.5, 1.5, (500, 3))
    one, other = (surfaces()[name].surface for name in ("torus", "UFL"))
    (d, c), (e, f) = one.closest(points), other.closest(points)
    np.testing.assert_allclose(d, torus(points), atol=1e-15)
    np.testing.assert_allclose(d, e, atol=1e-15)
    # the direction of differences
    np.testing.assert_allclose(c, f, atol=1e-6)
    np.testing.assert_allclose(torus(c), 0.0, atol=1e-15)


def test_what_is_no_distance_is_touched_at_its_surface():
    rng = RNG(2)
    on = rng.standard_normal((500, 3))
    on *= np.array([1.0, 0.6, 0.4]) / np.linalg.norm(on, axis=1)[:, None]
    normal = on / np.array([1.0, 0.6, 0.4]) ** 2
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    out = rng.uniform(1e-3, 0.5, (500, 1))
    distance, feet = surfaces()["ellipsoid"].surface.closest(on + out * normal)
    # values of the function are off by a tenth
    np.testing.assert_allclose(distance, out[:, 0], rtol=1e-12)
    np.testing.assert_allclose(feet, on, atol=1e-6)


@pytest.mark.parametrize("name", [kind for kind in KINDS if kind != "UFL"])
def test_safe_motions_pass_through_nothing(name):
    rng, keep = RNG(7 + len(name)), 0.1
    parts, stops = [], 0
    for _ in range(1 if name == "ellipsoid" else 6):
        every, fields, before, after = scene([name], rng, 25, twist=0.5, way=0.5)
        ways = np.linalg.norm(after.points - before.points, axis=1)
        found = find_pairs(every, all_of(fields), before, ways)
        start = every.state(found, before)
        found = pairs_of(every, fields, found.pairs.points[start.distance > RADIUS, 0])
        gaps = np.minimum(every.state(found, before).distance - RADIUS, DHAT)
        part = safe_part(every, found, before, after, keep)
        assert part > 0.0
        whole = free(every, fields, before)
        w = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
        x0, dx = (x[:25] for x in (before.points, after.points - before.points))

        def at(t):
            return with_axes(every, x0 + t * dx, se3.retract(before.frames, t * w))  # noqa: B023

        for t in part * np.linspace(0.0, 1.0, 15):
            distance = every.state(found, at(t)).distance
            assert (distance - RADIUS >= keep * gaps * (1 - 1e-9)).all()
            # nor does one that was not found
            assert (every.state(whole, at(t)).distance > RADIUS).all()
        if part < 1.0:
            distance = every.state(found, at(min(part + 0.02, 1.0))).distance
            stops += bool((distance - RADIUS < 0.5 * gaps).any())
        parts.append(part)
    assert min(parts) < 1.0
    # it does not end for nothing
    assert stops >= 0.7 * sum(part < 1.0 for part in parts)


def all_of(fields, obstacles=1):
    n = len(fields)
    return Stations(
        np.arange(n), np.full(n, RADIUS), np.full(n, DHAT), np.full(n, 3e3), np.ones(n),
        fields[:, None] == np.arange(obstacles),
    )  # fmt: skip


def test_sliding_points_are_not_held_up():
    # gaps of a thousandth of the way: by distances alone this takes a thousand steps
    for name, x, ends in (
        ("plane", [-0.3, 0.0, RADIUS + 1e-3], [[0.7, 0.0, RADIUS + 1e-3]]),
        ("bore", [0.0, 1.2 - RADIUS - 1e-3, 0.0], [[0.0, 1.2 - RADIUS - 1e-3, 1.0],
                                                  [0.0, -1.2 + RADIUS + 1e-3, 0.0]]),
    ):  # fmt: skip
        every = Obstacles([Obstacle(distance_of(surfaces()[name]), 1 + np.arange(4), 1.0)])
        found, frames = pairs_of(every, np.zeros(1, int)), se3.exp(np.zeros((1, 6)))
        before = with_axes(every, np.array([x]), frames)
        for end in ends:
            after = with_axes(every, np.array([end]), frames)
            assert safe_part(every, found, before, after, 0.1) == 1.0


def test_pairs_are_those_that_come_near():
    rng = RNG(9)
    every, fields, before, after = scene(["torus", "disc"], rng, 1000)
    n = len(fields)
    away = np.zeros((n, 3))
    away[:500] = 2.0 * rng.standard_normal((500, 3))
    before.points[:n] += away
    after.points[:n] += away
    dx = after.points - before.points
    slack = np.linalg.norm(dx, axis=1)
    found = find_pairs(every, all_of(fields, 2), before, slack)
    w = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
    for t in (0.0, 0.3, 0.7, 1.0):
        frames = se3.retract(before.frames, t * w)
        arms = arms_of(before.points[:n] + t * dx[:n], frames[fields])
        near = every.closest(fields, arms)[0] < RADIUS + DHAT
        assert np.isin(np.flatnonzero(near), found.pairs.points[:, 0]).all()
    assert found.count < 0.8 * n


def test_a_function_that_fails_in_a_run_is_noted_and_acts_as_nan():
    broken = []

    def ball(points):
        assert not broken, "out of range"
        return np.linalg.norm(points, axis=1) - 0.7

    surface = ff.RigidObstacle(GROUND, ball, [(-1, -1, -1), (1, 1, 1)])
    every = Obstacles([Obstacle(distance_of(surface), 1 + np.arange(4), 1.0)])
    at = with_axes(every, np.array([[0.0, 0.0, 0.8]]), se3.exp(np.zeros((1, 6))))
    broken.append(True)
    with watched() as faults:
        found = find_pairs(every, all_of(np.zeros(1, int)), at, np.zeros(5))
        assert found.count == 1
        assert np.isnan(stepped(every, found, at, at).rows()[2]).all()
        assert safe_part(every, found, at, at, 0.1) == 0.0
    assert str(faults.error).startswith("RigidObstacle on the ground: ball (test_contact_fields.py")
    assert "AssertionError: out of range" in str(faults.error)
