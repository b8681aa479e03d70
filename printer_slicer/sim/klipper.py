"""Klipper as far as it is not Marlin: what it refuses, how it says so, and that it answers on when it has shut down.

Every line gets its ok, whatever became of it; what is refused is said in a line that begins with `!!`.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING, Final

from printer_slicer.sim.heating import TABLE as HEATING
from printer_slicer.sim.moves import goal_of
from printer_slicer.sim.moves import straight as go

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.motion.rules import Axes
    from printer_slicer.sim.board import Board, Steps
    from printer_slicer.sim.words import Command

__all__ = ["ANYWAY", "KNOWN", "TABLE", "refuse_shut_down", "straight", "unparsed"]

ANYWAY: Final = frozenset({"M105", "M110", "M112", "M115", "FIRMWARE_RESTART", "RESTART"})
"""What is obeyed in a shutdown too."""

KNOWN: Final = frozenset(
    (
        *(
            "G0",
            "G1",
            "G20",
            "G21",
            "G28",
            "G90",
            "G91",
            "G92",
            "M18",
            "M82",
            "M83",
            "M84",
            "M104",
            "M105",
            "M106",
            "M107",
        ),
        *("M109", "M110", "M112", "M114", "M115", "M119", "M140", "M190", "M204", "M220", "M221", "M400"),
    )
)
"""Commands that it has in common with Marlin, in the configuration that was recorded."""

RESTART_SECONDS: Final = 1.7
LONGEST_EXTRUSION: Final = 50.0
"""mm of filament without motion: its option max_extrude_only_distance."""

_SHUT_DOWN: Final = (
    "// Once the underlying issue is corrected, use the",
    '// "FIRMWARE_RESTART" command to reset the firmware, reload the',
    "// config, and restart the host software.",
    "// Printer is shutdown",
)


def refuse_shut_down(board: Board) -> None:
    """Say why nothing is done any more."""
    first = "Shutdown due to M112 command" if "M112" in board.shut_down else board.shut_down
    for line in (f"// {first}", *_SHUT_DOWN, f"!! {first}"):
        board.say(line)
    board.violated("the printer has shut down")


def straight(board: Board, words: Sequence[str | float | None]) -> Steps | None:
    """G0 and G1, refused as a whole where Marlin would make something of them."""
    if board.shut_down:
        refuse_shut_down(board)
        return None
    goal = goal_of(board, words)
    why = _out_of_reach(board, goal) or _not_to_extrude(board, goal)
    if why:
        board.say(f"!! {why}")
        option = _OPTIONS.get(why.partition(" (")[0])
        if option:
            board.say(f"// See the '{option}' config option for details")
        board.violated(why)
        return None
    return go(board, words)


_OPTIONS: Final = {
    "Extrude below minimum temp": "min_extrude_temp",
    "Extrude only move too long": "max_extrude_only_distance",
    "Move exceeds maximum extrusion": "max_extrude_cross_section",
}


def _out_of_reach(board: Board, goal: Axes) -> str:
    """Why the kinematics cannot go there; empty if they can."""
    x, y, z, e = goal
    here = f"{x:.3f} {y:.3f} {z:.3f} [{e:.3f}]"
    low, high = board.machine.box_min, board.machine.box_max
    moved = [axis for axis in range(3) if goal[axis] != board.position[axis]]
    if not all(board.homed[axis] for axis in moved):
        return f"Must home axis first: {here}"
    if not all(low[axis] <= goal[axis] <= high[axis] for axis in moved):
        return f"Move out of range: {here}"
    return ""


def _not_to_extrude(board: Board, goal: Axes) -> str:
    """Why the extruder would not turn so; empty if it would."""
    fed = (goal[3] - board.position[3]) * board.e_ratio
    if not fed:
        return ""
    if not board.hot and not board.warm_enough():
        return "Extrude below minimum temp"
    way = sqrt(sum((goal[axis] - board.position[axis]) ** 2 for axis in range(3)))
    if not way:
        longest = LONGEST_EXTRUSION
        return (
            f"Extrude only move too long ({abs(fed):.3f}mm vs {longest:.3f}mm)" if abs(fed) > longest else ""
        )
    machine = board.machine
    filament, most = pi * machine.filament_diameter**2 / 4.0, 4.0 * machine.nozzle**2
    area = fed / way * filament
    if area > most and fed > machine.nozzle * most / filament:
        return f"Move exceeds maximum extrusion ({area:.3f}mm^2 vs {most:.3f}mm^2)"
    return ""


def unparsed(board: Board, command: Command) -> bool:
    """Reject a move with an invalid number, as the real one does with `G1 Z.2.3`; return whether it was rejected."""
    if not command.without_number("XYZEF"):
        return False
    board.say(f"!! Unable to parse move '{command.text}'")
    board.violated("move that cannot be parsed")
    return True


def _move(board: Board, command: Command) -> Steps | None:
    if not board.shut_down and unparsed(board, command):
        return None
    return straight(board, [command.value(letter) for letter in "XYZEF"])


def _dwell(board: Board, command: Command) -> Steps | None:
    """G4 is one more move, of no way and so many milliseconds."""
    seconds = command.value("S") or (command.value("P") or 0.0) / 1000.0
    if seconds <= 0.0:
        return None
    board.tally.dwell_seconds += seconds
    board.tally.motion_seconds -= seconds  # the planner will count it
    return _dwelling(board, seconds)


def _dwelling(board: Board, seconds: float) -> Steps:
    yield from board.planned_pause(seconds)
    if seconds > board.front_end.ahead_seconds:  # a longer one is acknowledged when it has finished
        yield from board.until(board.now + seconds)


def _motors_off(board: Board, _: Command) -> Steps:
    """M84 and M18: all motors, whatever else it says; no axis is homed any more."""
    yield from board.drained()
    board.homed = [False, False, False]
    board.guard()


def _tell(board: Board, command: Command) -> None:
    """M118."""
    board.say(f"echo: {command.rest}")


def _stop(board: Board, _: Command) -> None:
    """M112, which has acted when the line was queued."""
    board.violated("emergency stop")
    if not board.shut_down:
        board.kill("M112 Shutdown")


def _restart(board: Board, _: Command) -> None:
    """FIRMWARE_RESTART: the ok comes first."""

    def leave() -> None:
        """It is gone."""
        board.say("// Klipper state: Disconnect")
        board.alarm("restart", board.now + RESTART_SECONDS, board.reset)

    board.alarm("restart", board.now, leave)


def _heat(code: str, command: Command, board: Board) -> Steps | None:
    """Temperatures beyond the machine are refused, not lowered."""
    heater = board.bed if code in {"M140", "M190"} else board.hotend
    target = command.value("S")
    if target is not None and not 0.0 <= target <= heater.spec.highest:
        board.say(f"!! Requested temperature ({target:.1f}) out of range (0.0:{heater.spec.highest:.1f})")
        board.violated("temperature out of range")
        return None
    return HEATING[code](board, command)


def _nothing(_: Board, __: Command) -> None:
    """Known, and without an effect that could be seen from outside."""


TABLE: Final = {
    "G0": _move,
    "G1": _move,
    "G4": _dwell,
    "M84": _motors_off,
    "M18": _motors_off,
    "M112": _stop,
    "M118": _tell,
    "FIRMWARE_RESTART": _restart,
    "RESTART": _restart,
    "SET_GCODE_OFFSET": _nothing,
    "SET_PRESSURE_ADVANCE": _nothing,
    "STATUS": _nothing,
    **{
        code: lambda board, command: _heat(command.code, command, board)
        for code in ("M104", "M109", "M140", "M190")
    },
}
