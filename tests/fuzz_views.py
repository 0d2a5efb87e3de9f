# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damaged series and scenes: rows of the table of ``tests.fuzz_readers``."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from mpi4py import MPI

import numpy as np

from flexfem.io.scene_file import NAME, SceneFile
from flexfem.io.view.content import gather
from flexfem.io.view.document import page
from flexfem.io.view.reading import Choice
from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.beam_writer import BeamWriter
from flexfem.io.vtu.body_fields import JointFields, JointWriter
from flexfem.io.vtu.reader import read_index, read_pieces
from flexfem.materials.section_wall import SectionWall
from tests.fuzz_readers import Reader

__all__ = ["READERS"]

_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_SCENE = SceneFile(
    {"beams": ["rod"]}, [("Revolute", "hinge")], [((SectionWall(_SQUARE, np.ones((4, 2, 6))),),)]
)


def _beams(turn: float) -> BeamFields:
    """Two elements along x, rotated about z."""
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    x = np.arange(3)[:, None] * axes[:, 0]
    frames, number = np.tile(axes, (3, 1, 1)), np.zeros(2, dtype=np.int64)
    cells = np.array([[0, 1], [1, 2]])
    eye = np.tile(np.eye(3), (2, 2, 1, 1))
    return BeamFields(
        x, x, frames, x, x, cells, number, np.ones((2, 6)), np.ones((2, 6)), number, eye
    )


def _write(folder: Path) -> None:
    """Two instants of a beam and a joint."""
    beams = BeamWriter(folder, MPI.COMM_SELF, _SCENE.sections)
    joints = JointWriter(folder, MPI.COMM_SELF, ["Revolute"], 0.1)
    for step in range(2):
        beams.write(0.5 * step, step, _beams(0.3 * step))
        place = np.full((1, 3), 0.1 * step)
        joints.write(
            0.5 * step, step,
            JointFields(place, place + 1.0, place, place, place, np.zeros(1, np.int64), place),
        )  # fmt: skip
    beams.close()
    joints.close()
    _SCENE.write(folder)


@cache
def _contents(name: str) -> Sequence[bytes]:
    with TemporaryDirectory() as folder:
        _write(Path(folder))
        return [(Path(folder) / name).read_bytes()]


def _page_with(path: Path, name: str) -> object:
    """A page of a folder one of whose files is this one."""
    with TemporaryDirectory() as folder:
        _write(Path(folder))
        (Path(folder) / name).write_bytes(path.read_bytes())
        try:
            return sum(map(len, page(gather(Path(folder), Choice()))))
        except ValueError as error:
            raise ValueError(f"{path.name}: {error}") from error


_BEAMS, _JOINTS = "beams/beams_000001_0.vtu", "joints/joints_000000_0.vtu"
_WORDS = (b"<!DOCTYPE r [<!ENTITY a 'b'>]>", b"<Piece>", b'offset="0"', b"</VTKFile>")
_INDEX = "beams.pvd"
_JSON = (b"[" * 5000, b"{", b"NaN", b"1e999", json.dumps("\ud800").encode(), b"null")

READERS = {
    "vtu": Reader(".vtu", lambda: _contents(_BEAMS), read_pieces, _WORDS),
    "pvd": Reader(
        ".pvd", lambda: _contents(_INDEX), lambda path: read_index(path, "beams"), _WORDS
    ),
    "scene": Reader(".json", lambda: _contents(NAME), SceneFile.read, _JSON),
    "page of beams": Reader(
        ".vtu", lambda: _contents(_BEAMS), lambda path: _page_with(path, _BEAMS), _WORDS
    ),
    "page of joints": Reader(
        ".vtu", lambda: _contents(_JOINTS), lambda path: _page_with(path, _JOINTS), _WORDS
    ),
    "page of a scene": Reader(
        ".json", lambda: _contents(NAME), lambda path: _page_with(path, NAME), _JSON
    ),
}
