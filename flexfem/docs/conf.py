# SPDX-License-Identifier: LGPL-3.0-or-later
"""Configuration of Sphinx."""

import gc

import flexfem

# a fifth of the time: what a build makes, less than 1 GB, is in use to its end
gc.disable()

project = "flexfem"
copyright = "the flexfem authors"
version = release = flexfem.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "myst_parser",
    "flexfem.docs.extensions.formulas",
    "flexfem.docs.extensions.references",
    "flexfem.docs.extensions.directives",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["__pycache__"]
root_doc = "index"
nitpicky = True
smartquotes = False  # options begin with two hyphens

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence"]
myst_heading_anchors = 3

# Docstrings: Google style, names and formulas between single backticks or double ones.
default_role = "literal"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autoclass_content = "both"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autosummary_generate = False
maximum_signature_line_length = 88
python_use_unqualified_type_names = True
toc_object_entries = False

html_theme = "furo"
html_title = f"flexfem {release}"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sphinx = False
