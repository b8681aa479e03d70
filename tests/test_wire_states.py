"""Any order of faults and wishes: what was executed is always the beginning of the job, and it always ends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from benchmarks.wire_lab import QUICK
from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.states import ENDED, State
from tests.effort import examples

if TYPE_CHECKING:
    from printer_slicer.sim.link import Direction

JOB = [b"G28", b"G90", b"M83", b"G92 E0", *(b"G1 X%d Y%d E0.5 F6000" % (i, 2 * i) for i in range(1, 81))]
MOVES = [line.decode() for line in JOB if line.startswith(b"G1")]
END_SCRIPT = [b"M104 S0", b"G91", b"G1 Z5 F300", b"G90"]

DAMAGES = ("flip", "drop", "lose ok", "double ok", "noise")


class Wire(RuleBasedStateMachine):
    """A streamer and a printer, a cable that hits the next chunk as it is told, and a person."""

    @initialize(name=st.sampled_from(sorted(SIMULATED_FIRMWARES)), baud=st.sampled_from([None, 115_200]))
    def begin(self, name: str, baud: int | None) -> None:
        self.firmware = SIMULATED_FIRMWARES[name]
        self.executed: list[str] = []
        self.events: list[Event] = []
        self.hits: list[tuple[Direction, str, int]] = []
        self.was_reset = self.was_cancelled = self.was_stopped = False
        self.at_reset = 0
        firmware = replace(self.firmware, boot_seconds=0.1)
        machine = replace(QUICK, coldest_extrusion=0.0)
        self.printer = SimulatedPrinter(machine, firmware, on_executed=self.executed.append)
        self.port = VirtualPort(self.printer, baud=baud, latency=0.001, noise=self._damage)
        self.streamer = Streamer(JOB, limits=machine.limits, baud=baud)

    def _damage(self, data: bytes, way: Direction) -> bytes:
        for hit in self.hits:
            if hit[0] == way and data:
                self.hits.remove(hit)
                return spoilt(data, hit[1], hit[2])
        return data

    def _pump(self, seconds: float) -> None:
        end = self.port.now() + seconds
        while True:
            now = self.port.now()
            if data := self.streamer.send(now):
                self.port.write(data)
            self.events += self.streamer.events()
            if self.streamer.done or now >= end:
                return
            due = self.streamer.wakeup()
            wait = end - now if due is None else min(max(due - now, 0.0), end - now)
            self.streamer.receive(self.port.read(wait), self.port.now())

    @rule(seconds=st.sampled_from([0.003, 0.02, 0.1, 0.5, 3.0]))
    def time_passes(self, seconds: float) -> None:
        self._pump(seconds)

    # Klipper executes what arrives, however damaged: there the cable must be a good one.
    @precondition(lambda self: self.firmware.accepted_lines != "any")
    @rule(what=st.sampled_from(DAMAGES[:2]), at=st.integers(0, 200))
    def line_is_hit(self, what: str, at: int) -> None:
        self.hits.append(("to printer", what, at))

    @rule(what=st.sampled_from(DAMAGES), at=st.integers(0, 200))
    def answer_is_hit(self, what: str, at: int) -> None:
        if what != "double ok" or self.firmware.accepted_lines == "next":
            self.hits.append(("to host", what, at))

    @rule()
    def pause(self) -> None:
        self.streamer.pause()

    @rule()
    def resume(self) -> None:
        self.streamer.resume()

    @rule(command=st.sampled_from([b"M105", b"M106 S9", b"M117 hello"]))
    def inject(self, command: bytes) -> None:
        self.streamer.inject(command)

    @precondition(lambda self: not self.was_cancelled)
    @rule()
    def cancel(self) -> None:
        self.was_cancelled = True
        self.streamer.cancel(END_SCRIPT)

    @rule()
    def emergency_stop(self) -> None:
        self.was_stopped = True
        self.streamer.emergency_stop()

    @precondition(lambda self: not self.was_reset)
    @rule()
    def reset(self) -> None:
        self.was_reset = self.streamer.state is not State.CONNECTING
        self.printer.reset(self.port.now())

    @invariant()
    def moves_are_the_beginning_of_the_job(self) -> None:
        moves = [line for line in getattr(self, "executed", []) if line.startswith("G1") and "Z5" not in line]
        assert moves == MOVES[: len(moves)]

    def teardown(self) -> None:
        if not hasattr(self, "streamer"):
            return
        self.hits.clear()
        self.streamer.resume()
        self._pump(600.0)
        self.moves_are_the_beginning_of_the_job()
        assert self.streamer.state in ENDED
        ends = [event for event in self.events if isinstance(event, Finished | Halted)]
        assert len(ends) == 1
        moves = [line for line in self.executed if line.startswith("G1") and "Z5" not in line]
        if isinstance(ends[0], Finished):
            assert self.was_cancelled or len(moves) == len(MOVES)
        else:
            assert (
                self.was_reset
                or self.was_stopped
                or self.was_cancelled
                or self.firmware.accepted_lines != "next"
            ), ends


def spoilt(data: bytes, what: str, at: int) -> bytes:
    """A chunk with one fault in it."""
    at %= len(data)
    if what == "flip":
        return data[:at] + bytes([data[at] ^ 1 << at % 8]) + data[at + 1 :]
    if what == "drop":
        return data[:at] + data[at + 1 :]
    if what == "lose ok":
        return data.replace(b"ok\n", b"", 1)
    if what == "double ok":
        return data.replace(b"ok\n", b"ok\nok\n", 1)
    return bytes((at * 7 + i) % 256 for i in range(50)).replace(b"\n", b"?") + b"\n" + data


def test_an_ok_too_many_before_the_count_is_told_does_no_harm() -> None:
    """The first answer is damaged; the oks of commands that a person types meanwhile come in its place."""
    for at in range(0, 40, 3):
        wire = Wire()
        wire.begin(name="marlin 2.1.3", baud=115_200)
        wire.answer_is_hit(what="flip", at=at)
        for command in (b"M105", b"M105", b"M106 S9", b"M105"):
            wire.inject(command)
        wire.teardown()


TestWire = Wire.TestCase
TestWire.settings = settings(
    max_examples=examples(60), stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
)
