# SPDX-License-Identifier: LGPL-3.0-or-later
"""Finite elements in floating frames: element matrices, prescribed frames, four formalisms."""

from typing import Any

import numpy as np

import flexfem as ff
from flexfem import research
from flexfem.cli import load_case
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import accelerations, consistent_start
from tests.verification.result import Result

RUBBER = ff.Material(youngs_modulus=2e6, poisson_ratio=0.3, density=1200.0)
LENGTH, SIDE, SPEED = 0.5, 0.04, 30.0


def bar(elements: int, **more: Any) -> research.EnergyBody:
    """A soft bar along the first axis of its frame."""

    def mesh(comm: Any) -> Any:
        from dolfinx.mesh import create_interval

        return create_interval(comm, elements, (0.0, LENGTH))

    return research.EnergyBody(
        "bar", research.BeamMatter(RUBBER, SIDE, SIDE), research.PlanarFrame(), mesh, **more
    )


def element_rows() -> list[Result]:
    """Entries of the matrices of one quadratic element, where its middle node is."""
    found = research.element_matrices(bar(1), (0.0, 0.0, SPEED), (0.0, 0.0, 100.0), 0)
    middle = [
        int(np.flatnonzero((found.points[:, 0] == 0.5 * LENGTH) & (found.components == i))[0])
        for i in (0, 1)
    ]
    x, y = middle
    mass = RUBBER.density * SIDE**2 * LENGTH
    source, mesh = "int rho N^T W N by hand", "1 quadratic beam"
    # a factor 2 of c, the sign of k(omega) or a wrong shape function is 10 per cent and more
    values = (
        ("m, kg", 8.0 / 15.0 * mass, found.m[x, x]),
        ("c, kg/s", -16.0 / 15.0 * SPEED * mass, found.c[x, y]),
        ("k(eps), kg/s^2", -8.0 / 15.0 * 100.0 * mass, found.k_epsilon[x, y]),
        ("k(omega), kg/s^2", -8.0 / 15.0 * SPEED**2 * mass, found.k_omega[x, x]),
        ("q_i(eps), N", mass * LENGTH / 3.0 * 100.0, found.q_epsilon[y]),
        ("q_i(omega), N", -mass * LENGTH / 3.0 * SPEED**2, found.q_omega[x]),
        ("m_Oi, kg", 2.0 / 3.0 * mass, found.m_origin[x, 0]),
    )
    return [Result("element in a moving frame", f"{name}, middle node", float(reference), source,
                   float(ours), mesh, 1e-12) for name, reference, ours in values]  # fmt: skip


def stretched_bar(elements: int) -> Result:
    """Elongation of a spinning bar, EA u'' + rho A omega^2 (x + u) = 0: k + k(omega) and q_i."""
    found = research.element_matrices(bar(elements), (0.0, 0.0, SPEED), (0.0, 0.0, 0.0)).of_free()
    u = np.linalg.solve(found.k + found.k_omega, -found.q_omega)
    tip = int(np.flatnonzero((found.points[:, 0] == LENGTH) & (found.components == 0))[0])
    wave = SPEED * np.sqrt(RUBBER.density / RUBBER.youngs_modulus)
    exact = np.tan(wave * LENGTH) / wave - LENGTH
    # without k(omega) it is 5 per cent less
    return Result("spinning bar in its frame", "elongation, m", float(exact),
                  "tan(kL)/k - L, k = omega sqrt(rho/E)", float(u[tip]),
                  f"{elements} quadratic beams", 1e-5)  # fmt: skip


def formalism_rows() -> list[Result]:
    """Accelerations of a slider-crank by each formalism beside Lagrange's."""
    study = load_case("formalisms").model(element="plane", motion="planar", elements=1)
    model = MechanismEquations(study.first)
    q, v = consistent_start(model)
    reference = accelerations("lagrange", model, q, v)
    at = int(np.argmax(np.abs(reference)))
    # round-off of a mass matrix; any term left out is 1e-3 and more
    return [Result("slider-crank by formalisms", f"largest acceleration, {name}",
                   float(reference[at]), "Lagrange's equations with multipliers",
                   float(accelerations(name, model, q, v)[at]), "1 x 1 quadratic plane stress",
                   1e-9) for name in research.FORMALISMS[1:]]  # fmt: skip


def crank_rows(full: bool) -> list[Result]:
    """Slider of a crank that rotates uniformly, with links too stiff to bend, by all formalisms."""
    end, h = 0.1, 5e-4 if full else 2e-3
    study = load_case("formalisms").model(
        element="beam", motion="planar", prescribed=True, elements=1, youngs_modulus=7e13
    )
    short, long, angle = 0.3, 0.6, np.radians(60.0) + 20.0 * end
    exact = short * np.cos(angle) + np.sqrt(long**2 - (short * np.sin(angle)) ** 2)
    rows = []
    for name in research.FORMALISMS if full else ("lagrange", "maggi"):
        own = research.Mechanism(
            name, study.first.bodies, study.first.joints, (), study.first.gravity, name,
            study.first.observed,
        )  # fmt: skip
        options = ff.RunOptions(dt=h, t_end=end, rho_inf=0.8, tolerance=1e-10)
        outcome = research.simulate_mechanism(own, options)
        # a motion that is one step late is 5e-3 away
        rows.append(Result("slider-crank, prescribed crank", f"x of the slider, m, {name}",
                           float(exact), "rigid links", float(outcome.history["x"][-1]),
                           f"1 beam a link, h = {h:g} s", 1e-6))  # fmt: skip
    return rows


def results(full: bool = True) -> list[Result]:
    """All lines."""
    return [
        *element_rows(), stretched_bar(4), *formalism_rows(), *crank_rows(full)
    ]  # fmt: skip
