"""Write the Common Layer Interface 2.0, ASCII and binary.

The format, as this writer uses it:

- The header is ASCII in both variants. In the binary variant the first command follows `$$HEADEREND` directly.
- A layer command gives the z of the top of its layer. The thickness of a layer is the difference from the previous
  one, so the file starts with an empty layer at z = 0, which `$$LAYERS` counts.
- A polyline is `id, dir, n` and n points. Seen from above, dir 0 runs clockwise around a hole and dir 1
  counter-clockwise around a solid. The last point of a closed polyline equals the first.
- A command in the binary variant is a 16-bit little-endian number: 127 layer (32-bit float), 130 polyline (three 32-bit
  integers, then 32-bit floats).

The binary variant also has short commands (128, 129) with unsigned 16-bit numbers, which are limited to 0 to 65 535
units. Only the long commands are written: they hold every whole number of units up to 16 777 216 exactly.

Source: Common Layer Interface (CLI), version 2.0 (www.hmilch.net/downloads/cli_format.html).
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.errors import OutputError, UsageError
from printer_slicer.exports.rounding import RoundedRings, round_to_grid
from printer_slicer.model import Sections

__all__ = ["CLI_UNITS", "write_cli"]

CLI_UNITS: Final = 0.001
"""mm; default unit of the coordinates."""

_EXACT = 2**24  # every integer up to this is exact as a 32-bit float
_LAYER, _POLYLINE = 127, 130
_PART = 1  # identifier of the part in polylines and in the label


def write_cli(sections: Sections, *, binary: bool, units_mm: float = CLI_UNITS) -> bytes:
    """Return a stack of contours as a CLI file.

    Coordinates and heights are rounded to whole multiples of `units_mm`, and the header says so. Rings smaller than
    the unit are left out, and the header gives their number.

    Args:
        sections: the contours; layers may have any heights.
        binary: write the binary variant instead of ASCII; both hold the same numbers.
        units_mm: unit of the numbers in the file, mm.

    Raises:
        UsageError: the unit is not between 0.000 001 and 1 mm.
        OutputError: a layer is thinner than the unit, or, in the binary variant, a number is too large to be exact.
    """
    if not 1e-6 <= units_mm <= 1.0:
        raise UsageError(
            f"a CLI file cannot have units of {units_mm:g} mm",
            remedy="Choose a unit between 0.000001 and 1 mm",
        )
    rounded = round_to_grid(sections.solid, units_mm)
    z = np.rint(np.concatenate([[0.0], sections.plan.top]) / units_mm).astype(np.int64)
    _check_numbers(rounded, z, units_mm, binary=binary)
    header = _format_header(rounded, z, units_mm, binary=binary)
    if binary:
        return header + b"".join(_encode_commands(rounded, z))
    return "\n".join([header.decode("ascii"), *_format_commands(rounded, z), ""]).encode("ascii")


def _check_numbers(rounded: RoundedRings, z: Int, units: float, *, binary: bool) -> None:
    """Check that a reader gets back every number exactly."""
    if (np.diff(z) <= 0).any():
        layer = int(np.flatnonzero(np.diff(z) <= 0)[0])
        raise OutputError(
            f"layer {layer + 1} is thinner than the CLI unit of {units:g} mm", remedy="Choose a finer unit"
        )
    largest = max(int(np.abs(rounded.xy).max(initial=0)), int(z[-1]))
    if binary and largest > _EXACT:
        raise OutputError(
            f"binary CLI holds integers up to {_EXACT} exactly; with units of {units:g} mm, it would have to hold "
            f"{largest}",
            remedy="Choose a coarser unit, or the ASCII variant",
        )


def _format_header(rounded: RoundedRings, z: Int, units: float, *, binary: bool) -> bytes:
    """Return the header from $$HEADERSTART to $$HEADEREND."""
    low, high = (
        (rounded.xy.min(axis=0), rounded.xy.max(axis=0)) if len(rounded.xy) else (np.zeros(2), np.zeros(2))
    )
    corners = [*low.tolist(), 0, *high.tolist(), int(z[-1])]
    lines = [
        "$$HEADERSTART",
        "$$BINARY" if binary else "$$ASCII",
        f"$$UNITS/{_format_decimal(units)}",
        "$$VERSION/200",
        f"// printer-slicer: rounded to whole units, x, y and z at most {_format_decimal(units / 2)} mm off //",
    ]
    if rounded.lost:
        lines.append(f"// {rounded.lost} rings smaller than the unit are left out //")
    lines += [
        f"$$LABEL/{_PART},part",
        "$$DIMENSION/" + ",".join(_format_decimal(corner * units) for corner in corners),
        f"$$LAYERS/{len(z):06d}",
        "$$HEADEREND",
    ]
    return "\n".join(lines).encode("ascii")


def _format_decimal(value: float) -> str:
    """Format a length, mm, without an exponent and without trailing zeros."""
    text = f"{value:.9f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


def _format_commands(rounded: RoundedRings, z: Int) -> list[str]:
    """Return the commands of the geometry section, one per line."""
    xy, start = rounded.close_rings()
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


def _encode_commands(rounded: RoundedRings, z: Int) -> list[bytes]:
    """Return the commands of the geometry section in binary form."""
    xy, start = rounded.close_rings()
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
