# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem view: a result folder as one HTML file to look at, turn and send."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from flexfem import launch
from flexfem.cli.postprocessing import print_files
from flexfem.cli.usage import Parser, folder, join_negative_values

SUMMARY = "make one HTML file that shows a result: flexfem view RESULTS_DIR [options]"
_DESCRIPTION = """\
Makes view.html in each result folder: the motion to turn, play and look into, with colours, values,
forces at joints and the histories of probes. It is one file that needs no network and nothing but a
browser; view.html#t=1.5 opens at 1.5 s.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Make the pages and print the names of the files."""
    parser = Parser(prog=prog, description=_DESCRIPTION)
    parser.add_argument("folders", type=folder, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument(
        "--frames", type=int, metavar="N",
        help="instants at most, evenly chosen (default: up to 600, fewer of large models)",
    )  # fmt: skip
    parser.add_argument(
        "--fields", metavar="A,B",
        help='fields that colours can show, "all" or "none" (default: the usual ones)',
    )  # fmt: skip
    parser.add_argument(
        "--gltf", action="store_true",
        help="instead of pages view.glb, an animated glTF file of what moves in frames: beams, "
        "rigid bodies, joints, obstacles",
    )  # fmt: skip
    options = parser.parse_args(join_negative_values(argv))
    return print_files(lambda: _make(options))


def _make(options: argparse.Namespace) -> list[Path]:
    """Make the pages, and print what they leave out."""
    from flexfem.io.view.document import write_view
    from flexfem.io.view.gltf import write_gltf
    from flexfem.io.view.reading import Choice

    fields = None if options.fields is None else options.fields.split(",")
    made = []
    for one in dict.fromkeys(options.folders):
        write = write_gltf if options.gltf else write_view
        path, notes = write(one, Choice(options.frames, fields))
        made.append(path)
        for note in notes:
            launch.say(f"{one}: {note}")
    return made
