# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small wrong changes to the package, one at a time, and whether a test notices them.

    python -m tests.mutations --count 12 --seed 3 --areas solvers,restarts --quick
    python -m tests.mutations --at flexfem/joints/bushing.py:70 --count 5 --tests tests/contract

Each change is made in a copy of the tree and spread evenly over the areas: operators, constants,
signs, dropped terms and statements, swapped indices and arguments, comparisons. Run are the test
files that name the changed module or what it defines (else modules which import it), then, without
``--quick``, all of ``tests/unit`` and ``tests/contract``. A test that fails counts only if it
passes without the change. What survives is not covered, or changes no result, only iterations.

The copy has links to the compiled loops beside the sources. Their stamps are checksums of their
module and all that it imports: only loops behind the change are compiled again, into files of the
copy (column "compiled"), for minutes after a change of ``lie`` or ``core``. Forms are kept by their
own checksum. Run the chosen tests once before, so that all loops are there.
"""

import argparse
import ast
import copy
import fnmatch
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
#: Files of each area, and names of functions if it is only some.
AREAS: dict[str, tuple[tuple[str, ...], str]] = {
    "families": (("families/*", "bodies/*", "forms/*", "reduction/*"), ""),
    "solvers": (("solvers/*", "la/*", "kinematics/*"), ""),
    "integrators": (("integrators/*", "simulation/motion/*"), ""),
    "joints": (("joints/*", "loads/*", "core/*", "constraints/*"), ""),
    "system": (("layout/*", "system/*", "mesh/*.py", "contact/*"), ""),
    "materials": (("materials/*", "lie/*", "kernels/*"), ""),
    "readers": (("mesh/imported/*", "robots/*", "io/tables/*", "io/hdf5/reduced*"), ""),
    "restarts": (("*",), r"_?(restore|state|recall|resume|kept_rows)$"),
    "outputs": (("io/*", "system/measure/*", "inspection/*"), ""),
    "papers": (("research/*",), ""),
}
#: Test files that are run because of their names.
MOST = 3
NOT_THESE = ("docs/*", "cli/*", "__init__.py", "_*", "options.py")
_SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
#: Their insides are no numbers of the model: messages, names, types.
_LEFT = (ast.Raise, ast.Import, ast.ImportFrom, ast.JoinedStr, ast.AnnAssign, ast.arguments)


class Change(NamedTuple):
    """Text ``new`` in place of the bytes ``begin:end`` of a file."""

    path: Path
    line: int
    kind: str
    begin: int
    end: int
    old: str
    new: str

    @property
    def text(self) -> bytes:
        data = self.path.read_bytes()
        return data[: self.begin] + self.new.encode() + data[self.end :]

    def valid(self) -> bool:
        """Return True if Python reads something else than before."""
        try:
            return ast.dump(ast.parse(self.text)) != ast.dump(ast.parse(self.path.read_bytes()))
        except SyntaxError:
            return False

    def __str__(self) -> str:
        shown = [" ".join(part.split())[:60] for part in (self.old, self.new)]
        return f"{self.path.relative_to(ROOT)}:{self.line}  {shown[0]}  ->  {shown[1]}"


def edited(node: ast.AST, edit: Callable[[Any], None]) -> ast.AST:
    """A changed copy."""
    made = copy.deepcopy(node)
    edit(made)
    return made


def variants(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Wrong forms of one node."""
    if (swap := _SWAPS.get(type(getattr(node, "op", None)))) is not None:
        kind = "condition" if isinstance(node, ast.BoolOp) else "operator"
        yield kind, edited(node, lambda n: setattr(n, "op", swap()))
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Sub)):
            yield "dropped term", node.left
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in _SWAPS:
        swap = _SWAPS[type(node.ops[0])]
        yield "comparison", edited(node, lambda n: n.ops.__setitem__(0, swap()))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        yield "sign", node.operand
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield "constant", ast.Constant(node.value * 1.02 if node.value % 1 else node.value + 1)
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple):
        if [type(e) in (ast.Name, ast.Constant) for e in node.slice.elts] == [True, True]:
            yield "indices", edited(node, lambda n: n.slice.elts.reverse())
    elif isinstance(node, ast.Call) and [type(a) for a in node.args] == [ast.Name, ast.Name]:
        yield "arguments", edited(node, lambda n: n.args.reverse())
    dropped = node.value if isinstance(node, ast.Expr) else getattr(node, "targets", [node])[0]
    if isinstance(dropped, (ast.Call, ast.Attribute, ast.Subscript, ast.AugAssign)) and (
            isinstance(node, ast.stmt)):  # fmt: skip
        yield "dropped statement", ast.Pass()


