"""The lines in flight: which answer belongs to which, what is in doubt, how many more may go out.

An ok does not say whose it is. The first row that fits decides:

    an ok...                                       acknowledges
    with a number                                  everything up to it
    with temperatures, a question in flight        everything up to the newest question
    with temperatures, right behind such a one     nothing: it answers an older question
    right behind a refusal, or the remains of one  nothing
    behind the lines in flight at an M108          nothing: it answers that
    bare, where the answer has temperatures        nothing
    for a line that was refused                    nothing
    any other                                      the oldest line in flight
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.stream.burst import Burst, Verdict
from printer_slicer.stream.framing import LONGEST
from printer_slicer.stream.ledger import ASK, Ledger
from printer_slicer.stream.tracker import parse
from printer_slicer.stream.watch import Watch

if TYPE_CHECKING:
    from printer_slicer.stream.replies import Ok

__all__ = ["Flight"]

_CAREFUL_LINES: Final = 300
"""Lines sent one at a time after an error."""

_BREAK_WAIT: Final = b"\nM108\n"
_BREAK_AGAIN: Final = 2.0
_MOST_BREAKS: Final = 6
"""Times that one wait is told to end: all of them together fit into any receive buffer."""

_QUESTION_ROOM: Final = 16
"""Bytes of the window kept for a question about the lines in flight."""

_WAITS: Final = frozenset({b"M0", b"M1", b"M109", b"M190", b"M191"})

_ECHO: Final = 0.5
"""s in which a printer that was busy answers the questions that have piled up."""


class Flight:
    """Numbered lines from 1 on, with everything known about their fate.

    Attributes:
        ledger: the lines.
        burst: the error that is being settled.
        watch: the clock over the oldest of them.
        lost_count: line wanted by a printer that had it or can never have it; None while all is well.
    """

    def __init__(self, window_lines: int, window_bytes: int, give_up: float) -> None:
        self.ledger = Ledger()
        self.burst = Burst()
        self.watch = Watch(give_up)
        self.lost_count: int | None = None
        self._window = (window_lines, window_bytes)
        self._careful = 0
        self._requested: int | None = None
        self._echo_until = -inf
        self._heat_with_ok = False
        self._unnumbered: deque[int] = deque()  # last line in front of each command without a number
        self._breaks, self._broken = 0, -inf

    @property
    def due(self) -> float | None:
        """When something must be done if nothing arrives, s; None for never."""
        if self.burst.active:
            return self.burst.until
        return self.watch.due(self.ledger.oldest) if self.ledger.in_flight else None

    def room(self) -> int:
        """Bytes that the next line may have, with its line break, to join those in flight now."""
        ledger = self.ledger
        if not ledger.in_flight or ledger.cursor == self._requested:
            return LONGEST + 1
        lines, size = self._window
        if ledger.in_flight >= (1 if self._careful else lines):
            return 0
        return size - _QUESTION_ROOM - ledger.bytes_in_flight

    def repeats(self) -> bool:
        """Whether the next line, which has its number already, may go out now."""
        return len(self.ledger.next.text) < self.room()

    def overdue(self, now: float) -> bool:
        """Whether an answer should have come by now."""
        return self.ledger.in_flight > 0 and now >= self.watch.due(self.ledger.oldest)

    def ask(self, now: float) -> bytes:
        """Send the next line ahead of its turn, so that the printer must say which line it wants."""
        self._careful = _CAREFUL_LINES
        self.burst.swallow = False
        self.watch.ask(now)
        return self.ledger.take(now, break_first=True)

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
        self._careful = max(0, self._careful - (number - ledger.accepted))
        job = ledger.accept(number)
        self._breaks, self._broken = 0, -inf
        self.burst.calm(number)
        self.watch.answered(now, settled=settled or not ledger.in_flight)
        return job

    def belongs_to(self, ok: Ok, now: float) -> int | None:
        """The line up to which an ok acknowledges, None if it acknowledges nothing."""
        ledger, burst = self.ledger, self.burst
        if ok.number is not None:
            return ok.number if ledger.accepted < ok.number < ledger.cursor else None
        if ok.heat:
            self._heat_with_ok = True
            asked = ledger.find(ASK)
            if asked is not None:
                burst.swallow = False
                self._echo_until = now + _ECHO
                return asked
            if now < self._echo_until:
                return None
        if burst.claim is not None:
            # The request between the error and this ok was lost; the error has named the line too.
            self.request(None, now)
        if burst.swallow:
            burst.swallow = False
            return None
        if self._unnumbered and ledger.accepted >= self._unnumbered[0]:
            self._unnumbered.popleft()
            return None
        oldest = ledger.accepted + 1
        if not ledger.in_flight or (burst.wanted is not None and oldest >= burst.wanted):
            return None
        if self._heat_with_ok and ledger.oldest.command == ASK:
            # One ok too many. Where lines are told apart by their answers, the count is right again.
            self.watch.answered(now)
            return None
        return oldest

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
        if verdict is Verdict.ASK:
            self.watch.suspect(now)
        elif verdict is Verdict.LOST_COUNT:
            self.lost_count = number

    def stray(self, now: float, *, refusal: bool) -> None:
        """Something came that answers none of the lines in flight, or that cannot be read.

        Args:
            now: s.
            refusal: an ok right behind it would mean no, or nothing.
        """
        if self.ledger.in_flight:
            self.burst.swallow = self.burst.swallow or refusal
            self.watch.suspect(now)

    def go_back(self, wanted: int, now: float) -> int:
        """Make `wanted` the next line; entries of the job that stay accepted."""
        self._requested = wanted
        self._careful = _CAREFUL_LINES
        self.watch.answered(now, settled=True)
        return self.ledger.rewind(wanted)
