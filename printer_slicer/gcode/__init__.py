"""G-code: program -> text in `writer`, text -> moves in `reader`.

Names are imported when they are first used: `lexer`, `commands` and `state` are plain Python, and whoever needs only
them does not wait for numpy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.gcode.labels import LABEL_WORDS
    from printer_slicer.gcode.moves import Moves, Timer, changed_limits
    from printer_slicer.gcode.reader import pieces_of, read_moves
    from printer_slicer.gcode.writer import write_gcode

__all__ = [
    "LABEL_WORDS",
    "Moves",
    "Timer",
    "changed_limits",
    "pieces_of",
    "read_moves",
    "write_gcode",
]

_HOMES: Final = {
    "LABEL_WORDS": "labels",
    "Moves": "moves",
    "Timer": "moves",
    "changed_limits": "moves",
    "pieces_of": "reader",
    "read_moves": "reader",
    "write_gcode": "writer",
}


__getattr__ = lazy_names(__name__, _HOMES)
