"""Lower the parts of paths that lie under shallow upper surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct
from printer_slicer.contouring.infill_direction import print_from_low_to_high
from printer_slicer.contouring.surface_heights import FacetBins, LayerPoints
from printer_slicer.contouring.tops import find_steepest_slopes
from printer_slicer.contouring.z_profiles import (
    Positions,
    fill_short_dips,
    find_needed_points,
    limit_changes,
    smooth,
)
from printer_slicer.model import Toolpaths
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import Struct, replace

__all__ = ["contour", "find_contoured_paths"]

_SPACING: Final = 0.25  # mm, maximum distance of the points at which the height of the surface is found
_COARSE_SPACING: Final = 0.5  # mm, of the points at which surfaces are searched for
_LEAST_DEPTH: Final = 0.01  # mm; paths that are nowhere lower than their layer by this much stay flat
_ROUNDING: Final = 1e-9  # mm
_HIGHER: Final = 1e-3  # mm
_POINTS_AT_ONCE: Final = 1 << 18  # bounds the memory for points of paths that are not contoured
_CONTOURED_ROLES: Final = (
    Role.EXTERNAL_PERIMETER,
    Role.PERIMETER,
    Role.SOLID_INFILL,
    Role.TOP_SOLID_INFILL,
    Role.IRONING,
)


class _FinePoints(Struct, frozen=True, eq=False):
    """Points of paths at most a given distance apart.

    Attributes:
        start: (M + 1,) index of the first point of each path.
        corner: (N,) index of the point of the path, or of the one before an added point.
        share: (N,) position between this point and the next one, 0 to 1.
        xy: (N, 2) mm.
    """

    start: Int
    corner: Int
    share: Float
    xy: Float

    @classmethod
    def of(cls, paths: Toolpaths, spacing: float) -> _FinePoints:
        """Add points to all lines of paths, at most `spacing` mm apart."""
        step = paths.xy.take(paths.following, axis=0) - paths.xy
        count = np.maximum(np.ceil(np.hypot(*step.T) / spacing), 1).astype(np.int64)
        corner = np.repeat(np.arange(len(count)), count)
        share = consecutive(np.zeros_like(count), count) / count.take(corner)
        xy = paths.xy.take(corner, axis=0) + share[:, None] * step.take(corner, axis=0)
        return cls(np.append(0, np.cumsum(count))[paths.start], corner, share, xy)

    @property
    def owner(self) -> Int:
        """Path (N,) of each point."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


def find_contoured_paths(paths: Toolpaths, bins: FacetBins) -> Bool:
    """Return a mask (M,) of the paths that may be contoured: those that come near a shallow upper surface."""
    result = np.zeros(paths.n_paths, np.bool_)
    candidates = np.flatnonzero(_may_be_contoured(paths, bins))
    for batch in _split_by_length(paths.take(candidates)):
        some = paths.take(candidates[batch])
        fine = _FinePoints.of(some, _COARSE_SPACING)
        owner = fine.owner
        found = bins.find_bins(fine.xy, some.layer[owner]) >= 0
        result[candidates[batch]] = np.bincount(owner[found], minlength=some.n_paths) > 0
    return result


def _split_by_length(paths: Toolpaths) -> Iterator[Int]:
    """Yield batches of paths with a limited number of points, unless one path has more."""
    points = np.cumsum(paths.length() / _COARSE_SPACING + np.diff(paths.start))
    batch = (points / _POINTS_AT_ONCE).astype(np.int64)
    for number in distinct(batch):
        yield np.flatnonzero(batch == number)


def _may_be_contoured(paths: Toolpaths, bins: FacetBins) -> Bool:
    """Return a mask (M,) of the paths whose role, layer and height allow contouring."""
    tops, plan = bins.tops, paths.plan
    has_tops = np.zeros(plan.n_layers, np.bool_)
    has_tops[tops.layer] = True
    result = np.isin(paths.role, _CONTOURED_ROLES) & has_tops[paths.layer]
    result &= paths.height < plan.height[paths.layer] + _HIGHER  # not several layers high
    result &= paths.z_top - paths.height > tops.base + SAME_TOP
    result[np.repeat(np.arange(paths.n_paths), np.diff(paths.start))[paths.z_offset != 0]] = False
    return np.asarray(result)


