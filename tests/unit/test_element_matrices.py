# SPDX-License-Identifier: LGPL-3.0-or-later
"""Element matrices in a moving frame, and frames whose motion is prescribed.

Closed forms of the matrices; equations of motion that UFL derives from energies, which are
independent of these matrices.
"""

import csv
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import research
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import accelerations, consistent_start
from flexfem.research.formalisms.runs.element_tables import tabulate_elements
from tests.unit import elastic_bodies as eb
from tests.unit.refusals import assert_on_page

KINDS = [("beam", False), ("beam", True), ("plane", False), ("plane", True), ("solid", True)]
LENGTH = 0.5
OMEGA, EPSILON = np.array([3.0, -5.0, 7.0]), np.array([20.0, 11.0, -30.0])


def one_body(element, spatial, **more):
    return eb.body("arm", element, spatial, LENGTH, **more)


def by_names(matrices):
    """Indices of displacements by node's place along the axis and component."""
    pairs = zip(matrices.points[:, 0], matrices.components, strict=True)
    return {(round(float(x) / LENGTH, 6), int(i)): k for k, (x, i) in enumerate(pairs)}


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_matrices_of_a_spatial_beam_in_closed_form(degree):
    """Integrals of Lagrange's polynomials, taken by NumPy; rotary inertia of the section too."""
    body = one_body("beam", True, degree=degree)
    found = research.element_matrices(body, OMEGA, EPSILON, 0)
    places = np.linspace(0.0, 1.0, degree + 1)
    shapes = []
    for xa in places:
        others = places[places != xa]
        shapes.append(np.poly1d(np.poly(others)) / np.prod(xa - others))

    def integral(p):
        primitive = np.polyint(p)
        return LENGTH * (primitive(1.0) - primitive(0.0))

    width, height, rho = eb.SIZE, 1.5 * eb.SIZE, eb.RUBBER.density
    area = rho * width * height
    # inertia of the section, and what each rotation does to the vector along that side of it
    high = rho * width * height**3 / 12.0, np.array([[0, 0, 1.0], [0, 0, 0], [-1.0, 0, 0]])
    wide = rho * height * width**3 / 12.0, np.array([[0, -1.0, 0], [1.0, 0, 0], [0, 0, 0]])

    def weighted(W):
        """The 6 x 6 blocks of a pair of nodes, without the integral of their functions."""
        block = np.zeros((6, 6))
        block[:3, :3] = area * W
        for inertia, turn in (high, wide):
            block[3:, 3:] += inertia * turn @ W @ turn.T
        return block

    cross = lambda a: np.cross(np.eye(3), a)  # noqa: E731
    spin, change = -cross(OMEGA).T, -cross(EPSILON).T
    np.testing.assert_allclose(spin @ EPSILON, np.cross(OMEGA, EPSILON))
    where = by_names(found)
    names = ("m", "c", "k_epsilon", "q_omega")
    scale = {name: np.abs(getattr(found, name)).max() for name in names}
    for a, xa in enumerate(places):
        rows = [where[round(xa, 6), i] for i in range(6)]
        for b, xb in enumerate(places):
            columns = [where[round(xb, 6), i] for i in range(6)]
            overlap = integral(shapes[a] * shapes[b])
            at = np.ix_(rows, columns)
            # round-off; without the rotary inertia the rotations' entries are zero
            close = {"rtol": 1e-10, "atol": 1e-13 * scale["m"]}
            np.testing.assert_allclose(found.m[at], overlap * weighted(np.eye(3)), **close)
            close["atol"] = 1e-13 * scale["c"]
            np.testing.assert_allclose(found.c[at], 2.0 * overlap * weighted(spin), **close)
            np.testing.assert_allclose(found.k_omega[at], overlap * weighted(spin @ spin), **close)
            close["atol"] = 1e-13 * scale["k_epsilon"]
            np.testing.assert_allclose(found.k_epsilon[at], overlap * weighted(change), **close)
        first, whole = integral(shapes[a] * np.poly1d([LENGTH, 0.0])), integral(shapes[a])
        for name, W in (("q_epsilon", change), ("q_omega", spin @ spin)):
            expected = np.zeros(6)
            expected[:3] = area * first * W[:, 0]
            for (inertia, turn), axis in ((high, 1), (wide, 2)):
                expected[3:] += inertia * whole * turn @ W[:, axis]
            got = getattr(found, name)[rows]
            np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-13 * scale["q_omega"])
        expected = np.zeros((6, 3))
        expected[:3] = area * whole * np.eye(3)
        np.testing.assert_allclose(found.m_origin[rows], expected, atol=1e-13 * area)
    if degree == 1:  # the textbook's bar
        stiffness = eb.RUBBER.youngs_modulus * width * height / LENGTH
        ends = [where[0.0, 0], where[1.0, 0]]
        bar = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
        np.testing.assert_allclose(found.k[np.ix_(ends, ends)], bar, rtol=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_body_is_the_sum_of_its_elements(kind):
    body = one_body(*kind, elements=2)
    whole = research.element_matrices(body, OMEGA, EPSILON)
    number = {
        (tuple(np.round(x, 9)), int(i)): k
        for k, (x, i) in enumerate(zip(whole.points, whole.components, strict=True))
    }
    summed, forces = np.zeros_like(whole.k_omega), np.zeros_like(whole.q_epsilon)
    for element in range(2 if kind[0] == "beam" else 4 if kind[0] == "plane" else 12):
        one = research.element_matrices(body, OMEGA, EPSILON, element)
        pairs = zip(one.points, one.components, strict=True)
        own = [number[tuple(np.round(x, 9)), int(i)] for x, i in pairs]
        summed[np.ix_(own, own)] += one.k_omega
        forces[own] += one.q_epsilon
    # a wrong place of one entry would be of the size of the largest
    np.testing.assert_allclose(summed, whole.k_omega, atol=1e-12 * np.abs(summed).max())
    np.testing.assert_allclose(forces, whole.q_epsilon, atol=1e-12 * np.abs(forces).max())


def turning(spatial):
    """A motion with all terms, without symmetry."""
    out = 1.0 if spatial else 0.0

    def swing(t):
        return np.sin(4.0 * t), 4.0 * np.cos(4.0 * t), -16.0 * np.sin(4.0 * t)

    def path(t):
        return (2 * t, t**3, out * t * t), (2.0, 3 * t * t, 2 * out * t), (0.0, 6 * t, 2 * out)

    about = [((0.0, 0.0, 1.0), lambda t: (0.4 + 5.0 * t + 3.0 * t * t, 5.0 + 6.0 * t, 6.0))]
    return research.FrameMotion(path, [*about, ((1.0, 2.0, -1.0), swing)] if spatial else about)


def rotation_rates(body, t):
    """Rotation, angular velocity and acceleration in the frame's axes, by differences alone."""
    h = 1e-4

    def R(s):
        return body.frame.rotation_matrix(body.prescribed(s)[0])

    def omega(s):
        W = R(s).T @ (R(s + h) - R(s - h)) / (2.0 * h)
        return np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2.0

    return R(t), omega(t), (omega(t + h) - omega(t - h)) / (2.0 * h)


@pytest.mark.serial
@pytest.mark.parametrize(
    "kind",
    [
        ("plane", False),
        *(pytest.param((k, True), marks=pytest.mark.slow) for k in ("beam", "solid")),
    ],
    ids=str,
)
def test_bodies_in_prescribed_frames_obey_the_element_equations(kind, rng):
    """Accelerations of all formalisms against m^-1 of all terms that the matrices make."""
    body = one_body(*kind, elements=1, motion=turning(kind[1]), origin=(0.1, 0.2, 0.0))
    model = MechanismEquations(research.Mechanism("driven", (body,), gravity=eb.GRAVITY))
    t, count = 0.3, body.frame.count
    q, v = np.zeros(model.size), np.zeros(model.size)
    g, gd, gdd = body.prescribed(t)
    q[:count], v[:count] = g, gd
    q[count:] = 0.01 * rng.standard_normal(model.size - count)
    v[count:] = 0.1 * rng.standard_normal(model.size - count)
    R, omega, epsilon = rotation_rates(body, t)
    rest = np.array([*gdd[:2], gdd[2] if kind[1] else 0.0]) - eb.GRAVITY
    e = research.element_matrices(body, omega, epsilon).of_free()
    # the coordinates come node by node, as the matrices' rows do
    u, ud = q[count:], v[count:]
    r = e.c @ ud + (e.k + e.k_epsilon + e.k_omega) @ u + e.q_epsilon + e.q_omega
    r += e.m_origin @ (R.T @ rest)
    expected = -np.linalg.solve(e.m, r)
    for name in research.FORMALISMS:
        found = accelerations(name, model, q, v, t)
        # differences give omega and epsilon to 1e-7; any term left out is 1e-3 of the sum
        np.testing.assert_allclose(found[count:], expected, atol=3e-6 * np.abs(expected).max())
        np.testing.assert_allclose(found[:count], gdd, atol=1e-9)


@pytest.mark.serial
def test_rates_of_a_prescribed_frame_are_differences(rng):
    body = one_body("beam", True, motion=turning(True))
    h = 1e-5
    before, now, after = (body.prescribed(0.7 + s * h) for s in (-1.0, 0.0, 1.0))
    for k in (1, 2):
        slope = (after[k - 1] - before[k - 1]) / (2.0 * h)
        # a missing product term is of the size of the rate
        np.testing.assert_allclose(now[k], slope, atol=1e-6 * np.abs(slope).max())
    assert abs(np.linalg.norm(now[0][3:]) - 1.0) < 1e-15
    q, v = consistent_start(MechanismEquations(research.Mechanism("driven", (body,))))
    np.testing.assert_allclose(q[:7], body.prescribed(0.0)[0], atol=1e-15)
    np.testing.assert_allclose(v[:7], body.prescribed(0.0)[1], atol=1e-13)


def still(t):
    return 0.0, 0.0, 0.0


BAD = {
    "the rate of its motion is": {
        "motion": research.FrameMotion(None, [((0, 0, 1), lambda t: (t, 2.0, 0.0))])
    },
    "the second rate of its motion is": {
        "motion": research.FrameMotion(lambda t: (t * t, 2 * t, 1.0))
    },
    "its motion leaves the plane": {"motion": research.FrameMotion(None, [((0, 1, 1), still)])},
    "motion must return value, rate and second rate": {"motion": research.FrameMotion(lambda t: t)},
    "its motion is prescribed, leave out its velocities": {
        "motion": research.FrameMotion(), "velocity": (1.0, 0.0, 0.0)
    },
    "must be a FrameMotion": {"motion": still},
}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("message", BAD)
def test_motions_that_are_wrong_are_refused(message):
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        research.Mechanism("driven", (one_body("beam", False, **BAD[message]),)).validate()
    assert_on_page(str(raised.value))


@pytest.mark.serial
def test_wrong_arguments_are_refused():
    body = one_body("beam", False)
    whole = research.InertiaIntegrals(body)
    for message, make in {
        "there is no element 7, the mesh has 1": lambda: research.InertiaIntegrals(body, 7),
        "omega must hold 3 numbers": lambda: whole.at((1.0, 2.0), EPSILON),
        "rotations must be pairs": lambda: research.FrameMotion(None, [still]),
        "translation must be a function": lambda: research.FrameMotion(3.0),
    }.items():  # fmt: skip
        with pytest.raises((ValueError, TypeError), match=message) as raised:
            make()
        assert_on_page(str(raised.value))


@pytest.mark.serial
def test_tables_hold_every_entry(tmp_path, capsys):
    bodies = {("beam",): one_body("beam", False), ("bar",): one_body("beam", True)}
    study = research.ElementMatrixStudy(bodies, ("kind",), OMEGA, EPSILON)
    options = {"dt": 1.0, "t_end": 1.0, "output": tmp_path}
    outcome = tabulate_elements(study, ff.RunOptions(**options))
    assert (outcome.status, outcome.summary["unknowns"]) == ("ok", 6 + 12)
    printed = capsys.readouterr().out
    assert "kind beam: 6 displacements\n  m\n" in printed
    assert "k(omega)" in printed
    rows = list(csv.DictReader((tmp_path / "matrices.csv").read_text().splitlines()))
    for (kind,), body in bodies.items():
        found = research.element_matrices(body, OMEGA, EPSILON, 0)
        own = [row for row in rows if row["kind"] == kind]
        assert len(own) == 5 * found.m.size + 2 * len(found.free) + found.m_origin.size
        for title, values in (("k(omega)", found.k_omega), ("m_Oi", found.m_origin)):
            written = np.zeros_like(values)
            for row in own:
                if row["matrix"] == title:
                    written[int(row["row"]), int(row["column"])] = float(row["value"])
            np.testing.assert_array_equal(written, values)
        row = next(r for r in own if (r["matrix"], r["row"], r["column"]) == ("c", "0", "4"))
        assert float(row["column_x"]) == found.points[4, 0]
        assert int(row["column_component"]) == found.components[4]
    with pytest.raises(ValueError, match="no motion to be resumed") as raised:
        tabulate_elements(study, ff.RunOptions(**options, restart=tmp_path / "checkpoint.h5"))
    assert_on_page(str(raised.value))
    with pytest.raises(ValueError, match="bodies must hold at least one") as raised:
        replace(study, bodies={}).validate()
    assert_on_page(str(raised.value))


@pytest.mark.three_ranks
def test_every_rank_has_the_same_matrices():
    own = research.element_matrices(one_body("beam", False), OMEGA, EPSILON)
    for other in MPI.COMM_WORLD.allgather(own.k_omega + own.m):
        np.testing.assert_array_equal(other, own.k_omega + own.m)
