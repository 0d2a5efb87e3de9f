# SPDX-License-Identifier: LGPL-3.0-or-later
"""Section constants against closed forms, direct integration and independent series."""

import numpy as np
import pytest

from flexfem.materials.constants import rectangle_torsion
from flexfem.materials.material import Material
from flexfem.materials.section import Section

pytestmark = pytest.mark.serial

EPS = np.finfo(float).eps
STEEL = Material(2.1e11, 0.3, 7850.0)
G = 2.1e11 / 2.6


def torsion_by_double_series(a, b, terms=2001):
    """Prandtl's stress function as a double sine series: another route to the same constant."""
    n = np.arange(1, terms, 2.0)
    m, k = np.meshgrid(n, n)
    return 256 * a * b / np.pi**6 * np.sum(1 / ((m * k) ** 2 * ((m / a) ** 2 + (k / b) ** 2)))


def inertia_by_points(width, height, density, centre):
    """Inertia of a rectangle about the reference axis by Gauss points of exact degree."""
    x, w = np.polynomial.legendre.leggauss(2)
    inertia = np.zeros((6, 6))
    for i in range(2):
        for j in range(2):
            y, z = centre[0] + x[i] * width / 2, centre[1] + x[j] * height / 2
            dm = density * width * height * w[i] * w[j] / 4
            # velocity of the point: V + Omega x r = [I, -skew(r)] v
            skew = np.array([[0.0, -z, y], [z, 0.0, 0.0], [-y, 0.0, 0.0]])
            velocity = np.hstack([np.eye(3), -skew])
            inertia += dm * velocity.T @ velocity
    return inertia


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (1.0, 2.0), (0.3, 0.1), (0.05, 1.0)])
def test_torsion_of_rectangles(a, b):
    # The double series is truncated: its tail, not ours, sets the tolerance
    assert rectangle_torsion(a, b) == pytest.approx(torsion_by_double_series(a, b), rel=2e-6)
    assert rectangle_torsion(a, b) == rectangle_torsion(b, a)


def test_torsion_limits():
    assert rectangle_torsion(1.0, 1.0) == pytest.approx(0.1405770150, abs=1e-10)
    assert rectangle_torsion(1e3, 1e-3) == pytest.approx(1e-6 / 3 * (1 - 0.63e-6), rel=1e-9)


def test_rectangle_axes():
    b, h = 0.02, 0.05
    section = Section.rectangle(b, h, STEEL)
    area = b * h
    expected = [
        2.1e11 * area,
        5 / 6 * G * area,
        5 / 6 * G * area,
        G * rectangle_torsion(b, h),
        2.1e11 * b * h**3 / 12,  # about e2: the height lies along e3
        2.1e11 * h * b**3 / 12,
    ]
    np.testing.assert_allclose(section.stiffness, np.diag(expected), rtol=8 * EPS)
    assert section.mass_per_length == pytest.approx(7850 * area, rel=4 * EPS)
    assert np.ptp(section.outline, axis=0) == pytest.approx([b, h])


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.01, 0.0), (0.0, -0.02), (0.013, 0.007)])
def test_mass_centre_moves_the_inertia(centre):
    section = Section.rectangle(0.02, 0.05, STEEL, mass_centre=centre)
    direct = inertia_by_points(0.02, 0.05, 7850.0, centre)
    np.testing.assert_allclose(section.inertia, direct, atol=1e-14 * direct[0, 0])
    np.testing.assert_allclose(section.mass_centre, centre, atol=1e-16)


def test_shear_force_through_the_shear_centre_does_not_twist():
    y, z = 0.01, -0.03
    section = Section.rectangle(0.02, 0.05, STEEL, shear_centre=(y, z))
    f2, f3 = 120.0, -70.0
    # Forces at (y, z) have the torque y f3 - z f2 about the reference axis
    strain = np.linalg.solve(section.stiffness, [0.0, f2, f3, y * f3 - z * f2, 0.0, 0.0])
    assert abs(strain[3]) < 1e-12 * np.abs(strain).max()
    plain = Section.rectangle(0.02, 0.05, STEEL)
    free_twist = np.linalg.solve(section.stiffness, [0.0, 0.0, 0.0, 5.0, 0.0, 0.0])
    # Under torque alone the shear centre stays: the twist is that of the section itself
    assert free_twist[3] == pytest.approx(5.0 / plain.stiffness[3, 3], rel=1e-12)
    assert free_twist[1] - z * free_twist[3] == pytest.approx(0.0, abs=1e-12 * free_twist[3])
    assert free_twist[2] + y * free_twist[3] == pytest.approx(0.0, abs=1e-12 * free_twist[3])


@pytest.mark.parametrize(("factor", "pair"), [(0.7, (0.7, 0.7)), ((0.6, 0.9), (0.6, 0.9))])
def test_given_shear_factor(factor, pair):
    section = Section.circle(0.1, STEEL, shear_factor=factor)
    area = np.pi * 0.1**2 / 4
    np.testing.assert_allclose(
        np.diagonal(section.stiffness)[1:3], np.array(pair) * G * area, rtol=8 * EPS
    )


