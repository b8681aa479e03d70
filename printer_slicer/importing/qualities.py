"""Convert print settings of other slicers to qualities."""

from __future__ import annotations

import re
from typing import Final

from printer_slicer import bead
from printer_slicer.importing.conditions import evaluate_setting
from printer_slicer.importing.conversion import ONE_TOOL, SUPPORTS_OFF, Conversion, find_highest_layer
from printer_slicer.importing.object_overrides import add_object_overrides
from printer_slicer.importing.presets import OFF_WORDS, ON_WORDS, Preset
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.importing.speeds import convert_speeds
from printer_slicer.importing.supports import convert_supports
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
    "hilbertcurve": "rectilinear",
    "line": "rectilinear",
    "alignedrectilinear": "rectilinear",
    "monotonic": "rectilinear",
    "monotoniclines": "rectilinear",
    "zigzag": "rectilinear",
    "crosszag": "rectilinear",
    "lockedzag": "rectilinear",
    "2dlattice": "grid",
    "lateral-lattice": "grid",
    "2dhoneycomb": "honeycomb",
    "lateral-honeycomb": "honeycomb",
    "tpmsfk": "gyroid",
}
_SEAMS: Final = {
    "aligned": "aligned",
    "nearest": "nearest",
    "rear": "rear",
    "random": "random",
    "back": "rear",
}
_BRIMS: Final = {"outer_only": "outer", "inner_only": "inner", "outer_and_inner": "both", "brim_ears": "ears"}
_NEAR_BRIMS: Final = {"auto_brim": "outer", "painted": "ears"}
_NO_BRIM: Final = ("no_brim", "none")
_IRONED: Final = {
    "top": "",
    "topmost": "all top surfaces are ironed here",
    "solid": "only top surfaces are ironed here",
}
_NOT_IRONED: Final = ("", "no ironing", "none")
_WALL_ORDERS: Final = (
    "inner wall/outer wall",
    "outer wall/inner wall",
    "inner-outer-inner wall",
    "inner wall/outer wall/infill",
    "outer wall/inner wall/infill",
    "infill/inner wall/outer wall",
    "infill/outer wall/inner wall",
    "inner-outer-inner wall/infill",
)
_ARCS: Final = ("emit_center", *ON_WORDS)
_NO_VERTICAL_SHELLS: Final = ("", "none", "disabled", *OFF_WORDS)
_VERTICAL_SHELLS: Final = (
    "ensure_all",
    "ensure_moderate",
    "ensure_critical_only",
    "partial",
    "enabled",
    *ON_WORDS,
)
_SINGLE_TOP_PERIMETERS: Final = ("none", "top", "topmost", "not_top", *ON_WORDS, *OFF_WORDS)
_DRAFT_SHIELDS: Final = ("disabled", "limited", "enabled", *ON_WORDS, *OFF_WORDS)
_RAFT_SETTINGS: Final = (
    "raft_layers",
    "raft_contact_distance",
    "raft_first_layer_expansion",
    "raft_first_layer_density",
    "raft_expansion",
)
_SCARFS: Final = ("external", "all")
_WIDTHS: Final = (
    "perimeter_extrusion_width",
    "external_perimeter_extrusion_width",
    "infill_extrusion_width",
    "solid_infill_extrusion_width",
    "top_infill_extrusion_width",
)
_EXTERNAL_WIDTH: Final = _WIDTHS[1]
_NOZZLE_CONDITION: Final = re.compile(r"nozzle_diameter\[0\]\s*={1,2}\s*(\d*\.?\d+)")


def convert_quality(preset: Preset) -> ImportedProfile:
    """Convert print settings.

    Args:
        preset: the settings under PrusaSlicer's names; `context` has those of the printer if it is known.

    Raises:
        ProfileError: a value is not a number, or out of range; with place and remedy.
    """
    conversion = Conversion(preset)
    conversion.put("name", preset.name)
    conversion.put("planner", {"kind": "uniform"})
    height = conversion.copy_number("layer_height", "layer_height")
    if not 0.01 <= height <= 1.6:
        raise conversion.make_error(
            "layer_height", f"a layer height of {height:g} mm is out of range", "Choose 0.01 to 1.6 mm"
        )
    _convert_layers(conversion, height)
    width = _convert_widths(conversion, height)
    _convert_perimeters(conversion)
    _convert_shells(conversion, height)
    _convert_infill(conversion, height, width)
    _convert_adhesion(conversion, height)
    convert_supports(conversion, height, width)
    convert_speeds(conversion)
    done = conversion.finish(
        lambda name: _explain_unsupported(name, supports=preset.is_on("support_material"))
    )
    return add_object_overrides(done, preset, convert_quality) if preset.object_settings else done


