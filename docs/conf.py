"""How Sphinx builds the documentation. `make docs` builds it into build/docs; a warning is an error."""

from __future__ import annotations

from importlib.metadata import version as version_of

project = "WebGym"
author = "The WebGym authors"
release = version = version_of("webgym-rl")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
nitpicky = False

myst_enable_extensions = ["colon_fence", "deflist", "fieldlist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = "WebGym"
