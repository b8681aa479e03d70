"""Rate a direction of a part by its layers, by supports that land on the part, and by how the part stands."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry.raster import Float32
from printer_slicer.orienting.cost_model import FLAT, CostModel, measure_stairs
from printer_slicer.orienting.orientations import Orientation
from printer_slicer.orienting.part_shape import PartShape
from printer_slicer.orienting.stability import measure_standing
from printer_slicer.orienting.support_estimate import estimate_supports
from printer_slicer.orienting.surface_samples import TurnedSamples
from printer_slicer.orienting.turning import find_angles, find_upright_frame
from printer_slicer.planning.slopes import cusp_height
from printer_slicer.profile import Profile

__all__ = ["rate_frame"]

_N_BINS: Final = 60  # of the height
_STEEPEST_WEIGHT: Final = 8  # exponent of a mean in which the flattest slopes count most
_SLACK: Final = 1e-3  # mm


def rate_frame(shape: PartShape, frame: Float, profile: Profile, cost_model: CostModel) -> Orientation:
    """Rate a part that is turned so that the rows of `frame` (3, 3) are its axes x, y and z.

    Args:
        shape: the part.
        frame: axes of the turned part in the axes of the shape.
        profile: gives the size of the printer and the width of a brim.
        cost_model: of time, support and deviation.
    """
    corners = shape.hull @ frame.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    samples = _turn_samples(shape, frame, low)
    size = high - low
    upright = find_upright_frame(shape, -frame[2])  # the turn about z makes no difference
    width = float(np.hypot(*np.ptp(shape.hull @ upright[:2].T, axis=0))) / 2
    seconds, stairs = _time_layers(samples, shape.volume, (width, float(size[2])), cost_model, profile)
    space, area = estimate_supports(samples, cost_model)
    extruded = cost_model.compute_support_volume(space, area)
    minutes = (seconds + float(cost_model.times.compute_support_seconds(*extruded))) / 60
    grams, overhang = float(cost_model.compute_grams(extruded.sum())), float(area.sum())
    deviation = stairs + cost_model.gap * overhang
    standing = measure_standing(shape, frame, profile.quality.brim_width)
    return Orientation(
        rotate=find_angles(frame @ shape.axes),
        cost=float(cost_model.compute_cost(minutes, grams, deviation)),
        minutes=minutes,
        support_g=grams,
        deviation=deviation / max(shape.area, 1e-9),
        surface_area=shape.area,
        height=float(size[2]),
        contact_area=standing.contact_area,
        overhang=overhang,
        tilt_deg=standing.tilt_deg,
        is_stable=standing.is_stable,
        fits=bool((size <= np.add(profile.printer.print_volume, _SLACK)).all()),
    )


def _turn_samples(shape: PartShape, frame: Float, low: Float) -> TurnedSamples:
    """Return the samples of a part with the rows of `frame` (3, 3) as axes, from the corner `low` (3,) of its box."""
    narrow = frame.astype(np.float32)
    points = narrow @ shape.samples.points - low.astype(np.float32)[:, None]
    return TurnedSamples(points, narrow[2] @ shape.samples.normals, shape.samples.area, shape.spacing)


def _time_layers(
    samples: TurnedSamples, volume: float, size: tuple[float, float], cost_model: CostModel, profile: Profile
) -> tuple[float, float]:
    """Return the print time of the part without supports, s, and the volume of the stairs on its slopes, mm³.

    Args:
        samples: of the turned part.
        volume: of the part, mm³.
        size: mean width and height of the turned part, mm.
        cost_model: of the profile.
        profile: gives the tolerance of layers.
    """
    times, step = cost_model.times, max(size[1] / _N_BINS, 1e-9)
    _, rise, area, _ = samples
    of = np.clip((samples.points[2] / np.float32(step)).astype(np.int64), 0, _N_BINS - 1)

    def add_up(values: Float32) -> Float:
        """Return the sums (B,) of the samples in each bin."""
        return np.bincount(of, values, _N_BINS).astype(np.float64)

    slope = np.abs(rise)
    sine = np.sqrt(np.maximum(np.float32(1) - rise * rise, np.float32(0)))
    filled = area * times.fill_shells(rise, sine)
    is_flat = slope > FLAT
    stairs = np.where(is_flat, np.float32(0), area * measure_stairs(slope, sine))
    solid = _spread(add_up(filled * (is_flat & (rise < 0))), times.bottom / step)
    solid += _spread(add_up(filled * (is_flat & (rise > 0))), -times.top / step)
    height = _choose_heights(
        add_up(stairs * slope ** (_STEEPEST_WEIGHT - 1)), add_up(area), cost_model, profile
    )
    sections = _measure_sections(add_up(area * rise), volume)
    volumes = times.divide(add_up(area * sine), solid, add_up(filled * ~is_flat), sections)
    width = np.full(_N_BINS, size[0])
    seconds = times.compute_seconds(volumes, step / height, width, height)
    return float(seconds.sum()), float(add_up(stairs) @ height) * cost_model.stair_share


def _measure_sections(upward: Float, volume: float) -> Float:
    """Return the volume (B,) of the part in each bin, mm³.

    A section has the area by which the surface above it faces up more than down.

    Args:
        upward: (B,) area of the surface in each bin, times the vertical component of its normals, mm².
        volume: of the part, mm³.
    """
    sections = np.maximum(np.cumsum(upward[::-1])[::-1] - upward / 2, 0.0)
    return np.asarray(sections * (volume / max(float(sections.sum()), 1e-9)))


def _spread(values: Float, width: float) -> Float:
    """Return values (B,) of bins, each spread over `width` bins from its own upward, or downward if it is negative."""
    if width < 0:
        return _spread(values[::-1], -width)[::-1]
    width = max(width, 1.0)
    before = np.arange(len(values) + 1) - width
    total = np.append(0.0, np.cumsum(values))
    at = np.arange(len(total), dtype=np.float64)
    # The sum over a window of this width ends at each edge between bins.
    window = (total - np.interp(before, at, total)) / width
    return np.asarray(window[1:])


def _choose_heights(powers: Float, area: Float, cost_model: CostModel, profile: Profile) -> Float:
    """Return the layer height (B,) in each bin, as the tolerance allows it for the flattest slopes, mm.

    Args:
        powers: (B,) area of slopes times a power of the vertical component of their normals, mm².
        area: (B,) mm².
        cost_model: gives the range of layer heights.
        profile: gives the tolerance.
    """
    flattest = (powers / np.maximum(area, 1e-9)) ** (1 / _STEEPEST_WEIGHT)
    return np.clip(cusp_height(profile) / np.maximum(flattest, 1e-9), *cost_model.times.heights)
