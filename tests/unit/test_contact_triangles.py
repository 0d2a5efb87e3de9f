# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with triangles: distances, forces, tangents, search."""

import numpy as np
import pytest

from flexfem.contact.detection.broad_phase import overlaps
from flexfem.contact.detection.neighbours import Rows, find_candidates, rings
from flexfem.contact.law.closed_contacts import ClosedContacts, ContactLaw
from flexfem.contact.law.data import BEND, DISTANCE
from flexfem.contact.obstacles.overlaps import deepest_start, first_crossing
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.lie import so3
from tests.unit.surfaces import grid, masters, points_on_surface, slaves, two_sheets

pytestmark = pytest.mark.serial
RNG = np.random.default_rng


def wavy(x, y):
    return 0.05 * np.sin(5 * x) * np.cos(4 * y)


@pytest.fixture
def scattered():
    """Points all around a wavy sheet, half of them beside its rims."""
    rng = RNG(0)
    points, triangles = grid(6, 6, height=wavy)
    others = np.column_stack([rng.uniform(-0.1, 1.1, (80, 2)), rng.uniform(-0.15, 0.15, 80)])
    return points_on_surface(points, triangles, others, 0.1, skin=0.25)


def forces(contact, points, h=0.0):
    contact.evaluate(points, h)
    residual = np.zeros_like(points)
    contact.add_forces(residual)
    return residual


def derivative(function, points, way, h=1e-6):
    return (function(points + h * way) - function(points - h * way)) / (2 * h)


def test_candidates_are_those_of_all_pairs():
    rng = RNG(1)
    low, other = rng.uniform(0, 1, (200, 3)), rng.uniform(0, 1, (300, 3))
    high = low + rng.uniform(0, 0.1, low.shape)
    end = other + rng.uniform(0, 0.3, other.shape)
    meet = ((low[:, None] <= end) & (other <= high[:, None])).all(2)
    starts, found = overlaps(low, high, other, end)
    # exact: one pair lost, or found in two cells, changes the lists
    np.testing.assert_array_equal(found, np.nonzero(meet)[1])
    np.testing.assert_array_equal(np.diff(starts), meet.sum(1))


def test_distance_is_the_least_of_all_points_of_the_surface(scattered):
    contact, points = scattered
    contact.evaluate(points)
    triangles = contact.masters.triangles
    u, v = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41))
    inside = u + v <= 1
    w = np.stack([1 - u - v, u, v], -1)[inside]
    cloud = np.einsum("wk,tka->twa", w, points[triangles]).reshape(-1, 3)
    p = points[contact.slaves.nodes]
    least = np.linalg.norm(p[:, None] - cloud, axis=2).min(1)
    touching, first = np.unique(contact.ends[:, 0], return_index=True)
    # samples are 5 mm apart, which moves distances of 0.01 to 0.1 by 1 mm at most; a missing
    # triangle moves them by centimetres
    np.testing.assert_allclose(contact.contacts[first, DISTANCE], least[touching], atol=1.5e-3)
    assert set(np.flatnonzero(least < 0.098)) <= set(touching)


@pytest.mark.parametrize("stiffer", [1.0, 10.0])
def test_forces_are_the_derivative_of_the_energy(scattered, stiffer):
    contact, points = scattered
    contact.stiffer = stiffer
    way = RNG(2).normal(size=points.shape)

    def energy(x):
        contact.evaluate(x)
        return contact.energy

    contact.evaluate(points)
    curved = (contact.contacts[:, BEND : BEND + 2] != 0).sum(1)
    assert set(curved) == {0, 1, 2}  # faces, edges and nodes are all there
    expected = (forces(contact, points) * way).sum()
    # measured 3e-9: rounding of the differences; without edges and nodes 1e-2
    assert derivative(energy, points, way) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("stiffer", [1.0, 10.0])
