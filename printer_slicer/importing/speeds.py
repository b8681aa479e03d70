"""Speeds and accelerations of other slicers as ours: percentages of each other, and 0 for whatever is fastest."""

from __future__ import annotations

from typing import Final

from printer_slicer.importing.conversion import Conversion

__all__ = ["speeds_of"]

# ours, theirs, the setting that a percentage is of
_SPEEDS: Final = (
    ("inner_perimeter", "perimeter_speed", ""),
    ("outer_perimeter", "external_perimeter_speed", "perimeter_speed"),
    ("sparse", "infill_speed", ""),
    ("solid", "solid_infill_speed", "infill_speed"),
    ("top_skin", "top_solid_infill_speed", "solid_infill_speed"),
    ("bridge", "bridge_speed", ""),
    ("internal_bridge", "bridge_speed_internal", "bridge_speed"),
    ("ironing", "ironing_speed", "solid_infill_speed"),
    ("raft", "support_material_speed", "perimeter_speed"),
)
_ACCELERATIONS: Final = (
    ("first_layer", ("first_layer_acceleration",)),
    ("outer_perimeter", ("external_perimeter_acceleration", "perimeter_acceleration")),
    ("inner_perimeter", ("perimeter_acceleration",)),
    ("bridge", ("bridge_acceleration",)),
    ("sparse", ("infill_acceleration",)),
    ("solid", ("solid_infill_acceleration", "infill_acceleration")),
    ("top_skin", ("top_solid_infill_acceleration", "solid_infill_acceleration", "infill_acceleration")),
)
_OVERHANGS: Final = (("0", 0), ("25", 1), ("50", 2), ("75", 3))


def speeds_of(made: Conversion) -> None:
    """Put all speeds and accelerations.

    Raises:
        ProfileError: a speed that is negative, with place and remedy.
    """
    for ours, theirs, whole in _SPEEDS:
        _put(made, ours, theirs, whole)
    _first_layer(made)
    _small(made)
    travel = made.preset.number("travel_speed")
    _positive(made, "travel_speed", travel)
    made.held("speeds.travel", travel, 0.1, 2000, "travel_speed")
    _overhangs(made)
    _accelerations(made)
    made.skip(["max_print_speed", "overhangs"])


def _put(made: Conversion, ours: str, theirs: str, whole: str) -> None:
    """One speed, with what it is a percentage of."""
    if theirs == "bridge_speed_internal" and not made.preset.has(theirs):
        bridge, how = _speed(made, "bridge_speed", "")
        made.held("speeds.internal_bridge", bridge, 0.1, 1000, "bridge_speed", how)
        return
    value, how = _speed(made, theirs, whole)
    made.held(f"speeds.{ours}", value, 0.1, 1000, theirs, how)


def _speed(made: Conversion, name: str, whole: str) -> tuple[float, str]:
    """A speed in mm/s, and what was made of it."""
    found = made.quantity(name)
    _positive(made, name, found.value)
    if found.percent:
        base = {theirs: rest for _, theirs, rest in _SPEEDS}.get(whole, "")
        of_whole = _speed(made, whole, base)[0] if whole else made.preset.number("max_print_speed")
        return found.of(of_whole), f"percentage of {whole or 'max_print_speed'}"
    if found.value == 0:  # as fast as the flow allows, up to a limit
        return made.preset.number("max_print_speed") or 80.0, "0 means up to max_print_speed"
    return found.value, ""


def _positive(made: Conversion, name: str, value: float) -> None:
    if value < 0:
        raise made.refuse(name, f"a speed of {value:g}", "write a positive one")


def _first_layer(made: Conversion) -> None:
    """One speed for all of the first layer; a percentage is of each role's there."""
    found = made.quantity("first_layer_speed")
    _positive(made, "first_layer_speed", found.value)
    speeds = made.values["speeds"]
    if found.percent:
        value, how = found.of(float(speeds["inner_perimeter"])), "percentage of that of perimeters"
    else:
        value, how = found.value, ""
    if not value:
        value, how = max(float(speeds["inner_perimeter"]), float(speeds["sparse"])), "0 means no limit"
    made.held("speeds.first_layer", value, 0.1, 1000, "first_layer_speed", how)


def _small(made: Conversion) -> None:
    found = made.quantity("small_perimeter_speed")
    _positive(made, "small_perimeter_speed", found.value)
    whole = float(made.values["speeds"]["inner_perimeter"])
    how = "percentage of that of perimeters" if found.percent else ""
    made.held("speeds.small_perimeter", found.of(whole), 0, 1000, "small_perimeter_speed", how)


def _overhangs(made: Conversion) -> None:
    """Overhangs as the source grades them; else only bridges are slower."""
    preset = made.preset
    graded = preset.has("enable_dynamic_overhang_speeds") and preset.on("enable_dynamic_overhang_speeds")
    outer = float(made.values["speeds"]["outer_perimeter"])
    for share, number in _OVERHANGS:
        name = f"overhang_speed_{number}"
        speed = preset.quantity(name).of(outer) if graded and preset.has(name) else 0.0
        if speed > 0:
            made.held(
                f"speeds.overhang_{share}_ratio",
                speed / outer,
                0.01,
                1,
                name,
                "as a share of outer perimeters",
            )
        else:
            made.put(f"speeds.overhang_{share}_ratio", 1, name)
    made.skip(["enable_dynamic_overhang_speeds"])


def _accelerations(made: Conversion) -> None:
    """0 there: as default_acceleration; 0 here: as the printer's."""
    preset = made.preset
    usual = preset.quantity("default_acceleration").value
    for ours, names in _ACCELERATIONS:
        name = next((one for one in names if preset.has(one) and preset.quantity(one).value), "")
        found = preset.quantity(name) if name else preset.quantity("default_acceleration")
        value = found.of(usual)
        how = "" if name == names[0] or not value else f"as {name or 'default_acceleration'}"
        how = "percentage of default_acceleration" if found.percent else how
        made.skip(names)
        made.held(f"accelerations.{ours}", value, 0, 100000, (name or "default_acceleration",), how)
