"""Resolve speed, acceleration and flow of each role from quality, printer and material.

All stages get them through `Profile`; no other module applies factors.
"""

from __future__ import annotations

from typing import Final

from msgspec.structs import replace

from printer_slicer.profile.settings import Accelerations, Material, Printer, Quality, Speeds

__all__ = [
    "USUAL_FLOW",
    "resolve_accelerations",
    "resolve_flow",
    "resolve_pressure_advance",
    "resolve_speeds",
]

USUAL_FLOW: Final = 12.0
"""Flow limit of a standard 0.4 mm hotend for PLA, mm³/s, if neither printer nor material sets one."""

_SCALED: Final = ("outer_perimeter", "inner_perimeter", "sparse", "solid", "top_skin", "gap", "support")
_VISIBLE: Final = ("outer_perimeter", "top_skin")
_AS_THEY_ARE: Final = ("bridge", "internal_bridge", "small_perimeter", "travel", "first_layer")


def resolve_speeds(printer: Printer, quality: Quality) -> Speeds:
    """Return the speeds of a quality, mm/s, with zeros replaced by the printer's values.

    Only `small_perimeter` may stay 0: such perimeters are as fast as others. Zeros of the printer that refer to
    another of its speeds are replaced too. Values from the printer are limited by the speed of its axes.
    """
    own, wanted = printer.speeds, quality.speeds
    fastest = max(printer.max_speed_x, printer.max_speed_y)
    usual = {name: getattr(own, name) for name in (*_SCALED, *_AS_THEY_ARE)}
    usual["gap"] = own.gap or own.inner_perimeter
    usual["support_interface"] = own.support_interface or own.support
    usual |= {name: usual[name] * wanted.ratio for name in (*_SCALED, "support_interface")}
    if wanted.visible_most:
        usual |= {name: min(usual[name], wanted.visible_most) for name in _VISIBLE}
    filled = {name: getattr(wanted, name) or min(speed, fastest) for name, speed in usual.items()}
    if not own.gap and not wanted.gap:
        filled["gap"] = filled["inner_perimeter"]
    filled["raft"] = wanted.raft or filled["support"]
    infill = wanted.first_layer or own.first_layer_infill or own.first_layer
    filled["first_layer_infill"] = wanted.first_layer_infill or infill
    travel = wanted.first_layer_travel or own.first_layer_travel or filled["travel"]
    filled["first_layer_travel"] = min(travel, filled["travel"])
    return replace(wanted, **filled)


def resolve_accelerations(printer: Printer, quality: Quality) -> Accelerations:
    """Return the accelerations of a quality with zeros replaced, mm/s²: at most `printer.acceleration`.

    `first_layer` may stay 0: then the first layer has the accelerations of the others.
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
    """Return the flow limit of hotend and material, mm³/s."""
    hotend = printer.hotend_max_flow
    if not material.max_flow:
        return hotend or USUAL_FLOW
    return min(material.max_flow, hotend) if hotend else material.max_flow


def resolve_pressure_advance(printer: Printer, material: Material) -> float:
    """Return the pressure advance, s: the material's, or the printer's for PLA; 0: the firmware's own."""
    if material.pressure_advance:
        return material.pressure_advance
    is_pla = (material.type or material.name).strip().upper() == "PLA"
    return printer.pla_pressure_advance if is_pla and printer.firmware.dialect.pressure_advance else 0.0
