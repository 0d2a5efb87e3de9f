# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tensegrity prism is deployed by its cables: three struts that do not touch, nine cables.

Winches shorten the two triangles of cables and pay out the three between them, along the family of
prisms in balance. Of all of them the top is twisted against the bottom by 90 - 180 / 3 = 30 degrees
(Tibert, Pellegrino 2003). A further twist needs no stretch to first order: prestress alone
makes the prism stiff against it, with a frequency in closed form.

Run: ``python examples/tensegrity.py``, then ``flexfem view results/tensegrity``; ``--smoke`` for a
few steps.
"""

import sys
from collections.abc import Callable

import numpy as np

import flexfem as ff

STRUT, MASS, RADIUS = 2.0, 1.2, 0.015  # m, kg, m
EXTENSION, PULL, DAMPING = 5e4, 150.0, 20.0  # cables: N; tension between triangles, N; N s/m
TURN = np.deg2rad(150.0)  # of an upper end of a strut against its lower end
FOLDED, DEPLOYED, TIME = 1.01, 0.55, 4.0  # radii of the triangles, m; s
LOWER = [(k, (k + 1) % 3) for k in range(3)]
UPPER = [(3 + i, 3 + j) for i, j in LOWER]
BETWEEN = [((k + 1) % 3, 3 + k) for k in range(3)]


def ends(radius: float) -> np.ndarray:
    """Three lower and three upper ends of the struts (m) of a prism in balance."""
    height = np.sqrt(STRUT**2 - 2.0 * radius**2 * (1.0 - np.cos(TURN)))
    angle = 2.0 / 3.0 * np.pi * np.arange(3)
    angle = np.append(angle, angle + TURN)
    z = np.repeat([0.0, height], 3)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def rest_length(pair: tuple[int, int], radius: float) -> float:
    """Length (m) without tension of a cable whose prism in balance has this radius."""
    points = ends(radius)
    length = np.linalg.norm(points[pair[1]] - points[pair[0]])
    between = np.linalg.norm(points[BETWEEN[0][1]] - points[BETWEEN[0][0]])
    # force densities of the triangles are those between them over the root of 3
    share = 1.0 if pair in BETWEEN else 1.0 / np.sqrt(3.0)
    return float(length / (1.0 + share * PULL * length / between / EXTENSION))


def build(start: float, radius: Callable[[float], float]) -> ff.Model:
    """The prism with the radius of its start, and that for which its cables are long enough."""
    points = ends(start)
    model = ff.Model("tensegrity")
    for k in range(3):
        arm = points[3 + k] - points[k]
        along = arm / STRUT
        aside = np.cross(along, [0.0, 0.0, 1.0])
        aside /= np.linalg.norm(aside)
        inertia = MASS * STRUT**2 / 12.0
        model.add(
            ff.RigidBody(f"strut_{k}", MASS, (0.5 * MASS * RADIUS**2, inertia, inertia),
                         position=0.5 * (points[k] + points[3 + k]),
                         rotation=np.column_stack([along, aside, np.cross(along, aside)]),
                         shape=ff.Cylinder(RADIUS, STRUT)),
        )  # fmt: skip
    half = 0.5 * STRUT
    tips = [
        ff.Marker(f"strut_{k % 3}", offset=(half if k > 2 else -half, 0.0, 0.0)) for k in range(6)
    ]
    for number, pair in enumerate([*LOWER, *UPPER, *BETWEEN]):
        model.add(ff.Cable(
            f"cable_{number}", [tips[pair[0]], tips[pair[1]]], axial_stiffness=EXTENSION,
            rest_length=lambda t, pair=pair: rest_length(pair, radius(t)), damping=DAMPING,
        ))  # fmt: skip
    model.add(*(ff.PositionProbe(f"tip_{k}", tip) for k, tip in enumerate(tips)))
    return model


def shape(tips: np.ndarray) -> tuple[float, float]:
    """Twist (degrees) of the upper triangle against the lower one, and height (m), of tips."""
    low, high = tips[:3].mean(axis=0), tips[3:].mean(axis=0)
    axis = (high - low) / np.linalg.norm(high - low)
    a, b = tips[1] - low, tips[3] - high
    return float(np.rad2deg(np.arctan2(np.cross(a, b) @ axis, a @ b))), float((high - low) @ axis)


def twisting(radius: float) -> float:
    """Frequency (Hz) of the twist, from the tension and the length of cables that are longest."""
    points = ends(radius)
    between = np.linalg.norm(points[BETWEEN[0][1]] - points[BETWEEN[0][0]])
    rise = radius**2 * np.sin(TURN) / points[3, 2]  # of the height by the turn
    stiffness = 3.0 * np.sqrt(3.0) * PULL * radius**2 / between
    inertia = 0.25 * MASS * (radius**2 * (2.0 - np.cos(TURN)) + rise**2)
    return float(np.sqrt(stiffness / inertia) / (2.0 * np.pi))


def main(*, smoke: bool) -> None:
    """Deploy it; then find its frequencies."""
    options = ff.RunOptions(dt=0.01, t_end=0.1 if smoke else TIME + 1.0, quiet=True, every=5,
                            output=None if smoke else "results/tensegrity")  # fmt: skip
    radius = ff.SmoothStep(0.0, TIME, FOLDED, DEPLOYED)
    history = ff.simulate(build(FOLDED, radius), options, case="tensegrity").history
    last = np.array([[history[f"tip_{k}_{c}"][-1] for c in "xyz"] for k in range(6)])
    twist, height = shape(last)
    expected = ends(radius(options.t_end))[3, 2]
    print(f"twisted by {twist:.3f} degrees, {height:.4f} m high, in closed form 30 degrees and "
          f"{expected:.4f} m")  # fmt: skip
    assert abs(twist - 30.0) < 0.1
    assert abs(height / expected - 1.0) < 1e-3
    still = build(DEPLOYED, lambda t: DEPLOYED)
    found = ff.find_modes(still, ff.ModeOptions(modes=15, quiet=True)).history["frequency"]
    print("frequencies", *(f"{one:.3f}" for one in found), "Hz, in closed form",
          f"{twisting(DEPLOYED):.3f} Hz")  # fmt: skip


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
