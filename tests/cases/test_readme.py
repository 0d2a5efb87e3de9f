# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the README shows is what there is."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import flexfem as ff

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def python(*arguments: object, **environment: str) -> str:
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    ).stdout


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_examples_run(number: int, tmp_path: Path) -> None:
    script = tmp_path / "example.py"
    script.write_text(EXAMPLES[number])
    if "ff.main(" in EXAMPLES[number]:
        assert "results are in" in python(script, "--smoke", "--output", tmp_path / "results")
    else:
        status, lowest = python(script).split()
        assert status == "ok"
        assert -0.51 < float(lowest) < -0.49


def test_help_text() -> None:
    text = python(ROOT / "cases" / "slider_crank.py", "--help", COLUMNS="80")
    assert text[text.index("this case:") : text.index("Writes history")].strip() in README


def test_public_names_exist() -> None:
    names = set(re.findall(r"\bff\.([A-Z]\w*)", README))
    listed = README[README.index("## What there is") : README.index("## The solver")]
    names |= {n for n in re.findall(r"`([A-Z]\w+)[`.]", listed) if n not in {"Joint", "AxisJoint"}}
    assert len(names) > 25
    for name in names:
        assert hasattr(ff, name), name
