# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scripts in ``examples/`` run as a user runs them, in their quick form."""

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))


@pytest.mark.serial
@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_smoke(script: Path, tmp_path: Path) -> None:
    """It ends well, prints a line at least, and leaves nothing beside itself."""
    done = subprocess.run(
        [sys.executable, str(script), "--smoke"], cwd=tmp_path, text=True, capture_output=True,
        timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert not any(FOLDER.glob("results*"))
