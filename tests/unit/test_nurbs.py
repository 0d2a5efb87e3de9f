# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS curves: exact shapes, refinement, fitting, elements, arc lengths, section frames."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import BSpline

import flexfem as ff
from flexfem.lie import so3
from flexfem.mesh.nurbs import fit
from flexfem.mesh.nurbs import frames as frames_of
from flexfem.mesh.nurbs.basis import greville
from flexfem.mesh.nurbs.elements import shape_functions
from flexfem.mesh.nurbs.frames import control_frames, interpolated_rotations, section_rotations

pytestmark = pytest.mark.serial

U = np.linspace(0.0, 1.0, 37)
EX, EY, EZ = np.eye(3)
CORNER = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0]]


def some_curve(degree, seed=0):
    """Uneven knots, one of them twice (degree 2 and higher), and uneven weights."""
    random = np.random.default_rng(seed)
    inside = [0.2, 0.5, 0.5, 0.9] if degree > 1 else [0.2, 0.5, 0.9]
    knots = np.concatenate([np.zeros(degree + 1), inside, np.ones(degree + 1)])
    n = len(knots) - degree - 1
    points = np.column_stack([np.arange(n), *random.uniform(-0.2, 0.2, (2, n))])
    return ff.NurbsCurve(degree, knots, points, random.uniform(0.6, 1.6, n))


def by_scipy(curve, u, order=0):
    """Numerator and denominator by SciPy, the quotient's derivatives by hand up to the second."""
    w = curve.weights[:, None]
    bottom = BSpline(curve.knots, w, curve.degree)
    top = BSpline(curve.knots, w * curve.points, curve.degree)
    a, b = ([spline(u, nu=d) for d in range(order + 1)] for spline in (top, bottom))
    value = a[0] / b[0]
    if order == 0:
        return value
    slope = (a[1] - b[1] * value) / b[0]
    return slope if order == 1 else (a[2] - 2.0 * b[1] * slope - b[2] * value) / b[0]


def helix(u):
    """1 m of radius, 0.3 m of rise in 3 rad."""
    return np.column_stack([np.cos(3.0 * u), np.sin(3.0 * u), 0.3 * u])


# --- elements ------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", range(1, 8))
def test_shape_functions_are_a_partition_of_unity(degree):
    xi = np.linspace(0.0, 1.0, 9)
    for shape in some_curve(degree).elements.shape:
        N = shape_functions(shape, xi, 3)
        # a wrong coefficient of one function leaves a sum that differs by its size, 1e-2 or more
        np.testing.assert_allclose(N[0].sum(axis=1), 1.0, rtol=0, atol=1e-12)
        assert N[0].min() > -1e-12
        # the sums of derivatives are rounding errors of terms up to 1e4; a missing term of the
        # quotient rule leaves 1e-2 or more
        np.testing.assert_allclose(N[1:].sum(axis=2), 0.0, rtol=0, atol=1e-8)


@pytest.mark.parametrize("degree", range(1, 8))
def test_extraction_gives_the_spline(degree):
    curve = some_curve(degree)
    parts = curve.elements
    assert parts.nodes.shape == parts.extraction.shape[:2]
    xi = np.linspace(0.0, 1.0, 6)[:-1]
    bernstein = BSpline(np.repeat([0.0, 1.0], degree + 1), np.eye(degree + 1), degree)(xi)
    for nodes, (a, b), C, shape in zip(
        parts.nodes, parts.spans, parts.extraction, parts.shape, strict=True
    ):
        u = a + xi * (b - a)
        direct = BSpline(curve.knots, np.eye(len(curve.points)), curve.degree)(u)[:, nodes]
        # one wrong knot in the recursion changes a function by 1e-2 or more
        np.testing.assert_allclose(bernstein @ C.T, direct, rtol=0, atol=1e-13)
        x = shape_functions(shape, xi)[0] @ curve.points[nodes]
        # unweighted functions would miss by 1e-2
        np.testing.assert_allclose(x, by_scipy(curve, u), rtol=0, atol=1e-11)


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_derivatives(degree):
    curve = some_curve(degree)
    values = curve.derivatives(U, 2)
    for order in range(3):
        # scale of the second derivatives is 1e2; a lost factor of the span's size is 2 at least
        np.testing.assert_allclose(values[order], by_scipy(curve, U, order), rtol=1e-9, atol=1e-9)
    h = 1e-4
    third = (curve.derivatives(U[1:-1] + h, 2)[2] - curve.derivatives(U[1:-1] - h, 2)[2]) / (2 * h)
    away = (np.abs(U[1:-1, None] - curve.elements.spans[:, 0]) > 2 * h).all(axis=1)
    # central differences err by 1e-3 of the value here; a wrong binomial coefficient by a third
    exact = curve.derivatives(U[1:-1], 3)[3]
    np.testing.assert_allclose(third[away], exact[away], rtol=0, atol=0.01 * np.abs(exact).max())