def _find_nozzle(conversion: Conversion) -> tuple[float, str]:
    """Return the nozzle diameter, mm, to which percentages refer, and a phrase that describes this nozzle."""
    preset = conversion.preset
    known = dict(preset.context) | {name: entry.text for name, entry in preset.entries.items()}
    try:
        return float(str(evaluate_setting("nozzle_diameter", known))), "of the nozzle"
    except (MacroFault, ValueError):
        found = _NOZZLE_CONDITION.search(preset.read_raw("compatible_printers_condition"))
        value = float(found[1]) if found else 0.4
        return (value, f"of the {value:g} mm nozzle it is for") if found else (0.4, "of a 0.4 mm nozzle")


def _lower_first_layer(conversion: Conversion) -> None:
    """Lower the first layer to what the nozzle can press onto the bed, if the printer is known."""
    preset, first = conversion.preset, float(conversion.values["first_layer_height"])
    if "nozzle_diameter" not in preset.context or "first_layer_height" in preset.typed:
        return
    nozzle, _ = _find_nozzle(conversion)
    most = find_highest_layer(nozzle)
    if 0 < most < first:
        how = f"the nozzle of {nozzle:g} mm allows {most:g} mm; the source has {first:g} mm"
        conversion.put("first_layer_height", most, "first_layer_height", how, differs=True)


def _convert_layers(conversion: Conversion, height: float) -> None:
    """Convert the first layer height, the resolution, arcs, and the compensation of contours."""
    found = conversion.read_quantity("first_layer_height")
    nozzle, whose = (
        _find_nozzle(conversion)
        if conversion.preset.dialect == "superslicer"
        else (height, "of layer_height")
    )
    first = found.resolve(nozzle) or height
    how = f"percentage {whose}" if found.is_percent else "" if found.value else "0 means layer_height"
    conversion.clamp("first_layer_height", first, 0, 1.6, "first_layer_height", how)
    _lower_first_layer(conversion)
    resolution = conversion.preset.read_number("resolution") or conversion.preset.read_number(
        "gcode_resolution"
    )
    conversion.clamp("resolution", resolution, 0, 0.2, ("resolution", "gcode_resolution"))
    if conversion.preset.read_word("arc_fitting", [*_ARCS, "disabled", *OFF_WORDS]) in _ARCS:
        conversion.clamp("arc_tolerance", max(resolution, 0.0125), 0, 0.2, "arc_fitting", "the resolution")
    else:
        conversion.switch_off("arc_tolerance", 0, "arc_fitting")
    _convert_compensation(conversion, height)


def _convert_compensation(conversion: Conversion, height: float) -> None:
    """Convert the compensation of contours, holes and the first layer."""
    preset = conversion.preset
    offset = preset.read_number("xy_size_compensation")
    conversion.clamp("xy_compensation", offset, -1, 1, "xy_size_compensation")
    if preset.has("xy_hole_compensation"):  # OrcaSlicer's setting has the same sign as ours
        conversion.clamp(
            "hole_compensation", preset.read_number("xy_hole_compensation"), -1, 1, "xy_hole_compensation"
        )
    else:
        inner = "xy_inner_size_compensation"
        holes = preset.read_number(inner) if preset.has(inner) else offset
        names = ["xy_size_compensation", inner]
        if preset.has("hole_size_compensation"):  # SuperSlicer's extra compensation of convex holes
            holes += preset.read_number("hole_size_compensation")
            names = ["hole_size_compensation", *names]
        how = "applies to all holes" if preset.read_number("hole_size_compensation") else ""
        conversion.clamp("hole_compensation", -holes, -1, 1, names, how)
    _convert_elephant_foot(conversion, height)


