# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 6: a solid body in a mechanism.

An arm of tetrahedra, 0.6 m from eye to eye with a shank of 30 x 15 mm (aluminium, E = 7e10 N/m^2,
nu = 0.33, rho = 2700 kg/m^3), is reduced to the motions of its eyes and some modes. It rotates on a
pin in the big eye, driven to 90 degrees within ``--duration`` seconds, and carries 1 kg in the
small one.

History: ``tip_x``, ``tip_y``, ``tip_z`` (m) of the small eye; ``lag`` (rad), the angle by which it
is behind the drive; ``torque_fx``, ``torque_fy``, ``torque_fz`` (N), ``torque_mx``, ``torque_my``,
``torque_mz`` (N m), exerted by the motor on the arm.

Expected: the arm bends back while it is sped up, forward while it is slowed down, and vibrates in
its first mode at the end.
Run: ``python cases/tutorial_6_solid_arm.py``, then
``flexfem render results/tutorial_6_solid_arm --colour von_mises``.
"""

import math
import sys
from pathlib import Path

import flexfem as ff

Z = (0.0, 0.0, 1.0)


def build(
    *, size: float, internal_modes: int, length: float, width: float, youngs_modulus: float,
    poisson_ratio: float, density: float, mass: float, angle: float, duration: float, reduced: str,
) -> ff.Model:  # fmt: skip
    """Model of a mesh with edges of this size, rotated within so many seconds."""
    aluminium = ff.Material(youngs_modulus, poisson_ratio, density)
    arm = _arm(aluminium, length, width, size, internal_modes, reduced)
    big, small = ff.Marker("arm", "big_end"), ff.Marker("arm", "small_end")
    drive = ff.SmoothStep(0.0, duration, 0.0, math.radians(angle))

    model = ff.Model("tutorial_6_solid_arm")
    model.add(
        ff.FloatingBody("arm", arm),
        ff.PointMass("load", mass, small),
        ff.Revolute("pin", ff.Ground(), big, axis=Z),
        ff.PrescribedAngle("motor", ff.Ground(), big, axis=Z, angle=drive),
        ff.PositionProbe("tip", small),
        ff.Probe(
            "bending",
            small,
            ("lag",),
            lambda t, tip: (drive(t) - math.atan2(tip.position[1], tip.position[0]),),
        ),
        ff.ReactionProbe("torque", "motor"),
    )
    return model


def _arm(
    aluminium: ff.Material, length: float, width: float, size: float, modes: int, file: str
) -> ff.ReducedBody:
    """The arm's mesh, its elasticity, and its reduction to two interfaces and some modes."""
    made_with = {
        "length": length, "width": width, "size": size, "internal_modes": modes,
        "youngs_modulus": aluminium.youngs_modulus, "density": aluminium.density,
        "poisson_ratio": aluminium.poisson_ratio,
    }  # fmt: skip
    if file and Path(file).exists():
        return ff.load_reduced_body(file, made_with=made_with)
    if file and not Path(file).absolute().parent.is_dir():
        raise ValueError(f"--reduced {file}: there is no such folder")
    mesh = ff.build_body_mesh("connecting_rod", length=length, width=width, size=size)
    eyes = {"big_end": (0.0, 0.0, 0.0), "small_end": (length, 0.0, 0.0)}
    body = ff.reduce_body(
        ff.solid_body(mesh.mesh, aluminium, name="arm"),
        {name: mesh.facets(name) for name in eyes},
        modes=modes,
        positions=eyes,
    )
    if file:
        ff.save_reduced_body(file, body, made_with=made_with)
    return body


CASE = ff.Case(
    name="tutorial_6_solid_arm",
    summary="tutorial 6: an arm of tetrahedra, reduced to a body in a floating frame",
    description=__doc__,
    build=build,
    options=(
        ff.Option("size", float, 0.012, "edges of the tetrahedra", unit="m", above=0.0),
        ff.Option("internal_modes", int, 6, "modes besides the motions of the eyes", minimum=0),
        ff.Option("length", float, 0.6, "from eye to eye", unit="m", above=0.0),
        ff.Option("width", float, 0.015, "of the shank, in the plane", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 7e10, "of the arm", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.33, "of the arm", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 2700.0, "of the arm", unit="kg/m^3", above=0.0),
        ff.Option("mass", float, 1.0, "of the load", unit="kg", above=0.0),
        ff.Option("angle", float, 90.0, "of the turn", unit="deg"),
        ff.Option("duration", float, 0.5, "duration of the turn", unit="s", above=0.0),
        ff.Option("reduced", str, "", "file of the reduced arm: read if there, else written"),
    ),
    dt=1e-3,
    t_end=0.8,
    smoke={"size": 0.03, "internal_modes": 1, "t_end": 3e-3},
    results=lambda history: {
        "largest_lag": float(abs(history["lag"]).max()),
        "largest_torque": float(abs(history["torque_mz"]).max()),
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
