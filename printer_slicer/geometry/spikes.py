"""Remove spikes from outlines: remains of strips narrower than the grid of a geometry engine.

Where two outlines are one grid step apart, a cut between them leaves an outline that runs out and back along itself.
Such a spike has no area, but its rounded sides may cross. Operations that need simple rings (GEOS, offsets, hatches)
fail there.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.kernel import load_kernel

__all__ = ["is_spike", "remove_spikes"]

_MOST = 2 / STEPS_PER_MM  # mm; rounding moves each side of a spike by up to one step
_LEAST = (
    1 / STEPS_PER_MM + 1e-11
)  # mm; the area of a ring with at most this mean width comes only from rounding


def remove_spikes(areas: Areas) -> Areas:
    """Remove the points at which an outline turns back on itself, and rings without area.

    Args:
        areas: rings on the grid of the engines. A spike is at most two grid steps wide. A ring without area is at most
            one step wide on average.
    """
    kernel = load_kernel()
    if kernel:
        made = kernel.remove_spikes(areas.xy, areas.ring_start, areas.ring_layer)
        return Areas.from_buffers(made, areas.n_layers) if made else areas
    spikes = is_spike(areas)
    if not spikes.any():
        return areas
    # Rings without area turn back somewhere, so the other rings need no check.
    rings = distinct(np.searchsorted(areas.ring_start, np.flatnonzero(spikes), side="right") - 1)
    points = consecutive(areas.ring_start[rings], np.diff(areas.ring_start)[rings])
    keep = np.ones(len(areas.xy), np.bool_)
    keep[points] = False
    part, spikes = areas.take(rings), spikes[points]
    while spikes.any():
        # Remove only one of several neighbouring spikes at a time: then the next one may no longer be a spike.
        gone = spikes & ~spikes[part.previous]
        sound = part.mask_whole_rings(~(gone | _is_in_flat_ring(part, spikes)))
        part, points = part.of_points(sound), points[sound]
        spikes = is_spike(part)
    keep[points] = True
    return areas.of_points(keep)


def _is_in_flat_ring(areas: Areas, spikes: Bool) -> Bool:
    """Return a mask (N,) of points whose ring has a mean width of one grid step or less, or has only `spikes`."""
    flat = 2 * np.abs(areas.ring_area()) <= areas.ring_length() * _LEAST
    flat |= np.logical_and.reduceat(spikes, areas.ring_start[:-1])
    return np.repeat(flat, np.diff(areas.ring_start))


def is_spike(areas: Areas) -> Bool:
    """Return a mask (N,) of points where the outline turns back on itself, within two grid steps."""
    spikes = np.zeros(len(areas.xy), np.bool_)
    if not areas.n_rings:
        return spikes
    kernel = load_kernel()
    if kernel:
        return np.frombuffer(kernel.find_spikes(areas.xy, areas.ring_start, areas.ring_layer), np.bool_)
    first, last = areas.ring_start[:-1], areas.ring_start[1:] - 1
    x, y = np.ascontiguousarray(areas.xy.T)
    ahead_x, ahead_y = _subtract_from_next(x, first, last), _subtract_from_next(y, first, last)
    # Operations on whole arrays are faster than indices, and every area from an engine is checked here.
    along = np.zeros(len(x))
    np.multiply(ahead_x[1:], ahead_x[:-1], out=along[1:])
    along[1:] += ahead_y[1:] * ahead_y[:-1]
    along[first] = ahead_x[first] * ahead_x[last] + ahead_y[first] * ahead_y[last]
    back = np.flatnonzero(along <= 0)
    before = areas.previous[back]
    in_x, in_y, out_x, out_y = ahead_x[before], ahead_y[before], ahead_x[back], ahead_y[back]
    longer = np.maximum(np.hypot(in_x, in_y), np.hypot(out_x, out_y))
    spikes[back] = np.abs(in_x * out_y - in_y * out_x) <= longer * _MOST
    return spikes


def _subtract_from_next(values: Float, first: Int, last: Int) -> Float:
    """Return the difference (N,) to the next point around the ring."""
    ahead = np.empty_like(values)
    np.subtract(values[1:], values[:-1], out=ahead[:-1])
    ahead[last] = values[first] - values[last]
    return ahead
