"""Speeds and accelerations by role, of printers and of qualities."""

# Annotations are not postponed: msgspec needs their values, and evaluates texts one by one.
from typing import Annotated

from printer_slicer.profile.base import ANYWHERE, Settings, make_meta

__all__ = ["Accelerations", "PrinterAccelerations", "PrinterSpeeds", "Speeds"]


class PrinterSpeeds(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Default speeds of a printer by role, for layers of about 0.2 mm."""

    external_perimeter: Annotated[float, make_meta("speed of external perimeters", "mm/s", gt=0, le=1000)] = (
        35
    )
    perimeter: Annotated[
        float, make_meta("speed of perimeters, except external ones", "mm/s", gt=0, le=1000)
    ] = 50
    internal_infill: Annotated[float, make_meta("speed of internal infill", "mm/s", gt=0, le=1000)] = 70
    solid_infill: Annotated[
        float, make_meta("speed of solid infill, including bottom layers", "mm/s", gt=0, le=1000)
    ] = 60
    top_solid_infill: Annotated[float, make_meta("speed of top solid infill", "mm/s", gt=0, le=1000)] = 40
    gap_fill: Annotated[
        float, make_meta("speed of gap fill; 0: the speed of perimeters", "mm/s", ge=0, le=1000)
    ] = 0
    bridge: Annotated[float, make_meta("speed of bridges", "mm/s", gt=0, le=1000)] = 30
    internal_bridge: Annotated[
        float, make_meta("speed of the first solid layer above internal infill", "mm/s", gt=0, le=1000)
    ] = 40
    overhang_75: Annotated[
        float,
        make_meta(
            "speed limit for perimeters with 75 % of their width supported; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    overhang_50: Annotated[
        float,
        make_meta(
            "speed limit for perimeters with 50 % of their width supported; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    overhang_25: Annotated[
        float,
        make_meta(
            "speed limit for perimeters with 25 % of their width supported; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    small_perimeter: Annotated[
        float,
        make_meta(
            "speed limit for small perimeters (see quality.speeds.small_perimeter_radius); 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    support: Annotated[float, make_meta("speed of support material and rafts", "mm/s", gt=0, le=1000)] = 30
    support_interface: Annotated[
        float,
        make_meta(
            "speed of support interfaces and of the top layer of rafts; 0: the speed of support",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    travel: Annotated[float, make_meta("speed of travel moves", "mm/s", gt=0, le=2000)] = 150
    first_layer: Annotated[
        float, make_meta("speed limit for perimeters on the first layer", "mm/s", gt=0, le=1000)
    ] = 20
    first_layer_infill: Annotated[
        float,
        make_meta(
            "speed limit for infill on the first layer; 0: the same as first_layer", "mm/s", ge=0, le=1000
        ),
    ] = 0
    first_layer_travel: Annotated[
        float,
        make_meta(
            "speed limit for travel moves on the first layer; 0: the same as travel", "mm/s", ge=0, le=2000
        ),
    ] = 0


class PrinterAccelerations(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Default accelerations of a printer by role; `printer.acceleration` limits all of them."""

    default: Annotated[
        float,
        make_meta(
            "acceleration of roles whose own value is 0; 0: printer.acceleration",
            "mm/s²",
            ge=0,
            le=100000,
        ),
    ] = 0
    first_layer: Annotated[
        float,
        make_meta(
            "acceleration of extrusions on the first layer; 0: the same as on other layers",
            "mm/s²",
            ge=0,
            le=100000,
        ),
    ] = 0
    external_perimeter: Annotated[
        float, make_meta("acceleration of external perimeters; 0: default", "mm/s²", ge=0, le=100000)
    ] = 0
    perimeter: Annotated[
        float,
        make_meta("acceleration of perimeters, except external ones; 0: default", "mm/s²", ge=0, le=100000),
    ] = 0
    overhang: Annotated[
        float, make_meta("acceleration of overhang perimeters; 0: default", "mm/s²", ge=0, le=100000)
    ] = 0
    bridge: Annotated[float, make_meta("acceleration of bridges; 0: default", "mm/s²", ge=0, le=100000)] = 0
    internal_infill: Annotated[
        float, make_meta("acceleration of internal infill; 0: default", "mm/s²", ge=0, le=100000)
    ] = 0
    solid_infill: Annotated[
        float,
        make_meta(
            "acceleration of solid infill, including bottom layers; 0: default", "mm/s²", ge=0, le=100000
        ),
    ] = 0
    top_solid_infill: Annotated[
        float, make_meta("acceleration of top solid infill and ironing; 0: default", "mm/s²", ge=0, le=100000)
    ] = 0


class Speeds(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Speeds of a quality by role; 0: the printer's speed times `ratio`.

    The maximum flow of material and hotend may lower all of them.
    """

    ratio: Annotated[
        float,
        make_meta(
            "multiplier for the printer's speeds of perimeters, infill, gap fill and supports",
            "ratio",
            gt=0,
            le=10,
            own=ANYWHERE,
        ),
    ] = 1
    visible_most: Annotated[
        float,
        make_meta(
            "upper limit for the printer's speeds of external perimeters and top solid infill; 0: no limit",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    external_perimeter: Annotated[
        float,
        make_meta(
            "speed of external perimeters; 0: as in the printer profile", "mm/s", ge=0, le=1000, own=ANYWHERE
        ),
    ] = 0
    perimeter: Annotated[
        float,
        make_meta(
            "speed of perimeters, except external ones; 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    internal_infill: Annotated[
        float,
        make_meta(
            "speed of internal infill; 0: as in the printer profile", "mm/s", ge=0, le=1000, own=ANYWHERE
        ),
    ] = 0
    solid_infill: Annotated[
        float,
        make_meta(
            "speed of solid infill, including bottom layers; 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    top_solid_infill: Annotated[
        float,
        make_meta(
            "speed of top solid infill; 0: as in the printer profile", "mm/s", ge=0, le=1000, own=ANYWHERE
        ),
    ] = 0
    gap_fill: Annotated[
        float,
        make_meta("speed of gap fill; 0: as in the printer profile", "mm/s", ge=0, le=1000, own=ANYWHERE),
    ] = 0
    ironing: Annotated[float, make_meta("speed of ironing", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 15
    bridge: Annotated[
        float,
        make_meta("speed of bridges; 0: as in the printer profile", "mm/s", ge=0, le=1000, own=ANYWHERE),
    ] = 0
    internal_bridge: Annotated[
        float,
        make_meta(
            "speed of the first solid layer above internal infill; 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    overhang_75_ratio: Annotated[
        float,
        make_meta(
            "speed of perimeters with 75 % of their width supported, as a fraction of their normal speed",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.9
    overhang_50_ratio: Annotated[
        float,
        make_meta(
            "speed of perimeters with 50 % of their width supported, as a fraction of their normal speed",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.7
    overhang_25_ratio: Annotated[
        float,
        make_meta(
            "speed of perimeters with 25 % of their width supported, as a fraction of their normal speed",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.55
    overhang_0_ratio: Annotated[
        float,
        make_meta(
            "speed of unsupported perimeters, as a fraction of their normal speed; never faster than bridges",
            "0-1",
            gt=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.45
    support: Annotated[
        float, make_meta("speed of support material; 0: as in the printer profile", "mm/s", ge=0, le=1000)
    ] = 0
    support_interface: Annotated[
        float,
        make_meta(
            "speed of support interfaces and of the top layer of rafts; 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    raft: Annotated[
        float,
        make_meta(
            "speed of rafts; 0: the speeds support and, for the top layer, support_interface",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    first_layer: Annotated[
        float,
        make_meta(
            "speed limit for perimeters on the first layer, also above a raft; 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    first_layer_infill: Annotated[
        float,
        make_meta(
            "speed limit for infill on the first layer; 0: first_layer, or as in the printer profile if "
            "that is 0 too",
            "mm/s",
            ge=0,
            le=1000,
        ),
    ] = 0
    first_layer_travel: Annotated[
        float,
        make_meta(
            "speed limit for travel moves on the first layer; 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=2000,
        ),
    ] = 0
    slow_below: Annotated[
        float,
        make_meta(
            "height up to which speeds increase from the first layer's limit to full speed; 0: no ramp",
            "mm",
            ge=0,
            le=100,
        ),
    ] = 0
    small_perimeter: Annotated[
        float,
        make_meta(
            "speed limit for small perimeters (see small_perimeter_radius); 0: as in the printer profile",
            "mm/s",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 0
    small_perimeter_radius: Annotated[
        float,
        make_meta(
            "perimeters that are not longer than a circle with this radius count as small",
            "mm",
            ge=0,
            le=100,
            own=ANYWHERE,
        ),
    ] = 6.5
    even_flow_ratio: Annotated[
        float,
        make_meta(
            "degree to which speeds adapt to the layer height: 0: not at all; 1: all layers get the same "
            "flow as at layer_height",
            "0-1",
            ge=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0
    even_flow_most: Annotated[
        float,
        make_meta(
            "largest factor by which even_flow_ratio may change a speed", "ratio", ge=1, le=10, own=ANYWHERE
        ),
    ] = 2
    travel: Annotated[
        float, make_meta("speed of travel moves; 0: as in the printer profile", "mm/s", ge=0, le=2000)
    ] = 0


class Accelerations(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Accelerations of a quality by role; 0: `default`, or the printer's if that is 0 too.

    `printer.acceleration` limits all of them.
    """

    default: Annotated[
        float,
        make_meta(
            "acceleration of roles whose own value is 0; 0: as in the printer profile",
            "mm/s²",
            ge=0,
            le=100000,
            own=ANYWHERE,
        ),
    ] = 0
    first_layer: Annotated[
        float,
        make_meta(
            "acceleration of extrusions on the first layer; 0: as in the printer profile",
            "mm/s²",
            ge=0,
            le=100000,
        ),
    ] = 0
    external_perimeter: Annotated[
        float,
        make_meta("acceleration of external perimeters; 0: default", "mm/s²", ge=0, le=100000, own=ANYWHERE),
    ] = 0
    perimeter: Annotated[
        float,
        make_meta(
            "acceleration of perimeters, except external ones; 0: default",
            "mm/s²",
            ge=0,
            le=100000,
            own=ANYWHERE,
        ),
    ] = 0
    overhang: Annotated[
        float,
        make_meta("acceleration of overhang perimeters; 0: default", "mm/s²", ge=0, le=100000, own=ANYWHERE),
    ] = 0
    bridge: Annotated[
        float, make_meta("acceleration of bridges; 0: default", "mm/s²", ge=0, le=100000, own=ANYWHERE)
    ] = 0
    internal_infill: Annotated[
        float,
        make_meta("acceleration of internal infill; 0: default", "mm/s²", ge=0, le=100000, own=ANYWHERE),
    ] = 0
    solid_infill: Annotated[
        float,
        make_meta(
            "acceleration of solid infill, including bottom layers; 0: default",
            "mm/s²",
            ge=0,
            le=100000,
            own=ANYWHERE,
        ),
    ] = 0
    top_solid_infill: Annotated[
        float,
        make_meta(
            "acceleration of top solid infill and ironing; 0: default", "mm/s²", ge=0, le=100000, own=ANYWHERE
        ),
    ] = 0
