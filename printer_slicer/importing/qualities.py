"""Convert print settings of other slicers to qualities."""

from __future__ import annotations

import re
from typing import Final

from printer_slicer import bead
from printer_slicer.importing.conditions import evaluate_setting
from printer_slicer.importing.conversion import ONE_TOOL, SUPPORTS_OFF, Conversion
from printer_slicer.importing.object_overrides import add_object_overrides
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.importing.speeds import convert_speeds
from printer_slicer.macros import MacroFault

__all__ = ["convert_quality"]

_PATTERNS: Final = {
    same: same
    for same in (
        "rectilinear",
        "grid",
        "triangles",
        "cubic",
        "gyroid",
        "honeycomb",
        "concentric",
        "lightning",
    )
} | {"zig-zag": "rectilinear"}
_NEAR_PATTERNS: Final = {
    "stars": "triangles",
    "tri-hexagon": "triangles",
    "adaptivecubic": "cubic",
    "supportcubic": "cubic",
    "quartercubic": "cubic",
    "3dhoneycomb": "honeycomb",
    "crosshatch": "gyroid",
    "tpmsd": "gyroid",
    "scatteredrectilinear": "rectilinear",
    "archimedeanchords": "concentric",
    "octagramspiral": "concentric",
}
_SEAMS: Final = {
    "aligned": "aligned",
    "nearest": "nearest",
    "rear": "rear",
    "random": "random",
    "back": "rear",
}
_BRIMS: Final = {"outer_only": "outer", "inner_only": "inner", "outer_and_inner": "both", "brim_ears": "ears"}
_NEAR_BRIMS: Final = {"painted": "ears"}
_WIDTHS: Final = (
    "perimeter_extrusion_width",
    "external_perimeter_extrusion_width",
    "infill_extrusion_width",
    "solid_infill_extrusion_width",
    "top_infill_extrusion_width",
)
_EXTERNAL: Final = _WIDTHS[1]
_NOZZLE: Final = re.compile(r"nozzle_diameter\[0\]\s*={1,2}\s*(\d*\.?\d+)")


def convert_quality(preset: Preset) -> ImportedProfile:
    """Convert print settings.

    Args:
        preset: its settings under PrusaSlicer's names; `context` has the printer's, if it is known.

    Raises:
        ProfileError: a value is not a number, or out of range; with place and remedy.
    """
    made = Conversion(preset)
    made.put("name", preset.name)
    made.put("planner", {"kind": "uniform"})
    height = made.number("layer_height", "layer_height")
    if not 0.01 <= height <= 1.6:
        raise made.error("layer_height", f"layers of {height:g} mm", "Choose 0.01 to 1.6 mm")
    _layers(made, height)
    width = _widths(made, height)
    _walls(made)
    _shells(made, height)
    _infill(made, height, width)
    _bed(made, height)
    convert_speeds(made)
    done = made.finish(lambda name: _reason(name, supports=preset.is_on("support_material")))
    return add_object_overrides(done, preset, convert_quality) if preset.own else done


def _nozzle(made: Conversion) -> tuple[float, str]:
    """Return the nozzle diameter that percentages refer to, mm, and where it comes from."""
    preset = made.preset
    known = dict(preset.context) | {name: entry.text for name, entry in preset.entries.items()}
    try:
        return float(str(evaluate_setting("nozzle_diameter", known))), "of the nozzle"
    except (MacroFault, ValueError):
        found = _NOZZLE.search(preset.raw("compatible_printers_condition"))
        value = float(found[1]) if found else 0.4
        return (value, f"of the {value:g} mm nozzle it is for") if found else (0.4, "of a 0.4 mm nozzle")


def _layers(made: Conversion, height: float) -> None:
    found = made.quantity("first_layer_height")
    nozzle, whose = _nozzle(made) if made.preset.dialect == "superslicer" else (height, "of layer_height")
    first = found.of(nozzle) or height
    how = f"percentage {whose}" if found.percent else "" if found.value else "0 means layer_height"
    made.clamp("first_layer_height", first, 0, 1.6, "first_layer_height", how)
    resolution = made.preset.number("resolution") or made.preset.number("gcode_resolution")
    made.clamp("resolution", resolution, 0, 0.2, ("resolution", "gcode_resolution"))
    if made.preset.text("arc_fitting") in ("emit_center", "1", "true"):
        made.clamp("arc_tolerance", max(resolution, 0.0125), 0, 0.2, "arc_fitting", "the resolution")
    made.mark_used(["arc_fitting"])
    _compensation(made, height)


