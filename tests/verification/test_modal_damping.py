# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping ratios of the modes of models: found again, and without effect on rigid motions."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.lie import se3
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.modal import modal_damping
from flexfem.solvers.modal.mode_errors import Solution
from flexfem.solvers.modal.modes import solve_pencil
from tests.unit.refusals import assert_on_page

RANK = MPI.COMM_WORLD.rank
STEEL = ff.Material(2e11, 0.3, 7800.0)
BAR = ff.Section.rectangle(0.02, 0.03, STEEL)
RATIOS = [0.01, 0.02, 0.03, 0.04]


def cantilever(*more: Any, damping: Any = None, spring: bool = False, **given: Any) -> ff.Model:
    """A bar of two metres, clamped or on a hinge with a spring."""
    model = ff.Model("m", mesh=ff.LineMesh.straight({"bar": [(0, 0, 0), (2, 0, 0)]}, 8))
    root = ff.Ground(), ff.Marker("bar", "start")
    model.add(ff.Beam("bar", BAR, orientation=(0, 1, 0), **given), *more)
    if spring:
        model.add(ff.Revolute("hinge", *root, axis=(0, 0, 1)))
        model.add(ff.TorsionalSpringDamper("spring", *root, axis=(0, 0, 1), stiffness=3e3))
    else:
        model.add(ff.Rigid("clamp", *root))
    if damping is not None:
        model.add(ff.ModalDamping("damping", damping))
    return model


def plate(*more: Any, element: str) -> ff.Model:
    """A clamped plate with a mass on its corner."""
    x, y = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 0.6, 4)
    model = ff.Model("m", surface=ff.SurfaceMesh.grid("plate", x, y))
    section = ff.ShellSection.isotropic(0.01, STEEL)
    shell = ff.Shell("plate", section, element=element, edges={"plate_left": "clamped"})
    corner = ff.Marker("plate", "plate_bottom_right")
    model.add(shell, ff.PointMass("mass", 5.0, corner), *more)
    return model


MODELS: dict[str, Callable[..., ff.Model]] = {
    "se3": cantilever,
    "nurbs": lambda *more: cantilever(*more, formulation="nurbs"),
    "rotation_free": lambda *more: plate(*more, element="rotation_free"),
    "director": lambda *more: plate(*more, element="director"),
}


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("se3", marks=pytest.mark.serial),
        pytest.param("nurbs", marks=pytest.mark.serial),
        "rotation_free",
        pytest.param("director", marks=pytest.mark.serial),
    ],
)
def test_modes_have_their_ratios(kind: str) -> None:
    """All others have none, and frequencies without damping are those of the model without."""
    damping = ff.ModalDamping("damping", RATIOS)
    options = ff.ModeOptions(modes=6, quiet=True)
    plain = ff.find_modes(MODELS[kind](), options).history
    found = ff.find_modes(MODELS[kind](damping), options).history
    if RANK == 0:
        # modes are decoupled: what is left is the solver's error
        np.testing.assert_allclose(found["damping_ratio"], [*RATIOS, 0.0, 0.0], atol=1e-8)
        size = np.hypot(found["real"], found["imag"]) / (2.0 * np.pi)
        np.testing.assert_allclose(size, plain["frequency"], rtol=1e-7)


def test_damping_of_bodies_adds_to_ratios() -> None:
    """A flying bar whose damping, proportional to its stiffness, leaves modes decoupled.

    Its modes are found by an iteration at a shift, beside rigid motions. With this damping in the
    matrix that is inverted there, frequencies and ratios would be 1 % off.
    """
    mu = 1e-4
    model = ff.Model("m", mesh=ff.LineMesh.straight({"bar": [(0, 0, 0), (2, 0, 0)]}, 40))
    model.add(ff.Beam("bar", BAR, orientation=(0, 1, 0), damping=mu))
    model.add(ff.ModalDamping("damping", RATIOS))
    found = ff.find_modes(model, ff.ModeOptions(modes=8, quiet=True)).history
    if RANK == 0:
        size = np.hypot(found["real"], found["imag"])
        own = found["damping_ratio"] - 0.5 * mu * size
        np.testing.assert_allclose(own[size > 1.0], RATIOS[:2], atol=1e-7)


