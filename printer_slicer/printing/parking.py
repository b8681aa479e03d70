"""Commands that park the nozzle at a pause, and commands that return it to the same position.

pause    retract - lift over everything printed - move off the part (- cool down)
resume   (heat - purge old filament) - move over the position - lower - deretract - restore E, modes and speed
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import ModalState
from printer_slicer.printing.commands import Pause
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.journal import dataclass_from_json
from printer_slicer.printing.machine_state import PrintState, number

__all__ = [
    "ParkedState",
    "end_script",
    "extruded_length",
    "leave",
    "park_state",
    "parking_position",
    "parse_parked_state",
    "restore_modes",
    "return_to_part",
]

_NEAR = 0.001


@dataclass(frozen=True, slots=True)
class ParkedState:
    """State of a parked print: the position to return to, and how.

    Attributes:
        entries: number of job entries that had a line number at the pause.
        stand: machine state to return to.
        park: whether the nozzle leaves its position.
        spot: parking position, x and y, mm.
        safe: z of the moves to and from it, mm.
        hotend, bed: target temperatures of the print, °C.
        cold: whether the nozzle cools down meanwhile.
        replay: commands of discarded planned moves, to be sent after the return.
    """

    entries: int
    stand: ModalState
    park: bool
    spot: tuple[float, float] = (0.0, 0.0)
    safe: float = 0.0
    hotend: float = 0.0
    bed: float = 0.0
    cold: bool = False
    replay: tuple[str, ...] = field(default=())

    def as_json(self) -> dict[str, Any]:
        """Return it for the journal."""
        return asdict(self)


def parse_parked_state(values: Mapping[str, Any]) -> ParkedState:
    """Rebuild from the result of `as_json`.

    Raises:
        TypeError: a value has the wrong type.
    """
    return dataclass_from_json(ParkedState, values)


def park_state(
    stand: ModalState, modes: PrintState, setup: HostSettings, pause: Pause, entries: int
) -> ParkedState:
    """Return the parked state for a pause at this moment.

    Args:
        stand: machine state to return to.
        modes: state of the print.
        setup: settings of the printer.
        pause: options of the pause.
        entries: number of job entries that have a line number.
    """
    machine, z = modes.machine, stand.place[2]
    over = z if modes.highest is None else max(modes.highest, z)
    top = setup.top + (machine.offset[2] or 0.0)
    return ParkedState(
        entries=entries,
        stand=stand,
        park=pause.park and stand.known,
        spot=parking_position(setup, modes),
        safe=max(z, min(over + setup.lift, top)),
        hotend=machine.hotend,
        bed=machine.bed,
        cold=pause.cold and machine.hotend > 0,
    )


def parking_position(setup: HostSettings, modes: PrintState) -> tuple[float, float]:
    """Return the corner of the bed that is farthest from the part, in coordinates of the program.

    If the program has moved its origin by an unknown distance, this is the current position.

    Args:
        setup: settings of the printer.
        modes: state of the print.
    """
    box, (by_x, by_y, _) = modes.box, modes.machine.offset
    if by_x is None or by_y is None:
        return modes.stand.place[:2]
    left, right = setup.low[0] + by_x, setup.high[0] + by_x
    front, back = setup.low[1] + by_y, setup.high[1] + by_y
    inset = min(5.0, (right - left) / 4, (back - front) / 4)
    corners = [(x, y) for y in (back - inset, front + inset) for x in (left + inset, right - inset)]
    if box is None:
        return corners[0]

    def distance(corner: tuple[float, float]) -> float:
        """Return the distance of a corner from the box, mm; negative inside."""
        beside = [box[axis] - corner[axis] for axis in (0, 1)] + [
            corner[axis] - box[axis + 2] for axis in (0, 1)
        ]
        return max(beside)

    return max(corners, key=distance)


def leave(parked: ParkedState, modes: PrintState, setup: HostSettings) -> list[bytes]:
    """Return the commands that park the nozzle."""
    script: list[bytes] = []
    if parked.park:
        script += [b"G21"] if modes.machine.inches else []
        if modes.machine.hotend >= setup.coldest:
            script += [b"M83", b"G1 E-%s F%d" % (number(setup.retract), setup.retract_speed * 60)]
        script += [b"G90", b"G1 Z%s F%d" % (number(parked.safe), setup.lift_speed * 60)]
        x, y = parked.spot
        script.append(b"G1 X%s Y%s F%d" % (number(x), number(y), setup.travel_speed * 60))
    if parked.cold:
        script.append(b"M104 S0")
    return script


def return_to_part(
    parked: ParkedState, setup: HostSettings, pushed: float, *, inches: bool = False
) -> list[bytes]:
    """Return the commands that bring the nozzle back to the part.

    Args:
        parked: state to return to.
        setup: settings of the printer.
        pushed: mm of filament extruded since parking; negative for retracted.
        inches: whether a user has switched the printer to inches.
    """
    script = [b"G21"] if inches or parked.stand.inches else []
    if parked.cold and parked.hotend:
        script += [b"M104 S%s" % number(parked.hotend), b"M109 S%s" % number(parked.hotend)]
    stand = parked.stand
    if parked.park:
        warm = parked.hotend >= setup.coldest
        if parked.cold and warm:
            script += [
                b"M83",
                b"G1 E%s F300" % number(setup.purge),
                b"G1 E-%s F300" % number(setup.purge / 10),
            ]
            pushed = stand.pulled - setup.purge / 10
        x, y, z = (number(value) for value in stand.place)
        script += [
            b"G90",
            b"G1 Z%s F%d" % (number(parked.safe), setup.lift_speed * 60),
            b"G1 X%s Y%s F%d" % (x, y, setup.travel_speed * 60),
            b"G1 Z%s F%d" % (z, setup.lift_speed * 60),
        ]
        if warm and abs(pushed) > _NEAR:
            script += [b"M83", b"G1 E%s F%d" % (number(-pushed), setup.deretract_speed * 60)]
    return script + restore_modes(stand)


def restore_modes(stand: ModalState) -> list[bytes]:
    """Return the commands that restore E, modes, speed and unit on a printer in mm mode."""
    script = [
        b"G92 E%s" % number(stand.e),
        b"G91" if stand.relative else b"G90",
        b"M83" if stand.extruder else b"M82",
    ]
    script += [b"G1 F%s" % number(stand.speed * 60)] if stand.speed else []
    return script + ([b"G20"] if stand.inches else [])


def extruded_length(commands: Sequence[bytes]) -> float:
    """Return the filament that commands with relative E extrude, mm."""
    moved = 0.0
    for command in commands:
        word, values = parse(command)
        if word == b"G1":
            moved += values.get(b"E", 0.0)
    return moved


def end_script(modes: PrintState, setup: HostSettings, spot: tuple[float, float]) -> list[bytes]:
    """Return the end script of a cancelled print: heaters and fan off, nozzle off the part, motors off."""
    script = [b"M104 S0", b"M140 S0", b"M107"]
    if modes.machine.chamber:
        script.append(b"M141 S0")
    stand, highest = modes.stand, modes.highest
    script += [*([b"G21"] if stand.inches else []), b"G91", b"G1 Z5 F300", b"G90"]
    if stand.known and modes.box:
        x, y = spot
        if highest is not None and highest > stand.place[2]:
            script.append(b"G1 Z%s F300" % number(highest + 5))
        script.append(b"G1 X%s Y%s F%d" % (number(x), number(y), setup.travel_speed * 60))
    return [*script, b"M84"]
