"""The site: `make site` builds it into build/site, without a warning or not at all."""

import inspect
import re
from pathlib import Path

project = "placement_planner_ros"
copyright = "the placement_planner_ros authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "placement_planner_ros"
exclude_patterns = ["conf.py"]
myst_heading_anchors = 4

default_role = "code"
autodoc_class_signature = "separated"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "undoc-members": False}
napoleon_use_ivar = True
napoleon_use_rtype = False


def _insert(app, name, source):
    """The README is the first page, and others beside it are pages too."""
    source[0] = re.sub(r"<!-- (\S+) comes here -->", lambda found: _page(app, found[1]), source[0])


def _page(app, name):
    text = (Path(app.srcdir).parent / name).read_text(encoding="utf-8")
    return re.sub(r"\]\((?!https?:|#)([^)]+)\)", _link, text)


def _link(found):
    """What is linked to lies elsewhere, seen from here."""
    pages = {"CHANGELOG.md": "changes.md", "CONTRIBUTING.md": "contributing.md"}
    target = found[1]
    here = target.startswith("docs/")
    return f"]({target.removeprefix('docs/') if here else pages.get(target, f'../{target}')})"


def _skip(app, what, name, member, skip, options):
    """Attributes stand in the docstring of their class."""
    told = inspect.isroutine(member) or isinstance(member, (property, classmethod, staticmethod))
    return skip or not told


def setup(app):
    """What Sphinx calls."""
    app.connect("autodoc-skip-member", _skip)
    app.connect("source-read", _insert)
