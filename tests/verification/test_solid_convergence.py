# SPDX-License-Identifier: LGPL-3.0-or-later
"""Convergence of solids: a tube under pressure against its boundary value problem, and bending."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

import flexfem as ff
from flexfem.families.solid.meshes.lagrange import quadrature_points, quadrature_weights, shapes
from tests.verification.benchmarks.solids import INNER, OUTER, quarter

pytestmark = pytest.mark.serial

MU, BULK, PRESSURE = 1.0, 4.0, 0.25


def stresses(r: np.ndarray, slope: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial and hoop first Piola stress of the neo-Hookean tube in plane strain."""
    a, b = slope, r / R
    J, square = a * b, a * a + b * b + 1.0
    shape, volume = MU * J ** (-2.0 / 3.0), BULK / 2.0 * (J * J - 1.0)
    return tuple(shape * (x - square / (3.0 * x)) + volume / x for x in (a, b))


def exact() -> object:
    """Radii of the loaded tube as a function of those at the start, and their slopes."""

    def equations(R: np.ndarray, y: np.ndarray) -> np.ndarray:
        r, slope = y
        radial, hoop = stresses(r, slope, R)
        step = 1e-6
        by_slope = (stresses(r, slope + step, R)[0] - stresses(r, slope - step, R)[0]) / (2 * step)
        ahead = stresses(r + step * slope, slope, R + step)[0]
        behind = stresses(r - step * slope, slope, R - step)[0]
        along = (ahead - behind) / (2 * step)  # at a constant slope
        return np.vstack([slope, ((hoop - radial) / R - along) / by_slope])

    def ends(inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
        first = stresses(inner[0], inner[1], INNER)[0] + PRESSURE * inner[0] / INNER
        return np.array([first, stresses(outer[0], outer[1], OUTER)[0]])

    R = np.linspace(INNER, OUTER, 41)
    found = solve_bvp(equations, ends, R, np.vstack([R, np.ones_like(R)]), tol=1e-9)
    assert found.success
    return found.sol


def error(degree: int, cells: int, radii: object) -> float:
    """Root of the integral of the squared error of the positions."""
    mesh = quarter(cells, degree)
    tube = ff.Solid(
        "tube", ff.laws.NeoHookean(MU, BULK), mesh, density=1.0, degree=degree, plane="strain",
        fixed={"x0": "x", "y0": "y"},
    )  # fmt: skip
    nodes = [ff.Marker("tube", tuple(x)) for x in tube.points]
    columns = [f"{axis}{k}" for k in range(len(nodes)) for axis in "xy"]
    model = ff.Model("tube")
    model.add(
        tube,
        ff.SurfacePressure("gas", "tube", "inner", PRESSURE),
        ff.Probe("all", nodes, columns, lambda t, *at: np.ravel([a.position[:2] for a in at])),
    )
    options = ff.StaticOptions(load_steps=2, tolerance=1e-12)
    history = ff.solve_static(model, options).history
    x = np.array([history[name][-1] for name in columns]).reshape(-1, 2)
    rule = "quadrilateral", 2 * degree + 4
    values, gradients = shapes("quadrilateral", degree, quadrature_points(*rule))
    places, moved = (points[tube.nodes.cells] for points in (tube.points[:, :2], x))
    X, now = (np.einsum("qk,mka->mqa", values, one) for one in (places, moved))
    sizes = np.linalg.det(np.einsum("qkd,mka->mqad", gradients, places))
    R = np.linalg.norm(X, axis=2)
    wanted = X * (radii(R)[0] / R)[..., np.newaxis]
    squares = ((now - wanted) ** 2).sum(axis=2) * sizes * quadrature_weights(*rule)
    return float(np.sqrt(squares.sum()))


@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_positions_converge_by_their_degree_and_one(degree):
    """Curved cells in a tube that opens by a fifth under an inner pressure that follows it."""
    radii = exact()
    assert radii(INNER)[0] > 1.2 * INNER
    coarse, fine = (error(degree, cells, radii) for cells in (2, 4))
    # meshes this coarse are within a quarter of the order; a wrong quadrature or geometry loses one
    assert np.log2(coarse / fine) > degree + 0.75


def cook(nu: float, formulation: str, cells: int) -> float:
    """Rise of the corner of Cook's membrane, 48 mm wide, under a shear force, m."""
    box = ff.SolidMesh.box((1.0, 1.0), (cells, cells), "quadrilateral")
    s, t = box.points[:, 0], box.points[:, 1]
    height = 44.0 + s * (16.0 - 44.0)
    points = 1e-3 * np.column_stack([48.0 * s, 44.0 * s + height * t, 0.0 * s])
    law = ff.laws.NeoHookean.from_young(240.565e6, nu)
    model = ff.Model("cook")
    model.add(
        ff.Solid(
            "plate", law, box.moved(points), density=1.0, plane="strain", thickness=1e-3,
            formulation=formulation, fixed={"x0": "xy"},
        ),
        ff.SurfaceTraction("shear", "plate", "x1", (0.0, 6.25e6, 0.0)),
        ff.PositionProbe("corner", ff.Marker("plate", (0.048, 0.060, 0.0))),
    )  # fmt: skip
    return float(ff.solve_static(model, ff.StaticOptions()).history["corner_y"][-1]) - 0.060


@pytest.mark.slow
def test_nearly_incompressible_bending_does_not_lock():
    """Cook's membrane at nu = 0.4999: 6.91 mm with 16 cells along each side."""
    # 6.80 mm with four by the dilatation, 5.92 mm without
    assert cook(0.4999, "dilatation", 4) == pytest.approx(6.91e-3, rel=0.02)
    assert cook(0.4999, "displacement", 4) < 6.0e-3
