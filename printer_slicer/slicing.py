"""Cut a mesh at all layers of a plan, join the segments into rings and simplify them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from printer_slicer.arrays import Float, Int, distinct, reorder_points
from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry import (
    Areas,
    close_gaps,
    difference,
    normalize,
    offset,
    simplify,
    union,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import find_cycles
from printer_slicer.geometry.contour_closing import Chords, LooseEnds, close_with_chords, join_near_ends
from printer_slicer.geometry.facet_topology import find_edge_faults, label_bodies
from printer_slicer.geometry.plane_sections import Crossings, intersect_with_planes
from printer_slicer.geometry.slab_projection import BESIDE, project_slabs
from printer_slicer.healing import repair
from printer_slicer.model import (
    Contours,
    Gap,
    LayerPlan,
    Mesh,
    MeshFaults,
    Repair,
    Sections,
    Volumes,
    VolumeSections,
)

if TYPE_CHECKING:
    from printer_slicer.contouring import ReachedAreas

__all__ = [
    "contours",
    "cut",
    "cut_closed",
    "cut_volumes",
    "find_gaps",
    "find_mesh_faults",
    "list_section_repairs",
]

_ROUNDING = 1e-3  # mm; ends this close are the same point
_FINE = 0.002  # mm; contained contours are simplified by this tolerance and then offset by it
_CRACK = 1.0  # mm; loose ends up to this distance are a crack; beyond it, surface is missing
_MAX_GUESSED = 1 / 3  # maximum fraction of a contour that may be guessed
_WORTH_SAYING = 0.01  # mm²
_SHORTEST_SLIT = 0.5  # mm, both sides together
_BLOCKER_MARGIN = 0.01  # mm; blockers are grown by this, so that no slivers remain at their sides
_PAINT_MARGIN = 0.1  # mm; painted facets are grown by this
_MEND = "Close the mesh in your CAD program: look for missing or flipped faces there"


def cut(mesh: Mesh, plan: LayerPlan, resolution: float, reached: ReachedAreas | None = None) -> Sections:
    """Compute the solid area of the part in each layer, without the negative volumes.

    Args:
        mesh: the part, standing on z = 0.
        plan: the layers and their cut planes.
        resolution: tolerance for simplifying contours before polygon operations, mm. With positive or negative
            containment a smaller one is used, and the result never violates the containment.
        reached: areas beside the sections that contoured extrusions fill; they are added.

    Raises:
        PartError: no layer contains material, or the contours cannot be closed.
    """
    exact = plan.containment != "mid"
    rings = _cut_rings(mesh, plan, None if exact else resolution)
    solid = (
        _compute_contained_areas(mesh, plan, rings.areas)
        if exact
        else _close_slits(rings.areas, normalize(rings.areas), 2 * resolution + _ROUNDING)
    )
    if solid.n_rings == 0:
        raise PartError(
            f"{mesh.name}: no layer contains any material",
            remedy="Check size and unit of the part: it may be thinner than one layer, or inside out",
        )
    inverted = None if exact else _find_inverted_areas(rings.areas, solid)
    if reached is not None:
        solid = reached.add_to(solid, resolution)
    if mesh.volumes and mesh.volumes.negative:
        solid = _subtract_negative(mesh, mesh.volumes.negative, plan, solid)
    return Sections(plan, solid, rings.unpaired, rings.gaps, inverted)


def _close_slits(rings: Areas, solid: Areas, width: float) -> Areas:
    """Close the slits between bodies that touch, whose contours were moved apart by rounding and simplification.

    Args:
        rings: contours of all bodies.
        solid: their union.
        width: mm; slits up to this width are closed.
    """
    layers = _find_layers_with_neighbours(rings.select(rings.ring_area() > 0), width)
    if not len(layers):
        return solid
    some = solid.of_layers(layers)
    closed = close_gaps(some, width / 2)
    has_slit = some.length() - closed.length() > _SHORTEST_SLIT
    return Areas.merged([solid.of_layers(~has_slit), closed.of_layers(has_slit)]) if has_slit.any() else solid


def _find_layers_with_neighbours(outer: Areas, width: float) -> Int:
    """Return the layers in which sides of different rings are not farther apart than a width, mm, or nearly so."""
    one, _ = Boxes.of_rings(outer).expand(width / 2).find_neighbours()
    outer = outer.of_layers(distinct(outer.ring_layer[one]))
    one, other = Boxes.of_sides(outer).expand(width / 2).find_neighbours()
    differ = outer.point_ring[one] != outer.point_ring[other]
    return distinct(outer.point_layer[one[differ]])


def _subtract_negative(mesh: Mesh, negative: Mesh, plan: LayerPlan, solid: Areas) -> Areas:
    """Subtract the negative volumes from the solid areas.

    Raises:
        PartError: nothing remains.
        MeshError: a negative volume is not closed.
    """
    remaining = difference(solid, cut_closed(negative, plan))
    if remaining.n_rings == 0:
        raise PartError(
            f"{mesh.name}: nothing remains of the part after the negative volumes were cut out",
            remedy="Check the sizes and positions of the negative volumes",
        )
    return remaining


def cut_volumes(volumes: Volumes, plan: LayerPlan) -> VolumeSections:
    """Find the places of each layer where volumes and painted facets ask for supports or forbid them.

    Args:
        volumes: in the coordinates of the layers.
        plan: the layers of the part.

    Raises:
        MeshError: the surface of an enforcer or blocker is open.
    """
    # A facet hangs in the layer whose cut is the first one above it.
    low = np.concatenate([plan.bottom[:1], plan.cut[:-1]])
    slabs = {
        "mid": (low, plan.cut),
        "positive": (plan.bottom, plan.top),
        "negative": (np.concatenate([low[:1], plan.bottom[:-1]]), np.concatenate([low[:1], plan.top[:-1]])),
    }
    below, above = slabs[plan.containment]

    def project(facets: Float) -> Areas:
        """Return the areas of painted facets (P, 3, 3), seen from above."""
        projected = project_slabs(_duplicate_level_facets(facets), below, above)
        return offset(normalize(projected), _PAINT_MARGIN)

    blocked = offset(cut_closed(volumes.block, plan), _BLOCKER_MARGIN)
    return VolumeSections(
        union(cut_closed(volumes.enforce, plan), project(volumes.enforced_facets)),
        union(blocked, project(volumes.blocked_facets)),
    )


def _duplicate_level_facets(facets: Float) -> Float:
    """Return facets with level ones in two copies, just below and just above their height.

    A level facet at a border of two slabs would be in neither of them.
    """
    is_level = np.ptp(facets[..., 2], axis=1) < BESIDE
    step = np.array([0.0, 0.0, 2 * BESIDE])
    return np.concatenate([facets[~is_level], facets[is_level] - step, facets[is_level] + step])


def cut_closed(mesh: Mesh | None, plan: LayerPlan) -> Areas:
    """Return the sections of a mesh that need not reach all layers; it is repaired if necessary.

    Raises:
        MeshError: the surface is open.
    """
    return normalize(_cut_rings(repair(mesh)[0], plan).areas) if mesh else Areas.empty(plan.n_layers)


def _find_inverted_areas(rings: Areas, solid: Areas) -> Areas | None:
    """Return the areas inside rings of reversed orientation, which are not solid; None if there are none.

    If no rings overlap and none is reversed, the sum of their signed areas equals the area of the solid.
    """
    differs = np.abs(rings.area() - solid.area()) > 1e-5 * rings.length() + 1e-6
    if not differs.any():
        return None
    mirror = np.array([-1.0, 1.0])  # mirroring reverses the orientation
    suspects = rings.of_layers(differs)
    found = normalize(
        Areas(suspects.xy * mirror, suspects.ring_start, suspects.ring_layer, suspects.n_layers)
    )
    found = found.of_layers(found.area() > _WORTH_SAYING)
    if not found.n_rings:
        return None
    return Areas(found.xy * mirror, found.ring_start, found.ring_layer, found.n_layers)


def _compute_contained_areas(mesh: Mesh, plan: LayerPlan, rings: Areas) -> Areas:
    """Return the union (positive containment) or intersection (negative) of all sections within each layer.

    Sections at two heights of a layer differ only where the surface lies between them. So the union is the section at
    the cut plus the shadow of the surface within the layer, and the intersection is the section minus that shadow.
    """
    section = normalize(rings)
    if plan.containment == "positive":
        shadow = normalize(project_slabs(mesh.triangles, plan.bottom, plan.top))
        return offset(simplify(union(section, shadow), _FINE), _FINE)
    return offset(simplify(_intersect_sections(mesh, plan, section), _FINE), -_FINE)


def _intersect_sections(mesh: Mesh, plan: LayerPlan, section: Areas) -> Areas:
    """Return the intersection of all sections within each layer.

    Overlapping bodies hide parts of each other's surface, so each body is processed alone; voids are inverted bodies.
    """
    body = label_bodies(mesh.triangles)
    if body.max(initial=0) == 0:
        return difference(section, normalize(project_slabs(mesh.triangles, plan.bottom, plan.top)))
    solid, hollow = Areas.empty(plan.n_layers), Areas.empty(plan.n_layers)
    for number in range(int(body.max()) + 1):
        one = Mesh(mesh.triangles[body == number], mesh.name)
        shadow = normalize(project_slabs(one.triangles, plan.bottom, plan.top))
        if one.volume >= 0:
            solid = union(solid, difference(normalize(_cut_rings(one, plan).areas), shadow))
        else:
            turned = Mesh(one.triangles[:, ::-1], mesh.name)
            hollow = union(hollow, union(normalize(_cut_rings(turned, plan).areas), shadow))
    return difference(solid, hollow)


def contours(mesh: Mesh, plan: LayerPlan) -> Contours:
    """Return the contours of each layer before and after the repair that the paper describes, for pictures."""
    parts = list(intersect_with_planes(mesh.triangles, plan.cut))
    segments = [np.stack([part.xy[part.tail], part.xy[part.head]], axis=1) for part in parts]
    layers = [part.plane[part.tail] for part in parts]
    joined = _cut_rings(mesh, plan).areas
    return Contours(
        np.concatenate([np.zeros((0, 2, 2)), *segments]),
        np.concatenate([np.zeros(0, np.int64), *layers]),
        joined,
        simplify(joined, 0.0),
    )


def find_gaps(mesh: Mesh, plan: LayerPlan) -> tuple[int, list[Gap]]:
    """Count the edges without a neighbour, and list the closed gaps of contours, widest first."""
    rings = _cut_rings(mesh, plan)
    return rings.unpaired, list(rings.gaps)


def list_section_repairs(
    sections: Sections, shift: Float | tuple[float, float, float] = (0, 0, 0)
) -> list[Repair]:
    """List the repairs of contours made when the mesh was cut.

    Args:
        sections: sections of the part.
        shift: (3,) mm, added to the positions.
    """
    done = []
    if sections.gaps:
        places = np.array([(gap.x, gap.y, gap.z) for gap in sections.gaps]) + shift
        area = sum(gap.area for gap in sections.gaps)
        done.append(Repair("gaps in contours closed", places, sections.gaps[0].width, area))
    if sections.inverted is not None:
        first, layer = sections.inverted.ring_start[:-1], sections.inverted.ring_layer
        places = np.column_stack([sections.inverted.xy[first], sections.plan.cut[layer]]) + shift
        done.append(Repair("inside-out areas left out", places, area=float(-sections.inverted.area().sum())))
    return done


def find_mesh_faults(mesh: Mesh) -> MeshFaults:
    """Find edges where the mesh is open, inconsistently oriented, or not a manifold, in coordinates of the mesh."""
    return MeshFaults(*find_edge_faults(mesh.triangles))


class _Rings(NamedTuple):
    """Contours of all layers, the gaps that were closed (widest first), and the number of unpaired edges."""

    areas: Areas
    gaps: tuple[Gap, ...]
    unpaired: int


def _cut_rings(mesh: Mesh, plan: LayerPlan, resolution: float | None = None) -> _Rings:
    """Cut the contours of all layers, a few layers at a time, so that memory holds mostly simplified contours.

    Args:
        mesh: the part.
        plan: the layers.
        resolution: simplification tolerance, mm; None keeps every point.

    Raises:
        MeshError: a contour cannot be closed, or more than a third of one would be guessed.
    """
    parts: list[Areas] = []
    gaps: list[Gap] = []
    unpaired, n_pairs = 0, 0
    for crossings in intersect_with_planes(mesh.triangles, plan.cut):
        following = np.full(len(crossings.xy), -1, np.int64)
        following[crossings.tail] = crossings.head
        chords = Chords.none()
        if crossings.unpaired:
            chords, compared = _close_contours(following, crossings, plan, mesh.name, n_pairs)
            n_pairs += compared
        rings, closed = _join_rings(following, crossings, chords, plan, mesh.name)
        parts.append(rings if resolution is None else simplify(rings, resolution))
        gaps += closed
        unpaired += crossings.unpaired
    gaps.sort(key=lambda gap: (-gap.width, gap.layer, gap.x, gap.y))
    return _Rings(Areas.concatenate(parts, plan.n_layers), tuple(gaps), unpaired)


def _join_rings(
    following: Int, crossings: Crossings, chords: Chords, plan: LayerPlan, name: str
) -> tuple[Areas, list[Gap]]:
    """Join segments and chords into rings; also return the gaps that the chords close.

    Raises:
        MeshError: more than a third of a contour would be guessed.
    """
    n_nodes = len(crossings.xy)
    ring, rank = find_cycles(following)
    first = np.flatnonzero(rank == 0)
    first = first[np.argsort(crossings.plane[first], kind="stable")]
    size = np.bincount(ring, minlength=n_nodes)[first]
    start = np.concatenate([[0], np.cumsum(size)])
    place_of_ring = np.zeros(n_nodes, np.int64)
    place_of_ring[first] = start[:-1]
    xy = reorder_points(crossings.xy, place_of_ring.take(ring) + rank)
    rings = Areas(xy, start, crossings.plane[first], plan.n_layers)
    if not len(chords.tail):
        return rings, []
    place_of_ring[first] = np.arange(len(first))
    gaps = _list_gaps(chords, crossings, plan)
    _check_guessed_length(chords, place_of_ring[ring[chords.tail]], rings, gaps, name)
    return rings, gaps


def _close_contours(
    following: Int, crossings: Crossings, plan: LayerPlan, name: str, n_pairs: int
) -> tuple[Chords, int]:
    """Close the contours of some planes in place; return the chords and the number of compared pairs of ends.

    Raises:
        MeshError: a contour cannot be closed.
    """
    loose = LooseEnds.of(following, crossings.xy, crossings.plane)
    if not len(loose.tails):
        return Chords.none(), 0
    try:
        found, left = _close_ends(following, loose, n_pairs)
    except OverflowError:
        raise _make_open_surface_error(name, loose, plan, "the surface has too many holes") from None
    if len(found.tail) < len(loose.tails):
        raise _make_open_surface_error(
            name, loose.without(found), plan, "the contour cannot be closed without crossing itself"
        )
    following[found.tail] = found.head
    return found, left.n_pairs


def _close_ends(following: Int, loose: LooseEnds, n_pairs: int) -> tuple[Chords, LooseEnds]:
    """Join loose ends up to 1 mm apart, then join the remaining ends by chords that cross no segment.

    Args:
        following: next node of each node of some planes.
        loose: the nodes without a successor or predecessor.
        n_pairs: number of pairs already compared on other planes.

    Returns:
        The chords, and the loose ends that were left for the second step.

    Raises:
        OverflowError: there are too many pairs to compare.
    """
    chords = join_near_ends(loose, _CRACK)
    left = loose.without(chords)
    if len(left.tails):
        tail = np.flatnonzero(following >= 0)
        begin = np.concatenate([loose.xy[tail], loose.xy[chords.tail]])
        end = np.concatenate([loose.xy[following[tail]], loose.xy[chords.head]])
        planes = np.concatenate([loose.plane[tail], loose.plane[chords.tail]])
        chords = Chords.merged([chords, close_with_chords(left, begin, end, planes, n_pairs)])
    return chords, left


def _make_open_surface_error(name: str, loose: LooseEnds, plan: LayerPlan, why: str) -> MeshError:
    """Return the error for an open contour; its message names the loose end with the lowest z, x, y."""
    planes = loose.plane[loose.tails]
    lowest = loose.xy[loose.tails[planes == planes.min()]]
    x, y = lowest[np.lexsort(lowest.T[::-1])[0]]
    z = plan.cut[planes.min()]
    return MeshError(
        f"{name}: the surface is open: {why} at x {x:.2f} y {y:.2f} z {z:.2f} "
        f"(loose ends at this height: {len(lowest)})",
        remedy=_MEND,
    )


def _list_gaps(chords: Chords, crossings: Crossings, plan: LayerPlan) -> list[Gap]:
    """List the gaps that chords close, widest first, without those due to rounding."""
    wide = np.flatnonzero(chords.width > _ROUNDING)
    xy = (crossings.xy[chords.tail[wide]] + crossings.xy[chords.head[wide]]) / 2
    plane = crossings.plane[chords.tail[wide]]
    columns = (plane, xy[:, 0], xy[:, 1], plan.cut[plane], chords.width[wide])
    order = np.lexsort((xy[:, 1], xy[:, 0], plane, -chords.width[wide]))
    return [Gap(*row) for row in zip(*(column[order].tolist() for column in columns), strict=True)]


def _check_guessed_length(chords: Chords, ring: Int, rings: Areas, gaps: list[Gap], name: str) -> None:
    """Check that no contour consists of guessed chords for more than a third of its length.

    Args:
        chords: all chords.
        ring: (C,) index of the ring of each chord.
        rings: all rings.
        gaps: the gaps that the chords close.
        name: name of the part.

    Raises:
        MeshError: more than a third of a contour would be guessed.
    """
    wide, length = chords.width > _CRACK, rings.ring_length()
    guessed = np.bincount(ring[wide], chords.width[wide], minlength=len(length))
    # A contour without area is a single sheet; a chord along it adds nothing.
    flat = np.abs(rings.ring_area()) <= _ROUNDING * length
    bad = ((guessed > _MAX_GUESSED * length) & ~flat)[ring] & wide
    if bad.any():
        worst = next(gap for gap in gaps if gap.width == chords.width[bad].max())
        share = 100 * float(
            (guessed / np.maximum(length, 1e-9))[ring][bad & (chords.width == worst.width)].max()
        )
        raise MeshError(
            f"{name}: the surface is open: a gap of {worst.width:.3g} mm at x {worst.x:.2f} y {worst.y:.2f} "
            f"z {worst.z:.2f}; {share:.0f} % of the contour there would be guessed",
            remedy=_MEND,
        )
