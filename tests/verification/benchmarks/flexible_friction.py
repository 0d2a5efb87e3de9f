# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two cantilevers on top of each other, bent by a sudden force, rub (V5.02.140 of code_aster).

Its reference is another computation with solids. Here the beams are alike and move alike, so that
they share the load P at the tip of the upper one: they touch at their tips with P/2 at all times.
Their surfaces slip by the depth h times the rotation phi of the tips, and friction takes
mu P/2 h |d phi|.
"""

import math
from collections.abc import Mapping

import numpy as np

import flexfem as ff
from flexfem._types import FloatArray
from tests.verification.result import Result

#: Length, depth and breadth, m, load, N, coefficient; gap and reach, m.
LENGTH, DEPTH, LOAD, FRICTION, GAP = 1.0, 0.1, 1e4, 0.2, 1e-5
E_MODULUS, DENSITY = 200e9, 7800.0
#: Period of the first mode of one of them, s.
PERIOD = 2.0 * math.pi / 3.51602 / math.sqrt(E_MODULUS * DEPTH**2 / 12.0 / DENSITY) * LENGTH**2


def rubbed(elements: int, step: float, periods: float) -> Mapping[str, FloatArray]:
    """History of the motion from rest."""
    section = ff.Section.rectangle(DEPTH, DEPTH, ff.Material(E_MODULUS, 0.0, DENSITY))
    ends = {
        name: [(0.0, 0.0, z), (LENGTH, 0.0, z)]
        for name, z in (("lower", 0.0), ("upper", DEPTH + GAP))
    }
    model = ff.Model("beams", mesh=ff.LineMesh.straight(ends, elements))
    for name, (place, _) in ends.items():
        model.add(
            ff.Beam(name, section),
            ff.Rigid(f"{name}_root", ff.Ground(place), ff.Marker(name, "start")),
            ff.PositionProbe(f"{name}_tip", ff.Marker(name, "end")),
            ff.Probe(f"{name}_turn", ff.Marker(name, "end"), (f"{name}_angle",), angle),
        )
    model.add(
        ff.PointForce("load", ff.Marker("upper", "end"), (0.0, 0.0, -LOAD)),
        ff.Contact("rub", "upper", "lower", radius=0.5 * DEPTH, friction=FRICTION, reach=GAP),
        ff.ContactProbe("touch", "rub"), ff.EnergyProbe(),
    )  # fmt: skip
    span = periods * PERIOD
    options = ff.RunOptions(dt=step, t_end=span, rho_inf=0.8, tolerance=1e-10, quiet=True)
    outcome = ff.simulate(model, options)
    if outcome.status != "ok":
        raise RuntimeError(outcome.status)
    return outcome.history


def angle(t: float, tip: ff.MarkerState) -> tuple[float]:
    """Rotation of a tip about y."""
    del t
    return (math.atan2(-tip.rotation[2, 0], tip.rotation[0, 0]),)


def results(full: bool = True) -> list[Result]:
    """Forces, their sign, and what they take of the energy."""
    elements, step, periods = (20, 1e-4, 3.0) if full else (6, 2e-4, 0.5)
    history = rubbed(elements, step, periods)
    turns = np.diff(0.5 * (history["upper_angle"] + history["lower_angle"]))
    normal, friction = history["touch_normal"][1:], history["touch_fx"][1:]
    lost = np.diff(history["energy_dissipation"])
    slides = np.abs(turns) > 0.5 * np.abs(turns).max()
    # the upper one turns to positive angles as it goes down, its lower side moves backwards
    part = (np.sign(turns) * friction / np.maximum(FRICTION * normal, 1.0))[slides]
    case, mesh = "two beams rub", f"2 x {elements} elements, h = {step:g} s, {periods:g} periods"
    right = FRICTION * 0.5 * LOAD * DEPTH * float(np.abs(turns).sum())
    whole = history["energy_dissipation"][-1]
    return [
        # waves between the beams in the first swing; unlike beams would have 0 or 1
        Result(case, "normal force over load, mean", 0.5, "both beams alike",
               float(normal.mean()) / LOAD, mesh, 6e-2),
        # at each turning point they stick for a moment; friction at the axes takes nothing
        Result(case, "energy that friction takes, J", right, "mu P/2 h times all rotations", whole,
               mesh, 3e-2 if full else 6e-2),
        Result(case, "energy that friction returns in a step, largest, over all that it takes", 0.0,
               "dissipation", max(float(-lost.min()), 0.0) / whole, mesh, 1e-12),
        # -1 for a force along the motion
        Result(case, "friction against the motion, over Coulomb's, while they slide, least", 1.0,
               "Coulomb", float(part.min()), mesh, 0.05),
        Result(case, "the same, largest", 1.0, "Coulomb", float(part.max()), mesh, 0.05),
    ]  # fmt: skip
