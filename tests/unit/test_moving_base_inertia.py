# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modal integrals of the beam on a moving base against the exact, nonlinear kinematics."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexfem.lie import so3
from flexfem.research.moving_base.base import PrescribedBase
from flexfem.research.moving_base.basis import Basis, analytic_basis, modal_basis
from flexfem.research.moving_base.effects import Effects, effects_of
from flexfem.research.moving_base.equations import PrescribedBaseEquations, Setting
from flexfem.research.moving_base.inertia import Inertia, inertia_of
from flexfem.research.moving_base.properties import BeamProperties, Piecewise
from flexfem.research.moving_base.rotations import rotation_matrices

pytestmark = pytest.mark.serial

N = 9


def properties(**changes: Any) -> BeamProperties:
    """A beam of unit size with everything that varies, and mass centres off both axes."""
    values: dict[str, Any] = {
        "length": 1.3, "youngs_modulus": lambda x: 1.0 + 0.3 * x, "shear_modulus": 0.4,
        "mass_per_length": lambda x: 1.5 - 0.6 * x, "area": Piecewise((0.5, 1.3), (1.0, 0.7)),
        "second_moment_2": Piecewise((0.5, 1.3), (0.08, 0.05)), "second_moment_3": 0.03,
        "shear_ratio_2": 1.2, "shear_ratio_3": 1.5, "torsion_constant": 0.02,
        "warping_constant": 1e-3, "eccentricity_2": lambda x: 0.1 * x,
        "eccentricity_3": Piecewise((0.5, 1.3), (0.0, 0.2)),
    }  # fmt: skip
    return BeamProperties(**{**values, **changes})


def turned(rotations: str, theta: Any) -> tuple[Any, Any]:
    """Rotations (p, 3, 3), and the spins in section axes that the rates of theta give.

    A rotation by theta1 about a1, then by theta2 about a2, then by theta3 about a3; or exp(theta).
    """
    if rotations == "vector":
        return so3.exp(theta), so3.tangent(theta)
    R1, R2, R3 = (Rotation.from_rotvec(theta * axis).as_matrix() for axis in np.eye(3))
    axes = [(R3 @ R2)[:, :, 0], R3[:, :, 1], np.tile([0.0, 0.0, 1.0], (len(theta), 1))]
    R = R3 @ R2 @ R1
    return R, np.stack([np.einsum("pba,pb->pa", R, axis) for axis in axes], axis=2)


def exact_mass(basis: Basis, q: Any, rotations: str = "sequence") -> Any:
    """Mass matrix (6 + n) of the beam at finite q: velocities of mass centres, spins of sections.

    The axis is stretched by exactly s.
    """
    s, w = basis.sections, basis.quadrature.weights
    (ds, d2, d3), fields = basis.slopes[:3], basis.fields
    root = np.sqrt((1.0 + ds @ q) ** 2 - (d2 @ q) ** 2 - (d3 @ q) ** 2)
    u1 = basis.quadrature.running(root - 1.0)
    du1 = ((1.0 + ds @ q)[:, None] * ds - (d2 @ q)[:, None] * d2 - (d3 @ q)[:, None] * d3) / root[
        :, None
    ]
    du1 = basis.quadrature.running(du1)
    theta = np.ascontiguousarray((fields[3:] @ q).T)
    R, T = turned(rotations, theta)
    e = s.eccentricity.T
    r = np.stack([basis.quadrature.x + u1, fields[1] @ q, fields[2] @ q], axis=1)
    r = r + np.einsum("pab,pb->pa", R, e)
    spin = np.einsum("pab,bpi->pai", T, fields[3:])  # in section axes
    dr = np.stack([du1, fields[1], fields[2]], axis=1)
    dr = dr + np.einsum("pab,pbi->pai", R, np.cross(spin, e[:, :, None], axis=1))
    n, p = basis.size, len(w)
    velocity, angular = np.zeros((p, 3, 6 + n)), np.zeros((p, 3, 6 + n))
    velocity[:, :, :3] = np.eye(3)
    velocity[:, :, 3:6] = -so3.skew(r)
    velocity[:, :, 6:] = dr
    angular[:, :, 3:6] = np.swapaxes(R, 1, 2)
    angular[:, :, 6:] = spin
    out = np.einsum("p,pai,paj->ij", w * s.mass, velocity, velocity)
    return out + np.einsum("p,ap,pai,paj->ij", w, s.rotary, angular, angular)


