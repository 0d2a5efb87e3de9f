# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beam on a moving base: rotating beams, static limits, spin-up, free base, exact beam."""

from typing import Any

import numpy as np
import pytest
import scipy.linalg

import flexfem as ff
from flexfem import research
from flexfem.research.equations.run.simulate import simulate_equations
from flexfem.research.moving_base.equations import PrescribedBaseEquations
from tests.unit.refusals import assert_on_page
from tests.verification.benchmarks.flexible_spin_up import EXTENSION, PEAK, REFERENCE, _angle

pytestmark = pytest.mark.serial

#: First out-of-plane frequency of a uniform clamped beam that spins at 0 to 12: Wright, Smith,
#: Thresher, Wang, "Vibration modes of centrifugally stiffened beams", J. Appl. Mech. 49 (1982).
WRIGHT = [
    3.5160, 3.6816, 4.1373, 4.7973, 5.5850, 6.4495, 7.3604, 8.2996, 9.2568, 10.2257, 11.2023,
    12.1843, 13.1702,
]  # fmt: skip
STILL = research.PrescribedBase()


def unit_beam(**changes: Any) -> research.BeamProperties:
    """Uniform beam with length, mass per length and bending rigidity one."""
    values: dict[str, Any] = {
        "length": 1.0, "youngs_modulus": 1.0, "shear_modulus": 1.0, "mass_per_length": 1.0,
        "area": 1e6, "second_moment_2": 1.0, "second_moment_3": 1.0, "torsion_constant": 1.0,
    }  # fmt: skip
    return research.BeamProperties(**{**values, **changes})


def equations(
    properties: research.BeamProperties,
    base: research.PrescribedBase,
    effects: research.Effects,
    **more: Any,
) -> PrescribedBaseEquations:
    source = research.MovingBaseBeam(properties=properties, base=base, effects=effects, **more)
    source.validate()
    made = source.equations()
    assert isinstance(made, PrescribedBaseEquations)
    return made


def spinning(speed: float, axis: int = 2, hub: float = 0.0) -> research.PrescribedBase:
    """Steady rotation about an axis through a point ``hub`` before the root."""
    omega = speed * np.eye(3)[axis]
    velocity = np.cross(omega, [hub, 0.0, 0.0])
    return research.PrescribedBase(velocity=lambda t: velocity, angular_velocity=lambda t: omega)


def ritz(spin: float, count: int = 16) -> Any:
    """Out-of-plane frequencies of the unit beam: curvatures are Legendre polynomials.

    Energy of bending and of the tension ``spin^2 (1 - x^2)/2``; independent of the package.
    """
    x, w = np.polynomial.legendre.leggauss(2 * count)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    bent = [np.polynomial.Legendre.basis(k, domain=[0.0, 1.0]) for k in range(count)]
    values = [np.array([f.integ(n, lbnd=0.0)(x) for f in bent]) for n in (2, 1)]
    curvature = np.array([f(x) for f in bent])
    stiffness = (w * curvature) @ curvature.T
    stiffness += spin**2 * (0.5 * w * (1.0 - x**2) * values[1]) @ values[1].T
    return np.sqrt(scipy.linalg.eigh(stiffness, (w * values[0]) @ values[0].T)[0][:3])


@pytest.mark.parametrize("out_of_plane", [True, False])
def test_frequencies_of_rotating_beams(out_of_plane: bool) -> None:
    effects = research.Effects(in_plane=not out_of_plane, out_of_plane=out_of_plane).without(
        "shear", "rotary_inertia", "extension", "torsion"
    )
    for spin, published in enumerate(WRIGHT):
        eq = equations(unit_beam(), spinning(spin), effects, modes=10)
        squares = np.linalg.eigvalsh(eq.matrices(0.0)[1])[:3]
        expected = ritz(spin)
        assert expected[0] == pytest.approx(published, abs=6e-5)  # the table's last digit
        # in the plane they are lower by the spin, squares
        found = np.sqrt(squares + (0.0 if out_of_plane else spin**2))
        # without b + g the first would stay at 3.516, or become imaginary
        assert np.allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("theory", ["premature", "conventional"])
