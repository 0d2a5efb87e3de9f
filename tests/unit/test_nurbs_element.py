# SPDX-License-Identifier: LGPL-3.0-or-later
"""The NURBS beam: exact derivatives, objectivity, closed forms, groups of elements."""

import numpy as np
import pytest
import ufl
from scipy.integrate import solve_ivp

import flexfem as ff
from flexfem.lie import se3, so3
from tests.unit.sections import coupled_section, shifted_sections

pytestmark = pytest.mark.serial

GRAVITY = np.array([3.0, -7.0, 2.0])
SCALE = 0.3
STILL = np.array([0.0, 0.0, 1.0])
MASS = np.array([0.0, 1.0, 0.0])


SECTION = coupled_section()
EA, GA_2, GA_3, GJ, EI_2, EI_3 = STIFFNESS = (1e3, 400.0, 300.0, 20.0, 10.0, 5.0)
#: of the arc that is bent
RADIUS = 1.5
SIMPLE = ff.Section.general(STIFFNESS, (2.0, 2.0, 2.0, 0.3, 0.2, 0.1))


def energy(strain, p):
    """Stiffening extension, softening bending, couplings."""
    g1, g2, g3, k1, k2, k3 = strain
    bending = p.EI * p.k0**2 * (ufl.sqrt(1 + (k2**2 + k3**2) / p.k0**2) - 1)
    stretching = p.EA * (g1**2 / 2 + g1**4 / 2) + p.GA * (g2**2 + g3**2) / 2
    return stretching + p.GJ * k1**2 / 2 + bending + p.c * (g1 * k1 + g2 * k3**2)


def dissipation(strain, rate, p):
    """Thinning in the rate, thickening in the strain."""
    return p.eta * (1 + ufl.dot(strain, strain)) * (ufl.sqrt(1 + ufl.inner(rate, rate)) - 1)


VALUES = {"EA": 90.0, "GA": 40.0, "GJ": 20.0, "EI": 10.0, "k0": 2.5, "c": 6.0, "eta": 3.0}
LAW = ff.Section.general(
    law=ff.BeamLaw(energy, dissipation=dissipation, parameters=VALUES),
    inertia=SECTION.inertia,
)


def _curved(
    one_nurbs, degree: int, section=SECTION, damping: float = 0.0, inertial=True, count=3,
    vectors=False,
):  # fmt: skip
    """A curved and twisted beam with any weights; its frames do not follow the line."""
    n = count * degree + 1
    s = np.linspace(0.0, 2.0, n)
    points = np.stack([np.sin(s), 1.0 - np.cos(s), 0.3 * s**2], axis=1)
    weights = 1.0 + 0.4 * np.random.default_rng(3).random(n)
    turns = 0.1 + s[:, np.newaxis] * [0.2, 0.3, 0.5]
    return one_nurbs(points, degree, section, damping, weights, turns, inertial, vectors)


# --- derivatives ---------------------------------------------------------------------------------


def _check_derivatives(beam, shifts, rng):
    beam.gravity = GRAVITY
    beam.disturb(rng)
    state, eps = beam.state(), 2e-6
    step, sides = beam.random(rng, 1.0), []
    for sign in (1.0, -1.0):
        beam.move(state, sign * eps * step, shifts)
        sides.append(beam.residual(SCALE))
    beam.move(state, 0.0 * step, shifts)
    expected = (sides[0] - sides[1]) / (2.0 * eps)
    # differences are good to about 1e-10; a missing term (geometric, gravity, gyroscopic, damping
    # at a moving place) is of the order of the term itself, more than 1e-3 here
    bound = 1e-8 * beam.largest(expected)
    assert beam.largest(beam.product(step, shifts, SCALE) - expected) <= bound
    assert beam.largest(beam.action(step, shifts, SCALE) - expected) <= bound


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
@pytest.mark.parametrize("damping", [0.0, 0.03])
@pytest.mark.parametrize("moving", [True, False], ids=["moving", "stiffness"])
@pytest.mark.parametrize("inertial", [False, True], ids=["se3", "inertial"])
def test_tangent_and_action_are_the_derivative_of_the_residual(
    one_nurbs, degree, damping, moving, inertial, rng
):
    beam = _curved(one_nurbs, degree, damping=damping, inertial=inertial)
    _check_derivatives(beam, beam.shifts if moving else STILL, rng)


@pytest.mark.parametrize("degree", [pytest.param(1, marks=pytest.mark.slow), 3])
@pytest.mark.parametrize("damping", [0.0, 0.03])
def test_derivatives_with_relative_rotation_vectors(one_nurbs, degree, damping, rng):
    beam = _curved(one_nurbs, degree, damping=damping, vectors=True)
    _check_derivatives(beam, beam.shifts, rng)