def test_circle_and_tube():
    d = 0.04
    circle = Section.circle(d, STEEL)
    area, second = np.pi * d**2 / 4, np.pi * d**4 / 64
    k = 6 * 1.3 / (7 + 6 * 0.3)
    np.testing.assert_allclose(
        np.diagonal(circle.stiffness),
        [2.1e11 * area, k * G * area, k * G * area, 2 * G * second, *2 * [2.1e11 * second]],
        rtol=8 * EPS,
    )
    almost = Section.tube(1e-6 * d, d, STEEL)
    np.testing.assert_allclose(almost.stiffness, circle.stiffness, rtol=1e-10)
    thin = Section.tube(0.999 * d, d, STEEL).stiffness
    assert thin[1, 1] / thin[0, 0] * 2.6 == pytest.approx(2 * 1.3 / (4 + 3 * 0.3), rel=1e-5)


def test_hollow_rectangle():
    b, h, t = 0.06, 0.1, 0.004
    section = Section.hollow_rectangle(b, h, t, STEEL)
    outer = Section.rectangle(b, h, STEEL)
    inner = Section.rectangle(b - 2 * t, h - 2 * t, STEEL)
    for entry in (0, 4, 5):
        difference = outer.stiffness[entry, entry] - inner.stiffness[entry, entry]
        assert section.stiffness[entry, entry] == pytest.approx(difference, rel=1e-12)
    np.testing.assert_allclose(section.inertia, outer.inertia - inner.inertia, atol=1e-12)
    bredt = 2 * t * (b - t) ** 2 * (h - t) ** 2 / (b + h - 2 * t)
    assert section.stiffness[3, 3] / G == pytest.approx(bredt, rel=0.02)


def test_walls_of_any_thickness_keep_their_digits():
    """Differences of two solids would have 4 digits left, and none of walls below 1e-16."""
    for t in (1e-12, 1e-25):
        box = np.diagonal(Section.hollow_rectangle(1.0, 2.0, t, STEEL).stiffness) / 2.1e11
        # the centre line's area and second moments, exact to t/b
        about = [6 * t, 2 * (1.0 * t * 1.0) + 2 * t * 2.0**3 / 12]
        about.append(2 * (2.0 * t * 0.25) + 2 * t * 1.0**3 / 12)
        np.testing.assert_allclose(box[[0, 4, 5]], about, rtol=1e-11)
    inner = 1.0 - 2.0**-40
    tube = np.diagonal(Section.tube(inner, 1.0, STEEL).stiffness) / 2.1e11
    np.testing.assert_allclose(tube[[0, 4]], np.pi * 2.0**-41 * np.array([1, 1 / 8]), rtol=1e-11)


@pytest.mark.parametrize("length", [1e-31, 1e-300, 1e31])
def test_lengths_that_no_section_has(length):
    """Products of second moments would be zero or infinite, and stresses no numbers."""
    makes = (
        lambda: Section.rectangle(length, length, STEEL),
        lambda: Section.hollow_rectangle(4 * length, 4 * length, length, STEEL),
        lambda: Section.circle(length, STEEL),
        lambda: Section.tube(0.5 * length, length, STEEL),
        lambda: Section.t_section(9 * length, 9 * length, length, length, STEEL),
    )
    for make in makes:
        with pytest.raises(ValueError, match=r"must be between 1e-30 and 1e\+30 m, got"):
            make()


def test_shear_factor_of_a_box_by_its_shear_flow():
    """Integrate the shear flow of a thin box numerically: energy q^2/t against V^2/(k A)."""
    b, h, t = 0.06, 0.1, 1e-6
    section = Section.hollow_rectangle(b, h, t, STEEL)
    s, w = np.polynomial.legendre.leggauss(6)
    flange = (s + 1) * b / 4  # from the middle of a flange to its corner
    web = s * h / 2
    second = t * h**3 / 6 + b * t * h**2 / 2
    q_flange = t * h / 2 * flange / second
    q_web = (t * h * b / 4 + t * (h**2 / 4 - web**2) / 2) / second
    energy = (4 * b / 4 * w @ q_flange**2 + 2 * h / 2 * w @ q_web**2) / t
    area = 2 * t * (b + h)
    assert section.stiffness[2, 2] / (G * area) == pytest.approx(1 / (area * energy), rel=1e-4)


def test_general_section():
    diagonal = [1e4, 1e4, 1e4, 500.0, 500.0, 500.0]
    section = Section.general(diagonal, [1, 1, 1, 10, 10, 10])
    np.testing.assert_array_equal(section.stiffness, np.diag(diagonal))
    assert section.outline is None
    assert section.mass_per_length == 1.0
    again = Section.general(section.stiffness, section.inertia, [[0, 0], [1, 0], [0, 1]])
    np.testing.assert_array_equal(again.inertia, section.inertia)


def test_massless_section():
    section = Section.general(np.ones(6), np.zeros(6))
    assert section.mass_per_length == 0.0
    np.testing.assert_array_equal(section.mass_centre, [0.0, 0.0])
    assert Section.rectangle(0.1, 0.1, Material(1e9, 0.3, 0.0)).mass_per_length == 0.0


def test_sections_cannot_be_changed():
    stiffness = np.diag(np.ones(6))
    section = Section.general(stiffness, np.ones(6))
    with pytest.raises(AttributeError):
        section.stiffness = stiffness
    with pytest.raises(ValueError, match="read-only"):
        section.stiffness[0, 0] = 2.0
    stiffness[0, 0] = 3.0
    assert section.stiffness[0, 0] == 1.0


def test_shear_modulus():
    assert STEEL.shear_modulus == pytest.approx(G, rel=2 * EPS)
