"""What shall go wrong with a simulated printer and its cable, and when: planted faults, the same each time.

kind         strikes    what happens
flip         cable      bits of bytes flip, a `rate` of the bytes
drop         cable      bytes are lost
insert       cable      bytes come that nobody sent
duplicate    cable      bytes come twice
burst        cable      once, so many `bytes` of noise
lose_reply   cable      lines of the printer that begin with ok are lost, a `rate` of them, `count` at most
disconnect   cable      the plug is out
hang         printer    the main loop does nothing
brown_out    printer    the firmware starts anew
heater       printer    an element is dead (`state` "off") or cannot be switched off ("on")
sensor       printer    a thermistor `reads` the same for ever
endstop      printer    the endstop of an `axis` never closes
clog         printer    a `share` of the filament that is fed does not come out
runout       printer    the filament ends

A fault strikes when the printer begins the line with a number, begins its n-th layer or lays plastic above a z, at a
time, or from the beginning; what lasts does so for `seconds`, or for ever. All chance comes from one source that is
given, so the same seed, faults and host make the same run.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.sim.damage import Chance, Direction
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["CABLE_KINDS", "KINDS", "Fault", "Faults", "Happening"]

KINDS: Final = (
    *("flip", "drop", "insert", "duplicate", "burst", "lose_reply", "disconnect"),
    *("hang", "brown_out", "heater", "sensor", "endstop", "clog", "runout"),
)

CABLE_KINDS: Final = frozenset({"flip", "drop", "insert", "duplicate", "burst", "lose_reply"})
"""Those that change bytes on their way."""

_OK: Final = re.compile(rb"ok[^\n]*\n")


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    Attributes:
        kind: see the table above.
        line: number of the line, as the host counts them; of a host that does not, how many it has sent.
        layer: of those that comments of the file tell, else how many heights plastic was laid at.
        z: mm, at or above which plastic was laid.
        time: s since the printer was switched on.
        seconds: how long it lasts; infinity: for ever.
        rate: share of bytes or replies.
        count: how often at most; 0: without end.
        bytes: of a burst.
        way: which direction of the cable.
        heater: bed, E0 (the first hotend), E1 and so on.
        state: of a heater's element.
        reads: °C, of a sensor.
        axis: x, y or z.
        share: of the filament.
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
    way: Direction | Literal["both"] = "both"
    heater: str = "E0"
    state: Literal["off", "on"] = "off"
    reads: float = 0.0
    axis: Literal["x", "y", "z"] = "x"
    share: float = 1.0


class Happening(NamedTuple):
    """A fault that struck.

    Attributes:
        time: s.
        line: number of the line that was executed last.
        text: what happened.
    """

    time: float
    line: int
    text: str


class Faults:
    """Faults waiting for their moment. Given to the printer and to its cable; good for one run.

    Attributes:
        due: when the next one strikes or ends without the printer doing anything, s.
        unplugged: the cable carries nothing.
        happened: what struck so far, in order.
        layer_now: in which layer the printer is; None counts the heights at which it has laid plastic.
    """

    def __init__(self, faults: Sequence[Fault], chance: Chance) -> None:
        self.due = inf
        self.unplugged = False
        self.happened: list[Happening] = []
        self.layer_now: Callable[[], int] | None = None
        self._chance = chance
        self._waiting = list(faults)
        self._ends: list[tuple[float, Fault]] = []
        self._acting: dict[Fault, int] = {}  # on the cable, and how often
        self._line = self._layer = inf
        self._z = inf
        self._printer: SimulatedPrinter | None = None

    def take(self, printer: SimulatedPrinter) -> None:
        """Strike this printer."""
        self._printer = printer
        self._reckon()

    def watch(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Something to call with each command that begins; it passes it on."""

        def executed(text: str) -> None:
            """Pass the command on, and interrupt the printer once the fault is due."""
            printer = self._printer
            assert printer is not None
            if on_executed is not None:
                on_executed(text)
            layers, z = self._laid(printer)
            if printer.line >= self._line or layers >= self._layer or z >= self._z:
                self.due = printer.board.now
                printer.interrupt()

        return executed

    def strike(self, now: float) -> None:
        """Let everything strike, and end, whose time has come."""
        printer = self._printer
        assert printer is not None
        layers, z = self._laid(printer)
        line = printer.line
        come = [one for one in self._waiting if self._has_come(one, now, line, layers, z)]
        self._waiting = [one for one in self._waiting if not self._has_come(one, now, line, layers, z)]
        self._reckon()  # a printer that is reset looks for what is next
        for fault in come:
            self.happened.append(Happening(now, line, _told(fault)))
            self._begin(fault, printer, now)
            if fault.seconds < inf and fault.kind != "hang":
                self._ends.append((now + fault.seconds, fault))
        over = [fault for end, fault in self._ends if end <= now]
        self._ends = [one for one in self._ends if one[0] > now]
        for fault in over:
            self._end(fault, printer, now)
        self._reckon()

    def __call__(self, data: bytes, direction: Direction) -> bytes:
        """What arrives of bytes on their way through the cable."""
        if self.unplugged:
            return b""
        for fault in list(self._acting):
            if fault.way in ("both", direction) and data:
                data = self._changed(fault, data, direction)
        return data

    def _laid(self, printer: SimulatedPrinter) -> tuple[int, float]:
        """The layer, and the height at which plastic was laid last, mm."""
        layers, z = printer.laid
        return (layers if self.layer_now is None else self.layer_now()), z

    def _has_come(self, fault: Fault, now: float, line: int, layers: int, z: float) -> bool:
        """Whether it is time for a fault."""
        if fault.line is not None:
            return line >= fault.line
        if fault.layer is not None:
            return layers >= fault.layer
        if fault.z is not None:
            return z >= fault.z
        return now >= (fault.time or 0.0)

    def _reckon(self) -> None:
        """Find out anew what comes next."""
        waiting = self._waiting
        placed = [one for one in waiting if (one.line, one.layer, one.z) == (None, None, None)]
        self.due = min([*(one.time or 0.0 for one in placed), *(end for end, _ in self._ends)], default=inf)
        self._line = min((one.line for one in waiting if one.line is not None), default=inf)
        self._layer = min((one.layer for one in waiting if one.layer is not None), default=inf)
        self._z = min((one.z for one in waiting if one.z is not None), default=inf)

    def _begin(self, fault: Fault, printer: SimulatedPrinter, now: float) -> None:
        """A fault strikes."""
        board = printer.board
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
            board.stuck_endstops.add("xyz".index(fault.axis))
        elif fault.kind == "clog":
            board.clog(fault.share)
        else:
            board.spool_ended()

    def _end(self, fault: Fault, printer: SimulatedPrinter, now: float) -> None:
        """A fault is over."""
        self._acting.pop(fault, None)
        if fault.kind == "disconnect":
            self.unplugged = False
        elif fault.kind in ("heater", "sensor"):
            self._upset(fault, printer, now, broken=False)
        elif fault.kind == "endstop":
            printer.board.stuck_endstops.discard("xyz".index(fault.axis))
        elif fault.kind == "clog":
            printer.board.clog(0.0)

    def _upset(self, fault: Fault, printer: SimulatedPrinter, now: float, *, broken: bool) -> None:
        """Break or mend a heater; one that the machine does not have is left alone."""
        board = printer.board
        if fault.heater not in board.heaters.guards:
            return
        board.settle()
        heater = board.heaters.named(fault.heater)
        if not broken:
            heater.upset(now, element="works")
        elif fault.kind == "heater":
            heater.upset(now, element=fault.state)
        else:
            heater.upset(now, stuck_at=fault.reads)
        board.upset(fault.heater)

    def _changed(self, fault: Fault, data: bytes, direction: Direction) -> bytes:
        """What a fault makes of some bytes."""
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
        """A reply, or nothing."""
        return b"" if self._strikes_again(fault) else reply

    def _hit(self, fault: Fault, byte: int) -> bytes:
        """What becomes of one byte."""
        if not self._strikes_again(fault):
            return bytes((byte,))
        if fault.kind == "flip":
            return bytes((byte ^ 1 << self._chance.randrange(8),))
        if fault.kind == "insert":
            return bytes((self._chance.randrange(256), byte))
        return bytes((byte, byte)) if fault.kind == "duplicate" else b""

    def _strikes_again(self, fault: Fault) -> bool:
        """Draw whether this one is hit; a fault that has struck often enough does not any more."""
        struck = self._acting.get(fault)
        if struck is None or self._chance.random() >= fault.rate:
            return False
        self._acting[fault] = struck + 1
        if struck + 1 == fault.count:
            del self._acting[fault]
        return True


def _told(fault: Fault) -> str:
    """A fault in words."""
    lasting = f" for {fault.seconds:g} s" if fault.seconds < inf else ""
    return {
        "burst": f"{fault.bytes} bytes of noise {fault.way}",
        "lose_reply": f"replies lost, {100 * fault.rate:g} % of them"
        + (f", at most {fault.count}" if fault.count else ""),
        "disconnect": "the cable was pulled",
        "hang": "the firmware hangs",
        "brown_out": "the firmware started anew",
        "heater": f"heater {fault.heater} is stuck {fault.state}",
        "sensor": f"sensor of {fault.heater} reads {fault.reads:g} °C",
        "endstop": f"the {fault.axis} endstop does not close",
        "clog": f"the nozzle is clogged, {100 * fault.share:g} %",
        "runout": "the filament has run out",
    }.get(fault.kind, f"{fault.kind} {fault.way}, {fault.rate:g} of the bytes") + lasting
