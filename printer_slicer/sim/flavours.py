"""Commands that other firmwares than Marlin 2 have, or by which they mean something else.

The simulated printer speaks as Marlin does and moves as its profile says; these tables let it understand files that
were written for another firmware. Sources are named where such files are written.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.answers import limit_accelerations, nothing, positive
from printer_slicer.sim.heating import tool_target, wait_for_all
from printer_slicer.sim.klipper import unparsed
from printer_slicer.sim.machine import AXES, replaced
from printer_slicer.sim.moves import (
    firmware_retraction,
    line,
    line_of_zeros,
    machine_move,
    offset_next_homing,
    probe,
)
from printer_slicer.sim.pausing import ask_person

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.words import Command

__all__ = ["FLAVOURS"]

_MINUTE: Final = 60.0


def _velocity_limit(board: Board, command: Command) -> None:
    """Klipper's SET_VELOCITY_LIMIT: the acceleration of all moves."""
    value = command.setting("ACCEL")
    limit_accelerations(board, value, value, value)


def _retraction(board: Board, command: Command) -> None:
    """Klipper's SET_RETRACTION."""
    names = ("RETRACT_LENGTH", "RETRACT_SPEED", "UNRETRACT_SPEED", "UNRETRACT_EXTRA_LENGTH")
    new = zip((command.setting(name) for name in names), board.retraction, strict=True)
    length, back, forward, extra = (old if value is None else value for value, old in new)
    board.retraction = length, back, forward, extra


def _speeds_per_minute(board: Board, command: Command) -> None:
    """RepRapFirmware's M203."""
    new = {axis: value / _MINUTE for axis, value in positive(command, AXES).items()}
    board.set_limits(replace(board.limits, max_speed=replaced(board.limits.max_speed, new)))


def _jerks_per_minute(board: Board, command: Command) -> None:
    """RepRapFirmware's M566."""
    new = {axis: value / _MINUTE for axis, value in positive(command, AXES).items()}
    board.set_limits(replace(board.limits, jerk=replaced(board.limits.jerk, new)))


def _print_acceleration(board: Board, command: Command) -> None:
    """Repetier's M201."""
    limit_accelerations(board, printing=min(positive(command, "XY").values(), default=None))


def _travel_acceleration(board: Board, command: Command) -> None:
    """Repetier's M202."""
    limit_accelerations(board, travel=min(positive(command, "XY").values(), default=None))


def _jerks(board: Board, command: Command) -> None:
    """Repetier's M207: X counts for Y too."""
    new = positive(command, AXES)
    new |= {"Y": new["X"]} if "X" in new else {}
    board.set_limits(replace(board.limits, jerk=replaced(board.limits.jerk, new)))


def _accelerations(board: Board, command: Command) -> None:
    """Smoothie's M204: S of all moves, E of the extruder alone."""
    new = positive(command, "SE")
    limit_accelerations(board, new.get("S"), new.get("S"), new.get("E"))


def _junction_deviation(board: Board, command: Command) -> None:
    """Smoothie's M205."""
    deviation = positive(command, "X").get("X", board.limits.junction_deviation)
    board.set_limits(replace(board.limits, junction_deviation=deviation))


def _retraction_or_tool(board: Board, command: Command) -> Steps | None:
    """G10: with a tool its temperature (Duet3D's G-code dictionary, "G10"), else it retracts."""
    if command.value("P") is None:
        return firmware_retraction(board, command)
    tool_target(board, command)
    return None


def _parsed_line(board: Board, command: Command) -> Steps | None:
    """Klipper's G0 and G1."""
    return None if unparsed(board, command) else line(board, command)


FLAVOURS: Final[dict[str, dict[str, Callable[[Board, Command], Steps | None]]]] = {
    "marlin": {},
    "marlin_legacy": {},
    "prusa": {
        "G0": line_of_zeros,
        "G1": line_of_zeros,
        "G80": probe,
        "M403": nothing,  # the kind of filament, told to the MMU
        "M862.1": nothing,  # nozzle, model, firmware: whether the file is for this printer
        "M862.2": nothing,
        "M862.3": nothing,
        "M862.4": nothing,
        "M862.5": nothing,
        "M862.6": nothing,
        "M907": nothing,
    },
    "klipper": {
        "G0": _parsed_line,
        "G1": _parsed_line,
        "M200": lambda board, command: board.unknown(command.text),
        "PAUSE": ask_person,
        "SET_RETRACTION": _retraction,
        "SET_VELOCITY_LIMIT": _velocity_limit,
    },
    "reprapfirmware": {
        "G10": _retraction_or_tool,
        "G53": machine_move,
        "M116": wait_for_all,
        "M203": _speeds_per_minute,
        "M226": ask_person,
        "M566": _jerks_per_minute,
        "M568": tool_target,
        "M572": nothing,
    },
    "repetier": {
        "G0": line_of_zeros,
        "G1": line_of_zeros,
        "@pause": ask_person,
        "M201": _print_acceleration,
        "M202": _travel_acceleration,
        "M203": nothing,
        "M204": nothing,
        "M205": nothing,
        "M206": nothing,
        "M207": _jerks,
        "M208": nothing,
    },
    "smoothie": {
        "G0": line_of_zeros,
        "G1": line_of_zeros,
        "M204": _accelerations,
        "M205": _junction_deviation,
        "G53": machine_move,
        "M206": offset_next_homing,
    },
}
