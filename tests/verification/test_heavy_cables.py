# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables with mass against closed forms, balances and chains of bodies."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.histories import columns
from tests.unit.refusals import assert_on_page

G = 9.81
SMALL = (0.01, 0.01, 0.01)
MU = 1.5


def run(model: ff.Model, dt: float, t_end: float, **given: Any) -> Mapping[str, np.ndarray]:
    """History of a motion."""
    return columns(ff.simulate(model, ff.RunOptions(dt=dt, t_end=t_end, quiet=True, **given)))


def model_of(*things: Any) -> ff.Model:
    """A model under gravity with its energies."""
    model = ff.Model("heavy")
    model.add(ff.Gravity((0.0, 0.0, -G)), *things, ff.EnergyProbe())
    return model


def balanced(history: Mapping[str, np.ndarray], part: float) -> None:
    """Check that the balance of the energies is small."""
    size = np.abs(history["energy_kinetic"]).max()
    assert np.abs(history["energy_balance"]).max() < part * size


M1, M2, RADIUS, DEEP = 3.0, 2.0, 0.2, 2.0


def atwood(**cable: Any) -> ff.Model:
    """Two masses on a heavy cable over a sheave."""
    sheave = ff.Sheave(ff.Ground(), RADIUS, (0.0, 1.0, 0.0))
    path = [ff.Marker("heavy"), sheave, ff.Marker("light")]
    return model_of(
        ff.RigidBody("heavy", M1, SMALL, position=(-RADIUS, 0.0, -DEEP)),
        ff.RigidBody("light", M2, SMALL, position=(RADIUS, 0.0, -DEEP)),
        ff.Cable("cable", path, mass_per_length=MU, tension_only=False, **cable),
        ff.PositionProbe("at", ff.Marker("heavy")),
        ff.CableProbe("pull", "cable"),
    )


@pytest.mark.serial
@pytest.mark.parametrize("integrator", ["generalized_alpha", "stabilized_index2"])
def test_atwoods_machine_with_a_heavy_rope(integrator: str) -> None:
    """(m1 + m2 + mu L) x'' = (m1 - m2 + 2 mu x) g, with what lies on the sheave in L."""
    history = run(atwood(), 8e-3, 0.8, integrator=integrator)
    whole = M1 + M2 + MU * (2.0 * DEEP + np.pi * RADIUS)
    rate, x0 = np.sqrt(2.0 * MU * G / whole), (M1 - M2) / (2.0 * MU)
    exact = -DEEP - x0 * (np.cosh(0.8 * rate) - 1.0)
    # second order in the step, 9e-6 m here; the sheave's share of the mass alone is 3e-2 m
    assert history["at_z"][-1] == pytest.approx(exact, abs=2e-5)
    balanced(history, 1e-6)


def lines_of(q: np.ndarray) -> tuple[list[Any], list[Any]]:
    """Starts and lines of a cable in a plane, from a point over a sheave, an eyelet, to a point.

    Args:
        q: (6,) coordinates of the three points, which may be complex; the sheave is at the origin.

    Returns:
        Straight parts and the arc, as functions of the arc length in them; their lengths.
    """
    a, eyelet, b = q.reshape(3, 2)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # t x y in the plane of x and z
    lines = []
    for D, sign in ((-a, 1.0), (eyelet, -1.0)):
        length = np.sqrt(D @ D - RADIUS**2)
        lines.append((length * D + sign * RADIUS * (turn @ D)) / (D @ D))
    last = b - eyelet
    lengths = [np.sqrt(a @ a - RADIUS**2), 0.0, np.sqrt(eyelet @ eyelet - RADIUS**2)]
    lengths.append(np.sqrt(last @ last))
    one, two = turn @ lines[0], turn @ lines[1]
    angle = -1j * np.log(one @ two + 1j * (one[1] * two[0] - one[0] * two[1]))
    lengths[1] = RADIUS * (angle if np.iscomplexobj(q) else angle.real)

    def around(s: Any) -> np.ndarray:
        c, i = np.cos(s / RADIUS), np.sin(s / RADIUS)
        return RADIUS * np.array([c * one[0] + i * one[1], c * one[1] - i * one[0]])

    courses = [
        lambda s: a + s * lines[0],
        around,
        lambda s: RADIUS * two + s * lines[1],
        lambda s: eyelet + s / lengths[3] * last,
    ]
    return courses, lengths


