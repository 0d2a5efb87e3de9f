# SPDX-License-Identifier: LGPL-3.0-or-later
"""Who may import whom."""

import ast
import re
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import TopologicalSorter
from itertools import groupby
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "flexfem"
FILES = sorted(PACKAGE.rglob("*.py"))

# From low to high: a package may import those on the lines above its own. Those on one line do not
# import each other, save the small modules of the first.
LAYERS = [
    {
        "_types",
        "_faults",
        "_checks",
        "_files",
        "_packages",
        "_trust",
        "_memory",
        "_beside",
        "_fields",
        "resources",
        "launch",
        "_leaving",
        "options",
        "installation",
    },
    {"analyses"},
    {"kernels", "la", "materials", "control"},
    {"lie"},
    {"forms", "mesh"},
    {"core"},
    {"joints", "loads"},
    {"reduction", "sections"},
    {"model"},
    {"bodies"},
    {"layout"},
    {"constraints", "contact"},
    {"system"},
    {"families"},
    {"kinematics"},
    {"solvers", "io", "robots", "inspection"},
    {"integrators"},
    {"simulation"},
    {"gradients"},
    {"research"},
    {"case"},
    {"studies"},
    {"cli"},
    {"__main__"},
    {"docs"},
]
# Those of one group do not import each other, although some are on different lines.
STRANGERS = (
    {"bodies", "contact", "constraints", "joints", "loads"},
    {"families", "contact", "constraints"},
)
# Elements of a family may import nothing else from the layout.
CONTRACT_OF_ELEMENTS = {"flexfem.layout.elements", "flexfem.layout.tangent_request"}
UNKNOWN_TO_ELEMENTS = {"bodies", "constraints", "contact", "joints", "layout", "loads", "system"}
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
HEAVY = {"dolfinx", "dolfinx_solver", "petsc4py", "slepc4py", "mpi4py"}
FORBIDDEN = {
    "forms": HEAVY,
    "lie": HEAVY | {"ufl"},
    "kernels": HEAVY | {"ufl"},
    "materials": HEAVY | {"numba", "ufl"},
    "control": HEAVY | {"numba", "ufl"},
    "model": HEAVY | {"numba", "ufl"},
    "kinematics": {"dolfinx", "dolfinx_solver", "petsc4py", "slepc4py"},
    "inspection": {"dolfinx", "dolfinx_solver", "petsc4py", "slepc4py"},
    "joints": HEAVY | {"numba", "ufl"},
    "robots": HEAVY | {"numba", "ufl"},
    "loads": HEAVY | {"numba", "ufl"},
    "reduction": HEAVY | {"numba", "ufl"},
}
# Here is what may do so in a package that otherwise must not.
EXEMPT = (
    PACKAGE / "joints" / "ufl_marker_law.py",
    PACKAGE / "reduction" / "fem",
    PACKAGE / "kernels" / "ffcx.py",
    PACKAGE / "kernels" / "ffcx_options.py",
    PACKAGE / "kernels" / "form_kernels.py",
    PACKAGE / "kernels" / "users" / "ufl_function.py",
)


def part(path: Path) -> str:
    """The package or top-level module a file belongs to, e.g. "joints"."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


#: The files of each part.
PARTS = {name: list(files) for name, files in groupby(sorted(FILES, key=part), key=part)}


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file, the whole module first; each file is read once."""
    return tuple(ast.walk(ast.parse(path.read_text())))


