# SPDX-License-Identifier: LGPL-3.0-or-later
"""Double pendulum of two half cylinders, thin shells that swing and flutter under gravity.

Both segments are half cylinders of radius 0.3 m and length 1.2 m, 0.01 m thick, E = 1e9 N/m^2,
nu = 0.3, rho = 7810 kg/m^3. They lie one after the other along Y, open upwards, gravity 9.81 m/s^2
along -Z. The two corners of the first end are pinned to the ground, those of the common end are
pinned to one another: both pairs are hinges with axes along X. ``--mesh`` counts nodes along the
arc and along the axis of one segment.

History: ``hinge_x, hinge_y, hinge_z``, corner at x > 0 of the common end, ``tip_x, tip_y, tip_z``,
that of the free end, ``bottom_z``, middle of the arc there, m; ``energy_kinetic, energy_strain,
energy_gravity, energy_work, energy_dissipation, energy_balance`` and the strain energy by kind,
``shell_membrane, shell_bending, shell_shear``, J.

Expected (data after Liu, Tian, Hu 2012; the supports are our choice): within 1 s the energy balance
stays below 1e-4 of the largest kinetic energy; meshes 23x15, 31x21 and 61x41 agree to 2e-3 m at the
tip. One factorisation serves the whole motion. Run:
``python cases/cylindrical_pendulum.py --mesh 31x21``. Figures of its results:
``flexfem plot results/cylindrical_pendulum --columns tip_y,tip_z`` or
``shell_bending,shell_membrane``; ``flexfem render results/cylindrical_pendulum --colour
bending_energy --range 0,10 --time 0.25,0.5,0.75,1``.
The paper's table of meshes, unknowns and times, in ``sweep.csv``:
``flexfem sweep cylindrical_pendulum --vary mesh=23x15,25x17,31x21 --jobs 1 --every 1000000``, with
unknowns of both segments, 2070, 2550, 3906 (the paper counts one).
"""

import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

SIDES = ("left", "right")
Points = npt.NDArray[np.float64]


def segment(
    name: str, nodes: tuple[int, int], start: float, radius: float, length: float
) -> ff.SurfaceMesh:
    """Half cylinder along Y from ``start`` (m), its arc from x = R over the bottom to x = -R."""

    def surface(parameters: Points) -> Points:
        angle, y = parameters.T
        return np.column_stack([radius * np.cos(angle), start + y, -radius * np.sin(angle)])

    arc, axis = np.linspace(0.0, np.pi, nodes[0]), np.linspace(0.0, length, nodes[1])
    return ff.SurfaceMesh.grid(name, arc, axis, surface)


def segments(mesh: str, size: float, radius: float, length: float) -> ff.SurfaceMesh:
    """Both segments, of a grid or of triangles of a size (m)."""
    if size > 0.0:
        return ff.build_surface_mesh(
            "cylindrical_pendulum", radius=radius, length=length, size=size
        )
    nodes = ff.grid_nodes(mesh)
    parts = [("first", 0.0), ("second", length)]
    return ff.SurfaceMesh.join([segment(name, nodes, y, radius, length) for name, y in parts])


def build(
    *, mesh: str, size: float, element: str, radius: float, length: float, thickness: float,
    youngs_modulus: float, poisson_ratio: float, density: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model with a number of nodes such as "31x21" on each segment, or with triangles of a size."""
    surface = segments(mesh, size, radius, length)
    material = ff.Material(youngs_modulus, poisson_ratio, density)
    section = ff.ShellSection.isotropic(thickness, material)
    model = ff.Model("cylindrical_pendulum", surface=surface)
    model.add(ff.Gravity((0.0, 0.0, -gravity)))
    for name in ("first", "second"):
        model.add(ff.Shell(name, section, element=element))
    for side in SIDES:
        corner = surface.points[surface.nodes[f"first_bottom_{side}"]]
        ends = ff.Marker("first", f"first_top_{side}"), ff.Marker("second", f"second_bottom_{side}")
        model.add(
            ff.Spherical(
                f"pin_{side}", ff.Ground(corner), ff.Marker("first", f"first_bottom_{side}")
            ),
            ff.Spherical(f"hinge_{side}", *ends),
        )
    free = (0.0, 2.0 * length, -radius)
    model.add(
        ff.PositionProbe("hinge", ff.Marker("first", "first_top_left")),
        ff.PositionProbe("tip", ff.Marker("second", "second_top_left")),
        ff.Probe("bottom", ff.Marker("second", free), ("bottom_z",), lambda t, s: s.position[2:]),
        ff.EnergyProbe(),
        ff.ShellEnergyProbe(),
    )
    return model


def results(history: Mapping[str, Points]) -> dict[str, float]:
    """Position of the tip at the end, and the energy balance."""
    ends = {name: history[name][-1] for name in ("tip_x", "tip_y", "tip_z")}
    largest = history["energy_kinetic"].max()
    balance = float(np.abs(history["energy_balance"]).max() / largest) if largest > 0.0 else 0.0
    return {**ends, "relative_energy_balance": balance}


CASE = ff.Case(
    name="cylindrical_pendulum",
    summary="two half cylinders hinged at corners: thin shells in large motion",
    description=__doc__,
    build=build,
    options=(
        ff.GridOption("mesh", "31x21", "nodes along the arc and the axis of a segment"),
        ff.Option(
            "size",
            float,
            0.0,
            "edges of unstructured triangles, 0: grid --mesh",
            unit="m",
            minimum=0,
        ),
        ff.Option("element", str, "rotation_free", "formulation", choices=ff.SHELL_ELEMENTS),
        ff.Option("radius", float, 0.3, "of the half cylinders", unit="m", above=0.0),
        ff.Option("length", float, 1.2, "of a segment", unit="m", above=0.0),
        ff.Option("thickness", float, 0.01, "of the shells", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1e9, "of the shells", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the shells", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7810.0, "of the shells", unit="kg/m^3", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2"),
    ),
    dt=1e-3,
    t_end=1.0,
    every=10,
    smoke={"mesh": "7x5", "t_end": 5e-3},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
