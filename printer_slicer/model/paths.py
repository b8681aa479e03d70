"""What is printed: paths, then moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import (
    Bool,
    Float,
    Int,
    consecutive,
    distinct,
    following_around,
    frozen_array,
    lengths,
)
from printer_slicer.model.layers import SAME_TOP, LayerPlan
from printer_slicer.roles import Role
from printer_slicer.showing import Drawn

__all__ = [
    "Acceleration",
    "Event",
    "Fan",
    "Heat",
    "PressureAdvance",
    "Program",
    "ToolChange",
    "Toolpaths",
    "reordered",
]


_NOT_GIVEN: Final = np.zeros(0)
_NO_NUMBERS: Final = np.zeros(0, np.int64)
_MAY_BE_USUAL: Final = ("carried", "rise", "share", "centre")
_OF_POINTS: Final = ("xy", "width", "carried", "rise", "share", "centre")
_OF_PATHS: Final = ("layer", "role", "height", "closed", "sweep", "rule", "z_top", "tool")


@dataclass(frozen=True, slots=True, eq=False)
class Toolpaths(Drawn):
    """Polylines to print: path `i` is `xy[start[i]:start[i + 1]]`.

    Attributes:
        plan: the layers that are printed.
        xy: (N, 2) mm; a closed path does not repeat its first point.
        width: (N,) extrusion width at each point; between two points it changes evenly.
        start: (M + 1,) where each path begins.
        layer: (M,) ascending.
        role: (M,) a `Role` each.
        height: (M,) how high the bead is: the layer's height, unless it reaches down through several layers or is
            squeezed less.
        closed: (M,) whether the path returns to its first point.
        carried: (N,) share of the bead's width, 0 to 1, that lies over the layer below from each point to the next;
            1 everywhere where it is not given.
        sweep: (M,) paths with the same number follow each other as they stand, or all of them turned around and the
            last one first; -1, everywhere where it is not given, for those that may be printed in any order.
        rise: (N,) mm from the top of the layer up to the nozzle, negative below it; 0 where it is not given.
        share: (N,) how much of the bead's cross-section is laid; between two points both change evenly. 1 where it is
            not given.
        centre: (N, 2) mm, of the arc that the line to the next point is a chord of; nan, everywhere where it is not
            given, for lines.
        rule: (M,) the number of the profile whose speeds and flow each path has; 0 everywhere where it is not given.
        z_top: (M,) mm, where the nozzle prints; the top of the path's layer where it is not given.
        tool: (M,) the extruder that prints each path, by its number in `Profile.extruders`; 0 where it is not given.
    """

    plan: LayerPlan
    xy: Float
    width: Float
    start: Int
    layer: Int
    role: Int
    height: Float
    closed: Bool
    carried: Float = field(default_factory=lambda: _NOT_GIVEN)
    sweep: Int = field(default_factory=lambda: _NO_NUMBERS)
    rise: Float = field(default_factory=lambda: _NOT_GIVEN)
    share: Float = field(default_factory=lambda: _NOT_GIVEN)
    centre: Float = field(default_factory=lambda: _NOT_GIVEN)
    rule: Int = field(default_factory=lambda: _NO_NUMBERS)
    z_top: Float = field(default_factory=lambda: _NOT_GIVEN)
    tool: Int = field(default_factory=lambda: _NO_NUMBERS)

    def __post_init__(self) -> None:
        n_points, n_paths = len(self.xy), len(self.layer)
        for name, value, shape in (
            ("carried", 1.0, (n_points,)),
            ("rise", 0.0, (n_points,)),
            ("share", 1.0, (n_points,)),
            ("centre", np.nan, (n_points, 2)),
        ):
            if getattr(self, name) is _NOT_GIVEN:
                object.__setattr__(self, name, np.broadcast_to(np.float64(value), shape))
        if self.sweep is _NO_NUMBERS:
            object.__setattr__(self, "sweep", np.full(n_paths, -1))
        for name in ("rule", "tool"):
            if getattr(self, name) is _NO_NUMBERS:
                object.__setattr__(self, name, np.zeros(n_paths, np.int64))
        if self.z_top is _NOT_GIVEN:
            object.__setattr__(self, "z_top", self.plan.top[self.layer])
        for name, dtype, shape in (
            ("xy", np.float64, (-1, 2)),
            ("width", np.float64, (n_points,)),
            ("start", np.int64, (n_paths + 1,)),
            ("layer", np.int64, (n_paths,)),
            ("role", np.int64, (n_paths,)),
            ("height", np.float64, (n_paths,)),
            ("closed", np.bool_, (n_paths,)),
            ("carried", np.float64, (n_points,)),
            ("sweep", np.int64, (n_paths,)),
            ("rise", np.float64, (n_points,)),
            ("share", np.float64, (n_points,)),
            ("centre", np.float64, (n_points, 2)),
            ("rule", np.int64, (n_paths,)),
            ("z_top", np.float64, (n_paths,)),
            ("tool", np.int64, (n_paths,)),
        ):
            if name not in _MAY_BE_USUAL or not _is_usual(getattr(self, name)):
                object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        metres = float(self.length().sum()) / 1000
        return f"<Toolpaths: {self.plan.n_layers} layers, {self.n_paths} paths, {metres:.4g} m>"

    @classmethod
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
        carried: Float | None = None,
        sweep: Int | None = None,
        slope: tuple[Float, Float] | None = None,
        rule: Int | None = None,
    ) -> Toolpaths:
        """Paths given one after the other with `size` (M,) points each, in any order of layers.

        `width` is (N,) for each point or (M,) for each path; `height` (M,) is the layer's where it is not given. All of
        it is carried and free to be ordered where `carried` and `sweep` are not given. `slope` is `rise` and `share`;
        all has the first of the profiles where `rule` is not given.
        """
        flags = np.full(len(layer), closed) if isinstance(closed, bool) else closed
        heights = plan.height[layer] if height is None else height
        widths = width if len(width) == len(xy) else np.repeat(width, size)
        shares = _NOT_GIVEN if carried is None else carried
        sweeps = np.full(len(layer), -1) if sweep is None else sweep
        rise, share = (_NOT_GIVEN, _NOT_GIVEN) if slope is None else slope
        rules = np.zeros(len(layer), np.int64) if rule is None else rule
        if (np.diff(layer) < 0).any():
            order = np.argsort(layer, kind="stable")
            before = size
            (xy, widths), size = reordered((xy, widths), before, order)
            if carried is not None:
                (shares,), _ = reordered((carried,), before, order)
            if slope is not None:
                (rise, share), _ = reordered(slope, before, order)
            layer, role, flags = layer[order], role[order], flags[order]
            heights, sweeps, rules = heights[order], sweeps[order], rules[order]
        start = np.concatenate([[0], np.cumsum(size)])
        return cls(
            plan, xy, widths, start, layer, role, heights, flags, shares, sweeps, rise, share, rule=rules
        )

    @classmethod
    def joined(cls, plan: LayerPlan, parts: Sequence[Toolpaths]) -> Toolpaths:
        """All paths of several values, by layer; within a layer in the order of `parts`.

        The layers of all of them are those of `plan`, and the nozzle prints at their tops.
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
            carried=np.concatenate([part.carried for part in parts]),
            sweep=_numbered_apart([part.sweep for part in parts]),
            slope=None
            if all(_is_usual(part.rise) and _is_usual(part.share) for part in parts)
            else (
                np.concatenate([part.rise for part in parts]),
                np.concatenate([part.share for part in parts]),
            ),
            rule=np.concatenate([part.rule for part in parts]),
        )
        tool = np.concatenate([part.tool for part in parts])
        by_layer = np.argsort(np.concatenate([part.layer for part in parts]), kind="stable")
        return replace(joined, tool=tool[by_layer]) if tool.any() else joined

    def on_plan(self, plan: LayerPlan, lift: float = 0.0) -> Toolpaths:
        """The same paths `lift` mm higher on another plan that has layers with their tops; heights stay."""
        layer = plan.find_tops(self.plan.top + lift)[self.layer]
        return replace(self, plan=plan, layer=layer, z_top=plan.top[layer])

    def with_tool(self, tool: int) -> Toolpaths:
        """The same paths printed by another extruder."""
        return replace(self, tool=np.full(self.n_paths, tool))

    def ruled(self, of_layer: Int) -> Toolpaths:
        """The same paths with the profiles that the layers (L,) have, by number."""
        return replace(self, rule=of_layer[self.layer])

    def take(self, chosen: Int) -> Toolpaths:
        """Some of the paths, by their indices; their layers must ascend."""
        size = np.diff(self.start)[chosen]
        points = consecutive(self.start[chosen], size)
        return self.of_points(points, np.append(0, np.cumsum(size)), chosen)

    def of_points(self, point: Int, start: Int, path: Int) -> Toolpaths:
        """Paths made of some points (n,), with what else there is to know from `path` (m,).

        Path `i` of them has the points `point[start[i]:start[i + 1]]`. `carried` goes with the points: it is right for
        paths that keep their direction.
        """
        columns: dict[str, Any] = {name: getattr(self, name) for name in _OF_POINTS}
        columns = {
            name: _NOT_GIVEN if _is_usual(column) else column.take(point, axis=0)
            for name, column in columns.items()
        }
        of_path = {name: getattr(self, name).take(path) for name in _OF_PATHS}
        return replace(self, start=start, **columns, **of_path)

    def begins_at(self, layer: int) -> Bool:
        """(M,) paths of this layer, and of later ones those that rest on what it rests on.

        The latter are first layers of objects with layers of their own.
        """
        rests = self.z_top - self.height < float(self.plan.bottom[layer]) + SAME_TOP
        return np.asarray((self.layer == layer) | ((self.layer > layer) & rests))

    @property
    def has_arcs(self) -> bool:
        """Whether some lines are chords of arcs."""
        return not _is_usual(self.centre) and bool(np.isfinite(self.centre[:, 0]).any())

    @property
    def n_paths(self) -> int:
        """Number of paths."""
        return len(self.layer)

    @property
    def following(self) -> Int:
        """(N,) the point after each; itself at the end of an open path."""
        return following_around(self.start, self.closed)

    @property
    def beads_of_each(self) -> Int:
        """(M,) number of lines from point to point, the last one of a loop to its first point."""
        return np.diff(self.start) - ~self.closed

    @property
    def ends_of_beads(self) -> tuple[Int, Int]:
        """(B,) both: the points at which the lines of all paths begin, and those at which they end."""
        begin = consecutive(self.start[:-1], self.beads_of_each)
        return begin, self.following.take(begin)

    def steps(self) -> Float:
        """(N,) mm from each point to the one after it; 0 at the end of an open path."""
        return np.asarray(np.hypot(*(self.xy.take(self.following, axis=0) - self.xy).T))

    def length(self) -> Float:
        """(M,) length of each path, mm."""
        return lengths(self.xy, self.start, self.closed)

    def area(self) -> Float:
        """(M,) mm² that the beads fill, seen from above: length times spacing, which changes evenly between points."""
        if not self.n_paths:
            return np.zeros(0)
        spacing = bead.spacing(self.width, np.repeat(self.height, np.diff(self.start)))
        return np.add.reduceat(self.steps() * (spacing + spacing.take(self.following)) / 2, self.start[:-1])

    def path(self, index: int) -> Float:
        """(n, 2) the points of one path."""
        return self.xy[self.start[index] : self.start[index + 1]]


