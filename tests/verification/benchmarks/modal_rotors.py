# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotors and tops: gyroscopic splitting of frequencies."""

import numpy as np

import flexfem as ff
from tests.verification.benchmarks.straight_beam import (
    angular_frequencies,
    beam_model,
    spun_frequencies,
)
from tests.verification.result import Result

AXIS = (0.0, 0.0, 1.0)


def results() -> list[Result]:
    """All frequencies of this file."""
    return [*_shaft(), *_overhung(), *_top(), *_unbalanced()]


def _shaft() -> list[Result]:
    """Tubular shaft with a disk at mid-span, bending as if clamped at both ends."""
    steel = ff.Material(210e9, 0.3, 7800.0)
    section = ff.Section.tube(0.09, 0.1, steel)
    model = beam_model(section, 40, length=6.0, direction=AXIS)
    mass, radius, thickness = 70.573, 0.24, 0.05
    across = mass * (radius**2 / 4 + thickness**2 / 12)
    model.add(
        ff.RigidBody("disk", mass, (across, across, mass * radius**2 / 2), position=(0, 0, 3)),
        ff.Rigid("fit", ff.Marker("beam", 0.5), ff.Marker("disk")),
        ff.Revolute("left", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.Cylindrical("right", ff.Ground((0, 0, 6)), ff.Marker("beam", "end"), axis=AXIS),
    )
    ours = float(angular_frequencies(model, 2)[0])
    return [Result(
        "shaft with disk", "first bending [rad/s]", 56.87, "Bauchau et al. (2016) data",
        ours, "40", 6e-3,
    )]  # fmt: skip


def _overhung() -> list[Result]:
    """Disk at the end of a massless cantilever shaft (Stodola 1924)."""
    m, J_d, J_p, EI, L = 2.0, 0.3, 0.6, 100.0, 1.0
    light = 1e-6
    section = ff.Section.general(
        (1e7, 1e7, 1e7, 1e4, EI, EI), (light, light, light, 2 * light, light, light)
    )
    model = beam_model(section, 40, length=L, direction=AXIS)
    model.add(
        ff.RigidBody("disk", m, (J_d, J_d, J_p), position=(0, 0, L)),
        ff.Rigid("fit", ff.Marker("beam", "end"), ff.Marker("disk")),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
        ff.PrescribedAngle("drive", ff.Ground(), ff.Marker("beam", "start"), axis=AXIS),
    )
    found = []
    spins = (0.0, 10.0, 40.0)
    for spin, values in zip(spins, spun_frequencies(model, 6, spins), strict=True):
        # (k11 - m w^2)(k22 - J_d w^2 + J_p spin w) = k12^2 for the complex tilt exp(i w t)
        k11, k12, k22 = 12 * EI / L**3, 6 * EI / L**2, 4 * EI / L
        left = np.polymul([-m, 0.0, k11], [-J_d, J_p * spin, k22])
        roots = np.sort(np.roots(np.polysub(left, [k12**2])).real)
        for root in roots:
            turning = abs(root - spin)  # in axes that rotate with the disk
            ours = float(values[np.argmin(np.abs(values - turning))])
            found.append(Result(
                f"overhung disk at {spin:g} rad/s", f"whirl {root:.4g} rad/s in rotating axes",
                float(turning), "Stodola (1924)", ours, "40", 2e-3,
            ))  # fmt: skip
    return found


def _top() -> list[Result]:
    """Sleeping top: A w^2 - C spin w + m g l = 0 for precession and nutation."""
    m, g, arm, A, C = 1.5, 9.81, 0.4, 0.5, 0.3
    model = ff.Model("top")
    across = A - m * arm**2
    model.add(
        ff.Gravity((0, 0, -g)),
        ff.RigidBody("top", m, (across, across, C), position=(0, 0, arm)),
        ff.Spherical("tip", ff.Ground(), ff.Marker("top", offset=(0, 0, -arm))),
    )
    found = []
    for spin in (25.0, 60.0):
        values = angular_frequencies(model, 3, spin=spin)
        for name, root in zip(
            ("precession", "nutation"), np.sort(np.roots([A, -C * spin, m * g * arm])), strict=True
        ):
            turning = abs(float(root) - spin)
            ours = float(values[np.argmin(np.abs(values - turning))])
            found.append(Result(
                f"sleeping top at {spin:g} rad/s", f"{name} in rotating axes [rad/s]", turning,
                "Lagrange's top", ours, "rigid", 1e-10,
            ))  # fmt: skip
    return found


def _unbalanced() -> list[Result]:
    """Disk with an unbalance in the middle of a massless shaft on two hinges (Jeffcott 1919)."""
    m, e, L, EI = 10.0, 1e-3, 1.0, 2000.0
    critical, light = np.sqrt(48.0 * EI / L**3 / m), 1e-6
    section = ff.Section.general(
        (1e8, 1e8, 1e8, 1e4, EI, EI), (light, light, light, 2 * light, light, light)
    )
    model = beam_model(section, 40, length=L, direction=AXIS)
    model.add(
        ff.RigidBody("disk", m, (0.01, 0.01, 0.02), position=(e, 0, L / 2)),
        ff.Rigid("fit", ff.Marker("beam", 0.5), ff.Marker("disk", offset=(-e, 0, 0))),
        ff.Spherical("left", ff.Ground(), ff.Marker("beam", "start")),
        ff.PointOnLine("right", ff.Ground((0, 0, L)), ff.Marker("beam", "end"), axis=AXIS),
        ff.PositionProbe("middle", ff.Marker("beam", 0.5)),
    )
    found = []
    for ratio in (0.5, 2.0):
        spin = float(ratio * critical)
        outcome = ff.find_modes(model, ff.ModeOptions(modes=3, spin=spin, quiet=True))
        assert outcome.status == "ok"
        assert not any("is unstable" in text for text in outcome.summary["warnings"])
        case = f"unbalanced disk at {ratio:g} of its critical speed"
        # bending of 40 elements is 4e-4 too stiff; without what turns beyond the critical speed, or
        # with forces of the start alone, the sign is wrong or the deflection 0.25 and 4
        found.append(Result(
            case, "deflection over unbalance", ratio**2 / (1.0 - ratio**2), "Jeffcott (1919)",
            outcome.state["middle_x"] / e, "40", 2e-3,
        ))  # fmt: skip
        for name, turning in (("backward", critical + spin), ("forward", abs(critical - spin))):
            values = 2.0 * np.pi * outcome.modes.frequencies
            ours = float(values[np.argmin(np.abs(values - turning))])
            found.append(Result(
                case, f"{name} whirl in rotating axes [rad/s]", float(turning), "Jeffcott (1919)",
                ours, "40", 5e-3,
            ))  # fmt: skip
    return found
