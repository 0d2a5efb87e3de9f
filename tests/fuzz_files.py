# SPDX-License-Identifier: LGPL-3.0-or-later
"""Readers of tables, robots, surfaces, FMUs, checkpoints, reduced bodies; valid files of each.

Files with checksums are damaged behind them: what is wrong is found by what reads the contents.
Descriptions of FMUs are damaged by themselves and put into archives, and so are archives.
The process that looks at the structure of HDF5 files is a copy of this one, which is there sooner.
"""

import io
import os
import resource
import struct
import warnings
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from mpi4py import MPI

import h5py
import numpy as np

import flexfem as ff
from flexfem.control.fmu import FmuLaw
from flexfem.core.state import Numbering, State
from flexfem.io import read_history, read_summary
from flexfem.io.evaluations import read_evaluations
from flexfem.io.hdf5 import checkpoint
from flexfem.io.hdf5 import reduced_body as reduced_body_file
from flexfem.io.hdf5.arrays import PlainFile
from flexfem.io.hdf5.checkpoint import write_checkpoint
from flexfem.io.hdf5.reduced_body import _digest, load_reduced_body, save_reduced_body
from flexfem.io.hdf5.structure import read_structure
from flexfem.mesh.imported.surface_files import read_surface
from flexfem.mesh.surface_mesh import read_surface_mesh
from flexfem.simulation.run.checkpoints import SavedState
from tests.fuzz_readers import Reader, any_of
from tests.unit.beam_texts import BLADE, MATRICES, PRIMARY, STATIONS, WINDIO_1, WINDIO_2
from tests.unit.fmu_files import description
from tests.unit.forged import seal
from tests.unit.test_bad_urdf import SOUND
from tests.unit.test_reduced_body import two_masses
from tests.unit.test_section_table import MATERIALS, SECTIONS

__all__ = ["READERS"]

_BLOCK = 512
_NODES = {"nodes": Numbering(np.arange(4), np.ones(4, dtype=bool), 4)}


def _texts(*texts: str) -> Sequence[bytes]:
    return [text.encode() for text in texts]


def _beamdyn(path: Path) -> object:
    return ff.read_beamdyn(path, blade=path)


def _sections(path: Path) -> object:
    return ff.read_sections(path, {"steel": _STEEL, "alloy": _STEEL})


_STEEL = ff.Material(2e11, 0.3, 7850.0)


