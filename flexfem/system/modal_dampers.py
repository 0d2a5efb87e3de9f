# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dampers of the amplitudes of modes, which are projections of the elements' strains.

With strains ``e_i`` of a mode and the integrals ``s_i`` of its stresses, the amplitude changes by
the rate ``a_i = s_i . e'(x) v`` (times ``omega_i^2``), and the damper adds ``c_i a_i e_i`` to the
strains whose stresses the elements use: the forces are the transpose of the rates by the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.layout.elements import DampedElements, ElementFamily
from flexfem.layout.tangent_request import Strains, TangentRequest

__all__ = ["ModalDampers", "StrainModes", "row_of", "strain_of"]

_WEIGHTLESS = np.zeros(3)


@dataclass(frozen=True)
class StrainModes:
    """Strains of modes in the elements of one block.

    Attributes:
        block, elements: the block and its elements.
        strains: of each mode, zero in bodies that are not damped.
        stresses: (k, n) integrals of the stresses of these strains, all groups in a row.
    """

    block: FrameBlock
    elements: ElementFamily
    strains: Sequence[Strains]
    stresses: FloatArray

    def rates(self) -> FloatArray:
        """(n,) rates of the strains at the trial state, all groups in a row."""
        return row_of(strain_of(self.elements, self.block.frames, self.block.velocity))

    def present(self) -> Strains:
        """Strains at the trial state."""
        found = self.elements.continued_strains(
            self.block.frames, np.zeros_like(self.block.velocity)
        )
        assert found is not None
        return found

    def products(self, chosen: BoolArray) -> FloatArray:
        """The integrals (k, n) of the stresses in the chosen (m,) cells alone."""
        assert isinstance(self.elements, DampedElements)
        found = [self.elements.strain_products(own, chosen)[1] for own in self.strains]
        return np.array([row_of(own) for own in found]).reshape(self.stresses.shape)

    def sum(self, given: Strains, amounts: FloatArray) -> Strains:
        """Given strains with amounts (k,) of the modes added."""
        total = [own.copy() for own in given]
        for amount, strains in zip(amounts.tolist(), self.strains, strict=True):
            for k, added in enumerate(strains):
                total[k] += amount * added
        return total

    def forces(self, mode: int) -> FloatArray:
        """(n_owned, width) forces of the stresses of a mode at the trial state (collective)."""
        block, nothing = self.block, [np.zeros_like(own) for own in self.strains[mode]]
        block.residual[:] = 0.0
        for strains, sign in ((self.strains[mode], 1.0), (nothing, -1.0)):
            self.elements.add_residual(block, _WEIGHTLESS, sign, TangentRequest(strains))
        block.add_ghosts()
        return block.hold(block.owned_residual.copy())


class ModalDampers:
    """All dampers of modes of a system.

    Attributes:
        owner: in messages.
        factors: (k,) ``2 zeta / omega^3`` of modes of unit modal mass, s^3.
        parts: strains of the modes, by the number of the part.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        owner: str,
        factors: FloatArray,
        parts: dict[int, StrainModes],
    ) -> None:
        """Store the modes."""
        self._comm, self.owner = comm, owner
        self.factors, self.parts = factors, parts

    def shares(self) -> FloatArray:
        """(k,) this rank's shares of the rates of the amplitudes at the trial state."""
        found = np.zeros(len(self.factors))
        for own in self.parts.values():
            found += own.stresses @ own.rates()
        return found

    def rates(self) -> FloatArray:
        """(k,) rates of the amplitudes, times the squared frequencies (collective)."""
        return np.asarray(self._comm.allreduce(self.shares(), op=MPI.SUM))

    def strains(self, given: Sequence[Strains | None]) -> list[Strains | None]:
        """Strains of each part whose stresses are the given ones and the dampers' (collective).

        Args:
            given: of each part; None for the present strains.
        """
        amounts, found = self.factors * self.rates(), list(given)
        for number, own in self.parts.items():
            present = given[number]
            found[number] = own.sum(own.present() if present is None else present, amounts)
        return found


def strain_of(elements: ElementFamily, frames: FloatArray, steps: FloatArray) -> Strains:
    """Derivative of the strains at ``frames`` (n, 12) along local twists ``steps`` (n, 6)."""
    after = elements.continued_strains(frames, steps)
    before = elements.continued_strains(frames, np.zeros_like(steps))
    assert after is not None
    assert before is not None
    return [own - there for own, there in zip(after, before, strict=True)]


def row_of(strains: Strains) -> FloatArray:
    """The numbers of all groups in a row."""
    return np.concatenate([np.empty(0), *(own.ravel() for own in strains)])
