# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilevers under large displacements.

References "BVP" are solutions of the Simo–Reissner equations as boundary-value problems to eight
digits or more, found without finite elements.
"""

from collections.abc import Sequence
from math import cos, radians, sin

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.result import Result

BVP = "boundary-value problem"


def vector(
    case: str, names: str, references: Sequence[float], source: str, ours: Sequence[float],
    mesh: str, tolerance: float,
) -> list[Result]:  # fmt: skip
    """Results of the components of one vector; errors are relative to its largest."""
    scale = max(map(abs, references))
    return [
        Result(case, name, reference, source, value, mesh, tolerance, scale)
        for name, reference, value in zip(names.split(), references, ours, strict=True)
    ]


def cantilever(elements: int, length: float, section: ff.Section) -> ff.Model:
    """Straight cantilever along X with e2 along Y; probe of the tip's displacement."""
    mesh = ff.build_mesh("chain", links=1, elements=elements, length=length)
    model = ff.Model("cantilever", mesh=mesh)
    tip = ff.Marker("link_1", "end")
    model.add(
        ff.Beam("link_1", section, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("link_1", "start")),
        ff.Probe("tip", tip, ("u", "v", "w", "angle"), lambda t, at: _tip(at, length)),
    )
    return model


def _tip(at: ff.MarkerState, length: float) -> list[float]:
    """Displacement, and rotation about Z within a full turn."""
    x, y, z = at.position
    return [x - length, y, z, float(np.arctan2(at.rotation[1, 0], at.rotation[0, 0]))]


def solve(model: ff.Model, names: str = "u v w", **options: object) -> list[float]:
    """Last values of columns."""
    outcome = ff.solve_static(model, ff.StaticOptions(**options))
    assert outcome.status == "ok", outcome.status
    return [float(outcome.history[name][-1]) for name in names.split()] if outcome.history else []


def stiff(bending: float, axial: float) -> ff.Section:
    """Section with three equal axial and three equal bending stiffnesses."""
    return ff.Section.general((axial,) * 3 + (bending,) * 3, (1.0,) * 6)


def dead_force(elements: int) -> list[float]:
    """Tip (u, v, angle) of the cantilever of Nachbagauer et al. (2011), F = 62.5 MN."""
    material = ff.Material(2.07e11, 0.3, 7850.0)
    factor = 10.0 * 1.3 / (12.0 + 11.0 * 0.3)
    section = ff.Section.rectangle(0.5, 0.1, material, shear_factor=factor)
    model = cantilever(elements, 2.0, section)
    model.add(ff.PointForce("force", ff.Marker("link_1", "end"), (0.0, 62.5e6, 0.0)))
    return solve(model, "u v angle", load_steps=3)


DEAD_FORCE = (-0.15097114, 0.71056860, 0.52017317)


def elastica(elements: int) -> list[float]:
    """Tip of the elastica with P L^2/EI = 10; length 1."""
    model = cantilever(elements, 1.0, stiff(1.0, 1e8))
    model.add(ff.PointForce("force", ff.Marker("link_1", "end"), (0.0, 10.0, 0.0)))
    return solve(model, "u v angle", load_steps=4)


ELASTICA = (-0.55499560, 0.81060902, 1.43028554)


def princeton(elements: int, angle: float, force: float) -> list[float]:
    """Tip displacement (mm) of the Princeton beam; angle in degrees."""
    shear = 1_084_759.0
    stiffness = (2_842_069.0, shear, shear, 2.925744, 2.428872, 36.285519)
    model = cantilever(elements, 0.508, ff.Section.general(stiffness, (1.0,) * 6))
    b = radians(angle)
    load = (0.0, -force * cos(b), force * sin(b))
    model.add(ff.PointForce("force", ff.Marker("link_1", "end"), load))
    return [1e3 * x for x in solve(model, load_steps=2)]


