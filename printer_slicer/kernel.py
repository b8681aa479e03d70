"""The compiled kernel: a C++ module for the slowest steps, which an installation has if a compiler was there.

Without it, Python code computes the same results. hatch_build.py compiles it from the files of kernel/. If
PRINTER_SLICER_KERNEL is `off`, the kernel is neither compiled nor used.
"""

from __future__ import annotations

import os
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol

from printer_slicer.errors import UsageError

__all__ = ["VARIABLE", "Buffer", "Kernel", "describe_kernel", "load_kernel"]

VARIABLE: Final = "PRINTER_SLICER_KERNEL"
_INTERFACE: Final = 10  # of the functions that are called here; the same number stands in kernel/kernel.cpp
_REASON: Final = Path(__file__).with_name("_kernel.txt")  # written by hatch_build.py if there is no kernel


Buffer = Any
"""An object with the buffer protocol, such as an array: `collections.abc.Buffer` of Python 3.12."""


class Kernel(Protocol):
    """Functions of the kernel. Arguments and results are arrays of int64 or float64 as bytes, in native order.

    Areas are three arrays: `xy`, `ring_start` and `ring_layer` of `Areas`.
    """

    CLIPPER2_VERSION: str

    def accumulate_with_limit(
        self, bound: memoryview, gain: memoryview, first: float, width: int, /
    ) -> bytes:
        """Compute running sums with limits; see `printer_slicer.motion.vectorized`.

        Args:
            bound: (n,) float64, upper bounds.
            gain: (n,) float64.
            first: the value before the first one.
            width: number of values per row, each of which starts at the end of the row before.

        Returns:
            The values (n,) as float64.

        Raises:
            ValueError: the arrays have different lengths, or the width is less than 1.
        """

    def build_polyline_tree(self, ends: memoryview, /) -> bytes:
        """Build a search tree for segments; see `printer_slicer.geometry.polyline_tree`.

        Args:
            ends: (S, 4) float64, x and y of start and end of each segment.

        Returns:
            The boxes of the tree, for `query_polyline_tree`.

        Raises:
            ValueError: a segment does not have four numbers.
        """

    def clip_outlines(self, *areas: Buffer) -> tuple[bytes, bytes, bytes]:
        """Return the parts of outlines within areas as `printer_slicer.geometry.clipper` does, on its grid.

        Args:
            areas: three arrays of the outlines, and three of the areas.

        Returns:
            The points of the open lines, the offset of each line, and its layer, like the arrays of areas.

        Raises:
            ValueError: the arrays do not match.
        """

    def combine_areas(self, operation: int, /, *areas: Buffer) -> tuple[bytes, bytes, bytes]:
        """Combine two areas layer by layer as `printer_slicer.geometry.clipper` does, on its grid.

        Args:
            operation: 0 union, 1 difference, 2 intersection.
            areas: six arrays, of both areas.

        Returns:
            The arrays of the result.

        Raises:
            ValueError: the arrays do not match.
        """

    def coordinate_keys(self, x: Buffer, y: Buffer, z: Buffer, /) -> bytes:
        """Return 64-bit keys (n,) of corners, given their coordinates as float64, (n,) each.

        See `printer_slicer.geometry.facet_topology`.

        Raises:
            ValueError: the arrays have different lengths.
        """

    def cut_edges(
        self,
        corners: memoryview,
        level: memoryview,
        low: memoryview,
        high: memoryview,
        planes: memoryview,
        /,
    ) -> tuple[bytes, bytes]:
        """Return the points where planes cut edges; see `printer_slicer.geometry.plane_sections`.

        Args:
            corners: (3, C) float64, x, y and z of corners.
            level: (C,) int64, the number of planes at or below each corner.
            low: (E,) int64, the corner at the lower end of each edge.
            high: (E,) int64, the corner at its upper end.
            planes: (P,) float64, ascending heights of the planes.

        Returns:
            The points (N, 2) as float64, and the plane (N,) of each as int64; edge by edge, plane by plane.

        Raises:
            ValueError: the arrays do not match, or an index is outside of its array.
        """

    def divide_pieces(self, n_points: int, /, *arrays: Buffer) -> tuple[bytes, bytes, bytes, bytes]:
        """Divide the pieces of a medial axis; see `printer_slicer.perimeters.graph`.

        Args:
            n_points: number of points before; the cuts become the next ones.
            arrays: `start`, `foot` and `following` of `AxisGraph`; (n,) int64, ascending, the piece of each cut; (n,)
                float64, the position of each cut on its piece, 0 to 1, ascending on each piece.

        Returns:
            `start`, `foot` and `following` of the parts, and the piece of each part.

        Raises:
            ValueError: the arrays do not match, or the cuts are not in the order of pieces.
        """

    def facet_contacts(self, triangles: Buffer, begin: int, /) -> tuple[bytes, ...]:
        """Find the facets, edges and corners that a ball can touch; see `printer_slicer.surface.contacts`.

        Args:
            triangles: (n, 3, 3) float64, x, y and z of the corners of facets.
            begin: number of the first facet.

        Returns:
            Lowest and highest z, rise, and double area of each facet (n,) as float64; then for ridges, valleys, peaks
            and pits the arrays of `_ContactCandidates`: int64, uint64, uint64.

        Raises:
            ValueError: a facet does not have nine coordinates, or there are too many facets.
        """

    def facing_boxes(self, sides: memoryview, cosine: float, /) -> bytes:
        """Find the parts of outlines that face each other; see `printer_slicer.perimeters.facing_sides`.

        Args:
            sides: (S, 11) float64: begin, end, normal and previous normal of each side, x and y each; its layer and the
                largest distance between facing sides; and 1 if the corner at the begin points into the area, or else 0.
            cosine: of the largest angle between facing sides.

        Returns:
            (S, 4) float64: lowest and highest corner of the box around the part of each side that faces another one.
            Without any, they are infinite.

        Raises:
            ValueError: a side does not have 11 numbers.
        """

    def find_carried_samples(
        self,
        samples: tuple[Buffer, Buffer, Buffer, Buffer],
        layer_start: Buffer,
        kind: bytes,
        size: tuple[int, int],
        /,
    ) -> bytes:
        """Find the samples of beads that lie on beads of the layer below; see `printer_slicer.supports.bead_samples`.

        Args:
            samples: `x`, `y`, `across` and `bead` of `BeadSamples`.
            layer_start: (S + 1,) int64, also of `BeadSamples`.
            kind: (S,) uint8: 0 for layers without samples that count as equal to the layer below, 1 for those on the
                bed, 2 for those that begin where the layer below ends, and 3 for others.
            size: number of rows and columns of the grid.

        Returns:
            For each sample, 1 if it is carried, else 0, as uint8.

        Raises:
            ValueError: the arrays do not match, or an index is outside of its array.
        """

    def find_cycles(self, following: memoryview, /) -> tuple[bytes, bytes] | None:
        """Find the cycles of a permutation (n,) of int64; see `printer_slicer.geometry.connectivity`.

        Returns:
            The lowest index in the cycle of each item, and the steps from there to the item, (n,) int64 each; None if
            it is not a permutation.

        Raises:
            ValueError: an index is outside of the array.
        """

    def find_spikes(self, xy: Buffer, ring_start: Buffer, ring_layer: Buffer, /) -> bytes:
        """Return a mask (N,) of the points of areas that are spikes; see `printer_slicer.geometry.spikes`.

        Raises:
            ValueError: the arrays do not match.
        """

    def find_unsupported_pieces(
        self,
        height_map: tuple[Buffer, Buffer, int],
        moves: tuple[Buffer, ...],
        pieces: tuple[Buffer, ...],
        support_gap: float,
        drop: float,
        /,
    ) -> bytes:
        """Find unsupported extrusion of one height; see `printer_slicer.inspection.deposition.unsupported`.

        Args:
            height_map: (C + 1,) float32, the top of the print in each cell, row by row, and 0 for everything outside;
                (C + 1,) uint8, whether it is removable, or no elements; the number of cells per row.
            moves: `start`, `end`, `volume` and `xy_length` of `LevelMoves`; (n,) uint8, whether each move is removable.
            pieces: the arrays of `MovePieces`; (P,) int64, the cell of each piece.
            support_gap: mm that removable print may be lower than other print.
            drop: mm that all print may be lower.

        Returns:
            The indices of the unsupported pieces as int64.

        Raises:
            ValueError: the arrays do not match, or an index is outside of its array.
        """

    def format_move_rows(
        self, codes: memoryview, words: bytes, values: memoryview, present: memoryview, /
    ) -> tuple[bytes, bytes]:
        """Format rows of moves; see `printer_slicer.gcode.move_text`.

        Args:
            codes: (n,) uint8, the number after the G of each row.
            words: (W, 2) uint8, the letter and the number of decimals of each word.
            values: (W, n) int64, the numbers of each word, in units of the last decimal.
            present: (W, n) one byte each, whether a row has the word.

        Returns:
            The text of all rows, and the length (n,) of each row as int64.

        Raises:
            ValueError: the arrays do not match, or a number has 20 or more decimals.
        """

    def highest_facets(
        self, points: Buffer, bins: Buffer, start: Buffer, listed: Buffer, facets: Buffer, /
    ) -> bytes:
        """Find the highest facet over each point; see `printer_slicer.contouring.surface_heights`.

        Args:
            points: (N, 5) float64: x and y, lowest and highest z of a facet there, and tangent of its steepest slope.
            bins: (N,) int64, bin of each point, or -1.
            start: (B + 1,) int64, as of `FacetBins`.
            listed: (P,) int64, `facet` of `FacetBins`.
            facets: (T, 13) float64, `columns` of `FacetBins`.

        Returns:
            The facet (N,) as int64, the last one of several; -1 if there is none.

        Raises:
            ValueError: the arrays do not match, or an index is outside of its array.
        """

    def inflate_paths(
        self, xy: Buffer, start: Buffer, group: Buffer, distance: Buffer, is_closed: bool, /
    ) -> tuple[bytes, bytes, bytes]:
        """Offset the outlines of areas, or make areas around open lines; see `printer_slicer.geometry.clipper`.

        Args:
            xy: (N, 2) float64, mm.
            start: (M + 1,) int64, offset of each path.
            group: (M,) int64, ascending; paths of one group are offset together.
            distance: (M,) float64, mm, equal within a group.
            is_closed: whether the paths are outlines of areas.

        Returns:
            Points, offsets and groups of the rings, like the arrays of areas.

        Raises:
            ValueError: the arrays do not match.
        """

    def inner_edges(self, sides: memoryview, cells: memoryview, ends: memoryview, reach: float, /) -> bytes:
        """Find the edges of diagrams that belong to the medial axis; see `printer_slicer.geometry.medial_axis`.

        Args:
            sides: (S, 4, 2) float64: the previous point, start and end of each side, the next point.
            cells: (h, 2) int64: side and place of the cell on the left of each edge; each edge is followed by its twin.
            ends: (h, 2, 2) float64: start and end of each edge.
            reach: largest distance to the outline.

        Returns:
            (h,) uint8: 1 for edges inside the areas that are within reach of the outline at one end at least.

        Raises:
            ValueError: the arrays do not match.
        """

    def label_components(self, one: Buffer, other: Buffer, n: int, /) -> bytes:
        """Label connected components; see `printer_slicer.geometry.connectivity`.

        Args:
            one: (M,) int32, an item of each link.
            other: (M,) int32, the other item.
            n: number of items.

        Returns:
            The component (n,) of each item as int64, in the order of their lowest items.

        Raises:
            ValueError: the arrays do not match, or an item does not exist.
        """

    def make_blocks(
        self, delta: Buffer, speed: Buffer, acceleration: Buffer, limits: Buffer, /
    ) -> tuple[bytes, bytes, bytes, bytes, bytes, bytes]:
        """Build blocks of moves and limit the speeds at their corners; see `printer_slicer.motion.vectorized`.

        Args:
            delta: (K, 4) float64.
            speed: (K,) float64.
            acceleration: (K,) float64, or (0,) for that of the limits.
            limits: (18,) float64: shortest length, lowest speed, accelerations of extrusions, travels and retractions,
                shortest time, and for each axis speed, acceleration and jerk.

        Returns:
            The indices (B,) of the moves that are not zero as int64, and their length, speed, acceleration, share and
            squared corner speed.

        Raises:
            ValueError: the arrays do not match.
        """

    def match_edges(self, x: Buffer, y: Buffer, z: Buffer, /) -> tuple[bytes, bytes, bytes, bytes]:
        """Match the edges of n facets; see `printer_slicer.healing.soundness`.

        Args:
            x: (3 n,) float64 of the first corners of all facets, then of the second and of the third corners.
            y: (3 n,) float64.
            z: (3 n,) float64.

        Returns:
            Key, direction and piece of each unmatched edge as uint64, bool and int32, and the number of pieces (1,).

        Raises:
            ValueError: the arrays do not match.
        """

    def miter_areas(
        self, xy: Buffer, ring_start: Buffer, ring_layer: Buffer, distance: Buffer, limit: float, /
    ) -> tuple[bytes, bytes, bytes]:
        """Move the rings of areas outward; see `printer_slicer.geometry.mitering`.

        Args:
            xy: first of the three arrays of the areas.
            ring_start: second array.
            ring_layer: third array.
            distance: (R,) float64, mm.
            limit: corners with a point farther away than this many distances are cut off square.

        Returns:
            The arrays of the moved rings on the grid; those without area are left out.

        Raises:
            ValueError: the arrays do not match.
        """

    def nearest_marked(
        self, links: memoryview, lengths: memoryview, marked: memoryview, reach: float, /
    ) -> tuple[bytes, bytes]:
        """Find the nearest marked item along links; see `printer_slicer.perimeters.layout`.

        Args:
            links: (k, 2) int64, the two items that each link joins.
            lengths: (k,) float64, of the links.
            marked: (n,) int64, not 0 for marked items.
            reach: longest way to a marked item.

        Returns:
            (n,) int64: the nearest marked item, or -1, and (n,) float64: its distance.

        Raises:
            ValueError: the arrays do not match, or a length is negative.
        """

    def nearest_segments(self, ends: memoryview, boxes: bytes, points: memoryview, /) -> bytes:
        """Find the segment nearest to each point, the first of several.

        Args:
            ends: (S, 4) float64, x and y of start and end of each segment.
            boxes: the tree of these segments.
            points: (P, 2) float64.

        Returns:
            The segments (P,) as int64.

        Raises:
            ValueError: the boxes do not belong to the segments, or an array has another shape.
        """

    def neighbour_paths(
        self,
        arcs: tuple[memoryview, memoryview, memoryview],
        limits: tuple[memoryview, memoryview, memoryview],
        low: int,
        penalty: float,
        reduced: float,
        /,
    ) -> tuple[bytes, bytes]:
        """Compute costs of cheapest paths with limits for neighbours; see `printer_slicer.shortest_path`.

        Args:
            arcs: (n + 2,) int64, the first arc of each node; (A,) int64, start of each; (A,) float64, cost of each.
            limits: (R,) int64 each, the first and the last row that may follow a row; (n + 1,) int64, not 0 for spared
                nodes.
            low: height of the layers of row 0.
            penalty: cost per pair of layers that is not allowed.
            reduced: cost per such pair at a spared node.

        Returns:
            (n + 1, R) float64, cost of the cheapest path to each node on which a layer of each row may follow, and
            (n + 1,) float64, of the cheapest path to each node.

        Raises:
            ValueError: the arrays do not match, or a window of rows is empty.
        """

    def neighbouring_boxes(self, low: Buffer, high: Buffer, layer: Buffer, /) -> tuple[bytes, bytes]:
        """Find pairs of boxes that overlap; see `printer_slicer.geometry.boxes`.

        Args:
            low: (B, 2) float64, lowest corner of each box.
            high: (B, 2) float64, highest corner.
            layer: (B,) int64.

        Returns:
            Both boxes (n,) of each pair as int64.

        Raises:
            ValueError: the arrays do not match.
        """

    def number_cuts(self, level: memoryview, edges: memoryview, slot: memoryview, /) -> bytes:
        """Return the node where each plane cuts an edge of each facet; see `printer_slicer.geometry.plane_sections`.

        Args:
            level: (C,) int64, as for `cut_edges`.
            edges: (4, H) int64, start corner, lower and upper corner, and base of the nodes of each half-edge.
            slot: (F,) int64, base of the results of each facet; corner `c` belongs to the facet `c % F`.

        Returns:
            The nodes (S,) as int64.

        Raises:
            ValueError: as for `cut_edges`.
        """

    def outline_points(self, xy: memoryview, ring_start: memoryview, tolerance: float, /) -> bytes:
        """Find the points that outlines need; see `printer_slicer.geometry.outline_simplification`.

        Args:
            xy: (N, 2) float64, points of the rings.
            ring_start: (R + 1,) int64.
            tolerance: of positions.

        Returns:
            A mask (N,) of these points.

        Raises:
            ValueError: the arrays do not match.
        """

    def overlapping_boxes(self, *boxes: Buffer) -> tuple[bytes, bytes]:
        """Find pairs of boxes of two sets that overlap; see `printer_slicer.geometry.boxes`.

        Args:
            boxes: the three arrays of one set and of the other one, as for `neighbouring_boxes`.

        Returns:
            Both boxes (n,) of each pair as int64.

        Raises:
            ValueError: the arrays do not match.
        """

    def points_to_keep(
        self, points: memoryview, sizes: memoryview, closed: memoryview, tolerance: float, /
    ) -> bytes:
        """Return a mask (N,) of the points that paths need; see `printer_slicer.perimeters.simplification`.

        Args:
            points: (N, 3) float64, x, y and width.
            sizes: (M,) int64, number of points of each path; at least one.
            closed: (M,) int64, not 0 for paths that return to their first point.
            tolerance: of position and width.

        Raises:
            ValueError: the sizes do not match the points.
        """

    def query_polyline_tree(
        self, ends: memoryview, boxes: bytes, queries: memoryview, /
    ) -> tuple[bytes, bytes]:
        """Find the segments whose bounding box touches a given box.

        Args:
            ends: (S, 4) float64, x and y of start and end of each segment.
            boxes: the tree of these segments.
            queries: (Q, 4) float64, x and y of two opposite corners of each given box.

        Returns:
            The given box (X,) and the segment (X,) of each pair, ascending.

        Raises:
            ValueError: the boxes do not belong to the segments, or an array has another shape.
        """

    def raise_height_map(
        self,
        height_map: tuple[Buffer, Buffer, int],
        moves: tuple[Buffer, ...],
        pieces: tuple[Buffer, ...],
        left: float,
        front: float,
        /,
    ) -> None:
        """Add extrusions of one height to a height map; see `printer_slicer.inspection.deposition.unsupported`.

        Args:
            height_map: as for `find_unsupported_pieces`; its arrays are changed.
            moves: as there.
            pieces: as there.
            left: x of the corner of the first cell.
            front: y of this corner.

        Raises:
            ValueError: as there, or a move is removable and the height map has no array for that.
        """

    def read_elements(self, text: bytes, words: bytes, is_whole: bool, /) -> bytes | None:
        """Read the numbers of XML elements, as `printer_slicer.mesh_io.element_runs` does.

        Args:
            text: the elements, and white space.
            words: the beginning of the tag, then the beginning of each attribute: `<vertex x=" y=" z="`.
            is_whole: whether the numbers are integers.

        Returns:
            The numbers as int64 or float64; None if the text is not in this form.
        """

    def remove_spikes(
        self, xy: Buffer, ring_start: Buffer, ring_layer: Buffer, /
    ) -> tuple[bytes, bytes, bytes] | None:
        """Remove the spikes of areas; see `printer_slicer.geometry.spikes`.

        Returns:
            Points, offsets and layers of the rings that are left; None if there are no spikes.

        Raises:
            ValueError: the arrays do not match.
        """

    def ring_areas(self, xy: Buffer, ring_start: Buffer, /) -> bytes:
        """Return the signed area (R,) of each ring, as `Areas.ring_area` does.

        Raises:
            ValueError: the arrays do not match.
        """

    def split_moves(self, start: Buffer, end: Buffer, /) -> tuple[bytes, bytes, bytes, bytes, bytes]:
        """Split moves into short pieces; see `printer_slicer.inspection.deposition.height_map`.

        Args:
            start: (n, 3) float64.
            end: (n, 3) float64.

        Returns:
            The arrays of `MovePieces`.

        Raises:
            ValueError: the arrays do not match, or a move is too long.
        """

    def voronoi_diagrams(
        self, sides: memoryview, counts: memoryview, /
    ) -> tuple[bytes, bytes, bytes, bytes, bytes, bytes]:
        """Compute segment Voronoi diagrams; see `printer_slicer.geometry.voronoi_diagram`.

        Args:
            sides: (S, 4) int64, x and y of start and end of each side, 32 bits each.
            counts: (A,) int64, number of sides of each area; at least one.

        Returns:
            The arrays of `_RawDiagrams`.

        Raises:
            ValueError: the numbers of sides do not match, a coordinate has more than 32 bits, or sides cross.
        """

    def weld_keys(self, key: Buffer, /) -> tuple[bytes, bytes]:
        """Number keys (n,) of 64 bits; see `printer_slicer.geometry.connectivity`.

        Returns:
            The number (n,) of each key, and the last index (m,) of the key with each number, ascending, as int32.

        Raises:
            ValueError: there are more than 2**31 - 1 keys.
        """


