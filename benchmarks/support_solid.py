"""A part as vertical columns of solid intervals, from its facets alone, and what of it hangs.

A vertical line through the middle of each cell of a grid crosses the facets. Where the winding number rises from 0, the
line enters the part through a surface that faces down. No layers, sections or functions of the slicer are involved, so
all programs are judged by the same overhangs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import ndimage, sparse

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Mesh

__all__ = ["Grid", "Island", "Overhang", "Solid", "find_islands", "find_overhang"]

_CELL: Final = 0.1  # mm
_SHIFT: Final = np.array([0.00137, 0.00211])  # mm; middles of cells lie on no edge of a part with round sizes
_BLOCK: Final = 1 << 22  # candidate cells at a time
_SAME_SHEET: Final = 0.25  # mm; surfaces of neighbouring cells that differ by less are one surface
_FIRST: Final = 0.2  # mm; what hangs lower is in the first layer, on the bed
_FLAT_DEG: Final = 5.0  # surfaces flatter than this are level
_STRIP_DEG: Final = (
    24.0  # on steeper slopes, strips of 0.2 mm layers are narrower than an extrusion, which is no bridge
)
_LAYER: Final = 0.2  # mm, height of a bridge
_FILLET: Final = 10  # cells, width of a fillet between a ceiling and a wall
_STEP: Final = 0.1  # mm between the sections in which islands are sought
_ON_BED: Final = 0.25  # mm; pieces that begin lower are printed on the bed
_DIRECTIONS: Final = 36  # of bridges
_SAMPLES: Final = 500  # cells by which the direction of a bridge is chosen


@dataclass(frozen=True)
class Grid:
    """Square cells; the middle of cell (i, j) is `low` + (j + 0.5, i + 0.5) cells."""

    low: tuple[float, float]
    shape: tuple[int, int]

    @classmethod
    def around(cls, mesh: Mesh, margin: float) -> Grid:
        """Return the cells around a part, extended by a margin, mm."""
        low, high = mesh.bounds[:, :2] + np.array([[-margin], [margin]])
        wide, deep = np.ceil((high - low) / _CELL).astype(int).tolist()
        return cls(tuple((low + _SHIFT).tolist()), (deep, wide))

    @property
    def cell(self) -> float:
        """Width of a cell, mm."""
        return _CELL

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    def index(self, xy: Float) -> Int:
        """Return the flat index (n,) of the cells of points (n, 2); points outside are at the border."""
        j, i = np.floor((xy - self.low) / _CELL).astype(np.int64).T
        return np.clip(i, 0, self.shape[0] - 1) * self.shape[1] + np.clip(j, 0, self.shape[1] - 1)

    def middles(self, index: Int) -> Float:
        """Return x and y (n, 2) of the middles of cells, mm."""
        i, j = np.divmod(index, self.shape[1])
        return np.column_stack([j + 0.5, i + 0.5]) * _CELL + self.low

    def mask(self, index: Int) -> Bool:
        """Return flags of all cells, with those of the given index."""
        flags = np.zeros(self.n_cells, np.bool_)
        flags[index] = True
        return flags.reshape(self.shape)


@dataclass(frozen=True, eq=False)
class Solid:
    """Solid intervals of all columns, by cell and height.

    Attributes:
        grid: the cells.
        cell: (I,) flat index of the column.
        low, high: (I,) mm.
        slope: (I,) angle of the surface at `low` from the horizontal, degrees.
        broken: share of columns left out because their surface is not closed.
    """

    grid: Grid
    cell: Int
    low: Float
    high: Float
    slope: Float
    broken: float

    @classmethod
    def of(cls, mesh: Mesh, margin: float = 12.0) -> Solid:
        """Return the columns of a part."""
        grid = Grid.around(mesh, margin)
        cell, z, way, slope = (np.concatenate(one) for one in zip(*_crossings(mesh, grid), strict=True))
        z = np.round(z, 6)  # of surfaces that touch, the one that enters comes first
        order = np.lexsort((-way, z, cell))
        cell, z, way, slope = cell[order], z[order], way[order], slope[order]
        winding = np.cumsum(way)
        first = np.flatnonzero(np.diff(cell, prepend=-1))
        last = np.append(first[1:], len(cell)) - 1
        sums = winding[last] - np.where(first > 0, winding[first - 1], 0)
        count = last - first + 1
        winding -= np.repeat(np.where(first > 0, winding[first - 1], 0), count)
        sound = np.repeat(sums == 0, count)
        before = winding - way
        enters = sound & (before <= 0) & (winding > 0)
        leaves = sound & (before > 0) & (winding <= 0)
        broken = float((sums != 0).mean())
        low, high = z[enters], z[leaves]
        return cls(grid, cell[enters], low, high, slope[enters], broken)

    def at(self, z: float) -> Bool:
        """Return the section at a height, as flags of all cells."""
        return self.grid.mask(self.cell[(self.low < z) & (self.high > z)])

    def within(self, low: float, high: float) -> Bool:
        """Return the cells that are solid anywhere between two heights."""
        return self.grid.mask(self.cell[(self.low < high) & (self.high > low)])

    def fills(self, cell: Int, low: Float, high: Float) -> Bool:
        """Return which cells (n,) are solid anywhere between two heights (n,), mm."""
        first = np.searchsorted(self.cell, cell)
        count = np.searchsorted(self.cell, cell, side="right") - first
        found = np.zeros(len(cell), np.bool_)
        for k in range(int(count.max(initial=0))):
            here = np.flatnonzero(count > k)
            at = first[here] + k
            found[here] |= (self.low[at] < high[here]) & (self.high[at] > low[here])
        return found

    @cached_property
    def top(self) -> float:
        """Height of the part, mm."""
        return float(self.high.max())


def _crossings(mesh: Mesh, grid: Grid) -> Iterator[tuple[Float, ...]]:
    """Return cell, height, winding (1 upward into the part, -1 out of it) and slope of the facets at all columns."""
    corners = mesh.triangles
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    kept = np.abs(normal[:, 2]) > 1e-9 * np.maximum(size, 1e-30)
    corners, normal, size = corners[kept], normal[kept], size[kept]
    slope = np.rad2deg(np.arccos(np.clip(np.abs(normal[:, 2]) / size, 0, 1)))
    way = np.where(normal[:, 2] < 0, 1, -1)
    places = (corners[:, :, :2] - grid.low) / _CELL - 0.5
    low = np.maximum(np.ceil(places.min(axis=1)), 0).astype(np.int64)
    high = np.floor(places.max(axis=1)).astype(np.int64)
    wide, deep = np.maximum(high - low + 1, 0).T
    count = wide * deep
    block = np.cumsum(count) // _BLOCK
    for number in np.unique(block[count > 0]):
        some = np.flatnonzero((block == number) & (count > 0))
        facet = np.repeat(some, count[some])
        piece = np.arange(len(facet)) - np.repeat(np.cumsum(count[some]) - count[some], count[some])
        i, j = np.divmod(piece, wide[facet])
        at = np.column_stack([j + low[facet, 0], i + low[facet, 1]]).astype(np.float64)
        weights = _barycentric(places[facet], at)
        inside = (weights >= 0).all(axis=1)
        facet, weights, at = facet[inside], weights[inside], at[inside].astype(np.int64)
        z = (weights * corners[facet, :, 2]).sum(axis=1)
        yield at[:, 1] * grid.shape[1] + at[:, 0], z, way[facet], slope[facet]


def _barycentric(triangles: Float, at: Float) -> Float:
    """Return the weights (n, 3) of the corners of triangles (n, 3, 2) at points (n, 2)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]

    def area(p: Float, q: Float, r: Float) -> Float:
        return (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])

    parts = np.column_stack([area(at, b, c), area(a, at, c), area(a, b, at)])
    return np.asarray(parts / area(a, b, c)[:, None])