PRINCETON = {
    (45.0, 8.896): (-14.412, -8.979, 109.113),
    (90.0, 8.896): (-26.021, 0.0, 146.252),
    (45.0, 13.345): (-30.453, -15.621, 156.775),
}


def bend(elements: int, torsion: str) -> list[float]:
    """Tip displacement of the 45-degree bend at P = 600."""
    model = load_case("bend_45").model(elements=elements, torsion=torsion, force=600.0)
    return solve(model, "tip_x tip_y tip_z", load_steps=4)


BEND = {
    "square": (46.89192478 - 70.71067812, 15.55778582 - 29.28932188, 53.60736927),
    "polar": (47.15043857 - 70.71067812, 15.68480053 - 29.28932188, 53.47485879),
}


def roll_up(elements: int) -> list[float]:
    """Tip after one full turn by a moment."""
    model = load_case("roll_up").model(elements=elements, turns=1.0, out_of_plane_force=0.0)
    return solve(model, "tip_x tip_y tip_z", load_steps=2)


def helix(elements: int, factor: float) -> list[float]:
    """Tip of the beam under 20 pi EI/L and 50 times the factor."""
    model = load_case("roll_up").model(elements=elements, turns=10.0, out_of_plane_force=50.0)
    return solve(model, "tip_x tip_y tip_z", load_steps=8, t_end=factor)


HELIX = {0.05: (-9.288519, 6.285664, 2.750736), 0.1: (-9.589797, 0.053771, -1.091729)}


def follower(elements: int, force: float) -> list[float]:
    """Tip (u, v) under a follower force without shear (Argyris, Symeonidis 1981)."""
    bending, rigid = 3.5e7, 4.2e11
    stiffness = (4.2e8, rigid, rigid, bending, bending, bending)
    model = cantilever(elements, 100.0, ff.Section.general(stiffness, (1.0,) * 6))
    tip = ff.Marker("link_1", "end")
    model.add(ff.PointForce("force", tip, (0.0, force, 0.0), follower=True))
    return solve(model, "u v", load_steps=6)


FOLLOWER = (-50.709050, -11.586389)  # at 100e3, EA = 4.2e8


def results(full: bool = True) -> list[Result]:
    """All of them; errors of the elements are of second order, tolerances two to three times that.

    Another torsion constant moves the 45-degree bend by 5e-3, a wrong path the helix by per cents.
    """
    n, share = (64, 0.1) if full else (16, 1.0)
    mesh = f"{n} elements"
    found = vector("cantilever, dead force", "u/m v/m angle", DEAD_FORCE, BVP, dead_force(n), mesh,
                   2e-3 * share)  # fmt: skip
    found += vector("elastica, P L^2/EI = 10", "u/L v/L angle", ELASTICA, BVP, elastica(n), mesh,
                    1.5e-3 * share)  # fmt: skip
    found += vector("roll-up to a circle", "u v w", (-10.0, 0.0, 0.0), "closed form", roll_up(8),
                    "8 elements", 1e-12)  # fmt: skip
    for (angle, force), reference in PRINCETON.items():
        found += vector(f"Princeton beam, {angle:g} deg, {force:g} N", "u/mm v/mm w/mm",
                        reference, BVP, princeton(n, angle, force), mesh, 2e-3 * share)  # fmt: skip
    for torsion, reference in BEND.items():
        found += vector(f"45-degree bend, P = 600, {torsion} torsion constant", "u v w", reference,
                        BVP, bend(n, torsion), mesh, 1.5e-3 * share)  # fmt: skip
    for factor, reference in HELIX.items():
        found += vector(f"helix, load factor {factor}", "u v w", reference, BVP,
                        helix(2 * n, factor), f"{2 * n} elements", 2e-3 * share)  # fmt: skip
    found += vector("follower force 100e3", "u v", FOLLOWER, BVP, follower(2 * n, 100e3),
                    f"{2 * n} elements", 8e-3 * share)  # fmt: skip
    return found