@pytest.mark.parametrize("degree", [pytest.param(1, marks=pytest.mark.slow), 3])
@pytest.mark.parametrize("moving", [True, False], ids=["moving", "stiffness"])
def test_derivatives_with_a_law_of_the_user(one_nurbs, degree, moving, rng):
    beam = _curved(one_nurbs, degree, LAW)
    _check_derivatives(beam, beam.shifts if moving else STILL, rng)


def test_more_elements_than_lanes(one_nurbs, rng):
    """A batch that is full and one that is not."""
    beam = _curved(one_nurbs, 2, damping=0.03, count=11)
    _check_derivatives(beam, beam.shifts, rng)


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_mass_matrix_is_the_residual_of_the_accelerations(one_nurbs, degree, rng):
    beam = _curved(one_nurbs, degree, damping=0.03)
    beam.disturb(rng)
    beam.block.increment[:] = 0.0
    before, change = beam.residual(), beam.random(rng, 1.0)
    beam.block.acceleration += change
    expected = beam.residual() - before
    # the residual is linear in them: round-off; a lump at the wrong node is off by its size
    bound = 1e-13 * beam.largest(expected) * 100.0
    assert beam.largest(beam.product(change, MASS, 1.0) - expected) <= bound
    assert beam.largest(beam.action(change, MASS, 1.0) - expected) <= bound


def test_local_derivatives_are_those_of_translations_in_local_axes(one_nurbs, rng):
    beam = _curved(one_nurbs, 3, damping=0.03)
    beam.disturb(rng)
    local, moving = beam.matrix(beam.shifts, local=True), beam.matrix(beam.shifts)
    beam.block.inertial = False
    np.testing.assert_array_equal(local, beam.matrix(beam.shifts))
    # otherwise both calls would mean the same
    assert np.abs(local - moving).max() > 1e-2


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize(
    ("section", "vectors"),
    [(SECTION, False), (LAW, False), (SECTION, True)],
    ids=["linear", "law", "vectors"],
)
def test_internal_force_is_the_gradient_of_the_strain_energy(
    one_nurbs, degree, section, vectors, rng
):
    beam = _curved(one_nurbs, degree, section, vectors=vectors)
    beam.disturb(rng)
    beam.block.velocity[:], beam.block.acceleration[:] = 0.0, 0.0
    state, step, eps, energies = beam.state(), beam.random(rng, 1.0), 1e-5, []
    for sign in (1.0, -1.0):
        beam.move(state, sign * eps * step, np.zeros(3))
        energies.append(beam.energy())
    beam.move(state, 0.0 * step, np.zeros(3))
    power = float((beam.residual() * step).sum())
    # differences of the energy are good to 1e-9; one quadrature for both, or forces that lack a
    # part of the map from places to nodes, differ by 1e-2 and more
    assert power == pytest.approx((energies[0] - energies[1]) / (2.0 * eps), rel=1e-7)


def test_stress_continued_along_a_step(one_nurbs, rng):
    """Stresses of the mixed Newton method: those of strains continued linearly along the step.

    The force they add is that of a viscosity of one second at the velocities of the step.
    """
    plain, damped = _curved(one_nurbs, 3), _curved(one_nurbs, 3, damping=1.0)
    for beam in (plain, damped):
        beam.disturb(np.random.default_rng(5))
        beam.block.velocity[:], beam.block.acceleration[:] = 0.0, 0.0
    frames, step = plain.block.frames.copy(), plain.random(rng, 0.2)
    exact, before = plain.matrix(STILL), plain.residual()
    damped.block.velocity[:] = step
    moving = damped.residual()
    damped.block.velocity[:] = 0.0
    damping_only = moving - damped.residual() - _inertia_force(damped, step)
    continued = plain.beams.continued_strains(frames, step)
    # round-off; a step taken in other axes, or stresses of the trial state, are off by percents
    difference = plain.residual(strains=continued) - before
    np.testing.assert_allclose(difference, damping_only, rtol=0, atol=1e-11)
    along, eps = plain.random(rng, 1.0), 1e-6
    slopes = []
    for strains in (continued, plain.beams.continued_strains(frames, 0.0 * step)):
        sides = []
        for sign in (1.0, -1.0):
            plain.block.frames[:] = se3.retract(frames, sign * eps * along)
            # at the given stress wherever the nodes are
            sides.append(plain.residual(strains=strains))
        plain.block.frames[:] = frames
        slopes.append((sides[0] - sides[1]) / (2.0 * eps))
    change = ((plain.matrix(STILL, strains=continued) - exact) @ along.ravel()).reshape(-1, 6)
    expected = slopes[0] - slopes[1]
    # differences are good to 1e-9; the geometric stiffness alone has the stress in it
    np.testing.assert_allclose(change, expected, atol=1e-7 * np.abs(expected).max())


