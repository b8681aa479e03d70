"""Plan the layers of supports: their tops lie where overhangs need them, and few layers are between them.

The layers are the shortest path through the heights at which a support layer may end: multiples of a z step, and the
height at which the support of each overhang should end. Overhangs in one plane get exactly the gap of the settings.
Below slopes the gap may be larger by the slack, so that supports need fewer layers than the part.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, distinct
from printer_slicer.geometry import split_connected
from printer_slicer.model import LayerPlan, Overhangs, SupportPlan, UnsupportedPlace
from printer_slicer.profile import Profile
from printer_slicer.shortest_path import ArcGraph, cheapest_path
from printer_slicer.values import Struct, force_setattr

__all__ = ["find_height_limits", "list_places_without_room", "plan_shared_layers", "plan_support_layers"]

_UNIT: Final = 0.02  # mm between heights at which a layer may end, if the z step is finer
_DEFAULT_RATIO: Final = 0.75  # nozzle diameters, the largest layer height if the settings have none
_MIN_GAP: Final = 0.5  # of the gap, where the first layer is the only one that fits under an overhang
_ROUNDING: Final = 1e-6  # mm
_EVENNESS: Final = (
    0.1  # cost of a layer of the largest height; quadratic in height, so that equal layers are cheaper
)
_EXCESS_PRICE: Final = 0.05  # layers worth adding to avoid 1 mm³ of additional gap
_MISSED: Final = 1e4  # layers worth adding for an overhang that would get more gap than its slack
_MISSED_AREA: Final = 1e2  # the same for each mm² of it
_NO_ROOM: Final = "no support layer fits between the bed and this place"


class _Contacts(Struct, frozen=True, eq=False):
    """What supports must reach in each layer of the part, by ascending height.

    Attributes:
        layer: (C,) layer of the part.
        wanted: (C,) height at which the support should end, mm.
        slack: (C,) amount by which it may end lower, mm.
        area: (C,) mm².
    """

    layer: Int
    wanted: Float
    slack: Float
    area: Float

    def __post_init__(self) -> None:
        order = np.argsort(self.wanted, kind="stable")
        for name in ("layer", "wanted", "slack", "area"):
            force_setattr(self, name, getattr(self, name)[order])

    @classmethod
    def joined(cls, parts: Sequence[_Contacts]) -> _Contacts:
        """Return the contacts of several objects."""
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__struct_fields__)
        )


def plan_support_layers(overhangs: Overhangs, profile: Profile) -> SupportPlan:
    """Plan the layers of supports for overhangs with the same settings, see `plan_shared_layers`."""
    return plan_shared_layers([(overhangs, profile)])[0]


def plan_shared_layers(
    demands: Sequence[tuple[Overhangs, Profile]], start_heights: Float | None = None
) -> list[SupportPlan]:
    """Plan the layers of supports, from the bed to the highest overhang, which all objects share.

    The first layer is as high as that of the part. An overhang so low that no second layer fits is carried by the first
    one, with more gap than wanted, or with as little as half of it. Below that, it has no carrier. If no overhang has
    one, only the first layer is planned.

    Args:
        demands: overhangs, with the profile that has its gaps. The plan of each has the layers of its object. Layer
            heights, and the limits of the printer, are those of the first profile.
        start_heights: (n,) where supports begin above faces of the part, mm. A layer begins there if possible.

    Returns:
        A plan for each of `demands`, all with the same support layers.
    """
    contacts = [_find_contacts(*demand) for demand in demands]
    together = _Contacts.joined(contacts)
    top = np.zeros(0)
    if len(together.layer):
        part = LayerPlan.union([overhangs.plan for overhangs, _ in demands])
        if start_heights is not None:
            together = _add_start_heights(together, start_heights)
        top = _choose_tops(together, part, float(part.top[0]), demands[0][1])
    found = [
        _find_carriers(own, overhangs.plan, top, profile.quality.support_gap)
        for own, (overhangs, profile) in zip(contacts, demands, strict=True)
    ]
    highest = max((int(carrier.max(initial=-1)) for carrier in found), default=-1)
    layers = LayerPlan.from_tops(top[: max(highest, 0) + 1], "supports")
    return [_make_plan(layers, carrier, *demand) for carrier, demand in zip(found, demands, strict=True)]


def _find_carriers(contacts: _Contacts, part: LayerPlan, top: Float, gap: float) -> Int:
    """Return for each layer of the part (L,) the support layer, by its top (S,), that carries it; -1: none."""
    carrier = np.full(part.n_layers, -1)
    if len(top):
        found = np.searchsorted(top, contacts.wanted + _ROUNDING) - 1
        room = part.bottom[contacts.layer] - top[0]
        found[(found < 0) & (room >= _MIN_GAP * gap - _ROUNDING)] = 0
        carrier[contacts.layer] = found
    return carrier


def _make_plan(layers: LayerPlan, carrier: Int, overhangs: Overhangs, profile: Profile) -> SupportPlan:
    """Return the plan for one of several demands."""
    gaps, some = np.full(len(carrier), np.nan), np.flatnonzero(carrier >= 0)
    gaps[some] = overhangs.plan.bottom[some] - layers.top[carrier[some]]
    flat = gaps[(carrier >= 0) & overhangs.is_flat]
    return SupportPlan(
        layers, carrier, gaps, float(np.abs(flat - profile.quality.support_gap).max(initial=0.0))
    )


def list_places_without_room(overhangs: Overhangs, plan: SupportPlan) -> tuple[UnsupportedPlace, ...]:
    """List the overhangs so low that no support layer fits below them."""
    hanging = overhangs.area.of_layers(plan.carrier < 0)
    pieces, islands = split_connected(hanging), overhangs.islands.used
    area, (low, high) = pieces.areas.area(), pieces.areas.boxes()
    bottom = overhangs.plan.bottom
    middle = ((low + high) / 2).tolist()
    return tuple(
        UnsupportedPlace(x, y, float(bottom[layer]), size, _NO_ROOM, is_island=bool(islands[layer]))
        for (x, y), size, layer in zip(middle, area.tolist(), pieces.layer.tolist(), strict=True)
    )


def _find_contacts(overhangs: Overhangs, profile: Profile) -> _Contacts:
    """Return what supports must reach."""
    quality, area = profile.quality, overhangs.area.area()
    layer = np.flatnonzero(overhangs.area.used)
    wanted = overhangs.plan.bottom[layer] - quality.support_gap
    slack = np.where(overhangs.is_flat[layer], 0.0, quality.support_gap_slack)
    return _Contacts(layer, np.round(wanted, 7), slack, area[layer])


def _add_start_heights(contacts: _Contacts, heights: Float) -> _Contacts:
    """Return contacts and the heights at which supports begin; to miss one costs less than to miss any overhang."""
    heights = distinct(np.round(heights[heights < contacts.wanted[-1] - _ROUNDING], 7))
    nothing = np.zeros(len(heights))
    return _Contacts.joined([contacts, _Contacts(np.full(len(heights), -1), heights, nothing, nothing)])


def _choose_tops(contacts: _Contacts, part: LayerPlan, first: float, profile: Profile) -> Float:
    """Return the tops (S,) of the support layers, mm."""
    low, high = find_height_limits(profile)
    above = contacts.wanted[contacts.wanted >= first + low - _ROUNDING]
    if not len(above):
        return np.array([first])
    if profile.quality.support_synchronize_layers:
        nodes = part.top[(part.top > first + _ROUNDING) & (part.top <= above[-1] + _ROUNDING)]
    else:
        unit = _choose_unit(profile)
        lattice = first + unit * np.arange(1, np.ceil((above[-1] - first) / unit))
        nodes = distinct(np.round(np.concatenate([lattice, above]), 6))
        nodes = nodes[np.append(np.diff(nodes) > 2 * _ROUNDING, True)]
        # Rounded heights make equal nodes equal; those of contacts must stay exact.
        place = np.searchsorted(nodes, above - 2 * _ROUNDING)
        nodes[place] = above
    nodes = np.concatenate([[0.0, first], nodes])
    # Some heights are not sums of layers, such as a little more than the highest layer; the next lower one is used.
    for n in range(len(nodes), 2, -1):
        graph = _list_arcs(nodes[:n], low, high)
        arcs = cheapest_path(graph, _compute_arc_costs(graph, nodes[:n], contacts, first, high))
        if arcs is not None:
            return np.asarray(nodes[graph.end[arcs]])
    return np.array([first])


def find_height_limits(profile: Profile) -> tuple[float, float]:
    """Return the smallest and the largest layer height of supports above the first layer, mm."""
    printer = profile.printer
    wanted = profile.quality.support_layer_max or _DEFAULT_RATIO * printer.nozzle_diameter
    high = min(wanted, printer.max_layer, profile.highest_bead)
    return printer.min_layer, max(high, printer.min_layer)


def _choose_unit(profile: Profile) -> float:
    """Return the distance between heights at which layers may end, mm: a multiple of the printer's steps."""
    step = profile.printer.z_full_step or profile.printer.z_step
    return float(step * max(round(_UNIT / step), 1))


