# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 3: statics, and a column that buckles.

A column of 1 m (steel strip 20 x 2 mm, E = 2.1e11 N/m^2, nu = 0.3) is clamped at its foot and
pushed down at its head. The load factor t counts in units of Euler's load ``pi^2 E I / (4 L^2)``.
A side force of ``--imperfection`` times Euler's load at the head bends it a little from the start.

History: ``down`` and ``aside`` (m), the displacement of the head; ``tilt`` (rad), its rotation.

Expected: the elastica. With a small imperfection the column is almost straight up to t = 1, then
it gives way; at t = 1.152 (tilt 60 degrees) the head is 0.593 m aside and 0.259 m below its start
(Timoshenko, Gere, Theory of Elastic Stability, 1961, table 2-4). By default only stable equilibria
are searched; the straight column is unstable beyond t = 1. Without imperfection, with
``--imperfection 0 --no-stabilise --arc-length 0.05 --critical-points --branch 0.05``, the path
leaves the straight column at the bifurcation, t = 1.0005. ``--buckling-modes 1`` finds this load
from the linearised equations.
Run: ``python cases/tutorial_3_column.py``, then
``flexfem plot results/tutorial_3_column --columns t --x aside``.
"""

import math
import sys
from functools import partial

import flexfem as ff


def build(
    *, elements: int, length: float, width: float, thickness: float, youngs_modulus: float,
    poisson_ratio: float, density: float, imperfection: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` elements and a side force of this part of Euler's load."""
    mesh = ff.LineMesh.straight({"column": [(0.0, 0.0, 0.0), (0.0, 0.0, length)]}, elements)
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    bending = youngs_modulus * width * thickness**3 / 12.0
    euler = math.pi**2 * bending / (4.0 * length**2)

    foot, head = ff.Marker("column", "start"), ff.Marker("column", "end")
    model = ff.Model("tutorial_3_column", mesh=mesh)
    model.add(
        # width along e2, thickness along e3: it bends about Y
        ff.Beam("column", ff.Section.rectangle(width, thickness, steel), orientation=(0, 1, 0)),
        ff.Rigid("clamp", ff.Ground(), foot),
        ff.PrescribedDisplacement("guide", ff.Ground(), head, axis=(0.0, 1.0, 0.0)),
        # loads without an amplitude grow in proportion to the load factor
        ff.PointForce("push", head, (0.0, 0.0, -euler)),
    )
    if imperfection > 0.0:
        model.add(
            ff.PointForce("nudge", head, (imperfection * euler, 0.0, 0.0), amplitude=lambda t: 1.0)
        )
    model.add(ff.Probe("head", head, ("down", "aside", "tilt"), partial(_way, length)))
    return model


def _way(length: float, t: float, head: ff.MarkerState) -> tuple[float, float, float]:
    """Displacement of the head and the angle of its tangent from the vertical."""
    x, _, z = head.position
    tangent = head.rotation[:, 2]  # markers have the inertial axes at the start
    return length - z, x, math.atan2(tangent[0], tangent[2])


CASE = ff.Case(
    name="tutorial_3_column",
    summary="tutorial 3: a column that buckles, by load steps or along the path",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 20, "beam elements of the column", minimum=2),
        ff.Option("length", float, 1.0, "of the column", unit="m", above=0.0),
        ff.Option("width", float, 0.02, "of its section", unit="m", above=0.0),
        ff.Option("thickness", float, 0.002, "of its section", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the column", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the column", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the column", unit="kg/m^3", above=0.0),
        ff.Option(
            "imperfection", float, 1e-3, "side force, part of Euler's load", minimum=0, maximum=1
        ),
    ),
    analysis=ff.STATICS,
    t_end=1.5,
    load_steps=30,
    stabilise=True,
    smoke={"elements": 2, "load_steps": 3},
    results=lambda history: {"largest_tilt": float(abs(history["tilt"]).max())},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
