"""Track the lines in flight: match acknowledgements, detect losses, and limit how many lines may follow.

A plain ok does not name its line. The first row that applies decides:

    an ok...                                       acknowledges
    with a number                                  everything up to it
    with temperatures, a probe in flight           everything up to the newest probe
    with temperatures, right after such an ok      nothing: it answers an older probe
    right after a rejection, or its remains        nothing
    after the lines in flight at an M108 or M110   nothing: it answers that command
    plain, where the answer has temperatures       nothing
    for a rejected line                            nothing
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
"""Queries the number of the last line; with a line number it would set it instead."""

_BREAK_WAIT: Final = b"\nM108\n"
_BREAK_AGAIN: Final = 2.0
_MOST_BREAKS: Final = 6
"""Maximum number of M108 per waiting command; all of them fit into any receive buffer."""

_WAITS: Final = commands_that(Effect.ENDED_BY_M108)

_ECHO: Final = 0.5
"""s in which a printer that was busy answers the probes that have piled up."""


class AckTracker:
    """Numbered lines and everything known about their acknowledgement.

    Attributes:
        history: the numbered lines.
        resends: resend requests of the current error.
        timer: timeouts of the oldest line in flight.
        window: limit of lines in flight.
        unacked: the single line in flight without acknowledgement, where the firmware ignores line numbers, else None.
        has_executed_stray: whether the printer executed a line that was not sent.
        lost_count: line requested by a printer that already has it or cannot need it yet; None if none.
    """

    def __init__(self, window: Window, give_up: float) -> None:
        self.history = SendHistory()
        self.resends = ResendBurst()
        self.timer = AckTimer(give_up)
        self.window = window
        self.unacked: UnackedLine | None = None
        self.has_executed_stray = False
        self.lost_count: int | None = None
        self._counts = self._ok_when_read = False
        # Timeouts of the lines that may be ahead of a line when it is read.
        self._timeouts: deque[float] = deque(maxlen=1)
        self._sequence = True
        self._counted: int | None = None  # next line when the query M110 was sent
        self._longest = LONGEST
        self._requested: int | None = None
        self._late_answers_until = -inf
        self._ok_has_temperatures = False
        # Acknowledged probes whose temperatures follow in a separate report.
        self._expected_temperatures = 0
        self._expected_until = -inf
        self._idle_at = -inf
        self._lone_probe: int | None = None  # probe sent to a printer that was idle
        self._unnumbered: deque[int] = deque()  # last line sent before each unnumbered command
        self._breaks, self._last_break = 0, -inf

    def set_dialect(self, dialect: WireDialect, *, emergency_parser: bool) -> None:
        """Apply the rules of the reported firmware."""
        self._counts = dialect.reports_last_line
        self._ok_when_read = dialect.ok_when_read
        if dialect.ok_when_read:
            self._timeouts = deque(maxlen=dialect.queue_size + 2)
        self._sequence = dialect.checks_line_numbers
        self._longest = dialect.max_line_bytes
        if dialect.checksum == "crc16":
            self.history.frame = frame_crc
        self.window.set_dialect(dialect, emergency_parser=emergency_parser)

    def add(self, command: bytes, job: int, timeout: float) -> None:
        """Assign the next line number to a command, which is acknowledged within `timeout`, s, once its turn comes."""
        self._timeouts.append(timeout)
        self.history.add(command, job, sum(self._timeouts))

    @property
    def due(self) -> float | None:
        """Return when to act if nothing arrives, s; None for never."""
        if self.resends.is_active:
            return self.resends.until
        if self.history.in_flight:
            return self.timer.due(self.history.oldest)
        return self._expected_until if self._expected_temperatures else None

    def room(self) -> int:
        """Return how many bytes the next line may have, with its line break, to be sent now."""
        history = self.history
        if not history.in_flight or history.cursor == self._requested:
            return self._longest + 1
        window = self.window
        if history.in_flight >= window.lines:
            return 0
        return window.size - QUESTION_ROOM - history.bytes_in_flight

    def can_resend(self) -> bool:
        """Return whether the next line, which already has a number, may be sent now."""
        return len(self.history.next.text) < self.room()

    def is_overdue(self, now: float) -> bool:
        """Return whether an acknowledgement is overdue."""
        return self.history.in_flight > 0 and now >= self.timer.due(self.history.oldest)

    def probe(self, now: float) -> bytes:
        """Send the next line early as a probe, so that the printer must name the line it wants."""
        self.window.on_error()
        self.resends.ignore_next_ok = False
        self.timer.on_probe(now)
        if self.history.line(self.history.cursor - 1).sent <= self._idle_at:
            self._lone_probe = self.history.cursor
        return self.history.send_next(now, break_first=True)

    @property
    def can_probe_last_line(self) -> bool:
        """Return whether to query the number of the last line first.

        That query has no checksum, so it is not used on a cable that damages lines: one flipped bit turns it into M112.
        """
        return self._counts and not self.timer.probes and not self.window.is_careful

    def probe_last_line(self, now: float) -> bytes:
        """Query the number of the last accepted line."""
        self._counted = self.history.cursor
        self._unnumbered.append(self.history.cursor - 1)
        self.resends.ignore_next_ok = False
        self.timer.on_probe(now)
        return _COUNT

    def probe_position(self, unacked: UnackedLine, now: float) -> bytes:
        """Query the position, then the temperatures, whose answer shows that the first answer has arrived."""
        self.window.on_error()
        self.timer.on_probe(now)
        questions = (b"M114", ASK) if unacked.needs_position else (ASK,)
        unacked.needs_position = False
        # The firmware ignores the numbers, but it checks the checksum behind a number.
        return b"\n" + b"".join(
            self.history.frame(self.history.cursor, question) + b"\n" for question in questions
        )

    def on_last_line(self, last: int, now: float) -> int | None:
        """Handle a reported last line; return the line up to which to accept, None if none.

        The printer read that query after all lines sent before, so a line that it does not count was lost.
        """
        counted, self._counted = self._counted, None
        history = self.history
        if counted is None:
            return None
        self.resends.ignore_next_ok = True
        if self._unnumbered:  # otherwise another ok was taken for the answer to this query
            self._unnumbered.pop()
        if not history.accepted <= last < history.cursor:
            # The report is damaged, or the printer has restarted; the next line shows which.
            self.timer.expect_loss(now)
            return None
        if last + 1 < counted:
            self.on_resend(last + 1, now)
        return last if last > history.accepted else None

    @property
    def break_due(self) -> float:
        """Return when to break the wait of the oldest line, for heating or for a user; infinite if it does not wait."""
        history = self.history
        if (
            not history.in_flight
            or parse(history.oldest.command)[0] not in _WAITS
            or self._breaks >= _MOST_BREAKS
        ):
            return inf
        return self._last_break + _BREAK_AGAIN

    def break_wait(self, now: float) -> bytes:
        """Return an M108 that breaks the wait of the oldest line; empty if none is due.

        It has no number, because firmware handles only unnumbered lines while it executes another command. A waiting
        command starts to wait when its turn comes, so the M108 is repeated until the command is acknowledged.
        """
        if now < self.break_due:
            return b""
        self._breaks += 1
        self._last_break = now
        self.expect_unnumbered()
        return _BREAK_WAIT

    def expect_unnumbered(self) -> None:
        """Record that an unnumbered command is sent now; its ok follows those of the lines in flight."""
        self._unnumbered.append(self.history.cursor - 1)

    def accept(self, number: int, now: float, *, settled: bool = False) -> int:
        """Mark the lines up to `number` as accepted; return the number of accepted job entries."""
        history = self.history
        if number == history.accepted + 1:
            self.timer.learn_response_time(history.oldest, now)
        self.window.on_accepted(number - history.accepted)
        job = history.accept(number)
        self.unacked = None
        self._breaks, self._last_break = 0, -inf
        self.resends.on_accepted(number)
        self.timer.on_answer(now, settled=settled or not history.in_flight)
        return job

    def match_ok(self, ok: Ok, now: float) -> int | None:
        """Return the line up to which an ok acknowledges, None if it acknowledges nothing."""
        history = self.history
        if ok.planner is not None and ok.places is not None:
            self.window.on_queue_report(ok.planner, ok.places)
        if ok.number is not None:
            if not history.accepted < ok.number < history.cursor:
                return None
            self._drop_unnumbered(ok.number)
            return ok.number
        if ok.heat:
            self._ok_has_temperatures = True
            number = history.find(ASK)
            if number is not None:
                return self._match_probe(number, now)
            if now < self._late_answers_until or not self._sequence:
                return None
        return None if self._is_unmatched(ok, now) else self._match_oldest(now)

    def _match_probe(self, number: int, now: float) -> int:
        """Handle an ok with temperatures that answers this probe."""
        self.resends.ignore_next_ok = False
        self._late_answers_until = now + _ECHO
        self._drop_unnumbered(number)
        line = self.history.line(number)
        self.window.on_probe_answer(len(line.text), now - line.sent)
        return number

    def _is_unmatched(self, ok: Ok, now: float) -> bool:
        """Return whether an ok belongs to a rejection, to an unnumbered command, or to nothing that was sent."""
        history, resends = self.history, self.resends
        if resends.claimed_line is not None:
            # The resend request before this ok was lost, but the error has named the line.
            self.on_resend(None, now)
        if resends.ignore_next_ok:
            resends.ignore_next_ok = False
            return True
        if self._unnumbered and history.accepted >= self._unnumbered[0]:
            self._unnumbered.popleft()
            return True
        if ok.planner is not None and history.in_flight:
            # Such firmware names the line, so an ok without a number belongs to a line that the host has not sent.
            self.has_executed_stray = True
        return self.has_executed_stray or not history.in_flight

    def _match_oldest(self, now: float) -> int | None:
        """Return the oldest line in flight if a plain ok may acknowledge it, else None."""
        history, resends = self.history, self.resends
        oldest = history.accepted + 1
        if resends.wanted is not None and oldest >= resends.wanted:
            return None
        if history.oldest.command == ASK:
            if self._ok_has_temperatures:
                # This ok is surplus. Where answers identify their lines, the count is correct again.
                self.timer.on_answer(now)
                return None
            if self._ok_when_read:
                self._expected_temperatures += 1
                self._expected_until = now + history.oldest.timeout
        return oldest

    def expects_temperatures(self, now: float) -> bool:
        """Return whether the printer still has to report queried temperatures."""
        return self._expected_temperatures > 0 and now < self._expected_until

    def clear_expected_temperatures(self) -> bool:
        """Forget overdue temperature reports; return whether there were none."""
        owed, self._expected_temperatures = self._expected_temperatures, 0
        return not owed

    def on_idle(self, now: float) -> None:
        """Handle an idle report: all answers to earlier lines have been sent."""
        self._expected_temperatures = 0
        self._idle_at = now
        if self.history.in_flight:
            self.timer.on_idle(self.history.oldest, now)

    def match_temperatures(self) -> int | None:
        """Match a temperature report without ok; return the probe whose ok was lost, else None."""
        alone, self._lone_probe = self._lone_probe, None
        if alone is not None:
            self._expected_temperatures = 0
            return alone if alone > self.history.accepted else None
        if self._expected_temperatures:
            self._expected_temperatures -= 1
            return None
        return self.history.find_oldest(ASK)

    def _drop_unnumbered(self, number: int) -> None:
        """Drop unnumbered commands before a line that is acknowledged, because answers keep their order."""
        while self._unnumbered and self._unnumbered[0] < number:
            self._unnumbered.popleft()
            self._counted = None

    def is_conclusive(self, ok: Ok) -> bool:
        """Return whether such an ok shows reliably which lines arrived."""
        return ok.number is not None or ok.heat

    def on_resend(self, number: int | None, now: float) -> None:
        """Handle a resend request for a line; None: the line that an error has named."""
        resends, history = self.resends, self.history
        if number is None:
            number = resends.claimed_line
            decision = resends.use_claimed_line(history, now)
        else:
            decision = resends.on_request(number, history, now)
        if decision is ResendDecision.PROBE:
            self.timer.expect_loss(now)
        elif decision is ResendDecision.LOST_COUNT:
            self.lost_count = number

    def on_stray_reply(self, now: float, *, refusal: bool) -> None:
        """Handle a reply that is unreadable or answers none of the lines in flight.

        Args:
            now: time, s.
            refusal: whether a following ok would belong to a rejection.
        """
        if self.history.in_flight and self.unacked is None:
            self.resends.ignore_next_ok = self.resends.ignore_next_ok or refusal
            self.timer.expect_loss(now)

    def go_back(self, wanted: int, now: float) -> int:
        """Go back to line `wanted`; return the number of job entries that stay accepted."""
        self._requested = wanted
        self.unacked = self._lone_probe = None
        self.window.on_error()
        self.timer.on_answer(now, settled=True)
        return self.history.rewind(wanted)