def test_shapes_of_arguments():
    curve = some_curve(2)
    assert curve.derivatives(0.3, 1).shape == (2, 3)
    assert curve.position(U.reshape(1, -1)).shape == (1, len(U), 3)
    assert curve.arc_length(0.3).shape == ()
    # the curve begins and ends at control points; any other place is 0.1 away
    np.testing.assert_allclose(curve.position([0.0, 1.0]), curve.points[[0, -1]], atol=1e-13)


# --- arc lengths ---------------------------------------------------------------------------------


def test_arc_length_of_a_parabola():
    curve = ff.NurbsCurve(2, [0, 0, 0, 1, 1, 1], [[0, 0, 0], [0.5, 0, 0], [1, 1, 0]])  # y = x^2
    exact = (2 * U * np.sqrt(1 + 4 * U**2) + np.arcsinh(2 * U)) / 4
    # chord lengths of 36 pieces would miss by 1e-4, Gauss quadrature of five points by 1e-6
    np.testing.assert_allclose(curve.arc_length(U), exact, rtol=0, atol=1e-12)
    np.testing.assert_allclose(curve.length, exact[-1], rtol=1e-13)
    # the inverse: fractions taken for parameters would miss by 0.1
    np.testing.assert_allclose(curve.parameter_at(exact / exact[-1]), U, rtol=0, atol=1e-12)


def test_arc_length_of_every_element():
    curve = some_curve(4)
    parts = curve.elements
    u, weights = np.polynomial.legendre.leggauss(60)
    for (a, b), arc, length in zip(parts.spans, parts.arc, parts.lengths, strict=True):
        speed = np.linalg.norm(curve.derivatives(0.5 * (a + b) + 0.5 * (b - a) * u, 1)[1], axis=1)
        # the polynomial misses by 1e-6 with half as many coefficients
        np.testing.assert_allclose(length, 0.5 * (b - a) * weights @ speed, rtol=1e-11)
        assert arc[0] == 0.0


# --- exact shapes --------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 3, 7])
def test_line_has_uniform_speed(degree):
    curve = ff.NurbsCurve.line([1, 2, 3], [4, 6, 15], degree=degree, elements=5)
    assert len(curve.points) == 5 + degree
    # equal distances of control points would make the speed uneven by half
    np.testing.assert_allclose(curve.position(U), [1, 2, 3] + U[:, None] * [3, 4, 12], atol=1e-12)
    np.testing.assert_allclose(curve.elements.lengths, 13 / 5, rtol=1e-12)


@pytest.mark.parametrize("degree", [2, 3, 5])
@pytest.mark.parametrize("angle", [0.5, -2.0, 4.0, 2 * np.pi])
def test_arc_is_exact(degree, angle):
    centre, axis = np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 2.0])
    start = centre + np.array([0.5, 0.0, 7.0])  # the centre may be any point of the axis
    curve = ff.NurbsCurve.arc(centre, start, axis, angle, degree=degree)
    x = curve.position(curve.parameter_at(U)) - centre
    exact = [0.5 * np.cos(angle * U), 0.5 * np.sin(angle * U), np.full(len(U), 7.0)]
    # the best polynomial of degree 5 misses a quarter circle by 1e-6; points at equal parameters
    # would miss by 1e-2
    np.testing.assert_allclose(x, np.transpose(exact), rtol=0, atol=1e-12)
    np.testing.assert_allclose(curve.length, 0.5 * abs(angle), rtol=1e-12)


