# SPDX-License-Identifier: LGPL-3.0-or-later
"""Valid files of beams in small: tables of sections, BeamDyn, both versions of windIO."""

import numpy as np

#: A station in a row, engineering constants.
STATIONS = """\
# a mast
s [m], EA [MN], GA2, GA3, GJ [kN m^2], EI2 [kN m^2], EI3, EI23, tension_y [mm], shear_z, \
mass [kg/m], mass_z [cm], J2, J3, twist [deg]
0, 400, 8e7, 7e7, 90, 120, 2e5, 1e3, 20, 0.01, 15, 2, 0.01, 0.02, 0
3, 300, 6e7, 5e7, 60, 80, 1.5e5, 0, 10, 0, 12, 1, 0.008, 0.015, 10
"""

#: Upper halves of both matrices.
MATRICES = """\
eta;K11;K22;K33;K44;K55;K66;K14;M11;M22;M33;M44;M55;M66
0;1e8;4e7;4e7;2e5;3e5;4e5;1e5;10;10;10;0.05;0.02;0.03
1;5e7;2e7;2e7;1e5;2e5;2e5;0;5;5;5;0.03;0.01;0.02
"""

PRIMARY = """\
--------- BEAMDYN with OpenFAST INPUT FILE ---------
a bent blade
---------------------- GEOMETRY PARAMETER ----------
          1   member_total    - Total number of members (-)
          4   kp_total        - Total number of key points (-)
     1     4                  - Member number; Number of key points in this member
   kp_xr   kp_yr   kp_zr   initial_twist
    (m)     (m)     (m)      (deg)
   0.0     0.0     0.0      12.0
   0.1     0.0     4.0       8.0
   0.0     0.0     8.0       3.0
  -0.4     0.0    12.0      -1.0
---------------------- MATERIAL PARAMETER ----------
"blade.dat"    BldFile - Name of file containing properties for blade
"""


def _rows(matrix: np.ndarray) -> str:
    return "\n".join("  ".join(f"{x:.8e}" for x in row) for row in matrix)


def matrices(share: float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of a section in the order of BeamDyn: x, y, z."""
    K = np.diag([3e7, 5e7, 4e8, 2e7, 1e7, 5e6]) * share
    K[2, 3] = K[3, 2] = 1e6 * share
    K[0, 5] = K[5, 0] = -2e5 * share
    mass, x, y = 100.0 * share, 0.02, -0.1
    M = np.diag([mass, mass, mass, 6.0, 4.0, 10.0])
    M[0, 5] = M[5, 0] = -mass * y
    M[1, 5] = M[5, 1] = mass * x
    M[2, 3] = M[3, 2] = mass * y
    M[2, 4] = M[4, 2] = -mass * x
    M[3, 4] = M[4, 3] = 0.3
    return K, M


SHARES = ((0.0, 1.0), (0.4, 0.7), (1.0, 0.3))
MU = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3)

BLADE = """\
 ------- BEAMDYN V1.00.* INDIVIDUAL BLADE INPUT FILE ----
a bent blade
 ---------------------- BLADE PARAMETERS ----------------
3    station_total    - Number of blade input stations (-)
 1   damp_type        - Damping type: 0: no damping; 1: damped
  ---------------------- DAMPING COEFFICIENT -------------
   mu1   mu2   mu3   mu4   mu5   mu6
   (-)   (-)   (-)   (-)   (-)   (-)
 """ + " ".join(map(str, MU)) + "\n --------- DISTRIBUTED PROPERTIES ---\n" + "".join(
    f" {eta:f}\n" + "\n\n".join(map(_rows, matrices(share))) + "\n\n" for eta, share in SHARES
)  # fmt: skip


def _axis(indent: str) -> str:
    return "\n".join(
        f"{indent}{name}: {{grid: [0.0, 0.3, 0.7, 1.0], values: {values}}}"
        for name, values in (
            ("x", [0.0, 0.1, 0.0, -0.4]), ("y", [0.0, 0.0, 0.0, 0.0]), ("z", [0.0, 4.0, 8.0, 12.0])
        )
    )  # fmt: skip


_UPPER = np.triu_indices(6)
_GRID = [eta for eta, _ in SHARES]
_ROWS = [[matrices(share)[i][_UPPER].tolist() for _, share in SHARES] for i in (0, 1)]

WINDIO_1 = f"""\
name: a bent blade
components:
  blade:
    outer_shape_bem:
      twist: &twist {{grid: [0.0, 0.5, 1.0], values: [0.2, 0.05, -0.02]}}
      reference_axis: &axis
{_axis("        ")}
    elastic_properties_mb:
      six_x_six:
        reference_axis: *axis
        twist: *twist
        stiff_matrix: {{grid: {_GRID}, values: {_ROWS[0]}}}
        inertia_matrix: {{grid: {_GRID}, values: {_ROWS[1]}}}
"""


def _columns(indent: str) -> str:
    K = np.array(_ROWS[0])
    return "\n".join(
        f"{indent}K{i + 1}{j + 1}: {K[:, n].tolist()}"
        for n, (i, j) in enumerate(zip(*_UPPER, strict=True))
        if K[:, n].any()
    )


WINDIO_2 = f"""\
windIO_version: '2.0'
components:
  blade:
    reference_axis:
{_axis("      ")}
    outer_shape:
      twist: {{grid: [0.0, 0.5, 1.0], values: {np.rad2deg([0.2, 0.05, -0.02]).tolist()}}}
    structure:
      elastic_properties:
        stiffness_matrix:
          grid: {_GRID}
{_columns("          ")}
        inertia_matrix:
          grid: {_GRID}
          mass: [100.0, 70.0, 30.0]
          cm_x: [0.02, 0.02, 0.02]
          cm_y: [-0.1, -0.1, -0.1]
          i_edge: [6.0, 6.0, 6.0]
          i_flap: [4.0, 4.0, 4.0]
          i_plr: [10.0, 10.0, 10.0]
          i_cp: [-0.3, -0.3, -0.3]
        structural_damping: {{mu: {list(MU)}}}
"""
