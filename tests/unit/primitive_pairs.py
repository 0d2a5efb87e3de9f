"""Pairs of primitives for tests."""

import numpy as np

from flexfem.contact.obstacles.surface_data import node_areas
from flexfem.contact.primitives.complexes import Complex, Surface
from flexfem.contact.primitives.data import Kind, Pairs, Response
from flexfem.contact.primitives.statics import forces_at_rest
from flexfem.contact.primitives.steps import forces_of_step
from flexfem.contact.primitives.tangents import add_forces

#: Points of each kind of pair, as its own.
POINTS = np.array([[0, 1, 1, 1], [0, 1, 2, 2], [0, 1, 2, 3], [0, 1, 2, 3], [0, 1, 2, 2],
                   [0, 0, 1, 1]])  # fmt: skip
KINDS = list(Kind)


def alone(kind, touch=0.1, dhat=0.5):
    """Pairs (m,) of kinds, each with four points of its own, and a group of its own."""
    kind = np.asarray(kind, np.int64)
    m = len(kind)
    points = POINTS[kind] + 4 * np.arange(m)[:, None]
    weight = np.linspace(0.5, 2.0, m)
    return Pairs(
        kind=kind, points=points, weight=weight, touch=np.full(m, touch), dhat=np.full(m, dhat),
        kappa=np.full(m, 3.0), starts=np.arange(m + 1), keys=np.arange(m),
    )  # fmt: skip


def surface_of(points, triangles, lines=(), label=None, radius=0.01, dhat=0.05, area=None):
    """All triangles and edges of polylines at points (n, 3) with the same radius and gap."""
    n = len(points)
    cells = Complex.of(np.reshape(triangles, (-1, 3)), np.reshape(lines, (-1, 2)), np.arange(n))
    label = np.zeros(n, np.int64) if label is None else label
    area = node_areas(points, cells.vertices[cells.triangles]) if area is None else area
    return Surface(cells, label, np.full(n, radius), np.full(n, dhat), np.full(n, 1e4), area)


def at_rest(pairs, points):
    """Forces (n, 3) and the response at positions (n, 3)."""
    response, sums = Response.of(pairs), np.zeros_like(points)
    forces_at_rest(pairs.memory, points, np.zeros(pairs.count), 0.0, response.memory)
    add_forces(pairs.memory, response.memory, 1.0, sums)
    return sums, response


def of_step(pairs, before, after):
    """Forces (n, 3) and the response of a step."""
    response, sums = Response.of(pairs), np.zeros_like(before)
    forces_of_step(pairs.memory, before, after, response.memory)
    add_forces(pairs.memory, response.memory, 1.0, sums)
    return sums, response
