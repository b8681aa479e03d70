"""Draw extrusions on a fine grid: the area that they cover, and the volume in each cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas
from printer_slicer.model import Toolpaths
from tests.parts import shape

PITCH = 0.02  # mm


@dataclass(frozen=True, eq=False)
class Raster:
    """One layer on a grid.

    Attributes:
        solid: where the section is.
        inside: where the walls leave room.
        covered: under a bead, with round ends and joints.
        plastic: how high plastic would stand, in layer heights, if it did not flow.
    """

    solid: Bool
    inside: Bool
    covered: Bool
    plastic: Float

    def widest_gap(self, *, but: Bool | None = None) -> float:
        """Diameter, mm, of the largest disc in what is neither covered nor inside nor in `but`."""
        empty = self.solid & ~self.covered & ~self.inside
        if but is not None:
            empty &= ~but
        # What lies outside the section is no room for a disc.
        return float(2 * PITCH * ndimage.distance_transform_edt(np.pad(empty, 1)).max())

    def most_plastic(self, radius: float, *, but: Bool | None = None) -> float:
        """Greatest share of plastic to room in any disc of that radius, mm, with its middle in the section."""
        reach = round(radius / PITCH)
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        disc = (x**2 + y**2 <= reach**2).astype(np.float64)
        disc /= disc.sum()
        room = ndimage.convolve(self.solid.astype(np.float64), disc, mode="constant")
        lies = ndimage.convolve(self.plastic, disc, mode="constant")
        middle = self.solid if but is None else self.solid & ~but
        return float((lies / np.maximum(room, 0.3))[middle].max(initial=0.0))


def raster(paths: Toolpaths, solid: Areas, inside: Areas, layer: int) -> Raster:
    """One layer of walls on a grid around its section."""
    section = shape(solid, layer)
    low = np.array(section.bounds[:2]) - 0.6
    size = np.ceil((np.array(section.bounds[2:]) + 0.6 - low) / PITCH).astype(int)
    x, y = (low[axis] + (np.arange(size[axis]) + 0.5) * PITCH for axis in (0, 1))
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    plastic = np.zeros(size)
    bodies = []
    for begin, end, first, last, height in _beads(paths, layer):
        bodies.append(_body(begin, end, first, last))
        _lay(
            plastic, (begin - low) / PITCH, (end - low) / PITCH, (first / PITCH, last / PITCH), height / PITCH
        )
    covered = shapely.union_all(bodies)
    places = [section, shape(inside, layer), covered]
    for one in places:
        shapely.prepare(one)
    return Raster(*(shapely.contains_xy(one, grid_x, grid_y) for one in places), plastic)


def _beads(paths: Toolpaths, layer: int) -> Iterator[tuple[Float, Float, float, float, float]]:
    for path in np.flatnonzero(paths.layer == layer).tolist():
        here = slice(paths.start[path], paths.start[path + 1])
        xy, width = paths.xy[here], paths.width[here]
        if paths.closed[path]:
            xy, width = np.vstack([xy, xy[:1]]), np.append(width, width[0])
        for k in range(len(xy) - 1):
            yield xy[k], xy[k + 1], float(width[k]), float(width[k + 1]), float(paths.height[path])


def _body(begin: Float, end: Float, first: float, last: float) -> shapely.Geometry:
    discs = [shapely.Point(begin).buffer(first / 2), shapely.Point(end).buffer(last / 2)]
    return shapely.convex_hull(shapely.union_all(discs))


def _lay(plastic: Float, begin: Float, end: Float, width: tuple[float, float], height: float) -> None:
    """Add one bead, in steps of the grid: a rectangle with half circles at its sides, cut off square at its ends."""
    along = end - begin
    length = float(np.hypot(*along))
    if length == 0:
        return
    n = int(np.ceil(2 * length))
    share = (np.arange(n) + 0.5) / n
    wide = width[0] + share * (width[1] - width[0])
    m = int(np.ceil(2 * max(width)))
    across = ((np.arange(m) + 0.5) / m - 0.5)[None, :] * wide[:, None]
    beyond = np.maximum(np.abs(across) - (wide[:, None] - height) / 2, 0.0) / (height / 2)
    profile = np.sqrt(np.maximum(1 - beyond**2, 0.0))
    normal = np.array([-along[1], along[0]]) / length
    points = begin + share[:, None, None] * along + across[..., None] * normal
    amount = profile * (length / n) * (wide[:, None] / m)
    index = np.floor(points).astype(int).reshape(-1, 2)
    kept = ((index >= 0) & (index < plastic.shape)).all(axis=1)
    np.add.at(plastic, tuple(index[kept].T), amount.ravel()[kept])
