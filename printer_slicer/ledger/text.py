"""G-code text of any slicer -> beads: moves by the reader, purposes and heights by comments where there are any."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from printer_slicer.gcode import read_moves
from printer_slicer.geometry import Float, Int, frozen_array
from printer_slicer.ledger.beads import Beads, Purpose, beads_of_moves
from printer_slicer.stream.framing import strip

__all__ = ["Deposit", "beads_of_gcode"]

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

# What slicers call their beads, in small letters with blanks; the first that the name begins with counts.
# PrusaSlicer and SuperSlicer; OrcaSlicer and Bambu Studio; CuraEngine.
_NAMES: Final = (
    ("external perimeter", Purpose.OUTER_PERIMETER),
    ("outer wall", Purpose.OUTER_PERIMETER),
    ("wall outer", Purpose.OUTER_PERIMETER),
    ("overhang", Purpose.OVERHANG),
    ("perimeter", Purpose.INNER_PERIMETER),
    ("inner wall", Purpose.INNER_PERIMETER),
    ("wall inner", Purpose.INNER_PERIMETER),
    ("internal infill", Purpose.SPARSE),
    ("sparse infill", Purpose.SPARSE),
    ("internal bridge", Purpose.BRIDGE),
    ("bridge", Purpose.BRIDGE),
    ("gap", Purpose.GAP),
    ("thin wall", Purpose.GAP),
    ("ironing", Purpose.IRONING),
    ("solid infill", Purpose.SKIN),
    ("internal solid infill", Purpose.SKIN),
    ("top", Purpose.SKIN),
    ("bottom", Purpose.SKIN),
    ("skin", Purpose.SKIN),
    ("fill", Purpose.SPARSE),
    ("support", Purpose.SUPPORT),
    ("skirt", Purpose.BESIDE),
    ("brim", Purpose.BESIDE),
    ("prime", Purpose.BESIDE),
    ("wipe", Purpose.BESIDE),
    ("custom", Purpose.BESIDE),
)


@dataclass(frozen=True, slots=True, eq=False)
class Deposit:
    """What a G-code text lays.

    Attributes:
        beads: heights are those of comments, nan where there are none.
        turn: (B,) how many layer comments stand before each bead; all 0 where there are none.
        standing: mm³ laid while x and y stand still.
        diameter: of the filament, mm; one for each tool.
        diameter_known: whether the text says so, or the caller did.
        settings: what stands in comments as `key = value`.
    """

    beads: Beads
    turn: Int
    standing: float
    diameter: Float
    diameter_known: bool
    settings: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "turn", frozen_array(self.turn, np.int64, (self.beads.n_beads,)))
        object.__setattr__(self, "diameter", frozen_array(self.diameter, np.float64, (-1,)))


def beads_of_gcode(text: bytes, *, filament_diameter: float | None = None) -> Deposit:
    """The beads of a G-code text.

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
    if settings.get("use_volumetric_e", "0") == "1" and not any(one.startswith(b"M200") for one in commands):
        # The printer was told before, or is, by a start macro.
        commands, numbers = [b"M200 D%f" % diameter[0], *commands], [0, *numbers]
    beads, _, standing = beads_of_moves(read_moves(commands), diameter)
    line = np.array(numbers, np.int64)[beads.line]
    purpose, height, turn = _noted(text, line)
    return Deposit(
        replace(beads, line=line, purpose=purpose, height=height), turn, standing, diameter, known, settings
    )


def _diameter(settings: Mapping[str, str], given: float | None) -> tuple[Float, bool]:
    """The diameter for each tool, mm, and whether anybody said it."""
    if given is not None:
        return np.array([given]), True
    for key in _DIAMETERS:
        found = [float(number) for number in _NUMBER.findall(settings.get(key, ""))]
        if found and all(0.5 < one < 10 for one in found):
            return np.array(found), True
    return np.array([USUAL_DIAMETER]), False


def _noted(text: bytes, line: Int) -> tuple[Int, Float, Int]:
    """Purpose, height (mm or nan) and number of layer comments before each bead, from the comments before its line."""
    breaks = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    notes = list(_NOTE.finditer(text))
    place = np.searchsorted(breaks, np.array([note.start() for note in notes], np.int64)) + 1
    kinds = [note[1] for note in notes]

    def latest(wanted: tuple[bytes, ...], read: Callable[[str], float], before: float) -> Float:
        """What the last comment of the `wanted` kinds says before each bead; `before` where there is none yet."""
        of_kind = [i for i, kind in enumerate(kinds) if kind in wanted]
        values = [before, *(read(notes[i][2].decode("utf-8", "replace")) for i in of_kind)]
        return np.array(values, np.float64)[np.searchsorted(place[of_kind], line)]

    turn = np.searchsorted(place[[i for i, kind in enumerate(kinds) if kind in _LAYERS]], line)
    purpose = latest(_TYPES, _purpose, Purpose.UNKNOWN).astype(np.int64)
    height = latest(_HEIGHTS, _height, np.nan)
    # What is laid before the first layer primes the nozzle.
    if turn.max(initial=0):
        purpose[turn == 0] = Purpose.BESIDE
    return purpose, height, turn


def _purpose(name: str) -> float:
    """What a slicer's name for a bead means."""
    plain = re.sub(r"[\W_]+", " ", name.lower()).strip()
    return next((purpose for begin, purpose in _NAMES if plain.startswith(begin)), Purpose.UNKNOWN)


def _height(text: str) -> float:
    """Mm, or nan."""
    found = _NUMBER.match(text.strip())
    return float(found[0]) if found else np.nan
