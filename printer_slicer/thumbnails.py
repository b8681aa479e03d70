"""Thumbnails: pictures of the part, written as PNG or QOI into comments of a G-code file.

In the file a thumbnail begins with its size and the number of characters: `; thumbnail begin 300x300 12345` for PNG,
`; thumbnail_QOI begin ...` for QOI. Source: Moonraker, OctoPrint's thumbnail plugin and py-gcode-metadata.
"""

from __future__ import annotations

import io
from binascii import b2a_base64
from collections.abc import Mapping, Sequence
from struct import pack
from typing import Final
from zlib import compress, crc32

import numpy as np

from printer_slicer.model import Mesh
from printer_slicer.rendering import Picture, RenderedFacets, render_facets

__all__ = ["Picture", "encode_image", "render", "render_thumbnail_lines"]

_COLOUR: Final = np.array([255.0, 146.0, 48.0])
_SHADE: Final = np.array([112.0, 50.0, 22.0])  # colour in full shadow
_KEYWORDS: Final[Mapping[str, str]] = {"PNG": "thumbnail", "QOI": "thumbnail_QOI"}
"""Keyword of each image format in the file."""
_LINE_LENGTH: Final = 78  # characters per comment line


def render(part: Mesh, width: int, height: int) -> Picture:
    """Render the part as a picture (height, width, 4) of red, green, blue and opacity, 0 to 255."""
    return render_facets(_list_facets(part), [(width, height)])[0]


def render_thumbnail_lines(part: Mesh, specs: Sequence[str]) -> list[str]:
    """Render thumbnails as comment lines of a G-code file.

    Args:
        part: the part to show.
        specs: size and format of each thumbnail, `300x300` or `300x300/QOI`; the default format is PNG.
    """
    parsed = [spec.partition("/") for spec in specs]
    sizes = [(int(size.partition("x")[0]), int(size.partition("x")[2])) for size, _, _ in parsed]
    lines: list[str] = []
    for picture, (size, _, name) in zip(render_facets(_list_facets(part), sizes), parsed, strict=True):
        text = b2a_base64(encode_image(picture, name or "PNG"), newline=False).decode("ascii")
        keyword = _KEYWORDS[name or "PNG"]
        rows = [f"; {text[at : at + _LINE_LENGTH]}" for at in range(0, len(text), _LINE_LENGTH)]
        lines += [";", f"; {keyword} begin {size} {len(text)}", *rows, f"; {keyword} end", ";"]
    return lines


def encode_image(picture: Picture, file_format: str) -> bytes:
    """Encode a picture as an image file, PNG or QOI."""
    if file_format == "PNG":
        return _encode_png(picture)
    from PIL import Image  # noqa: PLC0415 - slow, and most printers show PNG

    data = io.BytesIO()
    # With a file name Pillow imports only this format, otherwise all common ones.
    data.name = f"picture.{file_format.lower()}"
    Image.fromarray(picture).save(data)
    return data.getvalue()


def _encode_png(picture: Picture) -> bytes:
    """Encode a picture as a PNG file, without Pillow, whose import takes longer than rendering a small part.

    Rows are stored without filters, because pictures with few colours are smaller without.
    """
    height, width, _ = picture.shape
    rows = np.zeros((height, 1 + 4 * width), np.uint8)  # the first byte of a row is its filter: none
    rows[:, 1:] = picture.reshape(height, -1)
    header = pack(">2I5B", width, height, 8, 6, 0, 0, 0)  # 8 bits of red, green, blue and opacity
    chunks = ((b"IHDR", header), (b"IDAT", compress(rows.tobytes(), 6)), (b"IEND", b""))
    encoded = [pack(">I", len(data)) + name + data + pack(">I", crc32(name + data)) for name, data in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(encoded)


def _list_facets(part: Mesh) -> RenderedFacets:
    """Return the facets of a part, all of one colour."""
    triangles = part.triangles
    return RenderedFacets(
        len(triangles), lambda which: np.asarray(triangles[which]), lambda _: (_COLOUR, _SHADE)
    )
