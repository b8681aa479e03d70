"""The values that flow: Mesh -> LayerPlan -> Sections -> Walls, Regions -> Toolpaths -> Program.

All are frozen and hold read-only arrays. Letters in shapes: F facets, L layers, R rings, M paths, N points, K moves.
Lengths are mm, times s, speeds mm/s, temperatures °C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from printer_slicer.geometry import Areas, Bool, Float, Int, frozen_array
from printer_slicer.geometry.areas import consecutive

__all__ = [
    "Areas",
    "Bool",
    "Contours",
    "Event",
    "Fan",
    "Faults",
    "Float",
    "Gap",
    "Heat",
    "Int",
    "LayerPlan",
    "Mesh",
    "Program",
    "Regions",
    "Repair",
    "Repairs",
    "Role",
    "Sections",
    "Toolpaths",
    "Walls",
    "reordered",
]

_BLOCK = 1 << 12  # facets: what fits the cache


class Role(IntEnum):
    """Why a bead is laid. The order is the order in which the parts of one island are printed."""

    TRAVEL = 0
    SKIRT = 1
    BRIM = 2
    INNER_PERIMETER = 3
    OUTER_PERIMETER = 4
    BRIDGE = 5
    BOTTOM_SKIN = 6
    SOLID = 7
    TOP_SKIN = 8
    SPARSE = 9


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Mesh:
    """The surface of the part as loose triangles, as an STL file has them.

    Neighbours share the coordinates of their corners exactly.

    Attributes:
        triangles: (F, 3, 3) mm; corners counter-clockwise seen from outside.
        name: what to call the part in messages.
    """

    triangles: Float
    name: str = "part"

    def __post_init__(self) -> None:
        object.__setattr__(self, "triangles", frozen_array(self.triangles, np.float64, (-1, 3, 3)))

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.triangles)

    @property
    def bounds(self) -> Float:
        """(2, 3) lowest and highest corner of the envelope, mm."""
        # Axis by axis: reducing strided columns is twenty times faster than reducing rows of three.
        columns = [self.triangles[:, :, axis] for axis in range(3)]
        return np.array([[column.min() for column in columns], [column.max() for column in columns]])

    @property
    def size(self) -> Float:
        """(3,) edge lengths of the envelope, mm."""
        low, high = self.bounds
        return np.asarray(high - low)

    @property
    def height(self) -> float:
        """Top of the part over z = 0, mm."""
        return float(self.triangles[:, :, 2].max())

    @property
    def volume(self) -> float:
        """Signed volume, mm³; negative when the facets face inward."""
        # In blocks, coordinate by coordinate: seven times as fast as whole arrays, and no second copy of a large mesh.
        # Seen from the middle of the first facet: turned inside out, an open mesh has exactly the opposite volume too.
        middle = self.triangles[:1].mean(axis=(0, 1)) if self.n_facets else np.zeros(3)
        total, origin = 0.0, np.tile(middle, 3)[:, None]
        for start in range(0, self.n_facets, _BLOCK):
            block = self.triangles[start : start + _BLOCK].reshape(-1, 9)
            a, b, c = np.subtract(block.T, origin, order="C").reshape(3, 3, -1)
            total += sum(float(a[i] @ (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2])) for i in range(3))
        return total / 6

    def moved(self, by: Float | tuple[float, float, float]) -> Mesh:
        """The same part, shifted by (x, y, z) mm."""
        return Mesh(self.triangles + np.asarray(by, dtype=np.float64), self.name)


@dataclass(frozen=True, slots=True, eq=False)
class LayerPlan:
    """Where the layers end and where the mesh is cut for each.

    Attributes:
        top: (L,) z of the top of each layer, strictly increasing; the nozzle prints at this height.
        cut: (L,) z at which the mesh is cut for each layer, within the layer.
        planner: name of the strategy that made the plan.
        containment: "mid": a layer has the section at `cut`; "positive": everything that the part covers anywhere
            between bottom and top; "negative": only what it covers everywhere between them.
    """

    top: Float
    cut: Float
    planner: str = ""
    containment: str = "mid"

    def __post_init__(self) -> None:
        object.__setattr__(self, "top", frozen_array(self.top, np.float64, (-1,)))
        object.__setattr__(self, "cut", frozen_array(self.cut, np.float64, (len(self.top),)))

    @classmethod
    def from_tops(cls, top: Float, planner: str = "", *, cut_ratio: float = 0.5) -> LayerPlan:
        """A plan cut at `cut_ratio` of each layer's height: 0 bottom, 0.5 middle, 1 top."""
        bottom = np.concatenate([[0.0], top[:-1]])
        return cls(top, bottom + cut_ratio * (top - bottom), planner)

    @property
    def n_layers(self) -> int:
        """Number of layers."""
        return len(self.top)

    @property
    def bottom(self) -> Float:
        """(L,) z of the bottom of each layer."""
        return np.concatenate([[0.0], self.top[:-1]])

    @property
    def height(self) -> Float:
        """(L,) layer heights."""
        # Rounded to 0.1 nm: differences of tops carry floating-point dust that would make equal layers unequal.
        return np.round(self.top - self.bottom, 7)

    def runs(self) -> list[tuple[int, float]]:
        """Consecutive layers of equal height: [(count, height in mm), ...]."""
        heights = np.round(self.height, 6)
        starts = np.flatnonzero(np.diff(heights, prepend=np.nan) != 0)
        counts = np.diff(np.append(starts, len(heights)))
        return [(int(n), float(heights[i])) for n, i in zip(counts, starts, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Contours:
    """The contour of every layer as the mesh gives it, before and after it is put in order.

    Attributes:
        segments: (S, 2, 2) mm, one per facet and plane, in the order of the facets, solid to the left: the raw contour.
        segment_layer: (S,) layer of each segment.
        joined: the same segments joined tail to head into closed rings, every point kept.
        repaired: `joined` without repeated and collinear points: the repaired contour.
    """

    segments: Float
    segment_layer: Int
    joined: Areas
    repaired: Areas

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", frozen_array(self.segments, np.float64, (-1, 2, 2)))
        n_segments = len(self.segments)
        object.__setattr__(self, "segment_layer", frozen_array(self.segment_layer, np.int64, (n_segments,)))


@dataclass(frozen=True, slots=True, eq=False)
class Faults:
    """What keeps a mesh from bounding a solid, each as middle points (n, 3) of edges, mm.

    Attributes:
        open_edges: edges with a facet on one side only.
        flipped_edges: edges whose two facets face opposite ways.
        crowded_edges: edges that more than two facets share; solids that touch along an edge have them too.
    """

    open_edges: Float
    flipped_edges: Float
    crowded_edges: Float

    def __post_init__(self) -> None:
        for name in ("open_edges", "flipped_edges", "crowded_edges"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, (-1, 3)))

    @property
    def count(self) -> int:
        """How many edges in all."""
        return len(self.open_edges) + len(self.flipped_edges) + len(self.crowded_edges)


@dataclass(frozen=True, slots=True, eq=False)
class Repair:
    """What was done to a mesh for one reason.

    Attributes:
        kind: what, in words: "facets turned round".
        places: (n, 3) mm, one for each time it was done.
        widest: the farthest that a corner was moved, or the largest hole that was closed, mm; 0 where neither.
        area: mm² of surface that was guessed.
    """

    kind: str
    places: Float
    widest: float = 0.0
    area: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen_array(self.places, np.float64, (-1, 3)))

    @property
    def count(self) -> int:
        """How often."""
        return len(self.places)


