"""Settings of a quality for the part itself: layers, perimeters, infill and bridges."""

# Annotations are not postponed: msgspec needs their values, and evaluates texts one by one.
from typing import Annotated, Literal

from msgspec import field

from printer_slicer.profile.base import ANYWHERE, EACH_OBJECT, Settings, make_meta
from printer_slicer.profile.planners import OptimalPlanner, Planner

__all__ = ["PartQuality"]


class PartQuality(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of layers, perimeters, infill and bridges, which are part of every quality."""

    name: Annotated[str, make_meta("display name of this quality")]
    planner: Planner = field(default_factory=OptimalPlanner)
    layer_height: Annotated[
        float, make_meta("layer height of the uniform planner", "mm", ge=0.01, le=1.6)
    ] = 0.2
    first_layer_height: Annotated[
        float, make_meta("height of the first layer; 0: chosen by the planner", "mm", ge=0, le=1.6)
    ] = 0
    first_layer_flow: Annotated[
        float,
        make_meta(
            "flow multiplier for the layer on the bed",
            "ratio",
            ge=0.5,
            le=1.5,
            own=EACH_OBJECT,
        ),
    ] = 1
    thinnest_layer: Annotated[
        float, make_meta("minimum height of variable layers; 0: printer.min_layer", "mm", ge=0, le=1.6)
    ] = 0
    thickest_layer: Annotated[
        float, make_meta("maximum height of variable layers; 0: printer.max_layer", "mm", ge=0, le=1.6)
    ] = 0
    layer_step: Annotated[
        float,
        make_meta(
            "variable layer heights are multiples of this; 0: printer.z_full_step, or 0.01 mm if that is "
            "unknown",
            "mm",
            ge=0,
            le=1,
        ),
    ] = 0
    layer_heights: Annotated[
        tuple[float, ...],
        make_meta("allowed variable layer heights; empty: all from thinnest_layer to thickest_layer", "mm"),
    ] = ()
    tolerance: Annotated[float, make_meta("maximum surface deviation", "mm", ge=0.001, le=2)] = 0.12
    containment: Annotated[
        Literal["mid", "positive", "negative"],
        make_meta(
            "side of the surface on which layers may deviate from it: mid: both sides; positive: only "
            "outside; negative: only inside"
        ),
    ] = "mid"
    resolution: Annotated[
        float, make_meta("maximum deviation when contours are simplified", "mm", ge=0, le=0.2)
    ] = 0.0125
    arc_tolerance: Annotated[
        float,
        make_meta(
            "maximum deviation of arcs (G2, G3) from the curves that they replace; 0: no arcs",
            "mm",
            ge=0,
            le=0.2,
        ),
    ] = 0
    link_tolerance: Annotated[
        float,
        make_meta(
            "maximum deviation when short moves are merged for the serial connection",
            "mm",
            ge=0,
            le=0.2,
        ),
    ] = 0.05
    xy_compensation: Annotated[
        float,
        make_meta("outward offset of outer contours; negative: inward", "mm", ge=-1, le=1, own=EACH_OBJECT),
    ] = 0
    hole_compensation: Annotated[
        float,
        make_meta(
            "distance by which holes are enlarged on all sides; negative: reduced",
            "mm",
            ge=-1,
            le=1,
            own=EACH_OBJECT,
        ),
    ] = 0
    elephant_foot: Annotated[
        float,
        make_meta(
            "inset of the first layer that compensates for elephant foot", "mm", ge=0, le=1, own=EACH_OBJECT
        ),
    ] = 0
    elephant_foot_height: Annotated[
        float,
        make_meta(
            "height over which the inset of elephant_foot decreases to zero; 0: first layer only",
            "mm",
            ge=0,
            le=5,
            own=EACH_OBJECT,
        ),
    ] = 0
    extrusion_width: Annotated[
        float, make_meta("extrusion width; 0: 1.125 nozzle diameters", "mm", ge=0, le=4)
    ] = 0
    external_perimeter_width: Annotated[
        float, make_meta("extrusion width of external perimeters; 0: extrusion_width", "mm", ge=0, le=4)
    ] = 0
    first_layer_width: Annotated[
        float, make_meta("extrusion width on the first layer; 0: extrusion_width", "mm", ge=0, le=4)
    ] = 0
    perimeters: Annotated[int, make_meta("number of perimeters", ge=0, le=100, own=ANYWHERE)] = 2
    varying_walls: Annotated[
        bool,
        make_meta(
            "fill walls that are too narrow for all perimeters with extrusions of variable width; false: "
            "slicing is slightly faster",
            own=ANYWHERE,
        ),
    ] = True
    min_bead_width: Annotated[
        float,
        make_meta(
            "minimum extrusion width in thin walls; 0: 0.85 nozzle diameters",
            "mm",
            ge=0,
            le=4,
            own=ANYWHERE,
        ),
    ] = 0
    max_bead_width: Annotated[
        float,
        make_meta(
            "maximum extrusion width in thin walls; 0: 1.65 nozzle diameters", "mm", ge=0, le=4, own=ANYWHERE
        ),
    ] = 0
    min_feature: Annotated[
        float,
        make_meta(
            "walls thinner than this are not printed; 0: 0.25 nozzle diameters",
            "mm",
            ge=0,
            le=4,
            own=ANYWHERE,
        ),
    ] = 0
    single_top_perimeter: Annotated[
        bool,
        make_meta(
            "print only the external perimeter on top surfaces; top solid infill replaces the other "
            "perimeters",
            own=ANYWHERE,
        ),
    ] = False
    extra_perimeters: Annotated[bool, make_meta("add perimeters at the edges of overhangs", own=ANYWHERE)] = (
        False
    )
    external_perimeter_first: Annotated[
        bool, make_meta("print external perimeters before the other perimeters")
    ] = False
    infill_first: Annotated[bool, make_meta("print infill before the perimeters around it")] = False
    seam: Annotated[
        Literal["aligned", "nearest", "rear", "direction", "random"],
        make_meta(
            "where perimeters start: aligned: at corners above each other; nearest: nearest to the "
            "nozzle; rear: at the rear; direction: on the side of seam_angle_deg; random: anywhere"
        ),
    ] = "aligned"
    seam_angle_deg: Annotated[
        float,
        make_meta(
            "side of the part for seams (0: right, 90: rear) with seam = direction, and for aligned seams "
            "where no corner can hide them",
            "degrees",
            ge=-360,
            le=360,
        ),
    ] = 90
    staggered_inner_seams: Annotated[
        bool,
        make_meta(
            "shift the seams of the other perimeters by 1.5 mm from the seam of the external perimeter, "
            "alternately to both sides"
        ),
    ] = False
    scarf_length: Annotated[
        float,
        make_meta(
            "length of the scarf joint (sloped seam) of external perimeters; 0: no scarf joint",
            "mm",
            ge=0,
            le=100,
        ),
    ] = 0
    scarf_start: Annotated[
        float,
        make_meta(
            "height of the extrusion at the start of a scarf joint, as a fraction of the layer height",
            "0-1",
            ge=0,
            le=0.9,
        ),
    ] = 0.1
    scarf_inner: Annotated[
        bool, make_meta("use scarf joints for all perimeters, not only for external ones")
    ] = False
    z_contouring: Annotated[
        bool,
        make_meta(
            "let the nozzle follow shallow upper surfaces in z within a layer, so that they have no steps"
        ),
    ] = False
    contour_min_height: Annotated[
        float,
        make_meta(
            "minimum height of extrusions that follow an upper surface (z_contouring)", "mm", ge=0.02, le=0.2
        ),
    ] = 0.05
    contour_max_slope_deg: Annotated[
        float,
        make_meta(
            "steepest upper surface that extrusions follow (z_contouring), from the horizontal; 0: where it removes "
            "more error than the width of the extrusion makes, at most 35",
            "degrees",
            ge=0,
            le=45,
        ),
    ] = 0
    avoid_crossing: Annotated[
        bool, make_meta("keep travel moves inside the part, around holes and corners, where that is possible")
    ] = True
    max_detour: Annotated[
        float,
        make_meta(
            "maximum additional length of a travel move that stays inside the part; 0: only detours that "
            "take less time than a retraction",
            "mm",
            ge=0,
            le=10000,
        ),
    ] = 50
    bottom_thickness: Annotated[
        float,
        make_meta(
            "thickness of solid infill above surfaces that face down", "mm", ge=0, le=1000, own=ANYWHERE
        ),
    ] = 0.6
    top_thickness: Annotated[
        float,
        make_meta("thickness of solid infill below surfaces that face up", "mm", ge=0, le=1000, own=ANYWHERE),
    ] = 0.8
    slope_shell_ratio: Annotated[
        float,
        make_meta(
            "minimum shell thickness across slopes, as a fraction of the thickness of solid infill or of "
            "all perimeters, whichever is less; 0: only the vertical thickness counts",
            "ratio",
            ge=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.9
    solid_infill_below_area: Annotated[
        float,
        make_meta(
            "areas of internal infill that are smaller than this, or narrower than three extrusions, "
            "become solid infill; 0: none",
            "mm²",
            ge=0,
            le=1e6,
            own=ANYWHERE,
        ),
    ] = 15
    ironing: Annotated[
        bool, make_meta("smooth top surfaces with closely spaced passes of the hot nozzle", own=ANYWHERE)
    ] = False
    ironing_spacing: Annotated[
        float, make_meta("distance between ironing lines", "mm", ge=0.1, le=1, own=ANYWHERE)
    ] = 0.1
    ironing_flow_ratio: Annotated[
        float,
        make_meta(
            "flow of ironing, as a fraction of the flow of a full layer",
            "ratio",
            ge=0.01,
            le=0.3,
            own=ANYWHERE,
        ),
    ] = 0.15
    thick_bridges: Annotated[
        bool,
        make_meta(
            "print bridges as round extrusions with the diameter of the nozzle; false: as flat extrusions "
            "of the layer height",
            own=ANYWHERE,
        ),
    ] = True
    bridge_flow_ratio: Annotated[
        float, make_meta("flow multiplier for bridges", "ratio", ge=0.3, le=2, own=ANYWHERE)
    ] = 1
    internal_bridge_flow_ratio: Annotated[
        float,
        make_meta(
            "flow multiplier for the first solid layer above internal infill",
            "ratio",
            ge=0.5,
            le=2,
            own=ANYWHERE,
        ),
    ] = 1
    bridge_anchor: Annotated[
        float,
        make_meta(
            "length that bridge lines extend onto the layer below at each end",
            "mm",
            ge=0,
            le=20,
            own=EACH_OBJECT,
        ),
    ] = 1.5
    infill: Annotated[
        Literal[
            "rectilinear", "grid", "triangles", "cubic", "gyroid", "honeycomb", "concentric", "lightning"
        ],
        make_meta("pattern of internal infill", own=ANYWHERE),
    ] = "grid"
    infill_density: Annotated[
        float, make_meta("density of internal infill", "0-1", ge=0, le=1, own=ANYWHERE)
    ] = 0.15
    infill_angle_deg: Annotated[
        float, make_meta("direction of infill lines", "degrees", ge=-360, le=360, own=ANYWHERE)
    ] = 45
    infill_overlap: Annotated[
        float,
        make_meta(
            "overlap of solid infill with perimeters, as a fraction of the mean line spacing of both",
            "0-1",
            ge=0,
            le=0.5,
            own=ANYWHERE,
        ),
    ] = 0.25
    internal_infill_overlap: Annotated[
        float,
        make_meta(
            "overlap of internal infill with perimeters, as a fraction of the mean line spacing of both",
            "0-1",
            ge=0,
            le=0.5,
            own=ANYWHERE,
        ),
    ] = 0.25
    infill_anchor: Annotated[
        float,
        make_meta(
            "length by which an infill line that ends without a connection continues along the perimeter; "
            "0: none",
            "mm",
            ge=0,
            le=50,
            own=ANYWHERE,
        ),
    ] = 2.5
    infill_anchor_max: Annotated[
        float,
        make_meta(
            "maximum length of connections between infill lines along the perimeter; 0: no connections",
            "mm",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 24
    internal_infill_every: Annotated[
        float,
        make_meta(
            "combine internal infill of several layers up to this total height, at most 0.8 nozzle "
            "diameters; 0: off",
            "mm",
            ge=0,
            le=2,
            own=EACH_OBJECT,
        ),
    ] = 0
    perimeters_every: Annotated[
        float,
        make_meta(
            "combine perimeters (except external ones) of several layers up to this total height, where "
            "the section is constant; 0: off",
            "mm",
            ge=0,
            le=2,
            own=EACH_OBJECT,
        ),
    ] = 0
    lightning_angle_deg: Annotated[
        float,
        make_meta(
            "maximum angle of lightning branches from the vertical", "degrees", ge=5, le=80, own=ANYWHERE
        ),
    ] = 40
