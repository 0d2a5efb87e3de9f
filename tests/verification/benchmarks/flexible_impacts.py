# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impacts of flexible bodies by barriers: bar on a wall, sheet landing flat, strip on its edge."""

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.motions import run_undamped
from tests.verification.result import Result


def bar(elements: int) -> list[Result]:
    """Elastic bar on a rigid wall (SDNV100 of code_aster), from the case ``bar_impact``."""
    found = load_case("bar_impact").run(elements=elements, quiet=True).summary["results"]
    case, mesh = "bar on a rigid wall", f"{elements} elements"
    return [
        Result(case, what, reference, "wave equation", found[name], mesh, tolerance)
        for what, name, reference, tolerance in (
            ("force, N", "force", 1.85638e6, 1e-3),
            ("impulse, N s", "impulse", 128.0, 1e-3),
            ("speed after, m/s", "last_com_velocity", 100.0, 2e-3),
        )
    ]  # fmt: skip


def landing(dt: float, count: int) -> list[Result]:
    """A sheet of 0.4 m x 0.4 m x 1 mm of aluminium lands flat at 0.63 m/s."""
    u = np.linspace(-0.2, 0.2, count + 1)
    mesh = ff.SurfaceMesh.grid("sheet", u, u, lambda p: np.c_[p, np.full(len(p), 6e-3)])
    model = ff.Model("landing", surface=mesh)
    section = ff.ShellSection.isotropic(1e-3, ff.Material(7e10, 0.3, 2700.0))
    model.add(
        ff.Shell("sheet", section, velocity=(0.0, 0.0, -0.63)),
        ff.Contact("ground", "sheet", surfaces=ff.RigidPlane(ff.Ground()), law="barrier"),
        ff.ContactProbe("touch", "ground"), ff.EnergyProbe(), ff.MomentumProbe("p"),
    )  # fmt: skip
    history = run_undamped(model, dt, 0.03).history
    energy = history["energy_kinetic"] + history["energy_strain"]
    text = f"{count} x {count} triangle pairs, h = {dt:g} s"
    case, start = "sheet landing flat", float(energy[0])
    return [
        Result(case, "energy gained", 0.0, "conservation",
               max(float(energy.max()) / start - 1.0, 0.0), text, 1e-6),
        Result(case, "momentum after over before", -1.0, "rebound",
               float(history["p_pz"][-1] / history["p_pz"][0]), text, 1e-3),
    ]  # fmt: skip


def strip(bounces: int, dt: float) -> list[Result]:
    """A strip of 0.2 m x 0.05 m x 1 mm bounces on its edge, upright, between two planes."""
    gap, width, speed, half = 4e-3, 0.05, 0.5, 5e-4
    u, v = np.linspace(-0.1, 0.1, 5), np.linspace(-0.5 * width, 0.5 * width, 2)
    mesh = ff.SurfaceMesh.grid("strip", u, v, lambda p: np.c_[p[:, 0], 0.0 * p[:, 0], p[:, 1]])
    model = ff.Model("strip", surface=mesh)
    section = ff.ShellSection.isotropic(2.0 * half, ff.Material(7e10, 0.3, 2700.0))
    away = 0.5 * (width + gap) + half
    walls = [
        ff.RigidPlane(ff.Ground((0.0, 0.0, -side * away), np.diag([1.0, side, side])))
        for side in (1.0, -1.0)
    ]
    model.add(
        ff.Shell("strip", section, velocity=(0.1, 0.0, -speed)),
        ff.Contact("walls", "strip", surfaces=walls, law="barrier", reach=2e-4),
        ff.EnergyProbe(), ff.MomentumProbe("p"),
    )  # fmt: skip
    history = run_undamped(model, dt, bounces * gap / speed).history
    energy = history["energy_kinetic"] + history["energy_strain"]
    text, case = f"{bounces} bounces, h = {dt:g} s", "strip on its edge, e = 1"
    drift = float(np.ptp(energy)) / float(energy[0]) / bounces
    along = float(np.ptp(history["p_px"])) / float(abs(history["p_px"][0])) / bounces
    # as good as generalized-alpha with bending that is not linear: the strip vibrates in flight,
    # where the energy of single steps is off as well
    return [
        Result(case, "change of the energy over bounces", 0.0, "conservation", drift, text, 1e-3),
        Result(case, "change of the momentum along the walls over bounces", 0.0, "conservation",
               along, text, 1e-5),
    ]  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """All lines; fewer for tests."""
    if not full:
        return strip(4, 1e-3)
    found = landing(5e-3, 5) + bar(100)
    return found + landing(1e-3, 5) + landing(1e-4, 5) + strip(100, 2e-4)
