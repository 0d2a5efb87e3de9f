# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 5: a shell that falls on an obstacle.

A rubber sheet of 0.4 x 0.2 m (thickness 2 mm, E = 5e6 N/m^2, nu = 0.45, rho = 1100 kg/m^3) is
clamped along one short edge and falls from the horizontal on a rigid cylinder of 40 mm radius.

History: ``corner_x``, ``corner_y``, ``corner_z`` (m) of a free corner; ``touch_penetration`` (m),
``touch_fx``, ``touch_fy``, ``touch_fz`` (N), the force of the cylinder on the sheet, and
``touch_normal`` (N), the sum of all normal forces, ``touch_closed``, how many points touch.

Expected: the sheet meets the cylinder after 0.1 s, folds over it, and swings there. Nodes sink in
by less than a tenth of the thickness.
Run: ``python cases/tutorial_5_sheet.py``, then
``flexfem render results/tutorial_5_sheet``.
"""

import sys

import flexfem as ff


def build(*, mesh: str, element: str, friction: float) -> ff.Model:
    """Model with so many nodes along and across the sheet."""
    along, across = ff.grid_nodes(mesh)
    surface = ff.SurfaceMesh.rectangle("sheet", (0.4, 0.2), (along - 1, across - 1))
    rubber = ff.Material(youngs_modulus=5e6, poisson_ratio=0.45, density=1100.0)

    model = ff.Model("tutorial_5_sheet", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell(
            "sheet", ff.ShellSection.isotropic(0.002, rubber), element=element, damping=2e-3,
            edges={"sheet_left": "clamped"},
        ),
    )  # fmt: skip

    # a cylinder around the z axis of its place, which is turned to lie along Y
    lying = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    place = ff.Ground((0.2, 0.1, -0.08), lying)
    roller = ff.RigidCylinder(place, radius=0.04)
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
        ff.Option("friction", float, 0.3, "between sheet and cylinder", minimum=0.0),
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
