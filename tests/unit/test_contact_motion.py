"""Continuous collision detection and the search for pairs."""

from itertools import pairwise

import numpy as np
import pytest

from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.closest import closest_pairs
from flexfem.contact.primitives.complexes import Surface
from flexfem.contact.primitives.data import Kind, Pairs
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from tests.unit.primitive_pairs import KINDS, alone, surface_of
from tests.unit.surfaces import grid

pytestmark = pytest.mark.serial
RNG = np.random.default_rng

#: Times of impact at a distance of 0.05 of moving points, by the additive CCD of ipctk 1.6.0 with a
#: conservative rescaling of 0.999. The k-th pair has ``x = rng.uniform(0, 1, (4, 3))`` and
#: ``y = x + rng.uniform(-1, 1, (4, 3))`` of ``default_rng(7)``.
TIMES = {
    Kind.VERTEX_TRIANGLE: {
        21: 0.0789, 22: 0.1522, 39: 0.2951, 47: 0.0265, 48: 0.0279, 72: 0.5292, 74: 0.4533,
        75: 0.272, 80: 0.0103, 83: 0.1258, 90: 0.3479, 94: 0.194, 112: 0.0872, 116: 0.5046,
    },
    Kind.EDGE_EDGE: {
        5: 0.003, 20: 0.1061, 22: 0.1674, 23: 0.1175, 28: 0.0661, 33: 0.6135, 39: 0.2928,
        41: 0.2187, 48: 0.013, 55: 0.7275, 58: 0.1068, 72: 0.5131, 83: 0.1748, 95: 0.4172,
    },
}  # fmt: skip


def one(pairs, k):
    """The k-th pair alone."""
    at = slice(k, k + 1)
    return Pairs(
        kind=pairs.kind[at], points=pairs.points[at], weight=pairs.weight[at],
        touch=pairs.touch[at], dhat=pairs.dhat[at], kappa=pairs.kappa[at], starts=np.arange(2),
        keys=pairs.keys[at],
    )  # fmt: skip


def gaps(pairs, x):
    """Gaps (m,) at positions (n, 3)."""
    distances, weights = np.empty(pairs.count), np.empty((pairs.count, 4))
    reach = pairs.touch + pairs.dhat
    closest_pairs(x, pairs.kind, pairs.points, reach, weights, distances)
    return distances - pairs.touch


@pytest.mark.parametrize("kind", TIMES)
def test_times_of_impact_are_those_of_additive_ccd(kind):
    rng, pairs = RNG(7), alone([kind], touch=0.05, dhat=1e-3)
    for k in range(117):
        x = rng.uniform(0, 1, (4, 3))
        y = x + rng.uniform(-1, 1, (4, 3))
        if k in TIMES[kind]:
            part = safe_part(pairs.memory, x, y, 0.01)
            # printed to 1e-4, and both end at gaps of up to 1e-3; another touch distance changes
            # the times by a tenth
            assert abs(part - TIMES[kind][k]) < 2e-3


@pytest.mark.parametrize("keep", [0.1, 0.9])
@pytest.mark.parametrize("kind", KINDS)
def test_gaps_remain_and_nearly_all_of_the_motion_is_used(kind, keep):
    rng, m = RNG(20 + int(kind)), 250
    pairs = alone(np.full(m, int(kind)), touch=0.05, dhat=0.2)
    before = rng.uniform(0, 1, (4 * m, 3))
    after = before + rng.uniform(-1, 1, before.shape) * rng.choice([0.1, 1, 10], (4 * m, 1))
    after[0::12] = before[1::12]  # every third one meets
    after[1::12] = before[0::12]
    after[2::12] = before[0::12]
    start = gaps(pairs, before)
    least = keep * np.minimum(start, pairs.dhat)
    parts = np.array([safe_part(one(pairs, k).memory, before, after, keep) for k in range(m)])
    assert not parts[start <= 0].any()
    free = start > 0
    way = np.repeat(parts, 4)[:, None] * (after - before)
    for t in np.linspace(0, 1, 201):
        # round-off alone may be missing
        assert (gaps(pairs, before + t * way) - least)[free].min() > -1e-12
    stopped = free & (parts < 1)
    assert stopped.sum() > 40
    left = (gaps(pairs, before + way) - least)[stopped]
    # what is kept is met within a fiftieth: a motion cut shorter than needed leaves more
    close = left <= 0.0201 * (1 - keep) * np.minimum(start, pairs.dhat)[stopped]
    assert close.all()
    assert safe_part(pairs.memory, before, after, keep) == parts.min()


