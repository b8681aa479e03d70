"""Convert speeds and accelerations of other slicers, with percentages of each other and 0 for automatic."""

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
_FASTEST: Final = "max_print_speed"
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
"""Setting -> setting that its percentage refers to; others refer to max_print_speed or default_acceleration."""

_PERCENT_OF_IN: Final[Mapping[str, Mapping[str, str]]] = {
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
"""The same for slicers that differ. Source: their setting definitions (`ratio_over`)."""

_DEFAULT: Final = "default_acceleration"
_ACCELERATIONS: Final = (
    ("default", (_DEFAULT,)),
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


def convert_speeds(made: Conversion) -> None:
    """Convert all speeds and accelerations.

    Raises:
        ProfileError: a speed is negative; with place and remedy.
    """
    for ours, theirs in _SPEEDS:
        _put(made, ours, theirs)
    _gap(made)
    _first_layer(made)
    _small(made)
    travel = made.preset.number("travel_speed")
    _positive(made, "travel_speed", travel)
    made.clamp("speeds.travel", travel, 0.1, 2000, "travel_speed")
    _first_layer_travel(made, travel)
    _overhangs(made)
    _accelerations(made)
    made.mark_used([_FASTEST, "overhangs", "default_speed", _DEFAULT])
    if made.preset.mixed:  # it becomes a setting of the printer
        made.mark_used(["travel_acceleration"])


def _put(made: Conversion, ours: str, theirs: str) -> None:
    """Convert one speed."""
    if theirs == "bridge_speed_internal":  # SuperSlicer renamed it
        names = (theirs, "internal_bridge_speed")
        theirs = next((one for one in names if made.preset.raw(one)), "bridge_speed")
    value, how = _speed(made, theirs)
    made.clamp(f"speeds.{ours}", value, 0.1, 1000, theirs, how)


def _percent_of(made: Conversion, name: str, other: str) -> str:
    """Return the setting that a percentage refers to."""
    preset = made.preset
    # Versions of SuperSlicer without default_speed use the percentages of PrusaSlicer.
    older = preset.dialect == "superslicer" and "default_speed" not in preset.entries
    own = {} if older else _PERCENT_OF_IN.get(preset.dialect, {})
    return own.get(name) or _PERCENT_OF.get(name, other)


def _speed(made: Conversion, name: str) -> tuple[float, str]:
    """Return a speed in mm/s, and how it was converted."""
    if name.startswith("machine_"):
        return made.printer_number(name), ""
    found = made.quantity(name)
    _positive(made, name, found.value)
    if found.percent:
        whole = _percent_of(made, name, _FASTEST)
        base = made.preset.number(whole) if whole == _FASTEST else _speed(made, whole)[0]
        return found.of(base), f"percentage of {whole}"
    if found.value == 0:  # automatic: limited by the flow and by max_print_speed
        return made.preset.number(_FASTEST) or 80.0, f"0 means up to {_FASTEST}"
    return found.value, ""


def _positive(made: Conversion, name: str, value: float) -> None:
    if value < 0:
        raise made.error(name, f"a speed of {value:g}", "Write a positive speed")


def _gap(made: Conversion) -> None:
    """Convert the gap fill speed; 0 disables gap fill in the source, and means the perimeter speed here."""
    name = "gap_fill_speed"
    value, how = _speed(made, name) if made.quantity(name).value else (0.0, "")
    made.clamp("speeds.gap_fill", value, 0, 1000, name, how)
    if made.preset.has("raft_speed"):
        _put(made, "raft", "raft_speed")


def _first_layer(made: Conversion) -> None:
    """Convert the speeds of perimeters and infill on the first layer; a percentage refers to each role's speed."""
    speeds = made.values["speeds"]
    perimeter, internal, solid = (
        float(speeds[key]) for key in ("perimeter", "internal_infill", "solid_infill")
    )
    name, infill = "first_layer_speed", "first_layer_infill_speed"
    found = made.quantity(name)
    _positive(made, name, found.value)
    if found.percent:
        value, how = found.of(perimeter), "percentage of the perimeter speed"
    else:
        value, how = found.value, ""
    if not value:
        value, how = max(perimeter, internal), "0 means no limit"
    made.clamp("speeds.first_layer", value, 0.1, 1000, name, how)
    asked = made.quantity(infill) if made.quantity(infill).value else found
    theirs = infill if asked is not found else name
    _positive(made, theirs, asked.value)
    how = "percentage of the solid infill speed" if asked.percent else ""
    made.clamp("speeds.first_layer_infill", asked.of(solid) or value, 0.1, 1000, (theirs, infill), how)


def _first_layer_travel(made: Conversion, travel: float) -> None:
    """Convert the travel speed on the first layer; 0 means the normal travel speed."""
    name = "first_layer_travel_speed"
    found = made.quantity(name)
    _positive(made, name, found.value)
    value = found.of(travel)
    same = value >= travel
    how = "as travel_speed" if same else "percentage of travel_speed" if found.percent else ""
    made.clamp("speeds.first_layer_travel", travel if same or not value else value, 0.1, 2000, name, how)


def _small(made: Conversion) -> None:
    """Convert the speed of small perimeters, and the radius up to which it applies."""
    name, preset = "small_perimeter_speed", made.preset
    found = preset.quantity(name)
    value, how = _speed(made, name) if found.value else (0.0, "")
    made.clamp("speeds.small_perimeter", value, 0, 1000, name, how)
    radius = "speeds.small_perimeter_radius"
    length, threshold = "small_perimeter_min_length", "small_perimeter_threshold"
    if preset.dialect == "orca":
        made.clamp(radius, preset.number(threshold), 0, 100, threshold)
    elif preset.has(length):
        around = preset.quantity(length).of(made.printer_number("nozzle_diameter"))
        how = (
            "radius of a circle of this length; the source speeds up gradually to small_perimeter_max_length"
        )
        made.clamp(radius, around / (2 * pi), 0, 100, (length, "small_perimeter_max_length"), how)


def _overhangs(made: Conversion) -> None:
    """Convert speeds graded by overhang; without them only bridges are slower."""
    preset = made.preset
    graded = preset.has("enable_dynamic_overhang_speeds") and preset.is_on("enable_dynamic_overhang_speeds")
    outer = float(made.values["speeds"]["external_perimeter"])
    for share, number in _OVERHANGS:
        name = f"overhang_speed_{number}"
        speed = preset.quantity(name).of(outer) if graded and preset.has(name) else 0.0
        if speed > 0:
            made.clamp(
                f"speeds.overhang_{share}_ratio",
                speed / outer,
                0.01,
                1,
                name,
                "as a ratio of external perimeters",
            )
        else:
            made.put(f"speeds.overhang_{share}_ratio", 1, name)
    made.mark_used(["enable_dynamic_overhang_speeds"])


def _accelerations(made: Conversion) -> None:
    """Convert accelerations; 0 in the source refers to another setting, 0 here to the printer."""
    for ours, names in _ACCELERATIONS:
        name = next((one for one in names if made.quantity(one).value), _DEFAULT)
        value = _acceleration(made, name)
        how = "" if name == names[0] or not value else f"as {name}"
        if made.quantity(name).percent:
            how = f"percentage of {_percent_of(made, name, _DEFAULT)}"
        made.mark_used(names)
        made.clamp(f"accelerations.{ours}", value, 0, 100000, name, how)


def _acceleration(made: Conversion, name: str) -> float:
    """Return an acceleration in mm/s²; 0 if the source does not set one."""
    if name.startswith("machine_"):
        return made.printer_number(name)
    found = made.quantity(name)
    if not found.value and name != _DEFAULT:
        return _acceleration(made, _percent_of(made, name, _DEFAULT))
    return found.of(_acceleration(made, _percent_of(made, name, _DEFAULT))) if found.percent else found.value
