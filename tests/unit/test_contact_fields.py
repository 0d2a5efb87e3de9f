# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of points with obstacles by their signed distance: work, tangents, safe motions."""

from functools import cache

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem._faults import watched
from flexfem.contact.fields.ccd import safe_part
from flexfem.contact.fields.data import ARM, GAP, NORMAL, POTENTIAL, SLOPE, FieldPairs
from flexfem.contact.fields.data import FieldResponse as Response
from flexfem.contact.fields.obstacles import Obstacle, Obstacles, Placed, arms_of
from flexfem.contact.fields.search import Stations, deepest_overlap, find_pairs
from flexfem.contact.fields.shapes import distance_of
from flexfem.contact.fields.statics import forces_at_rest
from flexfem.contact.fields.steps import forces_of_step
from flexfem.contact.fields.tangents import (
    add_actions,
    add_forces,
    add_wrenches,
    maps_at_rest,
    maps_of_step,
    potential,
    rows_into,
)
from flexfem.contact.primitives import data as primitive
from flexfem.contact.primitives.data import Pairs
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
    """Obstacles on turned places of carriers, free points near them, and a motion of both."""
    places = se3.exp(rng.uniform(-0.8, 0.8, (len(names), 6)))
    every = Obstacles([
        Obstacle(distance_of(surfaces()[name]), place)
        for name, place in zip(names, places, strict=True)
    ])  # fmt: skip
    frames = se3.exp(rng.uniform(-1.0, 1.0, (len(names), 6)))
    fields = rng.integers(0, len(names), count)
    arms = rng.uniform(-1.6, 1.6, (count, 3))
    _, feet = every.closest(fields, arms)
    ways = (arms - feet) / np.linalg.norm(arms - feet, axis=1)[:, None]
    points = on_carriers(frames[fields], feet + rng.uniform(0.04, 0.4, (count, 1)) * ways)
    after = se3.retract(frames, twist * rng.standard_normal((len(names), 6)))
    before, moved = Placed(points, frames), points + way * rng.standard_normal((count, 3))
    return every, fields, before, Placed(moved, after)


def on_carriers(frames, arms):
    return frames[:, :3] + np.einsum("kab,kb->ka", se3.rotation(frames), arms)


def pairs_of(fields):
    n = len(fields)
    return FieldPairs(
        points=np.arange(n), fields=fields.astype(np.int64), touch=np.full(n, RADIUS),
        dhat=np.full(n, DHAT), kappa=np.full(n, 3e3), weight=np.linspace(0.5, 2.0, n),
    )  # fmt: skip


def free(every, fields, *placed):
    """The pairs that touch at no instant, nor on half of the way."""
    pairs = pairs_of(fields)
    keep = np.ones(len(fields), bool)
    for one in placed:
        keep &= every.state(pairs, one).distance > RADIUS + 5e-3
    rows = np.flatnonzero(keep)
    return FieldPairs(
        points=rows, fields=pairs.fields[rows],
        **{name: getattr(pairs, name)[rows] for name in ("touch", "dhat", "kappa", "weight")},
    )  # fmt: skip


def rest(every, pairs, at, bends=True):
    state, response = every.state(pairs, at), Response.of(pairs)
    second = every.bends(pairs, state) if bends else np.zeros((pairs.count, 9))
    forces_at_rest(pairs.memory, state.memory, second, response.memory)
    return state, response


def stepped(every, pairs, before, after):
    response, start, end = Response.of(pairs), every.state(pairs, before), every.state(pairs, after)
    forces_of_step(pairs.memory, start.memory, end.memory, response.memory)
    return end, response