def nodes(tree: ast.AST, functions: str, inside: bool = False) -> Iterator[ast.AST]:
    """Nodes within functions (of some names), without messages, types and default values."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, _LEFT):
            continue
        if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
            named = isinstance(child, ast.FunctionDef) and re.match(functions, child.name)
            yield from nodes(ast.Module(child.body, []), functions, bool(named))
        else:
            yield from [child] if inside else []
            yield from nodes(child, functions, inside)


def changes(path: Path, functions: str = "") -> Iterator[Change]:
    """All changes of a file."""
    data = path.read_bytes()
    starts = [0]
    for row in data.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))
    for node in nodes(ast.parse(data), functions):
        for kind, wrong in variants(node) if hasattr(node, "lineno") else ():
            begin = starts[node.lineno - 1] + node.col_offset
            end = starts[node.end_lineno - 1] + node.end_col_offset
            old, new = data[begin:end].decode(), ast.unparse(wrong)
            if isinstance(node, ast.expr) and not isinstance(wrong, ast.Constant):
                new = f"({new})"
            yield Change(path, node.lineno, kind, begin, end, old, new)


@cache
def texts(folder: str) -> dict[Path, str]:
    """Texts of Python files."""
    return {path: path.read_text() for path in sorted((ROOT / folder).rglob("*.py"))}


def fits(path: Path, patterns: tuple[str, ...]) -> bool:
    """Return True if a source of the package has one of some names, by its path or alone."""
    names = path.relative_to(ROOT / "flexfem").as_posix(), path.name
    return any(fnmatch.fnmatch(name, pattern) for name in names for pattern in patterns)


def chosen(areas: list[str], count: int, draw: random.Random) -> list[tuple[str, Change]]:
    """Changes in turns over the areas: a file by its number of lines, a kind, one of these."""
    found: list[tuple[str, Change]] = []
    for number in range(count):
        area = areas[number % len(areas)]
        patterns, functions = AREAS[area]
        sources = [p for p in texts("flexfem") if fits(p, patterns) and not fits(p, NOT_THESE)]
        sizes = [path.stat().st_size for path in sources]
        while True:
            [path] = draw.choices(sources, sizes)
            every = list(changes(path, functions))
            if every:
                kind = draw.choice(sorted({change.kind for change in every}))
                change = draw.choice([change for change in every if change.kind == kind])
                if change.valid() and (area, change) not in found:
                    found.append((area, change))
                    break
    return found


def mapped(path: Path) -> list[str]:
    """Test files that name a module or what it defines; else those of what imports it."""
    level, seen = {path}, {path}
    tests = {p: t for p, t in texts("tests").items() if p.name.startswith("test_")}
    while level:
        share: dict[str, float] = {}
        for source in level:
            module = ".".join(source.relative_to(ROOT).with_suffix("").parts)
            package, _, last = module.rpartition(".")
            defined = re.findall(r"^(?:def|class) ([A-Za-z]\w+)", source.read_text(), re.MULTILINE)
            names = [re.escape(module) + r"\b", *(rf"\bff\.{name}\b" for name in defined)]
            names.append(rf"from {re.escape(package)} import [^\n]*\b{last}\b")
            words = [word for word in (last, source.parent.name) if "_" in word]
            names += [rf"\b{word}\b" for word in words]  # names of schemes, in strings
            for test, text in tests.items():
                if hits := len(re.findall("|".join(names), text)):
                    share[str(test.relative_to(ROOT))] = hits / len(text) + any(
                        word in test.stem for word in (last, *words)
                    )
        if share:
            return sorted(share, key=lambda name: -share[name])[:MOST]
        stems = [".".join(source.relative_to(ROOT).with_suffix("").parts) for source in level]
        importing = re.compile("|".join(rf"{re.escape(stem)}\b" for stem in stems))
        level = {p for p, text in texts("flexfem").items() if importing.search(text)} - seen
        seen |= level
    words = re.findall(r"[a-z]{4,}", str(path.relative_to(ROOT / "flexfem").with_suffix("")))
    named = [p for p in tests if any(word.rstrip("s") in p.stem for word in words)]
    return [str(p.relative_to(ROOT)) for p in named][:MOST]


def copied(folder: Path) -> Path:
    """A copy of the tree, with links to compiled loops, which are replaced, never written to."""

    def put(source: str, target: str) -> None:
        try:
            if source.endswith((".nbi", ".nbc")):
                os.link(source, target)
                return
        except OSError:  # another disk
            pass
        shutil.copy2(source, target)

    for name in ("flexfem", "tests", "cases", "meshes", "postprocess"):
        shutil.copytree(ROOT / name, folder / name, copy_function=put)
    shutil.copy2(ROOT / "pyproject.toml", folder)
    return folder


def failure(tree: Path, tests: list[str], seconds: float) -> str:
    """The first test that fails in a tree; empty if none does."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment |= {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not benchmark", "-p",
               "no:cacheprovider", *tests]  # fmt: skip
    try:
        ended = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=seconds,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"? no end within {seconds:g} s"
    named = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", ended.stdout, re.MULTILINE)
    if ended.returncode in (0, 5):  # passed, or nothing to run
        return ""
    return named[1] if named else f"pytest ended with {ended.returncode}"


