"""Parts with shallow tops."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from tests.parts import box, joined, loft

__all__ = ["dome", "wedge", "wedge_height", "wedges"]

_BASE = 1.0  # mm


def wedge_height(x: Float, degrees: float) -> Float:
    """The surface of a wedge over positions x, mm from its low side."""
    return np.asarray(_BASE + np.tan(np.deg2rad(degrees)) * x)


def wedge(degrees: float, size: tuple[float, float] = (12.0, 10.0)) -> Mesh:
    """A wedge with this slope, which rises in x from 1 mm on."""
    corner = np.array(box((*size, 1.0)).triangles)
    corner[..., 2] *= wedge_height(corner[..., 0], degrees)
    return Mesh(corner, f"wedge of {degrees:g} degrees")


def wedges(degrees: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0), side: float = 15.0) -> Mesh:
    """Wedges side by side on a common plate."""
    step = side + 2.0
    parts = [
        wedge(angle, (2 * side, side)).moved((0.0, row * step, 0.0)) for row, angle in enumerate(degrees)
    ]
    plates = [box((2 * side, 2.0, _BASE), (0.0, row * step - 2.0, 0.0)) for row in range(1, len(degrees))]
    return joined([*parts, *plates], "wedges")


def dome(radius: float = 20.0, height: float = 3.0, sides: int = 48) -> Mesh:
    """A cap of a sphere of this radius on a cylinder 1 mm high."""
    z = height * np.sin(np.linspace(0, 0.98, 12) * np.pi / 2)
    across = np.sqrt(radius**2 - (radius - height + z) ** 2)
    turn = np.arange(sides) / sides * 2 * np.pi
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [ring * across[0], *(ring * one for one in across)]
    return Mesh(loft(rings, [0.0, *(_BASE + z)]), "dome")