def _inertia_force(beam, velocity: np.ndarray) -> np.ndarray:
    """Force of the inertia at the given velocities."""
    kept = beam.beams
    for group in kept.groups:
        group.data.damping[:] = 0.0
    still = beam.residual()
    beam.block.velocity[:] = velocity
    force = beam.residual() - still
    beam.block.velocity[:] = 0.0
    return force


# --- invariance ----------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_every_initial_shape_is_free_of_stress(one_nurbs, degree):
    beam = _curved(one_nurbs, degree)
    strain, _ = beam.beams.points_at(np.linspace(0.0, 1.0, 5)).resultants(beam.block.frames)
    # round-off; the curvature of the line or of its frames taken for strain is of order 1
    assert beam.largest(strain) <= 1e-14
    assert beam.largest(beam.residual()) <= 1e-13


@pytest.mark.parametrize(
    ("degree", "vectors"),
    [(1, False), (2, False), (3, False), (4, False), (1, True), (2, True), (3, True), (4, True)],
)
def test_superposed_rigid_motion_changes_neither_strain_nor_local_force(
    one_nurbs, degree, vectors, rng
):
    beam = _curved(one_nurbs, degree, vectors=vectors)
    beam.disturb(rng)
    places = np.linspace(0.0, 1.0, 4)
    strain = beam.beams.points_at(places).resultants(beam.block.frames)[0]
    force, stored = beam.residual(), beam.energy()
    rigid = se3.exp(np.array([7.0, -4.0, 2.0, 1.9, -0.8, 1.7]))
    beam.block.frames[:] = se3.compose(rigid, beam.block.frames)
    moved = beam.beams.points_at(places).resultants(beam.block.frames)[0]
    # round-off, which grows with the distance; interpolated total rotations change it by 1e-2
    assert beam.largest(moved - strain) <= 1e-13 * 20.0
    # inertia too: without gravity the local residual does not depend on the orientation
    assert beam.largest(beam.residual() - force) <= 1e-13 * beam.largest(force) * 20.0
    assert beam.energy() == pytest.approx(stored, rel=1e-13)


@pytest.mark.parametrize("vectors", [False, True], ids=["quaternions", "vectors"])
def test_closed_path_returns_the_energy(one_nurbs, vectors, rng):
    """The work along a closed path of all nodes, turning by up to a radian, is zero."""
    beam = _curved(one_nurbs, 3, vectors=vectors)
    first, second, count, work, size = beam.random(rng, 0.3), beam.random(rng, 0.3), 48, 0.0, 0.0
    for t in 2.0 * np.pi * np.arange(count) / count:
        twist = np.sin(t) * first + np.sin(2.0 * t) * second + (1.0 - np.cos(t)) * second[::-1]
        rate = np.cos(t) * first + 2.0 * np.cos(2.0 * t) * second + np.sin(t) * second[::-1]
        beam.block.frames[:] = se3.retract(beam.block.start_frames, twist)
        speed = np.einsum("nij,nj->ni", se3.tangent(twist), rate)
        power = float((beam.residual() * speed).sum())
        work, size = work + power / count, size + abs(power) / count
    # equidistant points are as good as exact for what is smooth and periodic; rotations summed up
    # over increments leave 1e-3
    assert abs(work) <= 1e-10 * size


@pytest.mark.parametrize("vectors", [False, True], ids=["quaternions", "vectors"])
def test_strains_are_those_of_the_interpolated_line(one_nurbs, vectors, rng):
    """gamma = R^T x', kappa = axial(R^T R'), from differences along the line of one element."""
    beam = _curved(one_nurbs, 3, count=1, vectors=vectors)
    beam.disturb(rng)
    xi, eps = np.array([0.0, 0.3, 0.8]), 1e-5
    both = []
    for frames in (beam.block.frames, beam.block.start_frames):
        ends = [_pose(beam, frames, xi + sign * eps) for sign in (1.0, -1.0)]
        start = [_pose(beam, beam.block.start_frames, xi + sign * eps)[0] for sign in (1.0, -1.0)]
        speed = np.linalg.norm(start[0] - start[1], axis=1)[:, np.newaxis]
        R = _pose(beam, frames, xi)[1]
        gamma = np.einsum("qji,qj->qi", R, ends[0][0] - ends[1][0]) / speed
        kappa = so3.log(np.swapaxes(ends[1][1], -1, -2) @ ends[0][1]) / speed
        both.append(np.concatenate([gamma, kappa], axis=1))
    strain, resultant = beam.beams.points_at(xi).resultants(beam.block.frames)
    # differences are good to 1e-9; derivatives by xi, or the left curvature, are off by 0.1
    np.testing.assert_allclose(strain[0], both[0] - both[1], atol=1e-8)
    np.testing.assert_allclose(resultant[0], strain[0] @ SECTION.stiffness, rtol=1e-12)


