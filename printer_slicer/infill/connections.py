"""Join rows into zigzags with thin connections, which fill the space beyond the ends of the rows."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, next_in_ring, previous_in_ring
from printer_slicer.geometry import Areas, Lines, row_ends
from printer_slicer.values import Struct

__all__ = ["MAX_CONNECTION", "Zigzags", "join_rows", "measure_extension_room"]

# Row spacings. Connections run along the border; where it meets rows at less than 27° they would be longer.
MAX_CONNECTION = 2.2


class Zigzags(Struct, frozen=True, eq=False):
    """Polylines in which rows and connections alternate; the point where they meet is stored twice.

    Attributes:
        xy: (N, 2) mm.
        start: (M + 1,) first point of each polyline.
        entry: (M,) the area that each one fills.
        thin: (N,) whether the point belongs to a connection.
    """

    xy: Float
    start: Int
    entry: Int
    thin: Bool

    @classmethod
    def with_uniform_width(
        cls, rows: Lines, area: Areas, angle: Float, gap: Float, overlap: Float
    ) -> Zigzags:
        """Join rows of a hatch by connections as wide as the rows; ends without a connection overlap the perimeter.

        Args:
            rows: hatch of `area`.
            area: P entries, the area to fill, inset by half a row.
            angle: (P,) radians, of the rows.
            gap: (P,) mm from row to row.
            overlap: (P,) mm by which ends without a connection are extended.
        """
        end, start = row_ends(rows, max_turn=MAX_CONNECTION * gap)
        entry = rows.layer[end // 2]
        xy = _extend_row_ends(
            rows, area, angle, end, np.where(_find_connected_ends(end, start), 0.0, overlap[entry])
        )
        return cls(xy, start, entry[start[:-1]], np.zeros(len(xy), np.bool_))

    def take(self, chosen: Int) -> Zigzags:
        """Return the zigzags with the indices `chosen`."""
        size = np.diff(self.start)[chosen]
        point = consecutive(self.start[chosen], size)
        return Zigzags(self.xy[point], np.append(0, np.cumsum(size)), self.entry[chosen], self.thin[point])

    def length(self) -> Float:
        """Return the length (M, 2) of rows and of connections, mm."""
        step = np.hypot(*(self.xy[next_in_ring(self.start, False)] - self.xy).T)
        owner = np.repeat(np.arange(len(self.entry)), np.diff(self.start))
        kinds = (np.where(self.thin, 0.0, step), np.where(self.thin, step, 0.0))
        return np.stack([np.bincount(owner, kind, len(self.entry)) for kind in kinds], axis=1)


def join_rows(
    rows: Lines, area: Areas, angle: Float, gap: Float, connection_gap: Float, *, overlap: Float
) -> Zigzags:
    """Extend rows toward the border and join them along it.

    A connection as wide as the rows would overlap their ends by half its width, and the space between it and the next
    connection would stay half empty. Rows that end half a connection before the border leave exactly the space that
    the connections fill, whatever the angle of the border.

    Args:
        rows: hatch of `area`.
        area: P entries, the area to fill, inset by half a row.
        angle: (P,) radians, of the rows.
        gap: (P,) mm from row to row.
        connection_gap: (P,) mm, spacing of the connections.
        overlap: (P,) mm by which ends without a connection are extended at least.
    """
    end, start = row_ends(rows, max_turn=MAX_CONNECTION * gap)
    entry = rows.layer[end // 2]
    inner = _find_connected_ends(end, start)
    deep = (gap - connection_gap)[entry] / 2
    xy = _extend_row_ends(rows, area, angle, end, np.where(inner, deep, np.maximum(deep, overlap[entry])))
    point = np.repeat(np.arange(len(end)), 1 + inner)
    first = np.diff(point, prepend=-1) > 0
    # A connection begins at the second end of a row and ends at the first end of the next one.
    thin = inner[point] & (first == (point % 2 == 0))
    return Zigzags(xy[point], np.append(0, np.cumsum(1 + inner))[start], entry[start[:-1]], thin)


def _find_connected_ends(end: Int, start: Int) -> Bool:
    """Return which row ends (N,) belong to connections: all except the first and the last of each zigzag."""
    inner = np.ones(len(end), np.bool_)
    inner[start[:-1]] = inner[start[1:] - 1] = False
    return inner


def _extend_row_ends(rows: Lines, area: Areas, angle: Float, end: Int, depth: Float) -> Float:
    """Extend row ends (N, 2) along their rows until they are `depth` (N,) mm beyond the border."""
    entry = rows.layer[end // 2]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1).take(entry, axis=0)
    out = np.where((end % 2 == 1)[:, None], along, -along)
    xy = rows.ends.reshape(-1, 2).take(end, axis=0)
    return np.asarray(
        xy + measure_extension_room(xy, out, area, rows.edge.ravel()[end], depth)[:, None] * out
    )


def measure_extension_room(xy: Float, out: Float, area: Areas, edge: Int, depth: Float) -> Float:
    """Return how far rows can be extended (N,), mm, without reaching more than `depth` (N,) mm beyond `edge` (N,).

    The two neighbouring edges limit the extension in the same way.
    """
    begin = area.xy
    side = begin[area.following] - begin
    side /= np.maximum(np.hypot(*side.T), 1e-12)[:, None]
    inward = np.stack([-side[:, 1], side[:, 0]], axis=1)
    sine = -(inward[edge] * out).sum(axis=1)
    # Rows are not extended where the border meets them at a small angle; extrusions along it fill the gaps.
    room = np.where(sine * MAX_CONNECTION >= 1, depth / np.maximum(sine, 1e-12), 0.0)
    for other in (previous_in_ring(area.ring_start)[edge], area.following[edge]):
        # Only convex corners limit the extension.
        turned = side[edge, 0] * side[other, 1] - side[edge, 1] * side[other, 0]
        convex = np.where(other == area.following[edge], turned, -turned) > 0
        nearing = -(inward[other] * out).sum(axis=1)
        left = ((xy - begin[other]) * inward[other]).sum(axis=1) + depth
        limit = np.where(convex & (nearing > 1e-9), left / np.maximum(nearing, 1e-9), np.inf)
        room = np.minimum(room, np.maximum(limit, 0.0))
    return room
