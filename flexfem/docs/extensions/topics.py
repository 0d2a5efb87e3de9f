# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of the pages: public names by their modules, cases by analysis.

Nothing here needs Sphinx.
"""

import ast
import re
from collections.abc import Iterable
from pathlib import Path

import flexfem
from flexfem import research
from flexfem.case import Case
from flexfem.cli.case_run import load_case
from flexfem.resources import shipped_files

SOURCES = Path(__file__).parents[1]
#: Examples, and pictures of them and of the cases.
EXAMPLES, GALLERY = SOURCES.parents[1] / "examples", SOURCES / "figures" / "gallery"
#: Options of cases in the gallery, whose defaults run long or show little.
SHORTER = {
    "draping": "--mesh 31x31",
    "sheet_landing": "--tilt 20 --t-end 0.06",
    "solar_array": "--t-end 2.5",
}

#: Modules of all public names, by their full names.
PLACES = {
    **{f"flexfem.{name}": place for name, place in flexfem._MODULES.items()},
    **{f"flexfem.research.{name}": f"research.{p}" for name, p in research._MODULES.items()},
}


def names_of(modules: Iterable[str]) -> list[str]:
    """Public names that these modules, or those of these packages, define; in the order given.

    They are full ones, such as "flexfem.Beam".

    Raises:
        ValueError: one of them defines no public name.
    """
    found: list[str] = []
    for module in modules:
        inside = [
            name
            for name, place in PLACES.items()
            if place == module or place.startswith(f"{module}.")
        ]
        if not inside:
            raise ValueError(f"no public name is defined in flexfem.{module}")
        found += inside
    return found


def cases_of(analysis: str) -> dict[str, Case]:
    """The shipped cases of one analysis by name, tutorials first.

    Raises:
        ValueError: there is none.
    """
    cases = {name: load_case(name) for name in shipped_files("cases")}
    found = {name: case for name, case in cases.items() if case.analysis.name == analysis}
    if not found:
        raise ValueError(f"no case has the analysis '{analysis}'")
    return dict(sorted(found.items(), key=lambda item: (not item[0].startswith("tutorial"), item)))


def examples() -> dict[str, str]:
    """What each example says of itself in its first line."""
    found = {}
    for path in sorted(EXAMPLES.glob("*.py")):
        said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        found[path.stem] = (said or "").partition("\n")[0]
    return found


def sentences() -> dict[str, str]:
    """One sentence on every example and every case."""
    cases = {name: load_case(name).summary for name in shipped_files("cases")}
    return {**examples(), **{name: f"{said[0].upper()}{said[1:]}." for name, said in cases.items()}}


def arguments_of(directive: str) -> list[str]:
    """Arguments of all uses of a directive in the reStructuredText pages."""
    pattern = re.compile(rf"^\.\. {directive}:: (.+)$", re.MULTILINE)
    pages = sorted(SOURCES.rglob("*.rst"))
    return [text for page in pages for text in pattern.findall(page.read_text(encoding="utf-8"))]