def material(q: np.ndarray, points: list[tuple[int, float]], rest: float) -> np.ndarray:
    """Places (n, 2) of material at rest lengths along a cable of one stretch, each in its part."""
    courses, lengths = lines_of(q)
    stretch, before = sum(lengths) / rest, np.cumsum([0.0, *lengths])
    return np.array([courses[n](stretch * s - before[n]) for n, s in points])


POINTS = np.array([[-1.0, -1.0], [0.8, -0.3], [1.2, -1.8]])
RATES = np.array([[0.7, -0.4], [-1.1, 0.9], [0.3, 2.0]])
MASSES, REST, STIFF = np.array([2.0, 1.0, 3.0]), 3.9, 5e3


@pytest.mark.serial
def test_accelerations_are_those_of_the_material() -> None:
    """d'Alembert's principle for 18 points of an explicit map from material to places.

    The map is differentiated numerically, at fixed material: in steps of 1e-7 i, and twice along
    the motion. Ends and eyelet are free. What passes the eyelet changes its direction at once: the
    eyelet gives it that momentum.
    """
    model = model_of()
    for name, place, rate, mass in zip("aeb", POINTS, RATES, MASSES, strict=True):
        at, speed = (place[0], 0.0, place[1]), (rate[0], 0.0, rate[1])
        model.add(
            ff.RigidBody(name, mass, SMALL, position=at, velocity=speed),
            ff.Probe(f"a{name}", ff.Marker(name), (f"{name}x", f"{name}z"),
                     lambda t, own: (own.acceleration[0], own.acceleration[2])),
        )  # fmt: skip
    guides = [ff.Sheave(ff.Ground(), RADIUS, (0.0, 1.0, 0.0)), ff.Eyelet(ff.Marker("e"))]
    model.add(
        ff.Cable("cable", [ff.Marker("a"), *guides, ff.Marker("b")], mass_per_length=MU,
                 axial_stiffness=STIFF, rest_length=REST),
    )  # fmt: skip
    history = run(model, 1e-4, 1e-4)
    found = np.array([history[f"{name}{c}"][0] for name in "aeb" for c in "xz"])
    q, v = POINTS.ravel(), RATES.ravel()
    lengths = np.array(lines_of(q)[1])
    at, weights = np.polynomial.legendre.leggauss(6)
    points, masses, before = [], [], np.cumsum([0.0, *lengths])
    for n in range(4):
        for x, w in zip(at, weights, strict=True):
            points.append((n, (before[n] + 0.5 * (1.0 + x) * lengths[n]) * REST / lengths.sum()))
            masses.append(0.5 * w * lengths[n] * MU * REST / lengths.sum())
    J = np.array([
        material(q + 1e-7j * unit, points, REST).imag / 1e-7 for unit in np.eye(6)
    ])  # fmt: skip
    places = [material(q + e * v, points, REST) for e in (-1e-4, 0.0, 1e-4)]
    curved = (places[0] - 2.0 * places[1] + places[2]) / 1e-8
    pull = STIFF * (lengths.sum() / REST - 1.0)
    longer = np.array([sum(lines_of(q + 1e-7j * unit)[1]).imag / 1e-7 for unit in np.eye(6)])
    weight, own = np.array([0.0, -G]), np.repeat(MASSES, 2)
    M = np.diag(own) + np.einsum("ink,jnk,n->ij", J, J, masses)
    forces = own * np.tile(weight, 3) - pull * longer
    forces += np.einsum("ink,nk,n->i", J, weight - curved, masses)

    def at_eyelet(q: np.ndarray) -> Any:
        """Arc length of the material that is at the eyelet now, less that of the eyelet."""
        moved = np.array(lines_of(q)[1])
        return before[3] / lengths.sum() * moved.sum() - moved[:3].sum()

    flow = at_eyelet(q + 1e-7j * v).imag / 1e-7
    ahead, into = (POINTS[2] - POINTS[1]) / lengths[3], lines_of(q)[0][2]
    behind = into(1.0) - into(0.0)
    forces[2:4] -= MU * REST / lengths.sum() * flow**2 * (ahead - behind)
    exact = np.linalg.solve(M, forces)
    # differences leave 1e-6; terms with the square of the flow are parts of 1e-2
    np.testing.assert_allclose(found, exact, atol=2e-5 * np.abs(exact).max())


