# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shipped cases, meshes and scripts: inside an installed package, or beside it in a source tree."""

import ast
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

_PACKAGE = Path(__file__).resolve().parent


def shipped_folder(name: str) -> Path:
    """Folder of the shipped ``cases``, ``meshes`` or ``postprocess``.

    Raises:
        FileNotFoundError: If this installation has no such folder.
    """
    for folder in (_PACKAGE / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"this installation of flexfem has no folder '{name}'")


def shipped_files(name: str) -> dict[str, Path]:
    """The shipped files of one kind by their names, sorted; files with a leading _ are private."""
    files = sorted(shipped_folder(name).glob("*.py"))
    return {path.stem: path for path in files if not path.stem.startswith("_")}


def shipped_data(name: str) -> Path:
    """Data that comes with the package, such as ``iea15_blade.yaml`` of ``meshes``.

    Raises:
        ValueError: There is no such file.
    """
    folder = shipped_folder("meshes")
    known = {path.name: path for path in sorted(folder.glob("*.yaml"))}
    if name not in known:
        raise ValueError(f"no data '{name}' is shipped, known are {', '.join(known)}")
    return known[name]


def load_module(path: Path, prefix: str) -> ModuleType:
    """Execute a Python file that is not part of a package.

    Args:
        path: The file, with the ending .py.
        prefix: Start of the module's name, so that a file cannot shadow an installed module.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not a Python file.
    """
    name = f"{prefix}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if path.suffix != ".py" or spec is None or spec.loader is None:
        raise ValueError(f"'{path}' is not a Python file (.py)")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look the module up by its name
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise ValueError(f"'{path}', line {error.lineno}: {error.msg}") from None
    return module


def imported_elsewhere(path: Path) -> Iterator[tuple[str, str]]:
    """Modules that a file imports from elsewhere, though there are files of their names beside it.

    Returns:
        Their names, and where they are from.
    """
    try:
        nodes = list(ast.walk(ast.parse(path.read_bytes())))
    except (OSError, SyntaxError, ValueError):  # reported where the mesh is loaded
        return
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {n.module or "" for n in nodes if isinstance(n, ast.ImportFrom) and not n.level}
    for name in sorted({name.partition(".")[0] for name in names} & set(sys.modules)):
        origin = getattr(sys.modules[name], "__file__", None) or "Python itself"
        file = path.parent / f"{name}.py"
        if file.is_file() and Path(origin).resolve() != file.resolve():
            yield name, origin