@dataclass(frozen=True, eq=False)
class Overhang:
    """Cells of surfaces that hang and need a support.

    Attributes:
        cell: (n,) flat index.
        z: (n,) mm.
        patch: (n,) number of the patch.
        is_flat: (n,) whether the surface is level.
        bridged: mm² that bridges of at most the given length hold.
        small: mm² of patches that are too small.
    """

    cell: Int
    z: Float
    patch: Int
    is_flat: Bool
    bridged: float
    small: float

    @property
    def area(self) -> float:
        """mm², seen from above."""
        return len(self.cell) * _CELL**2


def find_overhang(
    solid: Solid, threshold_deg: float, max_bridge: float, least_area: float = 1.0, least_reach: float = 0.5
) -> Overhang:
    """Return the surfaces that hang.

    Args:
        solid: the part.
        threshold_deg: surfaces flatter than this hang.
        max_bridge: mm; areas that level lines of at most this length cross, in the direction that holds most of the
            area, do not count. Both ends of a line lie on the part.
        least_area: mm²; smaller patches do not count, nor do smaller rests beside bridges.
        least_reach: mm; patches and rests into which no circle of this radius fits do not count.
    """
    hanging = (solid.low > _FIRST) & (solid.slope < threshold_deg - 0.01)
    cell, z, slope = solid.cell[hanging], solid.low[hanging], solid.slope[hanging]
    patch = _sheets(solid.grid, cell, z)
    held = np.zeros(len(cell), np.bool_)
    dropped = np.zeros(len(cell), np.bool_)
    for members in _groups(patch):
        if _is_small(solid.grid, cell[members], least_area, least_reach):
            dropped[members] = True
            continue
        surface = np.full(solid.grid.n_cells, np.inf)
        surface[cell[members]] = z[members]
        flat = slope[members] < _FLAT_DEG
        for level in _levels(members[flat], z):
            top = float(z[level].max())
            some = np.union1d(level, members[(z[members] > top - _LAYER) & (z[members] <= top)])
            held[some] |= _bridged(solid, surface, (cell[some], z[some]), max_bridge, is_slope=False)
        some = members[~flat & (slope[members] < _STRIP_DEG)]
        held[some] |= _bridged(solid, surface, (cell[some], z[some]), max_bridge, is_slope=True)
        rest = members[~held[members]]
        for piece in _groups(_sheets(solid.grid, cell[rest], z[rest])) if len(rest) < len(members) else []:
            dropped[rest[piece]] = _is_small(solid.grid, cell[rest[piece]], least_area, least_reach)
    kept = ~held & ~dropped
    areas = [float(np.count_nonzero(one)) * _CELL**2 for one in (held, dropped)]
    return Overhang(cell[kept], z[kept], patch[kept], slope[kept] < 1.0, *areas)


