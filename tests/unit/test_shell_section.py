# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shell sections against closed forms and integration over the thickness."""

import numpy as np
import pytest

from flexfem.materials.material import Material
from flexfem.materials.shell_section import Ply, ShellSection

pytestmark = pytest.mark.serial

CARBON = {"moduli": (140e9, 9e9), "shear_modulus": 5e9, "poisson_ratio": 0.3, "density": 1600.0}


def _ply(angle, thickness=1e-3):
    return Ply(thickness, np.radians(angle), **CARBON)


def test_isotropic_plate():
    E, nu, h = 7e10, 0.3, 2e-3
    section = ShellSection.isotropic(h, Material(E, nu, 2700.0))
    plane = E / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    # round-off; h^3/6 or the wrong shear is off by order 1
    np.testing.assert_allclose(section.stiffness[:3, :3], h * plane, rtol=1e-14)
    np.testing.assert_allclose(section.stiffness[3:, 3:], h**3 / 12 * plane, rtol=1e-14)
    assert not section.stiffness[:3, 3:].any()
    assert section.mass == pytest.approx(5.4, rel=1e-15)


def test_laminate_is_the_integral_over_its_thickness():
    """Unsymmetric, angles of all kinds, off the reference surface; 2 Gauss points a ply."""
    plies = [_ply(30.0), _ply(-70.0, 2e-3), _ply(0.0, 5e-4)]
    section = ShellSection.laminate(plies, offset=4e-4)
    expected, z = np.zeros((6, 6)), -1.75e-3 + 4e-4
    x = 1.0 / np.sqrt(3.0)
    for ply in plies:
        c, s = np.cos(ply.angle), np.sin(ply.angle)
        turn = np.array([[c, s], [-s, c]])
        for point in (-x, x):
            height = z + 0.5 * ply.thickness * (1.0 + point)
            # stress along the fibres for every unit strain, by tensors
            for k in range(6):
                unit = np.eye(6)[k]
                e = unit[:3] + height * unit[3:]
                fibre = turn @ np.array([[e[0], e[2] / 2], [e[2] / 2, e[1]]]) @ turn.T
                E1, E2 = ply.moduli
                q = 1.0 / (1.0 - ply.poisson_ratio**2 * E2 / E1)
                s11 = q * (E1 * fibre[0, 0] + ply.poisson_ratio * E2 * fibre[1, 1])
                s22 = q * (E2 * fibre[1, 1] + ply.poisson_ratio * E2 * fibre[0, 0])
                s12 = 2.0 * ply.shear_modulus * fibre[0, 1]
                stress = turn.T @ np.array([[s11, s12], [s12, s22]]) @ turn
                n = 0.5 * ply.thickness * np.array([stress[0, 0], stress[1, 1], stress[0, 1]])
                expected[:3, k] += n
                expected[3:, k] += height * n
        z += ply.thickness
    # round-off; a sign of an angle or of the coupling is off by order 1
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(section.stiffness / scale, expected / scale, atol=1e-13)
    assert section.thickness == pytest.approx(3.5e-3)
    assert section.mass == pytest.approx(1600.0 * 3.5e-3)


def test_symmetric_laminate_does_not_couple():
    section = ShellSection.laminate([_ply(30.0), _ply(90.0), _ply(30.0)])
    assert np.abs(section.stiffness[:3, 3:]).max() <= 1e-9 * np.abs(section.stiffness).max() * 1e-3


def test_one_ply_of_an_isotropic_material_is_a_plate():
    E, nu, h = 2e11, 0.25, 3e-3
    ply = Ply(h, 0.4, (E, E), E / (2 * (1 + nu)), nu, 7800.0)
    plate = ShellSection.isotropic(h, Material(E, nu, 7800.0))
    np.testing.assert_allclose(
        ShellSection.laminate([ply]).stiffness, plate.stiffness, rtol=1e-12, atol=1e-3
    )


def test_orthotropic_rigidities():
    """Tension along e1 alone contracts e2 by Poisson's ratio and takes the rigidity along e1."""
    section = ShellSection.orthotropic(
        (1095.84, 744.31, 40.964), (8.134e-6, 6.174e-6, 2.646e-6), 0.1, 0.19, 0.593e-3
    )
    for block, rigidities in (
        (section.stiffness[:3, :3], (1095.84, 744.31, 40.964)),
        (section.stiffness[3:, 3:], (8.134e-6, 6.174e-6, 2.646e-6)),
    ):
        strain = np.linalg.solve(block, np.array([1.0, 0.0, 0.0]))
        assert 1.0 / strain[0] == pytest.approx(rigidities[0], rel=1e-13)
        assert -strain[1] / strain[0] == pytest.approx(0.1, rel=1e-13)
        assert 1.0 / np.linalg.inv(block)[1, 1] == pytest.approx(rigidities[1], rel=1e-13)
        assert block[2, 2] == rigidities[2]


BAD = {
    "thickness": (lambda: ShellSection.isotropic(0.0, Material(1.0, 0.3, 1.0)), "thickness"),
    "material": (lambda: ShellSection.isotropic(1.0, 7e10), "material must be"),
    "no ply": (lambda: ShellSection.laminate([]), "at least one ply"),
    "not a ply": (lambda: ShellSection.laminate([1.0]), "ply must be"),
    "ratio": (lambda: Ply(1.0, 0.0, (1.0, 4.0), 1.0, 0.5, 1.0), "poisson_ratio must be"),
    "shear": (lambda: Ply(1.0, 0.0, (1.0, 4.0), 0.0, 0.1, 1.0), "shear_modulus must be"),
    "modulus": (lambda: Ply(1.0, 0.0, (1.0, -9.0), 1.0, 0.5, 1.0), "modulus must be"),
    "shape": (lambda: ShellSection(np.eye(3), 1.0, 1.0), "stiffness must hold 6 x 6"),
    "indefinite": (lambda: ShellSection(-np.eye(6), 1.0, 1.0), "positive definite"),
    "unsymmetric": (lambda: ShellSection(np.eye(6) + 0.1 * np.eye(6, k=1), 1.0, 1.0), r"\(1, 2\)"),
    "mass": (lambda: ShellSection(np.eye(6), -1.0, 1.0), "mass must"),
    "rigidities": (
        lambda: ShellSection.orthotropic((0.0, 1.0, 1.0), (1.0, 1.0, 1.0), 0.1, 1.0, 1.0),
        "membrane rigidity",
    ),
}


@pytest.mark.parametrize(("make", "message"), BAD.values(), ids=BAD)
def test_bad_input(make, message):
    with pytest.raises((TypeError, ValueError), match=message) as raised:
        make()
    assert "\n" not in str(raised.value)


def test_shear_across_the_thickness():
    plate = ShellSection.isotropic(0.1, Material(2.6, 0.3, 1.0))
    # 5/6 G h; without the factor it is 20 % more
    np.testing.assert_allclose(plate.shear, 5 / 6 * 0.1 * np.eye(2), rtol=1e-14)
    laminate = ShellSection.laminate([_ply(30.0), _ply(90.0)])
    np.testing.assert_allclose(laminate.shear, 5 / 6 * 5e9 * 2e-3 * np.eye(2), rtol=1e-14)
    given = ShellSection.laminate([_ply(30.0)], shear=[[2.0, 0.5], [0.5, 3.0]])
    np.testing.assert_array_equal(given.shear, [[2.0, 0.5], [0.5, 3.0]])
    with pytest.raises(ValueError, match="shear must be positive definite"):
        ShellSection(np.eye(6), 1.0, 0.1, [[1.0, 2.0], [2.0, 1.0]])
