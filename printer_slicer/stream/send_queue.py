"""What is sent, in which order: injected commands, the job or the end script, the questions at the end."""

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

__all__ = ["SAME_PLACE", "SendQueue"]

SAME_PLACE: Final = 0.05
"""mm; the printer says two decimals of single-precision numbers."""

_CLOSING: Final = (b"M400", ASK)
_MOST_LOOKS: Final = 5


class SendQueue:
    """All commands of a print that have no number yet.

    Attributes:
        taken: entries of the job that have been given out.
        position: where the printer says it is, None until it says so.

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
        self._looks = 0
        self._patience = ResponseTimeout(limits)
        self._machine = MachineState()
        self._command, self._before = b"", self._machine.place

    def set_dialect(self, dialect: WireDialect) -> None:
        """The firmware is known now."""
        self._machine.set_flavour(flavour_of(dialect))

    def inject(self, command: bytes) -> None:
        """Give this out next.

        Raises:
            UsageError: it can never be sent.
        """
        check_commands([command], self._longest)
        self._injected.append(command)
        self.reopen()

    @property
    def injected(self) -> int:
        """Commands that a person wants and that were not given out yet."""
        return len(self._injected)

    def cancel(self, end_script: Sequence[bytes]) -> None:
        """Give out the end script instead of the rest of the job."""
        self._end_script = deque(end_script)
        self._injected.clear()

    def reopen(self) -> None:
        """The motion goes on: the questions at the end are to be asked again."""
        self._closing = deque(_CLOSING)
        self._looks = 0

    def next_injected(self, room: int) -> bytes | None:
        """The next command that a person wants, None if there is none or it is longer than `room`."""
        return _next_of(self._injected, room)

    def next_of_job(self, room: int) -> bytes | None:
        """The next command of the job, or of the end script once cancelled.

        None at its end, and for one that is longer than `room` bytes, which stays the next.
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

    def next_of_closing(self) -> bytes | None:
        """Wait for the end of the motion, then ask where the printer is; None when nothing is left to ask.

        The question between is answered like no other, so an ok too many can make nobody believe in an early
        end; and a printer that has lost the last lines is not where they lead.
        """
        if self._closing:
            return self._closing.popleft()
        # A report may be lost or damaged: look again before believing that something is wrong.
        if self._looks == 0 or (self._looks < _MOST_LOOKS and not self._satisfied()):
            self._looks += 1
            self.position = None
            return b"M114"
        return None

    def follow(self, command: bytes) -> float:
        """Take note of a command that gets its number now; longest time until its ok, s."""
        word, values = parse(command)
        self._before = self._place
        self._command = command
        move = self._machine.apply(word, values, command)
        macro = is_macro(command)
        if macro:
            self._machine.forget_position()
        return self._patience.allow(b"" if macro else word or b"SET", values, move)

    @property
    def _place(self) -> Place:
        """Return the position that the printer must report; none in inch mode, where firmwares report differently."""
        return (None, None, None, None) if self._machine.inches else self._machine.place

    def doubt(self) -> UnackedLine:
        """Questions about the last command that got its number."""
        word, values = parse(self._command)
        repeatable = is_repeatable(word, relative=self._machine.relative(values))
        return UnackedLine(self._before, self._place, repeatable=repeatable, asks=self._command == ASK)

    def finished(self, acknowledged: int) -> Finished:
        """How the print ended."""
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
        """Whether the printer is where the commands lead, None if that cannot be said."""
        if self.position is None:
            return None
        pairs = zip(self.position, self._place[:3], strict=True)
        misses = [abs(is_at - to_be) for is_at, to_be in pairs if is_at is not None and to_be is not None]
        return max(misses) <= SAME_PLACE if misses else None


def _next_of(commands: deque[bytes], room: int) -> bytes | None:
    while commands:
        command = strip(commands[0])
        if len(command) > room:
            return None
        commands.popleft()
        if command:
            return command
    return None
