# SPDX-License-Identifier: LGPL-3.0-or-later
"""Paths with limit points and bifurcations."""

from collections.abc import Mapping
from math import pi, sqrt
from typing import Any

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.benchmarks.static_beams import BVP, vector
from tests.verification.result import Result

LEE, ARCH = 20000.0, 1000.0
#: Sources other than boundary value problems.
SOURCES = {
    "hinged angle under end moments": "pi sqrt(EI GJ)/L",
    "twisted ring of a straight rod": "sqrt(3) EI/GJ (Michell 1889; Goriely 2006)",
}
#: Torsional over bending stiffness of the ring.
TORSION = 0.7


def follow(model: ff.Model, **options: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Summary and history of a path."""
    outcome = ff.solve_static(model, ff.StaticOptions(**options))
    assert outcome.status == "ok", outcome.status
    return outcome.summary, outcome.history


def lee_frame(elements: int) -> tuple[float, float, float]:
    """Limit load and displacement of Lee's frame, and the load at a displacement of 60."""
    model = load_case("lee_frame").model(elements=elements)
    summary, history = follow(model, arc_length=0.05, stop_column="down", stop_value=60.0)
    first = summary["critical_points"][0]
    assert first["kind"] == "limit point"
    load = LEE * float(history["t"][-1]) if history else 0.0
    return LEE * first["t"], first.get("down", 0.0), load


def deep_arch(elements: int) -> tuple[float, float, float, float]:
    """Limit load of the deep arch, both displacements there, and the load at 120."""
    model = load_case("deep_arch").model(elements=elements)
    summary, history = follow(model, arc_length=0.1, stop_column="down", stop_value=120.0)
    (point,) = summary["critical_points"]
    load = ARCH * float(history["t"][-1]) if history else 0.0
    return ARCH * point["t"], point.get("down", 0.0), point.get("aside", 0.0), load


def right_angle(elements: int, force: float) -> float:
    """Load at which the right-angled frame of Argyris buckles laterally, N."""
    leg, wide, thin, E, nu = 0.24, 0.03, 0.0006, 71.24e9, 0.31
    G, A = E / (2.0 + 2.0 * nu), wide * thin
    stiffness = (E * A, 5 / 6 * G * A, 5 / 6 * G * A, G * wide * thin**3 / 3.0,
                 E * thin * wide**3 / 12.0, E * wide * thin**3 / 12.0)  # fmt: skip
    mesh = ff.build_mesh("frame", column=leg, beam=leg, load_at=leg / 2, elements=elements)
    model = ff.Model("right_angle", mesh=mesh)
    model.add(
        ff.Beam("frame", ff.Section.general(stiffness, (1.0,) * 6), orientation=(0.0, 0.0, 1.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("frame", "foot")),
        # along the first leg, outwards
        ff.PointForce("force", ff.Marker("frame", "tip"), (0.0, force, 0.0)),
    )
    summary, _ = follow(model, load_steps=2, t_end=1.2, critical_points=True)
    (point,) = summary["critical_points"]
    assert point["kind"] == "bifurcation"
    return float(point["t"])


def end_moments(elements: int) -> float:
    """Moment (N mm) at which the hinged angle of Argyris buckles.

    Both ends turn about the normal of the angle's plane only; one of them moves along their line.
    """
    leg, wide, thin, E, nu = 240.0, 30.0, 0.6, 71240.0, 0.31
    G, A = E / (2.0 + 2.0 * nu), wide * thin
    stiffness = (E * A, 5 / 6 * G * A, 5 / 6 * G * A, G * wide * thin**3 / 3.0,
                 E * thin * wide**3 / 12.0, E * wide * thin**3 / 12.0)  # fmt: skip
    mesh = ff.build_mesh("frame", column=leg, beam=leg, load_at=leg / 2, elements=elements)
    model = ff.Model("angle", mesh=mesh)
    foot, tip, far = ff.Marker("frame", "foot"), ff.Marker("frame", "tip"), (leg, leg, 0.0)
    model.add(
        ff.Beam("frame", ff.Section.general(stiffness, (1.0,) * 6), orientation=(0.0, 0.0, 1.0)),
        ff.RigidBody("carriage", 1.0, (1.0, 1.0, 1.0), position=far),
        ff.Prismatic("rail", ff.Ground(far), ff.Marker("carriage"), axis=(1.0, 1.0, 0.0)),
        ff.Revolute("hinge", ff.Marker("carriage"), tip),
        ff.Revolute("pin", ff.Ground(), foot),
        ff.PointMoment("at_foot", foot, (0.0, 0.0, 1.0)),
        ff.PointMoment("at_tip", tip, (0.0, 0.0, -1.0)),
    )
    summary, _ = follow(model, load_steps=2, t_end=700.0, critical_points=True)
    return float(summary["critical_points"][0]["t"])


def twisted_ring(elements: int) -> float:
    """Turns by which the ends of a straight rod are twisted that buckle the ring made of it.

    The twist is imposed as a prestrain. The clamp of a point leaves one motion without stiffness:
    all sections turn in the ring as in a smoke ring, which its opposite point ends.
    """
    angle = np.linspace(0.0, 2.0 * pi, elements + 1)
    points = np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle])
    nodes = np.arange(elements)
    mesh = ff.LineMesh(points, np.column_stack([nodes, nodes + 1]), {"ring": nodes})
    section = ff.Section.general((1e5, 1e5, 1e5, TORSION, 1.0, 1.0), (1.0,) * 6)
    start, end = ff.Marker("ring", "start"), ff.Marker("ring", "end")
    model = ff.Model("ring", mesh=mesh)
    model.add(
        ff.Beam("ring", section, orientation=(0.0, 0.0, 1.0), rest_curvature=(0.0, 0.0, 0.0),
                prestrain=lambda s, t: (0.0, 0.0, 0.0, t, 0.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), start),
        ff.Rigid("closed", start, end),
        ff.PointOnPlane("flat", ff.Ground(), ff.Marker("ring", 0.5), axis=(0.0, 0.0, 1.0)),
    )  # fmt: skip
    summary, _ = follow(model, load_steps=1, t_end=3.0, critical_points=True)
    (point,) = summary["critical_points"]
    assert point["unstable"] == [0, 2]  # wherever the ring folds
    return float(point["t"])


