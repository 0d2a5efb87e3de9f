# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rubber tyre on a rigid rim that slides on the ground, spins up by friction, and rolls.

A tube of neo-Hookean rubber, ``--youngs-modulus`` 1 MPa, from ``--inner-radius`` 0.1 m to
``--outer-radius`` 0.15 m and ``--width`` 50 mm, is bonded to a rim of ``--rim-mass`` 3 kg. It
starts just above the ground (Z is up) with the speed ``--speed`` 1 m/s along X and the spin
``--spin`` 0, lands, and Coulomb friction ``--friction`` 0.6 turns it until it rolls. The rubber has
the viscosity ``--relaxation`` 5 ms times its shear modulus. Curved hexahedra of second order.

History: ``x, z`` (m) of the axle, ``speed`` (m/s), ``spin`` (rad/s, rolling along X is positive);
``ground_gap`` (m), ``ground_penetration`` (m, none), ``ground_fx, ground_fy, ground_fz`` (N), force
of the ground on the tyre, ``ground_normal`` (N), ``ground_closed``, number of points;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J).

Expected: the ground's force passes through the contact, about which the angular momentum stays. So
a stiff wheel of mass m and moment of inertia J ends with the speed
(m R^2 v + J R w)/(m R^2 + J), whatever the friction; ``results`` has it beside the speed found,
0.682 m/s for 0.699 m/s (landing and rolling deform the rubber), and the rolling radius, speed over
spin, 0.1506 m: rubber that keeps its volume is stretched along the ground. The balance of energy
never exceeds 1e-10 J of 2.6 J.
Run: ``python cases/tyre.py``, then ``flexfem view results/tyre``.
"""

import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff

Values = npt.NDArray[np.float64]

GRAVITY = 9.81
#: Distance from the ground at the start, m.
ABOVE = 2e-4


def viscous(F: Any, rate: Any, p: Any) -> Any:
    """Dissipation potential of a shear viscosity, W/m^3."""
    import ufl

    strain = (F.T * rate + rate.T * F) / 2.0
    return p.viscosity * ufl.inner(strain, strain)


def build(
    *, inner_radius: float, outer_radius: float, width: float, youngs_modulus: float,
    poisson_ratio: float, density: float, relaxation: float, rim_mass: float, speed: float,
    spin: float, friction: float, cells_around: int,
) -> ff.Model:  # fmt: skip
    """Model of the wheel just above the ground."""
    mesh = ff.build_body_mesh(
        "bushing", inner_radius=inner_radius, outer_radius=outer_radius, length=width,
        cells_around=cells_around, cells_across=1, cells_along=1,
    )  # fmt: skip
    tube = ff.SolidMesh.from_dolfinx(mesh.mesh, mesh.cell_tags, mesh.facet_tags, mesh.groups)
    x, y, z = tube.points.T
    elastic = ff.laws.NeoHookean.from_young(youngs_modulus, poisson_ratio)
    mu, bulk = elastic.shear_modulus, elastic.bulk_modulus
    law = ff.laws.Hyperelastic(
        elastic.energy, {"mu": mu, "bulk": bulk, "viscosity": relaxation * mu}, viscous, split=True
    )
    turning = (0.0, spin, 0.0)
    tyre = ff.Solid(
        "tyre", law, tube.moved(np.column_stack([x, -z, y])), density=density, touching="outer",
        velocity=(speed, 0.0, 0.0), angular_velocity=turning,
    )  # fmt: skip
    rim, axial = ff.Marker("rim"), 0.5 * rim_mass * inner_radius**2
    model = ff.Model("tyre")
    model.add(
        tyre,
        ff.RigidBody(
            "rim", rim_mass, (0.5 * axial, axial, 0.5 * axial), velocity=(speed, 0.0, 0.0),
            angular_velocity=turning, shape=ff.Cylinder(inner_radius, width, axis=(0.0, 1.0, 0.0)),
        ),
        ff.RigidPoints("bond", rim, nodes=tyre.node_markers("inner")),
        ff.Contact(
            "road", "tyre", friction=friction,
            surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -outer_radius - ABOVE))),
        ),
        ff.Gravity((0.0, 0.0, -GRAVITY)),
        ff.Probe(
            "axle", rim, ("x", "z", "speed", "spin"),
            lambda t, s: (s.position[0], s.position[2], s.velocity[0], s.angular_velocity[1]),
        ),
        ff.ContactProbe("ground", "road"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(
    history: Mapping[str, Values], *, inner_radius: float, outer_radius: float, width: float,
    density: float, rim_mass: float, speed: float, spin: float,
) -> dict[str, float]:  # fmt: skip
    """Speed at the end beside that of a stiff wheel, rolling radius, extremes of the balance."""
    tube = density * math.pi * (outer_radius**2 - inner_radius**2) * width
    mass, R = tube + rim_mass, outer_radius
    inertia = 0.5 * tube * (outer_radius**2 + inner_radius**2) + 0.5 * rim_mass * inner_radius**2
    late = history["t"] > 0.8 * history["t"][-1]
    means = {name: float(history[name][late].mean()) for name in ("speed", "spin", "ground_fz")}
    return {
        "speed": means["speed"],
        "speed_of_a_stiff_wheel": (mass * R * R * speed + inertia * R * spin)
        / (mass * R * R + inertia),
        "rolling_radius": means["speed"] / means["spin"] if means["spin"] else math.inf,
        "deflection": float(-history["z"][-1] - ABOVE),
        "ground_over_weight": means["ground_fz"] / (mass * GRAVITY),
        "least_gap": float(history["ground_gap"].min()),
        "largest_balance": float(history["energy_balance"].max()),
        "least_balance": float(history["energy_balance"].min()),
    }


CASE = ff.Case(
    name="tyre",
    summary="rubber tyre on a rigid rim that slides, spins up by friction, and rolls",
    description=__doc__,
    build=build,
    options=(
        ff.Option("inner_radius", float, 0.1, "of the rubber", unit="m", above=0.0),
        ff.Option("outer_radius", float, 0.15, "of the rubber", unit="m", above=0.0),
        ff.Option("width", float, 0.05, "of the rubber", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1e6, "of the rubber", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.45, "of the rubber", above=-1.0, maximum=0.49),
        ff.Option("density", float, 1100.0, "of the rubber", unit="kg/m^3", above=0.0),
        ff.Option("relaxation", float, 5e-3, "viscosity over shear modulus", unit="s", above=0.0),
        ff.Option("rim_mass", float, 3.0, "of the rim, a disk", unit="kg", above=0.0),
        ff.Option("speed", float, 1.0, "at the start, along X", unit="m/s"),
        ff.Option("spin", float, 0.0, "at the start, rolling along X", unit="rad/s"),
        ff.Option("friction", float, 0.6, "coefficient", minimum=0.0),
        ff.Option("cells_around", int, 32, "cells around the tube", minimum=4),
    ),
    dt=2e-3,
    t_end=0.16,
    integrator="energy_momentum",
    rho_inf=1.0,
    smoke={"cells_around": 4, "t_end": 2e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
