# SPDX-License-Identifier: LGPL-3.0-or-later
"""Soft gripper: pressure in two rubber fingers bends them around a ball, and they lift it.

Two fingers of neo-Hookean rubber hang from a rigid palm, ``--gap`` 24 mm to each side of its axis,
``--length`` 80 mm long, ``--width`` 16 mm and ``--depth`` 14 mm in section, with walls of
``--wall`` 2 mm around a chamber. The inner wall, which touches, is ``--stiffening`` 20 times as
stiff as the others, so that the ``--pressure`` 60 kPa, which follows the walls, bends the fingers
inwards. It rises within ``--close-time`` 0.1 s; from 0.05 s after that, within ``--lift-time``
0.2 s, the palm rises by ``--lift`` 50 mm along Z. The ball of ``--ball-radius`` 20 mm and
``--ball-mass`` 30 g lies on a plane with its centre ``--ball-depth`` 60 mm below the palm; Coulomb
friction ``--friction`` 0.8 holds it. Rubber has the viscosity ``--relaxation`` 10 ms times its
shear modulus.

History: ``opening`` (m) between the inner edges of the tips; ``palm_z`` and
``ball_x, ball_y, ball_z`` (m); ``grip_gap`` (m), ``grip_penetration`` (m, none),
``grip_fx, grip_fy, grip_fz`` (N), forces of the ball on the fingers, ``grip_normal`` (N), sum of
the normal forces, ``grip_closed``, number of points; ``walls_von_mises`` (Pa) and ``walls_J``,
means over the outer walls of the left finger; ``energy_kinetic, energy_strain, energy_gravity,
energy_work, energy_dissipation, energy_balance`` (J).

Expected: the ball rises with the palm, and the fingers carry its weight. ``results`` has the slip,
what the ball rises less than the palm, 0.04 mm, and the force at the end over the weight, 1.004;
the balance of energy stays within 3e-4 J of 0.8 J.
Run: ``python cases/gripper.py``, then ``flexfem view results/gripper``.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff

Values = npt.NDArray[np.float64]

GRAVITY = 9.81
#: Time from closing to lifting, s, and distance of the ball from the plane at the start, m.
PAUSE, ABOVE = 0.05, 2e-4


def finger(
    *, length: float, width: float, depth: float, wall: float, cells: int, inner: float
) -> ff.SolidMesh:
    """A hollow finger below z = 0 with its inner face at x = ``inner``, turned if that is > 0."""
    counts = (3, 3, cells)
    box = ff.SolidMesh.box(counts, counts)
    i, j, k = np.floor(box.points[box.cells].mean(axis=1)).astype(int).T
    hollow = (i == 1) & (j == 1) & (k > 0) & (k < cells - 1)
    used, rows = np.unique(box.cells[~hollow], return_inverse=True)
    ticks = (
        [-depth, wall - depth, -wall, 0.0],
        [-0.5 * width, wall - 0.5 * width, 0.5 * width - wall, 0.5 * width],
        [-length, *np.linspace(wall - length, -wall, cells - 1), 0.0],
    )
    units = box.points[used].T
    own = [np.interp(x, np.arange(len(t)), t) for x, t in zip(units, ticks, strict=True)]
    outside = np.any([(u == 0) | (u == n) for u, n in zip(units, counts, strict=True)], axis=0)
    sign = 1.0 if inner < 0.0 else -1.0
    places = np.column_stack([inner + sign * own[0], sign * own[1], own[2]])
    layer = (i == 2)[~hollow]
    mesh = ff.SolidMesh(
        places, rows.reshape(-1, 8), "hexahedron",
        regions={"layer": np.flatnonzero(layer), "walls": np.flatnonzero(~layer)},
    )  # fmt: skip
    return mesh.with_surfaces(
        root=lambda x: x[:, 2] == 0.0, inner=lambda x: x[:, 0] == inner,
        chamber=lambda x: ~outside,
    )  # fmt: skip


def viscous(F: Any, rate: Any, p: Any) -> Any:
    """Dissipation potential of a shear viscosity, W/m^3."""
    import ufl

    strain = (F.T * rate + rate.T * F) / 2.0
    return p.viscosity * ufl.inner(strain, strain)


def rubber(modulus: float, ratio: float, relaxation: float) -> ff.laws.SolidLaw:
    """Viscous neo-Hookean rubber."""
    elastic = ff.laws.NeoHookean.from_young(modulus, ratio)
    if relaxation == 0.0:
        return elastic
    mu, bulk = elastic.shear_modulus, elastic.bulk_modulus
    values = {"mu": mu, "bulk": bulk, "viscosity": relaxation * mu}
    return ff.laws.Hyperelastic(elastic.energy, values, viscous, split=True)


def build(
    *, pressure: float, close_time: float, lift: float, lift_time: float, length: float,
    width: float, depth: float, wall: float, gap: float, cells: int, degree: int,
    youngs_modulus: float, poisson_ratio: float, stiffening: float, density: float,
    relaxation: float, palm_mass: float, ball_radius: float, ball_mass: float, ball_depth: float,
    friction: float,
) -> ff.Model:  # fmt: skip
    """Model of the gripper above the ball."""
    law = {
        region: rubber(factor * youngs_modulus, poisson_ratio, relaxation)
        for region, factor in (("walls", 1.0), ("layer", stiffening))
    }
    palm, ball = ff.Marker("palm"), ff.Marker("ball")
    model = ff.Model("gripper")
    size = (2.0 * (gap + depth), width, 0.25 * width)
    inertia = [palm_mass / 12.0 * (np.dot(size, size) - side**2) for side in size]
    top = 0.5 * size[2]
    model.add(
        ff.RigidBody(
            "palm", palm_mass, inertia, position=(0.0, 0.0, top), shape=ff.Box(size),
        ),
        ff.RigidBody(
            "ball", ball_mass, (0.4 * ball_mass * ball_radius**2,) * 3,
            position=(0.0, 0.0, -ball_depth), shape=ff.Sphere(ball_radius),
        ),
    )  # fmt: skip
    tips = []
    for name, inner in (("left", -gap), ("right", gap)):
        mesh = finger(length=length, width=width, depth=depth, wall=wall, cells=cells, inner=inner)
        solid = ff.Solid(name, law, mesh, density=density, degree=degree, touching="inner")
        model.add(
            solid,
            ff.RigidPoints(f"{name}_bond", palm, nodes=solid.node_markers("root")),
            ff.SurfacePressure(
                f"{name}_air", name, "chamber", pressure,
                amplitude=ff.SmoothStep(0.0, close_time, 0.0, 1.0),
            ),
        )  # fmt: skip
        tips.append(ff.Marker(name, (inner, 0.0, -length)))
    start, rest = close_time + PAUSE, ff.Ground((0.0, 0.0, top))
    model.add(
        ff.Prismatic("rail", rest, palm, axis=(0.0, 0.0, 1.0)),
        ff.PrescribedDisplacement(
            "hoist", rest, palm, axis=(0.0, 0.0, 1.0),
            displacement=ff.SmoothStep(start, start + lift_time, 0.0, lift),
        ),
        ff.Contact("grip_on", ["left", "right"], against="ball", friction=friction),
        ff.Contact(
            "bed", "ball", friction=friction,
            surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -ball_depth - ball_radius - ABOVE))),
        ),
        ff.Gravity((0.0, 0.0, -GRAVITY)),
        ff.Probe("tips", tips, ("opening",), lambda t, a, b: (b.position[0] - a.position[0],)),
        ff.Probe("height", palm, ("palm_z",), lambda t, s: (s.position[2],)),
        ff.Probe("place", ball, ("ball_x", "ball_y", "ball_z"), lambda t, s: s.position),
        ff.ContactProbe("grip", "grip_on"),
        ff.SolidProbe("walls", "left", "walls", measures=("von_mises", "J")),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(history: Mapping[str, Values], *, ball_mass: float) -> dict[str, float]:
    """Slip of the ball, least gap, force at the end, and extremes of the balance of energy."""
    risen = {name: history[name][-1] - history[name][0] for name in ("palm_z", "ball_z")}
    return {
        "palm_rises": float(risen["palm_z"]),
        "slip": float(risen["palm_z"] - risen["ball_z"]),
        "carried_over_weight": float(-history["grip_fz"][-1] / (ball_mass * GRAVITY)),
        "least_gap": float(history["grip_gap"].min()),
        "largest_balance": float(history["energy_balance"].max()),
        "least_balance": float(history["energy_balance"].min()),
    }


CASE = ff.Case(
    name="gripper",
    summary="soft gripper of rubber: pressure closes its fingers on a ball and lifts it",
    description=__doc__,
    build=build,
    options=(
        ff.Option("pressure", float, 6e4, "in the chambers", unit="N/m^2", minimum=0.0),
        ff.Option("close_time", float, 0.1, "until the pressure is there", unit="s", above=0.0),
        ff.Option("lift", float, 0.05, "way of the palm", unit="m"),
        ff.Option("lift_time", float, 0.2, "of this way", unit="s", above=0.0),
        ff.Option("length", float, 0.08, "of a finger", unit="m", above=0.0),
        ff.Option("width", float, 0.016, "of a finger", unit="m", above=0.0),
        ff.Option("depth", float, 0.014, "of a finger, across the gap", unit="m", above=0.0),
        ff.Option("wall", float, 0.002, "thickness", unit="m", above=0.0),
        ff.Option("gap", float, 0.024, "of a finger from the middle", unit="m", above=0.0),
        ff.Option("cells", int, 8, "along a finger", minimum=3),
        ff.Option("degree", int, 2, "of the positions in a cell", minimum=1, maximum=3),
        ff.Option("youngs_modulus", float, 1e6, "of the rubber", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.4, "of the rubber", above=-1.0, maximum=0.49),
        ff.Option("stiffening", float, 20.0, "of the inner wall", above=0.0),
        ff.Option("density", float, 1100.0, "of the rubber", unit="kg/m^3", above=0.0),
        ff.Option("relaxation", float, 0.01, "viscosity over shear modulus", unit="s", minimum=0.0),
        ff.Option("palm_mass", float, 0.2, "of the palm", unit="kg", above=0.0),
        ff.Option("ball_radius", float, 0.02, "of the ball", unit="m", above=0.0),
        ff.Option("ball_mass", float, 0.03, "of the ball", unit="kg", above=0.0),
        ff.Option("ball_depth", float, 0.06, "of its centre below the palm", unit="m", above=0.0),
        ff.Option("friction", float, 0.8, "coefficient", minimum=0.0),
    ),
    dt=5e-3,
    t_end=0.45,
    integrator="energy_momentum",
    rho_inf=1.0,
    smoke={"cells": 3, "degree": 1, "dt": 1e-3, "t_end": 2e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
