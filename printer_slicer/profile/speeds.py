"""Speeds and accelerations of each role: those of a printer, and those of a quality."""

from __future__ import annotations

from typing import Annotated

from printer_slicer.profile.base import ANYWHERE, Settings, meta

__all__ = ["Accelerations", "PrinterAccelerations", "PrinterSpeeds", "Speeds"]


class PrinterSpeeds(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Usual speed of each role on a printer, for layers of about 0.2 mm."""

    external_perimeter: Annotated[float, meta("outer perimeters", "mm/s", gt=0, le=1000)] = 35
    perimeter: Annotated[float, meta("inner perimeters", "mm/s", gt=0, le=1000)] = 50
    internal_infill: Annotated[float, meta("sparse infill", "mm/s", gt=0, le=1000)] = 70
    solid_infill: Annotated[float, meta("solid infill, bottom layers included", "mm/s", gt=0, le=1000)] = 60
    top_solid_infill: Annotated[float, meta("top solid infill", "mm/s", gt=0, le=1000)] = 40
    gap_fill: Annotated[float, meta("gap fill; 0: as inner perimeters", "mm/s", ge=0, le=1000)] = 0
    bridge: Annotated[float, meta("bridges", "mm/s", gt=0, le=1000)] = 30
    internal_bridge: Annotated[
        float, meta("the first solid layer over sparse infill", "mm/s", gt=0, le=1000)
    ] = 40
    overhang_75: Annotated[
        float,
        meta(
            "limit for perimeters with 75 % of their width over the layer below; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    overhang_50: Annotated[float, meta("the same with 50 % of it", "mm/s", ge=0, le=1000)] = 0
    overhang_25: Annotated[float, meta("the same with 25 % of it", "mm/s", ge=0, le=1000)] = 0
    small_perimeter: Annotated[
        float,
        meta(
            "limit for perimeters up to quality.speeds.small_perimeter_radius; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    support: Annotated[float, meta("supports and rafts", "mm/s", gt=0, le=1000)] = 30
    support_interface: Annotated[
        float,
        meta("support interface and top layer of rafts; 0: as support", "mm/s", ge=0, le=1000),
    ] = 0
    travel: Annotated[float, meta("travels", "mm/s", gt=0, le=2000)] = 150
    first_layer: Annotated[float, meta("limit for perimeters on the first layer", "mm/s", gt=0, le=1000)] = 20
    first_layer_infill: Annotated[
        float, meta("limit for infill on the first layer; 0: as first_layer", "mm/s", ge=0, le=1000)
    ] = 0
    first_layer_travel: Annotated[
        float, meta("limit for travels on the first layer; 0: as travel", "mm/s", ge=0, le=2000)
    ] = 0


class PrinterAccelerations(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Usual acceleration of each role on a printer; `printer.acceleration` limits all of them."""

    default: Annotated[float, meta("all other roles; 0: printer.acceleration", "mm/s²", ge=0, le=100000)] = 0
    first_layer: Annotated[
        float, meta("everything on the first layer; 0: as on other layers", "mm/s²", ge=0, le=100000)
    ] = 0
    external_perimeter: Annotated[float, meta("outer perimeters; 0: default", "mm/s²", ge=0, le=100000)] = 0
    perimeter: Annotated[float, meta("inner perimeters; 0: default", "mm/s²", ge=0, le=100000)] = 0
    overhang: Annotated[float, meta("overhanging perimeters; 0: default", "mm/s²", ge=0, le=100000)] = 0
    bridge: Annotated[float, meta("bridges; 0: default", "mm/s²", ge=0, le=100000)] = 0
    internal_infill: Annotated[float, meta("sparse infill; 0: default", "mm/s²", ge=0, le=100000)] = 0
    solid_infill: Annotated[
        float, meta("solid infill, bottom layers included; 0: default", "mm/s²", ge=0, le=100000)
    ] = 0
    top_solid_infill: Annotated[
        float, meta("top solid infill and ironing; 0: default", "mm/s²", ge=0, le=100000)
    ] = 0


class Speeds(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Speed of each role; 0: the printer's speed times `ratio`.

    The flow limits of material and hotend may lower any of them.
    """

    ratio: Annotated[
        float,
        meta(
            "factor for the printer's speeds of perimeters, infill, gap fill and supports",
            "ratio",
            gt=0,
            le=10,
            own=ANYWHERE,
        ),
    ] = 1
    visible_most: Annotated[
        float,
        meta(
            "outer perimeters and top solid infill, upper limit of the printer's speeds; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    external_perimeter: Annotated[
        float, meta("outer perimeters; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE)
    ] = 0
    perimeter: Annotated[
        float, meta("inner perimeters; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE)
    ] = 0
    internal_infill: Annotated[
        float, meta("sparse infill; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE)
    ] = 0
    solid_infill: Annotated[
        float,
        meta("solid infill, bottom layers included; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE),
    ] = 0
    top_solid_infill: Annotated[
        float, meta("top solid infill; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE)
    ] = 0
    gap_fill: Annotated[float, meta("gap fill; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE)] = 0
    ironing: Annotated[float, meta("ironing", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 15
    bridge: Annotated[float, meta("bridges; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE)] = 0
    internal_bridge: Annotated[
        float,
        meta(
            "the first solid layer over sparse infill; 0: the printer's", "mm/s", ge=0, le=1000, own=ANYWHERE
        ),
    ] = 0
    overhang_75_ratio: Annotated[
        float,
        meta(
            "perimeters with 75 % of their bead over the layer below, of their speed",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.9
    overhang_50_ratio: Annotated[
        float,
        meta(
            "the same with 50 % of it",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.7
    overhang_25_ratio: Annotated[
        float,
        meta(
            "the same with 25 % of it",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.55
    overhang_0_ratio: Annotated[
        float,
        meta("the same over nothing but air, and no faster than bridges", "0-1", gt=0, le=1, own=ANYWHERE),
    ] = 0.45
    support: Annotated[float, meta("supports; 0: the printer's", "mm/s", ge=0, le=1000)] = 0
    support_interface: Annotated[
        float, meta("support interface and top layer of rafts; 0: the printer's", "mm/s", ge=0, le=1000)
    ] = 0
    raft: Annotated[
        float, meta("rafts; 0: as supports, the top layer as their interface", "mm/s", ge=0, le=1000)
    ] = 0
    first_layer: Annotated[
        float,
        meta(
            "limit for perimeters on the first layer, and the part's first layer on a raft; 0: the printer's",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    first_layer_infill: Annotated[
        float,
        meta(
            "limit for infill there; 0: first_layer if set, else the printer's",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    first_layer_travel: Annotated[
        float, meta("limit for travels on the first layer; 0: the printer's", "mm/s", ge=0, le=2000)
    ] = 0
    slow_below: Annotated[
        float,
        meta("from the first layer's speed up to this z speeds grow to the full ones", "mm", ge=0, le=100),
    ] = 0
    small_perimeter: Annotated[
        float,
        meta(
            "limit for perimeters up to small_perimeter_radius; 0: the printer's",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    small_perimeter_radius: Annotated[
        float,
        meta("loops no longer than a circle of this radius are small", "mm", ge=0, le=100, own=ANYWHERE),
    ] = 6.5
    even_flow_ratio: Annotated[
        float,
        meta(
            "speeds follow the layer height: 0 not at all, 1 so that every layer melts as much as one of layer_height",
            "0-1",
            ge=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0
    even_flow_most: Annotated[
        float, meta("for that, speeds change by at most this factor", "ratio", ge=1, le=10, own=ANYWHERE)
    ] = 2
    travel: Annotated[float, meta("travels; 0: the printer's", "mm/s", ge=0, le=2000)] = 0


class Accelerations(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Acceleration of each role; 0: `default`, or the printer's if that is 0 too.

    `printer.acceleration` limits all of them.
    """

    default: Annotated[
        float, meta("all other roles; 0: the printer's", "mm/s²", ge=0, le=100000, own=ANYWHERE)
    ] = 0
    first_layer: Annotated[
        float, meta("everything on the first layer; 0: the printer's", "mm/s²", ge=0, le=100000)
    ] = 0
    external_perimeter: Annotated[float, meta("outer perimeters", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    perimeter: Annotated[float, meta("inner perimeters", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    overhang: Annotated[float, meta("overhanging perimeters", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    bridge: Annotated[float, meta("bridges", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    internal_infill: Annotated[float, meta("sparse infill", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    solid_infill: Annotated[
        float,
        meta(
            "solid infill, bottom layers included",
            "mm/s²",
            ge=0,
            le=100000,
            own=ANYWHERE,
        ),
    ] = 0
    top_solid_infill: Annotated[
        float, meta("top solid infill and ironing", "mm/s²", ge=0, le=100000, own=ANYWHERE)
    ] = 0
