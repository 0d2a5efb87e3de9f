# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid reference of the truss that gravity deploys.

``python tests/data/generate/deployable_truss.py`` writes deployable_truss.csv. Rigid members leave
one freedom per bay, its angle beta between frame and cross-bars. Lagrange's equations of uniform
rods (translation, rotation and rotary inertia of their sections) are integrated by DOP853 from rest
at 5 degrees. A bay that reaches 90 degrees is locked there: its rate becomes zero, and the others
jump by the impulse that keeps their generalised momenta. Nothing is shared with flexfem.
"""

from collections.abc import Callable

import numpy as np
import scipy  # type: ignore[import-untyped]
from reference_csv import write
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

SIDE, BAR, DIAGONAL = 2.0, 4.0, np.sqrt(20.0)
OUTER, INNER, DENSITY = 0.060, 0.055, 7850.0
AREA = np.pi / 4.0 * (OUTER**2 - INNER**2)
INERTIA = np.pi / 64.0 * (OUTER**4 - INNER**4)
GRAVITY = 0.005 * 9.81
START, END = np.radians(5.0), np.pi / 2.0
BAYS, SAMPLE = 2, 0.1

Rod = tuple[np.ndarray, np.ndarray]


def point(x: float, y: float, z: float) -> np.ndarray:
    """Place relative to a frame and its derivatives with respect to beta: none, shape (3, 3)."""
    return np.array([[x, y, z], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def next_frame(beta: float) -> np.ndarray:
    """Position of the next frame relative to this one, first and second derivative."""
    c, s = BAR * np.cos(beta), BAR * np.sin(beta)
    return np.array([[s, 0.0, c], [c, 0.0, -s], [-s, 0.0, -c]])


def slider(beta: float) -> np.ndarray:
    """Height of the slider on the next frame's vertical member, first and second derivative."""
    c, s = BAR * np.cos(beta), BAR * np.sin(beta)
    root = np.sqrt(SIDE**2 + c**2)
    slope = -s * c / root
    bend = (s**2 - c**2) / root - (s * c) ** 2 / root**3
    height = np.zeros((3, 3))
    height[:, 2] = root - c, slope + s, bend + c
    return height


