"""All heaters of a machine, with their protection, cooling by flowing filament, and temperature reports."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Literal

from printer_slicer.sim.heater import Heater
from printer_slicer.sim.heater_protection import HeaterProtection

if TYPE_CHECKING:
    from printer_slicer.sim.machine import Machine

__all__ = ["Heaters"]


class Heaters:
    """All heaters of a machine: the bed, and one hotend for each extruder.

    Attributes:
        bed: heater of the bed.
        hotends: hotend of each extruder.
        tool: number of the active extruder.
        hotend: hotend of the active extruder.
        protections: protection of each heater, by its name in the firmware: bed, E0, E1 and so on.
        steady: whether filament flows at a constant rate, see `start_steady_flow`.
        fault_changes: number of faults injected and repaired; after each, a wait must compute its end again.
    """

    __slots__ = (
        "_heat_per_mm",
        "_melted_by",
        "bed",
        "fault_changes",
        "hotend",
        "hotends",
        "protections",
        "steady",
        "tool",
    )

    def __init__(self, machine: Machine, now: float) -> None:
        self.hotends = [Heater(machine.hotend, machine.ambient) for _ in range(machine.extruders)]
        if machine.one_hotend:
            self.hotends = self.hotends[:1] * machine.extruders
        self.tool = 0
        self.hotend = self.hotends[0]
        self.bed = Heater(machine.bed, machine.ambient)
        self.protections = {
            **{
                f"E{n}": HeaterProtection(heater, machine.hotend_protection)
                for n, heater in enumerate(self.hotends)
            },
            "bed": HeaterProtection(self.bed, machine.bed_protection),
        }
        self.fault_changes = 0
        self._melted_by = (
            now,
            0.0,
        )  # time, s, and filament fed, mm, at the last call of `apply_flow_cooling`
        self.steady = False
        self._heat_per_mm = pi * machine.filament_diameter**2 / 4.0 * machine.melting

    def all_heaters(self) -> tuple[Heater, ...]:
        """Return the hotends, then the bed."""
        return (*self.hotends, self.bed)

    def find_heater(self, name: str) -> Heater:
        """Return the heater with this name in the firmware: bed, E0, E1 and so on."""
        return self.bed if name == "bed" else self.hotends[int(name[1:])]

    def select_tool(self, tool: int) -> None:
        """Make this extruder the active extruder."""
        self.tool, self.hotend = tool, self.hotends[tool]

    def apply_flow_cooling(self, fed: float, now: float) -> None:
        """Cool the hotend by the filament fed since the last call; `fed` is the total since power-on, mm."""
        since, before = self._melted_by
        if now <= since:
            return
        heater = self.hotend
        heater.flow_loss = max(fed - before, 0.0) / (now - since) * self._heat_per_mm
        heater.temperature(now)
        heater.flow_loss = 0.0
        self._melted_by = (now, fed)

    def start_steady_flow(self, mm: float, seconds: float) -> None:
        """Start a constant flow, `mm` of filament per `seconds`, which lasts until `end_steady_flow`."""
        self.steady = True
        self.hotend.flow_loss = max(mm, 0.0) / max(seconds, 1e-9) * self._heat_per_mm

    def end_steady_flow(self, fed: float, now: float) -> None:
        """End the constant flow at `now`, s; `fed` is the filament fed since power-on, mm."""
        self.hotend.temperature(now)
        self.hotend.flow_loss = 0.0
        self._melted_by = (now, fed)
        self.steady = False

    @property
    def next_check_time(self) -> float:
        """Time of the next check of the heater protection, s."""
        return min(protection.due for protection in self.protections.values())

    def record_target(self, heater: Heater, now: float) -> None:
        """Record that a heater has a new target."""
        for name, protection in self.protections.items():
            if self.find_heater(name) is heater:
                protection.record_target(now)

    def record_fault(self, name: str, now: float) -> None:
        """Record that a fault has broken or repaired a heater."""
        self.fault_changes += 1
        self.protections[name].record_fault(now)

    def find_fault(self, now: float) -> tuple[str, str] | None:
        """Return the name and the error of a heater that is out of control; None if all heaters work."""
        for name, protection in self.protections.items():
            if protection.due <= now and (error := protection.check(now)):
                return name, error
        return None

    def format_temperatures(self, language: Literal["marlin", "klipper", "virtual"], now: float) -> str:
        """Return the temperatures of all heaters in the format of the reply to M105."""
        for protection in self.protections.values():
            protection.record_reading(now)
        bed, hotends = self.bed, list(enumerate(self.hotends))
        several = hotends if len(hotends) > 1 else []
        if language == "klipper":
            return " ".join(
                [
                    f"B:{_format_temperature(bed, now, 1)}",
                    *(f"T{n}:{_format_temperature(one, now, 1)}" for n, one in hotends),
                ]
            )
        if language == "virtual":
            tools = [f"T{n}:{_format_virtual(one, now)}" for n, one in several]
            return " ".join(
                [f"T:{_format_virtual(self.hotend, now)}", *tools, f"B:{_format_virtual(bed, now)}", "@:64"]
            )
        words = [f"T:{_format_temperature(self.hotend, now)}", f"B:{_format_temperature(bed, now)}"]
        words += [f"T{n}:{_format_temperature(one, now)}" for n, one in several]
        words += [f"@:{_format_power(self.hotend, now)}", f"B@:{_format_power(bed, now)}"]
        return " ".join(words + [f"@{n}:{_format_power(one, now)}" for n, one in several])


def _format_temperature(heater: Heater, now: float, decimals: int = 2) -> str:
    """Return the temperature and target of a heater in the format of Marlin and Klipper."""
    return f"{heater.sensor_reading(now):.{decimals}f} /{heater.target:.{decimals}f}"


def _format_virtual(heater: Heater, now: float) -> str:
    """Return the temperature and target of a heater in the format of OctoPrint's virtual printer."""
    return f"{heater.sensor_reading(now):.2f}/ {heater.target:.2f}"


def _format_power(heater: Heater, now: float) -> int:
    """Return the power of a heater as Marlin reports it, 0 to 127."""
    return round(heater.power_ratio(now) * 127)
