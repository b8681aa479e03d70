"""The settings of every planner, each a group of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, get_args

from msgspec import Struct

from printer_slicer.profile.base import Settings, meta

__all__ = [
    "PLANNER_SETTINGS",
    "AreaPlanner",
    "CuspPlanner",
    "GeneticPlanner",
    "HeightRange",
    "OptimalPlanner",
    "Planner",
    "StepwisePlanner",
    "UniformPlanner",
]


class UniformPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="uniform", tag_field="kind"
):
    """All layers equally high, as `layer_height` says."""


class AreaPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="area", tag_field="kind"
):
    """The area test of the paper: thick where the area of the section does not change, thin elsewhere."""

    tolerance: Annotated[float, meta("areas that differ by less are equal", "mm²", ge=0, le=1000)] = 1e-6
    relative_tolerance: Annotated[float, meta("the same as a share of the area", "ratio", ge=0, le=1)] = 1e-6
    aligned: Annotated[
        bool, meta("test whole regions between the z levels of the part, end layers on them")
    ] = False
    guarded: Annotated[bool, meta("go thick only if the area at the far plane is equal too")] = False


class CuspPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="cusp", tag_field="kind"
):
    """From the bed up, each layer as thick as the steepest facet in it allows; nothing looks ahead further."""

    metric: Annotated[
        Literal["cusp", "triangle", "wasserfall", "topography"], meta("what a layer's error is measured by")
    ] = "cusp"


class StepwisePlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="stepwise", tag_field="kind"
):
    """Slabs of the thickest layer, each divided evenly as far as the cusp height asks."""


class GeneticPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="genetic", tag_field="kind"
):
    """Random search for few layers under the cusp height."""

    seed: Annotated[int, meta("the same seed gives the same plan", ge=0, le=1000000)] = 0
    population: Annotated[int, meta("plans alive at the same time", ge=4, le=10000)] = 60
    generations: Annotated[int, meta("how often they breed", ge=1, le=100000)] = 200


class HeightRange(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A stretch of z with rules of its own; layers end at both of its ends."""

    low: Annotated[float, meta("where it begins, over the bed", "mm", ge=0, le=10000)]
    high: Annotated[float, meta("where it ends", "mm", gt=0, le=10000)]
    tolerance: Annotated[float, meta("tolerance in it; 0: the quality's", "mm", ge=0, le=2)] = 0
    layer_height: Annotated[
        float, meta("height of its layers; 0: as the planner has it", "mm", ge=0, le=1.6)
    ] = 0


class OptimalPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="optimal", tag_field="kind"
):
    """The best of all plans whose certified error is within the tolerance."""

    objective: Annotated[
        Literal["balanced", "time", "layers", "volume"],
        meta("what is least: minutes and volume error at their price, minutes, layers, or volume error"),
    ] = "balanced"
    error_price: Annotated[
        float,
        meta(
            "print time worth spending to avoid 1 mm³ of volume error (balanced); 0: see error_price_ratio",
            "s/mm³",
            ge=0,
            le=1e6,
        ),
    ] = 0
    error_price_ratio: Annotated[
        float,
        meta(
            "the same, relative to the time the machine needs for 1 mm³ of the part in layers of layer_height",
            "ratio",
            gt=0,
            le=1e6,
        ),
    ] = 45
    snap_tolerance: Annotated[
        float, meta("layers end this near to flats; 0: half of the printer's z_step", "mm", ge=0, le=1)
    ] = 0
    max_step: Annotated[
        float, meta("largest step between neighbouring layers; 0: see smooth", "mm", ge=0, le=1)
    ] = 0
    smooth: Annotated[
        bool,
        meta(
            "without max_step: neighbouring layers differ by at most 0.06 mm or a quarter of the thicker one, "
            "except next to flats"
        ),
    ] = True
    max_layers: Annotated[
        int, meta("the least volume error with no more layers; 0: any number", ge=0, le=1000000)
    ] = 0
    time_budget: Annotated[
        float, meta("the least volume error in this modelled time; 0: any time", "s", ge=0, le=1e8)
    ] = 0
    ranges: Annotated[
        tuple[HeightRange, ...],
        meta("LOW:HIGH:tolerance=MM or LOW:HIGH:layer_height=MM, separated by ;", "mm"),
    ] = ()


Planner = UniformPlanner | AreaPlanner | CuspPlanner | StepwisePlanner | GeneticPlanner | OptimalPlanner
PLANNER_SETTINGS: Final[Mapping[str, type[Struct]]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(Planner)
}
