"""Contact of primitives: distances, coefficients, potential, gradients and Hessians."""

import mpmath
import numpy as np
import pytest

from flexfem.contact.obstacles.surface_data import node_areas
from flexfem.contact.primitives.barrier import barrier, curvature, slope
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.closest import closest_pairs
from flexfem.contact.primitives.complexes import Complex, lengths
from flexfem.contact.primitives.data import GAP, POTENTIAL, Kind
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.tangents import add_actions, blocks_into, potential
from tests.called import called
from tests.unit.primitive_pairs import KINDS, POINTS, alone, at_rest, surface_of
from tests.unit.surfaces import grid

pytestmark = pytest.mark.serial
RNG = np.random.default_rng


def closest(kind, x, reach=0.0):
    """Weights (m, 4) and distances (m,) of pairs of one kind at (m, 4, 3)."""
    kinds, weights = np.full(len(x), int(kind)), np.empty((len(x), 4))
    distances = np.empty(len(x))
    rows = POINTS[kind] + 4 * np.arange(len(x))[:, None]
    closest_pairs(x.reshape(-1, 3), kinds, rows, np.full(len(x), reach), weights, distances)
    return weights, distances, x.reshape(-1, 3)[rows]


def raised(kind, points, reach):
    """Points (m, 4, 5) whose plain distance is the regularised one."""
    half = 0.5 * np.sqrt(1e-2) * reach * (kind >= Kind.EDGE_EDGE)
    ends = np.array([[-half, 0], [half, 0], [0, -half], [0, half]])
    return np.concatenate([points, np.broadcast_to(ends, (*points.shape[:2], 2))], axis=2)


def odd_points(kind):
    """Random primitives; parallel edges, edges and triangles without length or area."""
    rng = RNG(int(kind))
    x = rng.uniform(-1, 1, (600, 4, 3))
    x[:100, 3] = x[:100, 2] + (x[:100, 1] - x[:100, 0]) * rng.uniform(0.1, 2, (100, 1))
    x[100:150, 3] = x[100:150, 2]
    x[150:200, 1] = x[150:200, 0]
    x[200:250, 2:] = x[200:250, 1:2] + rng.uniform(-1, 1, (50, 2, 1)) * [[[1.0, 2.0, -1.0]]]
    x[250:300, 1:] = x[250:300, 1:2]
    return x


