"""Reproducible faults of the simulated printer and its cable.

kind         affects    what happens
flip         cable      one bit flips in each affected byte; `rate` is the share of affected bytes
drop         cable      bytes are lost
insert       cable      extra bytes appear
duplicate    cable      bytes arrive twice
burst        cable      a single burst of noise, `bytes` long
lose_reply   cable      ok replies are lost: the share `rate` of them, and at most `count`
disconnect   cable      the cable is unplugged
hang         printer    the main loop hangs
brown_out    printer    the firmware resets
heater       printer    a heater is stuck in a `state`, "off" or "on"
sensor       printer    a thermistor always reads the same `temperature`
endstop      printer    the endstop of an `axis` never triggers
clog         printer    a `share` of the fed filament does not come out
runout       printer    the filament runs out

A fault starts at a line number, a layer, a height z, a time, or at once. It lasts for `seconds` or for ever. All random
numbers come from one generator, so runs with the same seed, faults and host are identical.
"""

from __future__ import annotations

import re
from math import inf
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from printer_slicer.sim.cable_noise import Direction
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.sim.cable_noise import RandomSource
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["CABLE_KINDS", "KINDS", "Fault", "FaultEvent", "Faults"]

KINDS: Final = (
    *("flip", "drop", "insert", "duplicate", "burst", "lose_reply", "disconnect"),
    *("hang", "brown_out", "heater", "sensor", "endstop", "clog", "runout"),
)

CABLE_KINDS: Final = frozenset({"flip", "drop", "insert", "duplicate", "burst", "lose_reply"})
"""Kinds of faults that change bytes on the cable."""

_OK_LINE: Final = re.compile(rb"ok[^\n]*\n")


