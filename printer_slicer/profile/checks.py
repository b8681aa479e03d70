"""What settings must satisfy together, beyond the bounds of each."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import floor
from typing import NamedTuple

from printer_slicer.profile.profile import HIGHEST_BEAD, Profile
from printer_slicer.profile.settings import OptimalPlanner, Quality

__all__ = ["Conflict", "conflicts", "planner_conflicts"]

LARGEST_THUMBNAIL = 1024  # px


class Conflict(NamedTuple):
    """Two settings that contradict each other.

    Attributes:
        key: the one to change first, `section.name`.
        problem: what is wrong with it, with the values.
        remedy: what to do.
    """

    key: str
    problem: str
    remedy: str


def conflicts(profile: Profile) -> Iterator[Conflict]:
    """Settings of a profile that contradict each other."""
    yield from _layers(profile)
    yield from _planner(profile)
    yield from _widths(profile)
    yield from _raft(profile)
    yield from _heat(profile)
    yield from _firmware(profile)
    yield from _thumbnails(profile)


def _varies(profile: Profile) -> bool:
    return profile.quality.planner.__struct_config__.tag != "uniform"


def _layers(profile: Profile) -> Iterator[Conflict]:
    """Every layer height that a planner may use lies within the printer's limits and on its z steps."""
    printer = profile.printer
    if printer.min_layer > printer.max_layer:
        over = f"{printer.min_layer:g} mm is over printer.max_layer, {printer.max_layer:g} mm"
        yield Conflict("printer.min_layer", over, "lower one or raise the other")
    if profile.thinnest > profile.thickest:
        over = f"{profile.thinnest:g} mm is over the thickest layer, {profile.thickest:g} mm"
        yield Conflict("quality.thinnest_layer", over, "lower it, or raise quality.thickest_layer")
    for name, height in _heights(profile):
        if not printer.min_layer - 1e-9 <= height <= printer.max_layer + 1e-9:
            yield Conflict(
                f"quality.{name}",
                f"{height:g} mm, but printer {printer.name!r} prints layers of "
                f"{printer.min_layer:g} to {printer.max_layer:g} mm",
                f"choose a height in that range, or a printer that prints {height:g} mm",
            )
        steps = height / printer.z_step
        if abs(steps - round(steps)) > 1e-6:
            lower = floor(steps) * printer.z_step
            yield Conflict(
                f"quality.{name}",
                f"{height:g} mm is no multiple of printer.z_step {printer.z_step:g} mm",
                f"take {lower:g} or {lower + printer.z_step:g}",
            )


def _heights(profile: Profile) -> Iterator[tuple[str, float]]:
    """All layer heights that the quality names, each with its key."""
    quality = profile.quality
    for name in ("layer_height", "first_layer_height", "thinnest_layer", "thickest_layer"):
        height = getattr(quality, name)
        if height and not (_varies(profile) and name == "layer_height"):
            yield name, height
    yield from (("layer_heights", height) for height in quality.layer_heights)
    if isinstance(quality.planner, OptimalPlanner):
        for stretch in quality.planner.ranges:
            if stretch.layer_height:
                yield "planner.ranges", stretch.layer_height


def _planner(profile: Profile) -> Iterator[Conflict]:
    """What the settings of a planner must satisfy together."""
    quality, printer = profile.quality, profile.printer
    steps = quality.layer_step / printer.z_step
    if abs(steps - round(steps)) > 1e-6:
        no_multiple = f"{quality.layer_step:g} mm is no multiple of printer.z_step {printer.z_step:g} mm"
        yield Conflict("quality.layer_step", no_multiple, f"take {max(floor(steps), 1) * printer.z_step:g}")
    if printer.z_full_step:
        within = printer.z_full_step / printer.z_step
        if abs(within - round(within)) > 1e-6:
            no_multiple = f"{printer.z_full_step:g} mm is no multiple of printer.z_step {printer.z_step:g} mm"
            yield Conflict(
                "printer.z_full_step", no_multiple, "mend one of them: motors divide full steps evenly"
            )
    yield from planner_conflicts(quality)


def planner_conflicts(quality: Quality) -> Iterator[Conflict]:
    """Settings of a quality's planner that contradict each other, on any printer."""
    planner = quality.planner
    if not isinstance(planner, OptimalPlanner):
        return
    if planner.max_layers and planner.time_budget:
        both = "and quality.planner.time_budget both say how much the least volume error may cost"
        yield Conflict("quality.planner.max_layers", both, "set one of them to 0")
    for stretch in planner.ranges:
        if stretch.high <= stretch.low:
            turned = f"a range from {stretch.low:g} to {stretch.high:g} mm is empty"
            yield Conflict("quality.planner.ranges", turned, "name the lower end first")
    forced = sorted((one for one in planner.ranges if one.layer_height), key=lambda one: one.low)
    for lower, upper in pairwise(forced):
        if upper.low < lower.high and upper.layer_height != lower.layer_height:
            both = f"between {upper.low:g} and {min(lower.high, upper.high):g} mm two layer heights are asked for"
            yield Conflict("quality.planner.ranges", both, "let one range end where the other begins")


