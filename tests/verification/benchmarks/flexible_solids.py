# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slender nonlinear solids in motion: rubber pendulum, beam spun up, rod of a slider-crank.

Hexahedra of second order, one in a section. Joints hold the mean of an end face, as the ends of a
rod are held, or a rigid hub to which the face is bonded: it can then neither warp nor contract,
which stiffens a cell of 0.83 m as a whole.
"""

import math
from collections.abc import Iterator, Mapping

import numpy as np

import flexfem as ff
from flexfem.resources import load_module, shipped_files
from tests.verification.benchmarks import flexible_spin_up
from tests.verification.motions import compare, run
from tests.verification.result import Result

Values = np.ndarray
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
#: Rubber rod as that of Lang, Linn and Arnold (2011), but square: length, side, modulus, density.
LENGTH, SIDE, RUBBER, HEAVY = 1.0, 0.01, 5e6, 1100.0


def bar(
    length: float, depth: float, width: float, cells: int, law: ff.laws.SolidLaw, density: float,
    *, start: float = 0.0, name: str = "bar", **options: object,
) -> ff.Solid:  # fmt: skip
    """Bar along x, whose section has a depth along y and a width along z about the axis."""
    mesh = ff.SolidMesh.box(
        (length, depth, width), (cells, 1, 1), origin=(start, -0.5 * depth, -0.5 * width)
    )
    return ff.Solid(name, law, mesh, density=density, **options)


def swung(solid: bool, cells: int, h: float, end: float) -> Mapping[str, Values]:
    """Tip of the rubber rod, which falls from the horizontal about a hinge at its end."""
    model = ff.Model("rubber")
    if solid:
        law = ff.laws.NeoHookean.from_young(RUBBER, 0.49)
        rod = bar(LENGTH, SIDE, SIDE, cells, law, HEAVY, formulation="dilatation")
        hinge, tip = (
            rod.surface_marker("x0"),
            ff.SolidProbe("tip", "bar", "x1", measures=("position",)),
        )
    else:
        x = np.linspace(0.0, LENGTH, cells + 1)
        lines = np.stack([np.arange(cells), np.arange(1, cells + 1)], axis=1)
        model = ff.Model(
            "rubber",
            mesh=ff.LineMesh(np.stack([x, 0 * x, 0 * x], axis=1), lines, {"bar": np.arange(cells)}),
        )
        section = ff.Section.rectangle(SIDE, SIDE, ff.Material(RUBBER, 0.49, HEAVY))
        rod = ff.Beam("bar", section, orientation=Y, formulation="nurbs", degree=3)
        hinge, tip = ff.Marker("bar", "start"), ff.PositionProbe("tip", ff.Marker("bar", "end"))
    model.add(
        rod, ff.Gravity((0.0, 0.0, -9.81)), ff.Revolute("hinge", ff.Ground(), hinge, axis=Y), tip
    )
    return run(model, h, end)


def pendulum(full: bool) -> Iterator[Result]:
    """The rod of solid rubber against flexfem's exact rod, both with the same steps."""
    cells, h, end = (40, 2e-3, 1.0) if full else (6, 0.02, 0.3)
    solid, beam = swung(True, cells, h, end), swung(False, 24 if full else 6, h, end)
    for t in (0.25, 0.5, 0.75, 1.0) if full else (0.3,):
        row = int(np.argmin(np.abs(beam["t"] - t)))
        rows = {t: [float(beam[f"tip_{axis}"][row]) for axis in "xz"]}
        # of the length; a rod that is 2 % stiffer is 5e-3 off at 1 s
        yield from compare(
            "rubber pendulum", "cubic rods", f"{cells} hexahedra, h = {h:g} s", solid,
            ("tip_x", "tip_z"), rows, 2e-3 if full else 5e-3, LENGTH,
        )  # fmt: skip


def spun(cells: int, bonded: bool, h: float, end: float) -> Mapping[str, Values]:
    """Tip, in the axes of the hub, of the beam of ``flexible_spin_up`` as a solid."""
    depth, area = math.sqrt(12.0 * 2e-7 / 4e-4), 4e-4
    law = ff.laws.SaintVenantKirchhoff(7e10, 0.3)
    # in space a section so thin buckles sideways as it is accelerated
    beam = bar(10.0, depth, area / depth, cells, law, 3000.0, fixed={"z0": "z"})
    model, angle = ff.Model("spin_up"), flexible_spin_up._angle
    held = beam.surface_marker("x0")
    if bonded:
        held = ff.Marker("hub")
        model.add(
            ff.RigidBody("hub", 1e-3, (1e-6, 1e-6, 1e-6)),
            ff.RigidPoints("bond", held, nodes=beam.node_markers("x0")),
        )
    model.add(
        beam,
        ff.Revolute("bearing", ff.Ground(), held, axis=Z),
        ff.PrescribedAngle("motor", ff.Ground(), held, axis=Z, angle=angle),
        ff.SolidProbe("tip", "bar", "x1", measures=("position",)),
    )
    # nodes of the bond that lie in the plane of symmetry are fixed twice along z
    redundant = "least_norm" if bonded else "refuse"
    history = run(model, h, end, redundant_constraints=redundant)
    turn = np.array([angle(t) for t in history["t"]])
    u2 = np.cos(turn) * history["tip_y"] - np.sin(turn) * history["tip_x"]
    return {"t": history["t"], "u2": u2}


