# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear maps between variations of the state of nodes over a step.

Variations of configurations are local twists. With the increment n of a step from 0 to 1
``dq1 = E dq0 + F dn``: on SE(3) ``E = Ad(exp(-n))`` and ``F = T(n)``, on R^3 x SO(3)
``E = diag(R1^T R0, exp(-n_rot))`` and ``F = diag(R1^T, T(n_rot))`` (Brüls, Cardona, Arnold, Mech.
Mach. Theory 48 (2012) 121-137; Sonneville, Brüls, Multibody Syst. Dyn. 31 (2014) 47-67). Rates are
those of the increments; local twists and their rates vary with them and with the configuration by
``dV = Lv dv + Qv dq`` and ``dW = Lv dw + Nv dv + Qw dq``.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import step_rates
from flexfem.gradients.equations.kernels import apply_maps, apply_transposed_maps, step_maps
from flexfem.lie import se3, so3

__all__ = [
    "DirectorTurns", "RateMaps", "StepMaps", "TwistMap", "applied", "fixed_apart", "following",
    "increments_between", "moved", "moved_apart", "rotations", "start_moves", "transposed",
    "twists",
]  # fmt: skip

#: Distance of nodes at the starts of two models, m or 1, up to which it is rounding.
_ROUNDING = 1e-13


def rotations(frames: FloatArray) -> FloatArray:
    """Rotation matrices (n, 3, 3) of frames (n, 12)."""
    return frames[:, 3:].reshape(-1, 3, 3)


def twists(frames: FloatArray, moved: FloatArray, *, inertial: bool) -> FloatArray:
    """Local twists (n, 6) from frames to others (n, 12)."""
    if not inertial:
        return se3.log(se3.compose(se3.inverse(frames), moved))
    R = rotations(frames)
    turns = np.einsum("nji,njk->nik", R, rotations(moved))
    way = np.einsum("nji,nj->ni", R, moved[:, :3] - frames[:, :3])
    return np.concatenate([way, so3.log(turns)], axis=1)


def moved(frames: FloatArray, by: FloatArray, *, inertial: bool) -> FloatArray:
    """Frames (n, 12) moved by local twists (n, 6), the inverse of :func:`twists`."""
    if not inertial:
        return se3.retract(frames, by)
    found, R = frames.copy(), rotations(frames)
    found[:, :3] += np.einsum("nij,nj->ni", R, by[:, :3])
    found[:, 3:] = (R @ so3.exp(by[:, 3:])).reshape(-1, 9)
    return found


def increments_between(frames: FloatArray, after: FloatArray, *, inertial: bool) -> FloatArray:
    """Increments (n, 6) of a step from frames to those after it (n, 12)."""
    if not inertial:
        return twists(frames, after, inertial=False)
    turns = np.einsum("nji,njk->nik", rotations(frames), rotations(after))
    return np.concatenate([after[:, :3] - frames[:, :3], so3.log(turns)], axis=1)


def start_moves(block: FrameBlock, other: FrameBlock) -> FloatArray:
    """Local twists (n, 6) of nodes from their start to that in another model."""
    frames, after = block.start_frames, other.start_frames
    at = np.flatnonzero(np.abs(frames - after).max(axis=1, initial=0.0) > _ROUNDING)
    found = np.zeros((len(frames), 6))
    found[at] = twists(frames[at], after[at], inertial=block.inertial)
    return found


def fixed_apart(block: FrameBlock, other: FrameBlock) -> FloatArray:
    """Frames (n, 12) of a block, whose fixed unknowns move with the start of another one.

    A parameter may move them, as the width of a plate does those of its clamped edge.
    """
    return moved_apart(block, other, block.frames)


def moved_apart(block: FrameBlock, other: FrameBlock, frames: FloatArray) -> FloatArray:
    """The same of any frames (n, 12) of the nodes of the block."""
    if block.dirichlet is None:
        return frames.copy()
    moves = start_moves(block, other)
    moves[:, : block.width][~block.dirichlet] = 0.0
    moves[:, block.width :] = 0.0
    return _moved_some(block, frames, moves)


def following(block: FrameBlock, other: FrameBlock) -> FloatArray:
    """Frames (n, 12) of a block, all of which move with the start of another one."""
    return _moved_some(block, block.frames, start_moves(block, other))


def _moved_some(block: FrameBlock, frames: FloatArray, moves: FloatArray) -> FloatArray:
    """Frames of a block, of which those with twists that are not zero are moved."""
    found, at = frames.copy(), np.flatnonzero(moves.any(axis=1))
    found[at] = moved(frames[at], moves[at], inertial=block.inertial)
    return found


def applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """``matrices[i] vectors[i]``, (n, k)."""
    found: FloatArray = np.einsum("nij,nj->ni", matrices, vectors)
    return found


