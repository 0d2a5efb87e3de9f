"""Masses and springs in contact: generalized-alpha with the contact as an impulse.

A step solves, with n the increment, the equations of generalized-alpha with the forces of contact
multiplied by b'/(2 beta), b' = (1 - alpha_m) / (1 - alpha_f). Their impulse W changes velocities,
and half of it times h the positions that the scheme takes for its own: energy is kept if the forces
do the work of their potential over the step.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from flexfem.contact.obstacles.surface_data import node_areas
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.complexes import Complex, Surface, lengths
from flexfem.contact.primitives.data import GAP, Response
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.statics import forces_at_rest
from flexfem.contact.primitives.steps import forces_of_step
from flexfem.contact.primitives.tangents import add_forces, blocks_into, potential

RADIUS = 0.02
STIFFNESS, MASS = 2e3, 0.1


@dataclass
class Record:
    """What a motion did: energies over the first kinetic one, gaps, N s, N m s, iterations."""

    gain: float = -np.inf
    end: float = 0.0
    gap: float = np.inf
    impulse: float = 0.0
    torque: float = 0.0
    momentum: float = 0.0
    iterations: list = field(default_factory=list)


class Springs:
    """Masses at points (n, 3) and the same springs along all edges, of several bodies.

    Args:
        points, velocities: of the masses.
        triangles, lines: points of triangles (t, 3), and of edges of polylines (l, 2).
        label: body of each point.
        touching: bodies that touch.
        kappa: stiffness of the barrier between two bodies.
    """

    def __init__(self, points, velocities, triangles, lines, label, touching, kappa=3e7):
        self.x, self.v = points, np.asarray(velocities, float)
        n, cells = len(points), Complex.of(triangles, lines, np.zeros(0, np.int64))
        graph = np.zeros((n, n))
        for i, j in cells.edges:
            graph[[i, j], [i, j]] += STIFFNESS
            graph[[i, j], [j, i]] -= STIFFNESS
        self.stiffness, self.rest = np.kron(graph, np.eye(3)), points.copy()
        self.mass = np.repeat(MASS / np.bincount(label)[label], 3)
        area = node_areas(points, cells.triangles) + 2 * RADIUS * lengths(points, np.asarray(lines))
        self.surface = Surface(
            cells, label, np.full(n, RADIUS), np.full(n, RADIUS), np.full(n, 2 * kappa), area
        )
        self.touching = touching
        self.near = Neighbourhoods.of(self.surface, points, touching)

    @classmethod
    def strings(cls, strings, velocities, itself=False):
        """Straight or curved strings (k, 3), each with one velocity; they touch each other."""
        sizes = [len(x) for x in strings]
        spans = pairwise(np.cumsum([0, *sizes]))
        lines = np.concatenate([np.arange(i, j - 1)[:, None] + [0, 1] for i, j in spans])
        touching = ~np.eye(len(strings), dtype=bool) | itself
        label, none = np.repeat(np.arange(len(sizes)), sizes), np.zeros((0, 3), np.int64)
        v = np.repeat(velocities, sizes, axis=0)
        return cls(np.concatenate(strings), v, none, lines, label, touching)

    def pairs(self, before, after, skin):
        motion, here = Motion(before, after, skin), np.ones(len(before), bool)
        return find_pairs(self.surface, self.near, motion, self.touching, here)

    def energy(self, x, v):
        """Energy and smallest gap."""
        pairs = self.pairs(x, x, 0.0)
        response = Response.of(pairs)
        forces_at_rest(pairs.memory, x, np.zeros(pairs.count), 0.0, response.memory)
        u = (x - self.rest).ravel()
        elastic = 0.5 * u @ self.stiffness @ u + potential(response.memory)
        kinetic = 0.5 * self.mass @ v.ravel() ** 2
        return kinetic + elastic, response.rows()[1][:, GAP].min(initial=np.inf)

    def run(self, h, rho, until):
        """Move on; returns a record."""
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma = 0.5 + af - am
        beta = 0.25 * (gamma + 0.5) ** 2
        b = (1 - am) / (1 - af)
        kept = lu_factor(np.diag(self.mass) * b / (beta * h * h) + self.stiffness)
        x, v, out = self.x.copy(), self.v.copy(), Record()
        a, rate = np.zeros_like(x), np.zeros_like(x)
        mass, (start, _) = self.mass.reshape(-1, 3), self.energy(x, v)
        first, scale = (mass * v).sum(0), start
        for _ in range(round(until / h)):
            ahead, fast = x + h * v + h * h * (0.5 - beta) * a, v + h * (1 - gamma) * a
            pairs = self.pairs(x, ahead, 0.5 * RADIUS)
            response, f = Response.of(pairs), np.zeros_like(x)
            y = x + safe_part(pairs.memory, x, ahead, 0.1) * (ahead - x)
            for iteration in range(60):  # noqa: B007 # counted below
                forces_of_step(pairs.memory, x, y, response.memory)
                f[:] = 0.0
                add_forces(pairs.memory, response.memory, 1.0, f)
                inertia = b * (y - ahead) / (beta * h * h) + (am * a - af * rate) / (1 - af)
                r = mass * inertia - b / (2 * beta) * f
                r = r.ravel() + self.stiffness @ (y - self.rest).ravel()
                d = _newton(kept, pairs, response, b / (2 * beta), r).reshape(-1, 3)
                y = y - safe_part(pairs.memory, y, y - d, 0.1) * d
                if np.abs(d).max() < 1e-12:
                    break
            w, torque = h * f / mass, np.cross(0.5 * (x + y), h * f).sum(0)
            a1 = (y - 0.5 * h * w - ahead) / (beta * h * h)
            v = fast + h * gamma * a1 + w
            rate, x, a = ((1 - am) * a1 + am * a - af * rate) / (1 - af), y, a1
            energy, gap = self.energy(x, v)
            out.end, out.gap = (energy - start) / scale, min(out.gap, gap)
            out.gain = max(out.gain, out.end)
            out.impulse = max(out.impulse, h * np.abs(f).max())
            out.torque = max(out.torque, np.abs(torque).max())
            if response.count[0]:
                out.iterations.append(iteration + 1)
        out.momentum = np.abs((mass * v).sum(0) - first).max() / np.abs(first).max()
        return out


def _newton(kept, pairs, response, scale, r):
    """A step of Newton's method with kept factors and the tangents of contacts."""
    rows = response.rows()[0]
    d = lu_solve(kept, r)
    at = (3 * pairs.points[rows][:, :, None] + np.arange(3)).reshape(len(rows), 12)
    touched = np.unique(at)
    if len(touched):
        blocks = np.empty((len(rows), 12, 12))
        blocks_into(response.memory, scale, blocks)
        place, k = np.searchsorted(touched, at), np.zeros((len(touched), len(touched)))
        np.add.at(k, (place[:, :, None], place[:, None, :]), blocks)
        responses = lu_solve(kept, np.eye(len(r))[:, touched])
        reduced = np.eye(len(touched)) + k @ responses[touched]
        d -= responses @ np.linalg.solve(reduced, k @ d[touched])
    return d
