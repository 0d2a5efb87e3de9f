# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damaged files against all readers: what they read, or a refusal in one line, and nothing else."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz_readers import MODULES

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("module", MODULES)
def test_damaged_files_are_read_or_refused(module: str) -> None:
    """In a process of its own, which has a gigabyte and may end by a signal."""
    arguments = ["-m", "tests.fuzz_readers", "--module", module, "--inputs", "300", "--seed", "11"]
    run = subprocess.run(
        [sys.executable, *arguments],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    # each reader has read and refused some: a reader that refuses everything tests nothing
    rows = [line for line in run.stdout.splitlines() if " files, " in line]
    assert rows
    assert not [row for row in rows if ", 0 read," in row or ", 0 refused," in row]
