# SPDX-License-Identifier: LGPL-3.0-or-later
"""Systems with several cables: a tensegrity, a robot on cables, belts; other formulations."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, null_space
from scipy.optimize import root
from scipy.spatial.transform import Rotation

import flexfem as ff
from tests.histories import columns

G = 9.81
STIFFNESS, MASS = 1e4, 2.0


def corner(k: int, angle: float, z: float) -> np.ndarray:
    """Corner k of a triangle about the z axis."""
    at = 2.0 * np.pi * k / 3.0 + angle
    return np.array([np.cos(at), np.sin(at), z])


#: Ends of the cables of a prism: bottom corners 0 to 2, top corners 3 to 5.
PRISM = [
    *((k, (k + 1) % 3) for k in range(3)), *((3 + k, 3 + (k + 1) % 3) for k in range(3)),
    *(((k + 1) % 3, 3 + k) for k in range(3)),
]  # fmt: skip


def prism(points: np.ndarray, rests: np.ndarray) -> ff.Model:
    """Three struts from bottom corners k to top corners 3 + k, and nine cables."""
    model = ff.Model("prism")
    for k in range(3):
        arm = points[3 + k] - points[k]
        inertia = MASS / 12.0 * (arm @ arm * np.eye(3) - np.outer(arm, arm)) + 1e-3 * np.eye(3)
        model.add(
            ff.RigidBody(f"strut{k}", MASS, inertia, position=0.5 * (points[k] + points[3 + k]))
        )
    ends = [
        ff.Marker(f"strut{k % 3}", offset=(k // 3 - 0.5) * (points[3 + k % 3] - points[k % 3]))
        for k in range(6)
    ]
    for n, ((i, j), rest) in enumerate(zip(PRISM, rests, strict=True)):
        path = [ends[i], ends[j]]
        model.add(ff.Cable(f"cable{n}", path, axial_stiffness=STIFFNESS, rest_length=rest))
    for k, end in enumerate(ends):
        model.add(ff.PositionProbe(f"p{k}", end))
    return model


@pytest.mark.three_ranks
def test_a_tensegrity_prism_finds_its_twist() -> None:
    """Top and bottom of a prism of three struts are twisted by 30 degrees, whatever its cables.

    Tibert and Pellegrino (2003), "Review of form-finding methods for tensegrity structures": the
    angle is 90 degrees less 180 over the number of struts.
    """
    angle = np.deg2rad(140.0)
    points = np.array([*(corner(k, 0.0, 0.0) for k in range(3)),
                       *(corner(k, angle, 1.5) for k in range(3))])  # fmt: skip
    model = prism(points, np.repeat([1.3, 1.2, 1.4], 3))
    options = ff.RelaxationOptions(tolerance=1e-10, step_tolerance=1e-10, quiet=True)
    outcome = ff.relax(model, options)
    assert outcome.status == "ok"
    found = columns(outcome)
    at = np.array([[found[f"p{k}_{c}"][-1] for c in "xyz"] for k in range(6)])
    axis = np.cross(at[1] - at[0], at[2] - at[0])
    axis /= np.linalg.norm(axis)
    top, bottom = at[3] - at[3:].mean(axis=0), at[1] - at[:3].mean(axis=0)
    twist = np.arctan2(np.cross(bottom, top) @ axis, bottom @ top)
    # forces are in balance to 1e-10, and soft against twist; the start is ten degrees off
    assert np.rad2deg(twist) == pytest.approx(30.0, abs=1e-6)


@pytest.mark.parametrize("prestress", [40.0, 160.0])
def test_modes_of_a_prestressed_prism(prestress: float) -> None:
    """Against a truss of six points, whose struts are constraints between them.

    Without prestress the prism has a mechanism, a twist without first-order stretch.
    """
    angle = np.deg2rad(150.0)
    points = np.array([*(corner(k, 0.0, 0.0) for k in range(3)),
                       *(corner(k, angle, 1.5) for k in range(3))])  # fmt: skip
    bars = np.array([*PRISM, *((k, 3 + k) for k in range(3))])
    arms = points[bars[:, 1]] - points[bars[:, 0]]
    # force densities q with sum q (x_j - x_i) = 0 at every corner
    balance = np.zeros((18, 12))
    for n, (i, j) in enumerate(bars):
        balance[3 * i : 3 * i + 3, n] += arms[n]
        balance[3 * j : 3 * j + 3, n] -= arms[n]
    (density,) = null_space(balance, rcond=1e-10).T
    lengths = np.linalg.norm(arms, axis=1)
    density *= prestress / (density[8] * lengths[8])
    tension = density * lengths
    rests = lengths[:9] / (1.0 + tension[:9] / STIFFNESS)
    found = ff.find_modes(prism(points, rests), ff.ModeOptions(modes=18, quiet=True))
    K, M = np.zeros((18, 18)), np.zeros((18, 18))
    for n, (i, j) in enumerate(bars):
        along = np.outer(arms[n], arms[n]) / lengths[n] ** 2
        k = density[n] * (np.eye(3) - along)
        if n < 9:
            k += STIFFNESS / rests[n] * along
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * k
            if n >= 9:
                M[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += MASS / 6.0 * (1 + (a == b)) * np.eye(3)
    free = null_space(balance[:, 9:].T)
    squares = eigh(free.T @ K @ free, free.T @ M @ free, eigvals_only=True)[6:]
    if found.history:
        own = np.sort(found.history["frequency"])[-9:]
        exact = np.sqrt(squares) / (2.0 * np.pi)
        # the struts' own inertia of 1e-3 kg m^2 is 0.06 % of theirs; without prestress the lowest
        # frequency is zero
        np.testing.assert_allclose(own, exact, rtol=1e-3)


SIDE = 0.3


def robot(rest: Any) -> ff.Model:
    """A platform on eight cables from the corners of a room, which winches there haul."""
    model = ff.Model("robot")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("platform", 10.0, (0.2, 0.2, 0.2), position=(0.1, 0.2, 0.0)),
        ff.PositionProbe("at", ff.Marker("platform")),
        ff.PositionProbe("edge", ff.Marker("platform", offset=(1.0, 0.0, 0.0))),
    )
    for k, (winch, corner) in enumerate(zip(WINCHES, CORNERS, strict=True)):
        path = [ff.Ground(winch - [0.0, 0.0, 0.5]), ff.Eyelet(ff.Ground(winch)),
                ff.Marker("platform", offset=corner)]  # fmt: skip
        model.add(ff.Cable(f"cable{k}", path, axial_stiffness=2e4, rest_length=rest(k)))
    return model


_SIGNS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
WINCHES = _SIGNS * [2.0, 1.5, 1.2]
#: Crossed, so that cables also hold the platform against rotations.
CORNERS = _SIGNS * [1.0, 1.0, -1.0] * SIDE


def test_a_robot_on_cables_stands_where_its_forces_balance() -> None:
    """Against six equations of balance of a platform on eight springs, solved by SciPy."""
    start, change = np.array([0.1, 0.2, 0.0]), np.array([0.3, -0.25, 0.2])

    def length(k: int, where: np.ndarray) -> float:
        return 0.5 + float(np.linalg.norm(WINCHES[k] - where - CORNERS[k]))

    def rests(k: int) -> Any:
        first, last = 0.99 * length(k, start), 0.99 * length(k, start + change)
        return lambda t: first + t * (last - first)

    options = ff.StaticOptions(load_steps=4, gravity_load="constant", quiet=True)
    found = columns(ff.solve_static(robot(rests), options))

    def balance(y: np.ndarray) -> np.ndarray:
        force, moment = np.array([0.0, 0.0, -10.0 * G]), np.zeros(3)
        for k in range(8):
            arm = Rotation.from_rotvec(y[3:]).apply(CORNERS[k])
            gap = WINCHES[k] - y[:3] - arm
            apart, rest = np.linalg.norm(gap), rests(k)(1.0)
            pull = 2e4 * max(apart + 0.5 - rest, 0.0) / rest * gap / apart
            force, moment = force + pull, moment + np.cross(arm, pull)
        return np.concatenate([force, moment])

    exact = root(balance, [*(start + change), 0.0, 0.0, 0.0], tol=1e-12).x
    edge = exact[:3] + Rotation.from_rotvec(exact[3:]).as_matrix()[:, 0]
    for k, c in enumerate("xyz"):
        # balance to 1e-9 of the forces; the stretch under gravity alone moves it by 1e-3 m
        assert found[f"at_{c}"][-1] == pytest.approx(exact[k], abs=1e-8)
        assert found[f"edge_{c}"][-1] == pytest.approx(edge[k], abs=1e-8)
    assert np.linalg.norm(exact[:3] - start - change) > 1e-3


R1, R2, APART = 0.1, 0.25, 0.8


def belt(sense: float = 1.0, **given: Any) -> ff.Model:
    """Two wheels on fixed bearings and a belt around them, open or crossed (``sense`` -1)."""
    model = ff.Model("belt")
    speed = given.pop("speed", 0.0)
    for name, x, spin in (("one", 0.0, speed), ("two", APART, sense * speed * R1 / R2)):
        centre = (x, 0.0, 0.0)
        model.add(
            ff.RigidBody(name, 1.0, (0.02,) * 3, position=centre, angular_velocity=(0, 0, spin)),
            ff.Revolute(f"bearing_{name}", ff.Ground(centre), ff.Marker(name)),
        )
    path = [ff.Sheave(ff.Marker("one"), R1, grip=True),
            ff.Sheave(ff.Marker("two"), R2, (0.0, 0.0, sense), grip=True)]  # fmt: skip
    model.add(
        ff.Cable("belt", path, closed=True, **({"axial_stiffness": 2e4} | given)),
        ff.CableProbe("there", "belt"),
        ff.CableProbe("back", "belt", part=1),
        ff.Probe("turn", (ff.Marker("one"), ff.Marker("two")), ("one", "two"), _turns,
                 unwrap=("one", "two")),
    )  # fmt: skip
    return model


def _turns(t: float, one: ff.MarkerState, two: ff.MarkerState) -> tuple[float, ...]:
    return tuple(np.arctan2(state.turn[1, 0], state.turn[0, 0]) for state in (one, two))


@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["open", "crossed"])
@pytest.mark.parametrize("moment", [20.0, 60.0], ids=["taut", "slack"])
def test_a_belt_that_carries_a_moment(sense: float, moment: float) -> None:
    """Tight and slack side: preload and half of ``M / r`` more and less, or one side alone."""
    preload, k = 100.0, np.sqrt(APART**2 - (R2 - sense * R1) ** 2)
    model = belt(sense, preload=preload)
    model.add(
        ff.PrescribedAngle("hold", ff.Ground(), ff.Marker("one"), angle=lambda t: 0.0),
        ff.PointMoment("load", ff.Marker("two"), (0.0, 0.0, sense * moment)),
    )
    found = columns(ff.solve_static(model, ff.StaticOptions(load_steps=4, quiet=True)))
    pull, rest = moment / R2, k / (1.0 + preload / 2e4)
    slack = pull > 2.0 * preload
    tight = pull if slack else preload + 0.5 * pull
    # the wheel turns with the cable's sense: the part that leaves it becomes slack
    assert found["there_tension"][-1] == pytest.approx(tight, rel=1e-9)
    assert found["back_tension"][-1] == pytest.approx(tight - pull, abs=1e-6)
    turn = (tight - preload) / (2e4 / rest) / R2
    assert abs(found["two"][-1]) == pytest.approx(turn, rel=1e-8)


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "sense",
    [pytest.param(1.0, id="open", marks=pytest.mark.serial), pytest.param(-1.0, id="crossed")],
)
def test_a_belt_keeps_the_ratio_over_turns(sense: float) -> None:
    """Wheels that start at speeds in the ratio of their radii keep them, and the preload."""
    model = belt(sense, preload=100.0, speed=40.0)
    options = ff.RunOptions(dt=2e-3, t_end=0.8, quiet=True)
    outcome = ff.simulate(model, options)
    assert not [text for text in outcome.summary["warnings"] if "Cable" in text]
    found = columns(outcome)
    np.testing.assert_allclose(found["one"], 40.0 * found["t"], atol=1e-9)
    np.testing.assert_allclose(found["two"], sense * 16.0 * found["t"], atol=1e-9)
    # an angle that loses a turn stretches the belt by 0.6 m
    np.testing.assert_allclose(found["there_tension"], 100.0, atol=1e-7)
    np.testing.assert_allclose(found["back_tension"], 100.0, atol=1e-7)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_a_restart_knows_the_turns_of_a_belt(shared_tmp_path: Any) -> None:
    """After five turns; a restart that counts from zero again would tear the belt."""
    run = {"dt": 2e-3, "quiet": True, "output": shared_tmp_path, "checkpoint_every": 400}
    first = ff.simulate(belt(preload=100.0, speed=40.0), ff.RunOptions(t_end=0.8, **run))
    assert first.status == "ok"
    file = shared_tmp_path / "checkpoint_000400.h5"
    again = ff.RunOptions(**(run | {"t_end": 1.0, "restart": file}))
    found = columns(ff.simulate(belt(preload=100.0, speed=40.0), again))
    np.testing.assert_allclose(found["there_tension"], 100.0, atol=1e-7)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["open", "crossed"])
def test_a_chain_is_a_belt_that_does_not_stretch(sense: float) -> None:
    """Its wheels turn as one inertia, ``I (1 + (r1 / r2)^2)``; one of its parts is redundant."""
    model = belt(sense, axial_stiffness=None, tension_only=False)
    model.add(ff.PointMoment("drive", ff.Marker("one"), (0.0, 0.0, 5.0)))
    options = ff.RunOptions(dt=2e-3, t_end=0.3, redundant_constraints="least_norm", quiet=True)
    found = columns(ff.simulate(model, options))
    ratio = R1 / R2
    turn = 0.5 * 5.0 / (0.02 * (1.0 + ratio**2)) * found["t"] ** 2
    # round-off and the compliance of redundant rows; a slip of a hundredth is 0.1 rad
    np.testing.assert_allclose(found["one"], turn, atol=1e-6)
    np.testing.assert_allclose(found["two"], sense * ratio * turn, atol=1e-6)


def hung(length: float, stiffness: float, weight: float = 20.0, mass: float = 30.0) -> ff.Model:
    """A body on two hanging cables of different lengths from a ceiling."""
    model = ff.Model("hung")
    ends = [ff.Ground((0.0, 0.0, 0.0)), ff.Ground((8.0, 1.0, 2.0))]
    body = ff.Marker("body")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("body", mass, (0.5,) * 3, position=(3.0, 0.4, -4.0)),
        ff.PrescribedRotation("upright", ff.Ground(), body, rotation=lambda t: np.zeros(3)),
        ff.PositionProbe("at", body),
        ff.EnergyProbe(),
    )
    for k, end in enumerate(ends):
        model.add(
            ff.Catenary(f"line{k}", end, body, length + k, weight, stiffness),
            ff.ReactionProbe(f"pull{k}", f"line{k}"),
        )
    return model


def end_force(a: np.ndarray, b: np.ndarray, length: float, w: float, EA: float) -> np.ndarray:
    """Force on the end b of a hanging cable: integral of its slope from b to a, found by SciPy."""
    flat = b[:2] - a[:2]
    span, rise = float(np.hypot(*flat)), b[2] - a[2]
    s = np.linspace(0.0, length, 20001)

    def gap(y: np.ndarray) -> np.ndarray:
        H, V = y
        T = np.sqrt(H**2 + (V - w * s) ** 2)
        factor = 1.0 / T + 1.0 / EA
        return np.array([np.trapezoid(H * factor, s) - span,
                         np.trapezoid((V - w * s) * factor, s) - rise])  # fmt: skip

    H, V = root(gap, [w * span, w * length], tol=1e-13).x
    return np.array([*(-H * flat / span), -V])


@pytest.mark.parametrize(
    ("length", "stiffness"), [(6.5, 1e6), (6.5, 3e3), (4.9, 3e3)], ids=["slack", "soft", "taut"]
)
def test_a_body_that_hangs_on_two_cables_with_weight(length: float, stiffness: float) -> None:
    """Equilibrium with end forces from the integrals along the cables, by the trapezoidal rule."""
    options = ff.StaticOptions(load_steps=1, gravity_load="constant", quiet=True)
    found = columns(ff.solve_static(hung(length, stiffness), options))
    at = np.array([found[f"at_{c}"][-1] for c in "xyz"])
    total = np.array([0.0, 0.0, -30.0 * G])
    for k, end in enumerate(np.array([[0.0, 0.0, 0.0], [8.0, 1.0, 2.0]])):
        force = end_force(end, at, length + k, 20.0, stiffness)
        pull = np.array([found[f"pull{k}_f{c}"][-1] for c in "xyz"])
        # the integrals are good to 1e-6 N; half of a cable's weight at the wrong end is 70 N
        np.testing.assert_allclose(pull, force, atol=1e-4)
        total += force
    np.testing.assert_allclose(total, 0.0, atol=2e-4)


def test_a_hanging_cable_of_the_closed_form() -> None:
    """Sag ``H/w (cosh(w l / 2 H) - 1)`` of one that hardly stretches, as length and force."""
    H, w, span = 50.0, 20.0, 4.0
    half = w * span / (2.0 * H)
    model = ff.Model("catenary")
    model.add(
        ff.RigidBody("end", 1.0, (0.5,) * 3, position=(span, 0.0, 0.0)),
        ff.Rigid("hold", ff.Ground((span, 0.0, 0.0)), ff.Marker("end")),
        ff.Catenary("line", ff.Ground(), ff.Marker("end"), 2.0 * H / w * np.sinh(half), w, 1e12),
        ff.ReactionProbe("pull", "line"),
        ff.EnergyProbe(),
    )
    found = columns(ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True)))
    assert -found["pull_fx"][-1] == pytest.approx(H, rel=1e-8)
    assert -found["pull_fz"][-1] == pytest.approx(H * np.sinh(half), rel=1e-8)
    # weight times the depth of its centre: integral of w (H/w) (cosh(half) - cosh(w x / H)) ds
    depth = H**2 / w * (np.sinh(half) * np.cosh(half) - half)
    assert found["energy_strain"][-1] == pytest.approx(-depth, rel=1e-7)


def test_a_body_swings_on_hanging_cables() -> None:
    """Energy stays, and modes at rest are those of differences of the end forces."""
    model = hung(6.5, 3e3)
    options = ff.RunOptions(dt=5e-3, t_end=1.5, rho_inf=1.0, quiet=True)
    found = columns(ff.simulate(model, options))
    assert np.ptp(found["at_z"]) > 0.1
    # of second order in the step; an end force that is not the derivative of the energy shows as
    # percent
    assert np.ptp(found["energy_balance"]) < 1e-3 * np.ptp(found["energy_strain"])


TEETH = {"stiffness": 400.0, "damping": 0.8, "backlash": 0.02}


@pytest.mark.serial
def test_gears_rattle_in_their_play() -> None:
    """A shaken gear pair with elastic teeth and backlash, against SciPy."""
    one, two, ratio = 0.05, 0.2, -0.5
    model = ff.Model("rattle")
    for name, inertia, x in (("one", one, 0.0), ("two", two, 0.3)):
        place = (x, 0.0, 0.0)
        model.add(
            ff.RigidBody(name, 1.0, (inertia,) * 3, position=place),
            ff.Revolute(f"bearing_{name}", ff.Ground(place), ff.Marker(name)),
        )
    here = ff.Ground()
    model.add(
        ff.Gear("gear", here, ff.Marker("one"), here, ff.Marker("two"), ratio=ratio, **TEETH),
        ff.PointMoment(
            "shake", ff.Marker("one"), (0.0, 0.0, 2.0), amplitude=lambda t: np.sin(30.0 * t)
        ),
        ff.PointMoment("brake", ff.Marker("two"), (0.0, 0.0, 0.3)),
        ff.Probe("turn", (ff.Marker("one"), ff.Marker("two")), ("one", "two"), _turns,
                 unwrap=("one", "two")),
        ff.EnergyProbe(),
    )  # fmt: skip
    found = columns(ff.simulate(model, ff.RunOptions(dt=5e-4, t_end=0.6, quiet=True)))

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y[1] - ratio * y[0], y[3] - ratio * y[2]
        depth = abs(x) - 0.5 * TEETH["backlash"]
        force = 0.0
        if depth > 0.0:
            k, c = TEETH["stiffness"], TEETH["damping"]
            force = np.sign(x) * k * depth * (1.0 + np.tanh(np.sign(x) * c * v / (k * depth)))
        shake = 2.0 * np.sin(30.0 * t)
        return np.array([y[2], y[3], (shake + ratio * force) / one, (0.3 - force) / two])

    exact = solve_ivp(rates, (0.0, 0.6), np.zeros(4), t_eval=found["t"], rtol=1e-9, atol=1e-11,
                      max_step=1e-3).y  # fmt: skip
    gap = found["two"] - ratio * found["one"]
    assert (np.diff(np.sign(gap)) != 0.0).sum() > 5
    # of second order between impacts: 2e-5 rad; a twentieth less play, or an eighth less damping,
    # shows as 2e-3 rad
    np.testing.assert_allclose(found["one"], exact[0], atol=1e-4)
    np.testing.assert_allclose(found["two"], exact[1], atol=1e-4)
