"""Make one HTML file that contains the viewer and a preview, and needs no network.

The modules in `viewer/` import each other by name. A browser does not load modules from files, so the page has them in
one script: each after those it imports, without the words `import` and `export`. Their names at the top level are
therefore unique, and they import and export in two simple forms only.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import re
from collections import Counter
from importlib.resources import files
from typing import Final

from printer_slicer.preview.columns import Preview
from printer_slicer.preview.encoding import encode_preview

__all__ = ["join_modules", "make_view_page", "make_view_policy"]

_FIRST_MODULE: Final = "page.js"
_IMPORT: Final = re.compile(r'^import \{[^}]*\} from "\./([a-z0-9_]+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(?:async )?function |const |class )", re.MULTILINE)
_NAME: Final = re.compile(r"^(?:async )?(?:const|let|function|class) (\w+)", re.MULTILINE)
_LEFT: Final = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)
_POLICY: Final = (
    "default-src 'none'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; "
    "base-uri 'none'; form-action 'none'"
)


def make_view_page(preview: Preview) -> bytes:
    """Return the HTML file, in UTF-8."""
    script, style = join_modules(), _read_viewer_file("viewer.css")
    data = base64.b64encode(gzip.compress(encode_preview(preview), 9, mtime=0)).decode()
    parts = {
        "policy": html.escape(make_view_policy()),
        "title": html.escape(preview.name),
        "style": style,
        "preview": data,
        "script": script,
    }
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _read_viewer_file("page.html"))
    return page.encode("utf-8", "replace")


def make_view_policy() -> str:
    """Return the content security policy of the page, which allows its own script and style only."""
    return _POLICY.format(
        script=_hash_text(join_modules()), style=_hash_text(_read_viewer_file("viewer.css"))
    )


def join_modules(first: str = _FIRST_MODULE) -> str:
    """Return a module of the viewer and all that it imports as one script.

    Raises:
        ValueError: a module imports or exports in a form that is not supported, or two have a name in common.
    """
    done: dict[str, str] = {}
    _add_module(first, done)
    joined = "\n".join(done.values())
    names = Counter(_NAME.findall(joined))
    if twice := [name for name, count in names.items() if count > 1]:
        raise ValueError(f"modules of the viewer share the names {', '.join(twice)}")
    return joined


def _add_module(name: str, done: dict[str, str]) -> None:
    """Add a module to those in `done`, after the modules it imports."""
    if name in done:
        return
    text = _read_viewer_file(name)
    for other in _IMPORT.findall(text):
        _add_module(other, done)
    joined = _EXPORT.sub("", _IMPORT.sub("", text))
    if left := _LEFT.search(joined):
        raise ValueError(f"{name}: cannot join {left[0]!r}")
    done[name] = joined


def _read_viewer_file(name: str) -> str:
    """Return the text of a file in `viewer/`."""
    return files("printer_slicer.preview").joinpath("viewer", name).read_text("utf-8")


def _hash_text(text: str) -> str:
    """Return the SHA-256 of a text in base64, as a content security policy names it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
