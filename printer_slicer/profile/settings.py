"""All settings of printers and materials: name, type, bounds, unit, default and meaning.

Help texts, tables and error messages are generated from these definitions. The constructors do not check bounds;
`printer_slicer.profile.load_profile` and `profile_with` do.
"""

# Annotations are not postponed: msgspec needs their values, and evaluates texts one by one.
from math import pi
from typing import Annotated, Final, Literal

from msgspec import field

from printer_slicer.firmware import FIRMWARES, Firmware, Flavour
from printer_slicer.profile.base import ANYWHERE, EACH_HEIGHT, Settings, make_meta
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
from printer_slicer.profile.print_head import HeadShape, parse_head_shape
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


_CORNER: Final = r"-?\d{1,4}(\.\d+)?x-?\d{1,4}(\.\d+)?"
_POLYGON: Final = rf"^{_CORNER}( {_CORNER})+$"
_LENGTH: Final = r"\d{1,4}(\.\d+)?"
_HEAD_SHAPE: Final = rf"^{_LENGTH}: ?({_LENGTH}|{_CORNER}( {_CORNER})+)$"


_FLAT_RATIO: Final = 2.5  # nozzle diameters


class Printer(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a printer: dimensions, limits, firmware and macros."""

    name: Annotated[str, make_meta("display name of this printer")]
    model: Annotated[str, make_meta("model name sent to print servers; empty: the printer's name")] = ""
    flavour: Annotated[
        Flavour,
        make_meta("G-code dialect of the firmware; marlin is Marlin 2, marlin_legacy is Marlin 1.1"),
    ] = "marlin"
    bed_x: Annotated[float, make_meta("width of the bed", "mm", ge=20, le=5000)]
    bed_y: Annotated[float, make_meta("depth of the bed", "mm", ge=20, le=5000)]
    bed_z: Annotated[float, make_meta("maximum print height", "mm", ge=20, le=5000)]
    origin: Annotated[Literal["corner", "centre"], make_meta("position of X0 Y0 on the bed")] = "corner"
    bed_left: Annotated[
        float,
        make_meta(
            "offset in X of the bed's left edge from 0 (origin = corner) or from -bed_x / 2 (origin = "
            "centre)",
            "mm",
            ge=-1000,
            le=1000,
        ),
    ] = 0
    bed_front: Annotated[
        float,
        make_meta(
            "offset in Y of the bed's front edge from 0 (origin = corner) or from -bed_y / 2 (origin = "
            "centre)",
            "mm",
            ge=-1000,
            le=1000,
        ),
    ] = 0
    reach: Annotated[
        float,
        make_meta(
            "distance that the nozzle may move beyond the edges of the bed, for priming and wiping",
            "mm",
            ge=0,
            le=200,
        ),
    ] = 0
    bed_margin: Annotated[
        float,
        make_meta(
            "width of the strip along the edges of the bed on which no part may stand", "mm", ge=0, le=1000
        ),
    ] = 0
    excluded_areas: Annotated[
        tuple[Annotated[str, make_meta("", pattern=_POLYGON)], ...],
        make_meta(
            "areas of the bed in which nothing may be printed, such as those of clips: the corners of each polygon, or "
            "two opposite corners of a rectangle, as in 0x0 18x28",
            "mm",
        ),
    ] = ()
    head: Annotated[
        tuple[Annotated[str, make_meta("", pattern=_HEAD_SHAPE)], ...],
        make_meta(
            "shapes of the print head and the gantry that must not touch finished parts when parts are printed one "
            "after the other: for each, its height above the nozzle, then a radius, or corners relative to the "
            "nozzle, as in 0: 45, 25: -9999x-30 9999x30",
            "mm",
        ),
    ] = ("0: 65", "20: -999x-999 999x999")
    nozzle_diameter: Annotated[float, make_meta("diameter of the nozzle", "mm", ge=0.1, le=2)] = 0.4
    nozzle_flat_diameter: Annotated[
        float,
        make_meta(
            "diameter of the flat underside of the nozzle around its hole; 0: 2.5 nozzle diameters",
            "mm",
            ge=0,
            le=10,
        ),
    ] = 0
    z_step: Annotated[
        float, make_meta("step of the Z axis; all layer heights are multiples of it", "mm", ge=0.0005, le=0.1)
    ] = 0.01
    z_full_step: Annotated[
        float,
        make_meta(
            "distance of one full step of the Z motor; variable layer heights are multiples of it unless "
            "quality.layer_step is set; 0: unknown",
            "mm",
            ge=0,
            le=0.2,
        ),
    ] = 0
    min_layer: Annotated[float, make_meta("minimum layer height", "mm", ge=0.01, le=1)] = 0.09
    max_layer: Annotated[float, make_meta("maximum layer height", "mm", ge=0.02, le=1.6)] = 0.32
    probe: Annotated[bool, make_meta("whether the printer can probe its bed (G29) and store the mesh")] = (
        False
    )
    max_nozzle_temperature: Annotated[
        float, make_meta("maximum nozzle temperature", "°C", ge=100, le=500)
    ] = 275
    max_bed_temperature: Annotated[
        float, make_meta("maximum bed temperature; 0: no heated bed", "°C", ge=0, le=200)
    ] = 110
    max_speed_x: Annotated[float, make_meta("maximum speed of the X axis", "mm/s", gt=0, le=2000)] = 500
    max_speed_y: Annotated[float, make_meta("maximum speed of the Y axis", "mm/s", gt=0, le=2000)] = 500
    max_speed_z: Annotated[float, make_meta("maximum speed of the Z axis", "mm/s", gt=0, le=500)] = 10
    max_speed_e: Annotated[float, make_meta("maximum speed of the extruder", "mm/s", gt=0, le=500)] = 60
    max_acceleration_x: Annotated[
        float, make_meta("maximum acceleration of the X axis", "mm/s²", gt=0, le=100000)
    ] = 1000
    max_acceleration_y: Annotated[
        float, make_meta("maximum acceleration of the Y axis", "mm/s²", gt=0, le=100000)
    ] = 1000
    max_acceleration_z: Annotated[
        float, make_meta("maximum acceleration of the Z axis", "mm/s²", gt=0, le=10000)
    ] = 100
    max_acceleration_e: Annotated[
        float, make_meta("maximum acceleration of the extruder", "mm/s²", gt=0, le=100000)
    ] = 5000
    acceleration: Annotated[
        float, make_meta("maximum acceleration while printing", "mm/s²", gt=0, le=100000)
    ] = 1000
    travel_acceleration: Annotated[
        float, make_meta("acceleration of travel moves", "mm/s²", gt=0, le=100000)
    ] = 1000
    retract_acceleration: Annotated[
        float, make_meta("acceleration of retractions", "mm/s²", gt=0, le=100000)
    ] = 1000
    hotend_max_flow: Annotated[
        float, make_meta("maximum flow of the hotend with PLA; 0: unknown", "mm³/s", ge=0, le=200)
    ] = 0
    pla_pressure_advance: Annotated[
        float,
        make_meta(
            "pressure advance for PLA if the material sets none; 0: the firmware's own value", "s", ge=0, le=5
        ),
    ] = 0
    corner: Annotated[
        Literal["junction_deviation", "jerk", "square_corner"],
        make_meta("method by which the firmware limits the speed at corners"),
    ] = "junction_deviation"
    junction_deviation: Annotated[
        float, make_meta("junction deviation (with corner = junction_deviation)", "mm", gt=0, le=1)
    ] = 0.013
    jerk_xy: Annotated[
        float, make_meta("jerk of the X and Y axes (with corner = jerk)", "mm/s", ge=0, le=100)
    ] = 8
    jerk_z: Annotated[float, make_meta("jerk of the Z axis (with corner = jerk)", "mm/s", ge=0, le=100)] = 0.4
    jerk_e: Annotated[float, make_meta("jerk of the extruder (with corner = jerk)", "mm/s", ge=0, le=100)] = 5
    square_corner_velocity: Annotated[
        float, make_meta("square corner velocity (with corner = square_corner)", "mm/s", ge=0, le=100)
    ] = 5
    minimum_cruise_ratio: Annotated[
        float,
        make_meta(
            "minimum fraction of a move at constant speed (Klipper's minimum_cruise_ratio)", "0-1", ge=0, lt=1
        ),
    ] = 0
    min_segment_time: Annotated[
        float,
        make_meta(
            "minimum duration of a move (Marlin's M205 B), used by the time estimate; 0: none",
            "s",
            ge=0,
            le=1,
        ),
    ] = 0
    retract_length: Annotated[
        float, make_meta("length of filament retracted before a travel move", "mm", ge=0, le=20)
    ] = 0.8
    retract_speed: Annotated[float, make_meta("speed of retraction", "mm/s", gt=0, le=200)] = 35
    deretract_speed: Annotated[float, make_meta("speed of deretraction", "mm/s", gt=0, le=200)] = 25
    retract_before_travel: Annotated[
        float,
        make_meta(
            "travel moves that are shorter than this and stay inside the part do not retract",
            "mm",
            ge=0,
            le=100,
        ),
    ] = 1.5
    deretract_extra: Annotated[
        float,
        make_meta("additional length of filament in each deretraction; may be negative", "mm", ge=-2, le=2),
    ] = 0
    wipe_distance: Annotated[
        float,
        make_meta(
            "distance that the nozzle moves back along the last extrusion while it retracts (wipe); 0: no "
            "wipe",
            "mm",
            ge=0,
            le=20,
        ),
    ] = 0
    retract_inside: Annotated[
        float,
        make_meta(
            "travel moves that stay inside the part also retract if they are longer than this; 0: never",
            "mm",
            ge=0,
            le=10000,
        ),
    ] = 0
    z_hop: Annotated[
        float,
        make_meta(
            "height by which the nozzle is lifted during travel moves with retraction", "mm", ge=0, le=5
        ),
    ] = 0
    z_hop_ramp: Annotated[
        bool, make_meta("lift the nozzle gradually while it travels, instead of straight up")
    ] = False
    relative_extrusion: Annotated[bool, make_meta("use relative extrusion (M83)")] = True
    firmware_retraction: Annotated[
        bool,
        make_meta(
            "retract with G10 and G11; the G-code sets the lengths and speeds of retraction in the firmware"
        ),
    ] = False
    progress: Annotated[
        bool, make_meta("send progress and remaining time to the display (M73) if the flavour supports it")
    ] = True
    baud: Annotated[int, make_meta("baud rate of the serial port", "Bd", ge=1200, le=12000000)] = 115200
    link_lines_per_second: Annotated[
        float,
        make_meta(
            "maximum number of G-code lines per second over the serial connection; moves that need more "
            "are merged or slowed down; 0: no limit",
            "1/s",
            ge=0,
            le=100000,
        ),
    ] = 0
    receive_buffer: Annotated[
        int, make_meta("size of the firmware's serial receive buffer", "bytes", ge=32, le=65536)
    ] = 128
    labels: Annotated[
        Literal["auto", "none", "octoprint", "m486", "exclude_object"],
        make_meta(
            "method of labelling objects, so that single objects can be cancelled during the print; auto: "
            "the flavour's own method"
        ),
    ] = "auto"
    thumbnails: Annotated[
        tuple[Annotated[str, make_meta("", pattern=r"^[1-9]\d{0,3}x[1-9]\d{0,3}(/(PNG|QOI))?$")], ...],
        make_meta(
            "sizes of the preview pictures in the G-code: WIDTHxHEIGHT, WIDTHxHEIGHT/PNG or WIDTHxHEIGHT/QOI",
            "px",
        ),
    ] = ("32x32", "300x300")
    start_gcode: Annotated[
        str,
        make_meta("G-code at the start of the print; {expressions} are evaluated, as in all G-code settings"),
    ] = ""
    end_gcode: Annotated[str, make_meta("G-code at the end of the print")] = ""
    before_layer_gcode: Annotated[str, make_meta("G-code before the nozzle moves to the next layer")] = ""
    layer_gcode: Annotated[str, make_meta("G-code after the nozzle has moved to the next layer")] = ""
    tool: Annotated[
        int, make_meta("number of the tool to print with, on printers with several tools", ge=0, le=63)
    ] = 0
    tool_gcode: Annotated[
        str,
        make_meta(
            "G-code that selects the tool before the start G-code; empty: T with the tool number, or "
            "nothing for tool 0"
        ),
    ] = ""
    pause_gcode: Annotated[
        str,
        make_meta(
            "G-code that pauses the print at the heights in quality.pause_at; empty: the flavour's own "
            "command"
        ),
    ] = ""
    speeds: PrinterSpeeds = field(default_factory=PrinterSpeeds)
    accelerations: PrinterAccelerations = field(default_factory=PrinterAccelerations)

    @property
    def firmware(self) -> Firmware:
        """Properties of the printer's firmware."""
        return FIRMWARES[self.flavour]

    @property
    def nozzle_flat(self) -> float:
        """Diameter of the flat underside of the nozzle, mm."""
        return self.nozzle_flat_diameter or _FLAT_RATIO * self.nozzle_diameter

    @property
    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Front left and rear right corner of the bed, mm."""
        x, y = (-self.bed_x / 2, -self.bed_y / 2) if self.origin == "centre" else (0.0, 0.0)
        left, front = x + self.bed_left, y + self.bed_front
        return (left, front), (left + self.bed_x, front + self.bed_y)

    @property
    def free_corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Front left and rear right corner of the area on which parts may stand, mm."""
        (left, front), (right, back) = self.corners
        margin = self.bed_margin
        return (left + margin, front + margin), (right - margin, back - margin)

    @property
    def print_volume(self) -> tuple[float, float, float]:
        """Size in x, y and z of the space in which parts may stand, mm."""
        (left, front), (right, back) = self.free_corners
        return right - left, back - front, self.bed_z

    @property
    def excluded_polygons(self) -> tuple[tuple[tuple[float, float], ...], ...]:
        """The corners of each of the `excluded_areas`, mm; rectangles have four."""
        polygons = []
        for text in self.excluded_areas:
            corners = [tuple(map(float, corner.split("x"))) for corner in text.split()]
            points = [(x, y) for x, y in corners]
            if len(points) == 2:
                (left, front), (right, back) = points
                points = [(left, front), (right, front), (right, back), (left, back)]
            polygons.append(tuple(points))
        return tuple(polygons)

    @property
    def head_shapes(self) -> tuple[HeadShape, ...]:
        """The shapes in `head`, the lowest first."""
        return tuple(sorted(map(parse_head_shape, self.head)))


class Material(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a material: temperatures, flow and cooling."""

    name: Annotated[str, make_meta("display name of this material")]
    type: Annotated[
        str, make_meta("material type sent to print servers, such as PLA; empty: the material's name")
    ] = ""
    cost: Annotated[
        float, make_meta("price of the material, for the cost of the part", "per kg", ge=0, le=1e6)
    ] = 0
    filament_diameter: Annotated[float, make_meta("diameter of the filament", "mm", ge=1, le=4)] = 1.75
    density: Annotated[
        float, make_meta("density of the material, for the weight of the part", "g/cm³", gt=0, le=20)
    ] = 1.24
    flow_ratio: Annotated[
        float, make_meta("flow multiplier for all extrusions", "ratio", ge=0.5, le=1.5, own=ANYWHERE)
    ] = 1
    nozzle_temperature: Annotated[
        float, make_meta("nozzle temperature", "°C", ge=0, le=500, own=EACH_HEIGHT)
    ] = 210
    first_layer_nozzle_temperature: Annotated[
        float, make_meta("nozzle temperature on the first layer", "°C", ge=0, le=500)
    ] = 215
    bed_temperature: Annotated[float, make_meta("bed temperature", "°C", ge=0, le=200)] = 60
    first_layer_bed_temperature: Annotated[
        float, make_meta("bed temperature on the first layer", "°C", ge=0, le=200)
    ] = 60
    pressure_advance: Annotated[
        float,
        make_meta(
            "pressure advance (linear advance); 0: printer.pla_pressure_advance for PLA, the firmware's "
            "own value for other materials",
            "s",
            ge=0,
            le=5,
        ),
    ] = 0
    max_flow: Annotated[
        float,
        make_meta(
            "maximum flow of the material; printer.hotend_max_flow limits the flow too; 0: "
            "printer.hotend_max_flow, or 12 if that is 0",
            "mm³/s",
            ge=0,
            le=200,
            own=ANYWHERE,
        ),
    ] = 12
    first_layer_max_flow_ratio: Annotated[
        float, make_meta("maximum flow on the first layer, as a fraction of max_flow", "ratio", ge=0.1, le=1)
    ] = 1
    fan_ratio: Annotated[
        float, make_meta("part fan speed on layers that take fan_layer_time or longer", "0-1", ge=0, le=1)
    ] = 0.5
    fan_ratio_max: Annotated[
        float, make_meta("part fan speed on layers that take min_layer_time or less", "0-1", ge=0, le=1)
    ] = 1
    fan_ratio_bridge: Annotated[float, make_meta("part fan speed on bridges", "0-1", ge=0, le=1)] = 1
    fan_overhang_75_ratio: Annotated[
        float,
        make_meta(
            "part fan speed on perimeters with 75 % of their width supported; 0: as on the rest of the "
            "layer, 1: as on bridges",
            "0-1",
            ge=0,
            le=1,
        ),
    ] = 0
    fan_overhang_50_ratio: Annotated[
        float,
        make_meta(
            "part fan speed on perimeters with 50 % of their width supported; 0: as on the rest of the "
            "layer, 1: as on bridges",
            "0-1",
            ge=0,
            le=1,
        ),
    ] = 0.5
    fan_overhang_25_ratio: Annotated[
        float,
        make_meta(
            "part fan speed on perimeters with 25 % of their width supported; 0: as on the rest of the "
            "layer, 1: as on bridges",
            "0-1",
            ge=0,
            le=1,
        ),
    ] = 1
    fan_overhang_0_ratio: Annotated[
        float,
        make_meta(
            "part fan speed on unsupported perimeters; 0: as on the rest of the layer, 1: as on bridges",
            "0-1",
            ge=0,
            le=1,
        ),
    ] = 1
    support_fan: Annotated[float, make_meta("part fan speed on support interfaces", "0-1", ge=0, le=1)] = 1
    fan_off_below: Annotated[
        float, make_meta("height below which the part fan is off", "mm", ge=0, le=100)
    ] = 0.3
    fan_full_above: Annotated[
        float,
        make_meta(
            "height above which the part fan runs at its normal speed; from fan_off_below up to it, the "
            "fan speed rises",
            "mm",
            ge=0,
            le=100,
        ),
    ] = 0.8
    fan_layer_time: Annotated[
        float, make_meta("layers that take less time than this get a higher fan speed", "s", ge=0, le=600)
    ] = 30
    min_layer_time: Annotated[
        float,
        make_meta("minimum time for a layer; layers that take less time are slowed down", "s", ge=0, le=600),
    ] = 8
    min_speed: Annotated[
        float,
        make_meta("lowest speed to which min_layer_time may slow down extrusions", "mm/s", ge=1, le=100),
    ] = 12

    @property
    def filament_area(self) -> float:
        """Cross-section of the filament, mm²."""
        return pi * self.filament_diameter**2 / 4
