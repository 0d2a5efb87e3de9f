# SPDX-License-Identifier: LGPL-3.0-or-later
"""Complete Python examples in texts: they run, and print what the text says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NUMBER = re.compile(r"(-?\d+(?:\.\d*)?(?:e-?\d+)?)")


def python(*arguments: object, folder: Path = ROOT, **environment: str) -> str:
    """Output of a Python program."""
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


def complete_examples(text: str) -> list[str]:
    """The blocks of Python in a Markdown text."""
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def assert_runs(text: str, folder: Path) -> None:
    """Run an example in a folder; every print is followed by a comment with its output."""
    script = folder / "example.py"
    script.write_text(text)
    if "ff.main(" in text:
        assert "results are in" in python(script, "--smoke", folder=folder)
        return
    lines = python(script, folder=folder).splitlines()
    shown = re.findall(r"^print\(.*\)\n# (.*)$", text, re.MULTILINE)
    assert len(lines) == len(shown) > 0
    for line, expected in zip(lines, shown, strict=True):
        assert_alike(line, expected)


def assert_alike(line: str, shown: str) -> None:
    """Words are equal; numbers to five digits, which are shown: the last one is rounded."""
    ours, expected = NUMBER.split(line), NUMBER.split(shown)
    assert ours[::2] == expected[::2], (line, shown)
    numbers = [float(number) for number in ours[1::2]]
    assert numbers == pytest.approx([float(n) for n in expected[1::2]], rel=1e-4), (line, shown)
