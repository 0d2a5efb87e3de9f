# SPDX-License-Identifier: LGPL-3.0-or-later
"""A motion that begins at rest is the same on any number of ranks."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from tests.cases.conftest import ROOT
from tests.cases.examples import complete_examples
from tests.histories import columns


def test_stiff_links_in_equilibrium_begin_alike(tmp_path: Path) -> None:
    """Undamped, what the first steps do to stiff links rings for long.

    All predictions of the first step are equal, and rounding must not choose: two ranks that choose
    another one than one rank differ by 1e-7 of the forces.
    """
    if MPI.COMM_WORLD.size == 1:
        pytest.skip("compares several ranks with one")
    (text,) = complete_examples((ROOT / "flexfem/docs/guide/walk.md").read_text())
    script = tmp_path / "scissor.py"
    script.write_text(text.replace("damping=1e-3", "damping=0.0"))
    case = load_case(str(script))
    values, options = case.prepare({"t_end": 0.02}, quiet=True)
    assert options.start == "equilibrium"
    several = columns(ff.simulate(case.model(**values), options))
    one = ff.simulate(case.model(**values), options, comm=MPI.COMM_SELF).history
    for name in ("driving", "foot_force", "rail_force"):
        forces = [c for c in one if c.startswith(f"{name}_f")]
        largest = max(np.abs(one[c]).max() for c in forces)
        assert max(np.abs(one[c] - several[c]).max() for c in forces) <= 1e-9 * largest, name
