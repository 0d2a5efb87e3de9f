# SPDX-License-Identifier: LGPL-3.0-or-later
"""Binary glTF files: their description in JSON, and the arrays that it refers to.

glTF 2.0 (Khronos Group 2021, ISO/IEC 12113).
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["GltfFile"]

type Description = dict[str, Any]

#: Numbers that the format gives types, targets and kinds of chunks.
_FLOAT, _SHORT, _WHOLE = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942


class GltfFile:
    """A file under way.

    Attributes:
        root: number of the node that turns z upwards into y upwards.
    """

    def __init__(self) -> None:
        """Begin with the root."""
        half = 0.5**0.5
        self._bytes: list[bytes] = []
        self._size = 0
        self._made: dict[str, list[Description]] = {
            key: [] for key in ("bufferViews", "accessors", "meshes", "skins", "materials", "nodes")
        }
        self._scene: list[int] = []
        self._channels: list[Description] = []
        self._samplers: list[Description] = []
        self.root = self.node({"name": "z is up", "rotation": [-half, 0.0, 0.0, half]})

    def add(self, kind: str, description: Description) -> int:
        """Add to "meshes", "skins" or "materials"; returns its number."""
        self._made[kind].append(description)
        return len(self._made[kind]) - 1

    def node(self, description: Description, parent: int | None = None) -> int:
        """Add a node, to the scene itself where it has no parent; returns its number."""
        number = self.add("nodes", description)
        if parent is None:
            self._scene.append(number)
        else:
            self._made["nodes"][parent].setdefault("children", []).append(number)
        return number

    def animate(self, node: int, path: str, times: int, values: int) -> None:
        """Let a node move: numbers of the arrays of times and values, linear between them."""
        sampler = {"input": times, "output": values, "interpolation": "LINEAR"}
        target = {"node": node, "path": path}
        self._channels.append({"sampler": len(self._samplers), "target": target})
        self._samplers.append(sampler)

    def numbers(self, values: NDArray[Any], kind: str, *, bounds: bool = False) -> int:
        """Keep an array, of float32, uint16 or uint32; returns its number."""
        return self._accessor(values, kind, None, bounds)

    def vertices(self, values: NDArray[Any], kind: str, *, bounds: bool = False) -> int:
        """Keep data of vertices."""
        return self._accessor(values, kind, _VERTICES, bounds)

    def indices(self, cells: NDArray[Any]) -> int:
        """Keep vertices of triangles or lines."""
        return self._accessor(cells.reshape(-1).astype(np.uint32), "SCALAR", _INDICES, False)

    def _accessor(self, values: NDArray[Any], kind: str, target: int | None, bounds: bool) -> int:
        raw = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(raw)}
        self._made["bufferViews"].append(view | ({} if target is None else {"target": target}))
        padded = raw + bytes(-len(raw) % 4)
        self._bytes.append(padded)
        self._size += len(padded)
        number = {"f": _FLOAT, "u": _WHOLE if values.dtype.itemsize == 4 else _SHORT}
        one: Description = {
            "bufferView": len(self._made["bufferViews"]) - 1, "count": len(values), "type": kind,
            "componentType": number[values.dtype.kind],
        }  # fmt: skip
        if bounds:
            flat = values.reshape(len(values), -1)
            one |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        return self.add("accessors", one)

    def contents(self) -> list[bytes]:
        """The file: a header, a chunk of JSON and one of binary data, of multiples of 4 bytes."""
        animation = {"name": "motion", "channels": self._channels, "samplers": self._samplers}
        made = {key: listed for key, listed in self._made.items() if listed}
        document = {
            "asset": {"version": "2.0", "generator": "flexfem"}, "scene": 0,
            "scenes": [{"nodes": self._scene}], **made,
            "animations": [animation], "buffers": [{"byteLength": self._size}],
        }  # fmt: skip
        text = json.dumps(document, allow_nan=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self._size
        header = np.array([_MAGIC, 2, total, len(text), _JSON], "<u4").tobytes()
        return [header, text, np.array([self._size, _BINARY], "<u4").tobytes(), *self._bytes]