def test_dampers_leave_the_damped_modes_as_they_are() -> None:
    """They have no part in the modes of the model without damping; what they add is theirs."""
    ends = ff.Ground((2, 0, -1)), ff.Marker("bar", "end")
    dashpot = ff.SpringDamper("dashpot", *ends, damping=5.0)
    options = ff.ModeOptions(modes=4, quiet=True)
    alone = ff.find_modes(cantilever(dashpot), options).history
    both = ff.find_modes(cantilever(dashpot, ff.ModalDamping("damping", RATIOS)), options).history
    if RANK == 0:
        # to second order in both
        added = np.subtract(both["damping_ratio"], alone["damping_ratio"])
        assert max(alone["damping_ratio"]) > 1e-4
        np.testing.assert_allclose(added, RATIOS, atol=1e-5)


def masts(*dampings: ff.ModalDamping) -> ff.Model:
    """Three equal masts, whose modes have the same frequencies."""
    names = ["first", "second", "third"]
    places = [(0.0, float(i), 0.0) for i in range(3)]
    lines = {
        name: [place, np.add(place, (2, 0, 0))] for name, place in zip(names, places, strict=True)
    }
    model = ff.Model("masts", mesh=ff.LineMesh.straight(lines, 8))
    beams = model.add(ff.Many(ff.Beam, names, BAR, orientation=(0, 1, 0)))
    grounds = ff.each([ff.Ground(place) for place in places])
    model.add(ff.Many(ff.Rigid, "foot", grounds, ff.each(beams.markers("start"))))
    model.add(*dampings)
    return model


@pytest.mark.parametrize("modes", [6, pytest.param(12, marks=pytest.mark.serial)])
def test_one_of_equal_bodies_is_damped(modes: int) -> None:
    """As if it were alone: shapes of one frequency are found as any mixtures of the bodies."""
    own = (
        ff.ModalDamping("weak", 0.1, modes=modes, bodies=("second",)),
        ff.ModalDamping("strong", 0.3, modes=modes, bodies=("third",)),
    )
    found = ff.find_modes(masts(*own), ff.ModeOptions(modes=6, quiet=True)).history
    if RANK == 0:
        ratios = np.sort(found["damping_ratio"])
        np.testing.assert_allclose(ratios, [0.0, 0.0, 0.1, 0.1, 0.3, 0.3], atol=1e-8)


def free(
    kind: str, spin: tuple[float, float, float], ratio: float, modes: int, *more: Any
) -> ff.Model:
    """A soft bar or panel that flies and turns."""
    soft, start = ff.Material(2e8, 0.3, 2000.0), {"angular_velocity": spin, "velocity": (1, 2, 3)}
    if kind in ("se3", "nurbs"):
        mesh = ff.LineMesh.straight({"body": [(-0.5, 0, 0), (0.5, 0, 0)]}, 6)
        model, section = ff.Model("m", mesh=mesh), ff.Section.rectangle(0.02, 0.03, soft)
        model.add(ff.Beam("body", section, formulation=kind, orientation=(0, 1, 0), **start))
    else:
        x, y = np.linspace(-0.5, 0.5, 5), np.linspace(-0.1, 0.1, 2)
        model = ff.Model("m", surface=ff.SurfaceMesh.grid("body", x, y))
        section = ff.ShellSection.isotropic(0.02, soft)
        model.add(ff.Shell("body", section, element=kind, **start))
    model.add(ff.ModalDamping("damping", ratio, modes=modes), *more)
    return model


@pytest.mark.serial
@pytest.mark.parametrize("kind", MODELS)
def test_forces_of_dampers_are_in_equilibrium_and_vanish_in_rigid_motions(kind: str) -> None:
    """Of bodies that are bent far, and turned: momenta and rigid energy are kept."""
    system = Simulation(
        free(kind, (0.3, 5.0, 20.0), 0.1, 4), ff.RunOptions(dt=1e-3, t_end=1.0)
    ).system
    (part,), dampers = system.parts, system.modal_dampers
    block, rng = part.block, np.random.default_rng(1)
    block.owned_step[:] = 0.1 * rng.normal(size=block.owned_step.shape)
    block.frames[:] = se3.retract(block.frames, block.step)
    turned = se3.exp(np.array([1.0, 2.0, 3.0, 0.7, -1.1, 0.4]))
    block.frames[:] = se3.compose(turned, block.frames)
    back = se3.adjoint(se3.inverse(block.frames))
    block.velocity[:] = back @ np.array([1.0, -2.0, 3.0, 20.0, -30.0, 10.0])
    rigid = np.abs(dampers.rates()).max()
    moved = 10.0 * rng.normal(size=block.velocity.shape)
    block.velocity[:, : block.width] = moved[:, : block.width]
    # rounding; neglected rotations of the mode by the deflection would be of its size
    assert rigid < 1e-9 * np.abs(dampers.rates()).max()
    for mode in range(len(dampers.factors)):
        own = dampers.parts[0].forces(mode)
        wrenches = np.zeros((len(own), 6))
        wrenches[:, : block.width] = own
        total = np.einsum("nij,ni->j", back, wrenches)
        assert np.abs(total).max() < 1e-9 * np.abs(own).sum()


