"""Every setting, written once: name, type, bounds, unit, default, meaning.

Three owners: the printer, the material, the quality. Help texts, tables and error messages are made from these lines.
The constructors do not check bounds; `printer_slicer.profile.load_profile` and `profile_with` do.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import field

from printer_slicer.firmware import FIRMWARES, Firmware, Flavour
from printer_slicer.profile.base import ANYWHERE, EACH_HEIGHT, Settings, meta
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
from printer_slicer.profile.quality import Quality
from printer_slicer.profile.speeds import Accelerations, PrinterAccelerations, PrinterSpeeds, Speeds

__all__ = [
    "PLANNER_SETTINGS",
    "Accelerations",
    "AreaPlanner",
    "CuspPlanner",
    "GeneticPlanner",
    "HeightRange",
    "Material",
    "OptimalPlanner",
    "Planner",
    "Printer",
    "PrinterAccelerations",
    "PrinterSpeeds",
    "Quality",
    "Speeds",
    "StepwisePlanner",
    "UniformPlanner",
]


class Printer(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the machine is and what it can do."""

    name: Annotated[str, meta("what people call this machine")]
    model: Annotated[str, meta("what print servers call this model; empty: its name")] = ""
    flavour: Annotated[
        Flavour,
        meta("dialect of G-code; marlin is 2, marlin_legacy 1.1"),
    ] = "marlin"
    bed_x: Annotated[float, meta("width of the bed", "mm", ge=20, le=5000)]
    bed_y: Annotated[float, meta("depth of the bed", "mm", ge=20, le=5000)]
    bed_z: Annotated[float, meta("greatest height of a part", "mm", ge=20, le=5000)]
    origin: Annotated[Literal["corner", "centre"], meta("where x = y = 0 is on the bed")] = "corner"
    bed_left: Annotated[
        float,
        meta("the left edge of the bed lies so much farther right than origin says", "mm", ge=-1000, le=1000),
    ] = 0
    bed_front: Annotated[float, meta("its front edge lies so much farther back", "mm", ge=-1000, le=1000)] = 0
    reach: Annotated[
        float, meta("the nozzle can go this far beside the bed, to prime and to wipe", "mm", ge=0, le=200)
    ] = 0
    nozzle_diameter: Annotated[float, meta("diameter of the nozzle's hole", "mm", ge=0.1, le=2)] = 0.4
    z_step: Annotated[float, meta("layer heights are multiples of this", "mm", ge=0.0005, le=0.1)] = 0.01
    z_full_step: Annotated[
        float,
        meta(
            "a full step of the z motor; variable heights are multiples of it, unless quality.layer_step says "
            "otherwise; 0: not known",
            "mm",
            ge=0,
            le=0.2,
        ),
    ] = 0
    min_layer: Annotated[float, meta("thinnest layer the machine prints", "mm", ge=0.01, le=1)] = 0.09
    max_layer: Annotated[float, meta("thickest layer the machine prints", "mm", ge=0.02, le=1.6)] = 0.32
    probe: Annotated[bool, meta("measures its bed by touching it (G29), and may keep what it measured")] = (
        False
    )
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
    acceleration: Annotated[float, meta("while printing, at most", "mm/s²", gt=0, le=100000)] = 1000
    travel_acceleration: Annotated[float, meta("while travelling", "mm/s²", gt=0, le=100000)] = 1000
    retract_acceleration: Annotated[
        float, meta("while only the extruder turns", "mm/s²", gt=0, le=100000)
    ] = 1000
    hotend_max_flow: Annotated[
        float, meta("flow limit of the hotend for PLA; 0: unknown", "mm³/s", ge=0, le=200)
    ] = 0
    pla_pressure_advance: Annotated[
        float,
        meta("pressure advance for PLA if the material sets none; 0: the firmware's own", "s", ge=0, le=5),
    ] = 0
    corner: Annotated[
        Literal["junction_deviation", "jerk", "square_corner"], meta("how the firmware finds corner speeds")
    ] = "junction_deviation"
    junction_deviation: Annotated[float, meta("for corner = junction_deviation", "mm", gt=0, le=1)] = 0.013
    jerk_xy: Annotated[float, meta("for corner = jerk", "mm/s", ge=0, le=100)] = 8
    jerk_z: Annotated[float, meta("for corner = jerk", "mm/s", ge=0, le=100)] = 0.4
    jerk_e: Annotated[float, meta("for corner = jerk", "mm/s", ge=0, le=100)] = 5
    square_corner_velocity: Annotated[float, meta("for corner = square_corner", "mm/s", ge=0, le=100)] = 5
    minimum_cruise_ratio: Annotated[float, meta("Klipper's minimum_cruise_ratio", "0-1", ge=0, lt=1)] = 0
    min_segment_time: Annotated[
        float,
        meta(
            "the time model slows shorter moves down to this, as Marlin's M205 B does; 0: none",
            "s",
            ge=0,
            le=1,
        ),
    ] = 0
    retract_length: Annotated[float, meta("filament pulled back before a travel", "mm", ge=0, le=20)] = 0.8
    retract_speed: Annotated[float, meta("speed of pulling back", "mm/s", gt=0, le=200)] = 35
    deretract_speed: Annotated[float, meta("speed of pushing forward", "mm/s", gt=0, le=200)] = 25
    retract_before_travel: Annotated[
        float, meta("shorter travels that stay inside do not retract", "mm", ge=0, le=100)
    ] = 1.5
    deretract_extra: Annotated[
        float, meta("pushed forward beyond what was pulled back; may be negative", "mm", ge=-2, le=2)
    ] = 0
    wipe_distance: Annotated[
        float,
        meta("retract while going back over this much of the last bead; 0: standing", "mm", ge=0, le=20),
    ] = 0
    retract_inside: Annotated[
        float, meta("longer travels retract inside the part, too; 0: none does", "mm", ge=0, le=10000)
    ] = 0
    z_hop: Annotated[float, meta("lift during a retracted travel", "mm", ge=0, le=5)] = 0
    z_hop_ramp: Annotated[bool, meta("lift while travelling, in a slope, not straight up")] = False
    relative_extrusion: Annotated[bool, meta("E words are differences (M83)")] = True
    firmware_retraction: Annotated[
        bool, meta("retract by G10 and G11, with the lengths and speeds above told to the firmware")
    ] = False
    progress: Annotated[bool, meta("tell the display share and time left (M73), where the flavour can")] = (
        True
    )
    baud: Annotated[int, meta("speed of the serial port", "Bd", ge=1200, le=12000000)] = 115200
    link_lines_per_second: Annotated[
        float,
        meta(
            "lines that the link brings; denser stretches are merged, then slowed down; 0: any number",
            "1/s",
            ge=0,
            le=100000,
        ),
    ] = 0
    receive_buffer: Annotated[
        int, meta("bytes the firmware's serial buffer holds", "bytes", ge=32, le=65536)
    ] = 128
    labels: Annotated[
        Literal["auto", "none", "octoprint", "m486", "exclude_object"],
        meta(
            "how several things on the plate are marked, so that one can be given up; auto: as the flavour does"
        ),
    ] = "auto"
    thumbnails: Annotated[
        tuple[Annotated[str, meta("", pattern=r"^[1-9]\d{0,3}x[1-9]\d{0,3}(/(PNG|QOI))?$")], ...],
        meta("pictures of the part in the file: width x height, PNG or QOI", "px"),
    ] = ("32x32", "300x300")
    start_gcode: Annotated[
        str, meta("G-code before the part; {expressions} are filled in, as in the others")
    ] = ""
    end_gcode: Annotated[str, meta("G-code after the part")] = ""
    before_layer_gcode: Annotated[str, meta("G-code before the nozzle goes to the next layer")] = ""
    layer_gcode: Annotated[str, meta("G-code when the nozzle has come to the height of a layer")] = ""
    tool: Annotated[int, meta("the tool that prints, where the machine has several", ge=0, le=63)] = 0
    tool_gcode: Annotated[
        str, meta("G-code that selects it, before start G-code; empty: T and its number, nothing for tool 0")
    ] = ""
    pause_gcode: Annotated[
        str, meta("G-code where the print pauses (quality.pause_at); empty: the flavour's own command")
    ] = ""
    speeds: PrinterSpeeds = field(default_factory=PrinterSpeeds)
    accelerations: PrinterAccelerations = field(default_factory=PrinterAccelerations)

    @property
    def firmware(self) -> Firmware:
        """What this printer's firmware does in its own way."""
        return FIRMWARES[self.flavour]

    @property
    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Front left and back right corner of the bed, mm."""
        x, y = (-self.bed_x / 2, -self.bed_y / 2) if self.origin == "centre" else (0.0, 0.0)
        left, front = x + self.bed_left, y + self.bed_front
        return (left, front), (left + self.bed_x, front + self.bed_y)


class Material(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is printed with, and how it wants to be treated."""

    name: Annotated[str, meta("what people call this material")]
    type: Annotated[str, meta("what print servers call it, such as PLA; empty: its name")] = ""
    cost: Annotated[float, meta("for the cost of the part", "per kg", ge=0, le=1e6)] = 0
    filament_diameter: Annotated[float, meta("diameter of the filament", "mm", ge=1, le=4)] = 1.75
    density: Annotated[float, meta("for the weight of the part", "g/cm³", gt=0, le=20)] = 1.24
    flow_ratio: Annotated[
        float, meta("all extrusion is multiplied by this", "ratio", ge=0.5, le=1.5, own=ANYWHERE)
    ] = 1
    nozzle_temperature: Annotated[float, meta("nozzle", "°C", ge=0, le=500, own=EACH_HEIGHT)] = 210
    first_layer_nozzle_temperature: Annotated[float, meta("nozzle, first layer", "°C", ge=0, le=500)] = 215
    bed_temperature: Annotated[float, meta("bed", "°C", ge=0, le=200)] = 60
    first_layer_bed_temperature: Annotated[float, meta("bed, first layer", "°C", ge=0, le=200)] = 60
    pressure_advance: Annotated[
        float,
        meta("pressure (linear) advance; 0: the printer's for PLA, else the firmware's own", "s", ge=0, le=5),
    ] = 0
    max_flow: Annotated[
        float,
        meta(
            "flow limit; printer.hotend_max_flow may lower it; 0: that of the hotend for PLA",
            "mm³/s",
            ge=0,
            le=200,
            own=ANYWHERE,
        ),
    ] = 12
    first_layer_max_flow_ratio: Annotated[
        float, meta("the same on the first layer, as a share of it", "ratio", ge=0.1, le=1)
    ] = 1
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
