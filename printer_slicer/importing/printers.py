"""Convert printers of other slicers."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from printer_slicer.firmware import FIRMWARES
from printer_slicer.importing.bed_shapes import (
    BedRectangle,
    find_excluded_areas,
    find_head_shapes,
    find_rectangle,
)
from printer_slicer.importing.conversion import ONE_TOOL, Conversion, find_highest_layer
from printer_slicer.importing.machine_gcode import convert_macros
from printer_slicer.importing.presets import Preset, parse_quantity
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.profile.profile import HIGHEST_BEAD

__all__ = ["CompanionRanges", "convert_printer"]

_FLAVOURS: Final = {
    firmware.prusaslicer_name: name for name, firmware in FIRMWARES.items() if firmware.prusaslicer_name
}
_NEAR_FLAVOURS: Final = {
    "reprap": "marlin_legacy",
    "sprinter": "marlin_legacy",
    "teacup": "marlin_legacy",
    "lerdge": "marlin_legacy",
}
_KLIPPER_MACRO: Final = re.compile(
    r"(?m)^[ \t]*([A-Za-z]+_[A-Za-z_]*[A-Za-z])(?=[ \t]+[A-Za-z_]+=|[ \t]*(?:;|$))"
)
_MAX_LAYER_RATIO: Final = 0.75  # nozzle diameters: maximum layer height if the source does not set one
_Z_STEP: Final = 0.0025  # mm: a screw with a lead of 8 mm, 200 steps per turn, 16 microsteps
_USUAL_TEMPERATURE_LIMITS: Final = {"nozzle": 275.0, "bed": 110.0}


class CompanionRanges(NamedTuple):
    """Ranges of the settings of materials and qualities for a printer; 0: unknown.

    Attributes:
        nozzle, bed: highest temperatures, °C.
        thinnest, thickest: layer heights, including first layers only in `thinnest`, mm.
        thickest_first: greatest height of a first layer, mm.
    """

    nozzle: float = 0.0
    bed: float = 0.0
    thinnest: float = 0.0
    thickest: float = 0.0
    thickest_first: float = 0.0


def convert_printer(preset: Preset, companions: CompanionRanges) -> ImportedProfile:
    """Convert a printer.

    Args:
        preset: its settings under PrusaSlicer's names.
        companions: ranges of the settings of its materials and qualities.

    Raises:
        ProfileError: this program cannot drive the machine; with place and remedy.
    """
    conversion = Conversion(preset)
    _check_kind(conversion)
    conversion.put("name", preset.name)
    if preset.read_text("printer_model"):
        conversion.put("model", preset.read_text("printer_model"), "printer_model")
    _convert_flavour(conversion)
    bed = _convert_bed(conversion)
    nozzle = _convert_nozzle(conversion)
    _convert_layer_limits(conversion, nozzle, companions)
    _set_temperature_limits(conversion, companions)
    _convert_machine_limits(conversion)
    _convert_corner_method(conversion)
    _convert_retraction(conversion)
    _convert_file_settings(conversion)
    convert_macros(conversion, bed)
    return conversion.finish(_explain_unsupported)


def _check_kind(conversion: Conversion) -> None:
    """Reject resin printers, and printers whose E values are in mm³."""
    preset = conversion.preset
    conversion.mark_used(["printer_technology"])
    if preset.read_text("printer_technology").upper() not in ("FFF", ""):
        raise conversion.make_error(
            "printer_technology", "this is a resin printer", "Choose a filament printer"
        )
    if preset.is_on("use_volumetric_e"):
        raise conversion.make_error(
            "use_volumetric_e",
            "E in mm³ is not supported",
            "Set the firmware to mm of filament (M200 D0) and export the printer with use_volumetric_e = 0",
        )


def _convert_flavour(conversion: Conversion) -> None:
    """Convert the G-code flavour; recognize Prusa's firmware and Klipper by notes and macros."""
    preset = conversion.preset
    word = preset.read_text("gcode_flavor").strip().lower()
    notes = preset.read_text("printer_notes")
    macro = _find_klipper_macro(preset)
    if macro and word in ("marlin", "marlin2", *_NEAR_FLAVOURS):
        how = f"{word} in the source, but {macro} is a Klipper macro"
        conversion.put("flavour", "klipper", "gcode_flavor", how)
        conversion.warn(
            "gcode_flavor", f"{how}: imported as Klipper; set flavour if the firmware is different"
        )
    elif word == "marlin" and "PRINTER_VENDOR_PRUSA3D" in notes:
        conversion.put(
            "flavour", "prusa", ("gcode_flavor", "printer_notes"), "a Prusa machine, according to its notes"
        )
    elif word == "marlin" and re.search(r"(?m)^\s*G80\b", preset.read_text("start_gcode")):
        how = "its start G-code measures the bed with G80, as Prusa machines do"
        conversion.put("flavour", "prusa", "gcode_flavor", how)
    elif word in _FLAVOURS:
        how = "Marlin 1.1 and older; set flavour to marlin for Marlin 2" if word == "marlin" else ""
        conversion.put("flavour", _FLAVOURS[word], "gcode_flavor", how)
    elif word in _NEAR_FLAVOURS:
        conversion.put(
            "flavour", _NEAR_FLAVOURS[word], "gcode_flavor", f"{word} is nearest to Marlin 1.1", differs=True
        )
        conversion.warn(
            "gcode_flavor",
            f"{word}: check that the firmware supports M201, M203, M204 and M205 of Marlin",
        )
    else:
        raise conversion.make_error(
            "gcode_flavor", f"unknown flavour {word!r}", f"Use one of {', '.join(_FLAVOURS)}"
        )


