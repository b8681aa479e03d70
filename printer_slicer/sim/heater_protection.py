"""Heater protection: when a firmware halts because of a heater.

what              when                                                      Marlin's names
MINTEMP           a heater that is on reads below 5 °C: a broken sensor     HEATER_0_MINTEMP
MAXTEMP           it reads more than the highest target and a margin        HEATER_0_MAXTEMP
heating failed    far below its target it gained less than 2 °C in 40 s     WATCH_TEMP_PERIOD, WATCH_TEMP_INCREASE
thermal runaway   it had arrived and is 4 °C too cold for more than 40 s    THERMAL_PROTECTION_PERIOD, _HYSTERESIS

A working heater cannot cause any of these, so checks are rare: "heating failed" is checked when its period ends, and
checks every second start only after a fault was injected or a temperature was found too low.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.heater import Heater

__all__ = ["HeaterProtection", "ProtectionLimits"]

LOOK_SECONDS: Final = 1.0

ARRIVED: Final = 1.0
"""°C below the target from which a heater counts as having reached it; it approaches the target asymptotically."""


@dataclass(frozen=True, slots=True)
class ProtectionLimits:
    """Limits of the heater protection; the defaults are those of Marlin for a hotend.

    Attributes:
        lowest: minimum reading of a heater that is on, °C.
        margin: tolerance above the highest target, °C.
        watch_seconds, watch_rise: a heater far below its target must rise by `watch_rise` °C in `watch_seconds`.
        near: within this distance of the target, °C, the rise is not checked.
        hysteresis, runaway_seconds: a heater that reached its target may be `hysteresis` °C colder for so many s.
    """

    lowest: float = 5.0
    margin: float = 15.0
    watch_seconds: float = 40.0
    watch_rise: float = 2.0
    near: float = 6.0
    hysteresis: float = 4.0
    runaway_seconds: float = 40.0


class HeaterProtection:
    """Watches one heater.

    Attributes:
        due: time of the next check, s; infinite if none is needed.
    """

    __slots__ = ("_arrived", "_cold_since", "_goal", "_heater", "_spec", "_watched_until", "due")

    def __init__(self, heater: Heater, spec: ProtectionLimits) -> None:
        self.due = inf
        self._heater = heater
        self._spec = spec
        self._goal = 0.0
        self._watched_until = inf
        self._arrived = False
        self._cold_since = inf

    def target_set(self, now: float) -> None:
        """Note a new target."""
        self._arrived = False
        self._cold_since = inf
        self._watch(now)
        self.due = self._next(now)

    def disturbed(self, now: float) -> None:
        """Note that the heater was broken or repaired: check at once, and keep checking."""
        self._arrived = self._arrived or self._heater.temperature(now) >= self._heater.target - ARRIVED
        self.due = now

    def check(self, now: float) -> str:
        """Return what is wrong with the heater at `now`; empty if nothing is."""
        heater, spec = self._heater, self._spec
        reading = heater.reading(now)
        if reading > heater.spec.highest + spec.margin:
            return "MAXTEMP triggered"
        if heater.target <= 0.0:
            self.due = self._next(now)
            return ""
        if reading < spec.lowest:
            return "MINTEMP triggered"
        if now >= self._watched_until:
            if reading < self._goal:
                return "Heating failed"
            self._watch(now)
        self._arrived = self._arrived or reading >= heater.target - ARRIVED
        if not self._arrived or reading >= heater.target - spec.hysteresis:
            self._cold_since = inf
        elif self._cold_since == inf:
            self._cold_since = now
        elif now - self._cold_since > spec.runaway_seconds:
            return "Thermal Runaway"
        self.due = self._next(now)
        return ""

    def seen(self, now: float) -> None:
        """Note that the temperature was read; keep checking if it is too low."""
        heater = self._heater
        if heater.target <= 0.0 or self.due <= now + LOOK_SECONDS:
            return
        reading = heater.reading(now)
        if reading >= heater.target - ARRIVED:
            self._arrived = True
        elif self._arrived and reading < heater.target - self._spec.hysteresis:
            self.due = now + LOOK_SECONDS

    def _watch(self, now: float) -> None:
        """Require a rise if the target is far away."""
        heater, spec = self._heater, self._spec
        reading = heater.reading(now)
        if heater.target > 0.0 and reading < heater.target - spec.near:
            self._goal, self._watched_until = reading + spec.watch_rise, now + spec.watch_seconds
        else:
            self._watched_until = inf

    def _next(self, now: float) -> float:
        """Return the time of the next check."""
        if self._heater.disturbed or self._cold_since != inf:
            return min(now + LOOK_SECONDS, self._watched_until)
        return self._watched_until if self._heater.target > 0.0 else inf
