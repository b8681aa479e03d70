"""Mesh + LayerPlan -> Sections: cut all layers at once, join tail to head, remove what is redundant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from printer_slicer.arrays import Float, Int, placed
from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry import Areas, difference, normalize, offset, simplify, union
from printer_slicer.geometry.closing import Chords, LooseEnds, close_by_chords, close_near
from printer_slicer.geometry.crossing import Crossings, crossings_of
from printer_slicer.geometry.joints import cycles
from printer_slicer.geometry.planes import connected, edge_faults
from printer_slicer.geometry.slabs import slab_shadows
from printer_slicer.model import Contours, Gap, LayerPlan, Mesh, MeshFaults, Repair, Sections

__all__ = ["contours", "cut", "find_gaps", "find_mesh_faults", "section_repairs"]

_ROUNDING = 1e-3  # mm; ends this close are the same point, written twice
_FINE = (
    0.002  # mm; contours that must not cross the surface are simplified by this much and moved away as much
)
_CRACK = (
    1.0  # mm; up to this, loose ends are the two sides of a crack; beyond, something is missing between them
)
_MOST_GUESSED = 1 / 3  # of a contour
_WORTH_SAYING = 0.01  # mm²
_MEND = "close the mesh in the program that made it (look for missing or flipped faces there)"


def cut(mesh: Mesh, plan: LayerPlan, resolution: float) -> Sections:
    """The solid area of the part in each layer.

    Args:
        mesh: the part, standing on z = 0.
        plan: where each layer is cut.
        resolution: contours are simplified by at most this, mm, before any polygon operation; where a plan has
            positive or negative containment, by less, and always to its side.

    Raises:
        PartError: the planes meet no material, or the contours cannot be closed.
    """
    exact = plan.containment != "mid"
    rings = _rings_of(mesh, plan, None if exact else resolution)
    solid = _contained(mesh, plan, rings.areas) if exact else normalize(rings.areas)
    if solid.n_rings == 0:
        raise PartError(
            f"{mesh.name}: no layer contains any material",
            remedy="the part may be thinner than one layer, or inside out; check its size and units",
        )
    turned = None if exact else _turned(rings.areas, solid)
    return Sections(plan, solid, rings.unpaired, rings.gaps, turned)


def _turned(rings: Areas, solid: Areas) -> Areas | None:
    """What rings run around the wrong way and so is not solid; None where there is nothing of it.

    Where no rings overlap and none runs around the wrong way, the sum of their signed areas is that of the solid.
    """
    differs = np.abs(rings.area() - solid.area()) > 1e-5 * rings.length() + 1e-6
    if not differs.any():
        return None
    mirror = np.array([-1.0, 1.0])  # in a mirror the wrong way round is the right one
    suspects = rings.of_layers(differs)
    found = normalize(
        Areas(suspects.xy * mirror, suspects.ring_start, suspects.ring_layer, suspects.n_layers)
    )
    found = found.of_layers(found.area() > _WORTH_SAYING)
    if not found.n_rings:
        return None
    return Areas(found.xy * mirror, found.ring_start, found.ring_layer, found.n_layers)


def _contained(mesh: Mesh, plan: LayerPlan, rings: Areas) -> Areas:
    """Everything that the part covers in each layer, or only what it covers at every height of it.

    The section at one height of a layer differs from that at another only where the surface lies between them, so the
    section at the cut with the shadow of the surface in the layer is their union, and without it their intersection.
    """
    section = normalize(rings)
    if plan.containment == "positive":
        shadow = normalize(slab_shadows(mesh.triangles, plan.bottom, plan.top))
        return offset(simplify(union(section, shadow), _FINE), _FINE)
    return offset(simplify(_common(mesh, plan, section), _FINE), -_FINE)


def _common(mesh: Mesh, plan: LayerPlan, section: Areas) -> Areas:
    """What the part covers at every height of each layer.

    Bodies that overlap hide parts of each other's surface, so each is taken for itself; voids are bodies inside out.
    """
    body = connected(mesh.triangles)
    if body.max(initial=0) == 0:
        return difference(section, normalize(slab_shadows(mesh.triangles, plan.bottom, plan.top)))
    solid, hollow = Areas.empty(plan.n_layers), Areas.empty(plan.n_layers)
    for number in range(int(body.max()) + 1):
        one = Mesh(mesh.triangles[body == number], mesh.name)
        shadow = normalize(slab_shadows(one.triangles, plan.bottom, plan.top))
        if one.volume >= 0:
            solid = union(solid, difference(normalize(_rings_of(one, plan).areas), shadow))
        else:
            turned = Mesh(one.triangles[:, ::-1], mesh.name)
            hollow = union(hollow, union(normalize(_rings_of(turned, plan).areas), shadow))
    return difference(solid, hollow)


def contours(mesh: Mesh, plan: LayerPlan) -> Contours:
    """The contour of each layer before and after the repair that the paper describes, to look at."""
    parts = list(crossings_of(mesh.triangles, plan.cut))
    segments = [np.stack([part.xy[part.tail], part.xy[part.head]], axis=1) for part in parts]
    layers = [part.plane[part.tail] for part in parts]
    joined = _rings_of(mesh, plan).areas
    return Contours(
        np.concatenate([np.zeros((0, 2, 2)), *segments]),
        np.concatenate([np.zeros(0, np.int64), *layers]),
        joined,
        simplify(joined, 0.0),
    )


def find_gaps(mesh: Mesh, plan: LayerPlan) -> tuple[int, list[Gap]]:
    """How many edges lack a neighbour, and where contours had to be closed over a gap, widest first."""
    rings = _rings_of(mesh, plan)
    return rings.unpaired, list(rings.gaps)


def section_repairs(
    sections: Sections, shift: Float | tuple[float, float, float] = (0, 0, 0)
) -> list[Repair]:
    """What was done to contours when the mesh was cut.

    Args:
        sections: of the part.
        shift: (3,) mm, added to places.
    """
    done = []
    if sections.gaps:
        places = np.array([(gap.x, gap.y, gap.z) for gap in sections.gaps]) + shift
        area = sum(gap.area for gap in sections.gaps)
        done.append(Repair("gaps in contours closed", places, sections.gaps[0].width, area))
    if sections.turned is not None:
        first, layer = sections.turned.ring_start[:-1], sections.turned.ring_layer
        places = np.column_stack([sections.turned.xy[first], sections.plan.cut[layer]]) + shift
        done.append(Repair("inside-out areas left out", places, area=float(-sections.turned.area().sum())))
    return done


def find_mesh_faults(mesh: Mesh) -> MeshFaults:
    """Where the mesh is open, wrongly oriented, or not a surface; in the coordinates of the mesh."""
    return MeshFaults(*edge_faults(mesh.triangles))


class _Rings(NamedTuple):
    """Contours of all layers; where they had to be closed over more than rounding, widest first; edges left over."""

    areas: Areas
    gaps: tuple[Gap, ...]
    unpaired: int


def _rings_of(mesh: Mesh, plan: LayerPlan, resolution: float | None = None) -> _Rings:
    """The contours of all layers, some layers at a time: only what is left of them once simplified adds up.

    Args:
        mesh: the part.
        plan: where it is cut.
        resolution: mm; None leaves every point.

    Raises:
        MeshError: a contour cannot be closed, or more than a third of one would be guessed.
    """
    parts: list[Areas] = []
    gaps: list[Gap] = []
    unpaired, n_pairs = 0, 0
    for crossings in crossings_of(mesh.triangles, plan.cut):
        following = np.full(len(crossings.xy), -1, np.int64)
        following[crossings.tail] = crossings.head
        chords = Chords.none()
        if crossings.unpaired:
            chords, compared = _closed(following, crossings, plan, mesh.name, n_pairs)
            n_pairs += compared
        rings, closed = _joined(following, crossings, chords, plan, mesh.name)
        parts.append(rings if resolution is None else simplify(rings, resolution))
        gaps += closed
        unpaired += crossings.unpaired
    gaps.sort(key=lambda gap: (-gap.width, gap.layer, gap.x, gap.y))
    return _Rings(Areas.following_on(parts, plan.n_layers), tuple(gaps), unpaired)


def _joined(
    following: Int, crossings: Crossings, chords: Chords, plan: LayerPlan, name: str
) -> tuple[Areas, list[Gap]]:
    """Segments and chords joined tail to head into rings, and the chords that are longer than rounding.

    Raises:
        MeshError: more than a third of a contour would be guessed.
    """
    n_nodes = len(crossings.xy)
    ring, rank = cycles(following)
    first = np.flatnonzero(rank == 0)
    first = first[np.argsort(crossings.plane[first], kind="stable")]
    size = np.bincount(ring, minlength=n_nodes)[first]
    start = np.concatenate([[0], np.cumsum(size)])
    place_of_ring = np.zeros(n_nodes, np.int64)
    place_of_ring[first] = start[:-1]
    xy = placed(crossings.xy, place_of_ring.take(ring) + rank)
    rings = Areas(xy, start, crossings.plane[first], plan.n_layers)
    if not len(chords.tail):
        return rings, []
    place_of_ring[first] = np.arange(len(first))
    gaps = _gaps(chords, crossings, plan)
    _refuse_guesses(chords, place_of_ring[ring[chords.tail]], rings, gaps, name)
    return rings, gaps


def _closed(
    following: Int, crossings: Crossings, plan: LayerPlan, name: str, n_pairs: int
) -> tuple[Chords, int]:
    """Close the contours of some planes, in place; how many pairs of ends were compared for it.

    Raises:
        MeshError: they cannot be closed.
    """
    loose = LooseEnds.of(following, crossings.xy, crossings.plane)
    if not len(loose.tails):
        return Chords.none(), 0
    try:
        found, left = _closed_part(following, loose, n_pairs)
    except OverflowError:
        raise _not_closed(name, loose, plan, "the surface is in shreds") from None
    if len(found.tail) < len(loose.tails):
        raise _not_closed(
            name, loose.without(found), plan, "the contour cannot be closed without crossing itself"
        )
    following[found.tail] = found.head
    return found, left.n_pairs


def _closed_part(following: Int, loose: LooseEnds, n_pairs: int) -> tuple[Chords, LooseEnds]:
    """Loose ends up to 1 mm apart first, then by chords that cross nothing.

    Args:
        following: of each node of some planes.
        loose: those of them that begin or end nowhere.
        n_pairs: compared by chords on other planes.

    Returns:
        Chords; and what was left to the second kind.

    Raises:
        OverflowError: there are too many to compare.
    """
    chords = close_near(loose, _CRACK)
    left = loose.without(chords)
    if len(left.tails):
        tail = np.flatnonzero(following >= 0)
        begin = np.concatenate([loose.xy[tail], loose.xy[chords.tail]])
        end = np.concatenate([loose.xy[following[tail]], loose.xy[chords.head]])
        planes = np.concatenate([loose.plane[tail], loose.plane[chords.tail]])
        chords = Chords.merged([chords, close_by_chords(left, begin, end, planes, n_pairs)])
    return chords, left


def _not_closed(name: str, loose: LooseEnds, plan: LayerPlan, why: str) -> MeshError:
    """What to say where a contour stays open: at the end with the lowest z, x, y."""
    planes = loose.plane[loose.tails]
    lowest = loose.xy[loose.tails[planes == planes.min()]]
    x, y = lowest[np.lexsort(lowest.T[::-1])[0]]
    z = plan.cut[planes.min()]
    return MeshError(
        f"{name}: the surface is open: {why} at x {x:.2f} y {y:.2f} z {z:.2f} "
        f"(loose ends at this height: {len(lowest)})",
        remedy=_MEND,
    )


def _gaps(chords: Chords, crossings: Crossings, plan: LayerPlan) -> list[Gap]:
    """Where contours were closed over more than rounding, widest first."""
    wide = np.flatnonzero(chords.width > _ROUNDING)
    xy = (crossings.xy[chords.tail[wide]] + crossings.xy[chords.head[wide]]) / 2
    plane = crossings.plane[chords.tail[wide]]
    columns = (plane, xy[:, 0], xy[:, 1], plan.cut[plane], chords.width[wide])
    order = np.lexsort((xy[:, 1], xy[:, 0], plane, -chords.width[wide]))
    return [Gap(*row) for row in zip(*(column[order].tolist() for column in columns), strict=True)]


def _refuse_guesses(chords: Chords, ring: Int, rings: Areas, gaps: list[Gap], name: str) -> None:
    """Raise when chords wider than cracks are more than a third of a contour that holds an area.

    Args:
        chords: all.
        ring: (C,) of each chord.
        rings: all.
        gaps: as they will be told.
        name: of the part.
    """
    wide, length = chords.width > _CRACK, rings.ring_length()
    guessed = np.bincount(ring[wide], chords.width[wide], minlength=len(length))
    # A chord along the one sheet that a contour consists of adds nothing: no area hangs on it.
    flat = np.abs(rings.ring_area()) <= _ROUNDING * length
    bad = ((guessed > _MOST_GUESSED * length) & ~flat)[ring] & wide
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