def test_theories_without_stiffening_soften(theory: str) -> None:
    without = ("shear", "rotary_inertia", "extension", "torsion", "out_of_plane")
    effects = research.effects_of(theory, without=without)
    for spin in (1.0, 3.0, 4.0):
        eq = equations(unit_beam(), spinning(spin), effects, modes=6)
        lowest = np.linalg.eigvalsh(eq.matrices(0.0)[1])[0]
        assert lowest == pytest.approx(3.51601527**2 - spin**2, rel=1e-6)  # negative for 4


def test_functions_need_not_be_modes() -> None:
    effects = research.Effects().without(
        "shear", "rotary_inertia", "extension", "torsion", "in_plane"
    )
    eq = equations(unit_beam(), spinning(6.0), effects, analytic=(0, 0, 10, 0))
    found = np.sqrt(np.linalg.eigvalsh(eq.matrices(0.0)[1])[:3])
    assert np.allclose(found, ritz(6.0), rtol=1e-4)


def test_static_limits_of_a_beam_on_an_accelerated_base() -> None:
    e, g, area, i2, i3, j = 70.0, 27.0, 0.4, 0.02, 0.03, 0.01
    length, rho, offset = 2.0, 1.7, 0.15
    properties = unit_beam(
        length=length, youngs_modulus=e, shear_modulus=g, mass_per_length=rho, area=area,
        second_moment_2=i2, second_moment_3=i3, torsion_constant=j, shear_ratio_2=1.2,
        shear_ratio_3=1.9, eccentricity_3=offset,
    )  # fmt: skip
    a1, a2, a3 = acceleration = np.array([0.3e-6, 0.2e-6, -0.5e-6])  # its stiffness is nothing
    base = research.PrescribedBase(
        velocity=lambda t: t * acceleration, acceleration=lambda t: acceleration
    )
    eq = equations(properties, base, research.Effects(), modes=40)
    _, K, F = eq.matrices(0.0)
    u2, u3, twist, s = eq._tip(np.linalg.solve(K, F))
    load = -rho * acceleration
    bending, shear = length**4 / 8.0, length**2 / 2.0
    expected = [
        load[1] * (bending / (e * i3) + shear * 1.2 / (g * area)),
        # the axial force acts off the axis: a moment per length about a2
        load[2] * (bending / (e * i2) + shear * 1.9 / (g * area))
        - load[0] * offset * length**3 / 3.0 / (e * i2),
        -load[1] * offset * shear / (g * j),
        load[0] * shear / (e * area),
    ]
    # moduli mixed up, or moments of the wrong sign, are off by ten per cent and more
    assert [u2, u3, twist, s] == pytest.approx(expected, rel=1e-3)
    assert 0.0 not in (a1, a2, a3)


def test_warping_held_at_the_root_stiffens_torsion() -> None:
    g, j, e, gamma, length = 1.0, 0.01, 2.6, 2e-3, 1.0
    properties = unit_beam(
        shear_modulus=g, torsion_constant=j, youngs_modulus=e, warping_constant=gamma,
        eccentricity_3=0.1,
    )  # fmt: skip
    rate = np.array([0.0, 1e-6, 0.0])
    base = research.PrescribedBase(velocity=lambda t: t * rate, acceleration=lambda t: rate)
    effects = research.Effects(in_plane=False, out_of_plane=False, extension=False)
    eq = equations(properties, base, effects, modes=20)
    _, K, F = eq.matrices(0.0)
    twist = eq._tip(np.linalg.solve(K, F))[2]
    # rate f of the twist: G J f - E Gamma f'' = m (L - x), f = 0 at the root, f' = 0 at the tip
    m, k = -1e-6 * 0.1, np.sqrt(g * j / (e * gamma))
    # f = A cosh kx + B sinh kx + m (L - x)/(G J); the load of the mass centre at +e3 is -rho a2
    A = m * length / (g * j)
    y = k * length
    B = (-m / (g * j * k) - A * np.sinh(y)) / np.cosh(y)
    closed = (A * np.sinh(y) + B * (np.cosh(y) - 1.0)) / k - m * length**2 / (2.0 * g * j)
    assert twist == pytest.approx(closed, rel=1e-4)
    assert twist < 0.4 * abs(m) * length**2 / (2.0 * g * j)  # what it is without warping


