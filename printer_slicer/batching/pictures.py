"""Pictures of the parts whose G-code is kept from an earlier run: the thumbnails in these files."""

from __future__ import annotations

import re
from base64 import b64decode
from binascii import Error
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from printer_slicer.batching.tasks import BatchResult
from printer_slicer.values import replace

__all__ = ["add_pictures", "read_thumbnail"]

_HEAD_SIZE: Final = 1 << 17  # bytes of a file in which thumbnails are
_THUMBNAIL: Final = re.compile(rb"; thumbnail begin (\d+)x\d+ \d+\s+((?:; [\w+/=]+\s+)+); thumbnail end")


def add_pictures(results: Sequence[BatchResult], folder: Path) -> list[BatchResult]:
    """Return the results; those that are done and have no picture get the thumbnail of their first file."""
    return [
        replace(one, picture=read_thumbnail(folder / Path(one.files[0].name).name))
        if one.files and not one.picture
        else one
        for one in results
    ]


def read_thumbnail(path: Path) -> bytes:
    """Return the widest thumbnail of a G-code file as PNG; empty if there is none."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_SIZE)
    except OSError:
        return b""
    found = [(int(width), text) for width, text in _THUMBNAIL.findall(head)]
    if not found:
        return b""
    _, text = max(found)
    try:
        return b64decode(text.replace(b"; ", b""))
    except Error:
        return b""
