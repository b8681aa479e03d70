"""A heater as one warm lump of metal, solved exactly instead of step by step.

The lump stores heat, is fed by the heater and loses heat to the room in proportion to how much warmer it is.
The controller gives full power while it is far below the target, none while it is far above, and in between
the power that would hold the target plus a share for what is missing. In each of the three the temperature is
an exponential, so the temperature at any moment, and the moment of any temperature, are formulas; how often
somebody looks changes nothing.

Left out: overshoot, noise and lag of the sensor, the cooling by flowing filament, a heater that fails.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log
from typing import Final

__all__ = ["Heater", "HeaterSpec"]

CONTROL_BAND: Final = 10.0
"""°C; this far below its target a controller gives full power. Marlin's PID_FUNCTIONAL_RANGE."""


@dataclass(frozen=True, slots=True)
class HeaterSpec:
    """What a heater can do.

    Attributes:
        power: W at full power.
        heat_capacity: J/K of everything it warms.
        loss: W/K lost to the room.
        fan_loss: W/K lost in addition with the part cooling fan at full speed.
        highest: °C; the firmware lowers a higher target to this.
        window: °C; a wait counts as arrived within this distance of the target.
        residency: s; a wait goes on for so long after arriving.
    """

    power: float
    heat_capacity: float
    loss: float
    fan_loss: float
    highest: float
    window: float = 1.0
    residency: float = 10.0


class Heater:
    """The temperature of one heater over time.

    Attributes:
        spec: what it can do.
        target: °C; 0 = off.
        peak: °C, the highest temperature up to the moment last asked about.
    """

    __slots__ = ("_ambient", "_fan", "_temperature", "_when", "peak", "spec", "target")

    def __init__(self, spec: HeaterSpec, ambient: float) -> None:
        self.spec = spec
        self.target = 0.0
        self.peak = ambient
        self._ambient = ambient
        self._temperature = ambient
        self._when = 0.0
        self._fan = 0.0

    def temperature(self, now: float) -> float:
        """°C at `now`, which may not be before an earlier question."""
        left = now - self._when
        self._when = now
        while left > 0.0:
            asymptote, tau, edge = self._leg()
            reach = _reach(self._temperature, asymptote, tau, edge)
            if reach >= left:
                self._temperature = asymptote + (self._temperature - asymptote) * exp(-left / tau)
                break
            self._temperature = edge
            left -= reach
        self.peak = max(self.peak, self._temperature)
        return self._temperature

    def power_ratio(self, now: float) -> float:
        """Share of full power given at `now`, 0 to 1."""
        temperature = self.temperature(now)
        if self.target <= 0.0:
            return 0.0
        wanted = self._holding() + self._gain() * (self.target - temperature)
        return min(max(wanted / self.spec.power, 0.0), 1.0)

    def set_target(self, target: float, now: float) -> None:
        """Aim at `target` °C from `now` on; 0 switches off."""
        self.temperature(now)
        self.target = target

    def set_fan(self, ratio: float, now: float) -> None:
        """Part cooling fan at `ratio` of its full speed, 0 to 1, from `now` on."""
        self.temperature(now)
        self._fan = ratio

    def cool_from(self, before: Heater, now: float) -> None:
        """Be the same lump of metal as `before`, switched off at `now`."""
        self._temperature = before.temperature(now)
        self._when = now
        self.peak = before.peak

    def seconds_until(self, temperature: float, now: float) -> float:
        """Seconds from `now` until the temperature is first reached; infinite when it never is."""
        at = self.temperature(now)
        seconds = 0.0
        while at != temperature:
            asymptote, tau, edge = self._leg(at)
            reach = _reach(at, asymptote, tau, temperature)
            if reach <= (leave := _reach(at, asymptote, tau, edge)):
                return seconds + reach
            at = edge
            seconds += leave
        return seconds

    def _loss(self) -> float:
        return self.spec.loss + self.spec.fan_loss * self._fan

    def _gain(self) -> float:
        return self.spec.power / CONTROL_BAND

    def _holding(self) -> float:
        """W that keep the target."""
        return self._loss() * (self.target - self._ambient)

    def _leg(self, at: float | None = None) -> tuple[float, float, float]:
        """Asymptote (°C), time constant (s) and end (°C) of the exponential that the temperature is on."""
        at = self._temperature if at is None else at
        spec, loss = self.spec, self._loss()
        off = (self._ambient, spec.heat_capacity / loss)
        if self.target <= 0.0:
            return (*off, self._ambient)
        gain, holding = self._gain(), self._holding()
        low = self.target - (spec.power - holding) / gain
        high = self.target + max(holding, 0.0) / gain
        if at < low:
            return self._ambient + spec.power / loss, spec.heat_capacity / loss, low
        if at > high:
            return (*off, high)
        return self.target, spec.heat_capacity / (gain + loss), self.target


def _reach(start: float, asymptote: float, tau: float, goal: float) -> float:
    """Seconds until an exponential from `start` gets to `goal`; infinite when `goal` is not on its way."""
    if goal == start:
        return 0.0 if start != asymptote else inf
    ratio = (asymptote - start) / (asymptote - goal) if goal != asymptote else 0.0
    return tau * log(ratio) if ratio > 1.0 else inf