def _is_small(grid: Grid, cell: Int, least_area: float, least_reach: float) -> bool:
    """Return whether cells cover less than an area, mm², or hold no circle of a radius, mm."""
    return len(cell) * _CELL**2 < least_area or _reach(grid, cell) < least_reach


def _sheets(grid: Grid, cell: Int, z: Float) -> Int:
    """Return the number of the connected surface (n,) of each cell."""
    order = np.lexsort((z, cell))
    ordered = cell[order]
    rows, columns = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for step in (1, grid.shape[1], grid.shape[1] + 1, grid.shape[1] - 1):
        first = np.searchsorted(ordered, ordered + step)
        last = np.searchsorted(ordered, ordered + step, side="right")
        for k in range(int((last - first).max(initial=0))):
            mine = np.flatnonzero(first + k < last)
            other = first[mine] + k
            near = np.abs(z[order[mine]] - z[order[other]]) < _SAME_SHEET
            rows.append(order[mine[near]])
            columns.append(order[other[near]])
    row, column = np.concatenate(rows), np.concatenate(columns)
    links = sparse.coo_matrix((np.ones(len(row), np.int8), (row, column)), (len(cell), len(cell)))
    return np.asarray(sparse.csgraph.connected_components(links, directed=False)[1], np.int64)


def _groups(label: Int) -> list[Int]:
    """Return the members of each label."""
    order = np.argsort(label, kind="stable")
    cuts = np.flatnonzero(np.diff(label[order])) + 1
    return np.split(order, cuts) if len(label) else []


def _reach(grid: Grid, cell: Int) -> float:
    """Return the radius, mm, of the largest circle in cells, seen from above."""
    i, j = np.divmod(cell, grid.shape[1])
    flags = np.zeros((np.ptp(i) + 3, np.ptp(j) + 3), np.bool_)
    flags[i - i.min() + 1, j - j.min() + 1] = True
    # The transform measures to the middles of cells outside, half a cell beyond the edge.
    return (float(ndimage.distance_transform_edt(flags).max()) - 0.5) * _CELL


def _levels(members: Int, z: Float) -> list[Int]:
    """Return groups of members whose heights are near each other."""
    order = members[np.argsort(z[members])]
    cuts = np.flatnonzero(np.diff(z[order]) > _STEP) + 1
    return [one for one in np.split(order, cuts) if len(one)]


