# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification table: every benchmark at its full mesh, beside its reference.

Run from the source tree::

    python -m tests.verification.table                          # TABLE.md, all modules
    python -m tests.verification.table --only rigid_pendulum    # TABLE.md, these modules' parts
    python -m tests.verification.table --missing                # TABLE.md, modules not yet in it
    python -m tests.verification.table rigid_pendulum           # some modules, to the terminal

Each module in ``benchmarks/`` has a function ``results`` that returns its lines; where that takes
long, tests call it with ``full=False``. A new module is found by itself. With the table the number
of its values in README.md and in the guide is written. The exit code is 1 when a line of the
modules computed misses its tolerance.
"""

import argparse
import re
import sys
import time
from importlib import import_module
from pathlib import Path
from types import ModuleType

from tests.verification.result import Result

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
TABLE = HERE / "TABLE.md"
_HEAD = """\
# Verification

Computed by `make verification`; every line is checked against its tolerance. The error is relative
to the reference (or, for small values of a larger quantity, to that). Parts have the names of their
modules in `benchmarks/`; `python -m tests.verification.table --only NAME` computes one anew.
"""
_COLUMNS = """\
| case | quantity | reference | source | flexfem | error | tolerance | mesh and step |
|---|---|---|---|---|---|---|---|
"""
_MISSED = " **missed**"
#: Files that tell how many values there are, and what surrounds the number.
TOLD = {
    ROOT / "README.md": (r"computes \[", r" values\]\(tests/verification/TABLE\.md\)"),
    ROOT / "flexfem/docs/guide/performance.md": (r"The table has ", r" values\."),
}


def modules() -> list[str]:
    """Names of all benchmark modules."""
    found = (path.stem for path in sorted((HERE / "benchmarks").glob("*.py")))
    names = [name for name in found if not name.startswith("_")]
    return [name for name in names if hasattr(load(name), "results")]


def load(name: str) -> ModuleType:
    """A benchmark module."""
    return import_module(f"tests.verification.benchmarks.{name}")


def line(result: Result) -> str:
    """One row of the table."""
    mark = "" if result.passed else _MISSED
    return (
        f"| {result.case} | {result.quantity} | {result.reference:.8g} | {result.source} "
        f"| {result.ours:.8g} | {result.error:.1e}{mark} | {result.tolerance:.0e} "
        f"| {result.mesh} |"
    )


def rows(name: str) -> list[str]:
    """Rows of a module; progress goes to stderr."""
    begin = time.perf_counter()
    found = [line(result) for result in load(name).results()]
    seconds = time.perf_counter() - begin
    print(f"{name}: {len(found)} values, {seconds:.1f} s", file=sys.stderr, flush=True)
    return found


def written(text: str) -> dict[str, list[str]]:
    """Rows of each module in the text of a table."""
    parts: dict[str, list[str]] = {}
    for part in text.split("\n## ")[1:]:
        name, *lines = part.splitlines()
        parts[name] = [row for row in lines if row.startswith("| ")][1:]
    return parts


def missed(parts: dict[str, list[str]]) -> int:
    """Number of rows that miss their tolerance."""
    return sum(_MISSED in row for rows_of_part in parts.values() for row in rows_of_part)


def summary(parts: dict[str, list[str]]) -> str:
    """Number of values."""
    return f"{sum(map(len, parts.values()))} values, {missed(parts)} missed."


def page(parts: dict[str, list[str]]) -> str:
    """Text of the table, a part for each module, by name."""
    text = f"{_HEAD}\n{summary(parts)}\n"
    for name in sorted(parts):
        title = (load(name).__doc__ or "").splitlines()[0]
        text += f"\n## {name}\n\n{title}\n\n{_COLUMNS}" + "\n".join(parts[name]) + "\n"
    return text


def told(path: Path) -> re.Match[str]:
    """Places in the texts with the number of values.

    Raises:
        ValueError: It does not, or more than once.
    """
    before, after = TOLD[path]
    found = list(re.finditer(rf"(?<={before})\d+(?={after})", path.read_text(encoding="utf-8")))
    if len(found) != 1:
        raise ValueError(f"{path}: tells the number of values {len(found)} times, not once")
    return found[0]


def write(parts: dict[str, list[str]]) -> None:
    """Write the table, and the number of its values where others tell it."""
    TABLE.write_text(page(parts), encoding="utf-8")
    count = str(sum(map(len, parts.values())))
    for path in TOLD:
        at = told(path)
        path.write_text(at.string[: at.start()] + count + at.string[at.end() :], encoding="utf-8")


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    known = modules()
    parser.add_argument("shown", nargs="*", metavar="NAME", help="modules to the terminal")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--only", nargs="+", metavar="NAME", help="compute these anew, keep the rest of TABLE.md"
    )
    what.add_argument("--missing", action="store_true", help="compute what TABLE.md lacks")
    options = parser.parse_args(argv)
    if options.shown and (options.only or options.missing):
        parser.error("names stand behind --only, or without it and --missing")
    for name in (*options.shown, *(options.only or ())):
        if name not in known:
            parser.error(f"no module '{name}' in benchmarks/, there are: {', '.join(known)}")
    kept = written(TABLE.read_text(encoding="utf-8")) if options.only or options.missing else {}
    kept = {name: found for name, found in kept.items() if name in known}
    lacking = [name for name in known if name not in kept]
    chosen = options.shown or options.only or lacking
    new = {}
    for name in chosen:
        new[name] = rows(name)
        if kept:  # a part that is done stays done when a later one fails
            write(kept | new)
    if options.shown:
        print(page(new))
        return 1 if missed(new) else 0
    write(kept | new)
    print(f"{TABLE}: {summary(kept | new)}")
    return 1 if missed(new) else 0


if __name__ == "__main__":
    sys.exit(main())
