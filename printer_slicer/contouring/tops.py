"""The shallow upper surfaces of a part, and the areas of its layers that they widen."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, normalize
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.slab_projection import project_pieces
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["Tops", "find_reached_areas", "find_steepest_slopes", "find_tops"]

_ERROR_RATIO: Final = 1.2
"""A contoured surface may rise by this many layer heights over the width of an extrusion."""
_STEEPEST_DEG: Final = 35.0
_NO_AREA: Final = 1e-9  # mm²
_ROUNDING: Final = 1e-6  # mm


class Tops(Struct, frozen=True, eq=False):
    """The facets that contoured extrusions follow, once for each layer that they reach.

    Attributes:
        plan: the layers.
        corners: (T, 3, 3) mm, counter-clockwise as seen from above, in the coordinates of the layers.
        slope: (T,) tangent of the angle between each facet and the horizontal.
        facet: (R,) a facet that reaches into a layer.
        layer: (R,) that layer, ascending.
        base: z at which the part begins, mm.
    """

    plan: LayerPlan
    corners: Float
    slope: Float
    facet: Int
    layer: Int
    base: float


def find_steepest_slopes(height: Float, profile: Profile) -> Float:
    """Return the tangent (n,) of the steepest slope that is contoured in layers of these heights (n,), mm."""
    if profile.quality.contour_max_slope_deg:
        return np.full(len(height), np.tan(np.deg2rad(profile.quality.contour_max_slope_deg)))
    return np.minimum(_ERROR_RATIO * height / profile.extrusion_width, np.tan(np.deg2rad(_STEEPEST_DEG)))


def find_tops(mesh: Mesh, plan: LayerPlan, profile: Profile, lift: float = 0.0) -> Tops | None:
    """Find the facets that contoured extrusions follow in the layers of a plan; None if there are none.

    The first layer of the part is never contoured, nor is any if the sections are larger or smaller than the part on
    purpose (`containment`).

    Args:
        mesh: the placed part, standing on z = 0.
        plan: the layers.
        profile: rules of contouring; with `quality.z_contouring` off there are no tops.
        lift: height by which the layers of the part are raised, mm, as on a raft.
    """
    if not profile.quality.z_contouring or plan.containment != "mid":
        return None
    steepest = float(find_steepest_slopes(plan.height, profile).max())
    corners, slope = _select_shallow_facets(mesh.triangles, steepest)
    if lift:
        corners = corners + np.array([0.0, 0.0, lift])
    reaching, layer = _list_reached_layers(corners[..., 2], plan)
    kept = slope[reaching] <= find_steepest_slopes(plan.height, profile)[layer] + _ROUNDING
    kept &= plan.bottom[layer] > lift + SAME_TOP
    if not kept.any():
        return None
    order = np.argsort(layer[kept], kind="stable")
    return Tops(plan, corners, slope, reaching[kept][order], layer[kept][order], lift)


def _select_shallow_facets(triangles: Float, steepest: float) -> tuple[Float, Float]:
    """Return the upward facets (T, 3, 3) up to a slope, and their slopes (T,), as tangents."""
    upward = triangles[_cross_sides(triangles, 0, 1) > _NO_AREA]
    normal = [_cross_sides(upward, *axes) for axes in ((1, 2), (2, 0), (0, 1))]
    slope = np.hypot(normal[0], normal[1]) / normal[2]
    shallow = slope <= steepest + _ROUNDING
    return upward[shallow], slope[shallow]


def _cross_sides(triangles: Float, x: int, y: int) -> Float:
    """Return the cross product (n,) of two sides of triangles (n, 3, 3) in the plane of two axes."""
    (ax, ay), (bx, by), (cx, cy) = ((triangles[:, corner, x], triangles[:, corner, y]) for corner in range(3))
    return np.asarray((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def _list_reached_layers(z: Float, plan: LayerPlan) -> tuple[Int, Int]:
    """Return pairs of facets, with corners at `z` (T, 3), and the layers that they reach into from above the bottom."""
    low, high = z.min(axis=1), z.max(axis=1)
    first = np.searchsorted(plan.top, low + _ROUNDING, side="right")
    # Layers of different objects may overlap, so their bottoms need not ascend.
    last = np.searchsorted(plan.top, high + float(plan.height.max()), side="right")
    facet, place = expand_counts(np.maximum(last - first, 0))
    layer = first[facet] + place
    kept = plan.bottom[layer] < high[facet]
    return facet[kept], layer[kept]


def find_reached_areas(tops: Tops, profile: Profile) -> Areas:
    """Return the areas of each layer that contoured extrusions fill, but where the surface is below the cut.

    A section at the cut ends where the surface is half a layer high. A contoured extrusion may be as low as
    `quality.contour_min_height`, so the section takes in everything where the surface is higher than half of that.

    Args:
        tops: from `find_tops`.
        profile: the least height of extrusions.
    """
    plan = tops.plan
    low = np.minimum(plan.bottom + profile.quality.contour_min_height / 2, plan.cut)
    return normalize(project_pieces(tops.corners[tops.facet], tops.layer, low, plan.cut))
