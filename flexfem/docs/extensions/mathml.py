# SPDX-License-Identifier: LGPL-3.0-or-later
"""Formulas as MathML, which browsers draw without scripts, fonts or network."""

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

_LOGGER = logging.getLogger(__name__)


def _inline(writer: Any, node: Any) -> None:
    writer.body.append(_converted(node, block=False))
    raise nodes.SkipNode


def _block(writer: Any, node: Any) -> None:
    number = ""
    if node["number"]:
        number = f'<span class="eqno">({node["number"]})</span>'
    label = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    writer.body.append(f'<div class="math equation"{label}>{_converted(node, block=True)}')
    writer.body.append(f"{number}</div>\n")
    raise nodes.SkipNode


def _converted(node: Any, *, block: bool) -> str:
    """A formula in MathML; what has no translation is a warning, and so an error of the build."""
    text = node.astext()
    try:
        return str(tex2mathml(text, as_block=block))
    except MathError as error:
        _LOGGER.warning("formula '%s': %s", text, error, location=node)
        return f"<code>{text}</code>"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
