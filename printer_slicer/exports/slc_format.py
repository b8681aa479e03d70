"""Write StereoLithography Contour (SLC) 2.0 files of 3D Systems.

The format, as this writer uses it:

- The header is up to 2048 ASCII characters of `-KEYWORD value`. It ends with carriage return, line feed and control-Z,
  and 256 reserved bytes follow.
- The sampling table is a byte with the number of entries, followed by the entries. Each entry describes a run of layers
  of equal thickness: lowest z, thickness, line width compensation (0: none), reserved. The first run starts with the
  first contour layer.
- A contour layer is the z of its bottom, the number of boundaries, and for each boundary the number of points, the
  number of gaps (0) and the points. The last point equals the first; solids run counter-clockwise, holes clockwise.
- The file ends with the z of the top of the part and 0xFFFFFFFF as the number of boundaries.
- Numbers are little-endian 32-bit floats and unsigned integers.

Source: 3D Systems, SLC File Specification, about 1994 (paulbourke.net/dataformats/slc; rp-ml.org/rp-ml-1999/0713.html).
"""

from __future__ import annotations

import struct

import numpy as np

from printer_slicer.errors import OutputError
from printer_slicer.exports.rounding import RoundedRings, round_to_float32
from printer_slicer.model import LayerPlan, Sections

__all__ = ["has_uneven_heights", "write_slc"]

_RESERVED = bytes(256)
_MAX_RUNS = 255  # the number of table entries is one byte
_END = 0xFFFFFFFF
_MULTIPLE = 1e-6  # of a thickness


def write_slc(sections: Sections) -> bytes:
    """Return a stack of contours as an SLC file, in mm.

    Coordinates and heights are rounded to 32-bit floats, by at most 0.000 004 mm up to 128 mm from the origin and
    0.000 031 mm up to 1 m. The header says "float32". Rings without an area after rounding are left out.

    Raises:
        OutputError: there are more than 255 runs of equal layers, or layers that are equal as 32-bit floats.
    """
    plan, rounded = sections.plan, round_to_float32(sections.solid)
    z = np.concatenate([[0.0], plan.top]).astype(np.float32)
    if (np.diff(z) <= 0).any():
        layer = int(np.flatnonzero(np.diff(z) <= 0)[0])
        raise OutputError(
            f"layer {layer + 1} is too thin for the 32-bit numbers of SLC",
            remedy="Plan thicker layers, or write .cli or .svg, which can hold thinner ones",
        )
    head = _format_header(rounded, float(z[-1])) + _RESERVED
    return head + _encode_sampling_table(plan) + b"".join(_encode_layers(rounded, z.tolist()))


def has_uneven_heights(plan: LayerPlan) -> bool:
    """Return whether a layer height is not a multiple of the smallest one; the specification warns of such files."""
    thin = float(plan.height.min())
    ratio = plan.height / thin
    return bool((np.abs(ratio - np.rint(ratio)) > _MULTIPLE).any())


def _format_header(rounded: RoundedRings, top: float) -> bytes:
    """Return the header with version, unit, type, program, and the bounding box of the part."""
    low, high = (
        (rounded.xy.min(axis=0).tolist(), rounded.xy.max(axis=0).tolist())
        if len(rounded.xy)
        else ([0.0, 0.0], [0.0, 0.0])
    )
    box = " ".join(
        f"{a:.6f},{b:.6f}" for a, b in zip([*low, 0.0], [*high, top], strict=True)
    )  # x, y, z: each from, to
    text = f"-SLCVER 2.0 -UNIT MM -TYPE PART -PACKAGE printer-slicer float32 -EXTENTS {box}"
    return text.encode("ascii") + b"\r\n\x1a"


def _encode_sampling_table(plan: LayerPlan) -> bytes:
    """Return the sampling table: an entry for each run of layers of equal thickness."""
    runs = plan.runs()
    if len(runs) > _MAX_RUNS:
        raise OutputError(
            f"an SLC file has at most {_MAX_RUNS} runs of equal layers; this plan has {len(runs)}",
            remedy="Plan with fewer different heights (`layer_heights`), or write .cli or .svg",
        )
    counts = np.array([count for count, _ in runs])
    bottom = plan.bottom[np.cumsum(counts) - counts]
    entries = [
        struct.pack("<4f", z, height, 0.0, 0.0) for z, (_, height) in zip(bottom.tolist(), runs, strict=True)
    ]
    return bytes([len(runs)]) + b"".join(entries)


def _encode_layers(rounded: RoundedRings, z: list[float]) -> list[bytes]:
    """Return the contour layers and the end mark."""
    xy, start = rounded.close_rings()
    points = memoryview(xy.astype("<f4").tobytes())
    pieces: list[bytes] = []
    for bottom, rings in zip(z[:-1], rounded.layers(), strict=True):
        pieces.append(struct.pack("<fI", bottom, len(rings)))
        for ring in rings:
            begin, end = start[ring], start[ring + 1]
            pieces.append(struct.pack("<II", end - begin, 0))
            pieces.append(bytes(points[8 * begin : 8 * end]))
    pieces.append(struct.pack("<fI", z[-1], _END))
    return pieces
