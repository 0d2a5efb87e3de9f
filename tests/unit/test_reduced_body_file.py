# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of reduced bodies: what is written is what is read, on any number of ranks."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import h5py
import numpy as np
import pytest

import flexfem as ff
from flexfem.io.hdf5 import structure as hdf5_structure
from flexfem.io.hdf5.arrays import PlainFile
from flexfem.io.hdf5.reduced_body import _digest
from flexfem.reduction.elastic_polynomial import ElasticPolynomial
from flexfem.reduction.reduced_body import Recovery
from tests.unit.forged import each_kind, endless, replaced
from tests.unit.particle_body import symmetric
from tests.unit.test_reduced_body import two_masses

COMM = MPI.COMM_WORLD


def strip(rank: int, functions: int = 12) -> Recovery:
    """Two triangles a rank, all figures different; of a nonlinear body with its gradients."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) + np.array([2.0 * rank, 0, 0])
    moves = np.arange(12.0 * functions).reshape(4, 3, functions) + 1000.0 * rank
    stress = np.arange(12.0 * functions).reshape(2, 6, functions) - 1000.0 * rank
    law = [np.tile(stress, (1, 2, 1))[:, :9], np.arange(7371.0)] if functions > 12 else []
    return Recovery(points, np.array([[0, 1, 2], [1, 3, 2]]), moves, stress, *law)


def polynomial(rng: np.random.Generator) -> ElasticPolynomial:
    """Elastic forces in the six coordinates of an interface and the products of its rotations."""
    own, pairs = symmetric(rng, 12, 4), np.triu_indices(12)
    residual = rng.normal(size=(2, 78)), rng.normal(size=(2, 12, 78))
    cubic = own[pairs][:, *pairs]
    inertia = rng.normal(size=(3, 6)), np.tile(np.eye(13)[:, 7:], (3, 3, 1, 1))
    loads = rng.normal(size=(2, 24)), np.eye(24), np.ones(1)
    return ElasticPolynomial(1, own[0, 0], own[0][pairs], cubic, *residual, *inertia, *loads)


@pytest.mark.three_ranks
def test_bodies_come_back_on_any_ranks(shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "rod.h5"
    geometric = np.arange(12.0 * 144).reshape(12, 12, 12)
    rng = np.random.default_rng(3)
    lines = {
        name: ff.BodyLine(rng.normal(size=(4, 3)), *rng.normal(size=(2, 4, 3, 18)))
        for name in ("axis", "top")
    }
    body = two_masses(
        recovery=strip(COMM.rank, 18), acceleration_stiffness=geometric + geometric.swapaxes(1, 2),
        lines=lines, polynomial=polynomial(rng),
    )  # fmt: skip
    ff.save_reduced_body(path, body)
    assert [p.name for p in shared_tmp_path.iterdir()] == ["rod.h5"]
    back = ff.load_reduced_body(path)
    assert [i.name for i in back.interfaces] == ["a", "b"]
    np.testing.assert_array_equal(back.interfaces[1].position, body.interfaces[1].position)
    for name in ("moments", "products", "stiffness", "damping", "held", "acceleration_stiffness"):
        np.testing.assert_array_equal(getattr(back, name), getattr(body, name))
    assert back.interface_stiffness is None
    assert back.polynomial is not None
    assert body.polynomial is not None
    assert back.polynomial.turning == 1
    for name, values in body.polynomial.arrays.items():
        np.testing.assert_array_equal(back.polynomial.arrays[name], values)
    assert list(back.lines) == ["axis", "top"]
    for name, line in lines.items():
        for what, values in line.arrays.items():
            np.testing.assert_array_equal(back.lines[name].arrays[what], values)
    alone = ff.load_reduced_body(path, MPI.COMM_SELF).recovery
    assert alone is not None
    assert back.recovery is not None
    assert alone.stress is not None
    assert len(alone.cells) == 2 * COMM.size
    for rank in range(COMM.size):
        part, rows = strip(rank, 18), alone.cells[2 * rank : 2 * rank + 2]
        np.testing.assert_array_equal(alone.points[rows], part.points[part.cells])
        np.testing.assert_array_equal(alone.displacement[rows], part.displacement[part.cells])
        np.testing.assert_array_equal(alone.stress[2 * rank : 2 * rank + 2], part.stress)
    # the ranks' shares make the whole
    assert alone.gradient is not None
    assert alone.law is not None
    np.testing.assert_array_equal(alone.gradient[:, :6], alone.stress)
    assert alone.law[-1] == 7370.0
    shares = COMM.allgather(back.recovery.points[back.recovery.cells])
    np.testing.assert_array_equal(np.concatenate(shares), alone.points[alone.cells])


@pytest.mark.three_ranks
@pytest.mark.parametrize("damage", ["missing", "text", "other", "format", "changed", "cut"])
def test_bad_files_are_refused_by_all_ranks(shared_tmp_path: Path, damage: str) -> None:
    path = shared_tmp_path / "rod.h5"
    messages = {
        "missing": "No such file",
        "text": "file signature not found",
        "other": "no file of a reduced body",
        "format": "its format is 9, not 1",
        "changed": "it is damaged",
        "cut": "truncated",
    }
    ff.save_reduced_body(path, two_masses())
    if COMM.rank == 0:
        if damage == "missing":
            path.unlink()
        elif damage == "text":
            path.write_text("reduced")
        elif damage == "cut":
            path.write_bytes(path.read_bytes()[:5000])
        elif damage == "other":
            with h5py.File(path, "w") as file:
                file["x"] = 1.0
        else:
            with h5py.File(path, "r+") as file:
                if damage == "format":
                    file.attrs["format"] = 9
                else:
                    file["stiffness"][0, 0] *= 1.0 + 1e-15
    COMM.Barrier()
    with pytest.raises(ValueError, match=messages[damage]) as caught:
        ff.load_reduced_body(path)
    assert str(caught.value).startswith("reduced body '")
    assert "\n" not in str(caught.value)


#: Changes of a file whose checksum is computed again, and what is said of them.
FORGERIES: dict[str, tuple[Callable[[Any], object], str]] = {
    "missing": (lambda f: f.__delitem__("stiffness"), 'it has no "stiffness"'),
    "shape": (replaced("stiffness", data=np.zeros((3, 3))), "stiffness must hold 12 x 12 numbers"),
    "text": (replaced("stiffness", data=[b"x"]), '"stiffness" does not hold numbers'),
    "without end": (
        replaced("stiffness", shape=(10**12,), dtype="f8", chunks=(1024,)), "claims numbers that"
    ),
    "link": (
        lambda f: (
            f.__delitem__("stiffness"),
            f.__setitem__("stiffness", h5py.ExternalLink("/etc/hostname", "/x")),
        ),
        'it has no "stiffness"',
    ),
    "mass": (lambda f: f.attrs.__setitem__("mass", np.nan), "mass must be finite"),
    "no mass": (lambda f: f.attrs.__setitem__("mass", "heavy"), '"mass" is no number'),
    "format": (lambda f: f.attrs.__setitem__("format", [1, 2]), '"format" is no number'),
    "names": (lambda f: f.attrs.__setitem__("interfaces", "[1, 2]"), "interfaces have no names"),
    "few names": (lambda f: f.attrs.__setitem__("interfaces", '["a"]'), "it has 2 positions of 1"),
    "deep": (lambda f: f.attrs.__setitem__("interfaces", "[" * 50_000), "have no names"),
    "held": (replaced("held", data=np.zeros(12)), "held must hold 12 truth values"),
    "positions": (replaced("positions", data=np.zeros(4)), "cannot reshape"),
    "surface": (lambda f: f.__delitem__("recovery/points"), 'has no "recovery/points"'),
    "cells": (replaced("recovery/cells", data=[[0, 1, -1]]), "cells must lie in 0 to"),
    "surface is none": (
        lambda f: (f.__delitem__("recovery"), f.__setitem__("recovery", 1.0)), 'it has no "recovery'
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", each_kind(FORGERIES, "missing", "mass", "names", "cells"))
def test_forged_files_are_refused_by_all_ranks(kind: str, shared_tmp_path: Path) -> None:
    path = shared_tmp_path / "rod.h5"
    ff.save_reduced_body(path, two_masses(recovery=strip(COMM.rank)))
    change, reason = FORGERIES[kind]
    if COMM.rank == 0:
        with h5py.File(path, "r+") as file:
            change(file)
            with suppress(ValueError):  # no checksum is needed of an unreadable file
                file.attrs["digest"] = _digest(PlainFile(file, path.stat().st_size))
    COMM.Barrier()
    with pytest.raises(ValueError, match=rf"^reduced body '.*rod.h5': .*{reason}") as caught:
        ff.load_reduced_body(path)
    assert "\n" not in str(caught.value)


@pytest.mark.slow_on_ranks
def test_what_the_library_never_ends_with(
    shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without another process that goes first, this one would read without end."""
    monkeypatch.setattr(hdf5_structure, "_SECONDS", 1)
    path = shared_tmp_path / "rod.h5"
    ff.save_reduced_body(path, two_masses())
    if COMM.rank == 0:
        endless(path)
    COMM.barrier()
    with pytest.raises(ValueError, match=f"^reduced body '{path}': .* has not read it after 1 s$"):
        ff.load_reduced_body(path)