@pytest.mark.serial
def test_a_rope_slides_off_a_table() -> None:
    """``mu l x'' = mu g x`` through an eyelet at the edge, with little masses at the ends."""
    along, down, little = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1e-3
    behind, below = (-1.5, 0.0, 0.0), (0.0, 0.0, -0.5)
    ends = [ff.Marker("end"), ff.Eyelet(ff.Ground()), ff.Marker("tip")]
    model = model_of(
        ff.RigidBody("end", little, SMALL, position=behind),
        ff.RigidBody("tip", little, SMALL, position=below),
        ff.Prismatic("table", ff.Ground(behind), ff.Marker("end"), axis=along),
        ff.Prismatic("edge", ff.Ground(below), ff.Marker("tip"), axis=down),
        ff.Cable("rope", ends, mass_per_length=MU, tension_only=False),
        ff.PositionProbe("at", ff.Marker("tip")),
    )
    history = run(model, 2e-3, 0.4)
    more = little / MU
    rate = np.sqrt(G * MU / (2.0 * MU + 2.0 * little))
    exact = more - (0.5 + more) * np.cosh(0.4 * rate)
    # second order, 6e-7 m; without the flow through the eyelet the rope is half as heavy
    assert history["at_z"][-1] == pytest.approx(exact, abs=2e-6)
    balanced(history, 1e-6)


LOAD, LONG, STIFFNESS = 5.0, 3.0, 1e4


def hanging(**cable: Any) -> ff.Model:
    """A load on a heavy cable, which does not turn."""
    given = {"axial_stiffness": STIFFNESS, "mass_per_length": MU} | cable
    return model_of(
        ff.RigidBody("load", LOAD, SMALL, position=(0.0, 0.0, -LONG)),
        ff.PrescribedRotation(
            "upright", ff.Ground(), ff.Marker("load"), rotation=lambda t: (0.0, 0.0, 0.0)
        ),
        ff.Cable("rope", [ff.Ground(), ff.Marker("load")], **given),
        ff.PositionProbe("at", ff.Marker("load")),
        ff.CableProbe("pull", "rope"),
        ff.ReactionProbe("hold", "rope"),
    )


@pytest.mark.serial
def test_equilibrium_and_modes_of_a_hanging_load() -> None:
    """Half of the rope's weight stretches it; a third of its mass moves with the load."""
    pull = (LOAD + 0.5 * MU * LONG) * G
    model = hanging(preload=pull)
    rest = LONG / (1.0 + pull / STIFFNESS)
    half, third = LOAD + 0.5 * MU * rest, LOAD + MU * rest / 3.0
    long = rest * (1.0 + half * G / STIFFNESS)
    options = ff.StaticOptions(load_steps=1, gravity_load="constant", quiet=True)
    found = ff.solve_static(model, options).history
    # Newton's tolerance; the preload is that of a rope that is 1 % heavier
    assert found["at_z"][-1] == pytest.approx(-long, abs=1e-9)
    assert found["pull_tension"][-1] == pytest.approx(half * G, rel=1e-8)
    # without the weight of the rope, of which the ground holds the other half
    assert found["hold_fz"][-1] == pytest.approx(LOAD * G, rel=1e-8)
    modes = ff.find_modes(model, ff.ModeOptions(modes=3, start="equilibrium", quiet=True))
    swing, stretch = half * G / long / third, STIFFNESS / rest / third
    exact = np.sqrt([swing, swing, stretch]) / (2.0 * np.pi)
    # differences of the weight and the little mass of matrices leave 1e-8
    np.testing.assert_allclose(modes.history["frequency"], exact, rtol=1e-7)
    linear = ff.linearize(model, ff.LinearOptions(modes=3, start="equilibrium", quiet=True))
    own = np.sort(np.abs(np.linalg.eigvals(linear.A).imag))[::2] / (2.0 * np.pi)
    np.testing.assert_allclose(own[-3:], exact, rtol=1e-7)


