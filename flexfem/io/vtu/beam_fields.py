# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion, strains and resultants of beams as result files take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["BeamFields"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class BeamFields:
    """This rank's beam cells and their nodes at one instant; arrays may have no rows.

    Attributes:
        position: Node positions (n, 3), inertial, m.
        displacement: Node displacements (n, 3), inertial, m.
        rotation: Section frames (n, 3, 3), columns e1, e2, e3 in inertial axes.
        velocity: Node velocities (n, 3), inertial, m/s.
        angular_velocity: Angular velocities (n, 3), inertial, rad/s.
        cells: Node numbers (m, 2), in the direction of e1.
        body: Body number of each cell (m,).
        strain: Extension, two shears, twist, two curvatures (m, 6), 1 and 1/m.
        resultant: N, Q2, Q3 in N, T, M2, M3 in N m (m, 6).
        section: Number of each cell's outline (m,).
        turn: Section axes at both ends of each cell in the axes of its nodes (m, 2, 3, 3).
    """

    position: FloatArray
    displacement: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    cells: IntArray
    body: IntArray
    strain: FloatArray
    resultant: FloatArray
    section: IntArray
    turn: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes."""
        n, m = len(self.position), len(self.cells)
        shapes: dict[str, tuple[int, ...]] = {
            "position": (n, 3), "displacement": (n, 3), "rotation": (n, 3, 3), "velocity": (n, 3),
            "angular_velocity": (n, 3), "cells": (m, 2), "body": (m,), "strain": (m, 6),
            "resultant": (m, 6), "section": (m,), "turn": (m, 2, 3, 3),
        }  # fmt: skip
        for name, shape in shapes.items():
            found = np.shape(getattr(self, name))
            if found != shape:
                raise ValueError(f"BeamFields '{name}': shape {found}, expected {shape}")

    @classmethod
    def joined(cls, several: Sequence[BeamFields]) -> BeamFields:
        """Fields of several groups of beams, none of which may be given."""
        if len(several) < 2:
            return several[0] if several else cls.empty()
        first = np.cumsum([0, *(len(one.position) for one in several)])
        values = {
            f.name: np.concatenate([getattr(one, f.name) for one in several]) for f in fields(cls)
        }
        cells = [one.cells + at for one, at in zip(several, first, strict=False)]
        return cls(**{**values, "cells": np.concatenate(cells)})

    @classmethod
    def empty(cls) -> BeamFields:
        """Fields of a rank without beams."""
        v, s, i = np.zeros((0, 3)), np.zeros((0, 6)), np.zeros(0, dtype=np.int64)
        cells = np.zeros((0, 2), dtype=np.int64)
        axes = np.zeros((0, 3, 3))
        return cls(v, v, axes, v, v, cells, i, s, s, i, np.zeros((0, 2, 3, 3)))
