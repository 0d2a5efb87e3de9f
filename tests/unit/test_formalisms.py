# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of motion that UFL derives from energies, by four formalisms.

What they are compared with is written by hand: finite differences of energies, the matrices and
vectors of finite elements in a floating frame (Vlase, Marin, Negrean, Mathematics 10 (2022) 257),
closed forms.
"""

import textwrap
import time
from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import research
from flexfem.core.status import Status
from flexfem.research.equations.vector_equations import Motion
from flexfem.research.formalisms.compiled import energies_of
from flexfem.research.formalisms.counting import Count, count_form, count_operations
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import (
    accelerations,
    consistent_start,
    null_space,
    partition,
)
from flexfem.research.formalisms.motion import FormalismMotion
from flexfem.research.formalisms.runs.motion import SideBySide
from tests.unit import elastic_bodies as eb

KINDS = [("beam", False), ("beam", True), ("plane", False), ("solid", True)]


def relative(a, b):
    return np.abs(np.asarray(a) - b).max() / np.abs(b).max()


@pytest.fixture(
    scope="module",
    params=[pytest.param(kind, marks=pytest.mark.slow if kind[1] else ()) for kind in KINDS],
    ids=lambda kind: f"{kind[0]}-{['planar', 'spatial'][kind[1]]}",
)
def pair(request):
    return MechanismEquations(eb.pair(*request.param, damping=0.01))


@pytest.mark.serial
def test_formalisms_give_the_same_accelerations(pair, rng):
    for _ in range(3):
        q, v = eb.random_state(pair, rng)
        ways = {name: accelerations(name, pair, q, v, 0.2) for name in research.FORMALISMS}
        for name in research.FORMALISMS[1:]:
            # round-off of a mass matrix of condition 1e3; any term left out is 1e-3 or more
            assert relative(ways[name], ways["lagrange"]) < 1e-12, name
        # the constraints are kept: a wrong bias term would leave 1e-2
        given = pair.prescribed_accelerations(q, v, 0.2)
        np.testing.assert_allclose(pair.jacobian(q) @ ways["maggi"], given, atol=1e-10)


@pytest.mark.serial
def test_equations_agree_away_from_any_motion(pair, rng):
    """Lagrange's and Gibbs and Appell's are the same functions of q, q', q'', free or not."""
    q, v, a = (0.05 * rng.standard_normal(pair.size) for _ in range(3))
    q, v, a = q + pair.start[0], 50.0 * v, 500.0 * a
    one, other = (pair.vector(name, q, v, a) for name in ("lagrange", "gibbs_appell"))
    # the inertia is most of it; an error of one term in a hundred thousand would be seen
    assert relative(one, other) < 1e-13
    # p' = -dH/dq + Q is the same equation again: dp/dt along the motion minus the force
    change = pair.matrix("hamilton", (1.0,), q, v) @ a
    change += pair.matrix("hamilton", (0.0, 1.0), q, v) @ v
    assert relative(change - pair.vector("force", q, v), one) < 1e-12


@pytest.mark.serial
def test_momenta_and_forces_are_differences_of_the_energies(pair, rng):
    """Only the energies are evaluated: no derivative of UFL is trusted."""
    pair = (
        pair
        if not pair.mechanism.bodies[0].matter.damping
        else MechanismEquations(
            replace(pair.mechanism, bodies=[_undamped(b) for b in pair.mechanism.bodies])
        )
    )
    q, v = eb.random_state(pair, rng)

    def lagrangian(q, v):
        kinetic, potential = pair.energy(q, v)
        return kinetic - potential

    h = 1e-5
    steps = h * np.eye(pair.size)
    by_v = [(lagrangian(q, v + e) - lagrangian(q, v - e)) / (2 * h) for e in steps]
    by_q = [(lagrangian(q + e, v) - lagrangian(q - e, v)) / (2 * h) for e in steps]
    # central differences: h^2 and round-off / h; a wrong coefficient is 1e-2 and more
    assert relative(pair.vector("momentum", q, v), np.array(by_v)) < 1e-7
    assert relative(pair.vector("force", q, v), np.array(by_q)) < 1e-6


def _undamped(body):
    return replace(body, matter=replace(body.matter, damping=0.0), rotation=body.rotation)


