"""The printed paths (`Toolpaths`) and the moves of the print (`Program`)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import (
    Bool,
    Float,
    Int,
    SmallInt,
    consecutive,
    distinct,
    frozen_array,
    next_in_ring,
    polyline_lengths,
)
from printer_slicer.deprecation import accept_former_arguments, accept_former_fields, renamed_method
from printer_slicer.model.layers import SAME_TOP, LayerPlan
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.roles import Role
from printer_slicer.values import Struct, field, force_setattr, replace

__all__ = [
    "Acceleration",
    "Event",
    "Fan",
    "Heat",
    "PressureAdvance",
    "Program",
    "ToolChange",
    "Toolpaths",
    "reorder_ragged",
]


_NOT_GIVEN: Final = np.zeros(0)
_NO_NUMBERS: Final = np.zeros(0, np.int64)
_MAY_BE_DEFAULT: Final = ("support_ratio", "z_offset", "flow_ratio", "centre")
_POINT_COLUMNS: Final = ("xy", "width", "support_ratio", "z_offset", "flow_ratio", "centre")
_PATH_COLUMNS: Final = ("layer", "role", "height", "closed", "chain_id", "settings_id", "z_top", "tool")
_POINTS_AT_ONCE: Final = 1 << 16  # bounds the memory for indices of points


@accept_former_fields(
    carried="support_ratio", sweep="chain_id", rise="z_offset", share="flow_ratio", rule="settings_id"
)
class Toolpaths(SvgRepr, Struct, frozen=True, eq=False):
    """Polylines to print; path `i` has the points `xy[start[i]:start[i + 1]]`.

    Attributes:
        plan: the layers that are printed.
        xy: (N, 2) mm; a closed path does not repeat its first point.
        width: (N,) extrusion width at each point, mm; it changes linearly between two points.
        start: (M + 1,) index of the first point of each path.
        layer: (M,) layer index, ascending.
        role: (M,) `Role` of each path.
        height: (M,) height of the extrusion, mm: that of the layer, unless the extrusion fills several layers or is
            squeezed less.
        closed: (M,) whether the path returns to its first point.
        support_ratio: (N,) fraction of the extrusion width, 0 to 1, that rests on the layer below, from each point to
            the next. Default 1.
        chain_id: (M,) paths with the same number are printed one after the other, in this order or all reversed. -1
            (default): the path may be printed at any time.
        z_offset: (N,) mm from the top of the layer up to the nozzle; negative below it. It changes linearly between two
            points. Default 0.
        flow_ratio: (N,) fraction of the full cross-section that is extruded. It changes linearly between two points.
            Default 1.
        centre: (N, 2) mm, centre of the arc of which the line to the next point is a chord; nan (default): a straight
            line.
        settings_id: (M,) index of the profile that gives the path its speeds and flow. Default 0.
        z_top: (M,) z of the nozzle, mm. Default: the top of the path's layer.
        tool: (M,) index in `Profile.extruders` of the extruder that prints the path. Default 0.
    """

    plan: LayerPlan
    xy: Float
    width: Float
    start: Int
    layer: Int
    role: Int
    height: Float
    closed: Bool
    support_ratio: Float = field(default_factory=lambda: _NOT_GIVEN)
    chain_id: Int = field(default_factory=lambda: _NO_NUMBERS)
    z_offset: Float = field(default_factory=lambda: _NOT_GIVEN)
    flow_ratio: Float = field(default_factory=lambda: _NOT_GIVEN)
    centre: Float = field(default_factory=lambda: _NOT_GIVEN)
    settings_id: Int = field(default_factory=lambda: _NO_NUMBERS)
    z_top: Float = field(default_factory=lambda: _NOT_GIVEN)
    tool: Int = field(default_factory=lambda: _NO_NUMBERS)

    def __post_init__(self) -> None:
        n_points, n_paths = len(self.xy), len(self.layer)
        for name, value, shape in (
            ("support_ratio", 1.0, (n_points,)),
            ("z_offset", 0.0, (n_points,)),
            ("flow_ratio", 1.0, (n_points,)),
            ("centre", np.nan, (n_points, 2)),
        ):
            if getattr(self, name) is _NOT_GIVEN:
                force_setattr(self, name, np.broadcast_to(np.float64(value), shape))
        if self.chain_id is _NO_NUMBERS:
            force_setattr(self, "chain_id", np.full(n_paths, -1))
        for name in ("settings_id", "tool"):
            if getattr(self, name) is _NO_NUMBERS:
                force_setattr(self, name, np.zeros(n_paths, np.int64))
        if self.z_top is _NOT_GIVEN:
            force_setattr(self, "z_top", self.plan.top[self.layer])
        for name, dtype, shape in (
            ("xy", np.float64, (-1, 2)),
            ("width", np.float64, (n_points,)),
            ("start", np.int64, (n_paths + 1,)),
            ("layer", np.int64, (n_paths,)),
            ("role", np.int64, (n_paths,)),
            ("height", np.float64, (n_paths,)),
            ("closed", np.bool_, (n_paths,)),
            ("support_ratio", np.float64, (n_points,)),
            ("chain_id", np.int64, (n_paths,)),
            ("z_offset", np.float64, (n_points,)),
            ("flow_ratio", np.float64, (n_points,)),
            ("centre", np.float64, (n_points, 2)),
            ("settings_id", np.int64, (n_paths,)),
            ("z_top", np.float64, (n_paths,)),
            ("tool", np.int64, (n_paths,)),
        ):
            if name not in _MAY_BE_DEFAULT or not _is_default(getattr(self, name)):
                force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        metres = float(self.length().sum()) / 1000
        return f"<Toolpaths: {self.plan.n_layers} layers, {self.n_paths} paths, {metres:.4g} m>"

    @classmethod
    @accept_former_arguments(carried="support_ratio", sweep="chain_id", rule="settings_id")
    def gathered(  # noqa: PLR0913 - one argument per column
        cls,
        plan: LayerPlan,
        *,
        xy: Float,
        size: Int,
        layer: Int,
        role: Int,
        width: Float,
        closed: bool | Bool,
        height: Float | None = None,
        support_ratio: Float | None = None,
        chain_id: Int | None = None,
        slope: tuple[Float, Float] | None = None,
        settings_id: Int | None = None,
    ) -> Toolpaths:
        """Build paths from the concatenated points `xy` (N, 2) of all paths; layers may be in any order.

        `size` (M,) is the number of points of each path. `width` is (N,) for each point or (M,) for each path. `height`
        (M,) defaults to the height of the layer. `slope` is (`z_offset`, `flow_ratio`).
        """
        flags = np.full(len(layer), closed) if isinstance(closed, bool) else closed
        heights = plan.height[layer] if height is None else height
        widths = width if len(width) == len(xy) else np.repeat(width, size)
        support_ratios = _NOT_GIVEN if support_ratio is None else support_ratio
        chain_ids = np.full(len(layer), -1) if chain_id is None else chain_id
        z_offset, flow_ratio = (_NOT_GIVEN, _NOT_GIVEN) if slope is None else slope
        settings_ids = np.zeros(len(layer), np.int64) if settings_id is None else settings_id
        if (np.diff(layer) < 0).any():
            order = np.argsort(layer, kind="stable")
            before = size
            (xy, widths), size = reorder_ragged((xy, widths), before, order)
            if support_ratio is not None:
                (support_ratios,), _ = reorder_ragged((support_ratio,), before, order)
            if slope is not None:
                (z_offset, flow_ratio), _ = reorder_ragged(slope, before, order)
            layer, role, flags = layer[order], role[order], flags[order]
            heights, chain_ids, settings_ids = heights[order], chain_ids[order], settings_ids[order]
        start = np.concatenate([[0], np.cumsum(size)])
        columns = (layer, role, heights, flags, support_ratios, chain_ids, z_offset, flow_ratio)
        return cls(plan, xy, widths, start, *columns, settings_id=settings_ids)

    @classmethod
    def joined(cls, plan: LayerPlan, parts: Sequence[Toolpaths]) -> Toolpaths:
        """Concatenate paths; they are sorted by layer, and within a layer they keep the order of `parts`.

        All parts must have the layers of `plan`. The nozzle prints at the tops of these layers.
        """
        joined = cls.gathered(
            plan,
            xy=np.concatenate([part.xy for part in parts]),
            size=np.concatenate([np.diff(part.start) for part in parts]),
            layer=np.concatenate([part.layer for part in parts]),
            role=np.concatenate([part.role for part in parts]),
            width=np.concatenate([part.width for part in parts]),
            closed=np.concatenate([part.closed for part in parts]),
            height=np.concatenate([part.height for part in parts]),
            support_ratio=np.concatenate([part.support_ratio for part in parts]),
            chain_id=_renumber_chains([part.chain_id for part in parts]),
            slope=None
            if all(
                _is_default(part.z_offset) and _is_default(part.flow_ratio) for part in parts if len(part.xy)
            )
            else (
                np.concatenate([part.z_offset for part in parts]),
                np.concatenate([part.flow_ratio for part in parts]),
            ),
            settings_id=np.concatenate([part.settings_id for part in parts]),
        )
        tool = np.concatenate([part.tool for part in parts])
        by_layer = np.argsort(np.concatenate([part.layer for part in parts]), kind="stable")
        return replace(joined, tool=tool[by_layer]) if tool.any() else joined

    def on_plan(self, plan: LayerPlan, lift: float = 0.0) -> Toolpaths:
        """Return the paths raised by `lift` mm onto another plan, which must have layers with the same tops."""
        layer = plan.find_tops(self.plan.top + lift)[self.layer]
        return replace(self, plan=plan, layer=layer, z_top=plan.top[layer])

    def with_tool(self, tool: int) -> Toolpaths:
        """Return the paths assigned to another extruder."""
        return replace(self, tool=np.full(self.n_paths, tool))

    def with_settings(self, of_layer: Int) -> Toolpaths:
        """Assign profiles to paths: each path gets the profile index `of_layer` (L,) of its layer."""
        return replace(self, settings_id=of_layer[self.layer])

    ruled = renamed_method("Toolpaths.ruled", "Toolpaths.with_settings")

    def take(self, chosen: Int) -> Toolpaths:
        """Return the paths with these indices; their layers must ascend."""
        size = np.diff(self.start)[chosen]
        points = consecutive(self.start[chosen], size)
        return self.of_points(points, np.append(0, np.cumsum(size)), chosen)

    def of_points(self, point: Int, start: Int, path: Int) -> Toolpaths:
        """Build paths (m,) from points with these indices (n,); all columns of paths are copied from `path` (m,).

        Path `i` has the points `point[start[i]:start[i + 1]]`. `support_ratio` is copied with the points, so it is only
        correct for paths that keep their direction.
        """
        columns: dict[str, Any] = {name: getattr(self, name) for name in _POINT_COLUMNS}
        columns = {
            name: _NOT_GIVEN if _is_default(column) else column.take(point, axis=0)
            for name, column in columns.items()
        }
        of_path = {name: getattr(self, name).take(path) for name in _PATH_COLUMNS}
        return replace(self, start=start, **columns, **of_path)

    def arrange(self, path: Int, is_reversed: Bool) -> Toolpaths:
        """Return the paths `path` (m,) in this order, by layer; those of the mask `is_reversed` (m,) run backward."""
        size, first = np.diff(self.start)[path], self.start[path]
        start = np.append(0, np.cumsum(size))

        def find_points(some: slice) -> tuple[Int, Int]:
            """Return for the points of some paths the former points, and those with their support ratio."""
            count, back = size[some], is_reversed[some]
            at = consecutive(np.zeros_like(count), count)
            at *= np.repeat(1 - 2 * back, count)
            point = np.repeat(first[some] + (count - 1) * back, count) + at
            # `support_ratio` belongs to the segment after a point; in reversed paths that is the segment before it.
            supported = np.maximum(point - np.repeat(back, count), np.repeat(first[some], count))
            return point, supported

        return self.rebuild(find_points, start, path)[0]

    def rebuild(
        self, find_points: Callable[[slice], tuple[Int, Int]], start: Int, path: Int
    ) -> tuple[Toolpaths, dict[str, Float]]:
        """Build paths (m,) as `of_points` does, from indices that are computed for a slab of new paths at a time.

        Args:
            find_points: called with a slice of the new paths. Returns the indices (n,) of the points of these paths,
                and of the points from which their `support_ratio` is copied.
            start: (m + 1,) new path `i` has the points `start[i]:start[i + 1]`.
            path: (m,) the paths from which the other columns are copied.

        Returns:
            The paths, and the columns of their points that are not default, by name. The caller may write to them
            before it uses the paths.
        """
        old: dict[str, Float] = {name: getattr(self, name) for name in _POINT_COLUMNS}
        old = {name: column for name, column in old.items() if not _is_default(column)}
        new = {name: np.zeros((int(start[-1]), *column.shape[1:])) for name, column in old.items()}
        for paths in _split_by_points(start):
            points = slice(int(start[paths.start]), int(start[paths.stop]))
            point, supported = find_points(paths)
            for name, column in old.items():
                indices = supported if name == "support_ratio" else point
                column.take(indices, axis=0, out=new[name][points], mode="clip")
        of_path = {name: getattr(self, name).take(path) for name in _PATH_COLUMNS}
        columns: dict[str, Any] = {**dict.fromkeys(_POINT_COLUMNS, _NOT_GIVEN), **new, **of_path}
        return replace(self, start=start, **columns), new

    def begins_at(self, layer: int) -> Bool:
        """Return which paths (M,) are on this layer (from 0), or on a later layer but rest at the same height.

        The latter are in the first layers of objects with their own layer plan.
        """
        rests = self.z_top - self.height < float(self.plan.bottom[layer]) + SAME_TOP
        return np.asarray((self.layer == layer) | ((self.layer > layer) & rests))

    @property
    def has_arcs(self) -> bool:
        """Whether any line is a chord of an arc."""
        return not _is_default(self.centre) and bool(np.isfinite(self.centre[:, 0]).any())

    @property
    def n_paths(self) -> int:
        """Number of paths."""
        return len(self.layer)

    @property
    def following(self) -> Int:
        """Index (N,) of the next point of each point; for the last point of an open path, its own index."""
        return next_in_ring(self.start, self.closed)

    @property
    def beads_of_each(self) -> Int:
        """Number of line segments of each path (M,); loops have one more than open paths, back to the first point."""
        return np.diff(self.start) - ~self.closed

    @property
    def path_of_point(self) -> Int:
        """Index (N,) of the path of each point."""
        return np.repeat(np.arange(self.n_paths), np.diff(self.start))

    @property
    def path_of_bead(self) -> Int:
        """Index (B,) of the path of each line segment."""
        return np.repeat(np.arange(self.n_paths), self.beads_of_each)

    def find_lowered(self, depth: float = 0.0) -> Bool:
        """Return a mask (M,) of the paths that are more than `depth` mm below their top somewhere, else with full flow.

        Scarf seams also are lower than their top, but the rest of their flow comes at the top.
        """
        result = np.zeros(self.n_paths, np.bool_)
        owner = self.path_of_point
        result[owner[self.z_offset < -depth]] = True
        result[owner[(self.z_offset == 0) & (self.flow_ratio < 1)]] = False
        return result

    @property
    def ends_of_beads(self) -> tuple[Int, Int]:
        """Indices of the start points (B,) and end points (B,) of all line segments."""
        begin = consecutive(self.start[:-1], self.beads_of_each)
        return begin, self.following.take(begin)

    def steps(self) -> Float:
        """Return the distance (N,) from each point to the next one, mm; 0 at the end of an open path."""
        return np.asarray(np.hypot(*(self.xy.take(self.following, axis=0) - self.xy).T))

    def length(self) -> Float:
        """Return the length of each path (M,), mm."""
        return polyline_lengths(self.xy, self.start, self.closed)

    def area(self) -> Float:
        """Return the area that each path covers in the top view (M,), mm²: length times spacing."""
        if not self.n_paths:
            return np.zeros(0)
        spacing = bead.spacing(self.width, np.repeat(self.height, np.diff(self.start)))
        return np.add.reduceat(self.steps() * (spacing + spacing.take(self.following)) / 2, self.start[:-1])

    def path(self, index: int) -> Float:
        """Return the points (n, 2) of one path."""
        return self.xy[self.start[index] : self.start[index + 1]]


def _is_default(column: Float) -> bool:
    """Return whether a column holds only its default value, as a single value that numpy broadcasts."""
    return len(column) > 0 and column.strides[0] == 0


def _split_by_points(start: Int) -> list[slice]:
    """Split paths into slabs of about `_POINTS_AT_ONCE` points; path `i` has the points `start[i]:start[i + 1]`."""
    first = np.searchsorted(start, np.arange(0, int(start[-1]), _POINTS_AT_ONCE))
    cuts = distinct(np.append(first, len(start) - 1)).tolist()
    return [slice(*ends) for ends in itertools.pairwise(cuts)]


def _renumber_chains(parts: Sequence[Int]) -> Int:
    """Concatenate chain ids of several parts, renumbered so that chains of different parts stay separate."""
    used = np.cumsum([0, *(int(ids.max(initial=-1)) + 1 for ids in parts)])
    numbered = [np.where(ids < 0, -1, ids + first) for ids, first in zip(parts, used, strict=False)]
    return np.concatenate([np.zeros(0, np.int64), *numbered])


def reorder_ragged(columns: Sequence[Float], size: Int, order: Int) -> tuple[list[Float], Int]:
    """Put the items of ragged columns in another order; return the columns and the sizes of the items."""
    first, counts = (np.cumsum(size) - size)[order], size[order]
    chosen = consecutive(first, counts)
    return [column.take(chosen, axis=0) for column in columns], counts


class Fan(Struct, frozen=True):
    """Set the part fan before move `index`; `ratio` 0 to 1."""

    index: int
    ratio: float


class Heat(Struct, frozen=True):
    """Set temperatures, °C, before move `index`; None leaves a heater unchanged; `tool` selects the nozzle."""

    index: int
    nozzle: float | None = None
    bed: float | None = None
    tool: int = 0


class Acceleration(Struct, frozen=True):
    """Set the acceleration `value`, mm/s², from move `index` on; also of travels if the firmware has one value."""

    index: int
    value: float


class PressureAdvance(Struct, frozen=True):
    """Set the pressure advance, s, from move `index` on."""

    index: int
    seconds: float


class ToolChange(Struct, frozen=True):
    """Switch to extruder `tool`, an index in `Profile.extruders`, before move `index`."""

    index: int
    tool: int


Event = Fan | Heat | Acceleration | PressureAdvance | ToolChange


class Program(SvgRepr, Struct, frozen=True, eq=False, weakref=True):
    """The moves of a print, before they are written as G-code: straight lines between positions.

    Attributes:
        plan: the layers.
        origin: (3,) position of the nozzle before the first move.
        xyz: (K, 3) position at the end of each move.
        filament: (K,) mm of filament fed during the move; negative retracts.
        speed: (K,) mm/s along the path; along the filament for moves of the extruder alone.
        layer: (K,) layer index, ascending.
        role: (K,) `Role` of each move, as int16; TRAVEL for every move that does not extrude.
        width: (K,) mean extrusion width, mm; 0 for TRAVEL.
        height: (K,) height of the extrusion, mm; 0 for TRAVEL.
        centre: (K, 2) mm, centre of the arc of which the move is a chord; chords of one arc are consecutive. nan
            (default): a straight move.
        events: changes of fan, heaters, accelerations and tools, by ascending index.
        z_top: (K,) z at which the nozzle prints the path of the move, or for a travel the next path, mm. Default: the
            top of the layer.
        tool: (K,) index in `Profile.extruders` of the extruder in use, as int16. Default 0.
    """

    plan: LayerPlan
    origin: Float
    xyz: Float
    filament: Float
    speed: Float
    layer: Int
    role: SmallInt
    width: Float
    height: Float
    events: tuple[Event, ...] = ()
    centre: Float = field(default_factory=lambda: _NOT_GIVEN)
    z_top: Float = field(default_factory=lambda: _NOT_GIVEN)
    tool: SmallInt = field(default_factory=lambda: _NO_NUMBERS)

    def __post_init__(self) -> None:
        n_moves = len(self.xyz)
        if self.tool is _NO_NUMBERS:
            force_setattr(self, "tool", np.zeros(n_moves, np.int16))
        if self.z_top is _NOT_GIVEN:
            force_setattr(self, "z_top", self.plan.top[self.layer])
        if self.centre is _NOT_GIVEN:
            force_setattr(self, "centre", np.broadcast_to(np.float64(np.nan), (n_moves, 2)))
        for name, dtype, shape in (
            ("origin", np.float64, (3,)),
            ("xyz", np.float64, (-1, 3)),
            ("filament", np.float64, (n_moves,)),
            ("speed", np.float64, (n_moves,)),
            ("layer", np.int64, (n_moves,)),
            ("role", np.int16, (n_moves,)),
            ("width", np.float64, (n_moves,)),
            ("height", np.float64, (n_moves,)),
            ("centre", np.float64, (n_moves, 2)),
            ("z_top", np.float64, (n_moves,)),
            ("tool", np.int16, (n_moves,)),
        ):
            if name not in _MAY_BE_DEFAULT or not _is_default(getattr(self, name)):
                force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        metres = self.filament_used / 1000
        return f"<Program: {self.plan.n_layers} layers, {self.n_moves} moves, {metres:.4g} m of filament>"

    @property
    def has_arcs(self) -> bool:
        """Whether any move is a chord of an arc."""
        return not _is_default(self.centre) and bool(np.isfinite(self.centre[:, 0]).any())

    @property
    def on_same_arc(self) -> Bool:
        """Mask (K,) of the moves that are chords of the same arc as the move before."""
        return self.find_same_arcs(slice(0, self.n_moves))

    def find_same_arcs(self, moves: slice) -> Bool:
        """Return a mask (n,) of a range of moves: chords of the same arc as the move before in the range."""
        same = np.zeros(moves.stop - moves.start, np.bool_)
        if not _is_default(self.centre):  # nan never equals nan
            centre = self.centre[moves]
            same[1:] = (centre[1:] == centre[:-1]).all(axis=1)
        return same

    @property
    def n_moves(self) -> int:
        """Number of moves."""
        return len(self.xyz)

    @property
    def start(self) -> Float:
        """Position (K, 3) at the start of each move, mm."""
        return np.concatenate([self.origin[None], self.xyz[:-1]])

    @property
    def printed(self) -> Int:
        """Indices of the layers that have extrusions; a layer has none if the part is too thin there."""
        return distinct(self.layer[self.role != Role.TRAVEL])

    @property
    def climbs(self) -> bool:
        """Whether z changes during extrusions, as in spirals and scarf seams."""
        beads = self.role != Role.TRAVEL
        return bool((self.xyz[beads, 2] != self.start[beads, 2]).any())

    @property
    def filament_used(self) -> float:
        """Length of filament in all extrusions, mm."""
        return float(self.filament[self.role != Role.TRAVEL].sum())