def _convert_elephant_foot(conversion: Conversion, height: float) -> None:
    """Convert elephant foot compensation; SuperSlicer's setting is negative, and can apply to several layers."""
    preset, name = conversion.preset, "first_layer_size_compensation"
    if not preset.read_number(name):
        name = "elefant_foot_compensation"
        conversion.mark_used(["first_layer_size_compensation"])
        conversion.clamp("elephant_foot", max(preset.read_number(name), 0), 0, 1, name)
        return
    inset = -preset.read_number(name)
    conversion.clamp(
        "elephant_foot", inset, 0, 1, (name, "elefant_foot_compensation"), "positive values shrink here"
    )
    layers = preset.read_number(f"{name}_layers")
    if layers > 1:
        first = float(conversion.values["first_layer_height"])
        fading = first + (layers - 1) * height
        conversion.clamp("elephant_foot_height", fading, 0, 5, f"{name}_layers", f"{layers:g} layers")


def _convert_widths(conversion: Conversion, height: float) -> float:
    """Convert the widths of perimeters, external perimeters and the first layer.

    All other extrusions are as wide as perimeters.

    Returns:
        The width of perimeters, mm.
    """
    preset = conversion.preset
    nozzle, whose = _find_nozzle(conversion)
    is_of_nozzle = preset.dialect not in {"prusaslicer", "slic3r"}

    def resolve_width(name: str, layer: float) -> float:
        """Return an extrusion width in mm; 0 means automatic."""
        return preset.read_quantity(name).resolve(nozzle if is_of_nozzle else layer)

    name = next((one for one in (_WIDTHS[0], "extrusion_width") if resolve_width(one, height)), "")
    perimeter_width = resolve_width(name, height) if name else 1.125 * nozzle
    percent = bool(name) and preset.read_quantity(name).is_percent
    differing = {
        one
        for one in _WIDTHS
        if resolve_width(one, height) and abs(resolve_width(one, height) - perimeter_width) > 1e-6
    }
    conversion.mark_used(one for one in ("extrusion_width", *_WIDTHS) if one not in differing)
    part = f"percentage {whose if is_of_nozzle else 'of layer_height'}"
    if name:
        conversion.clamp("extrusion_width", perimeter_width, 0, 4, name, part if percent else "")
    else:
        conversion.put("extrusion_width", 0, "extrusion_width", "automatic: 1.125 nozzle diameters")
    if _EXTERNAL_WIDTH in differing:
        how = part if preset.read_quantity(_EXTERNAL_WIDTH).is_percent else ""
        conversion.clamp(
            "external_perimeter_width", resolve_width(_EXTERNAL_WIDTH, height), 0, 4, _EXTERNAL_WIDTH, how
        )
    else:
        conversion.switch_off("external_perimeter_width", 0, _EXTERNAL_WIDTH)
    first = resolve_width("first_layer_extrusion_width", float(conversion.values["first_layer_height"]))
    found = preset.read_quantity("first_layer_extrusion_width")
    what = f"percentage {whose if is_of_nozzle else 'of first_layer_height'}" if found.is_percent else ""
    conversion.clamp("first_layer_width", first, 0, 4, "first_layer_extrusion_width", what)
    return perimeter_width


def _convert_perimeters(conversion: Conversion) -> None:
    """Convert the number, the widths and the order of perimeters, and the seam."""
    preset = conversion.preset
    conversion.clamp("perimeters", int(preset.read_number("perimeters")), 0, 100, "perimeters")
    classic = preset.read_text("perimeter_generator") == "classic"
    how = "gaps and thin walls are filled with variable extrusion width" if classic else ""
    conversion.put(
        "varying_walls", True, ("perimeter_generator", "thin_walls", "gap_fill_enabled"), how, differs=classic
    )
    _convert_bead_widths(conversion)
    _convert_perimeter_order(conversion)
    for name in ("extra_perimeters_on_overhangs", "extra_perimeters_overhangs"):
        if preset.has(name):
            conversion.copy_switch("extra_perimeters", name)
    for name in ("top_one_perimeter_type", "only_one_perimeter_top"):
        if preset.has(name):
            word = preset.read_word(name, _SINGLE_TOP_PERIMETERS)
            conversion.put("single_top_perimeter", word not in ("none", *OFF_WORDS), name)
    if preset.has("staggered_inner_seams"):
        conversion.copy_switch("staggered_inner_seams", "staggered_inner_seams")
    conversion.convert_choice("seam", "seam_position", _SEAMS, {}, "aligned")
    _convert_scarf_joints(conversion)
    _convert_contouring(conversion)
    conversion.copy_switch("avoid_crossing", "avoid_crossing_perimeters")
    detour = preset.read_quantity("avoid_crossing_perimeters_max_detour")
    if not detour.is_percent:
        # In the source, 0 means no limit.
        conversion.clamp(
            "max_detour", detour.value or 10000, 0, 10000, "avoid_crossing_perimeters_max_detour"
        )
    conversion.copy_switch("spiral", "spiral_vase")
    _convert_print_order(conversion)


