"""List all moves: for each path the moves to its start, then its extrusions."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, SmallInt
from printer_slicer.extrusion.wiping import Wipes, find_wipes
from printer_slicer.model import Toolpaths, Travels, find_travel_ends
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["APPROACH", "MoveKind", "MoveRows", "find_lowered_paths", "list_moves"]

APPROACH = 2.0  # mm above the first layer: height of the first travel
_SHORTEST_EXTRUSION = 0.003  # mm
_ROUNDING = 1e-6  # mm
_NEXT_ROW_WIDTHS = 1.5  # extrusion widths; distance up to which a travel leads to a neighbouring row
_RAMP_SLOPE = 3.0  # mm of travel per mm of a ramped lift


class MoveKind:
    """Kinds of moves, in the order in which they occur for each path."""

    RETRACT, WIPE, LIFT, TRAVEL, DROP, DERETRACT, BEAD = range(7)


_PULLS: Final = np.isin(np.arange(MoveKind.BEAD + 1), (MoveKind.RETRACT, MoveKind.WIPE, MoveKind.DERETRACT))


class MoveRows(Struct, frozen=True, eq=False):
    """All moves, without speeds; the last one retracts after the last path.

    Attributes:
        path: (K,) the path that each move belongs to or leads to.
        kind: (K,) `MoveKind` of each move.
        xyz: (K, 3) end position, mm.
        pulls: (R,) indices of the moves that move filament without extrusion.
        pulled: (R,) the filament that they move, mm; negative for retractions.
        begin: (B,) first points of the extrusions, as int32.
        end: (B,) last points of the extrusions, as int32.
    """

    path: Int
    kind: SmallInt
    xyz: Float
    pulls: Int
    pulled: Float
    begin: SmallInt
    end: SmallInt

    @property
    def is_bead(self) -> Bool:
        """Mask (K,) of the moves that extrude."""
        return np.asarray(self.kind == MoveKind.BEAD)


def list_moves(paths: Toolpaths, travels: Travels, profile: Profile) -> MoveRows:
    """List the moves that print paths in order."""
    lowered = find_lowered_paths(paths, profile)
    wipes = find_wipes(paths, travels, profile, np.append(False, lowered[:-1]))
    ends = _find_travel_ends(paths, travels, profile, lowered)
    count = _count_moves(paths, travels, wipes, ends)
    path = np.repeat(np.arange(paths.n_paths), count.sum(axis=1))
    kind = np.repeat(np.tile(np.arange(MoveKind.BEAD + 1, dtype=np.int8), paths.n_paths), count.ravel())
    begin, end = paths.ends_of_beads
    # A sudden change of width repeats a point, and G-code is written in steps of 1 µm.
    far = np.hypot(*(paths.xy.take(end, axis=0) - paths.xy.take(begin, axis=0)).T) > _SHORTEST_EXTRUSION
    kept = np.ones(len(path), np.bool_)
    kept[kind == MoveKind.BEAD] = far
    path, kind = path[kept], kind[kept]
    begin, end = (points.astype(np.int32)[far] for points in (begin, end))
    xyz = _compute_positions(paths, travels, wipes, ends, (path, kind, end))
    xyz = _move_retractions(xyz, kind)
    if profile.printer.z_hop_ramp:
        xyz = _turn_lifts_into_ramps(xyz, path, kind, travels)
    path, kind = np.append(path, path[-1]), np.append(kind, kind.dtype.type(MoveKind.RETRACT))
    return MoveRows(
        path, kind, np.concatenate([xyz, xyz[-1:]]), *_list_pulls(path, kind, wipes, profile), begin, end
    )


def find_lowered_paths(paths: Toolpaths, profile: Profile) -> Bool:
    """Return a mask (M,) of the paths that follow a surface; none without `quality.z_contouring`."""
    return paths.find_lowered() if profile.quality.z_contouring else np.zeros(paths.n_paths, np.bool_)


def _list_pulls(path: Int, kind: SmallInt, wipes: Wipes, profile: Profile) -> tuple[Int, Float]:
    """Return the moves (R,) that move filament without extrusion, and how much, mm; the last move retracts."""
    printer, pulls = profile.printer, np.flatnonzero(_PULLS[kind])
    own = kind[pulls]
    pulled = np.full(len(pulls), printer.retract_length + printer.deretract_extra)
    retracts = own == MoveKind.RETRACT
    pulled[retracts] = -wipes.standing[path[pulls[retracts]]]
    pulled[own == MoveKind.WIPE] = -wipes.moving
    pulled[-1] = -printer.retract_length
    return pulls, pulled


class _TravelEnds(Struct, frozen=True, eq=False):
    """Start, end and height of the travel to each path.

    Attributes:
        start: (M, 2) start of the travel, mm.
        end: (M, 2) end of the travel, mm.
        start_z: (M,) z at the start, mm.
        travel_z: (M,) z during the travel, mm.
        path_z: (M,) z at which the path starts, mm.
    """

    start: Float
    end: Float
    start_z: Float
    travel_z: Float
    path_z: Float


def _find_travel_ends(paths: Toolpaths, travels: Travels, profile: Profile, lowered: Bool) -> _TravelEnds:
    """Return start, end and heights of the travel to each path; `lowered` (M,) are those that follow a surface."""
    first, last = paths.start[:-1], paths.start[1:] - 1
    top = paths.z_top
    start, end = top + paths.z_offset[first], top + paths.z_offset[np.where(paths.closed, first, last)]
    leave = np.append(start[:1], end[:-1])
    hop = np.where(travels.retract, profile.printer.z_hop, 0.0)
    hop[:1] = APPROACH
    # A path that starts lower than the previous one ends is approached from above.
    begin_xy, end_xy = find_travel_ends(paths)
    travel_z = np.maximum(
        np.maximum(leave, start), _find_clear_heights(paths, lowered, begin_xy, end_xy, profile)
    )
    return _TravelEnds(begin_xy, end_xy, leave, travel_z + hop, start)


def _find_clear_heights(paths: Toolpaths, lowered: Bool, begin: Float, end: Float, profile: Profile) -> Float:
    """Return the z (M,) that the travel to each path must reach where paths follow a surface, mm; elsewhere -inf.

    Between its ends there may be extrusions as high as the layers. Only a step to the next row passes over none.

    Args:
        paths: in printing order.
        lowered: (M,) mask of the paths that follow a surface.
        begin: (M, 2) start of each travel, mm.
        end: (M, 2) its end, mm.
        profile: the extrusion width.
    """
    if not lowered.any():
        return np.full(paths.n_paths, -np.inf)
    before = np.append(0, np.arange(paths.n_paths - 1))
    is_far = np.hypot(*(end - begin).T) > _NEXT_ROW_WIDTHS * profile.extrusion_width
    top = np.maximum(paths.z_top, paths.z_top[before])
    return np.where((lowered | lowered[before]) & is_far, top, -np.inf)


def _count_moves(paths: Toolpaths, travels: Travels, wipes: Wipes, ends: _TravelEnds) -> Int:
    """Return the number (M, 7) of moves of each kind for each path."""
    first = np.arange(paths.n_paths) == 0
    count = np.zeros((paths.n_paths, MoveKind.BEAD + 1), np.int64)
    count[:, MoveKind.RETRACT] = travels.retract & (wipes.standing > 0)
    count[:, MoveKind.WIPE] = np.diff(wipes.start)
    count[:, MoveKind.LIFT] = (ends.travel_z - ends.start_z > _ROUNDING) & ~first
    moves = (ends.end != ends.start).any(axis=1) | (count[:, MoveKind.WIPE] > 0)
    count[:, MoveKind.TRAVEL] = moves | first
    count[:, MoveKind.TRAVEL] += np.diff(travels.start)
    count[:, MoveKind.DROP] = ends.travel_z - ends.path_z > _ROUNDING
    count[:, MoveKind.DERETRACT] = travels.retract
    count[:, MoveKind.BEAD] = paths.beads_of_each
    return count


def _compute_positions(
    paths: Toolpaths, travels: Travels, wipes: Wipes, ends: _TravelEnds, moves: tuple[Int, SmallInt, Int]
) -> Float:
    """Return the end position (K, 3) of each move, mm, given its path, its kind, and the last point of extrusions."""
    path, kind, end = moves
    top = paths.z_top
    xyz = np.zeros((len(path), 3))
    xyz[:, :2], xyz[:, 2] = ends.end[path], ends.path_z[path]
    stays = kind <= MoveKind.LIFT
    xyz[stays, :2] = ends.start[path[stays]]
    low = kind <= MoveKind.WIPE  # still at the height of the previous path
    xyz[low, 2] = ends.start_z[path[low]]
    xyz[kind == MoveKind.WIPE, :2] = wipes.xy
    lifted = (kind == MoveKind.LIFT) | (kind == MoveKind.TRAVEL)
    xyz[lifted, 2] = ends.travel_z[path[lifted]]
    wiped = np.flatnonzero((kind == MoveKind.LIFT) & (np.diff(wipes.start) > 0)[path])
    xyz[wiped, :2] = xyz[wiped - 1, :2]
    # All moves of a travel except the last one end at its waypoints.
    passing = (kind == MoveKind.TRAVEL) & (np.append(kind[1:], MoveKind.BEAD) == MoveKind.TRAVEL)
    passing &= np.append(path[1:], -1) == path
    xyz[passing, :2] = travels.xy
    is_bead = kind == MoveKind.BEAD
    xyz[is_bead, :2] = paths.xy.take(end, axis=0)
    xyz[is_bead, 2] = top[path[is_bead]] + paths.z_offset[end]
    return xyz


def _move_retractions(xyz: Float, kind: SmallInt) -> Float:
    """Move retractions to the actual nozzle position, which differs where a very short last extrusion is dropped."""
    pulls = np.flatnonzero(kind == MoveKind.RETRACT)
    pulls = pulls[pulls > 0]
    xyz[pulls] = xyz[pulls - 1]
    return xyz


def _turn_lifts_into_ramps(xyz: Float, path: Int, kind: SmallInt, travels: Travels) -> Float:
    """Change lifts into ramps: the nozzle rises during the travel."""
    lift = np.flatnonzero((kind == MoveKind.LIFT) & travels.retract[path])
    lift = lift[(lift > 0) & (lift + 1 < len(xyz))]
    delta = xyz[lift + 1, :2] - xyz[lift - 1, :2]
    far = np.hypot(*delta.T)
    rise = xyz[lift, 2] - xyz[lift - 1, 2]
    share = np.where(far > 0, np.minimum(_RAMP_SLOPE * rise / np.maximum(far, 1e-9), 0.5), 0.0)
    xyz[lift, :2] = xyz[lift - 1, :2] + delta * share[:, None]
    return xyz