def imports(tree: ast.AST) -> Iterator[str]:
    """Dotted names of everything imported, also inside functions, but not for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{'.' * node.level}{node.module or ''}.{name.name}" for name in node.names)
        else:
            yield from imports(node)


@pytest.mark.serial
@pytest.mark.parametrize("here", PARTS)
def test_imports_point_downwards(here: str) -> None:
    """Lower layers never import higher ones; siblings never import each other."""
    if here == "__init__":
        return
    assert here in LEVEL, f"{here} has no place among the layers"
    for path in PARTS[here]:
        forbidden = set() if {path, *path.parents} & set(EXEMPT) else FORBIDDEN.get(here, set())
        for name in imports(nodes_of(path)[0]):
            top, *rest = name.split(".")
            assert top, f"{path}: relative import {name}"
            assert top not in {"cases", "meshes", "tests", "postprocess"}, path
            assert top not in forbidden, f"{path}: {name}"
            other = rest[0] if top == "flexfem" and rest else here
            if other in LEVEL and other != here:
                assert not any({here, other} <= group for group in STRANGERS), f"{path}: {name}"
                below = LEVEL[other] < LEVEL[here] or LEVEL[here] == 0
                assert below, f"{path}: {name} is not below {here}"


@pytest.mark.serial
@pytest.mark.parametrize("here", PARTS)
def test_only_io_opens_files(here: str) -> None:
    """Result files are written in one place."""
    if here in {"io", "mesh", "_files"}:  # meshes are input, and so is what the last opens
        return
    opening = {"open", "write_text", "write_bytes", "savetxt", "savez", "tofile", "File"}
    for path in PARTS[here]:
        calls = (node.func for node in nodes_of(path) if isinstance(node, ast.Call))
        assert not opening & {ast.unparse(call).split(".")[-1] for call in calls}, path


def dotted(path: Path) -> str:
    """Name of a module, that of the package for an ``__init__``."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def imported_names(path: Path) -> frozenset[str]:
    """Dotted names that a file imports, also inside functions and for type checkers."""
    found = set()
    for node in nodes_of(path):
        if isinstance(node, ast.ImportFrom):
            for name in node.names:
                found |= {f"{node.module}.{name.name}", str(node.module)}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return frozenset(found)


def imported_modules(path: Path, modules: Mapping[str, Path]) -> set[str]:
    """Modules of the package that one imports, also inside functions and for type checkers."""
    return set(imported_names(path) & modules.keys())


@pytest.mark.serial
def test_modules_import_each_other_in_one_direction() -> None:
    """No cycles, neither between packages nor inside one; type checkers' imports count."""
    modules = {dotted(path): path for path in FILES}
    files = {name for name, path in modules.items() if path.name != "__init__.py"}
    graph = {name: imported_modules(modules[name], modules) & files for name in sorted(files)}
    TopologicalSorter(graph).prepare()  # its error names the modules of a cycle


#: Folders that are lists: one joint, one reader, one check a file.
LISTS = {"joints", "mesh.imported", "inspection.checks"}
#: Modules in any other folder at most: more are a heap.
MOST = 15


@pytest.mark.serial
def test_folders_can_be_overlooked() -> None:
    """A folder has few modules, and says in its ``__init__`` what they are."""
    for folder in sorted({path.parent for path in FILES}):
        name = ".".join(folder.relative_to(PACKAGE).parts)
        ends = {"__init__.py", "__main__.py"}
        modules = [path for path in folder.glob("*.py") if path.name not in ends]
        assert len(modules) <= MOST or name in LISTS, name
        assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text())), name


@pytest.mark.serial
def test_folders_import_each_other_in_one_direction() -> None:
    """No cycles between folders, whether beside or inside one another; type checkers count."""
    modules = {dotted(path): path for path in FILES}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        if path.name != "__init__.py" and path.parent != PACKAGE:
            others = {other.rpartition(".")[0] for other in imported_modules(path, modules)
                      if modules[other].name != "__init__.py"}  # fmt: skip
            here = name.rpartition(".")[0]
            graph.setdefault(here, set()).update(others - {here, "flexfem"})
    TopologicalSorter(graph).prepare()  # its error names the folders of a cycle


