# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces and lines with their motions: in frames, or point by point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem.io.view.motion import store_frames
from flexfem.io.view.packing import Pack

__all__ = ["Deforming", "Framed"]

type FloatArray = NDArray[np.floating[Any]]
type IntArray = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Framed:
    """A surface whose vertices are fixed in moving frames.

    Attributes:
        local: (v, 3) places of the vertices in their frames, m; normal: (v, 3) unit vectors there.
        frame: (v,) frames; cell: (v,) elements, or parts of what is rigid.
        triangles: (t, 3) vertices.
        places: (n, 3) of the frames at each instant, m; turns: (n, 3, 3) their rotations.
        bodies: numbers of the elements' names; names: of the bodies.
    """

    local: FloatArray
    normal: FloatArray
    frame: IntArray
    cell: IntArray
    triangles: IntArray
    places: Sequence[FloatArray]
    turns: Sequence[FloatArray]
    bodies: IntArray
    names: Sequence[str]

    def store(self, pack: Pack) -> dict[str, Any]:
        """Keep all of it."""
        normal = np.rint(np.clip(self.normal, -1.0, 1.0) * 127.0)
        return {
            "kind": "frames", "local": pack.store(self.local.astype(np.float32)),
            "normal": pack.store(normal.astype(np.int8)),
            "frame": pack.store(self.frame.astype(np.uint32)),
            "cell": pack.store(self.cell.astype(np.uint32)),
            "triangles": pack.store(self.triangles.astype(np.uint32)),
            "bodies": pack.store(self.bodies.astype(np.uint32)), "names": list(self.names),
            "motion": store_frames(pack, self.places, self.turns),
        }  # fmt: skip


@dataclass(frozen=True)
class Deforming:
    """A surface or lines whose points move for themselves.

    Attributes:
        about: (3,) the point from which places are measured, m.
        places: (n, 3) of the points at each instant, m.
        source: (v,) the point of each vertex.
        cells: (t, 3) vertices of triangles, or (t, 2) of lines.
        cell: (t,) elements.
        bodies: numbers of the elements' names; names: of the bodies.
    """

    about: FloatArray
    places: Sequence[FloatArray]
    source: IntArray
    cells: IntArray
    cell: IntArray
    bodies: IntArray
    names: Sequence[str]
