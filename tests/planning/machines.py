"""Shipped printers for the tests of planners, and the same machine with all times scaled."""

from __future__ import annotations

from typing import Final

from msgspec.structs import replace

from printer_slicer.profile import Profile, load_profile

__all__ = ["MACHINES", "machine", "on_another_clock"]

MACHINES: Final = ("marlin_220", "creality_k1", "voron_2_4_350")
"""Slow, quick with a strong hotend, quick with a weaker one."""

_ACCELERATIONS: Final = (
    "acceleration",
    "travel_acceleration",
    "retract_acceleration",
    *(f"max_acceleration_{axis}" for axis in "xyze"),
)
_SPEEDS: Final = (
    "hotend_max_flow",
    "retract_speed",
    "deretract_speed",
    "square_corner_velocity",
    *(f"max_speed_{axis}" for axis in "xyze"),
    *(f"jerk_{axis}" for axis in ("xy", "z", "e")),
)


def machine(name: str, **quality: object) -> Profile:
    """A shipped printer with settings of the quality; `planner__kind` stands for `planner.kind`, `of` for another."""
    of = str(quality.pop("of", "adaptive"))
    changes = {f"quality.{key.replace('__', '.')}": value for key, value in quality.items()}
    return load_profile(name, quality=of, changes=changes)


def on_another_clock(profile: Profile, k: float) -> Profile:
    """The machine on which everything takes 1 / k of the time: it is as this one, seen in slow or in quick motion."""
    printer, material = profile.printer, profile.material
    printer = replace(
        printer,
        speeds=replace(
            printer.speeds,
            **{name: k * getattr(printer.speeds, name) for name in printer.speeds.__struct_fields__},
        ),
        accelerations=replace(
            printer.accelerations,
            **{
                name: k**2 * getattr(printer.accelerations, name)
                for name in printer.accelerations.__struct_fields__
            },
        ),
        **{name: k**2 * getattr(printer, name) for name in _ACCELERATIONS},
        **{name: k * getattr(printer, name) for name in _SPEEDS},
        min_segment_time=printer.min_segment_time / k,
    )
    material = replace(
        material,
        max_flow=k * profile.max_flow,
        min_speed=k * material.min_speed,
        min_layer_time=material.min_layer_time / k,
    )
    return replace(profile, printer=printer, material=material)
