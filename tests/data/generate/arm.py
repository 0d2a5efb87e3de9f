# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference dynamics of ``tests/data/arm.urdf``: ``python tests/data/generate/arm.py``.

By Pinocchio (``pip install pin``): its reader of URDF files, articulated-body and recursive
Newton-Euler algorithms. Nothing is shared with flexfem.
"""

import numpy as np
import pinocchio  # type: ignore[import-not-found]
import scipy  # type: ignore[import-untyped]
from reference_csv import DATA, write
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6", "grip")
SCALE = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.03])


class Arm:
    """The arm in coordinates, also for the joint that turns without end."""

    def __init__(self) -> None:
        self.model = pinocchio.buildModelFromUrdf(str(DATA / "arm.urdf"))
        self.data = self.model.createData()
        self.tool = self.model.getFrameId("tool")
        assert list(self.model.names)[1:] == list(JOINTS)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Its own coordinates: cosine and sine of the first angle."""
        return np.concatenate([[np.cos(q[0]), np.sin(q[0])], q[1:]])

    def accelerations(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Of the joints without drives, under gravity."""
        return np.array(pinocchio.aba(self.model, self.data, self.position(q), v, np.zeros(len(q))))

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Of drives that give the joints accelerations."""
        return np.array(pinocchio.rnea(self.model, self.data, self.position(q), v, a))

    def frame(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Position, rotation by rows, velocity and angular velocity of the tool, inertial axes."""
        pinocchio.forwardKinematics(self.model, self.data, self.position(q), v)
        pose = pinocchio.updateFramePlacement(self.model, self.data, self.tool)
        twist = pinocchio.getFrameVelocity(
            self.model, self.data, self.tool, pinocchio.LOCAL_WORLD_ALIGNED
        )
        parts = [pose.translation, pose.rotation.ravel(), twist.linear, twist.angular]
        return np.concatenate(parts)


def main() -> None:
    """Write states with their dynamics, and a motion."""
    arm, rng, rows = Arm(), np.random.default_rng(6), []
    for _ in range(6):
        q, v, a = (SCALE * rng.uniform(-scale, scale, 7) for scale in (1.3, 2.0, 5.0))
        free, tau = arm.accelerations(q, v), arm.torques(q, v, a)
        rows.append(np.concatenate([q, v, free, a, tau, arm.frame(q, v)]))
    columns = [f"{what}_{joint}" for what in ("q", "v", "free", "a", "tau") for joint in JOINTS]
    columns += [f"tool_{i}" for i in range(18)]
    source = f"""Source: tests/data/generate/arm.py, Pinocchio {pinocchio.__version__},
NumPy {np.__version__}; gravity (0, 0, -9.81). SI units."""
    header = f"""Six states of the arm in tests/data/arm.urdf: coordinates q and rates v of joints,
accelerations under gravity without drives (free); torques tau that give accelerations a; position,
rotation by rows, velocity and angular velocity of the link "tool" in inertial axes.
{source} Error: round-off."""
    write("arm", header, columns, np.array(rows), 16)

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[7:], arm.accelerations(state[:7], state[7:])])

    times = np.linspace(0.0, 0.1, 11)
    result = solve_ivp(
        rate, (0.0, 0.1), rows[0][:14], method="DOP853", t_eval=times, rtol=1e-12, atol=1e-13
    )
    header = f"""Motion of the arm in tests/data/arm.urdf under gravity, from the first state of
arm.csv. Accelerations integrated by scipy {scipy.__version__} DOP853, rtol 1e-12, atol 1e-13.
{source} Estimated error: 1e-11 rad or m."""
    write("arm_motion", header, ["t", *JOINTS], np.column_stack([times, result.y[:7].T]), 13)


if __name__ == "__main__":
    main()
