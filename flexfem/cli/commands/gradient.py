# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem gradient: derivatives of a motion by any number of parameters, from one run."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
#: What is written.
_NAMES = (
    "at", "value", "gradient", "check", "wall_seconds_forward", "wall_seconds_backward",
    "factorizations_forward", "factorizations_backward", "steps_repeated",
    "growth", "warnings",
)  # fmt: skip


def execute(argv: Sequence[str], prog: str) -> int:
    """Compute the gradient and print the table."""
    line = read_derivatives(_parser(prog), argv, prog)
    with errors_of_derivatives():
        found, values = _gradient(line)

    def text(path: Path) -> str:
        table = _table(found, values, units(line.case))
        return f"{table}\n{_summary(found, path)}"

    return tell(line, found, _NAMES, text)


def _parser(prog: str) -> Parser:
    parser = Parser(prog=f"{prog} NAME", description=_TEXT, epilog=_MORE)
    parser.add_argument(
        "--wrt", action="append", default=[], metavar="NAME,...",
        help="options that are real numbers, components such as gravity[2], or paths into the "
        "model such as rod.velocity[0], spring.stiffness, or mesh.nodes[GROUP] for all nodes of a "
        "group",
    )  # fmt: skip
    add_derivative_options(
        parser, "gradient", "compare with the linearised motion along a random direction"
    )
    return parser


def _gradient(line: DerivativeLine) -> "tuple[Gradient, Mapping[str, Any]]":
    """The gradient, and the values of the parameters."""
    from flexfem.analyses.dynamics import RunOptions
    from flexfem.gradients.gradient import gradient
    from flexfem.gradients.motion.parameters import build_with_options

    own, wrt = (
        line.own,
        [name if "." in name else name.replace("-", "_") for name in parts(line.own.wrt)],
    )
    build, values = build_with_options(line.case.build, line.parameters, wrt)
    checked = isinstance(line.settings, RunOptions) and not own.unchecked
    found = gradient(
        build,
        line.of,
        values,
        line.settings,
        ks_rho=own.ks_rho,
        memory=own.memory,
        scratch=own.scratch,
        check=checked,
    )
    return found, values


def _table(found: "Gradient", values: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """One line for each derivative."""
    rows = [("of", "value", "wrt", "at", "unit", "derivative", "relative")]
    for of, by in found.gradient.items():
        value = found.value[of]
        for name, derivative in by.items():
            unit = units.get(name.split("[")[0], "") or "-"
            if not isinstance(derivative, float):  # by places of nodes
                most = f"at most {abs(derivative).max():.9g}"
                rows.append((of, f"{value:.6g}", name, f"{len(derivative)} nodes", "m", most, "-"))
                continue
            at = float(values[name])
            relative = f"{derivative * at / value:.4g}" if value else "-"
            rows.append(
                (of, f"{value:.6g}", name, f"{at:.6g}", unit, f"{derivative:.9g}", relative)
            )
    return table_of(rows)


def _summary(found: "Gradient", path: Path) -> str:
    """Seconds, factorisations and the check in words."""
    worst = max(found.check.values(), default=None)
    check = "" if worst is None else f"; adjoint and tangent agree to {worst:.1e}"
    return (
        f"forwards {found.wall_seconds_forward:.3g} s, backwards {found.wall_seconds_backward:.3g} "
        f"s with {found.factorizations_backward} factorisations{check}; {path}"
    )
