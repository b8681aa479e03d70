"""Make one HTML file that contains the viewer and a preview, and needs no network."""

from __future__ import annotations

import base64
import gzip
import html
import re

from printer_slicer.preview.columns import Preview
from printer_slicer.preview.encoding import encode_preview
from printer_slicer.preview.viewer_files import join_viewer_modules, make_view_policy, read_viewer_file

__all__ = ["make_view_page"]


def make_view_page(preview: Preview) -> bytes:
    """Return the HTML file, in UTF-8."""
    script, style = join_viewer_modules(), read_viewer_file("viewer.css")
    data = base64.b64encode(gzip.compress(encode_preview(preview), 9, mtime=0)).decode()
    parts = {
        "policy": html.escape(make_view_policy()),
        "title": html.escape(preview.name),
        "style": style,
        "preview": data,
        "script": script,
    }
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], read_viewer_file("page.html"))
    return page.encode("utf-8", "replace")