@pytest.mark.serial
def test_a_heavy_rope_swings_like_a_rod() -> None:
    """Rotation about its end, with the velocities of the start; inertia mu l^3/3 + m l^2."""
    model, spin = model_of(), 1.2
    model.add(
        ff.RigidBody("bob", 0.1, (1e-6,) * 3, position=(LONG, 0.0, 0.0),
                     velocity=(0.0, spin * LONG, 0.0)),
        ff.Cable("rope", [ff.Ground(), ff.Marker("bob")], mass_per_length=MU, tension_only=False),
        ff.MomentumProbe("p"),
        ff.PositionProbe("at", ff.Marker("bob")),
    )  # fmt: skip
    history = run(model, 4e-3, 0.6)
    inertia = MU * LONG**3 / 3.0 + 0.1 * LONG**2
    # the rope's third of the mass, not half: 2e-1 of it
    assert history["energy_kinetic"][0] == pytest.approx(0.5 * inertia * spin**2, rel=1e-10)
    # gravity has no moment about z; second order in the step, 4e-5
    np.testing.assert_allclose(history["p_lz"], inertia * spin, rtol=1e-4)
    balanced(history, 2e-4)


@pytest.mark.serial
def test_a_winch_lifts_rope_and_load() -> None:
    """Tension, work and balance while a winch hauls in a fifth of the rope."""

    def hauled(t: float) -> float:
        return -0.8 * t**3 / (0.3 + t**2)

    model = hanging(axial_stiffness=None, tension_only=False, paid_out=hauled)
    history = run(model, 4e-3, 0.8, tolerance=1e-10)
    t, e = history["t"], 1e-4
    faster = (hauled(t + e) - 2.0 * hauled(t) + hauled(t - e)) / e**2
    exact = (LOAD + 0.5 * MU * (LONG + hauled(t))) * (G - faster)
    # second order in the step; the mass that is hauled in is 1e-1
    np.testing.assert_allclose(history["pull_tension"], exact, rtol=2e-4)
    # the load alone; the tension is up to 1.4 times as much
    np.testing.assert_allclose(history["hold_fz"], LOAD * (G - faster), rtol=2e-4)
    # the energy of what comes in, and the work along it, are 1e-1 and more of the energy
    balanced(history, 1e-4)


@pytest.mark.serial
def test_a_rope_through_an_eyelet_in_free_flight() -> None:
    """What flows through an eyelet that moves leaves it its momentum, whatever the step."""
    model = ff.Model("flight")
    places = {"a": (-1.0, 0.0, 0.2), "eye": (0.0, 0.0, 0.0), "b": (0.7, 0.0, 0.4)}
    rates = {"a": (0.0, 1.0, 0.0), "eye": (0.0, 0.0, 0.0), "b": (0.3, 0.0, 0.5)}
    for name, place in places.items():
        model.add(ff.RigidBody(name, 1.0, (0.5, 0.6, 0.7), position=place, velocity=rates[name]))
    path = [ff.Marker("a"), ff.Eyelet(ff.Marker("eye")), ff.Marker("b")]
    model.add(
        ff.Cable("rope", path, mass_per_length=1.0, tension_only=False),
        ff.MomentumProbe("p"),
        ff.EnergyProbe(),
    )
    history = run(model, 4e-3, 0.4, rho_inf=1.0, tolerance=1e-10)
    for axis in "xyz":
        # second order in the step, 1e-6; without what the eyelet does 1e-2
        np.testing.assert_allclose(history[f"p_p{axis}"], history[f"p_p{axis}"][0], atol=1e-5)
        np.testing.assert_allclose(history[f"p_l{axis}"], history[f"p_l{axis}"][0], atol=1e-5)
    # 2e-6, and 3e-3
    balanced(history, 1e-5)