def _pose(beam, frames: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (q, 3) and rotations (q, 3, 3) at places of the first element."""
    group = beam.beams.groups[0]
    nodes, powers = group.data.nodes[0], xi[:, np.newaxis] ** np.arange(beam.degree + 1)
    N = powers @ group.data.shape[0].T
    N /= N.sum(axis=1, keepdims=True)
    R = se3.rotation(frames[nodes])
    reference = R[len(nodes) // 2]
    theta = so3.log(reference.T @ R)
    if group.data.vectors:
        return N @ frames[nodes, :3], reference @ so3.exp(N @ theta)
    half = 0.5 * np.linalg.norm(theta, axis=1)
    # tan(t / 2) n of the sum of the quaternions (cos(t / 2), sin(t / 2) n)
    vector = 0.5 * N @ (np.sinc(half / np.pi)[:, np.newaxis] * theta)
    tangent = vector / (N @ np.cos(half))[:, np.newaxis]
    size = np.linalg.norm(tangent, axis=1)[:, np.newaxis]
    turn = 2.0 * np.arctan(size) * np.divide(tangent, size, where=size > 0, out=0.0 * tangent)
    return N @ frames[nodes, :3], reference @ so3.exp(turn)


# --- closed forms --------------------------------------------------------------------------------


def _straight(one_nurbs, degree: int, count: int, length: float, section=SIMPLE, **more):
    points = np.linspace([0.0, 0, 0], [length, 0, 0], degree * count + 1)
    return one_nurbs(points, degree, section, **more)


def _flexibility(beam) -> np.ndarray:
    """Of the last node of a cantilever, (6, 6)."""
    return np.linalg.inv(beam.matrix(STILL)[6:, 6:])[-6:, -6:]


def test_cubic_element_is_exact_for_loads_at_its_ends(one_nurbs):
    """Timoshenko's cantilever: L^3/(3 EI) + L/GA and its like, from one element."""
    L = 3.0
    F = np.diag([L / EA, L / GA_2, L / GA_3, L / GJ, L / EI_2, L / EI_3])
    F[1, 1] += L**3 / (3.0 * EI_3)
    F[2, 2] += L**3 / (3.0 * EI_2)
    F[1, 5] = F[5, 1] = L**2 / (2.0 * EI_3)
    F[2, 4] = F[4, 2] = -(L**2) / (2.0 * EI_2)
    # round-off; too few quadrature points leave it softer, locking stiffer, both by percents
    found = _flexibility(_straight(one_nurbs, 3, 1, L))
    np.testing.assert_allclose(found, F, atol=1e-12 * F.max())


def test_linear_element_does_not_lock(one_nurbs):
    """One point in a linear element: L^3/(4 EI) + L/GA; full quadrature would add EI/GA terms."""
    L = 3.0
    found = _flexibility(_straight(one_nurbs, 1, 1, L))
    # with two points the shear of a slender element hides all bending: ten times as stiff here
    assert found[1, 1] == pytest.approx(L**3 / (4.0 * EI_3) + L / GA_2, rel=1e-12)
    assert found[5, 5] == pytest.approx(L / EI_3, rel=1e-12)
    assert found[0, 0] == pytest.approx(L / EA, rel=1e-12)


def _bend(beam, force, moment: float, steps: int) -> None:
    """Load the end of a cantilever by a constant force and a moment about its e3."""
    force, size = np.asarray(force), len(beam.block.frames) * 6
    for step in range(1, steps + 1):
        for _ in range(30):
            load, K = np.zeros(size), beam.matrix(STILL)
            local = se3.rotation(beam.block.frames[-1]).T @ force * step / steps
            load[-6:-3], load[-1] = local, moment * step / steps
            K[-6:-3, -3:] -= so3.skew(local)
            change = np.zeros(size)
            change[6:] = np.linalg.solve(K[6:, 6:], (load - beam.residual().ravel())[6:])
            beam.block.frames[:] = se3.retract(beam.block.frames, change.reshape(-1, 6))
            if np.abs(change).max() < 1e-9:
                break
        else:
            pytest.fail("Newton's method did not converge")


@pytest.mark.parametrize(("degree", "counts"), [(1, (8, 16)), (2, (8, 16)), (3, (6, 12))])
def test_pure_bending_to_a_circle_converges(one_nurbs, degree, counts):
    """M = EI 2 pi / L closes a cantilever to a circle, with the energy M^2 L / (2 EI)."""
    L, gaps, errors = 2.0, [], []
    moment = 2.0 * np.pi * EI_3 / L
    for count in counts:
        beam = _straight(one_nurbs, degree, count, L)
        _bend(beam, np.zeros(3), moment, 8)
        frames = beam.block.frames
        gaps.append(np.linalg.norm(frames[-1, :3] - frames[0, :3]))
        errors.append(abs(beam.energy() / (0.5 * moment**2 * L / EI_3) - 1.0))
    # the order is 2 p in the energy; a wrong map from places to nodes does not converge at all
    orders = [np.log2(e[0] / e[1]) for e in (gaps, errors) if e[1] > 1e-11]
    assert not orders or min(orders) >= 2 * degree - 0.5
    # two nodes, rotated by t, bend by 4 tan(t/4): 1 + t^2/12 is the moment that turns them
    assert max(gaps[1], errors[1]) <= (3e-2 if degree == 1 else 3e-3)


def _arc(one_nurbs, degree: int, count: int, smooth: bool):
    """A quarter circle, the elements joined with C^(p - 1) or C0."""
    from flexfem.families.beam_nurbs.elements import NurbsCells
    from flexfem.mesh.nurbs.frames import control_frames

    curve = ff.NurbsCurve.arc([0, 0, 0], [RADIUS, 0, 0], [0, 0, 1], np.pi / 2, degree=degree)
    curve = curve.refine(count)
    if not smooth:
        curve = curve.insert(np.repeat(np.unique(curve.knots)[1:-1], degree - 1))
    parts, frames = curve.elements, control_frames(curve)
    numbers = np.zeros(count, dtype=np.int64)
    data = NurbsCells(parts.nodes, numbers, numbers, parts.shape, np.zeros((count, 1)))
    beam = _straight(one_nurbs, 1, 1, 1.0)
    beam.create(frames[:, :3], so3.log(se3.rotation(frames)), [data], [SIMPLE])
    np.testing.assert_allclose(beam.beams.lengths, parts.lengths, rtol=1e-12)
    return beam


def _rod(force) -> tuple[float, np.ndarray]:
    """Strain energy and end of the same arc, by shooting with the rod's differential equations."""

    def slope(_, state):
        q, moment = state[3:7], state[7:10]
        v = so3.skew(q[1:])
        R = np.eye(3) + (2.0 * q[0] * v + 2.0 * v @ v) / (q @ q)
        n, m = R.T @ force, R.T @ moment
        gamma, change = n / STIFFNESS[:3], m / STIFFNESS[3:]
        kappa = change + np.array([0.0, 0.0, 1.0 / RADIUS])
        x_s = R @ (gamma + np.array([1.0, 0.0, 0.0]))
        q_s = 0.5 * np.append(-q[1:] @ kappa, q[0] * kappa + np.cross(q[1:], kappa))
        return np.concatenate([x_s, q_s, np.cross(force, x_s), [0.5 * (n @ gamma + m @ change)]])

    def end(moment):
        # e1 starts along y
        start = [RADIUS, 0, 0, np.sqrt(0.5), 0, 0, np.sqrt(0.5), *moment, 0]
        length = 0.5 * np.pi * RADIUS
        return solve_ivp(slope, (0.0, length), start, method="DOP853", rtol=1e-12, atol=1e-13).y[
            :, -1
        ]

    moment, eps = np.cross([-RADIUS, RADIUS, 0.0], force), 1e-6
    for _ in range(20):
        miss = end(moment)[7:10]
        if np.abs(miss).max() < 1e-11:
            break
        sides = [[end(moment + s * eps * e)[7:10] for e in np.eye(3)] for s in (1.0, -1.0)]
        columns = (np.array(sides[0]) - sides[1]) / (2.0 * eps)
        moment = moment - np.linalg.solve(columns.T, miss)
    else:
        pytest.fail("shooting did not converge")
    last = end(moment)
    return float(last[10]), last[:3]


@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "C0"])
def test_order_of_convergence_of_a_bent_arc(one_nurbs, smooth):
    """Energy and displacement of the end in space fall with the power 2 p of the length."""
    force = np.array([1.0, -2.0, 3.0])
    energy, place = _rod(force)
    for degree, counts in ((2, (12, 24)), (3, (8, 16) if smooth else (4, 8))):
        errors = []
        for count in counts:
            beam = _arc(one_nurbs, degree, count, smooth)
            _bend(beam, force, 0.0, 4)
            miss = np.linalg.norm(beam.block.frames[-1, :3] - place)
            errors.append([abs(beam.energy() / energy - 1.0), miss])
        # rotations that jump between smooth elements leave the order 3; too few quadrature points,
        # or a derivative by the wrong length, cost an order at least
        assert (np.log2(np.divide(*errors)) >= 2 * degree - 0.3).all()
        # one more quadrature point locks: 7e-4 to 2.5e-3 at degree 2
        assert np.max(errors) <= 1e-4


