# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs on eight ranks, more than cores: three levels of rows between ranks."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

RUNS = {
    "chain": "--links 16 --t-end 0.1",
    "deployable_truss": "--bays 4 --t-end 0.1",
    "sliding_beam": "--t-end 0.05",
    "cylindrical_pendulum": "--t-end 0.05",
    "solar_array": "--panels 4 --t-end 0.1 --no-contact",
}


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("name", RUNS)
def test_eight_ranks_give_the_motion_of_one(
    name: str, run: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """Rows that a level leaves out, or adds twice, move a body by 1e-3 and more."""
    history = []
    for ranks in (1, 8):
        folder = tmp_path / str(ranks)
        given = ["-m", "flexfem", "run", name, *RUNS[name].split(), "--quiet", "--output", folder]
        ended = run(ranks, *given)
        assert ended.returncode == 0, ended.stderr
        history.append(np.genfromtxt(folder / "history.csv", delimiter=",", names=True))
    summary = json.loads((tmp_path / "8" / "summary.json").read_text())
    assert (summary["ranks"], summary["shared_rows"] > 0) == (8, True)
    one, eight = history
    for column in one.dtype.names:
        family = [c for c in one.dtype.names if c.rpartition("_")[0] == column.rpartition("_")[0]]
        size = max(np.abs(one[c]).max() for c in family)
        if column.startswith("error_"):  # between positions of about a metre
            size = max(size, 1.0)
        assert np.abs(eight[column] - one[column]).max() <= 1e-9 * size, column
