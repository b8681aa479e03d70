"""Configuration of Sphinx for the documentation site: `just docs`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parents[1]))

from printer_slicer.cli.commands.man import format_markdown_page
from printer_slicer.version import VERSION

HERE = Path(__file__).parent

project = "printer_slicer"
author = copyright = "the printer_slicer authors"  # noqa: A001 - Sphinx's name for it
release = version = VERSION
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
nitpicky = False  # our types refer to modules that are not public
default_role = "code"
html_theme = "furo"
html_title = f"printer_slicer {VERSION}"
html_static_path: list[str] = []
html_show_sphinx = False
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_type_aliases = {"Float": "Float", "Int": "Int", "Bool": "Bool"}
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_use_ivar = True
suppress_warnings = ["misc.highlighting_failure"]  # "sh not-here": Pygments knows the first word
exclude_patterns = ["_build"]


def outside(page: Path, target: str) -> bool:
    """Return whether a relative link refers to a file of the repository that is not a page of the site."""
    if re.match(r"[a-z]+:|#", target):
        return False
    goal = (page.parent / target.partition("#")[0]).resolve()
    return not goal.is_relative_to(HERE) or goal.is_dir()


def without_links_outside(_app: Sphinx, name: str, source: list[str]) -> None:
    """Replace such links by their text, because the site works without the repository."""
    page = HERE / f"{name}.md"
    text = re.sub(
        r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)", lambda m: m[1] if outside(page, m[2]) else m[0], source[0]
    )
    # Readers need not see which examples the tests skip.
    source[0] = re.sub(r"(?m)^( *```\w+) not-here$", r"\1", text)


def as_literals(
    _app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Convert `code` in docstrings from Markdown to reStructuredText."""
    lines[:] = [re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", line) for line in lines]


def setup(app: Sphinx) -> None:
    """Write the page of the command line, and process links as pages are read."""
    (HERE / "reference" / "cli.md").write_text(format_markdown_page(), encoding="utf-8")
    app.connect("source-read", without_links_outside)
    app.connect(
        "autodoc-process-docstring", as_literals, priority=400
    )  # before napoleon, which looks for colons
