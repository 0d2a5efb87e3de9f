# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear maps between variations of nodes over a step of the energy-momentum method.

Rates r of a node are the inertial velocity of its mass centre c and the angular velocity in its
axes; the increments of a step are the translation of that centre and the Cayley vector phi. With
local twists (u, theta) of the node at the start (0) and at the end (1), its increments change by
``P1 (u, theta)_1 - P0 (u, theta)_0``, where

``P = [R, -R c~; 0, S]``, ``S1 = 1 + phi~/2 + phi phi^T/4``, ``S0 = S1^T``.

Accepted states have rates of increments (v, omega), as all integrators have: local ones, or
translations in inertial axes. Their accelerations are the means over the step, of the centre,
``alpha = (r1 - r0)/h``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.step_kernels import StepNodes
from flexfem.gradients.equations.node_maps import applied, rotations
from flexfem.lie import se3, so3

__all__ = ["NodeRates", "NodesBefore", "StepPaths", "cayley_vectors", "crossed"]


def cayley_vectors(before: FloatArray, after: FloatArray) -> FloatArray:
    """Cayley vectors (n, 3) of the rotations between frames (n, 12), in the axes of the first."""
    Q = rotations(before).swapaxes(1, 2) @ rotations(after)
    axis = np.stack(
        [Q[:, 2, 1] - Q[:, 1, 2], Q[:, 0, 2] - Q[:, 2, 0], Q[:, 1, 0] - Q[:, 0, 1]], axis=1
    )
    found: FloatArray = 2.0 * axis / (1.0 + np.trace(Q, axis1=1, axis2=2))[:, np.newaxis]
    return found


