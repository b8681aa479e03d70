"""PNG with the standard library's zlib: eight bits, four channels, the filter of each row chosen by the least sum.

Pillow could write it too, but to import it takes three times as long as all of this.
Source: W3C, "Portable Network Graphics", 9.2 and 12.8 (the heuristic).
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["png_bytes"]

_CHANNELS = 4
_LEVEL = 6  # 9 takes ten times as long and saves 5 %


def png_bytes(picture: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 4) as the bytes of a PNG file."""
    height, width = picture.shape[:2]
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    rows = zlib.compress(_filtered(picture.reshape(height, -1)).tobytes(), _LEVEL)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        _chunk(name, data) for name, data in ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
    )


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _filtered(rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, 1 + 4w) the rows with the number of their filter in front.

    Of what is left when left, upper, or the nearer of both neighbours are subtracted, the least in sum is taken.
    """
    now = rows.astype(np.int16)
    left, upper, corner = np.zeros_like(now), np.zeros_like(now), np.zeros_like(now)
    left[:, _CHANNELS:] = now[:, :-_CHANNELS]
    upper[1:] = now[:-1]
    corner[1:, _CHANNELS:] = now[:-1, :-_CHANNELS]
    slope = left + upper - corner
    from_left, from_upper, from_corner = abs(slope - left), abs(slope - upper), abs(slope - corner)
    nearest = np.where(from_upper <= from_corner, upper, corner)
    paeth = np.where((from_left <= from_upper) & (from_left <= from_corner), left, nearest)
    kinds = np.array([0, 1, 2, 4], np.uint8)
    rest = np.stack([now, now - left, now - upper, now - paeth]).astype(np.uint8)
    sums = np.abs(rest.view(np.int8).astype(np.int32)).sum(axis=2)
    best = sums.argmin(axis=0)
    return np.column_stack([kinds[best], rest[best, np.arange(len(rows))]])
