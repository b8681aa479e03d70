"""Settings of the planners, one group each."""

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
    """Uniform layers of `layer_height`."""


class AreaPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="area", tag_field="kind"
):
    """The paper's area test: thick layers where the area of the section is constant, thin layers elsewhere."""

    tolerance: Annotated[
        float, meta("sections whose areas differ by less than this count as equal", "mm²", ge=0, le=1000)
    ] = 1e-6
    relative_tolerance: Annotated[
        float,
        meta("sections whose areas differ by less than this fraction count as equal", "ratio", ge=0, le=1),
    ] = 1e-6
    aligned: Annotated[
        bool,
        meta("compare areas between the z levels of the part's vertices, and end layers at these levels"),
    ] = False
    guarded: Annotated[
        bool, meta("use thick layers only if all sections up to the end of the layer have equal areas")
    ] = False


class CuspPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="cusp", tag_field="kind"
):
    """From the bed up, each layer as thick as the facets in it allow, without looking further ahead."""

    metric: Annotated[
        Literal["cusp", "triangle", "wasserfall", "topography"],
        meta("error measure that limits the layer height"),
    ] = "cusp"


class StepwisePlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="stepwise", tag_field="kind"
):
    """Slabs of the maximum layer height, each divided evenly until its layers meet the cusp height."""


class GeneticPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="genetic", tag_field="kind"
):
    """Random search for the fewest layers within the cusp height."""

    seed: Annotated[int, meta("random seed; the same seed gives the same plan", ge=0, le=1000000)] = 0
    population: Annotated[int, meta("number of plans in a generation", ge=4, le=10000)] = 60
    generations: Annotated[int, meta("number of generations", ge=1, le=100000)] = 200


class HeightRange(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A height range with rules of its own; layers end at both of its ends."""

    low: Annotated[float, meta("lower end of the range, measured from the bed", "mm", ge=0, le=10000)]
    high: Annotated[float, meta("upper end of the range, measured from the bed", "mm", gt=0, le=10000)]
    tolerance: Annotated[
        float, meta("maximum surface deviation in the range; 0: quality.tolerance", "mm", ge=0, le=2)
    ] = 0
    layer_height: Annotated[
        float, meta("layer height in the range; 0: chosen by the planner", "mm", ge=0, le=1.6)
    ] = 0


class OptimalPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="optimal", tag_field="kind"
):
    """The best of all layer plans whose certified deviation is within the tolerance."""

    objective: Annotated[
        Literal["balanced", "time", "layers", "volume"],
        meta(
            "what the planner minimizes: balanced: print time plus the price of the volume error; time: print time; "
            "layers: number of layers; volume: volume error"
        ),
    ] = "balanced"
    error_price: Annotated[
        float,
        meta(
            "print time worth spending to avoid 1 mm³ of volume error, for objective balanced; 0: by error_price_ratio",
            "s/mm³",
            ge=0,
            le=1e6,
        ),
    ] = 0
    error_price_ratio: Annotated[
        float,
        meta(
            "error_price as a multiple of the time that the printer takes for 1 mm³ of the part at layer_height",
            "ratio",
            gt=0,
            le=1e6,
        ),
    ] = 45
    snap_tolerance: Annotated[
        float,
        meta(
            "layer tops align with flat surfaces within this distance; 0: half of printer.z_step",
            "mm",
            ge=0,
            le=1,
        ),
    ] = 0
    max_step: Annotated[
        float,
        meta("maximum height difference between neighbouring layers; 0: set by smooth", "mm", ge=0, le=1),
    ] = 0
    smooth: Annotated[
        bool,
        meta(
            "limit height differences between neighbouring layers to 0.06 mm or a quarter of the thicker layer, "
            "except next to flat surfaces; max_step takes precedence"
        ),
    ] = True
    max_layers: Annotated[
        int,
        meta(
            "maximum number of layers, within which volume error is minimized; 0: no limit", ge=0, le=1000000
        ),
    ] = 0
    time_budget: Annotated[
        float,
        meta(
            "maximum estimated print time, within which volume error is minimized; 0: no limit",
            "s",
            ge=0,
            le=1e8,
        ),
    ] = 0
    ranges: Annotated[
        tuple[HeightRange, ...],
        meta(
            "height ranges with rules of their own: LOW:HIGH:tolerance=MM or LOW:HIGH:layer_height=MM, separated "
            "by ;",
            "mm",
        ),
    ] = ()


Planner = UniformPlanner | AreaPlanner | CuspPlanner | StepwisePlanner | GeneticPlanner | OptimalPlanner
PLANNER_SETTINGS: Final[Mapping[str, type[Struct]]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(Planner)
}
