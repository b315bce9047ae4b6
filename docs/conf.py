"""Settings of the documentation: `make docs`. Nothing here reaches for the network."""

from importlib.metadata import version as installed_version

project = "Sagnac"
author = "The Sagnac developers"
copyright = author
release = version = installed_version("sagnac")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinxcontrib.typer",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
root_doc = "index"
exclude_patterns = ["_build"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings tell types, shapes and units
napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_rtype = False
napoleon_use_ivar = True  # one description of a field, not two

html_theme = "furo"
html_title = f"Sagnac {release}"
html_copy_source = False

# The word for a type in a docstring may name several classes (Site, Noise): which one is meant stands in the signature.
suppress_warnings = ["ref.python"]
