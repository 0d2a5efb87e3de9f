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
NUMBER = re.compile(r"(-?\d+(?:\.\d*)?(?:e-?\d+)?)")


def python(*arguments: object, folder: Path = ROOT, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def assert_alike(line: str, shown: str) -> None:
    """Words are equal; numbers to five digits, which the README shows: its last one is rounded."""
    ours, expected = NUMBER.split(line), NUMBER.split(shown)
    assert ours[::2] == expected[::2], (line, shown)
    numbers = [float(number) for number in ours[1::2]]
    assert numbers == pytest.approx([float(n) for n in expected[1::2]], rel=1e-4), (line, shown)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_examples_run(number: int, tmp_path: Path) -> None:
    text = EXAMPLES[number]
    script = tmp_path / "example.py"
    script.write_text(text)
    if "ff.main(" in text:
        assert "results are in" in python(script, "--smoke", folder=tmp_path)
        return
    lines = python(script, folder=tmp_path).splitlines()
    shown = re.findall(r"^print\(.*\)\n# (.*)$", text, re.MULTILINE)
    assert len(lines) == len(shown) > 0
    for line, expected in zip(lines, shown, strict=True):
        assert_alike(line, expected)


def test_help_text() -> None:
    text = python(ROOT / "cases" / "slider_crank.py", "--help", COLUMNS="80")
    assert text[text.index("this case:") : text.index("Writes history")].strip() in README


def test_all_cases_are_listed() -> None:
    listed = README[README.index("| case | analysis |") : README.index("The options of")]
    names = {path.stem for path in (ROOT / "cases").glob("*.py")}
    assert set(re.findall(r"^\| `(\w+)` \|", listed, re.MULTILINE)) == names


def test_public_names_exist_and_are_listed() -> None:
    listed = README[README.index("## What there is") : README.index("## Restart and")]
    names = set(re.findall(r"\bff\.(\w+)", README))
    names |= set(re.findall(r"`([A-Z]\w+)(?=[`.(])", listed))
    for name in names:
        assert hasattr(ff, name), name
    told = set(re.findall(r"\w+", README))
    # what examples and the help of others say
    unsaid = {"Pose", "MarkerState", "Outcome", "LinearModel", "__version__"}
    assert set(ff.__all__) - told <= unsaid


def test_number_of_verified_values() -> None:
    table = (ROOT / "tests" / "verification" / "TABLE.md").read_text()
    count = table.rstrip().splitlines()[-1].split(" values")[0]
    assert f"The table has {count} values" in README
