"""The gyroid: one smooth surface without straight lines or crossings, nearly equally stiff in all directions.

The surface is sin x cos y + sin y cos z + sin z cos x = 0. At a given z its section is a set of waves with a closed
form: along x where |cos z| >= |sin z|, along y elsewhere.
Source: Schoen, Infinite periodic minimal surfaces without self-intersections, 1970; the trigonometric level set is the
usual approximation of his surface.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry import Polylines
from printer_slicer.infill.infill_task import InfillTask
from printer_slicer.infill.periodic_lines import PeriodicLines, clip_periodic_lines

__all__ = ["CHORD_ERROR", "gyroid_lines"]

CHORD_ERROR = 0.05
"""mm, approximate largest distance between the waves and the straight lines that replace them."""

_N_SAMPLES = 256  # of one period, to measure curvature and length
_MIN_POINTS = 6  # points of a period


def gyroid_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return sections of the gyroid at the z of each entry.

    The length of sections varies by up to a quarter where waves along x change to waves along y. The second result is
    this ratio (E,), so that the extrusion width can be corrected.
    """
    scale = 1 / (task.spacing * _mean_line_density())  # radians in a mm
    z = task.z * scale
    along_y = np.abs(np.sin(z)) > np.abs(np.cos(z))
    u = np.linspace(-np.pi, np.pi, _N_SAMPLES + 1)
    v = _wave_position(u[None, :], z[:, None], along_y[:, None])
    length = np.hypot(np.diff(u)[None, :], np.diff(v, axis=1))
    chosen, size = _choose_points(u, v, length, CHORD_ERROR * scale)
    owner = np.repeat(np.arange(len(z)), size)
    first = np.stack([chosen, _wave_position(chosen, z[owner], along_y[owner])], axis=1)
    # The second line of each period is the first one turned by 180° about a point, or shifted and mirrored.
    mirrored = np.stack(
        [-first[:, 0], np.where(along_y[owner], first[:, 1] - np.pi, np.pi - first[:, 1])], axis=1
    )
    uv, start = _interleave_lines(first, mirrored, size)
    waves = PeriodicLines(
        uv / scale,
        start,
        period=2 * np.pi / scale,
        pitch=2 * np.pi / scale,
        angle=task.angle,
        swapped=along_y,
    )
    return clip_periodic_lines(task.area, waves), _line_density(length) / _mean_line_density()


def _wave_position(u: Float, z: Float, along_y: Bool) -> Float:
    """Return the position across the wave, radians, of the section's first line at positions `u` along it."""
    # Along x: cos z sin y + sin x cos y = - sin z cos x. Along y: sin z cos x + cos y sin x = - cos z sin y.
    upright = np.where(along_y, np.sin(z), np.cos(z))
    flat = np.where(along_y, np.cos(z), np.sin(z)) * np.where(upright < 0, -1.0, 1.0)
    sine, cosine = np.sin(u), np.cos(u)
    swing = np.where(along_y, cosine, sine) * np.where(upright < 0, -1.0, 1.0)
    upright = np.abs(upright)
    rest = -flat * np.where(along_y, sine, cosine)
    share = np.clip(rest / np.maximum(np.hypot(upright, swing), 1e-12), -1.0, 1.0)
    turned = np.arctan2(swing, upright)
    return np.asarray(np.where(along_y, turned + np.arccos(share), np.arcsin(share) - turned))


def _choose_points(u: Float, v: Float, length: Float, error: float) -> tuple[Float, Int]:
    """Choose points along one period of each wave; return their positions (E, n + 1) and their number per wave.

    A chord of length c over a curve of curvature k deviates by k c² / 8, so chords have the length sqrt(8 error / k).
    """
    direction = np.arctan2(np.diff(v, axis=1), np.diff(u)[None, :])
    turn = np.abs(np.diff(direction, axis=1, append=direction[:, :1]))
    reach = (length + np.roll(length, -1, axis=1)) / 2
    wanted = np.sqrt(turn * reach / (8 * error)) + 1e-9
    total = wanted.sum(axis=1)
    size = np.maximum(np.ceil(total), _MIN_POINTS).astype(np.int64)
    # All waves follow each other on one axis; the k-th point of a wave is at k shares of its total.
    steps = np.concatenate([np.zeros((len(v), 1)), np.cumsum(wanted / total[:, None], axis=1)], axis=1)
    owner = np.repeat(np.arange(len(v)), size)
    asked = owner * 2.0 + consecutive(np.zeros_like(size), size) / size[owner]
    known = (steps + 2.0 * np.arange(len(v))[:, None]).ravel()
    place = np.interp(asked, known, np.tile(u, len(v)))
    return place, size


def _interleave_lines(first: Float, second: Float, size: Int) -> tuple[Float, Int]:
    """Interleave the first and second line of each entry, both in ascending order."""
    start = np.cumsum(size) - size
    owner = np.repeat(np.arange(len(size)), size)
    step = np.arange(len(first)) - start[owner]
    uv = np.zeros((2 * len(first), 2))
    uv[2 * start[owner] + step] = first
    uv[2 * start[owner] + 2 * size[owner] - 1 - step] = second
    return uv, np.append(0, np.cumsum(np.repeat(size, 2)))


def _line_density(length: Float) -> Float:
    """Return the line length per area (E,) of sections, from the steps (E, n) of one of two lines per period."""
    return np.asarray(length.sum(axis=1) / (2 * np.pi**2))


def _mean_line_density() -> float:
    """Return the mean line length per area over all z, computed from an eighth of the period because of symmetry."""
    z = (np.arange(64) + 0.5)[:, None] * np.pi / 256
    u = np.linspace(-np.pi, np.pi, _N_SAMPLES + 1)
    v = _wave_position(u[None, :], z, np.zeros_like(z, dtype=np.bool_))
    return float(_line_density(np.hypot(np.diff(u)[None, :], np.diff(v, axis=1))).mean())
