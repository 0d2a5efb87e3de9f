# SPDX-License-Identifier: LGPL-3.0-or-later
"""Complete Python examples in texts: they run, and print what the text says."""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Runs scripts as Python does, with --smoke those that have a command line.
IN_TURN = """\
import contextlib, os, runpy, sys, traceback

scripts, path = sys.argv[1:], list(sys.path)
for script in scripts:
    folder = os.path.dirname(script)
    os.chdir(folder)
    sys.path[:] = [folder, *path]
    smoke = ["--smoke"] if "ff.main(" in open(script).read() else []
    sys.argv = [script, *smoke]
    with open("printed", "w") as stream, contextlib.redirect_stdout(stream):
        with open("warned", "w") as warned, contextlib.redirect_stderr(warned):
            try:
                runpy.run_path(script, run_name="__main__")
            except BaseException as error:
                if not isinstance(error, SystemExit) or error.code:
                    traceback.print_exc(file=stream)
"""
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


def run_in_turn(texts: Sequence[str], folder: Path) -> list[tuple[str, str]]:
    """What examples print, or its traceback, and their warnings; each in a folder of its own.

    One process runs them all: to start one with the package takes longer than most examples.
    """
    scripts = []
    for number, text in enumerate(texts):
        scripts.append(folder / str(number) / "example.py")
        scripts[-1].parent.mkdir()
        scripts[-1].write_text(text)
    python("-c", IN_TURN, *scripts, folder=folder)
    return [
        ((script.parent / "printed").read_text(), (script.parent / "warned").read_text())
        for script in scripts
    ]


def assert_printed(text: str, printed: str, warned: str) -> None:
    """An example ran without a warning; its prints are followed by comments with their output."""
    assert "Traceback" not in printed, printed
    assert [line for line in warned.splitlines() if line not in text] == []
    if "ff.main(" in text:
        assert "results are in" in printed
        return
    lines = printed.splitlines()
    shown = re.findall(r"^print\(.*\)\n# (.*)$", text, re.MULTILINE)
    assert len(lines) == len(shown) > 0, printed
    for line, expected in zip(lines, shown, strict=True):
        assert_alike(line, expected)


def assert_alike(line: str, shown: str) -> None:
    """Words are equal; numbers to five digits, which are shown: the last one is rounded."""
    ours, expected = NUMBER.split(line), NUMBER.split(shown)
    assert ours[::2] == expected[::2], (line, shown)
    numbers = [float(number) for number in ours[1::2]]
    assert numbers == pytest.approx([float(n) for n in expected[1::2]], rel=1e-4), (line, shown)
