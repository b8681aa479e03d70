"""Printer settings that the host needs during a print; each print stores its own copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from printer_slicer.firmware import FIRMWARES, Firmware
from printer_slicer.motion.rules import MotionLimits, limits_of
from printer_slicer.printing.journal import restore_struct
from printer_slicer.values import Struct, as_dict, field

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["HostSettings", "make_host_settings", "parse_host_settings"]


class HostSettings(Struct, frozen=True):
    """Printer settings that the host needs during a print. Lengths in mm, speeds in mm/s.

    Attributes:
        flavour: G-code flavour of the firmware.
        limits: motion limits.
        window_bytes: maximum number of bytes in flight.
        baud: baud rate of the port.
        low, high: front left and back right corner of the bed.
        top: maximum z.
        retract, retract_speed, deretract_speed: length and speeds of the retraction at a pause.
        travel_speed, lift_speed: speeds of the moves to and from the parking position.
        lift: height of the nozzle over the part while parked.
        purge: length of filament purged after the nozzle was cold.
        coldest: minimum nozzle temperature for extrusion, °C.
        settings: all settings of the profile, to check commands typed by a user; empty: no check.
        allowed: names of the findings that were allowed.
    """

    flavour: str
    limits: MotionLimits
    window_bytes: int
    baud: int
    low: tuple[float, float]
    high: tuple[float, float]
    top: float
    retract: float
    retract_speed: float
    deretract_speed: float
    travel_speed: float
    lift_speed: float
    lift: float = 5.0
    purge: float = 10.0
    coldest: float = 170.0
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    allowed: tuple[str, ...] = ()

    @property
    def firmware(self) -> Firmware:
        """Return the properties of the firmware with this G-code flavour."""
        return FIRMWARES[self.flavour]

    def as_json(self) -> dict[str, Any]:
        """Return the settings as a JSON object."""
        return as_dict(self)


def make_host_settings(profile: Profile, allowed: Iterable[str] = ()) -> HostSettings:
    """Return the host settings of a profile; `allowed` holds the names of the findings that are allowed."""
    from printer_slicer.profile import settings_as_dict  # noqa: PLC0415 - not needed when settings are read from the job store

    printer = profile.printer
    low, high = printer.corners
    return HostSettings(
        flavour=printer.flavour,
        limits=limits_of(printer),
        window_bytes=printer.receive_buffer - 1,
        baud=printer.baud,
        low=low,
        high=high,
        top=printer.bed_z,
        retract=min(max(printer.retract_length, 0.5), 6.0),
        retract_speed=printer.retract_speed,
        deretract_speed=printer.deretract_speed,
        travel_speed=min(100.0, printer.max_speed_x, printer.max_speed_y),
        lift_speed=min(10.0, printer.max_speed_z),
        settings=settings_as_dict(profile),
        allowed=tuple(sorted(allowed)),
    )


def parse_host_settings(values: Mapping[str, Any]) -> HostSettings:
    """Restore host settings from the JSON object that `HostSettings.as_json` has returned.

    Raises:
        TypeError: a value has the wrong type.
    """
    setup = restore_struct(HostSettings, values)
    if setup.flavour not in FIRMWARES:
        raise TypeError(f"flavour is {setup.flavour!r}, which this version does not support")
    return setup
