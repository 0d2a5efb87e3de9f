# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the forces of dampers of modes, see ``system.modal_dampers``.

A damper adds ``c a e`` to the strains whose stresses act, with the rate ``a = s . e'(q) V`` of the
amplitude. Its force ``c a g`` with ``g(q) = e'(q)^T s`` changes by ``c a dg`` and by ``c g da``,
with ``da = g . dV + V . dg``: a matrix of the elements, and a product of two vectors for each mode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_kernels import step_rates
from flexfem.gradients.equations.node_maps import transposed
from flexfem.layout.tangent_request import Strains, TangentRequest
from flexfem.system.modal_dampers import StrainModes
from flexfem.system.system import Shifts, System

__all__ = ["DampedModes"]

_WEIGHTLESS, _STIFFNESS = np.zeros(3), np.array([0.0, 0.0, 1.0])

#: (n_owned, width) for each part.
BlockVectors = list[FloatArray]


class CellMatrices(Protocol):
    """Matrices of the cells of a part."""

    def add_stresses(self, values: FloatArray) -> None:
        """Add entries of the cells to the matrix by positions."""
        ...

    def transposed_product(self, values: FloatArray) -> FloatArray:
        """Transposed product (n_owned, width) of entries of the cells with the block's steps."""
        ...


@dataclass(frozen=True)
class _Vectors:
    """Vectors (k, n_owned, width) of the modes in a block.

    Attributes:
        forces: g.
        rates: derivatives of the rates by positions and by velocities, along steps.
    """

    forces: FloatArray
    rates: tuple[FloatArray, FloatArray]


class DampedModes:
    """Derivatives of all dampers at a trial state."""

    def __init__(self, system: System) -> None:
        """Find the dampers, if there are any."""
        self._system, self._dampers = system, system.modal_dampers
        self._vectors: dict[int, _Vectors] = {}
        self._scale = 0.0

    def take(self, shifts: Shifts, matrices: Sequence[CellMatrices]) -> None:
        """Compute the derivatives at the trial state (collective); residuals are lost.

        Args:
            shifts: factors of the scheme.
            matrices: those of the parts.
        """
        assert self._dampers is not None
        self._scale = shifts.scale
        amounts = self._dampers.factors * self._dampers.rates()
        for number, own in self._dampers.parts.items():
            block = own.block
            nothing = [np.zeros_like(strains) for strains in own.present()]
            still = _stiffness(own, nothing)
            stressed = _stiffness(own, own.sum(nothing, amounts))
            matrices[number].add_stresses(shifts.scale * (stressed - still))
            turning, forces = [], []
            for k, strains in enumerate(own.strains):
                entries = _stiffness(own, strains) - still
                block.owned_step[:] = block.velocity[: block.owned, : block.width]
                block.spread_step()
                turning.append(matrices[number].transposed_product(entries))
                forces.append(own.forces(k))
            held, moved = (_by_steps(own, velocity) for velocity in (0.0, shifts.velocity))
            by_positions = [a + transposed(held, b) for a, b in zip(turning, forces, strict=True)]
            by_velocities = [transposed(moved - held, b) for b in forces]
            shape = len(forces), *block.owned_step.shape
            self._vectors[number] = _Vectors(
                np.array(forces).reshape(shape),
                (np.array(by_positions).reshape(shape), np.array(by_velocities).reshape(shape)),
            )

    def add(self, steps: BlockVectors, out: BlockVectors, kinds: Sequence[int]) -> None:
        """Add the changes of the forces along steps of all blocks (collective).

        Args:
            steps: (n_owned, width) of each block.
            out: the same.
            kinds: 0 for changes with positions, 1 for those with velocities.
        """
        self._spread(self._rates(kinds), self._forces, (steps, out))

    def add_transposed(
        self, factors: BlockVectors, out: BlockVectors, kinds: Sequence[int]
    ) -> None:
        """The transposed of :meth:`add`."""
        self._spread(self._forces, self._rates(kinds), (factors, out))

    def _rates(self, kinds: Sequence[int]) -> dict[int, FloatArray]:
        """Derivatives (k, n_owned, width) of the rates along steps."""
        return {
            number: np.sum([own.rates[kind] for kind in kinds], axis=0)
            for number, own in self._vectors.items()
            if kinds
        }

    @property
    def _forces(self) -> dict[int, FloatArray]:
        return {number: own.forces for number, own in self._vectors.items()}

    def _spread(
        self, first: Mapping[int, FloatArray], second: Mapping[int, FloatArray],
        vectors: tuple[BlockVectors, BlockVectors],
    ) -> None:  # fmt: skip
        """Add ``second c (first . vector)`` of all modes to others."""
        if self._dampers is None:
            return
        sums = np.zeros(len(self._dampers.factors))
        for number, own in first.items():
            sums += np.einsum("mni,ni->m", own, vectors[0][number])
        self._system.comm.Allreduce(MPI.IN_PLACE, sums)
        sums *= self._scale * self._dampers.factors
        for number, own in second.items():
            vectors[1][number] += np.einsum("mni,m->ni", own, sums)


def _stiffness(own: StrainModes, strains: Strains) -> FloatArray:
    """Entries of the matrices of the cells with the stresses of some strains."""
    request = TangentRequest(strains)
    return own.elements.values(own.block, _WEIGHTLESS, _STIFFNESS, 1.0, request).copy()


def _by_steps(own: StrainModes, velocity: float) -> FloatArray:
    """Derivatives (n_owned, w, w) of local velocities along steps."""
    block = own.block
    out = np.empty((len(block.frames), 2, 36))
    step_rates(block.nodes.memory, np.array([velocity, 0.0, 1.0]), block.inertial, out)
    found = out[: block.owned, 0].reshape(-1, 6, 6)
    return found[:, : block.width, : block.width]
