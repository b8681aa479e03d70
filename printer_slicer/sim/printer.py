"""A simulated printer: firmware, heaters and motion behind a serial port, without I/O, clock or thread.

Bytes go in with the moment they arrive, bytes come out, and the printer says when it wants to be asked again.
All time is the caller's: a virtual clock makes a print of hours take seconds, the real one makes it a printer
to test a host against. What happens depends only on the bytes and their times, never on how often anybody
asks.

Modelled:
- the serial port: receive buffer with or without flow control, lines assembled from bytes however they are
  cut, the 96-byte line buffer, numbers, checksums, refusals and resends as the chosen front end does them, ok
  (also with numbers), `busy`, `wait`, a main loop that takes time and waits for its own printing, M108, M112
  and M410 seen early, the emergency parser;
- the command queue of four and the planner of sixteen: a move is answered when it has a place in the planner,
  so a full planner holds back the ok; moves last as long as `motion.rules.Lookahead` says, with what it knew
  by then;
- heaters that store and lose heat, waits with their window, M109 and M190 with S and R;
- homing and probing that take their time, soft endstops, offsets, units, relative and absolute modes, arcs,
  feed and flow ratios, limits changed by M201 to M205, refused cold extrusion;
- an account of all that, see `Report`: times, filament, heights, violations, starvations.

Not modelled: steps and their rounding, pressure advance, filament and its melting, a bed that is not flat,
sensors that fail or are noisy, thermal runaway and every other fault of the machine, EEPROM, SD card,
display, more than one extruder, backspaces and quoting in lines, and the speed within a move: the position
in the middle of a move is taken by its share of time.
"""

from __future__ import annotations

import re
from collections import deque
from math import inf, pi
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.board import Board
from printer_slicer.sim.commands import run
from printer_slicer.sim.front_end import MARLIN_2_1, FrontEnd
from printer_slicer.sim.line_reader import Line, LineReader
from printer_slicer.sim.moves import STOP_SECONDS, straight
from printer_slicer.sim.tally import Report, Tally
from printer_slicer.sim.words import SIMPLE_MOVE

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.board import Steps
    from printer_slicer.sim.machine import Machine

__all__ = ["SimulatedPrinter"]

_URGENT: Final = re.compile(rb" *(?:N[-0-9 ]*)?(M108|M112|M410)").match
"""What an emergency parser recognises at the start of a line, whatever follows."""

_URGENT_CODES: Final = frozenset({"M108", "M112", "M410"})

_MOVES: Final = frozenset({"G0", "G1", "G2", "G3"})


