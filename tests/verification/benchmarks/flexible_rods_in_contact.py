# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rods that touch under all angles, from crossed to parallel: statics with barriers.

Two cantilevers whose upper one is loaded. Where they cross they touch at a point; parallel ones
touch along a line, as soon as the load is spread (Meier, Popp, Wall 2016: neither contact at points
nor one along lines alone is right for all angles).
"""

import math

import numpy as np

import flexfem as ff
from tests.verification.result import Result

#: Length of the rods as far as they cross, and beyond, m.
ARM, BEYOND = 1.0, 0.1
#: Gap of the rods at the start and reach of their contact, m.
GAP = 2e-6


def round_section(radius: float) -> ff.Section:
    """Section of steel."""
    return ff.Section.circle(2.0 * radius, ff.Material(2e11, 0.3, 7800.0))


def compliances(section: ff.Section) -> tuple[float, float]:
    """One over the shear and the bending stiffness, 1/N and 1/(N m^2)."""
    return 1.0 / float(section.stiffness[1, 1]), 1.0 / float(section.stiffness[4, 4])


def point_compliance(section: ff.Section) -> float:
    """Deflection of a cantilever at the crossing under a unit force there, m/N."""
    shear, bending = compliances(section)
    return ARM * shear + ARM**3 / 3.0 * bending


def spread_compliance(section: ff.Section) -> float:
    """The same under a unit force that is spread along the rod, m/N."""
    shear, bending = compliances(section)
    whole = ARM + BEYOND
    bent = ARM**2 * (6.0 * whole**2 - 4.0 * whole * ARM + ARM**2) / 24.0
    return (bent * bending + (whole * ARM - 0.5 * ARM**2) * shear) / whole


def crossed(
    degrees: float, elements: int, *, radius: float, deep: float, spread: bool
) -> dict[str, float]:
    """Forces of two cantilevers over the load on the upper one.

    Under much larger loads the upper one slides off to the side where they are parallel.

    Args:
        degrees: angle between them.
        elements: of each rod as far as the crossing.
        radius: of the rods, m.
        deep: deflection under the load at the crossing if the upper one were alone, m.
        spread: True for a uniform load along the rod, False for one at the crossing.
    """
    section = round_section(radius)
    load = deep / point_compliance(section)
    up, angle = 2.0 * radius + GAP, math.radians(degrees)
    along = {"upper": np.array([1.0, 0.0, 0.0]),
             "lower": np.array([math.cos(angle), math.sin(angle), 0.0])}  # fmt: skip
    s = np.linspace(-ARM, BEYOND, round(elements * (ARM + BEYOND) / ARM) + 1)
    points = [np.outer(s, way) for way in along.values()]
    points[0][:, 2] = up
    n = len(s)
    cells = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    mesh = ff.LineMesh(
        np.concatenate(points), np.concatenate([cells, cells + n]),
        {"upper": np.arange(n - 1), "lower": np.arange(n - 1, 2 * n - 2)},
        {"crossing": elements},
    )  # fmt: skip
    model = ff.Model("rods", mesh=mesh)
    for name, place in zip(along, points, strict=True):
        model.add(
            ff.Beam(name, section, orientation=(0.0, 0.0, 1.0)),
            ff.Rigid(f"{name}_root", ff.Ground(place[0]), ff.Marker(name, "start")),
            ff.ReactionProbe(f"{name}_force", f"{name}_root"),
        )
    down = np.array([0.0, 0.0, -load])
    if spread:
        model.add(ff.LineLoad("load", "upper", down / (ARM + BEYOND)))
    else:
        model.add(ff.PointForce("load", ff.Marker("upper", "crossing"), down))
    model.add(ff.Contact("rods", "upper", "lower", reach=GAP), ff.ContactProbe("touch", "rods"))
    options = ff.StaticOptions(load_steps=2, tolerance=1e-10, quiet=True)
    outcome = ff.solve_static(model, options)
    if outcome.status != "ok":
        raise RuntimeError(f"{degrees} degrees: {outcome.status}")
    end = {name: float(values[-1]) / load for name, values in outcome.history.items()}
    return {
        "force": end["touch_fz"],
        "opposite": end["touch_fz"] - end["lower_force_fz"],
        "sum": end["upper_force_fz"] + end["lower_force_fz"] - 1.0,
        "closed": (GAP - load * end["touch_gap"]) / deep,
    }


#: Largest deviation from half of the load, of rods that share it: 2e-5 m of 2 mm is the gap.
SAME = 1e-3
#: Largest change of the force between neighbours, of the load: where contact along a line ends and
#: contact at a point begins without a transition it is 0.26.
CHANGE = 0.03


def at_point(degrees: list[float], elements: int) -> list[Result]:
    """Both rods are alike: each bears half of the load at the crossing, whatever the angle."""
    found = [crossed(angle, elements, radius=5e-3, deep=2e-3, spread=False) for angle in degrees]
    force = np.array([one["force"] for one in found])
    case, mesh = "crossed cantilevers", f"2 x {elements} elements, {len(degrees)} angles"
    return [
        Result(case, f"force over load at {degrees[k]:g} degrees", 0.5, "two springs", force[k],
               mesh, SAME)
        for k in (0, 1, -1)
    ] + [
        Result(case, "largest deviation of all angles from half of the load", 0.0, "two springs",
               float(np.abs(force - 0.5).max()), mesh, SAME),
        # without a contact force that is opposite on both rods it is 0.5
        Result(case, "load less both reactions, over the load, largest of all angles", 0.0,
               "forces of contact equal and opposite", max(abs(one["sum"]) for one in found), mesh,
               1e-12),
        # the reaction of the lower rod alone, to the tolerance of the iteration
        Result(case, "force less the lower reaction, over the load, largest of all angles", 0.0,
               "equilibrium", max(abs(one["opposite"]) for one in found), mesh, 1e-7),
    ]  # fmt: skip


def along_line(degrees: list[float], elements: int) -> list[Result]:
    """Under a spread load parallel rods touch all along: the force rises from that of a point."""
    radius, deep = 5e-2, 1e-2
    found = [crossed(angle, elements, radius=radius, deep=deep, spread=True) for angle in degrees]
    force = np.array([one["force"] for one in found])
    near = np.diff(degrees) <= 1.0
    section = round_section(radius)
    point = point_compliance(section)
    right = 0.5 * (spread_compliance(section) / point - found[-1]["closed"])
    case, same = "pressed cantilevers", "the same deflections"
    mesh = f"2 x {elements} elements, {len(degrees)} angles"
    return [
        # elements; a contact along a part of the line has the other force
        Result(case, "force over load at 90 degrees", right, "beam theory", force[-1], mesh, 5e-3),
        # close to the roots the rods do not touch; contact at a point alone makes 0.22
        Result(case, "force over load, parallel", 0.5, same, force[0], mesh, 6e-2),
        Result(case, "largest change of the force between neighbours, over the load", 0.0,
               "continuous", float(np.abs(np.diff(force)[near]).max()), mesh, CHANGE),
        Result(case, "largest rise of the force with the angle", 0.0, "it falls",
               max(float(np.diff(force).max()), 0.0), mesh, 1e-3),
        Result(case, "load less both reactions, over the load, largest of all angles", 0.0,
               "forces of contact equal and opposite", max(abs(one["sum"]) for one in found), mesh,
               1e-12),
    ]  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """All angles in steps of one degree, and the transition to parallel rods."""
    if not full:
        return at_point([0.0, 2.0, 90.0], 10) + along_line([0.0, 0.02, 90.0], 10)
    whole = [float(angle) for angle in range(91)]
    fine = [*np.geomspace(1e-4, 1.0, 33)]
    return at_point(whole, 20) + along_line([0.0, *fine, *whole[2:]], 40)
