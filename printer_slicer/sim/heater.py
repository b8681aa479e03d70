"""A heater as a lumped thermal mass, solved exactly instead of step by step.

The mass is heated by the element and loses heat to the room in proportion to the temperature difference. The
controller gives full power far below the target, none far above, and in between the power that holds the target plus
a proportional term. In each of the three ranges the temperature is an exponential, so temperatures and times are
formulas, and the result does not depend on how often it is read.

Flowing filament carries heat away. The controller does not anticipate this, so the temperature drops until the
proportional term compensates. Element and sensor can be broken by injected faults.

Not modelled: overshoot, noise and lag of the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log
from typing import Final, Literal

__all__ = ["Element", "Heater", "HeaterSpec"]

Element = Literal["works", "off", "on"]
"""State of a heating element: working, stuck off, or stuck on."""

CONTROL_BAND: Final = 10.0
"""°C below the target from which on a controller gives full power. Marlin's PID_FUNCTIONAL_RANGE."""


@dataclass(frozen=True, slots=True)
class HeaterSpec:
    """Properties of a heater.

    Attributes:
        power: W at full power.
        heat_capacity: J/K of everything it heats.
        loss: W/K lost to the room.
        fan_loss: W/K lost in addition with the part cooling fan at full speed.
        highest: maximum target, °C; the firmware lowers higher targets to it.
        window: distance from the target, °C, within which it counts as reached.
        residency: s that a wait continues after reaching the window.
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
        spec: its properties.
        target: °C; 0 = off.
        peak: highest temperature so far, °C.
        flow_loss: W/K carried away by flowing filament until the next call.
        element: state of the heating element.
        stuck_at: constant reading of a broken sensor, °C; None while it works.
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
        """Whether element or sensor is broken."""
        return self.element != "works" or self.stuck_at is not None

    def temperature(self, now: float) -> float:
        """Return the temperature at `now`, °C; `now` must not decrease between calls."""
        left = now - self._when
        self._when = now
        while left > 0.0:
            asymptote, tau, edge = self._current_exponential(self._temperature)
            reach = _reach(self._temperature, asymptote, tau, edge)
            if reach >= left:
                self._temperature = asymptote + (self._temperature - asymptote) * exp(-left / tau)
                break
            self._temperature = edge
            left -= reach
        self.peak = max(self.peak, self._temperature)
        return self._temperature

    def reading(self, now: float) -> float:
        """Return the reading of the sensor at `now`, °C."""
        temperature = self.temperature(now)
        return temperature if self.stuck_at is None else self.stuck_at

    def power_ratio(self, now: float) -> float:
        """Return the power at `now` as a share of full power, 0 to 1."""
        return self._wanted(self.reading(now)) / self.spec.power

    def set_target(self, target: float, now: float) -> None:
        """Set the target, °C, from `now` on; 0 switches off."""
        self.temperature(now)
        self.target = target

    def set_fan(self, ratio: float, now: float) -> None:
        """Set the speed of the part cooling fan from `now` on, 0 to 1."""
        self.temperature(now)
        self._fan = ratio

    def disturb(self, now: float, *, element: Element | None = None, stuck_at: float | None = None) -> None:
        """Break the element, or the sensor, or both, from `now` on; "works" repairs the element and the sensor."""
        self.temperature(now)
        self.element = element or self.element
        self.stuck_at = stuck_at if element != "works" else None

    def cool_from(self, before: Heater, now: float) -> None:
        """Take over temperature and faults of the heater before a reset, switched off at `now`."""
        self._temperature = before.temperature(now)
        self._when = now
        self.peak = before.peak
        self.element, self.stuck_at = before.element, before.stuck_at

    def seconds_until(self, temperature: float, now: float) -> float:
        """Return the seconds from `now` until a temperature is first reached; infinite if never."""
        at = self.temperature(now)
        seconds = 0.0
        while at != temperature:
            asymptote, tau, edge = self._current_exponential(at)
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
        """Return the power that holds the target without flow, W."""
        return self._loss() * (self.target - self._ambient)

    def _wanted(self, reading: float) -> float:
        """Return the power that the controller demands, W."""
        if self.target <= 0.0:
            return 0.0
        return min(max(self._holding() + self._gain() * (self.target - reading), 0.0), self.spec.power)

    def _current_exponential(self, at: float) -> tuple[float, float, float]:
        """Return asymptote (°C), time constant (s) and end (°C) of the current exponential.

        The end is the asymptote if the temperature stays in the current range.
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
        # Written so that without flow the result is exactly the target.
        middle = self.target - flow * (self.target - self._ambient) / (gain + loss)
        if at < low or (at == low and middle < low):
            asymptote = self._ambient + spec.power / loss
            return asymptote, spec.heat_capacity / loss, low if asymptote > low else asymptote
        if at > high or (at == high and middle > high):
            return self._ambient, spec.heat_capacity / loss, high if self._ambient < high else self._ambient
        return middle, spec.heat_capacity / (gain + loss), min(max(middle, low), high)

    def _given(self, at: float) -> float:
        """Return the power of a heater that is off or broken, W."""
        if self.element != "works":
            return self.spec.power if self.element == "on" else 0.0
        return self._wanted(at if self.stuck_at is None else self.stuck_at)


def _reach(start: float, asymptote: float, tau: float, goal: float) -> float:
    """Return the seconds until an exponential from `start` reaches `goal`; infinite if it never does."""
    if goal == start:
        return 0.0 if start != asymptote else inf
    ratio = (asymptote - start) / (asymptote - goal) if goal != asymptote else 0.0
    return tau * log(ratio) if ratio > 1.0 else inf