def test_arc_of_any_radius_is_exact_and_so_are_its_mass_and_motion(one_nurbs):
    """A quarter of a circle is one rational element of degree 2 (weights 1, sqrt(1/2), 1)."""
    r, spin = 1.5, 0.8
    points = r * np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    turns = np.array([[0.0, 0, 2], [0, 0, 3], [0, 0, 4]]) * np.pi / 4.0
    beam = one_nurbs(points, 2, SIMPLE, weights=np.array([1.0, np.sqrt(0.5), 1.0]), turns=turns)
    length = 0.5 * np.pi * r
    # to round-off: chords, or lengths by the parameter, would be off by percents
    np.testing.assert_allclose(beam.beams.lengths, [length], rtol=1e-13)
    beam.gravity = GRAVITY
    np.testing.assert_allclose(
        beam.wrench(beam.residual())[:3], -2.0 * length * GRAVITY, rtol=1e-12
    )
    beam.gravity = np.zeros(3)
    beam.block.velocity[:] = beam.rigidly(np.zeros(3), np.array([0.0, 0.0, spin]))
    motion = np.zeros(11)
    beam.beams.add_motion(beam.block, np.array([True]), motion)
    inertia, centre = 2.0 * length * r**2 + 0.1 * length, 2.0 * r / np.pi
    moment = 2.0 * length * centre
    expected = [
        0.5 * inertia * spin**2, 2.0 * length, moment, moment, 0.0, -moment * spin, moment * spin,
        0.0, 0.0, 0.0, inertia * spin,
    ]  # fmt: skip
    # lumped translation misses the moment of inertia by tens of percents
    np.testing.assert_allclose(motion, expected, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(beam.momenta(), motion[5:], rtol=1e-12, atol=1e-12)


def test_rigid_motion_of_a_rod_with_an_uneven_parameter(one_nurbs):
    """Kinetic energy and momenta of a straight rod whose speed by the parameter varies."""
    points = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.9, 0, 0], [2.0, 0, 0]])
    beam = one_nurbs(points, 3, SIMPLE, weights=np.array([1.0, 0.7, 1.4, 1.1]))
    velocity, spin = np.array([1.0, -2.0, 0.5]), np.array([0.7, -0.2, 0.4])
    beam.block.velocity[:] = beam.rigidly(velocity, spin)
    motion, mass = np.zeros(11), 2.0 * 2.0
    beam.beams.add_motion(beam.block, np.array([True]), motion)
    centre = velocity + np.cross(spin, [1.0, 0.0, 0.0])
    J = mass * 4.0 / 12.0 * np.diag([0.0, 1.0, 1.0]) + 2.0 * np.diag([0.3, 0.2, 0.1])
    assert motion[0] == pytest.approx(0.5 * mass * centre @ centre + 0.5 * spin @ J @ spin, 1e-13)
    # masses by the parameter instead of the arc length are off by tens of percents
    np.testing.assert_allclose(motion[5:8], mass * centre, rtol=1e-12)
    np.testing.assert_allclose(
        motion[8:], J @ spin + mass * np.cross([1.0, 0, 0], centre), rtol=1e-12
    )


