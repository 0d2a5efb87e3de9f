# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a linear elastic body on a mesh to its reduced data."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import ufl

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray
from flexfem.reduction.damping import modal_damping
from flexfem.reduction.fem.blocks import assembled_matrix, multiply, projected, with_neighbours
from flexfem.reduction.fem.geometric import GeometricStiffness
from flexfem.reduction.fem.integrals import MassIntegrals
from flexfem.reduction.fem.internal import BASES, LARGEST, Pieces, internal_functions
from flexfem.reduction.fem.linear_body import LinearBody
from flexfem.reduction.fem.orientation import Orientation
from flexfem.reduction.fem.recovery import recover
from flexfem.reduction.fem.response import StaticResponse
from flexfem.reduction.fem.spectrum import Choice
from flexfem.reduction.fem.ties import TIES, Ties, rigid_motions, tie
from flexfem.reduction.reduced_body import ReducedBody, interface_motions

__all__ = ["reduce_body"]

#: Relative energy of a rigid motion that is more than round-off.
_RIGID = 1e-7
#: Relative error with which static functions must contain rigid motions.
_CONTAINED = 1e-5


def reduce_body(
    body: LinearBody,
    interfaces: Mapping[str, Any] | None = None,
    *,
    modes: int | None = None,
    frequency: float | None = None,
    participation: float | None = None,
    basis: str = "craig_bampton",
    ties: Mapping[str, str] | None = None,
    positions: Mapping[str, Any] | None = None,
    damping_ratio: float = 0.0,
    stiffness_damping: float = 0.0,
    geometric_stiffness: bool = False,
    recovery: bool = True,
) -> ReducedBody:
    """Reduce a body to the motion of its interfaces and some internal functions (collective).

    Args:
        body: the body.
        interfaces: regions by the names of the frames tied to them: (facet tags, tag), a function
            of points (3, q) that says which are meant, or a point for the nearest vertex of a
            body whose points have rotations. None: free modes only.
        modes: keep so many modes;
        frequency: or all up to this frequency, Hz;
        participation: or as few as move this part of the mass along each axis.
        basis: internal functions: "craig_bampton", modes with the interfaces at rest (Craig and
            Bampton 1968); "free_free", modes of the free body and what the inertia of rigid
            motions does, in the same coordinates (Craig and Chang 1977); "full", all of the mesh.
        ties: "rigid" (the region moves as one) or "average" (the frame has the region's mean
            motion) by names; rigid if not named.
        positions: (3,) of the frames at rest, body axes, by names; the region's centroid if not
            named.
        damping_ratio: of all elastic modes of the free reduced body.
        stiffness_damping: factor of the stiffness in the damping, s.
        geometric_stiffness: compute how stresses by acceleration and by interface motion stiffen.
        recovery: compute what pictures need.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an argument is out of its range; a region is not there, overlaps another or
            cannot turn; the body is in pieces, or its rigid motions cost energy.
    """
    owner = "reduce_body"
    _checks.instance(owner, "body", body, LinearBody)
    owner = f'{owner} "{body.name}"'
    places, kinds, at = _names(owner, interfaces, ties, positions)
    if basis not in BASES:
        raise ValueError(f"{owner}: basis must be one of {BASES}, got {_checks.show(basis)}")
    size = body.space.dofmap.index_map.size_global * body.space.dofmap.index_map_bs
    if basis == "full":
        if not modes is frequency is participation is None:
            raise ValueError(f'{owner}: the basis "full" has all modes, none can be chosen')
        if size > LARGEST:
            raise ValueError(
                f'{owner}: "full" can have {LARGEST} unknowns at most, the mesh has {size}'
            )
        choice = Choice()
    else:
        choice = Choice.checked(owner, modes, frequency, participation)
    if choice.participation is not None and (basis != "craig_bampton" or not places):
        raise ValueError(
            f"{owner}: participation is that of modes with interfaces at rest: it needs interfaces "
            'and the basis "craig_bampton"'
        )
    ratio = _checks.number(owner, "damping_ratio", damping_ratio, nonnegative=True)
    factor = _checks.number(owner, "stiffness_damping", stiffness_damping, nonnegative=True)
    if geometric_stiffness and body.prestress is None:
        raise ValueError(f"{owner}: geometric_stiffness needs the body's prestress")

    comm = body.space.mesh.comm
    integrals = MassIntegrals(body)
    ties_found = tie(owner, body, places, kinds, at)
    pieces = _prepare(owner, body, integrals, ties_found)
    inner = internal_functions(owner, pieces, basis, choice)
    functions = np.hstack([pieces.static, inner])
    held = np.concatenate([ties_found.held, np.zeros(inner.shape[1], dtype=np.bool_)])

    stiffness = projected(comm, functions, multiply(pieces.stiffness, functions))
    stiffness = _without_rigid_forces(0.5 * (stiffness + stiffness.T), ties_found)
    moments, products = integrals.products(functions, loads := integrals.loads())
    mass_matrix = np.einsum("aaij->ij", products[:, :, 1:, 1:])
    by_acceleration = by_interface = None
    if geometric_stiffness:
        geometric = GeometricStiffness(body)
        whole = with_neighbours(body.space, functions)
        by_acceleration = -geometric.of(pieces.response.respond(loads), whole)
        by_interface = geometric.of_interfaces(ties_found, pieces.static, whole)
    k = len(held) - inner.shape[1]
    rigid = pieces.rigid.shape[1] if places else 0
    squares = np.linalg.eigvalsh(stiffness[k:, k:]) if inner.shape[1] else np.zeros(0)
    return ReducedBody(
        ties_found.interfaces,
        integrals.mass(),
        moments,
        products,
        stiffness,
        modal_damping(mass_matrix, stiffness, held, ratio, rigid) + factor * stiffness,
        ties_found.held,
        np.sqrt(np.maximum(squares, 0.0)),
        by_acceleration,
        by_interface,
        recover(body, functions) if recovery else None,
    )