def spin_up_beam() -> research.BeamProperties:
    """The published beam of 10 that is spun up."""
    return research.BeamProperties(
        length=10.0, youngs_modulus=1.0, shear_modulus=1.0, mass_per_length=1.2, area=2.8e7,
        second_moment_2=1.4e4, second_moment_3=1.4e4, torsion_constant=1.4e4,
        shear_ratio_2=2.8, shear_ratio_3=2.8,
    )  # fmt: skip


def _plane(theory: str) -> research.MovingBaseBeam:
    still = research.constant_angle(0.0)
    base = research.manipulator_base(still, research.spin_up_angle(), still, link_1=0.0, link_2=0.0)
    return research.MovingBaseBeam(
        properties=spin_up_beam(), base=base, modes=6, elements=10,
        effects=research.effects_of(theory, without=("torsion", "out_of_plane")),
    )  # fmt: skip


def test_spin_up_follows_the_exact_beam_and_conventional_theory_diverges() -> None:
    options = ff.RunOptions(dt=0.02, t_end=20.0, quiet=True)
    history = simulate_equations(_plane("consistent"), options).history
    lag = history["u2"]
    for t, (_, u2) in REFERENCE.items():
        # linear in a deflection of 6 per cent of the length: off by 2e-3 of the length at most
        assert np.interp(t, history["t"], lag) == pytest.approx(u2, abs=0.01)
    assert lag.min() == pytest.approx(PEAK, rel=1e-2)
    after = history["t"] >= 15.0
    assert history["s"][after].mean() == pytest.approx(EXTENSION, rel=1e-3)
    short = ff.RunOptions(dt=0.02, t_end=10.0, quiet=True)
    wrong = simulate_equations(_plane("conventional"), short).history["u2"]
    assert wrong.min() < -10.0  # of a beam of length 10
    assert research.spin_up_angle()(7.0)[0] == pytest.approx(_angle(7.0))


def test_base_of_the_manipulator_moves_as_its_links_do() -> None:
    def wobble(a: float, b: float) -> Any:
        return lambda t: (
            a + b * np.sin(b * t), b * b * np.cos(b * t), -(b**3) * np.sin(b * t)
        )  # fmt: skip

    base = research.manipulator_base(
        wobble(0.3, 1.1), wobble(1.0, 0.7), wobble(2.0, -0.9), link_1=3.0, link_2=2.0
    )
    assert base.position is not None
    assert base.rotation is not None
    for t in (0.0, 0.7, 2.0):
        h = 1e-5
        R = np.asarray(base.rotation(t))
        dx = (np.asarray(base.position(t + h)) - base.position(t - h)) / (2 * h)
        dR = (np.asarray(base.rotation(t + h)) - base.rotation(t - h)) / (2 * h)
        W = R.T @ dR
        twist = base.twist(t)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert np.allclose(R.T @ dx, twist[:3], atol=1e-8)
        assert np.allclose([W[2, 1], W[0, 2], W[1, 0]], twist[3:], atol=1e-8)
        assert np.allclose((base.twist(t + h) - base.twist(t - h)) / (2 * h), base.rate(t))


def test_link_at_rest_vibrates_as_exact_elements_do() -> None:
    link = research.outboard_link()
    base = research.PrescribedBase(position=lambda t: (0, 0, 0), rotation=lambda t: np.eye(3))
    model = research.exact_model(link, base, elements=24, warping=False)
    exact = ff.find_modes(model, ff.ModeOptions(modes=6, frames=0, quiet=True)).history["frequency"]
    eq = equations(link, base, research.effects_of("consistent", without=["warping"]))
    modes = eq.basis.frequencies[:6] / (2.0 * np.pi)
    # two-node elements are 1 per cent stiff; without eccentricity the second is 2 per cent higher
    assert np.allclose(modes, exact, rtol=0.012)


