"""Find the fan speeds and temperatures that the commands of a job set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.gcode.state import MachineState
from printer_slicer.values import Struct

__all__ = ["SetPoints", "find_set_points"]

_FULL_FAN = 255.0


class SetPoints(Struct, frozen=True, eq=False):
    """Fan speeds and target temperatures after each command that changes one of them.

    Attributes:
        command: (m,) number of the command, counted from 1.
        fan: (m,) speed of the part cooling fan after the command, %.
        nozzle, bed: (m,) target temperatures after the command, °C; nozzle is that of the current tool.
    """

    command: Int
    fan: Float
    nozzle: Float
    bed: Float


def find_set_points(commands: Sequence[bytes], flavour: str) -> SetPoints:
    """Find the commands that set the fan or a temperature, and the values that they set.

    Args:
        commands: of a job, without comments.
        flavour: the printer's G-code flavour.
    """
    state = MachineState(flavour)
    rows = [(1, 0.0, 0.0, 0.0)]
    for number, command in enumerate(commands, 1):
        if command[:1] == b"G" and command[:3] != b"G10":  # a move; but G10 may set a temperature
            continue
        state.follow(command)
        now = (min(state.fan / _FULL_FAN, 1.0) * 100, state.hotend, state.bed)
        if now != rows[-1][1:]:
            rows.append((number, *now))
    table = np.array(rows)
    return SetPoints(table[:, 0].astype(np.int64), table[:, 1], table[:, 2], table[:, 3])
