# SPDX-License-Identifier: LGPL-3.0-or-later
"""A flexible sheet lands on the ground, flat or tilted, and rebounds.

The sheet, 0.3 x 0.3 m and ``--thickness`` 1 mm of rubber (E = 5e6 N/m^2, nu = 0.45,
rho = 1100 kg/m^3), falls at ``--speed`` with its lowest point ``--height`` above the plane z = 0,
its middle above the origin, rotated about Y by ``--tilt``. Flat, all its nodes meet the ground at
the same time, which is the hardest landing for a scheme in time: a penalty that is a little too
stiff for the step throws the sheet up with several times its energy. Tilted, an edge lands first,
and the rest slaps down after it. The ground is frictionless and gives back what it takes;
``--friction`` and ``--restitution`` change that. ``--mesh`` counts nodes along the sides.

History: ``gap`` (m), the least distance of the sheet's lower side from the ground; force on the
sheet ``contact_fx, contact_fy, force`` (N), the last one upwards; ``contact_penetration`` (m),
``contact_normal`` (N) and ``contact_closed``, the number of points within reach; momenta and centre
of mass ``momentum_px, momentum_py, momentum_pz, momentum_lx, momentum_ly, momentum_lz, momentum_cx,
momentum_cy, momentum_cz`` (kg m/s, kg m^2/s, m);
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J), the strain energy with that of the contact.

Expected: the gap is never negative, whatever the step; without friction the energy never exceeds
that of the start (``energy_made`` is at most 1e-6 of the energy of motion), and a flat sheet leaves
at the speed at which it came (``rebound``, the largest momentum upwards over that downwards, is 1).
Run: ``python cases/sheet_landing.py --tilt 10``, then ``flexfem render results/sheet_landing``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Points = npt.NDArray[np.float64]


def sheet(nodes: tuple[int, int], sides: tuple[float, float], tilt: float, height: float,
          thickness: float) -> ff.SurfaceMesh:  # fmt: skip
    """Plane grid rotated about Y by ``tilt`` (rad), its lower side ``height`` above z = 0."""
    along, across = (
        np.linspace(-0.5 * side, 0.5 * side, count)
        for side, count in zip(sides, nodes, strict=True)
    )
    middle = height + 0.5 * (thickness + sides[0] * abs(math.sin(tilt)))

    def surface(parameters: Points) -> Points:
        x, y = parameters.T
        return np.column_stack([x * math.cos(tilt), y, middle - x * math.sin(tilt)])

    return ff.SurfaceMesh.grid("sheet", along, across, surface, diagonal="right_left")


def build(
    *, mesh: str, element: str, length: float, width: float, thickness: float,
    youngs_modulus: float, poisson_ratio: float, density: float, speed: float, tilt: float,
    height: float, gravity: float, friction: float, restitution: float, reach: float,
) -> ff.Model:  # fmt: skip
    """Model of sheet and ground."""
    surface = sheet(ff.grid_nodes(mesh), (length, width), math.radians(tilt), height, thickness)
    material = ff.Material(youngs_modulus, poisson_ratio, density)
    model = ff.Model("sheet_landing", surface=surface)
    model.add(
        ff.Shell(
            "sheet", ff.ShellSection.isotropic(thickness, material), element=element,
            velocity=(0.0, 0.0, -speed),
        ),
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Contact(
            "ground", "sheet", surfaces=ff.RigidPlane(ff.Ground()), friction=friction,
            restitution=restitution, reach=reach * thickness,
        ),
        ff.ContactProbe("contact", "ground", names={"gap": "gap", "fz": "force"}),
        ff.MomentumProbe("momentum"),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(history: Mapping[str, Points]) -> dict[str, float]:
    """Least gap, spurious energy over that of motion, largest force, and rebound."""
    energy = sum(history[f"energy_{kind}"] for kind in ("kinetic", "strain", "gravity"))
    motion = history["energy_kinetic"][0] or history["energy_kinetic"].max()
    momentum = history["momentum_pz"]
    return {
        "least_gap": float(history["gap"].min()),
        "energy_made": float((energy - energy[0]).max() / motion),
        "largest_force": float(history["force"].max()),
        "rebound": float(momentum.max() / -momentum.min()),
    }


CASE = ff.Case(
    name="sheet_landing",
    summary="a flexible sheet lands flat or tilted on the ground: contact without spurious energy",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "13x13", "nodes along length and width"),
        ff.Option("element", str, "rotation_free", "formulation", choices=ff.SHELL_ELEMENTS),
        ff.Option("length", float, 0.3, "of the sheet, along X", unit="m", above=0.0),
        ff.Option("width", float, 0.3, "of the sheet, along Y", unit="m", above=0.0),
        ff.Option("thickness", float, 1e-3, "of the sheet", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 5e6, "of the sheet", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.45, "of the sheet", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1100.0, "of the sheet", unit="kg/m^3", above=0.0),
        ff.Option("speed", float, 0.63, "downwards at the start", unit="m/s", minimum=0.0),
        ff.Option(
            "tilt",
            float,
            0.0,
            "about Y: the side at +X is lower",
            unit="deg",
            minimum=-90.0,
            maximum=90.0,
        ),
        ff.Option("height", float, 2e-3, "of the lowest point at the start", unit="m", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2", minimum=0.0),
        ff.Option("friction", float, 0.0, "Coulomb's coefficient", minimum=0.0),
        ff.Option(
            "restitution", float, 1.0, "speed after over speed before", minimum=0.0, maximum=1.0
        ),
        ff.Option(
            "reach", float, 0.05, "gap below which the ground repels, in thicknesses", above=0.0
        ),
    ),
    dt=1e-3,
    t_end=0.1,
    tolerance=1e-9,
    every=2,
    smoke={"mesh": "3x3", "height": 2e-4, "t_end": 3e-3},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
