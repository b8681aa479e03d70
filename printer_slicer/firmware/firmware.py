"""All that is known about one firmware, in one value."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.firmware.dialect import Dialect
    from printer_slicer.firmware.wire_dialect import WireDialect

__all__ = ["Firmware"]


def _marlin_baby_step(mm: float) -> bytes:
    return b"M290 Z%.3f" % mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Firmware:
    """One firmware.

    Attributes:
        title: as messages call it.
        dialect: its G-code.
        wire: name -> how lines are sent to it. Several, where versions read them differently; the first whose pattern
            is found in what M115 says counts.
        planner_blocks: moves it plans ahead.
        one_acceleration: printing and travelling have the same.
        ends_beyond: a move beyond the machine ends the print; others stop at the end of the axis and go on.
        moves_unhomed: moves before homing; others refuse.
        quick_stop: has M410, which throws away the planned moves.
        resume: ends a pause that the printer has begun by itself; M108 where it waits in the middle of a command.
        baby_step: shifts the nozzle by mm while it prints.
        set_z: says at which height, mm, the nozzle stands when nothing is homed; None where G92 does.
        cancel_object: says that the object of this name is not printed any further; None where the host leaves it out.
        prusaslicer: its name in the setting `gcode_flavor` of PrusaSlicer and its relatives; empty if it has none.
    """

    title: str
    dialect: Dialect
    wire: Mapping[str, WireDialect]
    planner_blocks: int
    one_acceleration: bool = False
    ends_beyond: bool = False
    moves_unhomed: bool = True
    quick_stop: bool = False
    resume: bytes = b"M108"
    baby_step: Callable[[float], bytes] = _marlin_baby_step
    set_z: Callable[[float], bytes] | None = None
    cancel_object: Callable[[str], bytes] | None = None
    prusaslicer: str = ""
