"""A simulated printer: firmware, heaters and motion behind a serial port, without I/O, clock or thread.

Bytes go in with the moment they arrive, bytes come out, and the printer says when it wants to be asked again.
All time is the caller's: a virtual clock makes a print of hours take seconds, the real one makes it a printer
to test a host against. What happens depends only on the bytes and their times, never on how often anybody
asks.

What is modelled, what is not, and what is known of each firmware is told in docs/simulator.md.
"""

from __future__ import annotations

from collections import deque
from math import inf, nextafter, pi
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.batch import Batch, BatchStart
from printer_slicer.sim.board import Board
from printer_slicer.sim.card import SdCard
from printer_slicer.sim.card_commands import abort, finished, write_line
from printer_slicer.sim.commands import run, straight_of
from printer_slicer.sim.front_end import MARLIN_2_1, FrontEnd
from printer_slicer.sim.line_reader import Line, LineReader
from printer_slicer.sim.moves import STOP_SECONDS
from printer_slicer.sim.refusals import Refusals
from printer_slicer.sim.tally import Report, Tally
from printer_slicer.sim.urgent import URGENT_CODES, EmergencyParser
from printer_slicer.sim.words import SIMPLE_MOVE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from printer_slicer.sim.board import Steps
    from printer_slicer.sim.machine import Machine
    from printer_slicer.sim.track import Track
    from printer_slicer.sim.trouble import Trouble

__all__ = ["SimulatedPrinter"]

_MOVES: Final = frozenset({"G0", "G1", "G2", "G3"})

_OWN: Final = -(2**63)
"""Stands for the line number of a command of the card or of the firmware itself, which gets no ok."""

_CARD_SECONDS: Final = 0.0002
"""What reading a line of the card costs the main loop."""