@pytest.mark.serial
def test_elements_know_neither_model_nor_system() -> None:
    """Modules of the elements of a family import neither joints nor loads nor numbered models."""
    modules = {dotted(path): path for path in FILES}
    left = [name for name in modules if re.fullmatch(r"flexfem\.families\.\w+\.elements", name)]
    found: set[str] = set()
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            others = imported_modules(modules[name], modules)
            left += [other for other in others if other.startswith("flexfem.families.")]
            known = {other for other in others if other.split(".")[1] in UNKNOWN_TO_ELEMENTS}
            assert known <= CONTRACT_OF_ELEMENTS, name


# Attributes of others that are set around calls, and why; no more shall come.
SET_AROUND_CALLS = {
    "lead": "the instant of loads and drives beside a jump, while a step is solved",
}


def set_around_calls(function: ast.FunctionDef) -> Iterator[str]:
    """Attributes of other objects that a function assigns, goes on with calls, and assigns again.

    That is how a mode is switched on and off: what the calls do cannot be read from their
    arguments. Assignments in different branches of one condition do not follow each other.
    """
    yield from _around(function.body, {})


def _around(body: list[ast.stmt], assigned: dict[str, bool]) -> Iterator[str]:
    """Go through statements in order; ``assigned`` tells which attributes calls have followed."""
    for statement in body:
        own = {ast.unparse(target): target.attr for target in _foreign(statement)}
        first, other, last = (
            getattr(statement, name, []) for name in ("body", "orelse", "finalbody")
        )
        handlers = [handler.body for handler in getattr(statement, "handlers", [])]
        inner = [[*first, *last], other, *handlers]
        yield from (attribute for name, attribute in own.items() if assigned.get(name))
        branches = [dict(assigned) for _ in inner]
        if not isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
            for part, known in zip(inner, branches, strict=True):
                yield from _around(part, known)
        if any(isinstance(node, ast.Call) for node in ast.walk(statement)):
            assigned.update(dict.fromkeys(assigned, True))
        assigned.update(dict.fromkeys(own, False))


def _foreign(statement: ast.stmt) -> list[ast.Attribute]:
    """Attributes that a statement assigns of what is not ``self``."""
    targets = statement.targets if isinstance(statement, ast.Assign) else []
    flat = [e for t in targets for e in (t.elts if isinstance(t, ast.Tuple) else [t])]
    return [e for e in flat if isinstance(e, ast.Attribute) and ast.unparse(e.value) != "self"]


def test_modes_set_around_calls_are_seen() -> None:
    """The rule itself: a flag, a swap, a try; but neither branches nor a loop over objects."""

    def found(text: str) -> list[str]:
        (function,) = ast.parse(text).body
        assert isinstance(function, ast.FunctionDef)
        return list(set_around_calls(function))

    flag = "def f(a):\n a.on = True\n a.run()\n a.on = False"
    swap = "def f(self):\n old, self.a.b = self.a.b, 1\n run()\n self.a.b = old"
    assert found(flag) == ["on"]
    assert found(swap) == ["b"]
    assert found("def f(a):\n a.on = 1\n try:\n  run()\n finally:\n  a.on = 0") == ["on"]
    assert not found("def f(a):\n if a.x():\n  a.on = 1\n  run()\n else:\n  a.on = 2")
    assert not found("def f(self):\n self.on = 1\n run()\n self.on = 2")


@pytest.mark.serial
@pytest.mark.parametrize("here", PARTS)
def test_no_modes_are_set_around_calls(here: str) -> None:
    """The effect of a call follows from its arguments."""
    for path in PARTS[here]:
        for node in nodes_of(path):
            if isinstance(node, ast.FunctionDef):
                assert set(set_around_calls(node)) <= SET_AROUND_CALLS.keys(), (path, node.name)


@pytest.mark.serial
@pytest.mark.parametrize("path", sorted((ROOT / "postprocess").glob("*.py")), ids=lambda p: p.name)
def test_postprocessing_reads_files_only(path: Path) -> None:
    """Figures come from result files, not from the code that made them."""
    tops = {name.split(".")[0] for name in imports(nodes_of(path)[0])}
    assert not tops & (HEAVY | {"flexfem"})
