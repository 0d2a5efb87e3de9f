"""Discrete contact forces: energy, momentum and torque of steps, and motions of strings."""

import numpy as np
import pytest

from flexfem.contact.primitives.barrier import slope
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.data import GAP, MIXED, POTENTIAL, SLOPE, TURN, Kind
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.steps import turn_forces
from flexfem.contact.primitives.tangents import add_actions, potential
from tests.called import called
from tests.unit.primitive_pairs import alone, at_rest, of_step, surface_of
from tests.unit.springs_in_contact import RADIUS, Springs
from tests.unit.surfaces import grid

pytestmark = pytest.mark.serial
RNG = np.random.default_rng


def torque(pairs, response, middle):
    """Largest torque of a pair about the middle positions, over its force."""
    rows, _, forces = response.rows()
    moments = np.cross(middle[pairs.points[rows]], forces).sum(1)
    return np.abs(moments).max() / np.abs(forces).max()


def test_single_pairs_do_exactly_the_work_of_their_potential():
    rng = RNG(3)
    pairs = alone(rng.integers(0, 6, 3000))
    before = rng.uniform(0, 1, (12000, 3))
    before[0::4, 2] += 0.4
    after = before + 0.2 * rng.standard_normal(before.shape)
    # pairs that do not pass through each other
    least = [at_rest(pairs, before + t * (after - before))[1] for t in (0.0, 0.5, 1.0)]
    bad = np.zeros(3000, bool)
    for one in least:
        rows, numbers, _ = one.rows()
        bad[rows[~np.isfinite(numbers[:, POTENTIAL])]] = True
    after[np.repeat(bad, 4)] = before[np.repeat(bad, 4)] = 1e3 * rng.uniform(
        size=(4 * bad.sum(), 3)
    )
    start, end = (potential(at_rest(pairs, x)[1].memory) for x in (before, after))
    forces, response = of_step(pairs, before, after)
    rows, numbers, each = response.rows()
    assert len(rows) > 1500
    assert numbers[:, SLOPE].min() >= 0
    # round-off: a force at one end, or of the middle, misses a tenth
    np.testing.assert_allclose((forces * (after - before)).sum(), start - end, rtol=1e-12)
    assert np.abs(each.sum(1)).max() < 1e-14 * np.abs(each).max()
    assert torque(pairs, response, 0.5 * (before + after)) < 1e-14


def over(points, triangles, before, after, dhat=0.15):
    """Pairs of vertices (k, 3) that move over triangles, and both positions of all points."""
    n, k = len(points), len(before)
    x0, x1 = np.concatenate([points, before]), np.concatenate([points, after])
    area = np.repeat([0.0, 1.0], [n, k])
    label = np.concatenate([np.zeros(n, int), np.arange(1, k + 1)])
    surface = surface_of(x0, triangles, label=label, dhat=dhat, area=area)
    touching = np.zeros((k + 1, k + 1), bool)
    touching[0, 1:] = touching[1:, 0] = True
    near = Neighbourhoods.of(surface, x0, touching)
    return find_pairs(surface, near, Motion(x0, x1), touching, np.ones(n + k, bool)), x0, x1


def test_sliding_over_a_flat_surface_has_no_friction_and_the_whole_force():
    points, triangles = grid(9, 7)
    rng = RNG(0)
    before = np.column_stack([rng.uniform(0.05, 0.95, (50, 2)), rng.uniform(0.06, 0.12, 50)])
    after = before.copy()
    after[:, :2] = rng.uniform(0.05, 0.95, (50, 2))  # over many triangles in one step
    pairs, x0, x1 = over(points, triangles, before, after)
    forces, _ = of_step(pairs, x0, x1)
    wanted = [-called(slope)(z - 0.02, 0.15, 1e4) for z in before[:, 2]]
    far = np.linalg.norm(after - before, axis=1) > 3.0 * before[:, 2]
    assert far.sum() > 30
    # with forces of single pairs the whole is a tenth of it, and has components along the surface
    np.testing.assert_allclose(forces[-50:, 2][far], np.array(wanted)[far], rtol=1e-10)
    assert np.abs(forces[-50:, :2][far]).max() < 1e-10 * max(wanted)
    np.testing.assert_allclose(forces[-50:, 2], wanted, rtol=0.15)  # mixed with those of pairs
    near = before.copy()
    near[:, 0] += rng.uniform(-0.5, 0.5, 50) * before[:, 2]
    forces, _ = of_step(*over(points, triangles, before, near))
    np.testing.assert_allclose(forces[-50:, 2], wanted, rtol=0.02)  # forces of single pairs
    after[:, 2] += rng.uniform(-0.03, 0.03, 50)
    pairs, x0, x1 = over(points, triangles, before, after)
    forces, _ = of_step(pairs, x0, x1)
    start, end = (potential(at_rest(pairs, x)[1].memory) for x in (x0, x1))
    np.testing.assert_allclose((forces * (x1 - x0)).sum(), start - end, rtol=1e-11)


