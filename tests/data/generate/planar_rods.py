# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane motion of pin-jointed Simo-Reissner rods without constraints, as an explicit ODE.

High-order elements; positions are shared at the pins and supports are left out, so there are no
multipliers and the mass matrix is constant: M a = f(q), integrated by scipy's DOP853. Nothing is
shared with flexfem: inertial positions and one angle per node, no Lie group, no implicit scheme.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import Legendre, leggauss
from scipy.integrate import DOP853  # type: ignore[import-untyped]


def _lagrange(nodes: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives of the Lagrange polynomials, each of shape (len(at), len(nodes))."""
    vandermonde = np.vander(nodes, increasing=True)
    powers = np.vander(at, len(nodes), increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, len(nodes))
    inverse = np.linalg.inv(vandermonde)
    return powers @ inverse, slopes @ inverse


@dataclass(frozen=True)
class Rod:
    """Uniform rod in the plane.

    Args:
        length: m.
        mass: Mass per length, kg/m.
        rotary: Rotary inertia per length, kg m.
        axial: EA, N.
        shear: k GA, N.
        bending: EI, N m^2.
    """

    length: float
    mass: float
    rotary: float
    axial: float
    shear: float
    bending: float


@dataclass(frozen=True)
class State:
    """Positions (n, 2) and velocities (n, 2) of all nodes at a time; pins are shared nodes."""

    time: float
    position: np.ndarray
    velocity: np.ndarray


class PinnedRods:
    """Rods in a row along the first axis, the first one pinned at the origin, initially at rest.

    Args:
        rods: Rods from the ground outwards.
        n_elements: Elements per rod.
        degree: Polynomial degree of positions and angles; quadrature has as many points.
        gravity: Acceleration along the second axis, m/s^2.
        moment: Moment on the first rod at the ground, N m.
        slider_mass: Mass at the far end in kg, which then keeps to the first axis; None: free end.
    """

    def __init__(
        self,
        rods: list[Rod],
        n_elements: int,
        degree: int,
        *,
        gravity: float,
        moment: float = 0.0,
        slider_mass: float | None = None,
    ) -> None:
        stride = n_elements * degree
        self.pins = [stride * i for i in range(len(rods) + 1)]
        self.n = stride * len(rods) + 1
        self.n_angles = (stride + 1) * len(rods)
        self._assemble(rods, n_elements, degree)
        mass_x, mass_y = self.mass.copy(), self.mass
        free_x, free_y = np.arange(1, self.n), np.arange(1, self.n)
        if slider_mass is not None:
            mass_x[-1, -1] += slider_mass
            free_y = free_y[:-1]
        self.inverse_x = self._restricted_inverse(mass_x, free_x)
        self.inverse_y = self._restricted_inverse(mass_y, free_y)
        inverse_angle = np.linalg.inv(self.rotary)
        # The constant operators of the acceleration, multiplied out once.
        weighted = self.slope.T * self.weight
        self.from_force_x, self.from_force_y = self.inverse_x @ weighted, self.inverse_y @ weighted
        self.weight_y = self.inverse_y @ (gravity * self.mass.sum(1))
        self.from_couple = inverse_angle @ (self.angle.T * self.weight)
        bending = (self.angle_slope.T * (self.weight * self.bending)) @ self.angle_slope
        self.from_bending = inverse_angle @ bending
        self.drive = moment * inverse_angle[:, 0]

    @staticmethod
    def _restricted_inverse(matrix: np.ndarray, free: np.ndarray) -> np.ndarray:
        inverse = np.zeros_like(matrix)
        inverse[np.ix_(free, free)] = np.linalg.inv(matrix[np.ix_(free, free)])
        return inverse

    def _assemble(self, rods: list[Rod], n_elements: int, degree: int) -> None:
        """Dense mass matrices and the maps from nodal values to quadrature points."""
        inner = np.sort(Legendre.basis(degree).deriv().roots().real)
        nodes = np.concatenate([[-1.0], inner, [1.0]])
        points, weights = leggauss(degree)
        N, D = _lagrange(nodes, points)
        mass_points, mass_weights = leggauss(degree + 1)
        N_mass, _ = _lagrange(nodes, mass_points)
        consistent = N_mass.T @ (mass_weights[:, None] * N_mass)
        n_points = len(rods) * n_elements * degree
        self.slope = np.zeros((n_points, self.n))
        self.angle = np.zeros((n_points, self.n_angles))
        self.angle_slope = np.zeros((n_points, self.n_angles))
        self.weight, self.axial, self.shear, self.bending = np.zeros((4, n_points))
        self.mass = np.zeros((self.n, self.n))
        self.rotary = np.zeros((self.n_angles, self.n_angles))
        self.start = np.zeros(self.n)
        for k in range(len(rods) * n_elements):
            i, e = divmod(k, n_elements)
            rod, half = rods[i], rods[i].length / n_elements / 2
            at = slice(k * degree, (k + 1) * degree)
            x = slice(k * degree, (k + 1) * degree + 1)
            a = slice(x.start + i, x.stop + i)
            self.slope[at, x] = D / half
            self.angle[at, a], self.angle_slope[at, a] = N, D / half
            self.weight[at] = half * weights
            self.axial[at], self.shear[at], self.bending[at] = rod.axial, rod.shear, rod.bending
            self.mass[x, x] += rod.mass * half * consistent
            self.rotary[a, a] += rod.rotary * half * consistent
            offset = sum(r.length for r in rods[:i])
            self.start[x] = offset + half * (2 * e + 1 + nodes)

    def acceleration(self, q: np.ndarray) -> np.ndarray:
        """Second derivative of q = (first coordinates, second coordinates, angles)."""
        x, y, angle = q[: self.n], q[self.n : 2 * self.n], q[2 * self.n :]
        dx, dy, theta = self.slope @ x, self.slope @ y, self.angle @ angle
        c, s = np.cos(theta), np.sin(theta)
        along = self.axial * (c * dx + s * dy - 1.0)
        across = self.shear * (c * dy - s * dx)
        nx, ny = c * along - s * across, s * along + c * across
        return np.concatenate(
            [
                -(self.from_force_x @ nx),
                self.weight_y - self.from_force_y @ ny,
                self.drive - self.from_bending @ angle + self.from_couple @ (dx * ny - dy * nx),
            ]
        )

    def integrate(self, times: np.ndarray, tolerance: float) -> Iterator[State]:
        """Yield the states at the given times (ascending, from 0).

        Args:
            times: s.
            tolerance: Relative and absolute tolerance of DOP853 for all unknowns.

        Raises:
            RuntimeError: If the integrator gives up.
        """
        q = np.concatenate([self.start, np.zeros(self.n + self.n_angles)])
        size, n, k = len(q), self.n, 0

        def rate(_: float, z: np.ndarray) -> np.ndarray:
            return np.concatenate([z[size:], self.acceleration(z[:size])])

        initial = np.concatenate([q, np.zeros(size)])
        solver = DOP853(rate, 0.0, initial, times[-1], rtol=tolerance, atol=tolerance)
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"DOP853 failed at t = {solver.t:g} s")
            dense = solver.dense_output() if k < len(times) and times[k] <= solver.t else None
            while dense is not None and k < len(times) and times[k] <= solver.t:
                z = dense(times[k])
                position = np.column_stack([z[:n], z[n : 2 * n]])
                velocity = np.column_stack([z[size : size + n], z[size + n : size + 2 * n]])
                yield State(float(times[k]), position, velocity)
                k += 1
