"""How fast and how hard each role is printed."""

from __future__ import annotations

from typing import Annotated

from printer_slicer.profile.base import ANYWHERE, Settings, meta

__all__ = ["Accelerations", "Speeds"]


class Speeds(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How fast each role is printed; the material's flow limit may lower any of them."""

    outer_perimeter: Annotated[float, meta("outer perimeters", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 35
    inner_perimeter: Annotated[float, meta("inner perimeters", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 50
    sparse: Annotated[float, meta("sparse infill", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 70
    solid: Annotated[float, meta("solid infill and bottom skins", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 60
    top_skin: Annotated[float, meta("top skins", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 40
    ironing: Annotated[float, meta("ironing", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 15
    bridge: Annotated[float, meta("bridges", "mm/s", gt=0, le=1000, own=ANYWHERE)] = 30
    internal_bridge: Annotated[
        float, meta("the first solid layer over sparse infill", "mm/s", gt=0, le=1000, own=ANYWHERE)
    ] = 40
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
    raft: Annotated[float, meta("rafts", "mm/s", gt=0, le=1000)] = 30
    first_layer: Annotated[
        float,
        meta(
            "everything on the first layer, and on the part's first over a raft, at most",
            "mm/s",
            gt=0,
            le=1000,
        ),
    ] = 20
    slow_below: Annotated[
        float,
        meta("from the first layer's speed up to this z speeds grow to the full ones", "mm", ge=0, le=100),
    ] = 0
    small_perimeter: Annotated[
        float,
        meta(
            "perimeters of small_perimeter_radius, at most; 0: as the others",
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
    travel: Annotated[float, meta("travels", "mm/s", gt=0, le=2000)] = 150


class Accelerations(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How hard each role is accelerated; 0: as `printer.acceleration` has it, which is the most for all of them."""

    first_layer: Annotated[float, meta("everything on the first layer", "mm/s²", ge=0, le=100000)] = 0
    outer_perimeter: Annotated[float, meta("outer perimeters", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    inner_perimeter: Annotated[float, meta("inner perimeters", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    overhang: Annotated[
        float, meta("perimeters that hang over air", "mm/s²", ge=0, le=100000, own=ANYWHERE)
    ] = 0
    bridge: Annotated[float, meta("bridges", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    sparse: Annotated[float, meta("sparse infill", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
    solid: Annotated[
        float,
        meta(
            "solid infill and bottom skins",
            "mm/s²",
            ge=0,
            le=100000,
            own=ANYWHERE,
        ),
    ] = 0
    top_skin: Annotated[float, meta("top skins and ironing", "mm/s²", ge=0, le=100000, own=ANYWHERE)] = 0
