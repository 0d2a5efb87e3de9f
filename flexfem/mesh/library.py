# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes made by scripts: those of the library and the user's own, with a function `build` each."""

import argparse
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexfem import _checks
from flexfem._faults import FAILURES, mistake
from flexfem._memory import LINE_NODE, check_run
from flexfem.installation import require
from flexfem.mesh.imported.gmsh_model import session
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.resources import load_module, shipped_files

#: Fills the current gmsh model with lines or triangles and named physical groups.
Build = Callable[..., None]


def build_mesh(name: str | Path, **parameters: float) -> LineMesh:
    """Build a mesh of lines of the library, or by a script of one's own.

    Args:
        name: A mesh of the library (`chain`), or the path of a script (`own.py`) with a function
            `build` that fills the current gmsh model with named physical groups, as those of the
            library do. The script is executed.
        **parameters: Arguments of that file's `build`.

    Returns:
        The mesh.

    Raises:
        TypeError: A parameter is of the wrong kind.
        ValueError: Unknown mesh or parameter, a parameter of the library's that is not
            positive, no lines in it, or a script that fails.
    """
    count = parameters.get("elements")  # at least, before gmsh makes them
    if isinstance(count, int):
        check_run(f'mesh "{name}": a step with {count} elements', float(count), LINE_NODE)
    return _built(name, parameters, LineMesh.from_gmsh_model)


def build_surface_mesh(name: str | Path, **parameters: float) -> SurfaceMesh:
    """Build a mesh of surfaces of the library or by a script; see :func:`build_mesh`.

    Raises:
        TypeError: A parameter is of the wrong kind.
        ValueError: Unknown mesh or parameter, a value that is not positive, no surfaces in it, or
            a script that fails.
    """
    return _built(name, parameters, SurfaceMesh.from_gmsh_model)


def _built[Mesh](name: str | Path, parameters: dict[str, float], read: Callable[[], Mesh]) -> Mesh:
    """Build a mesh in a gmsh session of its own and read it."""
    build = checked_build(name, parameters)
    with session(f"flexfem_{Path(name).stem}"):
        build(**parameters)
        return read()


def checked_build(name: str | Path, parameters: dict[str, float]) -> Build:
    """Function that builds a mesh of the library or of a script, its parameters checked.

    Raises:
        TypeError: A parameter is of the wrong kind.
        ValueError: Unknown mesh or parameter, a value that is not positive, or a script that fails.
    """
    own = isinstance(name, Path) or (isinstance(name, str) and name.endswith(".py"))
    build = _load_script(Path(name)) if own else _load(_checks.text("build_mesh", "name", name))
    _check_parameters(str(name), build, parameters, positive=not own)
    return build


def run_script(build: Build) -> None:
    """Build a mesh from the command line and write it; options follow the signature of `build`.

    Args:
        build: Function with keyword arguments that have numbers as defaults.
    """
    name = Path(inspect.getfile(build)).stem
    parser = argparse.ArgumentParser(description=inspect.getdoc(build), allow_abbrev=False)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    for parameter in inspect.signature(build).parameters.values():
        parser.add_argument(
            f"--{parameter.name.replace('_', '-')}",
            type=type(parameter.default),
            default=parameter.default,
            help=f"default {parameter.default}",
        )
    parser.add_argument(
        "--output", type=Path, default=Path(f"{name}.msh"), help=f"file, default {name}.msh"
    )
    values = vars(parser.parse_args())
    output: Path = values.pop("output")
    try:
        _check_parameters(name, build, values)
        if output.suffix != ".msh" or not output.parent.is_dir():
            raise ValueError(f'output "{output}" must be a .msh file in an existing folder')
        _write(name, build, values, output)
    except (TypeError, ValueError, OSError) as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")


def _write(name: str, build: Build, parameters: dict[str, Any], output: Path) -> None:
    """Build a mesh and write it, after checking that it can be read."""
    import gmsh

    with session(f"flexfem_{name}"):
        build(**parameters)
        if gmsh.model.getPhysicalGroups(3):
            pass  # DOLFINx reads solids as far as it can
        elif gmsh.model.getPhysicalGroups(2):
            SurfaceMesh.from_gmsh_model()
        else:
            LineMesh.from_gmsh_model()
        try:
            gmsh.write(str(output))
        except Exception as error:  # gmsh raises nothing more specific
            raise OSError(" ".join(str(error).split())) from None


def _load(name: str) -> Build:
    """Return the function `build` of a mesh of the library."""
    known = shipped_files("meshes")
    if name not in known:
        raise ValueError(f'mesh "{name}" is not in the library: {", ".join(known)}')
    require("gmsh")  # which the file is about to import
    build: Build = load_module(known[name], "flexfem_meshes").build
    return build


def _load_script(path: Path) -> Build:
    """Return the function `build` of a user's script."""
    require("gmsh")
    try:
        build: Any = getattr(load_module(path, "flexfem_own_meshes"), "build", None)
    except FAILURES as error:
        raise ValueError(f'mesh "{path}": {mistake(error)}') from error
    if not callable(build):
        raise ValueError(f'mesh "{path}": the file does not define a function build')
    made: Build = build
    return made


def _check_parameters(
    name: str, build: Build, parameters: dict[str, Any], *, positive: bool = True
) -> None:
    """Raise unless all parameters are known, and whole numbers where `build` has them."""
    known = inspect.signature(build).parameters
    for key, value in parameters.items():
        if key not in known:
            raise ValueError(
                f'mesh "{name}" has no parameter "{key}" (value {_checks.show(value)}); '
                f"it has {', '.join(known)}"
            )
        _checks.number(f'mesh "{name}"', key, value, positive=positive)
        if isinstance(known[key].default, int):
            _checks.instance(f'mesh "{name}"', key, value, int)
