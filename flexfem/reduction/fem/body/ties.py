# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coupling of interface frames to regions of a body: rigid or averaged (ties)."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
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
#: (3, 3, 3) small rotations about the axes, as gradients of displacements.
_TURNS = np.cross(np.eye(3)[:, np.newaxis], np.eye(3)).swapaxes(1, 2)
#: Smallest eigenvalue of the Gram matrix of the motions of a region, its diagonal one, with which
#: they are independent.
_INDEPENDENT = 1e-10


@dataclass(frozen=True, eq=False)
class Ties:
    """All interfaces of a body; c of their coordinates are means, e more are mean stretches.

    Attributes:
        interfaces: the frames.
        held: (6 k,) fixed coordinates, which the body does not have.
        fixed: this rank's rows in rigid regions.
        motion: (rows, 6 k) displacement of the fixed rows by each coordinate, zero elsewhere.
        conditions: (rows, c + e) the means as functionals, then the stretches, see
            :func:`_stretches`.
        averaged: (c,) the coordinates that they are.
        condition_of: (c + e,) number of the interface of each.
    """

    interfaces: tuple[Interface, ...]
    held: BoolArray
    fixed: IntArray
    motion: FloatArray
    conditions: FloatArray
    averaged: IntArray
    condition_of: IntArray

    @property
    def means(self) -> FloatArray:
        """(rows, c) the means as functionals."""
        return self.conditions[:, : len(self.averaged)]


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


def second_order(turns: FloatArray) -> FloatArray:
    """(rows, 6) displacements of second order by rotations, of points with three translations.

    ``1/2 (e_p x (e_q x r) + e_q x (e_p x r))``, half of that where p = q, as xx, xy, xz, yy, yz,
    zz: times the six products of rotations of ``core.places.floating_frames`` they are the
    symmetric part of a finite rotation.

    Args:
        turns: (rows, 3) of first order, ``e_q x r``.
    """
    fields = np.empty((len(turns), 6))
    for a, (p, q) in enumerate(combinations_with_replacement(range(3), 2)):
        both = _crossed(p, turns[:, q]) + _crossed(q, turns[:, p])
        fields[:, a] = (0.25 if p == q else 0.5) * both
    return fields


def _crossed(axis: int, vectors: FloatArray) -> FloatArray:
    """Cross products of a unit vector with the vectors of all nodes, one after the other."""
    crossed: FloatArray = np.cross(np.eye(3)[axis], vectors.reshape(-1, 3)).ravel()
    return crossed


