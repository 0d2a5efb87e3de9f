# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotors on supports in multiblade coordinates against closed forms."""

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import eig

import flexfem as ff
from flexfem._types import FloatArray
from flexfem.solvers.modal.mode_errors import ComplexArray
from tests.unit.refusals import assert_on_page

MASS, LENGTH, OFFSET, SPRING = 10.0, 2.0, 0.3, 500.0
SECOND, FIRST = MASS * LENGTH**2 / 3.0, MASS * LENGTH / 2.0
SUPPORT, MOUNT, WIDTH = 70.0, 4000.0, 0.1
SPINS = np.linspace(0.0, 6.0, 4)


def add_support(model: ff.Model) -> None:
    """Add a body that a spring holds along X."""
    base = ff.Marker("base")
    model.add(
        ff.RigidBody("base", SUPPORT - 20.0, (5.0, 5.0, 5.0)),
        ff.Prismatic("rail", ff.Ground(), base, axis=(1, 0, 0)),
        ff.SpringDamper("mount", ff.Ground((-3.0, 0.0, 0.0)), base, stiffness=MOUNT),
    )


def rotor(blades: int = 3, *, lag: bool = False, start: float = 0.0) -> ff.Model:
    """Rigid blades on hinges with springs, on a hub that rotates about Z.

    Args:
        blades: number of blades.
        lag: True for hinges along the axis, and a support that a spring holds along X; otherwise
            blades flap and the support does not move.
        start: azimuth, rad.
    """
    model, inertia = ff.Model("rotor"), MASS * LENGTH**2 / 12.0
    hub, base = ff.Marker("hub"), ff.Marker("base")
    model.add(ff.RigidBody("hub", 20.0, (1.0, 1.0, 1.5)))
    if lag:
        add_support(model)
    model.add(ff.Revolute("bearing", base if lag else ff.Ground(), hub, axis=(0, 0, 1)))
    for k in range(blades):
        c, s = np.cos(start + 2.0 * np.pi * k / blades), np.sin(start + 2.0 * np.pi * k / blades)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        name, hinge = f"blade_{k + 1}", ff.Marker("hub", offset=R @ [OFFSET, 0.0, 0.0])
        pair, axis = (hinge, ff.Marker(name, offset=(-LENGTH / 2.0, 0, 0))), R @ [0, 1, 0]
        axis = np.array([0.0, 0.0, 1.0]) if lag else axis
        place = R @ [OFFSET + LENGTH / 2.0, 0.0, 0.0]
        model.add(
            ff.RigidBody(name, MASS, (1e-8, inertia, inertia), position=place, rotation=R),
            ff.Revolute(f"hinge_{k + 1}", *pair, axis=axis),
            ff.TorsionalSpringDamper(f"spring_{k + 1}", *pair, axis=axis, stiffness=SPRING),
        )
    return model


def found(model: ff.Model, modes: int, comm: MPI.Intracomm = MPI.COMM_WORLD, **given: Any) -> Any:
    count = sum(body.name.startswith("blade") for body in model.bodies)
    options = {"spin_end": SPINS[-1], "speeds": len(SPINS)} | given
    names = ",".join(f"blade_{k + 1}" for k in range(count))
    return ff.sweep_rotor(
        model,
        ff.RotorOptions(blades=names, rotor="hub", modes=modes, quiet=True, **options),
        comm=comm,
    )


