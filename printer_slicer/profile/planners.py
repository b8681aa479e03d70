"""Settings of the planners: one group for each planner."""

# Annotations are not postponed: msgspec needs their values, and evaluates texts one by one.
from collections.abc import Mapping
from typing import Annotated, Final, Literal, get_args

from msgspec import Struct

from printer_slicer.profile.base import Settings, make_meta

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
    """Thick layers where the area of the section is constant, and thin layers where it changes."""

    tolerance: Annotated[
        float, make_meta("sections whose areas differ by less than this count as equal", "mm²", ge=0, le=1000)
    ] = 1e-6
    relative_tolerance: Annotated[
        float,
        make_meta(
            "sections whose areas differ by less than this fraction count as equal", "ratio", ge=0, le=1
        ),
    ] = 1e-6
    aligned: Annotated[
        bool,
        make_meta(
            "divide the part at the z levels of its vertices, compare areas between these levels, and end "
            "layers at them"
        ),
    ] = False
    guarded: Annotated[
        bool, make_meta("use thick layers only if all sections up to the end of the layer have equal areas")
    ] = False


class CuspPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="cusp", tag_field="kind"
):
    """Layers chosen one by one from the bed up; the steepness of the facets in a layer limits its height."""

    metric: Annotated[
        Literal["cusp", "triangle", "wasserfall", "topography"],
        make_meta("error measure that limits the layer height"),
    ] = "cusp"


class StepwisePlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="stepwise", tag_field="kind"
):
    """Slabs of the maximum layer height, each divided into equal layers that keep the cusp height."""


class GeneticPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="genetic", tag_field="kind"
):
    """Random search for the fewest layers within the cusp height."""

    seed: Annotated[int, make_meta("random seed; the same seed gives the same plan", ge=0, le=1000000)] = 0
    population: Annotated[int, make_meta("number of plans in a generation", ge=4, le=10000)] = 60
    generations: Annotated[int, make_meta("number of generations", ge=1, le=100000)] = 200


class HeightRange(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A height range with its own tolerance or layer height; a layer ends at each end of the range."""

    low: Annotated[float, make_meta("lower end of the range, measured from the bed", "mm", ge=0, le=10000)]
    high: Annotated[float, make_meta("upper end of the range, measured from the bed", "mm", gt=0, le=10000)]
    tolerance: Annotated[
        float, make_meta("maximum surface deviation in the range; 0: quality.tolerance", "mm", ge=0, le=2)
    ] = 0
    layer_height: Annotated[
        float, make_meta("layer height in the range; 0: chosen by the planner", "mm", ge=0, le=1.6)
    ] = 0


class OptimalPlanner(
    Settings, frozen=True, forbid_unknown_fields=True, kw_only=True, tag="optimal", tag_field="kind"
):
    """The best layer plan whose certified deviation is within the tolerance."""

    objective: Annotated[
        Literal["balanced", "time", "layers", "volume"],
        make_meta(
            "what the planner minimizes: balanced: print time plus the price of the volume error; time: print time; "
            "layers: number of layers; volume: volume error"
        ),
    ] = "balanced"
    error_price: Annotated[
        float,
        make_meta(
            "print time worth spending to avoid 1 mm³ of volume error, with objective = balanced; 0: "
            "calculated from error_price_ratio",
            "s/mm³",
            ge=0,
            le=1e6,
        ),
    ] = 0
    error_price_ratio: Annotated[
        float,
        make_meta(
            "error_price as a multiple of the time that the printer takes for 1 mm³ of the part at layer_height",
            "ratio",
            gt=0,
            le=1e6,
        ),
    ] = 45
    snap_tolerance: Annotated[
        float,
        make_meta(
            "distance within which layer tops align with flat surfaces; 0: half of printer.z_step",
            "mm",
            ge=0,
            le=1,
        ),
    ] = 0
    max_step: Annotated[
        float,
        make_meta(
            "maximum height difference between neighbouring layers; 0: determined by smooth", "mm", ge=0, le=1
        ),
    ] = 0
    smooth: Annotated[
        bool,
        make_meta(
            "limit height differences between neighbouring layers to 0.06 mm or a quarter of the thicker layer, "
            "except next to flat surfaces; max_step takes precedence"
        ),
    ] = True
    max_layers: Annotated[
        int,
        make_meta(
            "maximum number of layers; the volume error is minimized within this limit; 0: no limit",
            ge=0,
            le=1000000,
        ),
    ] = 0
    time_budget: Annotated[
        float,
        make_meta(
            "maximum estimated print time; the volume error is minimized within this limit; 0: no limit",
            "s",
            ge=0,
            le=1e8,
        ),
    ] = 0
    ranges: Annotated[
        tuple[HeightRange, ...],
        make_meta(
            "height ranges with their own tolerance or layer height: LOW:HIGH:tolerance=MM or "
            "LOW:HIGH:layer_height=MM, separated by ;",
            "mm",
        ),
    ] = ()
    stacks: Annotated[
        Literal["one", "objects", "features"],
        make_meta(
            "layer plans of a plate with several objects: one: the same plan for all objects; objects: a plan for each "
            "object if this costs less; features: also for parts of a single object that stand apart, such as towers"
        ),
    ] = "objects"


Planner = UniformPlanner | AreaPlanner | CuspPlanner | StepwisePlanner | GeneticPlanner | OptimalPlanner
PLANNER_SETTINGS: Final[Mapping[str, type[Struct]]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(Planner)
}
