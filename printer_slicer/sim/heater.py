"""A heater as one warm lump of metal, solved exactly instead of step by step.

The lump stores heat, is fed by the heater and loses heat to the room in proportion to how much warmer it is.
The controller gives full power while it is far below the target, none while it is far above, and in between
the power that would hold the target plus a share for what is missing. In each of the three the temperature is
an exponential, so the temperature at any moment, and the moment of any temperature, are formulas; how often
somebody looks changes nothing.

Filament that flows takes heat along. The controller does not know of it beforehand, so the temperature sinks until the
share for what is missing makes up for it. The element may stop working or heat for ever, the sensor may break or read
the same for ever: faults that somebody plants.

Left out: overshoot, noise and lag of the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log
from typing import Final, Literal

__all__ = ["Element", "Heater", "HeaterSpec"]

Element = Literal["works", "off", "on"]
"""A heating element: under control, broken, or with a switch that never opens."""

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
        flow_loss: W/K that flowing filament takes along until the next question.
        element: whether it heats as the controller wants, never, or always.
        stuck_at: °C that the sensor reads whatever the temperature is; None while it works.
    """

    __slots__ = (
        *("_ambient", "_fan", "_temperature", "_when", "element"),
        *("flow_loss", "peak", "spec", "stuck_at", "target"),
    )

    def __init__(self, spec: HeaterSpec, ambient: float) -> None:
        self.spec = spec
        self.target = 0.0
        self.peak = ambient
        self.flow_loss = 0.0
        self.element: Element = "works"
        self.stuck_at: float | None = None
        self._ambient = ambient
        self._temperature = ambient
        self._when = 0.0
        self._fan = 0.0

    @property
    def disturbed(self) -> bool:
        """Whether something is wrong with it."""
        return self.element != "works" or self.stuck_at is not None

    def temperature(self, now: float) -> float:
        """°C at `now`, which may not be before an earlier question."""
        left = now - self._when
        self._when = now
        while left > 0.0:
            asymptote, tau, edge = self._leg(self._temperature)
            reach = _reach(self._temperature, asymptote, tau, edge)
            if reach >= left:
                self._temperature = asymptote + (self._temperature - asymptote) * exp(-left / tau)
                break
            self._temperature = edge
            left -= reach
        self.peak = max(self.peak, self._temperature)
        return self._temperature

    def reading(self, now: float) -> float:
        """°C that the sensor says at `now`."""
        temperature = self.temperature(now)
        return temperature if self.stuck_at is None else self.stuck_at

    def power_ratio(self, now: float) -> float:
        """Share of full power that the controller asks for at `now`, 0 to 1."""
        return self._wanted(self.reading(now)) / self.spec.power

    def set_target(self, target: float, now: float) -> None:
        """Aim at `target` °C from `now` on; 0 switches off."""
        self.temperature(now)
        self.target = target

    def set_fan(self, ratio: float, now: float) -> None:
        """Part cooling fan at `ratio` of its full speed, 0 to 1, from `now` on."""
        self.temperature(now)
        self._fan = ratio

    def upset(self, now: float, *, element: Element | None = None, stuck_at: float | None = None) -> None:
        """Break the element, or the sensor, or both, from `now` on; "works" repairs the element and the sensor."""
        self.temperature(now)
        self.element = element or self.element
        self.stuck_at = stuck_at if element != "works" else None

    def cool_from(self, before: Heater, now: float) -> None:
        """Be the same lump of metal as `before`, switched off at `now`, with the same faults."""
        self._temperature = before.temperature(now)
        self._when = now
        self.peak = before.peak
        self.element, self.stuck_at = before.element, before.stuck_at

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
        """W that keep the target while nothing flows."""
        return self._loss() * (self.target - self._ambient)

    def _wanted(self, reading: float) -> float:
        """W that the controller asks for."""
        if self.target <= 0.0:
            return 0.0
        return min(max(self._holding() + self._gain() * (self.target - reading), 0.0), self.spec.power)

    def _leg(self, at: float) -> tuple[float, float, float]:
        """Asymptote (°C), time constant (s) and end (°C) of the exponential that the temperature is on.

        The end is the asymptote itself where the temperature stays in the same of the three ranges.
        """
        spec, flow = self.spec, self.flow_loss
        loss = self._loss() + flow
        if self.target <= 0.0 or self.element != "works" or self.stuck_at is not None:
            power = self._given(at)
            asymptote = self._ambient + power / loss
            return asymptote, spec.heat_capacity / loss, asymptote
        gain, holding = self._gain(), self._holding()
        low = self.target - (spec.power - holding) / gain
        high = self.target + max(holding, 0.0) / gain
        # Written so that without flow it is the target to the last digit.
        middle = self.target - flow * (self.target - self._ambient) / (gain + loss)
        if at < low or (at == low and middle < low):
            asymptote = self._ambient + spec.power / loss
            return asymptote, spec.heat_capacity / loss, low if asymptote > low else asymptote
        if at > high or (at == high and middle > high):
            return self._ambient, spec.heat_capacity / loss, high if self._ambient < high else self._ambient
        return middle, spec.heat_capacity / (gain + loss), min(max(middle, low), high)

    def _given(self, at: float) -> float:
        """W of a heater whose power does not follow its temperature."""
        if self.element != "works":
            return self.spec.power if self.element == "on" else 0.0
        return self._wanted(at if self.stuck_at is None else self.stuck_at)


def _reach(start: float, asymptote: float, tau: float, goal: float) -> float:
    """Seconds until an exponential from `start` gets to `goal`; infinite when `goal` is not on its way."""
    if goal == start:
        return 0.0 if start != asymptote else inf
    ratio = (asymptote - start) / (asymptote - goal) if goal != asymptote else 0.0
    return tau * log(ratio) if ratio > 1.0 else inf