def _is_usual(column: Float) -> bool:
    """Whether a column was not given: one value stands for all, and takes no room."""
    return len(column) > 0 and column.strides[0] == 0


def _numbered_apart(sweeps: Sequence[Int]) -> Int:
    """The numbers of several parts one after the other, so that sweeps of different parts stay different."""
    used = np.cumsum([0, *(int(sweep.max(initial=-1)) + 1 for sweep in sweeps)])
    numbered = [np.where(sweep < 0, -1, sweep + first) for sweep, first in zip(sweeps, used, strict=False)]
    return np.concatenate([np.zeros(0, np.int64), *numbered])


def reordered(columns: Sequence[Float], size: Int, order: Int) -> tuple[list[Float], Int]:
    """Ragged columns and sizes with their items in another order."""
    first, counts = (np.cumsum(size) - size)[order], size[order]
    chosen = consecutive(first, counts)
    return [column.take(chosen, axis=0) for column in columns], counts


@dataclass(frozen=True, slots=True)
class Fan:
    """Set the part fan before move `index`; `ratio` 0 to 1."""

    index: int
    ratio: float


@dataclass(frozen=True, slots=True)
class Heat:
    """Set a temperature before move `index`; None leaves that heater as it is; `tool` is the nozzle's."""

    index: int
    nozzle: float | None = None
    bed: float | None = None
    tool: int = 0


