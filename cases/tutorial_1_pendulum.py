# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 1: a pendulum with a flexible rod.

A rubber rod of 1 m (diameter 20 mm, E = 5e7 N/m^2, nu = 0.49, rho = 1100 kg/m^3) hangs on a hinge,
carries a bob of 0.2 kg at its other end and falls from the horizontal.

History: ``path_x``, ``path_y``, ``path_z`` (m) of the bob; ``sag`` (m), the distance of the
rod's middle from the straight line between its ends; ``energy_kinetic``, ``energy_strain``,
``energy_gravity``, ``energy_work``, ``energy_dissipation`` and ``energy_balance`` (J), the last one
numerical dissipation (negative) or spurious energy (positive).

Expected: the rod bends by up to 0.106 m on its way, and the bob gets as low as -1.0006 m, since the
rod also stretches. The energies add up to 1e-4 J.
Run: ``python cases/tutorial_1_pendulum.py``, then
``flexfem render results/tutorial_1_pendulum``.
"""

import sys

import numpy as np

import flexfem as ff


def build(
    *, elements: int, length: float, diameter: float, youngs_modulus: float, poisson_ratio: float,
    density: float, mass: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` elements along the rod and a bob of this mass."""
    # a line of the mesh, and the material of the rod
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (length, 0.0, 0.0)]}, elements)
    rubber = ff.Material(youngs_modulus, poisson_ratio, density)

    # markers are the points where joints and probes attach
    hinge, middle, end = (ff.Marker("rod", place) for place in ("start", 0.5, "end"))

    model = ff.Model("tutorial_1_pendulum", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Beam("rod", ff.Section.circle(diameter, rubber), orientation=(0.0, 1.0, 0.0)),
        ff.PointMass("bob", mass, end),
        ff.Revolute("hinge", ff.Ground(), hinge, axis=(0.0, 1.0, 0.0)),
    )

    # probes are the columns of the history
    model.add(
        ff.PositionProbe("path", end),
        ff.Probe("shape", (hinge, middle, end), ("sag",), _sag),
        ff.EnergyProbe(),
    )
    return model


def _sag(
    t: float, hinge: ff.MarkerState, middle: ff.MarkerState, end: ff.MarkerState
) -> tuple[float]:
    """Distance of the middle from the chord."""
    along = end.position - hinge.position
    along /= np.linalg.norm(along)
    return (float(np.linalg.norm(np.cross(along, middle.position - hinge.position))),)


CASE = ff.Case(
    name="tutorial_1_pendulum",
    summary="tutorial 1: a pendulum with a flexible rod",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 16, "beam elements of the rod", minimum=2),
        ff.Option("length", float, 1.0, "of the rod", unit="m", above=0.0),
        ff.Option("diameter", float, 0.02, "of the rod", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 5e7, "of the rod", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.49, "of the rod", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1100.0, "of the rod", unit="kg/m^3", above=0.0),
        ff.Option("mass", float, 0.2, "of the bob", unit="kg", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2"),
    ),
    dt=2e-3,
    t_end=2.0,
    smoke={"elements": 4, "t_end": 6e-3},
    results=lambda history: {
        "largest_sag": float(history["sag"].max()),
        "lowest_bob": float(history["path_z"].min()),
        "energy_balance": float(history["energy_balance"][-1]),
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