def _joined(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Matrices (n, 6, 6) of blocks (n, 3, 3)."""
    return np.concatenate([np.concatenate([a, b], axis=2), np.concatenate([c, d], axis=2)], axis=1)


def crossed(matrices: FloatArray, vectors: FloatArray, *, transpose: bool = False) -> FloatArray:
    """Products of matrices (n, 6, 6), or of their transposes, with vectors (n, w)."""
    width = vectors.shape[1]
    own = matrices[:, :width, :width]
    found: FloatArray = np.einsum("nji,nj->ni" if transpose else "nij,nj->ni", own, vectors)
    return found


@dataclass(frozen=True)
class StepPaths:
    """Maps of the owned nodes of a block over a step.

    Attributes:
        by_start, by_end: P0 and P1, (n, 6, 6).
        inverse_start, inverse_end: their inverses.
        turn: (n, 3, 3) from the axes at the start to those at the end, ``R1^T R0``.
    """

    by_start: FloatArray
    by_end: FloatArray
    inverse_start: FloatArray
    inverse_end: FloatArray
    turn: FloatArray

    @classmethod
    def of(cls, state: StepNodes, owned: int) -> StepPaths:
        """Maps at the trial state of a step."""
        own = np.s_[:owned]
        phi, centre = state.increments[own, 3:], so3.skew(state.centres[own])
        R0, R1 = (rotations(frames[own]) for frames in (state.frames0, state.frames))
        square = np.einsum("ni,nj->nij", phi, phi)
        S = np.eye(3) + 0.5 * so3.skew(phi) + 0.25 * square
        nothing = np.zeros_like(S)
        first, last = (
            _joined(R, -R @ centre, nothing, one) for R, one in ((R0, S.swapaxes(1, 2)), (R1, S))
        )
        turn = R1.swapaxes(1, 2) @ R0
        return cls(first, last, np.linalg.inv(first), np.linalg.inv(last), turn)

    def turned(self, vectors: FloatArray, *, back: bool = False) -> FloatArray:
        """Forces and moments (n, w) in the axes at the end, of those at the start, or back."""
        form = "nji,nkj->nki" if back else "nij,nkj->nki"
        halves = vectors.reshape(len(vectors), vectors.shape[1] // 3, 3)
        found: FloatArray = np.einsum(form, self.turn, halves)
        return found.reshape(vectors.shape)


@dataclass(frozen=True)
class NodesBefore:
    """Maps of the owned nodes of a block from the start of a motion to one step before it.

    There they are at ``H exp(-h V)``, with their local velocities V.

    Attributes:
        by_twist, by_local: derivatives of local twists by those at the start and by V, (n, 6, 6).
    """

    by_twist: FloatArray
    by_local: FloatArray

    @classmethod
    def of(cls, velocity: FloatArray, h: float) -> NodesBefore:
        """Maps of nodes with local velocities (n, 6), over a step of a size, s."""
        return cls(se3.adjoint(se3.exp(h * velocity)), -h * se3.tangent(-h * velocity))


@dataclass(frozen=True)
class NodeRates:
    """Maps at an accepted state of the owned nodes of a block, (n, 6, 6) each.

    Rates change by ``by_twist dq + by_rate dv``, and accelerations in the form of accepted states
    by ``w_mean d(alpha) + w_twist dq + w_rate dv``.

    Attributes:
        by_twist, by_rate, rate: of rates, and the inverse of the second.
        w_mean, w_twist, w_rate, mean: of accelerations, and the inverse of the first.
        local: (n, 6) local velocities; local_twist, local_rate: of these, as the first two.
    """

    by_twist: FloatArray
    by_rate: FloatArray
    rate: FloatArray
    w_mean: FloatArray
    w_twist: FloatArray
    w_rate: FloatArray
    mean: FloatArray
    local: FloatArray
    local_twist: FloatArray
    local_rate: FloatArray

    @classmethod
    def of(
        cls, block: FrameBlock, state: Mapping[str, FloatArray], centres: FloatArray
    ) -> NodeRates:
        """Maps at a state.

        Args:
            block: of the nodes.
            state: accepted state of the block.
            centres: (n, 3) mass centres in the axes of its nodes.
        """
        own, skew = np.s_[: block.owned], so3.skew
        R, c = rotations(state["frames"][own]), centres[own]
        v, w = state["velocity"][own], state["acceleration"][own]
        omega, spin, C = v[:, 3:], w[:, 3:], skew(c)
        arm = np.cross(omega, c)
        swing = np.cross(spin, c) + np.cross(omega, arm)
        one, none = np.tile(np.eye(3), (len(R), 1, 1)), np.zeros_like(R)
        # of omega x (omega x c)
        twice = -skew(arm) - skew(omega) @ C
        if block.inertial:
            by_twist = _joined(none, -R @ skew(arm), none, none)
            by_rate = _joined(one, -R @ C, none, one)
            w_mean = _joined(one, R @ C, none, one)
            w_twist = _joined(none, R @ skew(swing), none, none)
            w_rate = _joined(none, -R @ twice, none, none)
            back = R.swapaxes(1, 2)
            local = np.concatenate([applied(back, v[:, :3]), omega], axis=1)
            local_twist = _joined(none, skew(local[:, :3]), none, none)
            local_rate = _joined(back, none, none, one)
        else:
            V = v[:, :3]
            by_twist = _joined(none, -R @ skew(V + arm), none, none)
            by_rate = _joined(R, -R @ C, none, one)
            w_mean = _joined(R.swapaxes(1, 2), C, none, one)
            local = w[:, :3] + swing + np.cross(omega, V)
            w_twist = _joined(none, skew(local), none, none)
            w_rate = _joined(-skew(omega), -twice + skew(V), none, none)
            local, local_twist = v, np.zeros_like(by_rate)
            local_rate = np.tile(np.eye(6), (len(R), 1, 1))
        return cls(
            by_twist, by_rate, np.linalg.inv(by_rate), w_mean, w_twist, w_rate,
            np.linalg.inv(w_mean), local, local_twist, local_rate,
        )  # fmt: skip
