"""Queue of commands to send: injected commands, the job or the end script, and the final queries."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from printer_slicer.firmware import get_flavour
from printer_slicer.gcode.lexer import is_macro, parse, strip
from printer_slicer.gcode.state import MachineState, Place
from printer_slicer.stream.ack_timer import ResponseTimeout
from printer_slicer.stream.events import AxisPositions, Finished
from printer_slicer.stream.framing import MAX_LINE_BYTES, check_commands
from printer_slicer.stream.send_history import PROBE_COMMAND
from printer_slicer.stream.unacked_line import UnackedLine, is_repeatable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.firmware import WireDialect
    from printer_slicer.motion.rules import MotionLimits

__all__ = ["POSITION_TOLERANCE", "SendQueue"]

POSITION_TOLERANCE: Final = 0.05
"""Tolerance of a reported position, mm: printers report two decimals of single-precision numbers."""

_FINAL_QUERIES: Final = (b"M400", PROBE_COMMAND)
_MAX_POSITION_QUERIES: Final = 5


class SendQueue:
    """Queue of all commands of a print that have no line number yet.

    Attributes:
        n_entries_taken: number of job entries that have left the queue.
        position: position reported by the printer, None until reported.

    Raises:
        UsageError: an entry of the job can never be sent.
    """

    def __init__(
        self, commands: Sequence[bytes], limits: MotionLimits | None, max_line_bytes: int = MAX_LINE_BYTES
    ) -> None:
        check_commands(commands, max_line_bytes)
        self._max_line_bytes = max_line_bytes
        self.n_entries_taken = 0
        self.position: AxisPositions | None = None
        self._commands = commands
        self._end_script: deque[bytes] | None = None
        self._injected: deque[bytes] = deque()
        self._final_queries = deque(_FINAL_QUERIES)
        self._position_queries = 0
        self._timeout = ResponseTimeout(limits)
        self._machine = MachineState()
        self._last_command, self._position_before = b"", self._machine.place

    def set_dialect(self, dialect: WireDialect) -> None:
        """Apply the protocol rules of the firmware that the printer has reported."""
        self._machine.set_flavour(get_flavour(dialect))

    def inject(self, command: bytes) -> None:
        """Queue a command ahead of the job.

        Raises:
            UsageError: the command can never be sent.
        """
        check_commands([command], self._max_line_bytes)
        self._injected.append(command)
        self.restart_final_queries()

    @property
    def injected_count(self) -> int:
        """Return the number of injected commands that are still queued."""
        return len(self._injected)

    def cancel(self, end_script: Sequence[bytes]) -> None:
        """Replace the rest of the job and all queued injected commands by the end script."""
        self._end_script = deque(end_script)
        self._injected.clear()

    def restart_final_queries(self) -> None:
        """Send the final queries again from the first one, because more commands follow."""
        self._final_queries = deque(_FINAL_QUERIES)
        self._position_queries = 0

    def take_injected_command(self, max_length: int) -> bytes | None:
        """Return the next injected command; None if there is none or it is longer than `max_length` bytes."""
        return _take_first_command(self._injected, max_length)

    def take_job_command(self, max_length: int) -> bytes | None:
        """Return the next command of the job, or of the end script after a cancel; None at the end.

        None also if the next command is longer than `max_length` bytes; then it stays in the queue.
        """
        if self._end_script is not None:
            return _take_first_command(self._end_script, max_length)
        while self.n_entries_taken < len(self._commands):
            command = strip(self._commands[self.n_entries_taken])
            if len(command) > max_length:
                return None
            self.n_entries_taken += 1
            if command:
                return command
        return None

    def take_final_query(self) -> bytes | None:
        """Return the next of the queries that check the end of the print; None if all were sent.

        M400 waits for the end of the motion, and M114 queries the position. The M105 between them has a unique answer,
        so a surplus ok cannot suggest an early end. A printer that has lost the last lines reports a position that
        differs from the expected one.
        """
        if self._final_queries:
            return self._final_queries.popleft()
        # A report may be lost or damaged: query again before reporting a wrong position.
        if self._position_queries == 0 or (
            self._position_queries < _MAX_POSITION_QUERIES and not self._has_good_position()
        ):
            self._position_queries += 1
            self.position = None
            return b"M114"
        return None

    def track_command(self, command: bytes) -> float:
        """Apply a newly numbered command to the machine state; return how long its ok may take, s."""
        word, values = parse(command)
        self._position_before = self._expected_position
        self._last_command = command
        move = self._machine.apply(word, values, command)
        macro = is_macro(command)
        if macro:
            self._machine.forget_position()
        return self._timeout.estimate_timeout(b"" if macro else word or b"SET", values, move)

    @property
    def _expected_position(self) -> Place:
        """Return the position that the printer must report; unknown in inch mode, where firmwares differ."""
        return (None, None, None, None) if self._machine.inches else self._machine.place

    def make_unacked_line(self) -> UnackedLine:
        """Return an `UnackedLine` that finds out whether the last numbered command was executed."""
        word, values = parse(self._last_command)
        repeatable = is_repeatable(word, relative=self._machine.is_relative(values))
        return UnackedLine(
            self._position_before,
            self._expected_position,
            repeatable=repeatable,
            is_probe=self._last_command == PROBE_COMMAND,
        )

    def make_finished_event(self, acknowledged: int) -> Finished:
        """Return the event that reports the end of the print."""
        return Finished(
            acknowledged=acknowledged,
            cancelled=self._end_script is not None,
            position=self.position,
            expected=self._expected_position[:3],
            verified=self._is_at_end_position(),
        )

    def _has_good_position(self) -> bool:
        """Return whether the printer has reported a position that does not contradict the commands."""
        return self.position is not None and self._is_at_end_position() is not False

    def _is_at_end_position(self) -> bool | None:
        """Return whether the printer is at the end position of the commands, None if unknown."""
        if self.position is None:
            return None
        pairs = zip(self.position, self._expected_position[:3], strict=True)
        deviations = [
            abs(reported - demanded)
            for reported, demanded in pairs
            if reported is not None and demanded is not None
        ]
        return max(deviations) <= POSITION_TOLERANCE if deviations else None


def _take_first_command(commands: deque[bytes], max_length: int) -> bytes | None:
    """Remove and return the next command, without comments; None if there is none or it is longer than `max_length`."""
    while commands:
        command = strip(commands[0])
        if len(command) > max_length:
            return None
        commands.popleft()
        if command:
            return command
    return None
