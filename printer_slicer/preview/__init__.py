"""Previews of prints: columns of moves that a viewer in a browser shows.

    G-code of any slicer --read_preview--> Preview --encode_preview--> bytes --viewer/*.js--> pictures
                                              |
                                              +------make_view_page----> one HTML file with viewer and preview

`columns` is the value: one row per move and one per layer. `reading` makes it from G-code. `encoding` documents the
bytes. `page` puts the viewer and the bytes into one HTML file. `viewer/` has the viewer as JavaScript modules, which a
server can also serve as files. `viewer/viewer.js` starts it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.preview.columns import Preview, PreviewRole
    from printer_slicer.preview.encoding import decode_preview, encode_preview
    from printer_slicer.preview.page import make_view_page
    from printer_slicer.preview.reading import read_preview

_HOMES = {
    "Preview": "columns",
    "PreviewRole": "columns",
    "decode_preview": "encoding",
    "encode_preview": "encoding",
    "make_view_page": "page",
    "read_preview": "reading",
}
__all__ = ["Preview", "PreviewRole", "decode_preview", "encode_preview", "make_view_page", "read_preview"]


__getattr__ = lazy_names(__name__, _HOMES)
