"""Settings of a quality: those of the part, and adhesion, supports, speeds, overrides."""

# Annotations are not postponed: msgspec needs their values, and evaluates texts one by one.
from typing import Annotated, Literal

from msgspec import field

from printer_slicer.profile.base import ANYWHERE, make_meta
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.part_quality import PartQuality
from printer_slicer.profile.speeds import Accelerations, Speeds

__all__ = ["Quality"]


class Quality(PartQuality, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a quality, which are independent of printer and material."""

    print_order: Annotated[
        Literal["by_layer", "by_object"],
        make_meta(
            "by_layer: all objects of the plate grow together; by_object: each is finished before the next begins, as "
            "far as the shapes in printer.head allow"
        ),
    ] = "by_layer"
    skirt_loops: Annotated[int, make_meta("number of skirt loops on the first layer", ge=0, le=20)] = 1
    skirt_distance: Annotated[
        float, make_meta("gap between the skirt and the part or its brim", "mm", ge=0, le=50)
    ] = 5
    skirt_min_length: Annotated[
        float,
        make_meta(
            "minimum length of filament in the skirt of the first layer; loops are added to reach it",
            "mm",
            ge=0,
            le=10000,
        ),
    ] = 0
    skirt_height: Annotated[
        float,
        make_meta(
            "height of the skirt, which then is a draft shield; 0: first layer only, 10000: all layers",
            "mm",
            ge=0,
            le=10000,
        ),
    ] = 0
    brim_width: Annotated[float, make_meta("width of the brim; 0: no brim", "mm", ge=0, le=50)] = 0
    brim_type: Annotated[
        Literal["outer", "inner", "both", "ears"],
        make_meta(
            "where the brim is: around parts (outer), in their holes (inner), both, or only at sharp corners "
            "(ears)"
        ),
    ] = "outer"
    brim_gap: Annotated[float, make_meta("gap between the part and its brim", "mm", ge=0, le=5)] = 0
    brim_ear_angle_deg: Annotated[
        float, make_meta("corners with a smaller angle than this get an ear", "degrees", ge=0, le=180)
    ] = 125
    brim_ear_scale: Annotated[
        float,
        make_meta("corners with a rounding radius below half of this count as sharp", "mm", ge=0.1, le=50),
    ] = 2
    raft_height: Annotated[float, make_meta("height of the raft; 0: no raft", "mm", ge=0, le=50)] = 0
    raft_margin: Annotated[
        float, make_meta("distance by which the raft extends beyond the first layer", "mm", ge=1, le=50)
    ] = 3
    raft_gap: Annotated[float, make_meta("vertical gap between the raft and the part", "mm", ge=0, le=1)] = (
        0.16
    )
    raft_base_density: Annotated[
        float, make_meta("infill density of the raft's lowest layer", "0-1", ge=0.2, le=1)
    ] = 0.5
    support: Annotated[
        Literal["off", "auto", "columns", "tree"],
        make_meta(
            "supports under overhangs: off: none; auto: columns or trees, whichever costs less; columns: straight "
            "down; tree: branches that merge; places that one style leaves unsupported may get the other",
            own=ANYWHERE,
        ),
    ] = "off"
    support_places: Annotated[
        Literal["all", "enforced"],
        make_meta(
            "where supports are made: all: under all overhangs; enforced: only in support enforcers and below "
            "facets that are painted for supports",
            own=ANYWHERE,
        ),
    ] = "all"
    support_threshold_deg: Annotated[
        float,
        make_meta(
            "surfaces that are flatter than this angle from the horizontal are overhangs; values under 5 degrees "
            "act as 5, because the step between two layers looks like a slope at smaller angles",
            "degrees",
            ge=0,
            le=89,
            own=ANYWHERE,
        ),
    ] = 40
    support_max_bridge: Annotated[
        float,
        make_meta(
            "maximum length of bridges that are printed without supports; 0: all bridges get supports",
            "mm",
            ge=0,
            le=100,
            own=ANYWHERE,
        ),
    ] = 10
    support_min_area: Annotated[
        float,
        make_meta(
            "overhangs with a smaller area than this, seen from above, get no supports",
            "mm²",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 1
    support_min_reach: Annotated[
        float,
        make_meta(
            "narrow overhangs, into which no circle of this radius fits, seen from above, get no supports, unless they "
            "extend beyond the part below by four times this radius",
            "mm",
            ge=0,
            le=10,
            own=ANYWHERE,
        ),
    ] = 0.5
    support_gap: Annotated[
        float,
        make_meta("vertical gap between supports and the overhang above", "mm", ge=0, le=1, own=ANYWHERE),
    ] = 0.2
    support_bottom_gap: Annotated[
        float,
        make_meta(
            "vertical gap between supports and the part below, on which they stand",
            "mm",
            ge=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.2
    support_gap_slack: Annotated[
        float,
        make_meta(
            "amount by which the gap below slopes may exceed support_gap; a larger value gives fewer support layers",
            "mm",
            ge=0,
            le=0.3,
            own=ANYWHERE,
        ),
    ] = 0.1
    support_xy_gap: Annotated[
        float,
        make_meta(
            "horizontal gap between supports and the part; trees keep 0.15 mm more",
            "mm",
            ge=0,
            le=10,
            own=ANYWHERE,
        ),
    ] = 0.35
    support_layer_max: Annotated[
        float, make_meta("maximum layer height of supports; 0: 0.75 nozzle diameters", "mm", ge=0, le=1.6)
    ] = 0
    support_synchronize_layers: Annotated[
        bool, make_meta("give supports the same layers as the part; false: layers of their own")
    ] = False
    support_interface_layers: Annotated[
        int, make_meta("number of closed layers on top of supports", ge=0, le=10, own=ANYWHERE)
    ] = 2
    support_interface_spacing: Annotated[
        float, make_meta("gap between the lines of support interfaces", "mm", ge=0, le=5, own=ANYWHERE)
    ] = 0.2
    support_spacing: Annotated[
        float, make_meta("distance between the lines of supports", "mm", ge=0.5, le=20, own=ANYWHERE)
    ] = 2.5
    support_walls: Annotated[
        int, make_meta("number of loops around columns of support", ge=0, le=10, own=ANYWHERE)
    ] = 0
    support_closing: Annotated[
        float,
        make_meta(
            "distance for closing gaps between supports: gaps narrower than twice this are filled",
            "mm",
            ge=0,
            le=10,
            own=ANYWHERE,
        ),
    ] = 1
    support_on_bed_only: Annotated[
        bool, make_meta("make only supports that stand on the bed, none on the part", own=ANYWHERE)
    ] = False
    support_first_layer_expansion: Annotated[
        float, make_meta("width added around supports at the bed", "mm", ge=0, le=20, own=ANYWHERE)
    ] = 3
    support_joist_spacing: Annotated[
        float,
        make_meta(
            "distance between joists: the single lines on the tips of trees, which carry the interface",
            "mm",
            ge=0.5,
            le=10,
            own=ANYWHERE,
        ),
    ] = 2.5
    support_tip_distance: Annotated[
        float,
        make_meta(
            "maximum distance between the tips of trees along a joist",
            "mm",
            ge=0.5,
            le=50,
            own=ANYWHERE,
        ),
    ] = 5
    support_tip_diameter: Annotated[
        float, make_meta("diameter of the tips of trees", "mm", ge=0.2, le=5, own=ANYWHERE)
    ] = 1.0
    support_tree_angle_deg: Annotated[
        float,
        make_meta(
            "maximum angle of branches from the vertical, where the part is in the way",
            "degrees",
            ge=5,
            le=75,
            own=ANYWHERE,
        ),
    ] = 45
    support_tree_slow_angle_deg: Annotated[
        float,
        make_meta(
            "maximum angle of branches from the vertical, where nothing is in the way",
            "degrees",
            ge=5,
            le=75,
            own=ANYWHERE,
        ),
    ] = 34
    support_branch_diameter: Annotated[
        float, make_meta("diameter of branches just below their tips", "mm", ge=0.5, le=20, own=ANYWHERE)
    ] = 2
    support_branch_growth_deg: Annotated[
        float,
        make_meta(
            "angle at which branches become thicker towards the bed", "degrees", ge=0, le=15, own=ANYWHERE
        ),
    ] = 5
    support_bed_detour: Annotated[
        float,
        make_meta(
            "maximum extra length of a branch that leads to the bed instead of ending on the part",
            "mm",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 20
    support_minutes_per_gram: Annotated[
        float,
        make_meta(
            "print time worth spending to avoid one gram of support", "min/g", ge=0, le=100, own=ANYWHERE
        ),
    ] = 1
    surface_price: Annotated[
        float,
        make_meta(
            "print time worth spending to avoid 1 mm³ of mean surface deviation times surface area, when a part is "
            "turned to print well",
            "s/mm³",
            ge=0,
            le=1000,
        ),
    ] = 1
    spiral: Annotated[
        bool,
        make_meta(
            "print one continuous spiral perimeter above the bottom (vase mode), without infill, top "
            "layers or other perimeters"
        ),
    ] = False
    pause_at: Annotated[
        tuple[Annotated[float, make_meta("", ge=0, le=10000)], ...],
        make_meta("heights above the bed at which the print pauses", "mm"),
    ] = ()
    overrides: Annotated[
        tuple[Override, ...],
        make_meta(
            "settings of single objects or height ranges: OBJECT:KEY=VALUE or LOW:HIGH:KEY=VALUE, separated by ;"
        ),
    ] = ()
    speeds: Speeds = field(default_factory=Speeds)
    accelerations: Accelerations = field(default_factory=Accelerations)
