# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem plot: histories of one run, or of several in one picture."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from flexfem.cli.postprocessing import print_files, script
from flexfem.cli.usage import Parser, UsageError, join_negative_values

SUMMARY = "plot histories of runs: flexfem plot RESULTS_DIR... [options]"
_DESCRIPTION = """\
One folder: its columns over time, history.png; components of one quantity share a panel. Several
folders: a panel per column with a line per run, comparison.png in the first folder.
"""
#: Options of one run only, with their values when not given.
_OF_ONE = {
    "x": "t", "path": None, "planes": "xy,xz", "campbell": False, "axes": "fixed", "orders": 3,
}  # fmt: skip
#: Options of several runs.
_OF_SEVERAL = {"after": None, "clip": False}


def execute(argv: Sequence[str], prog: str) -> int:
    """Plot and print the names of the files."""
    options = _parser(prog).parse_args(join_negative_values(argv))
    folders = list(dict.fromkeys(options.folders))
    if len(folders) > 1:
        for name, default in _OF_ONE.items():
            if getattr(options, name) != default:
                raise UsageError(f"argument --{name}: takes one RESULTS_DIR, got {len(folders)}")
    else:
        for name, default in _OF_SEVERAL.items():
            if getattr(options, name) != default:
                raise UsageError(f"argument --{name}: takes several RESULTS_DIR, got 1")
    return print_files(lambda: [_plot(folders, options)])


def _plot(folders: list[Path], options: argparse.Namespace) -> Path:
    if len(folders) > 1:
        after = float("-inf") if options.after is None else options.after
        found = script("compare_runs").make(
            folders, options.columns, after, options.output, options.clip
        )
    else:
        name = "plot_campbell" if options.campbell else "plot_history"
        found = script(name).make(folders[0], options)
    return Path(found)


def _parser(prog: str) -> Parser:
    parser = Parser(prog=prog, description=_DESCRIPTION)
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument("--columns", metavar="A,B", help="columns to plot (default: all)")
    parser.add_argument("--output", type=Path, metavar="FILE", help="the picture")
    one = parser.add_argument_group("one run")
    one.add_argument(
        "--x", metavar="A", default=_OF_ONE["x"], help="column on the horizontal axis (default: t)"
    )
    one.add_argument("--path", metavar="POINT", help="path of POINT_x, POINT_y, POINT_z, path.png")
    one.add_argument(
        "--planes",
        metavar="AB,CD",
        default=_OF_ONE["planes"],
        help="planes of the path (default: %(default)s)",
    )
    one.add_argument(
        "--campbell", action="store_true", help="Campbell diagram of modes over speed, campbell.png"
    )
    one.add_argument(
        "--axes", choices=("fixed", "turning"), default=_OF_ONE["axes"],
        help="axes of its frequencies (default: fixed)",
    )  # fmt: skip
    one.add_argument(
        "--orders",
        type=int,
        default=_OF_ONE["orders"],
        metavar="N",
        help="its engine orders (default: 3)",
    )
    several = parser.add_argument_group("several runs")
    several.add_argument("--after", type=float, metavar="T", help="only from t = T on [s]")
    several.add_argument(
        "--clip", action="store_true",
        help="axes of the runs that do not diverge, with the time at which the others leave them",
    )  # fmt: skip
    return parser
