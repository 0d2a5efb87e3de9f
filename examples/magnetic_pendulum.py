# SPDX-License-Identifier: LGPL-3.0-or-later
"""A magnet on a rod swings over three magnets in the table, and comes to rest above one of them.

Magnets are dipoles: every pair exerts forces and couples by one ``ff.Force``, in which nothing is
linearised. The path is chaotic until the air has taken enough energy. A small swing over a single
magnet has a frequency in closed form, which the modes of the model must have.

Run: ``python examples/magnetic_pendulum.py``, then ``flexfem view results/magnetic_pendulum``;
``--smoke`` for a few steps.
"""

import sys

import numpy as np

import flexfem as ff

LENGTH, MASS, GAP, G = 1.0, 0.2, 0.06, 9.81  # rod and gap between the magnets, m; kg, m/s^2
BOB, TABLE = 6.0, 9.0  # dipoles, A m^2: cylinders of neodymium of some 6 and 9 cm^3
INERTIA = 4e-5  # of the bob about its centre, kg m^2
AIR = 0.04  # N s/m
CONSTANT = 1e-7  # vacuum permeability over four pi, N/A^2
PLACES = 0.12 * np.array([(np.cos(a), np.sin(a), 0.0) for a in (0.5, 2.594, 4.689)])  # m
UP = (0.0, 0.0, 1.0)


def field(r: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Flux density (T) at r (n, 3) from dipoles m (n, 3)."""
    d = np.linalg.norm(r, axis=1, keepdims=True)
    along = (m * r).sum(axis=1, keepdims=True)
    return CONSTANT * (3.0 * along * r / d**5 - m / d**3)


def attraction(r: np.ndarray, m: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Forces (N) on dipoles n at r (n, 3) from dipoles m."""
    d = np.linalg.norm(r, axis=1, keepdims=True)
    u = r / d
    mu, nu, mn = ((a * b).sum(axis=1, keepdims=True) for a, b in ((m, u), (n, u), (m, n)))
    return 3.0 * CONSTANT / d**4 * (mu * n + nu * m + (mn - 5.0 * mu * nu) * u)


def magnets(
    t: float, ends: ff.Ends, z: np.ndarray, strengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces and couples on the bob, the first marker, and on the magnets of the table."""
    moments = strengths[:, None] * ends.rotations[:, :, 2]
    bob, others = np.broadcast_to(moments[0], moments[1:].shape), moments[1:]
    r = ends.positions[0] - ends.positions[1:]
    on_bob = attraction(r, others, bob)
    couples = np.cross(bob, field(r, others))
    back = np.cross(others, field(-r, bob))
    forces = np.vstack([on_bob.sum(axis=0), -on_bob])
    forces[0] -= AIR * ends.velocities[0]
    return forces, np.vstack([couples.sum(axis=0), back])


def build(places: np.ndarray = PLACES, start: tuple[float, float] = (0.45, 0.6)) -> ff.Model:
    """The pendulum, turned aside by two angles (rad), above magnets at given places."""
    model = ff.Model("magnetic_pendulum")
    tilt, round_z = start
    c, s, e, f = np.cos(tilt), np.sin(tilt), np.cos(round_z), np.sin(round_z)
    turn = np.array([(e * c, -f, e * s), (f * c, e, f * s), (-s, 0.0, c)])
    hook = np.array([0.0, 0.0, LENGTH + GAP])
    rod = ff.Marker("bob", offset=(0.0, 0.0, LENGTH))
    half = ff.Pose((0.0, 0.0, 0.5 * LENGTH), np.eye(3))
    shape = ff.CompoundShape([
        (ff.Cylinder(0.025, 0.04, UP), ff.Pose((0.0, 0.0, 0.0), np.eye(3))),
        (ff.Cylinder(0.004, LENGTH, UP), half),
    ])  # fmt: skip
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("bob", MASS, (INERTIA,) * 3, position=hook - LENGTH * turn[:, 2],
                     rotation=turn, shape=shape),
        ff.Universal("hook", ff.Ground(hook), rod, turn[:, 0], second_axis=turn[:, 1]),
        ff.PositionProbe("at", ff.Marker("bob")),
        ff.EnergyProbe(),
    )  # fmt: skip
    ends: list[ff.Marker | ff.Ground] = [ff.Marker("bob")]
    for k, place in enumerate(places):
        name = f"magnet_{k}"
        model.add(ff.RigidBody(name, 0.1, (1e-5,) * 3, position=place,
                               shape=ff.Cylinder(0.03, 0.03, UP)),
                  ff.Rigid(f"glue_{k}", ff.Ground(place), ff.Marker(name)))  # fmt: skip
        ends.append(ff.Marker(name))
    strengths = np.array([BOB, *([TABLE] * len(places))])
    model.add(ff.Force("magnets", ends, magnets, parameters=strengths))
    return model


def small_swing() -> tuple[float, float]:
    """Frequency (Hz) above a single magnet: that of the model, and in closed form.

    At an angle q and with s = LENGTH / GAP the potential of the dipoles is to second order
    -CONSTANT BOB TABLE / GAP^3 (2 - (6 s^2 + 6 s + 1) q^2).
    """
    modes = ff.find_modes(build(np.zeros((1, 3)), (0.0, 0.0)), ff.ModeOptions(modes=2, quiet=True))
    s = LENGTH / GAP
    magnetic = 2.0 * CONSTANT * BOB * TABLE / GAP**3 * (6.0 * s**2 + 6.0 * s + 1.0)
    stiffness = MASS * G * LENGTH + magnetic
    exact = np.sqrt(stiffness / (MASS * LENGTH**2 + INERTIA)) / (2.0 * np.pi)
    return float(modes.history["frequency"].min()), exact


def main(*, smoke: bool) -> None:
    """Frequency of a small swing; then let it go."""
    found, exact = small_swing()
    print(f"above one magnet it swings with {found:.4f} Hz, in closed form {exact:.4f} Hz")
    assert abs(found / exact - 1.0) < 1e-4  # without couples it is 1 % off
    options = ff.RunOptions(dt=5e-3, t_end=0.05 if smoke else 60.0, quiet=True, every=4,
                            output=None if smoke else "results/magnetic_pendulum")  # fmt: skip
    history = ff.simulate(build(), options, case="magnetic_pendulum").history
    end = np.array([history["at_x"][-1], history["at_y"][-1]])
    off = np.linalg.norm(PLACES[:, :2] - end, axis=1)
    print(
        f"after {history['t'][-1]:.0f} s it is {1e3 * off.min():.1f} mm off magnet {off.argmin()}"
    )
    assert smoke or off.min() < 0.03  # the middle between them is 0.12 m off


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
