"""Every setting, written once: name, type, bounds, unit, default, meaning.

Three owners: the printer, the material, the quality. Help texts, tables and error messages are made from these lines.
The constructors do not check bounds; `printer_slicer.profile.load_profile` and `profile_with` do.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import field

from printer_slicer.profile.base import Settings, meta
from printer_slicer.profile.planners import (
    PLANNER_SETTINGS,
    AreaPlanner,
    CuspPlanner,
    GeneticPlanner,
    HeightRange,
    OptimalPlanner,
    Planner,
    StepwisePlanner,
    UniformPlanner,
)

__all__ = [
    "HIGHEST_BEAD",
    "PLANNER_SETTINGS",
    "AreaPlanner",
    "CuspPlanner",
    "GeneticPlanner",
    "HeightRange",
    "Material",
    "OptimalPlanner",
    "Planner",
    "Printer",
    "Profile",
    "Quality",
    "Speeds",
    "StepwisePlanner",
    "UniformPlanner",
]

HIGHEST_BEAD = 0.8  # nozzle diameters; higher beads are not pressed onto the layer below


class Printer(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the machine is and what it can do."""

    name: Annotated[str, meta("what people call this machine")]
    flavour: Annotated[Literal["marlin", "klipper"], meta("dialect of G-code")] = "marlin"
    bed_x: Annotated[float, meta("width of the bed", "mm", ge=20, le=5000)]
    bed_y: Annotated[float, meta("depth of the bed", "mm", ge=20, le=5000)]
    bed_z: Annotated[float, meta("greatest height of a part", "mm", ge=20, le=5000)]
    origin: Annotated[Literal["corner", "centre"], meta("where x = y = 0 is on the bed")] = "corner"
    nozzle_diameter: Annotated[float, meta("diameter of the nozzle's hole", "mm", ge=0.1, le=2)] = 0.4
    z_step: Annotated[float, meta("layer heights are multiples of this", "mm", ge=0.0005, le=0.1)] = 0.01
    min_layer: Annotated[float, meta("thinnest layer the machine prints", "mm", ge=0.01, le=1)] = 0.09
    max_layer: Annotated[float, meta("thickest layer the machine prints", "mm", ge=0.02, le=1.6)] = 0.32
    max_nozzle_temperature: Annotated[
        float, meta("never heat the nozzle over this", "°C", ge=100, le=500)
    ] = 275
    max_bed_temperature: Annotated[
        float, meta("never heat the bed over this; 0: not heated", "°C", ge=0, le=200)
    ] = 110
    max_speed_x: Annotated[float, meta("limit of the x axis", "mm/s", gt=0, le=2000)] = 500
    max_speed_y: Annotated[float, meta("limit of the y axis", "mm/s", gt=0, le=2000)] = 500
    max_speed_z: Annotated[float, meta("limit of the z axis", "mm/s", gt=0, le=500)] = 10
    max_speed_e: Annotated[float, meta("limit of the extruder", "mm/s", gt=0, le=500)] = 60
    max_acceleration_x: Annotated[float, meta("limit of the x axis", "mm/s²", gt=0, le=100000)] = 1000
    max_acceleration_y: Annotated[float, meta("limit of the y axis", "mm/s²", gt=0, le=100000)] = 1000
    max_acceleration_z: Annotated[float, meta("limit of the z axis", "mm/s²", gt=0, le=10000)] = 100
    max_acceleration_e: Annotated[float, meta("limit of the extruder", "mm/s²", gt=0, le=100000)] = 5000
    acceleration: Annotated[float, meta("while printing", "mm/s²", gt=0, le=100000)] = 1000
    travel_acceleration: Annotated[float, meta("while travelling", "mm/s²", gt=0, le=100000)] = 1000
    retract_acceleration: Annotated[
        float, meta("while only the extruder turns", "mm/s²", gt=0, le=100000)
    ] = 1000
    corner: Annotated[
        Literal["junction_deviation", "jerk", "square_corner"], meta("how the firmware finds corner speeds")
    ] = "junction_deviation"
    junction_deviation: Annotated[float, meta("for corner = junction_deviation", "mm", gt=0, le=1)] = 0.013
    jerk_xy: Annotated[float, meta("for corner = jerk", "mm/s", ge=0, le=100)] = 8
    jerk_z: Annotated[float, meta("for corner = jerk", "mm/s", ge=0, le=100)] = 0.4
    jerk_e: Annotated[float, meta("for corner = jerk", "mm/s", ge=0, le=100)] = 5
    square_corner_velocity: Annotated[float, meta("for corner = square_corner", "mm/s", ge=0, le=100)] = 5
    minimum_cruise_ratio: Annotated[float, meta("Klipper's minimum_cruise_ratio", "0-1", ge=0, lt=1)] = 0
    retract_length: Annotated[float, meta("filament pulled back before a travel", "mm", ge=0, le=20)] = 0.8
    retract_speed: Annotated[float, meta("speed of pulling back", "mm/s", gt=0, le=200)] = 35
    deretract_speed: Annotated[float, meta("speed of pushing forward", "mm/s", gt=0, le=200)] = 25
    retract_before_travel: Annotated[float, meta("shorter travels do not retract", "mm", ge=0, le=100)] = 1.5
    z_hop: Annotated[float, meta("lift during a retracted travel", "mm", ge=0, le=5)] = 0
    relative_extrusion: Annotated[bool, meta("E words are differences (M83)")] = True
    baud: Annotated[int, meta("speed of the serial port", "Bd", ge=1200, le=12000000)] = 115200
    receive_buffer: Annotated[
        int, meta("bytes the firmware's serial buffer holds", "bytes", ge=32, le=65536)
    ] = 128
    start_gcode: Annotated[str, meta("G-code before the part; {placeholders} are filled in")] = ""
    end_gcode: Annotated[str, meta("G-code after the part; {placeholders} are filled in")] = ""

    @property
    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Front left and back right corner of the bed, mm."""
        left, front = (-self.bed_x / 2, -self.bed_y / 2) if self.origin == "centre" else (0.0, 0.0)
        return (left, front), (left + self.bed_x, front + self.bed_y)


class Material(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is printed with, and how it wants to be treated."""

    name: Annotated[str, meta("what people call this material")]
    filament_diameter: Annotated[float, meta("diameter of the filament", "mm", ge=1, le=4)] = 1.75
    density: Annotated[float, meta("for the weight of the part", "g/cm³", gt=0, le=20)] = 1.24
    flow_ratio: Annotated[float, meta("all extrusion is multiplied by this", "ratio", ge=0.5, le=1.5)] = 1
    nozzle_temperature: Annotated[float, meta("nozzle", "°C", ge=0, le=500)] = 210
    first_layer_nozzle_temperature: Annotated[float, meta("nozzle, first layer", "°C", ge=0, le=500)] = 215
    bed_temperature: Annotated[float, meta("bed", "°C", ge=0, le=200)] = 60
    first_layer_bed_temperature: Annotated[float, meta("bed, first layer", "°C", ge=0, le=200)] = 60
    max_flow: Annotated[float, meta("most plastic the nozzle melts", "mm³/s", gt=0, le=200)] = 12
    fan_ratio: Annotated[float, meta("part fan when layers take long", "0-1", ge=0, le=1)] = 0.5
    fan_ratio_max: Annotated[
        float, meta("part fan when a layer takes the minimum time", "0-1", ge=0, le=1)
    ] = 1
    fan_ratio_bridge: Annotated[float, meta("part fan on bridges", "0-1", ge=0, le=1)] = 1
    fan_overhang_75_ratio: Annotated[
        float,
        meta(
            "fan on perimeters with 75 % of their bead carried, from the layer's to that on bridges",
            "0-1",
            ge=0,
            le=1,
        ),
    ] = 0
    fan_overhang_50_ratio: Annotated[float, meta("the same with 50 % of it", "0-1", ge=0, le=1)] = 0.5
    fan_overhang_25_ratio: Annotated[float, meta("the same with 25 % of it", "0-1", ge=0, le=1)] = 1
    fan_overhang_0_ratio: Annotated[float, meta("the same over nothing but air", "0-1", ge=0, le=1)] = 1
    fan_off_below: Annotated[float, meta("no fan below this z", "mm", ge=0, le=100)] = 0.3
    fan_full_above: Annotated[float, meta("the fan has ramped up at this z", "mm", ge=0, le=100)] = 0.8
    fan_layer_time: Annotated[float, meta("layers quicker than this get more fan", "s", ge=0, le=600)] = 30
    min_layer_time: Annotated[float, meta("slow down until a layer takes this long", "s", ge=0, le=600)] = 8
    min_speed: Annotated[float, meta("but never print slower than this", "mm/s", ge=1, le=100)] = 12


