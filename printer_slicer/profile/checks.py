"""Find conflicts between settings that are valid one by one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import floor
from typing import NamedTuple

from printer_slicer.profile.print_head import parse_head_shape
from printer_slicer.profile.profile import HIGHEST_BEAD, Profile
from printer_slicer.profile.settings import OptimalPlanner, Quality

__all__ = ["Conflict", "find_all_conflicts", "find_planner_conflicts"]

LARGEST_THUMBNAIL = 1024  # px


class Conflict(NamedTuple):
    """A conflict between settings.

    Attributes:
        key: the setting to change first, `section.name`.
        problem: the conflict, with the values.
        remedy: what to do.
    """

    key: str
    problem: str
    remedy: str


def find_all_conflicts(profile: Profile) -> Iterator[Conflict]:
    """Yield the conflicts between the settings of a profile."""
    yield from _check_layer_heights(profile)
    yield from _check_planner(profile)
    yield from _check_widths(profile)
    yield from _check_raft(profile)
    yield from _check_temperatures(profile)
    yield from _check_firmware(profile)
    yield from _check_bed(profile)
    yield from _check_print_order(profile)
    yield from _check_thumbnails(profile)


def _has_variable_layers(profile: Profile) -> bool:
    """Return whether the planner chooses layer heights."""
    return profile.quality.planner.__struct_config__.tag != "uniform"


def _check_layer_heights(profile: Profile) -> Iterator[Conflict]:
    """Check that all layer heights lie within the printer's limits and are multiples of its z step."""
    printer = profile.printer
    if printer.min_layer > printer.max_layer:
        problem = f"{printer.min_layer:g} mm is more than printer.max_layer ({printer.max_layer:g} mm)"
        yield Conflict("printer.min_layer", problem, "Lower printer.min_layer, or raise printer.max_layer")
    if profile.thinnest > profile.thickest:
        problem = f"{profile.thinnest:g} mm is more than the maximum layer height ({profile.thickest:g} mm)"
        yield Conflict("quality.thinnest_layer", problem, "Lower it, or raise quality.thickest_layer")
    for name, height in _list_layer_heights(profile):
        if not printer.min_layer - 1e-9 <= height <= printer.max_layer + 1e-9:
            yield Conflict(
                f"quality.{name}",
                f"{height:g} mm is outside the layer heights of printer {printer.name!r}, "
                f"{printer.min_layer:g} to {printer.max_layer:g} mm",
                f"Choose a height in that range, or a printer that supports {height:g} mm",
            )
        steps = height / printer.z_step
        if abs(steps - round(steps)) > 1e-6:
            lower = floor(steps) * printer.z_step
            yield Conflict(
                f"quality.{name}",
                f"{height:g} mm is not a multiple of printer.z_step ({printer.z_step:g} mm)",
                f"Use {lower:g} or {lower + printer.z_step:g}",
            )


def _list_layer_heights(profile: Profile) -> Iterator[tuple[str, float]]:
    """Yield the key and the value of each layer height in the quality, mm."""
    quality = profile.quality
    for name in ("layer_height", "first_layer_height", "thinnest_layer", "thickest_layer"):
        height = getattr(quality, name)
        if height and not (_has_variable_layers(profile) and name == "layer_height"):
            yield name, height
    yield from (("layer_heights", height) for height in quality.layer_heights)
    if isinstance(quality.planner, OptimalPlanner):
        for one in quality.planner.ranges:
            if one.layer_height:
                yield "planner.ranges", one.layer_height


def _check_planner(profile: Profile) -> Iterator[Conflict]:
    """Check the settings of the planner against each other and the printer."""
    quality, printer = profile.quality, profile.printer
    steps = quality.layer_step / printer.z_step
    if abs(steps - round(steps)) > 1e-6:
        problem = f"{quality.layer_step:g} mm is not a multiple of printer.z_step ({printer.z_step:g} mm)"
        yield Conflict("quality.layer_step", problem, f"Use {max(floor(steps), 1) * printer.z_step:g}")
    if printer.z_full_step:
        microsteps = printer.z_full_step / printer.z_step
        if abs(microsteps - round(microsteps)) > 1e-6:
            problem = (
                f"{printer.z_full_step:g} mm is not a multiple of printer.z_step ({printer.z_step:g} mm)"
            )
            yield Conflict(
                "printer.z_full_step",
                problem,
                "Correct one of them: a full step is a whole number of microsteps",
            )
    if isinstance(quality.planner, OptimalPlanner) and quality.planner.stacks == "features":
        yield from _check_features(quality, quality.planner)
    yield from find_planner_conflicts(quality)


