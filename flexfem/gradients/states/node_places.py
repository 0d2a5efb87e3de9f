# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of equilibria by the places of nodes: a few models for all of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.gradients.equations.values import copy_state
from flexfem.gradients.motion.parameters import NodePath, refusing
from flexfem.gradients.shapes.column_shares import ColumnShares, Shares
from flexfem.gradients.shapes.node_classes import NodeClasses, Owners
from flexfem.gradients.states.neighbours import NodeParameters
from flexfem.gradients.states.path import Equilibria, NearPath
from flexfem.model.model import Model

__all__ = ["Wanted", "gradient_by_nodes"]

#: Rounding of columns over the step of differences, beside that of their changes.
_ROUNDING = 1e-4


@dataclass(frozen=True)
class Wanted:
    """What is differentiated.

    Attributes:
        adjoints: (functionals, n) by the rows of the history on which functionals depend.
        weights: (functionals, columns of the history) by these rows.
        columns: names of the columns.
    """

    adjoints: Mapping[int, FloatArray]
    weights: Mapping[int, FloatArray]
    columns: Sequence[str]


def gradient_by_nodes(path: Equilibria, wanted: Wanted, nodes: NodeParameters) -> FloatArray:
    """This rank's part of derivatives (functionals, coordinates) of functionals (collective).

    Raises:
        InputError: equations or columns depend on nodes far away.
    """
    where = NodePath.of(nodes.name)
    assert where is not None
    classes = NodeClasses(where, path.model, path.system, path.recorder)
    one = _OfNodes(path, wanted, nodes, classes)
    return one.gradient(classes.classes(_reach(path, nodes, classes)))


def _reach(path: Equilibria, nodes: NodeParameters, classes: NodeClasses) -> int:
    """Elements between moved nodes and equations that depend on them (collective).

    Raises:
        InputError: there are too many.
    """
    path.go_to(path.rows - 1)
    moved = classes.apart()
    by = classes.lengths[:, np.newaxis] * classes.at_random(moved)
    blocks = [np.zeros(part.block.owned_step.shape) for part in path.system.parts]
    rows = np.zeros(path.system.constraints.size)
    for model, weight in nodes.neighbours(by):
        near = _near(path, model, nodes.name)
        near.go_to_present()
        copy_state(path.system, near.system)  # nodes stay, so that the shape acts most
        near.system.interface.update()
        own, values = near.residual()
        blocks = [a + weight * b for a, b in zip(blocks, own, strict=True)]
        rows += weight * values
    return classes.reach(moved, (blocks, rows))


def _near(path: Equilibria, model: Model, name: str) -> NearPath:
    """A neighbour of the model (collective).

    Raises:
        InputError: it cannot be, as joints do not hold where nodes have been moved.
    """
    with refusing(name):
        return NearPath(path, model, name)


class _OfNodes:
    """Derivatives by nodes, and what they say of a displacement of all nodes at random."""

    def __init__(
        self, path: Equilibria, wanted: Wanted, nodes: NodeParameters, classes: NodeClasses
    ) -> None:
        self._path, self._wanted, self._nodes = path, wanted, nodes
        self._classes = classes
        self._shares = ColumnShares(path.model, wanted.columns, nodes.name)
        self._random = classes.at_random(np.arange(len(classes.places)))

    def gradient(self, classes: Sequence[Owners]) -> FloatArray:
        """Derivatives (functionals, coordinates) (collective)."""
        rows, count = list(self._wanted.adjoints), len(self._classes.places)
        # of columns at fixed places of nodes, and of equations
        found = np.zeros((2, len(self._wanted.adjoints[rows[0]]) if rows else 0, count, 3))
        lengths = self._classes.lengths
        for owners in classes:
            of = self._owner_of_equations(owners)
            held = of >= 0
            for axis in self._classes.axes:
                by = np.zeros((count, 3))
                by[owners.nodes, axis] = lengths[owners.nodes]
                direct, equations = found[..., axis]
                for row, change, shares in self._changes(by):
                    direct += self._by_columns(row, shares, owners, count) / lengths
                    for k, z in enumerate(self._wanted.adjoints[row]):
                        products = z[held] * change[held]
                        sums = np.bincount(of[held], products, minlength=count)
                        equations[k] -= sums / lengths
        self._check_whole(found)
        total: FloatArray = found.sum(axis=0)
        return total.reshape(len(total), -1)

    def _by_columns(self, row: int, shares: Shares, owners: Owners, count: int) -> FloatArray:
        """Changes (functionals, count) of columns of a row, where the path is (collective)."""
        at = self._path.system, self._path.recorder
        return self._shares.products(self._wanted.weights[row], shares, at, owners, count)

    def _owner_of_equations(self, owners: Owners) -> IntArray:
        """Owners of all equations of this rank's vector."""
        system = self._path.system
        blocks = [
            np.repeat(own[: part.block.owned], part.block.owned_step.shape[1])
            for part, own in zip(system.parts, owners.blocks, strict=True)
        ]
        return np.concatenate([*blocks, owners.rows[system.constraints.owned_rows]])

    def _changes(self, by: FloatArray) -> Iterator[tuple[int, FloatArray, Shares]]:
        """Changes of equations and of parts of columns with displacements, by rows (collective).

        Nodes follow their starts: the equations of stiff bodies that change their shape in place
        would change by far more than what counts.
        """
        path, rows = self._path, list(self._wanted.adjoints)
        equations = [np.zeros(path.size) for _ in rows]
        parts: list[Shares | None] = [None for _ in rows]
        for model, weight in self._nodes.neighbours(by):
            near = _near(path, model, self._nodes.name)
            for k, row in enumerate(rows):
                path.go_to(row)
                near.go_to_present()
                equations[k] += weight * path.vector(*near.residual())
                t = float(path.times[row])
                own = self._shares.values(near.recorder, near.serial.model, t)
                before = parts[k] or own.added(own, -1.0)
                parts[k] = before.added(own, weight)
        for row, own_equations, shares in zip(rows, equations, parts, strict=True):
            assert shares is not None
            path.go_to(row)
            yield row, own_equations, shares

    def _check_whole(self, found: FloatArray) -> None:
        """Compare with changes by all nodes at once, along the random displacements (collective).

        Raises:
            InputError: they are not the sum of those by each.
        """
        everything = Owners.everything(self._path.system, self._path.model)
        length = float(self._classes.lengths.min())
        whole, sizes = np.zeros((2, *found.shape[:2]))
        for row, change, shares in self._changes(length * self._random):
            z = self._wanted.adjoints[row]
            columns = self._by_columns(row, shares, everything, 1)[:, 0]
            whole += np.array([columns, -(z @ change)]) / length
            values = np.zeros(len(self._path.columns))
            if self._path.history:  # on the first rank
                values[:] = [self._path.history[name][row] for name in self._path.columns]
            rounding = _ROUNDING * np.abs(self._wanted.weights[row]) @ np.abs(values)
            sizes += np.array([np.abs(columns) + rounding, np.abs(z) @ np.abs(change)]) / length
        together = (found * self._random).sum(axis=(2, 3))
        for own in zip(together, whole, sizes, strict=True):
            self._classes.check(*own)
