"""Convert speeds and accelerations of other slicers; they can be percentages of each other, or 0 for automatic."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Final

from printer_slicer.importing.conversion import Conversion

__all__ = ["convert_speeds"]

_SPEEDS: Final = (
    ("perimeter", "perimeter_speed"),
    ("external_perimeter", "external_perimeter_speed"),
    ("internal_infill", "infill_speed"),
    ("solid_infill", "solid_infill_speed"),
    ("top_solid_infill", "top_solid_infill_speed"),
    ("bridge", "bridge_speed"),
    ("internal_bridge", "bridge_speed_internal"),
    ("ironing", "ironing_speed"),
    ("support", "support_material_speed"),
    ("support_interface", "support_material_interface_speed"),
)
_MAX_SPEED: Final = "max_print_speed"
_PERCENT_OF: Final[Mapping[str, str]] = {
    "external_perimeter_speed": "perimeter_speed",
    "small_perimeter_speed": "perimeter_speed",
    "solid_infill_speed": "infill_speed",
    "top_solid_infill_speed": "solid_infill_speed",
    "bridge_speed_internal": "bridge_speed",
    "internal_bridge_speed": "bridge_speed",
    "ironing_speed": "solid_infill_speed",
    "support_material_speed": "perimeter_speed",
    "support_material_interface_speed": "support_material_speed",
    "first_layer_travel_speed": "travel_speed",
    "default_acceleration": "machine_max_acceleration_x",
}
"""Setting -> setting that its percentage refers to; the default is max_print_speed or default_acceleration."""

_PERCENT_OF_BY_DIALECT: Final[Mapping[str, Mapping[str, str]]] = {
    "superslicer": {
        "default_speed": "machine_max_feedrate_x",
        "perimeter_speed": "default_speed",
        "solid_infill_speed": "default_speed",
        "infill_speed": "solid_infill_speed",
        "bridge_speed": "default_speed",
        "ironing_speed": "top_solid_infill_speed",
        "support_material_speed": "default_speed",
        "external_perimeter_acceleration": "perimeter_acceleration",
        "infill_acceleration": "solid_infill_acceleration",
        "top_solid_infill_acceleration": "solid_infill_acceleration",
    },
    "orca": {
        "small_perimeter_speed": "external_perimeter_speed",
        "bridge_acceleration": "external_perimeter_acceleration",
    },
}
"""Dialect -> exceptions from `_PERCENT_OF`. Source: the setting definitions of these slicers (`ratio_over`)."""

_DEFAULT_ACCELERATION: Final = "default_acceleration"
_ACCELERATIONS: Final = (
    ("default", (_DEFAULT_ACCELERATION,)),
    ("first_layer", ("first_layer_acceleration",)),
    ("external_perimeter", ("external_perimeter_acceleration", "perimeter_acceleration")),
    ("perimeter", ("perimeter_acceleration",)),
    ("bridge", ("bridge_acceleration",)),
    ("internal_infill", ("infill_acceleration",)),
    ("solid_infill", ("solid_infill_acceleration", "infill_acceleration")),
    (
        "top_solid_infill",
        ("top_solid_infill_acceleration", "solid_infill_acceleration", "infill_acceleration"),
    ),
)
_OVERHANGS: Final = (("0", 0), ("25", 1), ("50", 2), ("75", 3))


def convert_speeds(conversion: Conversion) -> None:
    """Convert all speeds and accelerations.

    Raises:
        ProfileError: a speed is negative; with place and remedy.
    """
    for ours, theirs in _SPEEDS:
        _convert_speed(conversion, ours, theirs)
    _convert_gap_fill_and_raft(conversion)
    _convert_first_layer(conversion)
    _convert_small_perimeters(conversion)
    travel = conversion.preset.read_number("travel_speed")
    _check_not_negative(conversion, "travel_speed", travel)
    conversion.clamp("speeds.travel", travel, 0.1, 2000, "travel_speed")
    _convert_first_layer_travel(conversion, travel)
    _convert_overhangs(conversion)
    _convert_accelerations(conversion)
    conversion.mark_used([_MAX_SPEED, "overhangs", "default_speed", _DEFAULT_ACCELERATION])
    if conversion.preset.mixed:  # it becomes a setting of the printer
        conversion.mark_used(["travel_acceleration"])


def _convert_speed(conversion: Conversion, ours: str, theirs: str) -> None:
    """Set one of our speeds from a speed of the source."""
    if theirs == "bridge_speed_internal":  # SuperSlicer renamed it
        names = (theirs, "internal_bridge_speed")
        theirs = next((one for one in names if conversion.preset.read_raw(one)), "bridge_speed")
    value, how = _resolve_speed(conversion, theirs)
    conversion.clamp(f"speeds.{ours}", value, 0.1, 1000, theirs, how)


def _find_percent_base(conversion: Conversion, name: str, default: str) -> str:
    """Return the name of the setting to which the percentage of a speed refers."""
    preset = conversion.preset
    # Versions of SuperSlicer without default_speed use the percentages of PrusaSlicer.
    older = preset.dialect == "superslicer" and "default_speed" not in preset.entries
    own = {} if older else _PERCENT_OF_BY_DIALECT.get(preset.dialect, {})
    return own.get(name) or _PERCENT_OF.get(name, default)


def _resolve_speed(conversion: Conversion, name: str) -> tuple[float, str]:
    """Return a speed in mm/s, and how it was converted."""
    if name.startswith("machine_"):
        return conversion.read_printer_number(name), ""
    found = conversion.read_quantity(name)
    _check_not_negative(conversion, name, found.value)
    if found.is_percent:
        whole = _find_percent_base(conversion, name, _MAX_SPEED)
        base = (
            conversion.preset.read_number(whole)
            if whole == _MAX_SPEED
            else _resolve_speed(conversion, whole)[0]
        )
        return found.resolve(base), f"percentage of {whole}"
    if found.value == 0:  # automatic: limited by the flow and by max_print_speed
        return conversion.preset.read_number(_MAX_SPEED) or 80.0, f"0 means up to {_MAX_SPEED}"
    return found.value, ""


def _check_not_negative(conversion: Conversion, name: str, value: float) -> None:
    """Raise an error if a speed is negative."""
    if value < 0:
        raise conversion.make_error(name, f"a speed of {value:g} is negative", "Write a positive speed")


def _convert_gap_fill_and_raft(conversion: Conversion) -> None:
    """Convert the speeds of gap fill and rafts.

    A gap fill speed of 0 disables gap fill in the source; here it means the perimeter speed.
    """
    name = "gap_fill_speed"
    value, how = _resolve_speed(conversion, name) if conversion.read_quantity(name).value else (0.0, "")
    conversion.clamp("speeds.gap_fill", value, 0, 1000, name, how)
    if conversion.preset.has("raft_speed"):
        _convert_speed(conversion, "raft", "raft_speed")


def _convert_first_layer(conversion: Conversion) -> None:
    """Convert the speeds on the first layer; a percentage refers to the speed on other layers."""
    speeds = conversion.values["speeds"]
    perimeter, internal, solid = (
        float(speeds[key]) for key in ("perimeter", "internal_infill", "solid_infill")
    )
    name, infill = "first_layer_speed", "first_layer_infill_speed"
    found = conversion.read_quantity(name)
    _check_not_negative(conversion, name, found.value)
    if found.is_percent:
        value, how = found.resolve(perimeter), "percentage of the perimeter speed"
    else:
        value, how = found.value, ""
    if not value:
        value, how = max(perimeter, internal), "0 means no limit"
    conversion.clamp("speeds.first_layer", value, 0.1, 1000, name, how)
    asked = conversion.read_quantity(infill) if conversion.read_quantity(infill).value else found
    theirs = infill if asked is not found else name
    _check_not_negative(conversion, theirs, asked.value)
    how = "percentage of the solid infill speed" if asked.is_percent else ""
    conversion.clamp(
        "speeds.first_layer_infill", asked.resolve(solid) or value, 0.1, 1000, (theirs, infill), how
    )


def _convert_first_layer_travel(conversion: Conversion, travel: float) -> None:
    """Convert the travel speed on the first layer; 0 means the normal travel speed."""
    name = "first_layer_travel_speed"
    found = conversion.read_quantity(name)
    _check_not_negative(conversion, name, found.value)
    value = found.resolve(travel)
    same = value >= travel
    how = "as travel_speed" if same else "percentage of travel_speed" if found.is_percent else ""
    conversion.clamp(
        "speeds.first_layer_travel", travel if same or not value else value, 0.1, 2000, name, how
    )


def _convert_small_perimeters(conversion: Conversion) -> None:
    """Convert the speed of small perimeters, and the radius up to which it applies."""
    name, preset = "small_perimeter_speed", conversion.preset
    found = preset.read_quantity(name)
    value, how = _resolve_speed(conversion, name) if found.value else (0.0, "")
    conversion.clamp("speeds.small_perimeter", value, 0, 1000, name, how)
    radius = "speeds.small_perimeter_radius"
    length, threshold = "small_perimeter_min_length", "small_perimeter_threshold"
    if preset.dialect == "orca":
        conversion.clamp(radius, preset.read_number(threshold), 0, 100, threshold)
    elif preset.has(length):
        around = preset.read_quantity(length).resolve(conversion.read_printer_number("nozzle_diameter"))
        how = (
            "radius of a circle of this length; the source speeds up gradually to small_perimeter_max_length"
        )
        conversion.clamp(radius, around / (2 * pi), 0, 100, (length, "small_perimeter_max_length"), how)


def _convert_overhangs(conversion: Conversion) -> None:
    """Convert the speeds for each degree of overhang; if the source has none, only bridges are slower."""
    preset = conversion.preset
    switch = "enable_dynamic_overhang_speeds"
    graded = preset.has(switch) and preset.is_on(switch)
    outer = float(conversion.values["speeds"]["external_perimeter"])
    for share, number in _OVERHANGS:
        name = f"overhang_speed_{number}"
        speed = preset.read_quantity(name).resolve(outer) if graded and preset.has(name) else 0.0
        if speed > 0:
            conversion.clamp(
                f"speeds.overhang_{share}_ratio",
                speed / outer,
                0.01,
                1,
                (name, switch),
                "as a ratio of external perimeters",
            )
        else:
            conversion.put(f"speeds.overhang_{share}_ratio", 1, (name, switch))


def _convert_accelerations(conversion: Conversion) -> None:
    """Convert accelerations; here, 0 means the printer's value, but in the source, the value of another setting."""
    for ours, names in _ACCELERATIONS:
        name = next((one for one in names if conversion.read_quantity(one).value), _DEFAULT_ACCELERATION)
        value = _resolve_acceleration(conversion, name)
        how = "" if name == names[0] or not value else f"as {name}"
        if conversion.read_quantity(name).is_percent:
            how = f"percentage of {_find_percent_base(conversion, name, _DEFAULT_ACCELERATION)}"
        conversion.mark_used(names)
        conversion.clamp(f"accelerations.{ours}", value, 0, 100000, name, how)


def _resolve_acceleration(conversion: Conversion, name: str) -> float:
    """Return an acceleration in mm/s²; 0 if the source does not set one."""
    if name.startswith("machine_"):
        return conversion.read_printer_number(name)
    found = conversion.read_quantity(name)
    if not found.value and name != _DEFAULT_ACCELERATION:
        return _resolve_acceleration(conversion, _find_percent_base(conversion, name, _DEFAULT_ACCELERATION))
    return (
        found.resolve(
            _resolve_acceleration(conversion, _find_percent_base(conversion, name, _DEFAULT_ACCELERATION))
        )
        if found.is_percent
        else found.value
    )