def _check_features(quality: Quality, planner: OptimalPlanner) -> Iterator[Conflict]:
    """Yield what cannot be had together with layers of their own for features."""
    if quality.support != "off":
        problem = "features with layers of their own cannot have supports"
        yield Conflict("quality.planner.stacks", problem, "Set it to objects, or quality.support to off")
    if quality.spiral:
        problem = "a spiral has no layers of its own for features"
        yield Conflict("quality.planner.stacks", problem, "Set it to objects, or quality.spiral to false")
    if planner.max_layers:
        problem = "the number of layers cannot be limited for features with layers of their own"
        yield Conflict(
            "quality.planner.stacks", problem, "Set it to objects, or quality.planner.max_layers to 0"
        )


def find_planner_conflicts(quality: Quality) -> Iterator[Conflict]:
    """Yield the conflicts between the settings of a quality's planner."""
    planner = quality.planner
    if not isinstance(planner, OptimalPlanner):
        return
    if planner.max_layers and planner.time_budget:
        problem = "cannot be combined with quality.planner.time_budget"
        yield Conflict("quality.planner.max_layers", problem, "Set one of them to 0")
    for one in planner.ranges:
        if one.high <= one.low:
            problem = f"the height range from {one.low:g} to {one.high:g} mm is empty"
            yield Conflict("quality.planner.ranges", problem, "Write the lower end first")
    forced = sorted((one for one in planner.ranges if one.layer_height), key=lambda one: one.low)
    for lower, upper in pairwise(forced):
        if upper.low < lower.high and upper.layer_height != lower.layer_height:
            problem = f"two layer heights apply between {upper.low:g} and {min(lower.high, upper.high):g} mm"
            yield Conflict("quality.planner.ranges", problem, "End one range where the other one starts")


def _check_widths(profile: Profile) -> Iterator[Conflict]:
    """Check that extrusions are not higher than wide, and that their widths suit the nozzle."""
    nozzle = profile.printer.nozzle_diameter
    uniform = max(profile.quality.layer_height, profile.quality.first_layer_height)
    highest = profile.thickest if _has_variable_layers(profile) else uniform
    if highest > HIGHEST_BEAD * nozzle + 1e-9:
        yield Conflict(
            "printer.nozzle_diameter",
            f"{nozzle:g} mm allows layers up to {HIGHEST_BEAD * nozzle:g} mm, but layers are {highest:g} mm high",
            "Lower quality.thickest_layer or quality.layer_height, or use a larger nozzle",
        )
    widths = {
        "extrusion_width": profile.extrusion_width,
        "external_perimeter_width": profile.quality.external_perimeter_width,
        "first_layer_width": profile.quality.first_layer_width,
    }
    for name, width in widths.items():
        if not width:
            continue
        if width < highest:
            yield Conflict(
                f"quality.{name}",
                f"{width:g} mm is less than the layer height ({highest:g} mm)",
                "Increase the extrusion width, or use thinner layers",
            )
        if not 0.6 * nozzle <= width <= 2.5 * nozzle:
            yield Conflict(
                f"quality.{name}",
                f"{width:g} mm does not suit a nozzle of {nozzle:g} mm",
                f"Choose {0.6 * nozzle:g} to {2.5 * nozzle:g} mm",
            )
    narrowest, widest = profile.bead_widths
    if not narrowest <= profile.extrusion_width <= widest:
        yield Conflict(
            "quality.min_bead_width" if narrowest > profile.extrusion_width else "quality.max_bead_width",
            f"the extrusion width of {profile.extrusion_width:g} mm is outside {narrowest:g} to {widest:g} mm",
            "Choose minimum and maximum so that the extrusion width lies between them",
        )


