"""The certificate of a layer plan: how far from the surface its stack of layers can be wrong, proven.

A layer is the prism over one section. A point of it is wrong if it is filled outside of the part or empty inside. From
a wrong point straight up or down to the height at which the layer was cut one must pass the surface, so the distance to
the surface is bounded by a vertical run (see `runs`) from the cut to the top of the layer, or down to its bottom. Where
the layer holds everything (positive containment) or only what is common (negative), the run may cross the whole layer.

The certificate speaks of prisms over exact sections and of the mesh: not of bead shape, of contours simplified within
the profile's resolution, nor of the surface that the mesh stands for.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arrays import Float, frozen_array
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.surface.contacts import Contacts, find_contacts
from printer_slicer.surface.shadow import Shadow, project_surface
from printer_slicer.surface.vertical_runs import run_bounds, steepest

__all__ = [
    "Certificate",
    "Surface",
    "WorstLayer",
    "certificate_comments",
    "certify",
    "layer_bounds",
    "read_surface",
]

_ROUNDING = 1e-7  # mm; less than this over a tolerance is the sum's rounding


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """What of a part's surface decides about layers, read once for any number of plans.

    Attributes:
        triangles: (F, 3, 3) mm, the facets of the part, standing on z = 0.
        contacts: where balls touch it.
        turned: the same upside down: z counts downward.
        up: the shadow of the facets that face up.
        down: the shadow of the facets that face down.
        area: mm², of the surface.
        height: mm, top of the part.
    """

    triangles: Float
    contacts: Contacts
    turned: Contacts
    up: Shadow
    down: Shadow
    area: float
    height: float


@dataclass(frozen=True, slots=True)
class WorstLayer:
    """Where the bound of a plan is attained, and by what.

    Attributes:
        layer: index of the layer.
        z, x, y: mm, a place on the facet, edge or corner.
        kind: "facet", "flat", "edge", "corner", or "top" for what the last layer leaves out or adds over the part;
            "none" where no layer can be wrong.
        bound: mm.
    """

    layer: int
    z: float
    x: float
    y: float
    kind: str
    bound: float


@dataclass(frozen=True, slots=True, eq=False)
class Certificate(SvgRepr):
    """What is proven about a layer plan.

    Attributes:
        plan: the layers.
        bound: (L,) mm; no wrongly filled or empty point of the layer is farther from the surface than this.
        volume: (L,) mm³; no more than this is filled or empty wrongly in the layer.
        missing: mm by which the part rises over the last layer.
        overshoot: mm by which the last layer rises over the part.
        area: mm² of the surface.
        worst: where `max_error` is attained.
    """

    plan: LayerPlan
    bound: Float
    volume: Float
    missing: float
    overshoot: float
    area: float
    worst: WorstLayer

    def __post_init__(self) -> None:
        for name in ("bound", "volume"):
            object.__setattr__(
                self, name, frozen_array(getattr(self, name), np.float64, (self.plan.n_layers,))
            )

    @property
    def max_error(self) -> float:
        """No wrong point anywhere is farther from the surface than this, mm."""
        return max(float(self.bound.max(initial=0.0)), self.missing)

    @property
    def volume_error(self) -> float:
        """No more than this is filled or empty wrongly, mm³; what the last layer leaves out is in it."""
        return float(self.volume.sum())

    @property
    def mean_error(self) -> float:
        """Volume error by surface, mm: how thick a film the wrong places would make."""
        return self.volume_error / self.area if self.area > 0 else 0.0

    def over(self, tolerance: float | Float) -> list[tuple[float, float, float]]:
        """Stretches (lowest z, highest z, bound) of neighbouring layers whose bound is over `tolerance`, all mm.

        Args:
            tolerance: for all layers, or (L,).
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


_read: WeakKeyDictionary[Mesh, Surface] = WeakKeyDictionary()


def read_surface(mesh: Mesh) -> Surface:
    """Return the surface of a part that stands on z = 0; the result is cached per mesh."""
    if mesh not in _read:
        _read[mesh] = _surface(mesh)
    return _read[mesh]


def _surface(mesh: Mesh) -> Surface:
    contacts, area = find_contacts(mesh)
    up, down = project_surface(mesh)
    return Surface(mesh.triangles, contacts, contacts.mirrored(), up, down, area, mesh.height)


def layer_bounds(surface: Surface, plan: LayerPlan) -> Float:
    """(L,) mm, the bound of each layer of a plan, without the rest of its certificate."""
    return np.maximum(*_runs(surface, plan))


def _runs(surface: Surface, plan: LayerPlan) -> tuple[Float, Float]:
    """(L,) mm, what the runs upward and those downward allow to be wrong in each layer."""
    bottom, top, cut = plan.bottom, plan.top, plan.cut
    if plan.containment == "mid":
        return run_bounds(surface.contacts, cut, top), _downward(surface, cut, bottom)
    # Contained layers leave out what lies within rounding of their borders; at most that much is wrong for it.
    bottom, top = bottom + BESIDE, top - BESIDE
    return run_bounds(surface.contacts, bottom, top) + 2 * BESIDE, _downward(
        surface, top, bottom
    ) + 2 * BESIDE


