"""Read the extrusions of G-code of any slicer, with roles and heights from its comments."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.gcode import Moves, read_moves
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.inspection.coverage.extrusions import Extrusions, extrusions_of_moves
from printer_slicer.inspection.deposition.marks import Purpose, purpose_of

__all__ = ["GcodeExtrusions", "extrusions_of_gcode"]

USUAL_DIAMETER: Final = 1.75
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
_NOTE: Final = re.compile(
    rb"^[ \t]*;[ \t]*(TYPE|FEATURE|HEIGHT|LAYER_HEIGHT|LAYER_CHANGE|CHANGE_LAYER|LAYER)\b[: \t]*([^\r\n]*)",
    re.MULTILINE,
)
_SETTING: Final = re.compile(rb"^;[ \t]*([A-Za-z][\w.]*)[ \t]*=[ \t]*([^\r\n]*)", re.MULTILINE)
_DIAMETERS: Final = ("filament_diameter", "material.filament_diameter", "material_diameter")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_LAYERS: Final = (b"LAYER_CHANGE", b"CHANGE_LAYER", b"LAYER")
_TYPES: Final = (b"TYPE", b"FEATURE")
_HEIGHTS: Final = (b"HEIGHT", b"LAYER_HEIGHT")


@dataclass(frozen=True, slots=True, eq=False)
class GcodeExtrusions:
    """The extrusions of a G-code text.

    Attributes:
        beads: heights are those of comments, nan where there are none.
        turn: (B,) how many layer comments stand before each bead; all 0 where there are none.
        name: (B,) index into `names`.
        names: what comments call beads, as they are written; the first is empty, for beads that none speaks of.
        travel: (T, 2, 2) mm, from where to where the nozzle goes along x or y and lays nothing.
        before: (T,) the bead that follows each of these; the number of beads after the last one.
        standing: mm³ laid while x and y stand still.
        diameter: of the filament, mm; one for each tool.
        diameter_known: whether the text says so, or the caller did.
        settings: what stands in comments as `key = value`.
    """

    beads: Extrusions
    turn: Int
    name: Int
    names: tuple[str, ...]
    travel: Float
    before: Int
    standing: float
    diameter: Float
    diameter_known: bool
    settings: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("turn", "name"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.int64, (self.beads.n_beads,)))
        object.__setattr__(self, "travel", frozen_array(self.travel, np.float64, (-1, 2, 2)))
        object.__setattr__(self, "before", frozen_array(self.before, np.int64, (len(self.travel),)))
        object.__setattr__(self, "diameter", frozen_array(self.diameter, np.float64, (-1,)))


def extrusions_of_gcode(text: bytes, *, filament_diameter: float | None = None) -> GcodeExtrusions:
    """Return the extrusions of a G-code text.

    Args:
        text: of any slicer.
        filament_diameter: mm; None takes what the text says, else 1.75.
    """
    text = text.removeprefix(_BYTE_ORDER_MARK)
    commands, numbers = [], []
    for number, row in enumerate(text.split(b"\n"), 1):
        command = strip(row)
        if command:
            commands.append(command)
            numbers.append(number)
    settings = {
        key.decode(): value.decode("utf-8", "replace").strip() for key, value in _SETTING.findall(text)
    }
    diameter, known = _diameter(settings, filament_diameter)
    if settings.get("use_volumetric_e", "0") == "1" and not any(
        b"200" in one[:6] and parse(one)[0] == b"M200" for one in commands
    ):
        # The printer was told before, or is, by a start macro.
        commands, numbers = [b"M200 D%f" % diameter[0], *commands], [0, *numbers]
    moves = read_moves(commands)
    beads, kept, standing = extrusions_of_moves(moves, diameter)
    line = np.array(numbers, np.int64)[beads.line]
    notes = _read_comments(text, line)
    travel, before = _travels(moves, kept)
    return GcodeExtrusions(
        beads=replace(beads, line=line, purpose=notes.purpose, height=notes.height),
        turn=notes.turn,
        name=notes.name,
        names=notes.names,
        travel=travel,
        before=before,
        standing=standing,
        diameter=diameter,
        diameter_known=known,
        settings=settings,
    )


def _travels(moves: Moves, laying: Int) -> tuple[Float, Int]:
    """Return travel moves along x or y, and the number of extrusions before each."""
    goes = (moves.delta[:, :2] != 0).any(axis=1)
    goes[laying] = False
    index = np.flatnonzero(goes)
    end = moves.end[index, :2]
    return np.stack([end - moves.delta[index, :2], end], axis=1), np.searchsorted(laying, index)


def _diameter(settings: Mapping[str, str], given: float | None) -> tuple[Float, bool]:
    """Return the filament diameter of each tool, mm, and whether it is known."""
    if given is not None:
        return np.array([given]), True
    for key in _DIAMETERS:
        found = [float(number) for number in _NUMBER.findall(settings.get(key, ""))]
        if found and all(0.5 < one < 10 for one in found):
            return np.array(found), True
    return np.array([USUAL_DIAMETER]), False


@dataclass(frozen=True, slots=True)
class _Notes:
    """Comments before each extrusion: purpose, name, height (mm or nan), and number of layer comments."""

    purpose: Int
    name: Int
    names: tuple[str, ...]
    height: Float
    turn: Int


def _read_comments(text: bytes, line: Int) -> _Notes:
    """Read the comments before the lines (B,) of extrusions."""
    breaks = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    notes = list(_NOTE.finditer(text))
    place = np.searchsorted(breaks, np.array([note.start() for note in notes], np.int64)) + 1
    kinds = [note[1] for note in notes]

    def latest(wanted: tuple[bytes, ...]) -> tuple[Int, list[str]]:
        """Return the last comment of some kinds before each line, counted from 1, and the texts."""
        of_kind = [i for i, kind in enumerate(kinds) if kind in wanted]
        said = [notes[i][2].decode("utf-8", "replace").strip() for i in of_kind]
        return np.searchsorted(place[of_kind], line), said

    which, said = latest(_TYPES)
    names = ("", *dict.fromkeys(said))
    number = {name: i for i, name in enumerate(names)}
    name = np.array([0, *map(number.__getitem__, said)], np.int64)[which]
    purpose = np.array([Purpose.UNKNOWN, *map(purpose_of, names[1:])], np.int64)[name]
    which, said = latest(_HEIGHTS)
    height = np.array([np.nan, *map(_height, said)])[which]
    turn = latest(_LAYERS)[0]
    # What is laid before the first layer primes the nozzle.
    if turn.max(initial=0):
        purpose[turn == 0] = Purpose.CUSTOM
    return _Notes(purpose, name, names, height, turn)


def _height(text: str) -> float:
    """Parse a height, mm; nan if invalid."""
    found = _NUMBER.match(text)
    return float(found[0]) if found else np.nan
