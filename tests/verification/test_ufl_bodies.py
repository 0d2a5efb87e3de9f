# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies with an energy in UFL against closed forms."""

import numpy as np
import pytest
import ufl
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

import flexfem as ff
from tests.unit.test_ufl_bodies import block

pytestmark = pytest.mark.serial


def bar(x, X, p):
    """St. Venant-Kirchhoff bar."""
    F = ufl.grad(x)
    return p.EA / 2 * ((ufl.inner(F, F) - 1) / 2) ** 2


def membrane(x, X, p):
    """Incompressible neo-Hookean membrane."""
    F = ufl.grad(x)
    C = F.T * F
    square = (ufl.tr(C) ** 2 - ufl.inner(C, C)) / 2
    return p.mu * p.h / 2 * (ufl.tr(C) + 1 / square - 3)


def solid(x, X, p):
    """Compressible neo-Hookean solid."""
    F = ufl.grad(x)
    J = ufl.det(F)
    return p.mu / 2 * (ufl.inner(F, F) - 3 - 2 * ufl.ln(J)) + p.lam / 2 * ufl.ln(J) ** 2


def test_a_bar_swings_like_a_rod():
    """Two turns through large angles, beside the equation of a rigid rod; one factorisation."""
    mesh = ff.ElementMesh(
        [[0, 0, 0], [1, 0, 0]], [[0, 1]], "interval", nodes={"top": [0], "tip": [1]}
    )
    model = ff.Model("pendulum")
    model.add(
        ff.UFLBody("rod", mesh, bar, density=2.0, parameters={"EA": 1e6}),
        ff.Spherical("pin", ff.Ground(), ff.Marker("rod", "top")),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.PositionProbe("tip", ff.Marker("rod", "tip")),
    )
    outcome = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=1.5, quiet=True))
    assert outcome.summary["factorizations"] == 1
    history = outcome.history
    exact = solve_ivp(
        lambda t, y: [y[1], -14.715 * np.cos(y[0])], (0.0, 1.5), [0.0, 0.0], rtol=1e-11,
        atol=1e-11, t_eval=np.minimum(history["t"], 1.5),
    ).y[0]  # fmt: skip
    # two nodes in rotation move as the angle counted downwards does
    np.testing.assert_allclose(history["tip_x"], np.cos(exact), atol=2e-4)
    np.testing.assert_allclose(history["tip_z"], np.sin(exact), atol=2e-4)


def test_frequencies_of_a_bar():
    """Fixed at one end: those of linear elements with consistent mass, in closed form."""
    count, density, stiffness = 8, 2.0, 5e4
    points = np.zeros((count + 1, 3))
    points[:, 0] = np.linspace(0.0, 1.0, count + 1)
    cells = np.column_stack([np.arange(count), np.arange(1, count + 1)])
    mesh = ff.ElementMesh(
        points, cells, "interval", nodes={"all": np.arange(count + 1), "wall": [0]}
    )
    model = ff.Model("bar")
    model.add(
        ff.UFLBody(
            "bar", mesh, bar, density=density, parameters={"EA": stiffness},
            fixed={"all": "yz", "wall": "x"},
        )
    )  # fmt: skip
    outcome = ff.find_modes(model, ff.ModeOptions(modes=3, quiet=True))
    angle = (2 * np.arange(1, 4) - 1) * np.pi / 2 / count
    wave = np.sqrt(6 * (1 - np.cos(angle)) / (2 + np.cos(angle))) * count
    exact = wave * np.sqrt(stiffness / density) / (2 * np.pi)
    np.testing.assert_allclose(outcome.history["frequency"][:3], exact, rtol=1e-8)


def grid(count: int) -> ff.SurfaceMesh:
    """A square of 1 m in the plane of x and y."""
    ticks = np.linspace(0.0, 1.0, count + 1)
    return ff.SurfaceMesh.grid("sheet", ticks, ticks, lambda p: np.column_stack([p, 0.0 * p[:, 0]]))


def test_a_membrane_pulled_on_two_sides_has_the_closed_form():
    """Forces mu h (s - s^-5) per length stretch a neo-Hookean membrane by s in both directions."""
    stretch, mu, h = 1.6, 4e5, 1e-3
    mesh = ff.ElementMesh.from_surface(grid(3))
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    sets = {
        "left": np.flatnonzero(x == 0), "low": np.flatnonzero(y == 0), "all": np.arange(len(x))
    }  # fmt: skip
    mesh = ff.ElementMesh(mesh.points, mesh.cells, "triangle", nodes=sets)
    model = ff.Model("patch")
    model.add(
        ff.UFLBody(
            "sheet", mesh, membrane, density=1.0, parameters={"mu": mu, "h": h},
            fixed={"left": "x", "low": "y", "all": "z"},
        ),
        ff.PositionProbe("corner", ff.Marker("sheet", (1.0, 1.0, 0.0))),
    )  # fmt: skip
    line = mu * h * (stretch - stretch**-5)
    for node, place in enumerate(mesh.points):
        ends = [0.5 if 0.0 < place[1 - a] < 1.0 else 0.25 for a in range(2)]
        force = [2.0 * ends[a] / 3.0 * line if place[a] == 1.0 else 0.0 for a in range(2)]
        if any(force):
            at = ff.Marker("sheet", tuple(place.tolist()))
            model.add(ff.PointForce(f"pull {node}", at, (*force, 0.0)))
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=5, tolerance=1e-10, quiet=True))
    end = [outcome.history[f"corner_{axis}"][-1] for axis in "xyz"]
    np.testing.assert_allclose(end, [stretch, stretch, 0.0], atol=1e-8)


