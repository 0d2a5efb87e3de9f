# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 5: a shell that falls on an obstacle.

A rubber sheet of 0.4 x 0.2 m (thickness 2 mm, E = 5e6 N/m^2, nu = 0.45, rho = 1100 kg/m^3) is
clamped along one short edge and falls from the horizontal on a rigid cylinder of 40 mm radius below
its middle, whose axis is twice the radius deep.

History: ``corner_x``, ``corner_y``, ``corner_z`` (m) of a free corner; ``touch_gap``,
``touch_penetration`` (m),
``touch_fx``, ``touch_fy``, ``touch_fz`` (N), the force of the cylinder on the sheet, and
``touch_normal`` (N), the sum of all normal forces, ``touch_closed``, the number of touching points.

Expected: the sheet meets the cylinder after 0.1 s, folds over it, and swings there. Nodes penetrate
by less than a tenth of the thickness.
Run: ``python cases/tutorial_5_sheet.py``, then
``flexfem render results/tutorial_5_sheet``.
"""

import sys

import flexfem as ff


def build(
    *, mesh: str, element: str, length: float, width: float, thickness: float,
    youngs_modulus: float, poisson_ratio: float, density: float, radius: float,
    sheet_damping: float, friction: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model with so many nodes along and across the sheet."""
    along, across = ff.grid_nodes(mesh)
    surface = ff.SurfaceMesh.rectangle("sheet", (length, width), (along - 1, across - 1))
    rubber = ff.Material(youngs_modulus, poisson_ratio, density)

    model = ff.Model("tutorial_5_sheet", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Shell(
            "sheet", ff.ShellSection.isotropic(thickness, rubber), element=element,
            damping=sheet_damping, edges={"sheet_left": "clamped"},
        ),
    )  # fmt: skip

    # a cylinder around the z axis of its place, which is rotated to lie along Y
    lying = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    place = ff.Ground((0.5 * length, 0.5 * width, -2.0 * radius), lying)
    roller = ff.RigidCylinder(place, radius=radius)
    model.add(
        ff.Contact("landing", "sheet", surfaces=roller, friction=friction),
        ff.ContactProbe("touch", "landing"),
        ff.PositionProbe("corner", ff.Marker("sheet", "sheet_bottom_right")),
    )
    return model


CASE = ff.Case(
    name="tutorial_5_sheet",
    summary="tutorial 5: a sheet that falls on a cylinder",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "17x9", "nodes along and across the sheet"),
        ff.Option("element", str, "rotation_free", "kind of shell", choices=ff.SHELL_ELEMENTS),
        ff.Option("length", float, 0.4, "of the sheet", unit="m", above=0.0),
        ff.Option("width", float, 0.2, "of the sheet", unit="m", above=0.0),
        ff.Option("thickness", float, 0.002, "of the sheet", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 5e6, "of the sheet", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.45, "of the sheet", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1100.0, "of the sheet", unit="kg/m^3", above=0.0),
        ff.Option("radius", float, 0.04, "of the cylinder", unit="m", above=0.0),
        ff.Option("sheet_damping", float, 2e-3, "stiffness-proportional", unit="s", minimum=0.0),
        ff.Option("friction", float, 0.3, "between sheet and cylinder", minimum=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2"),
    ),
    dt=1e-3,
    t_end=0.6,
    smoke={"mesh": "4x3", "t_end": 3e-3},
    results=lambda history: {
        "largest_penetration": float(history["touch_penetration"].max()),
        "last_force": float(history["touch_fz"][-1]),
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