def test_small_motion_is_that_of_exact_elements() -> None:
    """The first second and a half of the spin-up: twist 0.08 rad, acceleration off the axis."""
    still = research.constant_angle(0.0)
    base = research.manipulator_base(still, research.spin_up_angle(), still, link_1=0.0)
    link = research.outboard_link()
    options = ff.RunOptions(dt=0.02, t_end=1.5, quiet=True)
    exact = ff.simulate(research.exact_model(link, base, elements=12), options).history
    source = research.MovingBaseBeam(properties=link, base=base)
    linear = simulate_equations(source, options).history
    for name, tolerance in (("u2", 0.01), ("theta1", 0.08)):
        size = np.abs(exact[name]).max()
        assert np.abs(exact[name] - linear[name]).max() < tolerance * size
        assert size > 0.01


def test_deflected_beam_vibrates_with_modal_damping() -> None:
    """A base at rest: every function is a damped oscillator, closed form."""
    ratios = np.array([0.05, 0.02, 0.1, 0.1, 0.1])  # the last one given holds for the others
    given = {"damping_ratio": ratios[:3].tolist(), "velocity": {"theta1": 0.3}}
    eq = started({"u2": 0.1, "theta1": -0.2}, **given)
    q, v = eq.start()
    assert eq._tip(q)[:3] == pytest.approx([0.1, 0.0, -0.2])
    assert eq._tip(v)[:3] == pytest.approx([0.0, 0.0, 0.3])
    # bent by a force, 0.1 (3 x^2 - x^3)/2, but with one mode only; a straight line is 0.02 off
    shape = eq.basis.node_fields[1] @ q
    x = eq.basis.nodes
    assert np.allclose(shape, 0.05 * (3.0 * x**2 - x**3), atol=4e-3)
    source = research.MovingBaseBeam(
        properties=slender(), base=STILL, effects=research.Effects(out_of_plane=False), modes=3,
        elements=3, displacement={"u2": 0.1, "theta1": -0.2}, **given,
    )  # fmt: skip
    options = ff.RunOptions(dt=2e-3, t_end=2.0, rho_inf=1.0, quiet=True)
    history = simulate_equations(source, options).history
    w, t = eq.basis.frequencies, history["t"][:, None]
    damped = w * np.sqrt(1.0 - ratios**2)
    sine = (v + ratios * w * q) / damped
    motion = np.exp(-ratios * w * t) * (q * np.cos(damped * t) + sine * np.sin(damped * t))
    slow = w < 100.0  # others are at rest, or beyond the step
    for name, row in (("u2", 1), ("theta1", 3)):
        expected = motion[:, slow] @ eq.basis.node_fields[row, -1, slow]
        size = np.abs(expected).max()
        # undamped, or with the ratio of another function, it is tens of per cent off at the end
        assert np.abs(history[name] - expected).max() < 0.02 * size
        assert np.abs(expected[-100:]).max() > 0.05 * size


def test_displacement_as_a_function_is_projected() -> None:
    eq = started()
    d = np.array([0.3, -0.2, 0.1, 0.0, 0.01])
    fields = eq.basis.fields
    again = started(lambda x: fields @ d)
    assert np.allclose(again.start()[0], d, atol=1e-10)
    assert not again.start()[1].any()


def test_free_base_starts_with_a_deflected_beam() -> None:
    history = simulate_equations(
        free(0.0, displacement={"u2": 0.05}, velocity={"u3": 0.1}),
        ff.RunOptions(dt=5e-3, t_end=0.05, rho_inf=1.0, quiet=True),
    ).history
    assert history["u2"][0] == pytest.approx(0.05)
    assert history["u3"][1] == pytest.approx(0.1 * 5e-3, rel=0.1)
    # what the beam does, the base answers
    for name in ("px", "py", "pz"):
        assert np.abs(history[name] - history[name][0]).max() < 1e-3