def test_steps_over_a_rough_surface_keep_energy_momentum_and_torque():
    points, triangles = grid(9, 7, height=lambda x, y: 0.05 * np.cos(20 * x) * np.sin(30 * y))
    rng = RNG(1)
    before = np.column_stack([rng.uniform(0.05, 0.95, (300, 2)), rng.uniform(0.08, 0.25, 300)])
    after = before + rng.uniform(-1, 1, (300, 3)) * [0.2, 0.2, 0.1]
    pairs, x0, x1 = over(points, triangles, before, after)
    x1 = x0 + 0.9 * safe_part(pairs.memory, x0, x1, 0.05) * (x1 - x0)
    forces, response = of_step(pairs, x0, x1)
    start, end = (potential(at_rest(pairs, x)[1].memory) for x in (x0, x1))
    np.testing.assert_allclose((forces * (x1 - x0)).sum(), start - end, atol=1e-12 * end)
    assert np.abs(forces.sum(0)).max() < 1e-13 * np.abs(forces).max()
    assert torque(pairs, response, 0.5 * (x0 + x1)) < 1e-14


def test_steps_across_an_edge_are_finite_and_keep_energy():
    points, triangles = grid(5, 3, height=lambda x, y: -0.8 * np.abs(x - 0.5))
    before = np.array([[0.4, 0.5, 0.0], [0.45, 0.3, 0.0], [0.3, 0.4, -0.05]])
    after = before * [-1, 1, 1] + [1, 0.1, 0]  # the middle is below the ridge
    pairs, x0, x1 = over(points, triangles, before, after)
    forces, response = of_step(pairs, x0, x1)
    start, end = (potential(at_rest(pairs, x)[1].memory) for x in (x0, x1))
    assert np.isfinite(response.rows()[1][:, :TURN]).all()
    # only round-off: the middle's potential is infinite
    np.testing.assert_allclose((forces * (x1 - x0)).sum(), start - end, atol=1e-12 * end)
    assert torque(pairs, response, 0.5 * (x0 + x1)) < 1e-14


def test_the_tangent_of_a_step_is_that_of_the_approach():
    points, triangles = grid(9, 7)
    rng = RNG(2)
    before = np.column_stack([rng.uniform(0.1, 0.9, (20, 2)), rng.uniform(0.1, 0.14, 20)])
    after = before - [0.0, 0.0, 0.04]
    pairs, x0, x1 = over(points, triangles, before, after)
    steps, h, tangent = np.zeros_like(x0), 1e-7, np.zeros_like(x0)
    steps[-20:, 2] = rng.uniform(-1, 1, 20)
    forces = [of_step(pairs, x0, x1 + sign * h * steps)[0] for sign in (1, -1)]
    _, response = of_step(pairs, x0, x1)
    add_actions(pairs.memory, response.memory, 1.0, steps, tangent)
    wanted = (forces[1] - forces[0]) / (2 * h)
    # exact along the normal of a flat surface; a stiffness of the end instead is twice as large
    np.testing.assert_allclose(tangent[-20:, 2], wanted[-20:, 2], rtol=1e-5)


