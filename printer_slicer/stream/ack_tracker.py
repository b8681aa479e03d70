"""Track the lines in flight: match acknowledgements, detect losses, and limit how many lines may follow.

A plain ok does not name its line. The first row that applies decides:

    an ok...                                       acknowledges
    with a number                                  everything up to it
    with temperatures, a probe in flight           everything up to the newest probe
    with temperatures, right after such an ok      nothing: it answers an older probe
    right after a rejection, also a damaged one    nothing
    after the lines in flight at an M108 or M110   nothing: it answers that command
    plain, for a probe whose ok has temperatures   nothing
    for a rejected line                            nothing
    any other                                      the oldest line in flight
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse
from printer_slicer.stream.ack_timer import AckTimer
from printer_slicer.stream.framing import MAX_LINE_BYTES, frame_with_crc
from printer_slicer.stream.resend_burst import ResendBurst, ResendDecision
from printer_slicer.stream.send_history import PROBE_COMMAND, SendHistory
from printer_slicer.stream.window import PROBE_BYTES, Window

if TYPE_CHECKING:
    from printer_slicer.firmware import WireDialect
    from printer_slicer.stream.replies import Ok
    from printer_slicer.stream.unacked_line import UnackedLine

__all__ = ["AckTracker"]

_QUERY_LAST_LINE: Final = b"\nM110\n"
"""Query of the last line number. It has no line number itself, because M110 would then set the number instead."""

_BREAK_WAIT: Final = b"\nM108\n"
_BREAK_INTERVAL: Final = 2.0
_MAX_BREAKS: Final = 6
"""Maximum number of M108 per waiting command; all of them fit into any receive buffer."""

_BREAKABLE_WAITS: Final = find_codes(Effect.ENDED_BY_M108)

_LATE_ANSWER_TIME: Final = 0.5
"""Time within which a printer that was busy answers all queued probes, s."""


class AckTracker:
    """Tracks the numbered lines, and which of them the printer has acknowledged.

    Attributes:
        history: the numbered lines.
        resends: resend requests of the current error.
        timer: timeouts of the oldest line in flight.
        window: limit of lines in flight.
        unacked: the line in flight whose acknowledgement is missing, if the firmware ignores line numbers; else None.
        has_executed_stray: whether the printer executed a line that was not sent.
        lost_count: line requested by a printer that has lost count, since it already has this line or cannot expect it
            yet; None if none.
    """

    def __init__(self, window: Window, give_up: float) -> None:
        self.history = SendHistory()
        self.resends = ResendBurst()
        self.timer = AckTimer(give_up)
        self.window = window
        self.unacked: UnackedLine | None = None
        self.has_executed_stray = False
        self.lost_count: int | None = None
        self._reports_last_line = self._ok_when_read = False
        # Timeouts of the lines that the printer may still have to execute when it reads a line.
        self._timeouts: deque[float] = deque(maxlen=1)
        self._checks_line_numbers = True
        self._next_line_at_query: int | None = None  # next line when the query M110 was sent
        self._max_line_bytes = MAX_LINE_BYTES
        self._requested_line: int | None = None
        self._late_answers_until = -inf
        self._ok_has_temperatures = False
        # Acknowledged probes whose temperatures follow in a separate report.
        self._expected_temperatures = 0
        self._temperatures_expected_until = -inf
        self._last_idle_at = -inf
        self._lone_probe: int | None = None  # probe sent to a printer that was idle
        self._unnumbered: deque[int] = deque()  # last line sent before each unnumbered command
        self._n_breaks, self._last_break_at = 0, -inf

    def set_dialect(self, dialect: WireDialect, *, emergency_parser: bool) -> None:
        """Apply the protocol rules of the firmware that the printer has reported."""
        self._reports_last_line = dialect.reports_last_line
        self._ok_when_read = dialect.ok_when_read
        if dialect.ok_when_read:
            self._timeouts = deque(maxlen=dialect.queue_size + 2)
        self._checks_line_numbers = dialect.checks_line_numbers
        self._max_line_bytes = dialect.max_line_bytes
        if dialect.checksum == "crc16":
            self.history.frame = frame_with_crc
        self.window.set_dialect(dialect, emergency_parser=emergency_parser)

    def add_line(self, command: bytes, entries: int, timeout: float) -> None:
        """Assign the next line number to a command.

        Args:
            command: the command.
            entries: number of job entries that are accepted once this command is accepted.
            timeout: maximum time, s, from the acceptance of the previous line to the ok of this one.
        """
        self._timeouts.append(timeout)
        self.history.add_line(command, entries, sum(self._timeouts))

    @property
    def next_action_at(self) -> float | None:
        """Return when to probe or resend if nothing arrives, s; None for never."""
        if self.resends.is_active:
            return self.resends.deadline
        if self.history.n_in_flight:
            return self.timer.next_probe_at(self.history.oldest)
        return self._temperatures_expected_until if self._expected_temperatures else None

    def find_max_line_length(self) -> int:
        """Return how long a line that is sent now may be, in bytes with its line break."""
        history = self.history
        if not history.n_in_flight or history.cursor == self._requested_line:
            return self._max_line_bytes + 1
        window = self.window
        if history.n_in_flight >= window.lines:
            return 0
        return window.size - PROBE_BYTES - history.bytes_in_flight

    def can_resend(self) -> bool:
        """Return whether the next line, which has its number already, may be sent now."""
        return len(self.history.next_line.text) < self.find_max_line_length()

    def is_overdue(self, now: float) -> bool:
        """Return whether the acknowledgement of the oldest line in flight is overdue."""
        return self.history.n_in_flight > 0 and now >= self.timer.next_probe_at(self.history.oldest)

    def send_probe(self, now: float) -> bytes:
        """Return the next line, sent early as a probe: the answer shows which line the printer expects."""
        self.window.on_error()
        self.resends.ignore_next_ok = False
        self.timer.on_probe(now)
        if self.history.get_line(self.history.cursor - 1).sent <= self._last_idle_at:
            self._lone_probe = self.history.cursor
        return self.history.send_next(now, break_first=True)

    @property
    def can_query_last_line(self) -> bool:
        """Return whether to query the number of the last line instead of sending a probe.

        That query has no checksum, so it is not used on a cable that damages lines: one flipped bit turns it into M112.
        """
        return self._reports_last_line and not self.timer.probes and not self.window.is_careful

    def query_last_line(self, now: float) -> bytes:
        """Return the query for the number of the last accepted line; it counts as sent."""
        self._next_line_at_query = self.history.cursor
        self._unnumbered.append(self.history.cursor - 1)
        self.resends.ignore_next_ok = False
        self.timer.on_probe(now)
        return _QUERY_LAST_LINE

    def query_position(self, unacked: UnackedLine, now: float) -> bytes:
        """Return the queries M114 and M105, whose answers show whether the line `unacked` was executed."""
        self.window.on_error()
        self.timer.on_probe(now)
        queries = (b"M114", PROBE_COMMAND) if unacked.needs_position else (PROBE_COMMAND,)
        unacked.needs_position = False
        # The firmware ignores the numbers, but it checks the checksum behind a number.
        return b"\n" + b"".join(self.history.frame(self.history.cursor, query) + b"\n" for query in queries)

    def on_last_line(self, last: int, now: float) -> int | None:
        """Handle a report of the last accepted line; return its number if it is newly accepted, else None.

        The printer read the query after all lines sent before it, so any later line number was lost.
        """
        next_line_at_query, self._next_line_at_query = self._next_line_at_query, None
        history = self.history
        if next_line_at_query is None:
            return None
        self.resends.ignore_next_ok = True
        if self._unnumbered:  # otherwise another ok was taken for the answer to this query
            self._unnumbered.pop()
        if not history.accepted <= last < history.cursor:
            # The report is damaged, or the printer has restarted; a probe shows which.
            self.timer.schedule_probe(now)
            return None
        if last + 1 < next_line_at_query:
            self.on_resend(last + 1, now)
        return last if last > history.accepted else None

    @property
    def next_break_at(self) -> float:
        """Return when to send M108 to end the wait of the oldest line, s; infinite if it does not wait."""
        history = self.history
        if (
            not history.n_in_flight
            or parse(history.oldest.command)[0] not in _BREAKABLE_WAITS
            or self._n_breaks >= _MAX_BREAKS
        ):
            return inf
        return self._last_break_at + _BREAK_INTERVAL

    def break_wait(self, now: float) -> bytes:
        """Return an M108, which ends the wait of the oldest line for heat or a user; empty if not yet due.

        It has no number, because firmware handles only unnumbered lines while it executes another command. The
        command may not have started to wait, so the M108 is repeated until the command is acknowledged.
        """
        if now < self.next_break_at:
            return b""
        self._n_breaks += 1
        self._last_break_at = now
        self.record_unnumbered_command()
        return _BREAK_WAIT

    def record_unnumbered_command(self) -> None:
        """Record that an unnumbered command is sent; its ok follows the oks of the lines in flight."""
        self._unnumbered.append(self.history.cursor - 1)

    def accept(self, number: int, now: float, *, is_conclusive: bool = False) -> int:
        """Mark the lines up to `number` as accepted; return the number of accepted job entries."""
        history = self.history
        if number == history.accepted + 1:
            self.timer.learn_response_time(history.oldest, now)
        self.window.on_accepted(number - history.accepted)
        entries = history.accept(number)
        self.unacked = None
        self._n_breaks, self._last_break_at = 0, -inf
        self.resends.on_accepted(number)
        self.timer.on_answer(now, is_conclusive=is_conclusive or not history.n_in_flight)
        return entries

    def match_ok(self, ok: Ok, now: float) -> int | None:
        """Return the number of the last line that an ok acknowledges, None if it acknowledges no line."""
        history = self.history
        if ok.planner is not None and ok.places is not None:
            self.window.on_queue_report(ok.planner, ok.places)
        if ok.number is not None:
            if not history.accepted < ok.number < history.cursor:
                return None
            self._forget_unnumbered_commands(ok.number)
            return ok.number
        if ok.has_temperatures:
            self._ok_has_temperatures = True
            number = history.find_newest_line(PROBE_COMMAND)
            if number is not None:
                return self._record_probe_answer(number, now)
            if now < self._late_answers_until or not self._checks_line_numbers:
                return None
        return None if self._is_unmatched(ok, now) else self._match_oldest(now)

    def _record_probe_answer(self, number: int, now: float) -> int:
        """Record that an ok with temperatures answers the probe on line `number`; return `number`."""
        self.resends.ignore_next_ok = False
        self._late_answers_until = now + _LATE_ANSWER_TIME
        self._forget_unnumbered_commands(number)
        line = self.history.get_line(number)
        self.window.on_probe_answer(len(line.text), now - line.sent)
        return number

    def _is_unmatched(self, ok: Ok, now: float) -> bool:
        """Return whether an ok acknowledges no line: it follows a rejection or an unnumbered command."""
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
        if ok.planner is not None and history.n_in_flight:
            # Firmware that reports the planner also names the line, so this ok belongs to a line that was not sent.
            self.has_executed_stray = True
        return self.has_executed_stray or not history.n_in_flight

    def _match_oldest(self, now: float) -> int | None:
        """Return the number of the oldest line in flight if a plain ok may acknowledge it, else None."""
        history, resends = self.history, self.resends
        oldest = history.accepted + 1
        if resends.requested_line is not None and oldest >= resends.requested_line:
            return None
        if history.oldest.command == PROBE_COMMAND:
            if self._ok_has_temperatures:
                # This ok is surplus: a probe is answered by an ok with temperatures.
                self.timer.on_answer(now)
                return None
            if self._ok_when_read:
                self._expected_temperatures += 1
                self._temperatures_expected_until = now + history.oldest.timeout
        return oldest

    def expects_temperatures(self, now: float) -> bool:
        """Return whether the printer still has to report temperatures that were queried."""
        return self._expected_temperatures > 0 and now < self._temperatures_expected_until

    def clear_expected_temperatures(self) -> bool:
        """Stop expecting temperature reports; return True if none were expected."""
        n_expected, self._expected_temperatures = self._expected_temperatures, 0
        return not n_expected

    def on_idle(self, now: float) -> None:
        """Handle an idle report, which the printer sends after all answers to earlier lines."""
        self._expected_temperatures = 0
        self._last_idle_at = now
        if self.history.n_in_flight:
            self.timer.on_idle(self.history.oldest, now)

    def match_temperature_report(self) -> int | None:
        """Match a temperature report to its M105 query; return the query's line number if its ok was lost."""
        number, self._lone_probe = self._lone_probe, None
        if number is not None:
            self._expected_temperatures = 0
            return number if number > self.history.accepted else None
        if self._expected_temperatures:
            self._expected_temperatures -= 1
            return None
        return self.history.find_oldest_line(PROBE_COMMAND)

    def _forget_unnumbered_commands(self, number: int) -> None:
        """Forget the unnumbered commands sent before line `number`: the printer has answered them already."""
        while self._unnumbered and self._unnumbered[0] < number:
            self._unnumbered.popleft()
            self._next_line_at_query = None

    def is_conclusive(self, ok: Ok) -> bool:
        """Return whether an ok proves which lines have arrived."""
        return ok.number is not None or ok.has_temperatures

    def on_resend(self, number: int | None, now: float) -> None:
        """Handle a resend request for line `number`; None: for the line that the error report named."""
        resends, history = self.resends, self.history
        if number is None:
            number = resends.claimed_line
            decision = resends.use_claimed_line(history, now)
        else:
            decision = resends.on_request(number, history, now)
        if decision is ResendDecision.PROBE:
            self.timer.schedule_probe(now)
        elif decision is ResendDecision.LOST_COUNT:
            self.lost_count = number

    def on_stray_reply(self, now: float, *, may_reject: bool) -> None:
        """Schedule a probe after a reply that is unreadable or answers none of the lines in flight.

        Args:
            now: time, s.
            may_reject: whether a following ok would belong to a rejection.
        """
        if self.history.n_in_flight and self.unacked is None:
            self.resends.ignore_next_ok = self.resends.ignore_next_ok or may_reject
            self.timer.schedule_probe(now)

    def go_back(self, number: int, now: float) -> int:
        """Go back to line `number`, which is sent next; return the number of job entries still accepted."""
        self._requested_line = number
        self.unacked = self._lone_probe = None
        self.window.on_error()
        self.timer.on_answer(now, is_conclusive=True)
        return self.history.rewind_to(number)