def taylor(function: Callable[[Any], Any], d: Any) -> tuple[Any, Any, Any]:
    """Value, first and second derivative along d at zero, by differences of the sixth order."""
    h = 0.02
    f = {k: function(k * h * d) for k in range(-3, 4)}
    first = (45 * (f[1] - f[-1]) - 9 * (f[2] - f[-2]) + f[3] - f[-3]) / (60 * h)
    second = (270 * (f[1] + f[-1]) - 27 * (f[2] + f[-2]) + 2 * (f[3] + f[-3]) - 490 * f[0]) / (
        180 * h * h
    )
    return f[0], first, second


@pytest.fixture(scope="module")
def case() -> tuple[Basis, Inertia]:
    effects = Effects()
    basis = modal_basis(properties(), effects, N - 2, 5)
    return basis, inertia_of(basis, effects)


def test_spins_are_those_of_the_rotations(rng: np.random.Generator) -> None:
    theta, rate = 0.7 * rng.normal(size=(2, 1, 3))
    h = 1e-5
    for rotations in ("sequence", "vector"):
        R, T = turned(rotations, theta)
        ends = [turned(rotations, theta + sign * h * rate)[0][0] for sign in (1.0, -1.0)]
        W = R[0].T @ (ends[0] - ends[1]) / (2.0 * h)
        # a turn about a section's axis for one about the base's is off by tens of per cent
        assert np.allclose([W[2, 1], W[0, 2], W[1, 0]], T[0] @ rate[0], atol=1e-8)
        assert np.allclose(rotation_matrices(rotations, theta), R, atol=1e-14)


@pytest.mark.parametrize("rotations", ["sequence", "vector"])
def test_coefficients_are_the_taylor_series_of_the_exact_mass_matrix(
    case: tuple[Basis, Inertia], rotations: str, rng: np.random.Generator
) -> None:
    basis, inertia = case[0], inertia_of(case[0], Effects(rotations=rotations))
    for _ in range(3):
        d = rng.normal(size=N)
        d /= np.abs(basis.fields @ d).max() * 2.0
        value, first, second = taylor(lambda q: exact_mass(basis, q, rotations), d)
        # the other rotations, or those to first order only, are 1e-2 of the size off
        close = {"rtol": 0.0, "atol": 1e-8}
        assert np.allclose(value[:6, :6], inertia.A0, **close)
        assert np.allclose(value[:6, 6:], inertia.B0, **close)
        assert np.allclose(value[6:, 6:], inertia.M, **close)
        assert np.allclose(first[:6, :6], inertia.A1 @ d, **close)
        assert np.allclose(first[:6, 6:], inertia.B1 @ d, **close)
        assert np.allclose(second[:6, :6], (inertia.A2 @ d) @ d, atol=1e-6, rtol=0.0)


@pytest.mark.parametrize("theory", ["consistent", "conventional"])
def test_matrices_of_mass_centres_are_the_published_ones(
    theory: str, rng: np.random.Generator
) -> None:
    """The conventional algorithm: points on the axis, whatever the functions are modes of."""
    effects = effects_of(theory)
    if theory == "consistent":
        effects = effects.without("torsional_inertia", "rotary_inertia", "eccentricity")
    basis = modal_basis(properties(), effects, N - 2, 5)
    assert basis.sections.eccentricity.any() == (theory == "conventional")
    v, a, omega, alpha = rng.normal(size=(4, 3))
    base = PrescribedBase(
        velocity=lambda t: v + t * a, acceleration=lambda t: a,
        angular_velocity=lambda t: omega + t * alpha, angular_acceleration=lambda t: alpha,
    )  # fmt: skip
    eq = PrescribedBaseEquations(basis, inertia_of(basis, effects), base, Setting())
    G, K, F = eq.matrices(0.0)
    w = basis.quadrature.weights * basis.sections.mass
    phi = basis.fields[:3]
    x = np.outer([1.0, 0.0, 0.0], basis.quadrature.x)

    def cross(p: Any, b: Any) -> Any:
        return np.einsum("ab,b...->a...", so3.skew(p), b)

    rigid = (a + np.cross(omega, v))[:, None] + cross(alpha, x) + cross(omega, cross(omega, x))
    turned = cross(alpha, phi) + cross(omega, cross(omega, phi))
    assert np.allclose(G, 2.0 * np.einsum("p,api,apj->ij", w, phi, cross(omega, phi)), atol=1e-12)
    expected = basis.stiffness + np.einsum("p,api,apj->ij", w, phi, turned)
    assert np.allclose(eq.inertia.M, np.einsum("p,api,apj->ij", w, phi, phi), atol=1e-12)
    if theory == "consistent":
        expected -= np.einsum("p,p,pij->ij", w, rigid[0], basis.shortening)
    assert np.allclose(K, expected, atol=1e-11)
    assert np.allclose(F, -np.einsum("p,api,ap->i", w, phi, rigid), atol=1e-12)
    assert np.allclose(G, -G.T, atol=1e-14)