class SimulatedPrinter:
    """The printer's end of the cable.

    Args:
        machine: what it is made of.
        front_end: how its firmware reads and answers.
        on_executed: called with each command, without number and checksum, when it begins.
        boots: it is switched on at time 0 and says its banner; otherwise it was on for long and says nothing.
        track: is told every move.
        faults: what shall go wrong.
        card: files on the memory card, by name.
    """

    def __init__(  # noqa: PLR0913 - all but one have a good default
        self,
        machine: Machine,
        front_end: FrontEnd = MARLIN_2_1,
        *,
        on_executed: Callable[[str], None] | None = None,
        boots: bool = True,
        track: Track | None = None,
        faults: Trouble | None = None,
        card: Mapping[str, bytes] | None = None,
    ) -> None:
        self._machine = machine
        self._front_end = front_end
        self._on_executed = on_executed if faults is None else faults.watch(on_executed)
        self._straight = straight_of(front_end)
        self._any_number = front_end.takes == "any"
        self._patient = front_end.partial_seconds == inf
        self._tally = Tally(track)
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
        """Bytes that arrive at `now`, s."""
        self._advance(now)
        if self._board.killed or now < self._deaf_until:
            return
        self._refusals.last_byte = now
        if self._front_end.emergency_parser:
            for code in self._parser.arrive(data):
                self._act_urgently(code)
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
    def board(self) -> Board:
        """Its state; another one after each reset."""
        return self._board

    @property
    def line(self) -> int:
        """Number of the line that was begun last; of a host without numbers, how many commands it has sent."""
        if self._queue and self._queue[0][0] not in (None, _OWN):
            self._line = self._queue[0][0]
        return self._tally.lines if self._line is None else self._line

    @property
    def laid(self) -> tuple[int, float]:
        """At how many heights plastic was laid, and the last of them, mm."""
        return self._tally.n_layers, self._tally.z

    def interrupt(self) -> None:
        """Let the printer look up before it begins another line."""
        self._ready = max(self._ready, nextafter(self._board.now, inf))

    @property
    def unread(self) -> int:
        """Bytes that have arrived and were not read: a cable with flow control waits while there are many."""
        return self._reader.unread

    @property
    def working(self) -> bool:
        """Whether a command that arrived is still unanswered."""
        return not self._board.killed and bool(self._queue or self._refusals.asking)

    @property
    def undisturbed_until(self) -> float:
        """When something will happen that no command asked for just now, s; infinite for never."""
        return min(self._board.due, self._next_wait)

    def hear(self, number: int | None, text: str, now: float) -> None:
        """A line that was read at `now`, s, without the bytes that would have brought it."""
        self._advance(now)
        if not self._board.killed:
            self._reader.last = self._reader.last if number is None else number
            self._enqueue((number, text))
            self._pump()

    def start_batch(self, now: float) -> BatchStart | None:
        """Return what a run of simple commands from `now`, s, depends on; None while nothing moves."""
        self._board.mover.advance(now)
        return BatchStart.of(self._board, self.undisturbed_until)

    def apply_batch(self, batch: Batch) -> None:
        """Have executed a run of simple commands, whose effect somebody else has computed."""
        assert not self.working
        self._reader.last = batch.number
        self._numbered = True
        batch.apply(self._board)
        self._next = self._next_event()

    def reset(self, now: float) -> None:
        """Restart the firmware, as a brown-out or the reset button does.

        What it had read, planned and set is lost, what was counted is kept, the heaters cool from where they
        are.
        """
        self._advance(now)
        self._reset()

    def _reset(self) -> None:
        self._tally.resets += 1
        self._line = None
        old = self._board
        old.stop_moving()
        self._deaf_until = old.now + self._front_end.boot_seconds
        self._start(old.now, banner=True)
        self._board.out[:0] = old.out
        self._board.take_over(old)
        self._next = self._next_event()

    def hang(self, seconds: float, now: float) -> None:
        """Let the main loop do something else for so long; what arrives in the meantime fills the buffer."""
        self._advance(now)
        self._ready = self._hung_until = max(self._ready, now) + seconds
        self._pump()

    def report(self) -> Report:
        """What was executed so far; moves that have not begun are in it with everything but their time."""
        board = self._board
        board.mover.advance(board.now)
        board.settle()
        board.clog(board.clogged)
        for heater in board.heaters.all():
            heater.temperature(board.now)
        radius = self._machine.filament_diameter / 2.0
        return self._tally.report(
            filament_area=pi * radius * radius,
            peak_hotend=max(heater.peak for heater in board.heaters.hotends),
            peak_bed=board.bed.peak,
        )

    def _start(self, now: float, *, banner: bool) -> None:
        """The state after power-on."""
        self._card.stop()
        self._card.writing = ""
        self._board = Board(self._machine, self._front_end, self._tally, self._card, now)
        self._board.inject = self._inject
        self._board.reset = self._reset
        self._reader = LineReader(self._front_end, self._tally)
        self._refusals = Refusals(self._reader, self._board, self._front_end, self._tally, now)
        self._parser = EmergencyParser(self._front_end.line_size)
        self._queue: deque[Line] = deque()
        self._steps: Steps | None = None
        self._resume_at = self._next_busy = inf
        self._next_wait = now + self._front_end.wait_seconds if self._front_end.wait_seconds else inf
        self._numbered = False  # a line with a number was executed
        self._ready = now  # the main loop has no time before
        self._charged = 0  # how many of the lines said have cost the main loop their time
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
        if self._faults is not None and self._faults.due <= now:
            self._next = inf  # it may reset the printer
            self._faults.strike(now)
            board = self._board
        if now >= self._hung_until:
            self._go_on(board, now)
        self._pump()

    def _go_on(self, board: Board, now: float) -> None:
        """What the main loop does besides lines."""
        if self._steps is not None and max(self._resume_at, self._ready) <= now:
            self._resume(self._steps)
        if self._steps is not None and self._next_busy <= now:
            board.report(board.busy_report)
            self._next_busy = now + board.busy_seconds
        if board.due <= now:
            board.ring()
        idle = not (self._queue or self._reader.waiting) and self._ready <= now
        if idle and self._next_wait <= now:
            board.report("wait")
            self._next_wait = now + self._front_end.wait_seconds
        if not self._patient and self._refusals.due() <= now:
            self._refusals.abandon(now)

    def _next_event(self) -> float:
        """When something will happen without bytes arriving."""
        board = self._board
        if self._faults is not None or self._hung_until > board.now:
            return self._next_trouble()
        if board.killed:
            return inf
        return self._next_of_firmware(board)

    def _next_trouble(self) -> float:
        """The same with planted faults, or while the main loop hangs."""
        board = self._board
        planted = inf if self._faults is None else self._faults.due
        if board.killed:
            return planted
        hung = self._hung_until > board.now
        return min(planted, self._hung_until if hung else self._next_of_firmware(board))

    def _next_of_firmware(self, board: Board) -> float:
        """When the firmware has something to do."""
        due = board.due if self._patient else min(board.due, self._refusals.due())
        if self._steps is not None:
            due = min(due, max(self._resume_at, self._ready), self._next_busy)
        elif not (self._queue or self._reader.waiting):
            due = min(due, max(self._next_wait, self._ready))
        if self._ready > board.now and (
            self._queue or self._refusals.asking or self._reader.waiting or self._card.printing
        ):
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
        """Take a line of the file that is printed."""
        text = self._card.next()
        if text is None:
            finished(self._board)
            return
        self._queue.append((_OWN, text))
        self._ready = max(self._ready, self._board.now) + _CARD_SECONDS

    def _inject(self, text: str) -> None:
        """Execute a command of the firmware's own behind the present one."""
        self._queue.insert(1, (_OWN, text))

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
        if (number is None or self._any_number) and text[:4] in URGENT_CODES and self._sees_early(text[:4]):
            self._act_urgently(text[:4])
        self._queue.append(line)
        if self._front_end.ok_when_read:
            self._board.say("ok")
        self._ready = max(self._ready, self._board.now) + self._front_end.seconds_per_line

    def _sees_early(self, code: str) -> bool:
        """Whether an urgent command acts when it is queued."""
        if self._front_end.language == "klipper":
            return code == "M112"
        return not self._front_end.emergency_parser and not self._card.writing

    def _act_urgently(self, code: str) -> None:
        """M108 and M876 end a wait, M410 stops the motion, M524 the print of a file, M112 everything."""
        board = self._board
        if code == "M112":
            if not board.shut_down:
                board.kill("M112 Shutdown")
            if board.shut_down and self._steps is not None:
                self._steps = None
                self._acknowledge()
        elif code in {"M108", "M876"}:
            if board.waiting and (code == "M108" or self._front_end.prompts):
                board.waiting = False
                self._resume_at = board.now
        elif code == "M524":
            abort(board)
        else:
            board.stop_moving()
            self._ready = max(self._ready, board.now) + STOP_SECONDS
            # A command that waited for moves waits for nothing now; any other goes back to sleep.
            self._resume_at = min(self._resume_at, self._ready)

    def _execute(self) -> None:
        """Begin the first command of the queue."""
        number, text = self._queue[0]
        board = self._board
        if self._card.writing:
            write_line(board, text)
            self._acknowledge()
            return
        self._tally.executed(text)
        if self._on_executed is not None:
            self._on_executed(text)
        if number is not None:
            self._numbered = self._numbered or number != _OWN
        elif self._numbered and text.partition(" ")[0] in _MOVES:
            self._tally.unnumbered_moves += 1
        match = SIMPLE_MOVE(text)
        if match is None:
            board.last_line = self._reader.last
            steps = run(board, text)
            if board.renumber is not None:
                self._reader.last, board.renumber = board.renumber, None
        else:
            steps = self._straight(board, match.groups())
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
        if board.killed or number == _OWN:
            return
        if board.muted:
            board.muted -= 1
        elif front_end.ok_when_read:
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