def _convert_print_order(conversion: Conversion) -> None:
    """Convert whether objects are printed one after the other, which the slicers name differently."""
    preset = conversion.preset
    if preset.has("complete_objects"):
        order = "by_object" if preset.is_on("complete_objects") else "by_layer"
        conversion.put("print_order", order, "complete_objects")
    if preset.has("print_sequence"):
        known = {"by layer": "by_layer", "all_at_once": "by_layer"}
        known |= {"by object": "by_object", "one_at_a_time": "by_object"}
        conversion.convert_choice("print_order", "print_sequence", known, {}, "by_layer")


def _convert_bead_widths(conversion: Conversion) -> None:
    """Convert the extrusion widths in thin walls."""
    preset = conversion.preset
    nozzle = _find_nozzle(conversion)[0]
    for ours, theirs, perimeter_width in (
        ("min_bead_width", "min_bead_width", 85),
        ("min_feature", "min_feature_size", 25),
    ):
        if preset.has(theirs):
            found = preset.read_quantity(theirs)
            same = found.is_percent and found.value == perimeter_width
            conversion.clamp(
                ours,
                0 if same else found.resolve(nozzle),
                0,
                4,
                theirs,
                "" if same or not found.is_percent else "percentage of the nozzle",
            )


def _convert_perimeter_order(conversion: Conversion) -> None:
    """Convert the order of perimeters and infill."""
    preset = conversion.preset
    name = "wall_sequence" if preset.read_text("wall_sequence") else "wall_infill_order"
    if order := preset.read_word(name, _WALL_ORDERS):
        conversion.put("external_perimeter_first", order.startswith("outer wall"), name)
    else:
        conversion.copy_switch("external_perimeter_first", "external_perimeters_first")
    conversion.copy_switch("infill_first", "infill_first")


def _convert_scarf_joints(conversion: Conversion) -> None:
    """Convert the length and start height of scarf joints, and whether inner perimeters have them."""
    preset = conversion.preset
    kind, length = "seam_slope_type", "seam_slope_min_length"
    if preset.read_word(kind, ["none", *_SCARFS]) not in _SCARFS:
        conversion.switch_off("scarf_length", 0, kind)
        conversion.mark_used(name for name in preset.entries if name.startswith(("seam_slope_", "scarf_")))
        return
    is_entire_loop = preset.is_on("seam_slope_entire_loop")
    how = "; ".join(
        text
        for text, there in (
            ("around the whole loop in the source", is_entire_loop),
            ("also in holes here", preset.read_text(kind) == "external"),
            ("also at corners here", preset.is_on("seam_slope_conditional")),
        )
        if there
    )
    reach = 100.0 if is_entire_loop else preset.read_number(length)
    names = (kind, length, "seam_slope_entire_loop", "seam_slope_conditional", "scarf_angle_threshold")
    conversion.clamp("scarf_length", reach, 0, 100, names, how)
    if how:
        conversion.mark_different()
    start = preset.read_quantity("seam_slope_start_height")
    share = start.value / 100 if start.is_percent else start.value / float(conversion.values["layer_height"])
    how = "as a ratio of the layer height" if start.value and not start.is_percent else ""
    conversion.clamp("scarf_start", share, 0, 0.9, "seam_slope_start_height", how)
    conversion.copy_switch("scarf_inner", "seam_slope_inner_walls")


def _convert_contouring(conversion: Conversion) -> None:
    """Convert contoured tops, which only OrcaSlicer has."""
    switch, height = "zaa_enabled", "zaa_min_z"
    if not conversion.preset.is_on(switch):
        conversion.switch_off("z_contouring", False, switch)
        conversion.mark_used(name for name in conversion.preset.entries if name.startswith("zaa_"))
        return
    conversion.put("z_contouring", True, switch)
    conversion.clamp("contour_min_height", conversion.preset.read_number(height), 0.02, 0.2, height)


