"""All heaters of a machine: protection, cooling by flowing filament, temperature reports."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Literal

from printer_slicer.sim.heater import Heater
from printer_slicer.sim.heater_protection import HeaterProtection

if TYPE_CHECKING:
    from printer_slicer.sim.machine import Machine

__all__ = ["Heaters"]


class Heaters:
    """The bed, and one hotend for each extruder.

    Attributes:
        bed: heater of the bed.
        hotends: by extruder number.
        tool: number of the active extruder.
        hotend: of the active extruder.
        protections: by the firmware names of the heaters: bed, E0, E1 and so on.
        steady: whether filament flows evenly, see `flow`.
        disturbances: number of injected and repaired faults; waits for a heater must recompute their end.
    """

    __slots__ = (
        "_heat_per_mm",
        "_melted_by",
        "bed",
        "disturbances",
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
        self.disturbances = 0
        self._melted_by = (now, 0.0)  # s and mm at the last update of the heat carried away
        self.steady = False
        self._heat_per_mm = pi * machine.filament_diameter**2 / 4.0 * machine.melting

    def all(self) -> tuple[Heater, ...]:
        """Return the hotends, then the bed."""
        return (*self.hotends, self.bed)

    def named(self, name: str) -> Heater:
        """Return the heater with a firmware name."""
        return self.bed if name == "bed" else self.hotends[int(name[1:])]

    def use(self, tool: int) -> None:
        """Make another extruder active."""
        self.tool, self.hotend = tool, self.hotends[tool]

    def apply_flow_cooling(self, fed: float, now: float) -> None:
        """Account for the heat taken by the filament fed since the last call, up to `fed` mm in all, spread evenly."""
        since, before = self._melted_by
        if now <= since:
            return
        heater = self.hotend
        heater.flow_loss = max(fed - before, 0.0) / (now - since) * self._heat_per_mm
        heater.temperature(now)
        heater.flow_loss = 0.0
        self._melted_by = (now, fed)

    def flow(self, mm: float, seconds: float) -> None:
        """Start a constant flow of filament, which lasts until `flowed`."""
        self.steady = True
        self.hotend.flow_loss = max(mm, 0.0) / max(seconds, 1e-9) * self._heat_per_mm

    def flowed(self, fed: float, now: float) -> None:
        """End the flow; `fed` mm were fed in all."""
        self.hotend.temperature(now)
        self.hotend.flow_loss = 0.0
        self._melted_by = (now, fed)
        self.steady = False

    @property
    def due(self) -> float:
        """When a guard wants to look, s."""
        return min(update_clipping.due for update_clipping in self.protections.values())

    def target_set(self, heater: Heater, now: float) -> None:
        """Note that a heater got another target."""
        for name, update_clipping in self.protections.items():
            if self.named(name) is heater:
                update_clipping.target_set(now)

    def disturb(self, name: str, now: float) -> None:
        """Something is wrong with a heater, or right again."""
        self.disturbances += 1
        self.protections[name].disturbed(now)

    def wrong(self, now: float) -> tuple[str, str] | None:
        """Return which heater is out of control, and how; None if none is."""
        for name, update_clipping in self.protections.items():
            if update_clipping.due <= now and (what := update_clipping.check(now)):
                return name, what
        return None

    def told(self, language: Literal["marlin", "klipper", "virtual"], now: float) -> str:
        """Return all temperatures as in the answer to M105."""
        for update_clipping in self.protections.values():
            update_clipping.seen(now)
        bed, hotends = self.bed, list(enumerate(self.hotends))
        several = hotends if len(hotends) > 1 else []
        if language == "klipper":
            return " ".join(
                [f"B:{_degrees(bed, now, 1)}", *(f"T{n}:{_degrees(one, now, 1)}" for n, one in hotends)]
            )
        if language == "virtual":
            tools = [f"T{n}:{_virtual(one, now)}" for n, one in several]
            return " ".join([f"T:{_virtual(self.hotend, now)}", *tools, f"B:{_virtual(bed, now)}", "@:64"])
        words = [f"T:{_degrees(self.hotend, now)}", f"B:{_degrees(bed, now)}"]
        words += [f"T{n}:{_degrees(one, now)}" for n, one in several]
        words += [f"@:{_power(self.hotend, now)}", f"B@:{_power(bed, now)}"]
        return " ".join(words + [f"@{n}:{_power(one, now)}" for n, one in several])


def _degrees(heater: Heater, now: float, decimals: int = 2) -> str:
    """Format temperature and target as Marlin and Klipper do."""
    return f"{heater.reading(now):.{decimals}f} /{heater.target:.{decimals}f}"


def _virtual(heater: Heater, now: float) -> str:
    """Format temperature and target as OctoPrint's virtual printer does."""
    return f"{heater.reading(now):.2f}/ {heater.target:.2f}"


def _power(heater: Heater, now: float) -> int:
    """Return the power of a heater as Marlin reports it."""
    return round(heater.power_ratio(now) * 127)