def test_sliding_and_rest_are_not_cut():
    pairs = alone([Kind.VERTEX_TRIANGLE], touch=0.1, dhat=0.05)
    x = np.array([[-4.0, 0.3, 0.1 + 1e-9], [-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]])
    y = x.copy()
    y[0, 0] = 4.0  # ten billion gaps, and a plane
    assert safe_part(pairs.memory, x, y, 0.1) == 1.0
    assert safe_part(pairs.memory, x, x, 0.1) == 1.0
    y[0, 2] = -1.0
    assert safe_part(pairs.memory, x, y, 0.1) == pytest.approx(0.9e-9 / 1.1, rel=0.03)


def scene(seed=0):
    """Two wavy sheets and two polylines, their labels, and a motion."""
    rng = RNG(seed)
    one, triangles = grid(7, 6, height=lambda x, y: 0.05 * np.sin(9 * x + 5 * y))
    s, up = np.linspace(0, 1, 12), np.array([0.1, 0.05, 0.12])
    line = np.column_stack([s, 0.4 + 0.1 * np.sin(7 * s), 0.1 + 0 * s])
    points = np.concatenate([one, one + up, line, line[:, [1, 0, 2]] + 0.4 * up])
    n, k = len(one), len(s)
    lines = np.concatenate([2 * n + j + np.column_stack([np.arange(k - 1), np.arange(1, k)])
                            for j in (0, k)])  # fmt: skip
    label = np.repeat(np.arange(4), [n, n, k, k])
    motion = rng.uniform(-0.06, 0.06, points.shape)
    return points, np.concatenate([triangles, triangles + n]), lines, label, motion


def keys(pairs):
    """Kind and points of pairs as tuples."""
    return [(int(k), *map(int, p)) for k, p in zip(pairs.kind, pairs.points, strict=True)]


def groups(pairs):
    """Groups as sorted lists of pairs."""
    found = keys(pairs)
    return [sorted(found[i:j]) for i, j in pairwise(pairs.starts)]


def test_all_pairs_that_come_near_are_found_once():
    points, triangles, lines, label, motion = scene()
    n = len(points)
    surface = surface_of(points, triangles, lines, label, area=np.full(n, 1e-3))
    touching = np.ones((4, 4), bool)
    near = Neighbourhoods.of(surface, points, touching)
    after = points + motion
    pairs = find_pairs(surface, near, Motion(points, after), touching, np.ones(n, bool))
    found = keys(pairs)
    assert len(set(found)) == len(found)
    wide = find_pairs(surface, near, Motion(points, points, 9.0), touching, np.ones(n, bool))
    least = np.full(wide.count, np.inf)
    for t in np.linspace(0, 1, 21):
        least = np.minimum(least, gaps(wide, points + t * motion))
    missing = set(keys(wide)) - set(found)
    close = [key for key, gap in zip(keys(wide), least, strict=True) if gap < 0.05]
    assert len(close) > 500
    assert not missing & set(close)
    # on ranks: each group once
    half = RNG(1).uniform(size=n) < 0.5
    parts = [find_pairs(surface, near, Motion(points, after), touching, h) for h in (half, ~half)]
    assert sorted(groups(parts[0]) + groups(parts[1])) == sorted(groups(pairs))


def test_bodies_that_do_not_touch_and_single_points():
    points, triangles, lines, label, motion = scene()
    n = len(points)
    surface = surface_of(points, triangles, lines, label, area=np.full(n, 1e-3))
    touching = np.zeros((4, 4), bool)
    touching[0, 2] = touching[2, 0] = True
    near = Neighbourhoods.of(surface, points, touching)
    pairs = find_pairs(surface, near, Motion(points, points + motion, 0.1), touching,
                       np.ones(n, bool))  # fmt: skip
    met = np.stack([label[pairs.points[:, 0]], label[pairs.points[:, 3]]])
    np.testing.assert_array_equal(np.unique(np.sort(met, axis=0), axis=1), [[0], [2]])
    assert (pairs.kind < Kind.CROSSING_EDGE_VERTEX).all()  # one polyline crosses no other
    # two spheres are two vertices, each with the area of its own
    balls = surface_of(np.eye(3)[:2], [], label=np.arange(2), radius=0.7, area=np.array([1.0, 2]))
    touching = ~np.eye(2, dtype=bool)
    near = Neighbourhoods.of(balls, np.eye(3)[:2], touching)
    pairs = find_pairs(balls, near, Motion(np.eye(3)[:2], np.eye(3)[:2]), touching,
                       np.ones(2, bool))  # fmt: skip
    np.testing.assert_array_equal(pairs.weight, [1, 2])
    np.testing.assert_array_equal(pairs.touch, [1.4, 1.4])
    np.testing.assert_array_equal(pairs.kappa, [1e4, 1e4])