def _names(
    owner: str,
    interfaces: Mapping[str, Any] | None,
    ties: Mapping[str, str] | None,
    positions: Mapping[str, Any] | None,
) -> tuple[Mapping[str, Any], Mapping[str, str], Mapping[str, Any]]:
    """Check the tables by names of interfaces."""
    tables: list[Mapping[str, Any]] = []
    for what, table in (("interfaces", interfaces), ("ties", ties), ("positions", positions)):
        if table is not None and not isinstance(table, Mapping):
            raise TypeError(f"{owner}: {what} must be a dictionary, got {_checks.show(table)}")
        tables.append(table or {})
        for name in tables[-1]:
            if name not in tables[0]:
                raise ValueError(
                    f"{owner}: {what} has the name {_checks.show(name)}, which no interface has"
                )
    for name, kind in tables[1].items():
        if kind not in TIES:
            raise ValueError(
                f'{owner}: tie of "{name}" must be one of {TIES}, got {_checks.show(kind)}'
            )
    places, kinds, at = tables
    for name in places:
        _checks.text(owner, "name of an interface", name)
    return places, kinds, {k: _checks.vector(owner, f'position of "{k}"', v) for k, v in at.items()}


def _prepare(owner: str, body: LinearBody, integrals: MassIntegrals, ties: Ties) -> Pieces:
    """Matrices, responses and static functions (collective)."""
    comm, space = body.space.mesh.comm, body.space
    mass = integrals.mass()
    if not mass > 0.0:
        raise ValueError(f"{owner}: the mass must be positive, got {mass:g}")
    centre = integrals.first() / mass
    spread = np.trace(integrals.second()) / mass - centre @ centre
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    stiffness = assembled_matrix(body.elastic(u, v))
    mass_matrix = integrals.mass_matrix()
    rigid = rigid_motions(body, centre)
    rigid = rigid[:, _present(comm, rigid)]
    _check_energy(owner, comm, stiffness, rigid)
    conditions = ties.conditions
    if not ties.interfaces:
        conditions = multiply(mass_matrix, rigid)
    try:
        response = StaticResponse(comm, stiffness, ties.fixed, conditions, rigid)
        means = np.zeros((conditions.shape[1], len(ties.held)))
        if ties.interfaces:
            means[np.arange(len(ties.averaged)), ties.averaged] = 1.0
        static = response.move(ties.motion, means)
    except ArithmeticError as error:
        raise ValueError(f"{owner}: the interfaces do not hold the body: {error}") from None
    _check_contained(owner, body, ties, static)
    return Pieces(
        stiffness,
        mass_matrix,
        response,
        ties,
        conditions,
        static,
        rigid,
        Orientation(body, max(spread, 1e-300) ** 0.5, centre),
    )


