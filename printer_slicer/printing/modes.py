"""What the printer knows after a command: place, modes, heat, fan, and what else stays until something changes it.

Followed command by command in the order in which the printer gets them, so that a print can be taken up again as if
it had never been left: after a pause, or on a machine that has lost everything. Lengths in mm, speeds in mm/s.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from printer_slicer.motion.counting import Counting, Rule
from printer_slicer.stream.framing import strip
from printer_slicer.stream.tracker import MOVES_UNSEEN, parse

__all__ = ["SCRIPT", "Modes", "Stand", "Step", "number"]

_HISTORY: Final = 256
"""Commands that are remembered: more than the moves in any planner of Marlin's kind, and what lies between."""

_AXES: Final = (b"X", b"Y", b"Z")
_DRAINS: Final = frozenset(
    {b"G4", b"G28", b"G29", b"M0", b"M1", b"M109", b"M190", b"M191", b"M226", b"M400", b"M600", b"M601"}
)
"""Their ok comes when all moves before them were made."""

_MOVES: Final = frozenset({b"G0", b"G1", b"G2", b"G3"})
_STICKY: Final = frozenset(
    {
        b"M201",
        b"M203",
        b"M204",
        b"M205",
        b"M220",
        b"M221",
        b"M207",
        b"M208",
        b"M900",
        b"M572",
        b"M566",
        b"G21",
    }
    | {b"G17", b"M200", b"M92", b"M302", b"M851"}
)
"""Settings that stay and say themselves what they set: the last of each with the same letters is enough."""

_WORDS: Final = re.compile(rb"([A-Z][A-Z_]{2,})\b")
_STICKY_WORDS: Final = frozenset({b"SET_PRESSURE_ADVANCE", b"SET_VELOCITY_LIMIT", b"SET_RETRACTION"})
"""Not SET_GCODE_OFFSET: a baby-step is in the height at which the nozzle stands, and that is what is told anew."""

_MESHES: Final = frozenset({b"BED_MESH_PROFILE", b"BED_MESH_CALIBRATE"})


def number(value: float) -> bytes:
    """A number as G-code says it: five decimals at most, no zeros behind."""
    return f"{value:.5f}".rstrip("0").rstrip(".").replace("-0", "0" if abs(value) < 5e-6 else "-0").encode()


@dataclass(frozen=True, slots=True)
class Stand:
    """Where and how the printer stands between two commands.

    Attributes:
        x, y, z: place as the program counts it; None where it is not known.
        e: filament as the program counts it.
        relative, relative_e: whether x, y, z, and e, count from where they are.
        extruder: what M82 or M83 must say so that it is as it was.
        speed: mm/s asked for last, 0 for never.
        retracted: whether the firmware has pulled back (G10).
        pulled: mm of filament that are pulled back by E.
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    e: float = 0.0
    relative: bool = False
    relative_e: bool = False
    extruder: bool = False
    speed: float = 0.0
    retracted: bool = False
    pulled: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the place is known."""
        return self.x is not None and self.y is not None and self.z is not None

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, z; what is not known counts as 0."""
        return self.x or 0.0, self.y or 0.0, self.z or 0.0


SCRIPT: Final = -2
"""Instead of an entry: a command of the host's own scripts, without which what follows would be wrong."""


class Step(NamedTuple):
    """A command: index of the entry (-1: not of the job, or SCRIPT), how the printer stands before and after it."""

    entry: int
    before: Stand
    after: Stand
    command: bytes


