"""Find the objects of a plate in the G-code, and skip the moves of cancelled objects.

The moves of a cancelled object are not sent, nor its commands that change the interpretation of moves. All other
commands of the object are sent, so that heaters, fan and limits stay as in the file. Its last moves are replaced by the
few commands that restore height, filament, origin and modes for the next object. The nozzle stays in place until the
first move of the next object.

Sources: OctoPrint's comments (`; printing object`), Marlin's and Duet3D's M486, Klipper's EXCLUDE_OBJECT.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final, overload

from printer_slicer.errors import UsageError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse, split_code, strip
from printer_slicer.gcode.state import MachineState, ModalState
from printer_slicer.printing.machine_state import PrintState, format_number
from printer_slicer.values import Struct

__all__ = ["LiveJob", "Span", "find_object_spans"]

_COMMENT: Final = re.compile(rb"\s*;\s*(stop )?printing object (.+?)\s*$")
_M486: Final = re.compile(rb"\s+([STAC])\s*(.*)")
_EXCLUDE_OBJECT: Final = re.compile(rb"EXCLUDE_OBJECT_(START|END)(?:\s+NAME=(\S+))?")
_OBJECT_NUMBER: Final = b"486"
_MARKS: Final = (b"printing object", _OBJECT_NUMBER, b"EXCLUDE_OBJECT_START")
_CHANGES_READING: Final = find_codes(
    Effect.MODE | Effect.UNITS | Effect.SETS_POSITION | Effect.SETS_HOME_OFFSET | Effect.RETRACTS
)
_SKIPPED: Final = find_codes(Effect.MOVES) | _CHANGES_READING | {b"G53"}
"""Commands that are not sent: moves, and commands that only change the interpretation of moves."""

_MAX_LOOK_AHEAD: Final = 40
_TOLERANCE: Final = 1e-6


class Span(Struct, frozen=True):
    """Range of job entries that print the object `name`: entry `first` to the one before `end`."""

    name: str
    first: int
    end: int


def find_object_spans(text: bytes) -> tuple[Span, ...]:
    """Find the marked objects in a G-code text; empty if there are none."""
    if not any(hint in text for hint in _MARKS):
        return ()
    spans: list[Span] = []
    names: dict[str, str] = {}
    current: tuple[str, int] | None = None
    count = 0
    for line in text.removeprefix(b"\xef\xbb\xbf").split(b"\n"):
        mark = _read_object_mark(line, names, current[0] if current else "")
        if mark is not None:
            if current and current[1] < count:
                spans.append(Span(*current, count))
            current = (mark, count) if mark else None
        count += bool(strip(line))
    if current and current[1] < count:
        spans.append(Span(*current, count))
    return tuple(Span(names.get(span.name, span.name), span.first, span.end) for span in spans)


def _read_object_mark(line: bytes, names: dict[str, str], inside: str) -> str | None:
    """Return the name of the object that starts in a line; empty if an object ends, None if neither."""
    if found := _COMMENT.match(line):
        return "" if found[1] else found[2].decode(errors="replace")
    if found := _EXCLUDE_OBJECT.match(line):
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
    """Job entries as they are sent, without cancelled objects.

    Args:
        commands: the entries.
        spans: the entries of each object.
        first: number of entries that were already sent.
        flavour: G-code flavour of the firmware.

    Attributes:
        print_state: state of the print after the first `followed` entries and the other commands sent.
        followed: number of entries applied to `print_state`.
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
        self.print_state = PrintState(flavour)
        self.followed = 0
        self.cancelled: set[str] = set()
        self.cancelled_at: dict[str, int] = {}
        self.marked_for_klipper = any(command.startswith(b"EXCLUDE_OBJECT") for command in commands[:1000])
        self._commands = commands
        self._spans = spans
        self._first_entries = [span.first for span in spans]
        self._changed: dict[int, bytes] = {}
        self._decided = first  # earlier entries have been sent and do not change any more

    @property
    def object_names(self) -> list[str]:
        """Return the names of the objects in printing order."""
        return list(dict.fromkeys(span.name for span in self._spans))

    def as_json(self) -> dict[str, Any]:
        """Return the names of all objects and of the cancelled objects, as part of the status."""
        return {"objects": self.object_names, "cancelled": sorted(self.cancelled)}

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
            self._decide_entry(index)
        return self._changed.get(index, self._commands[index]) if self._changed else self._commands[index]

    def __iter__(self) -> Iterator[bytes]:
        """Iterate over the original entries; cancelled objects are included."""
        return iter(self._commands)

    def cancel_object(self, name: str, n_entries_taken: int) -> str:
        """Skip an object from job entry `n_entries_taken` on; `name` is its name or number. Return its name.

        Raises:
            UsageError: no object has this name.
        """
        names = self.object_names
        if name not in names and name.isdecimal() and int(name) < len(names):
            name = names[int(name)]
        if name not in names:
            known_objects = ", ".join(names) if names else "none, because the file marks no objects"
            raise UsageError(f"no object named {name!r}", remedy=f"Objects: {known_objects}")
        self.cancelled.add(name)
        self.cancelled_at.setdefault(name, n_entries_taken)
        self._decided = max(self._decided, n_entries_taken)
        return name

    def follow(self, until: int) -> PrintState:
        """Update the print state by the entries before `until`; return the print state."""
        for index in range(self.followed, until):
            self.print_state.follow(self[index], index)
        self.followed = max(self.followed, until)
        return self.print_state

    def _decide_entry(self, index: int) -> None:
        """Decide what to send for an entry; skip the rest of its object if the object is cancelled."""
        at = bisect_right(self._first_entries, index) - 1
        if at < 0:
            self._decided = index
            return
        span = self._spans[at]
        if index < span.end and span.name in self.cancelled:
            self._skip_moves(index, span.end)
            self._decided = span.end
        else:
            self._decided = index + 1

    def _skip_moves(self, first: int, end: int) -> None:
        """Skip the moves in entries `first` to `end` - 1; the last ones become setup for the next object."""
        self._decided = end  # set before `follow`, which also reads entries
        before = self.follow(first)
        after = before.fork()
        # In other flavours M206 takes effect at the next homing, so it is sent.
        at_once = FLAVOURS[before.machine.flavour].home_offset == "at once"
        skipped = _SKIPPED if at_once else _SKIPPED - find_codes(Effect.SETS_HOME_OFFSET)
        moves = []
        for index in range(first, end):
            command = self._commands[index]
            after.follow(command)
            if parse(command)[0] in skipped:
                moves.append(index)
        replacement = _build_replacement(
            before.machine, after.machine, self._is_travel_next(end, after.modal)
        )
        if len(replacement) > len(moves):
            return
        self._changed |= dict.fromkeys(moves, b"")
        self._changed |= dict(zip(moves[len(moves) - len(replacement) :], replacement, strict=True))

    def _is_travel_next(self, end: int, modal: ModalState) -> bool:
        """Return whether the first move from entry `end` on is a travel to an absolute position."""
        for index in range(end, min(end + _MAX_LOOK_AHEAD, len(self._commands))):
            word, values = parse(self._commands[index])
            if word in {b"G0", b"G1"} and (b"X" in values or b"Y" in values):
                return {b"X", b"Y"} <= set(values) and b"E" not in values and not modal.relative
            if word in {b"G28", b"G2", b"G3", b"G53", b"G91"} or (
                word == b"G92" and (b"X" in values or b"Y" in values)
            ):
                return word == b"G28"
        return False