@pytest.mark.parametrize("reach", [0.0, 0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_closest_points_are_those_of_separating_planes(kind, reach):
    x = odd_points(kind)
    w, distance, points = closest(kind, x, reach)
    first = 2 if kind >= Kind.EDGE_EDGE else 1
    assert np.abs(w[:, :first].sum(1) - 1).max() < 1e-15
    assert np.abs(w[:, first:].sum(1) + 1).max() < 1e-15
    assert w[:, :first].min() >= 0
    assert w[:, first:].max() <= 0
    high = raised(kind, points, reach)
    r = np.einsum("mi,mia->ma", w, high)
    # round-off of unit lengths: another formula of the regularisation changes the third digit
    np.testing.assert_allclose(np.linalg.norm(r, axis=1), distance, atol=1e-15, rtol=1e-14)
    # all points of one primitive are beyond its closest one: the condition of the least distance
    # of convex sets. 1e-13 is round-off; weights wrong by 1e-6 leave 1e-6
    way = np.einsum("ma,mia->mi", r, high)
    used = np.abs(w).max(0) > 0
    least = np.einsum("mi,mi->m", w[:, :first], way[:, :first])
    most = -np.einsum("mi,mi->m", w[:, first:], way[:, first:])
    assert (way[:, :first] - least[:, None])[:, used[:first]].min() > -1e-13
    assert (way[:, first:] - most[:, None])[:, used[first:]].max() < 1e-13


def test_barrier_and_its_derivatives_are_those_of_many_digits():
    def exact(g):
        q = g / mpmath.mpf("0.3")
        return 7 * mpmath.mpf("0.3") ** 2 * (1 - q) ** 3 / q**2

    with mpmath.workdps(40):
        for gap in (1e-9, 1e-3, 0.1, 0.29, 0.2999999):
            parts = [called(f)(gap, 0.3, 7.0) for f in (barrier, slope, curvature)]
            wanted = [float(mpmath.diff(exact, mpmath.mpf(gap), n)) for n in range(3)]
            # q - 1 loses digits near dhat: 1e-16 / 3e-7 there
            np.testing.assert_allclose(parts, wanted, rtol=2e-9 if gap > 0.2999 else 1e-13)
    assert [called(f)(0.3, 0.3, 7.0) for f in (barrier, slope, curvature)] == [0, 0, 0]
    assert called(barrier)(0.0, 0.3, 7.0) == called(curvature)(-1.0, 0.3, 7.0) == np.inf
    assert called(slope)(-0.1, 0.3, 7.0) == -np.inf


def test_coefficients_are_euler_characteristics():
    points, triangles = grid(5, 4)
    flat = Complex.of(triangles, np.zeros((0, 2), int), np.zeros(0, int))
    sphere = Complex.of([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], [], [])
    fan = Complex.of([], [[0, 1], [0, 2], [0, 3], [5, 6]], [9])
    # of the whole complex: a disc 1, a sphere 2, a tree, an edge and a point 3
    assert [c.coefficients.sum() for c in (flat, sphere, fan)] == [1, 2, 3]
    assert set(flat.coefficients[: len(points)]) == {0, 1}
    np.testing.assert_array_equal(fan.coefficients[:7], [-2, 0, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(fan.line_coefficients, [-2, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1])
    np.testing.assert_allclose(node_areas(points, triangles).sum(), 1.0)
    np.testing.assert_allclose(lengths(points[:, [0, 2, 2]], np.array([[0, 1], [1, 2]])).sum(),
                               np.abs(points[[0, 1], 0] - points[[1, 2], 0]).sum())  # fmt: skip
    with pytest.raises(ValueError, match=r"points \[3, 4, 3\] of a cell"):
        Complex.of([[3, 4, 3]], [], [])


def over(points, triangles, way, dhat=0.15):
    """Potential (k,) and force (k, 3) of a vertex that moves along a way (k, 3) over triangles."""
    n, values, forces = len(points), [], []
    everything = np.concatenate([points, way[:1]])
    area = np.zeros(n + 1)
    area[-1] = 1.0
    surface = surface_of(everything, triangles, label=np.arange(n + 1) // n, dhat=dhat, area=area)
    touching = ~np.eye(2, dtype=bool)
    near = Neighbourhoods.of(surface, everything, touching)
    low, high = everything.copy(), everything.copy()
    low[-1], high[-1] = way.min(0), way.max(0)
    pairs = find_pairs(surface, near, Motion(low, high), touching, np.ones(n + 1, bool))
    for place in way:
        everything[-1] = place
        f, response = at_rest(pairs, everything)
        values.append(potential(response.memory))
        forces.append(f[-1])
    return np.array(values), np.array(forces)


def test_a_vertex_over_a_flat_surface_meets_one_barrier():
    points, triangles = grid(5, 4)
    way = np.column_stack([RNG(0).uniform(-0.2, 1.2, (400, 2)), RNG(1).uniform(0.03, 0.15, 400)])
    way[:60, :2] = points[RNG(2).integers(0, len(points), 60), :2]  # over nodes
    way[60:120, 0] = points[5, 0]  # and edges
    values, forces = over(points, triangles, way)
    beside = way[:, :2] - np.clip(way[:, :2], 0, 1)
    distance = np.sqrt((beside**2).sum(1) + way[:, 2] ** 2)
    gap = np.minimum(distance - 0.02, 0.15)
    wanted = [called(barrier)(g, 0.15, 1e4) for g in gap]
    # round-off: a cell counted twice, or not, changes the potential by itself
    np.testing.assert_allclose(values, wanted, rtol=1e-13, atol=1e-14 * max(wanted))
    normal = np.column_stack([beside, way[:, 2]]) / distance[:, None]
    pushes = -np.array([called(slope)(g, 0.15, 1e4) for g in gap])
    np.testing.assert_allclose(forces, pushes[:, None] * normal, atol=1e-12 * pushes.max())


@pytest.mark.parametrize("height", [
    lambda x, y: 0.5 * np.abs(x - 0.5), lambda x, y: -0.5 * np.abs(x - 0.5),
    lambda x, y: 0.3 * np.abs(x - 0.5) + 0.4 * np.abs(y - 0.5),
    lambda x, y: -0.3 * np.abs(x - 0.5) - 0.4 * np.abs(y - 0.5),
    lambda x, y: 0.2 * np.cos(20 * x) * np.sin(30 * y),
], ids=["groove", "ridge", "pit", "peak", "rough"])  # fmt: skip
def test_force_over_folds_is_continuous_and_the_gradient(height):
    points, triangles = grid(5, 5, height=height)
    s = np.linspace(0, 1, 1201)[:, None]
    way = np.array([0.1, 0.23, 0.0]) + s * np.array([0.83, 0.6, 0.0])
    way[:, 2] = height(way[:, 0], way[:, 1]) + 0.1
    if np.ptp(points[:, 2]) > 0.35:  # rough: above all nodes
        way[:, 2] = points[:, 2].max() + 0.03
    values, forces = over(points, triangles, way)
    coarse = np.abs(np.diff(forces[::2], axis=0)).max()
    fine = np.abs(np.diff(forces, axis=0)).max()
    assert np.abs(forces).max() > 100
    # differences of a continuous function with kinks halve with the step; those of a jump stay
    assert fine < 0.62 * coarse
    work = 0.5 * ((forces[1:] + forces[:-1]) * np.diff(way, axis=0)).sum(1)
    # trapezoidal rule over kinks: second order, 1e-3 at these steps; a lost cell changes all
    np.testing.assert_allclose(np.cumsum(work), values[0] - values[1:], atol=2e-3 * values.max())


def test_turning_through_parallel_edges_is_continuous():
    turn = np.linspace(-0.2, 0.2, 4001)
    x = np.zeros((len(turn), 4, 3))
    x[:, :2] = [[-0.5, 0, 0.1], [0.6, 0, 0.1]]
    x[:, 2, :2], x[:, 3, :2] = (c * np.array([np.cos(turn), np.sin(turn)]).T for c in (-0.4, 0.7))
    w, distance, _ = closest(Kind.EDGE_EDGE, x, 0.12)
    # the closest points move across the edge within 0.02 radians: steps of 1e-4 move them by less
    # than a hundredth, where without regularisation they jump by the whole overlap
    assert np.abs(np.diff(w, axis=0)).max() < 0.02
    assert 0.1 < distance.min() < distance.max() < 0.1 * (1 + 1e-2)


@pytest.mark.parametrize("kind", KINDS)
def test_forces_and_tangents_at_rest_are_exact_derivatives(kind):
    rng = RNG(10 + int(kind))
    pairs, x = alone(np.full(60, int(kind)), dhat=3.0), rng.uniform(0, 1, (240, 3))
    x[0::4, 2] += 1.2
    if kind in (Kind.EDGE_EDGE, Kind.CROSSING_EDGE_VERTEX):
        x[1::4, 2] += 1.2
    steps, h = rng.standard_normal(x.shape), 1e-6
    forces, response = at_rest(pairs, x)
    assert response.count[0] > 50
    assert response.rows()[1][:, GAP].min() > 0.05
    there, back = at_rest(pairs, x + h * steps), at_rest(pairs, x - h * steps)
    change = (potential(there[1].memory) - potential(back[1].memory)) / (2 * h)
    # central differences: 1e-10 by the step, 1e-10 by round-off; a missing term changes digit one
    np.testing.assert_allclose(-(forces * steps).sum(), change, rtol=1e-7)
    tangent = np.zeros_like(x)
    add_actions(pairs.memory, response.memory, 1.0, steps, tangent)
    wanted = -(there[0] - back[0]) / (2 * h)
    np.testing.assert_allclose(tangent, wanted, atol=1e-6 * np.abs(wanted).max())
    rows = response.rows()[0]
    blocks, sums = np.empty((len(rows), 12, 12)), np.zeros_like(x)
    blocks_into(response.memory, 1.0, blocks)
    points = pairs.points[rows]
    by_points = np.einsum("kpq,kq->kp", blocks, steps[points].reshape(-1, 12))
    np.add.at(sums, points, by_points.reshape(-1, 4, 3))
    np.testing.assert_allclose(sums, tangent, atol=1e-13 * np.abs(tangent).max())
    np.testing.assert_allclose(blocks, blocks.transpose(0, 2, 1), atol=1e-13 * np.abs(blocks).max())


def test_pairs_out_of_reach_do_nothing():
    pairs, x = alone(np.arange(6)), np.zeros((24, 3))
    x[:, 0] = 10.0 * np.arange(24)
    forces, response = at_rest(pairs, x)
    assert response.count[0] == 0
    assert not forces.any()
    assert response.rows()[1][:, POTENTIAL].sum() == 0
