# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slender solids against exact rods: elastica, roll-up, 45-degree bend and Princeton beam.

Hexahedra of second order, of Saint Venant and Kirchhoff's law. With one cell in a section they do
not warp, so that its torsion constant is the polar moment of a square; with two it is 0.2 % from
0.1406 side^4.
"""

import math
from collections.abc import Iterator

import numpy as np

import flexfem as ff
from tests.verification.result import Result

Values = np.ndarray
SOURCE = "boundary value problem of the rod"
#: Elastica and roll-up: length, side and modulus.
LENGTH, SIDE, MODULUS = 10.0, 0.1, 1e8
#: Displacement of the rod's end, m, by 16 SE(3) elements.
PRINCETON = (-14.3645e-3, -8.8739e-3, 108.9317e-3)
STIFFNESS = MODULUS * SIDE**4 / 12.0


def ended(solid: ff.Solid, *loads: object, steps: int) -> Values:
    """Mean displacement (3,) of the end face in equilibrium."""
    model = ff.Model("slender")
    model.add(solid, *loads, ff.SolidProbe("end", solid.name, "x1", measures=("displacement",)))
    history = ff.solve_static(model, ff.StaticOptions(load_steps=steps)).history
    return np.array([float(history[f"end_u{axis}"][-1]) for axis in "xyz"])


def rod(cells: int) -> ff.Solid:
    """A straight rod along x from the origin, clamped there."""
    mesh = ff.SolidMesh.box(
        (LENGTH, SIDE, SIDE), (cells, 1, 1), origin=(0.0, -0.5 * SIDE, -0.5 * SIDE)
    )
    law = ff.laws.SaintVenantKirchhoff(MODULUS, 0.0)
    return ff.Solid("rod", law, mesh, density=1.0, fixed={"x0": "xyz"})


def elastica(cells: int) -> Iterator[Result]:
    """A dead force of 10 EI/L^2 at the end."""
    force = 10.0 * STIFFNESS / LENGTH**2 / SIDE**2
    moved = ended(
        rod(cells), ff.SurfaceTraction("pull", "rod", "x1", (0.0, force, 0.0)), steps=1
    )  # fmt: skip
    for axis, reference in zip("xy", (-0.554996, 0.810609), strict=True):
        # shear and stretch are (side/length)^2; a geometric stiffness that is wrong ends elsewhere
        yield Result(
            "solid elastica", f"u{axis}/length", reference, SOURCE,
            float(moved["xy".index(axis)]) / LENGTH, f"{cells} hexahedra", 2e-3,
        )  # fmt: skip


def roll_up(cells: int) -> Iterator[Result]:
    """A moment of 2 pi EI/L at the end, by a rigid body on it."""
    solid = rod(cells)
    at = ff.Marker("cap")
    moved = ended(
        solid,
        ff.RigidBody("cap", 1e-3, (1e-6, 1e-6, 1e-6), position=(LENGTH, 0.0, 0.0)),
        ff.Rigid("glue", solid.surface_marker("x1"), at),
        ff.PointMoment("wind", at, (0.0, 0.0, 2.0 * math.pi * STIFFNESS / LENGTH)),
        steps=8,
    )
    # strains of pi side/length change moments by their squares, 1e-3; as much in the angle
    yield Result(
        "solid rolled up", "ux/length", -1.0, "circle", float(moved[0]) / LENGTH,
        f"{cells} hexahedra", 1e-2,
    )  # fmt: skip
    yield Result(
        "solid rolled up", "1 + uy/length", 1.0, "circle", 1.0 + float(moved[1]) / LENGTH,
        f"{cells} hexahedra", 1e-2,
    )  # fmt: skip


def bend(along: int, across: int, torsion: str, reference: Values) -> Iterator[Result]:
    """Bathe and Bolourchi's arc of 45 degrees and radius 100, a force of 600 along z."""
    mesh = ff.SolidMesh.box((1.0, 1.0, 1.0), (along, across, across)).raised(2)
    angle, radius = 0.25 * math.pi * mesh.points[:, 0], 100.5 - mesh.points[:, 1]
    mesh = mesh.moved(
        np.column_stack(
            [radius * np.sin(angle), 100.0 - radius * np.cos(angle), mesh.points[:, 2] - 0.5]
        )
    )
    law = ff.laws.SaintVenantKirchhoff(1e7, 0.0)
    solid = ff.Solid("arc", law, mesh, density=1.0, fixed={"x0": "xyz"})
    load = ff.SurfaceTraction("lift", "arc", "x1", (0.0, 0.0, 600.0))
    moved = ended(solid, load, steps=1)
    for axis, value, known in zip("xyz", moved, reference, strict=True):
        # the other torsion constant is 0.2 % in uz and 1.1 % in ux
        yield Result(
            f"45-degree bend, J = {torsion}", f"u{axis}, m", known, SOURCE, float(value),
            f"{along} x {across} x {across} hexahedra", 3e-3,
        )  # fmt: skip


def princeton() -> Iterator[Result]:
    """Dowell and Traybar's blade with 8.896 N at 45 degrees between its axes.

    The rod has the torsional stiffness of the rectangle, 3.103 N m^2 (Saint Venant); with the
    2.926 N m^2 of the usual data its displacement is 0.1 mm larger. The clamped end of the solid
    neither warps nor contracts, which a rod leaves out.
    """
    sizes, force = (0.508, 0.012377, 0.0032024), 8.896 / math.sqrt(2.0)
    mesh = ff.SolidMesh.box(sizes, (40, 4, 1), origin=(0.0, -0.5 * sizes[1], -0.5 * sizes[2]))
    law = ff.laws.SaintVenantKirchhoff(71.7e9, 0.31)
    solid = ff.Solid("blade", law, mesh, density=2700.0, fixed={"x0": "xyz"})
    area = sizes[1] * sizes[2]
    load = ff.SurfaceTraction("pull", "blade", "x1", (0.0, -force / area, force / area))
    moved = ended(solid, load, steps=1)
    whole = np.linalg.norm(PRINCETON)
    for axis, known, value in zip("xyz", PRINCETON, moved, strict=True):
        # of the whole displacement; a cell that locks in bending or torsion misses by percents
        yield Result(
            "solid Princeton beam", f"u{axis}, m", known, "rod of GJ = 3.103 N m^2", float(value),
            "40 x 4 x 1 hexahedra", 5e-3, float(whole),
        )  # fmt: skip


def results() -> list[Result]:
    """All lines."""
    return [
        *elastica(40), *roll_up(40), *princeton(),
        *bend(32, 1, "1/6", np.array([-23.5602, -13.6045, 53.4749])),
        *bend(32, 2, "0.1406", np.array([-23.8185, -13.7314, 53.6072])),
    ]  # fmt: skip