@pytest.mark.parametrize("given", [{"axes": "a"}, {}])
def test_forces_of_heavy_ropes_that_are_not_known(given: dict[str, str]) -> None:
    """Of one that ends on the ground, and in axes that the last part does not know."""
    ends = [ff.Marker("load"), ff.Marker("other") if given else ff.Ground()]
    model = model_of(
        ff.RigidBody("load", LOAD, SMALL, position=(0.0, 0.0, -LONG)),
        ff.RigidBody("other", LOAD, SMALL),
        ff.Cable("rope", ends, mass_per_length=MU, axial_stiffness=STIFFNESS),
        ff.ReactionProbe("hold", "rope", **given),
    )
    with pytest.raises(ValueError, match='Cable "rope" with mass') as caught:
        run(model, 1e-3, 1e-3)
    assert_on_page(str(caught.value))


def crane() -> ff.Model:
    """Two booms of beams; a heavy rope from one through an eyelet in and a sheave on the other."""
    lines = {
        "mast": ((-1.0, 0.0, -1.0), (-1.0, 0.0, 0.0)),
        "jib": ((0.0, 0.1, 0.0), (1.0, 0.1, 0.0)),
    }
    model = ff.Model("crane", mesh=ff.LineMesh.straight(lines, elements=1))
    steel = ff.Material(2.1e11, 0.3, 7850.0)
    top, head = ff.Eyelet(ff.Marker("jib", 0.3)), ff.Marker("jib", "end")
    guides = [top, ff.Sheave(head, 0.1, (0.0, 1.0, 0.0))]
    model.add(ff.Gravity((0.0, 0.0, -G)))
    for name in lines:
        model.add(
            ff.Beam(name, ff.Section.rectangle(0.04, 0.04, steel), orientation=(0.0, 1.0, 0.0)),
            ff.Rigid(f"{name} root", ff.Ground(lines[name][0]), ff.Marker(name, "start")),
        )
    model.add(
        ff.RigidBody("load", LOAD, SMALL, position=(1.1, 0.1, -1.0), velocity=(0.0, 0.5, 0.0)),
        ff.Cable("rope", [ff.Marker("mast", "end"), *guides, ff.Marker("load")],
                 mass_per_length=MU, axial_stiffness=2e5, preload=60.0, damping=50.0,
                 paid_out=lambda t: 2.0 * t**2),
        ff.PositionProbe("at", ff.Marker("load")),
        ff.PositionProbe("head", head),
        ff.CableProbe("pull", "rope"),
        ff.ReactionProbe("hold", "rope"),
        ff.ReactionProbe("hold_b", "rope", axes="b"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def test_a_heavy_rope_on_flexible_booms(shared_tmp_path: Path) -> None:
    """The same on all ranks, with the balance of the energies, also through a restart."""
    given = {"dt": 2e-3, "tolerance": 1e-10, "quiet": True}
    alone = ff.simulate(crane(), ff.RunOptions(t_end=0.02, **given), comm=MPI.COMM_SELF).history
    saved = {"output": shared_tmp_path, "checkpoint_every": 5} | given
    shared = columns(ff.simulate(crane(), ff.RunOptions(t_end=0.02, **saved)))
    file = shared_tmp_path / "checkpoint_000005.h5"
    again = columns(ff.simulate(crane(), ff.RunOptions(t_end=0.02, restart=file, **given)))
    balanced(alone, 1e-3)
    for name, values in alone.items():
        size = np.abs(values).max()
        # round-off; mass that no rank or two ranks count is of the order of the values
        np.testing.assert_allclose(shared[name], values, atol=1e-9 * size + 1e-12, err_msg=name)
        # Newton's tolerance; a state that is left out is of the order of the values
        assert again[name][-1] == pytest.approx(values[-1], abs=1e-7 * size + 1e-9), name