def test_circle_is_closed():
    curve = ff.NurbsCurve.circle([0, 0, 0], [2, 0, 0], [1, 0, 1], elements=8)
    np.testing.assert_array_equal(curve.points[0], curve.points[-1])
    assert len(curve.elements.nodes) == 8
    # start [2, 0, 0] turns about a slanted axis: radius sqrt(2); the distance as radius gives 2
    np.testing.assert_allclose(curve.length, 2 * np.pi * np.sqrt(2), rtol=1e-12)


def test_helix_keeps_its_tolerance():
    curve = ff.NurbsCurve.helix([0, 0, 0], [1, 0, 0], EZ, 3.0, 0.2 * np.pi, tolerance=1e-5)
    miss = np.linalg.norm(curve.position(U) - helix(U), axis=1).max()
    # a pitch per radian, or a turn the other way, misses by 0.1 or more
    assert 1e-8 < miss <= curve.deviation(helix) <= 1e-5
    # length of the exact one; elements of degree 3 that are just fine enough lose 1e-5
    np.testing.assert_allclose(curve.length, np.hypot(3.0, 0.3), rtol=1e-4)
    coarse = ff.NurbsCurve.helix([0, 0, 0], [1, 0, 0], EZ, 3.0, 0.2 * np.pi, elements=3)
    assert len(coarse.elements.nodes) == 3
    assert coarse.deviation(helix) > 1e-3


# --- refinement ----------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_refinement_keeps_the_curve(degree):
    curve = some_curve(degree)
    finer = curve.insert([0.1, 0.1, 0.7] if degree > 1 else [0.1, 0.7])
    for other in (finer, curve.refine(8), curve.refine(13), curve.elevate(), curve.elevate(3)):
        # without the weights in the coordinates the curve moves by 1e-2
        np.testing.assert_allclose(other.position(U), curve.position(U), rtol=0, atol=1e-12)
        np.testing.assert_allclose(other.length, curve.length, rtol=1e-11)
    assert len(curve.refine(8).elements.nodes) == 8
    assert len(curve.refine(13).elements.nodes) == 13
    assert curve.elevate(3).degree == degree + 3
    assert len(curve.elevate(3).elements.nodes) == len(curve.elements.nodes)


def test_refinement_of_equal_parts_and_k_refinement():
    line = ff.NurbsCurve.line([0, 0, 0], [1, 0, 0], degree=1)
    np.testing.assert_allclose(line.refine(4).knots, [0, 0, 0.25, 0.5, 0.75, 1, 1], atol=1e-15)
    # elevation first: as smooth as can be; cutting first keeps the kinks of degree 1
    assert len(line.elevate(2).refine(4).points) == 4 + 3
    assert len(line.refine(4).elevate(2).points) == 4 * 3 + 1


# --- fitting -------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_fit_has_order_p_plus_1(degree):
    errors = [ff.NurbsCurve.fit(helix, degree=degree, elements=n).deviation(helix) for n in (8, 16)]
    # observed degree + 1.0 to 1.3; one order less would be a wrong set of abscissae
    assert np.log2(errors[0] / errors[1]) > degree + 0.9


def test_fit_to_a_tolerance_and_to_points():
    fine = ff.NurbsCurve.fit(helix, tolerance=1e-6)
    assert fine.deviation(helix) <= 1e-6
    assert len(fine.elements.nodes) < 40  # 1e-6 asks for about 20 elements of degree 3
    points = helix(np.linspace(0.0, 1.0, 60))
    curve = ff.NurbsCurve.fit(points, elements=8)
    # eight elements of 0.4 rad: interpolation misses by 3e-5; a straight line by 0.1
    assert curve.deviation(points) < 1e-4
    np.testing.assert_array_equal(curve.points[[0, -1]], points[[0, -1]])


