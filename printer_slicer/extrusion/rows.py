"""Which moves there are: for each path those that lead to it, then its beads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.extrusion.wiping import Wipes, wipes_of
from printer_slicer.model import Toolpaths, Travels, leaves
from printer_slicer.profile import Profile

__all__ = ["APPROACH", "Kind", "MoveRows", "rows_of"]

APPROACH = 2.0  # mm over the first layer at which the nozzle arrives: nothing is dragged over the bed
_SHORTEST = 0.003  # mm, of a bead
_LEVEL = 1e-6  # mm
_RAMP = 3.0  # mm of way per mm of a ramped lift


class Kind:
    """What a move is for, in the order in which a path has them."""

    RETRACT, WIPE, LIFT, TRAVEL, DROP, DERETRACT, BEAD = range(7)


@dataclass(frozen=True, slots=True, eq=False)
class MoveRows:
    """The moves before they have numbers; the last one retracts after the last path.

    Attributes:
        path: (K,) the path each move belongs to or leads to.
        kind: (K,) a `Kind` each.
        xyz: (K, 3) where it ends.
        pulled: (K,) filament of the moves that lay no bead, mm.
        begin: (B,) points at which the beads begin.
        end: (B,) points at which they end.
    """

    path: Int
    kind: Int
    xyz: Float
    pulled: Float
    begin: Int
    end: Int

    @property
    def is_bead(self) -> Bool:
        """(K,) which moves lay a bead."""
        return np.asarray(self.kind == Kind.BEAD)

    @property
    def bead_path(self) -> Int:
        """(B,) the path of each bead."""
        return self.path[self.is_bead]

    def spread(self, values: Float) -> Float:
        """(K,) values (B,) of the beads at their moves; 0 at the others."""
        result = np.zeros(len(self.path))
        result[self.is_bead] = values
        return result


def rows_of(paths: Toolpaths, travels: Travels, profile: Profile) -> MoveRows:
    """The moves that print paths in order."""
    wipes = wipes_of(paths, travels, profile)
    ways = _ways(paths, travels, profile)
    count = _counts(paths, travels, wipes, ways)
    path = np.repeat(np.arange(paths.n_paths), count.sum(axis=1))
    kind = np.repeat(np.tile(np.arange(Kind.BEAD + 1), paths.n_paths), count.ravel())
    begin, end = paths.ends_of_beads
    # Where a bead's width changes at once, the same point stands twice; and files are written in steps of 1 µm.
    far = np.hypot(*(paths.xy.take(end, axis=0) - paths.xy.take(begin, axis=0)).T) > _SHORTEST
    kept = np.ones(len(path), np.bool_)
    kept[kind == Kind.BEAD] = far
    path, kind, begin, end = path[kept], kind[kept], begin[far], end[far]
    xyz = _positions(paths, travels, wipes, ways, (path, kind, end))
    xyz = _standing(xyz, kind)
    if profile.printer.z_hop_ramp:
        xyz = _ramped(xyz, path, kind, travels)
    pulled = np.zeros(len(path))
    pulled[kind == Kind.RETRACT] = -wipes.standing[path[kind == Kind.RETRACT]]
    pulled[kind == Kind.WIPE] = -wipes.moving
    printer = profile.printer
    pulled[kind == Kind.DERETRACT] = printer.retract_length + printer.deretract_extra
    return MoveRows(
        np.append(path, path[-1]),
        np.append(kind, Kind.RETRACT),
        np.concatenate([xyz, xyz[-1:]]),
        np.append(pulled, -printer.retract_length),
        begin,
        end,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """How the nozzle comes to each path.

    Attributes:
        leave, begin: (M, 2) mm, where the way begins and ends.
        low, travelled, high: (M,) z at which it begins, at which the nozzle travels, and at which the path begins.
    """

    leave: Float
    begin: Float
    low: Float
    travelled: Float
    high: Float


def _ways(paths: Toolpaths, travels: Travels, profile: Profile) -> _Ways:
    first, last = paths.start[:-1], paths.start[1:] - 1
    top = paths.z_top
    begin, end = top + paths.z_offset[first], top + paths.z_offset[np.where(paths.closed, first, last)]
    leave = np.append(begin[:1], end[:-1])
    hop = np.where(travels.retract, profile.printer.z_hop, 0.0)
    hop[:1] = APPROACH
    # What begins lower than the bead before ends is reached from above: nothing is dragged through that bead.
    return _Ways(*leaves(paths), leave, np.maximum(leave, begin) + hop, begin)


def _counts(paths: Toolpaths, travels: Travels, wipes: Wipes, ways: _Ways) -> Int:
    """(M, 7) how many moves of each kind lead to or make each path."""
    first = np.arange(paths.n_paths) == 0
    count = np.zeros((paths.n_paths, Kind.BEAD + 1), np.int64)
    count[:, Kind.RETRACT] = travels.retract & (wipes.standing > 0)
    count[:, Kind.WIPE] = np.diff(wipes.start)
    count[:, Kind.LIFT] = (ways.travelled - ways.low > _LEVEL) & ~first
    moves = (ways.begin != ways.leave).any(axis=1) | (count[:, Kind.WIPE] > 0)
    count[:, Kind.TRAVEL] = moves | first
    count[:, Kind.TRAVEL] += np.diff(travels.start)
    count[:, Kind.DROP] = ways.travelled - ways.high > _LEVEL
    count[:, Kind.DERETRACT] = travels.retract
    count[:, Kind.BEAD] = paths.beads_of_each
    return count


def _positions(
    paths: Toolpaths, travels: Travels, wipes: Wipes, ways: _Ways, moves: tuple[Int, Int, Int]
) -> Float:
    """(K, 3) where moves end: their path, kind, and for beads the point at which they end."""
    path, kind, end = moves
    top = paths.z_top
    xyz = np.zeros((len(path), 3))
    xyz[:, :2], xyz[:, 2] = ways.begin[path], ways.high[path]
    stays = kind <= Kind.LIFT
    xyz[stays, :2] = ways.leave[path[stays]]
    low = kind <= Kind.WIPE  # still at the height of the path before
    xyz[low, 2] = ways.low[path[low]]
    xyz[kind == Kind.WIPE, :2] = wipes.xy
    lifted = (kind == Kind.LIFT) | (kind == Kind.TRAVEL)
    xyz[lifted, 2] = ways.travelled[path[lifted]]
    wiped = np.flatnonzero((kind == Kind.LIFT) & (np.diff(wipes.start) > 0)[path])
    xyz[wiped, :2] = xyz[wiped - 1, :2]
    # All travels of a way but the last one end at the points that it passes.
    passing = (kind == Kind.TRAVEL) & (np.append(kind[1:], Kind.BEAD) == Kind.TRAVEL)
    passing &= np.append(path[1:], -1) == path
    xyz[passing, :2] = travels.xy
    is_bead = kind == Kind.BEAD
    xyz[is_bead, :2] = paths.xy.take(end, axis=0)
    xyz[is_bead, 2] = top[path[is_bead]] + paths.z_offset[end]
    return xyz


def _standing(xyz: Float, kind: Int) -> Float:
    """The same with retractions where the nozzle is: a last bead too short to be laid does not lead there."""
    pulls = np.flatnonzero(kind == Kind.RETRACT)
    pulls = pulls[pulls > 0]
    xyz[pulls] = xyz[pulls - 1]
    return xyz


def _ramped(xyz: Float, path: Int, kind: Int, travels: Travels) -> Float:
    """The same with lifts to hop on the way: the nozzle rises while it already travels."""
    lift = np.flatnonzero((kind == Kind.LIFT) & travels.retract[path])
    lift = lift[(lift > 0) & (lift + 1 < len(xyz))]
    way = xyz[lift + 1, :2] - xyz[lift - 1, :2]
    far = np.hypot(*way.T)
    rise = xyz[lift, 2] - xyz[lift - 1, 2]
    share = np.where(far > 0, np.minimum(_RAMP * rise / np.maximum(far, 1e-9), 0.5), 0.0)
    xyz[lift, :2] = xyz[lift - 1, :2] + way * share[:, None]
    return xyz
