# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fictitious masses of dynamic relaxation, with which an explicit step of unit size is stable.

The largest eigenvalue of ``M^-1 K`` is at most the largest sum of ``|K_ij| / m_i`` over a row
(Gershgorin); steps are stable below a limit that depends on the damping. Masses in proportion to
these sums bring every unknown close to its own limit (Underwood, in: Computational Methods for
Transient Analysis, 1983).
"""

from __future__ import annotations

from math import sqrt

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.system import MASS, Shifts, System

__all__ = ["REST", "fictitious_masses", "physical_masses"]

#: Stiffness alone, nothing scaled.
REST = Shifts(velocity=0.0, acceleration=0.0, scale=1.0)


def fictitious_masses(
    tangent: TangentSolver, limit: float, least: float, physical: list[FloatArray] | None
) -> list[FloatArray]:
    """Masses (n_owned, width) of every block from the stiffness at the trial state (collective).

    Args:
        tangent: exact matrix, rows and blocks evaluated.
        limit: largest admissible eigenvalue of ``M^-1 K``.
        least: least ratio of a node's three masses for translations, and of those for rotations, to
            the largest of them; 1 makes them equal.
        physical: masses that are multiplied by one factor instead; positive.
    """
    system = tangent.system
    tangent.assemble(REST)
    sums = [own + more for own, more in zip(tangent.row_sums(), _springs(system), strict=True)]
    needed = [total / limit for total in sums]
    if physical is not None:
        ratios = [
            float((n[n > 0.0] / m[n > 0.0]).max(initial=0.0))
            for n, m in zip(needed, physical, strict=True)
        ]
        factor = system.comm.allreduce(max(ratios, default=0.0), op=MPI.MAX)
        return [factor * m for m in physical]
    largest = np.zeros(2)
    for values in needed:
        for kind, first in enumerate(range(0, values.shape[1], 3)):
            group = values[:, first : first + 3]
            most = group.max(axis=1, keepdims=True, initial=0.0)
            np.maximum(group, least * most, out=group)
            largest[kind] = max(largest[kind], group.max(initial=0.0))
    system.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    largest[largest == 0.0] = 1.0
    for values in needed:
        for kind, first in enumerate(range(0, values.shape[1], 3)):
            group = values[:, first : first + 3]
            group[group == 0.0] = largest[kind]  # unsupported unknowns move like the stiffest ones
    return needed


def physical_masses(tangent: TangentSolver) -> list[FloatArray]:
    """Diagonals (n_owned, width) of the mass matrices of all blocks (collective).

    Raises:
        InputError: a node has no mass; a body of its block is named.
    """
    system = tangent.system
    tangent.assemble(MASS)
    every = [np.array(diagonal) for diagonal in tangent.diagonals()]
    for part, masses in zip(system.parts, every, strict=True):
        if system.comm.allreduce(bool((masses <= 0.0).any()), op=MPI.LOR):
            raise InputError(f"{part.owner}: it has nodes without mass, which cannot be scaled")
    return every


def _springs(system: System) -> list[FloatArray]:
    """Sums of the stiffness of force elements and contacts over the rows of every block."""
    rows = system.constraints
    sizes = np.abs(rows.force_jacobian)
    whole = np.bincount(rows.row_of_term, sizes.sum(axis=(1, 2)), minlength=rows.size)
    # an open stop has a slope of zero
    stiffness = np.maximum(rows.elastic[:, 1], np.abs(rows.static_forces()[:, 1]))
    factor = np.where(rows.active, stiffness, 0.0) * whole
    every = []
    for part in system.parts:
        out, width = np.zeros((part.block.owned, 6)), part.block.width
        local = np.append(part.interface_nodes, -1)[rows.term_nodes]
        term, side = np.nonzero(local >= 0)
        added = factor[rows.row_of_term[term], np.newaxis] * sizes[term, side]
        np.add.at(out, local[term, side], added)
        if part.contacts is not None:
            # a unit normal has a sum of at most sqrt(3) with the entries of another one
            out[:, :3] += sqrt(3.0) * part.contacts.nearby()[:, np.newaxis]
            out[:, 3:] += sqrt(3.0) * part.contacts.nearby_turns()[:, np.newaxis]
        every.append(part.block.hold(out[:, :width]))
    return every
