"""Heater protection: the conditions in which a firmware halts because of a heater.

error             condition                                                 Marlin's names
MINTEMP           a heater that is on reads below 5 °C: a broken sensor     HEATER_0_MINTEMP
MAXTEMP           it reads more than its highest target plus a margin       HEATER_0_MAXTEMP
heating failed    far below its target, it rises less than 2 °C in 40 s     WATCH_TEMP_PERIOD, WATCH_TEMP_INCREASE
thermal runaway   after reaching its target, it is 4 °C colder for 40 s     THERMAL_PROTECTION_PERIOD, _HYSTERESIS

A working heater causes none of these errors, so checks are rare. "Heating failed" is checked when its period ends.
Checks every second start only after a fault was injected or a reading was too low.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.sim.heater import Heater

__all__ = ["HeaterProtection", "ProtectionLimits"]

CHECK_INTERVAL: Final = 1.0

ARRIVAL_BAND: Final = 1.0
"""A heater counts as having reached its target at this distance below it, °C."""


class ProtectionLimits(Struct, frozen=True):
    """Limits of the heater protection; the defaults are those of Marlin for a hotend.

    Attributes:
        lowest: minimum reading of a heater that is on, °C.
        margin: tolerance above the highest target, °C.
        watch_seconds, watch_rise: a heater far below its target must rise by `watch_rise` °C in `watch_seconds`.
        near: distance from the target, °C, within which the rise is not checked.
        hysteresis, runaway_seconds: a heater that has reached its target may be `hysteresis` °C colder for at most
            `runaway_seconds`.
    """

    lowest: float = 5.0
    margin: float = 15.0
    watch_seconds: float = 40.0
    watch_rise: float = 2.0
    near: float = 6.0
    hysteresis: float = 4.0
    runaway_seconds: float = 40.0


class HeaterProtection:
    """Checks one heater for the errors in the table above.

    Attributes:
        due: time of the next check, s; infinite if none is needed.
    """

    __slots__ = ("_cold_since", "_goal", "_has_arrived", "_heater", "_spec", "_watched_until", "due")

    def __init__(self, heater: Heater, spec: ProtectionLimits) -> None:
        self.due = inf
        self._heater = heater
        self._spec = spec
        self._goal = 0.0
        self._watched_until = inf
        self._has_arrived = False
        self._cold_since = inf

    def record_target(self, now: float) -> None:
        """Record that the heater has a new target."""
        self._has_arrived = False
        self._cold_since = inf
        self._require_temperature_rise(now)
        self.due = self._next_check_time(now)

    def record_fault(self, now: float) -> None:
        """Record that a fault has broken or repaired the heater; check it now and then every second."""
        self._has_arrived = (
            self._has_arrived or self._heater.temperature(now) >= self._heater.target - ARRIVAL_BAND
        )
        self.due = now

    def check(self, now: float) -> str:
        """Return the error of the heater at `now`, s; empty if there is no error."""
        heater, spec = self._heater, self._spec
        reading = heater.sensor_reading(now)
        if reading > heater.spec.highest + spec.margin:
            return "MAXTEMP triggered"
        if heater.target <= 0.0:
            self.due = self._next_check_time(now)
            return ""
        if reading < spec.lowest:
            return "MINTEMP triggered"
        if now >= self._watched_until:
            if reading < self._goal:
                return "Heating failed"
            self._require_temperature_rise(now)
        self._has_arrived = self._has_arrived or reading >= heater.target - ARRIVAL_BAND
        if not self._has_arrived or reading >= heater.target - spec.hysteresis:
            self._cold_since = inf
        elif self._cold_since == inf:
            self._cold_since = now
        elif now - self._cold_since > spec.runaway_seconds:
            return "Thermal Runaway"
        self.due = self._next_check_time(now)
        return ""

    def record_reading(self, now: float) -> None:
        """Record that the temperature was read at `now`, s; if it is too low, start checking every second."""
        heater = self._heater
        if heater.target <= 0.0 or self.due <= now + CHECK_INTERVAL:
            return
        reading = heater.sensor_reading(now)
        if reading >= heater.target - ARRIVAL_BAND:
            self._has_arrived = True
        elif self._has_arrived and reading < heater.target - self._spec.hysteresis:
            self.due = now + CHECK_INTERVAL

    def _require_temperature_rise(self, now: float) -> None:
        """Start to check that the temperature rises if the target is far above it."""
        heater, spec = self._heater, self._spec
        reading = heater.sensor_reading(now)
        if heater.target > 0.0 and reading < heater.target - spec.near:
            self._goal, self._watched_until = reading + spec.watch_rise, now + spec.watch_seconds
        else:
            self._watched_until = inf

    def _next_check_time(self, now: float) -> float:
        """Return the time of the next check, s."""
        if self._heater.has_fault or self._cold_since != inf:
            return min(now + CHECK_INTERVAL, self._watched_until)
        return self._watched_until if self._heater.target > 0.0 else inf
