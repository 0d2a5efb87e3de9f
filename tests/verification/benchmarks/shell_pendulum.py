# SPDX-License-Identifier: LGPL-3.0-or-later
"""The double pendulum of two half cylinders: two elements, rigid bodies, and the energy.

The model is that of ``cases/cylindrical_pendulum.py``. The shells flutter; up to 0.4 s meshes and
elements agree about where they are, which later only the energy tells.
"""

from collections.abc import Mapping
from math import pi

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.motions import run
from tests.verification.result import Result

RADIUS, LENGTH, THICKNESS, DENSITY = 0.3, 1.2, 0.01, 7810.0
COLUMNS = ("hinge_y", "hinge_z", "tip_y", "tip_z")
STEP = 1e-3


def shells(mesh: str, element: str, t_end: float) -> Mapping[str, np.ndarray]:
    """History of the pendulum."""
    case = load_case("cylindrical_pendulum")
    model = case.model(mesh=mesh, element=element)
    return run(model, STEP, t_end, tolerance=1e-6)


def rigid(t_end: float) -> Mapping[str, np.ndarray]:
    """History of the same with rigid half cylinders, thin and uniform."""
    mass = DENSITY * THICKNESS * pi * RADIUS * LENGTH
    across, along = 0.5 * mass * RADIUS**2, mass * LENGTH**2 / 12.0
    drop = 2.0 * RADIUS / pi
    shift = mass * drop**2
    inertia = (across + along - shift, 2.0 * across - shift, across + along)
    model = ff.Model("rigid pendulum")
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    low = {-1: ff.Ground(), 1: ff.Marker("first", offset=(0.0, 0.5 * LENGTH, drop))}
    for k, name in enumerate(("first", "second")):
        centre = (0.0, (k + 0.5) * LENGTH, -drop)
        start = ff.Marker(name, offset=(0.0, -0.5 * LENGTH, drop))
        model.add(
            ff.RigidBody(name, mass, inertia, position=centre),
            ff.Revolute(f"hinge_{k}", low[2 * k - 1], start, axis=(1.0, 0.0, 0.0)),
        )
    ends = {name: ff.Marker(body, offset=(0.0, 0.5 * LENGTH, drop))
            for name, body in (("hinge", "first"), ("tip", "second"))}  # fmt: skip
    model.add(*(ff.PositionProbe(name, marker) for name, marker in ends.items()))
    return run(model, STEP, t_end)


def places(
    history: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], t: float, source: str,
    mesh: str, tolerance: float,
) -> list[Result]:  # fmt: skip
    """Ends of both segments at a time, beside those of another history."""
    row = round(t / STEP)
    return [
        Result("cylindrical pendulum", f"{name} at t = {t:g} s, m", float(other[name][row]), source,
               float(history[name][row]), mesh, tolerance, 1.0)
        for name in COLUMNS
    ]  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """Places at 0.4 s and the balance of energies over 1 s, or the like of a short span."""
    nodes, t = ("23x15", 0.4) if full else ("7x5", 0.1)
    history = shells(nodes, "rotation_free", 1.0 if full else t)
    words = f"rotation_free, 2 x {nodes.replace('x', ' x ')} nodes, h = {STEP:g} s"
    balance = float(np.abs(history["energy_balance"]).max() / history["energy_kinetic"].max())
    # lost by the scheme and the iteration; forces that are not those of the energy leave per cents
    lines = [
        Result("cylindrical pendulum", "largest energy balance over kinetic energy", 0.0,
               "conservation", balance, words, 5e-5),
        # bending, which rigid bodies lack, is a hundredth of the length; a wrong hinge or mass
        # gives tens of per cents
        *places(history, rigid(t), t, "rigid half cylinders", words, 2e-2 if full else 2e-3),
    ]  # fmt: skip
    if full:
        # what the meshes leave open
        other = shells("9x7", "director", t)
        lines += places(history, other, t, "director shell, 2 x 9 x 7 nodes", words, 2e-3)
    return lines