@pytest.mark.serial
def test_tangents_are_differences_of_residuals(pair, rng):
    q, v = eb.random_state(pair, rng)
    a, forces = rng.standard_normal(pair.size), rng.standard_normal(pair.constraints)
    motion, t, h, dv, da = FormalismMotion(pair, "lagrange"), 0.3, 1e-6, 3.0, 7.0
    K = motion.tangent(t, q, v, a, forces, dv, da)
    for j in range(pair.size):
        e = np.zeros(pair.size)
        e[j] = h
        ends = [
            motion.residual(t, q + s * e, v + s * dv * e, a + s * da * e, forces)
            for s in (1.0, -1.0)
        ]
        # a missing geometric or gyroscopic term is 1e-3 of the largest entry
        error = np.abs((ends[0] - ends[1]) / (2 * h) - K[:, j]).max()
        assert error < 1e-8 * np.abs(K).max(), j


@pytest.mark.serial
def test_pictures_show_displacements_from_the_start(pair, rng):
    motion = FormalismMotion(pair, "lagrange")
    q, v = motion.start()
    places = [
        {
            name: (picture.points, picture.point_data["displacement"])
            for name, picture in motion.pictures(Motion(0.0, at, v, v, v)).items()
        }
        for at in (q, eb.random_state(pair, rng)[0])
    ]
    for name, (start, still) in places[0].items():
        points, moved = places[1][name]
        assert not still.any()
        np.testing.assert_array_equal(moved, points - start)
        assert moved.any()


@pytest.mark.serial
def test_seconds_of_formalisms_are_those_of_their_steps(pair):
    both = SideBySide(pair, ("lagrange", "gibbs_appell"))
    options = ff.RunOptions(dt=1e-4, t_end=1e-3)
    both.stepper.begin(both, options)
    begin = time.perf_counter()
    for _ in range(2):
        assert both.stepper.step(1e-4) is Status.OK
    whole = time.perf_counter() - begin
    seconds = both.summary()["wall_seconds_of_formalisms"]
    assert min(seconds.values()) > 0.01 * whole
    assert sum(seconds.values()) <= whole


@pytest.mark.serial
def test_null_space(pair, rng):
    G = pair.jacobian(eb.random_state(pair, rng)[0])
    A = null_space(G, partition(G, pair.of_frames))
    assert A.shape == (pair.size, pair.size - pair.constraints)
    np.testing.assert_allclose(G @ A, 0.0, atol=1e-12)  # round-off of entries near 1
    assert np.linalg.matrix_rank(A) == A.shape[1]


class Hand:
    """Finite elements in a floating frame, assembled from forms written by hand."""

    def __init__(self, equations):
        import ufl
        from dolfinx.fem import Constant, assemble_matrix, assemble_vector, form

        nodes = next(iter(equations.nodes.values()))
        mesh, space = nodes.mesh, nodes.space
        u, w = ufl.TrialFunction(space), ufl.TestFunction(space)
        material, x = eb.RUBBER, ufl.SpatialCoordinate(mesh)
        dx = ufl.dx(metadata={"quadrature_degree": 2})
        rho = material.density
        spin, eps, rest = (Constant(mesh, np.zeros(3)) for _ in range(3))
        turn = lambda b: ufl.cross(spin, ufl.cross(spin, b))  # noqa: E731
        lame = (
            material.youngs_modulus
            * material.poisson_ratio
            / ((1 + material.poisson_ratio) * (1 - 2 * material.poisson_ratio))
        )
        strain = lambda b: ufl.sym(ufl.grad(b))  # noqa: E731
        stress = lame * ufl.tr(strain(u)) * ufl.Identity(3) + 2 * material.shear_modulus * strain(u)
        dot = ufl.dot
        matrices = {
            "m": rho * dot(u, w), "c": 2 * rho * dot(ufl.cross(spin, u), w),
            "k": ufl.inner(stress, strain(w)), "k_eps": rho * dot(ufl.cross(eps, u), w),
            "k_omega": rho * dot(turn(u), w),
        }  # fmt: skip
        vectors = {
            "q_eps": rho * dot(ufl.cross(eps, x), w), "q_omega": rho * dot(turn(x), w),
            "m_O": rho * dot(rest, w),
        }  # fmt: skip
        self._matrices = {k: form(e * dx) for k, e in matrices.items()}
        self._vectors = {k: form(e * dx) for k, e in vectors.items()}
        self._numbers, self._nodes = (spin, eps, rest), nodes
        self._assemble = assemble_matrix, assemble_vector

    def at(self, omega, epsilon, acceleration):
        """Matrices and vectors, all in local components."""
        for constant, value in zip(self._numbers, (omega, epsilon, acceleration), strict=True):
            constant.value[:] = value
        matrix, vector = self._assemble
        found = {k: matrix(f).to_dense() for k, f in self._matrices.items()}
        return found | {k: vector(f).array.copy() for k, f in self._vectors.items()}


