# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem plot: histories of one run, or of several in one picture."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from flexfem.cli.postprocessing import print_files, script
from flexfem.cli.usage import Parser, UsageError, join_negative_values, reader
from flexfem.options import Option

SUMMARY = "plot histories of runs: flexfem plot RESULTS_DIR... [options]"
_DESCRIPTION = """\
One folder: its columns over time, history.png; components of one quantity share a panel. Several
folders: a panel per column with a line per run, comparison.png in the first folder.
"""
#: Options of one run only, with their values when not given.
_OF_ONE = {"campbell": False, "axes": "fixed", "orders": 3, "outline": False, "time": None}
#: Options of several runs.
_OF_SEVERAL = {"after": None, "clip": False, "across": 1}
#: Other options with their values when not given.
_OF_ALL = {"columns": None, "x": "t", "path": None, "planes": "xy,xz"}
#: Options that an option needs, and those that have no effect beside one.
_WITH = {"planes": "path", "axes": "campbell", "orders": "campbell", "time": "outline"}
_INSTEAD = {
    "outline": ("campbell", "columns", "x", "path"),
    "campbell": ("columns", "x", "path"),
    "path": ("columns", "x", "across", "clip"),
}


def execute(argv: Sequence[str], prog: str) -> int:
    """Plot and print the names of the files."""
    return print_files(prepare(argv, prog))


def prepare(argv: Sequence[str], prog: str) -> Callable[[], list[Path]]:
    """Return what plots, and returns the files."""
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
    _fit_together(options)
    return lambda: _plot(folders, options)


def _fit_together(options: argparse.Namespace) -> None:
    """Refuse options without effect."""
    given = {
        name
        for name, default in (_OF_ONE | _OF_SEVERAL | _OF_ALL).items()
        if getattr(options, name) != default
    }
    for name, other in _WITH.items():
        if name in given and other not in given:
            raise UsageError(f"argument --{name}: needs --{other}")
    for name, others in _INSTEAD.items():
        for other in others:
            if name in given and other in given:
                raise UsageError(f"argument --{other}: changes nothing with --{name}")
    if {"clip", "x"} <= given:
        raise UsageError("argument --clip: columns are clipped over t, without --x")


def _plot(folders: list[Path], options: argparse.Namespace) -> list[Path]:
    if options.outline:
        return list(script("outline").make(folders[0], options.time, options.output))
    if len(folders) == 1:
        name = "plot_campbell" if options.campbell else "plot_history"
        return [script(name).make(folders[0], options)]
    compare, after = script("compare_runs"), options.after
    after = float("-inf") if after is None else after
    if options.path is not None:
        return [compare.make_paths(folders, options.path, options.planes, after, options.output)]
    return [
        compare.make(
            folders, options.columns, after, options.output, options.clip, options.x, options.across
        )
    ]


def _parser(prog: str) -> Parser:
    parser = Parser(prog=prog, description=_DESCRIPTION)
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument("--columns", metavar="A,B", help="columns to plot (default: all)")
    parser.add_argument("--output", type=Path, metavar="FILE", help="the picture")
    parser.add_argument(
        "--x", metavar="A", default=_OF_ALL["x"], help="column on the horizontal axis (default: t)"
    )
    parser.add_argument(
        "--path", metavar="POINT", help="path of POINT_x, POINT_y, POINT_z; of one run path.png"
    )
    parser.add_argument(
        "--planes",
        metavar="AB,CD",
        default=_OF_ALL["planes"],
        help="its planes (default: %(default)s)",
    )
    one = parser.add_argument_group("one run")
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
    one.add_argument(
        "--outline", action="store_true",
        help="sheet of shells and its outline from above, with its folds, outline.png and .csv",
    )  # fmt: skip
    one.add_argument("--time", type=float, metavar="T", help="of the outline [s] (default: last)")
    several = parser.add_argument_group("several runs")
    several.add_argument("--after", type=float, metavar="T", help="only from t = T on [s]")
    several.add_argument(
        "--clip", action="store_true",
        help="axes of the runs that do not diverge, with the time at which the others leave them",
    )  # fmt: skip
    several.add_argument(
        "--across", type=reader(Option("across", int, 1, "", minimum=1)), default=1, metavar="N",
        help="panels side by side (default: 1)",
    )  # fmt: skip
    return parser
