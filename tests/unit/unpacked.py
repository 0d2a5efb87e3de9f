# SPDX-License-Identifier: LGPL-3.0-or-later
"""What pages of results hold, read again."""

import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexfem.io.view.content import Content
from flexfem.io.view.packing import MISSING
from flexfem.io.vtu.reader import read_index, read_pieces

__all__ = ["Unpacked", "farthest", "files"]


class Unpacked:
    """The other side of packing, written from its description."""

    def __init__(self, content: Content) -> None:
        self.scene, self._data = content.scene, content.data
        self.layers = {layer["series"]: layer for layer in content.scene["layers"]}

    def array(self, reference: Mapping[str, Any]) -> np.ndarray:
        start = reference["at"]
        raw = zlib.decompress(self._data[start : start + reference["bytes"]])
        shape = reference["shape"]
        if "order" not in reference:
            return np.frombuffer(raw, reference["type"]).reshape(shape)
        low, high = np.frombuffer(raw, np.uint8).reshape(2, -1).astype(np.int64)
        folded = low + 256 * high
        values = np.where(folded % 2, -(folded + 1) // 2, folded // 2).reshape(shape)
        for _ in range(reference["order"]):
            values = np.cumsum(values, axis=0)
        return (values + 2**15) % 2**16 - 2**15

    def places(self, motion: Mapping[str, Any]) -> np.ndarray:
        return motion["middle"] + motion["half"] * self.array(motion["places"]) / 32767

    def turns(self, motion: Mapping[str, Any]) -> np.ndarray:
        """Rotations (instants, n, 3, 3), by the formula of Rodrigues."""
        q = self.array(motion["turns"]) / 32767
        q = q / np.linalg.norm(q, axis=-1, keepdims=True)
        v, w = q[..., :3], q[..., 3:]
        eye = np.eye(3)
        cross = np.stack([np.cross(v, e) for e in eye], axis=-1)
        return eye + 2 * (w[..., None] * cross + cross @ cross)

    def vertices(self, series: str) -> np.ndarray:
        """Places of the vertices of a surface in frames (instants, v, 3)."""
        layer = self.layers[series]
        frame, local = self.array(layer["frame"]), self.array(layer["local"])
        turned = np.einsum("tvij,vj->tvi", self.turns(layer["motion"])[:, frame], local)
        return self.places(layer["motion"])[:, frame] + turned

    def field(self, series: str, name: str) -> np.ndarray:
        (one,) = (f for f in self.layers[series]["fields"] if f["name"] == name)
        whole = self.array(one["values"])
        assert not np.any(whole == MISSING)
        return one["low"] + (whole + 32767) / 65534 * (one["high"] - one["low"])


def files(folder: Path, series: str) -> Iterator[Any]:
    for instant in read_index(folder / f"{series}.pvd", series):
        yield from read_pieces(instant.file)


def farthest(one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance of a point of one set to the other set."""
    return float(np.linalg.norm(one[:, None] - other, axis=2).min(axis=1).max())
