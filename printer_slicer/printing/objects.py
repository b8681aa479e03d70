"""Objects on one plate: which entries print which object, and how a cancelled object is skipped.

Its moves are not sent, nor commands that change how moves are read. All other commands between its marks are sent, so
that heaters, fan and limits stay as in the file. The last of its moves are replaced by the few commands that restore
height, filament, origin and modes for the next object. The nozzle stays in place until the first move of the next
object.

Sources: OctoPrint's comments (`; printing object`), Marlin's and Duet3D's M486, Klipper's EXCLUDE_OBJECT.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, overload

from printer_slicer.errors import UsageError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.lexer import parse, split_code, strip
from printer_slicer.gcode.state import MachineState, ModalState
from printer_slicer.printing.machine_state import PrintState, number

__all__ = ["LiveJob", "Span", "find_object_spans"]

_COMMENT: Final = re.compile(rb"\s*;\s*(stop )?printing object (.+?)\s*$")
_M486: Final = re.compile(rb"\s+([STAC])\s*(.*)")
_WORDS: Final = re.compile(rb"EXCLUDE_OBJECT_(START|END)(?:\s+NAME=(\S+))?")
_OBJECT_NUMBER: Final = b"486"
_HINTS: Final = (b"printing object", _OBJECT_NUMBER, b"EXCLUDE_OBJECT_START")
_READ_MOVES: Final = commands_that(
    Effect.MODE | Effect.UNITS | Effect.SETS_POSITION | Effect.SETS_HOME_OFFSET | Effect.RETRACTS
)
_SKIPPED: Final = commands_that(Effect.MOVES) | _READ_MOVES | {b"G53"}
"""Commands that are not sent: moves, and those that only change how moves are read."""

_LOOK_AHEAD: Final = 40
_NEAR: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Span:
    """Entries of the job from `first` to before `end` that print the object `name`."""

    name: str
    first: int
    end: int


def find_object_spans(text: bytes) -> tuple[Span, ...]:
    """Find the marked objects in a G-code text; empty if there are none."""
    if not any(hint in text for hint in _HINTS):
        return ()
    spans: list[Span] = []
    names: dict[str, str] = {}
    open_: tuple[str, int] | None = None
    count = 0
    for line in text.removeprefix(b"\xef\xbb\xbf").split(b"\n"):
        mark = _mark(line, names, open_[0] if open_ else "")
        if mark is not None:
            if open_ and open_[1] < count:
                spans.append(Span(*open_, count))
            open_ = (mark, count) if mark else None
        count += bool(strip(line))
    if open_ and open_[1] < count:
        spans.append(Span(*open_, count))
    return tuple(Span(names.get(span.name, span.name), span.first, span.end) for span in spans)


def _mark(line: bytes, names: dict[str, str], inside: str) -> str | None:
    """Return the object that starts in this line, empty at the end of one, None for any other line."""
    if found := _COMMENT.match(line):
        return "" if found[1] else found[2].decode(errors="replace")
    if found := _WORDS.match(line):
        return "" if found[1] == b"END" else (found[2] or b"").decode(errors="replace")
    head, behind = split_code(line) if _OBJECT_NUMBER in line else (b"", b"")
    if parse(head)[0] == b"M486" and (found := _M486.match(behind)):
        value = found[2].strip().strip(b'"').decode(errors="replace")
        if found[1] == b"S":
            which, _, rest = value.partition(" ")
            if rest.startswith("A"):
                names[which] = rest[1:].strip('"')
            return "" if which.startswith("-") else which
        if found[1] == b"A" and inside:
            names[inside] = value
    return None


class LiveJob(Sequence[bytes]):
    """Entries of a job as they are sent, without cancelled objects.

    Args:
        commands: the entries.
        spans: the entries of each object.
        first: number of entries that were already sent.
        flavour: determines how the firmware reads some commands.

    Attributes:
        modes: state of the print after the followed entries and all other commands sent.
        followed: number of followed entries.
        cancelled: names of cancelled objects.
        cancelled_at: name -> entry from which the object is cancelled.
        marked_for_klipper: whether the job marks the objects for Klipper, which can cancel them itself.
    """

    def __init__(
        self,
        commands: Sequence[bytes],
        spans: Sequence[Span] = (),
        first: int = 0,
        *,
        flavour: str = "marlin",
    ) -> None:
        self.modes = PrintState(flavour)
        self.followed = 0
        self.cancelled: set[str] = set()
        self.cancelled_at: dict[str, int] = {}
        self.marked_for_klipper = any(command.startswith(b"EXCLUDE_OBJECT") for command in commands[:1000])
        self._commands = commands
        self._spans = spans
        self._begins = [span.first for span in spans]
        self._changed: dict[int, bytes] = {}
        self._decided = first  # earlier entries were sent, and no longer change

    @property
    def names(self) -> list[str]:
        """Return the names of the objects in printing order."""
        return list(dict.fromkeys(span.name for span in self._spans))

    def as_json(self) -> dict[str, Any]:
        """Return this part of the status."""
        return {"objects": self.names, "cancelled": sorted(self.cancelled)}

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self._commands)

    @overload
    def __getitem__(self, index: int) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[bytes]: ...
    def __getitem__(self, index: int | slice) -> bytes | Sequence[bytes]:
        """Return an entry as it is sent, empty if it is skipped."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if self.cancelled and index >= self._decided:
            self._decide(index)
        return self._changed.get(index, self._commands[index]) if self._changed else self._commands[index]

    def __iter__(self) -> Iterator[bytes]:
        """Iterate over the entries of the file; this decides nothing about later entries."""
        return iter(self._commands)

    def cancel(self, name: str, taken: int) -> str:
        """Cancel an object from entry `taken` on; return its name.

        Raises:
            UsageError: there is no such object.
        """
        names = self.names
        if name not in names and name.isdecimal() and int(name) < len(names):
            name = names[int(name)]
        if name not in names:
            there = ", ".join(names) if names else "none, because the file marks no objects"
            raise UsageError(f"no object named {name!r}", remedy=f"Objects: {there}")
        self.cancelled.add(name)
        self.cancelled_at.setdefault(name, taken)
        self._decided = max(self._decided, taken)
        return name

    def follow(self, until: int) -> PrintState:
        """Follow the entries before `until`; return the state after them."""
        for index in range(self.followed, until):
            self.modes.follow(self[index], index)
        self.followed = max(self.followed, until)
        return self.modes

    def _decide(self, index: int) -> None:
        """Decide what to send for the span of an entry, if it belongs to a cancelled object."""
        at = bisect_right(self._begins, index) - 1
        if at < 0:
            self._decided = index
            return
        span = self._spans[at]
        if index < span.end and span.name in self.cancelled:
            self._skip(index, span.end)
            self._decided = span.end
        else:
            self._decided = index + 1

    def _skip(self, first: int, end: int) -> None:
        """Skip the moves from `first` to before `end`, and send commands for their other effects."""
        self._decided = end  # `follow` below reads entries, too
        before = self.follow(first)
        after = before.fork()
        # Elsewhere M206 takes effect at the next homing, so it is sent.
        at_once = FLAVOURS[before.machine.flavour].home_offset == "at once"
        skipped = _SKIPPED if at_once else _SKIPPED - commands_that(Effect.SETS_HOME_OFFSET)
        moves = []
        for index in range(first, end):
            command = self._commands[index]
            after.follow(command)
            if parse(command)[0] in skipped:
                moves.append(index)
        replacement = _replacement(before.machine, after.machine, self._is_travel_next(end, after.stand))
        if len(replacement) > len(moves):
            return
        self._changed |= dict.fromkeys(moves, b"")
        self._changed |= dict(zip(moves[len(moves) - len(replacement) :], replacement, strict=True))

    def _is_travel_next(self, end: int, stand: ModalState) -> bool:
        """Return whether the first move after the object is a travel to an absolute position."""
        for index in range(end, min(end + _LOOK_AHEAD, len(self._commands))):
            word, values = parse(self._commands[index])
            if word in {b"G0", b"G1"} and (b"X" in values or b"Y" in values):
                return {b"X", b"Y"} <= set(values) and b"E" not in values and not stand.relative
            if word in {b"G28", b"G2", b"G3", b"G53", b"G91"} or (
                word == b"G92" and (b"X" in values or b"Y" in values)
            ):
                return word == b"G28"
        return False


