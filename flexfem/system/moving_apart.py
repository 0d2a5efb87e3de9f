# SPDX-License-Identifier: LGPL-3.0-or-later
"""Corrections of the trial state that pass through no contact: they are cut short."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexfem.system.system import System

__all__ = ["Moved", "move_apart", "predict_apart", "share_apart"]

#: Parts of their gaps that contacts keep in a correction, and that they must have kept in one that
#: is cut: its motion is not exactly the part of the whole one where nodes rotate.
_KEEP, _KEPT = 0.4, 0.3
#: The same in predicted motions.
_PREDICTED = 0.8
#: Part of the largest possible correction that is taken, and the number of times that it is cut.
_SHORTER, _TIMES = 0.95, 40


class Moved(NamedTuple):
    """Motion of all blocks by their steps.

    Attributes:
        largest: largest entry of the whole steps on this rank, m or rad.
        part: part of them that has been taken, the same on all ranks.
        unsettled: how much contact forces have changed, over what ends an iteration, the same on
            all ranks.
        success: False if a further equation of the motion could not be solved.
    """

    largest: float
    part: float = 1.0
    unsettled: float = 0.0
    success: bool = True


def move_apart(system: System, move: Callable[[], float]) -> Moved:
    """Move all blocks by their steps, or by a part of these (collective).

    Args:
        system: at the trial state.
        move: moves all blocks by their steps; returns the largest entry on this rank.
    """
    if not system.contacts:
        return Moved(move())
    contacts, blocks = system.contacts[0], [part.block for part in system.parts]
    before = [(block.increment.copy(), block.owned_step.copy()) for block in blocks]
    sizes = []

    def go(share: float) -> None:
        for block, (increment, step) in zip(blocks, before, strict=True):
            block.increment[:] = increment
            np.multiply(step, share, out=block.owned_step)
        sizes.append(move())

    contacts.mark()
    part = _safe_share(contacts.safe_part, go, _KEEP, _KEPT)
    contacts.cut = part < 1.0
    return Moved(sizes[0], part, contacts.unsettled())


def predict_apart(system: System, predict: Callable[[float], None]) -> None:
    """Start a step with the predicted trial state, or a share of the predicted motion (collective).

    Args:
        system: at the start of the step.
        predict: predicts a share of the whole motion.
    """
    if not system.contacts:
        predict(1.0)
        return
    _safe_share(system.contacts[0].safe_part_of_step, predict, _PREDICTED, _PREDICTED)


def share_apart(system: System, move: Callable[[float], None]) -> tuple[float, float]:
    """Move by a share of a motion of the trial state that passes through no contact (collective).

    Args:
        system: at the trial state.
        move: moves it by a share of the whole motion, from this state whenever it is called.

    Returns:
        The share, and how much contact forces have changed, over what ends an iteration.
    """
    if not system.contacts:
        move(1.0)
        return 1.0, 0.0
    contacts = system.contacts[0]
    contacts.mark()
    share = _safe_share(contacts.safe_part, move, _KEEP, _KEPT)
    return share, contacts.unsettled()


def _safe_share(
    safe_part: Callable[[float], float], go: Callable[[float], None], keep: float, kept: float
) -> float:  # fmt: skip
    """Go by the whole motion, or by shares of it until it passes through no contact (collective).

    Args:
        safe_part: part of the last motion in which all pairs keep a part of their gap.
        go: moves by a share of the whole motion, from its start whenever it is called.
        keep: part of the gaps that the whole motion keeps.
        kept: that of shares of it.

    Returns:
        The last share.
    """
    share = 1.0
    go(share)
    safe = safe_part(keep)
    for time in range(_TIMES):
        if safe >= 1.0 or share == 0.0:
            break
        share *= _SHORTER * safe if time + 1 < _TIMES else 0.0
        go(share)
        safe = safe_part(kept)
    return share