def frequencies(history: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Angular frequencies of modes by name, rad/s."""
    return {k: 2.0 * np.pi * v for k, v in history.items() if k.endswith("_frequency")}


def flapping(spin: float) -> float:
    """Frequency of a blade in its own axes (Johnson, Helicopter Theory 1980, section 5-3)."""
    return float(np.sqrt(SPRING / SECOND + spin**2 * (1.0 + OFFSET * FIRST / SECOND)))


def coleman(spin: float, second: float = SECOND) -> ComplexArray:
    """Eigenvalues of support and cyclic lag (Coleman and Feingold, NACA report 1351, 1958).

    Args:
        spin: rad/s.
        second: moment of inertia of a blade about its hinge, kg m^2.
    """
    blades = 3
    own = SPRING / second + spin**2 * OFFSET * FIRST / second - spin**2
    whole = SUPPORT + blades * MASS
    M = np.array([[whole, 0, -blades / 2 * FIRST], [0, second, 0], [-FIRST, 0, second]])
    C = np.array([[0, 0, 0], [0, 0, 2 * spin * second], [0, -2 * spin * second, 0]])
    K, one, zero = np.diag([MOUNT, second * own, second * own]), np.eye(3), np.zeros((3, 3))
    values: ComplexArray
    values = eig(np.block([[zero, one], [-K, -C]]), np.block([[one, zero], [zero, M]]))[0]
    return values


def lagging(spin: float, second: float = SECOND) -> FloatArray:
    """Frequencies of support and cyclic lag, rad/s."""
    values = coleman(spin, second).imag
    return np.sort(values[values > 1e-6])


@pytest.mark.serial
def test_flapping_blades_have_the_frequencies_of_one_and_one_per_revolution() -> None:
    """Those of a blade alone in rotating axes, which the cyclic modes shift by the speed.

    At another azimuth of the start, and for four blades, whose fourth mode is in rotating axes, the
    same; at rest they are modes of the model at rest. A wrong sense of whirl swaps two names; the
    tolerance is that of the eigenvalues, half a percent of what the offset of the hinge does.
    """
    three = found(rotor(), 3)
    assert three.status == "ok"
    if three.history:
        named = frequencies(three.history)
        for name, shift in (("collective", 0.0), ("forward", 1.0), ("backward", -1.0)):
            expected = [flapping(spin) + shift * spin for spin in SPINS]
            np.testing.assert_allclose(named[f"{name}_flap_1_frequency"], expected, rtol=1e-7)
            np.testing.assert_allclose(three.history[f"{name}_flap_1_{name}"][1:], 1.0, atol=1e-8)
    for other in (
        found(rotor(start=0.4), 3, spin=4.0, speeds=2),
        found(rotor(), 3, spin=-4.0, spin_end=-6.0, speeds=2),
    ):
        for name, values in other.history.items():
            if name.endswith("_frequency"):
                np.testing.assert_allclose(values, three.history[name][-2:], rtol=1e-7)
    four = frequencies(found(rotor(4), 4, spin=6.0, spin_end=5.0, speeds=2).history)
    if four:
        np.testing.assert_allclose(four["other_flap_1_frequency"][0], flapping(6.0), rtol=1e-7)
        np.testing.assert_allclose(
            four["forward_flap_1_frequency"][0], flapping(6.0) + 6.0, rtol=1e-7
        )
    rest = ff.find_modes(rotor(), ff.ModeOptions(modes=4, quiet=True)).history
    if rest:
        np.testing.assert_allclose(2.0 * np.pi * rest["frequency"][1:], flapping(0.0), rtol=1e-7)


@pytest.mark.slow_on_ranks
def test_lagging_blades_shake_their_support() -> None:
    """Three coupled modes in fixed axes; a support in rotating axes would not have these."""
    history = found(rotor(lag=True), 4, speeds=4).history
    alone = found(rotor(lag=True), 4, MPI.COMM_SELF, spin=2.0, speeds=2).history
    if history:
        # collective modes turn the free hub against the blades
        cyclic = [v for k, v in frequencies(history).items() if not k.startswith("collective")]
        for values, spin in list(zip(np.transpose(cyclic), SPINS, strict=True))[1:]:
            np.testing.assert_allclose(np.sort(values), lagging(spin), rtol=1e-7)
        for name, values in alone.items():
            if name.endswith(("frequency", "damping")):
                np.testing.assert_allclose(values[-1], history[name][-1], rtol=1e-9, atol=1e-9)


@pytest.mark.serial
def test_ground_resonance_is_told() -> None:
    """Where lag against the rotation meets the support both grow; at other speeds nothing does."""
    outcome = found(rotor(lag=True), 4, spin=12.0, spin_end=24.0, speeds=7)
    assert outcome.status == "ok"
    (warning,) = outcome.summary["warnings"]
    rates = [float(coleman(spin).real.max()) for spin in np.linspace(12.0, 24.0, 7)]
    assert [rate > 1e-6 for rate in rates] == [False, False, True, True, False, False, False]
    start = "the state at 2 of 7 speeds, 16 to 18 rad/s, is unstable: 1 of 5 modes grows, the "
    assert warning.startswith(f"{start}fastest by exp({max(rates):.4g} 1/s t); ")
    assert_on_page(warning)


@pytest.mark.serial
def test_modes_that_are_left_out_are_told() -> None:
    """Speeds far apart lose the lowest mode, and a higher one takes its place."""
    coarse = found(rotor(lag=True), 3, spin_end=8.0, speeds=3)
    fine = found(rotor(lag=True), 3, spin_end=8.0, speeds=9)
    (warning,) = coarse.summary["warnings"]
    assert warning.startswith("modes of 0.1267 Hz at 8 rad/s could not be followed to all speeds")
    assert_on_page(warning)
    assert fine.summary["warnings"] == []
    if MPI.COMM_WORLD.rank == 0:
        last = np.sort([values[-1] for values in frequencies(fine.history).values()])
        np.testing.assert_allclose(last, lagging(8.0), rtol=1e-6)


@pytest.mark.serial
def test_rotors_without_symmetry_are_refused() -> None:
    with pytest.raises(ValueError, match="'blade_2' is not 'blade_1' rotated by a multiple of 120"):
        found(rotor(), 2, axis="x")
    with pytest.raises(ValueError, match="the model has no body 'blade_9'"):
        ff.sweep_rotor(
            rotor(),
            ff.RotorOptions(blades="blade_1,blade_2,blade_9", rotor="hub", spin_end=1.0),
        )
    section = ff.ShellSection.isotropic(1e-3, ff.Material(1e9, 0.3, 1e3))
    for bodies, edges, text in (
        ("sail,hub", {}, "'sail' has nodes with positions alone, which carry no axis"),
        ("hub,sail", {"sail_left": "clamped"}, "'sail' has held nodes, which do not rotate"),
    ):
        sails = rotor()
        sails.surface = ff.SurfaceMesh.rectangle("sail", (1.0, 1.0), (1, 1))
        sails.add(ff.Shell("sail", section, edges=edges))
        with pytest.raises(ValueError, match=text) as refused:
            ff.sweep_rotor(
                sails,
                ff.RotorOptions(blades="blade_1,blade_2,blade_3", rotor=bodies, spin_end=1.0),
            )
        assert_on_page(str(refused.value))
    heavy = rotor()
    heavy.add(ff.Gravity((0.0, -9.81, 0.0)))
    with pytest.raises(ValueError, match="change with the azimuth of the rotor"):
        found(heavy, 2, spin=1.0)
    for names, text in (("a,b", "three or more"), ("a,b,b", "'b' twice")):
        with pytest.raises(ValueError, match=text):
            ff.RotorOptions(blades=names, rotor="hub", spin_end=1.0)


def solid_blades(stiffness: float = 1e11, *, hinged: bool) -> ff.Model:
    """The rotor with blades of solids, nearly rigid: hinged along the axis, or fixed to the hub.

    One with hinges is on the support of :func:`rotor`, the other on a ball joint in its centre.
    """
    model, hub, base = ff.Model("rotor"), ff.Marker("hub"), ff.Marker("base")
    model.add(ff.RigidBody("hub", 20.0, (1.0, 1.0, 1.5)))
    if hinged:
        add_support(model)
        model.add(ff.Revolute("bearing", base, hub, axis=(0, 0, 1)))
    else:
        model.add(ff.Spherical("ball", ff.Ground(), hub))
    law = ff.laws.SaintVenantKirchhoff(stiffness, 0.0)
    box = ff.SolidMesh.box(
        (LENGTH, WIDTH, WIDTH), (1, 1, 1), origin=(OFFSET, -WIDTH / 2.0, -WIDTH / 2.0)
    )
    for k in range(3):
        R, name = about(k), f"blade_{k + 1}"
        blade = ff.Solid(
            name, law, box.moved(box.points @ R.T), density=MASS / LENGTH / WIDTH**2, degree=2
        )
        model.add(blade)
        pair = ff.Marker("hub", offset=R @ [OFFSET, 0.0, 0.0]), blade.surface_marker("x0")
        if not hinged:
            model.add(ff.Rigid(f"root_{k + 1}", *pair))
            continue
        model.add(
            ff.Revolute(f"hinge_{k + 1}", *pair, axis=(0, 0, 1)),
            ff.TorsionalSpringDamper(f"spring_{k + 1}", *pair, axis=(0, 0, 1), stiffness=SPRING),
        )
    return model


def about(blade: int) -> FloatArray:
    """Rotation of a blade about Z from the first one."""
    c, s = np.cos(2.0 * np.pi * blade / 3.0), np.sin(2.0 * np.pi * blade / 3.0)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.slow_on_ranks
def test_blades_of_solids_shake_their_support() -> None:
    """Coleman and Feingold's closed form on a support that yields along one axis alone."""
    outcome = found(solid_blades(hinged=True), 4, spin=5.0, speeds=3, accuracy=1e-6)
    assert outcome.status == "ok"
    assert outcome.summary["checks"]["azimuth"] < 1e-4
    if outcome.history:
        named = frequencies(outcome.history)
        cyclic = [v for k, v in named.items() if not k.startswith("collective")]
        for values, spin in zip(np.transpose(cyclic), (5.0, 5.5, 6.0), strict=True):
            second = SECOND + MASS * WIDTH**2 / 12.0
            # blades bend by the square of the frequency over that of bending; of the lowest mode,
            # a small difference of frequencies, it is more
            np.testing.assert_allclose(np.sort(values), lagging(spin, second), rtol=1e-4, atol=1e-3)


def test_a_rotor_of_solids_on_a_ball_joint_nutates_as_a_top() -> None:
    """At ``spin C/A`` of the moments of inertia along and across the axis; nothing else turns."""
    outcome = found(solid_blades(hinged=False), 1, spin=3.0, speeds=2, accuracy=1e-6)
    assert outcome.status == "ok"
    centre = OFFSET + LENGTH / 2.0
    along = MASS * ((LENGTH**2 + WIDTH**2) / 12.0 + centre**2)
    C = 1.5 + 3.0 * along
    A = 1.0 + 1.5 * (along + MASS * WIDTH**2 / 6.0)
    if outcome.history:
        (nutation,) = frequencies(outcome.history).values()
        # blades that bend by their gyroscopic forces
        np.testing.assert_allclose(nutation, np.array([3.0, 6.0]) * C / A, rtol=1e-5)


def light_rotor(kind: str, *, whole: bool = False) -> ff.Model:
    """Blades of rotation-free shells or of bars, on a support that is the same all around.

    Args:
        kind: "shell" or "net".
        whole: True for a support that rotates with the hub, as thin as a line.
    """
    model, hub, base = ff.Model("rotor"), ff.Marker("hub"), ff.Marker("base")
    stiffness = (4e3, 4e3, 9e3, 300.0, 300.0, 0.0 if whole else 1e5)
    model.add(
        ff.RigidBody("hub", 3.0, (0.02, 0.02, 0.03)),
        ff.RigidBody("base", 5.0, (0.05, 0.05, 1e-8)),
        ff.Bushing("mount", ff.Ground(), base, stiffness=stiffness),
    )
    joint = ff.Rigid("bearing", base, hub)
    model.add(joint if whole else ff.Revolute("bearing", base, hub, axis=(0, 0, 1)))
    names = [f"blade_{k + 1}" for k in range(3)]
    if kind == "net":
        corners = np.array([(0.2, -0.05, 0.0), (0.2, 0.05, 0.0), (0.2, 0.0, 0.08)])
        points = np.concatenate([corners + x * np.eye(3)[0] for x in (0.0, 0.5, 1.0)])
        around = [(3 * bay + i, 3 * bay + (i + 1) % 3) for bay in (1, 2) for i in range(3)]
        along = [
            (3 * b + i, 3 * b + 3 + j % 3) for b in (0, 1) for i in range(3) for j in (i, i + 1)
        ]
        roots = {f"root_{i}": [i] for i in range(3)}
        for k, name in enumerate(names):
            R = about(k)
            mesh = ff.ElementMesh(points @ R.T, around + along, "interval", nodes=roots)
            net = ff.CableNet(name, mesh, 4e4, mass_per_length=0.5, tension_only=False)
            model.add(net)
            for root, (node,) in roots.items():
                pair = ff.Marker("hub", offset=R @ points[node]), net.marker(root)
                model.add(ff.Spherical(f"{name}_{root}", *pair))
        return model
    sheets, corner = [], np.array([0.2, -0.04, 0.0])
    for k, name in enumerate(names):
        sheet = ff.SurfaceMesh.rectangle(name, (1.0, 0.08), (6, 1))
        sheets.append(sheet.moved((sheet.points + corner) @ about(k).T))
    model.surface = ff.SurfaceMesh.join(sheets)
    section = ff.ShellSection.isotropic(0.02, ff.Material(2e9, 0.0, 1e3))
    for name in names:
        line = ff.ShellLine(name, f"{name}_left")
        model.add(ff.Shell(name, section), ff.ClampedLine(f"{name}_root", line, hub))
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize("kind", ["shell", "net"])
def test_light_rotors_have_the_modes_of_axes_that_rotate_with_them(kind: str) -> None:
    """Of the same model that rotates as a whole: the frequencies of whirls are shifted by the spin.

    The blades are stretched by ``rho spin^2 (R^2 l - (R^3 - r^3)/3) / 2 E`` between r and R.
    """
    spin, far = 12.0, 1.2
    model = light_rotor(kind)
    if kind == "shell":
        model.add(ff.PositionProbe("tip", ff.Marker("blade_1", (far, 0.04, 0.0))))
    outcome = found(model, 9, spin=6.0, spin_end=spin, speeds=2)
    options = ff.ModeOptions(modes=14, spin=spin, quiet=True)
    rotating = ff.find_modes(light_rotor(kind, whole=True), options)
    assert outcome.status == rotating.status == "ok"
    assert outcome.summary["checks"]["azimuth"] < 1e-7
    assert rotating.modes is not None
    if outcome.history:
        named = frequencies(outcome.history)
        assert len(named) == 9
        for values in named.values():
            shifted = np.abs(values[-1] + spin * np.array([-1.0, 0.0, 1.0]))
            gaps = np.abs(shifted[:, np.newaxis] - rotating.modes.eigenvalues.imag)
            # rounding, and the support that rotates in one of them
            assert gaps.min() < 1e-6 * values[-1]
        if kind == "shell":
            stretch = 1e3 * spin**2 / 4e9 * (far**2 - (far**3 - 0.2**3) / 3.0)
            # masses at the corners of six pairs of triangles; without the forces nothing
            assert outcome.history["tip_x"][-1] - far == pytest.approx(stretch, rel=5e-2)


@pytest.mark.parametrize("kind", ["shell", "net"])
def test_tilted_rotors_are_the_same_at_all_azimuths(kind: str) -> None:
    """About the axis that the support has tilted by a tenth; about that of the start they differ.

    The force has a potential: nothing grows.
    """
    model = light_rotor(kind)
    model.add(ff.PointForce("push", ff.Marker("base", offset=(0.0, 0.0, 1.0)), (30.0, -20.0, 0.0)))
    outcome = found(model, 6, spin=6.0, spin_end=12.0, speeds=2)
    assert outcome.status == "ok"
    assert outcome.summary["checks"]["azimuth"] < 1e-7
    assert [text for text in outcome.summary["warnings"] if "unstable" in text] == []


@pytest.mark.serial
def test_rotors_at_rest_without_loads_depend_on_no_azimuth() -> None:
    """Forces are rounding alone, which changes by as much as it is."""
    outcome = found(light_rotor("net"), 3, spin_end=3.0, speeds=2)
    assert outcome.status == "ok"
    assert outcome.history["variation"][0] == 0.0
