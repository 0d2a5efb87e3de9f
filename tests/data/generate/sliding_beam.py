# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference motion of the sliding beam: ``python tests/data/generate/sliding_beam.py``.

Data of cases/sliding_beam.py (Wu et al., Appl. Sci. 10 (2020) 1231). Nothing is shared with
flexfem: both rods are fields of positions x(s) and of section normals d(s), |d| = 1, in inertial
axes; this is the Simo-Reissner rod of equal stiffness in both directions, without twist,

    2 W = (EA - GA) (d . x' - 1)^2 + GA |x' - d|^2 + EI |d'|^2.

Twist may be left out: the ends and the contact exert no moment along the axis, and the moment of
bending is parallel to the curvature, so that no twisting moment arises and the spin of the sections
about their normals has no influence. x and d are B-splines of full continuity, |d| = 1 holds at the
Greville points, the slider at the arc length zeta of the carrier obeys x_A = x_B(zeta) and
x_B'(zeta) . lambda = 0. The mass matrix is constant; generalized-alpha on the index-3 equations.
Writing the table takes some minutes; ``--study`` prints other meshes and steps instead.
"""

import argparse
import time
from dataclasses import dataclass, field

import numpy as np
import scipy  # type: ignore[import-untyped]
from reference_csv import write
from scipy.interpolate import BSpline  # type: ignore[import-untyped]
from scipy.sparse import (  # type: ignore[import-untyped]
    block_array,
    block_diag,
    csr_array,
    diags_array,
    eye_array,
    kron,
)
from scipy.sparse.linalg import SuperLU, splu  # type: ignore[import-untyped]

SIDE, YOUNG, POISSON, DENSITY = 0.01, 2e8, 0.3, 800.0
GRAVITY, TIP_MASS = np.array([0.0, 0.0, -9.81]), 1.0
A, B, M = np.array([0.0, 3.0, 1.0]), np.array([0.0, 0.0, 0.0]), np.array([1.0, 3.0, 1.0])
EA, EI = YOUNG * SIDE**2, YOUNG * SIDE**4 / 12.0
GA = 5.0 / 6.0 * EA / (2.0 * (1.0 + POISSON))
MASS, ROTARY = DENSITY * SIDE**2, DENSITY * SIDE**4 / 12.0
LENGTH = float(np.linalg.norm(B - A))
SAMPLE, SPECTRAL_RADIUS, TOLERANCE = 0.01, 0.8, 1e-9
COLUMNS = ["t", "mass_x", "mass_y", "mass_z", "zeta"]


class Rod:
    """Initially straight rod; its unknowns are all control positions, then all control normals.

    Args:
        start: First end, m.
        end: Second end, m.
        n_elements: Knot spans.
        degree: Of the B-splines; the quadrature has a point more.
    """

    def __init__(self, start: np.ndarray, end: np.ndarray, n_elements: int, degree: int) -> None:
        length = float(np.linalg.norm(end - start))
        self.degree, self.n = degree, n_elements + degree
        spans = np.linspace(0.0, length, n_elements + 1)
        self.knots = np.concatenate([[0.0] * degree, spans, [length] * degree])
        # A linear field has its values at the Greville points as control values.
        greville = np.array([self.knots[i + 1 : i + degree + 1].mean() for i in range(self.n)])
        tangent = (end - start) / length
        line = start + greville[:, None] * tangent
        self.start = np.concatenate([line.ravel(), np.tile(tangent, self.n)])
        points, weights = np.polynomial.legendre.leggauss(degree + 1)
        half = length / n_elements / 2.0
        self.weights = np.tile(half * weights, n_elements)
        s = (spans[:-1, None] + half * (1.0 + points)).ravel()
        N, D, eye = self._values(s), self._values(s, 1), eye_array(3)
        scalar = N.T @ diags_array(self.weights) @ N
        self.mass = block_diag([kron(MASS * scalar, eye), kron(ROTARY * scalar, eye)])
        rows = [[kron(D, eye), None], [None, kron(N, eye)], [None, kron(D, eye)]]
        self.to_points = block_array(rows, format="csr")
        self.load = np.zeros(6 * self.n)
        self.load[: 3 * self.n] = np.kron(MASS * scalar.sum(0), GRAVITY)
        unused = csr_array((3 * self.n, 3 * self.n))
        self.normals = block_array([[unused, kron(self._values(greville), eye)]], format="csr")

    def _values(self, s: np.ndarray, derivative: int = 0) -> csr_array:
        """All basis functions at s, shape (len(s), n)."""
        return csr_array(BSpline(self.knots, np.eye(self.n), self.degree)(s, derivative))

    def at(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Control points that matter at s; their functions and two derivatives, (3, degree + 1)."""
        p = self.degree
        # The last polynomial continues a little beyond the end.
        span = int(np.clip(np.searchsorted(self.knots, s, side="right") - 1, p, self.n - 1))
        basis = BSpline(self.knots[span - p : span + p + 2], np.eye(p + 1), p)
        return np.arange(span - p, span + 1), np.array([basis(s, i) for i in range(3)])

    def _fields(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x', d and d' at the quadrature points, each (points, 3)."""
        slope, normal, bend = (self.to_points @ q).reshape(3, -1, 3)
        return slope, normal, bend

    def force(self, q: np.ndarray) -> np.ndarray:
        """Gradient of the strain energy."""
        slope, normal, bend = self._fields(q)
        axial = (EA - GA) * ((normal * slope).sum(1, keepdims=True) - 1.0)
        shear = GA * (slope - normal)
        stress = np.concatenate([axial * normal + shear, axial * slope - shear, EI * bend])
        weighted = stress.ravel() * np.tile(np.repeat(self.weights, 3), 3)
        force: np.ndarray = self.to_points.T @ weighted
        return force

    def stiffness(self, q: np.ndarray) -> csr_array:
        """Second derivatives of the strain energy."""
        slope, normal, _ = self._fields(q)
        axial = (EA - GA) * ((normal * slope).sum(1)[:, None, None] - 1.0)
        eye = np.eye(3)
        outer = (EA - GA) * normal[:, :, None]
        slopes = self._diagonal(outer * normal[:, None, :] + GA * eye)
        mixed = self._diagonal(outer * slope[:, None, :] + (axial - GA) * eye)
        normals = self._diagonal((EA - GA) * slope[:, :, None] * slope[:, None, :] + GA * eye)
        bending = diags_array(EI * np.repeat(self.weights, 3))
        rows = [[slopes, mixed, None], [mixed.T, normals, None], [None, None, bending]]
        return self.to_points.T @ block_array(rows, format="csr") @ self.to_points

    def _diagonal(self, blocks: np.ndarray) -> csr_array:
        """Weighted blocks (points, 3, 3) along a diagonal."""
        weighted = self.weights[:, None, None] * blocks
        n = len(weighted)
        columns = np.repeat(np.arange(3 * n).reshape(n, 1, 3), 3, axis=1)
        return csr_array((weighted.ravel(), columns.ravel(), np.arange(0, 9 * n + 1, 3)))


@dataclass
class Contact:
    """The slider on the carrier: distance, its Jacobian, the carrier's slope and its derivative."""

    gap: np.ndarray
    jacobian: csr_array
    slope: np.ndarray
    bend: np.ndarray
    slope_jacobian: csr_array


@dataclass
class State:
    """Unknowns, rates, the algorithmic acceleration, arc length and multipliers."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    algorithmic: np.ndarray
    zeta: float
    zeta_rate: float
    units: np.ndarray
    force: np.ndarray


@dataclass
class Motion:
    """Rows of the table (one per step) and contact forces (n, 3); time of arrival, s."""

    rows: list[list[float]] = field(default_factory=list)
    forces: list[np.ndarray] = field(default_factory=list)
    arrival: float = np.nan


class SlidingBeam:
    """Carrier and slider in steps of equal size.

    Args:
        n_carrier: Elements of the carrier.
        n_slider: Elements of the slider.
        degree: Of both.
        h: Step, s.
    """

    def __init__(self, n_carrier: int, n_slider: int, degree: int, h: float) -> None:
        self.carrier, slider = Rod(A, B, n_carrier, degree), Rod(A, M, n_slider, degree)
        self.rods, self.h = (self.carrier, slider), h
        self.split = 6 * self.carrier.n
        n = self.split + 6 * slider.n
        self.tip = self.split + 3 * (slider.n - 1) + np.arange(3)
        weight = np.zeros(n)
        weight[self.tip] = TIP_MASS
        self.mass = csr_array(block_diag([rod.mass for rod in self.rods]) + diags_array(weight))
        self.load = np.concatenate([rod.load for rod in self.rods])
        self.load[self.tip] += TIP_MASS * GRAVITY
        self.normals = block_diag([rod.normals for rod in self.rods], format="csr")
        ends = [np.arange(3), 3 * (self.carrier.n - 1) + np.arange(3)]
        self.free = np.setdiff1d(np.arange(n), np.concatenate(ends))
        rho = SPECTRAL_RADIUS
        self.alpha_m, self.alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = 0.25 * (self.gamma + 0.5) ** 2
        self.scale = self.beta * h * h
        self.ratio = (1.0 - self.alpha_m) / (1.0 - self.alpha_f)
        self.factors: SuperLU | None = None
        self.state = self._start()

    def _force(self, q: np.ndarray) -> np.ndarray:
        parts = (q[: self.split], q[self.split :])
        inner = [rod.force(part) for rod, part in zip(self.rods, parts, strict=True)]
        total: np.ndarray = np.concatenate(inner) - self.load
        return total

    def _units(self, q: np.ndarray) -> tuple[np.ndarray, csr_array]:
        """|d|^2 - 1 at the Greville points and its Jacobian."""
        normals = self.normals @ q
        n = len(normals) // 3
        spread = csr_array((2.0 * normals, np.arange(3 * n), np.arange(0, 3 * n + 1, 3)))
        return (normals.reshape(n, 3) ** 2).sum(1) - 1.0, spread @ self.normals

    def _contact(self, q: np.ndarray, zeta: float) -> Contact:
        near, values = self.carrier.at(zeta)
        columns = 3 * near[:, None] + np.arange(3)
        place, slope, bend = values @ q[columns]
        end = self.split + np.arange(3)
        rows = np.tile(np.arange(3), len(near) + 1)
        shape = (3, len(q))
        data = np.concatenate([np.repeat(-values[0], 3), np.ones(3)])
        jacobian = csr_array((data, (rows, np.append(columns, end))), shape=shape)
        own = np.repeat(values[1], 3), (rows[:-3], columns.ravel())
        return Contact(q[end] - place, jacobian, slope, bend, csr_array(own, shape=shape))

    def _start(self) -> State:
        """Rest, with the accelerations and forces that belong to it."""
        q = np.concatenate([rod.start for rod in self.rods])
        free, zero = self.free, np.zeros_like(q)
        _, units = self._units(q)
        contact = self._contact(q, 0.0)
        slope = csr_array(-contact.slope[:, None])
        rows = [
            [self.mass[free][:, free], units[:, free].T, contact.jacobian[:, free].T, None],
            [units[:, free], None, None, None],
            [contact.jacobian[:, free], None, None, slope],
            [None, None, slope.T, None],
        ]
        matrix = block_array(rows, format="csc")
        right = np.zeros(matrix.shape[0])
        right[: len(free)] = -self._force(q)[free]
        found = splu(matrix).solve(right)
        a = zero.copy()
        a[free] = found[: len(free)]
        return State(q, zero, a, a, 0.0, 0.0, found[len(free) : -4], found[-4:-1])

    def _factorise(self, s: State) -> SuperLU:
        """Newton matrix with respect to positions, scaled multipliers and zeta."""
        free, h2 = self.free, self.scale
        parts = (s.q[: self.split], s.q[self.split :])
        inner = [rod.stiffness(part) for rod, part in zip(self.rods, parts, strict=True)]
        geometric = diags_array(np.repeat(2.0 * s.units, 3))
        stiffness = block_diag(inner) + self.normals.T @ geometric @ self.normals
        dynamic = csr_array(h2 * stiffness + self.ratio * self.mass)[free][:, free]
        units = self._units(s.q)[1][:, free]
        contact = self._contact(s.q, s.zeta)
        jacobian, slope = contact.jacobian[:, free], csr_array(-contact.slope[:, None])
        along = csr_array(-h2 * (contact.slope_jacobian.T @ s.force)[free][:, None])
        bend = csr_array([[-h2 * (s.force @ contact.bend)]])
        rows = [
            [dynamic, units.T, jacobian.T, along],
            [units, None, None, None],
            [jacobian, None, None, slope],
            [along.T, None, slope.T, bend],
        ]
        return splu(block_array(rows, format="csc"))

    def _residual(self, s: State) -> np.ndarray:
        gap, units = self._units(s.q)
        contact = self._contact(s.q, s.zeta)
        force = self.mass @ s.a + self._force(s.q)
        force += units.T @ s.units + contact.jacobian.T @ s.force
        along = -self.scale * (s.force @ contact.slope)
        return np.concatenate([self.scale * force[self.free], gap, contact.gap, [along]])

    def _move(self, s: State, dq: np.ndarray) -> None:
        """Change the positions and with them velocities and accelerations."""
        s.q = s.q + dq
        s.v = s.v + self.gamma / (self.beta * self.h) * dq
        s.algorithmic = s.algorithmic + dq / self.scale
        s.a = s.a + self.ratio / self.scale * dq

    def _predict(self) -> State:
        """Acceleration and rate of zeta as in the last step."""
        h, beta, gamma, old = self.h, self.beta, self.gamma, self.state
        algorithmic = self.alpha_f * old.a - self.alpha_m * old.algorithmic
        algorithmic = algorithmic / (1.0 - self.alpha_m)
        q = old.q + h * old.v + h * h * ((0.5 - beta) * old.algorithmic + beta * algorithmic)
        v = old.v + h * ((1.0 - gamma) * old.algorithmic + gamma * algorithmic)
        zeta = old.zeta + h * old.zeta_rate
        new = State(q, v, 0.0 * q, algorithmic, zeta, 0.0, old.units, old.force)
        self._move(new, self.scale / self.ratio * old.a)
        return new

    def step(self) -> None:
        """One step.

        Raises:
            RuntimeError: The iteration does not converge.
        """
        new, last = self._predict(), np.inf
        n, n_units = len(self.free), len(self.state.units)
        for iteration in range(40):
            # The matrix is kept as long as it serves.
            if self.factors is None or iteration in (6, 12, 18):
                self.factors = self._factorise(new)
            change = self.factors.solve(-self._residual(new))
            dq = np.zeros_like(new.q)
            dq[self.free] = change[:n]
            self._move(new, dq)
            new.units = new.units + change[n : n + n_units] / self.scale
            new.force = new.force + change[n + n_units : -1] / self.scale
            new.zeta += float(change[-1])
            size = float(np.abs(dq).max() + abs(change[-1]))
            if size > 0.3 * last or iteration == 4:
                self.factors = None
            if size < TOLERANCE:
                new.zeta_rate = (new.zeta - self.state.zeta) / self.h
                self.state = new
                return
            last = size
        raise RuntimeError(f"no convergence with {self.carrier.n} control points, h = {self.h:g}")

    def run(self, t_end: float = 2.0) -> Motion:
        """Move until the slider is at B."""
        motion, t = Motion(), 0.0
        motion.rows.append([t, *M, 0.0])
        motion.forces.append(self.state.force)
        while self.state.zeta < LENGTH and t < t_end:
            self.step()
            t = len(motion.rows) * self.h
            motion.rows.append([t, *self.state.q[self.tip], self.state.zeta])
            motion.forces.append(self.state.force)
        last = np.array(motion.rows[-4:])
        motion.arrival = float(np.polyval(np.polyfit(last[:, 4] - LENGTH, last[:, 0], 3), 0.0))
        return motion


def computed(n_carrier: int, n_slider: int, degree: int, h: float) -> Motion:
    """Run one discretisation and print what comes out."""
    begin = time.perf_counter()
    motion = SlidingBeam(n_carrier, n_slider, degree, h).run()
    late = ", ".join(f"{x:.6f}" for x in motion.rows[round(1.0 / h)][1:])
    took = f"({time.perf_counter() - begin:.0f} s)"
    print(
        f"{n_carrier:4d} and {n_slider:2d} elements of degree {degree}, h = {h:<8g}: arrival at "
        f"{motion.arrival:.5f} s; mass and zeta at 1 s {late} {took}",
        flush=True,
    )
    return motion


def sampled(motion: Motion, h: float) -> np.ndarray:
    """Rows every 0.01 s."""
    return np.array(motion.rows)[: -1 : round(SAMPLE / h)]


def study() -> None:
    """Print meshes and steps up to those of the table."""
    for h in (1e-3, 5e-4, 2.5e-4):
        for n_carrier, n_slider in ((16, 2), (32, 4), (64, 8), (128, 16)):
            for degree in (2, 3):
                computed(n_carrier, n_slider, degree, h)
    for n_slider in (4, 8, 16):
        computed(16, n_slider, 2, 1e-3)


def apart(one: np.ndarray, other: np.ndarray) -> str:
    """Largest distances of the mass and of zeta of two tables, m."""
    mass = np.linalg.norm(one[:, 1:4] - other[:, 1:4], axis=1).max()
    return f"mass {mass:.0e} m, zeta {np.abs(one[:, 4] - other[:, 4]).max():.0e} m"


def generate() -> None:
    """Write the table from the finest run."""
    h = 1.25e-4
    finest, coarser = computed(256, 32, 3, h), computed(128, 16, 3, h)
    longer = computed(256, 32, 3, 2.0 * h)
    table = sampled(finest, h)
    mesh, step = apart(table, sampled(coarser, h)), apart(table, sampled(longer, 2.0 * h))
    version = f"scipy {scipy.__version__}"
    header = f"""Sliding beam (Wu et al., Appl. Sci. 2020, 10, 1231); data: cases/sliding_beam.py.
Position of the point mass and arc length from A to the slider on the undeformed carrier; s, m.
Source: tests/data/generate/sliding_beam.py, rods of positions and section normals without twist,
256 and 32 elements of degree 3, generalized-alpha {SPECTRAL_RADIUS}, h = {h:g} s, {version}.
Arrival at B: {finest.arrival:.5f} s.
Largest distances from 128 and 16 elements: {mesh}, arrival {coarser.arrival:.5f} s;
from h = {2.0 * h:g} s: {step}, arrival {longer.arrival:.5f} s."""
    write("sliding_beam", header, COLUMNS, table, 10)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--study", action="store_true", help="only print meshes and steps")
    if parser.parse_args().study:
        study()
    else:
        generate()


if __name__ == "__main__":
    main()