def contour(paths: Toolpaths, bins: FacetBins, profile: Profile) -> Toolpaths:
    """Lower paths to the shallow upper surfaces above them, and reduce their flow accordingly.

    The top of an extrusion becomes the surface at its centre line, but its height is at least
    `quality.contour_min_height`. Along a path, z changes by at most 20°, and it returns to the top of the layer before
    the contoured surface ends. Paths that would change little keep their points and are flat.

    Args:
        paths: in printing order; rows of infill that climb are printed from low to high afterwards.
        bins: the surfaces.
        profile: rules of contouring.
    """
    chosen = np.flatnonzero(find_contoured_paths(paths, bins))
    if not len(chosen):
        return paths
    some = paths.take(chosen)
    fine = _FinePoints.of(some, _SPACING)
    positions = Positions.from_steps(_measure_steps(fine, some.closed), fine.start, some.closed)
    z = _find_offsets(some, fine, positions, bins, profile)
    is_lowered = np.minimum.reduceat(z, fine.start[:-1]) < -_LEAST_DEPTH
    if not is_lowered.any():
        return paths
    kept = find_needed_points(z, positions, fine.share == 0) & is_lowered[fine.owner]
    return print_from_low_to_high(_replace_points(paths, chosen, fine, kept, z))


def _measure_steps(fine: _FinePoints, closed: Bool) -> Float:
    """Return the distance (N,) of each point to the next one, mm; 0 at the ends of open paths."""
    following = np.arange(1, len(fine.xy) + 1)
    first, last = fine.start[:-1], fine.start[1:] - 1
    following[last] = np.where(closed, first, last)
    return np.asarray(np.hypot(*(fine.xy[following] - fine.xy).T))


def _full_heights(paths: Toolpaths) -> Float:
    """Return the height (M,) to which the layer of each path is filled, mm; ironing is thinner than its layer."""
    return np.where(paths.role == Role.IRONING, paths.plan.height[paths.layer], paths.height)


def _find_offsets(
    paths: Toolpaths, fine: _FinePoints, positions: Positions, bins: FacetBins, profile: Profile
) -> Float:
    """Return the z (N,) of the nozzle over each point, mm from the top of its path."""
    owner, full = fine.owner, _full_heights(paths)
    top = paths.z_top[owner]
    bottom = top - full[owner]
    points = LayerPoints(fine.xy, paths.layer[owner], bottom, top, find_steepest_slopes(full, profile)[owner])
    surface = bins.find_heights(points)
    lowest = np.minimum(bottom + profile.quality.contour_min_height, top)
    covered = np.flatnonzero(np.isfinite(surface))
    z = np.zeros(len(surface))
    z[covered] = np.minimum(np.maximum(surface, lowest) - top, 0.0)[covered]
    z[covered] = np.minimum(smooth(z, positions, covered), 0.0)
    z = limit_changes(z, positions)
    return fill_short_dips(np.where(z > -_ROUNDING, 0.0, z), positions, profile.printer.nozzle_flat)


def _replace_points(paths: Toolpaths, chosen: Int, fine: _FinePoints, kept: Bool, z: Float) -> Toolpaths:
    """Give paths their new points, z and flow.

    Args:
        paths: all paths.
        chosen: (m,) the paths to which the points belong.
        fine: points of these.
        kept: (N,) which points to use; those of paths without any stay as they are.
        z: (N,) mm from the top of the path.
    """
    size = np.diff(paths.start)
    n_kept = np.bincount(fine.owner[kept], minlength=len(chosen))
    changed = chosen[n_kept > 0]
    count = size.copy()
    count[changed] = n_kept[n_kept > 0]
    start = np.append(0, np.cumsum(count))
    source = np.zeros(int(start[-1]), np.int64)
    new = consecutive(start[changed], n_kept[n_kept > 0])
    is_old = np.ones(len(source), np.bool_)
    is_old[new] = False
    rest = np.ones(paths.n_paths, np.bool_)
    rest[changed] = False
    source[is_old] = consecutive(paths.start[:-1][rest], size[rest])
    corner = consecutive(paths.start[chosen], size[chosen])[fine.corner[kept]]
    source[new] = corner
    made = paths.of_points(source, start, np.arange(paths.n_paths))
    width, z_offset, flow = made.width.copy(), made.z_offset.copy(), made.flow_ratio.copy()
    xy, share = made.xy.copy(), fine.share[kept]
    xy[new] = fine.xy[kept]
    width[new] += share * (paths.width[paths.following[corner]] - width[new])
    owner = chosen[fine.owner[kept]]
    z_offset[new] = z[kept]
    flow[new] = _flow_ratios(paths, owner, width[new], z[kept])
    return replace(made, xy=xy, width=width, z_offset=z_offset, flow_ratio=flow)


def _flow_ratios(paths: Toolpaths, owner: Int, width: Float, z: Float) -> Float:
    """Return the flow ratio (n,) at points of paths `owner` (n,): local cross-section / full one; ironing keeps 1."""
    full = paths.height[owner]
    ratio = bead.cross_section(width, full + z) / bead.cross_section(width, full)
    return np.where(paths.role[owner] == Role.IRONING, 1.0, ratio)