@dataclass(frozen=True, slots=True)
class Repairs:
    """All that was done to a mesh before it was cut, in the order in which it was done; `sound`: it was one shell."""

    done: tuple[Repair, ...] = ()
    sound: bool = False

    @property
    def count(self) -> int:
        """How many places in all."""
        return sum(repair.count for repair in self.done)


@dataclass(frozen=True, slots=True)
class Gap:
    """A place where the mesh is open: the contour of a layer had to be closed over `width` mm."""

    layer: int
    x: float
    y: float
    z: float
    width: float

    @property
    def area(self) -> float:
        """Mm² by which the section is off if the missing wall stays within the circle over the gap: half a disc."""
        return float(np.pi / 8 * self.width**2)


@dataclass(frozen=True, slots=True, eq=False)
class Sections:
    """The solid area of the part in each layer, simplified to the resolution of the profile.

    Attributes:
        plan: the layers.
        solid: clean areas.
        open_edges: edges that the cut planes cross and that lack a neighbour, or whose neighbour faces the other way.
        gaps: where contours were closed over such edges, widest first.
        turned: what contours run around the wrong way, as a shell that crosses itself does, or a void that reaches out
            of the solid; it is left out. Its own rings run clockwise. None where there is nothing of it.
    """

    plan: LayerPlan
    solid: Areas
    open_edges: int = 0
    gaps: tuple[Gap, ...] = ()
    turned: Areas | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Centre lines of the perimeters, and what is left inside them.

    Attributes:
        plan: the layers.
        width: (L,) extrusion width of each layer's perimeters.
        loops: centre lines, outermost first; one `Areas` per depth.
        inside: the area that skins and infill have to fill.
        lost: (L,) mm² of each section outside the walls and between them that is too narrow for a bead and stays empty.
    """

    plan: LayerPlan
    width: Float
    loops: tuple[Areas, ...]
    inside: Areas
    lost: Float

    def __post_init__(self) -> None:
        for name in ("width", "lost"):
            object.__setattr__(
                self, name, frozen_array(getattr(self, name), np.float64, (self.plan.n_layers,))
            )


@dataclass(frozen=True, slots=True, eq=False)
class Regions:
    """What is inside the walls, by purpose; no overlap within a layer.

    Attributes:
        plan: the layers.
        bottom_skin: solid, on the bed.
        bridge: solid, nothing but air below.
        top_skin: solid, nothing above.
        solid: solid, within the shell thickness of a surface but not at it.
        sparse: to be filled with the infill pattern.
        bridge_angle: (L,) radians; the direction in which most bridge lines rest on something at both ends.
    """

    plan: LayerPlan
    bottom_skin: Areas
    bridge: Areas
    top_skin: Areas
    solid: Areas
    sparse: Areas
    bridge_angle: Float

    def __post_init__(self) -> None:
        angle = frozen_array(self.bridge_angle, np.float64, (self.plan.n_layers,))
        object.__setattr__(self, "bridge_angle", angle)


@dataclass(frozen=True, slots=True, eq=False)
class Toolpaths:
    """Polylines to print: path `i` is `xy[start[i]:start[i + 1]]`.

    Attributes:
        plan: the layers.
        xy: (N, 2) mm; a closed path does not repeat its first point.
        start: (M + 1,) where each path begins.
        layer: (M,) ascending.
        role: (M,) a `Role` each.
        width: (M,) extrusion width.
        closed: (M,) whether the path returns to its first point.
    """

    plan: LayerPlan
    xy: Float
    start: Int
    layer: Int
    role: Int
    width: Float
    closed: Bool

    def __post_init__(self) -> None:
        n_paths = len(self.layer)
        for name, dtype, shape in (
            ("xy", np.float64, (-1, 2)),
            ("start", np.int64, (n_paths + 1,)),
            ("layer", np.int64, (n_paths,)),
            ("role", np.int64, (n_paths,)),
            ("width", np.float64, (n_paths,)),
            ("closed", np.bool_, (n_paths,)),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

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
    ) -> Toolpaths:
        """Paths given one after the other with `size` (M,) points each, in any order of layers."""
        if (np.diff(layer) < 0).any():
            order = np.argsort(layer, kind="stable")
            xy, size = reordered(xy, size, order)
            layer, role, width = layer[order], role[order], width[order]
            closed = closed if isinstance(closed, bool) else closed[order]
        flags = np.full(len(layer), closed) if isinstance(closed, bool) else closed
        return cls(plan, xy, np.concatenate([[0], np.cumsum(size)]), layer, role, width, flags)

    @classmethod
    def joined(cls, plan: LayerPlan, parts: Sequence[Toolpaths]) -> Toolpaths:
        """All paths of several values, by layer; within a layer in the order of `parts`."""
        return cls.gathered(
            plan,
            xy=np.concatenate([part.xy for part in parts]),
            size=np.concatenate([np.diff(part.start) for part in parts]),
            layer=np.concatenate([part.layer for part in parts]),
            role=np.concatenate([part.role for part in parts]),
            width=np.concatenate([part.width for part in parts]),
            closed=np.concatenate([part.closed for part in parts]),
        )

    @property
    def n_paths(self) -> int:
        """Number of paths."""
        return len(self.layer)

    def path(self, index: int) -> Float:
        """(n, 2) the points of one path."""
        return self.xy[self.start[index] : self.start[index + 1]]


def reordered(xy: Float, size: Int, order: Int) -> tuple[Float, Int]:
    """Ragged points and sizes with their items in another order."""
    first, counts = (np.cumsum(size) - size)[order], size[order]
    return xy[consecutive(first, counts)], counts


@dataclass(frozen=True, slots=True)
class Fan:
    """Set the part fan before move `index`; `ratio` 0 to 1."""

    index: int
    ratio: float


@dataclass(frozen=True, slots=True)
class Heat:
    """Set a temperature before move `index`; None leaves that heater as it is."""

    index: int
    nozzle: float | None = None
    bed: float | None = None


Event = Fan | Heat


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """Moves before they become text: straight lines from one position to the next.

    Attributes:
        plan: the layers.
        origin: (3,) position of the nozzle before the first move.
        xyz: (K, 3) position at the end of each move.
        filament: (K,) mm of filament fed during the move; negative retracts.
        speed: (K,) along the path; along the filament for moves that only turn the extruder.
        layer: (K,) ascending.
        role: (K,) a `Role` each; TRAVEL for everything that lays no bead.
        width: (K,) extrusion width, 0 for TRAVEL.
        events: fan and heater changes, by ascending index.
    """

    plan: LayerPlan
    origin: Float
    xyz: Float
    filament: Float
    speed: Float
    layer: Int
    role: Int
    width: Float
    events: tuple[Event, ...] = ()

    def __post_init__(self) -> None:
        n_moves = len(self.xyz)
        for name, dtype, shape in (
            ("origin", np.float64, (3,)),
            ("xyz", np.float64, (-1, 3)),
            ("filament", np.float64, (n_moves,)),
            ("speed", np.float64, (n_moves,)),
            ("layer", np.int64, (n_moves,)),
            ("role", np.int64, (n_moves,)),
            ("width", np.float64, (n_moves,)),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

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
        return np.unique(self.layer[self.role != Role.TRAVEL])

    @property
    def filament_used(self) -> float:
        """Filament in the beads, mm."""
        return float(self.filament[self.role != Role.TRAVEL].sum())
