"""A simulated printer at a serial port: firmware, heaters and motion, without I/O, clock or thread.

The caller passes bytes with their arrival times, reads the replies, and asks for the time of the next call. It also
provides the time. With a virtual clock, a print of hours takes seconds; with the real clock, hosts can be tested. The
result depends only on the bytes and their times, not on the number of calls.

docs/simulator.md describes what is modelled and what is known about each firmware.
"""

from __future__ import annotations

from collections import deque
from math import inf, nextafter, pi
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.batch import Batch, BatchStart
from printer_slicer.sim.card_commands import abort_print, finish_print, write_to_file
from printer_slicer.sim.commands import choose_move_executor, start_command
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

_MOVE_CODES: Final = frozenset({"G0", "G1", "G2", "G3"})

_INTERNAL_LINE: Final = -(2**63)
"""Line number that marks commands from the SD card or the firmware itself, which get no ok."""

_CARD_SECONDS: Final = 0.0002
"""Time that the main loop needs to read a line from the card, s."""


class SimulatedPrinter:
    """A simulated printer, which receives the bytes of a host and sends replies.

    Args:
        machine: hardware of the printer.
        firmware: behaviour of the firmware.
        on_executed: called with each command, without number and checksum, when it starts.
        boots: whether the printer is switched on at time 0 and sends its banner; else it was on before.
        move_log: log of all moves; None: none.
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
        self._on_executed = on_executed if faults is None else faults.wrap_callback(on_executed)
        self._execute_move = choose_move_executor(firmware)
        self._any_number = firmware.accepted_lines == "any"
        self._waits_forever = firmware.line_timeout == inf
        self._statistics = Statistics(move_log)
        self._card = SdCard(card)
        self._faults = faults
        self._line: int | None = None
        self._ready = 0.0
        self._booting_until = self._hung_until = -inf
        self._power_on(0.0, banner=boots)
        if faults is not None:
            faults.attach_to(self)
            self._next = self._next_event()

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes at `now`, s."""
        self._advance_to(now)
        if self._state.killed or now < self._booting_until:
            return
        self._line_errors.last_byte = now
        if self._firmware.emergency_parser:
            for code in self._parser.add_bytes(data):
                self._execute_urgent_command(code)
        self._reader.add_bytes(data)
        self._process_lines()

    def send(self, now: float) -> bytes:
        """Return the replies that the printer has sent until `now`, s, since the last call."""
        self._advance_to(now)
        out = self._state.out
        if not out:
            return b""
        replies = "".join(out).encode("latin-1")
        out.clear()
        self._counted_output = 0
        return replies

    def wakeup(self) -> float | None:
        """Return the time of the next event, s; None if nothing happens until bytes arrive."""
        if self._state.out:
            return self._state.now
        return self._next if self._next < inf else None

    @property
    def state(self) -> FirmwareState:
        """State of the firmware; a reset creates a new state."""
        return self._state

    @property
    def line_number(self) -> int:
        """Number of the last line that was started; without line numbers, number of started commands."""
        if self._queue and self._queue[0][0] not in (None, _INTERNAL_LINE):
            self._line = self._queue[0][0]
        return self._statistics.lines if self._line is None else self._line

    @property
    def layer_count_and_height(self) -> tuple[int, float]:
        """Number of heights with extrusion, and the height of the last extrusion, mm."""
        return self._statistics.n_layers, self._statistics.last_extrusion_z

    def interrupt(self) -> None:
        """Make the printer check for events before it starts the next line."""
        self._ready = max(self._ready, nextafter(self._state.now, inf))

    @property
    def unread_bytes(self) -> int:
        """Number of received bytes not read yet; with flow control, a high number makes the sender wait."""
        return self._reader.unread_bytes

    @property
    def has_unanswered_command(self) -> bool:
        """Whether a received command has not been acknowledged yet."""
        return not self._state.killed and bool(self._queue or self._line_errors.needs_resend)

    @property
    def undisturbed_until(self) -> float:
        """Time of the next event that is not caused by a command, s; infinite if there is none."""
        return min(self._state.due, self._next_wait)

    def receive_line(self, number: int | None, text: str, now: float) -> None:
        """Receive a whole line at `now`, s, without buffering, and without a check of number and checksum."""
        self._advance_to(now)
        if not self._state.killed:
            self._reader.last = self._reader.last if number is None else number
            self._queue_line((number, text))
            self._process_lines()

    def start_batch(self, now: float) -> BatchStart | None:
        """Return the state before a batch of simple commands at `now`, s; None if nothing moves."""
        self._state.motion_queue.advance(now)
        return BatchStart.from_state(self._state, self.undisturbed_until)

    def apply_batch(self, batch: Batch) -> None:
        """Apply the combined effect of a batch of simple commands."""
        assert not self.has_unanswered_command
        self._reader.last = batch.number
        self._numbered = True
        batch.apply(self._state)
        self._next = self._next_event()

    def reset(self, now: float) -> None:
        """Restart the firmware, as a brown-out or the reset button does.

        Received lines, planned moves and settings are lost. Statistics are kept, and the heaters cool down.
        """
        self._advance_to(now)
        self._reset()

    def _reset(self) -> None:
        """Restart the firmware at the current time."""
        self._statistics.resets += 1
        self._line = None
        old = self._state
        old.stop_moving()
        self._booting_until = old.now + self._firmware.boot_seconds
        self._power_on(old.now, banner=True)
        self._state.out[:0] = old.out
        self._state.inherit_hardware(old)
        self._next = self._next_event()

    def hang(self, seconds: float, now: float) -> None:
        """Block the main loop for `seconds` from `now`, s; arriving bytes then fill the receive buffer."""
        self._advance_to(now)
        self._ready = self._hung_until = max(self._ready, now) + seconds
        self._process_lines()

    def report(self) -> Report:
        """Return the statistics so far; moves that still wait count fully, except for their duration."""
        state = self._state
        state.motion_queue.advance(state.now)
        state.apply_flow_cooling()
        state.set_clogged_share(state.clogged)
        for heater in state.heaters.all_heaters():
            heater.temperature(state.now)
        radius = self._machine.filament_diameter / 2.0
        return self._statistics.report(
            filament_area=pi * radius * radius,
            peak_hotend=max(heater.peak for heater in state.heaters.hotends),
            peak_bed=state.bed.peak,
        )

    def _power_on(self, now: float, *, banner: bool) -> None:
        """Create the firmware state after power-on or reset at `now`, s."""
        self._card.stop()
        self._card.writing = ""
        self._state = FirmwareState(self._machine, self._firmware, self._statistics, self._card, now)
        self._state.inject = self._queue_internal_command
        self._state.reset = self._reset
        self._reader = LineReader(self._firmware, self._statistics)
        self._line_errors = LineErrorReplies(self._reader, self._state, self._firmware, self._statistics, now)
        self._parser = EmergencyParser(self._firmware.line_size)
        self._queue: deque[Line] = deque()
        self._steps: Steps | None = None
        self._resume_at = self._next_busy = inf
        self._next_wait = now + self._firmware.wait_seconds if self._firmware.wait_seconds else inf
        self._numbered = False  # whether a numbered line was executed
        self._ready = now  # time at which the main loop is free, s
        self._counted_output = 0  # number of output lines whose sending time has been counted
        self._next = inf
        if banner:
            for line in self._firmware.banner:
                self._state.send_line(line)
        self._process_lines()

    def _advance_to(self, now: float) -> None:
        """Simulate all events until `now`, s."""
        while self._next <= now:
            self._run_events(self._next)
        self._state.now = max(self._state.now, now)

    def _run_events(self, now: float) -> None:
        """Simulate the events at `now`, s."""
        state = self._state
        state.now = now
        if self._faults is not None and self._faults.due <= now:
            self._next = inf  # a fault may reset the printer, which sets it again
            self._faults.inject_due_faults(now)
            state = self._state
        if now >= self._hung_until:
            self._run_main_loop(state, now)
        self._process_lines()

    def _run_main_loop(self, state: FirmwareState, now: float) -> None:
        """Do the work of the main loop at `now`, s, except reading lines."""
        if self._steps is not None and max(self._resume_at, self._ready) <= now:
            self._continue_command(self._steps)
        if self._steps is not None and self._next_busy <= now:
            state.send_report(state.busy_report)
            self._next_busy = now + state.busy_seconds
        if state.due <= now:
            state.run_due_alarms()
        idle = not (self._queue or self._reader.has_unread_bytes) and self._ready <= now
        if idle and self._next_wait <= now:
            state.send_report("wait")
            self._next_wait = now + self._firmware.wait_seconds
        if not self._waits_forever and self._line_errors.next_event_time() <= now:
            self._line_errors.discard_partial_line(now)

    def _next_event(self) -> float:
        """Return the time of the next event if no bytes arrive, s; infinite if there is no event."""
        state = self._state
        if self._faults is not None or self._hung_until > state.now:
            return self._next_event_with_faults()
        if state.killed:
            return inf
        return self._next_firmware_event(state)

    def _next_event_with_faults(self) -> float:
        """Return the time of the next event, s, if faults are injected or the main loop hangs."""
        state = self._state
        fault_due = inf if self._faults is None else self._faults.due
        if state.killed:
            return fault_due
        hung = self._hung_until > state.now
        return min(fault_due, self._hung_until if hung else self._next_firmware_event(state))

    def _next_firmware_event(self, state: FirmwareState) -> float:
        """Return the time of the next event of the firmware, s; infinite if there is no event."""
        due = state.due if self._waits_forever else min(state.due, self._line_errors.next_event_time())
        if self._steps is not None:
            due = min(due, max(self._resume_at, self._ready), self._next_busy)
        elif not (self._queue or self._reader.has_unread_bytes):
            due = min(due, max(self._next_wait, self._ready))
        if self._ready > state.now and (
            self._queue
            or self._line_errors.needs_resend
            or self._reader.has_unread_bytes
            or self._card.printing
        ):
            due = min(due, self._ready)
        return due

    def _process_lines(self) -> None:
        """Read and execute lines as far as possible at the current time."""
        state, reader, queue = self._state, self._reader, self._queue
        places = self._firmware.queue_places
        costly = self._firmware.seconds_per_byte > 0.0
        while not state.killed:
            if costly:
                self._block_while_sending()
            if self._ready > state.now:
                break
            if self._line_errors.needs_resend:
                self._line_errors.request_resend()
            elif queue and self._steps is None:
                self._start_next_command()
            elif len(queue) >= places:
                break
            elif (line := reader.next_line()) is not None:
                self._queue_line(line)
            elif reader.is_rejected or reader.skip_replies is not None or reader.overflowed:
                self._line_errors.send_reply()
            elif self._card.printing:
                self._queue_card_line()
            else:
                break
        self._next = self._next_event()

    def _queue_card_line(self) -> None:
        """Queue the next line of the file that is being printed from the SD card."""
        text = self._card.next_command()
        if text is None:
            finish_print(self._state)
            return
        self._queue.append((_INTERNAL_LINE, text))
        self._ready = max(self._ready, self._state.now) + _CARD_SECONDS

    def _queue_internal_command(self, text: str) -> None:
        """Queue a command of the firmware itself behind the current one."""
        self._queue.insert(1, (_INTERNAL_LINE, text))

    def _block_while_sending(self) -> None:
        """Block the main loop for the time that sending the new output takes."""
        out = self._state.out
        if len(out) > self._counted_output:
            n_bytes = sum(map(len, out[self._counted_output :]))
            self._counted_output = len(out)
            self._ready = max(self._ready, self._state.now) + n_bytes * self._firmware.seconds_per_byte

    def _queue_line(self, line: Line) -> None:
        """Queue a line; execute an urgent command without line number at once."""
        number, text = line
        if (
            (number is None or self._any_number)
            and text[:4] in URGENT_CODES
            and self._is_executed_early(text[:4])
        ):
            self._execute_urgent_command(text[:4])
        self._queue.append(line)
        if self._firmware.ok_when_read:
            self._state.send_line("ok")
        self._ready = max(self._ready, self._state.now) + self._firmware.seconds_per_line

    def _is_executed_early(self, code: str) -> bool:
        """Return whether the firmware executes an urgent command already when the command is queued."""
        if self._firmware.language == "klipper":
            return code == "M112"
        return not self._firmware.emergency_parser and not self._card.writing

    def _execute_urgent_command(self, code: str) -> None:
        """Execute an urgent command: M112 halts; M108 and M876 end a wait; M410 stops motion; M524 aborts a print."""
        state = self._state
        if code == "M112":
            if not state.shut_down:
                state.kill("M112 Shutdown")
            if state.shut_down and self._steps is not None:
                self._steps = None
                self._acknowledge_command()
        elif code in {"M108", "M876"}:
            if state.waiting and (code == "M108" or self._firmware.prompts):
                state.waiting = False
                self._resume_at = state.now
        elif code == "M524":
            abort_print(state)
        else:
            state.stop_moving()
            self._ready = max(self._ready, state.now) + STOP_SECONDS
            # A command that waited for moves can continue now; other commands keep waiting.
            self._resume_at = min(self._resume_at, self._ready)

    def _start_next_command(self) -> None:
        """Start the first command in the queue."""
        number, text = self._queue[0]
        state = self._state
        if self._card.writing:
            write_to_file(state, text)
            self._acknowledge_command()
            return
        self._statistics.count_command(text)
        if self._on_executed is not None:
            self._on_executed(text)
        if number is not None:
            self._numbered = self._numbered or number != _INTERNAL_LINE
        elif self._numbered and text.partition(" ")[0] in _MOVE_CODES:
            self._statistics.unnumbered_moves += 1
        match = SIMPLE_MOVE(text)
        if match is None:
            state.last_line = self._reader.last
            steps = start_command(state, text)
            if state.renumber is not None:
                self._reader.last, state.renumber = state.renumber, None
        else:
            steps = self._execute_move(state, match.groups())
        if steps is None:
            self._acknowledge_command()
        else:
            self._steps = steps
            self._next_busy = state.now + state.busy_seconds if state.busy_seconds else inf
            self._continue_command(steps)

    def _continue_command(self, steps: Steps) -> None:
        """Execute the next step of a command that takes time."""
        self._state.motion_queue.advance(self._state.now)
        due = next(steps, None)
        if due is None:
            self._steps = None
            self._acknowledge_command()
        else:
            self._resume_at = due

    def _acknowledge_command(self) -> None:
        """Send the ok for the executed command, unless it halted the printer."""
        state, firmware = self._state, self._firmware
        number, _ = self._queue.popleft()
        if state.killed or number == _INTERNAL_LINE:
            return
        if state.muted:
            state.muted -= 1
        elif firmware.ok_when_read:
            if state.ok_tail:
                state.send_line(state.ok_tail.strip())
                state.ok_tail = ""
        elif state.ok_tail:
            state.send_line("ok" + state.ok_tail)
            state.ok_tail = ""
        elif firmware.advanced_ok:
            state.motion_queue.advance(state.now)
            name = "" if number is None else f" N{number}"
            # The current command still occupies a place in the queue.
            free = firmware.queue_places - len(self._queue) - 1
            state.send_line(f"ok{name} P{state.motion_queue.free_places} B{free}")
        else:
            state.out.append("ok\n")
        if firmware.wait_seconds:
            self._next_wait = state.now + firmware.wait_seconds
