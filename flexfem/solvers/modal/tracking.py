# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes followed over a parameter, and the sense in which they whirl."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.lie import se3
from flexfem.solvers.modal.mode_errors import ComplexArray
from flexfem.solvers.modal.mode_shapes import Modes

__all__ = ["follow", "whirl"]

#: Decay of a candidate's score with its distance from the expected eigenvalue.
_DISTANCE = 4.0
#: Shapes that correlate less are not the same mode.
_ALIKE = 0.3


def follow(steps: Sequence[Modes], count: int) -> list[IntArray]:
    """Numbers of the modes that continue the first ones of the last step (collective).

    Modes are compared from the last step to the first, where equal frequencies of a symmetric model
    at rest may leave the choice open. Both a mode and its complex conjugate are candidates: a whirl
    whose frequency in rotating axes passes zero continues as the conjugate one. The score is the
    mass-weighted correlation of the shapes, reduced by the distance of the eigenvalue from the one
    that is extrapolated.

    Args:
        steps: modes at each value of the parameter, equally spaced; their number may differ.
        count: number of modes of the last step to follow.

    Returns:
        For each step the (k,) mode that continues mode i of the last step, -1 where none is left.
    """
    last = steps[-1].first(count)
    numbers: list[IntArray] = [np.arange(len(last))]
    conjugate = np.zeros(len(last), dtype=bool)
    expected = last.eigenvalues.copy()
    previous = last.eigenvalues.copy()
    for k in range(len(steps) - 2, -1, -1):
        new, old = steps[k], steps[k + 1]
        score, flipped = _scores(new, old, numbers[0], conjugate, expected)
        chosen = _assign(score)
        reached = previous.copy()
        for i, j in enumerate(chosen.tolist()):
            if j >= 0:
                conjugate[i] = flipped[i, j]
                value = new.eigenvalues[j]
                reached[i] = value.conjugate() if conjugate[i] else value
        expected = 2.0 * reached - previous
        previous = reached
        numbers.insert(0, chosen)
    return numbers


def _scores(
    new: Modes, old: Modes, number: IntArray, conjugate: np.ndarray, expected: ComplexArray
) -> tuple[FloatArray, np.ndarray]:
    """Scores (k, m) of the new modes as continuations, and True for those of conjugates."""
    plain, crossed = old.correlation(new), old.correlation(new.conjugate())
    count = len(number)
    score = np.full((count, len(new)), -1.0)
    flipped = np.zeros((count, len(new)), dtype=bool)
    scale = float(np.abs(new.eigenvalues).max(initial=0.0)) or 1.0
    for i in range(count):
        if number[i] < 0:
            continue
        straight, turned = plain[number[i]], crossed[number[i]]
        if conjugate[i]:
            straight, turned = turned, straight
        for j, value in enumerate(new.eigenvalues):
            size = max(abs(expected[i]), 1e-3 * scale)
            pair = [
                mac / (1.0 + _DISTANCE * abs(candidate - expected[i]) / size)
                for mac, candidate in ((straight[j], value), (turned[j], value.conjugate()))
            ]
            flipped[i, j] = pair[1] > pair[0]
            if max(straight[j], turned[j]) > _ALIKE:
                score[i, j] = max(pair)
    return score, flipped


def _assign(score: FloatArray) -> IntArray:
    """Pairs of largest scores first; -1 for rows that are left without."""
    left = score.copy()
    chosen = np.full(len(score), -1, dtype=np.int64)
    for _ in range(min(score.shape)):
        i, j = np.unravel_index(int(np.argmax(left)), left.shape)
        if left[i, j] < 0.0:
            break
        chosen[i] = j
        left[i, :] = left[:, j] = -1.0
    return chosen


def whirl(modes: Modes, axis: FloatArray) -> FloatArray:
    """(k,) sense of whirl about an axis: 1 all nodes rotate with it, -1 against it (collective).

    The motion ``Re(d exp(i omega t))`` across the axis is the sum of one that rotates with it, of
    amplitude ``|d_p + i d_q|/2``, and one against it, for displacements as for rotations; the
    result is the difference of their shares of the kinetic energy. 0 for plane motions, small for
    torsion and extension.
    """
    lin = modes.linearization
    p = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    p /= np.linalg.norm(p)
    across = np.stack([p, np.cross(axis, p)])
    sense = np.zeros(len(modes))
    for k, (shape, momentum) in enumerate(zip(modes.shapes, modes.momenta, strict=True)):
        for part, u, m in zip(lin.system.parts, lin.split(shape), lin.split(momentum), strict=True):
            R = se3.rotation(part.block.frames[: part.block.owned])
            turn = np.einsum("ai,nij->naj", across, R)
            for half in (slice(0, 3), slice(3, 6))[: part.block.width // 3]:
                d, h = (np.einsum("naj,nj->an", turn, field[:, half]) for field in (u, m))
                # |d_p + i d_q|^2 - |d_p - i d_q|^2, over two, with masses between
                sense[k] += np.sum(1j * (d[0].conj() * h[1] - d[1].conj() * h[0])).real
    total: FloatArray = np.asarray(lin.system.comm.allreduce(sense))
    return total