@pytest.mark.parametrize("degree", range(1, 6))
@pytest.mark.parametrize("n", [2, 3, 5, 12])
def test_through_interpolates(degree, n):
    points = helix(np.linspace(0.0, 1.0, n) ** 1.2)
    curve = ff.NurbsCurve.through(points, degree=degree, corners=[])
    parts = curve.elements
    assert len(parts.nodes) == n - 1
    ends = np.append(parts.spans[:, 0], 1.0)
    # a curve near the points only would miss by its fit's error, 1e-6 or more
    np.testing.assert_allclose(curve.position(ends), points, rtol=0, atol=1e-12)
    assert len(curve.points) == n - 1 + degree  # C^(p-1): one more control point per segment


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_through_comes_close_to_the_curve(degree):
    def error(n):
        x = ff.NurbsCurve.through(helix(np.linspace(0.0, 1.0, n)), degree=degree).position(
            np.linspace(0.0, 1.0, 501)
        )
        angle = np.unwrap(np.arctan2(x[:, 1], x[:, 0]))
        return np.linalg.norm(x - helix(angle / 3.0), axis=1).max()

    # natural ends (zero bending) would give order 2, quadratic splines with one free end 3
    assert np.log2(error(9) / error(17)) > 3.4


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_through_a_straight_line_keeps_the_speed(degree):
    along = np.sort(np.append([0.0, 1.0], np.random.default_rng(1).random(9)))
    curve = ff.NurbsCurve.through(along[:, None] * [3, 4, 12], degree=degree)
    # uneven spacing would show as a speed off by 1e-3 or more if it were not the parameter
    slopes = curve.derivatives(U, 1)[1]
    np.testing.assert_allclose(slopes, np.tile([3, 4, 12], (len(U), 1)), rtol=0, atol=1e-10)


def test_through_a_straight_line_solves_nothing(monkeypatch):
    """Trusses have thousands of members. Control points are the Greville abscissae to round-off."""

    def refuse(*_):
        raise AssertionError("a straight line needs no solution")

    monkeypatch.setattr(fit, "_least_jumps", refuse)
    points = np.linspace(0.0, 1.0, 7)[:, None] * [3.0, 4.0, 12.0] + [1.0, 0.0, -2.0]
    curve = ff.NurbsCurve.through(points)
    with pytest.raises(AssertionError, match="no solution"):
        ff.NurbsCurve.through(helix(np.linspace(0.0, 1.0, 7)))
    along = (curve.points - points[0]) @ [3.0, 4.0, 12.0] / 169.0
    np.testing.assert_allclose(along, greville(3, curve.knots), rtol=0, atol=1e-14)


def test_through_has_corners():
    curve = ff.NurbsCurve.through(CORNER, degree=3)
    assert np.count_nonzero(curve.knots == 0.5) == 3
    # rounded off, the curve would leave the two straight lines by 0.05
    x = curve.position(U)
    np.testing.assert_allclose(x, np.minimum(4 * U[:, None] * [1, 0, 0], [2, 0, 0]) + np.maximum(
        4 * U[:, None] - 2, 0.0) * [0, 1, 0], rtol=0, atol=1e-13)  # fmt: skip
    smooth = ff.NurbsCurve.through(CORNER, degree=3, corners=[])
    assert np.count_nonzero(smooth.knots == 0.5) == 1
    with pytest.raises(ValueError, match=r"turns by 90 degrees at parameter 0\.5, cut it there"):
        control_frames(curve)


# --- frames --------------------------------------------------------------------------------------


def rotations(frames):
    return frames[:, 3:].reshape(-1, 3, 3)


def mismatch(curve, frames, u, wanted):
    """Largest angle between interpolated and wanted rotations."""
    R = interpolated_rotations(curve, rotations(frames), *curve.places(u))
    return np.abs(so3.log(np.swapaxes(R, 1, 2) @ wanted)).max()


@pytest.mark.parametrize("orientation", [None, [0.0, 0.3, 1.0]])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_frames_of_a_line(degree, orientation):
    curve = ff.NurbsCurve.line([0, 0, 1], [2, 0, 1], degree=degree, elements=3)
    e2 = EY if orientation is None else np.array(orientation) / np.hypot(0.3, 1.0)
    exact = np.column_stack([EX, e2, np.cross(EX, e2)])
    frames = control_frames(curve, orientation)
    np.testing.assert_array_equal(frames[:, :3], curve.points)
    # e2 not made normal, or of the wrong sign, differs by 0.1 or more
    np.testing.assert_allclose(rotations(frames), np.tile(exact, (3 + degree, 1, 1)), atol=1e-14)


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("orientation", [None, EZ, lambda x: np.tile(EZ, (len(x), 1))])
def test_frames_of_an_arc(degree, orientation):
    curve = ff.NurbsCurve.arc([0, 0, 0], [1, 0, 0], EZ, 4.0, degree=degree, elements=8)
    u = greville(degree, curve.knots)
    x = curve.position(u)
    e1 = np.cross(EZ, x)
    e2 = -x if orientation is None else np.tile(EZ, (len(x), 1))
    exact = np.stack([e1, e2, np.cross(e1, e2)], axis=-1)
    # frames of the abscissae taken for those of the control points would miss by 1e-2
    assert mismatch(curve, control_frames(curve, orientation), u, exact) < 1e-12


