# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of a body: displacement and rotation of their points by each coordinate."""

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, geometry

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.kernels.ffcx_options import compile_options
from flexfem.reduction.body_line import BodyLine
from flexfem.reduction.fem.body.blocks import set_rows
from flexfem.reduction.fem.body.linear_body import LinearBody

__all__ = ["trace"]

#: Distance of a point from the mesh, relative to the length of its line, that counts as none.
_GAP = 1e-6
#: Degree of the fields on a cell: the cubic displacements of beams are the highest.
_DEGREE = 3


def trace(
    owner: str, body: LinearBody, functions: FloatArray, name: str, points: FloatArray
) -> BodyLine:
    """Motion of the points of a line, the same on every rank (collective).

    Args:
        owner: for messages.
        body: the body.
        functions: this rank's rows of the displacement functions (rows, n).
        name: of the line.
        points: (p, 3) along it, body axes, m.

    Raises:
        ValueError: the points of the body have no rotations, or a point is not in it.
    """
    if body.rotation is None:
        raise ValueError(f'{owner}: line "{name}" needs the rotation of a LinearBody')
    assert body.displacement is not None
    domain = body.space.mesh
    mine, cells = _located(f'{owner}: line "{name}"', body, points)
    n = functions.shape[1]
    state = fem.Function(body.space)
    field = fem.Function(fem.functionspace(domain, ("Discontinuous Lagrange", _DEGREE, (3,))))
    at = field.function_space.element.interpolation_points
    how = compile_options(domain.comm)
    values = np.zeros((2, len(points), 3, n))
    sources = [fem.Expression(of(state), at, **how) for of in (body.displacement, body.rotation)]
    for j in range(n):
        set_rows(state, functions[:, j])
        for k, source in enumerate(sources):
            field.interpolate(source)
            if len(mine):
                values[k, mine, :, j] = field.eval(points[mine], cells).reshape(-1, 3)
    domain.comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
    return BodyLine(points, values[0], values[1])


def _located(
    owner: str, body: LinearBody, points: FloatArray
) -> tuple[IntArray, npt.NDArray[np.int32]]:
    """Points that this rank evaluates, and the nearest of its cells to each (collective).

    Raises:
        ValueError: a point is not in the body.
    """
    domain, comm = body.space.mesh, body.space.mesh.comm
    dimension = domain.topology.dim
    own = np.arange(domain.topology.index_map(dimension).size_local, dtype=np.int32)
    gaps, nearest = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int32)
    if len(own):
        tree = geometry.bb_tree(domain, dimension, entities=own)
        midpoints = geometry.create_midpoint_tree(domain, dimension, own)
        nearest = geometry.compute_closest_entity(tree, midpoints, domain, points)
        gaps = np.sqrt(geometry.squared_distance(domain, dimension, nearest, points))
    best = np.empty_like(gaps)
    comm.Allreduce(gaps, best, op=MPI.MIN)
    room = _GAP * float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if (best > room).any():
        i = int(np.argmax(best))
        raise ValueError(
            f"{owner}: point {_checks.show(points[i].tolist())} is {best[i]:.3g} m away from the "
            "body"
        )
    rank = np.where(gaps <= best, comm.rank, comm.size)
    first = np.empty_like(rank)
    comm.Allreduce(rank, first, op=MPI.MIN)
    mine = np.flatnonzero(first == comm.rank)
    return mine, np.asarray(nearest[mine], dtype=np.int32)
