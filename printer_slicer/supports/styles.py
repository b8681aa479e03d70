"""Make supports in the style of the settings, or in the cheaper style for each group of overhangs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import (
    Overhangs,
    Sections,
    SupportPlan,
    Supports,
    Toolpaths,
    UnsupportedPlace,
    fill_layers,
)
from printer_slicer.profile import Profile
from printer_slicer.supports.columns import make_columns
from printer_slicer.supports.edge_rows import add_edge_rows
from printer_slicer.supports.patch_groups import PatchGroups, group_patches
from printer_slicer.supports.remaining_overhangs import find_remaining_overhangs
from printer_slicer.supports.stability import (
    StableSupports,
    check_stability,
    drop_areas_without_beads,
    lean_columns,
)
from printer_slicer.supports.stacking import make_obstacles
from printer_slicer.supports.support_layers import list_places_without_room
from printer_slicer.supports.support_paths import make_support_paths
from printer_slicer.supports.unsupported_places import (
    UnsupportedReasons,
    explain_no_way,
    list_unsupported_places,
)
from printer_slicer.values import Struct, replace

__all__ = ["STYLES", "GroupTimes", "PrintedSupports", "make_supports", "measure_path_volume"]

Style = Callable[[Overhangs, SupportPlan, Sections, Profile], Supports]

GroupTimes = Callable[[Toolpaths, Int, int, Profile], Float]
"""Function that returns the print time of each group (G,), s, from paths (M,), their groups (M,), G and the profile."""


def _grow_trees(overhangs: Overhangs, plan: SupportPlan, sections: Sections, profile: Profile) -> Supports:
    """Return trees; see `grow_trees`."""
    from printer_slicer.supports.trees import grow_trees  # noqa: PLC0415 - columns need none of its modules

    return grow_trees(overhangs, plan, sections, profile)


STYLES: Final[dict[str, Style]] = {"columns": make_columns, "tree": _grow_trees}
"""Function for each style; `auto` uses the cheaper one for each group of overhangs."""

_Case = tuple[Overhangs, SupportPlan, Sections, Profile]

_ADDED_STYLES: Final = ("tree", "columns")  # tried in this order for places that others leave unsupported

_MIN_GAIN: Final = 0.02  # of the cost, for which it is worth making supports again
_MAX_DIVISIONS: Final = 2  # of the groups into those with columns and with trees that are tried
_MIN_UNSUPPORTED_AREA: Final = 1.0  # mm² of a place for which other supports are tried
_MAX_ADDED_MINUTES: Final = 0.7  # for each mm² of an unsupported place; dearer supports are not added
_UNSUPPORTED_MINUTES: Final = 2.0  # cost of an unsupported place of this area, and of each smaller one
_UNSUPPORTED_AREA: Final = 6.0  # mm²
_ISLAND_MINUTES: Final = 100.0  # cost of an unsupported island


class PrintedSupports(Struct, frozen=True, eq=False):
    """Supports and their paths.

    Attributes:
        supports: the areas.
        paths: on the layers of `supports.plan`.
    """

    supports: Supports
    paths: Toolpaths


def make_supports(
    overhangs: Overhangs,
    plan: SupportPlan,
    sections: Sections,
    profile: Profile,
    measure_times: GroupTimes,
) -> PrintedSupports:
    """Return supports for overhangs, and their paths.

    Args:
        overhangs: areas that need supports; at least one patch.
        plan: the layers of supports.
        sections: all that supports must avoid.
        profile: style and other settings of supports.
        measure_times: print time of paths; only `auto` needs it.
    """
    style, case = profile.quality.support, (overhangs, plan, sections, profile)
    if style in STYLES:
        return _complete([_make(style, *case)], case, measure_times)
    return _choose_styles(*case, measure_times)


def _complete(made: Sequence[PrintedSupports], case: _Case, measure_times: GroupTimes) -> PrintedSupports:
    """Return the supports that stand, and others for the places that these leave unsupported.

    Branches reach some places where no column can stand, and columns some that no branch can reach. Places whose
    supports would cost too much stay unsupported.
    """
    printed = _remove_unsupported(made, *case)
    for style in _ADDED_STYLES:
        if not any(_is_worth_support(place) for place in printed.supports.unsupported):
            break
        own = drop_areas_without_beads(printed.supports, printed.paths)
        more = _support_places(style, replace(printed, supports=own), case, measure_times)
        if more is None:
            continue
        both = _remove_unsupported([PrintedSupports(own, printed.paths), more], *case)
        gain = _MIN_UNSUPPORTED_AREA / 2
        if (_count_islands(both), _measure_unsupported(both) + gain) < (
            _count_islands(printed),
            _measure_unsupported(printed),
        ):
            printed = both
    return printed


def _support_places(
    style: str, printed: PrintedSupports, case: _Case, measure_times: GroupTimes
) -> PrintedSupports | None:
    """Return supports of a style for the places that others leave unsupported; None if they cost too much."""
    overhangs, plan, sections, profile = case
    rest = find_remaining_overhangs(overhangs, printed.paths, profile)
    beside = fill_layers([sections, make_obstacles(printed.supports)])
    more = _make(style, rest, plan, beside, profile)
    if not more.paths.n_paths:
        return None
    groups = group_patches(rest, more.supports)
    price = _Prices(groups, profile, measure_times)
    is_worth = price.of(more) < _rate_places(printed.supports.unsupported, groups)
    if is_worth.all() or not is_worth.any():
        return more if is_worth.any() else None
    return _make(style, rest.take_patches(is_worth[groups.of_patch]), plan, beside, profile)


def _rate_places(places: Sequence[UnsupportedPlace], groups: PatchGroups) -> Float:
    """Return the highest acceptable cost (G,) of supports for the places in each group, min."""
    at = groups.find(np.array([(place.x, place.y) for place in places]).reshape(-1, 2))
    worth = [_ISLAND_MINUTES if place.is_island else _MAX_ADDED_MINUTES * place.area for place in places]
    return np.asarray(np.bincount(at, worth, groups.count))


def _remove_unsupported(
    made: Sequence[PrintedSupports],
    overhangs: Overhangs,
    plan: SupportPlan,
    sections: Sections,
    profile: Profile,
) -> PrintedSupports:
    """Return all supports without their unsupported beads, and with the unsupported places of overhangs.

    Columns lean only if that leaves less unsupported, because they take much more material.
    """
    supports = Supports.joined(plan, [one.supports for one in made])
    paths = made[0].paths if len(made) == 1 else Toolpaths.joined(plan.layers, [one.paths for one in made])
    known = (*supports.unsupported, *list_places_without_room(overhangs, plan))

    def compare(standing: StableSupports) -> PrintedSupports:
        """Return the supports that stand, with the unsupported places."""
        no_way = explain_no_way(on_bed_only=profile.quality.support_on_bed_only)
        reasons = UnsupportedReasons(known, standing.removed, no_way)
        bare = list_unsupported_places(overhangs, standing.paths, sections, profile, reasons)
        return PrintedSupports(replace(standing.supports, unsupported=bare), standing.paths)

    standing = check_stability(supports, paths, overhangs, sections, profile)
    upright = compare(standing)
    if _measure_unsupported(upright) < _UNSUPPORTED_AREA:
        return upright
    leaning = lean_columns(standing, overhangs, sections, profile)
    return upright if leaning is standing else min(upright, compare(leaning), key=_measure_unsupported)


def _is_worth_support(place: UnsupportedPlace) -> bool:
    """Return whether other supports are tried for a place."""
    return place.is_island or place.area >= _MIN_UNSUPPORTED_AREA


def _count_islands(made: PrintedSupports) -> int:
    """Return the number of islands without support."""
    return sum(place.is_island for place in made.supports.unsupported)


def _measure_unsupported(made: PrintedSupports) -> float:
    """Return the area of all places without support, mm²."""
    return sum(place.area for place in made.supports.unsupported)


def measure_path_volume(paths: Toolpaths) -> float:
    """Return the volume of paths, mm³, at a flow ratio of 1."""
    return float(_measure_volumes(paths).sum())


def _measure_volumes(paths: Toolpaths) -> Float:
    """Return the volume (M,) of each path, mm³."""
    if not paths.n_paths:
        return np.zeros(0)
    width = paths.width[paths.start[:-1]]  # the same along each path
    return np.asarray(paths.length() * bead.cross_section(width, paths.height))


def _make(
    style: str, overhangs: Overhangs, plan: SupportPlan, sections: Sections, profile: Profile
) -> PrintedSupports:
    """Return supports of one style."""
    supports = STYLES[style](overhangs, plan, sections, profile)
    paths = make_support_paths(supports, profile)
    if not supports.hollow.n_rings:
        paths = add_edge_rows(supports, paths, overhangs, profile)
    return PrintedSupports(supports, paths)


def _choose_styles(
    overhangs: Overhangs,
    plan: SupportPlan,
    sections: Sections,
    profile: Profile,
    measure_times: GroupTimes,
) -> PrintedSupports:
    """Return the cheapest of columns, trees, and both: columns for some groups, and trees that avoid them.

    Trees are first grown for all groups in which they may be cheaper, then only where they were. Groups in which places
    are bare because their supports did not stand, or did not come near enough, get the other style if that costs less.
    """
    columns = _make("columns", overhangs, plan, sections, profile)
    groups = group_patches(overhangs, columns.supports)
    price = _Prices(groups, profile, measure_times)
    cost = price.of(columns)
    from printer_slicer.supports.tree_costs import estimate_least_tree_costs  # noqa: PLC0415

    least = estimate_least_tree_costs(columns.supports, columns.paths, groups, profile)
    gets_tree, lowest, best = least < cost, cost.sum(), [columns]
    case, has_tree = (overhangs, plan, sections, profile), np.zeros(groups.count, np.bool_)
    for _ in range(_MAX_DIVISIONS):
        if not gets_tree.any():
            break
        made = _make_both(gets_tree[groups.of_patch], overhangs, plan, sections, profile)
        found = np.sum([price.of(one) for one in made], axis=0)
        if found.sum() < lowest:
            lowest, best, has_tree = found.sum(), made, gets_tree.copy()
        if np.minimum(found, cost).sum() > (1 - _MIN_GAIN) * lowest:
            break
        gets_tree &= found < cost
    printed = _complete(best, case, measure_times)
    lost = price.of_unsupported(printed) > price.of_unsupported(*best)
    if not lost.any():
        return printed
    gets_tree = has_tree ^ lost
    made = _make_both(gets_tree[groups.of_patch], *case) if gets_tree.any() else [columns]
    other = _complete(made, case, measure_times)
    return min(printed, other, key=lambda one: float(price.of(one).sum()))


def _make_both(
    gets_tree: Bool, overhangs: Overhangs, plan: SupportPlan, sections: Sections, profile: Profile
) -> list[PrintedSupports]:
    """Return columns for some patches, and trees, which avoid them, for those in a mask (n_patches,)."""
    if gets_tree.all():
        return [_make("tree", overhangs, plan, sections, profile)]
    columns = _make("columns", overhangs.take_patches(~gets_tree), plan, sections, profile)
    obstacles = fill_layers([sections, make_obstacles(columns.supports)])
    return [columns, _make("tree", overhangs.take_patches(gets_tree), plan, obstacles, profile)]


class _Prices(Struct, frozen=True, eq=False):
    """The cost of supports: the print time, and the price of their filament, min.

    Attributes:
        groups: of patches.
        profile: price of filament.
        measure_times: print time of paths.
    """

    groups: PatchGroups
    profile: Profile
    measure_times: GroupTimes

    def of(self, made: PrintedSupports) -> Float:
        """Return the cost (G,) of the supports of each group; places without support are expensive."""
        paths, n = made.paths, self.groups.count
        group = self.groups.find(paths.xy[paths.start[:-1]])
        seconds = self.measure_times(paths, group, n, self.profile)
        grams = _measure_volumes(paths) * self.profile.material.density / 1000
        cost = seconds / 60 + self.profile.quality.support_minutes_per_gram * np.bincount(group, grams, n)
        return np.asarray(cost + self.of_unsupported(made))

    def of_unsupported(self, *made: PrintedSupports) -> Float:
        """Return the part (G,) of the cost that is due to places without support, of all supports together."""
        bare = [place for one in made for place in one.supports.unsupported]
        at = self.groups.find(np.array([(place.x, place.y) for place in bare]).reshape(-1, 2))
        prices = [_price_unsupported_place(place) for place in bare]
        return np.asarray(np.bincount(at, prices, self.groups.count))


def _price_unsupported_place(place: UnsupportedPlace) -> float:
    """Return the cost of a place without support, min."""
    if place.is_island:
        return _ISLAND_MINUTES
    return _UNSUPPORTED_MINUTES * max(place.area / _UNSUPPORTED_AREA, 1.0)
