# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotors on supports in multiblade coordinates against closed forms."""

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import eig

import flexfem as ff
from flexfem._types import FloatArray
from tests.unit.refusals import assert_on_page

MASS, LENGTH, OFFSET, SPRING = 10.0, 2.0, 0.3, 500.0
SECOND, FIRST = MASS * LENGTH**2 / 3.0, MASS * LENGTH / 2.0
SUPPORT, MOUNT = 70.0, 4000.0
SPINS = np.linspace(0.0, 6.0, 4)


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
        model.add(
            ff.RigidBody("base", SUPPORT - 20.0, (5.0, 5.0, 5.0)),
            ff.Prismatic("rail", ff.Ground(), base, axis=(1, 0, 0)),
            ff.SpringDamper("mount", ff.Ground((-3.0, 0.0, 0.0)), base, stiffness=MOUNT),
        )
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


def lagging(spin: float, blades: int = 3) -> FloatArray:
    """Frequencies of support and cyclic lag (Coleman and Feingold, NACA report 1351, 1958)."""
    own = SPRING / SECOND + spin**2 * OFFSET * FIRST / SECOND - spin**2
    whole = SUPPORT + blades * MASS
    M = np.array([[whole, 0, -blades / 2 * FIRST], [0, SECOND, 0], [-FIRST, 0, SECOND]])
    C = np.array([[0, 0, 0], [0, 0, 2 * spin * SECOND], [0, -2 * spin * SECOND, 0]])
    K, one, zero = np.diag([MOUNT, SECOND * own, SECOND * own]), np.eye(3), np.zeros((3, 3))
    values = eig(np.block([[zero, one], [-K, -C]]), np.block([[one, zero], [zero, M]]))[0]
    return np.sort(values.imag[values.imag > 1e-6])


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
    sails = rotor()
    sails.surface = ff.SurfaceMesh.rectangle("sail", (1.0, 1.0), (1, 1))
    sails.add(ff.Shell("sail", ff.ShellSection.isotropic(1e-3, ff.Material(1e9, 0.3, 1e3))))
    with pytest.raises(ValueError, match="'sail' has nodes with positions alone") as refused:
        ff.sweep_rotor(
            sails,
            ff.RotorOptions(blades="blade_1,blade_2,blade_3", rotor="hub,sail", spin_end=1.0),
        )
    assert_on_page(str(refused.value))
    heavy = rotor()
    heavy.add(ff.Gravity((0.0, -9.81, 0.0)))
    with pytest.raises(ValueError, match="change with the azimuth of the rotor"):
        found(heavy, 2, spin=1.0)
    for names, text in (("a,b", "three or more"), ("a,b,b", "'b' twice")):
        with pytest.raises(ValueError, match=text):
            ff.RotorOptions(blades=names, rotor="hub", spin_end=1.0)
