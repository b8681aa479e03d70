"""Read the extrusions in G-code of any slicer; comments give their roles and heights."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.gcode import Moves, read_moves
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.inspection.coverage.contours import mark_contoured
from printer_slicer.inspection.coverage.extrusions import Extrusions, extrusions_of_moves
from printer_slicer.inspection.deposition.marks import Purpose, purpose_of
from printer_slicer.values import Struct, field, force_setattr, replace

__all__ = ["GcodeExtrusions", "extrusions_and_moves_of_gcode", "extrusions_of_gcode"]

USUAL_DIAMETER: Final = 1.75
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
_COMMENT: Final = re.compile(
    rb"^[ \t]*;[ \t]*(TYPE|FEATURE|HEIGHT|LAYER_HEIGHT|LAYER_CHANGE|CHANGE_LAYER|LAYER|Z|Z_HEIGHT)\b[: \t]*([^\r\n]*)",
    re.MULTILINE,
)
_SETTING: Final = re.compile(rb"^;[ \t]*([A-Za-z][\w.]*)[ \t]*=[ \t]*([^\r\n]*)", re.MULTILINE)
_DIAMETER_KEYS: Final = ("filament_diameter", "material.filament_diameter", "material_diameter")
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_LAYER_KEYS: Final = (b"LAYER_CHANGE", b"CHANGE_LAYER", b"LAYER")
_TYPE_KEYS: Final = (b"TYPE", b"FEATURE")
_HEIGHT_KEYS: Final = (b"HEIGHT", b"LAYER_HEIGHT")
_Z_KEYS: Final = (b"Z", b"Z_HEIGHT")


class GcodeExtrusions(Struct, frozen=True, eq=False):
    """The extrusions of a G-code text, with the information from its comments.

    Attributes:
        beads: the extrusions; heights come from comments and are nan without one.
        layer_comments: (B,) number of layer comments before each extrusion; 0 without such comments.
        name: (B,) index into `names`.
        names: role names as the comments write them; the first is empty, for extrusions without a role.
        travel: (T, 2, 2) mm, start and end of each travel move along x or y.
        before: (T,) index of the extrusion after each travel move; the number of extrusions after the last one.
        standing: mm³ extruded while x and y stand still.
        diameter: filament diameter of each tool, mm.
        diameter_known: whether the text or the caller gives the diameter.
        settings: values of comments of the form `key = value`.
    """

    beads: Extrusions
    layer_comments: Int
    name: Int
    names: tuple[str, ...]
    travel: Float
    before: Int
    standing: float
    diameter: Float
    diameter_known: bool
    settings: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("layer_comments", "name"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.int64, (self.beads.n_beads,)))
        force_setattr(self, "travel", frozen_array(self.travel, np.float64, (-1, 2, 2)))
        force_setattr(self, "before", frozen_array(self.before, np.int64, (len(self.travel),)))
        force_setattr(self, "diameter", frozen_array(self.diameter, np.float64, (-1,)))


def extrusions_of_gcode(text: bytes, *, filament_diameter: float | None = None) -> GcodeExtrusions:
    """Return the extrusions of a G-code text.

    Args:
        text: G-code of any slicer.
        filament_diameter: mm; None takes the value in the text, or 1.75.
    """
    return extrusions_and_moves_of_gcode(text, filament_diameter=filament_diameter)[0]


def extrusions_and_moves_of_gcode(
    text: bytes, *, filament_diameter: float | None = None
) -> tuple[GcodeExtrusions, Moves, Int]:
    """Return the extrusions of a G-code text, all its moves, and the index (B,) of the move of each extrusion.

    Args:
        text: G-code of any slicer.
        filament_diameter: mm; None takes the value in the text, or 1.75.
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
    diameter, known = _filament_diameters(settings, filament_diameter)
    if settings.get("use_volumetric_e", "0") == "1" and not any(
        b"200" in one[:6] and parse(one)[0] == b"M200" for one in commands
    ):
        # Volumetric E was set on the printer before, or a start macro sets it.
        commands, numbers = [b"M200 D%f" % diameter[0], *commands], [0, *numbers]
    moves = read_moves(commands)
    beads, kept, standing = extrusions_of_moves(moves, diameter)
    line = np.array(numbers, np.int64)[beads.line]
    comments = _read_comments(text, line)
    travel, before = _find_travels(moves, kept)
    beads = replace(beads, line=line, purpose=comments.purpose, height=comments.height)
    extrusions = GcodeExtrusions(
        beads=mark_contoured(beads, comments.layer_comments, comments.z),
        layer_comments=comments.layer_comments,
        name=comments.name,
        names=comments.names,
        travel=travel,
        before=before,
        standing=standing,
        diameter=diameter,
        diameter_known=known,
        settings=settings,
    )
    return extrusions, moves, kept


