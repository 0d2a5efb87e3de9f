# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic bar behind a cylinder under its weight (Turek, Hron 2006, tests CSM1 and CSM3).

A bar of ``--length`` 0.35 m, from the cylinder of ``--radius`` 0.05 m at (0.2, 0.2) to the point
A = (0.6, 0.2), and of ``--thickness`` 0.02 m, fixed to the cylinder: Saint Venant and Kirchhoff's
law in plane strain, E = 1.4e6 N/m^2, nu = 0.4, rho = 1000 kg/m^3. It is released from rest under
the acceleration ``--gravity`` 2 m/s^2 along -Y (CSM3), or in equilibrium with it by
``--analysis statics`` (CSM1). Quadrilaterals of second order, 18 x 1 at ``--refine 0``, twice as
many each way with every level, shorter at the cylinder.

History: ``ux``, ``uy``: displacement of A (m);
``energy_kinetic, energy_strain, energy_gravity, energy_work, energy_dissipation, energy_balance``
(J).

Expected: ux = -7.187e-3 m and uy = -66.10e-3 m in equilibrium; in motion
ux = -14.305e-3 +- 14.305e-3 m, uy = -63.607e-3 +- 65.160e-3 m at 1.0995 Hz, of means
(largest + least)/2 and amplitudes (largest - least)/2 in the last period.
``results`` has these, the frequency from the passages of A downwards through its mean height:
-14.28e-3 +- 14.28e-3 m, -63.55e-3 +- 65.09e-3 m, 1.0952 Hz; and in equilibrium -7.176e-3 and
-66.04e-3 m, with ``--refine 4`` -7.187e-3 and -66.10e-3 m. Faster vibrations along with the first
mode make periods differ: the first ones have uy = -64.8e-3 +- 64.7e-3 m. Run:
``python cases/turek_hron.py``, then ``flexfem plot results/turek_hron --columns uy``.
"""

import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

Values = npt.NDArray[np.float64]
#: Centre of the cylinder, m.
CENTRE = (0.2, 0.2)
#: Cells along the bar and across it at level 0.
CELLS = (18, 1)


def build(
    *, refine: int, length: float, thickness: float, radius: float, youngs_modulus: float,
    poisson_ratio: float, density: float, gravity: float, degree: int,
) -> ff.Model:  # fmt: skip
    """Model of the bar; a positive ``gravity`` acts downwards."""
    tip = (CENTRE[0] + radius + length, CENTRE[1], 0.0)
    along, across = (2**refine * number for number in CELLS)
    mesh = ff.build_body_mesh(
        "bar_on_cylinder", centre_x=CENTRE[0], centre_y=CENTRE[1], radius=radius, tip=tip[0],
        thickness=thickness, cells_along=along, cells_across=across,
    )  # fmt: skip
    law = ff.laws.SaintVenantKirchhoff(youngs_modulus, poisson_ratio)
    model = ff.Model("turek_hron")
    model.add(
        ff.Solid(
            "bar", law, mesh, density=density, degree=degree, plane="strain",
            fixed={"cylinder": "xy"},
        ),
        ff.Gravity((0.0, -gravity, 0.0)),
        ff.Probe(
            "A",
            ff.Marker("bar", tip),
            ("ux", "uy"),
            lambda t, a: (a.position[0] - tip[0], a.position[1] - tip[1]),
        ),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(history: Mapping[str, Values]) -> dict[str, float]:
    """Frequency, and means and amplitudes of the last period, or of all if there is none."""
    time, found = history["t"], {}
    down = history["uy"] - _middle(history["uy"])
    at = np.flatnonzero((down[:-1] >= 0.0) & (down[1:] < 0.0))
    first = 0.0
    if len(at) > 1:
        passed = time[at] + down[at] / (down[at] - down[at + 1]) * (time[at + 1] - time[at])
        found["frequency"] = float((len(at) - 1) / (passed[-1] - passed[0]))
        first = time[-1] - 1.0 / found["frequency"]
    for name in ("ux", "uy"):
        last = history[name][time >= first]
        found[f"{name}_mean"] = _middle(last)
        found[f"{name}_amplitude"] = 0.5 * float(np.ptp(last))
    return found


def _middle(values: Values) -> float:
    """Mean of the largest and the least."""
    return 0.5 * float(values.max() + values.min())


CASE = ff.Case(
    name="turek_hron",
    summary="elastic bar behind a cylinder under its weight, plane strain (Turek, Hron 2006)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("refine", int, 1, "level of the mesh", minimum=0, maximum=6),
        ff.Option("length", float, 0.35, "of the bar", unit="m", above=0.0),
        ff.Option("thickness", float, 0.02, "of the bar", unit="m", above=0.0),
        ff.Option("radius", float, 0.05, "of the cylinder", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1.4e6, "of the bar", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.4, "of the bar", above=-1.0, maximum=0.499),
        ff.Option("density", float, 1000.0, "of the bar", unit="kg/m^3", above=0.0),
        ff.Option("gravity", float, 2.0, "downwards, along -Y", unit="m/s^2"),
        ff.Option("degree", int, 2, "of the displacements", minimum=2, maximum=3),
    ),
    dt=0.005,
    t_end=10.0,
    rho_inf=1.0,
    smoke={"refine": 0, "t_end": 0.015},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
