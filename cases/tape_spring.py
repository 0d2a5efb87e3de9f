# SPDX-License-Identifier: LGPL-3.0-or-later
"""A carpenter's tape is folded until its layers touch, and snaps open when it is let go.

A strip of copper-beryllium (E = 131e9 N/m^2, nu = 0.3, rho = 8300 kg/m^3) of 0.2 m, 0.1 mm thick,
with the section of a circle of 15 mm radius over 110 degrees. Each end is clamped to a light cap on
a hinge; one of them slides along X. Both caps are turned against one another, against the curvature
of the section (``--angle`` negative) or along it, within ``--fold``: the tape is stiff at first, as
a beam of its curved section, until the section flattens and snaps. From there on a fold with the
radius of the section bends with a moment that hardly changes. Beyond half a turn the straight
parts on both sides of the fold meet and press on one another. At ``--release`` the caps are let go.

``--mesh`` counts cells along and across the tape, whose contact with itself is that of both sides
of the shell. No gravity.

History: ``angle`` (rad) between both caps; ``turn_fx, turn_fy, turn_fz, turn_mx, turn_my, turn_mz``
(N, N m), the wrench of the drive on the left cap, of which ``turn_my`` is the moment;
``contact_gap`` (m), the least distance of surfaces that are near each other, and
``contact_penetration`` (m), how far they overlap: not at all; ``contact_fx, contact_fy,
contact_fz`` (N), that of the tape on itself, zero; ``contact_normal`` (N), the sum of the sizes of
all normal forces, and ``contact_closed``, the number of pairs that push; ``energy_kinetic,
energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance`` (J).

Expected: folded between a quarter and half a turn, the moment of a fold against the curvature is
(1 + nu) D alpha, of one along it (1 - nu) D alpha, with the angle alpha of the section and the
plate stiffness D (W. Wuest, Z. angew. Math. Mech. 34, 1954, 444; K. A. Seffen, S. Pellegrino, Proc.
R. Soc. A 455, 1999, 1003); the results compare ``fold_moment`` and ``fold_moment_of_plate`` (N m).
After the release the caps come back to the angle zero.
Run: ``mpirun -n 2 python cases/tape_spring.py``, then ``flexfem view results/tape_spring``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
Points = npt.NDArray[np.float64]


def tape(cells: tuple[int, int], length: float, radius: float, section: float) -> ff.SurfaceMesh:
    """Mesh of a tape along X; the centre of its section (its angle in rad) is the origin."""
    centre = 2.0 * radius * math.sin(0.5 * section) / section

    def place(parameters: Points) -> Points:
        x, a = parameters.T
        return np.column_stack([x, radius * np.sin(a), centre - radius * np.cos(a)])

    along, across = (
        np.linspace(-0.5, 0.5, count + 1) * size
        for count, size in zip(cells, (length, section), strict=True)
    )
    return ff.SurfaceMesh.grid("tape", along, across, place)


def caps_angle(t: float, left: ff.MarkerState, right: ff.MarkerState) -> list[float]:
    """Angle about Y by which the left cap has turned from the right one, rad, in (-pi, pi].

    Beyond half a turn it goes on: each cap is measured by itself.
    """

    def own(state: ff.MarkerState) -> float:
        turned = state.rotation @ state.start.T
        return math.atan2(turned[0, 2], turned[0, 0])

    return [own(left) - own(right)]


def build(
    *, mesh: str, element: str, length: float, radius: float, section: float, thickness: float,
    youngs_modulus: float, poisson_ratio: float, density: float, damping: float, cap_mass: float,
    cap_inertia: float, angle: float, fold: float, release: float, friction: float,
    restitution: float, reach: float,
) -> ff.Model:  # fmt: skip
    """Model of the tape with so many cells along and across."""
    if release < fold:
        raise ValueError(f"release must not be before the end of the fold, {fold:g} s, "
                         f"got {release:g}")  # fmt: skip
    surface = tape(ff.grid_nodes(mesh), length, radius, math.radians(section))
    model = ff.Model("tape_spring", surface=surface)
    copper = ff.Material(youngs_modulus, poisson_ratio, density)
    model.add(
        ff.Shell("tape", ff.ShellSection.isotropic(thickness, copper), element=element,
                 damping=damping),
        ff.Contact("folds", "tape", "tape", friction=friction, restitution=restitution,
                   reach=reach * thickness),
        ff.ContactProbe("contact", "folds"),
    )  # fmt: skip
    turned = ff.SmoothStep(0.0, fold, 0.0, 0.5 * math.radians(angle))
    width = 2.0 * radius * math.sin(0.5 * math.radians(section))
    box = ff.Box((0.1 * width, 1.1 * width, 0.3 * width))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        place, cap = (-0.5 * sign * length, 0.0, 0.0), ff.Marker(side)
        model.add(
            ff.RigidBody(side, cap_mass, (cap_inertia,) * 3, position=place, shape=box),
            ff.ClampedLine(f"{side}_clamp", ff.ShellLine("tape", f"tape_{side}"), cap),
            ff.PrescribedAngle(f"{side}_drive", ff.Ground(place), cap, axis=Y,
                               angle=lambda t, s=sign: s * turned(t)),
        )  # fmt: skip
    left, right = ff.Marker("left"), ff.Marker("right")
    model.add(
        ff.Revolute("left_hinge", ff.Ground((-0.5 * length, 0.0, 0.0)), left, axis=Y),
        ff.Planar("right_hinge", ff.Ground(), right, axis=Y),
        ff.PointOnPlane("slide", ff.Ground(), right, axis=Z),
        ff.Event("let_go", (), lambda t: t - release,
                 [ff.ReleaseJoint("left_drive"), ff.ReleaseJoint("right_drive")]),
        ff.Probe("caps", (left, right), ("angle",), caps_angle),
        ff.ReactionProbe("turn", "left_drive"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(
    history: Mapping[str, Points], *, thickness: float, youngs_modulus: float,
    poisson_ratio: float, section: float, angle: float,
) -> dict[str, float]:  # fmt: skip
    """Largest moment, that of the fold between 100 and 170 degrees, least gap, last angle."""
    moment = np.copysign(1.0, angle) * history["turn_my"]
    plate = youngs_modulus * thickness**3 / (12.0 * (1.0 - poisson_ratio**2))
    found = {
        "largest_moment": float(moment.max()),
        "fold_moment_of_plate": plate * math.radians(section)
        * (1.0 - math.copysign(poisson_ratio, angle)),
        "least_gap": float(history["contact_gap"].min()),
        "last_angle": float(history["angle"][-1]),
    }  # fmt: skip
    folded = np.abs(np.degrees(history["angle"]))
    between = (folded > 100.0) & (folded < 170.0) & (moment != 0.0)
    if between.any():
        found["fold_moment"] = float(moment[between].mean())
    return found


CASE = ff.Case(
    name="tape_spring",
    summary="a carpenter's tape that folds onto itself and snaps open (Seffen, Pellegrino 1999)",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "24x4", "cells along and across the tape"),
        ff.Option("element", str, "director", "kind of shell", choices=ff.SHELL_ELEMENTS),
        ff.Option("length", float, 0.2, "of the tape", unit="m", above=0.0),
        ff.Option("radius", float, 0.015, "of its section", unit="m", above=0.0),
        ff.Option("section", float, 110.0, "angle of its section", unit="deg", above=0.0,
                  maximum=180.0),
        ff.Option("thickness", float, 1e-4, "of the tape", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 131e9, "of the tape", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the tape", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 8300.0, "of the tape", unit="kg/m^3", above=0.0),
        ff.Option("damping", float, 3e-3, "of the tape, stiffness-proportional", unit="s",
                  minimum=0.0),
        ff.Option("cap_mass", float, 0.01, "of each cap", unit="kg", above=0.0),
        ff.Option("cap_inertia", float, 1e-6, "of each cap", unit="kg m^2", above=0.0),
        ff.Option("angle", float, -200.0, "between the caps when folded; negative against the "
                  "curvature", unit="deg", minimum=-340.0, maximum=340.0),
        ff.Option("fold", float, 1.0, "time in which the caps are turned", unit="s", above=0.0),
        ff.Option("release", float, 1.1, "time at which they are let go", unit="s", above=0.0),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option("restitution", float, 1.0, "speed after over speed before impacts", minimum=0.0,
                  maximum=1.0),
        ff.Option("reach", float, 0.5, "gap below which surfaces repel each other, in thicknesses",
                  above=0.0),
    ),
    dt=4e-3,
    t_end=1.5,
    rho_inf=0.3,
    smoke={"mesh": "4x2", "angle": -1.0, "t_end": 8e-3},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