def _build_replacement(before: MachineState, after: MachineState, is_travel_next: bool) -> list[bytes]:
    """Return commands that replace a cancelled object and bring the machine from `before` to `after`."""
    now, script = before.fork(), list[bytes]()

    def emit(command: bytes) -> None:
        script.append(command)
        now.follow(command)

    def emit_in_mm(command: bytes) -> None:
        if now.inches:
            emit(b"G21")
        emit(command)

    new = after.modal
    _restore_origin(now, after, emit_in_mm)
    for move in _list_moves(now.modal, new, is_travel_next):
        if now.counting.has_relative_axes:
            emit(b"G90")
        emit_in_mm(move)
    if abs(extrusion := now.pulled - new.pulled) > _TOLERANCE:
        if not now.counting.has_relative_e:
            emit(b"M83")
        emit_in_mm(b"G1 E%s F1500" % format_number(extrusion))
    if now.retracted != new.retracted:
        emit(b"G10" if new.retracted else b"G11")
    if abs(now.modal.e - new.e) > _TOLERANCE:
        emit_in_mm(b"G92 E%s" % format_number(new.e))
    _restore_modes(now, new, emit, emit_in_mm)
    return script


def _restore_origin(now: MachineState, after: MachineState, emit_in_mm: Callable[[bytes], None]) -> None:
    """Set the origin that the file uses after a cancelled object, with M206 and G92."""
    homes = zip(now.home_offset, after.home_offset, strict=True)
    words = _format_axis_words([new if abs(new - old) > _TOLERANCE else None for old, new in homes])
    if (
        words and FLAVOURS[now.flavour].home_offset == "at once"
    ):  # in other flavours the M206 of the file is sent
        emit_in_mm(b" ".join([b"M206", *words]))
    shifts = zip(now.position, now.shift, after.shift, strict=True)
    if words := _format_axis_words(
        [
            here + new - old if here is not None and abs(new - old) > _TOLERANCE else None
            for here, old, new in shifts
        ]
    ):
        emit_in_mm(b" ".join([b"G92", *words]))


def _format_axis_words(values: Iterable[float | None]) -> list[bytes]:
    """Format the G-code words X, Y and Z, except those whose value is None."""
    return [
        letter + format_number(value)
        for letter, value in zip((b"X", b"Y", b"Z"), values, strict=True)
        if value is not None
    ]


def _list_moves(old: ModalState, new: ModalState, is_travel_next: bool) -> list[bytes]:
    """Return the moves to the height and position after a cancelled object.

    No move to the position is needed if the file travels next. A move up comes first, a move down last.
    """
    moves: list[bytes] = []
    rise = (new.z or 0.0) - (old.z or 0.0)
    if new.z is not None and abs(rise) > _TOLERANCE:
        moves.append(b"G1 Z%s" % format_number(new.z))
    if not is_travel_next and new.known and (new.x, new.y) != (old.x, old.y):
        travel = b"G1 X%s Y%s F6000" % (format_number(new.x or 0.0), format_number(new.y or 0.0))
        moves.insert(len(moves) if rise > 0 else 0, travel)
    return moves


def _restore_modes(
    now: MachineState, new: ModalState, emit: Callable[[bytes], None], emit_in_mm: Callable[[bytes], None]
) -> None:
    """Set the modes and the unit that the file uses after a cancelled object."""
    if new.speed and abs(new.speed - now.speed) > _TOLERANCE:
        emit_in_mm(b"G1 F%s" % format_number(new.speed * 60))
    if now.counting.has_relative_axes != new.relative:
        emit(b"G91" if new.relative else b"G90")
    if now.counting.has_relative_extruder != new.extruder:
        emit(b"M83" if new.extruder else b"M82")
    if now.inches != new.inches:
        emit(b"G20" if new.inches else b"G21")