def _find_klipper_macro(preset: Preset) -> str:
    """Return the first Klipper macro in the start and end G-code; empty if there is none."""
    for name in ("start_gcode", "end_gcode"):
        found = _KLIPPER_MACRO.search(preset.read_text(name))
        if found:
            return found[1]
    return ""


def _convert_bed(conversion: Conversion) -> BedRectangle:
    """Convert the size and position of the bed, and the maximum print height."""
    bed = find_rectangle(conversion)
    (left, front), (right, back) = bed.low, bed.high
    conversion.put("bed_x", right - left, "bed_shape", bed.how, differs=bool(bed.how))
    conversion.put("bed_y", back - front, "bed_shape", bed.how, differs=bool(bed.how))
    is_centred = abs(left + right) < 1e-6 and abs(front + back) < 1e-6
    conversion.put("origin", "centre" if is_centred else "corner", "bed_shape")
    for name, value in (("bed_left", left), ("bed_front", front)):
        if value and not is_centred:
            conversion.put(name, value, "bed_shape")
        else:
            conversion.switch_off(name, 0, "bed_shape")
    if conversion.preset.has("bed_exclude_area"):
        conversion.put("excluded_areas", find_excluded_areas(conversion), "bed_exclude_area")
    conversion.copy_number("bed_z", "max_print_height")
    if head := find_head_shapes(conversion):
        names = ("radius", "polygon", "height", "height_to_rod", "height_to_lid")
        conversion.put("head", head, [f"extruder_clearance_{name}" for name in names])
    if conversion.preset.read_number("z_offset"):
        conversion.warn(
            "z_offset",
            f"{conversion.preset.read_raw('z_offset')} mm is not imported: set it in the firmware (M206, M851)",
        )
    return bed


def _convert_nozzle(conversion: Conversion) -> float:
    """Convert the nozzle diameter of the first extruder, mm, and return it."""
    several = len([word for word in conversion.preset.read_items("nozzle_diameter") if word]) - 1
    how = f"the first extruder; {several} more are not imported" if several else ""
    return conversion.copy_number("nozzle_diameter", "nozzle_diameter", how, differs=several > 0)


def _convert_layer_limits(conversion: Conversion, nozzle: float, companions: CompanionRanges) -> None:
    """Convert the limits of layer heights; the source applies them only to variable heights, this program to all."""
    for ours, theirs, usual in (
        ("min_layer", "min_layer_height", 0.0),
        ("max_layer", "max_layer_height", _MAX_LAYER_RATIO),
    ):
        found = conversion.read_quantity(theirs)
        if found.value == 0 and usual:
            conversion.put(ours, usual * nozzle, theirs, f"0 means {usual:g} nozzle diameters")
        elif found.is_percent:
            conversion.put(ours, found.resolve(nozzle), theirs, "percentage of the nozzle diameter")
        else:
            conversion.clamp(ours, found.value, 0.01, 1.6, theirs)
    least, most = conversion.values["min_layer"], conversion.values["max_layer"]
    if least > most:
        raise conversion.make_error(
            "min_layer_height",
            f"{least:g} mm is more than max_layer_height, {most:g} mm",
            "Set both layer heights of the extruder in the other slicer",
        )
    _widen_layer_limits(conversion, nozzle, companions)
    if conversion.preset.has("z_step"):
        conversion.copy_number("z_step", "z_step")
    else:
        conversion.put("z_step", _Z_STEP, how="not in the source: 400 steps/mm, as with most lead screws")


