"""The profile (printer, material and quality), and values that are derived from several settings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from msgspec.structs import replace

from printer_slicer.profile.base import Settings
from printer_slicer.profile.settings import (
    Accelerations,
    Material,
    OptimalPlanner,
    Printer,
    Quality,
    Speeds,
)

if TYPE_CHECKING:
    from printer_slicer.profile.differences import ChangedSetting

__all__ = [
    "HIGHEST_BEAD",
    "USUAL_FLOW",
    "Extruder",
    "Profile",
    "resolve_accelerations",
    "resolve_flow",
    "resolve_pressure_advance",
    "resolve_speeds",
]

HIGHEST_BEAD = 0.8  # nozzle diameters; higher extrusions are not pressed onto the layer below


class Extruder(NamedTuple):
    """An extruder and its material.

    Attributes:
        tool: tool number, as in T0.
        nozzle_diameter: mm.
        material: the loaded filament.
    """

    tool: int
    nozzle_diameter: float
    material: Material


class Profile(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All settings that determine how a part becomes G-code.

    Attributes:
        printer, material, quality: the settings of each.
        changed: keys, such as `quality.perimeters`, that were changed on top of the named profiles. Profiles with the
            same settings are equal, whatever was changed.
    """

    printer: Printer
    material: Material
    quality: Quality
    changed: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Profile) and self._sections() == other._sections()

    def __hash__(self) -> int:
        return hash(self._sections())

    def _sections(self) -> tuple[Printer, Material, Quality]:
        """Return printer, material and quality."""
        return self.printer, self.material, self.quality

    def __repr__(self) -> str:
        from printer_slicer.profile.differences import format_differences_as_text  # noqa: PLC0415 - only where it is shown

        return format_differences_as_text(self._sections(), self._differences())

    def _repr_html_(self) -> str:
        """Return the table that notebooks show: settings that differ from their defaults."""
        from printer_slicer.profile.differences import format_differences_as_html  # noqa: PLC0415 - only where it is shown

        return format_differences_as_html(self._sections(), self._differences())

    def list_changes(self) -> list[ChangedSetting]:
        """Return the settings that were changed on top of the named profiles."""
        return [one for one in self._differences() if one.is_change] if self.changed else []

    def _differences(self) -> list[ChangedSetting]:
        """Return the changed settings, then the settings of the named profiles that differ from the defaults."""
        from printer_slicer.profile.differences import list_differences  # noqa: PLC0415 - only where it is shown

        sections = {"quality": self.quality, "material": self.material, "printer": self.printer}
        return list_differences(sections, self.changed)

    @property
    def dials(self) -> OptimalPlanner:
        """Settings of the planner `optimal`; if the quality uses another planner, their defaults."""
        planner = self.quality.planner
        return planner if isinstance(planner, OptimalPlanner) else OptimalPlanner()

    @property
    def extruders(self) -> tuple[Extruder, ...]:
        """Extruders that print; paths and moves refer to them by index. So far, every profile has one extruder."""
        return (Extruder(self.printer.tool, self.printer.nozzle_diameter, self.material),)

    @property
    def speeds(self) -> Speeds:
        """Speed of each role, mm/s, from the quality or the printer; see `resolve_speeds`."""
        return resolve_speeds(self.printer, self.quality)

    @property
    def raft_interface_speed(self) -> float:
        """Speed of the top layer of rafts, mm/s: `speeds.raft` of the quality, or the speed of support interfaces."""
        resolved, named = self.speeds, self.quality.speeds.raft
        return named or min(resolved.raft, resolved.support_interface)

    @property
    def accelerations(self) -> Accelerations:
        """Acceleration of each role, mm/s², from the quality or the printer; see `resolve_accelerations`."""
        return resolve_accelerations(self.printer, self.quality)

    @property
    def max_flow(self) -> float:
        """Maximum flow of hotend and material, mm³/s."""
        return resolve_flow(self.printer, self.material)

    @property
    def pressure_advance(self) -> float:
        """Pressure advance set in the G-code, s; 0: none."""
        return resolve_pressure_advance(self.printer, self.material)

    @property
    def resolved(self) -> Profile:
        """A copy of the profile in which the printer's values replace zeros in the quality and the material."""
        return replace(
            self,
            material=replace(self.material, max_flow=self.max_flow, pressure_advance=self.pressure_advance),
            quality=replace(self.quality, speeds=self.speeds, accelerations=self.accelerations),
        )

    @property
    def extrusion_width(self) -> float:
        """Extrusion width, mm; 1.125 nozzle diameters if the quality does not set one."""
        return self.quality.extrusion_width or 1.125 * self.printer.nozzle_diameter

    @property
    def with_external_width(self) -> Profile:
        """A copy of the profile in which all extrusions have the width of external perimeters."""
        wanted = self.quality.external_perimeter_width
        return replace(self, quality=replace(self.quality, extrusion_width=wanted)) if wanted else self

    @property
    def width_on_bed(self) -> float:
        """Width of extrusions that lie on the bed, mm; the general extrusion width if the quality does not set one."""
        return self.quality.first_layer_width or self.extrusion_width

    @property
    def width_of_first_layer(self) -> float:
        """Extrusion width of the part's first layer, mm: the general width on a raft, else the width on the bed."""
        return self.extrusion_width if self.quality.raft_height else self.width_on_bed

    @property
    def bead_widths(self) -> tuple[float, float]:
        """Minimum and maximum extrusion width in thin walls, mm; defaults replace zeros in the quality."""
        quality, nozzle, width = self.quality, self.printer.nozzle_diameter, self.extrusion_width
        narrowest = quality.min_bead_width or min(0.85 * nozzle, width)
        return narrowest, quality.max_bead_width or max(1.65 * nozzle, width)

    @property
    def highest_bead(self) -> float:
        """Maximum height of an extrusion, mm: 0.8 nozzle diameters, and not more than its width."""
        return min(HIGHEST_BEAD * self.printer.nozzle_diameter, self.extrusion_width)

    @property
    def thinnest_feature(self) -> float:
        """Thickness of the thinnest wall that is printed, mm; a default replaces a zero in the quality."""
        return self.quality.min_feature or 0.25 * self.printer.nozzle_diameter

    @property
    def thinnest(self) -> float:
        """Minimum layer height that a planner may choose, mm."""
        return min(self.quality.layer_heights, default=self.quality.thinnest_layer or self.printer.min_layer)

    @property
    def thickest(self) -> float:
        """Maximum layer height that a planner may choose, mm."""
        return max(self.quality.layer_heights, default=self.quality.thickest_layer or self.printer.max_layer)