@pytest.mark.parametrize("name", KINDS)
def test_steps_do_exactly_the_work_of_the_potential(name):
    rng = RNG(sum(map(ord, name)))
    # fourth-order differences of the block miss its edges by some 1e-12
    exact = 1e-10 if name == "block" else 1e-12
    every, fields, before, after = scene([name, name], rng)
    pairs = free(every, fields, before, after)
    end, response = stepped(every, pairs, before, after)
    rows, numbers, forces = response.rows()
    assert len(rows) > 10
    assert numbers[:, SLOPE].min() >= 0.0
    u0, u1 = (potential(rest(every, pairs, x, False)[1].memory) for x in (before, after))
    np.testing.assert_allclose(potential(response.memory), u1, rtol=exact)
    own, points = pairs.fields[rows], pairs.points[rows]
    ends = [on_carriers(x.frames[own], numbers[:, ARM : ARM + 3]) for x in (before, after)]
    moves = (after.points - before.points)[points] - (ends[1] - ends[0])
    size = np.abs(forces * moves).sum()
    # forces at one end miss a tenth of it
    assert abs((forces * moves).sum() + u1 - u0) < exact * size
    # pair by pair, in parts of what forces of some size do
    ways = 0.5 * (before.points + after.points)[points] - 0.5 * (ends[0] + ends[1])
    assert np.abs(np.cross(ways, forces)).max() < 1e-13 * np.abs(forces).max()
    np.testing.assert_allclose(np.cross(numbers[:, :3], forces), 0.0, atol=1e-13 * size)
    sums, wrenches = np.zeros_like(before.points), np.zeros((2, 6))
    add_forces(pairs.memory, response.memory, 1.0, sums)
    maps = maps_of_step(before.frames, after.frames)
    add_wrenches(pairs.memory, response.memory, maps, 1.0, wrenches)
    twists = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
    work = (sums * (after.points - before.points)).sum() + (wrenches * twists).sum()
    assert abs(work + u1 - u0) < exact * size
    assert np.isfinite(end.arms).all()


def moved(at, steps, twists, h):
    return Placed(at.points + h * steps, se3.retract(at.frames, h * twists))


def wrenches_at(every, pairs, at):
    _, response = rest(every, pairs, at, False)
    sums, wrenches = np.zeros_like(at.points), np.zeros((len(every), 6))
    add_forces(pairs.memory, response.memory, 1.0, sums)
    add_wrenches(pairs.memory, response.memory, maps_at_rest(at.frames), 1.0, wrenches)
    return sums, wrenches, potential(response.memory)


@pytest.mark.parametrize("name", KINDS)
def test_forces_at_rest_are_gradients_with_their_tangents(name):
    rng = RNG(len(name))
    every, fields, at, _ = scene([name, name], rng)
    pairs = free(every, fields, at)
    state, response = rest(every, pairs, at)
    assert response.count[0] > 5
    steps, twists = rng.standard_normal(at.points.shape), rng.standard_normal((2, 6))
    h = 1e-6
    ends = [wrenches_at(every, pairs, moved(at, steps, twists, s * h)) for s in (1, -1)]
    sums, wrenches, _ = wrenches_at(every, pairs, at)
    work = (sums * steps).sum() + (wrenches * twists).sum()
    change = (ends[0][2] - ends[1][2]) / (2 * h)
    # differences; a force of the wrong carrier or arm misses much more
    np.testing.assert_allclose(work, -change, rtol=1e-5, atol=1e-7 * np.abs(sums).sum())
    action, turned = np.zeros_like(sums), np.zeros((2, 6))
    add_actions(pairs.memory, state.memory, response.memory, 1.0, steps, twists, action, turned)
    wanted = [(ends[1][k] - ends[0][k]) / (2 * h) for k in range(2)]
    # second differences of the closest points; without the curvature of the obstacle 1e-1 is off
    np.testing.assert_allclose(action, wanted[0], atol=2e-4 * np.abs(wanted[0]).max())
    np.testing.assert_allclose(turned, wanted[1], atol=2e-4 * np.abs(wanted[1]).max())


def test_the_slope_of_a_step_is_that_of_the_approach():
    rng = RNG(4)
    every, fields, before, after = scene(["plane", "plane"], rng, way=0.03)
    after = Placed(after.points, before.frames)
    pairs = free(every, fields, before, after)
    end, response = stepped(every, pairs, before, after)
    rows, numbers, _ = response.rows()
    n = numbers[:, NORMAL : NORMAL + 3]
    steps = np.zeros_like(after.points)
    steps[pairs.points[rows]] = n
    h = 1e-7
    forces = []
    for sign in (1, -1):
        other = Placed(after.points + sign * h * steps, after.frames)
        kept, _, each = stepped(every, pairs, before, other)[1].rows()
        forces.append(dict(zip(kept.tolist(), each, strict=True)))
    both = [k for k, p in enumerate(rows) if p in forces[0] and p in forces[1]]
    slopes = [(forces[1][rows[k]] - forces[0][rows[k]]) @ n[k] / (2 * h) for k in both]
    scale = numbers[:, SLOPE].max()
    np.testing.assert_allclose(numbers[both, SLOPE], slopes, rtol=1e-4, atol=1e-5 * scale)
    lines = np.zeros((len(rows), 9))
    rows_into(pairs.memory, end.memory, response.memory, lines)
    twists, sums, wrenches = np.zeros((2, 6)), np.zeros_like(steps), np.zeros((2, 6))
    twists[:] = rng.standard_normal((2, 6))
    add_actions(pairs.memory, end.memory, response.memory, 1.0, steps, twists, sums, wrenches)
    own = pairs.fields[rows]
    gaps = np.einsum("ka,ka->k", lines[:, :3], n)
    gaps += np.einsum("ka,ka->k", lines[:, 3:], twists[own])
    wanted = (numbers[:, SLOPE] * gaps)[:, None] * lines
    np.testing.assert_allclose(sums[pairs.points[rows]], wanted[:, :3], atol=1e-9 * scale)
    total = np.zeros((2, 6))
    np.add.at(total, own, wanted[:, 3:])
    np.testing.assert_allclose(wrenches, total, atol=1e-9 * scale)