@cache
def _checkpoints() -> Sequence[bytes]:
    """A checkpoint of four nodes, whose checksum is renewed before it is read."""
    header = {
        "flexfem": ff.__version__, "model": {"bodies": "a"}, "options": {"dt": 0.1},
        "grid": [1.0, 10], "step": 3,
    }  # fmt: skip
    state = State(
        {"time": np.array([0.3]), "counters": np.arange(5.0), "fired": np.zeros((0, 2))},
        {"nodes": {"frames": np.tile(np.eye(4)[:3].ravel(), (4, 1)), "held": np.zeros(4)}},
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "c.h5"
        write_checkpoint(path, MPI.COMM_SELF, header, state, _NODES)
        return [path.read_bytes()]


class _Bodies:
    """Target of reading a checkpoint."""

    def __init__(self) -> None:
        self.rows = {"frames": np.zeros((4, 12)), "held": np.zeros(4)}

    def numberings(self) -> dict[str, Numbering]:
        return _NODES

    def doubts(self, state: State) -> str:
        return ""

    def state(self) -> State:
        values = {"time": np.zeros(1), "counters": np.zeros(5), "fired": np.zeros((0, 2))}
        return State(values, {"nodes": self.rows})

    def restore(self, state: State) -> None:
        assert float(state.values["time"][0]) == state.values["time"][0]


def _check_structure(path: Path) -> None:
    """As that of the package, with two seconds of the processor.

    Raises:
        ValueError: the copy of this process has not got to its end.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of copies of programs with threads
        number = os.fork()
    if number == 0:
        try:
            used = resource.getrusage(resource.RUSAGE_SELF)
            limit = int(used.ru_utime + used.ru_stime) + 2
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            read_structure(str(path))
        except BaseException:
            os._exit(1)
        os._exit(0)
    if code := os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]):
        raise ValueError(f"its structure cannot be read ({code})")


def _checkpoint(path: Path) -> object:
    if path.stat().st_size > _BLOCK and path.read_bytes().startswith(b"flexfem checkpoint"):
        seal(path)
    with patch.object(checkpoint, "check_structure", _check_structure):
        saved = SavedState(path, MPI.COMM_SELF)
    bodies = _Bodies()
    saved.restore(bodies, bodies)  # type: ignore[arg-type]
    return saved.state


@cache
def _reduced() -> Sequence[bytes]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rod.h5"
        save_reduced_body(path, two_masses(), MPI.COMM_SELF)
        return [path.read_bytes()]


def _reduced_body(path: Path) -> object:
    """Read a body whose checksum was renewed, where there is enough of the file for one."""
    try:
        _check_structure(path)
    except ValueError as error:
        look = patch.object(reduced_body_file, "check_structure", side_effect=error)
    else:
        look = patch.object(reduced_body_file, "check_structure")
        _seal_body(path)
    with look:
        return load_reduced_body(path, MPI.COMM_SELF)


def _seal_body(path: Path) -> None:
    content = io.BytesIO(path.read_bytes())
    with suppress(Exception), h5py.File(content, "r+") as file:
        file.attrs["digest"] = _digest(PlainFile(file, len(content.getvalue())))
        file.close()
        path.write_bytes(content.getvalue())


def _surface(path: Path) -> object:
    """As links of robots read it, which name the file."""
    try:
        return read_surface(path)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error


def _fmu_files() -> Sequence[bytes]:
    """Descriptions of FMI 2 and 3, alone and in archives."""
    texts = [description(version).encode() for version in (2, 3)]
    return [*texts, *map(_archived, texts)]


def _archived(text: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", text)
    return content.getvalue()


def _fmu(path: Path) -> object:
    content = path.read_bytes()
    if not content.startswith(b"PK"):
        path.write_bytes(_archived(content))
    return FmuLaw(f"FmuController of {path.name}", path, ("y",), ("u",), {"damping": 1.0})


_CORNERS = "".join(f"vertex {x} {y} 0\n" for x, y in ((0, 0), (1, 0), (0, 1e-1)))
_FACET = f"facet normal 0 0 1\nouter loop\n{_CORNERS}endloop\nendfacet\n"
_STL = f"solid plate\n{3 * _FACET}endsolid plate\n"
_BINARY_STL = bytes(80) + struct.pack("<I", 9) + 9 * struct.pack("<12fH", *range(12), 0)
_OBJ = "# a\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.1 0.2 0.3\nv 0 1e-1 0\nf 1 2 3 4\nf -1/1 -3/2/3 2//1\n"
_HISTORY = "t,tip_x,tip_y\n0.0,1.0,2.0\n0.1,1.5,-2e-3\n0.2,nan,inf\n"
_SUMMARY = '{"status": "ok", "steps": 3, "results": {"x": 1.5, "y": null}, "warnings": ["a"]}\n'
_OPTIMISATION = '{"functions": ["a", "b"]}\n' + 3 * "[[1.5, 2], [0.1, 3], [[1, 2e-3], [3, 4]]]\n"
_WORDS_XML = (
    b"<!DOCTYPE r [<!ENTITY a 'b'>]>", b"<a>" * 100, b'<mimic joint="hip"/>', b"<!--", b"<![CDATA[",
    b'<?xml version="1.0" encoding="utf-16"?>', b"&#0;", b"&lt;", b"</link>", b"<link name='a'/>",
)  # fmt: skip

READERS = {
    "materials": Reader(".csv", lambda: _texts(MATERIALS), ff.read_materials, (b'"', b";;;", b"#")),
    "sections": Reader(
        ".csv",
        lambda: _texts(SECTIONS),
        _sections,
        (b'"', b",,,", b"a;circle", b"b;hollow_rectangle;steel;1e18;1e18;1e-3"),
    ),
    "stations": Reader(
        ".csv", lambda: _texts(STATIONS, MATRICES), ff.read_section_table, (b'"', b",,,", b"1;;;")
    ),
    "beamdyn": Reader(".dat", lambda: _texts(PRIMARY + BLADE), _beamdyn, (b"1D400 1", b"1e")),
    "windio": Reader(
        ".yaml",
        lambda: _texts(WINDIO_1, WINDIO_2),
        ff.read_windio,
        (b"a: &a [*a]", b"<<: *axis", b"[[[[[", b"{", b"!!python/name:os.system"),
    ),
    "urdf": Reader(".urdf", lambda: _texts(SOUND), ff.read_urdf, _WORDS_XML),
    "stl": Reader(
        ".stl",
        lambda: [*_texts(_STL), _BINARY_STL],
        any_of(_surface, read_surface_mesh),
        (b"solid b", b"endsolid", b"vertex"),
    ),
    "obj": Reader(
        ".obj",
        lambda: _texts(_OBJ),
        any_of(_surface, read_surface_mesh),
        (b"f 1 1 1", b"v 1e999 0 0", b"f -9 1 2"),
    ),
    "fmu": Reader(".fmu", _fmu_files, _fmu, _WORDS_XML),
    "history": Reader(".csv", lambda: _texts(_HISTORY), read_history, (b"1,2", b"t,t")),
    "summary": Reader(".json", lambda: _texts(_SUMMARY), read_summary, (b"[" * 5000, b"{", b"NaN")),
    "optimisation": Reader(
        ".jsonl",
        lambda: _texts(_OPTIMISATION),
        read_evaluations,
        (b"[" * 5000, b"{}", b"[[1],[1],[[NaN]]]"),
    ),
    "checkpoint": Reader(".h5", _checkpoints, _checkpoint),
    "reduced": Reader(".h5", _reduced, _reduced_body),
}
