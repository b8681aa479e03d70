"""Commands of OctoPrint's interface to a printer, as commands to its print; without a print, they are rejected.

The queue opens the port for each print, so an idle printer cannot be heated or moved. Moves need a paused print; the
nozzle returns when it resumes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from starlette.requests import Request

from printer_slicer.server.octoprint_state import describe_state
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.targets import Target, find_target
from printer_slicer.texts import format_number

__all__ = ["change_bed", "change_print", "change_tool", "connect", "move_head", "send_gcode"]

_MAX_COMMANDS: Final = 50  # of one request
_PRINT_COMMANDS: Final = frozenset({"cancel", "pause", "resume"})
_JOG_SPEED: Final = 100.0  # mm/s in x and y
_JOG_SPEED_Z: Final = 5.0  # mm/s
_EXTRUSION_SPEED: Final = 5.0  # mm/s of filament
_AXES: Final = ("x", "y", "z")
_TOOL_NUMBERS: Final = frozenset(map(str, range(10)))
_MAX_NUMBER: Final = 1e6


def _find_controlled(request: Request) -> Target:
    """Return the printer of a request whose sender may control it.

    Raises:
        ProblemError: as of `find_target`, or the sender may not.
    """
    target = find_target(request)
    target.access.require("control", target.printer.name)
    return target


def change_print(request: Request, body: dict[str, Any]) -> None:
    """Pause, resume or cancel the print."""
    target = _find_controlled(request)
    command, action = str(body.get("command", "")), str(body.get("action") or "toggle")
    if command == "pause" and (
        action == "resume" or (action == "toggle" and describe_state(target)["flags"]["paused"])
    ):
        command = "resume"
    if command not in _PRINT_COMMANDS:
        raise ProblemError(
            409,
            f"the command {command[:40]!r} is not supported",
            "Start jobs in the queue; see printer-slicer queue",
        )
    if command == "cancel" and target.printer.job is not None:
        target.services.queue.cancel_job(target.printer.job)
        return
    target.services.send_command(target.printer.name, command)


def send_gcode(request: Request, body: dict[str, Any]) -> None:
    """Send G-code to the printer between the commands of its print; `M112` is the emergency stop, as in OctoPrint."""
    target = _find_controlled(request)
    commands = body.get("commands", [body.get("command")])
    if not isinstance(commands, list) or not all(isinstance(one, str) for one in commands):
        raise ProblemError(400, "the body contains no command", 'Send {"commands": ["..."]} as JSON')
    if len(commands) > _MAX_COMMANDS:
        raise ProblemError(400, f"more than {_MAX_COMMANDS} commands", "Send them in several requests")
    for command in commands:
        target.services.send_command(target.printer.name, f"say {command}")


def change_tool(request: Request, body: dict[str, Any]) -> None:
    """Heat nozzles, set the flow, extrude while the print is paused, or choose a tool."""
    target, command = _find_controlled(request), body.get("command")
    if command == "target":
        targets = body.get("targets")
        if not isinstance(targets, dict) or not targets:
            raise _make_error("targets is missing")
        lines = [_heat_tool(name, _read_number(targets, name)) for name in targets]
    elif command == "flowrate":
        lines = [f"flow {_read_percent(body):g}"]
    elif command == "extrude":
        lines = _move({"E": _read_number(body, "amount")}, _read_speed(body, _EXTRUSION_SPEED))
    elif command == "select":
        lines = [f"say T{_read_tool(body.get('tool'))}"]
    else:
        raise _make_error(f"the command {str(command)[:40]!r} is not supported")
    _send(target, lines)


def change_bed(request: Request, body: dict[str, Any]) -> None:
    """Heat the bed."""
    target = _find_controlled(request)
    if body.get("command") != "target":
        raise _make_error(f"the command {str(body.get('command'))[:40]!r} is not supported")
    _send(target, [f"bed {_read_number(body, 'target'):g}"])


def move_head(request: Request, body: dict[str, Any]) -> None:
    """Set the speed, or move or home the axes while the print is paused."""
    target, command = _find_controlled(request), body.get("command")
    if command == "feedrate":
        lines = [f"speed {_read_percent(body):g}"]
    elif command == "jog":
        distances = {axis.upper(): _read_number(body, axis) for axis in _AXES if axis in body}
        if not distances:
            raise _make_error("no axis is named")
        speed = _read_speed(body, _JOG_SPEED_Z if "Z" in distances else _JOG_SPEED)
        lines = _move(distances, speed, is_absolute=body.get("absolute") is True)
    elif command == "home":
        axes = body.get("axes")
        if not isinstance(axes, list) or not axes or not all(axis in _AXES for axis in axes):
            raise _make_error("axes must be a list of x, y and z")
        lines = [f"say G28 {' '.join(axis.upper() for axis in axes)}"]
    else:
        raise _make_error(f"the command {str(command)[:40]!r} is not supported")
    _send(target, lines)


def connect(request: Request, body: dict[str, Any]) -> None:
    """Accept that a program wants to connect; the queue opens the port for each print."""
    _find_controlled(request)
    if body.get("command") != "connect":
        raise ProblemError(409, "the queue opens and closes the port itself", "Add a job to print")


def _send(target: Target, lines: list[str]) -> None:
    """Send commands to the print of a printer."""
    for line in lines:
        target.services.send_command(target.printer.name, line)


def _heat_tool(name: str, celsius: float) -> str:
    """Return the command that heats a nozzle; the first one is the one in use."""
    number = _read_tool(name)
    return f"say M104 T{number} S{celsius:g}" if number else f"nozzle {celsius:g}"


def _move(distances: Mapping[str, float], speed: float, *, is_absolute: bool = False) -> list[str]:
    """Return the commands of a move; the print restores its modes when it resumes.

    Args:
        distances: mm by axis; a move of `E` has no other axis.
        speed: mm/s.
        is_absolute: whether the distances are positions.
    """
    words = " ".join(f"{axis}{format_number(distance)}" for axis, distance in distances.items())
    move = f"say G1 {words} F{60 * speed:.0f}"
    if "E" in distances:
        return ["say M83", move, "say M82"]
    return ["say G90", move] if is_absolute else ["say G91", move, "say G90"]


def _read_number(body: Mapping[str, Any], name: str) -> float:
    """Return a number in a body.

    Raises:
        ProblemError: it is missing, or no number.
    """
    value = body.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > _MAX_NUMBER:
        raise _make_error(f"{name[:40]} must be a number")
    return float(value)


def _read_percent(body: Mapping[str, Any]) -> float:
    """Return the member `factor` in percent; as in OctoPrint, a number with a decimal point is a factor."""
    value = _read_number(body, "factor")
    return 100 * value if isinstance(body["factor"], float) else value


def _read_speed(body: Mapping[str, Any], default: float) -> float:
    """Return the member `speed` of a body, which is in mm/min, in mm/s."""
    speed = _read_number(body, "speed") / 60 if "speed" in body else default
    if speed <= 0:
        raise _make_error("speed must be positive")
    return speed


def _read_tool(name: object) -> int:
    """Return the number of a tool such as `tool0`.

    Raises:
        ProblemError: it is not the name of a tool.
    """
    text = str(name)
    if not text.startswith("tool") or text[4:] not in _TOOL_NUMBERS:
        raise _make_error(f"{text[:40]!r} is not the name of a tool, such as tool0")
    return int(text[4:])


def _make_error(detail: str) -> ProblemError:
    """Return the error of a body that is no valid command."""
    return ProblemError(400, detail, "See https://docs.octoprint.org/en/master/api/printer.html")