def test_tangent_is_the_derivative_of_the_forces(scattered, stiffer):
    contact, points = scattered
    contact.stiffer = stiffer
    way = RNG(3).normal(size=points.shape)
    expected = derivative(lambda x: forces(contact, x), points, way)
    contact.evaluate(points)
    action = np.zeros_like(points)
    contact.add_actions(way, action)
    # measured 4e-9; without the turning of the normal 5e-2
    np.testing.assert_allclose(action, expected, atol=1e-6 * abs(expected).max())
    nodes, blocks = contact.blocks()
    product = np.zeros_like(points)
    steps = way[nodes].reshape(-1, 12, 1)
    np.add.at(product, nodes, (blocks @ steps).reshape(-1, 4, 3))
    # the same numbers in another order
    np.testing.assert_allclose(product, action, atol=1e-13)
    np.testing.assert_allclose(blocks, blocks.swapaxes(1, 2), atol=1e-14)


def test_momenta_are_in_balance_and_motion_as_one_changes_nothing(scattered):
    contact, points = scattered
    residual = forces(contact, points)
    # rounding; a reaction at another point than the closest one gives a moment of 1e-3
    np.testing.assert_allclose(residual.sum(0), 0, atol=1e-13)
    np.testing.assert_allclose(np.cross(points, residual).sum(0), 0, atol=1e-13)
    turn = so3.exp(np.array([0.3, -1.2, 0.7]))
    turned = forces(contact, points @ turn.T + [5.0, -2.0, 1.0])
    np.testing.assert_allclose(turned, residual @ turn.T, atol=1e-12)


def test_uniform_pressure_passes_between_different_meshes():
    passes, points, areas, lower = two_sheets()
    residual = np.zeros_like(points)
    for one in passes:
        one.evaluate(points)
        one.add_forces(residual)
    inner = (abs(points - [0.53, 0.5, 0]) < [0.22, 0.22, 1]).all(1)
    sign = np.where(np.arange(len(points)) < lower, 1, -1)
    pressure = sign * residual[:, 2] / areas
    gap = 0.001
    # measured -19 % to +13 %; one pass alone is exact on one side, on the other off by -38 to +27 %
    assert 1e3 * gap * 0.8 < pressure[inner].min() <= pressure[inner].max() < 1e3 * gap * 1.2
    np.testing.assert_allclose(residual[:, :2], 0, atol=1e-15)
    total = residual[lower:, 2].sum()
    # every node over the other sheet carries its share: nodes beside the rim are left out
    over = [np.isin(one.slaves.nodes, one.slaves.nodes[one.ends[:, 0]]) for one in passes]
    expected = sum(
        (0.5e3 * gap * areas[one.slaves.nodes[k]]).sum()
        for one, k in zip(passes, over, strict=True)
    )
    assert total == pytest.approx(-expected, rel=0.05)


def test_equal_meshes_face_to_face_carry_the_exact_pressure():
    points, triangles = grid(6, 5)
    contact, every = points_on_surface(
        points, triangles, points + np.array([0, 0, 0.009]), 0.01, stiffness=np.ones(30)
    )
    residual = forces(contact, every)
    # nodes lie over nodes, where rounding decides between up to six triangles: each counts once
    assert contact.count == 30
    np.testing.assert_allclose(residual[:30, 2], 1e-3, rtol=1e-9)
    np.testing.assert_allclose(residual[30:, 2], -1e-3, rtol=1e-9)


def test_force_is_continuous_around_an_edge_and_a_rim():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, -1.0], [2, 1, -1]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2], [4, 5, 2]])
    angles = np.linspace(-0.3, 1.1, 400)
    path = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], 1) * 0.09 + [1, 0.4, 0]
    for where in (path, (path - [1, 0, 0]) * [-1, 1, 1]):  # the second at the rim x = 0
        pulls = []
        for p in where:
            contact, every = points_on_surface(
                points, triangles, p[None], 0.1, skin=0.3, stiffness=np.ones(1)
            )
            pulls.append(forces(contact, every)[-1])
            assert contact.count == 1
        pulls = np.array(pulls)
        # directions turn by 3.5e-3 between places, distances change by a third of that at most; a
        # jump from the normal of one triangle to that of the other would be 7e-3
        assert abs(np.diff(pulls, axis=0)).max() < 0.05 * np.diff(angles).max()
        round_it = (angles > 0) & (angles < np.pi / 4)
        np.testing.assert_allclose(np.linalg.norm(pulls[round_it], axis=1), 0.01, rtol=1e-9)


