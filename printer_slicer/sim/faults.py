"""Fault injection: reproducible faults of the simulated printer and its cable.

kind         affects    what happens
flip         cable      a bit flips, in a share `rate` of the bytes
drop         cable      bytes are lost
insert       cable      extra bytes appear
duplicate    cable      bytes arrive twice
burst        cable      a single burst of noise, `bytes` long
lose_reply   cable      a share `rate` of the ok replies is lost, at most `count`
disconnect   cable      the cable is unplugged
hang         printer    the main loop hangs
brown_out    printer    the firmware resets
heater       printer    a heater is stuck in a `state`, "off" or "on"
sensor       printer    a thermistor always reads the same `temperature`
endstop      printer    the endstop of an `axis` never triggers
clog         printer    a `share` of the fed filament does not come out
runout       printer    the filament ends

A fault starts at a line number, a layer, a height z, a time, or at once. It lasts for `seconds`, or for ever. All
random numbers come from one generator, so the same seed, faults and host give the same run.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.sim.cable_noise import Direction, RandomSource
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["CABLE_KINDS", "KINDS", "Fault", "FaultEvent", "Faults"]

KINDS: Final = (
    *("flip", "drop", "insert", "duplicate", "burst", "lose_reply", "disconnect"),
    *("hang", "brown_out", "heater", "sensor", "endstop", "clog", "runout"),
)

CABLE_KINDS: Final = frozenset({"flip", "drop", "insert", "duplicate", "burst", "lose_reply"})
"""Kinds that change bytes on the cable."""

_OK: Final = re.compile(rb"ok[^\n]*\n")


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault to inject.

    Attributes:
        kind: see the table above.
        line: starts at this line number; without line numbers, after so many lines.
        layer: starts at this layer, by the layer comments of the file, else by the number of heights printed.
        z: starts at the first extrusion at or above this height, mm.
        time: starts at this time after power-on, s.
        seconds: duration; infinity: for ever.
        rate: affected share of bytes or replies.
        count: maximum number of occurrences; 0: unlimited.
        bytes: length of a burst.
        direction: of the cable.
        heater: bed, E0 (the first hotend), E1 and so on.
        state: in which a heater is stuck.
        temperature: reading of a sensor, °C.
        axis: x, y or z.
        share: of the filament that does not come out.
    """

    kind: str
    line: int | None = None
    layer: int | None = None
    z: float | None = None
    time: float | None = None
    seconds: float = inf
    rate: float = 1.0
    count: int = 0
    bytes: int = 100
    direction: Direction | Literal["both"] = "both"
    heater: str = "E0"
    state: Literal["off", "on"] = "off"
    temperature: float = 0.0
    axis: Literal["x", "y", "z"] = "x"
    share: float = 1.0


class FaultEvent(NamedTuple):
    """An injected fault.

    Attributes:
        time: s.
        line: number of the line executed last.
        text: what happened.
    """

    time: float
    line: int
    text: str