@pytest.mark.parametrize(("degree", "elements"), [(3, 80), (5, 20)])
def test_frames_where_abscissae_miss_places_on_the_way_by_round_off(degree, elements):
    start = [np.cos(np.deg2rad(342.5)), np.sin(np.deg2rad(342.5)), 0.0]
    curve = ff.NurbsCurve.arc(
        [0, 0, 0], start, EZ, np.deg2rad(215.0), degree=degree, elements=elements
    )
    u = greville(degree, curve.knots)
    x, R = curve.position(u), section_rotations(curve, u)
    # chords of 1e-17 m have any direction: normals that were reflected there missed by 0.4 rad
    np.testing.assert_allclose(R[:, :, 1], -x, rtol=0, atol=1e-12)
    assert mismatch(curve, control_frames(curve), u, R) < 1e-12


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_frames_of_a_helix(degree):
    curve = ff.NurbsCurve.helix([0, 0, 0], [1, 0, 0], EZ, 3.0, 2.0, degree=degree, elements=12)
    u = greville(degree, curve.knots)
    wanted = section_rotations(curve, u)
    # 1e-2 or more without corrections
    assert mismatch(curve, control_frames(curve), u, wanted) < 1e-12
    # The rotation-minimising normal turns against the principal one by minus torsion times length
    fine = ff.NurbsCurve.helix([0, 0, 0], [1, 0, 0], EZ, 3.0, 2.0, degree=5, elements=24)
    R = section_rotations(fine, U)
    rise = 2.0 / (2.0 * np.pi)
    angle = -3.0 * U * rise / np.hypot(1.0, rise)
    principal = -np.column_stack([np.cos(3 * U), np.sin(3 * U), 0 * U])
    binormal = np.cross(R[:, :, 0], principal)
    # e2 starts as the principal normal, ez x e1 / |..|; without the torsion it misses by 0.9
    exact = np.cos(angle)[:, None] * principal + np.sin(angle)[:, None] * binormal
    np.testing.assert_allclose(R[:, :, 1], exact, rtol=0, atol=1e-6)
    # the interpolated frames approach these with order p + 1 at least between the abscissae
    frames = control_frames(curve)
    assert mismatch(curve, frames, U, section_rotations(curve, U)) < {2: 2e-2, 3: 1e-3}.get(
        degree, 5e-4
    )


def test_frames_that_cannot_be_interpolated_are_refused():
    curve = ff.NurbsCurve.fit(
        lambda u: np.column_stack([np.cos(12 * u), np.sin(12 * u), u]), degree=7, elements=9
    )
    with pytest.raises(ValueError, match="frames rotate too much inside the element at parameter"):
        control_frames(curve)


@pytest.mark.parametrize("degree", [1, 3])
def test_orientation_parallel_to_the_tangent(degree):
    with pytest.raises(ValueError, match="is parallel to the tangent at"):
        control_frames(ff.NurbsCurve.line([0, 0, 0], [1, 0, 0], degree=degree), EX)


# --- bad input -----------------------------------------------------------------------------------