def transposed(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """``matrices[i]^T vectors[i]``, (n, k)."""
    found: FloatArray = np.einsum("nji,nj->ni", matrices, vectors)
    return found


@dataclass(frozen=True)
class TwistMap:
    """Linear maps of twists of some nodes, block upper triangular.

    Attributes:
        blocks: (n, 27) blocks A, U and D of ``[[A, U], [0, D]]``; of nodes without rotations A
            counts alone.
    """

    blocks: FloatArray

    def __call__(self, vectors: FloatArray) -> FloatArray:
        """Products with vectors (n, w)."""
        out = np.empty(vectors.shape)
        apply_maps(self.blocks, np.ascontiguousarray(vectors), out)
        return out

    def transposed(self, vectors: FloatArray) -> FloatArray:
        """Products of the transposed maps."""
        out = np.empty(vectors.shape)
        apply_transposed_maps(self.blocks, np.ascontiguousarray(vectors), out)
        return out


@dataclass(frozen=True)
class DirectorTurns:
    """Rotations of nodes about an axis about which their increments do not rotate.

    They follow from those about the other axes, which do not commute: a local twist x at the end of
    a step is that of an increment ``F^-1 x``, whose component along the axis is zero.

    Attributes:
        nodes: (m,) owned nodes; column: (m,) of that axis in the twists.
        factors: (m, 3) of the rotations about the three axes, zero for that one.
    """

    nodes: IntArray
    column: IntArray
    factors: FloatArray

    @classmethod
    def of(cls, block: FrameBlock) -> "DirectorTurns":
        """Those of the owned nodes of a block at its trial state."""
        axis = block.unturned[: block.owned]
        nodes = np.flatnonzero(axis >= 0)
        axis, rows = axis[nodes], np.arange(len(nodes))
        inverse = so3.inverse_tangent(block.increment[nodes, 3:])[rows, axis]
        factors = -inverse / inverse[rows, axis][:, np.newaxis]
        factors[rows, axis] = 0.0
        return cls(nodes, 3 + axis, factors)

    def add(self, twists: FloatArray) -> None:
        """Add the rotations of twists (n, w) that have none along the axes, in place."""
        if not len(self.nodes):  # of points, too
            return
        turns = (self.factors * twists[self.nodes, 3:]).sum(axis=1)
        twists[self.nodes, self.column] += turns

    def add_transposed(self, sums: FloatArray) -> None:
        """The transposed of :meth:`add`, which leaves zeros along the axes."""
        if not len(self.nodes):
            return
        along = sums[self.nodes, self.column]
        sums[self.nodes, 3:] += self.factors * along[:, np.newaxis]
        sums[self.nodes, self.column] = 0.0


@dataclass(frozen=True)
class StepMaps:
    """Maps of the owned nodes of a block over a step.

    Attributes:
        before: E, from twists at the step's start to those at its end.
        by_increment: F, from increments to twists at the end; inverse: its inverse.
        axes: from twists at the end to those in the axes of the accepted state, which some
            families rotate with their elements.
        held: (n, w) fixed unknowns along which twists have no variations, None if there are none;
            about the axes of :class:`DirectorTurns` they have.
        unturned: (n,) these axes, about which rates of increments have none, -1 without one.
    """

    before: TwistMap
    by_increment: TwistMap
    inverse: TwistMap
    axes: TwistMap
    held: BoolArray | None
    unturned: IntArray

    @classmethod
    def of(cls, block: FrameBlock, accepted: FloatArray) -> "StepMaps":
        """Maps of the step of a block's trial state.

        Args:
            block: at the trial state of the step.
            accepted: (n, 12) frames of the accepted state after it.
        """
        out = np.empty((4, block.owned, 27))
        step_maps(block.nodes.memory, accepted, out)
        held = None if block.dirichlet is None else block.dirichlet[: block.owned].copy()
        unturned = block.unturned[: block.owned]
        if held is not None and block.width == 6:
            held[unturned >= 0, 3:] = False
        before, by_increment, inverse, axes = (TwistMap(own) for own in out)
        return cls(before, by_increment, inverse, axes, held, unturned)

    def hold(self, twists: FloatArray) -> FloatArray:
        """Local twists without those along unknowns that have no variations, in place."""
        if self.held is not None:
            twists[self.held] = 0.0
        return twists

    def hold_rates(self, rates: FloatArray) -> FloatArray:
        """Rates of increments, or what multiplies them, without those along fixed unknowns."""
        if self.held is None:
            return rates
        found = self.inverse(self.hold(self.by_increment(rates)))
        at = np.flatnonzero(self.unturned >= 0)
        found[at, 3 + self.unturned[at]] = 0.0
        return found


@dataclass(frozen=True)
class RateMaps:
    """Maps of the owned nodes of a block at an accepted state, (n, 6, 6): Lv, Qv, Nv, Qw."""

    by_rate: FloatArray
    turning: FloatArray
    by_rate_again: FloatArray
    turning_again: FloatArray

    @classmethod
    def of(cls, block: FrameBlock) -> "RateMaps":
        """Maps at the accepted state, with increments of zero."""
        own = np.s_[: block.owned]
        forms = []
        for rates in ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0)):
            out = np.empty((len(block.frames), 2, 36))
            step_rates(block.nodes.memory, np.array(rates), block.inertial, out)
            forms.append(out.reshape(-1, 2, 6, 6)[own])
        still, moved = forms
        F = np.tile(np.eye(6), (block.owned, 1, 1))
        if block.inertial:
            F[:, :3, :3] = rotations(block.frames[own]).transpose(0, 2, 1)
        return cls(
            (moved[:, 0] - still[:, 0]) @ F, still[:, 0], (moved[:, 1] - still[:, 1]) @ F,
            still[:, 1],
        )  # fmt: skip

    @classmethod
    def by_rates(cls, block: FrameBlock) -> FloatArray:
        """Maps (n, w, w) from rates of increments to those of local twists, w unknowns a node."""
        return cls.of(block).by_rate[:, : block.width, : block.width]