def load_kernel() -> Kernel | None:
    """Return the kernel; None without one, and if PRINTER_SLICER_KERNEL is `off`.

    Raises:
        UsageError: PRINTER_SLICER_KERNEL has another value, or is `required` and there is no kernel.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted == "off":
        return None
    if wanted not in {"", "required"}:
        raise UsageError(f"unknown value {wanted!r} of {VARIABLE}", remedy="Use off or required, or unset it")
    kernel, reason = _import_kernel()
    if wanted and kernel is None:
        raise UsageError(
            f"{VARIABLE} is {wanted}, but there is no compiled kernel: {reason}",
            remedy="Unset it, or install a C++ compiler and then this program again",
        )
    return kernel


def describe_kernel() -> str:
    """Return `yes`, or `no` and the reason.

    Raises:
        UsageError: as for `load_kernel`.
    """
    if load_kernel():
        return "yes"
    reason = f"{VARIABLE} is off" if os.environ.get(VARIABLE) else _import_kernel()[1]
    return f"no ({reason})"


@cache
def _import_kernel() -> tuple[Kernel | None, str]:
    """Import the kernel; without one, return the reason."""
    try:
        module: Any = import_module(f"{__package__}._kernel")
    except ModuleNotFoundError:
        return None, _read_reason()
    except ImportError as error:
        return None, f"it cannot be loaded: {error}"
    if module.INTERFACE != _INTERFACE:
        return None, "it belongs to another version: install this program again"
    return module, ""


def _read_reason() -> str:
    """Return the reason for which the installation has no kernel."""
    try:
        return _REASON.read_text(encoding="utf-8").strip()
    except OSError:
        return "not compiled when installed"