def error_of_the_derivative(pairs, x0, x1, response, steps, h):
    """Error of the whole derivative of a response along steps, over that by differences of h."""
    action = np.zeros_like(x0)
    turn_forces(pairs.memory, x0, x1, response.memory)
    add_actions(pairs.memory, response.memory, 1.0, steps, action)
    ends = [of_step(pairs, x0, x1 + sign * h * steps)[0] for sign in (-1.0, 1.0)]
    wanted = (ends[0] - ends[1]) / (2.0 * h)
    return np.abs(action - wanted).max() / np.abs(wanted).max()


@pytest.mark.parametrize("kind", list(Kind))
def test_the_whole_derivative_is_that_of_the_forces(kind):
    """Of pairs that turn and slide within a step; closest points at ends of edges, too."""
    rng, pairs, errors = RNG(kind), alone([kind]), []
    upper = slice(1 if kind < Kind.EDGE_EDGE else 2)
    for _ in range(60):
        x0 = rng.uniform(-1.0, 1.0, (4, 3)) * [1.0, 1.0, 0.15]
        x0[upper, 2] += 0.4
        x1 = x0 + rng.uniform(-0.25, 0.25, (4, 3))
        _, response = of_step(pairs, x0, x1)
        steps = rng.uniform(-1.0, 1.0, (4, 3))
        if response.count[0] == 0 or not response.numbers[0, GAP] > 0.02:
            continue
        errors.append(error_of_the_derivative(pairs, x0, x1, response, steps, 1e-6))
    assert len(errors) > 5
    # differences; without the way of closest points, or along the mean line alone, 1e-2 to 1
    assert np.quantile(errors, 0.9) < 1e-7


def test_the_whole_derivative_of_mixed_forces_couples_the_pairs_of_a_group():
    """Vertices that slide over several triangles of a curved surface, and turn while they do."""

    def height(x, y):
        return 0.1 * np.sin(4 * x) * np.cos(3 * y)

    points, triangles = grid(9, 7, height=height)
    rng, errors, share = RNG(5), [], []
    for number in range(40):
        at = rng.uniform(0.3, 0.7, 2)
        before = np.append(at, height(*at) + rng.uniform(0.08, 0.12))[None]
        after = before + 0.006 * number * np.array([[1.0, 0.6, 0.1]]) - [0.0, 0.0, 0.02]
        pairs, x0, x1 = over(points, triangles, before, after)
        x1[:-1, 2] += 0.02 * x0[:-1, 0] ** 2
        _, response = of_step(pairs, x0, x1)
        if not (response.whole[: response.count[0]] == 3).all():
            continue  # closest points slide too little
        share.append(response.numbers[0, MIXED])
        steps = rng.uniform(-1.0, 1.0, x0.shape)
        errors.append(error_of_the_derivative(pairs, x0, x1, response, steps, 1e-7))
    assert len(errors) > 30
    assert 20 < share.count(1.0) < len(share) - 5  # and some that are mixed with those of pairs
    # differences; without what the group has in common 1, without the change of the share 1e-3
    assert np.quantile(errors, 0.9) < 1e-7


def test_a_string_slides_over_the_nodes_of_another():
    s = np.linspace(-0.5, 0.5, 9)
    low = np.column_stack([s, 0 * s, 0 * s])
    high = np.column_stack([0 * s, s, 0 * s + 2 * RADIUS + 0.3 * RADIUS])
    strings = Springs.strings([low, high], np.zeros((2, 3)))
    pairs = strings.pairs(strings.x, strings.x, 2.0)
    lines = np.isin(pairs.kind, [k for k in Kind if k >= Kind.EDGE_EDGE])
    np.testing.assert_array_equal(np.unique(pairs.weight[lines]), [-(0.04**2), 0.04**2])
    pairs.weight = np.where(lines, pairs.weight, 0.0)  # crossing alone
    levels = []
    for shift in np.linspace(0.0, 0.3, 121):
        x = strings.x.copy()
        x[9:, :2] += [shift, 0.7 * shift]
        levels.append(potential(at_rest(pairs, x)[1].memory))
    # the distance is longer at nodes by less than a hundredth; a node that counts like an edge
    # doubles the potential
    assert np.ptp(levels) < 0.1 * max(levels)


