"""Layer plans, sections of the part, and regions of sections by role."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.deprecation import accept_former_fields
from printer_slicer.errors import PlanError
from printer_slicer.geometry import Areas
from printer_slicer.model.part import Mesh
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.values import Struct, field, force_setattr, replace

__all__ = [
    "SAME_TOP",
    "ContourDeviations",
    "ContourRule",
    "Contours",
    "Gap",
    "LayerPlan",
    "ObjectStack",
    "Regions",
    "Sections",
]

SAME_TOP: Final = 1e-7
"""Layers of different objects have the same top if their tops differ by less than this, mm."""
_MAX_RISE: Final = 1.2  # layer heights by which a contoured surface may rise over the width of an extrusion
_STEEPEST_BY_RULE: Final = float(np.tan(np.deg2rad(35.0)))


class ContourRule(Struct, frozen=True):
    """Where extrusions follow shallow upper surfaces in z within a layer, so that their tops are not level.

    An extrusion is level across its width w, so on a slope it differs from the surface by up to (w / 2) tan(slope),
    whatever the height of the layer is. So contouring pays only where this is less than the steps of level layers.

    Attributes:
        min_height: minimum height of an extrusion, mm.
        width: of extrusions, mm.
        max_slope: tangent of the steepest slope that is followed; 0: where w tan(slope) is at most 1.2 layer heights,
            but at most 35 degrees.
        tolerance: largest difference of the z of the nozzle from the surface at the centre line, mm.
        nozzle_flat: diameter of the flat underside of the nozzle, mm.
        level_tops: tops of layers that stay level, mm.
        level_places: tops of layers that stay level around a place, and x and y of the place, mm.
        slope_limit: tangent of the slope above which nothing is followed in any layer, because the deviation could
            exceed the tolerance of the plan.
    """

    min_height: float
    width: float
    max_slope: float
    tolerance: float
    nozzle_flat: float
    level_tops: tuple[float, ...] = ()
    level_places: tuple[tuple[float, float, float], ...] = ()
    slope_limit: float = np.inf

    @property
    def steepest(self) -> float:
        """Tangent of the steepest slope that is followed in layers of any height."""
        return min(self.max_slope or _STEEPEST_BY_RULE, self.slope_limit)

    def bound_deviations(self, slope: Float) -> Float:
        """Return how far the tops of extrusions may be from surfaces of these slopes (n,), as tangents, mm."""
        across = self.width / 2 * slope / np.sqrt(1 + slope**2)
        return np.asarray(np.maximum(across, self.min_height / 2) + self.tolerance)

    def find_contoured(self, top: Float) -> Bool:
        """Return which layers with tops (n,), mm, may be contoured."""
        return ~_are_among(top, self.level_tops)

    def find_partly_level(self, top: Float) -> Bool:
        """Return which layers with tops (n,), mm, stay level around some places."""
        return _are_among(top, [place[0] for place in self.level_places])

    def are_beside_level_places(self, xy: Float, top: Float, reach: float) -> Bool:
        """Return which points are at most `reach` mm in x and y from a level place of their layer.

        Args:
            xy: (n, 2) mm.
            top: (n,) mm, of the layer of each point.
            reach: mm.
        """
        result = np.zeros(len(top), np.bool_)
        some = np.flatnonzero(self.find_partly_level(top))
        for level, *place in self.level_places if len(some) else ():
            here = some[np.abs(top[some] - level) < SAME_TOP]
            result[here] |= (np.abs(xy[here] - place) <= reach).all(axis=1)
        return result

    def find_max_slopes(self, height: Float) -> Float:
        """Return the tangent (n,) of the steepest slope that is followed in layers of heights (n,), mm."""
        if self.max_slope:
            return np.full(len(height), self.steepest)
        return np.minimum(_MAX_RISE * height / self.width, self.steepest)


def _are_among(tops: Float, others: Sequence[float] | Float) -> Bool:
    """Return which tops (n,) of layers, mm, are the same as one of the others."""
    known = np.sort(np.asarray(others, np.float64))
    first, end = (np.searchsorted(known, tops + side * SAME_TOP) for side in (-1, 1))
    return np.asarray(first < end)


class LayerPlan(SvgRepr, Struct, frozen=True, eq=False):
    """The stack of layers: their tops, and the heights at which the mesh is cut.

    Attributes:
        top: (L,) z of the top of each layer, mm, strictly increasing; the nozzle prints at this height. In a
            program that prints objects one after the other, tops increase within each object.
        cut: (L,) z at which the mesh is cut for each layer, mm, within the layer.
        planner: name of the planner that made the plan.
        containment: "mid": a layer has the section at `cut`; "positive": the union of all sections between bottom and
            top; "negative": their intersection.
        base: (L,) z of the bottom of each layer, mm, if it differs from the top of the layer before. That happens in
            the union of the plans of several objects. Otherwise empty.
        contour_rule: where extrusions follow shallow upper surfaces; None: all tops are level.
    """

    top: Float
    cut: Float
    planner: str = ""
    containment: str = "mid"
    base: Float = field(default_factory=lambda: np.zeros(0))
    contour_rule: ContourRule | None = None

    def __post_init__(self) -> None:
        force_setattr(self, "top", frozen_array(self.top, np.float64, (-1,)))
        force_setattr(self, "cut", frozen_array(self.cut, np.float64, (len(self.top),)))
        force_setattr(self, "base", frozen_array(self.base, np.float64, (len(self.base) and len(self.top),)))

    def __repr__(self) -> str:
        if not self.n_layers:
            return "<LayerPlan: no layers>"
        low, high = float(self.height.min()), float(self.height.max())
        heights = f"of {low:.4g} mm" if low == high else f"of {low:.4g} to {high:.4g} mm"
        return f"<LayerPlan {self.planner}: {self.n_layers} layers {heights}, top {self.top[-1]:.6g} mm>"

    @classmethod
    def from_tops(cls, top: Float, planner: str = "", *, cut_ratio: float = 0.5) -> LayerPlan:
        """Build a plan from the tops of its layers.

        Args:
            top: (L,) z of the tops, mm, strictly increasing from above 0.
            planner: name of the planner.
            cut_ratio: height of the cut within each layer: 0 bottom, 0.5 middle, 1 top.

        Raises:
            PlanError: `top` is not a list of numbers.
        """
        top = _convert_tops(top)
        bottom = np.concatenate([[0.0], top[:-1]])
        return cls(top, bottom + cut_ratio * (top - bottom), planner)

    @classmethod
    def union(cls, plans: Sequence[LayerPlan]) -> LayerPlan:
        """Combine the plans of several objects: a layer wherever one of them has a top.

        If several layers have the same top, the lowest bottom is used. The union of equal plans is the plan itself.
        """
        first = plans[0]
        if all(np.array_equal(plan.top, first.top) for plan in plans):
            return first
        top, bottom, cut = (
            np.concatenate([getattr(plan, name) for plan in plans]) for name in ("top", "bottom", "cut")
        )
        order = np.lexsort((bottom, top))
        begins = np.flatnonzero(np.diff(top[order], prepend=-np.inf) > SAME_TOP)
        chosen = order[begins]
        rest = first.planner, first.containment
        return cls(top[chosen], cut[chosen], *rest, bottom[chosen], first.contour_rule)

    @property
    def n_layers(self) -> int:
        """Number of layers."""
        return len(self.top)

    @property
    def bottom(self) -> Float:
        """Height z of the bottom of each layer (L,), mm."""
        return np.array(self.base) if len(self.base) else np.concatenate([[0.0], self.top[:-1]])

    @property
    def highest(self) -> float:
        """Highest top of all layers, mm."""
        return float(self.top.max())

    @property
    def stack_starts(self) -> Int:
        """Indices of the first layers of all stacks: layer 0, and each layer with a lower top than the one before.

        There are several stacks if objects are printed one after the other.
        """
        return np.flatnonzero(np.append(True, np.diff(self.top) < 0))

    @property
    def has_overlaps(self) -> bool:
        """Whether any layer begins below the top of the layer before, as layers of different objects do."""
        return bool((self.bottom[1:] < self.top[:-1] - SAME_TOP).any())

    def take(self, layers: Int) -> LayerPlan:
        """Return the layers with these indices (n,), ascending, with their bottoms."""
        base = np.asarray(self.bottom[layers])
        return replace(self, top=self.top[layers], cut=self.cut[layers], base=base)

    def find_tops(self, tops: Float) -> Int:
        """Return the indices of the layers with these tops (n,), mm."""
        return np.searchsorted(self.top, tops - SAME_TOP)

    def has_tops(self, tops: Float) -> Bool:
        """Return which of some tops (n,), mm, are those of layers."""
        return _are_among(tops, self.top)

    @property
    def height(self) -> Float:
        """Layer heights (L,), mm."""
        # Rounded to 0.1 nm, because rounding errors in differences of tops would make equal heights unequal.
        return np.round(self.top - self.bottom, 7)

    def runs(self) -> list[tuple[int, float]]:
        """Return the runs of consecutive layers with equal height: [(number of layers, height in mm), ...]."""
        heights = np.round(self.height, 6)
        starts = np.flatnonzero(np.diff(heights, prepend=np.nan) != 0)
        counts = np.diff(np.append(starts, len(heights)))
        return [(int(n), float(heights[i])) for n, i in zip(counts, starts, strict=True)]


class ContourDeviations(Struct, frozen=True, eq=False):
    """How far the tops of printed extrusions are from the surfaces that contoured extrusions follow.

    Attributes:
        top: (L,) z of the tops of all printed layers, mm.
        deviation: (L,) largest deviation in each of them, mm; 0 where nothing is contoured.
        place: (L, 3) mm, where it is.
        larger: (K, 4) all places where it is larger than the rule promises: top of the layer, x, y and deviation, mm.
    """

    top: Float
    deviation: Float
    place: Float
    larger: Float

    def select_layers(self, tops: Float) -> ContourDeviations:
        """Return those of the layers with these tops (n,), mm."""
        layers = np.searchsorted(self.top, tops - SAME_TOP)
        known = _are_among(self.larger[:, 0], tops)
        return ContourDeviations(tops, self.deviation[layers], self.place[layers], self.larger[known])

    @classmethod
    def find_worst(cls, made: Sequence[ContourDeviations | None]) -> ContourDeviations | None:
        """Return the largest deviation of each layer of objects with the same layers; None if nothing is known."""
        known = [one for one in made if one is not None]
        if not known:
            return None
        worst = np.argmax([one.deviation for one in known], axis=0)
        layer = np.arange(len(worst))
        deviation, place = (
            np.array([getattr(one, name) for one in known]) for name in ("deviation", "place")
        )
        larger = np.concatenate([one.larger for one in known])
        return cls(known[0].top, deviation[worst, layer], place[worst, layer], larger)


class ObjectStack(Struct, frozen=True, eq=False):
    """The layers of some objects of a plate, or of a feature. There is one stack if all objects have the same layers.

    Attributes:
        plan: the layers.
        mesh: the objects together, placed on the bed; the whole part if there is only one stack. With features, the
            surface between the bottom of the first and the top of the last layer, open at both.
        objects: indices of the objects in `Mesh.objects` of the part; (0,) for a part without a list of objects.
        whole_plan: with features, layers from the bed to the top of the part that contain those of `plan`, so that the
            neighbours of each layer are known; otherwise None.
        outline: an area that contains this feature and no other one, as seen from above, in one layer; None if the
            stack is not that of a feature.
        contours: how far the printed extrusions are from the surfaces that they follow, with the layers of `plan`; None
            before they are made, or without contoured tops.
    """

    plan: LayerPlan
    mesh: Mesh
    objects: tuple[int, ...]
    whole_plan: LayerPlan | None = None
    outline: Areas | None = None
    contours: ContourDeviations | None = None


def _convert_tops(top: object) -> Float:
    """Convert tops of layers to an array (L,)."""
    try:
        found: Float = np.asarray(top, np.float64)
    except (TypeError, ValueError):
        found = np.zeros((0, 0))
    if found.ndim != 1:
        raise PlanError(
            "tops of layers must be a list of numbers, mm, strictly increasing from above 0",
            remedy="Pass an array such as np.arange(1, 51) * 0.2",
        )
    return found


class Contours(Struct, frozen=True, eq=False):
    """The contours of all layers: the separate segments, and the contours joined from them.

    Attributes:
        segments: (S, 2, 2) mm, the raw contour: one segment per facet and plane, in the order of the facets, with the
            solid on the left.
        segment_layer: (S,) layer of each segment.
        joined: the segments joined into closed rings, with all points.
        repaired: `joined` without repeated and collinear points.
    """

    segments: Float
    segment_layer: Int
    joined: Areas
    repaired: Areas

    def __post_init__(self) -> None:
        force_setattr(self, "segments", frozen_array(self.segments, np.float64, (-1, 2, 2)))
        n_segments = len(self.segments)
        force_setattr(self, "segment_layer", frozen_array(self.segment_layer, np.int64, (n_segments,)))


class Gap(Struct, frozen=True):
    """A gap of `width` mm in the contour of a layer, where the mesh is open; the gap was closed."""

    layer: int
    x: float
    y: float
    z: float
    width: float

    @property
    def area(self) -> float:
        """Possible error of the section area, mm²: a half disc whose diameter is the gap."""
        return float(np.pi / 8 * self.width**2)


@accept_former_fields(turned="inverted")
class Sections(SvgRepr, Struct, frozen=True, eq=False):
    """The solid area of the part in each layer, simplified within the resolution of the profile.

    Attributes:
        plan: the layers.
        solid: areas without overlaps.
        open_edges: number of edges at the cut planes without a neighbour, or with a neighbour of opposite orientation.
        gaps: gaps in contours that were closed, widest first.
        inverted: areas inside contours of reversed orientation, as in a self-intersecting shell or a void that extends
            beyond the solid. They are not part of `solid`; their rings are clockwise. None if there are none.
        below_cut: areas, most of them within `solid`, where the surface lies within the layer but below its cut, and
            extrusions follow it. None if there are none.
    """

    plan: LayerPlan
    solid: Areas
    open_edges: int = 0
    gaps: tuple[Gap, ...] = ()
    inverted: Areas | None = None
    below_cut: Areas | None = None

    def solid_at(self, plan: LayerPlan) -> Areas:
        """Return the solid area on the layers of another plan; layers are matched by their tops."""
        if plan is self.plan:
            return self.solid
        layer = self.plan.find_tops(plan.top)
        exists = layer < self.plan.n_layers
        exists[exists] &= plan.top[exists] > self.plan.bottom[layer[exists]] + SAME_TOP
        within = np.flatnonzero(exists)
        return self.solid.copy_layers(layer[within]).on_layers(within, plan.n_layers)

    def __repr__(self) -> str:
        volume = float(self.solid.area() @ self.plan.height)
        return f"<Sections: {self.plan.n_layers} layers, {self.solid.n_rings} contours, {volume:.6g} mm3>"


_REGIONS: Final = (
    "bottom_solid_infill",
    "bridge",
    "top_solid_infill",
    "solid_infill",
    "internal_infill",
    "internal_bridge",
    "inside",
)


_ANGLES: Final = {
    "bridge_angle": "bridge",
    "internal_bridge_angle": "internal_bridge",
    "top_angle": "top_solid_infill",
}


@accept_former_fields(
    bottom_skin="bottom_solid_infill",
    top_skin="top_solid_infill",
    solid="solid_infill",
    sparse="internal_infill",
)
class Regions(SvgRepr, Struct, frozen=True, eq=False):
    """The area inside the perimeters, divided by role; regions of a layer do not overlap.

    Attributes:
        plan: the layers.
        bottom_solid_infill: area that lies on the bed.
        bridge: area with nothing below it, and the anchors on its sides.
        top_solid_infill: area with nothing above it.
        solid_infill: area closer to a surface than the shell thickness, but not exposed.
        internal_infill: area to be filled with the infill pattern.
        bridge_angle: (R,) radians for each ring of `bridge`, the same for all rings of a connected area: the direction
            in which most of its lines are supported at both ends.
        internal_bridge: solid area over the internal infill of the layer below, and the anchors on its sides.
        inside: the union of all regions.
        internal_bridge_angle: (R,) radians for each ring of `internal_bridge`; 0 until it is computed from the lines
            of the internal infill.
        top_angle: (R,) radians for each ring of `top_solid_infill`, the same for all rings of a connected area: the
            direction of its lines; nan where it is the usual one.
    """

    plan: LayerPlan
    bottom_solid_infill: Areas
    bridge: Areas
    top_solid_infill: Areas
    solid_infill: Areas
    internal_infill: Areas
    bridge_angle: Float
    internal_bridge: Areas = field(default_factory=lambda: Areas.empty(0))
    inside: Areas = field(default_factory=lambda: Areas.empty(0))
    internal_bridge_angle: Float = field(default_factory=lambda: np.zeros(0))
    top_angle: Float = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        angle = frozen_array(self.bridge_angle, np.float64, (self.bridge.n_rings,))
        force_setattr(self, "bridge_angle", angle)
        for name in ("internal_bridge", "inside"):
            if getattr(self, name).n_layers == 0:  # not given
                force_setattr(self, name, Areas.empty(self.plan.n_layers))
        n_rings = self.internal_bridge.n_rings
        given = self.internal_bridge_angle if len(self.internal_bridge_angle) else np.zeros(n_rings)
        force_setattr(self, "internal_bridge_angle", frozen_array(given, np.float64, (n_rings,)))
        n_rings = self.top_solid_infill.n_rings
        given = self.top_angle if len(self.top_angle) else np.full(n_rings, np.nan)
        force_setattr(self, "top_angle", frozen_array(given, np.float64, (n_rings,)))

    def __repr__(self) -> str:
        names = (
            "bottom_solid_infill",
            "bridge",
            "internal_bridge",
            "top_solid_infill",
            "solid_infill",
            "internal_infill",
        )
        volumes = {name: float(getattr(self, name).area() @ self.plan.height) for name in names}
        text = ", ".join(f"{name} {volume:.4g}" for name, volume in volumes.items() if volume)
        return f"<Regions: {self.plan.n_layers} layers, mm3: {text or 'nothing'}>"

    def on_plan(self, plan: LayerPlan) -> Regions:
        """Return the regions on the layers of another plan; layers are matched by their tops."""
        if plan is self.plan:
            return self
        layer = plan.find_tops(self.plan.top)
        areas = {name: getattr(self, name).on_layers(layer, plan.n_layers) for name in _REGIONS}
        return replace(self, plan=plan, **areas)

    def take(self, layers: Int) -> Regions:
        """Return the regions of the layers with these indices (n,), ascending."""
        here = np.isin(np.arange(self.plan.n_layers), layers)
        return Regions(
            self.plan.take(layers),
            **{name: getattr(self, name).copy_layers(layers) for name in _REGIONS},
            bridge_angle=self.bridge_angle[here[self.bridge.ring_layer]],
            internal_bridge_angle=self.internal_bridge_angle[here[self.internal_bridge.ring_layer]],
            top_angle=self.top_angle[here[self.top_solid_infill.ring_layer]],
        )

    def of_layers(self, here: Bool) -> Regions:
        """Keep the regions of the layers for which `here` (L,) is true; all other layers become empty."""
        return Regions(
            self.plan,
            **{name: getattr(self, name).of_layers(here) for name in _REGIONS},
            bridge_angle=self.bridge_angle[here[self.bridge.ring_layer]],
            internal_bridge_angle=self.internal_bridge_angle[here[self.internal_bridge.ring_layer]],
            top_angle=self.top_angle[here[self.top_solid_infill.ring_layer]],
        )

    @classmethod
    def joined(cls, parts: Sequence[Regions]) -> Regions:
        """Combine the regions of several objects."""
        plan = LayerPlan.union([part.plan for part in parts])
        parts = [part.on_plan(plan) for part in parts]
        first = parts[0]
        if len(parts) == 1:
            return first
        angles = {
            of: np.concatenate([getattr(part, of) for part in parts])[
                np.argsort(np.concatenate([getattr(part, name).ring_layer for part in parts]), kind="stable")
            ]
            for of, name in _ANGLES.items()
        }
        return cls(
            first.plan,
            **{name: Areas.merged([getattr(part, name) for part in parts]) for name in _REGIONS},
            bridge_angle=angles["bridge_angle"],
            internal_bridge_angle=angles["internal_bridge_angle"],
            top_angle=angles["top_angle"],
        )