def test_a_sphere_is_a_point_with_a_radius():
    rng, n = RNG(5), 200
    every = Obstacles([Obstacle(distance_of(surfaces()["sphere"]), se3.exp(np.zeros(6)))])
    directions = rng.standard_normal((n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = directions * rng.uniform(0.76, 1.0, (n, 1))
    pairs = pairs_of(np.zeros(n, int))
    other = alone(np.zeros(n, int), 0.7 + RADIUS, DHAT)
    other = Pairs(
        kind=other.kind, points=other.points, weight=pairs.weight, touch=other.touch,
        dhat=other.dhat, kappa=pairs.kappa, starts=other.starts,
    )  # fmt: skip
    frame = se3.exp(np.zeros((1, 6)))

    def vertices(x):
        whole = np.zeros((4 * n, 3))
        whole[0::4] = x
        return whole

    forces, known = at_rest(other, vertices(points))
    _, response = rest(every, pairs, Placed(points, frame))
    rows, numbers, own = response.rows()
    np.testing.assert_allclose(own, forces[0::4][rows], rtol=1e-9)
    np.testing.assert_array_equal(rows, known.rows()[0])
    steps, tangents = np.zeros_like(points), (np.zeros_like(points), np.zeros((4 * n, 3)))
    steps[:] = rng.standard_normal(points.shape)
    state = every.state(pairs, Placed(points, frame))
    add_actions(
        pairs.memory, state.memory, response.memory, 1.0, steps, np.zeros((1, 6)), tangents[0],
        np.zeros((1, 6)),
    )  # fmt: skip
    from flexfem.contact.primitives import tangents as others

    others.add_actions(other.memory, known.memory, 1.0, vertices(steps), tangents[1])
    np.testing.assert_allclose(
        tangents[0], tangents[1][0::4], atol=1e-5 * np.abs(tangents[0]).max()
    )
    after = points * rng.uniform(0.99, 1.02, (n, 1))  # along the radius mean lines are the same
    forces, known = of_step(other, vertices(points), vertices(after))
    _, response = stepped(every, pairs, Placed(points, frame), Placed(after, frame))
    rows, numbers, own = response.rows()
    np.testing.assert_allclose(own, forces[0::4][rows], rtol=1e-9, atol=1e-9 * np.abs(own).max())
    columns = known.rows()[1]
    for mine, theirs in ((GAP, primitive.GAP), (POTENTIAL, primitive.POTENTIAL)):
        np.testing.assert_allclose(numbers[:, mine], columns[:, theirs], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(numbers[:, SLOPE], columns[:, primitive.SLOPE], rtol=1e-6)


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
        stations = all_of(fields)
        pairs = find_pairs(every, stations, before, after)
        start = every.state(pairs, before)
        pairs = chosen(pairs, start.distance > RADIUS)
        gaps = np.minimum(every.state(pairs, before).distance - RADIUS, DHAT)
        part = safe_part(every, pairs, before, after, keep)
        assert part > 0.0
        whole = free(every, fields, before)
        w = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
        x0, dx = before.points, after.points - before.points
        for t in part * np.linspace(0.0, 1.0, 15):
            at = Placed(x0 + t * dx, se3.retract(before.frames, t * w))
            distance = every.state(pairs, at).distance
            assert (distance - RADIUS >= keep * gaps * (1 - 1e-9)).all()
            # nor does one that was not found
            assert (every.state(whole, at).distance > RADIUS).all()
        if part < 1.0:
            later = min(part + 0.02, 1.0)
            at = Placed(x0 + later * dx, se3.retract(before.frames, later * w))
            lost = every.state(pairs, at).distance - RADIUS < 0.5 * gaps
            stops += bool(lost.any())
        parts.append(part)
    assert min(parts) < 1.0
    # it does not end for nothing
    assert stops >= 0.7 * sum(part < 1.0 for part in parts)


def all_of(fields):
    n = len(fields)
    return Stations(
        np.arange(n), np.full(n, RADIUS), np.full(n, DHAT), np.full(n, 3e3), np.ones(n),
        np.ones((n, 1), bool),
    )  # fmt: skip


def chosen(pairs, keep):
    names = ("points", "fields", "touch", "dhat", "kappa", "weight")
    return FieldPairs(**{name: getattr(pairs, name)[keep] for name in names})


def test_sliding_points_are_not_held_up():
    # gaps of a thousandth of the way: by distances alone this takes a thousand steps
    x = np.array([[-0.3, 0.0, RADIUS + 1e-3]])
    frames = se3.exp(np.zeros((1, 6)))
    every = Obstacles([Obstacle(distance_of(surfaces()["plane"]), frames[0])])
    pairs = pairs_of(np.zeros(1, int))
    assert safe_part(every, pairs, Placed(x, frames), Placed(x + np.eye(3)[0], frames), 0.1) == 1.0
    every = Obstacles([Obstacle(distance_of(surfaces()["bore"]), frames[0])])
    x = np.array([[0.0, 1.2 - RADIUS - 1e-3, 0.0]])
    for after in (x + np.eye(3)[2], x * [1, -1, 1]):
        assert safe_part(every, pairs, Placed(x, frames), Placed(after, frames), 0.1) == 1.0


def test_pairs_are_those_that_are_near_and_overlaps_are_named():
    rng = RNG(9)
    every, fields, before, after = scene(["torus", "disc"], rng, 1000)
    away = np.zeros((1000, 3))
    away[:500] = 2.0 * rng.standard_normal((500, 3))
    before.points[:] += away
    after.points[:] += away
    n = len(fields)
    stations = Stations(
        np.arange(n), np.full(n, RADIUS), np.full(n, DHAT), np.ones(n), np.ones(n),
        fields[:, None] == np.arange(2),
    )  # fmt: skip
    pairs = find_pairs(every, stations, before, after)
    for t in (0.0, 0.3, 0.7, 1.0):
        x = before.points + t * (after.points - before.points)
        w = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
        frames = se3.retract(before.frames, t * w)
        arms = arms_of(x, frames[fields])
        near = every.closest(fields, arms)[0] < RADIUS + DHAT
        assert np.isin(np.flatnonzero(near), pairs.points).all()
    assert pairs.count < 0.8 * n
    found = deepest_overlap(every, stations, before)
    depth = RADIUS - every.closest(fields, arms_of(before.points, before.frames[fields]))[0]
    assert found.row == np.argmax(depth)
    assert found.field == fields[found.row]
    np.testing.assert_allclose(found.depth, depth.max(), rtol=1e-12)
    gap = np.linalg.norm(found.place - before.points[found.row])
    np.testing.assert_allclose(gap, found.depth - RADIUS, rtol=1e-9)
    far = Placed(before.points + 50.0, before.frames)
    assert deepest_overlap(every, stations, far) is None


def test_a_function_that_fails_in_a_run_is_noted_and_acts_as_nan():
    broken = []

    def ball(points):
        assert not broken, "out of range"
        return np.linalg.norm(points, axis=1) - 0.7

    surface = ff.RigidObstacle(GROUND, ball, [(-1, -1, -1), (1, 1, 1)])
    frames = se3.exp(np.zeros((1, 6)))
    every = Obstacles([Obstacle(distance_of(surface), frames[0])])
    at = Placed(np.array([[0.0, 0.0, 0.8]]), frames)
    pairs = pairs_of(np.zeros(1, int))
    broken.append(True)
    with watched() as faults:
        found = find_pairs(every, all_of(pairs.fields), at, at)
        assert found.count == 1
        _, response = stepped(every, pairs, at, at)
        assert np.isnan(response.rows()[2]).all()
        assert safe_part(every, pairs, at, at, 0.1) == 0.0
    assert str(faults.error).startswith("RigidObstacle on the ground: ball (test_contact_fields.py")
    assert "AssertionError: out of range" in str(faults.error)
