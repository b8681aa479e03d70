"""Mesh + LayerPlan -> Sections: cut all layers at once, join tail to head, remove what is redundant."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry import Areas, Float, Int, difference, normalize, offset, simplify, union
from printer_slicer.geometry.areas import placed
from printer_slicer.geometry.closing import Chords, LooseEnds, close_by_chords, close_near
from printer_slicer.geometry.crossing import Crossings, cross
from printer_slicer.geometry.joints import cycles
from printer_slicer.geometry.planes import connected, edge_faults
from printer_slicer.geometry.slabs import slab_shadows
from printer_slicer.model import Contours, Faults, Gap, LayerPlan, Mesh, Repair, Sections

__all__ = ["contours", "cut", "mesh_faults", "open_places", "section_repairs"]

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
    crossings = cross(mesh.triangles, plan.cut)
    rings, gaps = _joined(crossings, plan, mesh.name)
    simple = simplify(rings, resolution)
    solid = normalize(simple) if plan.containment == "mid" else _contained(mesh, plan, rings)
    if solid.n_rings == 0:
        raise PartError(
            f"{mesh.name}: no layer contains any material",
            remedy="the part may be thinner than one layer, or inside out; check its size and units",
        )
    turned = _turned(simple, solid) if plan.containment == "mid" else None
    return Sections(plan, solid, crossings.unpaired, tuple(gaps), turned)


def _turned(rings: Areas, solid: Areas) -> Areas | None:
    """What rings run around the wrong way and so is not solid; None where there is nothing of it.

    Where no rings overlap and none runs around the wrong way, the sum of their signed areas is that of the solid.
    """
    perimeter = np.bincount(rings.ring_layer, rings.ring_length(), minlength=rings.n_layers)
    differs = np.abs(rings.area() - solid.area()) > 1e-5 * perimeter + 1e-6
    if not differs.any():
        return None
    mirror = np.array([-1.0, 1.0])  # in a mirror the wrong way round is the right one
    suspects = rings.select(differs[rings.ring_layer])
    found = normalize(
        Areas(suspects.xy * mirror, suspects.ring_start, suspects.ring_layer, suspects.n_layers)
    )
    found = found.select((found.area() > _WORTH_SAYING)[found.ring_layer])
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
            rings = _joined(cross(one.triangles, plan.cut), plan, mesh.name)[0]
            solid = union(solid, difference(normalize(rings), shadow))
        else:
            turned = Mesh(one.triangles[:, ::-1], mesh.name)
            rings = _joined(cross(turned.triangles, plan.cut), plan, mesh.name)[0]
            hollow = union(hollow, union(normalize(rings), shadow))
    return difference(solid, hollow)


def contours(mesh: Mesh, plan: LayerPlan) -> Contours:
    """The contour of each layer before and after the repair that the paper describes, to look at."""
    crossings = cross(mesh.triangles, plan.cut)
    segments = np.stack([crossings.xy[crossings.tail], crossings.xy[crossings.head]], axis=1)
    joined = _joined(crossings, plan, mesh.name)[0]
    return Contours(segments, crossings.plane[crossings.tail], joined, simplify(joined, 0.0))


def open_places(mesh: Mesh, plan: LayerPlan) -> tuple[int, list[Gap]]:
    """How many edges lack a neighbour, and where contours had to be closed over a gap, widest first."""
    crossings = cross(mesh.triangles, plan.cut)
    return crossings.unpaired, _joined(crossings, plan, mesh.name)[1]


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


def mesh_faults(mesh: Mesh) -> Faults:
    """Where the mesh is open, wrongly oriented, or not a surface; in the coordinates of the mesh."""
    return Faults(*edge_faults(mesh.triangles))


def _joined(crossings: Crossings, plan: LayerPlan, name: str) -> tuple[Areas, list[Gap]]:
    """All segments joined tail to head into closed rings, and where that took more than rounding, widest first.

    Raises:
        MeshError: a contour cannot be closed, or more than a third of one would be guessed.
    """
    n_nodes = len(crossings.xy)
    following = np.full(n_nodes, -1, np.int64)
    following[crossings.tail] = crossings.head
    chords = _closed(following, crossings, plan, name) if crossings.unpaired else Chords.none()
    ring, rank = _cycles(following, crossings.part)
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


def _cycles(following: Int, part: Int) -> tuple[Int, Int]:
    """The lowest node of each node's ring, and the steps from there to the node: part by part, to stay in caches."""
    ring, rank = np.zeros_like(following), np.zeros_like(following)
    for begin, end in pairwise(part.tolist()):
        ring[begin:end], rank[begin:end] = cycles(following[begin:end] - begin)
        ring[begin:end] += begin
    return ring, rank


def _closed(following: Int, crossings: Crossings, plan: LayerPlan, name: str) -> Chords:
    """Close all contours, in place, some planes at a time: what is in shreds is found before all of it is compared."""
    chords, n_pairs = [Chords.none()], 0
    for begin, end in pairwise(crossings.part.tolist()):
        here = slice(begin, end)
        part = np.where(following[here] < 0, -1, following[here] - begin)
        loose = LooseEnds.of(part, crossings.xy[here], crossings.plane[here])
        if len(loose.tails):
            try:
                found, left = _closed_part(part, loose, n_pairs)
            except OverflowError:
                raise _not_closed(name, loose, plan, "the surface is in shreds") from None
            if len(found.tail) < len(loose.tails):
                left = loose.without(found)
                raise _not_closed(name, left, plan, "the contour cannot be closed without crossing itself")
            n_pairs += left.n_pairs
            following[found.tail + begin] = found.head + begin
            chords.append(Chords(found.tail + begin, found.head + begin, found.width))
    return Chords.merged(chords)


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
