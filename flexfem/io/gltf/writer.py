# SPDX-License-Identifier: LGPL-3.0-or-later
"""A motion as an animated glTF file, for Blender, three.js, office programs and others.

What moves in frames (beams, rigid bodies, joints, obstacles): every frame is a node of the scene,
with channels for its place and rotation. Every body is a mesh with a skin, whose vertices belong to
one frame each: sections of beams move with the nodes, as in pages. What deforms for itself (shells,
solids, cables): every body is a mesh with a morph target for each instant but the first. One weight
rises to 1 while the one before falls to 0, so that vertices move on straight lines between the
instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError
from flexfem._files import replace_file
from flexfem.io.gltf.container import GltfFile
from flexfem.io.view.beams import BeamLayer
from flexfem.io.view.instants import evenly
from flexfem.io.view.layers import MeshLayer, RigidLayer
from flexfem.io.view.motion import quaternions
from flexfem.io.view.normals import vertex_normals
from flexfem.io.view.reading import Choice, Motion, read_motion
from flexfem.io.view.shapes import Deforming, Framed

__all__ = ["NAME", "write_gltf"]

NAME = "view.glb"
#: Colours (red, green, blue), linear, of the series; others have that of flexible bodies.
_COLOURS = {
    "rigid_bodies": (0.27, 0.37, 0.48), "joints": (0.74, 0.19, 0.04),
    "contact_surfaces": (0.48, 0.54, 0.6), "cables": (0.1, 0.1, 0.1),
}  # fmt: skip
_FLEXIBLE = (0.2, 0.26, 0.33)
#: Targets by default where something deforms: each holds all of its vertices.
_TARGETS = 100
_LINES = 1  # mode of primitives


def write_gltf(
    folder: Path, choice: Choice, output: Path | None = None
) -> tuple[Path, Sequence[str]]:
    """Write the motion of a result folder; returns the file and notes about what is left out.

    Args:
        folder: of the results.
        choice: of the instants; fields are not written.
        output: the file; ``view.glb`` in the folder by default.

    Raises:
        InputError: there is nothing but arrows, or a file is damaged; nothing is written.
        OSError: the file cannot be written.
    """
    motion = read_motion(folder, Choice(choice.frames, ["none"]))
    parts = _parts(motion)
    if not parts:
        raise InputError(f"{folder}: nothing but arrows, which glTF files cannot hold")
    times = (motion.times - motion.times[0]).astype(np.float32)
    # the format wants times that increase in single precision: the last one of those that agree
    notes, chosen = list(motion.notes), np.flatnonzero(np.diff(times, append=np.inf) > 0.0)
    if choice.frames is None and any(isinstance(part, Deforming) for part in parts.values()):
        chosen = evenly(chosen, _TARGETS + 1)
    if len(chosen) < motion.instants:
        notes = [note for note in notes if "instants are shown" not in note]
        notes.append(f"{len(chosen)} of {motion.instants} instants are kept (--frames N chooses)")
    file = _Writer(times[chosen])
    for series, part in parts.items():
        file.write(series, part, chosen)
    target = output or folder / NAME
    replace_file(target, file.contents())
    return target, notes


def _parts(motion: Motion) -> dict[str, Framed | Deforming]:
    """Surfaces and lines of all series that have them."""
    parts: dict[str, Framed | Deforming] = {}
    for layer in motion.layers:
        if isinstance(layer, (BeamLayer, RigidLayer)):
            parts[layer.series] = layer.framed()
        elif isinstance(layer, MeshLayer):
            parts[layer.series] = layer.deforming()
    return parts


class _Writer:
    """The parts of a motion as nodes and meshes of a file."""

    def __init__(self, times: NDArray[np.float32]) -> None:
        """Begin with the times."""
        self._file = GltfFile()
        self._count = len(times)
        self._times = self._file.numbers(times, "SCALAR", bounds=True)
        self._weights: int | None = None

    def contents(self) -> list[bytes]:
        """The file."""
        return self._file.contents()

    def write(
        self, series: str, part: Framed | Deforming, chosen: NDArray[np.integer[Any]]
    ) -> None:
        """Write the bodies of a series at chosen instants."""
        colour = [*_COLOURS.get(series, _FLEXIBLE), 1.0]
        self._material = self._file.add("materials", {
            "name": series, "doubleSided": isinstance(part, Deforming), "pbrMetallicRoughness":
            {"baseColorFactor": colour, "metallicFactor": 0.1, "roughnessFactor": 0.6},
        })  # fmt: skip
        places = [part.places[k] for k in chosen]
        if isinstance(part, Deforming):
            self._write_deforming(replace(part, places=places))
        else:
            self._write_framed(replace(part, places=places, turns=[part.turns[k] for k in chosen]))

    def _write_framed(self, surface: Framed) -> None:
        first = self._add_frames(surface)
        body = surface.bodies[surface.cell]
        for number, name in enumerate(surface.names):
            chosen = np.flatnonzero(body == number)
            if len(chosen):
                self._add_skinned(name, surface, chosen, first)

    def _add_frames(self, surface: Framed) -> int:
        """Add a node for every frame, with its motion; returns the first."""
        x = np.array(surface.places, dtype=np.float32)
        q = quaternions(np.array(surface.turns))
        for k in range(1, len(q)):  # the shorter way from each to the next
            q[k] *= np.where(np.einsum("ni,ni->n", q[k], q[k - 1]) < 0.0, -1.0, 1.0)[:, None]
        file, added = self._file, []
        for frame in range(x.shape[1]):
            start = {"translation": x[0, frame].tolist(), "rotation": q[0, frame].tolist()}
            added.append(file.node(start, file.root))
            turn = q[:, frame].astype(np.float32)
            file.animate(added[-1], "translation", self._times, file.numbers(x[:, frame], "VEC3"))
            file.animate(added[-1], "rotation", self._times, file.numbers(turn, "VEC4"))
        return added[0]

    def _add_skinned(
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
        file, triangles = self._file, _own(surface.triangles, chosen, len(surface.cell))
        attributes = {
            "POSITION": file.vertices(points.astype(np.float32), "VEC3", bounds=True),
            "NORMAL": file.vertices(normals.astype(np.float32), "VEC3"),
            "JOINTS_0": file.vertices(joints, "VEC4"), "WEIGHTS_0": file.vertices(weights, "VEC4"),
        }  # fmt: skip
        back = np.zeros((len(frames), 4, 4), dtype=np.float32)  # by columns, into the frames
        back[:, :3, :3], back[:, 3, 3] = R[frames], 1.0
        back[:, 3, :3] = -np.einsum("nji,nj->ni", R[frames], x[frames])
        matrices = file.numbers(back, "MAT4")
        joined = (first + frames).tolist()
        skin = file.add("skins", {"joints": joined, "inverseBindMatrices": matrices})
        mesh = self._add_mesh(name, attributes, triangles)
        # skinned meshes take no transformation of their parents
        file.node({"name": name, "mesh": mesh, "skin": skin})

    def _write_deforming(self, part: Deforming) -> None:
        body = part.bodies[part.cell]
        for number, name in enumerate(part.names):
            cells = part.cells[body == number]
            if len(cells):
                self._add_morphed(name, part, cells)

    def _add_morphed(self, name: str, part: Deforming, cells: NDArray[np.integer[Any]]) -> None:
        """Add the mesh of a body, with its vertices at every instant."""
        file, chosen = self._file, np.unique(cells)
        own = _own(cells, chosen, len(part.source))
        x = [part.places[k][part.source[chosen]] for k in range(self._count)]
        arrays = [{"POSITION": points} for points in x]
        if cells.shape[1] == 3:
            arrays = [one | {"NORMAL": vertex_normals(one["POSITION"], own)} for one in arrays]
        base, *others = arrays
        attributes = {
            key: file.vertices(values.astype(np.float32), "VEC3", bounds=key == "POSITION")
            for key, values in base.items()
        }
        targets = [
            {
                key: file.vertices(
                    (values - base[key]).astype(np.float32), "VEC3", bounds=key == "POSITION"
                )
                for key, values in one.items()
            }
            for one in others
        ]
        mesh = self._add_mesh(name, attributes, own, targets)
        place = {"name": name, "mesh": mesh, "translation": part.about.tolist()}
        node = file.node(place, file.root)
        if targets:
            file.animate(node, "weights", self._times, self._kept_weights())

    def _kept_weights(self) -> int:
        """Number of the targets' weights (instants, instants - 1), the same for all meshes."""
        if self._weights is None:
            weights = np.eye(self._count, self._count - 1, -1, dtype=np.float32)
            self._weights = self._file.numbers(weights.reshape(-1), "SCALAR")
        return self._weights

    def _add_mesh(
        self, name: str, attributes: dict[str, int], cells: NDArray[np.integer[Any]],
        targets: Sequence[dict[str, int]] = (),
    ) -> int:  # fmt: skip
        """Add triangles or lines; returns their number."""
        primitive: dict[str, Any] = {
            "attributes": attributes, "indices": self._file.indices(cells),
            "material": self._material,
        }  # fmt: skip
        if cells.shape[1] == 2:
            primitive["mode"] = _LINES
        mesh: dict[str, Any] = {"name": name, "primitives": [primitive]}
        if targets:
            primitive["targets"] = list(targets)
            mesh["weights"] = [0.0] * len(targets)
        return self._file.add("meshes", mesh)


def _own(
    cells: NDArray[np.integer[Any]], chosen: NDArray[np.integer[Any]], count: int
) -> NDArray[np.integer[Any]]:
    """Cells all of whose vertices are among the chosen ones of so many, by their numbers there."""
    new = np.full(count, -1)
    new[chosen] = np.arange(len(chosen))
    corners = new[cells]
    own: NDArray[np.integer[Any]] = corners[np.all(corners >= 0, axis=1)]
    return own
