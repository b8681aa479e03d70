"""Toolpaths -> Toolpaths: inner perimeters of several layers in one bead, where these do not change.

The outermost bead gives the surface and stays as thin as its layer; what lies behind it only has to fill. Sources:
Sabourin, Houser & Bohn, Accurate exterior, fast interior layered manufacturing, 1997; Ma & He, An adaptive slicing and
selective hatching strategy for layered manufacturing, 1999.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Int, numbered
from printer_slicer.geometry import Areas, Pieces, rings_around
from printer_slicer.grouping import area_savings, divide, last_layers, within
from printer_slicer.model import LayerPlan, Regions, Sections, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.thick_walls.bands import SAME_PLACE, Bands, bands_of, common
from printer_slicer.thick_walls.stretches import Spans, cut, spans_between, spans_within

__all__ = ["SAME_PLACE", "thickened"]

_SLIVER = 0.5  # mm; less of a path beside another one's stretch is not cut out of it
_EQUAL = 0.05  # by how much the layers of a stretch may differ in length


def thickened(
    paths: Toolpaths, sections: Sections, regions: Regions, profile: Profile
) -> tuple[Toolpaths, Int | None]:
    """The perimeters, with the inner ones of several layers as one bead where these are in the same place.

    Layers are printed together in groups up to `quality.inner_perimeters_every` high, the same groups as for sparse
    infill. What of the inner perimeters is in one place on all layers of a group is laid on the last of them, with as
    much plastic; the rest on its own layer. So are the first layer, what hangs over air, what nothing lies on, and
    what bridges end on in the midst of a group.

    Args:
        paths: the perimeters, with what is carried of them.
        sections: of the part.
        regions: what is inside the perimeters.
        profile: how high beads may be.

    Returns:
        The paths, and (L,) the first layer of the group of each layer; None where nothing is printed together.
    """
    plan, limit = paths.plan, min(profile.quality.inner_perimeters_every, profile.highest_bead)
    lowest = within(plan, limit)
    inner = paths.role == Role.INNER_PERIMETER
    if (lowest == np.arange(plan.n_layers)).all() or not inner.any():
        return paths, None
    bands = bands_of(paths.take(np.flatnonzero(inner)), sections, regions, profile.extrusion_width)
    groups = _groups(bands, plan, lowest, regions.sparse, profile)
    inner &= np.bincount(groups, minlength=plan.n_layers)[groups[paths.layer]] > 1
    some = paths.take(np.flatnonzero(inner))
    stretches, piece = _stretches(some, common(bands, groups), groups)
    touched = np.isin(np.arange(some.n_paths), stretches.path)
    parts = [
        paths.take(np.flatnonzero(~inner)),
        some.take(np.flatnonzero(~touched)),
        cut(some, spans_between(some, stretches)),
        _as_one(cut(some, stretches), piece, groups),
    ]
    return Toolpaths.joined(plan, parts), groups


def _groups(bands: Bands, plan: LayerPlan, lowest: Int, sparse: Areas, profile: Profile) -> Int:
    """(L,) the first layer of each one's group: what saves most of perimeters and sparse infill together, mm."""
    quality = profile.quality
    of_infill = area_savings(sparse, within(plan, min(quality.sparse_every, profile.highest_bead)))
    of_infill *= quality.infill_density / profile.extrusion_width
    saved = bands.savings(lowest)
    several = np.zeros((max(len(saved), len(of_infill)), plan.n_layers))
    several[: len(saved)] += saved
    several[: len(of_infill)] += of_infill
    return divide(several)


def _stretches(some: Toolpaths, pieces: Pieces, groups: Int) -> tuple[Spans, Int]:
    """What of the paths, all in groups of layers, is laid together; and (S,) the piece that each stretch lies in."""
    last = last_layers(groups)
    area = pieces.on_layers(len(groups), np.arange(pieces.count))
    spans = spans_within(some, area.for_each(last), _SLIVER)
    made = cut(some, spans)
    size = np.diff(made.start)
    middle = made.xy[made.start[:-1] + size // 2 - 1] + made.xy[made.start[:-1] + size // 2]
    ring = rings_around(area, middle / 2, last[made.layer])
    piece = np.append(pieces.areas.ring_layer, -1)[ring]
    good = np.flatnonzero(np.append(_alike(made, piece, pieces.count, groups), False)[piece])
    return spans.take(good), piece[good]


def _alike(made: Toolpaths, piece: Int, count: int, groups: Int) -> Bool:
    """(count,) which pieces hold a stretch as long and as wide on every layer of their group, and wide enough.

    Args:
        made: stretches.
        piece: (M,) of each of them; -1 for none.
        count: how many pieces there are.
        groups: (L,) the first layer of the group of each layer.
    """
    plan, known = made.plan, np.flatnonzero(piece >= 0)
    if not len(known):
        return np.zeros(count, np.bool_)
    made, piece = made.take(known), piece[known]
    spacing = bead.spacing(made.width, np.repeat(made.height, np.diff(made.start)))
    long = made.length()
    least, most = np.full((4, count), np.inf), np.full((4, count), -np.inf)
    low, high = (ends.reduceat(spacing, made.start[:-1]) for ends in (np.minimum, np.maximum))
    for row, values in enumerate((made.area() / long, low, high)):
        np.minimum.at(least[row], piece, values)
        np.maximum.at(most[row], piece, values)
    # Layers of one group follow each other.
    where, number = numbered(piece * plan.n_layers + made.layer)
    on_layer, owner = np.bincount(number, long), where // plan.n_layers
    np.minimum.at(least[3], owner, on_layer)
    np.maximum.at(most[3], owner, on_layer)
    first = np.zeros(count, np.int64)
    first[piece] = groups[made.layer]
    last = last_layers(groups)[first]
    everywhere = np.bincount(owner, minlength=count) == last - first + 1
    thick = plan.top[last] - plan.bottom[first]
    even = (most[:3] - least[:3] <= SAME_PLACE).all(axis=0)
    even &= most[3] - least[3] <= _EQUAL * most[3] + _SLIVER
    return np.asarray(everywhere & even & (bead.width_for_spacing(least[1], thick) >= thick))


def _as_one(made: Toolpaths, piece: Int, groups: Int) -> Toolpaths:
    """Of the stretches in each piece (M,) those on the last layer, with the plastic of all."""
    plan = made.plan
    laid = np.bincount(piece, made.area() * made.height)
    kept = np.flatnonzero(made.layer == last_layers(groups)[made.layer])
    made, piece = made.take(kept), piece[kept]
    size = np.diff(made.start)
    height = np.round(plan.top[made.layer] - plan.bottom[groups[made.layer]], 7)
    more = laid / np.maximum(np.bincount(piece, made.area() * height, minlength=len(laid)), 1e-12)
    own, high = np.repeat(made.height, size), np.repeat(height, size)
    width = bead.width_for_spacing(bead.spacing(made.width, own) * np.repeat(more[piece], size), high)
    return replace(made, height=height, width=np.maximum(np.round(width, 4), high))
