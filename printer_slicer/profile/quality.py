"""Settings of quality: how the part shall come out, and how fast."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import field

from printer_slicer.profile.base import ANYWHERE, EACH_OBJECT, Settings, meta
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.planners import OptimalPlanner, Planner
from printer_slicer.profile.speeds import Accelerations, Speeds

__all__ = ["Quality"]


class Quality(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the part shall come out."""

    name: Annotated[str, meta("what people call this quality")]
    planner: Planner = field(default_factory=OptimalPlanner)
    layer_height: Annotated[float, meta("height of uniform layers", "mm", ge=0.01, le=1.6)] = 0.2
    first_layer_height: Annotated[
        float, meta("height of the first layer; 0: as the planner has it", "mm", ge=0, le=1.6)
    ] = 0
    first_layer_flow: Annotated[
        float,
        meta(
            "extrusion of the layer on the bed is multiplied by this",
            "ratio",
            ge=0.5,
            le=1.5,
            own=EACH_OBJECT,
        ),
    ] = 1
    thinnest_layer: Annotated[
        float, meta("lower end of variable heights; 0: the printer's", "mm", ge=0, le=1.6)
    ] = 0
    thickest_layer: Annotated[
        float, meta("upper end of variable heights; 0: the printer's", "mm", ge=0, le=1.6)
    ] = 0
    layer_step: Annotated[
        float,
        meta(
            "variable heights are this far apart; 0: printer.z_full_step, else 0.01 mm, or z_step if that is more",
            "mm",
            ge=0,
            le=1,
        ),
    ] = 0
    layer_heights: Annotated[
        tuple[float, ...],
        meta("the only variable heights allowed; empty: all from thinnest to thickest", "mm"),
    ] = ()
    tolerance: Annotated[
        float, meta("how far wrongly filled or empty places may lie from the surface", "mm", ge=0.001, le=2)
    ] = 0.12
    containment: Annotated[
        Literal["mid", "positive", "negative"],
        meta("layers balanced about the surface, everywhere outside of it, or everywhere inside"),
    ] = "mid"
    resolution: Annotated[float, meta("contours are simplified by at most this", "mm", ge=0, le=0.2)] = 0.0125
    arc_tolerance: Annotated[
        float,
        meta(
            "curves are written as arcs (G2, G3) that leave them by at most this; 0: none", "mm", ge=0, le=0.2
        ),
    ] = 0
    link_tolerance: Annotated[
        float,
        meta(
            "moves too short for the link are merged if nothing is moved by more than this",
            "mm",
            ge=0,
            le=0.2,
        ),
    ] = 0.05
    xy_compensation: Annotated[
        float, meta("outer outlines are moved outward by this", "mm", ge=-1, le=1, own=EACH_OBJECT)
    ] = 0
    hole_compensation: Annotated[
        float, meta("holes are widened by this on all sides", "mm", ge=-1, le=1, own=EACH_OBJECT)
    ] = 0
    elephant_foot: Annotated[
        float, meta("inset of the first layer, which the bed squeezes", "mm", ge=0, le=1, own=EACH_OBJECT)
    ] = 0
    elephant_foot_height: Annotated[
        float,
        meta(
            "height over which that inset fades away; 0: the first layer only",
            "mm",
            ge=0,
            le=5,
            own=EACH_OBJECT,
        ),
    ] = 0
    extrusion_width: Annotated[
        float, meta("width of a bead; 0: 1.125 nozzle diameters", "mm", ge=0, le=4)
    ] = 0
    first_layer_width: Annotated[
        float, meta("width of a bead on the bed; 0: that of the others", "mm", ge=0, le=4)
    ] = 0
    perimeters: Annotated[int, meta("perimeters around each section", ge=0, le=100, own=ANYWHERE)] = 2
    varying_walls: Annotated[
        bool,
        meta(
            "fill places too narrow for all perimeters with beads of varying width; false is a little quicker",
            own=ANYWHERE,
        ),
    ] = True
    min_bead_width: Annotated[
        float,
        meta(
            "narrowest bead where walls are thin; 0: 0.85 nozzle diameters",
            "mm",
            ge=0,
            le=4,
            own=ANYWHERE,
        ),
    ] = 0
    max_bead_width: Annotated[
        float,
        meta("widest bead where walls are thin; 0: 1.65 nozzle diameters", "mm", ge=0, le=4, own=ANYWHERE),
    ] = 0
    min_feature: Annotated[
        float, meta("thinner walls are left out; 0: 0.25 nozzle diameters", "mm", ge=0, le=4, own=ANYWHERE)
    ] = 0
    single_top_perimeter: Annotated[
        bool,
        meta("only the outer perimeter where nothing lies above; the rest becomes top skin", own=ANYWHERE),
    ] = False
    extra_perimeters: Annotated[
        bool, meta("more perimeters where the edge of a layer hangs over air", own=ANYWHERE)
    ] = False
    external_perimeter_first: Annotated[bool, meta("print the outer perimeter before the inner ones")] = False
    infill_first: Annotated[bool, meta("print infill before the perimeters around it")] = False
    seam: Annotated[
        Literal["aligned", "nearest", "rear", "direction", "random"],
        meta(
            "where perimeters begin: in corners above each other, nearest to the nozzle, at the back, toward "
            "seam_angle_deg, or anywhere"
        ),
    ] = "aligned"
    seam_angle_deg: Annotated[
        float,
        meta(
            "the side for seams: 0 right, 90 back; aligned ones lie there where no corner hides them",
            "degrees",
            ge=-360,
            le=360,
        ),
    ] = 90
    staggered_inner_seams: Annotated[
        bool, meta("inner perimeters begin 1.5 mm beside the seam of the outer one, to and fro")
    ] = False
    scarf_length: Annotated[
        float,
        meta(
            "outer perimeters end in a slope of this length over their begin; 0: they just end",
            "mm",
            ge=0,
            le=100,
        ),
    ] = 0
    scarf_start: Annotated[
        float,
        meta("height of the bead where such a slope begins, as a share of the layer's", "0-1", ge=0, le=0.9),
    ] = 0.1
    scarf_inner: Annotated[bool, meta("inner perimeters too")] = False
    avoid_crossing: Annotated[
        bool, meta("travel inside the part, around its holes and corners, where that leads to the next bead")
    ] = True
    max_detour: Annotated[
        float,
        meta(
            "ways inside may be this much longer than straight ones; 0: only where they are quicker than a retraction",
            "mm",
            ge=0,
            le=10000,
        ),
    ] = 50
    bottom_thickness: Annotated[
        float, meta("solid over a surface that looks down", "mm", ge=0, le=1000, own=ANYWHERE)
    ] = 0.6
    top_thickness: Annotated[
        float, meta("solid under a surface that looks up", "mm", ge=0, le=1000, own=ANYWHERE)
    ] = 0.8
    slope_shell_ratio: Annotated[
        float,
        meta(
            "shell across slopes, as a share of the lesser of skins and walls; 0: skins are only measured upright",
            "ratio",
            ge=0,
            le=1,
            own=ANYWHERE,
        ),
    ] = 0.9
    solid_infill_below_area: Annotated[
        float,
        meta(
            "smaller areas, and strips under three beads wide, are not sparse but solid; 0: none",
            "mm²",
            ge=0,
            le=1e6,
            own=ANYWHERE,
        ),
    ] = 15
    ironing: Annotated[
        bool, meta("smooth top skins with the nozzle, in lines close together", own=ANYWHERE)
    ] = False
    ironing_spacing: Annotated[
        float, meta("from line to line of ironing", "mm", ge=0.1, le=1, own=ANYWHERE)
    ] = 0.1
    ironing_flow_ratio: Annotated[
        float,
        meta(
            "plastic in ironing, as a share of a full layer",
            "ratio",
            ge=0.01,
            le=0.3,
            own=ANYWHERE,
        ),
    ] = 0.15
    thick_bridges: Annotated[
        bool,
        meta(
            "bridges are round threads as thick as the nozzle, not pressed flat to the layer's height",
            own=ANYWHERE,
        ),
    ] = True
    bridge_flow_ratio: Annotated[float, meta("plastic in bridges", "ratio", ge=0.3, le=2, own=ANYWHERE)] = 1
    internal_bridge_flow_ratio: Annotated[
        float,
        meta("plastic in the first solid layer over sparse infill", "ratio", ge=0.5, le=2, own=ANYWHERE),
    ] = 1
    bridge_anchor: Annotated[
        float, meta("bridges reach this far onto what carries them", "mm", ge=0, le=20, own=EACH_OBJECT)
    ] = 1.5
    infill: Annotated[
        Literal[
            "rectilinear", "grid", "triangles", "cubic", "gyroid", "honeycomb", "concentric", "lightning"
        ],
        meta("pattern of the sparse infill", own=ANYWHERE),
    ] = "grid"
    infill_density: Annotated[
        float, meta("share of the inside that is filled", "0-1", ge=0, le=1, own=ANYWHERE)
    ] = 0.15
    infill_angle_deg: Annotated[
        float, meta("direction of the infill", "degrees", ge=-360, le=360, own=ANYWHERE)
    ] = 45
    infill_overlap: Annotated[
        float,
        meta(
            "overlap of solid infill ends with the perimeter, as a share of the mean of both spacings",
            "0-1",
            ge=0,
            le=0.5,
            own=ANYWHERE,
        ),
    ] = 0.25
    internal_infill_overlap: Annotated[
        float,
        meta(
            "overlap of sparse infill ends with the perimeter, as a share of the mean of both spacings",
            "0-1",
            ge=0,
            le=0.5,
            own=ANYWHERE,
        ),
    ] = 0.25
    infill_anchor: Annotated[
        float,
        meta(
            "hook along the wall where no neighbouring line is near; 0: none", "mm", ge=0, le=50, own=ANYWHERE
        ),
    ] = 2.5
    infill_anchor_max: Annotated[
        float,
        meta(
            "lines are joined along the wall where the way is no longer; 0: never",
            "mm",
            ge=0,
            le=1000,
            own=ANYWHERE,
        ),
    ] = 24
    internal_infill_every: Annotated[
        float,
        meta(
            "sparse infill of several layers in beads up to this high, at most 0.8 nozzles; 0: layer by layer",
            "mm",
            ge=0,
            le=2,
            own=EACH_OBJECT,
        ),
    ] = 0
    perimeters_every: Annotated[
        float,
        meta(
            "inner perimeters of several layers in beads up to this high where the section does not change; 0: "
            "layer by layer",
            "mm",
            ge=0,
            le=2,
            own=EACH_OBJECT,
        ),
    ] = 0
    lightning_angle_deg: Annotated[
        float, meta("branches of lightning lean out by no more", "degrees", ge=5, le=80, own=ANYWHERE)
    ] = 40
    skirt_loops: Annotated[int, meta("loops around everything on the first layer", ge=0, le=20)] = 1
    skirt_distance: Annotated[float, meta("gap between part or brim and skirt", "mm", ge=0, le=50)] = 5
    skirt_min_length: Annotated[
        float, meta("more loops on the first layer until they hold this much filament", "mm", ge=0, le=10000)
    ] = 0
    skirt_height: Annotated[
        float,
        meta("draft shield: the skirt reaches up to this; 0: one layer, 10000: all", "mm", ge=0, le=10000),
    ] = 0
    brim_width: Annotated[float, meta("rim attached to the part on the first layer", "mm", ge=0, le=50)] = 0
    brim_type: Annotated[
        Literal["outer", "inner", "both", "ears"],
        meta("where the brim is: around bodies, in their holes, both, or at sharp corners"),
    ] = "outer"
    brim_gap: Annotated[float, meta("between part and brim", "mm", ge=0, le=5)] = 0
    brim_ear_angle_deg: Annotated[
        float, meta("sharper corners than this get an ear", "degrees", ge=0, le=180)
    ] = 125
    brim_ear_scale: Annotated[
        float, meta("corners rounded off by less than half of this are sharp", "mm", ge=0.1, le=50)
    ] = 2
    raft_height: Annotated[float, meta("platform under the part; 0: none", "mm", ge=0, le=50)] = 0
    raft_margin: Annotated[float, meta("the raft is wider than the first layer", "mm", ge=1, le=50)] = 3
    raft_gap: Annotated[float, meta("air between raft and part", "mm", ge=0, le=1)] = 0.16
    raft_base_density: Annotated[
        float, meta("share of the raft's lowest layer that is filled", "0-1", ge=0.2, le=1)
    ] = 0.5
    spiral: Annotated[
        bool,
        meta(
            "vase: above the bottom one perimeter that climbs without a break; without infill, top and inner perimeters"
        ),
    ] = False
    pause_at: Annotated[
        tuple[Annotated[float, meta("", ge=0, le=10000)], ...],
        meta("the print pauses before it goes on above these heights over the bed", "mm"),
    ] = ()
    overrides: Annotated[
        tuple[Override, ...],
        meta("OBJECT:KEY=VALUE or LOW:HIGH:KEY=VALUE, separated by ;: settings of some objects or heights"),
    ] = ()
    speeds: Speeds = field(default_factory=Speeds)
    accelerations: Accelerations = field(default_factory=Accelerations)
