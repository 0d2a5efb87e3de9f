# SPDX-License-Identifier: LGPL-3.0-or-later
"""A clamped blade of a wind turbine under a force at its tip.

The blade is read from a file: axis, twist and 6x6 matrices of stiffness and inertia at stations
along it. The default is the blade of the IEA 15 MW reference turbine, 117 m long; another one is a
primary file of BeamDyn, whose folder has the blade file, or a windIO file (``.yaml``). The root is
at the origin in the axes of these files: Z along the blade, X downwind, Y across. The force acts
from the start on, positive against X: the default bends the blade downwind, as wind does. The
damping of the file is multiplied by ``--damping``; sections without outline are drawn as ellipses
with the radii of gyration of thin tubes.

History: ``tip_x, tip_y, tip_z``, displacements of the tip (m). Of the first element: strains
``root_gamma1, root_gamma2, root_gamma3`` and ``root_kappa1, root_kappa2, root_kappa3`` (1/m),
forces ``root_n1, root_n2, root_n3`` (N) and moments ``root_m1, root_m2, root_m3`` (N m).

Expected (BeamDyn, one element of order 10, the same sections): ``tip_x`` 3.215, 6.279, 8.422,
10.223, 11.547, 12.886, 13.887, 14.310, 16.186, 17.668 m at 0.05, 0.10, ... 0.50 s; here 1.9 % off
in the mean. Frequencies: ``--analysis modes --force 0``, 0.506 Hz in flap and 0.693 Hz in edge.
Run: ``mpirun -n 2 python cases/turbine_blade.py --elements 80``; isogeometric elements:
``--formulation nurbs --degree 3 --elements 40``.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import flexfem as ff

#: Corners of the ellipses that sections are drawn as.
CORNERS = 24


def read(path: str) -> ff.BeamData:
    """Blade of a windIO file or of a primary file of BeamDyn; one of a bare name is shipped."""
    file = Path(path)
    if file.name == path and not file.exists():
        file = ff.shipped_data(path)
    return ff.read_windio(file) if file.suffix in (".yaml", ".yml") else ff.read_beamdyn(file)


def drawn(table: ff.SectionTable) -> ff.SectionTable:
    """The table with ellipses as outlines."""
    if table.outlines is not None:
        return table
    D = table.stiffness
    across, along = (np.sqrt(2.0 * D[:, i, i] / D[:, 0, 0]) for i in (4, 5))
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    y, z = np.outer(along, np.cos(angle)), np.outer(across, np.sin(angle))
    return replace(table, outlines=np.stack([y, z], axis=-1))


def build(
    *, blade: str, elements: int, formulation: str, degree: int, force: float, damping: float
) -> ff.Model:
    """Model with elements of equal length along the blade, NURBS ones of the given degree."""
    data = read(blade)
    mesh = data.mesh("blade", elements)
    model, start = ff.Model("turbine_blade", mesh=mesh), mesh.points[-1]
    root, tip = ff.Marker("blade", "start"), ff.Marker("blade", "end")
    model.add(
        data.beam(
            "blade", section=drawn(data.sections), damping=damping * data.damping,
            formulation=formulation, degree=degree if formulation == "nurbs" else None,
        ),
        ff.Rigid("clamp", ff.Ground(), root),
        ff.PointForce("wind", tip, (-force, 0.0, 0.0)),
        ff.Probe(
            "tip", tip, ("tip_x", "tip_y", "tip_z"),
            lambda t, state: (state.position - start).tolist(),
        ),
        ff.StrainProbe("root", "blade", 0.0),
    )  # fmt: skip
    return model


CASE = ff.Case(
    name="turbine_blade",
    summary="blade of the IEA 15 MW turbine under a force at its tip, from a file",
    description=__doc__,
    build=build,
    options=(
        ff.Option("blade", str, "iea15_blade.yaml", "windIO file or primary file of BeamDyn"),
        ff.Option("elements", int, 80, "beam elements along the blade", minimum=2),
        ff.Option("formulation", str, "se3", "of the beam", choices=("se3", "nurbs")),
        ff.Option("degree", int, 3, "of NURBS elements", minimum=1),
        ff.Option("force", float, -200e3, "at the tip in flap, against X", unit="N"),
        ff.Option("damping", float, 0.0, "factor of the damping in the file", minimum=0.0),
    ),
    dt=1e-3,
    t_end=0.5,
    rho_inf=0.4,
    smoke={"elements": 6, "t_end": 0.01},
    results=lambda history: {"tip_x": history["tip_x"][-1]},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