@pytest.mark.parametrize("degree", [1, 3])
def test_residual_is_the_rate_of_the_momenta(one_nurbs, degree, rng):
    """Internal forces sum to nothing, inertia forces to the rate of momentum, in any state."""
    beam = _curved(one_nurbs, degree, damping=0.03)
    beam.disturb(rng)
    block, state, eps, sides = beam.block, beam.state(), 1e-5, []
    rate, motion = beam.wrench(beam.residual()), np.zeros(11)
    beam.beams.add_motion(block, np.ones(3, dtype=bool), motion)
    np.testing.assert_allclose(beam.momenta(), motion[5:], rtol=1e-11, atol=1e-11)
    for sign in (1.0, -1.0):
        block.frames[:] = se3.retract(state.frames, sign * eps * state.velocity)
        block.velocity[:] = state.velocity + sign * eps * state.acceleration
        sides.append(beam.momenta())
    expected = (sides[0] - sides[1]) / (2.0 * eps)
    # differences are good to 1e-9; an inertia force whose axes rotate along the element misses the
    # rate by the square of its turning and loses momentum over a run
    np.testing.assert_allclose(rate, expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("degree", [1, 3])
def test_mass_matrix_is_positive_for_any_offset_and_gives_the_kinetic_energy(
    one_nurbs, degree, rng
):
    _, section, _ = shifted_sections()
    beam = _curved(one_nurbs, degree, section, inertial=False)
    beam.disturb(rng)
    beam.block.increment[:] = 0.0  # else velocities change with a tangent map
    block, shifts, size = beam.block, np.array([0.0, 1.0, 0.0]), 6 * len(beam.block.frames)
    columns = [beam.product(e.reshape(-1, 6), shifts, 1.0).ravel() for e in np.eye(size)]
    M = np.array(columns)
    np.testing.assert_allclose(M, M.T, atol=1e-13)
    # with first moments on the axis the least eigenvalues are negative, -0.04 and less
    assert np.linalg.eigvalsh(M)[0] > 1e-5
    motion, v = np.zeros(11), block.velocity.ravel()
    beam.beams.add_motion(block, np.ones(3, dtype=bool), motion)
    assert motion[0] == pytest.approx(0.5 * v @ M @ v, rel=1e-12)


@pytest.mark.parametrize("degree", [1, 3])
def test_inertia_and_weight_of_an_offset_axis_are_those_of_the_centred_one(one_nurbs, degree, rng):
    centred, section, c = shifted_sections()
    points = np.linspace([0.1, 0.2, -0.1], [1.3, 0.9, 0.8], 2 * degree + 1)
    beams = [one_nurbs(points, degree, s) for s in (section, centred)]
    shift = se3.frame(c, np.eye(3))
    X = se3.adjoint(se3.inverse(shift))
    a, b = (beam.block for beam in beams)
    beams[0].disturb(rng)
    b.frames[:] = se3.compose(a.frames, shift)
    b.velocity[:], b.acceleration[:] = a.velocity @ X.T, a.acceleration @ X.T
    forces = []
    for beam in beams:
        beam.gravity = GRAVITY
        moving = beam.residual()
        beam.gravity, beam.block.velocity[:], beam.block.acceleration[:] = np.zeros(3), 0.0, 0.0
        forces.append(moving - beam.residual())
    # first moments on the axis miss forces of the size of the inertia itself
    np.testing.assert_allclose(forces[0], forces[1] @ X, atol=1e-13 * np.abs(forces[0]).max())


def test_weight_acts_at_the_mass_centre_of_the_section(one_nurbs):
    beam = _straight(one_nurbs, 3, 2, 2.0, SECTION)
    beam.gravity = GRAVITY
    expected = -2.0 * 1.3 * np.cross([1.0, 0.11, -0.07], GRAVITY)
    # without the offset the moment about the axis vanishes
    np.testing.assert_allclose(beam.wrench(beam.residual())[3:], expected, atol=1e-12)


# --- viscosity -----------------------------------------------------------------------------------


@pytest.mark.parametrize("section", [SECTION, LAW], ids=["linear", "law"])
def test_viscosity_takes_the_power_that_the_residual_says(one_nurbs, section, rng):
    beam = _curved(one_nurbs, 2, section, 0.03 if section is SECTION else 0.0)
    beam.disturb(rng)
    block, eps, sides, at_points = beam.block, 1e-6, [], []
    stress, _ = beam.beams.viscosity(block)
    cells, lengths = beam.beams.viscous_at
    assert beam.beams.viscous
    np.testing.assert_allclose(np.bincount(cells, lengths), beam.beams.lengths, rtol=1e-3)
    frames, places = block.frames.copy(), 0.5 * (np.polynomial.legendre.leggauss(2)[0] + 1.0)
    for sign in (1.0, -1.0):
        block.frames[:] = se3.retract(frames, sign * eps * block.velocity)
        sides.append(beam.beams.viscosity(block)[1])
        points = beam.beams.points_at(places)
        at_points.append(points.resultants(block.frames)[0].reshape(-1, 6))
    block.frames[:] = frames
    rate = (sides[0] - sides[1]) / (2.0 * eps)
    power = float(np.einsum("j,ji,ji->", lengths, stress, rate))
    force = beam.residual()
    if section is SECTION:
        for group in beam.beams.groups:
            group.data.damping[:] = 0.0
        expected = float(((force - beam.residual()) * block.velocity).sum())
        # differences; a factor 2 (Rayleigh's function) or lengths by the parameter show at once
        assert power == pytest.approx(expected, rel=1e-7)
    # round-off: they are the strains of the beam but for those without stress
    np.testing.assert_allclose(sides[0] - sides[1], at_points[0] - at_points[1], atol=1e-12)


def test_damping_leaves_rigid_motion_alone(one_nurbs):
    beam = _curved(one_nurbs, 3, damping=0.03)
    beam.block.velocity[:] = beam.rigidly(np.array([1.0, 2.0, 3.0]), np.array([0.5, -1.0, 0.2]))
    # rates that are not objective would brake it by 1e-2
    assert np.abs(beam.beams.viscosity(beam.block)[0]).max() <= 1e-13


def test_a_law_that_says_the_same_as_a_stiffness_and_a_damping(one_nurbs, rng):
    D = np.diag(SIMPLE.stiffness)
    law = ff.BeamLaw(
        lambda e, p: sum(0.5 * float(D[i]) * e[i] ** 2 for i in range(6)),
        dissipation=lambda e, r, p: sum(0.01 * float(D[i]) * r[i] ** 2 for i in range(6)),
    )
    answers = []
    for section, damping in ((SIMPLE, 0.02), (SIMPLE.with_law(law), 0.0)):
        beam = _curved(one_nurbs, 2, section, damping)
        beam.disturb(np.random.default_rng(5))
        answers.append([
            beam.residual(), beam.matrix(beam.shifts), beam.beams.energies(beam.block.frames),
            *beam.beams.viscosity(beam.block),
            *beam.beams.resultants(beam.block.frames),
        ])  # fmt: skip
    for found, expected in zip(*answers, strict=True):
        # round-off; the potential is half the power
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


# --- groups --------------------------------------------------------------------------------------


def test_degrees_and_materials_side_by_side(one_nurbs, rng):
    """One block of a linear and a user's beam, each of degrees 2 and 3, against each alone."""
    from flexfem.families.beam_nurbs.elements import NurbsCells

    sections, alone = [SECTION, LAW], {}
    for degree in (2, 3):
        for number, section in enumerate(sections):
            alone[degree, number] = _curved(one_nurbs, degree, section)
    data, first, spans, points, turns = [], 0, {}, [], []
    for degree in (2, 3):
        parts = []
        for number in (1, 0):
            beam = alone[degree, number]
            cells, n = beam.beams.groups[-1 if number else 0].data, len(beam.block.frames)
            parts.append((cells, first, number))
            spans[degree, number] = slice(first, first + n)
            points.append(beam.block.start_frames)
            first += n
        data.append(NurbsCells(
            np.concatenate([c.nodes + at for c, at, _ in parts]),
            np.concatenate([c.body + 10 * degree + number for c, _, number in parts]),
            np.concatenate([np.full(3, number) for _, _, number in parts]),
            np.concatenate([c.shape for c, _, _ in parts]),
            np.concatenate([c.damping for c, _, _ in parts]),
        ))  # fmt: skip
    frames = np.concatenate(points)
    turns = so3.log(se3.rotation(frames))
    both = one_nurbs(frames[:5, :3], 2, SECTION)
    both.create(frames[:, :3], turns, data, sections)
    both.disturb(rng)
    together = both.residual(), both.matrix(both.shifts)
    assert both.beams.law_owner == "Section 1"
    assert [c.shape for c in both.beams.connectivity] == [(3, 3), (3, 3), (3, 4), (3, 4)]
    np.testing.assert_array_equal(both.beams.body, np.repeat([20, 21, 30, 31], 3))
    np.testing.assert_array_equal(both.beams.rows, [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
    chosen = np.array([7, 0, 10])
    some, every = (both.beams.resultants(both.block.frames, c) for c in (chosen, None))
    np.testing.assert_array_equal(some[1], every[1][chosen])
    motion = np.zeros(11)
    both.beams.add_motion(both.block, both.beams.body == 31, motion)
    for key, beam in alone.items():
        at = spans[key]
        for name in ("frames", "velocity", "acceleration", "increment"):
            getattr(beam.block, name)[:] = getattr(both.block, name)[at]
        size = np.abs(beam.residual()).max()
        # elements with the section or the degree of others differ by a tenth
        np.testing.assert_allclose(together[0][at], beam.residual(), atol=1e-12 * size)
        wide = slice(6 * at.start, 6 * at.stop)
        expected = beam.matrix(beam.shifts)
        np.testing.assert_allclose(
            together[1][wide, wide], expected, atol=1e-12 * np.abs(expected).max()
        )
        cells = both.beams.body == 10 * key[0] + key[1]
        energies = both.beams.energies(both.block.frames)[cells]
        np.testing.assert_allclose(energies, beam.beams.energies(beam.block.frames), rtol=1e-12)
    own = np.zeros(11)
    alone[3, 1].beams.add_motion(alone[3, 1].block, np.ones(3, dtype=bool), own)
    np.testing.assert_allclose(motion, own, rtol=1e-12)
