# SPDX-License-Identifier: LGPL-3.0-or-later
"""An engine drives a pump and an alternator by one belt, which a spring on an arm keeps taut.

The crank turns unevenly, twice a turn, and runs up through the frequencies of the drive. These are
compared with the three equations of its small motions, whose belt has the length of arcs and of
tangents to circles; and the friction that the alternator's pulley needs by Euler and Eytelwein.

Run: ``python examples/belt_drive.py``, then ``flexfem view results/belt_drive``; ``--smoke`` for a
few steps.
"""

import sys

import numpy as np
from scipy.linalg import eigh

import flexfem as ff

#: Place (m), radius (m), sense of rotation, and inertia (kg m^2) of pulleys in the belt's order.
PULLEYS = {
    "crank": ((0.0, 0.0), 0.08, 1.0, 0.02),
    "tensioner": ((0.11, 0.15), 0.03, -1.0, 1e-3),
    "pump": ((0.05, 0.28), 0.06, 1.0, 2e-3),
    "alternator": ((-0.25, 0.18), 0.03, 1.0, 3e-3),
}
PIVOT, ARM, SPRING, REST = np.array([0.14, 0.05]), 7e-3, 30.0, 0.5  # m, kg m^2, N m/rad, kg
EXTENSION, PULL, DAMPING = 1e5, 400.0, 20.0  # belt: N, N, N s/m
LOADS = {"pump": 4.0, "alternator": 4.0}  # N m
FAST, TIME, UNEVEN = 2.0 * np.pi * 50.0, 3.0, 0.01  # rad/s, s, rad
Z = (0.0, 0.0, 1.0)


def geometry(turn: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Length of the belt, of its straight parts, and angles around pulleys, by that of the arm."""
    c, s = np.cos(turn), np.sin(turn)
    at = {name: np.array(place) for name, (place, *_) in PULLEYS.items()}
    at["tensioner"] = PIVOT + np.array([[c, -s], [s, c]]) @ (at["tensioner"] - PIVOT)
    centres, r = np.array(list(at.values())), np.array([p[1] * p[2] for p in PULLEYS.values()])
    d = np.roll(centres, -1, axis=0) - centres
    apart = np.linalg.norm(d, axis=1)
    straight = np.sqrt(apart**2 - (np.roll(r, -1) - r) ** 2)
    course = np.arctan2(d[:, 1], d[:, 0]) - np.arcsin((np.roll(r, -1) - r) / apart)
    wraps = (course - np.roll(course, 1)) * np.sign(r) % (2.0 * np.pi)
    return float(straight.sum() + np.abs(r) @ wraps), straight, wraps


def small_motions() -> tuple[np.ndarray, float]:
    """Frequencies (Hz) of arm, pump and alternator, and the moment (N m) of the arm's spring."""
    h = 1e-4
    before, here, after = (geometry(x)[0] for x in (-h, 0.0, h))
    rate, bend = (after - before) / (2.0 * h), (after - 2.0 * here + before) / h**2
    _, straight, wraps = geometry(0.0)
    free = np.array([straight[:2].sum() + PULLEYS["tensioner"][1] * wraps[1], *straight[2:]])
    pump, alternator = PULLEYS["pump"][1], PULLEYS["alternator"][1]
    stretch = np.array([(rate, pump, 0.0), (0.0, -pump, alternator), (0.0, 0.0, -alternator)])
    K = stretch.T @ np.diag((EXTENSION + PULL) / free) @ stretch
    K[0, 0] += SPRING + PULL * bend
    M = np.diag([ARM, PULLEYS["pump"][3], PULLEYS["alternator"][3]])
    return np.sqrt(eigh(K, M, eigvals_only=True)) / (2.0 * np.pi), PULL * rate


def turned(t: float) -> float:
    """Angle of the crank (rad): a run up, and twice a turn a little ahead and back."""
    steady = 0.5 * FAST / TIME * t * t
    return steady + UNEVEN * np.sin(2.0 * steady)


def build(*, runs: bool = True) -> ff.Model:
    """The drive, which runs up, or stands without loads and damping."""
    model = ff.Model("belt_drive")
    guides = []
    for name, (place, radius, sense, inertia) in PULLEYS.items():
        arm = name == "tensioner"
        centre = np.array([*place, 0.0])
        pivot = np.array([*PIVOT, 0.0]) if arm else centre
        own = ff.Marker(name, offset=pivot - centre)
        mass = REST if arm else 2.0
        about = ARM - mass * np.sum((pivot - centre) ** 2) if arm else inertia
        model.add(
            ff.RigidBody(name, mass, (about,) * 3, position=centre,
                         shape=ff.Cylinder(radius - 0.002, 0.03, Z)),
            ff.Revolute(f"{name} bearing", ff.Ground(pivot), own, axis=Z),
        )  # fmt: skip
        guides.append(ff.Sheave(ff.Marker(name), radius, (0.0, 0.0, sense), grip=not arm))
        if arm:
            model.add(ff.TorsionalSpringDamper("spring", ff.Ground(pivot), own, axis=Z,
                                               stiffness=SPRING, damping=0.5 if runs else 0.0,
                                               preload=-small_motions()[1]))  # fmt: skip
        if runs and name in LOADS:
            rise = ff.SmoothStep(0.0, 0.3)
            model.add(ff.PointMoment(f"{name} load", ff.Marker(name), (0.0, 0.0, -LOADS[name]),
                                     amplitude=rise))  # fmt: skip
    angle = turned if runs else (lambda t: 0.0)
    model.add(
        ff.Cable("belt", guides, closed=True, axial_stiffness=EXTENSION, preload=PULL,
                 damping=DAMPING if runs else 0.0),
        ff.PrescribedAngle("engine", ff.Ground(), ff.Marker("crank"), axis=Z, angle=angle),
        *(ff.CableProbe(f"part_{k}", "belt", part=k) for k in range(3)),
    )  # fmt: skip
    return model


def main(*, smoke: bool) -> None:
    """Find the frequencies; then run up."""
    still = ff.find_modes(build(runs=False), ff.ModeOptions(modes=3, quiet=True))
    found, (own, _) = still.history["frequency"], small_motions()
    print("frequencies", *(f"{f:.3f}" for f in found), "Hz, by small motions",
          *(f"{f:.3f}" for f in own))  # fmt: skip
    assert np.allclose(found, own, rtol=1e-4)  # without PULL * bend 20 % less
    options = ff.RunOptions(dt=5e-4, t_end=0.01 if smoke else TIME, quiet=True, every=10,
                            output=None if smoke else "results/belt_drive")  # fmt: skip
    history = ff.simulate(build(), options, case="belt_drive").history
    pulls = np.array([history[f"part_{k}_tension"] for k in range(3)])
    needed = np.abs(np.log(pulls[1] / pulls[2])).max() / geometry(0.0)[2][3]
    print(f"tensions from {pulls.min():.0f} to {pulls.max():.0f} N, "
          f"friction needed at the alternator {needed:.2f}")  # fmt: skip


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