def test_equations_are_the_linearised_exact_lagrange_equations(
    case: tuple[Basis, Inertia], rng: np.random.Generator
) -> None:
    """Kinetic energy of the exact mass matrix, differentiated numerically along a motion."""
    basis, inertia = case
    v, a, omega, alpha = rng.normal(size=(4, 3))
    base = PrescribedBase(
        velocity=lambda t: v + t * a, acceleration=lambda t: a,
        angular_velocity=lambda t: omega + t * alpha, angular_acceleration=lambda t: alpha,
    )  # fmt: skip
    eq = PrescribedBaseEquations(basis, inertia, base, Setting())

    def lagrange(q: Any, rate: Any, second: Any) -> Any:
        def momentum(t: float) -> Any:
            speed = np.concatenate([base.twist(t), rate + t * second])
            return (exact_mass(basis, q + t * rate + 0.5 * t * t * second) @ speed)[6:]

        speed = np.concatenate([base.twist(0.0), rate])
        h = 1e-3
        out = (8 * (momentum(h) - momentum(-h)) - momentum(2 * h) + momentum(-2 * h)) / (12 * h)
        for j in range(N):
            step = np.eye(N)[j] * h
            energy = [0.5 * speed @ exact_mass(basis, q + k * step) @ speed for k in (-2, -1, 1, 2)]
            out[j] -= (energy[0] - 8 * energy[1] + 8 * energy[2] - energy[3]) / (12 * h)
        return out + basis.stiffness @ q

    G, K, F = eq.matrices(0.0)
    zero = np.zeros(N)
    assert np.allclose(lagrange(zero, zero, zero), -F, atol=1e-8)
    d = 1e-3
    for column in range(N):
        step = d * np.eye(N)[column]
        stiff = (lagrange(step, zero, zero) - lagrange(-step, zero, zero)) / (2 * d)
        gyro = (lagrange(zero, step, zero) - lagrange(zero, -step, zero)) / (2 * d)
        # a sign error in any coupling of rotary inertia or eccentricity gives 1e-3 and more
        assert np.allclose(stiff, K[:, column], atol=2e-5)
        assert np.allclose(gyro, G[:, column], atol=2e-5)


@pytest.mark.parametrize(
    "left_out",
    [f.name for f in fields(Effects) if f.name != "rotations"],
)
def test_every_effect_counts(case: tuple[Basis, Inertia], left_out: str) -> None:
    basis, inertia = case
    less = Effects().without(left_out)
    other = modal_basis(properties(), less, N - 2, 5)
    gone = {"extension": (0,), "in_plane": (1, 5), "out_of_plane": (2, 4), "torsion": (3,)}
    for field in gone.get(left_out, ()):
        assert not other.fields[field].any()
    if left_out in ("stiffening", "section_inertia"):
        assert np.allclose(other.frequencies, basis.frequencies)
        assert np.abs(inertia_of(basis, less).A2 - inertia.A2).max() > 1e-3
    else:
        assert np.abs(other.frequencies[:4] / basis.frequencies[:4] - 1.0).max() > 1e-3


def test_analytic_functions_give_frequencies_of_the_uniform_beam() -> None:
    uniform = properties(
        youngs_modulus=1.0, mass_per_length=1.0, area=1.0, second_moment_2=0.05, length=1.0,
        eccentricity_2=0.0, eccentricity_3=0.0, warping_constant=0.0,
    )  # fmt: skip
    effects = Effects().without("rotary_inertia", "shear", "in_plane", "torsion")
    basis = analytic_basis(uniform, effects, (1, 0, 3, 0), points=12)
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382])
    expected = np.sort([*(roots**2 * np.sqrt(0.05)), 0.5 * np.pi])
    assert np.allclose(basis.frequencies, expected, rtol=1e-8)
    elements = modal_basis(uniform, effects, 4, 12)
    assert np.allclose(elements.frequencies[:2], expected[:2], rtol=1e-5)


def test_rigid_coefficients_are_those_of_the_rigid_beam(case: tuple[Basis, Inertia]) -> None:
    basis, inertia = case
    s, w = basis.sections, basis.quadrature.weights * basis.sections.mass
    assert inertia.A0[0, 0] == pytest.approx(1.5 * 1.3 - 0.3 * 1.3**2)
    assert inertia.A0[5, 5] == pytest.approx(
        w @ (basis.quadrature.x**2 + s.eccentricity[1] ** 2)
        + basis.quadrature.weights @ s.rotary[2]
    )
