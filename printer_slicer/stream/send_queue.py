"""Queue of commands to send: injected commands, the job or the end script, and the closing queries."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from printer_slicer.firmware import flavour_of
from printer_slicer.gcode.lexer import is_macro, parse, strip
from printer_slicer.gcode.state import MachineState, Place
from printer_slicer.stream.ack_timer import ResponseTimeout
from printer_slicer.stream.events import AxisPositions, Finished
from printer_slicer.stream.framing import LONGEST, check_commands
from printer_slicer.stream.send_history import ASK
from printer_slicer.stream.unacked_line import UnackedLine, is_repeatable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.firmware import WireDialect
    from printer_slicer.motion.rules import MotionLimits

__all__ = ["POSITION_TOLERANCE", "SendQueue"]

POSITION_TOLERANCE: Final = 0.05
"""mm; printers report two decimals of single-precision numbers."""

_CLOSING: Final = (b"M400", ASK)
_MOST_POSITION_QUERIES: Final = 5


class SendQueue:
    """All commands of a print that have no line number yet.

    Attributes:
        taken: number of job entries that have left the queue.
        position: position reported by the printer, None until reported.

    Raises:
        UsageError: an entry of the job can never be sent.
    """

    def __init__(
        self, commands: Sequence[bytes], limits: MotionLimits | None, longest: int = LONGEST
    ) -> None:
        check_commands(commands, longest)
        self._longest = longest
        self.taken = 0
        self.position: AxisPositions | None = None
        self._commands = commands
        self._end_script: deque[bytes] | None = None
        self._injected: deque[bytes] = deque()
        self._closing = deque(_CLOSING)
        self._position_queries = 0
        self._timeout = ResponseTimeout(limits)
        self._machine = MachineState()
        self._command, self._before = b"", self._machine.place

    def set_dialect(self, dialect: WireDialect) -> None:
        """Apply the rules of the reported firmware."""
        self._machine.set_flavour(flavour_of(dialect))

    def inject(self, command: bytes) -> None:
        """Queue a command ahead of the job.

        Raises:
            UsageError: it can never be sent.
        """
        check_commands([command], self._longest)
        self._injected.append(command)
        self.restart_closing()

    @property
    def injected(self) -> int:
        """Return the number of injected commands that are still queued."""
        return len(self._injected)

    def cancel(self, end_script: Sequence[bytes]) -> None:
        """Replace the rest of the job and all queued injected commands by the end script."""
        self._end_script = deque(end_script)
        self._injected.clear()

    def restart_closing(self) -> None:
        """Send the closing queries again, because the motion continues."""
        self._closing = deque(_CLOSING)
        self._position_queries = 0

    def next_injected(self, room: int) -> bytes | None:
        """Return the next injected command; None if there is none or it is longer than `room` bytes."""
        return _next_of(self._injected, room)

    def next_of_job(self, room: int) -> bytes | None:
        """Return the next command of the job, or of the end script after a cancel.

        None at the end, and if the next command is longer than `room` bytes; then it stays in the queue.
        """
        if self._end_script is not None:
            return _next_of(self._end_script, room)
        while self.taken < len(self._commands):
            command = strip(self._commands[self.taken])
            if len(command) > room:
                return None
            self.taken += 1
            if command:
                return command
        return None

    def next_closing_query(self) -> bytes | None:
        """Return the next command that waits for the end of the motion and queries the position; None after the last.

        The temperature query between them has a unique answer, so a surplus ok cannot suggest an early end. A printer
        that has lost the last lines reports another position than expected.
        """
        if self._closing:
            return self._closing.popleft()
        # A report may be lost or damaged: query again before reporting a wrong position.
        if self._position_queries == 0 or (
            self._position_queries < _MOST_POSITION_QUERIES and not self._satisfied()
        ):
            self._position_queries += 1
            self.position = None
            return b"M114"
        return None

    def track(self, command: bytes) -> float:
        """Track a command that gets its line number now; return its timeout, s."""
        word, values = parse(command)
        self._before = self._place
        self._command = command
        move = self._machine.apply(word, values, command)
        macro = is_macro(command)
        if macro:
            self._machine.forget_position()
        return self._timeout.estimate(b"" if macro else word or b"SET", values, move)

    @property
    def _place(self) -> Place:
        """Return the position that the printer must report; unknown in inch mode, where firmwares differ."""
        return (None, None, None, None) if self._machine.inches else self._machine.place

    def make_unacked_line(self) -> UnackedLine:
        """Return the queries about the last command that got a line number."""
        word, values = parse(self._command)
        repeatable = is_repeatable(word, relative=self._machine.is_relative(values))
        return UnackedLine(self._before, self._place, repeatable=repeatable, is_probe=self._command == ASK)

    def make_finished(self, acknowledged: int) -> Finished:
        """Return the result of the print."""
        return Finished(
            acknowledged=acknowledged,
            cancelled=self._end_script is not None,
            position=self.position,
            expected=self._place[:3],
            verified=self._verified(),
        )

    def _satisfied(self) -> bool:
        return self.position is not None and self._verified() is not False

    def _verified(self) -> bool | None:
        """Return whether the printer is at the end position of the commands, None if unknown."""
        if self.position is None:
            return None
        pairs = zip(self.position, self._place[:3], strict=True)
        misses = [abs(is_at - to_be) for is_at, to_be in pairs if is_at is not None and to_be is not None]
        return max(misses) <= POSITION_TOLERANCE if misses else None


def _next_of(commands: deque[bytes], room: int) -> bytes | None:
    while commands:
        command = strip(commands[0])
        if len(command) > room:
            return None
        commands.popleft()
        if command:
            return command
    return None
