"""The three owners of settings together, and what follows from several settings at once."""

from __future__ import annotations

from typing import NamedTuple

from msgspec.structs import replace

from printer_slicer.profile.base import Settings
from printer_slicer.profile.role_motion import (
    resolve_accelerations,
    resolve_flow,
    resolve_pressure_advance,
    resolve_speeds,
)
from printer_slicer.profile.settings import (
    Accelerations,
    Material,
    OptimalPlanner,
    Printer,
    Quality,
    Speeds,
)

__all__ = ["HIGHEST_BEAD", "Extruder", "Profile"]

HIGHEST_BEAD = 0.8  # nozzle diameters; higher beads are not pressed onto the layer below


class Extruder(NamedTuple):
    """One of the machine's extruders, and what is in it.

    Attributes:
        tool: its number on the machine, as in T0.
        nozzle_diameter: mm.
        material: the filament.
    """

    tool: int
    nozzle_diameter: float
    material: Material


class Profile(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything that decides how a part becomes G-code."""

    printer: Printer
    material: Material
    quality: Quality

    @property
    def dials(self) -> OptimalPlanner:
        """The dials of the planner `optimal`; as they usually are where another planner is chosen."""
        planner = self.quality.planner
        return planner if isinstance(planner, OptimalPlanner) else OptimalPlanner()

    @property
    def extruders(self) -> tuple[Extruder, ...]:
        """Those that print; paths and moves name one by its place in this tuple. Profiles have one so far."""
        return (Extruder(self.printer.tool, self.printer.nozzle_diameter, self.material),)

    @property
    def speeds(self) -> Speeds:
        """Speed of each role, mm/s, including the printer's; see `resolve_speeds`."""
        return resolve_speeds(self.printer, self.quality)

    @property
    def raft_interface_speed(self) -> float:
        """Speed of a raft's top layer, mm/s: that of the support interface, unless the quality sets `raft`."""
        resolved, named = self.speeds, self.quality.speeds.raft
        return named or min(resolved.raft, resolved.support_interface)

    @property
    def accelerations(self) -> Accelerations:
        """Acceleration of each role, mm/s², including the printer's; see `resolve_accelerations`."""
        return resolve_accelerations(self.printer, self.quality)

    @property
    def max_flow(self) -> float:
        """Flow limit of hotend and material, mm³/s."""
        return resolve_flow(self.printer, self.material)

    @property
    def pressure_advance(self) -> float:
        """Pressure advance set in the G-code, s; 0: none."""
        return resolve_pressure_advance(self.printer, self.material)

    @property
    def resolved(self) -> Profile:
        """Return the profile with all values that quality and material leave to the printer."""
        return replace(
            self,
            material=replace(self.material, max_flow=self.max_flow, pressure_advance=self.pressure_advance),
            quality=replace(self.quality, speeds=self.speeds, accelerations=self.accelerations),
        )

    @property
    def extrusion_width(self) -> float:
        """Width of a bead, mm, with the default filled in."""
        return self.quality.extrusion_width or 1.125 * self.printer.nozzle_diameter

    @property
    def width_on_bed(self) -> float:
        """Width of a bead on the bed, mm, with the default filled in."""
        return self.quality.first_layer_width or self.extrusion_width

    @property
    def width_of_first_layer(self) -> float:
        """Width of a bead in the part's first layer, mm: that on the bed, unless there is a raft between."""
        return self.extrusion_width if self.quality.raft_height else self.width_on_bed

    @property
    def bead_widths(self) -> tuple[float, float]:
        """Narrowest and widest bead in narrow places, mm, with the defaults filled in."""
        quality, nozzle, width = self.quality, self.printer.nozzle_diameter, self.extrusion_width
        narrowest = quality.min_bead_width or min(0.85 * nozzle, width)
        return narrowest, quality.max_bead_width or max(1.65 * nozzle, width)

    @property
    def highest_bead(self) -> float:
        """Highest bead that the nozzle presses down and that is no higher than wide, mm."""
        return min(HIGHEST_BEAD * self.printer.nozzle_diameter, self.extrusion_width)

    @property
    def thinnest_feature(self) -> float:
        """Thinnest wall that is printed, mm, with the default filled in."""
        return self.quality.min_feature or 0.25 * self.printer.nozzle_diameter

    @property
    def thinnest(self) -> float:
        """Thinnest layer a planner may choose, mm."""
        return min(self.quality.layer_heights, default=self.quality.thinnest_layer or self.printer.min_layer)

    @property
    def thickest(self) -> float:
        """Thickest layer a planner may choose, mm."""
        return max(self.quality.layer_heights, default=self.quality.thickest_layer or self.printer.max_layer)
