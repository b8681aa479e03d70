"""Cross-section of an extruded bead: a rectangle with half-circles at its sides.

Width `w` and height `h` in mm. The cross-section is (w - h)·h + π·(h/2)². The spacing of neighbouring beads is
w - h·(1 - π/4). Then the cross-section equals spacing·h, so the beads fill their layer without gaps or surplus volume.
Source: the rounded-rectangle model that PrusaSlicer's "flow math" page documents; derived anew here.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "compute_side_extension",
    "cross_section",
    "filament_per_mm",
    "layer_widths",
    "spacing",
    "width_for_section",
    "width_for_spacing",
]

Float = NDArray[np.float64]
_ROUNDING = 1 - pi / 4  # reduction of the spacing by the round sides, as a fraction of the height


def spacing(width: Float | float, height: Float | float) -> Float:
    """Return the distance between the centre lines of neighbouring beads, mm, in the shape of the arguments."""
    return np.asarray(width - np.asarray(height) * _ROUNDING, dtype=np.float64)


def width_for_spacing(spacing: Float | float, height: Float | float) -> Float:
    """Return the width, mm, of a bead with this spacing; the inverse of `spacing`."""
    return np.asarray(spacing + np.asarray(height) * _ROUNDING, dtype=np.float64)


def compute_side_extension(height: Float | float) -> Float:
    """Return how far each side of a bead extends beyond a rectangle of the same height and cross-section, mm."""
    return np.asarray(np.asarray(height) * _ROUNDING / 2, dtype=np.float64)


def cross_section(width: Float | float, height: Float | float) -> Float:
    """Return the cross-section of a bead, mm²; the width must not be less than the height."""
    return spacing(width, height) * height


def width_for_section(section: Float | float, height: Float | float) -> Float:
    """Return the width, mm, of a bead with a cross-section in mm²; the inverse of `cross_section`.

    A cross-section too small to be pressed flat at this height stays round, as wide as high.
    """
    section, height = np.asarray(section, dtype=np.float64), np.asarray(height, dtype=np.float64)
    thread = np.sqrt(4 * section / pi)
    return np.where(thread < height, thread, width_for_spacing(section / height, height))


def filament_per_mm(width: Float | float, height: Float | float, filament_diameter: Float | float) -> Float:
    """Return the filament to feed per mm of path, mm/mm."""
    return np.asarray(cross_section(width, height) / (pi * filament_diameter**2 / 4), dtype=np.float64)


def layer_widths(n_layers: int, first: float, usual: float) -> Float:
    """Return the extrusion width (n_layers,) of each layer, mm: one for the first layer, one for all others."""
    widths = np.full(n_layers, usual, dtype=np.float64)
    widths[:1] = first
    return widths