def bay(beta: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends of bars, diagonals and the frame at the end of a bay, relative to its first frame."""
    moved, rods = next_frame(beta), []
    for y in (0.0, SIDE):
        rods += [(point(0.0, y, z), point(0.0, y, z) + moved) for z in (0.0, SIDE)]
        rods.append((point(0.0, y, y), point(0.0, SIDE - y, y) + moved))
        rods.append((point(0.0, y, 0.0), moved + slider(beta) + point(0.0, y, 0.0)))
        rods.append((moved + point(0.0, y, 0.0), moved + point(0.0, y, SIDE)))
        rods.append((moved + point(0.0, 0.0, y), moved + point(0.0, SIDE, y)))
    return rods


class Motion:
    """Equations of motion, summed up rod by rod.

    Attributes:
        mass: Mass matrix, shape (n, n).
        force: Right-hand side without the accelerations, shape (n,).
        energy: Kinetic and potential energy.
    """

    def __init__(self, betas: np.ndarray, rates: np.ndarray) -> None:
        """Set up the equations at these angles and rates, shape (n,)."""
        n = len(betas)
        self.mass, self.force, self.energy = np.zeros((n, n)), np.zeros(n), 0.0
        # position of the first frame of a bay, its Jacobian and what accelerates it at given rates
        base, slopes, bias = np.zeros(3), np.zeros((3, n)), np.zeros(3)
        for k in range(n):
            for ends in bay(betas[k]):
                jacobians = [slopes.copy(), slopes.copy()]
                for jacobian, end in zip(jacobians, ends, strict=True):
                    jacobian[:, k] += end[1]
                self._translate(
                    [base + end[0] for end in ends],
                    jacobians,
                    [bias + end[2] * rates[k] ** 2 for end in ends],
                )
                self._rotate(k, ends[1] - ends[0], rates[k])
            step = next_frame(betas[k])
            base, bias = base + step[0], bias + step[2] * rates[k] ** 2
            slopes[:, k] += step[1]
        self.energy += 0.5 * float(rates @ self.mass @ rates)

    def _translate(
        self, places: list[np.ndarray], jacobians: list[np.ndarray], biases: list[np.ndarray]
    ) -> None:
        """Add the translation of a rod's line, which is linear between its ends."""
        weight = DENSITY * AREA * float(np.linalg.norm(places[1] - places[0]))
        for i in range(2):
            self.force += 0.5 * weight * GRAVITY * jacobians[i][0]
            self.energy -= 0.5 * weight * GRAVITY * places[i][0]
            for j in range(2):
                share = weight * (1.0 / 3.0 if i == j else 1.0 / 6.0)
                self.mass += share * jacobians[i].T @ jacobians[j]
                self.force -= share * jacobians[i].T @ biases[j]

    def _rotate(self, k: int, line: np.ndarray, rate: float) -> None:
        """Add the sections' rotation about Y: rho I across, 2 rho I about the rod's own axis."""
        length = float(np.linalg.norm(line[0]))
        d, slope, bend = line[:, [2, 0]]
        across = max(float(d @ d), np.finfo(float).tiny)
        turn = (d[0] * slope[1] - d[1] * slope[0]) / across
        turn_rate = (d[0] * bend[1] - d[1] * bend[0]) / across * rate**2
        rotary = DENSITY * INERTIA * length * (2.0 - across / length**2)
        self.mass[k, k] += rotary * turn**2
        self.force[k] -= rotary * turn * turn_rate


def rate(free: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """Time derivative of (angles, rates) while only some bays are free."""

    def derivative(_: float, state: np.ndarray) -> np.ndarray:
        betas, rates = np.split(state, 2)
        motion = Motion(betas, rates)
        result = np.zeros_like(state)
        result[: len(betas)] = rates
        inner = motion.mass[np.ix_(free, free)]
        result[len(betas) :][free] = np.linalg.solve(inner, motion.force[free])
        return result

    return derivative


def deploy(
    bays: int, tolerance: float
) -> tuple[list[tuple[float, int]], Callable[..., np.ndarray]]:
    """Times at which bays are locked with their numbers; angles and rates over time."""
    state, start, locks = np.r_[np.full(bays, START), np.zeros(bays)], 0.0, []
    pieces = []
    free = np.arange(bays)
    while free.size:
        arrivals = [lambda _, y, k=k: y[k] - END for k in free]
        for arrival in arrivals:
            arrival.terminal, arrival.direction = True, 1.0  # type: ignore[attr-defined]
        solution = solve_ivp(
            rate(free), (start, 1e3), state, method="DOP853", rtol=tolerance, atol=tolerance,
            dense_output=True, events=arrivals,
        )  # fmt: skip
        start, state = solution.t[-1], solution.y[:, -1].copy()
        pieces.append((start, solution.sol))
        (stopped,) = (int(k) for k, hits in zip(free, solution.t_events, strict=True) if hits.size)
        locks.append((start, stopped))
        mass = Motion(*np.split(state, 2)).mass
        momentum = mass @ state[bays:]
        free = free[free != stopped]
        state[bays:] = 0.0
        state[stopped] = END
        if free.size:
            state[bays + free] = np.linalg.solve(mass[np.ix_(free, free)], momentum[free])

    def motion(t: float) -> np.ndarray:
        return next((sol(t) for end, sol in pieces if t <= end), state)

    return locks, motion


def check() -> float:
    """Largest change of a member's length and slider's distance over the motion, m."""
    worst = 0.0
    lengths = [BAR, BAR, DIAGONAL, DIAGONAL, SIDE, SIDE] * 2
    for beta in np.linspace(START, END, 86):
        for (p, q), length in zip(bay(beta), lengths, strict=True):
            worst = max(worst, abs(float(np.linalg.norm(q[0] - p[0])) - length))
    return worst


def table(bays: int, tolerance: float) -> tuple[np.ndarray, list[tuple[float, int]]]:
    """Columns t, D_x, D_z, beta_1 .. beta_n every ``SAMPLE`` seconds and at the end; the locks."""
    locks, motion = deploy(bays, tolerance)
    end = locks[-1][0]
    times = np.append(np.arange(0.0, end, SAMPLE), end)
    betas = np.array([motion(t)[:bays] for t in times])
    d = BAR * np.column_stack([np.sin(betas).sum(1), np.cos(betas).sum(1)])
    return np.column_stack([times, d, betas]), locks


def main() -> None:
    """Check the members, integrate with two tolerances and write the finer one."""
    gap = check()
    assert gap < 1e-13, gap
    (coarse, coarse_locks), (fine, locks) = table(BAYS, 1e-8), table(BAYS, 1e-11)
    error = np.abs(coarse[:-1] - fine[:-1]).max()
    late = max(abs(a[0] - b[0]) for a, b in zip(coarse_locks, locks, strict=True))
    arrivals = "; ".join(f"bay {k + 1} at {t:.6f} s" for t, k in locks)
    header = f"""Truss of {BAYS} bays, all members rigid, deployed by gravity 0.005 g along X.
t (s); lower corner D of the last frame, X and Z (m); angles between frames and cross-bars (rad).
Data and source: tests/data/generate/deployable_truss.py; Lagrange's equations of the uniform rods,
scipy {scipy.__version__} DOP853, tolerance 1e-11.
With 1e-8 the table changes by {error:.0e}, the times of arrival by {late:.0e} s.
From rest at 5 degrees; at 90 degrees the bays are locked, without restitution: {arrivals}."""
    columns = ["t", "D_x", "D_z", *(f"beta_{k + 1}" for k in range(BAYS))]
    write("deployable_truss", header, columns, fine, 10)


if __name__ == "__main__":
    main()
