"""Sphinx: ``sphinx-build -W -b html docs docs/_build``."""

from __future__ import annotations

import bfrt

project = "bfrt"
copyright = "the authors of bfrt"
version = release = bfrt.__version__

extensions = ["sphinx.ext.autodoc", "numpydoc"]
exclude_patterns = ["_build"]
html_theme = "alabaster"
html_theme_options = {
    "description": "Ray tracing of scenes larger than memory, under a memory budget",
    "fixed_sidebar": True,
    "page_width": "1060px",
}
highlight_language = "text"

autodoc_member_order = "bysource"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Vector": "Vector"}
numpydoc_show_class_members = False
