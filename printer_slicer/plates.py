"""Arrange parts on few plates, so that they stand apart on the bed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import ceil, hypot
from types import NoneType
from typing import Final

import numpy as np

from printer_slicer.adhesion import measure_reach as measure_adhesion
from printer_slicer.adhesion import measure_spacing
from printer_slicer.arguments import check_argument, check_arguments
from printer_slicer.arranging import Arrangement, FreeArea, arrange_outlines
from printer_slicer.arrays import Float
from printer_slicer.errors import PartError, UsageError
from printer_slicer.excluded_areas import read_excluded_areas
from printer_slicer.geometry import Areas, convex_hull, offset, simplify
from printer_slicer.geometry.vectors import cosine_and_sine
from printer_slicer.model import Mesh
from printer_slicer.placing import join, transform
from printer_slicer.profile import Profile
from printer_slicer.profile.object_profiles import (
    list_overridden_objects,
    list_support_styles,
    make_profile_for_object,
)
from printer_slicer.surface.top_view import project_from_above

__all__ = ["PART_GAP", "arrange", "choose_gap", "find_motion", "find_places", "make_plates", "measure_room"]

PART_GAP: Final = 6.0
"""Smallest distance between arranged parts by default, mm."""

_MAX_POINTS: Final = 500  # of outlines that are not simplified
_SLACK: Final = 1e-6  # mm
_TOLERANCE: Final = 0.05  # mm; larger outlines are enlarged by this, then simplified within it


@check_arguments(profile=Profile, gap=(float, int, NoneType))
def arrange(meshes: Sequence[Mesh], profile: Profile, *, gap: float | None = None) -> tuple[Mesh, ...]:
    """Arrange parts on few plates.

    Parts are rotated about z and moved. A part may stand in a hole of another part, but not below an overhang of it. If
    the profile has a brim, a raft or supports, `gap` is the distance between these. The same parts always get the same
    places.

        for plate in ps.arrange(parts, profile):
            job = ps.job_of(plate, profile, placement=ps.Placement(as_placed=True))

    Args:
        meshes: the parts; for copies, the same mesh several times.
        profile: gives the bed, and the width of brim, raft and supports.
        gap: smallest distance between parts seen from above, mm; None: 6 mm, or what the print head needs if the parts
            are printed one after the other.

    Returns:
        One mesh for each plate, at its position on the bed; the parts are its objects.

    Raises:
        UsageError: there is no part, or the gap is negative.
        PartError: a part does not fit the bed.
    """
    check_argument("meshes", meshes, (list, tuple))
    for mesh in meshes:
        check_argument("meshes", mesh, Mesh)
    if not meshes:
        raise UsageError("no part to arrange", remedy="Pass at least one part")
    gap = choose_gap(meshes, profile) if gap is None else gap
    if not 0 <= gap < np.inf:
        raise UsageError(f"gap {gap}: must be 0 mm or more", remedy="Choose a distance such as 6")
    return make_plates(meshes, find_places(meshes, profile, gap))


def choose_gap(meshes: Sequence[Mesh], profile: Profile) -> float:
    """Return the smallest distance between arranged parts if none is given, mm.

    Parts that are printed one after the other are so far apart that the head, whichever way it is turned, does not
    reach from one to another. Shapes that extend over the whole bed do not count, because no distance helps there.
    """
    if profile.quality.print_order == "by_layer" or len(meshes) < 2:
        return PART_GAP
    printer, height = profile.printer, max(_measure_top(mesh, profile) for mesh in meshes)
    widest = max(printer.bed_x, printer.bed_y)
    reach = [max(hypot(x, y) for x, y in one.corners) for one in printer.head_shapes if one.height < height]
    longest = max((value for value in reach if value < widest), default=0.0)
    return max(PART_GAP, ceil(10 * (longest + _measure_reach_of_nozzle(profile))) / 10)


def _measure_reach_of_nozzle(profile: Profile) -> float:
    """Return how far nozzle and material may be outside the outlines of two parts together, mm.

    Of the first part, only its material counts; of the other, also travels around its corners.
    """
    from printer_slicer.travels import measure_detour_reach  # noqa: PLC0415 - only sequential printing needs it

    return 2 * max(profile.quality.xy_compensation, 0.0) + measure_detour_reach(profile)


def find_places(meshes: Sequence[Mesh], profile: Profile, gap: float = PART_GAP) -> Arrangement:
    """Find a place for each part; arguments as for `arrange`.

    Raises:
        PartError: a part does not fit the print volume.
    """
    for mesh in meshes:
        _check_height(mesh, profile)
    known = {id(mesh): mesh for mesh in meshes}
    rooms = {key: measure_room(mesh, profile) for key, mesh in known.items()}
    by_object = profile.quality.print_order == "by_object" and len(meshes) > 1
    outline_of = {key: _find_outline(mesh, rooms[key], is_convex=by_object) for key, mesh in known.items()}
    low, high = map(np.array, profile.printer.free_corners)
    bed = FreeArea(low, high, read_excluded_areas(profile.printer))
    names = [f"{mesh.name}: the part{_name_surroundings(rooms[id(mesh)], profile)}" for mesh in meshes]
    remedy = "Choose a larger printer, or scale the part"
    remedy += ", or print it without brim, raft or supports" if any(rooms.values()) else ""
    outlines = [outline_of[id(mesh)] for mesh in meshes]
    spacing = min(max(gap, measure_spacing(profile)), hypot(*bed.size.tolist()))  # at most the bed's diagonal
    tall = _find_parts_above_gantry(meshes, profile)
    arrangement = arrange_outlines(outlines, names, bed, spacing, one_per_plate=tall, remedy=remedy)
    above_bars = _find_parts_above_bars(meshes, outlines, arrangement, profile)
    if not above_bars:
        return arrangement
    return arrange_outlines(outlines, names, bed, spacing, one_per_plate=tall | above_bars, remedy=remedy)


def _find_parts_above_gantry(meshes: Sequence[Mesh], profile: Profile) -> frozenset[int]:
    """Return the indices of parts that are higher than a shape of the head that is as large as the bed.

    If parts are printed one after the other, such a part must be the last of its plate.
    """
    printer = profile.printer
    if profile.quality.print_order == "by_layer":
        return frozenset()
    reach, lowest = max(printer.bed_x, printer.bed_y), np.inf
    for shape in printer.head_shapes:
        corners = np.array(shape.corners)
        if (corners.min(axis=0) <= -reach).all() and (corners.max(axis=0) >= reach).all():
            lowest = min(lowest, shape.height)
    return frozenset(at for at, mesh in enumerate(meshes) if _measure_top(mesh, profile) > lowest)


def _measure_top(mesh: Mesh, profile: Profile) -> float:
    """Return the height of a part with its raft, mm."""
    quality = profile.quality
    return float(mesh.size[2]) + (quality.raft_height + quality.raft_gap if quality.raft_height else 0.0)


def _find_parts_above_bars(
    meshes: Sequence[Mesh], outlines: Sequence[Areas], arrangement: Arrangement, profile: Profile
) -> frozenset[int]:
    """Return the indices of parts that are higher than a bar of the head and not in rows along it.

    A bar is a shape that is as long as the bed in x or in y only. If parts are printed one after the other, those that
    are higher must be farther apart across the bar than it reaches.
    """
    printer, found = profile.printer, set[int]()
    if profile.quality.print_order == "by_layer":
        return frozenset()
    longest = max(printer.bed_x, printer.bed_y)
    for shape in printer.head_shapes:
        corners = np.array(shape.corners)
        is_long = (corners.min(axis=0) <= -longest) & (corners.max(axis=0) >= longest)
        if is_long.sum() != 1:
            continue
        across = int(is_long.argmin())
        tall = [
            at
            for at, mesh in enumerate(meshes)
            if _measure_top(mesh, profile) > shape.height and outlines[at].n_rings
        ]
        spans = {at: _measure_span(outlines[at], arrangement, at, across) for at in tall}
        for a, b in combinations(tall, 2):
            distance = max(spans[a][0] - spans[b][1], spans[b][0] - spans[a][1])
            needed = np.abs(corners[:, across]).max() + _measure_reach_of_nozzle(profile)
            if arrangement.plate[a] == arrangement.plate[b] and distance < needed:
                found |= set(tall)
    return frozenset(found)


def _measure_span(outline: Areas, arrangement: Arrangement, part: int, axis: int) -> tuple[float, float]:
    """Return the lowest and the highest x (axis 0) or y (axis 1) of a part at its place, mm."""
    c, s = cosine_and_sine(float(arrangement.angle[part]))
    values = outline.xy @ np.array([[c, -s], [s, c]])[axis] + arrangement.shift[part, axis]
    return float(values.min()), float(values.max())


def _name_surroundings(room: float, profile: Profile) -> str:
    """Return what surrounds a part within its room, mm, such as ` with its brim and supports`."""
    has = {
        "brim": profile.quality.brim_width > 0,
        "raft": profile.quality.raft_height > 0,
        "supports": room > measure_adhesion(profile),
    }
    return f" with its {' and '.join(name for name, is_there in has.items() if is_there)}" if room else ""


def measure_room(mesh: Mesh, profile: Profile) -> float:
    """Return the width of the strip around the outline of a part that its supports, brim and raft need, mm."""
    names = {mesh.name, *(item.name for item in mesh.objects)}
    own = make_profile_for_object(profile, names) if list_overridden_objects(profile) else profile
    room = measure_adhesion(profile)
    if list_support_styles(profile) != {"off"}:
        from printer_slicer.supports.reach import measure_reach  # noqa: PLC0415 - most parts have no supports

        room += measure_reach(mesh, own)
    return room


def _find_outline(mesh: Mesh, around: float, *, is_convex: bool) -> Areas:
    """Return the outline of a part seen from above, wider by `around` mm.

    With `is_convex`, it is the convex hull, as the nozzle is assumed to go anywhere in it.
    """
    outline = project_from_above(mesh)
    if is_convex and outline.n_rings:
        outline = convex_hull(outline.xy)
    if len(outline.xy) > _MAX_POINTS:
        outline = simplify(offset(outline, _TOLERANCE, join="round"), _TOLERANCE)
    return offset(outline, around, join="round") if around else outline


def make_plates(meshes: Sequence[Mesh], arrangement: Arrangement, *, drop: bool = True) -> tuple[Mesh, ...]:
    """Rotate and move parts to their places, and join the parts of each plate.

    Args:
        meshes: the parts.
        arrangement: their places.
        drop: whether each part is moved down or up onto z = 0; otherwise it keeps its z.
    """
    moved = [_move_part(mesh, arrangement, part, drop=drop) for part, mesh in enumerate(meshes)]
    plates = [np.flatnonzero(arrangement.plate == plate) for plate in range(arrangement.n_plates)]
    return tuple(join([moved[part] for part in parts.tolist()]) for parts in plates)


def _move_part(mesh: Mesh, arrangement: Arrangement, part: int, *, drop: bool) -> Mesh:
    """Return a part at its place on the bed."""
    turned = transform(mesh, rotate=(0.0, 0.0, float(arrangement.angle[part])))
    return turned.moved(find_motion(mesh, arrangement, part, drop=drop)[1])


def find_motion(mesh: Mesh, arrangement: Arrangement, part: int, *, drop: bool = True) -> tuple[Float, Float]:
    """Return the rotation (3, 3), for column vectors, and the shift (3,), mm, that move a part to its place.

    Args:
        mesh: the part.
        arrangement: the places of all parts.
        part: its index.
        drop: whether it is moved onto z = 0.
    """
    c, s = cosine_and_sine(float(arrangement.angle[part]))
    x, y = arrangement.shift[part].tolist()
    z = -float(mesh.bounds[0, 2]) if drop else 0.0
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, z])


def _check_height(mesh: Mesh, profile: Profile) -> None:
    """Check that a part is not higher than the print volume.

    Raises:
        PartError: it is.
    """
    height, most = float(mesh.size[2]), profile.printer.bed_z
    if height > most + _SLACK:
        raise PartError(
            f"{mesh.name}: the part is {height - most:.3g} mm too high for {profile.printer.name!r}, which prints "
            f"up to {most:g} mm",
            remedy="Choose a larger printer, or scale or rotate the part",
        )
