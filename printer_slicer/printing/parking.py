"""Build the G-code that parks the nozzle at a pause, and the G-code that returns it to the part.

pause    retract - lift over everything printed - move off the part (- cool down)
resume   (heat - purge old filament) - move over the position - lower - deretract - restore E, modes and speed
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import ModalState
from printer_slicer.printing.commands import Pause
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.journal import restore_struct
from printer_slicer.printing.machine_state import PrintState, format_number
from printer_slicer.values import Struct, as_dict, field

__all__ = [
    "ParkedState",
    "build_end_script",
    "build_parking_script",
    "build_restore_script",
    "build_return_script",
    "find_parking_position",
    "make_parked_state",
    "parse_parked_state",
    "sum_extrusion",
]

_TOLERANCE = 0.001  # mm


class ParkedState(Struct, frozen=True):
    """State of a parked print: where the nozzle returns to, and at which temperatures.

    Attributes:
        entries: number of job entries that had a line number at the pause.
        stand: machine state to return to.
        park: whether the nozzle moves to the parking position.
        spot: parking position, x and y, mm.
        safe: z of the moves to and from the parking position, mm.
        hotend, bed: target temperatures of the print, °C.
        cold: whether the nozzle cools down during the pause.
        replay: discarded planned moves, to be sent again after the return.
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
        """Return the state as a JSON object for the journal."""
        return as_dict(self)


def parse_parked_state(values: Mapping[str, Any]) -> ParkedState:
    """Restore a parked state from the JSON object that `ParkedState.as_json` has returned.

    Raises:
        TypeError: a value has the wrong type.
    """
    return restore_struct(ParkedState, values)


def make_parked_state(
    modal: ModalState, print_state: PrintState, setup: HostSettings, pause: Pause, entries: int
) -> ParkedState:
    """Return the parked state of a print that pauses now.

    Args:
        modal: machine state to return to.
        print_state: state of the print.
        setup: settings of the printer.
        pause: options of the pause.
        entries: number of job entries that have a line number.
    """
    machine, z = print_state.machine, modal.place[2]
    over = z if print_state.highest_z is None else max(print_state.highest_z, z)
    top = setup.top + (machine.offset[2] or 0.0)
    return ParkedState(
        entries=entries,
        stand=modal,
        park=pause.park and modal.known,
        spot=find_parking_position(setup, print_state),
        safe=max(z, min(over + setup.lift, top)),
        hotend=machine.hotend,
        bed=machine.bed,
        cold=pause.cold and machine.hotend > 0,
    )


def find_parking_position(setup: HostSettings, print_state: PrintState) -> tuple[float, float]:
    """Return x and y of the bed corner farthest from the part, mm, in coordinates of the program.

    If the program has moved its origin by an unknown distance, return the current position.

    Args:
        setup: settings of the printer.
        print_state: state of the print.
    """
    box, (by_x, by_y, _) = print_state.bounding_box, print_state.machine.offset
    if by_x is None or by_y is None:
        return print_state.modal.place[:2]
    left, right = setup.low[0] + by_x, setup.high[0] + by_x
    front, back = setup.low[1] + by_y, setup.high[1] + by_y
    inset = min(5.0, (right - left) / 4, (back - front) / 4)
    corners = [(x, y) for y in (back - inset, front + inset) for x in (left + inset, right - inset)]
    if box is None:
        return corners[0]

    def measure_distance(corner: tuple[float, float]) -> float:
        """Return how far a corner is from the bounding box of the part, mm; negative inside the box."""
        beside = [box[axis] - corner[axis] for axis in (0, 1)] + [
            corner[axis] - box[axis + 2] for axis in (0, 1)
        ]
        return max(beside)

    return max(corners, key=measure_distance)


def build_parking_script(parked: ParkedState, print_state: PrintState, setup: HostSettings) -> list[bytes]:
    """Return the commands that park the nozzle."""
    script: list[bytes] = []
    if parked.park:
        script += [b"G21"] if print_state.machine.inches else []
        if print_state.machine.hotend >= setup.coldest:
            script += [b"M83", b"G1 E-%s F%d" % (format_number(setup.retract), setup.retract_speed * 60)]
        script += [b"G90", b"G1 Z%s F%d" % (format_number(parked.safe), setup.lift_speed * 60)]
        x, y = parked.spot
        script.append(b"G1 X%s Y%s F%d" % (format_number(x), format_number(y), setup.travel_speed * 60))
    if parked.cold:
        script.append(b"M104 S0")
    return script


def build_return_script(
    parked: ParkedState, setup: HostSettings, extruded: float, *, inches: bool = False
) -> list[bytes]:
    """Return the commands that bring the nozzle back to the part.

    Args:
        parked: state to return to.
        setup: settings of the printer.
        extruded: filament extruded since parking, mm; negative if retracted.
        inches: whether a user has switched the printer to inches.
    """
    script = [b"G21"] if inches or parked.stand.inches else []
    if parked.cold and parked.hotend:
        script += [b"M104 S%s" % format_number(parked.hotend), b"M109 S%s" % format_number(parked.hotend)]
    stand = parked.stand
    if parked.park:
        is_warm = parked.hotend >= setup.coldest
        if parked.cold and is_warm:
            script += [
                b"M83",
                b"G1 E%s F300" % format_number(setup.purge),
                b"G1 E-%s F300" % format_number(setup.purge / 10),
            ]
            extruded = stand.pulled - setup.purge / 10
        x, y, z = (format_number(value) for value in stand.place)
        script += [
            b"G90",
            b"G1 Z%s F%d" % (format_number(parked.safe), setup.lift_speed * 60),
            b"G1 X%s Y%s F%d" % (x, y, setup.travel_speed * 60),
            b"G1 Z%s F%d" % (z, setup.lift_speed * 60),
        ]
        if is_warm and abs(extruded) > _TOLERANCE:
            script += [b"M83", b"G1 E%s F%d" % (format_number(-extruded), setup.deretract_speed * 60)]
    return script + build_restore_script(stand)


def build_restore_script(modal: ModalState) -> list[bytes]:
    """Return the commands that restore E, modes, speed and unit on a printer that is set to mm."""
    script = [
        b"G92 E%s" % format_number(modal.e),
        b"G91" if modal.relative else b"G90",
        b"M83" if modal.extruder else b"M82",
    ]
    script += [b"G1 F%s" % format_number(modal.speed * 60)] if modal.speed else []
    return script + ([b"G20"] if modal.inches else [])


def sum_extrusion(commands: Sequence[bytes]) -> float:
    """Return the length of filament that G1 commands with relative E extrude, mm."""
    moved = 0.0
    for command in commands:
        word, values = parse(command)
        if word == b"G1":
            moved += values.get(b"E", 0.0)
    return moved


def build_end_script(print_state: PrintState, setup: HostSettings, spot: tuple[float, float]) -> list[bytes]:
    """Return the end script of a cancelled print: heaters and fan off, move off the part, motors off."""
    script = [b"M104 S0", b"M140 S0", b"M107"]
    if print_state.machine.chamber:
        script.append(b"M141 S0")
    modal, highest = print_state.modal, print_state.highest_z
    script += [*([b"G21"] if modal.inches else []), b"G91", b"G1 Z5 F300", b"G90"]
    if modal.known and print_state.bounding_box:
        x, y = spot
        if highest is not None and highest > modal.place[2]:
            script.append(b"G1 Z%s F300" % format_number(highest + 5))
        script.append(b"G1 X%s Y%s F%d" % (format_number(x), format_number(y), setup.travel_speed * 60))
    return [*script, b"M84"]