def _check_raft(profile: Profile) -> Iterator[Conflict]:
    """Check that raft heights are multiples of the z step, and that a raft has no brim."""
    quality, step = profile.quality, profile.printer.z_step
    if not quality.raft_height:
        return
    for name in ("raft_height", "raft_gap"):
        wanted = getattr(quality, name)
        steps = wanted / step
        if abs(steps - round(steps)) > 1e-6:
            problem = f"{wanted:g} mm is not a multiple of printer.z_step ({step:g} mm)"
            yield Conflict(
                f"quality.{name}",
                problem,
                f"Use {floor(steps) * step:g} or {(floor(steps) + 1) * step:g}",
            )
    if quality.brim_width:
        problem = f"a brim of {quality.brim_width:g} mm cannot be combined with a raft"
        yield Conflict("quality.brim_width", problem, "Set quality.brim_width or quality.raft_height to 0")


def _check_temperatures(profile: Profile) -> Iterator[Conflict]:
    """Check that the printer allows the temperatures of the material."""
    printer, material = profile.printer, profile.material
    for heater, limit in (("nozzle", printer.max_nozzle_temperature), ("bed", printer.max_bed_temperature)):
        for name in (f"{heater}_temperature", f"first_layer_{heater}_temperature"):
            wanted = getattr(material, name)
            if wanted > limit:
                yield Conflict(
                    f"material.{name}",
                    f"{wanted:g} °C is more than printer {printer.name!r} allows ({limit:g} °C)",
                    "Choose another material or printer",
                )


def _check_bed(profile: Profile) -> Iterator[Conflict]:
    """Check that the margin leaves room on the bed, and that excluded areas and shapes of the head have an area."""
    printer = profile.printer
    if 2 * printer.bed_margin >= min(printer.bed_x, printer.bed_y):
        bed = f"{printer.bed_x:g} x {printer.bed_y:g} mm"
        problem = f"{printer.bed_margin:g} mm on each side leave no room on a bed of {bed}"
        yield Conflict("printer.bed_margin", problem, "Choose a smaller margin")
    areas = zip(printer.excluded_areas, printer.excluded_polygons, strict=True)
    shapes = ((text, parse_head_shape(text).corners) for text in printer.head)
    for name, outlines in (("excluded_areas", areas), ("head", shapes)):
        for text, polygon in outlines:
            xs, ys = zip(*polygon, strict=True)
            if min(max(xs) - min(xs), max(ys) - min(ys)) <= 0:
                remedy = "Write its corners, or two opposite corners"
                yield Conflict(f"printer.{name}", f"{text!r} has no area", remedy)


def _check_print_order(profile: Profile) -> Iterator[Conflict]:
    """Check that objects that are printed one after the other have no draft shield around them all."""
    quality = profile.quality
    if (
        quality.print_order == "by_object"
        and quality.skirt_loops
        and quality.skirt_height > quality.first_layer_height
    ):
        problem = f"a skirt of {quality.skirt_height:g} mm height surrounds objects that are printed later"
        yield Conflict("quality.skirt_height", problem, "Set skirt_height = 0, or print_order = by_layer")


def _check_thumbnails(profile: Profile) -> Iterator[Conflict]:
    """Check that thumbnails are not too large for the programs that show them."""
    for one in profile.printer.thumbnails:
        if max(int(side) for side in one.partition("/")[0].split("x")) > LARGEST_THUMBNAIL:
            problem = f"{one} is larger than {LARGEST_THUMBNAIL} px"
            yield Conflict("printer.thumbnails", problem, f"Choose {LARGEST_THUMBNAIL} px or less")


def _check_firmware(profile: Profile) -> Iterator[Conflict]:
    """Check that the firmware supports the settings."""
    printer, dialect = profile.printer, profile.printer.firmware.dialect
    if printer.firmware_retraction and dialect.retraction is None:
        problem = f"flavour {printer.flavour} has no command to set the retraction length"
        yield Conflict("printer.firmware_retraction", problem, "Set it to false")
    if printer.firmware_retraction and printer.wipe_distance:
        problem = "a wipe cannot be combined with firmware retraction"
        yield Conflict(
            "printer.wipe_distance", problem, "Set it to 0, or printer.firmware_retraction to false"
        )
    if profile.material.pressure_advance and dialect.pressure_advance is None:
        problem = f"flavour {printer.flavour} has no command for pressure advance"
        yield Conflict("material.pressure_advance", problem, "Set it to 0")
