# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the forces of contact groups over a step by the motion of their points.

They are differences of fourth order of the forces themselves, damping, friction and closest points
of obstacles included, of copies of the groups that have points of their own: one evaluation moves a
point of each of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.barrier.grouped import GroupedPairs
from flexfem.contact.dissipation.data import ARMS, PUSH, SLIP, Groups, StepMotion
from flexfem.contact.primitives.data import GAP, VERTEX_VERTEX, Pairs
from flexfem.core.differences import STENCIL
from flexfem.gradients.unilateral.friction import Friction

__all__ = ["AFTER", "BEFORE", "RATES", "SPINS", "SPIN_RATES", "Entries", "GroupDerivatives"]

#: Motions of points on which forces depend; the last three with friction alone.
AFTER, BEFORE, SPINS, RATES, SPIN_RATES = "after", "before", "spins", "rates", "spin_rates"
#: Differences of positions, in parts of the gap, or of what is missing to that at which surfaces
#: repel, but not below a part of the latter: truncation and rounding are 3e-9 of the derivative
#: then.
_STEP, _LEAST = 2e-3, 1e-3
#: Numbers of a copied point: its force, weight and arm times weight, normal force and slips.
_FIELDS = 14
_AXES, _LAWS = np.arange(3), [PUSH, *range(SLIP, SLIP + 6)]
#: Weights of differences of fourth order, and of those of what is linear.
_LINEAR = ((1.0, 1 / 2), (-1.0, -1 / 2))
#: Place of points that nothing touches, m.
_FAR = 1e12


@dataclass(frozen=True)
class _Copies:
    """Groups that act, each with points of its own.

    Attributes:
        pairs: those that act; chosen: their numbers.
        points: rows (n,) of the points that are copied.
        group: number (n,) of the group of each copy, counted here.
        place: number (n,) of each copy in its group.
        motion: of the copies; two more are far away.
    """

    pairs: Pairs
    chosen: IntArray
    points: IntArray
    group: IntArray
    place: IntArray
    motion: StepMotion

    @classmethod
    def of(cls, own: GroupedPairs) -> _Copies:
        """Those of pairs at the last evaluation."""
        pairs, acting = own.pairs, own.response.pairs[: own.count]
        groups = np.searchsorted(pairs.starts, acting, side="right") - 1
        numbers, count = np.unique(groups, return_counts=True)
        # a pair of several is no pair alone
        several = np.diff(pairs.starts)[numbers] > 1
        beside = acting[np.searchsorted(groups, numbers[several & (count == 1)])]
        chosen = np.concatenate([acting, beside])
        far = np.arange(len(chosen)) >= len(acting)
        order = np.argsort(chosen, kind="stable")
        chosen, far = chosen[order], far[order]
        group = np.searchsorted(numbers, np.searchsorted(pairs.starts, chosen, side="right") - 1)
        total, near = len(own.motion.after), ~far
        keys = group[near, np.newaxis] * total + pairs.points[chosen[near]]
        found, places = np.unique(keys, return_inverse=True)
        points = np.empty((len(chosen), pairs.points.shape[1]), dtype=np.int64)
        points[near] = places.reshape(keys.shape)
        points[far] = len(found) + 1
        points[far, 0] = len(found)
        copies = Pairs(
            kind=np.where(far, VERTEX_VERTEX, pairs.kind[chosen]), points=points,
            weight=pairs.weight[chosen], touch=pairs.touch[chosen], dhat=pairs.dhat[chosen],
            kappa=pairs.kappa[chosen],
            starts=np.searchsorted(group, np.arange(len(numbers) + 1)).astype(np.int64),
            keys=numbers.astype(np.int64),
        )  # fmt: skip
        of_group, rows = found // total, found % total
        first = np.searchsorted(of_group, np.arange(len(numbers)))
        return cls(
            copies, chosen, rows, of_group, np.arange(len(found)) - first[of_group],
            _copied(own.motion, rows),
        )  # fmt: skip


def _copied(motion: StepMotion, rows: IntArray) -> StepMotion:
    """Motion of some points (k,), and of two that are far away."""
    far = np.array([[_FAR, 0.0, 0.0], [-_FAR, 0.0, 0.0]])
    still = np.zeros((2, 3))
    return StepMotion(
        before=np.concatenate([motion.before[rows], far]),
        after=np.concatenate([motion.after[rows], far]),
        spins=np.concatenate([motion.spins[rows], still]),
        rates=np.concatenate([motion.rates[rows], still]),
        spin_rates=np.concatenate([motion.spin_rates[rows], still]),
        radius=np.concatenate([motion.radius[rows], np.ones(2)]), dt=motion.dt,
    )  # fmt: skip