@pytest.mark.serial
def test_a_spinning_bar_settles_and_goes_on() -> None:
    """Unstretched at the start, it vibrates by the centrifugal forces; its rotation is kept."""
    probes = ff.MomentumProbe("p"), ff.EnergyProbe("e")
    model = free("se3", (0.0, 0.0, 40.0), 0.3, 36, *probes)
    options = ff.RunOptions(dt=1e-3, t_end=0.08, rho_inf=1.0, tolerance=1e-10, quiet=True)
    found = ff.simulate(model, options).history
    late = found["t"] > 0.06
    assert found["e_dissipation"][-1] > 0.1
    energy = found["e_kinetic"] + found["e_strain"]
    for kept, error in ((found["p_px"], 1e-12), (found["p_lz"], 1e-9), (energy, 1e-9)):
        # damping of the rotation by the ratio takes all of it in this time
        assert np.ptp(kept[late]) < error * np.abs(kept).max()


@pytest.mark.serial
def test_vibrations_decay_by_the_ratio() -> None:
    """The logarithmic decrement 2 pi zeta / sqrt(1 - zeta^2), of a bar that is let go."""
    zeta = 0.05
    pull = ff.PointForce(
        "pull", ff.Marker("bar", "end"), (0, 0, 5.0), amplitude=lambda t: 1.0 - float(t > 0.0)
    )  # fmt: skip
    probes = ff.PositionProbe("tip", ff.Marker("bar", "end")), ff.EnergyProbe("e")
    options = ff.RunOptions(
        dt=5e-3, t_end=0.4, rho_inf=1.0, start="equilibrium", tolerance=1e-10, quiet=True
    )
    found = ff.simulate(cantilever(pull, *probes, damping=zeta), options).history
    z = found["tip_z"]
    first, second = [i for i in range(1, len(z) - 1) if z[i - 1] < z[i] > z[i + 1]][:2]
    exact = 2.0 * np.pi * zeta / np.sqrt(1.0 - zeta**2)
    # steps and higher modes leave 0.1 %
    assert np.log(z[first] / z[second]) == pytest.approx(exact, rel=0.01)
    # what the dampers take is counted: without it the balance is their loss
    assert np.abs(found["e_balance"]).max() < 1e-4 * found["e_dissipation"][-1]


@pytest.mark.serial
def test_linear_models_have_the_poles() -> None:
    """Also beside a spring: its own mode is left out, the others have nearly their ratios."""
    damped = cantilever(ff.PositionProbe("tip", ff.Marker("bar", "end")), damping=RATIOS[:2])
    poles = ff.linearize(damped, ff.LinearOptions(modes=3)).poles[::2]
    np.testing.assert_allclose(-poles.real / np.abs(poles), [*RATIOS[:2], 0.0], atol=1e-8)
    options = ff.ModeOptions(modes=4, quiet=True)
    found = ff.find_modes(cantilever(spring=True, damping=0.02), options).history["damping_ratio"]
    assert found[0] < 1e-3
    np.testing.assert_allclose(found[1:], 0.02, rtol=0.01)


def two(*dampings: ff.ModalDamping) -> ff.Model:
    """Two bars that meet in a hinge, the second stiffer."""
    lines = {"bar": [(0, 0, 0), (1, 0, 0)], "arm": [(1, 0, 0), (1.4, 0, 0)]}
    model = ff.Model("m", mesh=ff.LineMesh.straight(lines, 4))
    stiff = ff.Section.rectangle(0.05, 0.06, STEEL)
    model.add(
        ff.Beam("bar", BAR, orientation=(0, 1, 0)),
        ff.Beam("arm", stiff, orientation=(0, 1, 0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "start")),
        ff.Rigid("weld", ff.Marker("bar", "end"), ff.Marker("arm", "start")),
        *dampings,
    )
    return model