def test_a_pipe_is_not_waited_for(shared_tmp_path: Path) -> None:
    if COMM.rank == 0:
        os.mkfifo(shared_tmp_path / "rod.h5")
    COMM.Barrier()
    with pytest.raises(ValueError, match=r"^reduced body '.*rod.h5': is not a regular file"):
        ff.load_reduced_body(shared_tmp_path / "rod.h5")


def test_a_folder_that_is_not_there_leaves_nothing(shared_tmp_path: Path) -> None:
    body = replace(two_masses(), recovery=None)
    with pytest.raises(OSError, match="No such file"):
        ff.save_reduced_body(shared_tmp_path / "not" / "there.h5", body)
    assert list(shared_tmp_path.iterdir()) == []


@pytest.mark.three_ranks
def test_bodies_of_other_numbers_are_refused(shared_tmp_path):
    """A case whose options have changed would move the former body, and nobody would notice."""
    path = shared_tmp_path / "rod.h5"
    made_with = {"length": 0.1 + 0.2, "internal_modes": 6, "stiffening": True}
    ff.save_reduced_body(path, two_masses(), made_with=made_with)
    assert ff.load_reduced_body(path, made_with=made_with).mass == two_masses().mass
    with pytest.raises(ValueError, match=r"rod.h5': it was made with length = 0.3.*4, not 0.31;"):
        ff.load_reduced_body(path, made_with=made_with | {"length": 0.31})
    with pytest.raises(ValueError, match="density that it was made with is not recorded"):
        ff.load_reduced_body(path, made_with={"density": 1.0})
    ff.save_reduced_body(path, two_masses())
    with pytest.raises(ValueError, match="length that it was made with is not recorded"):
        ff.load_reduced_body(path, made_with=made_with)