def _compensation(made: Conversion, height: float) -> None:
    """Convert the compensation of contours, holes and the first layer."""
    preset = made.preset
    grown = preset.number("xy_size_compensation")
    made.clamp("xy_compensation", grown, -1, 1, "xy_size_compensation")
    if preset.has("xy_hole_compensation"):  # OrcaSlicer's setting has the same sign as ours
        made.clamp("hole_compensation", preset.number("xy_hole_compensation"), -1, 1, "xy_hole_compensation")
    else:
        inner = "xy_inner_size_compensation"
        holes = preset.number(inner) if preset.has(inner) else grown
        names = ["xy_size_compensation", inner]
        if preset.has("hole_size_compensation"):  # SuperSlicer's extra compensation of convex holes
            holes += preset.number("hole_size_compensation")
            names = ["hole_size_compensation", *names]
        how = "applies to all holes" if preset.number("hole_size_compensation") else ""
        made.clamp("hole_compensation", -holes, -1, 1, names, how)
    _foot(made, height)


def _foot(made: Conversion, height: float) -> None:
    """Convert elephant foot compensation; SuperSlicer's is negative, and may cover several layers."""
    preset, name = made.preset, "first_layer_size_compensation"
    if not preset.number(name):
        name = "elefant_foot_compensation"
        made.mark_used(["first_layer_size_compensation"])
        made.clamp("elephant_foot", max(preset.number(name), 0), 0, 1, name)
        return
    inset = -preset.number(name)
    made.clamp(
        "elephant_foot", inset, 0, 1, (name, "elefant_foot_compensation"), "positive values shrink here"
    )
    layers = preset.number(f"{name}_layers")
    if layers > 1:
        first = float(made.values["first_layer_height"])
        fading = first + (layers - 1) * height
        made.clamp("elephant_foot_height", fading, 0, 5, f"{name}_layers", f"{layers:g} layers")


def _widths(made: Conversion, height: float) -> float:
    """Convert the widths of perimeters, external perimeters and the first layer.

    Everything else is as wide as perimeters.

    Returns:
        The width of perimeters, mm.
    """
    preset = made.preset
    nozzle, whose = _nozzle(made)
    over_nozzle = preset.dialect not in {"prusaslicer", "slic3r"}

    def width(name: str, layer: float) -> float:
        """Return a width in mm; 0: automatic."""
        return preset.quantity(name).of(nozzle if over_nozzle else layer)

    name = next((one for one in (_WIDTHS[0], "extrusion_width") if width(one, height)), "")
    usual = width(name, height) if name else 1.125 * nozzle
    percent = bool(name) and preset.quantity(name).percent
    differing = {one for one in _WIDTHS if width(one, height) and abs(width(one, height) - usual) > 1e-6}
    made.mark_used(one for one in ("extrusion_width", *_WIDTHS) if one not in differing)
    part = f"percentage {whose if over_nozzle else 'of layer_height'}"
    if name:
        made.clamp("extrusion_width", usual, 0, 4, name, part if percent else "")
    else:
        made.put("extrusion_width", 0, "extrusion_width", "automatic: 1.125 nozzle diameters")
    if _EXTERNAL in differing:
        how = part if preset.quantity(_EXTERNAL).percent else ""
        made.clamp("external_perimeter_width", width(_EXTERNAL, height), 0, 4, _EXTERNAL, how)
    first = width("first_layer_extrusion_width", float(made.values["first_layer_height"]))
    found = preset.quantity("first_layer_extrusion_width")
    what = f"percentage {whose if over_nozzle else 'of first_layer_height'}" if found.percent else ""
    made.clamp("first_layer_width", first, 0, 4, "first_layer_extrusion_width", what)
    return usual


def _walls(made: Conversion) -> None:
    preset = made.preset
    made.clamp("perimeters", int(preset.number("perimeters")), 0, 100, "perimeters")
    classic = preset.text("perimeter_generator") == "classic"
    how = "gaps and thin walls are filled with variable extrusion width" if classic else ""
    made.put(
        "varying_walls", True, ("perimeter_generator", "thin_walls", "gap_fill_enabled"), how, differs=classic
    )
    nozzle = _nozzle(made)[0]
    for ours, theirs, usual in (
        ("min_bead_width", "min_bead_width", 85),
        ("min_feature", "min_feature_size", 25),
    ):
        if preset.has(theirs):
            found = preset.quantity(theirs)
            same = found.percent and found.value == usual
            made.clamp(
                ours,
                0 if same else found.of(nozzle),
                0,
                4,
                theirs,
                "" if same or not found.percent else "percentage of the nozzle",
            )
    order = preset.text("wall_sequence") or preset.text("wall_infill_order")
    if order:
        name = "wall_sequence" if preset.has("wall_sequence") else "wall_infill_order"
        made.put("external_perimeter_first", order.startswith("outer wall"), name)
    else:
        made.switch("external_perimeter_first", "external_perimeters_first")
    made.switch("infill_first", "infill_first")
    for name in ("extra_perimeters_on_overhangs", "extra_perimeters_overhangs"):
        if preset.has(name):
            made.switch("extra_perimeters", name)
    for name in ("top_one_perimeter_type", "only_one_perimeter_top"):
        if preset.has(name):
            made.put("single_top_perimeter", preset.text(name) not in ("none", "0", "false"), name)
    if preset.has("staggered_inner_seams"):
        made.switch("staggered_inner_seams", "staggered_inner_seams")
    made.choice("seam", "seam_position", _SEAMS, {}, "aligned")
    _scarf(made)
    made.switch("avoid_crossing", "avoid_crossing_perimeters")
    detour = preset.quantity("avoid_crossing_perimeters_max_detour")
    if not detour.percent:
        # In the source, 0 means no limit.
        made.clamp("max_detour", detour.value or 10000, 0, 10000, "avoid_crossing_perimeters_max_detour")
    made.switch("spiral", "spiral_vase")