@dataclass(frozen=True, slots=True)
class Acceleration:
    """Accelerate by `value`, mm/s², from move `index` on: beads, and where the firmware has one for all moves, all."""

    index: int
    value: float


@dataclass(frozen=True, slots=True)
class PressureAdvance:
    """Push filament ahead by `seconds` of the extruder's speed from move `index` on."""

    index: int
    seconds: float


@dataclass(frozen=True, slots=True)
class ToolChange:
    """Print with another extruder from move `index` on, by its number in `Profile.extruders`."""

    index: int
    tool: int


Event = Fan | Heat | Acceleration | PressureAdvance | ToolChange


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Program(Drawn):
    """Moves before they become text: straight lines from one position to the next.

    Attributes:
        plan: the layers.
        origin: (3,) position of the nozzle before the first move.
        xyz: (K, 3) position at the end of each move.
        filament: (K,) mm of filament fed during the move; negative retracts.
        speed: (K,) along the path; along the filament for moves that only turn the extruder.
        layer: (K,) ascending.
        role: (K,) a `Role` each; TRAVEL for everything that lays no bead.
        width: (K,) extrusion width, in the mean along the move, 0 for TRAVEL.
        height: (K,) how high the bead is, 0 for TRAVEL.
        centre: (K, 2) mm, of the arc that the move is a chord of, all chords of one arc behind each other; nan,
            everywhere where it is not given, for straight moves.
        events: changes of fan, heaters, accelerations and tools, by ascending index.
        z_top: (K,) mm, where the nozzle prints the path of the move, or the one that it leads to; the top of its layer
            where it is not given.
        tool: (K,) the extruder in use, by its number in `Profile.extruders`; 0 where it is not given.
    """

    plan: LayerPlan
    origin: Float
    xyz: Float
    filament: Float
    speed: Float
    layer: Int
    role: Int
    width: Float
    height: Float
    events: tuple[Event, ...] = ()
    centre: Float = field(default_factory=lambda: _NOT_GIVEN)
    z_top: Float = field(default_factory=lambda: _NOT_GIVEN)
    tool: Int = field(default_factory=lambda: _NO_NUMBERS)

    def __post_init__(self) -> None:
        n_moves = len(self.xyz)
        if self.tool is _NO_NUMBERS:
            object.__setattr__(self, "tool", np.zeros(n_moves, np.int64))
        if self.z_top is _NOT_GIVEN:
            object.__setattr__(self, "z_top", self.plan.top[self.layer])
        if self.centre is _NOT_GIVEN:
            object.__setattr__(self, "centre", np.broadcast_to(np.float64(np.nan), (n_moves, 2)))
        for name, dtype, shape in (
            ("origin", np.float64, (3,)),
            ("xyz", np.float64, (-1, 3)),
            ("filament", np.float64, (n_moves,)),
            ("speed", np.float64, (n_moves,)),
            ("layer", np.int64, (n_moves,)),
            ("role", np.int64, (n_moves,)),
            ("width", np.float64, (n_moves,)),
            ("height", np.float64, (n_moves,)),
            ("centre", np.float64, (n_moves, 2)),
            ("z_top", np.float64, (n_moves,)),
            ("tool", np.int64, (n_moves,)),
        ):
            if name not in _MAY_BE_USUAL or not _is_usual(getattr(self, name)):
                object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        metres = self.filament_used / 1000
        return f"<Program: {self.plan.n_layers} layers, {self.n_moves} moves, {metres:.4g} m of filament>"

    @property
    def has_arcs(self) -> bool:
        """Whether some moves are chords of arcs."""
        return not _is_usual(self.centre) and bool(np.isfinite(self.centre[:, 0]).any())

    @property
    def on_same_arc(self) -> Bool:
        """(K,) moves that are chords of the same arc as the move before."""
        same = np.zeros(self.n_moves, np.bool_)
        if self.has_arcs:  # no centre is equal to none
            same[1:] = (self.centre[1:] == self.centre[:-1]).all(axis=1)
        return same

    @property
    def n_moves(self) -> int:
        """Number of moves."""
        return len(self.xyz)

    @property
    def start(self) -> Float:
        """(K, 3) position at the beginning of each move."""
        return np.concatenate([self.origin[None], self.xyz[:-1]])

    @property
    def printed(self) -> Int:
        """The layers that hold plastic; those where the part is narrower than a bead do not."""
        return distinct(self.layer[self.role != Role.TRAVEL])

    @property
    def climbs(self) -> bool:
        """Whether beads are laid while z changes: in spirals, and in seams that are slopes."""
        beads = self.role != Role.TRAVEL
        return bool((self.xyz[beads, 2] != self.start[beads, 2]).any())

    @property
    def filament_used(self) -> float:
        """Filament in the beads, mm."""
        return float(self.filament[self.role != Role.TRAVEL].sum())
