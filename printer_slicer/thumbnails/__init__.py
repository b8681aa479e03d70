"""Small pictures of the part as comments of a file: rendered, encoded, written in the lines that print servers read.

A picture begins with its size and the number of letters that follow: `; thumbnail begin 300x300 12345` for PNG,
`; thumbnail_QOI begin ...` for QOI. Source: what Moonraker, OctoPrint's thumbnail tool and py-gcode-metadata read.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from printer_slicer.model import Mesh
from printer_slicer.thumbnails.png import png_bytes
from printer_slicer.thumbnails.qoi import qoi_bytes
from printer_slicer.thumbnails.shading import Picture, pictures

__all__ = ["png_bytes", "qoi_bytes", "render", "thumbnail_lines"]

_ROW: Final = 78


class _Format(NamedTuple):
    """How pictures are encoded, and what stands in front of them."""

    encode: Callable[[Picture], bytes]
    word: str


_FORMATS: Final[Mapping[str, _Format]] = {
    "PNG": _Format(png_bytes, "thumbnail"),
    "QOI": _Format(qoi_bytes, "thumbnail_QOI"),
}


def render(part: Mesh, width: int, height: int) -> Picture:
    """The part as a picture (height, width, 4), red, green, blue and opacity from 0 to 255."""
    return pictures(part.triangles, [(width, height)])[0]


def thumbnail_lines(part: Mesh, wanted: Sequence[str]) -> list[str]:
    """Comments that hold pictures.

    Args:
        part: what is shown.
        wanted: one picture each, `300x300` or `300x300/QOI`; PNG where no format is named.
    """
    parsed = [one.partition("/") for one in wanted]
    sizes = [(int(size.partition("x")[0]), int(size.partition("x")[2])) for size, _, _ in parsed]
    lines: list[str] = []
    for picture, (size, _, name) in zip(pictures(part.triangles, sizes), parsed, strict=True):
        form = _FORMATS[name or "PNG"]
        text = b64encode(form.encode(picture)).decode("ascii")
        rows = [f"; {text[at : at + _ROW]}" for at in range(0, len(text), _ROW)]
        lines += [";", f"; {form.word} begin {size} {len(text)}", *rows, f"; {form.word} end", ";"]
    return lines
