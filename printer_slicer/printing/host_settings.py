"""What of a profile the host needs once a job is made: kept in the journal, so that profiles may change meanwhile."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from printer_slicer.firmware import FIRMWARES, Firmware
from printer_slicer.motion.rules import MotionLimits, limits_of
from printer_slicer.printing.journal import dataclass_from_json

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["HostSettings", "host_settings_from", "parse_host_settings"]


@dataclass(frozen=True, slots=True)
class HostSettings:
    """The printer, as the host sees it. Lengths mm, speeds mm/s.

    Attributes:
        flavour: of its firmware.
        limits: of its motion.
        window_bytes: most bytes in flight.
        baud: of the port.
        low, high: front left and back right corner of the bed.
        top: greatest z.
        retract, retract_speed, deretract_speed: of the filament around a pause.
        travel_speed, lift_speed: of moves to and from the parking place.
        lift: of the nozzle over the part.
        purge: mm of filament pushed out and lost after the nozzle was cold.
        coldest: °C below which the extruder must not turn.
        settings: all of the profile, by which commands are judged that a person types; empty: they are not.
        allowed: names of what was allowed all the same.
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
        """Its firmware."""
        return FIRMWARES[self.flavour]

    def as_json(self) -> dict[str, Any]:
        """As JSON holds it."""
        return asdict(self)


def host_settings_from(profile: Profile, allowed: Iterable[str] = ()) -> HostSettings:
    """What a profile says, and what was allowed against it."""
    from printer_slicer.profile import settings_of  # noqa: PLC0415 - a setup that is there needs no profile

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
        settings=settings_of(profile),
        allowed=tuple(sorted(allowed)),
    )


def parse_host_settings(values: Mapping[str, Any]) -> HostSettings:
    """What `as_json` gave.

    Raises:
        TypeError: a value has the wrong type.
    """
    setup = dataclass_from_json(HostSettings, values)
    if setup.flavour not in FIRMWARES:
        raise TypeError(f"flavour is {setup.flavour!r}, which this version does not support")
    return setup