def tried(change: Change | None, stages: list[list[str]], seconds: float) -> tuple[str, int]:
    """The first test that fails in a changed copy, and how many loops were compiled for it."""
    with tempfile.TemporaryDirectory(prefix="flexfem-change-") as folder:
        tree = copied(Path(folder))
        before = {p: p.stat().st_ino for p in tree.rglob("*.nbi")}
        if change is not None:
            (tree / change.path.relative_to(ROOT)).write_bytes(change.text)
        failed = next((found for tests in stages if (found := failure(tree, tests, seconds))), "")
        return failed, sum(before.get(p) != p.stat().st_ino for p in tree.rglob("*.nbi"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--count", type=int, default=10, help="number of changes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--areas", default=",".join(AREAS), help="of " + ",".join(AREAS))
    parser.add_argument("--at", help="changes of one file, or one of its lines (file:line)")
    parser.add_argument("--tests", nargs="+", help="run these instead of those found by the file")
    parser.add_argument("--quick", action="store_true", help="these tests only")
    parser.add_argument("--seconds", type=float, default=900.0, help="for one set of tests")
    parser.add_argument("--list", action="store_true", help="print the changes, run nothing")
    given = parser.parse_args()
    draw = random.Random(given.seed)
    if given.at:
        name, _, line = given.at.partition(":")
        every = [c for c in changes(ROOT / name) if line in ("", str(c.line)) and c.valid()]
        made = [(name, c) for c in draw.sample(every, min(given.count, len(every)))]
    else:
        made = chosen(given.areas.split(","), given.count, draw)
    survived = 0
    for area, change in made:
        print(f"{area}, {change.kind}: {change}", flush=True)
        if given.list:
            continue
        stages = [given.tests or mapped(change.path)]
        if not given.quick:
            stages.append(["tests/unit", "tests/contract"])
        noticed, compiled = tried(change, [stage for stage in stages if stage], given.seconds)
        if noticed.startswith("tests") and tried(None, [[noticed]], given.seconds)[0]:
            noticed = f"? fails without the change too: {noticed}"
        survived += not noticed or noticed[0] == "?"
        spent = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        tests = "" if noticed else " " + " ".join(Path(test).name for test in stages[0])
        print(f"    {noticed or 'SURVIVED' + tests} (compiled {compiled}, {spent:.0f} s in all)",
              flush=True)  # fmt: skip
    if not given.list:
        print(f"{len(made) - survived} of {len(made)} noticed")


if __name__ == "__main__":
    main()
