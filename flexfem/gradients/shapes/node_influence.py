# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the places of nodes change in a motion: a few models for all of them.

Of the start positions and velocities of nodes change at the moved ones alone. Accelerations and
forces of rows there are those of equations with an adjoint of their own, see
``gradients.renewals.renewal``, whose derivatives by nodes at fixed positions are as local as those
of the equations of steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.node_maps import moved, start_moves
from flexfem.gradients.equations.values import (
    Equations,
    SystemEquations,
    copy_state,
    equations_at,
)
from flexfem.gradients.motion.arrays import Known, influence_of
from flexfem.gradients.motion.columns import Seeds
from flexfem.gradients.motion.direct import disturb, free_twists
from flexfem.gradients.motion.influence import (
    UNSCALED,
    Factors,
    Influence,
    Sums,
    beside,
    evaluated,
    start_by_blocks,
    start_of,
)
from flexfem.gradients.motion.parameters import Build, NodePath, Values
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.renewals.renewal import Accelerations
from flexfem.gradients.shapes.column_shares import ColumnShares, Shares
from flexfem.gradients.shapes.node_classes import NodeClasses, Owners
from flexfem.system.measure.probes import ProbeRecorder

__all__ = ["NodeInfluence", "influences_of"]

#: Displacements of differences over the distance to the nearest node.
_STEP = 1e-4
#: Rounding of columns over the step of differences, beside that of their changes.
_ROUNDING = 1e-8


def influences_of(
    motion: Motion, build: Build, values: Values, known: Known
) -> Mapping[str, Influence]:
    """What each parameter changes (collective), see ``motion.arrays.influence_of``."""
    return {
        name: NodeInfluence(motion, build, values, name) if NodePath.of(name)
        else influence_of(motion, build, values, name, known)
        for name in values
    }  # fmt: skip


class _Pair:
    """Two models whose nodes are moved to either side.

    Attributes:
        simulations: their starts.
        start: derivatives of the start by the parameter, for each block.
    """

    def __init__(
        self, motion: Motion, build: Build, values: Values, name: str, by: FloatArray
    ) -> None:
        """Build them, with displacements (n, 3), m, of a unit of the parameter (collective)."""
        self._motion = motion
        self.simulations = [
            beside(motion, build, {**values, name: values[name] + sign * by}, name)
            for sign in (1.0, -1.0)
        ]
        self._recorders = [
            ProbeRecorder(one.system, one.serial, depth=1) for one in self.simulations
        ]
        first, second = (start_of(motion, one) for one in self.simulations)
        self.start = start_by_blocks(motion, 0.5 * (first - second))
        parts = motion.system.parts
        self._moves = [
            [start_moves(a.block, b.block) for a, b in zip(parts, one.system.parts, strict=True)]
            for one in self.simulations
        ]

    def followed(self, seeds: Seeds) -> list[FloatArray]:
        """What nodes (n,) of each block change of a column by following their starts."""
        found = []
        for part, own, a, b in zip(
            self._motion.system.parts, seeds.blocks, *self._moves, strict=True
        ):
            free = free_twists(part.block, 0.5 * (a - b))
            sums = np.zeros(len(free))
            np.add.at(sums, own.nodes, (own.twists * free[own.nodes]).sum(axis=1))
            found.append(sums)
        return found

    def equations(self, step: int, between: SystemEquations | None) -> Equations:
        """Derivatives of equations, see ``motion.influence.evaluated`` (collective)."""
        first, second = (evaluated(self._motion, one, step, between) for one in self.simulations)
        return _half(first, second)

    def disturbed(self) -> Equations:
        """Derivatives of equations at the trial state of the motion (collective)."""
        found = []
        for one in self.simulations:
            one.system.set_time(self._motion.system.time)
            copy_state(self._motion.system, one.system)
            found.append(equations_at(one.system, UNSCALED))
        return _half(*found)

    def shares(self, shares: ColumnShares, t: float) -> Shares:
        """Derivatives of parts of columns, with nodes that follow (collective)."""
        found = []
        for one, recorder, moves in zip(
            self.simulations, self._recorders, self._moves, strict=True
        ):
            copy_state(self._motion.system, one.system)
            for part, other, by in zip(
                self._motion.system.parts, one.system.parts, moves, strict=True
            ):
                other.block.frames[:] = moved(part.block.frames, by, inertial=part.block.inertial)
            found.append(shares.values(recorder, one.serial.model, t))
        first, second = found
        return first.added(first, -0.5).added(second, -0.5)


