"""Convert the outline of a bed to a rectangle."""

from __future__ import annotations

import re
from math import hypot
from typing import Final, NamedTuple

from printer_slicer.importing.conversion import Conversion

__all__ = ["BedRectangle", "find_excluded_areas", "find_head_shapes", "find_rectangle"]

_NUMBER: Final = r"-?\d+(?:\.\d*)?(?:e-?\d+)?"
_POINT: Final = re.compile(rf"\s*({_NUMBER})\s*x\s*({_NUMBER})\s*", re.IGNORECASE)
_ROUNDNESS: Final = 0.02  # largest relative difference between the radii of the corners of a round bed
_Point = tuple[float, float]


class BedRectangle(NamedTuple):
    """A rectangular bed: front left and back right corner, mm, and how the outline was converted."""

    low: _Point
    high: _Point
    how: str = ""


def find_rectangle(conversion: Conversion) -> BedRectangle:
    """Return a rectangle that replaces the outline of a bed.

    Raises:
        ProfileError: the outline is invalid or empty.
    """
    points = _read_points(conversion, "bed_shape", conversion.preset.read_raw("bed_shape"))
    xs, ys = [x for x, _ in points], [y for _, y in points]
    low, high = (min(xs), min(ys)), (max(xs), max(ys))
    size = (high[0] - low[0], high[1] - low[1])
    if len(points) < 3 or min(size) <= 0:
        raise conversion.make_error(
            "bed_shape", "the bed has no area", "Write its corners as 0x0,220x0,220x220,0x220"
        )
    if _is_rectangle(points, low, high):
        return BedRectangle(low, high)
    middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    radii = [hypot(x - middle[0], y - middle[1]) for x, y in points]
    if len(points) >= 8 and max(radii) - min(radii) <= _ROUNDNESS * max(radii):
        # Round beds are polygons: the square has to fit into the smallest radius.
        half = min(radii) * 0.5**0.5
        how = f"the square inside a round bed of {2 * max(radii):g} mm"
        return BedRectangle(_shift_point(middle, -half), _shift_point(middle, half), how)
    conversion.warn(
        "bed_shape",
        "the bed is not a rectangle: its bounding box is used; keep parts off the missing corners",
    )
    return BedRectangle(low, high, "bounding box of a bed that is not a rectangle")


def _is_rectangle(points: list[_Point], low: _Point, high: _Point) -> bool:
    """Return whether an outline fills its bounding box."""
    edges = zip(points, points[1:] + points[:1], strict=True)
    area = abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in edges)) / 2
    box_area = (high[0] - low[0]) * (high[1] - low[1])
    return area >= 0.98 * box_area


def _shift_point(middle: _Point, distance: float) -> _Point:
    """Return a point moved by the same distance in x and y."""
    return round(middle[0] + distance, 3), round(middle[1] + distance, 3)


def _read_points(conversion: Conversion, theirs: str, text: str) -> list[_Point]:
    """Read the corners of an outline.

    Raises:
        ProfileError: a corner is invalid.
    """
    points = []
    for word in text.split(","):
        found = _POINT.fullmatch(word)
        if found is None:
            raise conversion.make_error(
                theirs,
                f"{word.strip()[:30]!r} is not a corner of the bed",
                "Write corners as 0x0,220x0,220x220,0x220",
            )
        points.append((float(found[1]), float(found[2])))
    return points


def find_excluded_areas(conversion: Conversion) -> list[str]:
    """Return the areas of the bed in which the source prints nothing, each as text for `printer.excluded_areas`.

    OrcaSlicer and Bambu Studio write the corners of several rectangles as one list, four by four.

    Raises:
        ProfileError: a corner is invalid.
    """
    areas: list[list[_Point]] = []
    for text in filter(str.strip, conversion.preset.read_raw("bed_exclude_area").split(";")):
        points = _read_points(conversion, "bed_exclude_area", text)
        fours = [points[at : at + 4] for at in range(0, len(points), 4)]
        areas += fours if all(map(_is_box, fours)) else [points]
    return [" ".join(f"{x:.10g}x{y:.10g}" for x, y in points) for points in areas if _has_area(points)]


def find_head_shapes(conversion: Conversion) -> list[str]:
    """Return the shapes of the print head, each as text for `printer.head`; empty if the source has none.

    PrusaSlicer has a radius around the nozzle, and the height of the gantry above it, which may be anywhere over the
    bed. OrcaSlicer has two heights: that of the rods along x, and that of the lid. Cura has a polygon and a height.

    Raises:
        ProfileError: a corner is invalid.
    """
    preset, prefix = conversion.preset, "extruder_clearance_"
    radius = preset.read_number(f"{prefix}radius") if preset.has(f"{prefix}radius") else 0.0
    outline = f"{radius:.10g}" if radius > 0 else ""
    if preset.has(f"{prefix}polygon"):
        points = _read_points(conversion, f"{prefix}polygon", preset.read_raw(f"{prefix}polygon"))
        if _has_area(points):
            outline = " ".join(f"{x:.10g}x{y:.10g}" for x, y in points)
            radius = max(abs(y) for _, y in points)
    if not outline:
        return []
    bar = f"-9999x-{radius:.10g} 9999x{radius:.10g}"
    everywhere = "-9999x-9999 9999x9999"
    above = {"height_to_rod": bar, "height_to_lid": everywhere, "height": everywhere}
    heights = {name: preset.read_number(prefix + name) for name in above if preset.has(prefix + name)}
    most = preset.read_number("max_print_height")
    gantry = [f"{value:.10g}: {above[name]}" for name, value in heights.items() if 0 < value < most]
    return [f"0: {outline}", *gantry]


def _has_area(points: list[_Point]) -> bool:
    """Return whether an outline has at least three corners and extends in x and y."""
    xs, ys = zip(*points, strict=True)
    return len(points) > 2 and min(max(xs) - min(xs), max(ys) - min(ys)) > 0


def _is_box(points: list[_Point]) -> bool:
    """Return whether an outline is a rectangle along the axes."""
    xs, ys = zip(*points, strict=True)
    return (
        len(points) == 4
        and _has_area(points)
        and _is_rectangle(points, (min(xs), min(ys)), (max(xs), max(ys)))
    )
