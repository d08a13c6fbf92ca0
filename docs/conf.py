"""
How Sphinx makes the documentation site: `make docs`. Its source is the whole checkout, so that pages link to one another as
they do on a code host.
"""

from importlib.metadata import version as version_of
from pathlib import Path

from docutils.nodes import document
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

project = "sb3-guide"
author = "The sb3-guide authors"
version = release = version_of("sb3-guide")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
include_patterns = ["*.md", "docs/**"]
exclude_patterns = [".*", "build", "runs"]
root_doc = "docs/index"
templates_path = ["templates"]
html_additional_pages = {"index": "index.html"}  # which leads to the README
html_theme = "furo"
html_title = "sb3-guide"

myst_heading_anchors = 4
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!sb3_guide).*")]  # what other packages document
default_role = "literal"  # docstrings are read in editors too
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"


def leave_folders_alone(app: Sphinx, page: document) -> None:
    """Links to folders, which a code host can show and the site can't, become text."""
    here = Path(app.env.doc2path(app.env.docname)).parent
    for link in list(page.findall(pending_xref)):
        if (here / link["reftarget"]).is_dir():
            link.replace_self(link.children)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("doctree-read", leave_folders_alone)
