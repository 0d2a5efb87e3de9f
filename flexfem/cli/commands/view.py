# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem view: a result folder as one HTML file to look at, turn and send."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flexfem import launch
from flexfem.cli.postprocessing import print_files
from flexfem.cli.usage import Parser, UsageError, file, folder, join_negative_values

if TYPE_CHECKING:
    from flexfem.io.view.reading import Choice

SUMMARY = "make one HTML file that shows a result: flexfem view RESULTS_DIR [options]"
#: By how much a server gives way to the run that it shows.
_NICE = 10
_DESCRIPTION = """\
Makes view.html in each result folder: the motion to turn, play and look into, with colours, values,
forces at joints and the histories of probes. It is one file that needs no network and nothing but a
browser; view.html#t=1.5 opens at 1.5 s. With --live it is a page of a run that goes on.
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
        help="instead of pages view.glb, an animated glTF file; where shells, solids or cables "
        "deform with 101 instants at most by default",
    )  # fmt: skip
    parser.add_argument(
        "--gallery", type=file, metavar="FILE",
        help="also a page with links to the pages, and with pictures that flexfem render has made",
    )  # fmt: skip
    parser.add_argument(
        "--live", action="store_true",
        help="show a run that goes on, by a server on this computer, until Ctrl-C",
    )  # fmt: skip
    parser.add_argument(
        "--port", type=int, default=0, metavar="N",
        help="of that server, for tunnels: ssh -L N:127.0.0.1:N (default: one that is free)",
    )  # fmt: skip
    options = parser.parse_args(join_negative_values(argv))
    if options.live:
        return _serve(options)
    return print_files(lambda: _make(options))


def _serve(options: argparse.Namespace) -> int:
    """Show one folder while its run goes on."""
    from flexfem.io.view.live import serve

    if len(options.folders) > 1 or options.gltf or options.gallery:
        raise UsageError("argument --live: takes one RESULTS_DIR, no --gltf and no --gallery")
    if not 0 <= options.port < 2**16:
        raise UsageError(f"argument --port: must be from 0 to 65535, got {options.port}")
    if launch.rank() > 0:
        return 0
    os.nice(_NICE)
    try:
        serve(options.folders[0], _choice(options), options.port, launch.say)
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    return 0


def _make(options: argparse.Namespace) -> list[Path]:
    """Make the pages, and print what they leave out."""
    from flexfem.io.gltf.writer import write_gltf
    from flexfem.io.view.document import write_view
    from flexfem.io.view.gallery import write_gallery

    if options.gallery and options.gltf:
        raise UsageError("argument --gallery: links pages, not glTF files")
    made, choice = [], _choice(options)
    for one in dict.fromkeys(options.folders):
        write = write_gltf if options.gltf else write_view
        path, notes = write(one, choice)
        made.append(path)
        for note in notes:
            launch.say(f"{one}: {note}")
    if options.gallery:
        made.append(write_gallery(options.gallery, made))
    return made


def _choice(options: argparse.Namespace) -> "Choice":
    from flexfem.io.view.reading import Choice

    fields = None if options.fields is None else options.fields.split(",")
    return Choice(options.frames, fields)
