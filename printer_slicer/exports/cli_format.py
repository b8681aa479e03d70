"""Common Layer Interface 2.0, ASCII and binary.

What the specification says and this writer does:

- the header is ASCII in both kinds; in the binary kind the first command follows `$$HEADEREND` at once;
- a layer command names the upper surface of its layer. The thickness of a layer is the difference from the one
  before, so a layer without polylines at z = 0 comes first and gives the first layer its thickness; `$$LAYERS`
  counts it;
- a polyline is `id, dir, n` and n points. Seen from above, dir 0 runs clockwise around the inside of a hole and dir 1
  counter-clockwise around a solid; the last point of a closed polyline is its first;
- commands in the binary kind are a 16-bit number, least significant byte first: 127 layer (32-bit float), 130
  polyline (three 32-bit integers, then 32-bit floats).

The binary kind also has short commands (128, 129) with unsigned 16-bit numbers. They cannot be negative and end at
65 535 units; the long ones hold every whole number of units up to 16 777 216 exactly. Only those are written.

Source: Common Layer Interface (CLI), version 2.0 (www.hmilch.net/downloads/cli_format.html).
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.errors import OutputError, UsageError
from printer_slicer.exports.rounding import Rounded, on_grid
from printer_slicer.model import Sections

__all__ = ["CLI_UNITS", "write_cli"]

CLI_UNITS: Final = 0.001
"""mm; coordinates are whole multiples of this unless another unit is asked for."""

_EXACT = 2**24  # every whole number up to this is a 32-bit float
_LAYER, _POLYLINE = 127, 130
_PART = 1  # the identifier that polylines and label share


def write_cli(sections: Sections, *, binary: bool, units_mm: float = CLI_UNITS) -> bytes:
    """A stack of contours as a CLI file.

    Coordinates and heights are whole multiples of `units_mm`, so each is at most half a unit off; the header says so.
    Rings that are smaller than the unit are left out, and the header says how many.

    Args:
        sections: the contours; layers may have any heights.
        binary: the binary kind instead of the ASCII one; both hold the same numbers.
        units_mm: what the numbers of the file count, mm.

    Raises:
        UsageError: a unit that is not between 0.000 001 and 1 mm.
        OutputError: layers thinner than the unit, or, in the binary kind, numbers too large to be exact.
    """
    if not 1e-6 <= units_mm <= 1.0:
        raise UsageError(f"CLI units of {units_mm:g} mm", remedy="Choose between 0.000001 and 1 mm")
    rounded = on_grid(sections.solid, units_mm)
    z = np.rint(np.concatenate([[0.0], sections.plan.top]) / units_mm).astype(np.int64)
    _check(rounded, z, units_mm, binary=binary)
    header = _header(rounded, z, units_mm, binary=binary)
    if binary:
        return header + b"".join(_binary(rounded, z))
    return "\n".join([header.decode("ascii"), *_lines(rounded, z), ""]).encode("ascii")


def _check(rounded: Rounded, z: Int, units: float, *, binary: bool) -> None:
    """Refuse what would not be read back as it is."""
    if (np.diff(z) <= 0).any():
        layer = int(np.flatnonzero(np.diff(z) <= 0)[0])
        raise OutputError(
            f"layer {layer + 1} is thinner than the CLI unit of {units:g} mm", remedy="Choose a finer unit"
        )
    largest = max(int(np.abs(rounded.xy).max(initial=0)), int(z[-1]))
    if binary and largest > _EXACT:
        raise OutputError(
            f"binary CLI holds whole numbers up to {_EXACT} exactly; at {units:g} mm a unit, {largest} are needed",
            remedy="Choose a coarser unit, or ASCII",
        )


def _header(rounded: Rounded, z: Int, units: float, *, binary: bool) -> bytes:
    """From $$HEADERSTART to $$HEADEREND."""
    low, high = (
        (rounded.xy.min(axis=0), rounded.xy.max(axis=0)) if len(rounded.xy) else (np.zeros(2), np.zeros(2))
    )
    corners = [*low.tolist(), 0, *high.tolist(), int(z[-1])]
    lines = [
        "$$HEADERSTART",
        "$$BINARY" if binary else "$$ASCII",
        f"$$UNITS/{_decimal(units)}",
        "$$VERSION/200",
        f"// printer-slicer: rounded to whole units, x, y and z at most {_decimal(units / 2)} mm off //",
    ]
    if rounded.lost:
        lines.append(f"// {rounded.lost} rings smaller than the unit are left out //")
    lines += [
        f"$$LABEL/{_PART},part",
        "$$DIMENSION/" + ",".join(_decimal(corner * units) for corner in corners),
        f"$$LAYERS/{len(z):06d}",
        "$$HEADEREND",
    ]
    return "\n".join(lines).encode("ascii")


def _decimal(value: float) -> str:
    """A length, mm, without exponent and without more digits than it has."""
    text = f"{value:.9f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


def _lines(rounded: Rounded, z: Int) -> list[str]:
    """The commands of the geometry section, one a line."""
    xy, start = rounded.closed()
    words = list(map(str, xy.ravel().tolist()))
    direction = rounded.outer.astype(np.int64).tolist()
    lines = ["$$GEOMETRYSTART", f"$$LAYER/{z[0]}"]
    for height, rings in zip(z[1:].tolist(), rounded.layers(), strict=True):
        lines.append(f"$$LAYER/{height}")
        for ring in rings:
            begin, end = start[ring], start[ring + 1]
            points = ",".join(words[2 * begin : 2 * end])
            lines.append(f"$$POLYLINE/{_PART},{direction[ring]},{end - begin},{points}")
    lines.append("$$GEOMETRYEND")
    return lines


def _binary(rounded: Rounded, z: Int) -> list[bytes]:
    """The same commands as bytes."""
    xy, start = rounded.closed()
    points = memoryview(xy.astype("<f4").tobytes())
    direction = rounded.outer.astype(np.int64).tolist()
    pieces: list[bytes] = [struct.pack("<Hf", _LAYER, z[0])]
    for height, rings in zip(z[1:].tolist(), rounded.layers(), strict=True):
        pieces.append(struct.pack("<Hf", _LAYER, height))
        for ring in rings:
            begin, end = start[ring], start[ring + 1]
            pieces.append(struct.pack("<Hiii", _POLYLINE, _PART, direction[ring], end - begin))
            pieces.append(bytes(points[8 * begin : 8 * end]))
    return pieces