def _widths(profile: Profile) -> Iterator[Conflict]:
    """Beads are at least as wide as high, and the nozzle can press them flat."""
    nozzle = profile.printer.nozzle_diameter
    uniform = max(profile.quality.layer_height, profile.quality.first_layer_height)
    highest = profile.thickest if _varies(profile) else uniform
    if highest > HIGHEST_BEAD * nozzle + 1e-9:
        yield Conflict(
            "printer.nozzle_diameter",
            f"{nozzle:g} mm lays beads of {HIGHEST_BEAD * nozzle:g} mm at most, but layers are {highest:g} mm high",
            "lower quality.thickest_layer or quality.layer_height, or take a wider nozzle",
        )
    widths = {
        "extrusion_width": profile.extrusion_width,
        "first_layer_width": profile.quality.first_layer_width,
    }
    for name, width in widths.items():
        if not width:
            continue
        if width < highest:
            yield Conflict(
                f"quality.{name}",
                f"{width:g} mm is under the layer height {highest:g} mm",
                "a bead is at least as wide as high: widen it or take thinner layers",
            )
        if not 0.6 * nozzle <= width <= 2.5 * nozzle:
            yield Conflict(
                f"quality.{name}",
                f"{width:g} mm does not suit a nozzle of {nozzle:g} mm",
                f"choose {0.6 * nozzle:g} to {2.5 * nozzle:g} mm",
            )
    narrowest, widest = profile.bead_widths
    if not narrowest <= profile.extrusion_width <= widest:
        yield Conflict(
            "quality.min_bead_width" if narrowest > profile.extrusion_width else "quality.max_bead_width",
            f"beads of {narrowest:g} to {widest:g} mm, but the usual one is {profile.extrusion_width:g} mm wide",
            "the usual width lies between both",
        )


def _raft(profile: Profile) -> Iterator[Conflict]:
    """A raft takes whole z steps, and the part stands on it instead of holding on by a brim."""
    quality, step = profile.quality, profile.printer.z_step
    if not quality.raft_height:
        return
    for name in ("raft_height", "raft_gap"):
        wanted = getattr(quality, name)
        steps = wanted / step
        if abs(steps - round(steps)) > 1e-6:
            no_multiple = f"{wanted:g} mm is no multiple of printer.z_step {step:g} mm"
            yield Conflict(
                f"quality.{name}",
                no_multiple,
                f"take {floor(steps) * step:g} or {(floor(steps) + 1) * step:g}",
            )
    if quality.brim_width:
        both = f"{quality.brim_width:g} mm, but the part stands on a raft"
        yield Conflict("quality.brim_width", both, "set quality.brim_width or quality.raft_height to 0")


def _heat(profile: Profile) -> Iterator[Conflict]:
    """The machine stands the temperatures of the material."""
    printer, material = profile.printer, profile.material
    for heater, limit in (("nozzle", printer.max_nozzle_temperature), ("bed", printer.max_bed_temperature)):
        for name in (f"{heater}_temperature", f"first_layer_{heater}_temperature"):
            wanted = getattr(material, name)
            if wanted > limit:
                yield Conflict(
                    f"material.{name}",
                    f"{wanted:g} °C, but printer {printer.name!r} allows {limit:g} °C",
                    "choose another material or printer",
                )


def _thumbnails(profile: Profile) -> Iterator[Conflict]:
    """Pictures are small: they are read from the file in one piece."""
    for one in profile.printer.thumbnails:
        if max(int(side) for side in one.partition("/")[0].split("x")) > LARGEST_THUMBNAIL:
            large = f"{one} is over {LARGEST_THUMBNAIL} px"
            yield Conflict("printer.thumbnails", large, f"choose {LARGEST_THUMBNAIL} px or less")


def _firmware(profile: Profile) -> Iterator[Conflict]:
    """The firmware can do what is asked of it."""
    printer, dialect = profile.printer, profile.printer.firmware.dialect
    if printer.firmware_retraction and dialect.retraction is None:
        unable = f"printer.flavour {printer.flavour} cannot be told how far to retract"
        yield Conflict("printer.firmware_retraction", unable, "set it to false")
    if printer.firmware_retraction and printer.wipe_distance:
        both = f"{printer.wipe_distance:g} mm, but the firmware pulls back while the nozzle stands"
        yield Conflict("printer.wipe_distance", both, "set it to 0, or printer.firmware_retraction to false")
    if profile.material.pressure_advance and dialect.pressure_advance is None:
        unable = f"printer.flavour {printer.flavour} has no command for it"
        yield Conflict("material.pressure_advance", unable, "set it to 0")