def test_steep_valley_holds_a_node_by_both_walls():
    points = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 1.0], [1, 1, 1], [-1, 0, 1], [-1, 1, 1]])
    triangles = np.array([[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]])
    p = np.array([[0.0, 0.5, 0.12]])
    contact, every = points_on_surface(points, triangles, p, 0.1, skin=0.5, stiffness=np.ones(1))
    residual = forces(contact, every)[-1]
    depth = 0.1 - 0.12 / np.sqrt(2)
    # closed form; one wall alone would push it sideways
    np.testing.assert_allclose(residual, [0, 0, -np.sqrt(2) * depth], atol=1e-14)


def test_node_that_got_through_is_pushed_back_to_its_side():
    points, triangles = grid(5, 5, height=lambda x, y: 0.2 * x * y)
    start = np.array([[0.52, 0.41, 0.0]])
    start[:, 2] = 0.2 * start[:, 0] * start[:, 1] + 0.02
    contact, every = points_on_surface(
        points, triangles, start, 0.01, skin=0.2, stiffness=np.ones(1)
    )
    for depth in (0.0, 0.01, 0.03, 0.06):  # up to half of the skin from the start
        moved = every.copy()
        moved[-1, 2] -= depth
        residual = forces(contact, moved)
        if depth > 0.01:  # beyond the middle of the sheet the push is still upwards
            assert residual[-1, 2] < -0.9 * (depth - 0.011)
    contact.update(moved)  # remembered when the candidates are found again
    contact._built = None
    contact.update(moved)
    assert forces(contact, moved)[-1, 2] < -0.04


def test_walk_around_a_rim_changes_the_side():
    points, triangles = grid(4, 4)
    angles = np.linspace(0.9, -0.9, 60) * np.pi
    path = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], 1) * [0.1, 0, 0.03]
    path += [1.0, 0.45, 0]
    contact, every = points_on_surface(
        points, triangles, path[:1], 0.02, skin=0.1, stiffness=np.ones(1)
    )
    for p in path:
        every[-1] = p
        contact.update(every)
        contact.evaluate(every)
        # a remembered side would take the place below for a penetration
        assert contact.deepest < 0.02
    assert contact.candidates.sides.min() == -1
    every[-1, 2] = -0.008
    assert forces(contact, every)[-1, 2] == pytest.approx(0.012)


def test_neighbours_are_left_out_and_folds_are_found():
    points, triangles = grid(21, 5, (2.0, 0.4))
    nodes = np.arange(len(points))
    near = rings(triangles, nodes, 2, np.empty((0, 2), np.int64))
    assert set(near.values[near.starts[0] : near.starts[1]]) == {0, 1, 2, 21, 22, 23, 42, 43, 44}
    touching = slaves(nodes, 0.01, np.ones(len(nodes)))
    contact = TriangleContact(touching, masters(points, triangles, 0.02), 0.05, near)
    contact.update(points)
    contact.evaluate(points)
    assert contact.count == 0
    bent = points.copy()
    angle = np.pi * np.clip((points[:, 0] - 0.9) / 0.2, 0, 1)
    beyond = np.maximum(points[:, 0] - 1.1, 0)
    radius = 0.2 / np.pi * 0.13
    bent[:, 0] = np.minimum(points[:, 0], 0.9) + radius * np.sin(angle) - beyond
    bent[:, 2] = radius * (1 - np.cos(angle))
    contact.update(bent)
    contact.evaluate(bent)
    # the halves are 16.6 mm apart: all nodes more than two edges from the fold touch
    assert contact.deepest == pytest.approx(0.02 - 2 * radius, rel=1e-6)
    assert contact.count > 60