def _scarf(made: Conversion) -> None:
    """Convert scarf joints."""
    preset = made.preset
    kind, length = "seam_slope_type", "seam_slope_min_length"
    if preset.text(kind) in ("", "none"):
        made.mark_used(name for name in preset.entries if name.startswith(("seam_slope_", "scarf_")))
        return
    whole = preset.is_on("seam_slope_entire_loop")
    how = "; ".join(
        text
        for text, there in (
            ("around the whole loop in the source", whole),
            ("also in holes here", preset.text(kind) == "external"),
            ("also at corners here", preset.is_on("seam_slope_conditional")),
        )
        if there
    )
    reach = 100.0 if whole else preset.number(length)
    names = (kind, length, "seam_slope_entire_loop", "seam_slope_conditional", "scarf_angle_threshold")
    made.clamp("scarf_length", reach, 0, 100, names, how)
    if how:
        made.mark_different()
    start = preset.quantity("seam_slope_start_height")
    share = start.value / 100 if start.percent else start.value / float(made.values["layer_height"])
    how = "as a ratio of the layer height" if start.value and not start.percent else ""
    made.clamp("scarf_start", share, 0, 0.9, "seam_slope_start_height", how)
    made.switch("scarf_inner", "seam_slope_inner_walls")


def _shells(made: Conversion, height: float) -> None:
    """Convert top and bottom shells to thicknesses, and settings of ironing and bridges.

    The thickness is that of the layers, or the minimum thickness if it is greater.
    """
    preset = made.preset
    first = float(made.values["first_layer_height"])
    for side, begin in (("bottom", first), ("top", height)):
        count, least = preset.number(f"{side}_solid_layers"), preset.number(f"{side}_solid_min_thickness")
        thickness = begin + (count - 1) * height if count >= 1 else 0.0
        how = "" if least > thickness else f"{count:g} layers" if count else ""
        names = (f"{side}_solid_layers", f"{side}_solid_min_thickness")
        made.clamp(f"{side}_thickness", max(thickness, least if count else 0), 0, 1000, names, how)
    name = "ensure_vertical_shell_thickness"
    full = preset.text(name) not in ("0", "disabled", "false", "", "none")
    how = "0.9 of the shell thickness on slopes" if full else ""
    made.put("slope_shell_ratio", 0.9 if full else 0, name, how, differs=full)
    ironing = (
        preset.text("ironing_type") not in ("", "no ironing", "none")
        if preset.dialect == "orca"
        else preset.is_on("ironing")
    )
    made.put("ironing", ironing, ("ironing", "ironing_type"))
    made.clamp("ironing_spacing", preset.number("ironing_spacing"), 0.1, 1, "ironing_spacing")
    made.clamp("ironing_flow_ratio", made.resolve("ironing_flowrate", 1.0), 0.01, 0.3, "ironing_flowrate")
    made.switch("thick_bridges", "thick_bridges")
    made.clamp("bridge_flow_ratio", preset.number("bridge_flow_ratio"), 0.3, 2, "bridge_flow_ratio")
    made.mark_used(["top_fill_pattern", "bottom_fill_pattern", "external_fill_pattern"])


def _infill(made: Conversion, height: float, width: float) -> None:
    preset = made.preset
    made.choice("infill", "fill_pattern", _PATTERNS, _NEAR_PATTERNS, "rectilinear")
    density = preset.quantity("fill_density")
    share = density.value / 100 if density.percent or density.value > 1 else density.value
    if not 0 <= share <= 1:
        raise made.error("fill_density", f"a density of {100 * share:g} %", "Write 0 to 100 %")
    made.put("infill_density", share, "fill_density")
    if preset.has("infill_overlap"):
        _overlap(made, height, width)
    made.clamp("infill_angle_deg", preset.number("fill_angle"), -360, 360, "fill_angle")
    made.clamp(
        "solid_infill_below_area", preset.number("solid_infill_below_area"), 0, 1e6, "solid_infill_below_area"
    )
    for name, most in (("infill_anchor", 50), ("infill_anchor_max", 1000)):
        found = preset.quantity(name)
        length = min(found.of(width), most)  # in the source, 1000 means no limit
        how = "percentage of the extrusion width" if found.percent else ""
        how = how if length == found.of(width) else f"{most} is the most here"
        made.clamp(name, length, 0, most, name, how)
    every = preset.number("infill_every_layers")
    if every > 1:
        made.clamp("internal_infill_every", every * height, 0, 2, "infill_every_layers", f"{every:g} layers")
    made.mark_used(["infill_every_layers"])


