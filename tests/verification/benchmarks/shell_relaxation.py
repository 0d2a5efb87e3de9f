# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation of shells: an elastic catenary, and a plate by Newton's method."""

from functools import lru_cache
from math import asinh, hypot

import numpy as np
from scipy.optimize import brentq

import flexfem as ff
from tests.verification.result import Result

SPAN, LENGTH, WIDTH = 0.8, 1.0, 0.04
#: Of the strip: along it, N/m, and mass and weight per area, kg/m^2 and N/m^2.
STIFFNESS, MASS = 1e3, 0.2
WEIGHT = 9.81 * MASS


@lru_cache
def pull() -> float:
    """Horizontal pull (N/m) of an elastic catenary over the span."""
    end = 0.5 * WEIGHT * LENGTH

    def excess(pull: float) -> float:
        half = pull / WEIGHT * asinh(end / pull) + 0.5 * LENGTH * pull / STIFFNESS
        return 2.0 * half - SPAN

    return float(brentq(excess, 1e-3 * end, 100.0 * end))


def depth(arc: float) -> float:
    """Depth (m) below the ends at an arc length from the middle, before it stretched."""

    def height(s: float) -> float:
        return hypot(pull(), WEIGHT * s) / WEIGHT + 0.5 * WEIGHT * s * s / STIFFNESS

    return height(0.5 * LENGTH) - height(arc)


def bow(u: np.ndarray) -> np.ndarray:
    """Points (n, 2) of a parabola of the same span and length, at shares of its length."""
    x = np.linspace(0.0, 1.0, 2001)

    def arcs(sag: float) -> np.ndarray:
        curve = np.column_stack([SPAN * x, -4.0 * sag * x * (1.0 - x)])
        return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))

    sag = brentq(lambda sag: arcs(sag)[-1] - LENGTH, 0.0, 1.0)
    at = np.interp(u * LENGTH, arcs(sag), x)
    return np.column_stack([SPAN * at, -4.0 * sag * at * (1.0 - at)])


def hanging_strip(cells: int) -> ff.Model:
    """A strip with hardly any bending stiffness that stretches little, between two rows."""

    def surface(parameters: np.ndarray) -> np.ndarray:
        u, v = parameters.T
        x, z = bow(u).T
        return np.column_stack([x, v, z])

    mesh = ff.SurfaceMesh.grid(
        "strip", np.linspace(0.0, 1.0, cells + 1), np.linspace(0.0, WIDTH, 3), surface
    )
    section = ff.ShellSection.orthotropic(
        (STIFFNESS, STIFFNESS, 400.0), (1e-8, 1e-8, 1e-8), 0.0, mass=MASS, thickness=1e-3
    )
    model = ff.Model("strip", surface=mesh)
    model.add(
        ff.Shell("strip", section, fixed={"strip_left": "xyz", "strip_right": "xyz"}),
        ff.Gravity((0.0, 0.0, -9.81)),
    )
    for name, part in (("middle", 2), ("quarter", 4)):
        point = mesh.points[cells + 1 + cells // part]  # on the centre line of the strip
        model.add(ff.PositionProbe(name, ff.Marker("strip", point)))
    return model


def heavy_plate() -> ff.Model:
    """Square plate under its weight, clamped all around, that deflects by half its thickness."""
    grid = np.linspace(0.0, 1.0, 13)
    mesh = ff.SurfaceMesh.grid("plate", grid, grid)
    section = ff.ShellSection.isotropic(0.01, ff.Material(1e8, 0.3, 1000.0))
    model = ff.Model("plate", surface=mesh)
    model.add(
        ff.Shell("plate", section, edges=dict.fromkeys(mesh.lines, "clamped")),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.PositionProbe("middle", ff.Marker("plate", (0.5, 0.5, 0.0))),
    )
    return model


def relaxed(model: ff.Model, tolerance: float, step_tolerance: float) -> dict[str, float]:
    """End of a relaxation that must reach equilibrium."""
    options = ff.RelaxationOptions(
        tolerance=tolerance, step_tolerance=step_tolerance, quiet=True, record_every=20
    )
    outcome = ff.relax(model, options)
    if outcome.status != "ok":
        raise RuntimeError(f"{model!r}: {outcome.status}")
    return {name: float(values[-1]) for name, values in outcome.history.items()}


def results(full: bool = True) -> list[Result]:
    """Depths of the strip, and the deflection of the plate."""
    cells = 48 if full else 24
    end = relaxed(hanging_strip(cells), 1e-5, 1e-7)
    case, words = "hanging strip, relaxation", f"{cells} x 2 cells"
    # mesh; without stretch the strip is less deep by 3e-3, as the parabola that it starts as it is
    # deeper by 1e-2; a wrong load per length or a length that is lost change more
    lines = [
        Result(case, f"depth of {what}, m", depth(arc), "elastic catenary", -end[f"{name}_z"],
               words, 5e-4 if full else 1e-3)
        for what, name, arc in (("the middle", "middle", 0.0),
                                ("a quarter of the length", "quarter", 0.25 * LENGTH))
    ]  # fmt: skip
    if full:
        newton = ff.solve_static(heavy_plate(), ff.StaticOptions(quiet=True)).history["middle_z"]
        found = relaxed(heavy_plate(), 1e-8, 1e-8)["middle_z"]
        # one equilibrium, two ways to it; wrong fixed nodes give 1e-3 m
        lines.append(
            Result("heavy clamped plate, relaxation", "depth of the middle, m", -float(newton[-1]),
                   "Newton's method", -found, "12 x 12 cells", 1e-5)
        )  # fmt: skip
    return lines
