# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 8: a crane with a rope in two falls; cables, sheaves, a winch and friction.

A boom (steel tube, ``--length``, raised by ``--angle``) is clamped at its foot. The hoist rope runs
from a winch (``--winch``) over a sheave at the head of the boom, down around the sheave of the hook
block, which has the mass of ``--load``, and back up to the head. The winch hauls in ``--haul`` of
rope within ``--time``, from rest to rest, so that the load rises by half of it and swings, and the
boom springs. Sheaves rub by ``--friction``.

History: ``load_x``, ``load_y``, ``load_z`` (m) of the hook block; ``head_x``, ``head_y``,
``head_z`` (m) of the boom; ``pull_tension`` at the winch, ``pull_end_tension`` at the dead end (N)
and ``pull_stretch`` (m); ``energy_kinetic``, ``energy_strain``, ``energy_gravity``,
``energy_work``, ``energy_dissipation``, ``energy_balance`` (J).

Expected: the load rises by 3.000 m. While it is lifted the winch pulls with 9.95 kN at most, 1.31
times as much as the dead end; without friction with 8.25 kN, as the boom springs.
Run: ``python cases/tutorial_8_crane.py --friction 0``.
"""

import math
import sys

import flexfem as ff

#: Axis about which the rope runs over the sheaves, from the winch to the load.
ACROSS = (0.0, 1.0, 0.0)


def build(
    *, elements: int, length: float, angle: float, diameter: float, wall: float, load: float,
    rope: float, radius: float, friction: float, winch: tuple[float, ...], haul: float,
    time: float, gravity: tuple[float, ...],
) -> ff.Model:  # fmt: skip
    """Model of the crane."""
    rise = math.radians(angle)
    head = (length * math.cos(rise), 0.0, length * math.sin(rise))
    hook = (head[0], 0.0, 0.4 * head[2])
    steel = ff.Material(2.1e11, 0.3, 7850.0)

    model = ff.Model("tutorial_8_crane")
    model.add(
        ff.Gravity(gravity),
        ff.Beam("boom", ff.Section.tube(diameter - 2.0 * wall, diameter, steel),
                curve=ff.NurbsCurve.line((0.0, 0.0, 0.0), head, degree=3, elements=elements),
                orientation=ACROSS, damping=2e-3),
        ff.Rigid("foot", ff.Ground(), ff.Marker("boom", "start")),
        ff.RigidBody("hook", load, (0.1 * load,) * 3, position=hook,
                     shape=ff.Sphere(2.0 * radius)),
    )  # fmt: skip

    # the rope: winch, sheave of the head, sheave of the hook block, dead end
    over = ff.Sheave(ff.Marker("boom", "end"), radius, ACROSS, friction=friction)
    under = ff.Sheave(ff.Marker("hook"), radius, ACROSS, friction=friction)
    beside = (-radius * math.cos(rise), 0.0, radius * math.sin(rise))  # -X in the section's axes
    dead_end = ff.Marker("boom", "end", offset=beside)
    path = [ff.Ground(winch), over, under, dead_end]
    long = math.dist(winch, head) + 2.0 * (head[2] - hook[2])
    model.add(
        ff.Cable("rope", path, axial_stiffness=rope, preload=0.5 * math.hypot(*gravity) * load,
                 damping=0.02 * rope / long,
                 paid_out=ff.SmoothStep(0.5, 0.5 + time, 0.0, -haul)),
    )  # fmt: skip

    model.add(
        ff.PositionProbe("load", ff.Marker("hook")),
        ff.PositionProbe("head", ff.Marker("boom", "end")),
        ff.CableProbe("pull", "rope"),
        ff.EnergyProbe(),
    )
    return model


CASE = ff.Case(
    name="tutorial_8_crane",
    summary="tutorial 8: a crane; cables, sheaves, a winch and friction",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 6, "cubic elements of the boom", minimum=2),
        ff.Option("length", float, 12.0, "of the boom", unit="m", above=0.0),
        ff.Option("angle", float, 45.0, "of the boom", unit="deg", above=5.0, maximum=80.0),
        ff.Option("diameter", float, 0.4, "of the tube", unit="m", above=0.0),
        ff.Option("wall", float, 0.01, "of the tube", unit="m", above=0.0),
        ff.Option("load", float, 1500.0, "mass of the hook block and what hangs on it", unit="kg",
                  above=0.0),
        ff.Option("rope", float, 2e7, "axial stiffness of the rope", unit="N", above=0.0),
        ff.Option("radius", float, 0.2, "of both sheaves", unit="m", above=0.0),
        ff.Option("friction", float, 0.05, "of the rope on the sheaves", minimum=0.0),
        ff.VectorOption("winch", (-1.0, 0.0, 0.5), "where the winch is", unit="m"),
        ff.Option("haul", float, 6.0, "rope that the winch hauls in", unit="m"),
        ff.Option("time", float, 4.0, "it takes for that", unit="s", above=0.0),
        ff.VectorOption("gravity", (0.0, 0.0, -9.81), "its acceleration", unit="m/s^2"),
    ),
    dt=5e-3,
    t_end=6.0,
    start="equilibrium",
    smoke={"elements": 2, "t_end": 0.02},
    results=lambda history: {
        "lift": float(history["load_z"][-1] - history["load_z"][0]),
        "largest_tension": float(history["pull_tension"].max()),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
