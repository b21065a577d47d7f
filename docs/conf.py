"""The documentation as one static site: guides in Markdown, the reference from docstrings. `make docs` builds it."""

from __future__ import annotations

from importlib.metadata import version as version_of

project = "fingertwin"
author = "fingertwin contributors"
version = release = version_of("fingertwin")

# The source is the repository, so that links between guides, README, benchmarks and data are those of the checkout.
root_doc = "docs/index"
include_patterns = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "benchmarks/*.md",
    "data/README.md",
    "docs/**",
]
exclude_patterns = [".*", "build", "dist", "out", "demo-output", "**/_data"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
# Anchors of headings down to the third level, so that links to them are checked.
myst_heading_anchors = 3

# Docstrings are in Google's style, with names in single backquotes.
default_role = "code"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = False
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_type_aliases = {"Floats": "Floats", "Array": "Array"}
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"fingertwin {release}"
html_extra_path = ["site"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"top_of_page_buttons": []}