def _widen_layer_limits(conversion: Conversion, nozzle: float, companions: CompanionRanges) -> None:
    """Widen the limits of layer heights so that they include the layer heights of the print settings."""
    if 0 < companions.thinnest < conversion.values["min_layer"]:
        conversion.put(
            "min_layer",
            companions.thinnest,
            "min_layer_height",
            "the layer height of its print settings",
        )
    highest = HIGHEST_BEAD * nozzle + 1e-9
    thickest = companions.thickest if companions.thickest <= highest else 0.0
    first = min(companions.thickest_first, find_highest_layer(nozzle))  # as the import of qualities lowers it
    if conversion.values["max_layer"] < max(thickest, first):
        what = "greatest layer height" if thickest >= first else "first layer height"
        conversion.put(
            "max_layer", max(thickest, first), "max_layer_height", f"the {what} of its print settings"
        )


def _set_temperature_limits(conversion: Conversion, companions: CompanionRanges) -> None:
    """Set the temperature limits, which printers of other slicers do not have."""
    for heater, usual in _USUAL_TEMPERATURE_LIMITS.items():
        asked = companions.nozzle if heater == "nozzle" else companions.bed
        how = (
            f"not in the source: {usual:g} °C"
            if asked <= usual
            else "not in the source: the highest of its materials"
        )
        conversion.put(f"max_{heater}_temperature", max(usual, asked), how=how)


def _convert_machine_limits(conversion: Conversion) -> None:
    """Convert limits of speeds and accelerations; if there are two values, the first one is for normal mode."""
    for axis in "xyze":
        conversion.copy_number(f"max_speed_{axis}", f"machine_max_feedrate_{axis}")
        conversion.copy_number(f"max_acceleration_{axis}", f"machine_max_acceleration_{axis}")
    conversion.copy_number("acceleration", "machine_max_acceleration_extruding")
    _convert_travel_acceleration(conversion)
    conversion.copy_number("retract_acceleration", "machine_max_acceleration_retracting")
    for axis in "xyze":
        name = f"machine_max_jerk_{axis}"
        conversion.mark_used([name])
    if conversion.preset.read_text("machine_limits_usage") == "ignore":
        conversion.warn(
            "machine_limits_usage", "the source ignored the machine limits: check that they are correct"
        )


def _convert_travel_acceleration(conversion: Conversion) -> None:
    """Convert the travel acceleration, up to the machine limit; the default is the acceleration for printing."""
    preset, limit, asked = conversion.preset, "machine_max_acceleration_travel", "travel_acceleration"
    printing = "machine_max_acceleration_extruding"
    most = preset.read_number(limit) if preset.has(limit) else 0.0
    limits = [preset.read_number(f"machine_max_acceleration_{axis}") for axis in "xy"] + (
        [most] if most else []
    )
    wanted = preset.read_quantity(asked) if preset.has(asked) else None
    usual = preset.read_quantity("default_acceleration").value
    if wanted and (value := wanted.resolve(usual)):
        how = "percentage of default_acceleration" if wanted.is_percent else ""
        if value > min(limits):
            value, how = min(limits), f"the machine limit; the print settings have {value:g}"
        conversion.put(
            "travel_acceleration", value, (asked, limit), how, differs=value == min(limits) and bool(how)
        )
    elif most:
        conversion.copy_number("travel_acceleration", limit)
    else:
        conversion.put(
            "travel_acceleration", preset.read_number(printing), printing, "the acceleration while printing"
        )


def _convert_corner_method(conversion: Conversion) -> None:
    """Convert the method that limits speeds at corners: jerk, junction deviation or square corner velocity."""
    preset = conversion.preset
    jerk = min(preset.read_number("machine_max_jerk_x"), preset.read_number("machine_max_jerk_y"))
    names = ("machine_max_jerk_x", "machine_max_jerk_y")
    differs_by_axis = preset.read_number(names[0]) != preset.read_number(names[1])
    deviation = "machine_max_junction_deviation"
    if conversion.values["flavour"] == "klipper":
        conversion.put("corner", "square_corner", "gcode_flavor")
        conversion.clamp(
            "square_corner_velocity", jerk, 0, 100, names, "jerk of x and y, as in the source's time estimate"
        )
        conversion.clamp("jerk_e", preset.read_number("machine_max_jerk_e"), 0, 100, "machine_max_jerk_e")
        return
    if preset.has(deviation) and preset.read_number(deviation) > 0:
        conversion.put("corner", "junction_deviation", deviation)
        conversion.copy_number("junction_deviation", deviation)
        return
    conversion.put("corner", "jerk", names)
    conversion.clamp("jerk_xy", jerk, 0, 100, names, "the lesser of x and y" if differs_by_axis else "")
    conversion.clamp("jerk_z", preset.read_number("machine_max_jerk_z"), 0, 100, "machine_max_jerk_z")
    conversion.clamp("jerk_e", preset.read_number("machine_max_jerk_e"), 0, 100, "machine_max_jerk_e")


