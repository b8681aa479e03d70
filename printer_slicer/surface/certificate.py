"""Certificate of a layer plan: a proven bound for the deviation of its layers from the surface.

A layer is the prism over one section. A point of the layer is wrong if it is filled outside the part, or empty inside
it. A vertical line from a wrong point to the height of the section must pass the surface. So the distance to the
surface is bounded by a vertical run (see `vertical_runs`) from the section to the top of the layer, or down to its
bottom. If a layer is the union (positive containment) or the intersection (negative) of all its sections, the run may
cross the whole layer.

The certificate covers prisms over exact sections of the mesh. It does not cover the shape of extrusions, the
simplification of contours within the resolution of the profile, or the deviation of the mesh from the real shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arguments import check_arguments
from printer_slicer.arrays import Float, frozen_array
from printer_slicer.deprecation import renamed_method
from printer_slicer.errors import UsageError
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.model import ContourDeviations, LayerPlan, Mesh, ObjectStack
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.surface.contacts import Contacts, find_contacts
from printer_slicer.surface.shadow import Shadow, project_surface
from printer_slicer.surface.vertical_runs import bound_runs, find_main_contact
from printer_slicer.values import Struct, force_setattr, replace

if TYPE_CHECKING:
    from printer_slicer.surface.contoured_tops import ContouredLayers

__all__ = [
    "Certificate",
    "Surface",
    "WorstLayer",
    "certificate_comments",
    "certify",
    "certify_stacks",
    "layer_bounds",
    "read_surface",
]

_ROUNDING = 1e-7  # mm; allowed excess over a tolerance, for rounding of sums


class Surface(Struct, frozen=True, eq=False):
    """Properties of a part's surface that limit the error of layers, computed once for any number of plans.

    Attributes:
        triangles: (F, 3, 3) mm, facets of the part, which stands on z = 0.
        contacts: where a ball can touch the surface.
        turned: the contacts of the surface turned upside down: z counts downward.
        up: shadow of the facets that face up.
        down: shadow of the facets that face down.
        area: mm², area of the surface.
        height: mm, top of the part.
    """

    triangles: Float
    contacts: Contacts
    turned: Contacts
    up: Shadow
    down: Shadow
    area: float
    height: float


class WorstLayer(Struct, frozen=True):
    """Layer with the largest bound of a plan, and the feature that causes it.

    Attributes:
        layer: number of the layer, counted from 1.
        z, x, y: mm, a point on the facet, edge or corner.
        kind: "facet", "flat", "edge", "corner", "contoured facet" if extrusions follow it, "contoured top" if
            printed extrusions do not follow it well, or "top" if the last layer ends below or above the top of the
            part; "none" if no layer can be wrong.
        bound: mm.
    """

    layer: int
    z: float
    x: float
    y: float
    kind: str
    bound: float


class Certificate(SvgRepr, Struct, frozen=True, eq=False):
    """Proven error bounds of a layer plan.

    Attributes:
        plan: the layers.
        bound: (L,) mm, largest distance of any wrongly filled or wrongly empty point of the layer from the surface.
        volume: (L,) mm³, largest volume that is wrongly filled or wrongly empty in the layer.
        missing: mm by which the part extends above the last layer.
        overshoot: mm by which the last layer extends above the part.
        area: mm², area of the surface.
        worst: the layer with `max_error`.
        name: names of the objects, if the certificate belongs to one of several stacks of a plate.
        parts: certificates of the stacks, if the objects of a plate have several layer plans; otherwise empty. In that
            case `plan` is the union of all layers.
    """

    plan: LayerPlan
    bound: Float
    volume: Float
    missing: float
    overshoot: float
    area: float
    worst: WorstLayer
    name: str = ""
    parts: tuple[Certificate, ...] = ()

    def __post_init__(self) -> None:
        for name in ("bound", "volume"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (self.plan.n_layers,)))

    @property
    def max_error(self) -> float:
        """Largest distance of any wrong point from the surface, mm."""
        return max(float(self.bound.max(initial=0.0)), self.missing)

    @property
    def volume_error(self) -> float:
        """Largest total volume that is wrongly filled or empty, mm³, including any part above the last layer."""
        return float(self.volume.sum())

    @property
    def mean_error(self) -> float:
        """Volume error per surface area, mm."""
        return self.volume_error / self.area if self.area > 0 else 0.0

    def ranges_above(self, tolerance: float | Float) -> list[tuple[float, float, float]]:
        """Return the height ranges (lowest z, highest z, bound), mm, in which the bounds of layers exceed `tolerance`.

        Args:
            tolerance: mm, one for all layers, or (L,).
        """
        breaks = self.bound > tolerance + _ROUNDING
        change = np.flatnonzero(np.diff(breaks.astype(np.int64), prepend=0, append=0))
        bottom, top = self.plan.bottom, self.plan.top
        found = [
            (float(bottom[first]), float(top[end - 1]), float(self.bound[first:end].max()))
            for first, end in change.reshape(-1, 2).tolist()
        ]
        if self.missing > np.max(tolerance) + _ROUNDING:
            found.append((float(top[-1]), float(top[-1]) + self.missing, self.missing))
        return found

    over = renamed_method("Certificate.over", "Certificate.ranges_above")


_cached_surfaces: WeakKeyDictionary[Mesh, Surface] = WeakKeyDictionary()


@check_arguments(mesh=Mesh)
def read_surface(mesh: Mesh) -> Surface:
    """Return the surface of a part that stands on z = 0; the result is cached per mesh."""
    if mesh not in _cached_surfaces:
        _cached_surfaces[mesh] = _analyse_mesh(mesh)
    return _cached_surfaces[mesh]


def _analyse_mesh(mesh: Mesh) -> Surface:
    """Compute the contacts and the projected areas of the surface of a mesh."""
    contacts, area = find_contacts(mesh)
    up, down = project_surface(mesh)
    return Surface(mesh.triangles, contacts, contacts.mirror(), up, down, area, mesh.height)


def layer_bounds(surface: Surface, plan: LayerPlan) -> Float:
    """Return the deviation bound (L,) of each layer of a plan, mm, without computing a whole certificate."""
    contours = _find_contours(surface, plan)
    bound = np.maximum(*_bound_level_parts(surface, plan, contours))
    return np.maximum(bound, contours.bound_deviations()) if contours else bound


def _find_contours(surface: Surface, plan: LayerPlan) -> ContouredLayers | None:
    """Return the contoured layers of a plan; None if it has no rule of contouring."""
    if plan.contour_rule is None or plan.containment != "mid":
        return None
    from printer_slicer.surface.contoured_tops import ContouredLayers  # noqa: PLC0415 - off by default

    return ContouredLayers.of_triangles(surface.triangles, plan, plan.contour_rule)


def _bound_level_parts(
    surface: Surface, plan: LayerPlan, contours: ContouredLayers | None
) -> tuple[Float, Float]:
    """Return the same bounds (L,) as `_bound_runs`, mm, but 0 if all surfaces in a layer are contoured."""
    rising, falling = _bound_runs(surface, plan)
    if contours:
        rising, falling = (np.where(contours.only_followed, 0.0, one) for one in (rising, falling))
    return rising, falling


def _bound_runs(surface: Surface, plan: LayerPlan) -> tuple[Float, Float]:
    """Return the deviation bounds (L,), mm, of each layer above its section, and below its section."""
    bottom, top, cut = plan.bottom, plan.top, plan.cut
    if plan.containment == "mid":
        return bound_runs(surface.contacts, cut, top), _bound_downward_runs(surface, cut, bottom)
    # Layers with containment leave out a margin at their borders; it adds at most its height to the error.
    bottom, top = bottom + BESIDE, top - BESIDE
    return bound_runs(surface.contacts, bottom, top) + 2 * BESIDE, _bound_downward_runs(
        surface, top, bottom
    ) + 2 * BESIDE


def _bound_downward_runs(surface: Surface, start: Float, end: Float) -> Float:
    """Return the deviation bounds (L,) for vertical runs from the heights `start` down to `end`, mm."""
    return bound_runs(surface.turned, -start[::-1], -end[::-1])[::-1]


@check_arguments(surface=Surface, plan=LayerPlan)
def certify(surface: Surface, plan: LayerPlan) -> Certificate:
    """Certify a layer plan: bound its deviation and volume error for this part.

    Args:
        surface: surface of the part.
        plan: any plan that starts at z = 0; its containment says which sections a layer covers.

    Raises:
        UsageError: layers overlap, as in the union of the plans of several objects.
    """
    if plan.has_overlaps:
        raise UsageError(
            "cannot certify overlapping layers of different objects",
            remedy="Certify each of stages.stacks: ps.certify(ps.read_surface(stack.mesh), stack.plan)",
        )
    contours = _find_contours(surface, plan)
    rising, falling = _bound_level_parts(surface, plan, contours)
    top = plan.top
    missing = max(surface.height - float(top[-1]), 0.0)
    volume = _bound_volumes(surface, plan)
    if missing:
        volume[-1] += _bound_volume_above(surface.up, float(top[-1]), surface.height)
    level = Certificate(
        plan,
        np.maximum(rising, falling),
        volume,
        missing,
        max(float(top[-1]) - surface.height, 0.0),
        surface.area,
        _find_worst_layer(surface, plan, rising, falling, missing),
    )
    return _add_contours(level, surface, contours) if contours else level


def _add_contours(level: Certificate, surface: Surface, contours: ContouredLayers) -> Certificate:
    """Return the certificate of contoured layers from that of the same layers with level tops."""

    def find_place(layer: int) -> Float:
        """Return the middle of the steepest facet of a layer, mm."""
        x, y, z = surface.triangles[contours.find_steepest_facet(layer)].mean(axis=0)
        return np.array([x, y, np.clip(z, level.plan.bottom[layer], level.plan.top[layer])])

    volume = np.maximum(level.volume + contours.compute_volume_changes(), 0.0)
    return _raise_bounds(
        replace(level, volume=volume), contours.bound_deviations(), "contoured facet", find_place
    )


def _raise_bounds(
    certificate: Certificate, deviation: Float, kind: str, find_place: Callable[[int], Float]
) -> Certificate:
    """Raise the bounds of layers to deviations (L,), mm.

    Args:
        certificate: with other bounds.
        deviation: (L,) mm.
        kind: of the worst layer, if it is one of these.
        find_place: returns the place (3,) of the deviation of a layer, mm.
    """
    bound = np.maximum(certificate.bound, deviation)
    layer = int(bound.argmax())
    if deviation[layer] <= certificate.max_error:
        return replace(certificate, bound=bound)
    x, y, z = find_place(layer).tolist()
    return replace(certificate, bound=bound, worst=WorstLayer(layer + 1, z, x, y, kind, float(bound[layer])))


def certify_stacks(stacks: Sequence[ObjectStack]) -> Certificate:
    """Certify all stacks of a plate together: largest deviation, and sum of the volume errors of all objects.

    For printed extrusions with contoured tops, the measured deviations of these count if they are larger than those
    that the plan promises. With several stacks, the layers are the union of all layers, and `parts` has the certificate
    of each stack.

    Args:
        stacks: the stacks of a plate, as in `Stages.stacks`.
    """
    found = [_add_measured(certify(read_surface(one.mesh), one.plan), one.contours) for one in stacks]
    if len(found) == 1:
        return found[0]
    return _join_certificates(
        [replace(one, name=stack.mesh.name) for one, stack in zip(found, stacks, strict=True)]
    )


def _add_measured(certificate: Certificate, contours: ContourDeviations | None) -> Certificate:
    """Return a certificate in which measured deviations of contoured tops count."""
    if contours is None:
        return certificate
    return _raise_bounds(certificate, contours.deviation, "contoured top", contours.place.__getitem__)


def _join_certificates(parts: Sequence[Certificate]) -> Certificate:
    """Combine the certificates of several stacks on the union of their layers.

    Args:
        parts: at least two certificates with the names of their objects.
    """
    plan = LayerPlan.union([one.plan for one in parts])
    bound, volume = np.zeros(plan.n_layers), np.zeros(plan.n_layers)
    for one in parts:
        layer = plan.find_tops(one.plan.top)
        np.maximum.at(bound, layer, one.bound)
        np.add.at(volume, layer, one.volume)
    return Certificate(
        plan,
        bound,
        volume,
        max(one.missing for one in parts),
        max(one.overshoot for one in parts),
        sum(one.area for one in parts),
        _find_worst(parts, plan),
        parts=tuple(parts),
    )


def _find_worst(parts: Sequence[Certificate], plan: LayerPlan) -> WorstLayer:
    """Return the worst layer of all stacks, counted in the union of all layers."""
    one = max(parts, key=lambda part: part.max_error)
    top = one.plan.top[one.worst.layer - 1 : one.worst.layer]
    return replace(one.worst, layer=int(plan.find_tops(top)[0]) + 1)


def certificate_comments(certificate: Certificate) -> tuple[str, ...]:
    """Format a certificate as comments of a G-code file."""
    worst, plans = certificate.worst, [one.plan for one in certificate.parts or (certificate,)]
    heights = {height for plan in plans for height in plan.height.tolist()}
    return (
        f"layer heights = {len(heights)}",
        f"certified error [mm] = {certificate.max_error:.4f}",
        f"certified error attained = layer {worst.layer}, z {worst.z:.4g}, {worst.kind}",
        f"mean error [mm] = {certificate.mean_error:.4f}",
        f"volume error [mm3] = {certificate.volume_error:.2f}",
        *(
            f"certified errors of {' '.join(one.name.split())} = {one.max_error:.4f} mm, {one.volume_error:.2f} mm3"
            for one in certificate.parts
        ),
    )


def _bound_volumes(surface: Surface, plan: LayerPlan) -> Float:
    """Return an upper bound (L,) of the volume that each layer wrongly fills or leaves empty, mm³."""
    bottom, top, cut = plan.bottom, plan.top, plan.cut
    over, under = (surface.up, surface.down) if plan.containment != "negative" else (surface.down, surface.up)
    if plan.containment == "mid":
        # All planes at once: bottoms and cuts alternate, and the last top follows.
        planes = np.append(np.column_stack([bottom, cut]).ravel(), top[-1])
        aside = 2 * cut - bottom - top
        total = np.zeros(plan.n_layers)
        for shadow in (over, under):
            below = shadow.area_integral(planes)
            total += below[2::2] + below[:-1:2] - 2 * below[1::2]
            if np.abs(aside).max() > _ROUNDING:
                total += shadow.area_below(cut) * aside
        return np.maximum(total, 0)
    height, bottom, top = top - bottom, bottom + BESIDE, top - BESIDE
    added = (
        over.area_integral(top)
        - over.area_integral(bottom)
        - height * over.area_below(bottom, including=True)
    )
    added += height * under.area_below(top) - under.area_integral(top) + under.area_integral(bottom)
    return np.maximum(added, 0)


def _bound_volume_above(up: Shadow, top: float, height: float) -> float:
    """Return an upper bound of the volume of the part above the last layer, mm³."""
    planes = np.array([top, height])
    below, everything = up.area_integral(planes)
    return float((height - top) * up.area_below(planes, including=True)[1] - (everything - below))


def _find_worst_layer(
    surface: Surface, plan: LayerPlan, rising: Float, falling: Float, missing: float
) -> WorstLayer:
    """Find the layer with the largest bound, and the contact that contributes most to it."""
    bound = np.maximum(rising, falling)
    layer = int(bound.argmax())
    bottom, top, cut = float(plan.bottom[layer]), float(plan.top[layer]), float(plan.cut[layer])
    if missing > bound[layer] or bound[layer] <= 0:
        x, y, _ = surface.triangles.reshape(-1, 3)[surface.triangles[:, :, 2].argmax()]
        kind = "top" if missing > 0 else "none"
        return WorstLayer(plan.n_layers, surface.height, float(x), float(y), kind, max(missing, 0.0))
    whole = plan.containment != "mid"
    if rising[layer] >= falling[layer]:
        begin, end, contacts, turn = bottom if whole else cut, top, surface.contacts, 1
    else:
        begin, end, contacts, turn = -top if whole else -cut, -bottom, surface.turned, -1
    place = find_main_contact(contacts, begin, end)
    z = turn * min(max(float(contacts.low[place]), begin), end)
    source, flat = int(contacts.source[place]), contacts.low[place] == contacts.high[place]
    x, y, z, kind = _find_contact_point(surface.triangles, source, z, flat=bool(flat))
    if end > surface.height and contacts is surface.contacts and z >= surface.height - _ROUNDING:
        kind = "top"
    return WorstLayer(layer + 1, z, x, y, kind, float(bound[layer]))


def _find_contact_point(
    triangles: Float, source: int, z: float, *, flat: bool
) -> tuple[float, float, float, str]:
    """Return a point on the facet, edge or corner of a contact, at height z or as near as possible, and the kind."""
    n = len(triangles)
    if source < n:
        corners, kind = triangles[source], "flat" if flat else "facet"
    elif source < 4 * n:
        facet, at = divmod(source - n, 3)
        corners, kind = triangles[facet][[at, (at + 1) % 3]], "edge"
    else:
        facet, at = divmod(source - 4 * n, 3)
        corners, kind = triangles[facet][[at, at]], "corner"
    low, high = corners[corners[:, 2].argmin()], corners[corners[:, 2].argmax()]
    share = np.clip((z - low[2]) / max(high[2] - low[2], 1e-300), 0, 1)
    x, y, height = corners.mean(axis=0) if flat else low + share * (high - low)
    return float(x), float(y), float(height), kind
