# SPDX-License-Identifier: LGPL-3.0-or-later
"""Three half rings of shell on driven hinges: angles of the drive, and the same with beams.

The model is that of ``cases/circular_strips.py``. Rigid strips would be where the drive says; these
bend and twist by their inertia, and beams are the reference for where they are.
"""

from collections.abc import Mapping
from math import pi, sin

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.motions import run
from tests.verification.result import Result

CASE = load_case("circular_strips")
RADIUS, DURATION = 0.5, 10.0
ENDS = {"strip_1": -RADIUS, "strip_2": RADIUS}


def turned(t: float, before: ff.MarkerState, after: ff.MarkerState) -> tuple[float]:
    """Angle (rad) about the hinge axis, X, by which one side has rotated against the other."""
    relative = before.rotation.T @ after.rotation
    return (float(np.arctan2(relative[2, 1], relative[1, 1])),)


def motion(element: str, mesh: str, dt: float, t_end: float) -> Mapping[str, np.ndarray]:
    """History with the angles of both hinges."""
    model = CASE.build(**CASE.prepare({"mesh": mesh, "element": element})[0])
    for i, (name, x) in enumerate(ENDS.items(), 1):
        if element != "beam":
            sides = [ff.Marker(strip, (x, 0.0, 0.0)) for strip in (name, f"strip_{i + 1}")]
            model.add(ff.Probe(f"turn_{i}", sides, (f"angle_of_{i}",), turned))
    return run(model, dt, t_end, tolerance=1e-8)


def results(full: bool = True) -> list[Result]:
    """Angles and the place of the free end."""
    t, dt = 2.0, 0.01 if full else 0.1
    share = t / DURATION
    angle = pi * (share - sin(2.0 * pi * share) / (2.0 * pi))
    beams = motion("beam", "41x2" if full else "21x2", dt, t)
    lines = []
    for element, mesh in (
        ("rotation_free", "61x5" if full else "21x3"),
        ("director", "33x3" if full else "17x3"),
    ):
        shells = motion(element, mesh, dt, t)
        case = f"circular strips, {element}"
        words = f"{mesh.replace('x', ' x ')} nodes, h = {dt:g} s"
        for i in (1, 2):
            # the drive prescribes the angle between the triangles at the hinge, markers rotate with
            # all triangles around them, which bend; without the drive the angle stays zero
            lines.append(
                Result(case, f"angle of hinge {i} at t = {t:g} s, rad", angle, "drive, closed form",
                       float(shells[f"angle_of_{i}"][-1]), words, 1e-2 if full else 3e-2)
            )  # fmt: skip
        # plates that cannot bend across are stiffer than beams, by up to 10 %; without the twist of
        # bent curved strips the height is off by a third
        height, error = abs(float(beams["A_z"][-1])), 2e-2 if full else 4e-2
        lines.append(
            Result(case, f"A_z at t = {t:g} s, m", float(beams["A_z"][-1]), "NURBS beams",
                   float(shells["A_z"][-1]), words, error, height)
        )  # fmt: skip
    return lines