def test_search_finds_what_lies_within_reach():
    rng = RNG(4)
    points, triangles = grid(9, 8, height=wavy)
    others = rng.uniform([-0.2, -0.2, -0.2], [1.2, 1.2, 0.2], (200, 3))
    contact, every = points_on_surface(points, triangles, others, 0.02, skin=0.06)
    s, m = contact.slaves, contact.masters
    _, wide = find_candidates(every, s, m.triangles, m.thickness, 10.0, contact._excluded)
    assert len(wide) == len(others) * len(triangles)
    starts, values = contact.candidates.starts, contact.candidates.triangles
    big = TriangleContact(s, m, 10.0)
    big.update(every)
    contact.evaluate(every)
    big.evaluate(every)
    # lists that lack a triangle miss contacts
    assert contact.count == big.count > 8
    np.testing.assert_array_equal(contact.ends, big.ends)
    assert len(values) == starts[-1] < 0.1 * len(wide)


@pytest.mark.parametrize("push", [0.2, 5.0])
def test_friction_sticks_below_the_limit_and_slides_above(push):
    points, triangles = grid(4, 4)
    law = ContactLaw(friction=0.3, stick=1.0)
    contact, every = points_on_surface(
        points, triangles, np.array([[0.4, 0.4, 0.009]]), 0.01, stiffness=np.ones(1), law=law
    )
    contact.evaluate(every)
    contact.accept(every)
    moved = every.copy()
    moved[-1] += np.array([1e-3, 0, 0]) * push
    residual = forces(contact, moved)
    limit, elastic = 0.3 * 1e-3, 1e-3 * push
    assert residual[-1, 0] == pytest.approx(min(limit, elastic))
    np.testing.assert_allclose(residual.sum(0), 0, atol=1e-17)
    way = RNG(5).normal(size=every.shape)
    expected = derivative(lambda x: forces(contact, x), moved, way, 1e-8)
    contact.evaluate(moved)
    action = np.zeros_like(every)
    contact.add_actions(way, action)
    # measured 2e-8; friction's part is 30 % of it
    np.testing.assert_allclose(action, expected, atol=1e-6 * abs(expected).max())
    contact.accept(moved)
    # work of the sliding force where it slides
    lost = 0.0 if elastic < limit else limit * (elastic - limit)
    assert contact.closed.lost == pytest.approx(lost, abs=1e-18)


def test_damping_resists_approach():
    points, triangles = grid(4, 4)
    law = ContactLaw(damping=0.02)
    contact, every = points_on_surface(
        points, triangles, np.array([[0.4, 0.4, 0.009]]), 0.01, stiffness=np.ones(1), law=law
    )
    contact.evaluate(every)
    contact.accept(every)
    every[-1, 2] -= 1e-4
    h = 0.01
    # k g + k tau g / h: -1.1e-3 of the spring, -2e-4 of the damper
    assert forces(contact, every, h)[-1, 2] == pytest.approx(-1.1e-3 - 2e-4)
    contact.accept(every)
    assert contact.closed.lost == pytest.approx(2e-4 * 1e-4)


def test_bad_starts_are_found():
    points, triangles = grid(5, 5)
    contact, every = points_on_surface(
        points, triangles, np.array([[0.4, 0.4, 0.002], [0.7, 0.7, 0.009]]), 0.01
    )
    contact.evaluate(every)
    part, node, _ = deepest_start(contact)
    assert (part, node) == (pytest.approx(0.8), 25)
    edges = np.array([[25, 27], [26, 27]])
    every = np.concatenate([every, [[0.41, 0.42, -0.1]]])
    nothing = Rows.empty(2)
    crossing = first_crossing(every, edges, triangles, nothing)
    assert crossing[0] == 0
    assert first_crossing(every, edges[:0], triangles, nothing) == (-1, -1)
    above = every + np.array([0, 0, 1.0]) * (np.arange(len(every)) >= 25)[:, None]
    assert first_crossing(above, edges, triangles, nothing) == (-1, -1)


def test_no_slaves_on_this_rank_make_rows_of_the_width_of_others():
    law, extra = ContactLaw(friction=0.2), np.zeros((0, 3))
    rows = ClosedContacts.none(law).packed(0, extra)
    # checkpoints put rows of all ranks together
    assert rows.shape == (0, ClosedContacts.none(law).packed(2, extra).shape[1])
    found, more = ClosedContacts.unpacked(law, rows, np.zeros(0))
    assert (len(found.slaves), more.shape) == (0, (0, 3))
