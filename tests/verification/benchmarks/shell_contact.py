# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of shells with rigid surfaces: a lying sheet, a sphere in a plate, a draped fabric."""

from math import pi

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.benchmarks.shell_plates import plate
from tests.verification.result import Result

#: Force per penetration and area, N/m^3.
STIFFNESS = 1e5
MASS = 2.0


def lying_sheet(element: str) -> list[Result]:
    """A sheet of 0.4 m^2 and 2 kg/m^2 touches from the start: its weight, and how deep it sinks."""
    mesh = ff.SurfaceMesh.rectangle("sheet", (0.8, 0.5), (8, 5))
    section = ff.ShellSection.orthotropic((1e4, 1e4, 4e3), (1.0, 1.0, 0.4), 0.0, MASS, 0.01)
    model = ff.Model("sheet", surface=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", section, element=element, fixed={"sheet_left": "x", "sheet_bottom": "y"}),
        ff.Contact(
            "floor", "sheet", stiffness=STIFFNESS,
            surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, 1e-5 - 0.005))),
        ),
        ff.ContactProbe("contact", "floor"),
    )  # fmt: skip
    options = ff.StaticOptions(gravity_load="constant", load_steps=1, quiet=True)
    history = ff.solve_static(model, options).history
    case, words = f"sheet on a plane, {element}", "8 x 5 cells"
    # equilibrium, to the tolerance of the iteration; half of a thickness, or areas of nodes that do
    # not add up to the sheet's, change the first digit. Nodes of directors carry a bit more than
    # their areas' share of the mass, or less
    share = 1e-6 if element == "rotation_free" else 2e-2
    return [
        Result(case, "force of the plane, N", 0.4 * MASS * 9.81, "weight",
               float(history["contact_fz"][-1]), words, 1e-6),
        Result(case, "penetration, m", MASS * 9.81 / STIFFNESS, "weight per area over stiffness",
               float(history["contact_penetration"][-1]), words, share),
    ]  # fmt: skip


def compliance() -> float:
    """Deflection of a hinged square plate under a unit force on its middle; Navier."""
    odd = np.arange(1, 4000, 2)
    m, n = np.meshgrid(odd, odd)
    return float((4.0 / pi**4 / (m * m + n * n) ** 2.0).sum())


def pressed_plate(element: str, cells: int, tolerance: float) -> Result:
    """A large fixed sphere, which the plate of ``shell_plates`` overlaps, touches its middle."""
    overlap, radius, half = 1e-5, 2.0, 2.5e-3
    model = plate(cells, element, "hinged", load=0.0)
    centre = (0.5, 0.5, radius + half - overlap)
    sphere = ff.RigidSphere(ff.Ground(centre), radius)
    model.add(
        ff.Contact("press", "plate", surfaces=sphere, stiffness=1e7),
        ff.ContactProbe("contact", "press"),
    )
    history = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True)).history
    depth = -float(history["middle_z"][-1])
    # mesh; contact on several nodes, or a force that is not on the plate, changes the first digit
    return Result(
        f"sphere on a hinged plate, {element}", "force over depth, D/a^2", 1.0 / compliance(),
        "Navier's series", -float(history["contact_fz"][-1]) / depth, f"{cells} x {cells} cells",
        tolerance,
    )  # fmt: skip


def draped_fabric(mesh: str) -> list[Result]:
    """The fabric of ``cases/draping.py`` on its sphere, relaxed."""
    case = load_case("draping")
    model = case.build(**case.prepare({"mesh": mesh})[0])
    outcome = ff.relax(model, ff.RelaxationOptions(tolerance=1e-3, quiet=True))
    if outcome.status != "ok":
        raise RuntimeError(f"draping: {outcome.status}")
    end = {name: float(values[-1]) for name, values in outcome.history.items()}
    weight = 0.3 * 0.3 * 0.593e-3 * 320.4 * 9.81
    name, words = "draped fabric", f"{mesh.replace('x', ' x ')} nodes, relaxation to 1e-3"
    # forces out of balance are 1e-3 in root mean square over the nodes, and their sum less;
    # what passes through the sphere has no gap; rounding, which is not
    # symmetric, grows on the way, and a sheet that slides off to one side is off by a tenth
    return [
        Result(name, "force of the sphere, N", weight, "weight", end["contact_fz"], words, 1e-3),
        Result(name, "gap over thickness", 0.03, "between zero and the reach, 0.05",
               end["contact_gap"] / 0.593e-3, words, 0.6),
        Result(name, "outline off itself after half a turn, over its radius", 0.0, "symmetry",
               end["outline_half_turn"], words, 1e-3),
    ]  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """Weights, penetrations and forces."""
    lines = []
    for element, cells in (
        ("rotation_free", 48 if full else 16),
        ("director", 24 if full else 8),
    ):
        lines += lying_sheet(element)
        lines.append(pressed_plate(element, cells, 1e-2 if full else 5e-2))
    return lines + (draped_fabric("31x31") if full else [])