def _convert_shells(conversion: Conversion, height: float) -> None:
    """Convert top and bottom shells to thicknesses, and convert ironing and bridges.

    The thickness is the height of the solid layers, or the minimum thickness if that is greater.
    """
    preset = conversion.preset
    first = float(conversion.values["first_layer_height"])
    for side, begin in (("bottom", first), ("top", height)):
        count, least = (
            preset.read_number(f"{side}_solid_layers"),
            preset.read_number(f"{side}_solid_min_thickness"),
        )
        thickness = begin + (count - 1) * height if count >= 1 else 0.0
        how = "" if least > thickness else f"{count:g} layers" if count else ""
        names = (f"{side}_solid_layers", f"{side}_solid_min_thickness")
        conversion.clamp(f"{side}_thickness", max(thickness, least if count else 0), 0, 1000, names, how)
    name = "ensure_vertical_shell_thickness"
    full = preset.read_word(name, [*_VERTICAL_SHELLS, *_NO_VERTICAL_SHELLS]) not in _NO_VERTICAL_SHELLS
    how = "0.9 of the shell thickness on slopes" if full else ""
    conversion.put("slope_shell_ratio", 0.9 if full else 0, name, how, differs=full)
    _convert_ironing(conversion)
    conversion.copy_switch("thick_bridges", "thick_bridges")
    conversion.clamp(
        "bridge_flow_ratio", preset.read_number("bridge_flow_ratio"), 0.3, 2, "bridge_flow_ratio"
    )
    conversion.mark_used(["top_fill_pattern", "bottom_fill_pattern", "external_fill_pattern"])


def _convert_ironing(conversion: Conversion) -> None:
    """Convert ironing; OrcaSlicer switches it on by its type."""
    preset = conversion.preset
    word = preset.read_word("ironing_type", [*_IRONED, *_NOT_IRONED])
    is_ironed = word not in _NOT_IRONED if preset.dialect == "orca" else preset.is_on("ironing")
    how = _IRONED.get(word, "") if is_ironed else ""
    conversion.put("ironing", is_ironed, ("ironing", "ironing_type"), how, differs=bool(how))
    conversion.clamp("ironing_spacing", preset.read_number("ironing_spacing"), 0.1, 1, "ironing_spacing")
    conversion.clamp(
        "ironing_flow_ratio", conversion.resolve("ironing_flowrate", 1.0), 0.01, 0.3, "ironing_flowrate"
    )


def _convert_infill(conversion: Conversion, height: float, width: float) -> None:
    """Convert the pattern, the density, the direction and the anchors of infill."""
    preset = conversion.preset
    conversion.convert_choice("infill", "fill_pattern", _PATTERNS, _NEAR_PATTERNS, "rectilinear")
    density = preset.read_quantity("fill_density")
    share = density.value / 100 if density.is_percent or density.value > 1 else density.value
    if not 0 <= share <= 1:
        raise conversion.make_error(
            "fill_density", f"a density of {100 * share:g} % is out of range", "Write 0 to 100 %"
        )
    conversion.put("infill_density", share, "fill_density")
    if preset.has("infill_overlap"):
        _convert_overlap(conversion, height, width)
    conversion.clamp("infill_angle_deg", preset.read_number("fill_angle"), -360, 360, "fill_angle")
    conversion.clamp(
        "solid_infill_below_area",
        preset.read_number("solid_infill_below_area"),
        0,
        1e6,
        "solid_infill_below_area",
    )
    for name, most in (("infill_anchor", 50), ("infill_anchor_max", 1000)):
        found = preset.read_quantity(name)
        length = min(found.resolve(width), most)  # in the source, 1000 means no limit
        how = "percentage of the extrusion width" if found.is_percent else ""
        how = how if length == found.resolve(width) else f"{most} is the maximum here"
        conversion.clamp(name, length, 0, most, name, how)
    every = preset.read_number("infill_every_layers")
    if every > 1:
        conversion.clamp(
            "internal_infill_every", every * height, 0, 2, "infill_every_layers", f"{every:g} layers"
        )
    else:
        conversion.switch_off("internal_infill_every", 0, "infill_every_layers")


def _convert_overlap(conversion: Conversion, height: float, width: float) -> None:
    """Convert the overlap of infill with perimeters, mm or a percentage of the spacing, to a ratio of the spacing."""
    spacing = float(bead.spacing(width, height))
    solid = "solid_infill_overlap" if conversion.preset.has("solid_infill_overlap") else "infill_overlap"
    for ours, theirs in (("infill_overlap", solid), ("internal_infill_overlap", "infill_overlap")):
        found = conversion.read_quantity(theirs)
        how = "" if found.is_percent else "as a ratio of the spacing"
        conversion.clamp(ours, round(found.resolve(spacing) / spacing, 4), 0, 0.5, theirs, how)