def _present(comm: Any, rigid: FloatArray) -> BoolArray:
    """Rigid motions that move something."""
    present: BoolArray = np.diagonal(projected(comm, rigid, rigid)) > 0.0
    return present


def _check_energy(owner: str, comm: Any, stiffness: Any, rigid: FloatArray) -> None:
    """Rigid motions must cost no energy."""
    energy = np.diagonal(projected(comm, rigid, multiply(stiffness, rigid)))
    diagonal = stiffness.getDiagonal().getArray()[:, np.newaxis]
    scale = np.diagonal(projected(comm, rigid, diagonal * rigid))
    worst = float(np.max(np.abs(energy) / scale))
    if not worst <= _RIGID:
        raise ValueError(
            f"{owner}: rigid motions must cost no energy, but cost {worst:.3g} of what their "
            "parts cost; check the body's elastic form and its rigid motions"
        )


def _check_contained(owner: str, body: LinearBody, ties: Ties, static: FloatArray) -> None:
    """Static functions must superpose to rigid motions: they do not if the body is in pieces."""
    if not ties.interfaces:
        return
    comm = body.space.mesh.comm
    motions = rigid_motions(body, np.zeros(3))
    coordinates = interface_motions(ties.interfaces, ties.held)
    present = _present(comm, motions)
    error = (static @ coordinates - motions)[:, present]
    size = np.diagonal(projected(comm, motions, motions))[present]
    worst = float(np.sqrt((np.diagonal(projected(comm, error, error)) / size).max(initial=0.0)))
    if not worst <= _CONTAINED:
        raise ValueError(
            f"{owner}: moving all interfaces as one does not move the body as one (error "
            f"{worst:.3g}): it is in pieces, or its rigid motions are wrong"
        )


def _without_rigid_forces(stiffness: FloatArray, ties: Ties) -> FloatArray:
    """Remove round-off: rigid motions of the interfaces cause no force at all."""
    if not ties.interfaces:
        return stiffness
    if len(ties.interfaces) == 1:
        # all that it does is to move the body as one
        alone = stiffness.copy()
        alone[:6] = 0.0
        alone[:, :6] = 0.0
        return alone
    diagonal = np.diagonal(stiffness)
    weight = np.where(diagonal > 0.0, diagonal, 0.0)
    motions = np.zeros((len(stiffness), 6))
    motions[: len(ties.held)] = interface_motions(ties.interfaces, ties.held)
    motions = motions[:, np.abs(motions).max(axis=0) > 0.0]
    weight[weight == 0.0] = weight.max(initial=0.0)
    weight = weight if weight.any() else np.ones(len(stiffness))
    gram = motions.T @ (weight[:, np.newaxis] * motions)
    pull = np.linalg.solve(gram, (weight[:, np.newaxis] * motions).T)
    projector = np.eye(len(stiffness)) - motions @ pull
    clean = projector.T @ stiffness @ projector
    result: FloatArray = 0.5 * (clean + clean.T)
    return result
