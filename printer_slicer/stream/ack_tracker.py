"""The lines in flight: which answer belongs to which, what is in doubt, how many more may go out.

An ok does not say whose it is. The first row that fits decides:

    an ok...                                       acknowledges
    with a number                                  everything up to it
    with temperatures, a question in flight        everything up to the newest question
    with temperatures, right behind such a one     nothing: it answers an older question
    right behind a refusal, or the remains of one  nothing
    behind the lines in flight at an M108 or M110  nothing: it answers that
    bare, where the answer has temperatures        nothing
    for a line that was refused                    nothing
    any other                                      the oldest line in flight
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.lexer import parse
from printer_slicer.stream.ack_timer import AckTimer
from printer_slicer.stream.framing import LONGEST, frame_crc
from printer_slicer.stream.resend_burst import ResendBurst, ResendDecision
from printer_slicer.stream.send_history import ASK, SendHistory
from printer_slicer.stream.window import QUESTION_ROOM, Window

if TYPE_CHECKING:
    from printer_slicer.firmware import WireDialect
    from printer_slicer.stream.replies import Ok
    from printer_slicer.stream.unacked_line import UnackedLine

__all__ = ["AckTracker"]

_COUNT: Final = b"\nM110\n"
"""Asks for the number of the last line; with a number of its own it would set it."""

_BREAK_WAIT: Final = b"\nM108\n"
_BREAK_AGAIN: Final = 2.0
_MOST_BREAKS: Final = 6
"""Times that one wait is told to end: all of them together fit into any receive buffer."""

_WAITS: Final = commands_that(Effect.ENDED_BY_M108)

_ECHO: Final = 0.5
"""s in which a printer that was busy answers the questions that have piled up."""


class AckTracker:
    """Numbered lines from 1 on, with everything known about their fate.

    Attributes:
        ledger: the lines.
        burst: the error that is being settled.
        watch: the clock over the oldest of them.
        window: how many of them there may be.
        doubt: questions about the only one of them, where firmware does not look at numbers; None while all is well.
        strayed: a line was executed that nobody sent.
        lost_count: line wanted by a printer that had it or can never have it; None while all is well.
    """

    def __init__(self, window: Window, give_up: float) -> None:
        self.ledger = SendHistory()
        self.burst = ResendBurst()
        self.watch = AckTimer(give_up)
        self.window = window
        self.doubt: UnackedLine | None = None
        self.strayed = False
        self.lost_count: int | None = None
        self._counts = self._ok_when_read = False
        # Of the lines that may be in front of one when it is read.
        self._patiences: deque[float] = deque(maxlen=1)
        self._sequence = True
        self._counted: int | None = None  # next line when M110 went out
        self._longest = LONGEST
        self._requested: int | None = None
        self._echo_until = -inf
        self._heat_with_ok = False
        # Questions acknowledged whose temperatures are still to come, where they come apart.
        self._heat_owed = 0
        self._owed_until = -inf
        self._idle_at = -inf
        self._alone: int | None = None  # a question to a printer that had nothing else to do
        self._unnumbered: deque[int] = deque()  # last line in front of each command without a number
        self._breaks, self._broken = 0, -inf

    def set_dialect(self, dialect: WireDialect, *, emergency_parser: bool) -> None:
        """The firmware is known now."""
        self._counts = dialect.reports_last_line
        self._ok_when_read = dialect.ok_when_read
        if dialect.ok_when_read:
            self._patiences = deque(maxlen=dialect.queue_size + 2)
        self._sequence = dialect.checks_line_numbers
        self._longest = dialect.max_line_bytes
        if dialect.checksum == "crc16":
            self.ledger.frame = frame_crc
        self.window.set_dialect(dialect, emergency_parser=emergency_parser)

    def add(self, command: bytes, job: int, patience: float) -> None:
        """Give a command the next number; its ok comes within `patience`, s, of when it is its turn."""
        self._patiences.append(patience)
        self.ledger.add(command, job, sum(self._patiences))

    @property
    def due(self) -> float | None:
        """When something must be done if nothing arrives, s; None for never."""
        if self.burst.active:
            return self.burst.until
        if self.ledger.in_flight:
            return self.watch.due(self.ledger.oldest)
        return self._owed_until if self._heat_owed else None

    def room(self) -> int:
        """Bytes that the next line may have, with its line break, to join those in flight now."""
        ledger = self.ledger
        if not ledger.in_flight or ledger.cursor == self._requested:
            return self._longest + 1
        window = self.window
        if ledger.in_flight >= window.lines:
            return 0
        return window.size - QUESTION_ROOM - ledger.bytes_in_flight

    def repeats(self) -> bool:
        """Whether the next line, which has its number already, may go out now."""
        return len(self.ledger.next.text) < self.room()

    def overdue(self, now: float) -> bool:
        """Whether an answer should have come by now."""
        return self.ledger.in_flight > 0 and now >= self.watch.due(self.ledger.oldest)

    def ask(self, now: float) -> bytes:
        """Send the next line ahead of its turn, so that the printer must say which line it wants."""
        self.window.error()
        self.burst.swallow = False
        self.watch.ask(now)
        if self.ledger.line(self.ledger.cursor - 1).sent <= self._idle_at:
            self._alone = self.ledger.cursor
        return self.ledger.take(now, break_first=True)

    @property
    def can_count(self) -> bool:
        """Whether to ask for the number of the last line first.

        That question has no checksum, so not on a cable that damages lines: one flipped bit makes M112 of it.
        """
        return self._counts and not self.watch.asked and not self.window.careful

    def ask_count(self, now: float) -> bytes:
        """Ask for the number of the last line that the printer took."""
        self._counted = self.ledger.cursor
        self._unnumbered.append(self.ledger.cursor - 1)
        self.burst.swallow = False
        self.watch.ask(now)
        return _COUNT

    def ask_where(self, doubt: UnackedLine, now: float) -> bytes:
        """Ask where the printer is, and then what tells that its answer to that is here."""
        self.window.error()
        self.watch.ask(now)
        questions = (b"M114", ASK) if doubt.pair else (ASK,)
        doubt.pair = False
        # Their numbers mean nothing, but the checksum behind a number does.
        return b"\n" + b"".join(
            self.ledger.frame(self.ledger.cursor, question) + b"\n" for question in questions
        )

    def count(self, last: int, now: float) -> int | None:
        """The printer took the lines up to `last`: up to which line to accept, None if to none.

        It read that question behind all lines sent before, so one that it does not count was lost.
        """
        counted, self._counted = self._counted, None
        ledger = self.ledger
        if counted is None:
            return None
        self.burst.swallow = True
        if self._unnumbered:  # else an ok of something else was taken for the one to this question
            self._unnumbered.pop()
        if not ledger.accepted <= last < ledger.cursor:
            # Damaged, or of a printer that begins anew: the next line brings it out.
            self.watch.suspect(now)
            return None
        if last + 1 < counted:
            self.request(last + 1, now)
        return last if last > ledger.accepted else None

    @property
    def break_due(self) -> float:
        """When to end the waiting of the oldest line, for heat or for a person; infinite if it does not wait."""
        ledger = self.ledger
        if (
            not ledger.in_flight
            or parse(ledger.oldest.command)[0] not in _WAITS
            or self._breaks >= _MOST_BREAKS
        ):
            return inf
        return self._broken + _BREAK_AGAIN

    def break_wait(self, now: float) -> bytes:
        """What ends the waiting of the oldest line, nothing if it does not wait or was just told.

        Without a number, because only then firmware looks at it while another command is being executed. A command
        that waits begins to wait when it is its turn, so it is told again until its ok comes.
        """
        if now < self.break_due:
            return b""
        self._breaks += 1
        self._broken = now
        self.expect_unnumbered()
        return _BREAK_WAIT

    def expect_unnumbered(self) -> None:
        """A command without number goes out now: its ok comes behind those of the lines in flight."""
        self._unnumbered.append(self.ledger.cursor - 1)

    def accept(self, number: int, now: float, *, settled: bool = False) -> int:
        """Count the lines up to `number` as accepted; entries of the job done then."""
        ledger = self.ledger
        if number == ledger.accepted + 1:
            self.watch.learn(ledger.oldest, now)
        self.window.accepted(number - ledger.accepted)
        job = ledger.accept(number)
        self.doubt = None
        self._breaks, self._broken = 0, -inf
        self.burst.calm(number)
        self.watch.answered(now, settled=settled or not ledger.in_flight)
        return job

    def belongs_to(self, ok: Ok, now: float) -> int | None:
        """The line up to which an ok acknowledges, None if it acknowledges nothing."""
        ledger = self.ledger
        if ok.planner is not None and ok.places is not None:
            self.window.heard(ok.planner, ok.places)
        if ok.number is not None:
            if not ledger.accepted < ok.number < ledger.cursor:
                return None
            self._settle_unnumbered(ok.number)
            return ok.number
        if ok.heat:
            self._heat_with_ok = True
            asked = ledger.find(ASK)
            if asked is not None:
                return self._answers(asked, now)
            if now < self._echo_until or not self._sequence:
                return None
        return None if self._answers_nothing(ok, now) else self._oldest(now)

    def _answers(self, asked: int, now: float) -> int:
        """An ok with temperatures answers this question."""
        self.burst.swallow = False
        self._echo_until = now + _ECHO
        self._settle_unnumbered(asked)
        line = self.ledger.line(asked)
        self.window.timed(len(line.text), now - line.sent)
        return asked

    def _answers_nothing(self, ok: Ok, now: float) -> bool:
        """Whether an ok belongs to a refusal, to a command without number, or to nothing that was sent."""
        ledger, burst = self.ledger, self.burst
        if burst.claim is not None:
            # The request between the error and this ok was lost; the error has named the line too.
            self.request(None, now)
        if burst.swallow:
            burst.swallow = False
            return True
        if self._unnumbered and ledger.accepted >= self._unnumbered[0]:
            self._unnumbered.popleft()
            return True
        if ok.planner is not None and ledger.in_flight:
            # Such firmware names the line; what has no name had no number, and nobody has sent that.
            self.strayed = True
        return self.strayed or not ledger.in_flight

    def _oldest(self, now: float) -> int | None:
        """The oldest line in flight, which a bare ok is for, if it can be for any."""
        ledger, burst = self.ledger, self.burst
        oldest = ledger.accepted + 1
        if burst.wanted is not None and oldest >= burst.wanted:
            return None
        if ledger.oldest.command == ASK:
            if self._heat_with_ok:
                # One ok too many. Where lines are told apart by their answers, the count is right again.
                self.watch.answered(now)
                return None
            if self._ok_when_read:
                self._heat_owed += 1
                self._owed_until = now + ledger.oldest.patience
        return oldest

    def owes(self, now: float) -> bool:
        """Whether the printer has still to say the temperatures that it was asked for."""
        return self._heat_owed > 0 and now < self._owed_until

    def told(self) -> bool:
        """Whether nothing is owed; what was owed for too long was lost, and is forgotten."""
        owed, self._heat_owed = self._heat_owed, 0
        return not owed

    def idle(self, now: float) -> None:
        """The printer has nothing to do: whatever it had to say of earlier lines it has said."""
        self._heat_owed = 0
        self._idle_at = now
        if self.ledger.in_flight:
            self.watch.idle(self.ledger.oldest, now)

    def reported(self) -> int | None:
        """Temperatures came apart from any ok: the question that they answer, if its ok was lost, else None."""
        alone, self._alone = self._alone, None
        if alone is not None:
            self._heat_owed = 0
            return alone if alone > self.ledger.accepted else None
        if self._heat_owed:
            self._heat_owed -= 1
            return None
        return self.ledger.find_oldest(ASK)

    def _settle_unnumbered(self, number: int) -> None:
        """Answers keep their order: what was asked ahead of a line is answered, or never will be, once that line is."""
        while self._unnumbered and self._unnumbered[0] < number:
            self._unnumbered.popleft()
            self._counted = None

    def settles(self, ok: Ok) -> bool:
        """Whether such an ok leaves no doubt which lines arrived."""
        return ok.number is not None or ok.heat

    def request(self, number: int | None, now: float) -> None:
        """Take note that the printer asks for a line; None: the one that an error has named."""
        burst, ledger = self.burst, self.ledger
        if number is None:
            number = burst.claim
            verdict = burst.unrequested(ledger, now)
        else:
            verdict = burst.request(number, ledger, now)
        if verdict is ResendDecision.ASK:
            self.watch.suspect(now)
        elif verdict is ResendDecision.LOST_COUNT:
            self.lost_count = number

    def stray(self, now: float, *, refusal: bool) -> None:
        """Something came that answers none of the lines in flight, or that cannot be read.

        Args:
            now: s.
            refusal: an ok right behind it would mean no, or nothing.
        """
        if self.ledger.in_flight and self.doubt is None:
            self.burst.swallow = self.burst.swallow or refusal
            self.watch.suspect(now)

    def go_back(self, wanted: int, now: float) -> int:
        """Make `wanted` the next line; entries of the job that stay accepted."""
        self._requested = wanted
        self.doubt = self._alone = None
        self.window.error()
        self.watch.answered(now, settled=True)
        return self.ledger.rewind(wanted)
