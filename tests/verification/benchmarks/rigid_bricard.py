# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bricard's mechanism of the IFToMM library: six revolutes, one freedom, one redundant constraint.

The mechanism moves only because its axes are special. One of the revolutes is a cylindrical joint
here, which leaves out the redundant constraint.
"""

import flexfem as ff
from tests.verification.motions import box_inertia, compare, run
from tests.verification.result import Result

SOURCE = "Exudyn, refined"
REFERENCE = {
    1.0: (0.27448, -0.88671, -0.46233),
    2.0: (-0.77814, -0.98035, -0.19725),
    5.0: (0.99993, -1.0, -0.00007),
}
CORNERS = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
AXES = ((0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))


def build() -> ff.Model:
    """Five rods along the edges of a cube, from the first corner to the last."""
    model = ff.Model("bricard")
    model.add(ff.Gravity((0.0, -9.81, 0.0)), ff.EnergyProbe())
    for k in range(5):
        a, b = CORNERS[k], CORNERS[k + 1]
        sizes = [1.0 if a[i] != b[i] else 0.1 for i in range(3)]
        middle = [0.5 * (a[i] + b[i]) for i in range(3)]
        model.add(
            ff.RigidBody(
                f"rod_{k}", 1.0, box_inertia(1.0, *sizes), position=middle, shape=ff.Box(sizes)
            )
        )
    for k in range(6):
        corner, sides = CORNERS[k], []
        for rod in (k - 1, k):
            if rod in (-1, 5):
                sides.append(ff.Ground(corner))
            else:
                ends = CORNERS[rod], CORNERS[rod + 1]
                offset = [corner[i] - 0.5 * (ends[0][i] + ends[1][i]) for i in range(3)]
                sides.append(ff.Marker(f"rod_{rod}", offset=offset))
        kind = ff.Cylindrical if k == 5 else ff.Revolute
        model.add(kind(f"corner_{k + 1}", *sides, axis=AXES[k]))
    model.add(ff.PositionProbe("corner", ff.Marker("rod_1", offset=(0.0, -0.5, 0.0))))
    return model


def results(full: bool = True) -> list[Result]:
    """Place of the third corner."""
    h = 1e-3 if full else 5e-3
    rows = {t: x for t, x in REFERENCE.items() if full or t <= 1.0}
    history = run(build(), h, max(rows))
    columns = ("corner_x", "corner_y", "corner_z")
    # of second order; the reference has five digits
    tolerance = 2e-4
    return compare(
        "Bricard's mechanism", SOURCE, f"h = {h:g} s", history, columns, rows, tolerance, 1.0
    )