class Fault(Struct, frozen=True):
    """A fault to inject, with its start, its duration and the properties of its kind.

    Attributes:
        kind: see the table above.
        line: line number at which the fault starts; without line numbers, number of commands.
        layer: layer at which it starts, by the layer comments of the file, or by the number of heights printed.
        z: height at which it starts, with the first extrusion at or above it, mm.
        time: time after power-on at which it starts, s.
        seconds: duration; infinity: for ever.
        rate: share of the bytes or replies that are affected.
        count: maximum number of occurrences; 0: unlimited.
        bytes: length of a burst.
        direction: affected direction of the cable.
        heater: bed, E0 (the first hotend), E1 and so on.
        state: state in which a heater is stuck.
        temperature: constant reading of a broken sensor, °C.
        axis: axis of the endstop.
        share: share of the fed filament that does not come out.
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
    """A record of an injected fault.

    Attributes:
        time: time at which it started, s.
        line: number of the line that was executed last.
        text: description of the fault.
    """

    time: float
    line: int
    text: str


class Faults:
    """Injects faults into a printer and its cable. Use one instance per run.

    Attributes:
        due: next time at which a fault starts or ends, s; starts at a line, layer or height do not count.
        unplugged: whether the cable is disconnected.
        events: faults injected so far, in order.
        current_layer: function that returns the current layer; None: the heights with extrusion are counted.
    """

    def __init__(self, faults: Sequence[Fault], chance: RandomSource) -> None:
        self.due = inf
        self.unplugged = False
        self.events: list[FaultEvent] = []
        self.current_layer: Callable[[], int] | None = None
        self._chance = chance
        self._waiting = list(faults)
        self._ends: list[tuple[float, Fault]] = []
        self._occurrences: dict[Fault, int] = {}  # number of occurrences of each active fault of the cable
        self._line = self._layer = inf
        self._z = inf
        self._printer: SimulatedPrinter | None = None

    def attach_to(self, printer: SimulatedPrinter) -> None:
        """Connect these faults to the printer that they act on."""
        self._printer = printer
        self._update_due_times()

    def wrap_callback(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Return a callback for executed commands that also detects faults that must start now."""

        def check_faults(text: str) -> None:
            """Pass the executed command on, and interrupt the printer if a fault must start now."""
            printer = self._printer
            assert printer is not None
            if on_executed is not None:
                on_executed(text)
            layers, z = self._find_layer_and_height(printer)
            if printer.line_number >= self._line or layers >= self._layer or z >= self._z:
                self.due = printer.state.now
                printer.interrupt()

        return check_faults

    def inject_due_faults(self, now: float) -> None:
        """Start and end all faults whose time has come at `now`, s."""
        printer = self._printer
        assert printer is not None
        layers, z = self._find_layer_and_height(printer)
        line = printer.line_number
        starting = [one for one in self._waiting if self._is_due(one, now, line, layers, z)]
        self._waiting = [one for one in self._waiting if not self._is_due(one, now, line, layers, z)]
        self._update_due_times()  # first, because a fault may reset the printer, which then reads `due`
        for fault in starting:
            self.events.append(FaultEvent(now, line, _describe_fault(fault)))
            self._start_fault(fault, printer, now)
            if fault.seconds < inf and fault.kind != "hang":
                self._ends.append((now + fault.seconds, fault))
        ended = [fault for end, fault in self._ends if end <= now]
        self._ends = [one for one in self._ends if one[0] > now]
        for fault in ended:
            self._end_fault(fault, printer, now)
        self._update_due_times()

    def __call__(self, data: bytes, direction: Direction) -> bytes:
        """Return the bytes that arrive at the other end of the cable."""
        if self.unplugged:
            return b""
        for fault in list(self._occurrences):
            if fault.direction in ("both", direction) and data:
                data = self._corrupt_bytes(fault, data, direction)
        return data

    def _find_layer_and_height(self, printer: SimulatedPrinter) -> tuple[int, float]:
        """Return the current layer, and the height of the last extrusion, mm."""
        layers, z = printer.layer_count_and_height
        return (layers if self.current_layer is None else self.current_layer()), z

    def _is_due(self, fault: Fault, now: float, line: int, layers: int, z: float) -> bool:
        """Return whether a fault must start, given the time, s, line number, layer number and height, mm."""
        if fault.line is not None:
            return line >= fault.line
        if fault.layer is not None:
            return layers >= fault.layer
        if fault.z is not None:
            return z >= fault.z
        return now >= (fault.time or 0.0)

    def _update_due_times(self) -> None:
        """Update the time, line, layer and height at which the next fault is due."""
        waiting = self._waiting
        timed = [one for one in waiting if (one.line, one.layer, one.z) == (None, None, None)]
        self.due = min([*(one.time or 0.0 for one in timed), *(end for end, _ in self._ends)], default=inf)
        self._line = min((one.line for one in waiting if one.line is not None), default=inf)
        self._layer = min((one.layer for one in waiting if one.layer is not None), default=inf)
        self._z = min((one.z for one in waiting if one.z is not None), default=inf)

    def _start_fault(self, fault: Fault, printer: SimulatedPrinter, now: float) -> None:
        """Start a fault at `now`, s."""
        state = printer.state
        if fault.kind in CABLE_KINDS:
            self._occurrences[fault] = 0
        elif fault.kind == "disconnect":
            self.unplugged = True
        elif fault.kind == "hang":
            printer.hang(fault.seconds, now)
        elif fault.kind == "brown_out":
            printer.reset(now)
        elif fault.kind in ("heater", "sensor"):
            self._set_heater_fault(fault, printer, now, broken=True)
        elif fault.kind == "endstop":
            state.stuck_endstops.add("xyz".index(fault.axis))
        elif fault.kind == "clog":
            state.set_clogged_share(fault.share)
        else:
            state.run_out_of_filament()

    def _end_fault(self, fault: Fault, printer: SimulatedPrinter, now: float) -> None:
        """End a fault at `now`, s."""
        self._occurrences.pop(fault, None)
        if fault.kind == "disconnect":
            self.unplugged = False
        elif fault.kind in ("heater", "sensor"):
            self._set_heater_fault(fault, printer, now, broken=False)
        elif fault.kind == "endstop":
            printer.state.stuck_endstops.discard("xyz".index(fault.axis))
        elif fault.kind == "clog":
            printer.state.set_clogged_share(0.0)

    def _set_heater_fault(self, fault: Fault, printer: SimulatedPrinter, now: float, *, broken: bool) -> None:
        """Break or repair the heater that a fault names, if the machine has this heater."""
        state = printer.state
        if fault.heater not in state.heaters.protections:
            return
        state.apply_flow_cooling()
        heater = state.heaters.find_heater(fault.heater)
        if not broken:
            heater.set_fault(now, element="works")
        elif fault.kind == "heater":
            heater.set_fault(now, element=fault.state)
        else:
            heater.set_fault(now, stuck_at=fault.temperature)
        state.record_heater_fault(fault.heater)

    def _corrupt_bytes(self, fault: Fault, data: bytes, direction: Direction) -> bytes:
        """Return what arrives of `data` at the other end while a fault damages the cable."""
        if fault.kind == "burst":
            del self._occurrences[fault]
            return bytes(self._chance.randrange(256) for _ in range(fault.bytes)) + data
        if fault.kind == "lose_reply":
            return (
                data
                if direction == "to printer"
                else _OK_LINE.sub(lambda match: self._pass_or_lose_reply(fault, match[0]), data)
            )
        return b"".join(self._corrupt_byte(fault, byte) for byte in data)

    def _pass_or_lose_reply(self, fault: Fault, reply: bytes) -> bytes:
        """Return a reply unchanged, or no bytes if the fault deletes the reply."""
        return b"" if self._decide_if_affected(fault) else reply

    def _corrupt_byte(self, fault: Fault, byte: int) -> bytes:
        """Return the bytes that arrive instead of one sent byte while a fault damages the cable."""
        if not self._decide_if_affected(fault):
            return bytes((byte,))
        if fault.kind == "flip":
            return bytes((byte ^ 1 << self._chance.randrange(8),))
        if fault.kind == "insert":
            return bytes((self._chance.randrange(256), byte))
        return bytes((byte, byte)) if fault.kind == "duplicate" else b""

    def _decide_if_affected(self, fault: Fault) -> bool:
        """Decide at random whether a fault affects the next byte or reply; end it at its maximum count."""
        struck = self._occurrences.get(fault)
        if struck is None or self._chance.random() >= fault.rate:
            return False
        self._occurrences[fault] = struck + 1
        if struck + 1 == fault.count:
            del self._occurrences[fault]
        return True


def _describe_fault(fault: Fault) -> str:
    """Return the text that describes a fault in its `FaultEvent`."""
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