def free(speed: float = 1.0, **changes: Any) -> research.MovingBaseBeam:
    """Satellite with a boom; ``speed`` multiplies its rotation."""
    properties = research.BeamProperties(
        length=2.0, youngs_modulus=1e4, shear_modulus=4e3, mass_per_length=0.5, area=0.02,
        second_moment_2=2e-4, second_moment_3=1e-4, torsion_constant=1e-4, eccentricity_3=0.02,
        shear_ratio_2=1.2, shear_ratio_3=1.2,
    )  # fmt: skip
    base = research.FreeBase(
        mass=3.0, inertia=(0.4, 0.5, 0.6), centre=(-0.2, 0.1, 0.05), velocity=(0.1, 0.2, -0.3),
        angular_velocity=speed * np.array([0.3, 0.4, 0.8]),
    )  # fmt: skip
    return research.MovingBaseBeam(
        **{"properties": properties, "base": base, "modes": 4, "elements": 6, **changes}
    )


def test_free_base_conserves_momentum_and_energy() -> None:
    drift = {}
    for dt in (0.02, 0.01):
        options = ff.RunOptions(dt=dt, t_end=1.6, rho_inf=1.0, tolerance=1e-10, quiet=True)
        history = simulate_equations(free(), options).history
        assert np.abs(history["u2"]).max() > 0.02
        names = ("px", "py", "pz", "lx", "ly", "lz", "energy")
        drift[dt] = {n: np.abs(history[n] - history[n][0]).max() for n in names}
        total = np.abs([history[n][0] for n in names]).max()
        # dropped terms of second order would be 1e-2 of the whole, and not shrink with the step
        assert max(drift[dt].values()) < 2e-3 * total
    ratio = np.array([drift[0.02][n] / drift[0.01][n] for n in drift[0.01]])
    assert (ratio > 3.0).all()


def test_summary_tells_of_a_beam_in_two_segments() -> None:
    """1 kg in the first half, 3 kg in the second: 4 kg, their centre 2.5 / 4 of the length."""
    mass = research.Piecewise((1.0, 2.0), (1.0, 3.0))
    properties = unit_beam(length=2.0, mass_per_length=mass)
    text = str(research.MovingBaseBeam(properties=properties, base=STILL))
    # one end or one segment too many or too few would be 1 or 3; without weights the centre is 1 m
    assert "length 2 m, segments: 2\n" in text
    assert "mass 4 kg, mass centre 1.25 m from the base\n" in text


def test_free_base_is_that_of_the_multibody_model() -> None:
    source = free(0.25, modes=10)
    base, properties = source.base, source.properties
    assert isinstance(base, research.FreeBase)
    start, count = np.asarray(base.velocity), 12
    omega = np.asarray(base.angular_velocity)
    points = np.zeros((count + 1, 3))
    points[:, 0] = np.linspace(0.0, properties.length, count + 1)
    cells = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    [segment] = research.segment_sections(properties)
    model = ff.Model("satellite", mesh=ff.LineMesh(points, cells, {"boom": np.arange(count)}))
    model.add(
        ff.RigidBody(
            "hub", base.mass, base.inertia, centre=base.centre, velocity=start,
            angular_velocity=omega,
        ),
        ff.Beam(
            "boom", segment.section, orientation=(0.0, 1.0, 0.0), velocity=start,
            angular_velocity=omega,
        ),
        ff.Rigid("clamp", ff.Marker("hub"), ff.Marker("boom", "start")),
        ff.Probe(
            "tip", [ff.Marker("hub"), ff.Marker("boom", "end")], ("u2", "u3"),
            lambda t, hub, tip: (hub.rotation.T @ (tip.position - hub.position))[1:],
        ),
        ff.PositionProbe("base", ff.Marker("hub")),
    )  # fmt: skip
    options = ff.RunOptions(dt=0.01, t_end=2.0, quiet=True)
    exact = ff.simulate(model, options).history
    linear = simulate_equations(source, options).history
    for name in ("u2", "u3", "base_x", "base_y", "base_z"):
        size = np.abs(exact[name]).max()
        # deflections of 0.6 per cent of the length; at full speed, 8.6 per cent, u2 is 5 per cent
        # off; without the base's reaction it is tens of per cent
        assert np.abs(exact[name] - linear[name]).max() < 0.01 * size, name