@pytest.mark.serial
def test_bodies_are_chosen_and_ratios_depend_on_the_frequency() -> None:
    """Modes of the bar have the ratio of their frequency, and nearly so by its strains alone."""
    table, options = ff.Table([0.0, 200.0], [0.0, 0.1]), ff.ModeOptions(modes=4, quiet=True)
    plain = ff.find_modes(two(), options).history["frequency"]
    for bodies, error in ((None, 1e-7), (["bar"], 2e-3)):
        model = two(ff.ModalDamping("damping", table, bodies=bodies))
        found = ff.find_modes(model, options).history["damping_ratio"]
        np.testing.assert_allclose(found, 0.1 * plain / 200.0, rtol=error)


def refused(**given: Any) -> None:
    options = ff.RunOptions(dt=1e-3, t_end=1e-3, quiet=True)
    ff.simulate(two(ff.ModalDamping("d", **({"ratio": 0.1} | given))), options)


LAW = ff.BeamLaw(lambda e, p: 1e6 * e[0] ** 2 + e[1] ** 2 + e[2] ** 2 + e[3] ** 2
                 + e[4] ** 2 + e[5] ** 2)  # fmt: skip


def with_law() -> None:
    model = two()
    model.add(ff.ModalDamping("d", 0.1))
    object.__setattr__(model["bar"], "section", BAR.with_law(LAW))
    model.validate()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: refused(ratio=1.0), "ratio must be numbers from 0 to below 1, got"),
        (lambda: refused(ratio=[]), "ratio must be numbers from 0 to below 1, got"),
        (lambda: refused(ratio=-0.1), "ratio must be numbers from 0 to below 1, got"),
        (lambda: refused(ratio="much"), "ratio must hold"),
        (lambda: refused(ratio=lambda f: 2.0), "ratio must be numbers from 0 to below 1, got"),
        (lambda: refused(ratio=lambda f: 1.0 / 0.0), "ratio: .*ZeroDivisionError"),
        (lambda: refused(ratio=lambda f: "much"), "ratio must"),
        (lambda: refused(modes=0), "modes must be at least 1, got 0"),
        (lambda: refused(modes=2.0), "modes must be a whole number, got 2.0"),
        (lambda: refused(ratio=[0.1, 0.2], modes=3), "2 ratios, but modes=3"),
        (lambda: refused(bodies=["leg"]), 'Model "m" has no beam or shell "leg"'),
        (lambda: refused(bodies=["bar", "bar"]), "bodies must be names, each once, got"),
        (lambda: refused(bodies=3), "bodies must be a list or tuple, got 3"),
        (lambda: two(ff.ModalDamping("d", 0.1), ff.ModalDamping("e", 0.1)).validate(),
         'Beam "bar" is damped by "e" already'),
        (with_law, 'Beam "bar" has a law, modes are those of linear sections'),
        (lambda: ff.simulate(two(ff.ModalDamping("d", 0.1)), ff.RunOptions(
            dt=1e-3, t_end=1e-3, integrator="energy_momentum", quiet=True)),
         "the integrator energy_momentum does not support damping of modes"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        make()
    text = str(raised.value)
    assert "\n" not in text
    assert text.startswith('ModalDamping "d": ')
    assert_on_page(text)


@pytest.mark.parametrize("what", ["missing", "errors"])
def test_modes_that_are_not_found_are_told(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is left out would not be damped, and one that is inaccurate by another ratio."""

    def found(*given: Any) -> Solution:
        solution = solve_pencil(*given)
        errors = solution.errors + 1e-4 * np.abs(solution.values) ** 2
        return replace(solution, **({"missing": 4} if what == "missing" else {"errors": errors}))

    monkeypatch.setattr(modal_damping, "solve_pencil", found)
    text = 'ModalDamping "damping": 4 of 4 modes are inaccurate or were not found, ask for fewer'
    with pytest.raises(ValueError, match=text):
        ff.find_modes(cantilever(damping=RATIOS), ff.ModeOptions(modes=1, quiet=True))
    assert_on_page(text)