def _bridged(
    solid: Solid, surface: Float, some: tuple[Int, Float], longest: float, *, is_slope: bool
) -> Bool:
    """Return which of some cells lie on level lines that end on the part at both sides.

    All lines have the direction that holds most of the cells.

    Args:
        solid: the part.
        surface: (cells,) height of the patch, mm; infinite beside it.
        some: cells (n,) of the patch, and their heights, mm.
        longest: length of lines, mm.
        is_slope: whether lines must follow the patch up to its fillets at both ends. Those of level areas and crowns,
            which one layer closes, may end anywhere where the patch is lower.
    """
    step = max(len(some[0]) // _SAMPLES, 1)
    sample = some[0][::step], some[1][::step]
    angles = (np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS).tolist()
    count = [int(_lines_held(solid, surface, sample, (one, longest), is_slope).sum()) for one in angles]
    return _lines_held(solid, surface, some, (angles[int(np.argmax(count))], longest), is_slope)


def _lines_held(
    solid: Solid, surface: Float, some: tuple[Int, Float], line: tuple[float, float], is_slope: bool
) -> Bool:
    """Return for which cells (n,) a level line in a direction, up to a length, ends on the part at both sides."""
    (cell, z), (angle, longest) = some, line
    i, j = np.divmod(cell, solid.grid.shape[1])
    length, rests = np.zeros(len(cell)), np.ones(len(cell), np.bool_)
    for way in (-1.0, 1.0):
        going = np.ones(len(cell), np.bool_)
        for step in range(1, int(longest / _CELL) + 2):
            at = np.flatnonzero(going)
            if not len(at):
                break
            to = _step_along(solid.grid, (i[at], j[at]), way * step, angle)
            leaves = np.abs(surface[to] - z[at]) > (_LAYER / 2 if is_slope else _LAYER)
            length[at] += _CELL
            ends, to = at[leaves], to[leaves]
            rests[ends] &= solid.fills(to, z[ends] - _LAYER, z[ends] + 0.02)
            if is_slope:
                beyond = _step_along(solid.grid, (i[ends], j[ends]), way * (step + _FILLET), angle)
                rests[ends] &= np.isinf(surface[to]) | np.isinf(surface[beyond])
            going[ends] = False
        rests &= ~going
    return rests & (length - _CELL <= longest)


def _step_along(grid: Grid, start: tuple[Int, Int], steps: float, angle: float) -> Int:
    """Return the cells (n,) that are some steps in a direction away from cells in rows and columns (n,)."""
    y = np.rint(start[0] + steps * np.sin(angle)).astype(np.int64)
    x = np.rint(start[1] + steps * np.cos(angle)).astype(np.int64)
    return np.asarray(y * grid.shape[1] + x)


@dataclass(frozen=True, eq=False)
class Island:
    """A piece of the part with nothing below it.

    Attributes:
        cell: (n,) cells of its lowest section.
        z: mm, its lowest point.
        rise: mm from there to where it joins what stands, to 0.05 mm.
    """

    cell: Int
    z: float
    rise: float


def find_islands(solid: Solid, highest_layer: float) -> list[Island]:
    """Return all pieces that begin above the bed, walking up through sections.

    Left out are those that join the part before they are as high as the highest layer, mm, because layers need not
    contain them.
    """
    count = int(np.ceil(solid.top / _STEP))
    before, standing = np.zeros(solid.grid.shape, np.int64), np.ones(1, np.bool_)
    alive: dict[int, list[Island]] = {}
    found: list[Island] = []
    for level in range(count):
        z = (level + 0.5) * _STEP
        section = solid.at(z)
        if not alive and level > 1 and np.array_equal(section, before > 0):
            continue
        label, n = ndimage.label(section, np.ones((3, 3)))
        shared = section & (before > 0)
        keys = np.unique(label[shared].astype(np.int64) * len(standing) + before[shared])
        pairs = np.column_stack(np.divmod(keys, len(standing)))
        stands = np.zeros(n + 1, np.bool_)
        stands[pairs[standing[pairs[:, 1]], 0]] = True
        following: dict[int, list[Island]] = {}
        for piece, old in pairs.tolist():
            following.setdefault(piece, []).extend(alive.get(old, []))
        for piece in np.setdiff1d(np.arange(1, n + 1), pairs[:, 0]).tolist():
            cells = np.flatnonzero(label == piece)
            lowest = _lowest(solid, cells, z)
            if lowest < _ON_BED:
                stands[piece] = True
            else:
                following[piece] = [Island(cells, lowest, np.inf)]
        for piece, members in following.items():
            if stands[piece]:
                found += [Island(one.cell, one.z, z - _STEP / 2 - one.z) for one in members]
        alive = {piece: members for piece, members in following.items() if not stands[piece]}
        before, standing = label, stands
    found += [one for members in alive.values() for one in members]
    return [one for one in found if one.rise >= highest_layer]


def _lowest(solid: Solid, cells: Int, z: float) -> float:
    """Return the lowest point of the intervals through a section's cells."""
    through = (solid.low < z) & (solid.high > z) & np.isin(solid.cell, cells)
    return float(solid.low[through].min())
