# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of all interface nodes in one process, for serial evaluation of rows."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.rows.data import InterfaceNodes
from flexfem.layout.node_key import NodeKey

__all__ = ["NodeTable"]


@dataclass
class NodeTable:
    """Nodes with the attributes that rows of joints need, see ``constraints.interface.Interface``.

    Attributes:
        keys: node of each interface node.
        frames, velocities: (n, 12) and (n, 6), local axes.
        held: (n, 6) True for fixed unknowns.
        width: (n,) unknowns of each node, 6 or 3.
    """

    keys: Sequence[NodeKey]
    frames: FloatArray
    velocities: FloatArray
    held: BoolArray
    width: IntArray
    increments: FloatArray = field(init=False)
    inertial: BoolArray = field(init=False)
    node_of: dict[NodeKey, int] = field(init=False)
    interface_nodes: InterfaceNodes = field(init=False)

    def __post_init__(self) -> None:
        """Start without increments, translations in local axes."""
        count = len(self.keys)
        self.increments = np.zeros((count, 6))
        self.inertial = np.zeros(count, dtype=np.bool_)
        self.interface_nodes = InterfaceNodes(
            frames=self.frames, increments=self.increments, velocities=self.velocities,
            inertial=self.inertial,
        )  # fmt: skip
        self.node_of = {key: node for node, key in enumerate(self.keys)}

    @classmethod
    def of_bodies(cls, frames: FloatArray) -> "NodeTable":
        """Rigid bodies at rest, one node each, with frames (n, 12)."""
        count = len(frames)
        return cls(
            keys=[(0, i) for i in range(count)],
            frames=frames,
            velocities=np.zeros((count, 6)),
            held=np.zeros((count, 6), dtype=np.bool_),
            width=np.full(count, 6, dtype=np.int64),
        )