def _overlap(made: Conversion, height: float, width: float) -> None:
    """Convert the overlap of infill with perimeters: mm, or a percentage of the mean spacing of the two."""
    spacing = float(bead.spacing(width, height))
    solid = "solid_infill_overlap" if made.preset.has("solid_infill_overlap") else "infill_overlap"
    for ours, theirs in (("infill_overlap", solid), ("internal_infill_overlap", "infill_overlap")):
        found = made.quantity(theirs)
        how = "" if found.percent else "as a ratio of the spacing"
        made.clamp(ours, round(found.of(spacing) / spacing, 4), 0, 0.5, theirs, how)


def _bed(made: Conversion, height: float) -> None:
    """Convert skirt, brim and raft."""
    preset = made.preset
    first = float(made.values["first_layer_height"])
    made.clamp("skirt_loops", int(preset.number("skirts")), 0, 20, "skirts")
    made.clamp("skirt_distance", preset.number("skirt_distance"), 0, 50, "skirt_distance")
    made.clamp("skirt_min_length", preset.number("min_skirt_length"), 0, 10000, "min_skirt_length")
    layers = preset.number("skirt_height")
    shield = preset.text("draft_shield") in ("enabled", "1")
    tall = 10000 if shield else first + (layers - 1) * height if layers > 1 else 0
    made.clamp(
        "skirt_height",
        tall,
        0,
        10000,
        ("skirt_height", "draft_shield"),
        f"{layers:g} layers" if tall and not shield else "",
    )
    _brim(made)
    _raft(made, height)


def _brim(made: Conversion) -> None:
    preset = made.preset
    kind = preset.text("brim_type")
    none = kind in ("no_brim", "none")
    made.clamp("brim_width", 0 if none else preset.number("brim_width"), 0, 50, ("brim_width", "brim_type"))
    if preset.is_on("brim_ears"):  # a switch of SuperSlicer and old versions of OrcaSlicer
        made.put("brim_type", "ears", "brim_ears")
        if preset.has("brim_ears_max_angle"):
            made.clamp(
                "brim_ear_angle_deg", preset.number("brim_ears_max_angle"), 0, 180, "brim_ears_max_angle"
            )
    elif not none:
        made.choice("brim_type", "brim_type", _BRIMS, _NEAR_BRIMS, "outer")
    made.clamp("brim_gap", max(preset.number("brim_separation"), 0), 0, 5, "brim_separation")


def _raft(made: Conversion, height: float) -> None:
    preset = made.preset
    first = float(made.values["first_layer_height"])
    raft = preset.number("raft_layers")
    made.mark_used(
        [
            "raft_layers",
            "raft_contact_distance",
            "raft_first_layer_expansion",
            "raft_first_layer_density",
            "raft_expansion",
        ]
    )
    if raft >= 1:
        made.clamp("raft_height", first + (raft - 1) * height, 0, 50, "raft_layers", f"{raft:g} layers")
        made.clamp("raft_gap", preset.number("raft_contact_distance"), 0, 1, "raft_contact_distance")
        made.clamp(
            "raft_margin", preset.number("raft_first_layer_expansion"), 1, 50, "raft_first_layer_expansion"
        )
        made.clamp(
            "raft_base_density",
            made.resolve("raft_first_layer_density", 1.0),
            0.2,
            1,
            "raft_first_layer_density",
        )
        if made.values["brim_width"]:
            made.put("brim_width", 0, "brim_width", "the part stands on a raft", differs=True)


def _reason(name: str, *, supports: bool) -> str:
    """Return the reason why a print setting has no equivalent.

    Args:
        name: name of the setting.
        supports: whether the source prints supports.
    """
    if name.startswith("support_") or name in ("dont_support_bridges", "interface_shells"):
        return "supports are not available here" if supports else SUPPORTS_OFF
    if name.startswith(
        ("wipe_tower", "ooze_prevention", "standby_temperature", "mmu_", "single_extruder")
    ) or name.endswith("_extruder"):
        return ONE_TOOL
    if name == "travel_acceleration":
        return "travel_acceleration is a printer setting: set it there"
    if name in _WIDTHS:
        return "extrusion_width applies to everything but external perimeters and the first layer"
    if name == "max_volumetric_speed":
        return "max_flow of the material limits the flow"
    return "no equivalent"
