# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices, responses and static (constraint) modes of a body, with checks of them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl

from flexfem._types import BoolArray, FloatArray
from flexfem.reduction.fem.body.blocks import assembled_matrix, multiply, projected
from flexfem.reduction.fem.body.integrals import MassIntegrals
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.fem.body.ties import Ties, rigid_motions
from flexfem.reduction.fem.modes.internal import Pieces
from flexfem.reduction.fem.modes.orientation import Orientation
from flexfem.reduction.fem.modes.response import StaticResponse
from flexfem.reduction.reduced_body import Interface, interface_motions

__all__ = ["prepare", "without_rigid_forces"]

#: Relative energy of a rigid motion that is more than round-off.
_RIGID = 1e-7
#: Relative error with which static functions must contain rigid motions.
_CONTAINED = 1e-5


def prepare(owner: str, body: LinearBody, integrals: MassIntegrals, ties: Ties) -> Pieces:
    """Matrices, responses and static functions (collective)."""
    comm, space = body.space.mesh.comm, body.space
    mass = integrals.mass()
    if not mass > 0.0:
        raise ValueError(f"{owner}: the mass must be positive, got {mass:g}")
    centre = integrals.first() / mass
    spread = np.trace(integrals.second()) / mass - centre @ centre
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    stiffness = assembled_matrix(body.elastic(u, v), comm)
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
        raise ValueError(
            f"{owner}: the interfaces do not constrain all rigid motions of the body: {error}; "
            "take larger ones or more"
        ) from None
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
    """Raise for rigid motions that have strain energy."""
    energy = np.diagonal(projected(comm, rigid, multiply(stiffness, rigid)))
    diagonal = stiffness.getDiagonal().getArray()[:, np.newaxis]
    scale = np.diagonal(projected(comm, rigid, diagonal * rigid))
    worst = float(np.max(np.abs(energy) / scale))
    if not worst <= _RIGID:
        raise ValueError(
            f"{owner}: rigid motions must have no strain energy, but have {worst:.3g} of that of "
            "their parts; check the body's elastic form and its rigid motions"
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


def without_rigid_forces(
    stiffness: FloatArray, interfaces: Sequence[Interface], held: BoolArray
) -> FloatArray:
    """Remove round-off: rigid motions of the interfaces cause no force at all."""
    if not interfaces:
        return stiffness
    if len(interfaces) == 1:
        # all that it does is to move the body as one
        alone = stiffness.copy()
        alone[:6] = 0.0
        alone[:, :6] = 0.0
        return alone
    diagonal = np.diagonal(stiffness)
    weight = np.where(diagonal > 0.0, diagonal, 0.0)
    motions = np.zeros((len(stiffness), 6))
    motions[: len(held)] = interface_motions(interfaces, held)
    motions = motions[:, np.abs(motions).max(axis=0) > 0.0]
    weight[weight == 0.0] = weight.max(initial=0.0)
    weight = weight if weight.any() else np.ones(len(stiffness))
    gram = motions.T @ (weight[:, np.newaxis] * motions)
    pull = np.linalg.solve(gram, (weight[:, np.newaxis] * motions).T)
    projector = np.eye(len(stiffness)) - motions @ pull
    clean = projector.T @ stiffness @ projector
    result: FloatArray = 0.5 * (clean + clean.T)
    return result
