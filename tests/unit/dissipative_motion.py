"""Motions of points with masses in contact with dissipation, by the split scheme with rho = 1."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from flexfem.contact.dissipation.data import Groups, Law, StepMotion
from flexfem.contact.dissipation.rows import (
    add_friction,
    add_friction_actions,
    motions_into,
    spread,
)
from flexfem.contact.dissipation.steps import dissipate
from flexfem.contact.dissipation.tilts import Tilts, add_spins, place_tilts, spread_couples
from flexfem.contact.primitives.barrier import slope
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.data import Response
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.steps import forces_of_step
from flexfem.contact.primitives.tangents import add_actions, add_forces, potential
from tests.called import called
from tests.unit.primitive_pairs import surface_of

GRAVITY = 9.81


def law(damping=0.0, friction=0.0, static=None, slow=1e-3):
    """A law without losses but for what is given."""
    return Law(
        damping=damping, friction=friction, slip_speed=slow, stribeck_speed=1e-2,
        static_friction=friction if static is None else static,
    )  # fmt: skip


def all_spins(tilts, steps, phi):
    """Spins of points with inertia, and those of shells."""
    spins = phi.copy()
    if tilts is not None:
        add_spins(tilts.memory, steps, spins)
    return spins


@dataclass
class Points:
    """Points with masses (n,), infinite where they are held, and inertias of spheres (n,) or 0.

    Attributes:
        exact: False for the tangent of the solver's rows.
        iterations: of Newton's method in steps with contact.
        losses: of all steps, by normal laws and by friction.
    """

    surface: object
    law: Law
    x: np.ndarray
    v: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    g: np.ndarray = field(default_factory=lambda: np.zeros(3))
    tilts: Tilts | None = None
    exact: bool = True
    iterations: list = field(default_factory=list)
    losses: list = field(default_factory=list)

    def __post_init__(self):
        self.touching = ~np.eye(self.surface.label.max() + 1, dtype=bool)
        self.near = Neighbourhoods.of(self.surface, self.x, self.touching)
        self.spin, self.stored = np.zeros_like(self.x), 0.0
        self.free, self.round = np.flatnonzero(np.isfinite(self.mass)), np.flatnonzero(self.inertia)
        self.masses = np.concatenate([self.mass[self.free], self.inertia[self.round]]).repeat(3)

    @property
    def kinetic(self):
        """Kinetic energy."""
        return 0.5 * self.masses @ self._unknowns(self.v, self.spin) ** 2

    def momenta(self):
        """Linear and angular momentum."""
        p = self.mass[:, None] * self.v
        return np.concatenate([p.sum(0), np.cross(self.x, p).sum(0)])

    def _unknowns(self, points, spheres):
        return np.concatenate([points[self.free].ravel(), spheres[self.round].ravel()])

    def _vectors(self, unknowns):
        points, spheres = np.zeros((2, *self.x.shape))
        points[self.free] = unknowns[: 3 * len(self.free)].reshape(-1, 3)
        spheres[self.round] = unknowns[3 * len(self.free) :].reshape(-1, 3)
        return points, spheres

    def _spread(self, forces, couples):
        if self.tilts is not None:
            spread_couples(self.tilts.memory, couples, forces)
        return self._unknowns(forces, couples)

    def forces(self, y, phi, h):
        """Forces and couples of a trial state."""
        if self.tilts is not None:
            place_tilts(self.tilts.memory, 0.5 * (self.x + y))
        self.motion = StepMotion(
            before=self.x, after=y, spins=all_spins(self.tilts, y - self.x, phi), rates=self.v,
            spin_rates=all_spins(self.tilts, self.v, self.spin), radius=self.surface.radius, dt=h,
        )  # fmt: skip
        pairs, response = self.pairs.memory, self.response.memory
        forces_of_step(pairs, self.x, y, response)
        dissipate(pairs, response, self.law.memory, self.motion.memory, self.groups.memory)
        forces, couples = np.zeros((2, *y.shape))
        add_forces(pairs, response, 1.0, forces)
        add_friction(self.groups.memory, 1.0, forces, couples)
        return self._spread(forces, couples)

    def action(self, unknowns):
        """Minus the derivative of forces and couples along a step, exact or of the rows."""
        (steps, phi), (sums, couples) = self._vectors(unknowns), np.zeros((2, *self.x.shape))
        spins, groups = all_spins(self.tilts, steps, phi), self.groups.memory
        if self.exact:
            add_actions(self.pairs.memory, self.response.memory, 1.0, steps, sums)
            add_friction_actions(groups, 1.0, steps, spins, sums, couples)
        else:
            motions = np.zeros_like(self.groups.slopes)
            motions_into(groups, steps, spins, motions)
            spread(groups, motions * self.groups.slopes, sums, couples)
        return self._spread(sums, couples)

    def prepare(self, ahead):
        """Find the pairs of a step."""
        motion = Motion(self.x, ahead, self.surface.dhat.max())
        here = np.ones(len(self.x), bool)
        self.pairs = find_pairs(self.surface, self.near, motion, self.touching, here)
        self.response, self.groups = Response.of(self.pairs), Groups.of(self.pairs)

    def step(self, h):
        """One step."""
        fall = np.isfinite(self.mass)[:, None] * self.g
        ahead, phi = self.x + h * self.v + 0.5 * h * h * fall, h * self.spin
        self.prepare(ahead)
        m, aim, pairs = 2.0 / h**2 * self.masses, self._unknowns(ahead, phi), self.pairs.memory
        y = self.x + safe_part(pairs, self.x, ahead, 0.1) * (ahead - self.x)
        for iteration in range(40):  # noqa: B007 # counted below
            f = self.forces(y, phi, h)
            d = (f - m * (self._unknowns(y, phi) - aim)) / m
            if self.groups.count[0]:
                K = np.column_stack([self.action(one) for one in np.eye(len(m))])
                d = np.linalg.solve(np.diag(m) + K, m * d)
            move, turn = self._vectors(d)
            part = safe_part(pairs, y, y + move, 0.1)
            y, phi = y + part * move, phi + part * turn
            if np.abs(d).max() < 1e-13 * max(1.0, np.abs(y).max()):
                break
        else:
            raise AssertionError("Newton's method does not end")
        dv, dw = self._vectors(h * self.forces(y, phi, h) / self.masses)
        self.x, self.v, self.spin = y, self.v + h * fall + dv, self.spin + dw
        self.stored = potential(self.response.memory)
        self.losses.append(self.groups.losses.copy())
        if self.groups.count[0]:
            self.iterations.append(iteration + 1)


def rest_gap(weight, area, dhat, kappa):
    """Gap at which a point with an area bears a weight."""
    force = called(slope)
    return brentq(lambda g: -area * force(g, dhat, kappa) - weight, 1e-9 * dhat, (1 - 1e-9) * dhat)


def over_plane(places, radius, dhat, kappa, mass, law, size=50.0):
    """Spheres of one body, at places (k, 2), that rest on a plane under gravity."""
    k = len(places)
    x = np.zeros((3 + k, 3))
    x[:3, :2] = size * np.array([[-1, -1], [1, -1], [0, 1]])
    x[3:, :2] = places
    label, area = np.repeat([0, 1], [3, k]), np.repeat([0.0, 1.0], [3, k])
    surface = surface_of(x, [[0, 1, 2]], label=label, radius=0.0, dhat=dhat, area=area)
    surface.radius[3:], surface.kappa[:] = radius, kappa
    gap = rest_gap(mass * GRAVITY, 1.0, dhat, kappa)
    x[3:, 2] = radius + gap
    masses = np.repeat([np.inf, mass], [3, k])
    inertia = np.repeat([0.0, 0.4 * mass * radius**2], [3, k])
    return Points(surface, law, x, np.zeros_like(x), masses, inertia, np.array([0, 0, -GRAVITY]))