class Faults:
    """Injects faults into a printer and its cable. Use one instance per run.

    Attributes:
        due: time of the next start or end of a fault that depends on time only, s.
        unplugged: whether the cable is disconnected.
        events: faults injected so far, in order.
        layer_now: returns the current layer; None counts the heights printed.
    """

    def __init__(self, faults: Sequence[Fault], chance: RandomSource) -> None:
        self.due = inf
        self.unplugged = False
        self.events: list[FaultEvent] = []
        self.layer_now: Callable[[], int] | None = None
        self._chance = chance
        self._waiting = list(faults)
        self._ends: list[tuple[float, Fault]] = []
        self._acting: dict[Fault, int] = {}  # on the cable, and how often
        self._line = self._layer = inf
        self._z = inf
        self._printer: SimulatedPrinter | None = None

    def take(self, printer: SimulatedPrinter) -> None:
        """Attach to a printer."""
        self._printer = printer
        self._reckon()

    def watch(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Wrap the callback for executed commands to detect faults tied to lines or layers."""

        def executed(text: str) -> None:
            """Pass the command on, and interrupt the printer once the fault is due."""
            printer = self._printer
            assert printer is not None
            if on_executed is not None:
                on_executed(text)
            layers, z = self._layer_progress(printer)
            if printer.line >= self._line or layers >= self._layer or z >= self._z:
                self.due = printer.state.now
                printer.interrupt()

        return executed

    def strike(self, now: float) -> None:
        """Start and end all faults that are due."""
        printer = self._printer
        assert printer is not None
        layers, z = self._layer_progress(printer)
        line = printer.line
        come = [one for one in self._waiting if self._has_come(one, now, line, layers, z)]
        self._waiting = [one for one in self._waiting if not self._has_come(one, now, line, layers, z)]
        self._reckon()  # a reset printer asks for the next event
        for fault in come:
            self.events.append(FaultEvent(now, line, _describe_fault(fault)))
            self._begin(fault, printer, now)
            if fault.seconds < inf and fault.kind != "hang":
                self._ends.append((now + fault.seconds, fault))
        over = [fault for end, fault in self._ends if end <= now]
        self._ends = [one for one in self._ends if one[0] > now]
        for fault in over:
            self._end(fault, printer, now)
        self._reckon()

    def __call__(self, data: bytes, direction: Direction) -> bytes:
        """Return what arrives of bytes sent through the cable."""
        if self.unplugged:
            return b""
        for fault in list(self._acting):
            if fault.direction in ("both", direction) and data:
                data = self._changed(fault, data, direction)
        return data

    def _layer_progress(self, printer: SimulatedPrinter) -> tuple[int, float]:
        """Return the current layer, and the height of the last extrusion, mm."""
        layers, z = printer.layer_progress
        return (layers if self.layer_now is None else self.layer_now()), z

    def _has_come(self, fault: Fault, now: float, line: int, layers: int, z: float) -> bool:
        """Return whether a fault is due."""
        if fault.line is not None:
            return line >= fault.line
        if fault.layer is not None:
            return layers >= fault.layer
        if fault.z is not None:
            return z >= fault.z
        return now >= (fault.time or 0.0)

    def _reckon(self) -> None:
        """Update when the next fault is due."""
        waiting = self._waiting
        placed = [one for one in waiting if (one.line, one.layer, one.z) == (None, None, None)]
        self.due = min([*(one.time or 0.0 for one in placed), *(end for end, _ in self._ends)], default=inf)
        self._line = min((one.line for one in waiting if one.line is not None), default=inf)
        self._layer = min((one.layer for one in waiting if one.layer is not None), default=inf)
        self._z = min((one.z for one in waiting if one.z is not None), default=inf)

    def _begin(self, fault: Fault, printer: SimulatedPrinter, now: float) -> None:
        """Start a fault."""
        state = printer.state
        if fault.kind in CABLE_KINDS:
            self._acting[fault] = 0
        elif fault.kind == "disconnect":
            self.unplugged = True
        elif fault.kind == "hang":
            printer.hang(fault.seconds, now)
        elif fault.kind == "brown_out":
            printer.reset(now)
        elif fault.kind in ("heater", "sensor"):
            self._upset(fault, printer, now, broken=True)
        elif fault.kind == "endstop":
            state.stuck_endstops.add("xyz".index(fault.axis))
        elif fault.kind == "clog":
            state.set_clogged_share(fault.share)
        else:
            state.run_out_of_filament()

    def _end(self, fault: Fault, printer: SimulatedPrinter, now: float) -> None:
        """End a fault."""
        self._acting.pop(fault, None)
        if fault.kind == "disconnect":
            self.unplugged = False
        elif fault.kind in ("heater", "sensor"):
            self._upset(fault, printer, now, broken=False)
        elif fault.kind == "endstop":
            printer.state.stuck_endstops.discard("xyz".index(fault.axis))
        elif fault.kind == "clog":
            printer.state.set_clogged_share(0.0)

    def _upset(self, fault: Fault, printer: SimulatedPrinter, now: float, *, broken: bool) -> None:
        """Break or repair a heater; ignore one that the machine does not have."""
        state = printer.state
        if fault.heater not in state.heaters.protections:
            return
        state.apply_flow_cooling()
        heater = state.heaters.named(fault.heater)
        if not broken:
            heater.disturb(now, element="works")
        elif fault.kind == "heater":
            heater.disturb(now, element=fault.state)
        else:
            heater.disturb(now, stuck_at=fault.temperature)
        state.disturb(fault.heater)

    def _changed(self, fault: Fault, data: bytes, direction: Direction) -> bytes:
        """Return bytes as a fault changes them."""
        if fault.kind == "burst":
            del self._acting[fault]
            return bytes(self._chance.randrange(256) for _ in range(fault.bytes)) + data
        if fault.kind == "lose_reply":
            return (
                data
                if direction == "to printer"
                else _OK.sub(lambda match: self._lost(fault, match[0]), data)
            )
        return b"".join(self._hit(fault, byte) for byte in data)

    def _lost(self, fault: Fault, reply: bytes) -> bytes:
        """Return a reply, or nothing if it is lost."""
        return b"" if self._strikes_again(fault) else reply

    def _hit(self, fault: Fault, byte: int) -> bytes:
        """Return one byte as a fault changes it."""
        if not self._strikes_again(fault):
            return bytes((byte,))
        if fault.kind == "flip":
            return bytes((byte ^ 1 << self._chance.randrange(8),))
        if fault.kind == "insert":
            return bytes((self._chance.randrange(256), byte))
        return bytes((byte, byte)) if fault.kind == "duplicate" else b""

    def _strikes_again(self, fault: Fault) -> bool:
        """Decide at random whether a byte or reply is affected; end a fault that has reached its count."""
        struck = self._acting.get(fault)
        if struck is None or self._chance.random() >= fault.rate:
            return False
        self._acting[fault] = struck + 1
        if struck + 1 == fault.count:
            del self._acting[fault]
        return True


def _describe_fault(fault: Fault) -> str:
    """Describe a fault as text."""
    lasting = f" for {fault.seconds:g} s" if fault.seconds < inf else ""
    return {
        "burst": f"{fault.bytes} bytes of noise {fault.direction}",
        "lose_reply": f"{100 * fault.rate:g}% of the replies lost"
        + (f", at most {fault.count}" if fault.count else ""),
        "disconnect": "cable disconnected",
        "hang": "firmware hangs",
        "brown_out": "firmware reset",
        "heater": f"heater {fault.heater} is stuck {fault.state}",
        "sensor": f"sensor of {fault.heater} reads {fault.temperature:g} °C",
        "endstop": f"{fault.axis} endstop does not trigger",
        "clog": f"nozzle clogged, {100 * fault.share:g}%",
        "runout": "filament runout",
    }.get(fault.kind, f"{fault.kind} {fault.direction}, {fault.rate:g} of the bytes") + lasting
