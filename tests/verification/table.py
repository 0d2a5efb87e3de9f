# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification table: every benchmark at its full mesh, beside its reference.

Run from the source tree::

    python -m tests.verification.table                  # writes tests/verification/TABLE.md
    python -m tests.verification.table rigid_pendulum   # some modules, to the terminal

Each module in ``benchmarks/`` has a function ``results`` that returns its lines; where that takes
long, tests call it with ``full=False``. The exit code is 1 when a line misses its tolerance.
"""

import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from tests.verification.result import Result

HERE = Path(__file__).parent
TABLE = HERE / "TABLE.md"
_HEAD = """\
# Verification

Computed by `make verification`; every line is checked against its tolerance. The error is relative
to the reference (or, for small values of a larger quantity, to that).

| case | quantity | reference | source | flexfem | error | tolerance | mesh and step |
|---|---|---|---|---|---|---|---|
"""


def modules() -> list[str]:
    """Names of all benchmark modules."""
    found = (path.stem for path in sorted((HERE / "benchmarks").glob("*.py")))
    names = [name for name in found if not name.startswith("_")]
    return [name for name in names if hasattr(load(name), "results")]


def load(name: str) -> object:
    """A benchmark module."""
    return import_module(f"tests.verification.benchmarks.{name}")


def line(result: Result) -> str:
    """One row of the table."""
    mark = "" if result.passed else " **missed**"
    return (
        f"| {result.case} | {result.quantity} | {result.reference:.8g} | {result.source} "
        f"| {result.ours:.8g} | {result.error:.1e}{mark} | {result.tolerance:.0e} "
        f"| {result.mesh} |"
    )


def rows(names: list[str]) -> Iterator[tuple[str, bool]]:
    """Rows of the given modules and whether each passed; progress goes to stderr."""
    for name in names:
        begin = time.perf_counter()
        results = load(name).results()  # type: ignore[attr-defined]
        seconds = time.perf_counter() - begin
        print(f"{name}: {len(results)} values, {seconds:.1f} s", file=sys.stderr, flush=True)
        yield from ((line(result), result.passed) for result in results)


def main() -> int:
    """Command line."""
    chosen = sys.argv[1:]
    table = list(rows(chosen or modules()))
    missed = sum(not passed for _, passed in table)
    foot = f"\n{len(table)} values, {missed} missed.\n"
    text = _HEAD + "\n".join(row for row, _ in table) + "\n" + foot
    if chosen:
        print(text)
    else:
        TABLE.write_text(text)
        print(f"{TABLE}: {foot.strip()}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