class Modes:
    """Follows commands.

    Args:
        rule: by which the firmware reads G90, G91, M82 and M83.

    Attributes:
        stand: where and how the printer stands after them.
        hotend, bed, chamber: wanted °C.
        fan: 0 to 255, of the part fan.
        fans: number -> command, of others.
        mesh: the command that has the bed's unevenness followed, empty for none.
        offset: mm by which the program counts x and y higher than the machine (G92); None where that is not known.
        sticky: settings to be said again to a printer that has lost them, by what they set.
        tool: the command that selected the tool, empty for none.
        highest: greatest z at which plastic was laid.
        box: x from, y from, x to, y to of all plastic laid while moving, None before any.
        metric: whether the units are mm; else nothing here can be trusted.
        recent: the last moves that may not have been made yet, and what belongs between them.
    """

    def __init__(self, rule: Rule = "together") -> None:
        self.rule = rule
        self.stand = Stand()
        self.hotend = self.bed = self.chamber = 0.0
        self.fan = 0.0
        self.fans: dict[float, bytes] = {}
        self.mesh = b""
        self.offset: tuple[float | None, float | None] = (0.0, 0.0)
        self.sticky: dict[bytes, bytes] = {}
        self.tool = b""
        self.highest = 0.0
        self.box: tuple[float, float, float, float] | None = None
        self.metric = True
        self.recent: deque[Step] = deque(maxlen=_HISTORY)

    def follow(self, command: bytes, entry: int = -1) -> None:
        """One more command, entry `entry` of the job; -1: somebody said it, SCRIPT: the host did."""
        command = strip(command)
        word, values = parse(command)
        if word in _MOVES:
            self._move(command, values, entry)
        elif word:
            self._set(word, values, command)
            if entry >= 0 and word in _DRAINS:
                self.recent.clear()
        elif (found := _WORDS.match(command)) and found[1] in _STICKY_WORDS:
            self.sticky[found[1]] = command
        elif found and found[1] in _MESHES:
            # What was measured is kept by name at best.
            self.mesh = command if b"LOAD" in command else b"BED_MESH_PROFILE LOAD=default"
        elif command[:1] == b"T" and command[1:2].isdigit():
            self.tool = command
        if word not in _MOVES and entry != -1:
            self.recent.append(Step(entry, self.stand, self.stand, command))

    def _move(self, command: bytes, values: dict[bytes, float], entry: int) -> None:
        before = self.stand
        speed = values.get(b"F", 0.0) / 60 or before.speed
        place: list[float | None] = [before.x, before.y, before.z]
        for axis, letter in enumerate(_AXES):
            if letter in values:
                here = place[axis]
                moved = values[letter]
                place[axis] = moved if not before.relative else None if here is None else here + moved
        e = before.e
        if b"E" in values:
            e = values[b"E"] + (e if before.relative_e else 0.0)
        x, y, z = place
        pushed = e - before.e
        pulled = max(before.pulled - pushed, 0.0)
        after = replace(before, x=x, y=y, z=z, e=e, speed=speed, pulled=pulled)
        self.stand = after
        if pushed > 0.0 and z is not None and (x, y) != (before.x, before.y):
            self.highest = max(self.highest, z)
            self._grow(before)
            self._grow(after)
        self.recent.append(Step(entry, before, after, command))

    def _grow(self, stand: Stand) -> None:
        if stand.x is None or stand.y is None:
            return
        low_x, low_y, high_x, high_y = self.box or (stand.x, stand.y, stand.x, stand.y)
        if not (low_x < stand.x < high_x and low_y < stand.y < high_y):
            self.box = min(low_x, stand.x), min(low_y, stand.y), max(high_x, stand.x), max(high_y, stand.y)

    def _set(self, word: bytes, values: dict[bytes, float], command: bytes) -> None:
        stand = self.stand
        if word in {b"G90", b"G91", b"M82", b"M83"}:
            new = Counting(self.rule, stand.relative, stand.extruder).after(word.decode())
            self.stand = replace(stand, relative=new.axes, relative_e=new.e, extruder=new.extruder)
        elif word == b"G92":
            self._shift(values)
            self.stand = replace(
                stand,
                x=values.get(b"X", stand.x),
                y=values.get(b"Y", stand.y),
                z=values.get(b"Z", stand.z),
                e=values.get(b"E", stand.e),
            )
        elif word in MOVES_UNSEEN:
            # After homing all, firmware and file agree only when the file says where it goes.
            axes = [letter for letter in _AXES if letter in values or letter in command[3:].split()] or list(
                _AXES
            )
            gone = {letter.decode().lower(): None for letter in (axes if word == b"G28" else _AXES)}
            self.stand = replace(stand, **gone)  # type: ignore[arg-type]
            if word == b"G28":
                x, y = self.offset
                self.offset = (0.0 if b"X" in axes else x, 0.0 if b"Y" in axes else y)
            elif word == b"G29":
                self.mesh = b"M420 S1"
        elif word in {b"G10", b"G11"} and not values:
            self.stand = replace(stand, retracted=word == b"G10")
        elif word in {b"G20", b"G21"}:
            self.metric = word == b"G21"
        else:
            self._heat(word, values, command)
        if word == b"M420" and (b"S" in values or b"Z" in values):
            self.mesh = command if values.get(b"S", 1.0) else b""
        if word in _STICKY:
            self.sticky[word + b"".join(sorted(values))] = command

    def _shift(self, values: dict[bytes, float]) -> None:
        """G92: what the program calls x and y from now on."""
        here, new = (self.stand.x, self.stand.y), list(self.offset)
        for axis, letter in enumerate(_AXES[:2]):
            old, at = new[axis], here[axis]
            if letter in values:
                new[axis] = None if old is None or at is None else old + values[letter] - at
        self.offset = (new[0], new[1])

    def _heat(self, word: bytes, values: dict[bytes, float], command: bytes) -> None:
        wanted = values.get(b"S", values.get(b"R"))
        if word in {b"M104", b"M109"} and wanted is not None:
            self.hotend = wanted
        elif word in {b"M140", b"M190"} and wanted is not None:
            self.bed = wanted
        elif word in {b"M141", b"M191"} and wanted is not None:
            self.chamber = wanted
        elif word in {b"M106", b"M107"} and values.get(b"P", 0.0) == 0.0:
            self.fan = values.get(b"S", 255.0) if word == b"M106" else 0.0
        elif word in {b"M106", b"M107"}:
            self.fans[values[b"P"]] = command