def dome(p: np.ndarray) -> np.ndarray:
    """A vault of 0.1 m over the square."""
    return np.column_stack([p, 0.1 * np.prod(np.sin(np.pi * p), axis=1)])


def test_a_sheet_under_load_and_weight_beside_a_minimum_of_its_energy():
    """Dead loads against SciPy's minimum of the energy, coded again triangle by triangle."""
    mu, h, load = 3e4, 2e-3, 30.0
    ticks = np.linspace(0.0, 1.0, 5)
    surface = ff.SurfaceMesh.grid("sheet", ticks, ticks, dome)
    inside = ((surface.points[:, :2] > 0) & (surface.points[:, :2] < 1)).all(axis=1)
    mesh = ff.ElementMesh(
        surface.points, surface.triangles, "triangle", nodes={"rim": np.flatnonzero(~inside)}
    )
    model = ff.Model("sheet")
    model.add(
        ff.UFLBody(
            "sheet", mesh, membrane, density=0.5, parameters={"mu": mu, "h": h},
            fixed={"rim": "xyz"},
        ),
        ff.SurfaceLoad("load", "sheet", (2.0, 0.0, load)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.PositionProbe("middle", ff.Marker("sheet", (0.5, 0.5, 0.1))),
        ff.PositionProbe("side", ff.Marker("sheet", (0.25, 0.5, 0.0707))),
    )  # fmt: skip
    options = ff.StaticOptions(load_steps=8, tolerance=1e-9, quiet=True)
    history = ff.solve_static(model, options).history
    triangles, X = surface.triangles, surface.points
    sides = X[triangles[:, 1:]] - X[triangles[:, :1]]
    metric = np.einsum("mia,mja->mij", sides, sides)
    inverse = np.linalg.inv(metric)
    areas = 0.5 * np.sqrt(np.linalg.det(metric))
    weight = np.zeros_like(X)
    force = np.array([2.0, 0.0, load - 0.5 * 9.81])
    np.add.at(weight, triangles, (areas / 3.0)[:, None, None] * force)

    def energy(free: np.ndarray) -> float:
        x = X.copy()
        x[inside] = free.reshape(-1, 3)
        now = x[triangles[:, 1:]] - x[triangles[:, :1]]
        C = inverse @ np.einsum("mia,mja->mij", now, now)
        density = mu * h / 2 * (np.trace(C, axis1=1, axis2=2) + 1 / np.linalg.det(C) - 3)
        return float(areas @ density - (weight * (x - X)).sum())

    start = X[inside] + [0.0, 0.0, 0.05]
    found = minimize(energy, start.ravel(), method="BFGS", options={"gtol": 1e-7, "maxiter": 5000})
    x = X.copy()
    x[inside] = found.x.reshape(-1, 3)
    for name, place in (("middle", (0.5, 0.5)), ("side", (0.25, 0.5))):
        node = int(np.argmin(np.linalg.norm(X[:, :2] - place, axis=1)))
        values = [history[f"{name}_{axis}"][-1] for axis in "xyz"]
        np.testing.assert_allclose(values, x[node], atol=2e-6)


def test_a_solid_of_ten_node_tetrahedra_stretches_as_its_law_says():
    """Uniaxial stress in a neo-Hookean cuboid; the lateral stretch solves one equation."""
    mesh = block()
    X, size = mesh.points, np.array([1.0, 0.7, 0.5])
    mu, lam, stretch = 20.0, 30.0, 1.3
    side = minimize(
        lambda s: (mu / 2 * (stretch**2 + 2 * s[0] ** 2 - 3 - 2 * np.log(stretch * s[0] ** 2))
                   + lam / 2 * np.log(stretch * s[0] ** 2) ** 2),
        [0.9], method="Nelder-Mead", options={"xatol": 1e-12, "fatol": 1e-15},
    ).x[0]  # fmt: skip
    sets = {axis: np.flatnonzero(X[:, a] == 0) for a, axis in enumerate("xyz")}
    sets["end"] = np.flatnonzero(X[:, 0] == 1.0)
    mesh = ff.ElementMesh(X, mesh.cells, "tetrahedron", degree=2, nodes=sets)
    model = ff.Model("cuboid")
    model.add(
        ff.UFLBody(
            "cuboid", mesh, solid, density=1.0, parameters={"mu": mu, "lam": lam},
            fixed={axis: axis for axis in "xyz"},
        ),
        ff.PositionProbe("corner", ff.Marker("cuboid", tuple(size.tolist()))),
    )  # fmt: skip
    J = stretch * side**2
    pressure = mu * (stretch - 1 / stretch) + lam * np.log(J) / stretch
    # of quadratic triangles the midside nodes carry a third each
    faces = [
        [node for node in cell if X[node, 0] == 1.0] for cell in mesh.cells.tolist()
    ]  # fmt: skip
    forces = np.zeros(len(X))
    for face in faces:
        if len(face) == 6:
            p = [node for node in face if node < 8]
            area = 0.5 * np.linalg.norm(np.cross(X[p[1]] - X[p[0]], X[p[2]] - X[p[0]]))
            for node in face:
                if node >= 8:
                    forces[node] += area / 3.0
    assert forces.sum() == pytest.approx(0.35)
    for node in np.flatnonzero(forces):
        at = ff.Marker("cuboid", tuple(X[node].tolist()))
        model.add(ff.PointForce(f"pull {node}", at, (pressure * forces[node], 0.0, 0.0)))
    options = ff.StaticOptions(load_steps=4, tolerance=1e-10, quiet=True)
    history = ff.solve_static(model, options).history
    end = [history[f"corner_{axis}"][-1] for axis in "xyz"]
    np.testing.assert_allclose(end, size * [stretch, side, side], atol=1e-6)
