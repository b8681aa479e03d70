"""Where the moves of one thing on the plate begin and end, so that it can be given up while the others are printed.

A printer that gives a thing up passes over everything between the two marks. So both stand where the filament is pulled
back and the nozzle lifted, or both where it is not; behind each the first row says x, y, z and speed anew, and where E
counts from the beginning, what it stands at.

Sources: OctoPrint's Cancel Objects and PrusaSlicer (`; printing object`); Duet3D's and Marlin's M486; Klipper's
[exclude_object].
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, run_starts
from printer_slicer.firmware import Dialect
from printer_slicer.gcode.rows import E_DECIMALS, MoveText
from printer_slicer.model import Labels, Program
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.texts import number

__all__ = [
    "LABEL_WORDS",
    "LabelWords",
    "Marking",
    "ObjectMark",
    "definitions",
    "for_all",
    "fresh_rows",
    "marking",
    "marks_of",
    "start_notes",
    "stop_notes",
]


@dataclass(frozen=True, slots=True)
class LabelWords:
    """How things are named.

    Attributes:
        define: all of them, before the first move: names and boxes (O, 2, 2) from above.
        start: number, name, and whether it is the first time.
        stop: number and name.
    """

    define: Callable[[tuple[str, ...], Float], list[str]]
    start: Callable[[int, str, bool], list[str]]
    stop: Callable[[int, str], list[str]]


def _klipper_definitions(names: tuple[str, ...], boxes: Float) -> list[str]:
    """Without outlines: with them lines would be longer than some hosts send."""
    middles = boxes.mean(axis=1).tolist()
    return [
        f"EXCLUDE_OBJECT_DEFINE NAME={name} CENTER={number(round(x, 1))},{number(round(y, 1))}"
        for name, (x, y) in zip(names, middles, strict=True)
    ]


LABEL_WORDS: Final[Mapping[str, LabelWords]] = {
    "octoprint": LabelWords(
        define=lambda _names, _boxes: [],
        start=lambda index, name, _new: [f"; printing object {name} id:{index} copy 0"],
        stop=lambda index, name: [f"; stop printing object {name} id:{index} copy 0"],
    ),
    "m486": LabelWords(
        define=lambda names, _boxes: [f"M486 T{len(names)}"],
        start=lambda index, name, new: [f"M486 S{index}", *([f"M486 A{name}"] if new else [])],
        stop=lambda _index, _name: ["M486 S-1"],
    ),
    "m486_quoted": LabelWords(
        define=lambda names, _boxes: [f"M486 T{len(names)}"],
        start=lambda index, name, new: [f"M486 S{index}" + (f' A"{name}"' if new else "")],
        stop=lambda _index, _name: ["M486 S-1"],
    ),
    "exclude_object": LabelWords(
        define=_klipper_definitions,
        start=lambda _index, name, _new: [f"EXCLUDE_OBJECT_START NAME={name}"],
        stop=lambda _index, name: [f"EXCLUDE_OBJECT_END NAME={name}"],
    ),
}


Marking = tuple[Labels, LabelWords]
"""What is marked, and how."""


def marking(profile: Profile, dialect: Dialect, labels: Labels | None) -> Marking | None:
    """How a file marks the things on the plate; None where there is but one, or nobody wants to know."""
    asked = profile.printer.labels
    if labels is None or asked == "none":
        return None
    return labels, LABEL_WORDS[{"auto": dialect.labels, "m486": dialect.m486}.get(asked, asked)]


def definitions(marks: Marking | None) -> list[str]:
    """What stands before the first move."""
    return marks[1].define(marks[0].names, marks[0].boxes) if marks else []


@dataclass(frozen=True, slots=True)
class ObjectMark:
    """Before move `index` thing `stop` ends and thing `start` begins; -1: none.

    The beads of the one end before move `after`, those of the other begin with move `until`.
    """

    index: int
    stop: int
    start: int
    after: int
    until: int


def marks_of(program: Program, labels: Labels) -> list[ObjectMark]:
    """All changes from thing to thing, and at every layer."""
    beads = np.flatnonzero(program.role != Role.TRAVEL)
    item, layer = labels.object_id[beads], program.layer[beads]
    new = (np.diff(item, prepend=-1) != 0) | (run_starts(layer) & (item >= 0))
    change = np.flatnonzero(new)
    begins = beads[change]
    ends = np.where(change > 0, beads[np.maximum(change - 1, 0)] + 1, 0)
    before = np.where(change > 0, item[np.maximum(change - 1, 0)], -1)
    marks = [
        ObjectMark(_between(program, int(end), int(begin)), int(stop), int(start), int(end), int(begin))
        for end, begin, stop, start in zip(ends, begins, before, item[change], strict=True)
    ]
    if len(item) and item[-1] >= 0:
        last = int(beads[-1]) + 1
        end = program.n_moves
        marks.append(ObjectMark(_between(program, last, end), int(item[-1]), -1, last, end))
    return marks


def _between(program: Program, end: int, begin: int) -> int:
    """The move of a gap (from `end`, to before `begin`) before which a mark stands: behind retraction and lift."""
    pulled = np.flatnonzero(program.filament[end:begin] < 0)
    if not len(pulled):
        return end
    place = end + int(pulled[-1]) + 1
    while place < begin and _lifts(program, place):
        place += 1
    return place


def _lifts(program: Program, move: int) -> bool:
    """Whether a move only goes up."""
    way = program.xyz[move] - program.xyz[move - 1]
    return bool(way[2] > 0 and (way[:2] == 0).all() and program.filament[move] == 0)


def fresh_rows(marks: list[ObjectMark]) -> Int:
    """The moves whose rows must say everything."""
    return np.array(sorted({mark.index for mark in marks}), np.int64)


def stop_notes(
    marks: list[ObjectMark], marked: Marking, rows: MoveText, *, relative: bool
) -> Iterator[tuple[int, list[str]]]:
    """Where things end; where E counts from the beginning, what it stands at behind a thing given up."""
    labels, words = marked
    for mark in marks:
        if mark.stop < 0:
            continue
        lines = words.stop(mark.stop, labels.names[mark.stop])
        if not relative:
            lines = [*lines, f"G92 E{number(float(rows.fed[mark.index - 1]) / 10**E_DECIMALS)}"]
        yield mark.index, lines


def start_notes(marks: list[ObjectMark], marked: Marking) -> Iterator[tuple[int, list[str]]]:
    """Where things begin."""
    labels, words = marked
    seen: set[int] = set()
    for mark in marks:
        if mark.start >= 0:
            yield mark.index, words.start(mark.start, labels.names[mark.start], mark.start not in seen)
            seen.add(mark.start)


def for_all(
    notes: Iterator[tuple[int, list[str]]], marks: list[ObjectMark]
) -> Iterator[tuple[int, list[str]]]:
    """Notes that concern everything, put between the marks of two things: they hold if either is given up."""
    ends = [mark.after for mark in marks]
    for index, lines in notes:
        nth = bisect_right(ends, index) - 1
        held = nth >= 0 and index <= marks[nth].until
        yield marks[nth].index if held else index, lines
