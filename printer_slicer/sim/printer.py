"""A simulated printer: firmware, heaters and motion behind a serial port, without I/O, clock or thread.

The caller passes bytes with their arrival times, reads the replies, and learns when to call again. It also provides the
time: with a virtual clock a print of hours takes seconds, with the real clock it is a printer to test hosts against.
The result depends only on the bytes and their times, not on how often it is called.

docs/simulator.md describes what is modelled and what is known about each firmware.
"""

from __future__ import annotations

from collections import deque
from math import inf, nextafter, pi
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.batch import Batch, BatchStart
from printer_slicer.sim.card_commands import abort, finished, write_line
from printer_slicer.sim.commands import move_executor, run
from printer_slicer.sim.emergency_parser import URGENT_CODES, EmergencyParser
from printer_slicer.sim.firmware_state import FirmwareState
from printer_slicer.sim.firmwares import MARLIN_2_1, SimulatedFirmware
from printer_slicer.sim.line_errors import LineErrorReplies
from printer_slicer.sim.line_reader import Line, LineReader
from printer_slicer.sim.move_commands import STOP_SECONDS
from printer_slicer.sim.parsed_command import SIMPLE_MOVE
from printer_slicer.sim.sd_card import SdCard
from printer_slicer.sim.statistics import Report, Statistics

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from printer_slicer.sim.fault_injector import FaultInjector
    from printer_slicer.sim.firmware_state import Steps
    from printer_slicer.sim.machine import Machine
    from printer_slicer.sim.move_log import MoveLog

__all__ = ["SimulatedPrinter"]

_MOVES: Final = frozenset({"G0", "G1", "G2", "G3"})

_OWN: Final = -(2**63)
"""Line number of commands from the SD card or the firmware itself, which get no ok."""

_CARD_SECONDS: Final = 0.0002
"""Time of the main loop for reading a line from the card, s."""


