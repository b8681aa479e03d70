"""QOI, the format that displays of printers decode quickly; whole pictures at a time.

Every pixel becomes the shortest of: one more of a run, a place in the table of colours seen, a small difference, a
larger one, a colour. The table holds the last colour of each of 64 hashes, so a pixel is in it if the pixel before with
the same hash had the same colour: one stable sort finds that for all of them. Source: qoiformat.org, specification 1.0.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

__all__ = ["qoi_bytes"]

_LONGEST_RUN = 62
_END = bytes(7) + b"\x01"


def qoi_bytes(picture: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 4) as the bytes of a QOI file."""
    height, width = picture.shape[:2]
    pixels = picture.reshape(-1, 4)
    header = b"qoif" + struct.pack(">IIBB", width, height, 4, 0)
    before = np.vstack([np.array([[0, 0, 0, 255]], np.uint8), pixels[:-1]])
    same = (pixels == before).all(axis=1)
    codes = np.zeros((len(pixels), 5), np.uint8)
    length = np.zeros(len(pixels), np.int64)
    _runs(same, codes, length)
    fresh = np.flatnonzero(~same)
    codes[fresh], length[fresh] = _single(pixels[fresh], before[fresh])
    used = np.arange(5) < length[:, None]
    return header + codes[used].tobytes() + _END


def _runs(same: NDArray[np.bool_], codes: NDArray[np.uint8], length: NDArray[np.int64]) -> None:
    """Write the codes of runs of pixels like the one before, at the last pixel of each or of each 62."""
    places = np.arange(len(same))
    begin = np.maximum.accumulate(np.where(same, 0, places + 1))  # where the run began that a pixel is in
    count = places - begin + 1
    last = same & (np.append(~same[1:], True) | (count % _LONGEST_RUN == 0))
    codes[last, 0] = 0xC0 | ((count[last] - 1) % _LONGEST_RUN)
    length[last] = 1


def _single(
    pixels: NDArray[np.uint8], before: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """(n, 5) codes and their lengths of pixels that are not like the one before them."""
    red, green, blue, alpha = pixels.T
    step = (pixels - before).view(np.int8).astype(np.int16)  # modulo 256, as the decoder adds
    dr, dg, db = step[:, :3].T
    hashes = (
        3 * red.astype(int) + 5 * green.astype(int) + 7 * blue.astype(int) + 11 * alpha.astype(int)
    ) % 64
    small = (step[:, :3] >= -2).all(axis=1) & (step[:, :3] <= 1).all(axis=1)
    by_green = (dg >= -32) & (dg <= 31) & (abs(dr - dg + 0.5) < 8) & (abs(db - dg + 0.5) < 8)
    opaque_as_before = step[:, 3] == 0
    none = np.zeros_like(red)
    choices = [
        (_in_table(pixels, hashes), [hashes, none, none, none, none], 1),
        (
            opaque_as_before & small,
            [0x40 | (dr + 2) << 4 | (dg + 2) << 2 | (db + 2), none, none, none, none],
            1,
        ),
        (
            opaque_as_before & by_green,
            [0x80 | (dg + 32), (dr - dg + 8) << 4 | (db - dg + 8), none, none, none],
            2,
        ),
        (opaque_as_before, [none + 0xFE, red, green, blue, none], 4),
        (np.ones(len(pixels), np.bool_), [none + 0xFF, red, green, blue, alpha], 5),
    ]
    kind = np.argmax([chosen for chosen, _, _ in choices], axis=0)
    codes = np.stack([np.column_stack(columns).astype(np.uint8) for _, columns, _ in choices])
    sizes = np.array([size for _, _, size in choices])
    return codes[kind, np.arange(len(pixels))], sizes[kind]


def _in_table(pixels: NDArray[np.uint8], hashes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the last pixel with the same hash had the same colour; before the first, all of them are 0."""
    order = np.argsort(hashes, kind="stable")
    ordered = pixels[order]
    first = np.append(True, np.diff(hashes[order]) != 0)
    last = np.vstack([np.zeros((1, 4), np.uint8), ordered[:-1]])
    last[first] = 0
    found = np.zeros(len(pixels), np.bool_)
    found[order] = (ordered == last).all(axis=1)
    return found
