"""Write programs as G-code (`writer`) and read the moves of G-code (`reader`).

Names are imported on first use: `lexer`, `commands` and `state` are plain Python and must not load numpy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.gcode.labels import LABEL_FORMATS
    from printer_slicer.gcode.moves import Moves, Timer, apply_limit_change
    from printer_slicer.gcode.reader import read_moves, read_moves_in_pieces
    from printer_slicer.gcode.writer import write_gcode

__all__ = [
    "LABEL_FORMATS",
    "Moves",
    "Timer",
    "apply_limit_change",
    "read_moves",
    "read_moves_in_pieces",
    "write_gcode",
]

_HOMES: Final = {
    "LABEL_FORMATS": "labels",
    "Moves": "moves",
    "Timer": "moves",
    "apply_limit_change": "moves",
    "read_moves_in_pieces": "reader",
    "read_moves": "reader",
    "write_gcode": "writer",
}


__getattr__ = lazy_names(__name__, _HOMES)