LINE = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
BAD = [
    (lambda: ff.NurbsCurve(1.0, [0, 0, 1, 1], LINE[:2]), TypeError, "degree must be an integer"),
    (lambda: ff.NurbsCurve(0, [0, 1], LINE[:1]), ValueError, "degree must be positive, got 0"),
    (lambda: ff.NurbsCurve(8, [0, 1], LINE), ValueError, "degree must be 7 at most, got 8"),
    (lambda: ff.NurbsCurve(2, [0, 0, 0, 1, 1, 1], LINE[:2]), ValueError, "needs 3 points, got 2"),
    (lambda: ff.NurbsCurve(1, [0, 0, 1, 1], LINE), ValueError, "need 5 knots, got 4"),
    (lambda: ff.NurbsCurve(1, [0, 0, 2, 1, 1], LINE), ValueError, "knots must not decrease"),
    (lambda: ff.NurbsCurve(1, [0, 0.1, 0.2, 1, 1], LINE), ValueError, "must appear 2 times each"),
    (lambda: ff.NurbsCurve(1, [0, 0, np.nan, 1, 1], LINE), ValueError, "knots must be finite"),
    (
        lambda: ff.NurbsCurve(1, [0, 0, 0.5, 0.5, 1, 1], [*LINE, [3, 0, 0]]),
        ValueError,
        "may appear 1 times at most, got 0.5 2 times",
    ),
    (lambda: ff.NurbsCurve(1, "knots", LINE), TypeError, "knots must hold n numbers"),
    (lambda: ff.NurbsCurve(1, [0, 0, 0.5, 1, 1], LINE, [1, 1]), ValueError, "weights must be 3"),
    (lambda: ff.NurbsCurve(1, [0, 0, 0.5, 1, 1], LINE, [1, 0, 1]), ValueError, "must be positive"),
    (lambda: ff.NurbsCurve(1, [0, 0, 1, 1], [[0, 0, 0], [np.inf, 0, 0]]), ValueError, "finite"),
    (lambda: ff.NurbsCurve(1, [0, 0, 1, 1], [[0, 0], [1, 0]]), ValueError, "points must hold"),
    (lambda: ff.NurbsCurve.line(EX, EX), ValueError, "has a zero derivative"),
    (
        lambda: ff.NurbsCurve(2, [0, 0, 0, 1, 1, 1], [[0, 0, 0], [0, 0, 0], [1, 0, 0]]),
        ValueError,
        "has a zero derivative at parameter 0",
    ),
    (
        lambda: ff.NurbsCurve(2, [0, 0, 0, 1, 1, 1], [[0, 0, 0], [1, 0, 0], [0, 0, 0]]),
        ValueError,
        "has a zero derivative at parameter 0.5",
    ),
    (lambda: ff.NurbsCurve.line(EX, EY, elements=0), ValueError, "elements must be positive"),
    (lambda: ff.NurbsCurve.arc(EX, EX + EZ, EZ, 1.0), ValueError, "start .* lies on the axis"),
    (lambda: ff.NurbsCurve.arc(EX, EY, EZ, 0.0), ValueError, "angle must not be zero"),
    (lambda: ff.NurbsCurve.arc(EX, EY, EZ, 7.0), ValueError, "angle must be 2 pi at most, got 7"),
    (lambda: ff.NurbsCurve.arc(EX, EY, EZ, 4.0, elements=1), ValueError, "needs 2 elements"),
    (lambda: ff.NurbsCurve.arc(EX, EY, EZ, 1.0, degree=1), ValueError, "degree 2 at least, got 1"),
    (lambda: ff.NurbsCurve.arc(EX, EY, 0 * EZ, 1.0), ValueError, "axis must not be zero"),
    (lambda: ff.NurbsCurve.through([EX]), ValueError, "two points are needed at least, got 1"),
    (lambda: ff.NurbsCurve.through([EX, EX, EY]), ValueError, "points 0 and 1 coincide"),
    (lambda: ff.NurbsCurve.through(LINE, corners=[2]), ValueError, "corner 2 is no inner point"),
    (lambda: ff.NurbsCurve.fit(helix), ValueError, "fit needs elements or tolerance"),
    (lambda: ff.NurbsCurve.fit(LINE, elements=2), ValueError, "3 points are too few"),
    (
        lambda: ff.NurbsCurve.fit(helix, elements=2, tolerance=1e-9),
        ValueError,
        "2 elements of degree 3 miss the path by .* tolerance is 1e-09",
    ),
    (lambda: ff.NurbsCurve.fit(lambda u: u, elements=2), ValueError, "result of the function"),
    (lambda: some_curve(2).insert([1.0]), ValueError, "between 0 and 1, got 1"),
    (lambda: some_curve(2).insert([0.5]), ValueError, "may appear 2 times at most, got 0.5 3"),
    (lambda: some_curve(2).refine(2), ValueError, "elements must be 4 at least, got 2"),
    (lambda: some_curve(2).elevate(6), ValueError, "degree must be 7 at most, got 8"),
    (lambda: some_curve(2).elevate(0), ValueError, "times must be positive, got 0"),
    (lambda: some_curve(2).position(1.5), ValueError, "parameter must be between 0 and 1, got 1.5"),
    (lambda: some_curve(2).parameter_at(-0.1), ValueError, "fraction must be between 0 and 1"),
    (lambda: some_curve(2).parameter_at(1.1), ValueError, "fraction must be between 0 and 1"),
    (
        lambda: ff.NurbsCurve(2, [0, 0, 0, 1, 1, 1], [EX, 0.01 * EY, EX + 0.02 * EY]).length,
        ValueError,
        "element 0 bends too sharply for its length, refine the curve there",
    ),
]


