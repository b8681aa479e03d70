"""Thumbnails: pictures of the part, rendered with numpy, encoded by Pillow, and written as comments of a G-code file.

The part is seen from the front right and above, in parallel projection, lit, on a transparent background. One large
picture is rendered with a depth buffer; the thumbnails are downscaled from it. Many facets are rasterized at once: each
becomes one span of pixels per row. Facets that cover no pixel centre, as most of a fine mesh, are skipped early.

In the file a thumbnail begins with its size and the number of characters: `; thumbnail begin 300x300 12345` for PNG,
`; thumbnail_QOI begin ...` for QOI. Source: Moonraker, OctoPrint's thumbnail plugin and py-gcode-metadata.
"""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Mapping, Sequence
from math import cos, radians, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.model import Mesh

__all__ = ["Picture", "encode_image", "render", "render_thumbnail_lines"]

Picture = NDArray[np.uint8]
"""(h, w, 4) red, green, blue, opacity; row 0 is the top."""

# Direction of the camera: angle about z from +x, and angle above the bed.
_AZIMUTH, _ELEVATION = radians(-52.0), radians(28.0)
_SUPERSAMPLING: Final = 2.0  # pixels of the large picture per pixel of the largest thumbnail, along each axis
_MIN_LARGE_SIZE: Final = 384  # minimum size of the large picture along its longer side, px
_MARGIN: Final = 0.04  # margin around the part, as a fraction of the shorter side
_BLOCK_SIZE: Final = 1 << 14  # facets per block, which fit the CPU cache
_COLOUR: Final = np.array([255.0, 146.0, 48.0])
_SHADE: Final = np.array([112.0, 50.0, 22.0])  # colour in full shadow
_LIGHTS: Final = ((np.array([-0.30, -0.50, 0.80]), 0.78), (np.array([0.80, -0.45, 0.25]), 0.22))
_AMBIENT: Final = 0.14
_GLOSS: Final = 150.0  # highlight where light is perpendicular
_OUTLINE_BRIGHTNESS: Final = 0.55  # brightness of outlines
_KEYWORDS: Final[Mapping[str, str]] = {"PNG": "thumbnail", "QOI": "thumbnail_QOI"}
"""Keyword of each image format in the file."""
_LINE_LENGTH: Final = 78  # characters per comment line


def render(part: Mesh, width: int, height: int) -> Picture:
    """Render the part as a picture (height, width, 4) of red, green, blue and opacity, 0 to 255."""
    return _render_pictures(part.triangles, [(width, height)])[0]


def render_thumbnail_lines(part: Mesh, specs: Sequence[str]) -> list[str]:
    """Render thumbnails as comment lines of a G-code file.

    Args:
        part: the part to show.
        specs: size and format of each thumbnail, `300x300` or `300x300/QOI`; the default format is PNG.
    """
    parsed = [spec.partition("/") for spec in specs]
    sizes = [(int(size.partition("x")[0]), int(size.partition("x")[2])) for size, _, _ in parsed]
    lines: list[str] = []
    for picture, (size, _, name) in zip(_render_pictures(part.triangles, sizes), parsed, strict=True):
        text = b64encode(encode_image(picture, name or "PNG")).decode("ascii")
        keyword = _KEYWORDS[name or "PNG"]
        rows = [f"; {text[at : at + _LINE_LENGTH]}" for at in range(0, len(text), _LINE_LENGTH)]
        lines += [";", f"; {keyword} begin {size} {len(text)}", *rows, f"; {keyword} end", ";"]
    return lines


def encode_image(picture: Picture, file_format: str) -> bytes:
    """Encode a picture as an image file, PNG or QOI."""
    from PIL import Image  # noqa: PLC0415 - only thumbnails need it

    options: dict[str, Any] = {"compress_level": 6} if file_format == "PNG" else {}
    data = io.BytesIO()
    # With a file name Pillow imports only this format, otherwise all common ones.
    data.name = f"picture.{file_format.lower()}"
    Image.fromarray(picture).save(data, **options)
    return data.getvalue()


def _render_pictures(triangles: Float, sizes: Sequence[tuple[int, int]]) -> list[Picture]:
    """Render the part in several sizes.

    Args:
        triangles: (F, 3, 3) mm, counter-clockwise seen from outside.
        sizes: (width, height) of each picture, px.
    """
    if not sizes:
        return []
    low, size = _measure_projected_extent(triangles)
    scales = [_scale_to_fit(size, *one) for one in sizes]
    scale = max(_SUPERSAMPLING * max(scales), _MIN_LARGE_SIZE / float(size.max()))
    large = _render_large(triangles, low, size, scale)
    return [
        _downscale(large, size * scale, ratio / scale, one) for one, ratio in zip(sizes, scales, strict=True)
    ]


