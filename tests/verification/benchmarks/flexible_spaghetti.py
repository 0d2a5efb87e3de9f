# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flying spaghetti: a very flexible free beam tumbling in space (after Simo, Vu-Quoc 1988)."""

from pathlib import Path

import numpy as np

import flexfem as ff
from tests.verification.motions import compare, run
from tests.verification.result import Result

SOURCE = "Exudyn, refined"
DATA = Path(__file__).parents[2] / "data" / "flying_spaghetti.csv"
COLUMNS = tuple(f"{end}_{axis}" for end in ("lower", "upper") for axis in "xyz")
#: impulse of the force, a tenth of the area under the pulse, on a mass of 10
CENTRE = (65.5, 4.0, 0.0)


def build(elements: int) -> ff.Model:
    """Straight beam of 10 from (6, 0, 0) to (0, 8, 0) with a force and a moment at its start."""
    mesh = ff.build_mesh("flying_spaghetti", elements=elements)
    section = ff.Section.general(
        stiffness=(1e4, 1e4, 1e4, 500.0, 500.0, 500.0), inertia=(1.0, 1.0, 1.0, 10.0, 10.0, 10.0)
    )
    lower = ff.Marker("beam", "start")
    pulse = ff.Table((0.0, 2.5, 5.0), (0.0, 200.0, 0.0))
    model = ff.Model("flying_spaghetti", mesh=mesh)
    model.add(
        ff.Beam("beam", section, orientation=(0.0, 0.0, 1.0)),
        ff.PointForce("pull", lower, (0.1, 0.0, 0.0), amplitude=pulse),
        ff.PointMoment("twist", lower, (0.0, -0.5, -1.0), amplitude=pulse),
        ff.PositionProbe("lower", lower),
        ff.PositionProbe("upper", ff.Marker("beam", "end")),
        ff.EnergyProbe(),
        ff.MomentumProbe("all"),
    )
    return model


def results(full: bool = True) -> list[Result]:
    """Both ends, the centre of mass, and the energy balance."""
    table = np.loadtxt(DATA, delimiter=",", skiprows=_comments() + 1)
    elements, h, end = (40, 5e-3, 15.0) if full else (10, 0.025, 5.0)
    rows = {}
    for t in (2.5, 5.0, 10.0, 15.0):
        if t <= end:
            rows[t] = table[np.argmin(np.abs(table[:, 0] - t)), 1:7]
    history, mesh = run(build(elements), h, end), f"{elements} elements, h = {h:g} s"
    case = "flying spaghetti"
    # of places up to 70; motion on SE(3) instead of R^3 x SO(3) is off three times as far
    tolerance = 1.5e-3 if full else 3e-3
    found = compare(case, SOURCE, mesh, history, COLUMNS, rows, tolerance, 10.0)
    if full:
        centre = {15.0: CENTRE}
        found += compare(
            case, "impulse", mesh, history, ("all_cx", "all_cy", "all_cz"), centre, 1e-5, 10.0
        )
    lost = float(np.abs(history["energy_balance"]).max() / history["energy_work"].max())
    # of second order; a work of the moment in wrong axes leaves a tenth
    what = "energy lost, share of the loads' work"
    return [*found, Result(case, what, 0.0, "conservation", lost, mesh, 1e-3, 1.0)]


def _comments() -> int:
    """Lines before the names of the columns."""
    return sum(line.startswith("#") for line in DATA.read_text().splitlines())
