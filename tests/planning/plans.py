"""Reference for layer plans: compute the errors of a plan facet by facet, to check the planners."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.profile import Profile
from printer_slicer.surface.flats import find_flats
from tests.parts import loft

__all__ = ["RELAXED", "away_from", "cusp_heights", "freely_chosen", "frusta", "slopes_of", "wedge"]

RELAXED = 0.08
"""mm; with it two of the thinnest layers of the test printer (0.08 mm) may be one, so every flat can be met."""
_TOUCH = 2e-3  # mm that a facet must reach into a layer to count


def slopes_of(mesh: Mesh) -> Float:
    """(F,) |n_z| of the facets."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    return np.asarray(np.abs(normal[:, 2]) / np.linalg.norm(normal, axis=1))


def cusp_heights(mesh: Mesh, plan: LayerPlan) -> Float:
    """(L,) the largest cusp height t |n_z| in each layer, over all sloped facets that reach into it."""
    z, slope = mesh.triangles[:, :, 2], slopes_of(mesh)
    low, high = z.min(axis=1)[:, None], z.max(axis=1)[:, None]
    reaches = np.minimum(high, plan.top) - np.maximum(low, plan.bottom) > _TOUCH
    return np.asarray(plan.height * np.where(reaches, slope[:, None], 0.0).max(axis=0))


def freely_chosen(mesh: Mesh, plan: LayerPlan, wanted: Profile) -> Bool:
    """(L,) layers whose height had to be an allowed one: all but a fixed first one and the last two below a plane."""
    return away_from(np.append(find_flats(mesh)[0], mesh.height), plan, wanted)


def away_from(planes: Float, plan: LayerPlan, wanted: Profile) -> Bool:
    """(L,) layers that are not among the last two below one of the planes, nor a first one of a fixed height."""
    near = np.abs(plan.top[:, None] - planes) <= 0.501 * wanted.printer.z_step
    ends = np.flatnonzero(near.any(axis=1))
    free = np.ones(plan.n_layers, np.bool_)
    free[ends] = free[np.maximum(ends - 1, 0)] = False
    free[0] &= not wanted.quality.first_layer_height
    return free


def frusta(sides: list[float], heights: list[float]) -> Mesh:
    """Square rings of these sides, each so many mm over the one before; sides may grow and shrink."""
    rings = [np.array([(-s, -s), (s, -s), (s, s), (-s, s)]) / 2 for s in sides]
    return Mesh(loft(rings, np.cumsum([0.0, *heights]).tolist()), "frusta")


def wedge(degrees: float, height: float = 4.0, side: float = 20.0) -> Mesh:
    """A block with one side that leans inward at this angle from the horizontal; the other sides are walls."""
    ring = np.array([(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)])
    top = ring.copy()
    top[1:3, 0] -= height / np.tan(np.radians(degrees))
    return Mesh(loft([ring, top], [0.0, height]), "wedge")
