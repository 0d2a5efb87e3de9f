# SPDX-License-Identifier: LGPL-3.0-or-later
"""A motion that begins at rest is the same on any number of ranks."""

from pathlib import Path

import numpy as np
import pytest

from flexfem.io import read_history
from tests.cases.conftest import ROOT, Run
from tests.cases.examples import complete_examples

pytestmark = pytest.mark.serial


def test_stiff_links_in_equilibrium_begin_alike(run: Run, tmp_path: Path) -> None:
    """Undamped, what the first steps do to stiff links rings for long.

    All predictions of the first step are equal, and rounding must not choose: two ranks that choose
    another one than one rank differ by 1e-7 of the forces.
    """
    (text,) = complete_examples((ROOT / "flexfem/docs/guide/walk.md").read_text())
    script = tmp_path / "scissor.py"
    script.write_text(text.replace("damping=1e-3", "damping=0.0"))
    runs = []
    for ranks in (1, 2):
        folder = tmp_path / f"ranks{ranks}"
        ended = run(ranks, script, "--t-end", "0.02", "--output", folder, "--quiet")
        assert (ended.returncode, ended.stderr) == (0, "")
        runs.append(read_history(folder / "history.csv"))
    one, two = runs
    for name in ("driving", "foot_force", "rail_force"):
        columns = [c for c in one if c.startswith(f"{name}_f")]
        largest = max(np.abs(one[c]).max() for c in columns)
        assert max(np.abs(one[c] - two[c]).max() for c in columns) <= 1e-9 * largest
