"""Damping and friction of contacts over steps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from flexfem.contact.dissipation.data import (
    ACROSS,
    ALONG,
    FRICTION,
    NORMAL_LAWS,
    PUSH,
    RATIO,
    slow_speed,
)
from flexfem.contact.dissipation.rows import motions_into, spread
from flexfem.contact.dissipation.tilts import Tilts, add_spins, place_tilts, spread_couples
from flexfem.lie import so3
from tests.unit.dissipative_motion import GRAVITY, Points, all_spins, law, over_plane
from tests.unit.primitive_pairs import surface_of
from tests.unit.surfaces import grid

pytestmark = pytest.mark.serial
RNG = np.random.default_rng


def thrown(h, **laws):
    """A ball that meets a wall with 1 m/s, without gravity, when it has left it."""
    ball = over_plane([[0.0, 0.0]], 0.02, 0.02, 3e3, 1.0, law(**laws))
    ball.g[:], ball.x[3, 2], ball.v[3, 2] = 0.0, 0.045, -1.0
    start, k = ball.kinetic, 0
    while (ball.v[3, 2] <= 0 or ball.groups.count[0]) and k * h < 0.05:
        ball.step(h)
        k += 1
    # the end of Newton's method: what the laws take is what is missing
    assert abs(ball.kinetic + ball.stored + np.sum(ball.losses) - start) < 2e-11
    assert np.min(ball.losses) >= 0
    return ball


def test_damping_is_that_of_hunt_and_crossley():
    d = 1.0
    # m v dv / (1 + d v) = -dU in approach and separation, whatever U
    lost = 1 / d - np.log(1 + d) / d**2
    rebound = brentq(lambda v: -v / d - np.log(1 - d * v) / d**2 - lost, 1e-3, 0.999)
    errors = [thrown(h, damping=d).v[3, 2] - rebound for h in (2e-3, 1e-3)]
    # second order in the step, to where the impact begins within one
    assert abs(errors[0]) < 5e-3
    assert abs(errors[1]) < 0.5 * abs(errors[0])


def block(scale, laws):
    """Two points with masses on a plane, 0.3 m apart, which do not turn."""
    places = 0.3 * scale * np.array([[0, 0], [0.6, 0.8]])
    mass, dhat = 10.0 * scale**3, 4e-3 * scale
    kappa = 4.0 * mass * GRAVITY / dhat
    body = over_plane(places, 0.02 * scale, dhat, kappa, mass, laws, 50.0 * scale)
    return replace(body, inertia=np.zeros(5))


@pytest.mark.parametrize("exact", [True, False])
def test_block_on_a_slope_sticks_or_slides(exact):
    for angle, h in ((10, 1e-3), (20, 2e-3)):
        body, pull = block(1.0, law(friction=0.3)), GRAVITY * np.tan(np.radians(angle))
        body.exact, body.g[0] = exact, pull  # with the same load on the plane
        start = body.x[3, 0]
        for _ in range(25):
            body.step(h)
        if angle == 10:
            assert 0 < body.v[3, 0] < 1e-3  # creeps more slowly than the slip speed
            assert body.x[3, 0] - start < 25 * h * 1e-3
        else:
            # it gets faster where friction is not yet Coulomb's: at most by the slip speed
            assert -1e-7 <= body.v[3, 0] - 25 * h * (pull - 0.3 * GRAVITY) < 1e-3
        assert np.min(body.losses) >= 0
        assert np.mean(body.iterations) < 8


def test_way_to_stop_is_that_of_coulomb_at_all_scales():
    errors = []
    for scale in (1.0, 0.1, 0.01):
        root = np.sqrt(scale)
        body = block(scale, law(friction=0.3, slow=slow_speed(GRAVITY, 4e-3 * scale)))
        body.v[3:, 0] = root
        start, kinetic, h = body.x[3, 0], body.kinetic, 1e-2 * root
        for _ in range(45):
            body.step(h)
        errors.append((body.x[3, 0] - start) / (scale / (0.6 * GRAVITY)) - 1)
        assert np.min(body.losses) >= 0
        # all of the energy; rest does not go to and fro, as with a law of the mean slip
        assert sum(body.losses)[FRICTION] == pytest.approx(kinetic, rel=1e-9)
        assert np.abs(body.v[3:]).max() < 1e-6 * root
        assert np.mean(body.iterations) < 8
    # first order in the last step; a lagged normal force or slip misses per cent
    assert abs(errors[0]) < 1e-3
    # round-off: a speed that is not scaled changes the error
    assert np.ptp(errors) < 1e-8


@pytest.mark.parametrize(
    ("angle", "size"), [(0.438, 1.66), (0.311, 1.86), (0.213, 2.08), (0.100, 1.98)]
)
def test_newton_ends_where_slip_turns_across_itself(angle, size):
    """A push turns the slip of a block by almost a right angle beyond its reverse in one step."""
    body = block(1.0, law(friction=0.3))
    h = 1e-2
    body.v[3:, 0] = h * GRAVITY
    body.g[:2] = size * GRAVITY * np.array([-np.cos(angle), np.sin(angle)])
    body.step(h)
    assert np.min(body.losses) >= 0
    # slopes towards a slip along the force alone lead from one side to the other for ever
    assert body.iterations[-1] < 15


def test_sliding_spheres_roll():
    ball = over_plane([[0.0, 0.0]], 0.1, 1e-4, 4e5, 1.0, law(friction=0.3))
    ball.v[3, 0], h = 1.0, 1e-2
    for _ in range(40):
        ball.step(h)
    arm, spin = ball.x[3, 2], ball.spin[3, 1]
    assert np.min(ball.losses) >= 0
    # the gap is 1e-3 of the radius, and the slip speed; 1/7 without the couple of friction
    assert ball.v[3, 0] == pytest.approx(5 / 7, abs=1e-3)
    assert arm * spin == pytest.approx(ball.v[3, 0], abs=1e-3)


@pytest.mark.parametrize("h", [2e-3, 1e-2])
def test_spheres_that_stick_in_an_impact_leave_rolling(h):
    ball = over_plane([[0.0, 0.0]], 0.5, 0.02, 1e4, 1.0, law(friction=1.0))
    ball.g[:], ball.x[3, 2], ball.v[3] = 0.0, 0.525, (0.5, 0, -1.0)
    start = ball.kinetic
    for _ in range(round(0.1 / h)):
        ball.step(h)
    # 4 or 20 steps of impact; its gap is 2 per cent of the radius. A law of the mean slip returns
    # the slip in every other step: 0.2 to 0.5
    assert ball.v[3, 0] == pytest.approx(5 / 14, abs=1e-2)
    assert 0.5 * ball.spin[3, 1] == pytest.approx(5 / 14, abs=2e-2)
    assert ball.kinetic + np.sum(ball.losses) == pytest.approx(start, rel=1e-12)


def patches(exact=True):
    """Two thick patches without rotations, one of which rubs on the other and bounces off."""
    rng = RNG(0)
    low, triangles = grid(2, 2)
    x = np.concatenate([low, 0.8 * low + np.array([0.15, 0.2, 0.125])])
    x += rng.uniform(-2e-3, 2e-3, x.shape)
    corners = np.concatenate([triangles, triangles + 4])
    surface = surface_of(x, corners, label=np.repeat([0, 1], 4), radius=0.05, dhat=0.02)
    surface.kappa[:] = 2e6
    v = rng.uniform(-0.05, 0.05, x.shape)
    v[:4, 1] += 0.4
    v[4:] += (1.0, 0.0, -0.4)
    laws = law(damping=1.0, friction=0.5, static=0.6)
    return Points(surface, laws, x, v, np.full(8, 0.5), np.zeros(8), tilts=Tilts.of(corners, 8),
                  exact=exact)  # fmt: skip


def test_momentum_and_angular_momentum_are_kept_with_thickness():
    body = patches()
    momenta, energy = body.momenta(), body.kinetic
    for _ in range(30):
        body.step(1e-3)
        # round-off; without couples 1e-3, with friction at the mean points of one side 1e-2
        assert np.abs(body.momenta() - momenta).max() < 1e-12
        assert abs(body.kinetic + body.stored + np.sum(body.losses) - energy) < 1e-11
    total = sum(body.losses)
    assert min(total[FRICTION], total[NORMAL_LAWS]) > 0.02
    assert np.min(body.losses) >= 0
    assert max(body.iterations) <= 20


def slid(rng, friction=0.4, static=0.6):
    """A sphere in the middle of a step with contact and slip, and a trial state."""
    ball = over_plane([[0.1, 0.2]], 0.1, 0.02, 1e4, 1.0, law(friction=friction, static=static))
    ball.v[3], ball.spin[3] = (0.1, -0.05, -0.1), rng.uniform(-1, 1, 3)
    y, h = ball.x.copy(), 1e-3
    y[3] += h * np.array([0.08, -0.06, -0.05])
    ball.prepare(y)
    return ball, y, h


@pytest.mark.parametrize("slow", [1e-3, 0.3])
def test_tangent_of_friction_is_exact(slow):
    rng = RNG(1)
    for damping in (0.0, 2.0):
        ball, y, h = slid(rng)
        ball.law.slip_speed, ball.law.damping = slow, damping
        phi = h * (ball.spin + 0.1 * rng.standard_normal(ball.spin.shape))
        phi[:3] = 0.0
        K, difference = np.zeros((2, 6, 6))
        ball.forces(y, phi, h)
        for k, one in enumerate(np.eye(6)):
            K[:, k] = ball.action(one)
        for k, one in enumerate(1e-9 * np.eye(6)):
            ends = []
            for sign in (1.0, -1.0):
                ball.groups.forget()
                move, turn = ball._vectors(sign * one)
                ends.append(ball.forces(y + move, phi + turn, h))
            difference[:, k] = (ends[1] - ends[0]) / 2e-9
        largest = np.abs(difference).max()
        # differences; the final slip or the change of the coefficient left out miss a tenth
        slips = [0, 1, 3, 4, 5]
        np.testing.assert_allclose(K[:, slips], difference[:, slips], atol=1e-6 * largest)
        # the normal force is in it; arms, which change with the distance, are not
        np.testing.assert_allclose(K[:, 2], difference[:, 2], rtol=0.03, atol=1e-6 * largest)


def test_rows_are_the_symmetric_part_along_slip_and_normal():
    body = patches()
    for _ in range(12):
        body.step(1e-3)
    groups, rng, count = body.groups, RNG(2), int(body.groups.count[0])
    assert count > 3
    assert groups.slopes[:count].min() >= 0
    assert groups.numbers[:count, PUSH].min() >= 0
    steps, spins, sums, couples = np.zeros((4, 8, 3))
    steps[:], spins[:] = rng.standard_normal((2, 8, 3))
    motions, forces = np.zeros((2, count, 3))
    forces[:] = rng.standard_normal((count, 3))
    motions_into(groups.memory, steps, spins, motions)
    spread(groups.memory, forces, sums, couples)
    # one is the transpose of the other, but for the friction that normal forces bring along
    extra = forces[:, :1] * groups.numbers[:count, RATIO : RATIO + 3]
    along = (
        extra[:, np.newaxis] * groups.numbers[:count, ALONG : ACROSS + 3].reshape(-1, 2, 3)
    ).sum(2)
    assert np.abs(along).max() > 1e-3 * np.abs(forces).max()
    forces[:, 1:] += along
    work = (sums * steps).sum() + (couples * spins).sum()
    assert work == pytest.approx((motions * forces).sum(), rel=1e-12)
    assert np.abs(sums.sum(0)).max() < 1e-12
    plain = np.zeros((count, 1))
    motions_into(groups.memory, steps, spins, plain)
    np.testing.assert_array_equal(plain[:, 0], motions[:, 0])


def test_tilts_turn_with_rigid_motions_and_carry_couples():
    rng = RNG(4)
    points, triangles = grid(4, 3, height=lambda x, y: 0.2 * np.sin(3 * x + y))
    tilts, n = Tilts.of(triangles, len(points) + 1), len(points)
    every = np.concatenate([points, [[9.0, 9.0, 9.0]]])
    place_tilts(tilts.memory, every)
    omega, along = rng.standard_normal((2, 3))
    spins = all_spins(tilts, np.cross(omega, every) + along, np.zeros_like(every))
    np.testing.assert_allclose(spins[:n], np.tile(omega, (n, 1)), atol=1e-12)
    np.testing.assert_array_equal(spins[n], 0)  # a point of no triangle
    couples, sums, steps = rng.standard_normal(every.shape), np.zeros_like(every), every**2
    spread_couples(tilts.memory, couples, sums)
    assert np.abs(sums.sum(0)).max() < 1e-12
    np.testing.assert_allclose(np.cross(every, sums).sum(0), couples[:n].sum(0), atol=1e-12)
    turned = np.zeros_like(every)
    add_spins(tilts.memory, steps, turned)
    assert (sums * steps).sum() == pytest.approx((couples * turned).sum(), rel=1e-12)
    # a finite rotation from the middle: twice the tangent of half the angle
    R = so3.exp(np.array([0.0, 0.0, 0.1]))
    place_tilts(tilts.memory, 0.5 * (every + every @ R.T))
    turned = all_spins(tilts, every @ R.T - every, np.zeros_like(every))[:n]
    np.testing.assert_allclose(turned, np.tile([0, 0, 2 * np.tan(0.05)], (n, 1)), atol=1e-12)


def test_friction_in_a_groove_is_that_of_both_walls():
    points = np.array([[-5.0, 0, 0], [5, 0, 0], [-5, 3, 3], [5, 3, 3], [-5, -3, 3], [5, -3, 3]])
    triangles = np.array([[0, 1, 3], [0, 3, 2], [1, 0, 4], [1, 4, 5]])
    x = np.concatenate([points, [[0.3, 0, 0.0]]])
    label, area = np.repeat([0, 1], [6, 1]), np.repeat([0.0, 1.0], [6, 1])
    surface = surface_of(x, triangles, label=label, radius=0.0, dhat=0.01, area=area)
    surface.radius[6] = 0.1
    x[6, 2] = np.sqrt(2) * 0.105
    body = Points(surface, law(friction=0.2), x, np.zeros_like(x), np.repeat([np.inf, 1.0], [6, 1]),
                  np.zeros(7), np.array([0, 0, -GRAVITY]))  # fmt: skip
    body.v[6, 0], h = 1.0, 1e-3
    impulse = 0.0
    for _ in range(30):
        before = body.v[6].copy()
        body.step(h)
        impulse += body.v[6, 2] - before[2] + h * GRAVITY
    # walls at 45 degrees press with sqrt(2) times the load; one contact with their sum would not
    assert 1.0 - body.v[6, 0] == pytest.approx(0.2 * np.sqrt(2) * impulse, rel=1e-6)
    assert impulse > 0.1
