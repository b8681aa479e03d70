"""A printer that the test plays line by line, with a clock that the test advances."""

from __future__ import annotations

from typing import TYPE_CHECKING

from printer_slicer.motion.rules import MotionLimits
from printer_slicer.stream.framing import frame
from printer_slicer.stream.protocol import Streamer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.stream.events import Event

INTRODUCTION = ("FIRMWARE_NAME:Marlin 2.1 SOURCE_CODE_URL:x", "Cap:EMERGENCY_PARSER:0", "ok")
HOT = "ok T:200.0 /200.0 B:60.0 /60.0 @:40 B@:20"

LIMITS = MotionLimits(
    max_speed=(300.0, 300.0, 5.0, 25.0),
    max_acceleration=(3000.0, 3000.0, 100.0, 10000.0),
    acceleration=3000.0,
    travel_acceleration=3000.0,
    retract_acceleration=3000.0,
    corner="junction_deviation",
    junction_deviation=0.01,
    jerk=(10.0, 10.0, 0.3, 5.0),
    square_corner_velocity=5.0,
)
"""Of an ordinary machine."""


class Conversation:
    """What a streamer says to what the test says.

    Args:
        bytewise: give the streamer every byte by itself, and let it speak after each.
    """

    def __init__(self, streamer: Streamer, *, bytewise: bool = False) -> None:
        self.streamer = streamer
        self.now = 100.0
        self.events: list[Event] = []
        self._bytewise = bytewise

    def says(self, *lines: str) -> list[bytes]:
        """The lines that the streamer sends when the printer says `lines`."""
        return self.says_bytes(b"".join(line.encode() + b"\n" for line in lines))

    def says_bytes(self, data: bytes) -> list[bytes]:
        """The same for bytes."""
        pieces = [data[i : i + 1] for i in range(len(data))] if self._bytewise else [data]
        out = b""
        for piece in pieces:
            self.streamer.receive(piece, self.now)
            out += self._spoken()
        return lines_of(out)

    def waits(self, seconds: float) -> list[bytes]:
        """The lines that the streamer sends when nothing comes for so long."""
        end = self.now + seconds
        out = self._spoken()
        while (due := self.streamer.wakeup()) is not None and due <= end:
            self.now = max(self.now, due)
            out += self._spoken()
        self.now = end
        return lines_of(out + self._spoken())

    def happened(self, *kinds: type) -> list[Event]:
        """The events of these kinds so far."""
        return [event for event in self.events if isinstance(event, kinds)]

    def _spoken(self) -> bytes:
        out = self.streamer.send(self.now)
        self.events += self.streamer.events()
        return out


def lines_of(data: bytes) -> list[bytes]:
    """Split; a line break in front of a line stays with it, as what sets a repeat apart."""
    lines: list[bytes] = []
    start = b""
    for line in data.split(b"\n")[:-1]:
        if line:
            lines.append(start + line)
            start = b""
        else:
            start += b"\n"
    return lines


def first(number: int, command: str) -> bytes:
    """A line on the wire."""
    return frame(number, command.encode())


def again(number: int, command: str) -> bytes:
    """A repeat, or a question: after a line break."""
    return b"\n" + first(number, command)


def printing(
    commands: Sequence[str], *, bytewise: bool = False, streamer: Streamer | None = None
) -> tuple[Conversation, list[bytes]]:
    """A conversation after the greeting, and what of the job went out at once; the job begins at line 3."""
    talk = Conversation(streamer or Streamer([c.encode() for c in commands]), bytewise=bytewise)
    talk.waits(0.0)
    talk.says("ok")
    talk.says(*INTRODUCTION)
    return talk, talk.says(HOT)


def moves(n: int) -> list[str]:
    """A job of short lines, each another one."""
    return [f"G1 X{i}" for i in range(1, n + 1)]