class Speeds(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How fast each role is printed; the material's flow limit may lower any of them."""

    outer_perimeter: Annotated[float, meta("outer perimeters", "mm/s", gt=0, le=1000)] = 35
    inner_perimeter: Annotated[float, meta("inner perimeters", "mm/s", gt=0, le=1000)] = 50
    sparse: Annotated[float, meta("sparse infill", "mm/s", gt=0, le=1000)] = 70
    solid: Annotated[float, meta("solid infill and bottom skins", "mm/s", gt=0, le=1000)] = 60
    top_skin: Annotated[float, meta("top skins", "mm/s", gt=0, le=1000)] = 40
    ironing: Annotated[float, meta("ironing", "mm/s", gt=0, le=1000)] = 15
    bridge: Annotated[float, meta("bridges", "mm/s", gt=0, le=1000)] = 30
    internal_bridge: Annotated[
        float, meta("the first solid layer over sparse infill", "mm/s", gt=0, le=1000)
    ] = 40
    overhang_75_ratio: Annotated[
        float,
        meta("perimeters with 75 % of their bead over the layer below, of their speed", "0-1", gt=0, le=1),
    ] = 0.9
    overhang_50_ratio: Annotated[float, meta("the same with 50 % of it", "0-1", gt=0, le=1)] = 0.7
    overhang_25_ratio: Annotated[float, meta("the same with 25 % of it", "0-1", gt=0, le=1)] = 0.55
    overhang_0_ratio: Annotated[
        float, meta("the same over nothing but air, and no faster than bridges", "0-1", gt=0, le=1)
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
    travel: Annotated[float, meta("travels", "mm/s", gt=0, le=2000)] = 150


class Quality(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the part shall come out."""

    name: Annotated[str, meta("what people call this quality")]
    planner: Planner = field(default_factory=OptimalPlanner)
    layer_height: Annotated[float, meta("height of uniform layers", "mm", ge=0.01, le=1.6)] = 0.2
    first_layer_height: Annotated[float, meta("0: as the planner has it", "mm", ge=0, le=1.6)] = 0
    first_layer_flow: Annotated[
        float, meta("extrusion of the layer on the bed is multiplied by this", "ratio", ge=0.5, le=1.5)
    ] = 1
    thinnest_layer: Annotated[
        float, meta("lower end of variable heights; 0: the printer's", "mm", ge=0, le=1.6)
    ] = 0
    thickest_layer: Annotated[
        float, meta("upper end of variable heights; 0: the printer's", "mm", ge=0, le=1.6)
    ] = 0
    layer_step: Annotated[
        float,
        meta("variable heights are this far apart; 0: 0.01 mm, or z_step if that is more", "mm", ge=0, le=1),
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
    xy_compensation: Annotated[float, meta("outer outlines are moved outward by this", "mm", ge=-1, le=1)] = 0
    hole_compensation: Annotated[float, meta("holes are widened by this on all sides", "mm", ge=-1, le=1)] = 0
    elephant_foot: Annotated[
        float, meta("inset of the first layer, which the bed squeezes", "mm", ge=0, le=1)
    ] = 0
    elephant_foot_height: Annotated[
        float, meta("height over which that inset fades away; 0: the first layer only", "mm", ge=0, le=5)
    ] = 0
    extrusion_width: Annotated[
        float, meta("width of a bead; 0: 1.125 nozzle diameters", "mm", ge=0, le=4)
    ] = 0
    first_layer_width: Annotated[
        float, meta("width of a bead on the bed; 0: that of the others", "mm", ge=0, le=4)
    ] = 0
    perimeters: Annotated[int, meta("perimeters around each section", ge=0, le=100)] = 2
    varying_walls: Annotated[
        bool, meta("fill places too narrow for all perimeters with beads of varying width; false is quicker")
    ] = True
    min_bead_width: Annotated[
        float, meta("narrowest bead where walls are thin; 0: 0.85 nozzle diameters", "mm", ge=0, le=4)
    ] = 0
    max_bead_width: Annotated[
        float, meta("widest bead where walls are thin; 0: 1.65 nozzle diameters", "mm", ge=0, le=4)
    ] = 0
    min_feature: Annotated[
        float, meta("thinner walls are left out; 0: 0.25 nozzle diameters", "mm", ge=0, le=4)
    ] = 0
    single_top_perimeter: Annotated[
        bool, meta("only the outer perimeter where nothing lies above; the rest becomes top skin")
    ] = False
    extra_perimeters: Annotated[bool, meta("more perimeters where the edge of a layer hangs over air")] = (
        False
    )
    outer_perimeter_first: Annotated[bool, meta("print the outer perimeter before the inner ones")] = False
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
    bottom_thickness: Annotated[float, meta("solid over a surface that looks down", "mm", ge=0, le=1000)] = (
        0.6
    )
    top_thickness: Annotated[float, meta("solid under a surface that looks up", "mm", ge=0, le=1000)] = 0.8
    min_sparse_area: Annotated[
        float,
        meta(
            "smaller areas, and strips under three beads wide, are not sparse but solid; 0: none",
            "mm²",
            ge=0,
            le=1e6,
        ),
    ] = 15
    ironing: Annotated[bool, meta("smooth top skins with the nozzle, in lines close together")] = False
    ironing_spacing: Annotated[float, meta("from line to line of ironing", "mm", ge=0.1, le=1)] = 0.1
    ironing_flow_ratio: Annotated[
        float, meta("plastic in ironing, as a share of a full layer", "ratio", ge=0.01, le=0.3)
    ] = 0.15
    thick_bridges: Annotated[
        bool,
        meta("bridges are round threads as thick as the nozzle, not pressed flat to the layer's height"),
    ] = True
    bridge_flow_ratio: Annotated[float, meta("plastic in bridges", "ratio", ge=0.3, le=2)] = 1
    internal_bridge_flow_ratio: Annotated[
        float, meta("plastic in the first solid layer over sparse infill", "ratio", ge=0.5, le=2)
    ] = 1
    bridge_anchor: Annotated[
        float, meta("bridges reach this far onto what carries them", "mm", ge=0, le=20)
    ] = 1.5
    infill: Annotated[
        Literal[
            "rectilinear", "grid", "triangles", "cubic", "gyroid", "honeycomb", "concentric", "lightning"
        ],
        meta("pattern of the sparse infill"),
    ] = "grid"
    infill_density: Annotated[float, meta("share of the inside that is filled", "0-1", ge=0, le=1)] = 0.15
    infill_angle_deg: Annotated[float, meta("direction of the infill", "degrees", ge=-360, le=360)] = 45
    infill_overlap: Annotated[
        float, meta("infill reaches into the perimeter by this share of a bead", "0-1", ge=0, le=0.5)
    ] = 0.09
    sparse_overlap: Annotated[
        float, meta("sparse infill reaches into the perimeter by this share of a bead", "0-1", ge=0, le=0.5)
    ] = 0.15
    infill_anchor: Annotated[
        float, meta("hook along the wall where no neighbouring line is near; 0: none", "mm", ge=0, le=50)
    ] = 2.5
    infill_anchor_max: Annotated[
        float,
        meta("lines are joined along the wall where the way is no longer; 0: never", "mm", ge=0, le=1000),
    ] = 12
    sparse_every: Annotated[
        float,
        meta(
            "sparse infill of several layers in beads up to this high, at most 0.8 nozzles; 0: layer by layer",
            "mm",
            ge=0,
            le=2,
        ),
    ] = 0
    inner_perimeters_every: Annotated[
        float,
        meta(
            "inner perimeters of several layers in beads up to this high where the section does not change; 0: "
            "layer by layer",
            "mm",
            ge=0,
            le=2,
        ),
    ] = 0
    lightning_angle_deg: Annotated[
        float, meta("branches of lightning lean out by no more", "degrees", ge=5, le=80)
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
    speeds: Speeds = field(default_factory=Speeds)


class Profile(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything that decides how a part becomes G-code."""

    printer: Printer
    material: Material
    quality: Quality

    @property
    def dials(self) -> OptimalPlanner:
        """The dials of the planner `optimal`; as they usually are where another planner is chosen."""
        planner = self.quality.planner
        return planner if isinstance(planner, OptimalPlanner) else OptimalPlanner()

    @property
    def extrusion_width(self) -> float:
        """Width of a bead, mm, with the default filled in."""
        return self.quality.extrusion_width or 1.125 * self.printer.nozzle_diameter

    @property
    def width_on_bed(self) -> float:
        """Width of a bead on the bed, mm, with the default filled in."""
        return self.quality.first_layer_width or self.extrusion_width

    @property
    def width_of_first_layer(self) -> float:
        """Width of a bead in the part's first layer, mm: that on the bed, unless there is a raft between."""
        return self.extrusion_width if self.quality.raft_height else self.width_on_bed

    @property
    def bead_widths(self) -> tuple[float, float]:
        """Narrowest and widest bead in narrow places, mm, with the defaults filled in."""
        quality, nozzle, width = self.quality, self.printer.nozzle_diameter, self.extrusion_width
        narrowest = quality.min_bead_width or min(0.85 * nozzle, width)
        return narrowest, quality.max_bead_width or max(1.65 * nozzle, width)

    @property
    def highest_bead(self) -> float:
        """Highest bead that the nozzle presses down and that is no higher than wide, mm."""
        return min(HIGHEST_BEAD * self.printer.nozzle_diameter, self.extrusion_width)

    @property
    def thinnest_feature(self) -> float:
        """Thinnest wall that is printed, mm, with the default filled in."""
        return self.quality.min_feature or 0.25 * self.printer.nozzle_diameter

    @property
    def thinnest(self) -> float:
        """Thinnest layer a planner may choose, mm."""
        return min(self.quality.layer_heights, default=self.quality.thinnest_layer or self.printer.min_layer)

    @property
    def thickest(self) -> float:
        """Thickest layer a planner may choose, mm."""
        return max(self.quality.layer_heights, default=self.quality.thickest_layer or self.printer.max_layer)
