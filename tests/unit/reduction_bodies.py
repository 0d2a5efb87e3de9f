# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small bodies for tests of the reduction, and what their reduced data must agree in."""

from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
from dolfinx import mesh

import flexfem as ff

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
LENGTH = 1.0
SECTION = ff.Section.rectangle(0.03, 0.02, STEEL)


def at(axis: int, value: float) -> Any:
    """Facets in a plane."""
    return lambda x: np.isclose(x[axis], value)


ENDS = {"left": at(0, 0.0), "right": at(0, LENGTH)}
NODES = {"left": (0.0, 0.0, 0.0), "right": (LENGTH, 0.0, 0.0)}


def beam(cells: int = 8, section: ff.Section = SECTION, comm: Any = MPI.COMM_WORLD) -> Any:
    """Straight beam along x."""
    return ff.beam_body(
        np.linspace([0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0], cells + 1), section, comm=comm
    )


def box(
    cells: tuple[int, int, int] = (8, 1, 1),
    low: Any = (0.0, -0.05, -0.04),
    high: Any = (LENGTH, 0.05, 0.04),
    comm: Any = MPI.COMM_WORLD,
    degree: int = 2,
    kind: Any = mesh.CellType.hexahedron,
) -> Any:
    """Solid box."""
    return ff.solid_body(mesh.create_box(comm, [low, high], cells, kind), STEEL, degree)


def sheet(
    cells: tuple[int, int], size: tuple[float, float], comm: Any = MPI.COMM_WORLD, turn: Any = None
) -> Any:
    """Triangles of a rectangle in the plane z = 0, or rotated."""
    x, y = (np.linspace(0.0, s, n + 1) for s, n in zip(size, cells, strict=True))
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))], axis=-1)
    i, j = (k.ravel() for k in np.meshgrid(*map(np.arange, cells), indexing="ij"))
    a = i * len(y) + j
    b = a + len(y)
    corners = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    places = points.reshape(-1, 3) if turn is None else points.reshape(-1, 3) @ turn.T
    share = np.array_split(np.arange(len(corners)), comm.size)[comm.rank]
    own = np.array_split(np.arange(len(places)), comm.size)[comm.rank]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
    return mesh.create_mesh(comm, corners[share].astype(np.int64), element, places[own])


def frequencies(body: ff.ReducedBody, held: Any = (), spin: Any = None) -> Any:
    """Frequencies of the reduced body, some coordinates fixed, rad/s."""
    import scipy.linalg

    free = np.setdiff1d(np.arange(body.size), held)
    free = free[~np.isin(free, np.flatnonzero(body.held))]
    at = np.ix_(free, free)
    stiffness = body.stiffness if spin is None else body.stiffness + spin
    squares = scipy.linalg.eigvalsh(stiffness[at], body.mass_matrix[at])
    return np.sqrt(np.maximum(squares, 0.0))


def differences(first: ff.ReducedBody, second: ff.ReducedBody) -> dict[str, float]:
    """Largest differences of all arrays, relative to their largest values."""
    found = {}
    for name in (
        "moments", "products", "stiffness", "damping", "frequencies", "acceleration_stiffness",
        "interface_stiffness",
    ):  # fmt: skip
        a, b = getattr(first, name), getattr(second, name)
        if a is not None:
            found[name] = float(np.abs(a - b).max(initial=0.0) / (np.abs(a).max(initial=0.0) or 1))
    return found