def moved(angle, h, rho=1.0, until=0.06, speed=(0.05, 0.02, -1.0), rough=0.0):
    """The record of two straight strings at an angle that meet."""
    s, rng = np.linspace(-0.5, 0.5, 13), RNG(0)
    c, d = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    one = np.column_stack([s, 0 * s, 0 * s + 0.07])
    other = np.column_stack([s * c + 0.013, s * d, 0 * s])
    shapes = [x + rough * rng.standard_normal(x.shape) for x in (one, other)]
    return Springs.strings(shapes, [speed, (0.0, 0.0, 0.0)]).run(h, rho, until)


def assert_kept(record):
    """Energy is not made, momentum kept, and impulses have no torque."""
    assert record.impulse > 1e-3  # they do meet
    assert record.gain < 1e-8
    assert record.momentum < 1e-11
    assert record.torque < 1e-10 * max(record.impulse, 1.0)
    assert record.gap > 0
    # fixed-point iterations and wrong slopes need more, or do not end
    assert max(record.iterations) < 25


@pytest.mark.parametrize(("h", "rho"), [(1e-3, 1.0), (1e-3, 0.9), (5e-3, 1.0), (1e-2, 0.9)])
def test_crossing_strings_keep_energy_and_momenta(h, rho):
    record = moved(73.0, h, rho, until=0.1, speed=(0.0, 0.3, -1.0), rough=1e-3)
    assert_kept(record)
    if rho == 1.0:
        assert abs(record.end) < 1e-8


@pytest.mark.parametrize(
    ("angle", "h"),
    [*((angle, 1e-3) for angle in (0, 0.5, 1, 2, 5, 10, 20, 45, 70, 90)), (0, 5e-3), (3, 5e-3)],
)
def test_strings_pressed_together_keep_energy_and_momenta(angle, h):
    record = moved(angle, h, until=0.05)
    assert_kept(record)
    assert abs(record.end) < 1e-8


@pytest.mark.parametrize("h", [1e-3, 5e-3])
def test_sheets_that_slide_on_each_other_keep_energy_and_momenta(h):
    points, triangles = grid(5, 5)
    n, rng = len(points), RNG(0)
    x = np.concatenate([points, points + np.array([0.13, 0.07, 2 * RADIUS + 0.03])])
    x += 2e-3 * rng.standard_normal(x.shape)
    v = np.repeat([[0.0, 0.0, 0.0], [3.0, 1.0, -1.0]], n, axis=0)
    sheets = Springs(
        x, v, np.concatenate([triangles, triangles + n]), np.zeros((0, 2), int),
        np.repeat([0, 1], n), ~np.eye(2, dtype=bool), kappa=3e5,
    )  # fmt: skip
    record = sheets.run(h, 1.0, 0.05)
    assert_kept(record)
    assert abs(record.end) < 1e-8


def test_a_string_meets_itself():
    s = np.linspace(-0.5, 0.5, 13)
    turn = np.linspace(-0.5, 0.5, 5)[1:-1] * np.pi
    end = np.column_stack([0.5 + 0.04 * np.cos(turn), 0.04 * np.sin(turn), 0.002 * turn])
    x = np.concatenate([
        np.column_stack([s, -0.04 + 0 * s, 0.01 * s]), end,
        np.column_stack([s[::-1], 0.04 + 0 * s, -0.02 * s[::-1]]),
    ])  # fmt: skip
    string = Springs.strings([x], [[0.0, 0.0, 0.0]], itself=True)
    string.v[:13, 1], string.v[16:, 1] = 3.0, -2.5
    pairs = string.pairs(x, x, 0.1)
    for kind, (a, b, c, d) in zip(pairs.kind, pairs.points, strict=True):
        second = {c, d} if kind >= Kind.EDGE_EDGE else {b, c, d}
        assert not ({a, b} if kind >= Kind.EDGE_EDGE else {a}) & second
    record = string.run(1e-3, 1.0, 0.06)
    assert_kept(record)
    assert abs(record.end) < 1e-8
