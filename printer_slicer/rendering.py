"""Render facets with numpy: lit, in parallel projection, on a transparent background.

They are seen from the front right and above. One large picture is rendered with a depth buffer, in twice the scale of
the largest one wanted, from which all are downscaled. Many facets are rasterized at once: each becomes one span of
pixels per row. RenderedFacets that cover no pixel centre, as most of a fine mesh, are skipped early.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import ceil, cos, radians, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float, Int, consecutive, run_starts
from printer_slicer.values import Struct

__all__ = ["Picture", "RenderedFacets", "measure_rendered_size", "render_facets"]

Picture = NDArray[np.uint8]
"""(h, w, 4) red, green, blue, opacity; row 0 is the top."""

# Direction of the camera: angle about z from +x, and angle above the bed.
_AZIMUTH, _ELEVATION = radians(-52.0), radians(28.0)
_MIN_LARGE_SIZE: Final = 384  # minimum size of the large picture along its longer side, px
_BORDER: Final = 2  # transparent border of the large picture, px
_MARGIN: Final = 0.04  # margin around the part, as a fraction of the shorter side
_BLOCK_SIZE: Final = 1 << 14  # facets per block, which fit the CPU cache
_LIGHTS: Final = ((np.array([-0.30, -0.50, 0.80]), 0.78), (np.array([0.80, -0.45, 0.25]), 0.22))
_AMBIENT: Final = 0.14
_GLOSS: Final = 150.0  # highlight where light is perpendicular
_OUTLINE_BRIGHTNESS: Final = 0.55  # brightness of outlines


class RenderedFacets(Struct, frozen=True, eq=False):
    """RenderedFacets to render, which are made by blocks when they are needed.

    Attributes:
        count: their number.
        take: returns the corners (n, 3, 3) of facets, mm, counter-clockwise seen from outside.
        colours: returns the colours (n, 3) or (3,) of facets in full light and in full shadow, 0 to 255.
    """

    count: int
    take: Callable[[slice | Int], Float]
    colours: Callable[[Int], tuple[Float, Float]]


class _Planes(Struct, frozen=True, eq=False):
    """A rendering of the part, from which pictures are downscaled.

    Attributes:
        colours: (4, h, w) red, green, blue and opacity, 0 to 255; colours are multiplied by opacity. Row 0 is the
            bottom. `_BORDER` px around the part are transparent.
        corner: row and column of the part's lowest corner, px.
        scale: px/mm.
    """

    colours: NDArray[np.float32]
    corner: tuple[float, float]
    scale: float


def render_facets(facets: RenderedFacets, sizes: Sequence[tuple[int, int]]) -> list[Picture]:
    """Render facets in several sizes.

    Args:
        facets: the facets to show.
        sizes: (width, height) of each picture, px.
    """
    if not sizes:
        return []
    low, extent = _measure_projected_extent(facets)
    scales = [_scale_to_fit(extent, *one) for one in sizes]
    largest = int(np.argmax(scales))
    double = 2 * scales[largest]
    large = _render_large(facets, low, extent, max(double, _MIN_LARGE_SIZE / float(extent.max())))
    half = _halve(large, extent, sizes[largest]) if large.scale == double else None
    pictures = []
    for number, (size, scale) in enumerate(zip(sizes, scales, strict=True)):
        if half and number == largest:
            pictures.append(_finish(half.colours))
        else:
            source = half if half and 2 * scale <= half.scale else large
            pictures.append(_finish(_downscale(source, extent, scale, size)))
    return pictures


def measure_rendered_size(facets: RenderedFacets) -> tuple[float, float]:
    """Return the width and the height of facets as the camera sees them, mm."""
    width, height = _measure_projected_extent(facets)[1].tolist()
    return width, height


def _divide_into_blocks(count: int) -> Iterator[slice]:
    """Divide facets into blocks that fit the CPU cache."""
    for begin in range(0, count, _BLOCK_SIZE):
        yield slice(begin, begin + _BLOCK_SIZE)


def _measure_projected_extent(facets: RenderedFacets) -> tuple[Float, Float]:
    """Return the lowest projected coordinates (2,) of facets, and their projected size (2,), mm."""
    ends = []
    for block in _divide_into_blocks(facets.count):
        places = _project(facets.take(block))[:2].reshape(2, -1)
        ends.append((places.min(axis=1), places.max(axis=1)))
    low, high = np.min([one for one, _ in ends], axis=0), np.max([one for _, one in ends], axis=0)
    return low, np.maximum(high - low, 1e-6)


def _project(triangles: Float) -> Float:
    """Return the right, up and depth coordinates of the three corners of F facets, (3, 3, F) mm."""
    corners = np.ascontiguousarray(
        triangles.reshape(-1, 9).T
    )  # one contiguous column per coordinate, for speed
    axes = np.stack(_compute_camera_axes())
    return np.stack([axes @ corners[3 * one : 3 * one + 3] for one in range(3)], axis=1)


def _compute_camera_axes() -> tuple[Float, Float, Float]:
    """Return the unit vectors to the right, upward, and towards the camera."""
    toward = np.array([cos(_ELEVATION) * cos(_AZIMUTH), cos(_ELEVATION) * sin(_AZIMUTH), sin(_ELEVATION)])
    right = np.array([-sin(_AZIMUTH), cos(_AZIMUTH), 0.0])
    return right, np.cross(toward, right), toward


def _scale_to_fit(size: Float, width: int, height: int) -> float:
    """Return the scale, px/mm, at which the part fills a picture except for the margin."""
    margin = 2 * _MARGIN * min(width, height)
    return float(min((width - margin) / size[0], (height - margin) / size[1]))


def _render_large(facets: RenderedFacets, low: Float, extent: Float, scale: float) -> _Planes:
    """Render facets in a large scale, px/mm."""
    shape = (int(np.ceil(extent[1] * scale)) + 1, int(np.ceil(extent[0] * scale)) + 1)
    nearest = np.full(shape[0] * shape[1], -np.inf, np.float32)
    owner = np.full(shape[0] * shape[1], facets.count)  # the facet that is seen; none: the number of facets
    for block in _divide_into_blocks(facets.count):
        x, y, depth = _project(facets.take(block))
        facet, pixel, pixel_depth = _rasterize_facets(
            (x - low[0]) * scale, (y - low[1]) * scale, depth, shape
        )
        before = nearest.take(pixel)
        np.maximum.at(nearest, pixel, pixel_depth)
        seen = np.flatnonzero((pixel_depth > before) & (pixel_depth == nearest.take(pixel)))
        # Of several facets at equal depth, the last one wins.
        owner[pixel.take(seen)] = facet.take(seen) + block.start
    bright = _compute_outline_brightness(nearest.reshape(shape))
    colours = np.zeros((4, shape[0] + 2 * _BORDER, shape[1] + 2 * _BORDER), np.float32)
    inside = colours[:, _BORDER : _BORDER + shape[0], _BORDER : _BORDER + shape[1]]
    for channel, colour in zip(inside, _shade_facets(facets, owner), strict=False):
        np.multiply(colour.take(owner).reshape(shape), bright, out=channel)
    np.multiply(np.float32(255), owner.reshape(shape) < facets.count, out=inside[3])
    return _Planes(colours, (_BORDER, _BORDER), scale)


def _rasterize_facets(
    x: Float, y: Float, depth: Float, shape: tuple[int, int]
) -> tuple[Int, Int, NDArray[np.float32]]:
    """Rasterize facets that face the camera; return facet, pixel and depth for each covered pixel centre."""
    double_area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    bottom = np.ceil(np.minimum(np.minimum(y[0], y[1]), y[2]) - 0.5)
    rows = np.floor(np.maximum(np.maximum(y[0], y[1]), y[2]) - 0.5) - bottom + 1
    left = np.ceil(np.minimum(np.minimum(x[0], x[1]), x[2]) - 0.5)
    right = np.floor(np.maximum(np.maximum(x[0], x[1]), x[2]) - 0.5)
    kept = np.flatnonzero((double_area > 1e-12) & (rows > 0) & (right >= left))
    x, y, depth = x[:, kept], y[:, kept], depth[:, kept]
    count = rows[kept].astype(np.int64)
    row_facet = np.repeat(np.arange(len(kept)), count)
    row_y: Float = consecutive(bottom[kept].astype(np.int64), count).astype(np.float64) + 0.5
    begin, size = _find_pixel_spans(x, y, row_facet, row_y, shape[1])
    by_x, by_y = _compute_depth_slopes(x, y, depth, double_area[kept])
    base = depth[0] - by_x * (x[0] - 0.5) - by_y * y[0]
    pixel = consecutive(row_y.astype(np.int64) * shape[1] + begin, size)
    # The depth is linear along a row; `number` counts the pixels of all rows.
    number, slope = np.arange(len(pixel)), by_x.take(row_facet)
    first = base.take(row_facet) + by_y.take(row_facet) * row_y + slope * (begin - (np.cumsum(size) - size))
    pixel_depth = np.repeat(first, size) + np.repeat(slope, size) * number
    return np.repeat(kept.take(row_facet), size), pixel, pixel_depth.astype(np.float32)


def _find_pixel_spans(x: Float, y: Float, row_facet: Int, row_y: Float, width: int) -> tuple[Int, Int]:
    """Return the first pixel and the number of pixels in each row of a facet; facets are counter-clockwise."""
    begin, end = np.full(len(row_y), -np.inf), np.full(len(row_y), np.inf)
    for one, other in ((0, 1), (1, 2), (2, 0)):
        rise = y[other] - y[one]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = (x[other] - x[one]) / rise
        cut = x[one][row_facet] + (row_y - y[one][row_facet]) * slope[row_facet]
        up = rise[row_facet]
        begin = np.where(up < 0, np.maximum(begin, cut), begin)  # downward edges are on the left
        end = np.where(up > 0, np.minimum(end, cut), end)
    first = np.maximum(np.ceil(begin - 0.5), 0)
    size = np.minimum(np.floor(end - 0.5), width - 1) - first + 1
    is_covered = np.isfinite(size) & (size > 0)
    return np.where(is_covered, first, 0).astype(np.int64), np.where(is_covered, size, 0).astype(np.int64)


def _compute_depth_slopes(x: Float, y: Float, depth: Float, double_area: Float) -> tuple[Float, Float]:
    """Return the change of depth of each facet per pixel, to the right and upward."""
    one, other = depth[1] - depth[0], depth[2] - depth[0]
    ax, ay, bx, by = x[1] - x[0], y[1] - y[0], x[2] - x[0], y[2] - y[0]
    return (one * by - other * ay) / double_area, (other * ax - one * bx) / double_area


def _shade_facets(facets: RenderedFacets, owner: Int) -> NDArray[np.float32]:
    """Return the colours (3, F + 1) of the facets that are seen, lit by two lights and some ambient light from above.

    Args:
        facets: all of them.
        owner: (n,) the facet that is seen in each pixel, F where there is none.
    """
    used = np.zeros(facets.count + 1, np.bool_)
    used[owner[run_starts(owner)]] = True
    used[-1] = False
    seen = np.flatnonzero(used)
    corners = facets.take(seen)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-30)[:, None]
    light = _AMBIENT * (1 + 0.5 * normal[:, 2])
    for direction, strength in _LIGHTS:
        light += strength * np.maximum((normal * (direction / np.linalg.norm(direction))).sum(axis=1), 0)
    shine = np.clip(light, 0, 1)[:, None]
    table = np.zeros((3, facets.count + 1), np.float32)
    lit, shaded = facets.colours(seen)
    table[:, seen] = (shaded + (lit - shaded) * shine + _GLOSS * np.maximum(shine - 0.8, 0)).clip(0, 255).T
    return table


def _compute_outline_brightness(nearest: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the brightness factor (h, w) of each pixel; pixels at a jump in depth are darker and form an outline."""
    bright = np.ones(nearest.shape, np.float32)
    depths = nearest[np.isfinite(nearest)]
    if not len(depths):
        return bright
    far = np.where(np.isfinite(nearest), nearest, depths.min() - float(np.ptp(depths)) - 1)
    jump = 0.03 * float(np.ptp(depths)) + 1e-6
    for axis in (0, 1):
        ahead = np.diff(far, axis=axis)
        near = np.zeros(nearest.shape, np.bool_)
        near[tuple(slice(1, None) if axis == one else slice(None) for one in (0, 1))] |= ahead > jump
        near[tuple(slice(None, -1) if axis == one else slice(None) for one in (0, 1))] |= ahead < -jump
        bright[near] = _OUTLINE_BRIGHTNESS
    return bright