def remaining(surface: Surface, reference, lines: bool):
    """Coefficients of the pairs of one body that remain, by their definition."""
    cells = surface.complex
    v, e = len(cells.vertices), len(cells.edges)
    sets = [frozenset([i]) for i in range(v)] + [frozenset(map(int, c)) for c in cells.edges]
    sets += [frozenset(map(int, c)) for c in cells.triangles]
    last = v + e if lines else cells.count
    everything = [(i, j) for i in range(v + e if lines else v) for j in range(last)]
    first, second = np.array(everything).T
    size = np.array([len(s) for s in sets]) - 1
    points = np.concatenate([cells.points[first, :2], cells.points[second, :2]], axis=1)
    kind = 5 - size[first] - size[second]
    if lines:
        swap = size[first] < size[second]
        points[swap] = points[swap][:, [2, 3, 0, 1]]
        kind = np.select([size[first] + size[second] == 2, size[first] + size[second] == 1], [3, 4],
                         5)  # fmt: skip
    else:
        points = np.concatenate([cells.points[first, :1], cells.points[second]], axis=1)
        kind = size[second]
    distances, weights = np.empty(len(kind)), np.empty((len(kind), 4))
    closest_pairs(reference, kind, np.ascontiguousarray(points), np.zeros(len(kind)), weights,
                  distances)  # fmt: skip
    kept = [pair for pair, d in zip(everything, distances, strict=True) if d >= 0.07]
    value = {}
    for pair in sorted(kept, key=lambda p: -size[p[0]] - size[p[1]]):
        value[pair] = 1.0 - sum(
            c for other, c in value.items()
            if other != pair and sets[pair[0]] <= sets[other[0]] and sets[pair[1]] <= sets[other[1]]
            and (lines or pair[0] == other[0])
        )  # fmt: skip
    return value


@pytest.mark.parametrize("lines", [False, True])
def test_what_remains_of_one_body_is_a_complex(lines):
    if lines:
        s = np.linspace(0, 5.5, 15)
        points = np.column_stack([0.1 * np.cos(s), 0.1 * np.sin(s), 0.02 * s])
        edges = np.column_stack([np.arange(14), np.arange(1, 15)])
        surface = surface_of(points, [], edges, area=np.zeros(15), radius=0.02, dhat=0.03)
    else:
        points, triangles = grid(6, 5, size=(0.2, 0.16))
        points += 0.008 * RNG(0).standard_normal(points.shape)
        surface = surface_of(points, triangles, radius=0.02, dhat=0.03)
    touching = np.ones((1, 1), bool)
    near = Neighbourhoods.of(surface, points, touching)
    pairs = find_pairs(surface, near, Motion(points, points, 9.0), touching,
                       np.ones(len(points), bool))  # fmt: skip
    wanted = remaining(surface, points, lines)
    cells, c = surface.complex, surface.complex.count
    usual = cells.line_coefficients if lines else cells.coefficients
    first, second = np.array(list(wanted)).T
    base = usual[second] * (usual[first] if lines else 1.0)
    table = near.lines if lines else near.vertices
    np.testing.assert_array_equal(table.apply(first, second, base), list(wanted.values()))
    # and all others are left out
    all_first, all_second = (k.ravel() for k in np.indices((len(usual) if lines else
                             len(cells.vertices), len(usual))))  # fmt: skip
    out = ~np.isin(all_first * c + all_second, first * c + second)
    base = np.ones(int(out.sum()))
    assert not table.apply(all_first[out], all_second[out], base).any()
    vertices = pairs.kind < Kind.EDGE_EDGE
    chosen = ~vertices if lines else vertices
    total = sum(v for (i, j), v in wanted.items() if not lines or i > j)
    area = np.repeat(0.04**2, chosen.sum()) if lines else surface.area[pairs.points[chosen, 0]]
    np.testing.assert_allclose((pairs.weight[chosen] / area).sum(), total)