@pytest.fixture(scope="module")
def solid():
    """A free solid in space, on springs to nothing, with gravity."""
    own = eb.body("free", "solid", True, 0.5, elements=2)
    return MechanismEquations(research.Mechanism("free", (own,), gravity=eb.GRAVITY))


def rates_of_parameters(p, omega, epsilon):
    """Rates of Euler parameters from angular velocity and acceleration in the frame's axes."""
    a, b, c, d = p
    E = 0.5 * np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]])
    pd = E @ omega
    return pd, E @ epsilon - 0.25 * (omega @ omega) * p


@pytest.mark.slow
@pytest.mark.serial
def test_element_equations_in_a_moving_frame(solid, rng):
    """m u'' + c u' + (k + k(eps) + k(omega)) u + q(eps) + q(omega) + m_O a_O - weight."""
    nodes = solid.nodes["free"]
    free = nodes.elastic.ravel()
    rows = free >= 0
    frame = nodes.body.frame
    omega, epsilon, a_O = (rng.standard_normal(3) * s for s in (8.0, 30.0, 20.0))
    p = rng.standard_normal(4)
    p /= np.linalg.norm(p)
    q, v, a = (np.zeros(solid.size) for _ in range(3))
    q[3:7] = p
    v[3:7], a[3:7] = rates_of_parameters(p, omega, epsilon)
    v[:3], a[:3] = rng.standard_normal(3), a_O
    elastic = [scale * rng.standard_normal(rows.sum()) for scale in (0.01, 0.1, 1.0)]
    for state, values in zip((q, v, a), elastic, strict=True):
        state[free[rows]] = values
    R = frame.rotation_matrix(q[:7])
    hand = Hand(solid).at(omega, epsilon, R.T @ (a_O - np.array(eb.GRAVITY)))
    u, ud, udd = (np.zeros(free.shape) for _ in range(3))
    u[rows], ud[rows], udd[rows] = elastic
    expected = hand["m"] @ udd + hand["c"] @ ud
    expected += (hand["k"] + hand["k_eps"] + hand["k_omega"]) @ u
    expected += hand["q_eps"] + hand["q_omega"] + hand["m_O"]
    for name in ("lagrange", "gibbs_appell"):
        found = solid.vector(name, q, v, a)[free[rows]]
        # each of the seven terms is more than 1e-3 of the sum
        assert relative(found, expected[rows]) < 1e-12, name
    for term in ("c", "k_eps"):
        np.testing.assert_allclose(hand[term], -hand[term].T, atol=1e-13 * np.abs(hand[term]).max())
    softening = hand["k_omega"]
    np.testing.assert_allclose(softening, softening.T, atol=1e-13 * np.abs(softening).max())
    values = np.linalg.eigvalsh(softening)
    assert values[-1] < 1e-10 * -values[0]  # a sign error would stiffen
    assert values[0] < 0.0


