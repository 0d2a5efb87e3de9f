# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 2: a four-bar linkage, its motor, and measurements.

Three flexible steel bars (10 x 4 mm, E = 2.1e11 N/m^2, nu = 0.3, rho = 7850 kg/m^3) and the ground
make a crank-rocker: crank AB of 100 mm, coupler BC, rocker CD, with A at the origin and D at 400 mm
along X. Hinges about Z join them. A motor rotates the crank by one turn in ``--period`` seconds,
from rest to rest.

History: ``crank_angle`` and ``rocker_angle`` (rad) from the X axis; ``torque_fx``, ``torque_fy``,
``torque_fz`` (N), ``torque_mx``, ``torque_my``, ``torque_mz`` (N m), exerted by the motor on the
crank; ``pin_fx``, ``pin_fy``, ``pin_fz`` (N), ``pin_mx``, ``pin_my``, ``pin_mz`` (N m), exerted by
the pin at C on the rocker, in the axes of the rocker's end.

Expected: the rocker swings by 0.7236 rad and back (a rigid one: 0.7235). A whole turn
takes no work in the end: ``torque_mz`` is as much negative as positive.
Run: ``python cases/tutorial_2_four_bar.py``.
"""

import math
import sys

import flexfem as ff

A, C, D = (0.0, 0.0, 0.0), (0.35, 0.3, 0.0), (0.4, 0.0, 0.0)
Z = (0.0, 0.0, 1.0)


def build(
    *, elements: int, crank: float, width: float, height: float, youngs_modulus: float,
    poisson_ratio: float, density: float, period: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` elements a bar that goes round once."""
    B = (0.0, crank, 0.0)
    bars = {"crank": (A, B), "coupler": (B, C), "rocker": (C, D)}
    model = ff.Model("tutorial_2_four_bar", mesh=ff.LineMesh.straight(bars, elements))

    # every bar has nodes of its own, also where two of them meet: joints join them
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    section = ff.Section.rectangle(width, height, steel)
    model.add(*(ff.Beam(name, section, orientation=Z) for name in bars))

    start = {name: ff.Marker(name, "start") for name in bars}
    end = {name: ff.Marker(name, "end") for name in bars}
    model.add(
        ff.Revolute("pin_a", ff.Ground(A), start["crank"], axis=Z),
        ff.Revolute("pin_b", end["crank"], start["coupler"], axis=Z),
        ff.Revolute("pin_c", end["coupler"], start["rocker"], axis=Z),
        ff.Revolute("pin_d", ff.Ground(D), end["rocker"], axis=Z),
    )

    # the drive prescribes the angle that pin_a leaves free
    turn = ff.SmoothStep(0.0, period, 0.0, 2.0 * math.pi)
    model.add(ff.PrescribedAngle("motor", ff.Ground(A), start["crank"], axis=Z, angle=turn))

    model.add(
        ff.Probe("crank_turn", (start["crank"], end["crank"]), ("crank_angle",), _angle,
                 unwrap=("crank_angle",)),
        ff.Probe("rocker_turn", (end["rocker"], start["rocker"]), ("rocker_angle",), _angle),
        ff.ReactionProbe("torque", "motor"),
        ff.ReactionProbe("pin", "pin_c", axes="b"),
    )  # fmt: skip
    return model


def _angle(t: float, first: ff.MarkerState, second: ff.MarkerState) -> tuple[float]:
    """Angle of the line from the first marker to the second."""
    x, y, _ = second.position - first.position
    return (math.atan2(y, x),)


CASE = ff.Case(
    name="tutorial_2_four_bar",
    summary="tutorial 2: four-bar linkage with a motor, reactions and angles",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 4, "beam elements of each bar", minimum=1),
        ff.Option("crank", float, 0.1, "its length", unit="m", above=0.0, maximum=0.2),
        ff.Option("width", float, 0.01, "of the bars, along Z", unit="m", above=0.0),
        ff.Option("height", float, 0.004, "of the bars, in their plane", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the bars", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the bars", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the bars", unit="kg/m^3", above=0.0),
        ff.Option("period", float, 0.5, "duration of the turn", unit="s", above=0.0),
    ),
    dt=1e-3,
    t_end=0.5,
    smoke={"elements": 1, "t_end": 3e-3},
    results=lambda history: {
        "swing_of_rocker": float(history["rocker_angle"].max() - history["rocker_angle"].min()),
        "largest_torque": float(abs(history["torque_mz"]).max()),
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