USUAL_FLOW: Final = 12.0
"""Maximum flow of a standard 0.4 mm hotend with PLA, mm³/s, if neither printer nor material sets one."""

_SCALED_ROLES: Final = (
    "external_perimeter",
    "perimeter",
    "internal_infill",
    "solid_infill",
    "top_solid_infill",
    "gap_fill",
    "support",
)
_VISIBLE_ROLES: Final = ("external_perimeter", "top_solid_infill")
_UNSCALED_ROLES: Final = ("bridge", "internal_bridge", "small_perimeter", "travel", "first_layer")


def resolve_speeds(printer: Printer, quality: Quality) -> Speeds:
    """Return the speeds of a quality, mm/s, with zeros replaced by the printer's values.

    Only `small_perimeter` may stay 0, which means no limit. If the printer's value is 0 and refers to another speed of
    the printer, that speed is used. Values from the printer are limited by the maximum speed of its axes.
    """
    own, wanted = printer.speeds, quality.speeds
    fastest = max(printer.max_speed_x, printer.max_speed_y)
    usual = {name: getattr(own, name) for name in (*_SCALED_ROLES, *_UNSCALED_ROLES)}
    usual["gap_fill"] = own.gap_fill or own.perimeter
    usual["support_interface"] = own.support_interface or own.support
    usual |= {name: usual[name] * wanted.ratio for name in (*_SCALED_ROLES, "support_interface")}
    if wanted.visible_most:
        usual |= {name: min(usual[name], wanted.visible_most) for name in _VISIBLE_ROLES}
    filled = {name: getattr(wanted, name) or min(speed, fastest) for name, speed in usual.items()}
    if not own.gap_fill and not wanted.gap_fill:
        filled["gap_fill"] = filled["perimeter"]
    filled["raft"] = wanted.raft or filled["support"]
    infill = wanted.first_layer or own.first_layer_infill or own.first_layer
    filled["first_layer_infill"] = wanted.first_layer_infill or infill
    travel = wanted.first_layer_travel or own.first_layer_travel or filled["travel"]
    filled["first_layer_travel"] = min(travel, filled["travel"])
    return replace(wanted, **filled)


def resolve_accelerations(printer: Printer, quality: Quality) -> Accelerations:
    """Return the accelerations of a quality, mm/s², with zeros replaced, limited by `printer.acceleration`.

    `first_layer` may stay 0; the first layer then has the accelerations of the other layers.
    """
    own, wanted, most = printer.accelerations, quality.accelerations, printer.acceleration
    filled = {
        name: min(
            getattr(wanted, name) or wanted.default or getattr(own, name) or own.default or most,
            most,
        )
        for name in wanted.__struct_fields__
    }
    filled["first_layer"] = min(wanted.first_layer or own.first_layer, most)
    return replace(wanted, **filled)


def resolve_flow(printer: Printer, material: Material) -> float:
    """Return the maximum flow of hotend and material, mm³/s."""
    hotend = printer.hotend_max_flow
    if not material.max_flow:
        return hotend or USUAL_FLOW
    return min(material.max_flow, hotend) if hotend else material.max_flow


def resolve_pressure_advance(printer: Printer, material: Material) -> float:
    """Return the pressure advance, s, of the material, or of the printer for PLA; 0: the firmware's own value."""
    if material.pressure_advance:
        return material.pressure_advance
    is_pla = (material.type or material.name).strip().upper() == "PLA"
    return printer.pla_pressure_advance if is_pla and printer.firmware.dialect.pressure_advance else 0.0
