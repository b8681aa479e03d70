"""Wipe: retract filament while the nozzle moves over the end of the previous path."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.model import Toolpaths, Travels
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["Wipes", "find_wipes"]

_WIPE_SPEED_RATIO = 0.9  # fraction of the retraction speed that is used while wiping


class Wipes(Struct, frozen=True, eq=False):
    """Wipes before the travel to each path, over the end of the previous path.

    Attributes:
        xy: (W, 2) mm, points that the nozzle passes.
        start: (M + 1,) the wipe before path `i` passes `xy[start[i]:start[i + 1]]`, which may be empty.
        moving: (W,) mm of filament retracted on the move to each point.
        standing: (M,) mm of filament retracted before the wipe, while the nozzle stands still.
    """

    xy: Float
    start: Int
    moving: Float
    standing: Float


def find_wipes(paths: Toolpaths, travels: Travels, profile: Profile, after_lowered: Bool) -> Wipes:
    """Return the wipes before all paths: backward over open paths, forward along loops.

    There are none after paths that follow a surface, because the nozzle would enter their higher parts: `after_lowered`
    (M,) is the mask of the paths after these.
    """
    printer = profile.printer
    n = paths.n_paths
    standing = np.where(travels.retract, printer.retract_length, 0.0)
    wiped = np.flatnonzero(travels.retract & ~after_lowered)
    if not printer.wipe_distance or not len(wiped):
        return Wipes(np.zeros((0, 2)), np.zeros(n + 1, np.int64), np.zeros(0), standing)
    over = wiped - 1
    size = np.diff(paths.start)[over]
    # List the points of each path in the order of the wipe; loops return to their first point.
    step = consecutive(np.zeros_like(size), size + paths.closed[over])
    owner = np.repeat(np.arange(len(over)), size + paths.closed[over])
    first, loops = paths.start[:-1][over][owner], paths.closed[over][owner]
    point = first + np.where(loops, step % size[owner], size[owner] - 1 - step)
    xy = paths.xy.take(point, axis=0)
    far = np.hypot(*(xy - np.roll(xy, 1, axis=0)).T)
    far[step == 0] = 0.0
    walked = np.cumsum(far)
    walked -= walked[np.flatnonzero(step == 0)][owner]
    reach = np.minimum(printer.wipe_distance, walked[np.append(np.flatnonzero(step == 0)[1:], len(step)) - 1])
    used = (step > 0) & (walked - far < reach[owner] - 1e-9) & (far > 0)
    over_shot = np.maximum(walked - reach[owner], 0.0)[used]
    owner, length = owner[used], far[used] - over_shot
    back = (xy[np.flatnonzero(used) - 1] - xy[used]) / far[used][:, None]
    count = np.zeros(n, np.int64)
    count[wiped] = np.bincount(owner, minlength=len(over))
    speed = profile.speeds.travel
    total = np.minimum(
        printer.retract_length,
        _WIPE_SPEED_RATIO * printer.retract_speed * reach / min(speed, printer.max_speed_x),
    )
    standing[wiped] -= np.where(count[wiped] > 0, total, 0.0)
    return Wipes(
        xy[used] + back * over_shot[:, None],
        np.append(0, np.cumsum(count)),
        total[owner] * length / np.maximum(reach[owner], 1e-9),
        np.where(standing > 1e-6, standing, 0.0),
    )
