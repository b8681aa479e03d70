"""Lower the parts of paths that lie under shallow upper surfaces."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.contouring.fine_points import FinePoints, split_by_length
from printer_slicer.contouring.infill_direction import print_from_low_to_high
from printer_slicer.contouring.loop_starts import start_narrow_loops_low
from printer_slicer.contouring.surface_heights import FacetBins, LayerPoints, are_uncovered
from printer_slicer.contouring.tops import BESIDE_RATIO, LEVEL_REACH
from printer_slicer.contouring.z_profiles import (
    Positions,
    fill_short_dips,
    find_edges_of_dips,
    find_needed_points,
    limit_changes,
    smooth,
)
from printer_slicer.geometry import contain_points
from printer_slicer.model import ContourRule, Sections, Toolpaths
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["contour", "find_contoured_paths", "find_paths_near"]

_SPACING: Final = 0.25  # mm, maximum distance of the points at which the height of the surface is found
_COARSE_SPACING: Final = 0.5  # mm, of the points at which surfaces are searched for
_MIN_DEPTH: Final = 0.01  # mm; paths that are nowhere lower than their layer by this much stay flat
_SIDE: Final = 0.45  # widths of an extrusion from its centre to its sides, as far as these are looked at
_ROUNDING: Final = 1e-9  # mm
_HIGHER: Final = 1e-3  # mm
_CONTOURED_ROLES: Final = (
    Role.EXTERNAL_PERIMETER,
    Role.PERIMETER,
    Role.SOLID_INFILL,
    Role.TOP_SOLID_INFILL,
    Role.IRONING,
)


def find_contoured_paths(paths: Toolpaths, bins: FacetBins) -> Bool:
    """Return a mask (M,) of the paths that may be contoured: those that come near a shallow upper surface."""
    return find_paths_near(paths, np.flatnonzero(_may_be_contoured(paths, bins)), bins)


def find_paths_near(paths: Toolpaths, candidates: Int, bins: FacetBins) -> Bool:
    """Return a mask (M,) of those of some paths (n,) that come near a surface that extrusions follow."""
    result = np.zeros(paths.n_paths, np.bool_)
    for batch in split_by_length(paths, candidates, _COARSE_SPACING):
        some = paths.take(batch)
        fine = FinePoints.of(some, _COARSE_SPACING)
        owner = fine.owner
        near = bins.are_near_followed(fine.xy, some.layer[owner])
        result[batch] = np.bincount(owner[near], minlength=len(batch)) > 0
    return result


def _may_be_contoured(paths: Toolpaths, bins: FacetBins) -> Bool:
    """Return a mask (M,) of the paths whose role, layer and height allow contouring."""
    tops, plan = bins.tops, paths.plan
    result = np.isin(paths.role, _CONTOURED_ROLES) & tops.is_contoured[paths.layer]
    result &= paths.height < plan.height[paths.layer] + _HIGHER  # not several layers high
    result &= paths.z_top - paths.height > tops.base + SAME_TOP
    result[paths.path_of_point[paths.z_offset != 0]] = False
    return np.asarray(result)


def contour(paths: Toolpaths, bins: FacetBins, sections: Sections, rule: ContourRule) -> Toolpaths:
    """Lower paths to the shallow upper surfaces above them, and reduce their flow accordingly.

    The top of an extrusion becomes the surface at its centre line, but its height is at least
    `min_height` of the rule. Along a path, z changes by at most 20°, and it returns to the top of the layer before
    the contoured surface ends. Paths that would change little keep their points and are flat.

    Args:
        paths: in printing order; rows of infill that climb are printed from low to high afterwards, and loops around
            narrow places begin with their lower side.
        bins: the surfaces.
        sections: of all printed layers; surfaces under the next layer are not followed.
        rule: of contouring.
    """
    chosen = np.flatnonzero(find_contoured_paths(paths, bins))
    if not len(chosen):
        return paths
    some = paths.take(chosen)
    fine = FinePoints.of(some, _SPACING)
    positions = Positions.from_steps(_measure_steps(fine, some.closed), fine.start, some.closed)
    z = _find_offsets(some, fine, positions, (bins, sections), rule)
    is_lowered = np.minimum.reduceat(z, fine.start[:-1]) < -_MIN_DEPTH
    if not is_lowered.any():
        return paths
    kept = find_needed_points(z, positions, (fine.share == 0) | find_edges_of_dips(z, fine.start))
    kept &= is_lowered[fine.owner]
    lowered = _replace_points(paths, chosen, fine, kept, z)
    return print_from_low_to_high(start_narrow_loops_low(lowered, rule.nozzle_flat))


def _measure_steps(fine: FinePoints, closed: Bool) -> Float:
    """Return the distance (N,) of each point to the next one, mm; 0 at the ends of open paths."""
    following = np.arange(1, len(fine.xy) + 1)
    first, last = fine.start[:-1], fine.start[1:] - 1
    following[last] = np.where(closed, first, last)
    return np.asarray(np.hypot(*(fine.xy[following] - fine.xy).T))


def _full_heights(paths: Toolpaths) -> Float:
    """Return the height (M,) to which the layer of each path is filled, mm; ironing is thinner than its layer."""
    return np.where(paths.role == Role.IRONING, paths.plan.height[paths.layer], paths.height)


def _find_offsets(
    paths: Toolpaths,
    fine: FinePoints,
    positions: Positions,
    part: tuple[FacetBins, Sections],
    rule: ContourRule,
) -> Float:
    """Return the z (N,) of the nozzle over each point, mm from the top of its path."""
    bins, sections = part
    owner, full = fine.owner, _full_heights(paths)
    top = paths.z_top[owner]
    bottom = top - full[owner]
    points = LayerPoints(fine.xy, paths.layer[owner], bottom, top, rule.find_max_slopes(full)[owner])
    facet = bins.find_facets(points)
    covered = np.flatnonzero(facet >= 0)
    covered = covered[are_uncovered(points.take(covered), bins, sections)]
    covered = covered[~bins.tops.are_level(fine.xy[covered], points.layer[covered], LEVEL_REACH)]
    sides = fine.find_sides(paths, _SIDE)[covered]
    covered = covered[_is_clear_beside(points.take(covered), facet[covered], sides, part, rule)]
    surface = bins.measure_heights(fine.xy[covered], facet[covered])
    lowest = np.minimum(bottom + rule.min_height, top)[covered]
    z = np.zeros(len(top))
    z[covered] = np.minimum(np.maximum(surface, lowest) - top[covered], 0.0)
    z[covered] = np.minimum(smooth(z, positions, covered), 0.0)
    z = limit_changes(z, positions)
    return fill_short_dips(np.where(z > -_ROUNDING, 0.0, z), positions, rule.nozzle_flat)


def _is_clear_beside(
    points: LayerPoints, facet: Int, side: Float, part: tuple[FacetBins, Sections], rule: ContourRule
) -> Bool:
    """Return at which points (N,) the surface goes on to both sides of an extrusion, over its width.

    An extrusion is level across its width. So beside a much steeper surface it would leave a hole if it were lower than
    its layer. Where the surface leaves the layer, and outside the part, there is nothing to be filled.

    Args:
        points: centres of extrusions.
        facet: (N,) the surface at each of them.
        side: (N, 2) vectors to their left sides, mm.
        part: all surfaces, and the sections of all printed layers.
        rule: minimum height of extrusions.
    """
    bins, sections = part
    result = np.ones(len(facet), np.bool_)
    for xy in (points.xy - side, points.xy + side):
        z = bins.measure_heights(xy, facet)
        is_inside = (z > points.bottom + rule.min_height) & (z < points.top - _MIN_DEPTH)
        beside = replace(points, xy=xy, steepest=BESIDE_RATIO * points.steepest)
        some = np.flatnonzero(is_inside)
        some = some[bins.find_facets(beside.take(some)) < 0]
        some = some[np.argsort(points.layer[some], kind="stable")]
        result[some[contain_points(sections.solid, xy[some], points.layer[some])]] = False
    return result


def _replace_points(paths: Toolpaths, chosen: Int, fine: FinePoints, kept: Bool, z: Float) -> Toolpaths:
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
    flow[new] = _flow_ratios(paths, owner, z[kept])
    return replace(made, xy=xy, width=width, z_offset=z_offset, flow_ratio=flow)


def _flow_ratios(paths: Toolpaths, owner: Int, z: Float) -> Float:
    """Return the flow ratio (n,) at points of paths `owner` (n,): local height / full one; ironing keeps 1.

    The spacing of the paths stays that of full height, so their volume is proportional to their height.
    """
    ratio = 1 + z / paths.height[owner]
    return np.where(paths.role[owner] == Role.IRONING, 1.0, ratio)
