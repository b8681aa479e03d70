"""Measure the supports of one file against the part, on the extrusions of the file.

All distances are on a grid of 0.1 mm. A support extrusion is a level body between its bottom and its top.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy import ndimage, sparse

from benchmarks.support_beads import SupportFile, draw_beads, support_seconds
from benchmarks.support_carriers import TOUCHES, Carriers, SupportLayer, list_layers
from benchmarks.support_solid import Island, Overhang, Solid
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.deposition.marks import Purpose

__all__ = ["Figures", "Flat", "Place", "measure_supports"]

_SIDEWAYS, _BELOW = 1.5, 0.85  # mm; an overhang with a support as near as this is held
_MIN_CARRIED: Final = 0.5  # share of the width of an extrusion that must lie over something
_LONGEST_FREE: Final = 2.0  # mm of an extrusion with less than half its width over something
_LONGEST_TURN: Final = 2.5  # mm of an extrusion between two places that carry it, such as two rows
_LONGEST_SPAN: Final = 6.0  # mm, if it is straight
_SAMPLE: Final = 0.1  # mm between points along extrusions
_NEAR: Final = 1.0  # mm; free extrusions of a layer that are nearer are one place
_CONTACT: Final = 0.65  # mm below the part, room for a gap and a thick bridge; more is no contact
_MIN_FLAT: Final = 4.0  # mm²
_MIN_HELD: Final = 0.2  # mm² of a level area right above supports; less is only the side of a branch
_FARTHEST_GAP: Final = 1.2  # mm
_COARSE: Final = 5  # cells of the grid in a cell by which pieces are told apart
_CLOSING: Final = 3  # coarse cells
_REACHES: Final = (3.0, 20.0)  # mm around overhangs in which supports are sought
_BINS: Final = 0.05  # mm of height in which overhangs are handled together


@dataclass(frozen=True)
class Place:
    """A place in a file.

    Attributes:
        z, x, y: mm; x and y from the middle of the part.
        amount: mm or mm².
    """

    z: float
    x: float
    y: float
    amount: float


@dataclass(frozen=True)
class Flat:
    """The gap below one level area.

    Attributes:
        z: mm.
        area: mm².
        gap: mm from the highest top of a support to the lowest bottom of an extrusion of the part.
        usual: mm, the median over all places that have both.
    """

    z: float
    area: float
    gap: float
    usual: float


@dataclass(frozen=True)
class Figures:
    """What is measured of one file.

    Attributes:
        grams: of supports.
        minutes: to extrude supports and to travel to them.
        travel_minutes: of these, travels.
        paths: number of support paths.
        overhang: mm² that hang.
        bare: mm² of these without a support near.
        bare_places: the largest of them.
        farthest: mm, largest distance of an overhang from a support or the part below.
        islands: pieces of the part that begin in the air.
        unsupported: those of them without a support.
        floating: mm of support extrusions in the air.
        floats: places where support begins in the air: paths, or ends of paths, that nothing carries.
        sagging: mm of support extrusions that are held at both ends, but too long between them.
        sags: places of these.
        span: mm, longest straight extrusion between two supported ends.
        inside: mm² of support in the part.
        inside_places: the largest of them.
        standing: mm² of support that stands on the part.
        touching: mm² of the part with support just below it.
        flats: gaps under level areas.
        slimness: largest height of a piece of support divided by the square root of its foot's area.
    """

    grams: float
    minutes: float
    travel_minutes: float
    paths: int
    overhang: float
    bare: float
    bare_places: list[Place]
    farthest: float
    islands: int
    unsupported: list[Place]
    floating: float
    floats: list[Place]
    sagging: float
    sags: list[Place]
    span: float
    inside: float
    inside_places: list[Place]
    standing: float
    touching: float
    flats: list[Flat]
    slimness: float


@dataclass(eq=False)
class _Sums:
    """What is added up over the layers."""

    floating: float = 0.0
    sagging: float = 0.0
    span: float = 0.0
    inside: float = 0.0
    standing: float = 0.0
    floats: list[Place] = field(default_factory=list)
    sags: list[Place] = field(default_factory=list)
    inside_places: list[Place] = field(default_factory=list)


def measure_supports(
    file: SupportFile, solid: Solid, truth: tuple[Overhang, Sequence[Island]], density: float
) -> Figures:
    """Measure one file.

    Args:
        file: its extrusions, at the place of the part.
        solid: the part.
        truth: what hangs, and the islands.
        density: g/cm³.
    """
    overhang, islands = truth
    extruding, travelling = support_seconds(file)
    layers = list_layers(file.support, solid)
    sums = _walk_layers(file, layers, solid)
    bare, farthest = _bare(layers, solid, overhang)
    top = _tops_below(layers, solid)
    gap = solid.low - top
    lonely = [one for one in islands if not _is_held(layers, solid, one)]
    return Figures(
        grams=float(file.support.volume.sum()) * density / 1000,
        minutes=(extruding + travelling) / 60,
        travel_minutes=travelling / 60,
        paths=int(file.path.max(initial=-1)) + 1,
        overhang=overhang.area,
        bare=float(bare.sum()) * solid.grid.cell**2,
        bare_places=_bare_places(solid, overhang, bare),
        farthest=farthest,
        islands=len(islands),
        unsupported=[_place(solid, one.cell, one.z, one.rise) for one in lonely],
        floating=sums.floating,
        floats=sums.floats,
        sagging=sums.sagging,
        sags=sums.sags,
        span=sums.span,
        inside=sums.inside,
        inside_places=sorted(sums.inside_places, key=lambda one: -one.amount)[:8],
        standing=sums.standing,
        touching=float(np.count_nonzero(gap < _CONTACT)) * solid.grid.cell**2,
        flats=_flats(file.part, solid, overhang, top),
        slimness=_slimness(layers),
    )


def _place(solid: Solid, cells: Int, z: float, amount: float) -> Place:
    """Return the middle of cells as a place."""
    x, y = solid.grid.middles(cells).mean(axis=0) - _middle(solid)
    return Place(round(z, 3), round(float(x), 2), round(float(y), 2), round(float(amount), 2))


def _middle(solid: Solid) -> Float:
    ends = solid.grid.middles(solid.cell)
    return np.asarray((ends.min(axis=0) + ends.max(axis=0)) / 2)


# Layer by layer


def _walk_layers(file: SupportFile, layers: Sequence[SupportLayer], solid: Solid) -> _Sums:
    sums = _Sums()
    outlines = list(_outlines(file.part, solid))
    for layer in layers:
        if layer.bottom > TOUCHES:
            below = Carriers.below(layer.bottom, layers, file, solid)
            lands = layer.drawn & below.part & ~below.supports
            sums.standing += float(np.count_nonzero(lands)) * solid.grid.cell**2
            _add_floats(sums, file, layer, below)
        _add_inside(sums, layer, solid, outlines)
    return sums


def _add_floats(sums: _Sums, file: SupportFile, layer: SupportLayer, below: Carriers) -> None:
    """Add the extrusions of a layer that nothing carries."""
    beads = file.support.take(layer.members)
    count = np.maximum(np.ceil(beads.length / _SAMPLE), 1).astype(np.int64)
    bead = np.repeat(np.arange(beads.n_beads), count)
    step = np.arange(len(bead)) - np.repeat(np.cumsum(count) - count, count)
    way = (beads.end - beads.begin)[bead]
    at = beads.begin[bead] + way * ((step + 0.5) / count[bead])[:, None]
    side = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(np.hypot(*way.T), 1e-12)[:, None]
    length = (beads.length / count)[bead]
    path = file.path[layer.members][bead]
    across = side * beads.width[bead][:, None]
    free = below.measure_share(at, across) < _MIN_CARRIED
    found: dict[str, list[Float]] = {"air": [], "sags": []}
    for ends in _groups_of(path):
        for run in _free_runs(at[ends], free[ends]):
            own = ends[run]
            kind = _judge_run(run, at[ends], float(length[own].sum()))
            if kind == "spans":
                sums.span = max(sums.span, float(length[own].sum()))
            elif kind:
                found[kind].append(np.column_stack([at[own], length[own]]))
    if found["air"]:
        sums.floats += _clusters(np.concatenate(found["air"]), layer, below.solid)
        sums.floating += float(np.concatenate(found["air"])[:, 2].sum())
    if found["sags"]:
        sums.sags += _clusters(np.concatenate(found["sags"]), layer, below.solid)
        sums.sagging += float(np.concatenate(found["sags"])[:, 2].sum())


def _judge_run(run: Int, at: Float, length: float) -> str:
    """Return what a run of free samples of a path (n, 2) does: "air", "sags", "spans", or "" if it is short."""
    if len(run) == len(at):
        return "air"
    if length <= _LONGEST_FREE:
        return ""
    if not _is_held_at_both_ends(run, len(at), at):
        return "air"
    chord = float(np.hypot(*(at[run[-1]] - at[run[0]])))
    straight = chord > 0.95 * (length - _SAMPLE)
    return "spans" if length <= (_LONGEST_SPAN if straight else _LONGEST_TURN) else "sags"


def _groups_of(path: Int) -> list[Int]:
    """Return the samples of each path, in order."""
    cuts = np.flatnonzero(np.diff(path)) + 1
    return np.split(np.arange(len(path)), cuts)


def _free_runs(at: Float, free: Bool) -> Iterator[Int]:
    """Return runs of free samples; in a closed path, a run may lead over its begin."""
    if not free.any():
        return
    order = np.arange(len(free))
    if np.hypot(*(at[-1] - at[0])) < 2 * _SAMPLE and not free.all():
        order = np.roll(order, -int(np.argmin(free)))
    chosen = np.flatnonzero(free[order])
    for run in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1):
        yield order[run]


def _is_held_at_both_ends(run: Int, count: int, at: Float) -> bool:
    """Return whether the path goes on at both ends of a run; a closed path does."""
    closed = bool(np.hypot(*(at[-1] - at[0])) < 2 * _SAMPLE)
    return closed or (int(run[0]) > 0 and int(run[-1]) < count - 1)


def _clusters(points: Float, layer: SupportLayer, solid: Solid) -> list[Place]:
    """Return the free samples (n, 3: x, y, mm) of a layer as places; near ones are one place."""
    cells = np.unique(np.floor(points[:, :2] / _NEAR).astype(np.int64), axis=0)
    low = cells.min(axis=0)
    flags = np.zeros((np.ptp(cells, axis=0) + 1).tolist(), np.bool_)
    flags[tuple((cells - low).T)] = True
    label, n = ndimage.label(flags, np.ones((3, 3)))
    own = label[tuple((np.floor(points[:, :2] / _NEAR).astype(np.int64) - low).T)]
    middle = _middle(solid)
    found = []
    for number in range(1, n + 1):
        some = points[own == number]
        x, y = some[:, :2].mean(axis=0) - middle
        found.append(Place(layer.bottom, round(float(x), 2), round(float(y), 2), float(some[:, 2].sum())))
    return found


def _outlines(part: Extrusions, solid: Solid) -> Iterator[tuple[float, float, Bool]]:
    """Return bottom, top and drawn cells of the outlines of the part, by layer."""
    outer = part.take(np.isin(part.purpose, [Purpose.EXTERNAL_PERIMETER, Purpose.OVERHANG_PERIMETER]))
    bottom, top = np.round(outer.z_top - outer.height, 3), np.round(outer.z_top, 3)
    keys, which = np.unique(np.column_stack([bottom, top]), axis=0, return_inverse=True)
    for number, (low, high) in enumerate(keys.tolist()):
        yield low, high, draw_beads(outer.take(which.ravel() == number), solid.grid)


def _add_inside(
    sums: _Sums, layer: SupportLayer, solid: Solid, outlines: Sequence[tuple[float, float, Bool]]
) -> None:
    """Add the area of a layer that lies in the part, or in an outline of it, by more than a cell."""
    wrong = layer.drawn & _eroded(solid.at((layer.bottom + layer.top) / 2))
    for low, high, drawn in outlines:
        if min(high, layer.top) - max(low, layer.bottom) > 0.02:
            both = layer.drawn & drawn
            if both.any():
                wrong |= ndimage.binary_opening(both, np.ones((3, 3)))
    if wrong.any():
        label, n = ndimage.label(wrong, np.ones((3, 3)))
        area = np.bincount(label.ravel(), minlength=n + 1)[1:] * solid.grid.cell**2
        sums.inside += float(area.sum())
        largest = int(np.argmax(area))
        cells = np.flatnonzero(label == largest + 1)
        sums.inside_places.append(_place(solid, cells, layer.top, float(area[largest])))


def _eroded(flags: Bool) -> Bool:
    """Return the cells whose eight neighbours are set."""
    inner = flags.copy()
    inner[1:] &= flags[:-1]
    inner[:-1] &= flags[1:]
    rows = inner.copy()
    inner[:, 1:] &= rows[:, :-1]
    inner[:, :-1] &= rows[:, 1:]
    return inner


# Overhangs


def _near_below(layers: Sequence[SupportLayer], z: tuple[float, float], solid: Solid) -> Bool:
    """Return the cells under supports that end at most 0.85 mm below heights between two values."""
    drawn = np.zeros(solid.grid.shape, np.bool_)
    for layer in layers:
        if z[0] - _BELOW <= layer.top <= z[1] + 0.02:
            drawn |= layer.drawn
    return drawn


def _bare(layers: Sequence[SupportLayer], solid: Solid, overhang: Overhang) -> tuple[Bool, float]:
    """Return which cells (n,) of the overhang have no support near, and the largest distance from anything, mm."""
    bare, farthest = np.zeros(len(overhang.cell), np.bool_), 0.0
    number = np.floor(overhang.z / _BINS).astype(np.int64)
    order = np.argsort(number, kind="stable")
    for some in np.split(order, np.flatnonzero(np.diff(number[order])) + 1) if len(order) else []:
        z = overhang.z[some]
        drawn = _near_below(layers, (float(z.min()), float(z.max())), solid)
        away = _distances(drawn, overhang.cell[some], solid)
        bare[some] = away > _SIDEWAYS
        far = overhang.cell[some[away > farthest]]
        if len(far):
            carries = drawn | solid.at(max(float(z.min()) - 0.2, 0.05))
            farthest = max(farthest, float(_distances(carries, far, solid).max()))
    return bare, farthest


def _distances(drawn: Bool, cell: Int, solid: Solid) -> Float:
    """Return the distance (n,) of cells from drawn ones, mm; infinite if none is near any of the cells."""
    grid = solid.grid
    i, j = np.divmod(cell, grid.shape[1])
    for reach in _REACHES:
        margin = int(reach / grid.cell)
        top, left = max(int(i.min()) - margin, 0), max(int(j.min()) - margin, 0)
        window = drawn[top : int(i.max()) + margin, left : int(j.max()) + margin]
        if not window.any():
            continue
        away = ndimage.distance_transform_edt(~window)[i - top, j - left] * grid.cell
        if away.max() < reach - grid.cell:
            return np.asarray(away, np.float64)
    return np.asarray(away, np.float64) if window.any() else np.full(len(cell), np.inf)


def _bare_places(solid: Solid, overhang: Overhang, bare: Bool) -> list[Place]:
    """Return the patches with the largest bare areas."""
    found = []
    for patch in np.unique(overhang.patch[bare]).tolist():
        own = np.flatnonzero(bare & (overhang.patch == patch))
        area = len(own) * solid.grid.cell**2
        found.append(_place(solid, overhang.cell[own], float(overhang.z[own].min()), area))
    return sorted(found, key=lambda one: -one.amount)[:8]


def _is_held(layers: Sequence[SupportLayer], solid: Solid, island: Island) -> bool:
    """Return whether a support is near the lowest point of an island."""
    drawn = _near_below(layers, (island.z, island.z), solid)
    return bool(_distances(drawn, island.cell, solid).min() <= _SIDEWAYS)


# Contacts


def _tops_below(layers: Sequence[SupportLayer], solid: Solid) -> Float:
    """Return for each surface (I,) that faces down the top of the nearest support below it, mm; else -inf."""
    order = np.argsort(solid.low)
    z, cell = solid.low[order], solid.cell[order]
    top = np.full(len(z), -np.inf)
    for layer in layers:
        some = slice(*np.searchsorted(z, [layer.top - 0.02, layer.top + _FARTHEST_GAP]).tolist())
        under = layer.drawn.ravel()[cell[some]]
        top[some] = np.where(under, np.maximum(top[some], layer.top), top[some])
    return np.asarray(top[np.argsort(order)], np.float64)


def _flats(part: Extrusions, solid: Solid, overhang: Overhang, top: Float) -> list[Flat]:
    """Return the gaps under level overhangs."""
    found = []
    size = solid.grid.cell**2
    level = np.round(overhang.z, 2)
    for z in np.unique(level[overhang.is_flat]).tolist():
        cells = overhang.cell[overhang.is_flat & (level == z)]
        if len(cells) * size < _MIN_FLAT:
            continue
        own = np.flatnonzero(solid.grid.mask(cells).ravel()[solid.cell] & (np.abs(solid.low - z) < 0.006))
        held = own[np.isfinite(top[own])]
        bottom = _bottoms_above(part, z, solid)[solid.cell[held]]
        both = np.isfinite(bottom)
        if np.count_nonzero(both) * size >= _MIN_HELD:
            gap = float(bottom[both].min() - top[held][both].max())
            usual = float(np.median(bottom[both] - top[held][both]))
            found.append(Flat(z, round(len(cells) * size, 1), round(gap, 4), round(usual, 4)))
    return found


def _bottoms_above(part: Extrusions, z: float, solid: Solid) -> Float:
    """Return the bottom of the lowest extrusion (cells,) of the part that ends above a height, mm; else inf."""
    near = part.take(np.flatnonzero((part.z_top > z + 0.03) & (part.z_top < z + 0.65)))
    bottom = np.round(near.z_top - near.height, 4)
    found = np.full(solid.grid.n_cells, np.inf)
    for low in np.unique(bottom)[::-1].tolist():
        found[draw_beads(near.take(np.flatnonzero(bottom == low)), solid.grid).ravel()] = low
    return found


# Pieces


def _slimness(layers: Sequence[SupportLayer]) -> float:
    """Return the largest height of a piece of support, divided by the square root of the area it stands on."""
    labels, sizes, first = [], [], [0]
    for layer in layers:
        coarse = _coarse(layer.drawn)
        label, n = ndimage.label(coarse, np.ones((3, 3)))
        labels.append(np.where(label > 0, label + first[-1] - 1, -1))
        sizes.append(np.bincount(label.ravel(), minlength=n + 1)[1:])
        first.append(first[-1] + n)
    total = first[-1]
    if not total:
        return 0.0
    links = _links(layers, labels)
    pairs = sparse.coo_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), (total, total))
    count, piece = sparse.csgraph.connected_components(pairs, directed=False)
    index = np.repeat(np.arange(len(layers)), np.diff(first))
    bottom = np.array([one.bottom for one in layers])[index]
    top = np.array([one.top for one in layers])[index]
    area = np.concatenate(sizes) * (_COARSE * 0.1) ** 2
    is_foot = np.ones(total, np.bool_)
    is_foot[links[:, 0]] = False
    low, high = np.full(count, np.inf), np.zeros(count)
    np.minimum.at(low, piece, bottom)
    np.maximum.at(high, piece, top)
    foot = np.bincount(piece, weights=area * is_foot, minlength=count)
    return float(((high - low) / np.sqrt(np.maximum(foot, 0.1))).max())


def _links(layers: Sequence[SupportLayer], labels: Sequence[Int]) -> Int:
    """Return pairs (n, 2) of pieces, the upper one first, that lie on each other."""
    found = [np.zeros((0, 2), np.int64)]
    tops = np.array([one.top for one in layers])
    for layer, label in zip(layers, labels, strict=True):
        for below in np.flatnonzero(np.abs(tops - layer.bottom) <= TOUCHES).tolist():
            both = (label >= 0) & (labels[below] >= 0)
            found.append(np.unique(np.column_stack([label[both], labels[below][both]]), axis=0))
    return np.concatenate(found)


def _coarse(drawn: Bool) -> Bool:
    """Return cells of 0.5 mm that are drawn, with narrow gaps between them closed."""
    deep, wide = (np.array(drawn.shape) // _COARSE).tolist()
    blocks = drawn[: deep * _COARSE, : wide * _COARSE].reshape(deep, _COARSE, wide, _COARSE)
    flags = np.pad(blocks.any(axis=(1, 3)), _CLOSING)
    y, x = np.mgrid[-_CLOSING : _CLOSING + 1, -_CLOSING : _CLOSING + 1]
    disc = x**2 + y**2 <= _CLOSING**2
    closed = ndimage.binary_closing(flags, disc)
    return np.asarray(closed[_CLOSING:-_CLOSING, _CLOSING:-_CLOSING], np.bool_)