def _convert_adhesion(conversion: Conversion, height: float) -> None:
    """Convert skirt, brim and raft."""
    preset = conversion.preset
    first = float(conversion.values["first_layer_height"])
    conversion.clamp("skirt_loops", int(preset.read_number("skirts")), 0, 20, "skirts")
    conversion.clamp("skirt_distance", preset.read_number("skirt_distance"), 0, 50, "skirt_distance")
    conversion.clamp("skirt_min_length", preset.read_number("min_skirt_length"), 0, 10000, "min_skirt_length")
    layers = preset.read_number("skirt_height")
    is_draft_shield = preset.read_word("draft_shield", _DRAFT_SHIELDS) in ("enabled", *ON_WORDS)
    skirt_height = 10000 if is_draft_shield else first + (layers - 1) * height if layers > 1 else 0
    conversion.clamp(
        "skirt_height",
        skirt_height,
        0,
        10000,
        ("skirt_height", "draft_shield"),
        f"{layers:g} layers" if skirt_height and not is_draft_shield else "",
    )
    _convert_brim(conversion)
    _convert_raft(conversion, height)


def _convert_brim(conversion: Conversion) -> None:
    """Convert the width, type and gap of the brim, and the angle of brim ears."""
    preset = conversion.preset
    none = preset.read_word("brim_type", [*_BRIMS, *_NEAR_BRIMS, *_NO_BRIM]) in _NO_BRIM
    conversion.clamp(
        "brim_width", 0 if none else preset.read_number("brim_width"), 0, 50, ("brim_width", "brim_type")
    )
    if preset.is_on("brim_ears"):  # a switch of SuperSlicer and old versions of OrcaSlicer
        conversion.put("brim_type", "ears", "brim_ears")
        if preset.has("brim_ears_max_angle"):
            conversion.clamp(
                "brim_ear_angle_deg", preset.read_number("brim_ears_max_angle"), 0, 180, "brim_ears_max_angle"
            )
    elif not none:
        conversion.convert_choice("brim_type", "brim_type", _BRIMS, _NEAR_BRIMS, "outer")
    conversion.clamp("brim_gap", max(preset.read_number("brim_separation"), 0), 0, 5, "brim_separation")


def _convert_raft(conversion: Conversion, height: float) -> None:
    """Convert the raft; a part on a raft has no brim."""
    preset = conversion.preset
    first = float(conversion.values["first_layer_height"])
    raft = preset.read_number("raft_layers")
    conversion.mark_used(_RAFT_SETTINGS)
    if raft >= 1:
        conversion.clamp("raft_height", first + (raft - 1) * height, 0, 50, "raft_layers", f"{raft:g} layers")
        conversion.clamp(
            "raft_gap", preset.read_number("raft_contact_distance"), 0, 1, "raft_contact_distance"
        )
        conversion.clamp(
            "raft_margin",
            preset.read_number("raft_first_layer_expansion"),
            1,
            50,
            "raft_first_layer_expansion",
        )
        conversion.clamp(
            "raft_base_density",
            conversion.resolve("raft_first_layer_density", 1.0),
            0.2,
            1,
            "raft_first_layer_density",
        )
        if conversion.values["brim_width"]:
            conversion.put("brim_width", 0, "brim_width", "a part on a raft has no brim", differs=True)
    else:
        conversion.switch_off("raft_height", 0, "raft_layers")


def _explain_unsupported(name: str, *, supports: bool) -> str:
    """Return the reason why a print setting has no equivalent.

    Args:
        name: name of the setting.
        supports: whether the source prints supports.
    """
    if name.startswith("support_") and not supports:
        return SUPPORTS_OFF
    if name.startswith(
        ("wipe_tower", "ooze_prevention", "standby_temperature", "mmu_", "single_extruder")
    ) or name.endswith(("_extruder", "interface_shells")):
        return ONE_TOOL
    if name == "travel_acceleration":
        return "travel_acceleration is a printer setting: set it there"
    if name in _WIDTHS:
        return "extrusion_width applies to everything but external perimeters and the first layer"
    if name.startswith("zaa_"):
        return "the rule of z_contouring is based on slope, extrusion width and layer height"
    if name == "max_volumetric_speed":
        return "max_flow of the material limits the flow"
    return "no equivalent"
