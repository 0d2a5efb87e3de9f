# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem uncertainty: standard deviations of results from those of parameters, by one gradient."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem._files import number_in
from flexfem.cli.derivative_line import (
    DerivativeLine,
    add_derivative_options,
    errors_of_derivatives,
    parts,
    read_derivatives,
    table_of,
    tell,
    units,
)
from flexfem.cli.usage import Parser

if TYPE_CHECKING:
    from flexfem.gradients.uncertainty import Uncertainty

SUMMARY = (
    "uncertainty of results to first order: flexfem uncertainty NAME --of max:x --std mass=0.1"
)
_TEXT = """\
Finds the standard deviations of numbers of a motion, of equilibria or of modes from those of
parameters, to first order by one gradient, with the share of each parameter in the variance. Runs
beside the values of the parameters tell whether that is enough: a number for which they differ from
what is linear by a tenth of its standard deviation has a warning. The table is written to
uncertainty.json. Put "mpirun -n N" in front to run on N MPI ranks. "flexfem sweep" makes runs with
samples instead.
"""
_MORE = """\
All other options are those of the case: see "flexfem run NAME --help". Exit codes: 0 done, 1 the
analysis or its adjoint failed, 2 wrong input, or something in the model has no derivative.
"""
#: What is written.
_NAMES = ("value", "deviation", "share", "nonlinearity", "warnings")


def execute(argv: Sequence[str], prog: str) -> int:
    """Compute the deviations and print the table."""
    line = read_derivatives(_parser(prog), argv, prog)
    with errors_of_derivatives():
        found, values, spread = _uncertainty(line)

    def text(path: Path) -> str:
        table = _table(found, values, spread, units(line.case))
        return f"{table}\n{_summary(found, path)}"

    return tell(line, found, _NAMES, text)


def _parser(prog: str) -> Parser:
    parser = Parser(prog=f"{prog} NAME", description=_TEXT, epilog=_MORE)
    parser.add_argument(
        "--std", action="append", default=[], metavar="NAME=X,...",
        help="standard deviations, 0.1 or 5%% of the value, of options that are real numbers, "
        "components such as gravity[2], or paths into the model such as spring.stiffness",
    )  # fmt: skip
    parser.add_argument(
        "--within", action="append", default=[], metavar="NAME=X,...",
        help="the same of values that are anywhere within X of their own, with equal probability",
    )  # fmt: skip
    add_derivative_options(
        parser, "uncertainty", "make the runs that tell whether the first order is enough"
    )
    return parser


def _uncertainty(
    line: DerivativeLine,
) -> "tuple[Uncertainty, Mapping[str, Any], Mapping[str, float]]":
    """The result, values of the parameters, and their standard deviations."""
    from flexfem.gradients.motion.parameters import build_with_options
    from flexfem.gradients.uncertainty import uncertainty

    own = line.own
    texts = [(text, "--std", 1.0) for text in parts(own.std)]
    texts += [(text, "--within", 3.0**-0.5) for text in parts(own.within)]
    given = {}
    for text, option, factor in texts:
        name, width, relative = _width(text, option)
        if name in given:
            raise ValueError(f"{option} {name} is given twice")
        given[name] = (factor * width, relative)
    build, values = build_with_options(line.case.build, line.parameters, list(given))
    spread = {
        name: width * (abs(float(values[name])) if relative else 1.0)
        for name, (width, relative) in given.items()
    }
    found = uncertainty(
        build, line.of, values, spread, line.settings, ks_rho=own.ks_rho,
        check=not own.unchecked, memory=own.memory, scratch=own.scratch,
    )  # fmt: skip
    return found, values, spread


def _width(text: str, option: str) -> tuple[str, float, bool]:
    """Read ``name=X`` or ``name=X%``: the name, the number, and whether it is relative.

    Raises:
        ValueError: It is not of this form.
    """
    name, _, number = text.partition("=")
    try:
        width = number_in(number.removesuffix("%"))
    except ValueError:
        raise ValueError(f"{option} '{text}' is not of the form name=0.1 or name=5%") from None
    relative = number.endswith("%")
    return name.strip().replace("-", "_"), width * (0.01 if relative else 1.0), relative


def _table(
    found: "Uncertainty", values: Mapping[str, Any], spread: Mapping[str, float],
    units: Mapping[str, str],
) -> str:  # fmt: skip
    """One line for each number, and one for each parameter of each."""
    rows = [("of", "value", "std", "wrt", "at", "std", "unit", "share")]
    for of, shares in found.share.items():
        for k, (name, share) in enumerate(shares.items()):
            own = (of, f"{found.value[of]:.6g}", f"{found.deviation[of]:.4g}")
            unit = units.get(name.split("[")[0], "") or "-"
            more = (f"{float(values[name]):.6g}", f"{spread[name]:.4g}", unit, f"{share:.3f}")
            rows.append((*own, name, *more) if k == 0 else ("", "", "", name, *more))
    return table_of(rows)


def _summary(found: "Uncertainty", path: Path) -> str:
    """What the check has found in words."""
    worst = max(found.nonlinearity.values())
    check = "" if worst != worst else (
        f"runs aside differ from what is linear by {worst:.2g} standard deviations at most; "
    )  # fmt: skip
    return f"{check}{path}"
