# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference motion of the slow and the fast heavy top: ``python tests/data/generate/heavy_top.py``.

Data of Brüls, Cardona, Arnold (2012). The rigid body rotates about its fixed point: Euler's
equations in body axes and quaternion kinematics, integrated by DOP853. Nothing is shared with
flexfem.
"""

import numpy as np
import scipy  # type: ignore[import-untyped]
from reference_csv import write
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

MASS = 15.0
CENTRE = np.array([0.0, 1.0, 0.0])
INERTIA_CENTRE = np.diag([0.234375, 0.46875, 0.234375])
INERTIA = INERTIA_CENTRE + MASS * (CENTRE @ CENTRE * np.eye(3) - np.outer(CENTRE, CENTRE))
GRAVITY = np.array([0.0, 0.0, -9.81])
TOPS = {"slow": (0.0, 1.5, -0.0461538), "fast": (0.0, 150.0, -4.61538)}

# Position (3), angular velocity (3), reaction (3): table published with the benchmark.
CHECK = {
    ("slow", 0.5): "0.0072227982 .4058422986 -.9139145802 -3.083040202 1.5 -2.85519452 "
    "-5.77817749 -161.18447551 365.33436996",
    ("slow", 1.0): "-.0311686471 -.9833836814 -.1788436484 -.196690095 1.5 -1.848884067 "
    "1.13777283 76.52117875 16.14589544",
    ("fast", 0.5): "-.7024682971 -.0211651847 -.7114002577 -.471053102 150 5.901083048 "
    "523.28124351 404.20617832 357.33617645",
    ("fast", 1.0): "0.1733439641 .6400885921 -.7484907911 -.822078102 150 -5.923291348 "
    "-517.60073948 -396.84310149 404.57492516",
}


def rotation(q: np.ndarray) -> np.ndarray:
    """Rotation matrix (body to inertial) of a unit quaternion (scalar first)."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def angular_acceleration(R: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Angular acceleration in body axes, rad/s^2."""
    moment = MASS * np.cross(CENTRE, R.T @ GRAVITY)
    return np.linalg.solve(INERTIA, moment - np.cross(omega, INERTIA @ omega))


def rate(_: float, state: np.ndarray) -> np.ndarray:
    """Time derivative of (quaternion, body angular velocity)."""
    q, omega = state[:4], state[4:]
    dq = 0.5 * np.array([-q[1:] @ omega, *(q[0] * omega + np.cross(q[1:], omega))])
    return np.concatenate([dq, angular_acceleration(rotation(q), omega)])


def row(state: np.ndarray) -> np.ndarray:
    """Mass centre, angular velocity (body axes), force of the joint on the body (inertial axes)."""
    R, omega = rotation(state[:4]), state[4:]
    alpha = angular_acceleration(R, omega)
    acceleration = R @ (np.cross(alpha, CENTRE) + np.cross(omega, np.cross(omega, CENTRE)))
    return np.concatenate([R @ CENTRE, omega, MASS * (acceleration - GRAVITY)])


def main() -> None:
    """Integrate both tops, compare with the published table and write the file."""
    times = np.linspace(0.0, 1.0, 101)
    columns, table, worst = ["t"], [times], 0.0
    for name, omega in TOPS.items():
        start = np.array([1.0, 0.0, 0.0, 0.0, *omega])
        result = solve_ivp(
            rate, (0.0, 1.0), start, method="DOP853", t_eval=times, rtol=1e-13, atol=1e-14
        )
        rows = np.array([row(state) for state in result.y.T])
        table += list(rows.T)
        parts = [*"xyz", *(f"omega_{c}" for c in "123"), *(f"force_{c}" for c in "xyz")]
        columns += [f"{name}_{part}" for part in parts]
        for (top, t), text in CHECK.items():
            if top == name:
                error = np.abs(rows[round(100 * t)] - np.array(text.split(), dtype=float))
                print(f"{name} t = {t}: largest difference {error.max():.1e}")
                worst = max(worst, error[:6].max())
    header = f"""Heavy top (Brüls, Cardona, Arnold 2012), slow and fast. SI units.
Position of the mass centre, angular velocity in body axes, force of the joint on the body in
inertial axes. Source: tests/data/generate/heavy_top.py, Euler's equations about the fixed point
with quaternion kinematics, scipy {scipy.__version__} DOP853, rtol 1e-13, atol 1e-14.
Estimated error: positions 1e-12 m, angular velocities 1e-11 rad/s, forces 1e-9 N (differences from
an independently published table: at most {worst:.1g} m or rad/s, its last printed digit)."""
    write("heavy_top", header, columns, np.column_stack(table), 13)


if __name__ == "__main__":
    main()
