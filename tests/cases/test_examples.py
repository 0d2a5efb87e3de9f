# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scripts in ``examples/`` run in their quick form, in which they compare what they find."""

import runpy
from pathlib import Path

import pytest

from flexfem.docs.extensions.topics import EXAMPLES

SCRIPTS = sorted(EXAMPLES.glob("*.py"))
pytestmark = pytest.mark.serial


@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_smoke(
    script: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It ends well, prints a line at least, and leaves nothing in the folder it is run from."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(script), "--smoke"])
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert not list(tmp_path.iterdir())