@dataclass(frozen=True)
class Entries:
    """Entries (e,) of a matrix (n, 6) by (m, 3): forces and couples of points by their motions."""

    rows: IntArray
    columns: IntArray
    values: FloatArray

    def apply(self, motions: FloatArray) -> FloatArray:
        """Forces and couples (n, 6) by motions (n, 3)."""
        products, size = self.values * motions.ravel()[self.columns], 2 * motions.size
        return np.bincount(self.rows, products, size).reshape(-1, 6)

    def apply_transposed(self, factors: FloatArray) -> FloatArray:
        """Factors (n, 3) of motions by those (n, 6) of forces and couples."""
        products = self.values * factors.ravel()[self.rows]
        return np.bincount(self.columns, products, factors.size // 2).reshape(-1, 3)


class GroupDerivatives:
    """Derivatives of the forces and couples on all points, at the last evaluation.

    Friction is differentiated by hand by normal forces and slips, of which differences are taken:
    what sticks has slips that are less than rounding allows differences to be.

    Attributes:
        matrices: by each motion of the points; entries of points count twice where two groups do.
    """

    def __init__(self, own: GroupedPairs) -> None:
        """Compute them, those of pairs that act in the present step."""
        self._own, self._copies = own, _Copies.of(own)
        copies = self._copies.pairs
        self._work = own.kind.response_of(copies), Groups.of(copies)
        self._still = self._act(self._copies.motion)
        if own.rubs:
            self._friction = Friction.of(
                own.law, self._copies.motion.dt, self._of_groups(self._work[1].numbers)
            )
        names = (AFTER, BEFORE, *((SPINS, RATES, SPIN_RATES) if own.rubs else ()))
        steps = self._steps()
        self.matrices = {name: self._derivative(name, steps[name]) for name in names}

    def _act(self, motion: StepMotion) -> FloatArray:
        """What copies do: (n, 14) forces, weights and arms, normal forces and slips of groups."""
        copies, groups = self._copies, self._work[1]
        groups.forget()
        forces = self._own.act_alone(copies.pairs, copies.chosen, motion, self._work)[:-2]
        found = np.zeros((len(forces), _FIELDS))
        found[:, :3] = forces
        if self._own.rubs:
            count = int(groups.count[0])
            entries = np.arange(int(groups.starts[count]) if count else 0)
            group = np.searchsorted(groups.starts[1 : count + 1], entries, side="right")
            points, second = groups.points[entries], entries >= groups.sides[group]
            arms = groups.numbers[group[:, np.newaxis], ARMS + 3 * second[:, np.newaxis] + _AXES]
            found[points, 3] = groups.weights[entries]
            found[points, 4:7] = groups.weights[entries, np.newaxis] * arms
            found[:, 7:] = self._of_groups(groups.numbers)[self._copies.group][:, _LAWS]
        return found

    def _of_groups(self, numbers: FloatArray) -> FloatArray:
        """Numbers of all copied groups, zero for those that do not push."""
        groups = self._work[1]
        count = int(groups.count[0])
        found = np.zeros((len(self._copies.pairs.keys), numbers.shape[1]))
        found[groups.every[:count]] = numbers[:count]
        return found

    def _loads(self, changes: FloatArray) -> FloatArray:
        """Changes (n, 6) of forces and couples by those (n, 14) of what copies do."""
        found = np.zeros((len(changes), 6))
        found[:, :3] = changes[:, :3]
        if self._own.rubs:
            group, still = self._copies.group, self._still
            force = self._friction.force[group]
            change = np.einsum("gij,gj->gi", self._friction.slopes[group], changes[:, 7:])
            found[:, :3] += changes[:, 3:4] * force + still[:, 3:4] * change
            found[:, 3:] = np.cross(changes[:, 4:7], force) + np.cross(still[:, 4:7], change)
        return found

    def _lengths(self, motion: StepMotion) -> FloatArray:
        """Least length (g,) by which the forces of each group differ much at the end."""
        copies, response = self._copies, self._work[0]
        self._act(motion)
        count = int(response.count[0])
        acting = response.pairs[:count]
        least = np.full(len(copies.pairs.keys), np.inf)
        group = np.searchsorted(copies.pairs.starts, acting, side="right") - 1
        gaps, reach = np.abs(response.numbers[:count, GAP]), copies.pairs.dhat[acting]
        lengths = np.minimum(gaps, np.maximum(np.abs(reach - gaps), _LEAST * reach))
        np.minimum.at(least, group, lengths)
        return least

    def _steps(self) -> dict[str, FloatArray]:
        """Differences (g,) of each motion for each group; slips are linear in the last three."""
        motion, copies = self._copies.motion, self._copies.pairs
        backwards = _with(motion, before=motion.after, after=motion.before)
        after, before = (_STEP * self._lengths(one) for one in (motion, backwards))
        reach = np.full(len(after), np.inf)
        group = np.repeat(np.arange(len(after)), np.diff(copies.starts))
        np.minimum.at(reach, group, copies.dhat)
        rates, spins = reach / motion.dt, np.full(len(after), 1e-2)
        return {
            AFTER: after, BEFORE: before, SPINS: spins, RATES: rates, SPIN_RATES: spins / motion.dt,
        }  # fmt: skip

    def _derivative(self, name: str, steps: FloatArray) -> Entries:
        """The matrix of one motion, with differences of some size (g,)."""
        copies, width = self._copies, 6 if self._own.rubs else 3
        found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
        base = getattr(copies.motion, name)
        weights = STENCIL if name in (AFTER, BEFORE) else _LINEAR
        for place in range(int(copies.place.max(initial=-1)) + 1):
            moved = np.flatnonzero(copies.place == place)
            of_group = np.full(len(steps), -1)
            of_group[copies.group[moved]] = copies.points[moved]
            seen = np.flatnonzero(of_group[copies.group] >= 0)
            rows = 6 * copies.points[seen, np.newaxis] + np.arange(width)
            columns = np.repeat(3 * of_group[copies.group[seen]], width)
            for a in range(3):
                change = np.zeros((len(copies.points), _FIELDS))
                for part, weight in weights:
                    at = base.copy()
                    at[moved, a] += part * steps[copies.group[moved]]
                    change += weight * self._act(_with(copies.motion, **{name: at}))
                change /= steps[copies.group, np.newaxis]
                found.append((rows.ravel(), columns + a, self._loads(change)[seen, :width].ravel()))
        return Entries(*(np.concatenate(one) for one in zip(*found, strict=True)))


def _with(motion: StepMotion, **changed: FloatArray) -> StepMotion:
    """A motion with other arrays."""
    names = (BEFORE, AFTER, SPINS, RATES, SPIN_RATES, "radius", "dt")
    return StepMotion(**{**{name: getattr(motion, name) for name in names}, **changed})