def _find_travels(moves: Moves, extruding: Int) -> tuple[Float, Int]:
    """Return the travel moves along x or y (T, 2, 2), mm, and how many extrusions precede each (T,)."""
    travels = (moves.delta[:, :2] != 0).any(axis=1)
    travels[extruding] = False
    index = np.flatnonzero(travels)
    end = moves.end[index, :2]
    return np.stack([end - moves.delta[index, :2], end], axis=1), np.searchsorted(extruding, index)


def _filament_diameters(settings: Mapping[str, str], given: float | None) -> tuple[Float, bool]:
    """Return the filament diameter of each tool, mm, and whether it is known."""
    if given is not None:
        return np.array([given]), True
    for key in _DIAMETER_KEYS:
        found = [float(number) for number in _NUMBER.findall(settings.get(key, ""))]
        if found and all(0.5 < one < 10 for one in found):
            return np.array(found), True
    return np.array([USUAL_DIAMETER]), False


class _Comments(Struct, frozen=True):
    """What comments say about each extrusion: purpose, role name, height, number of layer comments, and z of its layer.

    The heights are nan if no comment gives one.
    """

    purpose: Int
    name: Int
    names: tuple[str, ...]
    height: Float
    layer_comments: Int
    z: Float


def _read_comments(text: bytes, line: Int) -> _Comments:
    """Read what the comments before the lines (B,) of extrusions say about them."""
    breaks = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    comments = list(_COMMENT.finditer(text))
    place = np.searchsorted(breaks, np.array([comment.start() for comment in comments], np.int64)) + 1
    kinds = [comment[1] for comment in comments]

    def find_latest(keys: tuple[bytes, ...]) -> tuple[Int, list[str]]:
        """Return the number, from 1, of the last comment with a key before each line, and all the texts."""
        of_kind = [i for i, kind in enumerate(kinds) if kind in keys]
        texts = [comments[i][2].decode("utf-8", "replace").strip() for i in of_kind]
        return np.searchsorted(place[of_kind], line), texts

    which, texts = find_latest(_TYPE_KEYS)
    names = ("", *dict.fromkeys(texts))
    number = {name: i for i, name in enumerate(names)}
    name = np.array([0, *map(number.__getitem__, texts)], np.int64)[which]
    purpose = np.array([Purpose.UNKNOWN, *map(purpose_of, names[1:])], np.int64)[name]
    which, texts = find_latest(_HEIGHT_KEYS)
    height = np.array([np.nan, *map(_parse_height, texts)])[which]
    layer_comments = find_latest(_LAYER_KEYS)[0]
    which, texts = find_latest(_Z_KEYS)
    z = np.array([np.nan, *map(_parse_height, texts)])[which]
    # Extrusion before the first layer primes the nozzle.
    if layer_comments.max(initial=0):
        purpose[layer_comments == 0] = Purpose.CUSTOM
    return _Comments(purpose, name, names, height, layer_comments, z)


def _parse_height(text: str) -> float:
    """Parse a height, mm; nan if invalid."""
    found = _NUMBER.match(text)
    return float(found[0]) if found else np.nan
