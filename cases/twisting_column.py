# SPDX-License-Identifier: LGPL-3.0-or-later
"""Column of rubber that twists about itself (Bonet, Gil, Lee, Said, Ortigosa 2015).

A column of ``--width`` 1 m square and ``--height`` 6 m, clamped at its base, starts with the
angular velocity ``--spin`` 105 sin(pi z/(2 height)) rad/s about its axis Z: neo-Hookean with
E = 1.7e7 N/m^2, nu = 0.45 and rho = 1100 kg/m^3 at small strains. Hexahedra or tetrahedra of
second order, ``--cells`` 2 across and three times as many along it for each metre of ratio;
``--formulation dilatation`` does not lock whatever nu.

History: ``twist`` (rad) of the end's diagonal about Z, counted on over full turns; ``x, y, z`` (m)
of its corner; ``volume_J``, present over initial volume of all of the column;
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J).

Expected: the end turns by nearly a full turn within 0.09 s and comes back; no closed form. It turns
by 5.88 rad with 2 and with 3 cells across; with nu = 0.499 by 5.96 and 5.98 rad, with
``--formulation displacement`` by 5.95 and 5.97 rad, and of tetrahedra, 2 across, by 5.88 and 5.72
rad in the two formulations. Some 4e-4 of the energy is lost, with
``--integrator energy_momentum --rho-inf 1 --tolerance 1e-9`` 2e-10.
Run: ``python cases/twisting_column.py``, then
``flexfem plot results/twisting_column --columns twist``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Values = npt.NDArray[np.float64]


class Twist:
    """Angle of the diagonal of the end about the axis, counted on over full turns."""

    def __init__(self) -> None:
        """Start at zero."""
        self.last = 0.0

    def __call__(
        self, t: float, first: ff.MarkerState, last: ff.MarkerState
    ) -> tuple[float, float, float, float]:
        """Twist, rad, and place of the last corner, m."""
        x, y, _ = last.position - first.position
        angle = math.atan2(y, x) - 0.25 * math.pi
        self.last = angle + 2.0 * math.pi * round((self.last - angle) / (2.0 * math.pi))
        return self.last, *last.position


def build(
    *, cells: int, cell: str, formulation: str, width: float, height: float, youngs_modulus: float,
    poisson_ratio: float, density: float, spin: float,
) -> ff.Model:  # fmt: skip
    """Model of the column with so many cells across."""
    along = max(1, round(cells * height / width / 2.0))
    mesh = ff.SolidMesh.box(
        (width, width, height),
        (cells, cells, along),
        cell,
        origin=(-0.5 * width, -0.5 * width, 0.0),
    )

    def velocity(x: Values) -> Values:
        rate = spin * np.sin(0.5 * math.pi * x[:, 2] / height)
        return np.column_stack([-rate * x[:, 1], rate * x[:, 0], np.zeros(len(x))])

    column = ff.Solid(
        "column", ff.laws.NeoHookean.from_young(youngs_modulus, poisson_ratio), mesh,
        density=density, formulation=formulation, fixed={"z0": "xyz"}, start_velocities=velocity,
    )  # fmt: skip
    corners = [ff.Marker("column", (s * width, s * width, height)) for s in (-0.5, 0.5)]
    model = ff.Model("twisting_column")
    model.add(
        column,
        ff.Probe("end", corners, ("twist", "x", "y", "z"), Twist()),
        ff.SolidProbe("volume", "column", measures=("J",)),
        ff.EnergyProbe(),
    )
    return model


def results(history: Mapping[str, Values]) -> dict[str, float]:
    """Extremes of the motion, and what the balance of energy misses relative to its start."""
    energy = history["energy_kinetic"][0]
    return {
        "largest_twist": float(history["twist"].max()),
        "time_of_largest_twist": float(history["t"][history["twist"].argmax()]),
        "least_z": float(history["z"].min()),
        "largest_change_of_volume": float(np.abs(history["volume_J"] - 1.0).max()),
        "energy_lost": float(-history["energy_balance"][-1] / energy),
        "energy_made": float(history["energy_balance"].max() / energy),
    }


CASE = ff.Case(
    name="twisting_column",
    summary="rubber column that twists about itself: nearly incompressible, large strains",
    description=__doc__,
    build=build,
    options=(
        ff.Option("cells", int, 2, "cells across the column", minimum=1),
        ff.Option("cell", str, "hexahedron", "shape", choices=("hexahedron", "tetrahedron")),
        ff.Option(
            "formulation", str, "dilatation", "of the change of volume",
            choices=("dilatation", "displacement"),
        ),
        ff.Option("width", float, 1.0, "of the square section", unit="m", above=0.0),
        ff.Option("height", float, 6.0, "of the column", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1.7e7, "small strains", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.45, "small strains", above=-1.0, maximum=0.49999),
        ff.Option("density", float, 1100.0, "of the column", unit="kg/m^3", above=0.0),
        ff.Option("spin", float, 105.0, "of the end at the start", unit="rad/s"),
    ),
    dt=5e-4,
    t_end=0.1,
    smoke={"cells": 1, "t_end": 1.5e-3, "formulation": "displacement"},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
