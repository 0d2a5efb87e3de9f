# SPDX-License-Identifier: LGPL-3.0-or-later
"""Four bars with a misaligned joint (Bauchau, Betsch, Cardona and others 2016).

Rigid bars could not move at all: the axis of one revolute is rotated by 5 degrees out of the normal
of the mechanism's plane.
"""

import math

import numpy as np

import flexfem as ff
from tests.verification.motions import run
from tests.verification.result import Result

SOURCE = "beams refined, independent code"
CORNERS = np.array([[0.0, 0.0, 0.0], [0.0, 0.12, 0.0], [0.24, 0.12, 0.0], [0.24, 0.0, 0.0]])
STIFF = (5.29920e7, 1.68803e7, 1.68803e7, 733.488, 1130.50, 1130.50)
SOFT = (1.32480e7, 4.22008e6, 4.22008e6, 45.8430, 70.6560, 70.6560)
HEAVY = (1.99680, 1.99680, 1.99680, 8.51968e-5, 4.25984e-5, 4.25984e-5)
LIGHT = (0.49920, 0.49920, 0.49920, 5.32480e-6, 2.66240e-6, 2.66240e-6)
#: normals of the bars in the plane: the third section axis points out of it
ACROSS = {"bar_1": (-1.0, 0.0, 0.0), "bar_2": (0.0, 1.0, 0.0), "bar_3": (1.0, 0.0, 0.0)}
REFERENCE = (
    ("C_x at t = 1 s", "corner_x", 0.30773727, 1e-4, 0.24),
    ("C_y at t = 1 s", "corner_y", 0.09902176, 1e-4, 0.24),
    ("C_z at t = 1 s", "corner_z", -0.00204470, 5e-4, 0.24),
    ("angle at D at t = 1 s, rad", "angle", -0.600891, 1e-3, 0.0),
    ("root M1 at t = 1 s, N m", "M1", 45.8714, 4e-2, 0.0),
    ("root M2 at t = 1 s, N m", "M2", 20.2936, 5e-2, 0.0),
)


def build(elements: int) -> ff.Model:
    """Bars of ``elements`` elements each, the first driven at -0.6 rad/s."""
    share = np.linspace(0.0, 1.0, elements + 1)[:, np.newaxis]
    points = np.concatenate([CORNERS[k] + share * (CORNERS[k + 1] - CORNERS[k]) for k in range(3)])
    count = np.arange(elements)
    first = np.concatenate([count + k * (elements + 1) for k in range(3)])
    names = ("bar_1", "bar_2", "bar_3")
    groups = {name: k * elements + count for k, name in enumerate(names)}
    mesh = ff.LineMesh(points, np.stack([first, first + 1], axis=1), groups)
    model, z = ff.Model("four_bars", mesh=mesh), (0.0, 0.0, 1.0)
    tilt = (math.sin(math.radians(5.0)), 0.0, math.cos(math.radians(5.0)))
    for name in names:
        stiffness, inertia = (SOFT, LIGHT) if name == "bar_3" else (STIFF, HEAVY)
        model.add(ff.Beam(name, ff.Section.general(stiffness=stiffness, inertia=inertia),
                          orientation=ACROSS[name]))  # fmt: skip
    root, last = ff.Marker("bar_1", "start"), ff.Marker("bar_3", "end")
    model.add(
        ff.Revolute("A", ff.Ground(), root, axis=z),
        ff.PrescribedAngle("motor", ff.Ground(), root, axis=z, angle=lambda t: -0.6 * t),
        ff.Revolute("B", ff.Marker("bar_1", "end"), ff.Marker("bar_2", "start"), axis=z),
        ff.Revolute("C", ff.Marker("bar_2", "end"), ff.Marker("bar_3", "start"), axis=tilt),
        ff.Revolute("D", ff.Ground(CORNERS[3]), last, axis=z),
        ff.PositionProbe("corner", ff.Marker("bar_2", "end")),
        ff.Probe("at_D", last, ("angle",),
                 lambda t, s: [math.atan2(s.rotation[1, 0], s.rotation[0, 0])]),
        ff.StrainProbe("root", "bar_1", 0.0),
        ff.StrainProbe("next", "bar_1", 1.5 / elements),
    )  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """Corner, last angle and moments at the root after one second."""
    elements, h = (16, 1e-3) if full else (4, 8e-3)
    history = dict(run(build(elements), h, 1.0))
    for k in (1, 2):
        # from the midpoints of the first two elements to the root
        history[f"M{k}"] = 1.5 * history[f"root_m{k}"] - 0.5 * history[f"next_m{k}"]
    mesh = f"3 x {elements} elements, h = {h:g} s"
    return [
        # the moments come from the misalignment alone; the shape moves by its square
        Result("four bars, misaligned", what, value, SOURCE, float(history[column][-1]), mesh,
               tolerance, scale)
        for what, column, value, tolerance, scale in REFERENCE
    ]  # fmt: skip
