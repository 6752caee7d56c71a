"""Configuration of the documentation site; ``make site`` builds it from the repository's pages, strictly."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from pygments.lexers.special import TextLexer

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

project = "spallwatch"
author = "the spallwatch authors"
copyright = author  # noqa: A001  (the name is Sphinx's)

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "sphinx_copybutton",
]
# Pages stay where they are read on GitHub too, so that the source folder is the repository.
root_doc = "docs/site/index"
include_patterns = ["docs/*.md", "docs/**/*.md", "CHANGELOG.md", "CONTRIBUTING.md"]
exclude_patterns = ["docs/README.md"]
source_suffix = {".md": "markdown"}

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
autodoc_class_signature = "separated"
autodoc_default_options = {"exclude-members": "__init__, __new__"}

html_theme = "furo"
html_title = "spallwatch"
html_copy_source = False
html_show_sourcelink = False
html_static_path: list[str] = []


def _targets(app: Any, name: str, source: list[str]) -> None:
    """Make targets of the anchors before headings of a page, which are HTML where the page is read on its own."""
    source[0] = re.sub(r'^<a id="([\w-]+)"></a>$', r"(\1)=", source[0], flags=re.MULTILINE)


def _literal(app: Any, context: Any, lines: list[str]) -> None:
    """Keep the stars of a help text, which is no markup."""
    lines[:] = [re.sub(r"(?<!\*)\*(?!\*)", r"\\*", line) for line in lines]


def setup(app: Any) -> None:
    """Connect what changes pages on their way."""
    app.connect("source-read", _targets)
    app.add_lexer("csv", TextLexer)
    for part in ("description", "options"):
        app.connect(f"sphinx-click-process-{part}", _literal)
