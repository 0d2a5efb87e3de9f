# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem render: pictures and films of the motion in result folders."""

from collections.abc import Callable, Sequence
from pathlib import Path

from flexfem.cli.postprocessing import print_files, script
from flexfem.cli.usage import Parser, join_negative_values

SUMMARY = "draw the motion in result folders: flexfem render RESULTS_DIR [options]"
_DESCRIPTION = """\
Draws motion.png, a few superposed instants, and a film, motion.gif or motion.mp4, into each result
folder, or with --time one instant, still.png, or several side by side, instants.png. The folder of
a mode, such as results/blade/mode_01, is one, too.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Draw and print the names of the files."""
    return print_files(prepare(argv, prog))


def prepare(argv: Sequence[str], prog: str) -> Callable[[], list[Path]]:
    """Return what draws, and returns the files."""
    render = script("render")
    parser = Parser(prog=prog, description=_DESCRIPTION)
    render.add_arguments(parser)
    options = parser.parse_args(join_negative_values(argv))
    return lambda: list(render.make(options))
