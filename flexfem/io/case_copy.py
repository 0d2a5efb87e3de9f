# SPDX-License-Identifier: LGPL-3.0-or-later
"""Copies of shipped cases, with the scripts of their meshes, for users to change."""

import ast
import re
from pathlib import Path

from flexfem.resources import shipped_files

__all__ = ["copy_case"]

#: Functions that name a mesh of the library by their first argument.
_BUILDERS = ("build_mesh", "build_surface_mesh", "build_body_mesh")
_IMPORT = "from pathlib import Path\n"


def copy_case(source: Path, target: Path) -> list[Path]:
    """Copy a case and the scripts of its meshes; the copy builds its meshes by the copied scripts.

    The copy is called after its file, so its results go to a folder of their own.

    Args:
        source: a shipped case.
        target: the copy, a Python file that is not there yet; scripts of meshes get its name and
            that of the mesh.

    Returns:
        The files written, the case first.

    Raises:
        ValueError: the target is no name of a case.
        OSError: a file is there already or cannot be written.
    """
    if target.suffix != ".py" or not target.stem.isidentifier():
        raise ValueError(f"'{target}' must be a Python file, its name of letters, digits and _")
    text = source.read_text(encoding="utf-8").replace(f"cases/{source.name}", str(target))
    commands = {"run ": str(target), "sweep ": str(target), "results/": target.stem}
    for before, new in commands.items():
        pieces = re.split(rf"\b{before}{source.stem}\b", text)  # in the commands of its text
        text = f"{before}{new}".join(pieces)
    changed, meshes = _for_user(text, target.stem)
    library = shipped_files("meshes")
    contents = {target: changed}
    for mesh, name in meshes.items():
        contents[target.with_name(name)] = library[mesh].read_text(encoding="utf-8")
    written: list[Path] = []
    try:
        for file, content in contents.items():
            with file.open("x", encoding="utf-8") as stream:  # never over a file of the user's
                written.append(file)
                stream.write(content)
    except OSError:
        for file in written:
            file.unlink()
        raise
    return written


def _for_user(text: str, name: str) -> tuple[str, dict[str, str]]:
    """Text of a case under another name, and its meshes with the names of their scripts."""
    edits: list[tuple[ast.expr, str]] = []
    meshes: dict[str, str] = {}
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func).removeprefix("ff.")
        if called in _BUILDERS and node.args and isinstance(node.args[0], ast.Constant):
            mesh = str(node.args[0].value)
            meshes[mesh] = f"{name}_{mesh}_mesh.py"
            edits.append((node.args[0], f'Path(__file__).with_name("{meshes[mesh]}")'))
        if called == "Case":
            named = next(keyword for keyword in node.keywords if keyword.arg == "name")
            edits.append((named.value, f'"{name}"'))
    lines = text.encode().splitlines(keepends=True)  # columns of ast count bytes
    for node, new in sorted(edits, key=lambda edit: (-edit[0].lineno, -edit[0].col_offset)):
        line = lines[node.lineno - 1]
        lines[node.lineno - 1] = (
            line[: node.col_offset] + new.encode() + line[node.end_col_offset :]
        )
    if meshes and _IMPORT not in text:
        at = next(n.lineno for n in tree.body if isinstance(n, (ast.Import, ast.ImportFrom)))
        lines.insert(at - 1, _IMPORT.encode())
    return b"".join(lines).decode(), meshes
