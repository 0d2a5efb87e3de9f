# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thin beam buckled laterally by a crank (Bauchau, Betsch, Cardona and others 2016).

A crank lifts the tip of a clamped blade over a link that is 0.1 mm beside its plane; at about a
third of the crank's way the blade gives way to the side.
"""

import math
from itertools import pairwise

import numpy as np

import flexfem as ff
from tests.verification.motions import run
from tests.verification.result import Result

SOURCE = "beams refined, independent code"
ASIDE = 1e-4
BLADE = (73e6, 5.025e6, 23.40e6, 877.2, 60830.0, 608.3)
LINK = (33.02e6, 10.81e6, 10.81e6, 914.5, 1189.0, 1189.0)
CRANK = (132.1e6, 43.22e6, 43.22e6, 14630.0, 19020.0, 19020.0)
REFERENCE = (
    ("middle y at t = 0.14 s, m", "middle_y", -0.007318, 0.0),
    ("middle z at t = 0.14 s, m", "middle_z", 0.011384, 0.0),
    ("tip twist at t = 0.14 s, rad", "twist", 0.06853, 0.0),
    ("root M1 at t = 0.14 s, N m", "M1", 13.945, 0.0),
    ("root M2 at t = 0.14 s, N m", "M2", -6533.06, 0.0),
    ("root M3 at t = 0.14 s, N m", "M3", -110.45, 0.0),
)


def _mass(m: float, second: float, third: float) -> tuple[float, ...]:
    return m, m, m, second + third, second, third


def _line(start: tuple, end: tuple, elements: int) -> np.ndarray:
    share = np.linspace(0.0, 1.0, elements + 1)[:, np.newaxis]
    return np.array(start) + share * (np.array(end) - np.array(start))


def build(elements: int) -> ff.Model:
    """Blade of ``elements`` elements, link and crank of a quarter as many."""
    corner, centre = (1.0, ASIDE, -0.25), (0.95, ASIDE, -0.25)
    few = max(1, elements // 4)
    lines = [
        _line((0, 0, 0), (1, 0, 0), elements), _line((1, ASIDE, 0), corner, few),
        _line(corner, centre, few),
    ]  # fmt: skip
    first = np.cumsum([0] + [len(x) for x in lines])
    cells = [np.arange(a, b - 1) for a, b in pairwise(first)]
    at = np.concatenate(cells)
    ends = np.cumsum([0] + [len(c) for c in cells])
    groups = {
        name: np.arange(ends[k], ends[k + 1]) for k, name in enumerate(("blade", "link", "crank"))
    }
    mesh = ff.LineMesh(np.concatenate(lines), np.stack([at, at + 1], axis=1), groups)
    model, y = ff.Model("lateral_buckling", mesh=mesh), (0.0, 1.0, 0.0)
    for name, stiffness, inertia in (
        ("blade", BLADE, _mass(2.68, 2233e-6, 22.33e-6)),
        ("link", LINK, _mass(1.212, 43.65e-6, 43.65e-6)),
        ("crank", CRANK, _mass(4.85, 698.3e-6, 698.3e-6)),
    ):
        section = ff.Section.general(stiffness=stiffness, inertia=inertia)
        model.add(ff.Beam(name, section, orientation=y))
    tip = ff.Marker("blade", "end")
    hub, bearing = ff.Marker("crank", "end"), ff.Ground(centre)
    model.add(
        ff.Rigid("clamp", ff.Ground(), ff.Marker("blade", "start")),
        ff.Spherical("C", ff.Marker("blade", "end", offset=(0, ASIDE, 0)),
                     ff.Marker("link", "start")),
        ff.Revolute("B", ff.Marker("link", "end"), ff.Marker("crank", "start"), axis=y),
        ff.Revolute("G", bearing, hub, axis=y),
        ff.PrescribedAngle("motor", bearing, hub, axis=(0, -1, 0),
                           angle=lambda t: 0.5 * math.pi * (1.0 - math.cos(math.pi * t / 0.4))),
        ff.PositionProbe("middle", ff.Marker("blade", 0.5)),
        ff.Probe("tip", tip, ("twist",),
                 lambda t, s: [math.atan2(s.rotation[2, 1], s.rotation[1, 1])]),
        ff.StrainProbe("root", "blade", 0.0),
        ff.StrainProbe("next", "blade", 1.5 / elements),
    )  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """Shape and root moments soon after buckling began."""
    elements, h = (64, 2.5e-4) if full else (24, 5e-4)
    history = dict(run(build(elements), h, 0.14))
    for k in (1, 2, 3):
        # from the midpoints of the first two elements to the root
        history[f"M{k}"] = 1.5 * history[f"root_m{k}"] - 0.5 * history[f"next_m{k}"]
    mesh = f"{elements} elements, h = {h:g} s"
    # the moment of an instability: a mesh too stiff buckles later and is off by half
    tolerance = 1.5e-2 if full else 0.15
    return [
        Result("lateral buckling by a crank", what, value, SOURCE, float(history[column][-1]), mesh,
               tolerance, scale)
        for what, column, value, scale in REFERENCE
    ]  # fmt: skip