@pytest.mark.serial
def test_uniform_rotation_gives_nodal_centrifugal_forces(solid):
    """q(omega) = -omega^2 M r about an axis through the origin: r is in the elements' space."""
    nodes = solid.nodes["free"]
    omega, free = 12.0, nodes.elastic.ravel()
    q, v, a = (np.zeros(solid.size) for _ in range(3))
    q[3], v[6] = 1.0, 0.5 * omega
    a[3] = -0.25 * omega**2
    weightless = MechanismEquations(replace(solid.mechanism, gravity=(0.0, 0.0, 0.0)))
    found = weightless.vector("gibbs_appell", q, v, a)
    m = Hand(solid).at(np.zeros(3), np.zeros(3), np.zeros(3))["m"]
    away = nodes.x * [1.0, 1.0, 0.0]
    expected = -(omega**2) * (m @ away.ravel())
    rows = free >= 0
    np.testing.assert_allclose(found[free[rows]], expected[rows], rtol=1e-11, atol=1e-12)
    mass = eb.RUBBER.density * 0.5 * eb.SIZE**2
    # all forces together: the mass times the centre's acceleration
    total = expected.reshape(-1, 3).sum(axis=0)
    np.testing.assert_allclose(total[0], -(omega**2) * mass * 0.25, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.serial
def test_beams_bend_twist_and_weigh_as_in_closed_form():
    """Cantilever under a tip load and its weight; solved in the elastic coordinates alone."""
    length, material = 0.5, eb.RUBBER
    own = research.BeamMatter(material, eb.SIZE, 1.5 * eb.SIZE, spatial=True)
    body = research.EnergyBody("arm", own, research.SpatialFrame(), eb.mesh("beam", length, 4))
    equations = MechanismEquations(research.Mechanism("arm", (body,), gravity=(0.0, -0.1, 0.0)))
    q, v = equations.start
    K = -equations.matrix("hamilton", (0.0, 0.0, 1.0), q, v)[7:, 7:]
    u = np.linalg.solve(K, equations.vector("force", q, v)[7:])
    tip = equations.nodes["arm"].elastic[equations.nodes["arm"].node("test", (length,))] - 7
    weight = 0.1 * material.density * 1.5 * eb.SIZE**2
    bending = material.youngs_modulus * eb.SIZE * (1.5 * eb.SIZE) ** 3 / 12
    shear = 5 / 6 * material.shear_modulus * 1.5 * eb.SIZE**2
    sag = weight * length**4 / (8 * bending) + weight * length**2 / (2 * shear)
    # elements of second degree miss the quartic by 1e-4; swapped axes by a factor of 2
    assert u[tip[1]] == pytest.approx(-sag, rel=1e-3)
    load = np.zeros(len(u))
    load[tip[3]] = 0.01
    torsion = material.shear_modulus * 1.5 * eb.SIZE**4 * 0.1958  # Timoshenko, Goodier: b/a = 1.5
    assert np.linalg.solve(K, load)[tip[3]] == pytest.approx(0.01 * length / torsion, rel=5e-3)


def _sine(t):
    return 0.1 * np.sin(5.0 * t), 0.5 * np.cos(5.0 * t), -2.5 * np.sin(5.0 * t)


@pytest.mark.slow
@pytest.mark.serial
def test_prescribed_motion_and_revolute_joint_in_space(rng):
    """A driven frame, and a hinge whose axis follows the section of a beam."""
    first = eb.body("first", "beam", True, 0.5)
    second = eb.body("second", "beam", True, 0.4, origin=(0.5, 0.0, 0.0))
    tip, root = research.End("first", (0.5, 0.0, 0.0)), research.End("second", (0.0, 0.0, 0.0))
    axes = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    joints = (
        research.Constraint("ground", (research.End("first"),), research.end_position, (0.0,) * 3),
        research.Constraint("drive", (tip,), _height, motion=_sine),
        research.Constraint("pin", (tip, root), research.coincidence),
        research.Constraint("hinge", (tip, root), research.parallel, axes),
    )
    equations = MechanismEquations(research.Mechanism("driven", (first, second), joints))
    t = 0.3
    q, v = equations.start
    equations.start = (
        q + 0.003 * rng.standard_normal(equations.size), rng.standard_normal(equations.size)
    )  # fmt: skip
    q, v = consistent_start(equations, t)
    assert np.abs(equations.gaps(q, t)).max() < 1e-12  # the start is closed at the given time
    assert equations.position(tip, q)[1] == pytest.approx(_sine(t)[0], rel=1e-12)
    ways = [accelerations(name, equations, q, v, t) for name in research.FORMALISMS]
    for other in ways[1:]:
        assert relative(other, ways[0]) < 1e-11  # twice the constraints, ten times the condition
    h = 1e-5
    slopes = [equations.jacobian(q + s * h * v) @ v for s in (-1, 1)]
    targets = [equations.prescribed_rates(t + s * h) for s in (-1, 1)]
    change = (targets[1] - targets[0] - slopes[1] + slopes[0]) / (2 * h)
    given = equations.prescribed_accelerations(q, v, t)
    # central differences; the drive alone is 2.5
    np.testing.assert_allclose(given, change, atol=1e-6 * np.abs(given).max())


def _height(end, data):
    return [end.position[1]]


@pytest.mark.serial
def test_counts_of_a_form_that_can_be_counted():
    import basix.ufl
    import ufl

    mesh = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
    space = ufl.FunctionSpace(mesh, basix.ufl.element("DG", "interval", 0))
    f, g = ufl.Coefficient(space), ufl.Coefficient(space)
    one = f * g * ufl.dx(metadata={"quadrature_degree": 0})
    two = (f * g + f) * ufl.dx(metadata={"quadrature_degree": 0})
    # one addition more per cell; a count of characters or lines would see more
    assert count_operations(two) - count_operations(one) == 1
    squared = f**2 * g * ufl.dx(metadata={"quadrature_degree": 0})
    count = count_form(ufl.derivative(squared, f))
    assert (count.derivatives, count.terms) == (1, 1)
    assert (count + count).operations == 2 * count.operations
    assert isinstance(count, Count)


class Counted:
    """A number that counts what is done with it."""

    done = 0

    def __init__(self, value):
        self.value = float(value)

    def _after(self, value):
        Counted.done += 1
        return Counted(value)

    def __add__(self, other):
        return self._after(self.value + float(other))

    def __sub__(self, other):
        return self._after(self.value - float(other))

    def __rsub__(self, other):
        return self._after(float(other) - self.value)

    def __mul__(self, other):
        return self._after(self.value * float(other))

    def __truediv__(self, other):
        return self._after(self.value / float(other))

    def __rtruediv__(self, other):
        return self._after(float(other) / self.value)

    def __neg__(self):
        return self._after(-self.value)

    def __float__(self):
        return self.value

    __radd__, __rmul__ = __add__, __mul__

    @staticmethod
    def array(values, dtype=None):
        flat = np.array(values, dtype=float)
        return np.array([Counted(x) for x in flat.ravel()], dtype=object).reshape(flat.shape)


def executed(form):
    """Operations that the kernel carries out, written as Python by another back end of FFCx."""
    import ffcx.compiler
    import ffcx.options

    options = dict(ffcx.options.get_options({})) | {"language": "numba"}
    text = "".join(ffcx.compiler.compile_ufl_objects([form], options=options, namespace="x")[0])
    lines = text[text.index("def tabulate_tensor") :].splitlines()
    end = next(i for i, line in enumerate(lines[2:], 2) if line and not line.startswith(" "))
    head = next(i for i, line in enumerate(lines) if "carray" in line)
    body = [line for line in lines[head:end] if "carray" not in line]
    body = [line for line in body if not line.lstrip().startswith("#")]
    arrays = {name: Counted.array(np.linspace(0.1, 0.9, 99)) for name in ("A", "w", "c")}
    arrays["coordinate_dofs"] = Counted.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0])
    functions = SimpleNamespace(
        array=Counted.array, zeros=lambda n, dtype=None: Counted.array(np.zeros(n)), float64=float,
        cos=lambda x: x._after(np.cos(x.value)), sin=lambda x: x._after(np.sin(x.value)),
        abs=lambda x: x._after(abs(x.value)),
    )  # fmt: skip
    Counted.done = 0
    exec(textwrap.dedent("\n".join(body)), {"np": functions, **arrays})
    return Counted.done


@pytest.mark.serial
@pytest.mark.parametrize("name", ["lagrange", "gibbs_appell", "momentum", "force"])
def test_counted_operations_are_those_carried_out(name):
    body = eb.body("any", "beam", False, 0.5, degree=2)
    form = getattr(energies_of(body.matter, body.frame), name)
    # exactly: a loop counted once, or an index taken for arithmetic, is off by ten per cent
    assert count_operations(form) == executed(form)


@pytest.mark.serial
def test_gibbs_and_appell_take_fewer_operations_than_lagrange():
    body = eb.body("any", "beam", False, 0.5)
    energies = energies_of(body.matter, body.frame)
    lagrange, gibbs = (count_form(getattr(energies, n)) for n in ("lagrange", "gibbs_appell"))
    assert gibbs.operations < 0.8 * lagrange.operations
    assert gibbs.derivatives < lagrange.derivatives


@pytest.mark.three_ranks
def test_every_rank_has_the_same_equations():
    equations = MechanismEquations(eb.pair("beam", False))
    q, v = eb.random_state(equations, np.random.default_rng(3))
    own = accelerations("maggi", equations, q, v)
    for other in MPI.COMM_WORLD.allgather(own):
        np.testing.assert_array_equal(other, own)