def _downward(surface: Surface, start: Float, end: Float) -> Float:
    """(L,) mm, the bounds of the runs from `start` down to `end`."""
    return run_bounds(surface.turned, -start[::-1], -end[::-1])[::-1]


def certify(surface: Surface, plan: LayerPlan) -> Certificate:
    """Certify a layer plan: bound its deviation and volume error for this part.

    Args:
        surface: of the part.
        plan: any plan whose layers begin at z = 0; its containment says what the layers hold.
    """
    rising, falling = _runs(surface, plan)
    top = plan.top
    missing = max(surface.height - float(top[-1]), 0.0)
    volume = _volume(surface, plan)
    if missing:
        volume[-1] += _shadow_over(surface.up, float(top[-1]), surface.height)
    return Certificate(
        plan,
        np.maximum(rising, falling),
        volume,
        missing,
        max(float(top[-1]) - surface.height, 0.0),
        surface.area,
        _worst(surface, plan, rising, falling, missing),
    )


def certificate_comments(certificate: Certificate) -> tuple[str, ...]:
    """Format a certificate as comments of a G-code file."""
    worst = certificate.worst
    return (
        f"layer heights = {len(set(certificate.plan.height.tolist()))}",
        f"certified error [mm] = {certificate.max_error:.4f}",
        f"certified error attained = layer {worst.layer + 1}, z {worst.z:.4g}, {worst.kind}",
        f"mean error [mm] = {certificate.mean_error:.4f}",
        f"volume error [mm3] = {certificate.volume_error:.2f}",
    )


def _volume(surface: Surface, plan: LayerPlan) -> Float:
    """(L,) the volume that each layer fills or leaves empty wrongly, at most."""
    bottom, top, cut = plan.bottom, plan.top, plan.cut
    over, under = (surface.up, surface.down) if plan.containment != "negative" else (surface.down, surface.up)
    if plan.containment == "mid":
        # All planes at once: bottoms and cuts take turns, and the last top comes after them.
        planes = np.append(np.column_stack([bottom, cut]).ravel(), top[-1])
        aside = 2 * cut - bottom - top
        total = np.zeros(plan.n_layers)
        for shadow in (over, under):
            below = shadow.integral(planes)
            total += below[2::2] + below[:-1:2] - 2 * below[1::2]
            if np.abs(aside).max() > _ROUNDING:
                total += shadow.under(cut) * aside
        return np.maximum(total, 0)
    height, bottom, top = top - bottom, bottom + BESIDE, top - BESIDE
    added = over.integral(top) - over.integral(bottom) - height * over.under(bottom, including=True)
    added += height * under.under(top) - under.integral(top) + under.integral(bottom)
    return np.maximum(added, 0)


def _shadow_over(up: Shadow, top: float, height: float) -> float:
    """Volume of the part over the last layer, at most."""
    planes = np.array([top, height])
    below, everything = up.integral(planes)
    return float((height - top) * up.under(planes, including=True)[1] - (everything - below))


def _worst(surface: Surface, plan: LayerPlan, rising: Float, falling: Float, missing: float) -> WorstLayer:
    """The layer with the largest bound, and the contact that weighs most in it."""
    bound = np.maximum(rising, falling)
    layer = int(bound.argmax())
    bottom, top, cut = float(plan.bottom[layer]), float(plan.top[layer]), float(plan.cut[layer])
    if missing > bound[layer] or bound[layer] <= 0:
        x, y, _ = surface.triangles.reshape(-1, 3)[surface.triangles[:, :, 2].argmax()]
        kind = "top" if missing > 0 else "none"
        return WorstLayer(plan.n_layers - 1, surface.height, float(x), float(y), kind, max(missing, 0.0))
    whole = plan.containment != "mid"
    if rising[layer] >= falling[layer]:
        begin, end, contacts, turn = bottom if whole else cut, top, surface.contacts, 1
    else:
        begin, end, contacts, turn = -top if whole else -cut, -bottom, surface.turned, -1
    place = steepest(contacts, begin, end)
    z = turn * min(max(float(contacts.low[place]), begin), end)
    source, flat = int(contacts.source[place]), contacts.low[place] == contacts.high[place]
    x, y, z, kind = _place(surface.triangles, source, z, flat=bool(flat))
    if end > surface.height and contacts is surface.contacts and z >= surface.height - _ROUNDING:
        kind = "top"
    return WorstLayer(layer, z, x, y, kind, float(bound[layer]))


def _place(triangles: Float, source: int, z: float, *, flat: bool) -> tuple[float, float, float, str]:
    """A point at height z, or as near as there is, on the facet, edge or corner that a contact comes from."""
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