class SimulatedPrinter:
    """The printer's end of the cable.

    Args:
        machine: what it is made of.
        front_end: how its firmware reads and answers.
        on_executed: called with each command, without number and checksum, when it begins.
        boots: it is switched on at time 0 and says its banner; otherwise it was on for long and says nothing.
    """

    def __init__(
        self,
        machine: Machine,
        front_end: FrontEnd = MARLIN_2_1,
        *,
        on_executed: Callable[[str], None] | None = None,
        boots: bool = True,
    ) -> None:
        self._machine = machine
        self._front_end = front_end
        self._on_executed = on_executed
        self._tally = Tally()
        self._ready = 0.0
        self._deaf_until = -inf
        self._start(0.0, banner=boots)

    def receive(self, data: bytes, now: float) -> None:
        """Bytes that arrive at `now`, s."""
        self._advance(now)
        if self._board.killed or now < self._deaf_until:
            return
        self._last_byte = now
        if self._front_end.emergency_parser:
            self._parse_emergencies(data)
        self._reader.arrive(data)
        self._pump()

    def send(self, now: float) -> bytes:
        """What the printer has said until `now`, s, and was not sent yet."""
        self._advance(now)
        out = self._board.out
        if not out:
            return b""
        said = "".join(out).encode("latin-1")
        out.clear()
        self._charged = 0
        return said

    def wakeup(self) -> float | None:
        """When the printer will next have something to say or do, s; None when not before bytes arrive."""
        if self._board.out:
            return self._board.now
        return self._next if self._next < inf else None

    @property
    def working(self) -> bool:
        """Whether a command that arrived is still unanswered."""
        return not self._board.killed and bool(self._queue or self._asking)

    def reset(self, now: float) -> None:
        """Restart the firmware, as a brown-out or the reset button does.

        What it had read, planned and set is lost, what was counted is kept, the heaters cool from where they
        are.
        """
        self._advance(now)
        self._tally.resets += 1
        old = self._board
        old.stop_moving()
        self._deaf_until = old.now + self._front_end.boot_seconds
        self._start(old.now, banner=True)
        self._board.out[:0] = old.out
        for heater, before in ((self._board.hotend, old.hotend), (self._board.bed, old.bed)):
            heater.cool_from(before, old.now)

    def hang(self, seconds: float, now: float) -> None:
        """Let the main loop do something else for so long; what arrives in the meantime fills the buffer."""
        self._advance(now)
        self._ready = max(self._ready, now) + seconds
        self._pump()

    def report(self) -> Report:
        """What was executed so far; moves that have not begun are in it with everything but their time."""
        board = self._board
        board.mover.advance(board.now)
        for heater in (board.hotend, board.bed):
            heater.temperature(board.now)
        radius = self._machine.filament_diameter / 2.0
        return self._tally.report(
            filament_area=pi * radius * radius, peak_hotend=board.hotend.peak, peak_bed=board.bed.peak
        )

    def _start(self, now: float, *, banner: bool) -> None:
        """The state after power-on."""
        self._board = Board(self._machine, self._front_end, self._tally, now)
        self._reader = LineReader(self._front_end, self._tally)
        self._queue: deque[Line] = deque()
        self._steps: Steps | None = None
        self._resume_at = self._next_busy = inf
        self._next_wait = now + self._front_end.wait_seconds if self._front_end.wait_seconds else inf
        self._numbered = False  # a line with a number was executed
        self._asking = False  # a refused line still needs its Resend
        self._ready = now  # the main loop has no time before
        self._charged = 0  # how many of the lines said have cost the main loop their time
        self._arriving = b""
        self._last_byte = now
        self._next = inf
        if banner:
            for line in self._front_end.banner:
                self._board.say(line)
        self._pump()

    def _advance(self, now: float) -> None:
        """Let everything happen that is due until `now`."""
        while self._next <= now:
            self._happen(self._next)
        self._board.now = max(self._board.now, now)

    def _happen(self, now: float) -> None:
        """Let happen what is due at `now`."""
        board = self._board
        board.now = now
        if self._steps is not None and max(self._resume_at, self._ready) <= now:
            self._resume(self._steps)
        if self._steps is not None and self._next_busy <= now:
            board.say(f"echo:busy: {board.busy_with}")
            self._next_busy = now + board.busy_seconds
        if board.next_report <= now:
            board.say(" " + board.temperatures())
            board.next_report += board.report_seconds
        if not self._queue and self._next_wait <= now:
            board.say("wait")
            self._next_wait = now + self._front_end.wait_seconds
        if self._abandons() <= now:
            self._abandon(now)
        self._pump()

    def _abandons(self) -> float:
        """When it will wait no longer for the rest of a line, or for a line that it asked for; infinite for never."""
        reader, front_end = self._reader, self._front_end
        asked = front_end.partial_asks and reader.skipping >= 0 and not reader.waiting
        return self._last_byte + front_end.partial_seconds if asked or reader.partial else inf

    def _abandon(self, now: float) -> None:
        """Throw the beginning of a line away, and ask for it again where the firmware does."""
        self._last_byte = now
        self._reader.abandon()
        if self._front_end.partial_asks:
            self._asking = True
        else:
            self._board.say("RX timeout")

    def _next_event(self) -> float:
        """When something will happen without bytes arriving."""
        board = self._board
        if board.killed:
            return inf
        due = min(board.next_report, self._abandons())
        if self._steps is not None:
            due = min(due, max(self._resume_at, self._ready), self._next_busy)
        elif not self._queue:
            due = min(due, max(self._next_wait, self._ready))
        if self._ready > board.now and (self._queue or self._asking or self._reader.waiting):
            due = min(due, self._ready)
        return due

    def _pump(self) -> None:
        """Read and execute as far as it goes at this moment, line by line as a slow wire would bring them."""
        board, reader, queue = self._board, self._reader, self._queue
        places = self._front_end.queue_places
        costly = self._front_end.seconds_per_byte > 0.0
        while not board.killed:
            if costly:
                self._charge()
            if self._ready > board.now:
                break
            if self._asking:
                self._ask_again()
            elif queue and self._steps is None:
                self._execute()
            elif len(queue) >= places:
                break
            elif (line := reader.next()) is not None:
                self._enqueue(line)
            elif not self._answer_refused():
                break
        self._next = self._next_event()

    def _answer_refused(self) -> bool:
        """Answer a line that was not taken; False when there was none, and everything was read."""
        reader = self._reader
        if reader.refused:
            self._refuse()
        elif reader.passed is not None:
            for said in reader.passed:
                self._board.say(said)
            reader.passed = None
        else:
            self._look_at_overflow()
            return False
        return True

    def _look_at_overflow(self) -> None:
        """Everything was read: say whether some of it came too fast."""
        reader = self._reader
        if reader.overflowed and self._front_end.tells_overflow:
            reader.abandon()
            self._board.say("Full RX Buffer")
        reader.overflowed = False

    def _charge(self) -> None:
        """Hold up the main loop for what was said since the last time."""
        out = self._board.out
        if len(out) > self._charged:
            n_bytes = sum(map(len, out[self._charged :]))
            self._charged = len(out)
            self._ready = max(self._ready, self._board.now) + n_bytes * self._front_end.seconds_per_byte

    def _enqueue(self, line: Line) -> None:
        """Put a line into the queue; the urgent ones act at once if they are un-numbered."""
        number, text = line
        if number is None and text[:4] in _URGENT_CODES and not self._front_end.emergency_parser:
            self._act_urgently(text[:4])
        self._queue.append(line)
        if self._front_end.ok_when_read:
            self._board.say("ok")
        self._ready = max(self._ready, self._board.now) + self._front_end.seconds_per_line

    def _parse_emergencies(self, data: bytes) -> None:
        """Act on urgent commands as soon as their line is complete."""
        data = self._arriving + data.replace(b"\r", b"\n")
        *lines, rest = data.split(b"\n")
        self._arriving = rest[: self._front_end.line_size]
        for line in lines:
            match = _URGENT(line)
            if match is not None:
                self._act_urgently(match[1].decode())

    def _act_urgently(self, code: str) -> None:
        """M108 ends a wait, M410 stops the motion, M112 everything."""
        board = self._board
        if code == "M112":
            board.kill("M112 Shutdown")
        elif code == "M108":
            if board.waiting:
                board.waiting = False
                self._resume_at = board.now
        else:
            board.stop_moving()
            self._ready = max(self._ready, board.now) + STOP_SECONDS
            # A command that waited for moves waits for nothing now; any other goes back to sleep.
            self._resume_at = min(self._resume_at, self._ready)

    def _refuse(self) -> None:
        """Say what is wrong with a line; saying so may take time in which more arrives."""
        reader = self._reader
        if reader.fault:
            self._board.say(reader.fault)
        reader.fault, reader.refused = "", False
        self._tally.line_errors += 1
        self._asking = True

    def _ask_again(self) -> None:
        """Ask for the line after the last good one."""
        self._asking = False
        if self._front_end.flushes_on_error:
            self._reader.flush()
        self._tally.resends += 1
        self._board.say(self._front_end.resend.format(wanted=self._reader.last + 1))
        if self._front_end.ok_after_resend:
            self._board.say("ok")

    def _execute(self) -> None:
        """Begin the first command of the queue."""
        number, text = self._queue[0]
        board = self._board
        self._tally.executed(text)
        if self._on_executed is not None:
            self._on_executed(text)
        if number is not None:
            self._numbered = True
        elif self._numbered and text.partition(" ")[0] in _MOVES:
            self._tally.unnumbered_moves += 1
        match = SIMPLE_MOVE(text)
        if match is None:
            board.last_line = self._reader.last
            steps = run(board, text)
            if board.renumber is not None:
                self._reader.last, board.renumber = board.renumber, None
        else:
            steps = straight(board, match.groups())
        if steps is None:
            self._acknowledge()
        else:
            self._steps = steps
            self._next_busy = board.now + board.busy_seconds if board.busy_seconds else inf
            self._resume(steps)

    def _resume(self, steps: Steps) -> None:
        """Go on with a command that takes time."""
        self._board.mover.advance(self._board.now)
        due = next(steps, None)
        if due is None:
            self._steps = None
            self._acknowledge()
        else:
            self._resume_at = due

    def _acknowledge(self) -> None:
        """Answer the command that was executed; one that killed the printer gets no answer."""
        board, front_end = self._board, self._front_end
        number, _ = self._queue.popleft()
        if board.killed:
            return
        if front_end.ok_when_read:
            if board.ok_tail:
                board.say(board.ok_tail.strip())
                board.ok_tail = ""
        elif board.ok_tail:
            board.say("ok" + board.ok_tail)
            board.ok_tail = ""
        elif front_end.advanced_ok:
            board.mover.advance(board.now)
            name = "" if number is None else f" N{number}"
            # The command that is being answered still holds its place.
            free = front_end.queue_places - len(self._queue) - 1
            board.say(f"ok{name} P{board.mover.room} B{free}")
        else:
            board.out.append("ok\n")
        if front_end.wait_seconds:
            self._next_wait = board.now + front_end.wait_seconds
