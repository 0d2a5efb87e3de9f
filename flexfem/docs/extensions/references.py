# SPDX-License-Identifier: LGPL-3.0-or-later
"""References of docstrings, without the network.

Types of other packages are shown without a link. A name of flexfem may be shortened to its end, as
docstrings do, if one thing alone that is documented ends so; internal names have no target. All
other references that lead nowhere are warnings.
"""

import re
import sys
from collections import defaultdict
from functools import cache
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.nodes import make_refnode

#: First parts of names that are explained elsewhere, and names of type variables.
_STRANGERS = {
    "Any", "Callable", "ClassVar", "Iterable", "Iterator", "Literal", "MPI", "Mapping", "Number",
    "Path", "Protocol", "Sequence", "Thing", "basix", "collections", "dataclasses", "dolfinx",
    "mpi4py", "np", "npt", "numpy", "pathlib", "petsc4py", "scipy", "typing", "ufl",
}  # fmt: skip

#: Names of classes begin with capitals; text before a colon in docstrings is taken for a type.
_CLASS = re.compile(r"[\w.]*\b_?[A-Z]\w+")


def _resolve(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Find the target of a reference that Sphinx does not know."""
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    objects = env.domains["py"].objects
    last = target.rpartition(".")[2]
    found = [name for name in _by_end(objects)[last] if name.endswith(f".{target}")]
    if len(found) == 1:
        place = objects[found[0]]
        return make_refnode(
            app.builder, node["refdoc"], place.docname, place.node_id, content, found[0]
        )
    no_class = node["reftype"] == "class" and not _CLASS.fullmatch(target)
    named_only = no_class or target.split(".")[0] in _STRANGERS or _is_internal(target)
    return content if named_only else None


#: Names by their last part, with their number: all are known before the first one is looked for.
_ENDS: dict[int, dict[str, list[str]]] = {}


def _by_end(objects: Any) -> dict[str, list[str]]:
    """Names of documented objects by their last part."""
    if len(objects) not in _ENDS:
        ends = _ENDS[len(objects)] = defaultdict(list)
        for name in objects:
            ends[name.rpartition(".")[2]].append(name)
    return _ENDS[len(objects)]


@cache
def _is_internal(target: str) -> bool:
    """Return True if this is a module of the package, or a name known in one of them."""
    if target in sys.modules and target.startswith("flexfem."):
        return True
    modules = [module for name, module in sys.modules.items() if name.startswith("flexfem")]
    first, *others = target.removeprefix("flexfem.").split(".")
    for module in modules:
        value = vars(module).get(first)
        for name in others:
            value = getattr(value, name, None)
        if value is not None:
            return True
    return False


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the search for targets that Sphinx does not find."""
    app.connect("missing-reference", _resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