def _convert_retraction(conversion: Conversion) -> None:
    """Convert retraction, z hop and wipe."""
    preset = conversion.preset
    length, speed = (
        conversion.copy_number("retract_length", "retract_length"),
        preset.read_number("retract_speed"),
    )
    conversion.copy_number("retract_speed", "retract_speed")
    own_deretract_speed = preset.read_number("deretract_speed")
    conversion.put(
        "deretract_speed",
        own_deretract_speed or speed,
        "deretract_speed",
        "" if own_deretract_speed else "0 means the speed of retractions",
    )
    conversion.clamp(
        "retract_before_travel", preset.read_number("retract_before_travel"), 0, 100, "retract_before_travel"
    )
    conversion.clamp("z_hop", preset.read_number("retract_lift"), 0, 5, "retract_lift")
    conversion.clamp(
        "deretract_extra", preset.read_number("retract_restart_extra"), -2, 2, "retract_restart_extra"
    )
    firmware = conversion.copy_switch("firmware_retraction", "use_firmware_retraction")
    if conversion.values["flavour"] == "repetier" and firmware:
        conversion.put(
            "firmware_retraction",
            False,
            "use_firmware_retraction",
            "this flavour has no command for the length",
            differs=True,
        )
        firmware = False
    _convert_wipe(conversion, length, speed, firmware=firmware)


def _convert_wipe(conversion: Conversion, length: float, speed: float, *, firmware: bool) -> None:
    """Convert the distance that the nozzle moves back during retraction (wipe).

    Args:
        conversion: conversion of a printer.
        length: length of filament that is retracted, mm.
        speed: speed of retraction, mm/s.
        firmware: whether the firmware retracts, which then does not wipe.
    """
    preset = conversion.preset
    if preset.is_on("wipe") and not firmware and preset.read_raw("wipe_distance"):
        conversion.clamp(
            "wipe_distance",
            preset.read_number("wipe_distance"),
            0,
            20,
            ("wipe_distance", "wipe", "retract_before_wipe"),
        )
    elif preset.is_on("wipe") and not firmware:
        travel = parse_quantity(preset.context.get("travel_speed", "") or "130")
        share = 1 - conversion.resolve("retract_before_wipe", 1.0)
        distance = 0.8 * length / max(speed, 1) * (travel.value if travel else 130) * share
        how = "the distance travelled during the retraction"
        conversion.clamp(
            "wipe_distance", distance, 0, 20, ("wipe", "retract_before_wipe"), how, is_derived=True
        )
    else:
        conversion.mark_used(["retract_before_wipe", "wipe_distance"])
        conversion.switch_off("wipe_distance", 0, "wipe")


def _convert_file_settings(conversion: Conversion) -> None:
    """Convert settings of the G-code file: relative extrusion, progress, baud rate, thumbnails."""
    preset = conversion.preset
    conversion.copy_switch("relative_extrusion", "use_relative_e_distances")
    if preset.has("remaining_times"):
        conversion.copy_switch("progress", "remaining_times")
    if preset.has("serial_speed") and 1200 <= preset.read_number("serial_speed") <= 12_000_000:
        conversion.put("baud", int(preset.read_number("serial_speed")), "serial_speed")
    conversion.mark_used(["thumbnails", "thumbnails_format"])
    if not preset.has("thumbnails"):
        return
    usual = preset.read_text("thumbnails_format").upper() or "PNG"
    kept, lost = [], []
    for word in preset.read_items("thumbnails"):
        size, _, form = word.partition("/")
        form = form.strip().upper() or usual
        fits = re.fullmatch(r"[1-9]\d{0,3}x[1-9]\d{0,3}", size) and max(map(int, size.split("x"))) <= 1024
        if fits:
            kept.append(f"{size}/QOI" if form == "QOI" else size)
        if not fits or form not in ("PNG", "QOI"):
            lost.append(word if "/" in word else f"{word}/{form}")
    conversion.put("thumbnails", kept, "thumbnails", f"PNG for {', '.join(lost)}" if lost and kept else "")


def _explain_unsupported(name: str) -> str:
    """Return the reason why a printer setting has no equivalent."""
    if name in ("toolchange_gcode", "color_change_gcode", "template_custom_gcode", "between_objects_gcode"):
        return "this G-code is never used here"
    if "toolchange" in name or name.startswith(
        ("cooling_tube", "parking_pos", "extruder_offset", "single_extruder")
    ):
        return ONE_TOOL
    if name.startswith(("machine_min", "retract_lift", "retract_layer")):
        return "this limit does not exist here"
    return "no equivalent"
