# SPDX-License-Identifier: LGPL-3.0-or-later
"""What moves in frames as an animated glTF file: beams, rigid bodies, joints and obstacles.

Blender, three.js, office programs and others read glTF 2.0 (Khronos Group 2021, ISO/IEC 12113).
Every frame is a node of the scene, with channels for its place and rotation. Every body is a mesh
with a skin, whose vertices belong to one frame each: sections of beams move with the nodes, as in
pages. Vertices are given where they are at the first instant.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError
from flexfem._files import replace_file
from flexfem.io.view.beams import BeamLayer
from flexfem.io.view.layers import Framed, RigidLayer
from flexfem.io.view.motion import quaternions
from flexfem.io.view.reading import Choice, read_motion

__all__ = ["NAME", "write_gltf"]

NAME = "view.glb"
#: Colours (red, green, blue), linear, of the series.
_COLOURS = {
    "beams": (0.2, 0.26, 0.33), "rigid_bodies": (0.27, 0.37, 0.48), "joints": (0.74, 0.19, 0.04),
    "contact_surfaces": (0.48, 0.54, 0.6),
}  # fmt: skip
#: Numbers that the format gives types, targets and kinds of chunks.
_FLOAT, _SHORT, _WHOLE = 5126, 5123, 5125
_VERTICES, _INDICES = 34962, 34963
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942


def write_gltf(
    folder: Path, choice: Choice, output: Path | None = None
) -> tuple[Path, Sequence[str]]:
    """Write the motion of a result folder; returns the file and notes about what is left out.

    Args:
        folder: of the results.
        choice: of the instants; fields are not written.
        output: the file; ``view.glb`` in the folder by default.

    Raises:
        InputError: nothing moves in frames, or a file is damaged; nothing is written.
        OSError: the file cannot be written.
    """
    motion = read_motion(folder, Choice(choice.frames, ["none"]))
    framed = {
        layer.series: layer.framed()
        for layer in motion.layers
        if isinstance(layer, (BeamLayer, RigidLayer))
    }
    if not framed:
        raise InputError(f"{folder}: no beams, rigid bodies or joints, which glTF files can hold")
    notes = list(motion.notes)
    loose = [one.series for one in motion.layers if one.series not in {*framed, "reactions"}]
    if loose:
        notes.append(f"not in the file, whose bodies move in frames: {', '.join(loose)}")
    file = _File(motion.times - motion.times[0])
    for series, surface in framed.items():
        file.add(series, surface)
    target = output or folder / NAME
    replace_file(target, file.contents())
    return target, notes


class _File:
    """A file under way: its description, and the binary data that it refers to."""

    def __init__(self, times: NDArray[np.float64]) -> None:
        """Begin with the times and a root, which turns z upwards into y upwards."""
        half = 0.5**0.5
        self._bytes: list[bytes] = []
        self._size = 0
        self._made: dict[str, list[dict[str, Any]]] = {
            key: [] for key in ("bufferViews", "accessors", "meshes", "skins", "materials")
        }
        root = {"name": "z is up", "rotation": [-half, 0.0, 0.0, half], "children": []}
        self._nodes: list[dict[str, Any]] = [root]
        self._roots = [0]
        self._channels: list[dict[str, Any]] = []
        self._samplers: list[dict[str, Any]] = []
        self._times = self._accessor(times.astype(np.float32), "SCALAR", bounds=True)

    def add(self, series: str, surface: Framed) -> None:
        """Add the bodies of a series."""
        colour = [*_COLOURS[series], 1.0]
        material = {"baseColorFactor": colour, "metallicFactor": 0.1, "roughnessFactor": 0.6}
        self._made["materials"].append({"name": series, "pbrMetallicRoughness": material})
        first = self._add_frames(surface)
        body = surface.bodies[surface.cell]
        for number, name in enumerate(surface.names):
            chosen = np.flatnonzero(body == number)
            if len(chosen):
                self._add_body(name, surface, chosen, first)

    def contents(self) -> list[bytes]:
        """The file: a header, a chunk of JSON and one of binary data, of multiples of 4 bytes."""
        animation = {"name": "motion", "channels": self._channels, "samplers": self._samplers}
        document = {
            "asset": {"version": "2.0", "generator": "flexfem"}, "scene": 0,
            "scenes": [{"nodes": self._roots}], "nodes": self._nodes, **self._made,
            "animations": [animation], "buffers": [{"byteLength": self._size}],
        }  # fmt: skip
        text = json.dumps(document, allow_nan=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self._size
        header = np.array([_MAGIC, 2, total, len(text), _JSON], "<u4").tobytes()
        return [header, text, np.array([self._size, _BINARY], "<u4").tobytes(), *self._bytes]

    def _add_frames(self, surface: Framed) -> int:
        """Add a node for every frame, with its motion; returns the first."""
        x = np.array(surface.places, dtype=np.float32)
        q = quaternions(np.array(surface.turns))
        for k in range(1, len(q)):  # the shorter way from each to the next
            q[k] *= np.where(np.einsum("ni,ni->n", q[k], q[k - 1]) < 0.0, -1.0, 1.0)[:, None]
        first = len(self._nodes)
        for frame in range(x.shape[1]):
            start = {"translation": x[0, frame].tolist(), "rotation": q[0, frame].tolist()}
            self._nodes[0]["children"].append(len(self._nodes))
            self._animate("translation", x[:, frame], "VEC3")
            self._animate("rotation", q[:, frame].astype(np.float32), "VEC4")
            self._nodes.append(start)
        return first

    def _animate(self, path: str, values: NDArray[np.float32], kind: str) -> None:
        """Let the next node move."""
        sampler = {"input": self._times, "output": self._accessor(values, kind)}
        target = {"node": len(self._nodes), "path": path}
        self._channels.append({"sampler": len(self._samplers), "target": target})
        self._samplers.append(sampler | {"interpolation": "LINEAR"})

    def _add_body(
        self, name: str, surface: Framed, chosen: NDArray[np.integer[Any]], first: int
    ) -> None:
        """Add the mesh of a body and its skin."""
        frames, joint = np.unique(surface.frame[chosen], return_inverse=True)
        x, R = np.array(surface.places[0]), np.array(surface.turns[0])
        turned = R[surface.frame[chosen]]
        points = x[surface.frame[chosen]] + np.einsum("nij,nj->ni", turned, surface.local[chosen])
        normals = np.einsum("nij,nj->ni", turned, surface.normal[chosen])
        joints = np.zeros((len(chosen), 4), dtype=np.uint16)
        joints[:, 0] = joint.reshape(-1)
        weights = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (len(chosen), 1))
        new = np.full(len(surface.cell), -1)
        new[chosen] = np.arange(len(chosen))
        corners = new[surface.triangles]
        triangles = corners[np.all(corners >= 0, axis=1)].reshape(-1).astype(np.uint32)
        attributes = {
            "POSITION": self._accessor(points.astype(np.float32), "VEC3", _VERTICES, bounds=True),
            "NORMAL": self._accessor(normals.astype(np.float32), "VEC3", _VERTICES),
            "JOINTS_0": self._accessor(joints, "VEC4", _VERTICES),
            "WEIGHTS_0": self._accessor(weights, "VEC4", _VERTICES),
        }  # fmt: skip
        primitive = {
            "attributes": attributes, "indices": self._accessor(triangles, "SCALAR", _INDICES),
            "material": len(self._made["materials"]) - 1,
        }  # fmt: skip
        back = np.zeros((len(frames), 4, 4), dtype=np.float32)  # by columns, into the frames
        back[:, :3, :3], back[:, 3, 3] = R[frames], 1.0
        back[:, 3, :3] = -np.einsum("nji,nj->ni", R[frames], x[frames])
        matrices = self._accessor(back, "MAT4")
        skin = {"joints": (first + frames).tolist(), "inverseBindMatrices": matrices}
        self._made["skins"].append(skin)
        self._made["meshes"].append({"name": name, "primitives": [primitive]})
        # skinned meshes take no transformation of their parents
        self._roots.append(len(self._nodes))
        number = len(self._made["meshes"]) - 1
        self._nodes.append({"name": name, "mesh": number, "skin": number})

    def _accessor(
        self, values: NDArray[Any], kind: str, target: int | None = None, bounds: bool = False
    ) -> int:
        """Keep an array; returns its number."""
        raw = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(raw)}
        self._made["bufferViews"].append(view | ({} if target is None else {"target": target}))
        padded = raw + bytes(-len(raw) % 4)
        self._bytes.append(padded)
        self._size += len(padded)
        number = {"f": _FLOAT, "u": _WHOLE if values.dtype.itemsize == 4 else _SHORT}
        one: dict[str, Any] = {
            "bufferView": len(self._made["bufferViews"]) - 1, "count": len(values), "type": kind,
            "componentType": number[values.dtype.kind],
        }  # fmt: skip
        if bounds:
            flat = values.reshape(len(values), -1)
            one |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self._made["accessors"].append(one)
        return len(self._made["accessors"]) - 1
