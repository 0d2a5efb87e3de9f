# SPDX-License-Identifier: LGPL-3.0-or-later
"""A muscle of Hill's type lifts a forearm with a weight in the hand.

Activation and the length of the fibres are states of an ``ff.Force``: activation follows the
excitation in 15 ms, and back in 60 ms (Thelen 2003); fibres have an active force by length and by
speed, and a passive one, and pull at an elastic tendon. So the muscle is stiff, and the steps need
not be small. Where the arm comes to rest follows from the balance of moments about the elbow.

Run: ``python examples/muscle.py``, then ``flexfem view results/muscle``; ``--smoke`` for a few
steps.
"""

import sys

import numpy as np
from scipy.optimize import brentq

import flexfem as ff

ISOMETRIC, FIBRE, TENDON = 900.0, 0.13, 0.20  # N; lengths at rest, m
FASTEST, STIFFNESS = 10.0, 35.0  # fibre lengths a second; of the tendon, isometric forces a strain
ORIGIN, INSERTION = np.array([0.03, 0.0, 0.0]), 0.05  # at the shoulder; from the elbow, m
UPPER, FORE, WEIGHT, ARM, G = 0.30, 0.28, 5.0, 1.5, 9.81  # m, m, kg, kg, m/s^2
EXCITATION = ff.SmoothStep(0.2, 0.4, 0.05, 0.6)
AXIS = (0.0, -1.0, 0.0)
ELBOW = np.array([0.0, 0.0, -UPPER])


def active(length: np.ndarray) -> np.ndarray:
    """Active force of fibres by length, 1 at their length at rest."""
    return np.exp(-(((length / FIBRE - 1.0) / 0.45) ** 2))


def passive(length: np.ndarray) -> np.ndarray:
    """Force of stretched fibres alone."""
    return np.expm1(5.0 * np.maximum(length / FIBRE - 1.0, 0.0) / 0.6) / np.expm1(5.0)


def tendon(length: np.ndarray) -> np.ndarray:
    """Force of a tendon, slack where it is shorter than at rest; smooth."""
    strain = length / TENDON - 1.0
    return STIFFNESS * 0.5 * (strain + np.sqrt(strain**2 + 1e-8))


def shortening(force: np.ndarray, activation: np.ndarray) -> np.ndarray:
    """Fibre lengths a second by Hill's hyperbola, and a steeper line where load stretches them."""
    shorter = FASTEST * (1.0 - force) / (1.0 + 4.0 * force)
    longer = FASTEST / 5.0 * (1.0 - force)
    return (0.25 + 0.75 * activation) * np.where(force < 1.0, shorter, longer)


def muscle(t: float, ends: ff.Ends, z: np.ndarray) -> tuple[np.ndarray, None, np.ndarray]:
    """Pull of the tendon, and rates of activation and fibre length."""
    activation, fibre = z
    arm = ends.positions[1] - ends.positions[0]
    length = np.linalg.norm(arm)
    force = tendon(length - fibre)
    wanted = EXCITATION(t)
    quick = 0.015 * (0.5 + 1.5 * activation)
    slow = 0.060 / (0.5 + 1.5 * activation)
    rate = (wanted - activation) / (quick if wanted > activation else slow)
    relative = (force - passive(fibre)) / (activation * active(fibre))
    pull = ISOMETRIC * force * arm / length
    return np.array([pull, -pull]), None, np.array([
        rate, -FIBRE * shortening(relative, activation)
    ])  # fmt: skip


def bent(angle: float) -> np.ndarray:
    """Direction of the forearm, bent by an angle (rad) from hanging."""
    return np.array([np.sin(angle), 0.0, -np.cos(angle)])


def rest(excitation: float) -> tuple[float, float]:
    """Angle of the elbow (rad) and fibre length (m) where moments and forces are in balance."""

    def pulled(angle: float) -> tuple[float, float]:
        """Force that the load needs, over the isometric one, and length of the muscle."""
        line = ORIGIN - (ELBOW + INSERTION * bent(angle))
        lever = abs(np.cross(INSERTION * bent(angle), line / np.linalg.norm(line))[1])
        moment = G * np.sin(angle) * (WEIGHT * FORE + ARM * 0.5 * FORE)
        return moment / lever / ISOMETRIC, np.linalg.norm(line)

    def fibre(force: float, length: float) -> float:
        return brentq(lambda x: tendon(length - x) - force, 0.2 * FIBRE, length)

    def missing(angle: float) -> float:
        force, length = pulled(angle)
        x = fibre(force, length)
        return excitation * active(x) + passive(x) - force

    angle = brentq(missing, 1e-3, 2.6)
    return angle, fibre(*pulled(angle))


def build() -> ff.Model:
    """The arm, at rest with little excitation."""
    angle, fibre = rest(EXCITATION(0.0))
    along = bent(angle)
    turn = np.column_stack([along, (0.0, 1.0, 0.0), np.cross(along, (0.0, 1.0, 0.0))])
    bone = ff.Cylinder(0.02, FORE, (1.0, 0.0, 0.0))
    centre = ELBOW + 0.5 * FORE * along
    inertia = ARM * FORE**2 / 12.0
    elbow = ff.Marker("forearm", offset=(-0.5 * FORE, 0.0, 0.0))
    hand = ff.Marker("forearm", offset=(0.5 * FORE, 0.0, 0.0))
    model = ff.Model("muscle")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("upper arm", 2.0, (0.02, 0.02, 0.002), position=0.5 * ELBOW,
                     shape=ff.Cylinder(0.025, UPPER, (0.0, 0.0, 1.0))),
        ff.Rigid("shoulder", ff.Ground(0.5 * ELBOW), ff.Marker("upper arm")),
        ff.RigidBody("forearm", ARM, (1e-3, inertia, inertia), position=centre, rotation=turn,
                     shape=bone),
        ff.RigidBody("weight", WEIGHT, (0.01,) * 3, position=ELBOW + FORE * along, rotation=turn,
                     shape=ff.Sphere(0.05)),
        ff.Rigid("hand", hand, ff.Marker("weight")),
        ff.Revolute("elbow", ff.Ground(ELBOW), elbow, axis=AXIS),
        ff.Force("biceps", [ff.Ground(ORIGIN),
                            ff.Marker("forearm", offset=(INSERTION - 0.5 * FORE, 0.0, 0.0))],
                 muscle, states=2, initial=(EXCITATION(0.0), fibre)),
        ff.Probe("angle", ff.Marker("forearm"), ("elbow_angle",), lambda t, at: (
            np.arctan2((at.turn @ along)[0], -(at.turn @ along)[2]),
        )),
        ff.ReactionProbe("biceps_at", "biceps"),
    )  # fmt: skip
    return model


def main(*, smoke: bool) -> None:
    """Lift the weight."""
    options = ff.RunOptions(dt=4e-3, t_end=0.1 if smoke else 4.0, quiet=True, every=5,
                            output=None if smoke else "results/muscle")  # fmt: skip
    history = ff.simulate(build(), options, case="muscle").history
    angle, (end, _) = np.rad2deg(history["elbow_angle"]), rest(EXCITATION(options.t_end))
    print(f"the elbow bends from {angle[0]:.2f} to {angle[-1]:.2f} degrees, at rest it is "
          f"{np.rad2deg(end):.2f}")  # fmt: skip
    force = np.hypot(history["biceps_at_fx"], history["biceps_at_fz"])
    print(f"the muscle pulls with {force.max():.0f} N at most")
    # a degree more or less is 2 % of the force
    assert abs(angle[-1] - np.rad2deg(end)) < 0.05


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
