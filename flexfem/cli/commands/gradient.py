# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem gradient: derivatives of a motion by any number of parameters, from one run."""

import argparse
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import launch
from flexfem._checks import InputError
from flexfem._faults import FunctionError
from flexfem.case import Case
from flexfem.cli.case_line import check_output, read_options
from flexfem.cli.case_run import built, load_case
from flexfem.cli.usage import FailedRunError, Parser, UsageError, folder, join_negative_values
from flexfem.options import Option

if TYPE_CHECKING:
    from flexfem.gradients.gradient import Gradient

SUMMARY = "derivatives by the adjoint of an analysis: flexfem gradient NAME --of final:x --wrt mass"
_TEXT = """\
Differentiates numbers of a motion, of equilibria or of modes by options of the case, or by numbers
in its model, whatever their number: a motion is computed once, and its discrete adjoint goes back
over the same steps with the same factors. The table is written to gradient.json. Put "mpirun -n N"
in front to run on N MPI ranks. "flexfem sensitivities" takes differences of runs instead, for
everything.
"""
_MORE = """\
All other options are those of the case: see "flexfem run NAME --help". Exit codes: 0 done, 1 the
analysis or its adjoint failed, 2 wrong input, or something in the model has no derivative.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Compute the gradient and print the table."""
    parser = _parser(prog)
    if not argv or argv[0].startswith("-"):
        parser.parse_args(argv)
        parser.error("the following arguments are required: NAME")
    own, rest = parser.parse_known_args(join_negative_values(argv[1:]))
    case, given = read_options(load_case(argv[0]), rest, prog=f"{prog} {shlex.quote(argv[0])}")
    output = own.output or Path("results") / f"{case.folder}_gradient"
    parameters, settings = _prepared(case, given, output)
    built(case, parameters, argv)  # faults of the model before all else, on every rank
    of, wrt = (_parts(own.of), [name.replace("-", "_") for name in _parts(own.wrt)])
    try:
        found, values = _gradient(case, (parameters, settings), (of, wrt), own)
    except InputError as error:
        raise UsageError(str(error), agreed=not error.alone) from error
    except (TypeError, ValueError) as error:  # of the names, on every rank
        raise UsageError(str(error), agreed=True) from error
    except (FunctionError, RuntimeError) as error:
        raise FailedRunError(str(error)) from error
    _write(output, found)
    if not own.quiet:
        launch.say(_table(found, values, _units(case)))
        launch.say(_summary(found, output))
    for text in found.warnings:
        launch.say(f"warning: {text}", error=True)
    return 0


def _parser(prog: str) -> Parser:
    parser = Parser(prog=f"{prog} NAME", description=_TEXT, epilog=_MORE)
    parser.add_argument(
        "--of", action="append", default=[], metavar="HOW:COLUMN,...",
        help="numbers, such as final:tip_x: final, mean, integral, rms, max, min, ks of a column; "
        "frequency:1, damping:1 of modes, buckling:1 of statics",
    )  # fmt: skip
    parser.add_argument(
        "--wrt", action="append", default=[], metavar="NAME,...",
        help="options that are real numbers, components such as gravity[2], or paths into the "
        "model such as rod.velocity[0] or spring.stiffness",
    )  # fmt: skip
    parser.add_argument(
        "--ks-rho", type=float, metavar="X", help="rho of ks, one over the unit of the column"
    )
    parser.add_argument(
        "--memory", type=float, default=2e9, metavar="BYTES",
        help="for states on each rank; with less, they are computed once more (default: 2e9)",
    )  # fmt: skip
    parser.add_argument(
        "--unchecked", action="store_true",
        help="do not compare with the linearised motion along a random direction",
    )  # fmt: skip
    parser.add_argument(
        "--output", type=folder, metavar="DIR",
        help="folder of gradient.json (default: results/NAME_gradient)",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="no table, errors only")
    return parser


def _parts(texts: Sequence[str]) -> list[str]:
    return [part.strip() for text in texts for part in text.split(",") if part.strip()]


def _prepared(case: Case, given: dict[str, Any], output: Path) -> tuple[dict[str, Any], Any]:
    """Keyword arguments of ``build`` and the options of the motion.

    Raises:
        UsageError: A value is not admissible, or the analysis is none in time.
    """
    from flexfem.analyses.dynamics import RunOptions
    from flexfem.analyses.modes import ModeOptions
    from flexfem.analyses.statics import StaticOptions

    smoke = given.pop("smoke")
    given = {name: value for name, value in given.items() if name not in ("quiet", "progress")}
    if "restart" in given:
        raise UsageError("gradient does not take --restart: a motion begins at its start")
    try:
        check_output(output)
        parameters, settings = case.prepare(given, smoke=smoke)
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    if type(settings) not in (RunOptions, StaticOptions, ModeOptions):  # and no kind of them
        name = case.analysis.name
        raise UsageError(
            f"gradient is for dynamics, statics and modes, not for the analysis {name}"
        )
    return parameters, settings


def _gradient(
    case: Case, prepared: tuple[Mapping[str, Any], Any], names: tuple[list[str], list[str]],
    own: argparse.Namespace,
) -> "tuple[Gradient, Mapping[str, Any]]":  # fmt: skip
    """The gradient, and the values of the parameters."""
    from flexfem.analyses.dynamics import RunOptions
    from flexfem.gradients.gradient import gradient
    from flexfem.gradients.motion.parameters import build_with_options

    (parameters, settings), (of, wrt) = prepared, names
    build, values = build_with_options(case.build, parameters, wrt)
    checked = isinstance(settings, RunOptions) and not own.unchecked
    found = gradient(
        build, of, values, settings, ks_rho=own.ks_rho, memory=own.memory, check=checked
    )
    return found, values


def _units(case: Case) -> dict[str, str]:
    """Units of the options, as far as they are known."""
    return {one.name: one.unit or "" for one in case.all_options() if isinstance(one, Option)}


def _write(output: Path, found: "Gradient") -> None:
    """Write ``gradient.json`` on the first rank."""
    from mpi4py import MPI

    from flexfem.io.summary import write_summary

    names = (
        "value", "gradient", "check", "wall_seconds_forward", "wall_seconds_backward",
        "factorizations_forward", "factorizations_backward", "growth", "warnings",
    )  # fmt: skip
    write_summary(
        output / "gradient.json", {name: getattr(found, name) for name in names}, MPI.COMM_WORLD
    )


def _table(found: "Gradient", values: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """One line for each derivative."""
    rows = [("of", "value", "wrt", "at", "unit", "derivative", "relative")]
    for of, by in found.gradient.items():
        value = found.value[of]
        for name, derivative in by.items():
            at = float(values[name])
            relative = f"{derivative * at / value:.4g}" if value else "-"
            unit = units.get(name.split("[")[0], "") or "-"
            rows.append(
                (of, f"{value:.6g}", name, f"{at:.6g}", unit, f"{derivative:.9g}", relative)
            )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    return "\n".join(lines)


def _summary(found: "Gradient", output: Path) -> str:
    """Seconds, factorisations and the check in words."""
    worst = max(found.check.values(), default=None)
    check = "" if worst is None else f"; adjoint and tangent agree to {worst:.1e}"
    return (
        f"forwards {found.wall_seconds_forward:.3g} s, backwards {found.wall_seconds_backward:.3g} "
        f"s with {found.factorizations_backward} factorisations{check}; {output / 'gradient.json'}"
    )
