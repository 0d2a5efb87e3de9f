# SPDX-License-Identifier: LGPL-3.0-or-later
"""Formulas without network: MathJax and its fonts come from a wheel and lie among the pages."""

import importlib.util
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

_LOGGER = logging.getLogger(__name__)

#: Components of MathJax that the pages need; all of it is twenty times as large.
_SCRIPT, _FONTS = "tex-chtml.js", "output/chtml/fonts/woff-v2"


def _mathjax() -> Path:
    """Folder of MathJax in the installed wheel.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    spec = importlib.util.find_spec("sphinx-mathjax-offline")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("formulas need the wheel sphinx-mathjax-offline (extra docs)")
    return Path(spec.origin).parent / "static" / "mathjax"


def _check(app: Sphinx, doctree: nodes.document) -> None:
    """Browsers show a formula that they cannot read in red; here it is a warning."""
    for node in doctree.findall(lambda node: isinstance(node, nodes.math | nodes.math_block)):
        try:
            tex2mathml(node.astext(), as_block=isinstance(node, nodes.math_block))
        except MathError as error:
            _LOGGER.warning("formula '%s': %s", node.astext(), error, location=node)


def _copy(app: Sphinx, error: Exception | None) -> None:
    """Put MathJax where the pages look for it."""
    if error is None and app.builder.format == "html":
        source, target = _mathjax(), Path(app.outdir) / "_static" / "mathjax"
        shutil.copytree(source / _FONTS, target / _FONTS, dirs_exist_ok=True)
        shutil.copyfile(source / _SCRIPT, target / _SCRIPT)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the check of formulas and the copy of MathJax."""
    app.setup_extension("sphinx.ext.mathjax")
    app.config.mathjax_path = f"mathjax/{_SCRIPT}"
    app.connect("doctree-read", _check)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