def euler(elements: int) -> tuple[float, float]:
    """Buckling load of a slender cantilever column by the exact path and linearised."""
    mesh = ff.build_mesh("chain", links=1, elements=elements, length=1.0)
    model = ff.Model("column", mesh=mesh)
    section = ff.Section.general((1e8, 1e8, 1e8, 100.0, 100.0, 100.0), (1.0,) * 6)
    model.add(
        ff.Beam("link_1", section, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("link_1", "start")),
        ff.PointForce("force", ff.Marker("link_1", "end"), (-1.0, 0.0, 0.0)),
    )
    summary, _ = follow(model, load_steps=2, t_end=300.0, critical_points=True, buckling_modes=1)
    (point,) = summary["critical_points"]
    assert point["unstable"] == [0, 2]  # both planes at once
    return float(point["t"]), float(summary["buckling"][0])


def results(full: bool = True) -> list[Result]:
    """Critical loads of two meshes, and extrapolated ones.

    Linear elements give these loads with an error of second order, so that ``(4 fine - coarse)/3``
    of two meshes shows whether they converge to the right ones. Shear left out moves Lee's limit
    load by 6.6e-4; a tangent of the prestressed path off by some terms moves buckling loads by per
    cents.
    """
    found = []
    for case, quantity, function, reference, least, tolerances in (
        ("Lee's frame", "P_max", lambda n: lee_frame(n)[0], 18543.7, 10, (3e-3, 5e-4)),
        ("deep arch", "P_max", lambda n: deep_arch(n)[0], 897.287, 20, (6e-3, 5e-4)),
        ("lateral buckling of a right-angled frame", "P/N outwards",
         lambda n: right_angle(n, 1.0), 1.0875178, 4, (4e-3, 1e-4)),
        ("lateral buckling of a right-angled frame", "P/N inwards",
         lambda n: right_angle(n, -1.0), 0.6804274, 4, (4e-3, 1e-4)),
        ("hinged angle under end moments", "M/(N mm)", end_moments, 622.2081, 4, (2e-2, 1e-3)),
        ("twisted ring of a straight rod", "turns", twisted_ring, sqrt(3.0) / TORSION, 16,
         (1.5e-2, 1e-3)),
    ):  # fmt: skip
        source = SOURCES.get(case, BVP)
        coarse = 2 * least if full else least
        values = function(coarse), function(2 * coarse)
        limit = (4.0 * values[1] - values[0]) / 3.0
        for value, mesh, tolerance in (
            (values[1], f"{2 * coarse} elements a member", tolerances[0]),
            (limit, f"extrapolated from {coarse} and {2 * coarse}", tolerances[1]),
        ):
            found.append(Result(case, quantity, reference, source, value, mesh, tolerance))
    arch = deep_arch(80 if full else 40)
    found += vector("deep arch, at P_max", "down aside", (113.734, 61.146), BVP, arch[1:3],
                    f"{80 if full else 40} elements", 1e-3)  # fmt: skip
    exact, linear = euler(16)
    found += vector("Euler's column", "P P_linearised", (25 * pi**2, 25 * pi**2),
                    "pi^2 EI/(4 L^2)", (exact, linear), "16 elements", 2e-3)  # fmt: skip
    return found
