# SPDX-License-Identifier: LGPL-3.0-or-later
"""A robot on eight cables: winches move a platform through a frame along a loop.

A platform on eight cables has two more than it needs. The controller takes the tensions nearest to
400 N that carry the weight at the wanted place, and pays out the lengths that cables then have
without tension (Pott 2018, "Cable-Driven Parallel Robots", chapters 3 and 4); what acceleration
needs is left out. A load in addition moves the platform by the stiffness of all cables.

Run: ``python examples/cable_robot.py``, then ``flexfem view results/cable_robot``; ``--smoke`` for
a few steps.
"""

import sys
from functools import cache
from itertools import product

import numpy as np

import flexfem as ff

ROOM, SIZE = np.array([2.0, 1.5, 1.2]), np.array([0.25, 0.2, 0.12])  # halves of frame, platform, m
MASS, EXTENSION, PULL, DAMPING, G = 25.0, 2e5, 400.0, 100.0, 9.81  # kg, N, N, N s/m, m/s^2
TIME = 6.0  # of a loop, s
AT = np.array(list(product((-1.0, 1.0), repeat=3)))
#: Cables from above end at lower edges and near the middle, so that they hold against every turn.
WINCHES = ROOM * AT
EYES = SIZE * AT * np.where(AT[:, 2:] > 0.0, [0.2, 1.0, -1.0], [1.0, 0.2, -1.0])
TURNING = ff.SmoothStep(0.0, TIME, 0.0, 2.0 * np.pi)


def path(t: float) -> np.ndarray:
    """Place of the platform (m): a loop that goes up and down twice."""
    a = TURNING(t)
    return np.array([1.1 * np.sin(a), 0.7 * (1.0 - np.cos(a)) - 0.7, 0.4 * np.sin(2.0 * a)])


def directions(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (8,) of the cables, m, and wrenches (8, 6) of unit tensions on the platform."""
    arms = WINCHES - EYES - place
    lengths = np.linalg.norm(arms, axis=1)
    u = arms / lengths[:, None]
    return lengths, np.hstack([u, np.cross(EYES, u)])


def tensions(place: np.ndarray) -> np.ndarray:
    """Tensions (8,) in N that carry the weight, nearest to the wanted ones."""
    _, wrenches = directions(place)
    missing = [0.0, 0.0, MASS * G, 0.0, 0.0, 0.0] - PULL * wrenches.sum(axis=0)
    return PULL + np.linalg.lstsq(wrenches.T, missing)[0]


@cache
def rest_lengths(t: float) -> np.ndarray:
    """Lengths (8,) of the cables without tension (m) at a time."""
    place = path(t)
    return directions(place)[0] / (1.0 + tensions(place) / EXTENSION)


def build(load: float = 0.0, speed: float = 1.0) -> ff.Model:
    """The robot, with a load (kg) that its controller does not know, or standing (speed 0)."""
    model = ff.Model("cable_robot")
    inertia = MASS / 3.0 * (SIZE @ SIZE - SIZE**2)
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody(
            "platform", MASS, inertia, position=path(0.0), shape=ff.Box(tuple(2.0 * SIZE))
        ),
        ff.PositionProbe("at", ff.Marker("platform")),
    )
    for k, (corner, eye) in enumerate(zip(WINCHES, EYES, strict=True)):
        name = f"cable_{k}"
        model.add(
            ff.Cable(name, [ff.Ground(corner), ff.Marker("platform", offset=eye)],
                     axial_stiffness=EXTENSION, damping=DAMPING,
                     rest_length=lambda t, k=k: rest_lengths(speed * t)[k]),
            ff.CableProbe(f"pull_{k}", name),
        )  # fmt: skip
    if load:
        model.add(ff.PointForce("load", ff.Marker("platform"), (0.0, 0.0, -load * G)))
    return model


def sag(load: float) -> float:
    """How far (m) a load moves the platform down at the start, by the stiffness of all cables.

    The tension's own stiffness is left out, which is to theirs as PULL to EXTENSION.
    """
    lengths, wrenches = directions(path(0.0))
    K = np.einsum("n,ni,nj->ij", EXTENSION / lengths, wrenches, wrenches)
    return float(-np.linalg.solve(K, [0.0, 0.0, -load * G, 0.0, 0.0, 0.0])[2])


def main(*, smoke: bool) -> None:
    """Sag at rest; then drive along the path."""
    options = ff.StaticOptions(load_steps=1, gravity_load="constant", quiet=True)
    found = path(0.0)[2] - ff.solve_static(build(10.0, 0.0), options).history["at_z"][-1]
    print(f"10 kg move it down by {1e3 * found:.4f} mm, by the stiffness of the cables "
          f"{1e3 * sag(10.0):.4f} mm")  # fmt: skip
    assert abs(found / sag(10.0) - 1.0) < 0.02  # one cable of the eight is 10 %
    options = ff.RunOptions(dt=5e-3, t_end=0.05 if smoke else TIME + 0.5, quiet=True, every=10,
                            output=None if smoke else "results/cable_robot")  # fmt: skip
    history = ff.simulate(build(), options, case="cable_robot").history
    wanted = np.array([path(t) for t in history["t"]])
    at = np.column_stack([history[f"at_{c}"] for c in "xyz"])
    pulls = np.array([history[f"pull_{k}_tension"] for k in range(8)])
    off = np.linalg.norm(at - wanted, axis=1)
    print(f"on the way it is {1e3 * off.max():.2f} mm off at most, at the end "
          f"{1e6 * off[-1]:.2f} um; cables pull with {pulls.min():.0f} to {pulls.max():.0f} N",
    )  # fmt: skip


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
