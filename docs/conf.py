"""Sphinx: ``sphinx-build -W -b html docs docs/_build``."""

from __future__ import annotations

import bfrt

project = "bfrt"
copyright = "the authors of bfrt"
version = release = bfrt.__version__

extensions = ["sphinx.ext.autodoc", "numpydoc"]
exclude_patterns = ["_build", "performance/*.rst"]  # parts that performance.rst includes
html_theme = "furo"
html_title = f"bfrt {release}"
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}
html_show_sourcelink = False
html_static_path = ["static"]
html_css_files = ["wide.css"]
pygments_style = "friendly"
pygments_dark_style = "native"
highlight_language = "text"

autodoc_member_order = "bysource"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Vector": "Vector"}
numpydoc_show_class_members = False
