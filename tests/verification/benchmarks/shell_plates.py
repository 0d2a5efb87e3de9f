# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thin square plates, hinged or clamped all around, with both elements.

The side, the bending stiffness and the mass per area are 1. Hinged plates have Navier's solution;
the references of clamped ones are those of Ritz's method with polynomials that satisfy the edges,
of the same theory of thin plates (Leissa, J. Sound Vib. 31 (1973) 257, has 35.992, 73.413, 108.27
with fewer terms).
"""

from functools import lru_cache
from math import pi

import numpy as np
from numpy.polynomial import Legendre
from scipy.linalg import eigh

import flexfem as ff
from tests.verification.result import Result

THICKNESS, RATIO = 5e-3, 0.3
SIDES = [f"plate_{side}" for side in ("left", "right", "bottom", "top")]
#: Load that deflects by a thousandth of the thickness and less: membranes do not carry.
LOAD = 1e-3
#: Modes that are compared: the second and the third have one frequency.
MODES = (0, 1, 3)


def navier() -> tuple[float, list[float]]:
    """Deflection of the middle under a unit load, and the four lowest frequencies (rad/s)."""
    odd = np.arange(1, 400, 2)
    m, n = np.meshgrid(odd, odd)
    sign = (-1.0) ** ((m + n) / 2 - 1)
    deflection = float((16.0 / pi**6 * sign / (m * n * (m**2 + n**2) ** 2)).sum())
    return deflection, [pi**2 * size for size in (2.0, 5.0, 5.0, 8.0)]


@lru_cache
def ritz(terms: int = 14) -> tuple[float, list[float]]:
    """The same of the clamped plate, with ``(1 - x^2)^2 P_i(x)`` along both sides of 2."""
    edge = Legendre.fromroots([1.0, 1.0, -1.0, -1.0])
    shapes = [edge * Legendre.basis(i) for i in range(terms)]
    x, w = np.polynomial.legendre.leggauss(terms + 6)
    values, slopes, bends = (
        np.array([f.deriv(k)(x) if k else f(x) for f in shapes]) for k in (0, 1, 2)
    )
    A, B, C = ((f * w) @ f.T for f in (values, slopes, bends))
    mass = np.kron(A, A)
    # clamped edges: the integral of the squared Laplacian is the energy for every ratio
    stiff = np.kron(C, A) + np.kron(A, C) + 2.0 * np.kron(B, B)
    squares = eigh(stiff, mass, eigvals_only=True, subset_by_index=[0, 3])
    load, middle = np.kron(values @ w, values @ w), [f(0.0) for f in shapes]
    deflection = float(np.kron(middle, middle) @ np.linalg.solve(stiff, load))
    # lengths are halved on the plate of side 1
    return deflection / 16.0, [4.0 * float(value) for value in np.sqrt(squares)]


def plate(cells: int, element: str, rule: str, load: float = LOAD) -> ff.Model:
    """Plate of cells cut in two under a load per area."""
    youngs = 12.0 * (1.0 - RATIO**2) / THICKNESS**3
    section = ff.ShellSection.isotropic(THICKNESS, ff.Material(youngs, RATIO, 1.0 / THICKNESS))
    model = ff.Model("plate", surface=ff.SurfaceMesh.rectangle("plate", (1.0, 1.0), (cells, cells)))
    model.add(
        ff.Shell("plate", section, element=element, edges=dict.fromkeys(SIDES, rule)),
        ff.SurfaceLoad("load", "plate", (0.0, 0.0, -load)),
        ff.PositionProbe("middle", ff.Marker("plate", (0.5, 0.5, 0.0))),
    )
    return model


def computed(model: ff.Model) -> tuple[float, list[float]]:
    """Deflection under a unit load, and the four lowest frequencies (rad/s)."""
    statics = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True))
    modes = ff.find_modes(model, ff.ModeOptions(modes=4, quiet=True)).modes
    deflection = -float(statics.history["middle_z"][-1]) / LOAD
    return deflection, [2.0 * pi * float(f) for f in modes.frequencies]


def results(full: bool = True) -> list[Result]:
    """Deflections and frequencies."""
    lines = []
    for rule, (deflection, frequencies), source in (
        ("hinged", navier(), "Navier's series"),
        ("clamped", ritz(), "Ritz's method, thin plate"),
    ):
        # errors of the meshes; hinged in place of clamped edges are off by a factor of 3 and of 2
        for element, cells, tolerance in (
            ("rotation_free", 48 if full else 16, 5e-3 if full else 5e-2),
            ("director", 24 if full else 8, 5e-3 if full else 5e-2),
        ):
            ours, found = computed(plate(cells, element, rule))
            case, mesh = f"{rule} square plate, {element}", f"{cells} x {cells} cells"
            lines.append(
                Result(case, "deflection D/(q a^4)", deflection, source, ours, mesh, tolerance)
            )
            lines += [
                Result(
                    case, f"frequency {k + 1}, sqrt(D/(rho h a^4)) rad/s", frequencies[k], source,
                    found[k], mesh, tolerance,
                )
                for k in MODES
            ]  # fmt: skip
    return lines
