# SPDX-License-Identifier: LGPL-3.0-or-later
"""The blade of the IEA 15 MW reference turbine as the windIO file of the case ``turbine_blade``.

``python -m tests.data.generate.iea15_blade IEA-15-240-RWT_BeamDyn.dat meshes/iea15_blade.yaml``
writes what BeamDyn's primary file and blade file say of axis, twist, stiffness, inertia and damping
in the terms of windIO 2. The numbers are those of the files; places are fractions of the arc length
of the axis instead of key points, and the inertia is given by mass, mass centre and moments.
"""

import sys
from pathlib import Path

import numpy as np

import flexfem as ff
from flexfem.io.beams.beam_data import arc_fractions
from flexfem.io.beams.beamdyn import ORDER

HEADER = """\
# Blade of the IEA 15 MW offshore reference wind turbine by IEA Wind Task 37, release of May 2025,
# https://github.com/IEAWindTask37/IEA-15-240-RWT, under the Apache License, Version 2.0: see the
# file LICENSE.Apache-2.0 beside this one.
# Changes: made of IEA-15-240-RWT_BeamDyn.dat and IEA-15-240-RWT_BeamDyn_blade.dat, reduced to axis,
# twist, 6x6 matrices and damping of the blade and written in the terms of windIO 2, by
# tests/data/generate/iea15_blade.py of flexfem; the numbers are those of the source.
"""


def text(path: Path) -> str:
    """The YAML file of a primary file of BeamDyn."""
    data = ff.read_beamdyn(path)
    table, back = data.sections, np.argsort(ORDER)
    stiffness, inertia = (
        values[:, back][:, :, back] for values in (table.stiffness, table.inertia)
    )
    mass = inertia[:, 0, 0]
    columns = {
        "mass": mass, "cm_x": inertia[:, 1, 5] / mass, "cm_y": -inertia[:, 0, 5] / mass,
        "i_edge": inertia[:, 3, 3], "i_flap": inertia[:, 4, 4], "i_plr": inertia[:, 5, 5],
        "i_cp": -inertia[:, 3, 4],
    }  # fmt: skip
    grid = arc_fractions(data.points)
    twist = -np.rad2deg(table.twist_at(grid))
    axis = [f"      {name}: {_curve(grid, data.points[:, i])}" for i, name in enumerate("xyz")]
    entries = [
        f"          K{i + 1}{j + 1}: {_list(stiffness[:, i, j])}"
        for i, j in zip(*np.triu_indices(6), strict=True)
        if stiffness[:, i, j].any()
    ]
    lines = [
        "windIO_version: '2.0'", "name: IEA 15 MW offshore reference wind turbine, blade",
        "components:", "  blade:", "    reference_axis:", *axis, "    outer_shape:",
        f"      twist: {_curve(grid, np.round(twist, 9))}", "    structure:",
        "      elastic_properties:", "        inertia_matrix:",
        f"          grid: {_list(table.stations)}",
        *(f"          {name}: {_list(values)}" for name, values in columns.items()),
        "        stiffness_matrix:", f"          grid: {_list(table.stations)}", *entries,
        "        structural_damping:", f"          mu: {_list(data.damping[back])}",
    ]  # fmt: skip
    return HEADER + "\n".join(lines) + "\n"


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _curve(grid: np.ndarray, values: np.ndarray) -> str:
    return f"{{grid: {_list(grid)}, values: {_list(values)}}}"


if __name__ == "__main__":
    source, target = map(Path, sys.argv[1:])
    target.write_text(text(source), encoding="utf-8")
