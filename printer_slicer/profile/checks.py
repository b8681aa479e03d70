"""What settings must satisfy together, beyond the bounds of each."""

from __future__ import annotations

from math import floor

from printer_slicer.errors import ProfileError
from printer_slicer.profile.settings import Profile

__all__ = ["check_together"]


def check_together(profile: Profile) -> None:
    """Refuse settings that contradict each other.

    Raises:
        ProfileError: naming both settings and what to change.
    """
    _check_layers(profile)
    _check_widths(profile)
    _check_heat(profile)


def _check_layers(profile: Profile) -> None:
    """Every layer height that a planner may use lies within the printer's limits and on its z steps."""
    printer, quality = profile.printer, profile.quality
    if printer.min_layer > printer.max_layer:
        raise ProfileError(
            f"printer.min_layer {printer.min_layer:g} is over printer.max_layer {printer.max_layer:g}"
        )
    if profile.thinnest > profile.thickest:
        raise ProfileError(
            f"quality.thinnest_layer {profile.thinnest:g} is over quality.thickest_layer {profile.thickest:g}"
        )
    named = {
        "quality.layer_height": quality.layer_height,
        "quality.first_layer_height": quality.first_layer_height,
        "quality.thinnest_layer": quality.thinnest_layer,
        "quality.thickest_layer": quality.thickest_layer,
    }
    variable = quality.planner.__struct_config__.tag != "uniform"
    for name, height in named.items():
        if height == 0 or (variable and name == "quality.layer_height"):
            continue
        if not printer.min_layer - 1e-9 <= height <= printer.max_layer + 1e-9:
            raise ProfileError(
                f"{name} is {height:g} mm, but printer {printer.name!r} prints layers of "
                f"{printer.min_layer:g} to {printer.max_layer:g} mm",
                remedy=f"choose a height in that range, or a printer that prints {height:g} mm",
            )
        steps = height / printer.z_step
        if abs(steps - round(steps)) > 1e-6:
            lower = floor(steps) * printer.z_step
            raise ProfileError(
                f"{name} is {height:g} mm, which is no multiple of printer.z_step {printer.z_step:g} mm",
                remedy=f"take {lower:g} or {lower + printer.z_step:g}",
            )


def _check_widths(profile: Profile) -> None:
    """Beads are at least as wide as high, and the nozzle can press them flat."""
    nozzle, width = profile.printer.nozzle_diameter, profile.extrusion_width
    variable = profile.quality.planner.__struct_config__.tag != "uniform"
    highest = (
        profile.thickest
        if variable
        else max(profile.quality.layer_height, profile.quality.first_layer_height)
    )
    if highest > 1.0 * nozzle + 1e-9:
        raise ProfileError(
            f"layers of {highest:g} mm are higher than the nozzle is wide ({nozzle:g} mm)",
            remedy="lower printer.max_layer or quality.thickest_layer, or take a wider nozzle",
        )
    if width < highest:
        raise ProfileError(
            f"quality.extrusion_width {width:g} mm is under the layer height {highest:g} mm",
            remedy="a bead is at least as wide as high: widen it or take thinner layers",
        )
    if not 0.6 * nozzle <= width <= 2.5 * nozzle:
        raise ProfileError(
            f"quality.extrusion_width {width:g} mm does not suit a nozzle of {nozzle:g} mm",
            remedy=f"choose {0.6 * nozzle:g} to {2.5 * nozzle:g} mm",
        )


def _check_heat(profile: Profile) -> None:
    """The machine stands the temperatures of the material."""
    printer, material = profile.printer, profile.material
    for heater, limit in (("nozzle", printer.max_nozzle_temperature), ("bed", printer.max_bed_temperature)):
        for name in (f"{heater}_temperature", f"first_layer_{heater}_temperature"):
            wanted = getattr(material, name)
            # A printer without a heated bed prints materials that would like one; heat is then not asked for.
            if wanted > limit and not (heater == "bed" and limit == 0):
                raise ProfileError(
                    f"material.{name} is {wanted:g} °C, but printer {printer.name!r} allows {limit:g} °C",
                    remedy="choose another material or printer",
                )