def _half(first: Equations, second: Equations) -> Equations:
    """Half the differences of equations."""
    blocks = [0.5 * (a - b) for a, b in zip(first[0], second[0], strict=True)]
    return blocks, 0.5 * (first[1] - second[1])


@dataclass(frozen=True)
class _Group:
    """Nodes of a class that are moved along an axis."""

    owners: Owners
    axis: int
    pair: _Pair


class NodeInfluence:
    """Places of the nodes of a group; see ``motion.influence.Influence``."""

    def __init__(self, motion: Motion, build: Build, values: Values, name: str) -> None:
        """Build all models (collective).

        Raises:
            InputError: equations depend on nodes far away, or there is something by which they are
                not differentiated.
        """
        nodes = NodePath.of(name)
        assert nodes is not None
        motion.go_to(0)
        _check_supported(motion, name)
        self._motion, self._name, self.count = motion, name, values[name].size
        self._build, self._values = build, values
        self._classes = NodeClasses(nodes, motion.model, motion.system, motion.recorder)
        count = len(values[name])
        lengths = _STEP * self._classes.lengths
        self._lengths = lengths
        self._groups = []
        for owners in self._classes.classes(self._reach()):
            for axis in self._classes.axes:
                by = np.zeros((count, 3))
                by[owners.nodes, axis] = lengths[owners.nodes]
                self._groups.append(_Group(owners, axis, self._pair(by)))
        self._random = self._classes.at_random(np.arange(count))
        self._whole = self._pair(lengths.min() * self._random)
        self._check_start()

    def _pair(self, by: FloatArray) -> _Pair:
        return _Pair(self._motion, self._build, self._values, self._name, by)

    def _reach(self) -> int:
        """Elements between moved nodes and equations that depend on them (collective)."""
        motion, nodes = self._motion, self._classes.apart()
        by = self._classes.at_random(nodes) * self._lengths[:, np.newaxis]
        pair = self._pair(by)
        motion.go_to(0)
        disturb(motion)
        return self._classes.reach(nodes, pair.disturbed())

    def _check_start(self) -> None:
        """Compare the start with that of all nodes moved at once (collective).

        Raises:
            InputError: it does not change by the sum of what each node changes.
        """
        off = size = 0.0
        for k, whole in enumerate(self._whole.start):
            for name in ("q", "v"):
                left = getattr(whole, name) / self._lengths.min()
                size = max(size, float(np.abs(left).max(initial=0.0)))
                for group in self._groups:
                    own, of = getattr(group.pair.start[k], name), group.owners.blocks[k]
                    held = of[: len(own)] >= 0
                    owners = of[: len(own)][held]
                    factor = self._random[owners, group.axis] / self._lengths[owners]
                    left[held] -= factor[:, np.newaxis] * own[held]
                off = max(off, float(np.abs(left).max(initial=0.0)))
        # rates of a start at rest are rounding
        self._classes.check(np.array([off]), np.zeros(1), np.array([max(size, 1.0)]))

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See ``Influence``.

        Raises:
            InputError: equations depend on nodes far away.
        """
        return self._products(step, factors, None)

    def _products(
        self, step: int, factors: Sequence[Factors], between: SystemEquations | None
    ) -> FloatArray:  # fmt: skip
        """The same of the equations of a step, or of others at its state (collective)."""
        found = np.zeros((len(factors), self.count // 3, 3))
        for group in self._groups:
            changes = group.pair.equations(step, between)
            owners = [*group.owners.blocks, group.owners.rows]
            for out, own in zip(found, factors, strict=True):
                for of, products in zip(owners, self._by_equations(own, changes), strict=True):
                    self._add(out[:, group.axis], of, products)
        changes, sums = self._whole.equations(step, between), []
        for own in factors:
            each = self._by_equations(own, changes)
            sums.append([sum(float(f(x).sum()) for x in each) for f in (np.asarray, np.abs)])
        whole, size = np.array(sums).T / self._lengths.min()
        self._classes.check((found * self._random).sum(axis=(1, 2)), whole, size)
        return found.reshape(len(factors), -1)

    def _by_equations(self, factors: Factors, changes: Equations) -> list[FloatArray]:
        """Products of factors and changes of the equations of nodes of each block, and of rows."""
        (z, mu, _), (blocks, rows) = factors, changes
        products = [(a * b).sum(axis=1) for a, b in zip(z, blocks, strict=True)]
        return [*products, self._motion.system.constraints.owned * mu * rows]

    def _add(self, out: FloatArray, of: IntArray, products: FloatArray) -> None:
        """Add products of equations, whose owners stand in front, to sums (n,) of nodes."""
        own = of[: len(products)]
        held = own >= 0
        sums = np.bincount(own[held], products[held], minlength=len(out))
        out += sums / self._lengths

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See ``Influence``."""
        motion, rows = self._motion, self._motion.system.constraints
        motion.go_to(0)
        renewal = Accelerations(motion.system, motion.tangent, motion.options.dt, 0.0 * rows.values)
        renewal.take()
        sums, factors = [], list[Factors]()
        for own, _, forces in carried:
            copies = [Carried(x.q.copy(), x.v.copy(), x.a.copy(), x.w.copy()) for x in own]
            z, mu = renewal.back(copies, np.zeros(rows.size), forces.copy())
            sums.append(copies)
            factors.append((z, mu, np.zeros(0)))
        found = -self._products(0, factors, renewal)
        motion.go_to(0)
        shaped = found.reshape(len(carried), -1, 3)
        for group in self._groups:
            for out, own in zip(shaped, sums, strict=True):
                for of, x, by in zip(group.owners.blocks, own, group.pair.start, strict=True):
                    products = (x.q * by.q).sum(axis=1) + (x.v * by.v).sum(axis=1)
                    self._add(out[:, group.axis], of, products)
        return found

    def event_changes(self, state: int) -> FloatArray:
        """See ``Influence``: there are no events."""
        return np.zeros(self.count)

    def direct_products(self, step: int, weights: FloatArray, seeds: Sequence[Seeds]) -> FloatArray:
        """See ``Influence``.

        Raises:
            InputError: columns depend on nodes far away.
        """
        motion, t = self._motion, float(self._motion.times[step])
        found = np.zeros((len(weights), self.count // 3, 3))
        used = tuple(n for n, own in zip(motion.columns, weights.T, strict=True) if own.any())
        if not used:
            return found.reshape(len(weights), -1)
        shares = ColumnShares(motion.model, used, self._name)
        at, together = (motion.system, motion.recorder), np.zeros(len(weights))
        for group in self._groups:
            change, own = group.pair.shares(shares, t), found[:, :, group.axis]
            direct = shares.products(weights, change, at, group.owners, own.shape[1])
            own += direct / self._lengths
            together += direct @ (self._random[:, group.axis] / self._lengths)
            for out, every in zip(own, seeds, strict=True):
                for of, products in zip(
                    group.owners.blocks, group.pair.followed(every), strict=True
                ):
                    self._add(out, of, -products)
        everything = Owners.everything(motion.system, motion.model)
        change = self._whole.shares(shares, t)
        whole = shares.products(weights, change, at, everything, 1)[:, 0] / self._lengths.min()
        at_rows = motion.values[motion.rows_at == step]  # on the first rank
        values = np.abs(weights) @ np.abs(at_rows).sum(axis=0) / self._lengths.min()
        self._classes.check(together, whole, np.abs(together) + _ROUNDING * values)
        return found.reshape(len(weights), -1)


def _check_supported(motion: Motion, name: str) -> None:
    """Refuse what the start, or nodes one by one, have no derivatives with (collective)."""
    system, rows = motion.system, motion.system.constraints
    found = {
        "other integrators than generalized_alpha": (
            motion.options.integrator != "generalized_alpha"
        ),
        "events": bool(motion.model.events),
        "states of force elements, controllers or internal variables": motion.remembering,
        "damping of modes": system.modal_dampers is not None,
        "damping that ends accelerations at the start": motion.start_decayed,
        "contacts": bool(system.contacts),
        "stops and other unilateral forces": bool(rows.unilateral.any()) or rows.split,
    }
    every = [what for what in found if system.comm.allreduce(found[what], op=MPI.LOR)]
    if missing := next(iter(every), None) or motion.not_renewed():
        raise InputError(
            f'gradient: there are no derivatives by nodes ("{name}") of motions with {missing} yet'
        )