def _list_arcs(nodes: Float, low: float, high: float) -> ArcGraph:
    """Return the layers between nodes (n,), mm, of which the lowest is the bed and the next the first layer's top."""
    # Layers of the part may be thicker than those of supports, which must have one of them if they have no others.
    previous = np.arange(len(nodes)) - 1
    begin = np.clip(np.searchsorted(nodes, nodes - high - _ROUNDING), 1, np.maximum(previous, 1))
    count = np.maximum(np.searchsorted(nodes, nodes - low + _ROUNDING, side="right") - begin, 0)
    begin[:2], count[:2] = 0, (0, 1)
    return ArcGraph(np.append(0, np.cumsum(count)), consecutive(begin, count))


def _compute_arc_costs(
    graph: ArcGraph, nodes: Float, contacts: _Contacts, first: float, high: float
) -> Float:
    """Return the cost (A,) of layers, in layers: their number, their evenness, and gaps that are larger than wanted."""
    bottom, top = nodes[graph.start], nodes[graph.end]
    cost = 1.0 + _EVENNESS * ((top - bottom) / high) ** 2
    served = contacts.wanted >= first - _ROUNDING
    for slack in distinct(contacts.slack[served]):
        own = np.flatnonzero(served & (contacts.slack == slack))
        wanted, area = contacts.wanted[own], contacts.area[own]
        # Overhangs that want a height from the bottom of a layer up to its top are carried by its bottom.
        begin, late, end = (
            np.searchsorted(wanted, z)
            for z in (bottom - _ROUNDING, bottom + slack + _ROUNDING, top - _ROUNDING)
        )
        late = np.minimum(late, end)
        areas, moments = (np.append(0.0, np.cumsum(values)) for values in (area, area * wanted))
        excess = moments[end] - moments[begin] - bottom * (areas[end] - areas[begin])
        cost += _EXCESS_PRICE * excess + _MISSED * (end - late) + _MISSED_AREA * (areas[end] - areas[late])
    return np.asarray(cost)