def tie(
    owner: str,
    body: LinearBody,
    places: Mapping[str, Any],
    kinds: Mapping[str, str],
    positions: Mapping[str, Any],
    turning: bool = False,
) -> Ties:
    """Tie the frames (collective).

    Args:
        owner: for messages.
        body: the body.
        places: regions by names of interfaces; see :func:`find_region`.
        kinds: "rigid" or "average" by names; rigid if not named.
        positions: of the frames by names; the region's centroid if not named.
        turning: interfaces other than the first turn by any angle in the body.

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
    stretches: list[FloatArray] = []
    turned: list[int] = []
    for i, (name, where) in enumerate(places.items()):
        who = f'{owner}: interface "{name}"'
        region = find_region(who, body.space.mesh, where)
        interface = Interface(name, positions.get(name, region.centroid))
        interfaces.append(interface)
        motion = rigid_motions(body, interface.position)
        if kinds.get(name, TIES[0]) == "rigid":
            mine = region.rows(body.space, rows)
            clash = np.isin(mine, np.concatenate([np.empty(0), *fixed])).any()
            if total(comm, np.array([float(clash)]))[0] > 0.0:
                raise ValueError(f"{who}: its region shares points with another rigid one")
            _check_independent(who, comm, rigid_motions(body, region.centroid)[mine][:, free])
            fixed.append(mine)
            there = np.zeros((rows, 6))
            there[mine] = motion[mine]
            motions.append(there)
        else:
            measure, at = _outside(who, body, region), interface.position
            conditions.append(_means(who, body, measure, at, motion, free))
            averaged.append(6 * i + np.flatnonzero(free))
            if turning and i > 0:
                stretches.append(_stretches(body, measure, at, motion, conditions[-1]))
                turned += [i] * stretches[-1].shape[1]
            motions.append(np.zeros((rows, 6)))
    coordinates = np.concatenate([np.empty(0, dtype=np.int64), *averaged])
    return Ties(
        tuple(interfaces),
        np.tile(~free, len(interfaces)),
        np.concatenate([np.empty(0, dtype=np.int64), *fixed]),
        np.hstack([np.zeros((rows, 0)), *motions]),
        np.hstack([np.zeros((rows, 0)), *conditions, *stretches]),
        coordinates,
        np.concatenate([coordinates // 6, np.array(turned, dtype=np.int64)]),
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


def _outside(who: str, body: LinearBody, region: Region) -> Any:
    """Measure of a region of outer facets."""
    domain = body.space.mesh
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
    return ufl.Measure("ds", domain, 1, subdomain_data=tags)


def _resultants(body: LinearBody, measure: Any, position: FloatArray, tensors: Any) -> FloatArray:
    """(rows, k) work of surface forces that are affine in the place, as functionals (collective).

    Args:
        body: the body.
        measure: of the surface.
        position: the place counts from here.
        tensors: (k, 3, 4) the force, and its derivatives by the place.
    """
    domain, rows = body.space.mesh, own_rows(body.space)
    pick = fem.Constant(domain, np.zeros((3, 4)))
    x, v = ufl.SpatialCoordinate(domain), ufl.TestFunction(body.space)
    arm = ufl.as_vector([x[i] if i < len(x) else 0.0 * x[0] for i in range(3)])
    arm = arm - fem.Constant(domain, np.array(position))
    assert body.displacement is not None
    force = pick * ufl.as_vector([1.0, *(arm[i] for i in range(3))])
    form = compiled_form(ufl.dot(force, body.displacement(v)) * measure)
    work = np.zeros((rows, len(tensors)))
    for i, tensor in enumerate(tensors):
        pick.value[:] = tensor
        work[:, i] = assemble_rows(form, rows)
    return work


def _means(
    who: str, body: LinearBody, measure: Any, position: FloatArray, motion: FloatArray,
    free: BoolArray,
) -> FloatArray:  # fmt: skip
    """Mean displacement and rotation over a region as functionals.

    The rigid motion of the frame whose resultants ``int u dS`` and ``int x cross u dS`` are those
    of the displacement: the interpolation element of commercial codes (RBE3), in the continuum.
    """
    forces = np.zeros((6, 3, 4))
    forces[:3, :, 0], forces[3:, :, 1:] = np.eye(3), _TURNS
    resultants = _resultants(body, measure, position, forces)[:, free]
    gram = projected(body.space.mesh.comm, resultants, motion[:, free])
    _check_gram(who, gram)
    # C^T R = 1: unit motions of the frame have unit means
    means: FloatArray = np.linalg.solve(gram, resultants.T).T
    return means


def _stretches(
    body: LinearBody, measure: Any, position: FloatArray, motion: FloatArray, means: FloatArray
) -> FloatArray:
    """Mean stretches of a region as functionals (rows, e), zero in small rigid motions.

    Its mean rotation is linear in the displacement: in a rotation by an angle it is the sine,
    which says nothing of a rotation at a right angle, where the inertia of the frame would be zero.
    With the stretches all moments of first order of the displacement over the region are there, in
    which finite rotations differ: three more over a plane, six over other surfaces.
    """
    comm, forces = body.space.mesh.comm, np.zeros((6, 3, 4))
    forces[:, :, 1:] = second_order(_TURNS.swapaxes(1, 2).reshape(3, 9).T).T.reshape(6, 3, 3)
    resultants = _resultants(body, measure, position, forces)
    resultants -= means @ projected(comm, motion, resultants)
    gram = projected(comm, resultants, second_order(motion[:, 3:]))
    values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    found = values > _INDEPENDENT * values[-1]
    stretches: FloatArray = resultants @ (vectors[:, found] / values[found])
    return stretches


def _check_gram(who: str, gram: FloatArray) -> None:
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(gram)), 1e-300))
    if np.linalg.svd(scale[:, np.newaxis] * gram * scale, compute_uv=False)[-1] < _INDEPENDENT:
        raise ValueError(f"{who}: its region lies on a line and has no mean rotation")