def _replacement(before: MachineState, after: MachineState, is_travel_next: bool) -> list[bytes]:
    """Return the commands that replace a cancelled object: from the state before it to the state after it."""
    now, script = before.fork(), list[bytes]()

    def say(command: bytes) -> None:
        script.append(command)
        now.follow(command)

    def say_in_mm(command: bytes) -> None:
        if now.inches:
            say(b"G21")
        say(command)

    new = after.modal
    _restore_origin(now, after, say_in_mm)
    for move in _height_and_travel(now.modal, new, is_travel_next):
        if now.counting.has_relative_axes:
            say(b"G90")
        say_in_mm(move)
    if abs(pull := now.pulled - new.pulled) > _NEAR:
        if not now.counting.has_relative_e:
            say(b"M83")
        say_in_mm(b"G1 E%s F1500" % number(pull))
    if now.retracted != new.retracted:
        say(b"G10" if new.retracted else b"G11")
    if abs(now.modal.e - new.e) > _NEAR:
        say_in_mm(b"G92 E%s" % number(new.e))
    _restore_modes(now, new, say, say_in_mm)
    return script


def _restore_origin(now: MachineState, after: MachineState, say_in_mm: Callable[[bytes], None]) -> None:
    """Set the origin that the file has after the object, by M206 and G92."""
    homes = zip(now.home_offset, after.home_offset, strict=True)
    words = _words([new if abs(new - old) > _NEAR else None for old, new in homes])
    if words and FLAVOURS[now.flavour].home_offset == "at once":  # elsewhere the file's own M206 is sent
        say_in_mm(b" ".join([b"M206", *words]))
    shifts = zip(now.position, now.shift, after.shift, strict=True)
    if words := _words(
        [
            here + new - old if here is not None and abs(new - old) > _NEAR else None
            for here, old, new in shifts
        ]
    ):
        say_in_mm(b" ".join([b"G92", *words]))


