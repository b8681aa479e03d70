"""Convert the settings of supports of other slicers."""

from __future__ import annotations

from math import atan, degrees
from typing import Final

from printer_slicer.importing.conversion import Conversion
from printer_slicer.importing.presets import OFF_WORDS, ON_WORDS

__all__ = ["convert_supports"]

_STYLES: Final = {
    "grid": "columns",
    "snug": "columns",
    "normal": "columns",
    "tree": "tree",
    "organic": "tree",
    "tree_slim": "tree",
    "tree_strong": "tree",
    "tree_organic": "tree",
    "tree_hybrid": "auto",
    "default": "auto",
}
"""Words of support_material_style, of OrcaSlicer's support_style and of Cura's support_structure."""
_TYPES: Final = {"normal": "columns", "hybrid": "auto", "tree": "tree"}
"""Words of OrcaSlicer's support_type, without what follows in brackets."""
_MANUAL: Final = ("normal(manual)", "tree(manual)")
_TYPE_WORDS: Final = ("normal(auto)", "tree(auto)", "hybrid(auto)", *_TYPES, *_MANUAL)
_NUMBERS: Final = (
    ("support_gap", "support_material_contact_distance", 0, 1),
    ("support_interface_layers", "support_material_interface_layers", 0, 10),
    ("support_interface_spacing", "support_material_interface_spacing", 0, 5),
    ("support_closing", "support_material_closing_radius", 0, 10),
    ("support_min_area", "minimum_support_area", 0, 1000),
    ("support_tip_diameter", "support_tree_tip_diameter", 0.2, 5),
    ("support_tree_angle_deg", "support_tree_angle", 5, 75),
    ("support_tree_slow_angle_deg", "support_tree_angle_slow", 5, 75),
    ("support_branch_diameter", "support_tree_branch_diameter", 0.5, 20),
    ("support_branch_growth_deg", "support_tree_branch_diameter_angle", 0, 15),
)
"""Our setting, PrusaSlicer's, and the bounds here."""
_MAX_BRIDGE: Final = 10.0  # mm, the default here
_FLATTEST, _STEEPEST = 5.0, 89.0  # degrees; smaller angles act as the flattest


def convert_supports(conversion: Conversion, height: float, width: float) -> None:
    """Convert all settings of supports, also if the source prints none.

    Args:
        conversion: the quality.
        height: layer height, mm.
        width: width of perimeters, mm.
    """
    preset = conversion.preset
    _convert_style(conversion)
    for ours, theirs, low, high in _NUMBERS:
        if preset.has(theirs):
            conversion.clamp(ours, preset.read_number(theirs), low, high, theirs)
    _convert_threshold(conversion, height, width)
    _convert_gaps(conversion, width)
    _convert_base(conversion, width)
    if preset.has("dont_support_bridges"):
        is_left_out = preset.is_on("dont_support_bridges")
        how = (
            f"bridges over {_MAX_BRIDGE:g} mm get supports here"
            if is_left_out
            else "all bridges get supports"
        )
        conversion.put("support_max_bridge", _MAX_BRIDGE if is_left_out else 0, "dont_support_bridges", how)
    for ours, theirs in (
        ("support_on_bed_only", "support_material_buildplate_only"),
        ("support_synchronize_layers", "support_material_synchronize_layers"),
    ):
        if preset.has(theirs):
            conversion.copy_switch(ours, theirs)
    if preset.has("independent_support_layer_height"):
        own = preset.is_on("independent_support_layer_height")
        conversion.put(
            "support_synchronize_layers", not own, "independent_support_layer_height", "the opposite"
        )


def _convert_style(conversion: Conversion) -> None:
    """Convert whether there are supports, and their style."""
    preset = conversion.preset
    names = ["support_material", "support_material_style", "support_type", "support_material_auto"]
    conversion.mark_used(names)
    if not preset.is_on("support_material"):
        conversion.switch_off("support", "off", "support_material")
        return
    style, is_enforced = "auto", False
    if preset.has("support_type"):
        word = preset.read_word("support_type", _TYPE_WORDS)
        style = _TYPES.get(word.partition("(")[0], "auto")
        is_enforced = word in _MANUAL
    if preset.has("support_material_style"):
        found = _STYLES.get(preset.read_word("support_material_style", _STYLES), "auto")
        style = style if found == "auto" and preset.has("support_type") else found
    if preset.has("support_material_auto") and not preset.is_on("support_material_auto"):
        is_enforced = True
    conversion.put("support", style, names)
    if is_enforced:
        theirs = "support_type" if preset.has("support_type") else "support_material_auto"
        conversion.put("support_places", "enforced", theirs)


def _convert_threshold(conversion: Conversion, height: float, width: float) -> None:
    """Convert the angle up to which surfaces get supports; 0 means half the width beyond the layer below."""
    name = "support_material_threshold"
    if not conversion.preset.has(name):
        return
    angle, how = conversion.preset.read_number(name), ""
    if not angle and conversion.preset.dialect != "cura":
        angle = round(degrees(atan(2 * height / width)), 1)
        how = "automatic: half an extrusion width beyond the layer below"
    conversion.clamp("support_threshold_deg", angle, _FLATTEST, _STEEPEST, name, how)


def _convert_gaps(conversion: Conversion, width: float) -> None:
    """Convert the gaps below and beside supports."""
    preset = conversion.preset
    bottom = "support_material_bottom_contact_distance"
    if preset.has(bottom):
        gap, how = preset.read_number(bottom), ""
        if not gap and preset.dialect != "cura" and preset.has("support_material_contact_distance"):
            gap, how = (
                preset.read_number("support_material_contact_distance"),
                "0 means the gap above supports",
            )
        conversion.clamp("support_bottom_gap", gap, 0, 1, bottom, how)
    beside = "support_material_xy_spacing"
    if preset.has(beside):
        found = preset.read_quantity(beside)
        external = float(conversion.values.get("external_perimeter_width", 0)) or width
        how = "percentage of the width of external perimeters" if found.is_percent else ""
        conversion.clamp("support_xy_gap", found.resolve(external), 0, 10, beside, how)


def _convert_base(conversion: Conversion, width: float) -> None:
    """Convert the lines, loops and foot of supports."""
    preset = conversion.preset
    if preset.has("support_material_spacing"):
        spacing = preset.read_number("support_material_spacing")
        how = "the width of a line is added" if preset.dialect != "cura" else ""
        conversion.clamp(
            "support_spacing", spacing + (width if how else 0), 0.5, 20, "support_material_spacing", how
        )
    if preset.has("support_material_with_sheath"):
        word = preset.read_word("support_material_with_sheath", [*ON_WORDS, *OFF_WORDS])
        walls = (
            int(preset.read_number("support_material_with_sheath")) if word.isdigit() else word in ON_WORDS
        )
        conversion.clamp("support_walls", int(walls), 0, 10, "support_material_with_sheath")
    foot = "raft_first_layer_expansion"
    if preset.has(foot) and preset.read_number("raft_layers") < 1 and preset.dialect != "cura":
        conversion.clamp("support_first_layer_expansion", preset.read_number(foot), 0, 20, foot)
