# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilever with a bending law of its own, bent by an end moment.

A straight beam along x, length 1 m, circle of 30 mm, E = 50 MPa, nu = 0.4, 1200 kg/m^3, is clamped
at the origin; the moment M about y at its end rises smoothly within 1 s and stays. No gravity. The
moment-curvature law is

    softening:   M = EI kappa / sqrt(1 + (kappa/k0)^2), never more than EI k0 = 3.98 N m
    stiffening:  M = EI kappa / sqrt(1 - (kappa/k0)^2), no curvature beyond k0 = 2 1/m

and all strains are viscous, with the stress T D strain_rate where D is the stiffness at zero strain
and T the retardation time.

History: ``tip_x, tip_y, tip_z``, the end of the beam, m; ``tip_angle``, its rotation about -y, rad.

Expected: a beam under a constant moment has a constant curvature, kappa = (M/EI) / sqrt(1 -/+
(M/(EI k0))^2). With M = 0.6 EI k0 the end comes to rest at the angle kappa L = 1.5 rad (softening)
or 1.02899 rad (stiffening), and at (sin(kappa L), 0, 1 - cos(kappa L)) / kappa.
Run: ``mpirun -n 2 python cases/nonlinear_beam.py --law softening``.
"""

import math
import sys
from typing import Any

import numpy as np

import flexfem as ff


def energy(strain: Any, p: Any) -> Any:
    """Strain energy per length: linear but for bending; ``sign`` is 1 where that softens."""
    import ufl

    g1, g2, g3, k1, k2, k3 = strain
    root = ufl.sqrt(1 + p.sign * (k2**2 + k3**2) / p.k0**2)
    linear = p.EA * g1**2 + p.GA * (g2**2 + g3**2) + p.GJ * k1**2
    return linear / 2 + p.sign * p.EI * p.k0**2 * (root - 1)


def dissipation(strain: Any, rate: Any, p: Any) -> Any:
    """Dissipation potential per length of a viscosity proportional to the stiffness."""
    g1, g2, g3, k1, k2, k3 = rate
    extension, shear = p.EA * g1**2, p.GA * (g2**2 + g3**2)
    return p.T / 2 * (extension + shear + p.GJ * k1**2 + p.EI * (k2**2 + k3**2))


def tip_angle(t: float, tip: ff.MarkerState) -> list[float]:
    """Rotation of the end about -y."""
    return [math.atan2(tip.rotation[2, 0], tip.rotation[0, 0])]


def build(
    *, elements: int, law: str, moment: float, retardation: float, curvature: float, length: float,
    diameter: float, youngs_modulus: float, poisson_ratio: float, density: float,
) -> ff.Model:  # fmt: skip
    """Cantilever under ``moment`` times EI k0 at its end."""
    rubber = ff.Material(youngs_modulus, poisson_ratio, density)
    linear = ff.Section.circle(diameter, rubber)
    assert linear.stiffness is not None
    ea, ga, _, gj, ei, _ = np.diag(linear.stiffness)
    section = linear.with_law(
        ff.BeamLaw(
            energy,
            dissipation=dissipation,
            parameters={
                "EA": ea, "GA": ga, "GJ": gj, "EI": ei, "k0": curvature, "T": retardation,
                "sign": 1.0 if law == "softening" else -1.0,
            },
        )
    )  # fmt: skip
    points = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], elements + 1)
    cells = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    model = ff.Model(
        "nonlinear_beam", mesh=ff.LineMesh(points, cells, {"beam": np.arange(elements)})
    )
    end = ff.Marker("beam", "end")
    model.add(
        ff.Beam("beam", section),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.PointMoment(
            "moment", end, (0.0, -moment * ei * curvature, 0.0), amplitude=ff.SmoothStep(0.0, 1.0)
        ),
        ff.PositionProbe("tip", end),
        ff.Probe("angle", end, ["tip_angle"], tip_angle, unwrap=["tip_angle"]),
    )
    return model


CASE = ff.Case(
    name="nonlinear_beam",
    summary="viscous cantilever with a nonlinear moment-curvature law in UFL",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 8, "beam elements", minimum=1),
        ff.Option(
            "law", str, "softening", "what bending does", choices=("softening", "stiffening")
        ),
        ff.Option("moment", float, 0.6, "moment at the end in units of EI k0"),
        ff.Option("retardation", float, 0.15, "retardation time", unit="s", minimum=0.0),
        ff.Option("curvature", float, 2.0, "k0, where bending gets nonlinear", unit="1/m", above=0),
        ff.Option("length", float, 1.0, "of the beam", unit="m", above=0.0),
        ff.Option("diameter", float, 0.03, "of the section", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 5e7, "of the material", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.4, "of the material", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1200.0, "of the material", unit="kg/m^3", above=0.0),
    ),
    dt=5e-3,
    t_end=8.0,
    smoke={"elements": 3, "t_end": 0.05},
    results=lambda history: {
        name: history[name][-1] for name in ("tip_x", "tip_y", "tip_z", "tip_angle")
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
