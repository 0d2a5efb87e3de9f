# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables as pictures show them: along tangents and arcs, with their tensions."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.unit.test_io import pvd, read
from tests.verification.test_cable_systems import APART, R1, R2, belt
from tests.verification.test_cables import rubbing


def lines(folder: Path, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lengths, middles and tensions of the lines of an instant."""
    mesh = read(folder / pvd(folder / "cables.pvd")[number][1])
    ends = np.asarray(mesh.points, dtype=float)[mesh.cells.reshape(-1, 3)[:, 1:]]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return lengths, ends.mean(axis=1), np.asarray(mesh["tension"])


def run(model: ff.Model, folder: Path, **given: Any) -> None:
    """Ten steps with pictures of the start and the end."""
    options = ff.RunOptions(dt=1e-3, t_end=0.01, output=folder, every=10, quiet=True, **given)
    assert ff.simulate(model, options).status == "ok"


@pytest.mark.three_ranks
@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["open", "crossed"])
def test_a_belt_is_drawn_along_tangents_and_arcs(sense: float, shared_tmp_path: Path) -> None:
    run(belt(sense, preload=100.0, speed=40.0), shared_tmp_path)
    if MPI.COMM_WORLD.rank:
        return
    lean = np.arcsin((R2 - sense * R1) / APART)
    straight = 2.0 * APART * np.cos(lean)
    around = R2 * (np.pi + 2.0 * lean) + R1 * (np.pi - sense * 2.0 * lean)
    for number in (0, 1):
        lengths, middles, tension = lines(shared_tmp_path, number)
        # 48 chords of an arc are shorter by 1e-3 of it; an arc on the other side by half of it
        assert lengths.sum() == pytest.approx(straight + around, rel=1e-3)
        np.testing.assert_allclose(tension, 100.0, rtol=1e-5)
        near = np.linalg.norm(middles - [APART, 0.0, 0.0], axis=1)
        assert near.min() > 0.998 * R2


@pytest.mark.three_ranks
def test_tensions_before_and_after_a_sheave_with_friction(shared_tmp_path: Path) -> None:
    run(rubbing((3.0, 1.5), 0.1, 0.4, tension_only=False), shared_tmp_path)
    if MPI.COMM_WORLD.rank:
        return
    _, middles, tension = lines(shared_tmp_path, 1)
    left = tension[middles[:, 0] < -0.199]
    right = tension[middles[:, 0] > 0.199]
    assert left.max() / right.max() == pytest.approx(np.exp(0.1 * np.pi), rel=1e-5)