def _words(values: Iterable[float | None]) -> list[bytes]:
    """Return the words X, Y and Z for the values that are not None."""
    return [
        letter + number(value)
        for letter, value in zip((b"X", b"Y", b"Z"), values, strict=True)
        if value is not None
    ]


def _height_and_travel(old: ModalState, new: ModalState, is_travel_next: bool) -> list[bytes]:
    """Move to the height after the object, up first and down last, and to its position if the file does not."""
    moves: list[bytes] = []
    risen = (new.z or 0.0) - (old.z or 0.0)
    if new.z is not None and abs(risen) > _NEAR:
        moves.append(b"G1 Z%s" % number(new.z))
    if not is_travel_next and new.known and (new.x, new.y) != (old.x, old.y):
        travel = b"G1 X%s Y%s F6000" % (number(new.x or 0.0), number(new.y or 0.0))
        moves.insert(len(moves) if risen > 0 else 0, travel)
    return moves


def _restore_modes(
    now: MachineState, new: ModalState, say: Callable[[bytes], None], say_in_mm: Callable[[bytes], None]
) -> None:
    """Set the modes and the unit that the file has after the object."""
    if new.speed and abs(new.speed - now.speed) > _NEAR:
        say_in_mm(b"G1 F%s" % number(new.speed * 60))
    if now.counting.has_relative_axes != new.relative:
        say(b"G91" if new.relative else b"G90")
    if now.counting.has_relative_extruder != new.extruder:
        say(b"M83" if new.extruder else b"M82")
    if now.inches != new.inches:
        say(b"G20" if new.inches else b"G21")