@pytest.mark.parametrize("case", range(len(BAD)))
def test_bad_input(case):
    build, error, message = BAD[case]
    with pytest.raises(error, match=message) as caught:
        build()
    assert str(caught.value).startswith("NurbsCurve: ")
    assert "\n" not in str(caught.value)


def test_building_a_line_loads_nothing_slow():
    code = (
        "import sys, flexfem as ff; ff.NurbsCurve.line([0, 0, 0], [1, 0, 0]);"
        "sys.exit(any(name in sys.modules for name in ('scipy', 'numba', 'dolfinx')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_continuity_is_lowered_and_the_curve_kept():
    curve = ff.NurbsCurve.arc((0, 0, 0), (1, 0, 0), (0, 0, 1), 1.5, degree=4, elements=3)
    for order, multiplicity in ((3, 1), (1, 3), (0, 4)):
        lower = curve.with_continuity(order)
        _, counts = np.unique(lower.knots[5:-5], return_counts=True)
        assert counts.tolist() == [multiplicity] * 2
        for u in (0.0, 0.2, 0.61, 1.0):
            # points of another curve are 1e-3 away
            np.testing.assert_allclose(lower.position(u), curve.position(u), atol=1e-14)
    assert len(lower.with_continuity(3).points) == len(lower.points)  # never raised
    with pytest.raises(ValueError, match="continuity must lie between 0 and 3 at degree 4, got 4"):
        curve.with_continuity(4)
    with pytest.raises(TypeError, match=r"continuity must be a whole number, got 1\.5"):
        curve.with_continuity(1.5)


@pytest.mark.parametrize("end", [(3.0, -1.0, 0.5), (0.0, 0.0, 2.0)])
@pytest.mark.parametrize("orientation", [None, (0.3, 2.0, 0.1)])
def test_frames_of_straight_curves_are_one_frame(end, orientation, monkeypatch):
    """Members of trusses: nothing is carried along them or solved for."""
    start = np.array([100.0, 50.0, -7.0])
    slow, fast = (ff.NurbsCurve.line(start, start + end, elements=4) for _ in range(2))
    with monkeypatch.context() as patched:
        patched.setattr(frames_of, "_straight", lambda _: None)
        expected = control_frames(slow, orientation)
    monkeypatch.setattr(ff.NurbsCurve, "places", None)
    # frames that start elsewhere or turn differ by order 1; points differ by nothing
    np.testing.assert_allclose(control_frames(fast, orientation), expected, rtol=0, atol=1e-12)


def test_curves_that_turn_back_or_bend_are_not_straight():
    """They, and those with a bend that is small, take the general way."""
    back = [[0, 0, 0], [2, 0, 0], [1, 0, 0], [3, 0, 0]]
    assert frames_of._straight(ff.NurbsCurve.line([0, 0, 0], [3, 0, 0])) is not None
    bent = ff.NurbsCurve.through([[0, 0, 0], [1, 1e-9, 0], [2, 0, 0], [3, 0, 0]])
    assert frames_of._straight(bent) is None
    assert frames_of._straight(SimpleNamespace(points=np.array(back, dtype=float))) is None