class SimulatedPrinter:
    """A simulated printer.

    Args:
        machine: its hardware.
        firmware: behaviour of its firmware.
        on_executed: called with each command, without number and checksum, when it starts.
        boots: whether it is switched on at time 0 and sends its banner; otherwise it has been on before.
        move_log: receives every move.
        faults: faults to inject.
        card: files on the SD card, by name.
    """

    def __init__(  # noqa: PLR0913 - all but one have a good default
        self,
        machine: Machine,
        firmware: SimulatedFirmware = MARLIN_2_1,
        *,
        on_executed: Callable[[str], None] | None = None,
        boots: bool = True,
        move_log: MoveLog | None = None,
        faults: FaultInjector | None = None,
        card: Mapping[str, bytes] | None = None,
    ) -> None:
        self._machine = machine
        self._firmware = firmware
        self._on_executed = on_executed if faults is None else faults.watch(on_executed)
        self._straight = move_executor(firmware)
        self._any_number = firmware.takes == "any"
        self._patient = firmware.partial_seconds == inf
        self._statistics = Statistics(move_log)
        self._card = SdCard(card)
        self._faults = faults
        self._line: int | None = None
        self._ready = 0.0
        self._deaf_until = self._hung_until = -inf
        self._start(0.0, banner=boots)
        if faults is not None:
            faults.take(self)
            self._next = self._next_event()

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes at `now`, s."""
        self._advance(now)
        if self._state.killed or now < self._deaf_until:
            return
        self._refusals.last_byte = now
        if self._firmware.emergency_parser:
            for code in self._parser.arrive(data):
                self._act_urgently(code)
        self._reader.arrive(data)
        self._pump()

    def send(self, now: float) -> bytes:
        """Return the replies until `now`, s, that were not returned yet."""
        self._advance(now)
        out = self._state.out
        if not out:
            return b""
        said = "".join(out).encode("latin-1")
        out.clear()
        self._charged = 0
        return said

    def wakeup(self) -> float | None:
        """Return the time of the next event, s; None if there is none before bytes arrive."""
        if self._state.out:
            return self._state.now
        return self._next if self._next < inf else None

    @property
    def state(self) -> FirmwareState:
        """State of the firmware; replaced at each reset."""
        return self._state

    @property
    def line(self) -> int:
        """Number of the line started last; without line numbers, the number of commands."""
        if self._queue and self._queue[0][0] not in (None, _OWN):
            self._line = self._queue[0][0]
        return self._statistics.lines if self._line is None else self._line

    @property
    def layer_progress(self) -> tuple[int, float]:
        """Number of heights with extrusion, and the last of them, mm."""
        return self._statistics.n_layers, self._statistics.z

    def interrupt(self) -> None:
        """Check for events before the next line starts."""
        self._ready = max(self._ready, nextafter(self._state.now, inf))

    @property
    def unread(self) -> int:
        """Number of received bytes not read yet; with flow control, the sender waits while there are many."""
        return self._reader.unread

    @property
    def working(self) -> bool:
        """Whether a received command is still unanswered."""
        return not self._state.killed and bool(self._queue or self._refusals.asking)

    @property
    def undisturbed_until(self) -> float:
        """Time of the next event that no command causes, s; infinite for never."""
        return min(self._state.due, self._next_wait)

    def hear(self, number: int | None, text: str, now: float) -> None:
        """Receive a whole line at `now`, s, bypassing the bytes."""
        self._advance(now)
        if not self._state.killed:
            self._reader.last = self._reader.last if number is None else number
            self._enqueue((number, text))
            self._pump()

    def start_batch(self, now: float) -> BatchStart | None:
        """Return the state that a batch of simple commands from `now`, s, depends on; None while nothing moves."""
        self._state.motion_queue.advance(now)
        return BatchStart.of(self._state, self.undisturbed_until)

    def apply_batch(self, batch: Batch) -> None:
        """Apply the effect of a batch of simple commands."""
        assert not self.working
        self._reader.last = batch.number
        self._numbered = True
        batch.apply(self._state)
        self._next = self._next_event()

    def reset(self, now: float) -> None:
        """Restart the firmware, as a brown-out or the reset button does.

        Received lines, planned moves and settings are lost. Statistics are kept, and the heaters cool down.
        """
        self._advance(now)
        self._reset()

    def _reset(self) -> None:
        self._statistics.resets += 1
        self._line = None
        old = self._state
        old.stop_moving()
        self._deaf_until = old.now + self._firmware.boot_seconds
        self._start(old.now, banner=True)
        self._state.out[:0] = old.out
        self._state.inherit_hardware(old)
        self._next = self._next_event()

    def hang(self, seconds: float, now: float) -> None:
        """Block the main loop, s; bytes that arrive meanwhile fill the buffer."""
        self._advance(now)
        self._ready = self._hung_until = max(self._ready, now) + seconds
        self._pump()

    def report(self) -> Report:
        """Return the statistics so far; moves that have not started count fully, except for their duration."""
        state = self._state
        state.motion_queue.advance(state.now)
        state.apply_flow_cooling()
        state.set_clogged_share(state.clogged)
        for heater in state.heaters.all():
            heater.temperature(state.now)
        radius = self._machine.filament_diameter / 2.0
        return self._statistics.report(
            filament_area=pi * radius * radius,
            peak_hotend=max(heater.peak for heater in state.heaters.hotends),
            peak_bed=state.bed.peak,
        )

    def _start(self, now: float, *, banner: bool) -> None:
        """Set the state after power-on."""
        self._card.stop()
        self._card.writing = ""
        self._state = FirmwareState(self._machine, self._firmware, self._statistics, self._card, now)
        self._state.inject = self._inject
        self._state.reset = self._reset
        self._reader = LineReader(self._firmware, self._statistics)
        self._refusals = LineErrorReplies(self._reader, self._state, self._firmware, self._statistics, now)
        self._parser = EmergencyParser(self._firmware.line_size)
        self._queue: deque[Line] = deque()
        self._steps: Steps | None = None
        self._resume_at = self._next_busy = inf
        self._next_wait = now + self._firmware.wait_seconds if self._firmware.wait_seconds else inf
        self._numbered = False  # whether a numbered line was executed
        self._ready = now  # when the main loop is free
        self._charged = 0  # number of output lines whose sending time has been counted
        self._next = inf
        if banner:
            for line in self._firmware.banner:
                self._state.say(line)
        self._pump()

    def _advance(self, now: float) -> None:
        """Simulate all events until `now`."""
        while self._next <= now:
            self._happen(self._next)
        self._state.now = max(self._state.now, now)

    def _happen(self, now: float) -> None:
        """Simulate the events at `now`."""
        state = self._state
        state.now = now
        if self._faults is not None and self._faults.due <= now:
            self._next = inf  # it may reset the printer
            self._faults.strike(now)
            state = self._state
        if now >= self._hung_until:
            self._go_on(state, now)
        self._pump()

    def _go_on(self, state: FirmwareState, now: float) -> None:
        """Do the work of the main loop besides reading lines."""
        if self._steps is not None and max(self._resume_at, self._ready) <= now:
            self._resume(self._steps)
        if self._steps is not None and self._next_busy <= now:
            state.report(state.busy_report)
            self._next_busy = now + state.busy_seconds
        if state.due <= now:
            state.run_due_alarms()
        idle = not (self._queue or self._reader.waiting) and self._ready <= now
        if idle and self._next_wait <= now:
            state.report("wait")
            self._next_wait = now + self._firmware.wait_seconds
        if not self._patient and self._refusals.due() <= now:
            self._refusals.abandon(now)

    def _next_event(self) -> float:
        """Return the time of the next event without new bytes."""
        state = self._state
        if self._faults is not None or self._hung_until > state.now:
            return self._next_trouble()
        if state.killed:
            return inf
        return self._next_of_firmware(state)

    def _next_trouble(self) -> float:
        """Return the time of the next event with injected faults, or while the main loop hangs."""
        state = self._state
        planted = inf if self._faults is None else self._faults.due
        if state.killed:
            return planted
        hung = self._hung_until > state.now
        return min(planted, self._hung_until if hung else self._next_of_firmware(state))

    def _next_of_firmware(self, state: FirmwareState) -> float:
        """Return the time of the next event of the firmware."""
        due = state.due if self._patient else min(state.due, self._refusals.due())
        if self._steps is not None:
            due = min(due, max(self._resume_at, self._ready), self._next_busy)
        elif not (self._queue or self._reader.waiting):
            due = min(due, max(self._next_wait, self._ready))
        if self._ready > state.now and (
            self._queue or self._refusals.asking or self._reader.waiting or self._card.printing
        ):
            due = min(due, self._ready)
        return due

    def _pump(self) -> None:
        """Read and execute lines as far as possible at this time."""
        state, reader, queue = self._state, self._reader, self._queue
        places = self._firmware.queue_places
        costly = self._firmware.seconds_per_byte > 0.0
        while not state.killed:
            if costly:
                self._charge()
            if self._ready > state.now:
                break
            if self._refusals.asking:
                self._refusals.ask_again()
            elif queue and self._steps is None:
                self._execute()
            elif len(queue) >= places:
                break
            elif (line := reader.next()) is not None:
                self._enqueue(line)
            elif reader.refused or reader.passed is not None or reader.overflowed:
                self._refusals.answer()
            elif self._card.printing:
                self._read_card()
            else:
                break
        self._next = self._next_event()

    def _read_card(self) -> None:
        """Queue a line of the file being printed."""
        text = self._card.next()
        if text is None:
            finished(self._state)
            return
        self._queue.append((_OWN, text))
        self._ready = max(self._ready, self._state.now) + _CARD_SECONDS

    def _inject(self, text: str) -> None:
        """Queue a command of the firmware behind the current one."""
        self._queue.insert(1, (_OWN, text))

    def _charge(self) -> None:
        """Block the main loop for the time of sending new output."""
        out = self._state.out
        if len(out) > self._charged:
            n_bytes = sum(map(len, out[self._charged :]))
            self._charged = len(out)
            self._ready = max(self._ready, self._state.now) + n_bytes * self._firmware.seconds_per_byte

    def _enqueue(self, line: Line) -> None:
        """Queue a line; unnumbered urgent commands are executed at once."""
        number, text = line
        if (number is None or self._any_number) and text[:4] in URGENT_CODES and self._sees_early(text[:4]):
            self._act_urgently(text[:4])
        self._queue.append(line)
        if self._firmware.ok_when_read:
            self._state.say("ok")
        self._ready = max(self._ready, self._state.now) + self._firmware.seconds_per_line

    def _sees_early(self, code: str) -> bool:
        """Return whether an urgent command is executed when it is queued."""
        if self._firmware.language == "klipper":
            return code == "M112"
        return not self._firmware.emergency_parser and not self._card.writing

    def _act_urgently(self, code: str) -> None:
        """Execute an urgent command: M108 and M876 end a wait, M410 stops motion, M524 a file print, M112 halts."""
        state = self._state
        if code == "M112":
            if not state.shut_down:
                state.kill("M112 Shutdown")
            if state.shut_down and self._steps is not None:
                self._steps = None
                self._acknowledge()
        elif code in {"M108", "M876"}:
            if state.waiting and (code == "M108" or self._firmware.prompts):
                state.waiting = False
                self._resume_at = state.now
        elif code == "M524":
            abort(state)
        else:
            state.stop_moving()
            self._ready = max(self._ready, state.now) + STOP_SECONDS
            # A command that waited for moves can continue; others keep waiting.
            self._resume_at = min(self._resume_at, self._ready)

    def _execute(self) -> None:
        """Start the first command of the queue."""
        number, text = self._queue[0]
        state = self._state
        if self._card.writing:
            write_line(state, text)
            self._acknowledge()
            return
        self._statistics.executed(text)
        if self._on_executed is not None:
            self._on_executed(text)
        if number is not None:
            self._numbered = self._numbered or number != _OWN
        elif self._numbered and text.partition(" ")[0] in _MOVES:
            self._statistics.unnumbered_moves += 1
        match = SIMPLE_MOVE(text)
        if match is None:
            state.last_line = self._reader.last
            steps = run(state, text)
            if state.renumber is not None:
                self._reader.last, state.renumber = state.renumber, None
        else:
            steps = self._straight(state, match.groups())
        if steps is None:
            self._acknowledge()
        else:
            self._steps = steps
            self._next_busy = state.now + state.busy_seconds if state.busy_seconds else inf
            self._resume(steps)

    def _resume(self, steps: Steps) -> None:
        """Continue a command that takes time."""
        self._state.motion_queue.advance(self._state.now)
        due = next(steps, None)
        if due is None:
            self._steps = None
            self._acknowledge()
        else:
            self._resume_at = due

    def _acknowledge(self) -> None:
        """Acknowledge the executed command; none if it halted the printer."""
        state, firmware = self._state, self._firmware
        number, _ = self._queue.popleft()
        if state.killed or number == _OWN:
            return
        if state.muted:
            state.muted -= 1
        elif firmware.ok_when_read:
            if state.ok_tail:
                state.say(state.ok_tail.strip())
                state.ok_tail = ""
        elif state.ok_tail:
            state.say("ok" + state.ok_tail)
            state.ok_tail = ""
        elif firmware.advanced_ok:
            state.motion_queue.advance(state.now)
            name = "" if number is None else f" N{number}"
            # The current command still occupies its place.
            free = firmware.queue_places - len(self._queue) - 1
            state.say(f"ok{name} P{state.motion_queue.room} B{free}")
        else:
            state.out.append("ok\n")
        if firmware.wait_seconds:
            self._next_wait = state.now + firmware.wait_seconds
