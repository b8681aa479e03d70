"""A simulated heater: one thermal mass whose temperature is computed exactly, without time steps.

The element heats the mass, which loses heat to the room in proportion to the temperature difference. The controller
gives full power far below the target and none far above. In between it gives the power that holds the target plus a
proportional term. In each of these three ranges the temperature follows an exponential. So temperatures and times have
closed formulas, and they do not depend on how often they are read.

Flowing filament carries heat away. The controller does not anticipate this, so the temperature drops until the
proportional term compensates. Injected faults can break the element and the sensor.

Not modelled: overshoot, noise and lag of the sensor.
"""

from __future__ import annotations

from math import exp, inf, log
from typing import Final, Literal

from printer_slicer.values import Struct

__all__ = ["Element", "Heater", "HeaterSpec"]

Element = Literal["works", "off", "on"]
"""State of a heating element: it works, is stuck off, or is stuck on."""

CONTROL_BAND: Final = 10.0
"""Distance below the target, °C, beyond which the controller gives full power; Marlin's PID_FUNCTIONAL_RANGE."""


class HeaterSpec(Struct, frozen=True):
    """Properties of a heater.

    Attributes:
        power: full power, W.
        heat_capacity: heat capacity of everything that it heats, J/K.
        loss: heat loss to the room, W/K.
        fan_loss: additional heat loss with the part cooling fan at full speed, W/K.
        highest: maximum target, °C; the firmware lowers higher targets to it.
        window: distance from the target within which the target counts as reached, °C.
        residency: time that a wait for the target continues within the window, s.
    """

    power: float
    heat_capacity: float
    loss: float
    fan_loss: float
    highest: float
    window: float = 1.0
    residency: float = 10.0


class Heater:
    """A simulated heater, whose temperature can be computed at any later time.

    Attributes:
        spec: properties of the heater.
        target: target temperature, °C; 0: off.
        peak: highest temperature so far, °C.
        flow_loss: heat loss to flowing filament until the next call, W/K.
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
    def has_fault(self) -> bool:
        """Whether the element or the sensor is broken."""
        return self.element != "works" or self.stuck_at is not None

    def temperature(self, now: float) -> float:
        """Return the temperature, °C, at `now`, s; later calls must not have an earlier `now`."""
        left = now - self._when
        self._when = now
        while left > 0.0:
            asymptote, tau, edge = self._find_temperature_curve(self._temperature)
            seconds = _seconds_to_reach(self._temperature, asymptote, tau, edge)
            if seconds >= left:
                self._temperature = asymptote + (self._temperature - asymptote) * exp(-left / tau)
                break
            self._temperature = edge
            left -= seconds
        self.peak = max(self.peak, self._temperature)
        return self._temperature

    def sensor_reading(self, now: float) -> float:
        """Return the reading of the sensor, °C, at the time `now`, s."""
        temperature = self.temperature(now)
        return temperature if self.stuck_at is None else self.stuck_at

    def power_ratio(self, now: float) -> float:
        """Return the power at the time `now`, s, as a fraction of full power."""
        return self._demanded_power(self.sensor_reading(now)) / self.spec.power

    def set_target(self, target: float, now: float) -> None:
        """Set the target, °C, at `now`, s; 0 switches the heater off."""
        self.temperature(now)
        self.target = target

    def set_fan(self, ratio: float, now: float) -> None:
        """Set the speed of the part cooling fan, 0 to 1, at `now`, s."""
        self.temperature(now)
        self._fan = ratio

    def set_fault(self, now: float, *, element: Element | None = None, stuck_at: float | None = None) -> None:
        """Break the element or the sensor at `now`, s; the element state "works" repairs both."""
        self.temperature(now)
        self.element = element or self.element
        self.stuck_at = stuck_at if element != "works" else None

    def inherit_temperature(self, before: Heater, now: float) -> None:
        """Copy temperature and faults from the heater before a reset at `now`, s; stay switched off."""
        self._temperature = before.temperature(now)
        self._when = now
        self.peak = before.peak
        self.element, self.stuck_at = before.element, before.stuck_at

    def seconds_until(self, temperature: float, now: float) -> float:
        """Return the seconds from `now` until a temperature is first reached; infinite for never."""
        at = self.temperature(now)
        seconds = 0.0
        while at != temperature:
            asymptote, tau, edge = self._find_temperature_curve(at)
            reach = _seconds_to_reach(at, asymptote, tau, temperature)
            if reach <= (leave := _seconds_to_reach(at, asymptote, tau, edge)):
                return seconds + reach
            at = edge
            seconds += leave
        return seconds

    def _heat_loss(self) -> float:
        """Return the heat loss to the room, W/K."""
        return self.spec.loss + self.spec.fan_loss * self._fan

    def _controller_gain(self) -> float:
        """Return the proportional gain of the controller, W/K."""
        return self.spec.power / CONTROL_BAND

    def _holding_power(self) -> float:
        """Return the power that holds the target without filament flow, W."""
        return self._heat_loss() * (self.target - self._ambient)

    def _demanded_power(self, reading: float) -> float:
        """Return the power, W, that the controller gives at a sensor reading, °C."""
        if self.target <= 0.0:
            return 0.0
        return min(
            max(self._holding_power() + self._controller_gain() * (self.target - reading), 0.0),
            self.spec.power,
        )

    def _find_temperature_curve(self, at: float) -> tuple[float, float, float]:
        """Return the exponential curve from temperature `at`: asymptote, °C, time constant, s, and end, °C.

        The end is the edge of the current range, or the asymptote if the temperature stays in this range.
        """
        spec, flow = self.spec, self.flow_loss
        loss = self._heat_loss() + flow
        if self.target <= 0.0 or self.element != "works" or self.stuck_at is not None:
            power = self._uncontrolled_power(at)
            asymptote = self._ambient + power / loss
            return asymptote, spec.heat_capacity / loss, asymptote
        gain, holding = self._controller_gain(), self._holding_power()
        low = self.target - (spec.power - holding) / gain
        high = self.target + max(holding, 0.0) / gain
        # This formula gives exactly the target if no filament flows.
        middle = self.target - flow * (self.target - self._ambient) / (gain + loss)
        if at < low or (at == low and middle < low):
            asymptote = self._ambient + spec.power / loss
            return asymptote, spec.heat_capacity / loss, low if asymptote > low else asymptote
        if at > high or (at == high and middle > high):
            return self._ambient, spec.heat_capacity / loss, high if self._ambient < high else self._ambient
        return middle, spec.heat_capacity / (gain + loss), min(max(middle, low), high)

    def _uncontrolled_power(self, at: float) -> float:
        """Return the power, W, of a heater that is off or broken, at the temperature `at`, °C."""
        if self.element != "works":
            return self.spec.power if self.element == "on" else 0.0
        return self._demanded_power(at if self.stuck_at is None else self.stuck_at)


def _seconds_to_reach(start: float, asymptote: float, tau: float, goal: float) -> float:
    """Return the time, s, in which an exponential curve from `start` reaches `goal`; infinite for never."""
    if goal == start:
        return 0.0 if start != asymptote else inf
    ratio = (asymptote - start) / (asymptote - goal) if goal != asymptote else 0.0
    return tau * log(ratio) if ratio > 1.0 else inf
