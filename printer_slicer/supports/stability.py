"""Check that each bead of supports lies on something; put columns under the others or remove them."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import Areas, contain_points, find_enclosing_rings, split_connected, union
from printer_slicer.model import LayerPlan, Overhangs, Sections, Supports, Toolpaths
from printer_slicer.profile import Profile, Quality
from printer_slicer.roles import Role
from printer_slicer.supports.added_columns import add_columns, find_contact_areas, find_needed_paths
from printer_slicer.supports.bead_samples import BeadSamples, find_repeated_layers, sample_beads
from printer_slicer.supports.blocked_areas import find_blocked_areas
from printer_slicer.supports.unsupported_beads import (
    SpanRules,
    find_carried_beads,
    keep_samples,
    remove_unsupported,
)
from printer_slicer.values import Struct, replace

__all__ = ["StableSupports", "check_stability", "drop_areas_without_beads", "lean_columns"]

_ROUNDS: Final = 2  # of upright columns under unsupported beads, and then of leaning ones
_NEAR_GAP: Final = 0.2  # mm beside layers of the part that end just below or begin just above
_AREAS: Final = ("base", "interface", "floor", "joists", "hollow")


class _CarriedBeads(Struct, frozen=True, eq=False):
    """Supports with columns under unsupported beads, before what still hangs is removed.

    Attributes:
        supports: areas by support layer.
        paths: the beads.
        suspect: (S,) layers in which beads may hang.
        cut: (n, 3) places of short ends that were removed before, mm.
        complete: whether nothing hangs that an overhang needs.
    """

    supports: Supports
    paths: Toolpaths
    suspect: Bool
    cut: Float
    complete: bool


class StableSupports(Struct, frozen=True, eq=False):
    """Supports whose beads all lie on something.

    Attributes:
        supports: areas by support layer.
        paths: the beads.
        removed: (n, 3) places of beads that were removed because nothing was below them, mm.
        carried: with what was removed, if columns were added.
    """

    supports: Supports
    paths: Toolpaths
    removed: Float
    carried: _CarriedBeads | None = None


def check_stability(
    supports: Supports,
    paths: Toolpaths,
    overhangs: Overhangs,
    sections: Sections,
    profile: Profile,
) -> StableSupports:
    """Return supports in which each bead lies on the bed, on the part or on supported beads.

    A bead stands if about half of its width lies on something over most of its length. Lines may span the distance
    between two rows or joists. Beads that hang get columns of their own if something needs them. They are taken out if
    nothing needs them, or if there is no place for a column. If all beads stand, the same values are returned.

    Args:
        supports: areas by support layer.
        paths: their beads, on the layers of supports.
        overhangs: areas that need supports.
        sections: the part, all objects.
        profile: gaps and spacings of supports.
    """
    cut = np.zeros((0, 3))
    if not paths.n_paths:
        return StableSupports(supports, paths, cut)
    rules = SpanRules.of(sections, paths.plan, profile.quality)
    samples = sample_beads(paths, ~find_repeated_layers(paths))
    carried, every = find_carried_beads(samples, paths, rules), slice(0, samples.count)
    hanging = rules.find_unsupported(samples, paths, every, carried)
    if not hanging.any():
        return StableSupports(supports, paths, cut)
    suspect = np.isin(np.arange(paths.plan.n_layers), paths.layer[samples.path[hanging]])
    column_rules = rules.for_columns()
    large = column_rules.find_unsupported(samples, paths, every, carried)
    if not large.any():
        cut = _list_places(samples, paths, hanging)
        paths, suspect = keep_samples(samples, paths, ~hanging), np.append(False, suspect[:-1])
        samples, large = _find_unsupported(paths, column_rules, suspect)
    if large.any():
        above = np.arange(paths.plan.n_layers) >= paths.layer[samples.path[large]].min()
        before = _CarriedBeads(supports, paths, suspect, cut, complete=False)
        return _remove_hanging(
            _carry(before, above, (overhangs, sections, profile), column_rules, leans=False), rules
        )
    rest, removed = _remove(paths, rules, suspect)
    all_removed = np.concatenate([cut, removed])
    if len(removed):
        supports = _drop_empty_areas(supports, rest, all_removed)
    return StableSupports(supports, rest, all_removed)


def lean_columns(
    standing: StableSupports, overhangs: Overhangs, sections: Sections, profile: Profile
) -> StableSupports:
    """Return supports with columns that lean beside steep slopes, where upright ones do not stand.

    Args:
        standing: result of `check_stability` for the other arguments; the same is returned if nothing leans.
        overhangs: areas that need supports.
        sections: the part, all objects.
        profile: gaps and spacings of supports.
    """
    carried = standing.carried
    if carried is None or carried.complete:
        return standing
    rules = SpanRules.of(sections, carried.paths.plan, profile.quality)
    case = overhangs, sections, profile
    return _remove_hanging(_carry(carried, carried.suspect, case, rules.for_columns(), leans=True), rules)


def _remove_hanging(carried: _CarriedBeads, rules: SpanRules) -> StableSupports:
    """Return the supports without the beads that still hang."""
    paths, removed = _remove(carried.paths, rules, carried.suspect)
    all_removed = np.concatenate([carried.cut, removed])
    supports = _drop_empty_areas(carried.supports, paths, all_removed)
    return StableSupports(supports, paths, all_removed, carried)


def _find_unsupported(paths: Toolpaths, rules: SpanRules, suspect: Bool) -> tuple[BeadSamples, Bool]:
    """Return samples of the beads in the layers of a mask (S,) and in those below them, and which (n,) are unsupported.

    In all other layers, all beads stand.
    """
    samples = sample_beads(paths, suspect | np.append(suspect[1:], False))
    carried = find_carried_beads(samples, paths, rules, suspect)
    return samples, rules.find_unsupported(samples, paths, slice(0, samples.count), carried)


def _remove(paths: Toolpaths, rules: SpanRules, suspect: Bool) -> tuple[Toolpaths, Float]:
    """Return the supported beads, and the places (n, 3) of those that were removed, mm.

    Only beads in the layers of a mask (S,) can hang.
    """
    removed = [np.zeros((0, 3))]
    while paths.n_paths:
        samples, hanging = _find_unsupported(paths, rules, suspect)
        if not hanging.any():
            break
        kept = remove_unsupported(samples, paths, hanging, rules)
        removed.append(_list_places(samples, paths, ~kept))
        suspect = np.isin(np.arange(paths.plan.n_layers), paths.layer[samples.path[~kept]])
        suspect[1:] |= suspect[:-1].copy()
        paths = keep_samples(samples, paths, kept)
    return paths, np.concatenate(removed)


def _list_places(samples: BeadSamples, paths: Toolpaths, some: Bool) -> Float:
    """Return the places (k, 3) of the samples of a mask (n,), mm."""
    which = np.flatnonzero(some)
    return np.column_stack([samples.points(which), paths.z_top[samples.path[which]]])


def _carry(
    before: _CarriedBeads,
    suspect: Bool,
    made_for: tuple[Overhangs, Sections, Profile],
    rules: SpanRules,
    *,
    leans: bool,
) -> _CarriedBeads:
    """Put columns under unsupported beads that are needed.

    Beads hang only in layers of a mask (S,).
    """
    overhangs, sections, profile = made_for
    supports, paths, layers = before.supports, before.paths, before.supports.plan.layers
    blocked, complete = None, False
    for _ in range(_ROUNDS):
        samples, hanging = _find_unsupported(paths, rules, suspect)
        kept = remove_unsupported(samples, paths, hanging, rules)
        lost = np.zeros(layers.n_layers, np.bool_)
        lost[paths.layer[samples.path[~kept]]] = True
        contacts = find_contact_areas(overhangs, supports.plan, lost)
        hanging &= find_needed_paths(samples, paths, kept, contacts)[samples.path]
        complete = not hanging.any()
        if complete:
            break
        blocked = blocked or _find_blocked(sections, layers, profile.quality)
        made = add_columns(samples, paths, hanging, blocked, rules, leans=leans)
        if not made.paths.n_paths:
            break  # the next round would be the same
        paths = Toolpaths.joined(layers, [_cut_replaced(paths, made.replaced), made.paths])
        supports = replace(supports, base=union(supports.base, made.area))
        suspect = suspect | np.isin(np.arange(layers.n_layers), made.paths.layer)
    return _CarriedBeads(supports, paths, before.suspect | suspect, before.cut, complete)


def _cut_replaced(paths: Toolpaths, replaced: Areas) -> Toolpaths:
    """Return the paths of bases without what lies in areas by support layer."""
    if not replaced.n_rings:
        return paths
    samples = sample_beads(paths, replaced.used)
    layer = paths.layer[samples.path]
    inside = contain_points(replaced, samples.points(np.arange(samples.count)), layer)
    inside &= paths.role[samples.path] == Role.SUPPORT
    return keep_samples(samples, paths, ~inside) if inside.any() else paths


def _find_blocked(sections: Sections, layers: LayerPlan, quality: Quality) -> Areas:
    """Return the areas by support layer in which no column may be."""
    xy_gap, gaps = quality.support_xy_gap, (quality.support_bottom_gap, quality.support_gap)
    blocked = find_blocked_areas(sections, layers, xy_gap, gaps, min(xy_gap, _NEAR_GAP))
    if not quality.support_on_bed_only:
        return blocked
    below = np.searchsorted(sections.plan.top, layers.bottom, side="right").tolist()
    shadow, shadows, first = Areas.empty(1), list[Areas](), 0
    for layer, last in enumerate(below):
        for k in range(first, last):
            shadow = union(shadow, sections.solid.copy_layers(np.array([k])))
        first = max(first, last)
        shadows.append(shadow.on_layers(np.array([layer]), layers.n_layers))
    return union(blocked, Areas.concatenate(shadows, layers.n_layers))


def _drop_empty_areas(supports: Supports, paths: Toolpaths, removed: Float) -> Supports:
    """Return supports without connected areas whose beads were all removed."""
    if not len(removed):
        return supports
    lost = supports.plan.layers.find_tops(removed[:, 2])
    order = np.argsort(lost, kind="stable")
    return _drop_areas(supports, paths, (removed[order, :2], lost[order]))


def drop_areas_without_beads(supports: Supports, paths: Toolpaths) -> Supports:
    """Return supports without connected areas in which no bead lies."""
    return _drop_areas(supports, paths, None)


def _drop_areas(supports: Supports, paths: Toolpaths, removed: tuple[Float, Int] | None) -> Supports:
    """Return supports without connected areas in which no bead lies, but only those with removed beads if given.

    Args:
        supports: areas by support layer.
        paths: the beads.
        removed: places (n, 2) of beads that were removed, mm, and the layer (n,) of each, ascending.
    """
    changed = np.full(supports.plan.layers.n_layers, removed is None)
    if removed:
        changed[removed[1]] = True
    rest, at = np.zeros((0, 2)), np.zeros(0, np.int64)
    if changed[paths.layer].any():
        samples = sample_beads(paths, changed)
        rest, at = samples.points(np.arange(samples.count)), paths.layer[samples.path]
    kept = {}
    for name in _AREAS:
        areas = getattr(supports, name)
        own = areas.of_layers(changed)
        pieces = split_connected(own)
        if not pieces.count:
            continue
        of_ring = np.append(pieces.of_ring, -1)
        empty = np.full(pieces.count + 1, removed is None)
        if removed:
            empty[of_ring[find_enclosing_rings(own, *removed)]] = True
        empty[of_ring[find_enclosing_rings(own, rest, at)]] = False
        keep = ~changed[areas.ring_layer]
        keep[changed[areas.ring_layer]] = ~empty[pieces.of_ring]
        kept[name] = keep
    less = {name: getattr(supports, name).select(keep) for name, keep in kept.items()}
    if "interface" in kept:
        less["interface_angle"] = supports.interface_angle[kept["interface"]]
    return replace(supports, **less)
