# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coupling of interface frames to regions of a body: rigid or averaged (ties)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.kernels.ffcx_options import compiled_form
from flexfem.reduction.fem.body.blocks import assemble_rows, own_rows, projected, total
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.fem.body.regions import Region, find_region
from flexfem.reduction.reduced_body import Interface

__all__ = ["TIES", "Ties", "rigid_motions", "tie"]

#: Ways of tying a frame to a region.
TIES = ("rigid", "average")
#: Smallest eigenvalue of the Gram matrix of the motions of a region, its diagonal one, with which
#: they are independent.
_INDEPENDENT = 1e-10


@dataclass(frozen=True, eq=False)
class Ties:
    """All interfaces of a body; c of their coordinates are means.

    Attributes:
        interfaces: the frames.
        held: (6 k,) fixed coordinates, which the body does not have.
        fixed: this rank's rows in rigid regions.
        motion: (rows, 6 k) displacement of the fixed rows by each coordinate, zero elsewhere.
        conditions: (rows, c) the means as functionals.
        averaged: (c,) the coordinates that they are.
    """

    interfaces: tuple[Interface, ...]
    held: BoolArray
    fixed: IntArray
    motion: FloatArray
    conditions: FloatArray
    averaged: IntArray


def rigid_motions(body: LinearBody, centre: FloatArray) -> FloatArray:
    """(rows, 6) small displacements along and rotations about axes at a point (collective)."""
    rows = own_rows(body.space)
    motions = np.zeros((rows, 6))
    assert body.rigid is not None
    for i, axis in enumerate(np.eye(3)):
        for j, (shift, turn) in enumerate(((axis, np.zeros(3)), (np.cross(centre, axis), axis))):
            function = body.rigid(shift, turn)
            motions[:, 3 * j + i] = function.x.array[:rows]
    return motions


def tie(
    owner: str,
    body: LinearBody,
    places: Mapping[str, Any],
    kinds: Mapping[str, str],
    positions: Mapping[str, Any],
) -> Ties:
    """Tie the frames (collective).

    Args:
        owner: for messages.
        body: the body.
        places: regions by names of interfaces; see :func:`find_region`.
        kinds: "rigid" or "average" by names; rigid if not named.
        positions: of the frames by names; the region's centroid if not named.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: a name that is no interface's, a region that is not there, that cannot rotate or
            has no surface to average over, or regions that overlap.
    """
    comm, rows = body.space.mesh.comm, own_rows(body.space)
    free = total(comm, np.abs(rigid_motions(body, np.zeros(3))).sum(axis=0)) > 0.0
    interfaces: list[Interface] = []
    fixed: list[IntArray] = []
    averaged: list[IntArray] = []
    motions: list[FloatArray] = []
    conditions: list[FloatArray] = []
    for i, (name, where) in enumerate(places.items()):
        who = f'{owner}: interface "{name}"'
        region = find_region(who, body.space.mesh, where)
        interface = Interface(name, positions.get(name, region.centroid))
        interfaces.append(interface)
        motion = rigid_motions(body, interface.position)
        if kinds.get(name, TIES[0]) == "rigid":
            mine = region.rows(body.space, rows)
            if np.isin(mine, np.concatenate([np.empty(0), *fixed])).any():
                clash = 1.0
            else:
                clash = 0.0
            if total(comm, np.array([clash]))[0] > 0.0:
                raise ValueError(f"{who}: its region shares points with another rigid one")
            _check_independent(who, comm, rigid_motions(body, region.centroid)[mine][:, free])
            fixed.append(mine)
            there = np.zeros((rows, 6))
            there[mine] = motion[mine]
            motions.append(there)
        else:
            conditions.append(_means(who, body, region, interface.position, motion, free))
            averaged.append(6 * i + np.flatnonzero(free))
            motions.append(np.zeros((rows, 6)))
    return Ties(
        tuple(interfaces),
        np.tile(~free, len(interfaces)),
        np.concatenate([np.empty(0, dtype=np.int64), *fixed]),
        np.hstack([np.zeros((rows, 0)), *motions]),
        np.hstack([np.zeros((rows, 0)), *conditions]),
        np.concatenate([np.empty(0, dtype=np.int64), *averaged]),
    )


def _check_independent(who: str, comm: Any, motions: FloatArray) -> None:
    gram = projected(comm, motions, motions)
    diagonal = np.diagonal(gram)
    if (diagonal > 0.0).all():
        scale = 1.0 / np.sqrt(diagonal)
        if np.linalg.eigvalsh(scale[:, np.newaxis] * gram * scale)[0] > _INDEPENDENT:
            return
    raise ValueError(
        f"{who}: its points cannot carry all rotations of a frame; it needs a larger region, or "
        "a body whose points have rotations"
    )


def _means(
    who: str,
    body: LinearBody,
    region: Region,
    position: FloatArray,
    motion: FloatArray,
    free: BoolArray,
) -> FloatArray:
    """Mean displacement and rotation over a region as functionals.

    The rigid motion of the frame whose resultants ``int u dS`` and ``int x cross u dS`` are those
    of the displacement: the interpolation element of commercial codes (RBE3), in the continuum.
    """
    domain, rows = body.space.mesh, own_rows(body.space)
    if region.dimension != domain.topology.dim - 1 or region.dimension == 0:
        raise ValueError(f"{who}: a mean needs facets with an area or a length")
    domain.topology.create_connectivity(region.dimension, domain.topology.dim)
    outer = mesh.exterior_facet_indices(domain.topology)
    marked = np.intersect1d(region.entities, outer).astype(np.int32)
    own = region.entities < domain.topology.index_map(region.dimension).size_local
    counts = total(domain.comm, np.array([len(marked), own.sum()], dtype=np.float64))
    if counts[0] != counts[1]:
        raise ValueError(f"{who}: a mean can be taken over outer facets only")
    tags = mesh.meshtags(domain, region.dimension, marked, np.ones(len(marked), dtype=np.int32))
    v = ufl.TestFunction(body.space)
    pick = fem.Constant(domain, np.zeros((2, 3)))
    x = ufl.SpatialCoordinate(domain)
    arm = ufl.as_vector([x[i] if i < len(x) else 0.0 * x[0] for i in range(3)])
    arm = arm - fem.Constant(domain, np.array(position))
    assert body.displacement is not None
    moved = body.displacement(v)
    work = ufl.dot(pick[0, :], moved) + ufl.dot(pick[1, :], ufl.cross(arm, moved))
    form = compiled_form(work * ufl.Measure("ds", domain, 1, subdomain_data=tags))
    resultants = np.zeros((rows, 6))
    for i in range(6):
        pick.value[:] = 0.0
        pick.value.flat[i] = 1.0
        resultants[:, i] = assemble_rows(form, rows)
    resultants = resultants[:, free]
    gram = projected(domain.comm, resultants, motion[:, free])
    _check_gram(who, gram)
    # C^T R = 1: unit motions of the frame have unit means
    means: FloatArray = np.linalg.solve(gram, resultants.T).T
    return means


def _check_gram(who: str, gram: FloatArray) -> None:
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(gram)), 1e-300))
    if np.linalg.svd(scale[:, np.newaxis] * gram * scale, compute_uv=False)[-1] < _INDEPENDENT:
        raise ValueError(f"{who}: its region lies on a line and has no mean rotation")
