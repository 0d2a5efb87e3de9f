# SPDX-License-Identifier: LGPL-3.0-or-later
"""High-speed flexible slider-crank.

Two steel rods of 0.3 m and 0.6 m (square section 0.03 x 0.03 m, E = 2.1e11 N/m^2, nu = 0.3, rho =
7850 kg/m^3) lie along +X at rest. A spherical joint connects rod I to the ground and another one
rod II to rod I; a mass of 0.1 kg at the end of rod II moves on the X axis. A constant moment of 500
N m about Z drives rod I at the ground; gravity is 9.81 m/s^2 along -Y.

Spherical joints leave the spin of either rod about its own axis free. It stays in the equations
with the rotary inertia of the rod and is never excited by the planar loads, so that nothing has to
be locked. The slider's mass is fixed to the end of rod II and guided on the axis; a further
spherical joint between the two would be the same.

History: ``crank_angle`` (rad) and ``crank_rate`` (rad/s) of the chord of rod I, ``slider_x`` (m)
and ``rod_2_deflection``, the distance of rod II's middle node from the middle of its chord over
0.6 m, without unit (on SE(3) beams with an odd number of elements: the mean of the two middle
nodes).

Expected (Wu et al., Appl. Sci. 10 (2020) 1231): the largest deflection of rod II exceeds 5 % of its
length, the crank passes 320 rad/s. Converged (``tests/data/slider_crank.csv``): 5.04 % at 0.1913 s,
crank angle 8.0438 rad at 0.1 s. 24 elements with ``--dt 2e-5`` give 5.02 %, the default 4.9 %,
six cubic NURBS elements with the default step 5.02 %. With ``--dt 5e-4`` these take 1447 Newton
iterations with either interpolation (published: 1473 with a frozen matrix), and the crank ends at
31.10178 rad with both.
Run: ``mpirun -n 2 python cases/slider_crank.py`` or, as published,
``python cases/slider_crank.py --formulation nurbs --degree 3 --elements 6``.
"""

import math
import sys
from collections.abc import Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

import flexfem as ff


def build(
    *, elements: int, formulation: str, interpolation: str, degree: int, length_1: float,
    length_2: float, side: float, youngs_modulus: float, poisson_ratio: float, density: float,
    slider_mass: float, moment: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` beam elements per rod, NURBS ones of the given degree."""
    mesh = ff.build_mesh("slider_crank", elements=elements, length_1=length_1, length_2=length_2)
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    section = ff.Section.rectangle(side, side, steel)
    model = ff.Model("slider_crank", mesh=mesh)
    root, tip = ff.Marker("rod_1", "start"), ff.Marker("rod_1", "end")
    pin, slider = ff.Marker("rod_2", "start"), ff.Marker("rod_2", "end")
    half = 0.5 if formulation == "nurbs" else (elements // 2) / elements
    given = degree if formulation == "nurbs" else None
    rotations = None if formulation == "se3" and interpolation == "quaternions" else interpolation
    along = {"formulation": formulation, "degree": given, "interpolation": rotations}
    middle = [ff.Marker("rod_2", half), ff.Marker("rod_2", 1.0 - half)]
    model.add(
        ff.Gravity((0.0, -gravity, 0.0)),
        ff.Beam("rod_1", section, orientation=(0.0, 1.0, 0.0), **along),
        ff.Beam("rod_2", section, orientation=(0.0, 1.0, 0.0), **along),
        ff.PointMass("slider", slider_mass, slider),
        ff.Spherical("ground_pin", ff.Ground(), root),
        ff.Spherical("crank_pin", tip, pin),
        ff.PointOnLine("guide", ff.Ground(), slider, axis=(1.0, 0.0, 0.0)),
        ff.PointMoment("drive", root, (0.0, 0.0, moment)),
        ff.Probe(
            "crank", (root, tip), ("crank_angle", "crank_rate"), _crank, unwrap=("crank_angle",)
        ),
        ff.Probe("guide_position", slider, ("slider_x",), lambda t, s: (s.position[0],)),
        ff.Probe(
            "rod_2_shape",
            (pin, *middle, slider),
            ("rod_2_deflection",),
            partial(_deflection, length_2),
        ),
    )
    return model


def _crank(t: float, root: ff.MarkerState, tip: ff.MarkerState) -> tuple[float, float]:
    """Angle and rate of the chord of rod I in the plane of motion."""
    x, y, _ = tip.position - root.position
    u, v, _ = tip.velocity - root.velocity
    return math.atan2(y, x), (x * v - y * u) / (x * x + y * y)


def _deflection(
    length: float, t: float, pin: ff.MarkerState, left: ff.MarkerState, right: ff.MarkerState,
    slider: ff.MarkerState,
) -> tuple[float]:  # fmt: skip
    """Distance of rod II's middle from the middle of its chord, relative to its length (m)."""
    middle = 0.5 * (left.position + right.position)
    return (float(np.linalg.norm(middle - 0.5 * (pin.position + slider.position))) / length,)


def results(history: Mapping[str, npt.NDArray[np.float64]]) -> dict[str, float]:
    """Largest deflection and its time, largest rate, angle at the end."""
    peak = int(np.argmax(history["rod_2_deflection"]))
    return {
        "largest_rod_2_deflection": history["rod_2_deflection"][peak],
        "time_of_largest_deflection": history["t"][peak],
        "largest_crank_rate": history["crank_rate"].max(),
        "final_crank_angle": history["crank_angle"][-1],
    }


CASE = ff.Case(
    name="slider_crank",
    summary="high-speed flexible slider-crank (Wu et al. 2020)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 12, "beam elements per rod", minimum=2),
        ff.Option("formulation", str, "se3", "of the beams", choices=("se3", "nurbs")),
        ff.Option("degree", int, 3, "of NURBS beams", minimum=1),
        ff.Option(
            "interpolation",
            str,
            "quaternions",
            "of the rotations of NURBS beams",
            choices=("quaternions", "relative_rotation_vectors"),
        ),
        ff.Option("length_1", float, 0.3, "of the crank, rod I", unit="m", above=0.0),
        ff.Option("length_2", float, 0.6, "of rod II, above length-1", unit="m", above=0.0),
        ff.Option("side", float, 0.03, "of the square sections", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the rods", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the rods", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the rods", unit="kg/m^3", above=0.0),
        ff.Option("slider_mass", float, 0.1, "mass of the slider", unit="kg", above=0.0),
        ff.Option("moment", float, 500.0, "on the crank about Z", unit="N m"),
        ff.Option("gravity", float, 9.81, "along -Y", unit="m/s^2"),
    ),
    dt=1e-4,
    t_end=0.2,
    smoke={"elements": 2, "t_end": 1e-3},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
