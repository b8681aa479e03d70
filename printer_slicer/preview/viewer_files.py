"""The files of the viewer: its modules as one script, and the content security policy of a page with them."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from typing import Final

from printer_slicer.javascript_modules import join_modules

__all__ = ["join_viewer_modules", "make_view_policy", "read_viewer_file"]

_FIRST_MODULE: Final = "page.js"
_POLICY: Final = (
    "default-src 'none'; script-src 'sha256-{script}'; style-src 'sha256-{style}'; "
    "base-uri 'none'; form-action 'none'"
)


def make_view_policy() -> str:
    """Return the content security policy of the page, which allows its own script and style only."""
    script, style = join_viewer_modules(), read_viewer_file("viewer.css")
    return _POLICY.format(script=_hash_text(script), style=_hash_text(style))


def join_viewer_modules() -> str:
    """Return the modules of the viewer as one script."""
    return join_modules(read_viewer_file, _FIRST_MODULE)


def read_viewer_file(name: str) -> str:
    """Return the text of a file in `viewer/`."""
    return files("printer_slicer.preview").joinpath("viewer", name).read_text("utf-8")


def _hash_text(text: str) -> str:
    """Return the SHA-256 of a text in base64, as a content security policy names it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