def slender() -> research.BeamProperties:
    """A beam that twists as easily as it bends."""
    return unit_beam(
        area=1e3, shear_modulus=10.0, torsion_constant=1e-3, second_moment_2=0.5,
        second_moment_3=1.0,
    )  # fmt: skip


def started(displacement: Any = None, **more: Any) -> PrescribedBaseEquations:
    """A beam that moves in its plane and twists."""
    given = {"effects": research.Effects(out_of_plane=False), "modes": 3, "elements": 3, **more}
    return equations(slender(), STILL, displacement=displacement, **given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: research.Piecewise((1.0, 0.5), (1.0, 2.0)), "ends must grow"),
        (lambda: research.Piecewise((1.0, 2.0), (1.0,)), "1 values for 2 ends"),
        (lambda: unit_beam(area=-1.0), "area must be > 0, got -1"),
        (lambda: unit_beam(shear_ratio_2=0.5), "shear_ratio_2 must be >= 1, got 0.5"),
        (lambda: unit_beam(area=research.Piecewise((0.5,), (1.0,))), "area ends at 0.5 m"),
        (lambda: unit_beam(area=lambda x: x[:2]), "area returns shape"),
        (lambda: research.effects_of("naive"), "theory 'naive': there are consistent, premature"),
        (
            lambda: research.effects_of("consistent", without=["shear", "sheer"]),
            "effect 'sheer': there",
        ),
        (
            lambda: research.Effects(rotations="euler"),
            "rotations must be one of sequence, vector, lin",
        ),
        (lambda: started(displacement={"u4": 1.0}), "displacement 'u4' of the tip: there are s, u"),
        (lambda: started(velocity={"u3": 1.0}), "velocity: the beam has no function of u3, got 1"),
        (lambda: started(displacement=lambda x: x), "displacement: six rows of finite numbers"),
        (
            lambda: started(displacement=lambda x: np.sin(40 * x) * np.ones((6, 1))),
            "per cent of it",
        ),
        (
            lambda: started({"u2": 0.1, "s": 0.1, "theta1": 0.1}, modes=1),
            "displacement: 3 functions cannot take u2, ",
        ),
        (lambda: started(damping_ratio=[0.1] * 9), "damping_ratio: 9 ratios for 5 functions"),
        (lambda: started(damping_ratio=[0.1, -0.1]), "damping_ratio must not be negative"),
        (
            lambda: started(effects=research.effects_of("conventional")),
            "without section_inertia .* functions move the axis in fewer ways",
        ),
        (
            lambda: research.beam_by_theory(
                unit_beam(),
                STILL,
                "beam",
                theory="beam",
                elements=4,
                assumed_modes=3,
                bodies=1,
                body_modes=0,
                warping=True,
                damping_ratio=0.1,
            ),
            "theory 'beam': damping_ratio is for assumed modes, got 0.1",
        ),
        (
            lambda: research.PrescribedBase(angular_velocity=lambda t: (0.0, 0.0, t)),
            "angular_acceleration is not the rate of angular_velocity",
        ),
        (lambda: research.FreeBase(mass=-1.0, inertia=(1, 1, 1)), "mass must be positive"),
        (
            lambda: research.FreeBase(mass=1.0, inertia=(1, 1, -1)),
            "inertia must be symmetric and pos",
        ),
        (
            lambda: research.MovingBaseBeam(properties=unit_beam(), base=STILL, modes=0).validate(),
            "modes must be at least 1, got 0",
        ),
        (
            lambda: research.MovingBaseBeam(
                properties=unit_beam(), base=STILL, modes=999, elements=3
            ).equations(),
            "modes 999: 3 elements have no more than",
        ),
        (lambda: research.exact_model(unit_beam(), STILL), "needs position and rotation"),
        (
            lambda: research.segment_sections(unit_beam(area=lambda x: 1.0 + x)),
            "area is a function",
        ),
    ],
)
def test_mistakes_are_named(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        make()
    assert_on_page(str(raised.value))
