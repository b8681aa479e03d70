"""Label the moves of each object, so that one object can be cancelled while the others are printed.

A printer that cancels an object skips everything between its start and stop labels. So the filament must be retracted
and the nozzle lifted at both labels, or at neither. The first row after each label repeats x, y, z and speed; with
absolute extrusion, G92 sets E.

Sources: OctoPrint's Cancel Objects and PrusaSlicer (`; printing object`); Duet3D's and Marlin's M486; Klipper's
[exclude_object].
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, run_starts
from printer_slicer.firmware import Dialect
from printer_slicer.gcode.move_text import E_DECIMALS, RowPlan
from printer_slicer.model import Labels, Program
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.texts import format_number
from printer_slicer.values import Struct

__all__ = [
    "LABEL_FORMATS",
    "LabelFormat",
    "Marking",
    "ObjectMark",
    "choose_marking",
    "find_moves_after_labels",
    "find_object_changes",
    "format_object_definitions",
    "format_start_labels",
    "format_stop_labels",
    "move_lines_outside_objects",
]


class LabelFormat(Struct, frozen=True):
    """A format of object labels.

    Attributes:
        define: formats the lines before the first move that define all objects, from the names and the bounding boxes
            (O, 2, 2) in x and y.
        start: formats a start label, from the object's number and name, and whether it is the object's first label.
        stop: formats a stop label, from the object's number and name.
    """

    define: Callable[[tuple[str, ...], Float], list[str]]
    start: Callable[[int, str, bool], list[str]]
    stop: Callable[[int, str], list[str]]


def _format_klipper_definitions(names: tuple[str, ...], boxes: Float) -> list[str]:
    """Format EXCLUDE_OBJECT_DEFINE without outlines: with them, lines are too long for some hosts."""
    middles = boxes.mean(axis=1).tolist()
    return [
        f"EXCLUDE_OBJECT_DEFINE NAME={name} CENTER={format_number(round(x, 1))},{format_number(round(y, 1))}"
        for name, (x, y) in zip(names, middles, strict=True)
    ]


LABEL_FORMATS: Final[Mapping[str, LabelFormat]] = {
    "octoprint": LabelFormat(
        define=lambda _names, _boxes: [],
        start=lambda index, name, _new: [f"; printing object {name} id:{index} copy 0"],
        stop=lambda index, name: [f"; stop printing object {name} id:{index} copy 0"],
    ),
    "m486": LabelFormat(
        define=lambda names, _boxes: [f"M486 T{len(names)}"],
        start=lambda index, name, new: [f"M486 S{index}", *([f"M486 A{name}"] if new else [])],
        stop=lambda _index, _name: ["M486 S-1"],
    ),
    "m486_quoted": LabelFormat(
        define=lambda names, _boxes: [f"M486 T{len(names)}"],
        start=lambda index, name, new: [f"M486 S{index}" + (f' A"{name}"' if new else "")],
        stop=lambda _index, _name: ["M486 S-1"],
    ),
    "exclude_object": LabelFormat(
        define=_format_klipper_definitions,
        start=lambda _index, name, _new: [f"EXCLUDE_OBJECT_START NAME={name}"],
        stop=lambda _index, name: [f"EXCLUDE_OBJECT_END NAME={name}"],
    ),
}


Marking = tuple[Labels, LabelFormat]
"""Labelled objects and the label format."""


def choose_marking(profile: Profile, dialect: Dialect, labels: Labels | None) -> Marking | None:
    """Choose how a file labels its objects; None for a single object or `labels = none`."""
    asked = profile.printer.labels
    if labels is None or asked == "none":
        return None
    return labels, LABEL_FORMATS[{"auto": dialect.labels, "m486": dialect.m486}.get(asked, asked)]


def format_object_definitions(marks: Marking | None) -> list[str]:
    """Format the lines before the first move that define all objects; empty without labels."""
    return marks[1].define(marks[0].names, marks[0].boxes) if marks else []


class ObjectMark(Struct, frozen=True):
    """The labels before move `index`: object `stop` ends and object `start` begins there; -1: no object.

    The extrusions of object `stop` end before move `after`. The extrusions of object `start` begin with move `until`.
    """

    index: int
    stop: int
    start: int
    after: int
    until: int


def find_object_changes(program: Program, labels: Labels) -> list[ObjectMark]:
    """Find all changes from one object to the next; an object that continues on the next layer starts again there."""
    beads = np.flatnonzero(program.role != Role.TRAVEL)
    item, layer = labels.object_id[beads], program.layer[beads]
    new = (np.diff(item, prepend=-1) != 0) | (run_starts(layer) & (item >= 0))
    change = np.flatnonzero(new)
    begins = beads[change]
    ends = np.where(change > 0, beads[np.maximum(change - 1, 0)] + 1, 0)
    before = np.where(change > 0, item[np.maximum(change - 1, 0)], -1)
    marks = [
        ObjectMark(
            _choose_label_position(program, int(end), int(begin)), int(stop), int(start), int(end), int(begin)
        )
        for end, begin, stop, start in zip(ends, begins, before, item[change], strict=True)
    ]
    if len(item) and item[-1] >= 0:
        last = int(beads[-1]) + 1
        end = program.n_moves
        marks.append(ObjectMark(_choose_label_position(program, last, end), int(item[-1]), -1, last, end))
    return marks


def _choose_label_position(program: Program, end: int, begin: int) -> int:
    """Return the move between `end` and `begin` before which to put a label: the first after retraction and lift."""
    pulled = np.flatnonzero(program.filament[end:begin] < 0)
    if not len(pulled):
        return end
    place = end + int(pulled[-1]) + 1
    while place < begin and _is_lift(program, place):
        place += 1
    return place


def _is_lift(program: Program, move: int) -> bool:
    """Return whether a move only lifts the nozzle."""
    step = program.xyz[move] - program.xyz[move - 1]
    return bool(step[2] > 0 and (step[:2] == 0).all() and program.filament[move] == 0)


def find_moves_after_labels(marks: list[ObjectMark]) -> Int:
    """Return the indices of the first moves after labels; their rows repeat x, y, z and speed."""
    return np.array(sorted({mark.index for mark in marks}), np.int64)


def format_stop_labels(
    marks: list[ObjectMark], marked: Marking, rows: RowPlan, *, relative: bool
) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that mark the end of each object; with absolute extrusion, also G92 E.

    A printer that has skipped the object does not know E.
    """
    labels, words = marked
    for mark in marks:
        if mark.stop < 0:
            continue
        lines = words.stop(mark.stop, labels.names[mark.stop])
        if not relative:
            lines = [*lines, f"G92 E{format_number(float(rows.fed[mark.index - 1]) / 10**E_DECIMALS)}"]
        yield mark.index, lines


def format_start_labels(marks: list[ObjectMark], marked: Marking) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that mark the start of each object."""
    labels, words = marked
    seen: set[int] = set()
    for mark in marks:
        if mark.start >= 0:
            yield mark.index, words.start(mark.start, labels.names[mark.start], mark.start not in seen)
            seen.add(mark.start)


def move_lines_outside_objects(
    insertions: Iterator[tuple[int, list[str]]], marks: list[ObjectMark]
) -> Iterator[tuple[int, list[str]]]:
    """Move each insertion that lies between the extrusions of two objects to the labels between these objects.

    Such lines concern the whole plate, and must be executed even if one of the objects is cancelled.
    """
    ends = [mark.after for mark in marks]
    for index, lines in insertions:
        nth = bisect_right(ends, index) - 1
        is_between = nth >= 0 and index <= marks[nth].until
        yield marks[nth].index if is_between else index, lines