def _measure_projected_extent(triangles: Float) -> tuple[Float, Float]:
    """Return the lowest projected coordinates (2,) of the part, and its projected size (2,), mm."""
    ends = []
    for first in range(0, len(triangles), _BLOCK_SIZE):
        places = _project(triangles[first : first + _BLOCK_SIZE])[:2].reshape(2, -1)
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


def _render_large(triangles: Float, low: Float, size: Float, scale: float) -> NDArray[np.float32]:
    """Render the large picture (h, w, 4), colours multiplied by opacity; row 0 is the bottom."""
    shape = (int(np.ceil(size[1] * scale)) + 1, int(np.ceil(size[0] * scale)) + 1)
    nearest = np.full(shape[0] * shape[1], -np.inf, np.float32)
    colour = np.zeros((shape[0] * shape[1], 3), np.float32)
    for begin in range(0, len(triangles), _BLOCK_SIZE):
        block = triangles[begin : begin + _BLOCK_SIZE]
        x, y, depth = _project(block)
        facet, pixel, pixel_depth = _rasterize_facets(
            (x - low[0]) * scale, (y - low[1]) * scale, depth, shape
        )
        before = nearest[pixel]
        np.maximum.at(nearest, pixel, pixel_depth)
        seen = np.flatnonzero((pixel_depth > before) & (pixel_depth == nearest[pixel]))
        # Of several facets at equal depth, the last one wins.
        colour[pixel[seen]] = _shade_facets(block, facet[seen])
    covered = np.isfinite(nearest).reshape(shape)
    shown = colour.reshape(*shape, 3) * _compute_outline_brightness(nearest.reshape(shape))[..., None]
    return np.dstack([shown, np.float32(255) * covered])


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
    across = consecutive(begin, size)
    row = np.repeat(np.arange(len(row_y)), size)
    facet = row_facet[row]
    by_x, by_y = _compute_depth_slopes(x, y, depth, double_area[kept])
    base = depth[0] - by_x * (x[0] - 0.5) - by_y * y[0]
    pixel_depth = base[facet] + by_x[facet] * across + by_y[facet] * row_y[row]
    pixel = row_y.astype(np.int64)[row] * shape[1] + across
    return kept[facet], pixel, pixel_depth.astype(np.float32)


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


def _shade_facets(triangles: Float, facet: Int) -> NDArray[np.float32]:
    """Return the colours (n, 3) of facets, lit by two lights from the front and some ambient light from above."""
    used = np.zeros(len(triangles), np.bool_)
    used[facet] = True
    corners = triangles[used]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-30)[:, None]
    light = _AMBIENT * (1 + 0.5 * normal[:, 2])
    for direction, strength in _LIGHTS:
        light += strength * np.maximum((normal * (direction / np.linalg.norm(direction))).sum(axis=1), 0)
    shine = np.clip(light, 0, 1)[:, None]
    table = np.zeros((len(triangles), 3), np.float32)
    table[used] = (_SHADE + (_COLOUR - _SHADE) * shine + _GLOSS * np.maximum(shine - 0.8, 0)).clip(0, 255)
    return table[facet]


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


def _downscale(
    large: NDArray[np.float32], size: Float, ratio: float, output_size: tuple[int, int]
) -> Picture:
    """Downscale the large picture to a size (width, height), with the part in its middle.

    Args:
        large: colours multiplied by opacity, row 0 at the bottom.
        size: (2,) size of the part in it, px.
        ratio: px of the result per px of the large picture.
        output_size: width and height of the result, px.
    """
    picture = large
    for axis, (pixels, part) in enumerate(zip(output_size[::-1], size[::-1], strict=True)):
        edges = (np.arange(pixels + 1) - (pixels - part * ratio) / 2) / ratio
        picture = _compute_box_means(picture, edges, axis)
    alpha = picture[..., 3:]
    straight = np.where(alpha > 0, picture[..., :3] * 255 / np.maximum(alpha, 1e-9), 0)
    whole = np.rint(np.concatenate([straight, alpha], axis=2)).clip(0, 255).astype(np.uint8)
    whole[whole[..., 3] == 0] = 0
    return np.ascontiguousarray(whole[::-1])


def _compute_box_means(picture: NDArray[np.float32], edges: Float, axis: int) -> NDArray[np.float32]:
    """Return the mean of the pixels between consecutive `edges` along an axis; pixels beyond the picture are 0."""
    moved = np.moveaxis(picture, axis, 0)
    sums = np.zeros((len(moved) + 1, *moved.shape[1:]), np.float32)
    np.cumsum(moved, axis=0, out=sums[1:])
    at = np.clip(edges, 0, len(moved))
    below = np.minimum(at.astype(np.int64), len(moved) - 1)
    part = (at - below).astype(np.float32).reshape(-1, *[1] * (moved.ndim - 1))
    until = sums[below] * (1 - part) + sums[below + 1] * part
    wide = np.diff(edges).astype(np.float32).reshape(-1, *[1] * (moved.ndim - 1))
    return np.moveaxis(np.diff(until, axis=0) / wide, 0, axis)