def _find_corner(extent: Float, size: tuple[int, int], scale: float) -> tuple[float, float]:
    """Return the row and the column of the part's lowest corner in a picture of a size (width, height), px."""
    return (size[1] - float(extent[1]) * scale) / 2, (size[0] - float(extent[0]) * scale) / 2


def _halve(large: _Planes, extent: Float, size: tuple[int, int]) -> _Planes:
    """Downscale to half the scale, in a picture of a size (width, height) with the part in its middle."""
    corner = _find_corner(extent, size, large.scale / 2)
    rows = _halve_axis(large.colours, 1, size[1], corner[0])
    return _Planes(_halve_axis(rows, 2, size[0], corner[1]), corner, large.scale / 2)


def _halve_axis(colours: NDArray[np.float32], axis: int, length: int, corner: float) -> NDArray[np.float32]:
    """Halve the scale along an axis; the part begins at `_BORDER` before and at `corner` afterwards, px.

    Each pixel of the result covers one whole pixel, and shares of those before and behind it, which are alike for all.
    """
    first = max(ceil(corner - _BORDER / 2), 0)
    begin, share = divmod(_BORDER + 2 * (first - corner), 1.0)
    count = min(length - first, (colours.shape[axis] - int(begin) - 1) // 2)
    one, two, three = (
        colours[(*[slice(None)] * axis, slice(at, at + 2 * count - 1, 2))]
        for at in range(int(begin), int(begin) + 3)
    )
    result = np.zeros((*colours.shape[:axis], length, *colours.shape[axis + 1 :]), np.float32)
    covered = result[(*[slice(None)] * axis, slice(first, first + count))]
    np.multiply(one, np.float32((1 - share) / 2), out=covered)
    covered += two * np.float32(0.5)
    covered += three * np.float32(share / 2)
    return result


def _downscale(planes: _Planes, extent: Float, scale: float, size: tuple[int, int]) -> NDArray[np.float32]:
    """Downscale to a picture of a size (width, height), with the part in its middle; return its colours (4, h, w)."""
    colours, ratio = planes.colours, planes.scale / scale
    for axis, pixels in ((1, size[1]), (2, size[0])):
        corner = _find_corner(extent, size, scale)[axis - 1]
        edges = planes.corner[axis - 1] + (np.arange(pixels + 1, dtype=np.float64) - corner) * ratio
        colours = _compute_box_means(colours, edges, axis)
    return colours


def _compute_box_means(colours: NDArray[np.float32], edges: Float, axis: int) -> NDArray[np.float32]:
    """Return the mean of the pixels between consecutive `edges` along an axis; pixels beyond the planes are 0."""
    moved = np.moveaxis(colours, axis, 0)
    sums = np.zeros((len(moved) + 1, *moved.shape[1:]), np.float32)
    np.cumsum(moved, axis=0, out=sums[1:])
    at = np.clip(edges, 0, len(moved))
    below = np.minimum(at.astype(np.int64), len(moved) - 1)
    part = (at - below).astype(np.float32).reshape(-1, *[1] * (moved.ndim - 1))
    until = sums[below] * (1 - part) + sums[below + 1] * part
    wide = np.diff(edges).astype(np.float32).reshape(-1, *[1] * (moved.ndim - 1))
    return np.moveaxis(np.diff(until, axis=0) / wide, 0, axis)


def _finish(colours: NDArray[np.float32]) -> Picture:
    """Return the picture (h, w, 4) of colours (4, h, w) that are multiplied by opacity; row 0 becomes the top."""
    alpha = colours[3]
    whole = np.zeros((*alpha.shape, 4), np.uint8)
    whole[..., :3] = np.rint(colours[:3] * 255 / np.maximum(alpha, 1e-9)).clip(0, 255).transpose(1, 2, 0)
    whole[..., 3] = np.rint(alpha).clip(0, 255)
    whole *= (whole[..., 3] > 0)[..., None]
    return np.ascontiguousarray(whole[::-1])
