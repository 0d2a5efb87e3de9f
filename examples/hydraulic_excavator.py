# SPDX-License-Identifier: LGPL-3.0-or-later
"""A boom of an excavator that a hydraulic cylinder lifts: oil pressures as states of a force.

The boom is a beam with a load at its end. The cylinder's oil is stiff (its vibration alone has more
than 30 Hz) and is stepped with 4 ms; its valve opens and closes smoothly.

The force that holds the boom follows from weights and levers of a rigid one.

Run: ``python examples/hydraulic_excavator.py``, then ``flexfem view results/hydraulic_excavator``;
``--smoke`` for a few steps.
"""

import sys

import numpy as np

import flexfem as ff

BORE, ROD = 7.9e-3, 4.0e-3  # areas of the piston, m^2
BULK, LEAK = 1.4e9, 5e-13  # Pa, m^3/(s Pa)
STROKE, DEAD = 0.9, 1e-4  # m, m^3
LENGTH, SUPPLY, RETURN = 4.0, 21e6, 1e5  # m, Pa
FOOT = (0.0, 0.0, -0.6)
BUCKET, AREA, DENSITY, G = 400.0, 0.3 * 0.0523, 7850.0, 9.81  # kg, m^2, kg/m^3, m/s^2
OPEN, CLOSE = ff.SmoothStep(0.2, 0.5), ff.SmoothStep(2.0, 2.4)


def valve(t: float) -> float:
    """Opening from -1 to 1: the boom is lifted for two seconds."""
    return OPEN(t) - CLOSE(t)


def cylinder(
    t: float, ends: ff.Ends, z: np.ndarray, parameters: np.ndarray
) -> tuple[np.ndarray, None, np.ndarray]:
    """Force of the pressures z on both sides of the piston, and what the flows make of them."""
    start, flow = parameters
    arm = ends.positions[1] - ends.positions[0]
    length = np.linalg.norm(arm)
    along = arm / length
    speed = (ends.velocities[1] - ends.velocities[0]) @ along
    out = np.clip(length - start, -0.1, STROKE)
    opening = valve(t)
    sides = (SUPPLY, RETURN) if opening > 0.0 else (RETURN, SUPPLY)
    drops = np.array([sides[0] - z[0], z[1] - sides[1]])
    # turbulent flow, smooth where the drop changes its sign
    flows = flow * opening * drops / (drops**2 + 1e8) ** 0.25
    leak = LEAK * (z[0] - z[1])
    rates = np.array([
        (flows[0] - BORE * speed - leak) / (DEAD + BORE * (out + 0.1)),
        (ROD * speed - flows[1] + leak) / (DEAD + ROD * (STROKE - out + 0.1)),
    ])  # fmt: skip
    push = (z[0] * BORE - z[1] * ROD) * along
    return np.array([-push, push]), None, BULK * rates


def held(x: float, z: float) -> float:
    """Force (N) of the cylinder that holds a rigid boom whose end is at (x, z)."""
    along = np.array([x, 0.0, z]) / LENGTH
    weights = G * x * (BUCKET + 0.5 * LENGTH * AREA * DENSITY)
    arm = along - FOOT
    return float(weights / np.linalg.norm(np.cross(along, arm / np.linalg.norm(arm))))


def build() -> ff.Model:
    """The boom on its hinge, the cylinder, and a load."""
    steel = ff.Material(youngs_modulus=2.1e11, poisson_ratio=0.3, density=DENSITY)
    mesh = ff.LineMesh.straight({"boom": [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}, elements=8)
    model = ff.Model("excavator", mesh=mesh)
    root, ear, tip = (ff.Marker("boom", at) for at in ("start", 0.25, "end"))
    hold = held(LENGTH, 0.0) / BORE
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.Beam("boom", ff.Section.rectangle(0.3, 0.0523, steel), orientation=(0, 0, 1),
                damping=1e-4),
        ff.RigidBody("bucket", BUCKET, (40.0, 40.0, 40.0), position=(LENGTH, 0.0, 0.0)),
        ff.Rigid("bolt", tip, ff.Marker("bucket")),
        ff.Revolute("hinge", ff.Ground(), root, axis=(0.0, 1.0, 0.0)),
        ff.Force(
            "cylinder", [ff.Ground(FOOT), ear], cylinder, states=2, initial=(hold, RETURN),
            parameters=(np.hypot(1.0, 0.6), 3e-7),
        ),
        ff.PositionProbe("load", ff.Marker("bucket")),
        ff.ReactionProbe("push", "cylinder"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def main(*, smoke: bool) -> None:
    """Lift the boom, and print what the cylinder does."""
    options = ff.RunOptions(dt=4e-3, t_end=0.02 if smoke else 4.0, quiet=True, every=5,
                            output=None if smoke else "results/hydraulic_excavator")  # fmt: skip
    history = ff.simulate(build(), options, case="hydraulic_excavator").history
    force = np.sqrt(sum(history[f"push_f{axis}"] ** 2 for axis in "xyz"))
    print(f"the bucket rises by {history['load_z'][-1]:.2f} m, the cylinder pushes with "
          f"{force[1:].min() / 1e3:.0f} to {force.max() / 1e3:.0f} kN")  # fmt: skip
    if smoke:
        return
    late = history["t"] > 2.5  # the valve is closed, the boom still swings
    mean, x, z = (values[late].mean() for values in (force, history["load_x"], history["load_z"]))
    print(f"in the end {mean / 1e3:.1f} kN on average, a rigid boom needs {held(x, z) / 1e3:.1f}")
    assert abs(mean / held(x, z) - 1.0) < 0.03  # its own weight is a third of it


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
