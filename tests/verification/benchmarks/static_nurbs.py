# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilevers under large displacements, on few NURBS elements; references as there."""

from math import cos, pi, radians, sin

import flexfem as ff
from tests.verification.benchmarks.static_beams import (
    BVP,
    DEAD_FORCE,
    ELASTICA,
    PRINCETON,
    solve,
    stiff,
    vector,
)
from tests.verification.result import Result

RADIUS = 100.0


def cantilever(curve: ff.NurbsCurve, section: ff.Section, e2: tuple[float, ...]) -> ff.Model:
    """Clamped at its start; probe of the displacement of its end."""
    model, end = ff.Model("cantilever"), curve.position(1.0)
    model.add(
        ff.Beam("beam", section, curve=curve.with_continuity(0), orientation=e2),
        ff.Rigid("clamp", ff.Ground(curve.position(0.0)), ff.Marker("beam", "start")),
        ff.Probe("tip", ff.Marker("beam", "end"), ("u", "v", "w"), lambda t, at: at.position - end),
    )
    return model


def force(model: ff.Model, vector: tuple[float, float, float]) -> ff.Model:
    """The same model with a dead force at the end."""
    model.add(ff.PointForce("force", ff.Marker("beam", "end"), vector))
    return model


def straight(length: float, degree: int, elements: int) -> ff.NurbsCurve:
    """Line along X."""
    return ff.NurbsCurve.line((0, 0, 0), (length, 0, 0), degree=degree, elements=elements)


def dead_force(degree: int, elements: int) -> list[float]:
    """Tip (u, v) of the cantilever of Nachbagauer et al. (2011), F = 62.5 MN."""
    material = ff.Material(2.07e11, 0.3, 7850.0)
    factor = 10.0 * 1.3 / (12.0 + 11.0 * 0.3)
    section = ff.Section.rectangle(0.5, 0.1, material, shear_factor=factor)
    model = cantilever(straight(2.0, degree, elements), section, (0.0, 1.0, 0.0))
    return solve(force(model, (0.0, 62.5e6, 0.0)), "u v", load_steps=3)


def elastica(degree: int, elements: int) -> list[float]:
    """Tip (u, v) of the elastica with P L^2/EI = 10; length 1."""
    model = cantilever(straight(1.0, degree, elements), stiff(1.0, 1e8), (0.0, 1.0, 0.0))
    return solve(force(model, (0.0, 10.0, 0.0)), "u v", load_steps=4)


def princeton(degree: int, elements: int, angle: float, size: float) -> list[float]:
    """Tip displacement (mm) of the Princeton beam; angle in degrees."""
    shear = 1_084_759.0
    stiffness = (2_842_069.0, shear, shear, 2.925744, 2.428872, 36.285519)
    section = ff.Section.general(stiffness, (1.0,) * 6)
    model, b = cantilever(straight(0.508, degree, elements), section, (0, 1, 0)), radians(angle)
    load = (0.0, -size * cos(b), size * sin(b))
    return [1e3 * x for x in solve(force(model, load), load_steps=2)]


def bend(degree: int, elements: int, torsion: float) -> list[float]:
    """Tip displacement of the 45-degree bend at P = 600; the curve is an exact arc."""
    curve = ff.NurbsCurve.arc(
        (0.0, RADIUS, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), pi / 4.0, degree=degree,
        elements=elements,
    )  # fmt: skip
    shear, inertia = 5e6, 1e7 / 12.0
    stiffness = (1e7, 5.0 / 6.0 * shear, 5.0 / 6.0 * shear, shear * torsion, inertia, inertia)
    model = cantilever(curve, ff.Section.general(stiffness, (1.0,) * 6), (0.0, 0.0, 1.0))
    return solve(force(model, (0.0, 0.0, 600.0)), load_steps=4)


#: with the shear factor 5/6, from the same source as BEND
BEND_SHEARED = (46.89158622 - 70.71067812, 15.55767615 - 29.28932188, 53.60798641)
TORSION = 0.140577


def results(full: bool = True) -> list[Result]:
    """Degree 3, eight elements or four, C0 between them."""
    count = 8 if full else 4
    mesh, error = f"{count} elements of degree 3, C0", 1e-6 if full else 1e-5
    # SE(3) elements need 60 for 1e-4; locking, or elements of lower order, leave 1e-4 and more
    found = vector(
        "45-degree bend, NURBS", "x y z", BEND_SHEARED, BVP, bend(3, count, TORSION), mesh, error
    )
    found += vector(
        "dead tip force, NURBS", "u v", DEAD_FORCE[:2], BVP, dead_force(3, count), mesh, error
    )
    found += vector(
        "elastica, NURBS", "u v", ELASTICA[:2], BVP, elastica(3, count), mesh, error * 30
    )
    for (angle, size), reference in PRINCETON.items():
        name = f"Princeton beam {angle:g} deg, {size:g} N, NURBS"
        # the references have five digits
        found += vector(name, "u v w", reference, BVP, princeton(3, count, angle, size), mesh, 1e-4)
    return found