def spin_up() -> Iterator[Result]:
    """Deflections of the beam that is spun up, by a hinge on its mean end and by a bonded hub."""
    cells, h = 12, 0.02
    for bonded, end in ((False, 12.0), (True, 8.0)):
        history = spun(cells, bonded, h, end)
        case = "spin-up of a solid beam, " + ("bonded hub" if bonded else "mean of the end")
        mesh = f"{cells} hexahedra, h = {h:g} s"
        known = {t: v[1:] for t, v in flexible_spin_up.REFERENCE.items() if t <= end}
        # without centrifugal stiffening the deflection grows without bound after 6 s
        common = (case, flexible_spin_up.SOURCE, mesh, history)
        yield from compare(*common, ("u2",), known, 1e-2, 0.57)
        yield Result(
            case, "largest deflection", flexible_spin_up.PEAK, flexible_spin_up.SOURCE,
            float(history["u2"].min()), mesh, 1e-2,
        )  # fmt: skip


def slider_crank(crank: int, cells: int) -> ff.Model:
    """The case ``slider_crank`` with a crank of NURBS beams and rod II as a solid."""
    case = load_module(shipped_files("cases")["slider_crank"], "flexfem_cases")
    x = np.linspace(0.0, 0.3, crank + 1)
    lines = np.stack([np.arange(crank), np.arange(1, crank + 1)], axis=1)
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    model = ff.Model("rod", mesh=ff.LineMesh(points, lines, {"crank": np.arange(crank)}))
    section = ff.Section.rectangle(0.03, 0.03, ff.Material(2.1e11, 0.3, 7850.0))
    law = ff.laws.SaintVenantKirchhoff(2.1e11, 0.3)
    rod = bar(0.6, 0.03, 0.03, cells, law, 7850.0, start=0.3)
    root, tip = ff.Marker("crank", "start"), ff.Marker("crank", "end")
    pin, end = rod.surface_marker("x0"), rod.surface_marker("x1")
    slider = ff.Marker("slider")
    places = [("pin", "x0"), ("middle", (0.6, 0.0, 0.0)), ("end", "x1")]
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Beam("crank", section, orientation=Y, formulation="nurbs", degree=3),
        rod,
        # it does not turn: nothing acts on it but at its centre
        ff.RigidBody("slider", 0.1, (1e-5, 1e-5, 1e-5), position=(0.9, 0.0, 0.0)),
        ff.Spherical("ground_pin", ff.Ground(), root),
        ff.Spherical("crank_pin", tip, pin),
        ff.Spherical("slider_pin", end, slider),
        ff.PointOnLine("guide", ff.Ground(), slider, axis=(1.0, 0.0, 0.0)),
        ff.PointMoment("drive", root, (0.0, 0.0, 500.0)),
        ff.Probe("motion", (root, tip), ("angle", "rate"), case._crank, unwrap=("angle",)),
        *(ff.SolidProbe(name, "bar", place, measures=("position",)) for name, place in places),
    )
    return model


def rod() -> Iterator[Result]:
    """Largest deflection of the rod in the high-speed slider-crank, and the angle of the crank."""
    crank, cells, h = 6, 16, 5e-5
    history = run(slider_crank(crank, cells), h, 0.2)
    pin, middle, tip = (
        np.stack([history[f"{name}_{axis}"] for axis in "xyz"]) for name in ("pin", "middle", "end")
    )
    deflection = np.linalg.norm(middle - 0.5 * (pin + tip), axis=0) / 0.6
    case, source = "slider-crank with a solid rod", "spectral rods"
    mesh = f"6 cubic beams, {cells} hexahedra, h = {h:g} s"
    angle = float(history["angle"][int(np.argmin(np.abs(history["t"] - 0.1)))])
    yield Result(case, "largest deflection", 0.05043, source, float(deflection.max()), mesh, 1e-2)
    yield Result(case, "crank angle at 0.1 s, rad", 8.043778, source, angle, mesh, 1e-3)


def results(full: bool = True) -> list[Result]:
    """All lines; the short ones are the pendulum until 0.3 s on few cells."""
    return [*pendulum(full), *((*spin_up(), *rod()) if full else ())]
