"""The interface of OctoPrint, as far as slicers and phone apps use it, for each printer under `/printers/NAME/api`.

With a key for one printer, or with a single printer, the same interface is at `/api`. A file that arrives with
`print=true` becomes a job of the queue for this printer. It starts at once if the printer is idle and its bed was
declared clear; otherwise it waits, and the queue tells why.
"""

from __future__ import annotations

from typing import Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from printer_slicer.server.octoprint_files import (
    delete_file,
    get_file,
    list_files,
    make_command,
    start_file,
    upload,
)
from printer_slicer.server.operations import find_access
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.targets import Target, find_target
from printer_slicer.version import VERSION

__all__ = ["OCTOPRINT_ROUTES"]

_VERSION: Final = "1.11.0"  # of the interface that is imitated
_MAX_COMMANDS: Final = 50  # of one request
_STATES: Final = {
    "stopping": "Pausing",
    "parking": "Pausing",
    "paused": "Paused",
    "returning": "Resuming",
    "cancelling": "Cancelling",
}
"""OctoPrint's names for the states of a print; all others are `Printing`."""
_COMMANDS: Final = {"cancel": "cancel", "pause": "pause", "resume": "resume"}


async def _get_version(request: Request) -> Response:
    """Answer with the version of the interface; a slicer that tests the address learns whether its printer exists."""
    named = "printer" in request.path_params
    await run_in_threadpool(find_target if named else find_access, request)
    text = f"OctoPrint {_VERSION} (printer-slicer {VERSION})"
    return JSONResponse({"api": "0.1", "server": _VERSION, "text": text})


async def _get_server(request: Request) -> Response:
    """Answer that the server runs."""
    await run_in_threadpool(find_access, request)
    return JSONResponse({"version": _VERSION, "safemode": None})


async def _get_settings(request: Request) -> Response:
    """Answer with the few settings that programs look for."""
    await run_in_threadpool(find_target, request)
    return JSONResponse(
        {
            "api": {"enabled": True},
            "appearance": {"name": "printer-slicer"},
            "feature": {"sdSupport": False},
            "plugins": {},
            "webcam": {"webcamEnabled": False, "streamUrl": "", "snapshotUrl": ""},
        }
    )


async def _log_in(request: Request) -> Response:
    """Answer who the sender of the key is."""
    target = await run_in_threadpool(find_target, request)
    admin = target.access.allows("admin")
    return JSONResponse(
        {
            "name": target.access.name,
            "active": True,
            "admin": admin,
            "user": True,
            "groups": [],
            "session": "",
        }
    )


async def _get_profiles(request: Request) -> Response:
    """Answer with the printer as the only profile."""
    target = await run_in_threadpool(find_target, request)
    name = target.printer.name
    profile = {"id": "_default", "name": name, "current": True, "default": True, "model": name}
    return JSONResponse({"profiles": {"_default": profile}})


async def _get_connection(request: Request) -> Response:
    """Answer that the printer is connected; the queue opens its port for each print."""
    target = await run_in_threadpool(find_target, request)
    current = {
        "state": _describe_state(target)["text"],
        "port": "",
        "baudrate": None,
        "printerProfile": "_default",
    }
    return JSONResponse(
        {"current": current, "options": {"ports": [], "baudrates": [], "printerProfiles": []}}
    )


def _describe_state(target: Target) -> dict[str, Any]:
    """Return the state of the printer in OctoPrint's words."""
    state = str(target.status.get("state", ""))
    paused, printing = state == "paused", target.printer.job is not None
    text = _STATES.get(state, "Printing") if printing else "Operational"
    flags = {
        "operational": True,
        "printing": printing and not paused,
        "paused": paused,
        "pausing": text == "Pausing",
        "resuming": text == "Resuming",
        "cancelling": text == "Cancelling",
        "finishing": False,
        "sdReady": False,
        "error": False,
        "ready": not printing,
        "closedOrError": False,
    }
    return {"text": text, "flags": flags}


async def _get_printer(request: Request) -> Response:
    """Answer with state and temperatures."""
    target = await run_in_threadpool(find_target, request)
    temperatures = {
        name: {"actual": actual, "target": wanted, "offset": 0}
        for name, actual, wanted in _list_temperatures(target.status)
    }
    return JSONResponse(
        {"temperature": temperatures, "sd": {"ready": False}, "state": _describe_state(target)}
    )


def _list_temperatures(status: dict[str, Any]) -> list[tuple[str, float, float]]:
    """Return name, temperature and target of the heaters that a print knows."""
    found = []
    for name, (actual, wanted) in status.get("temperatures", {}).items():
        tool = name[1:] or "0"
        shown = "bed" if name == "B" else f"tool{tool}" if name[:1] == "T" and tool.isdecimal() else ""
        if shown and actual is not None:
            found.append((shown, float(actual), float(wanted or 0)))
    return found


async def _get_job(request: Request) -> Response:
    """Answer with the job that is printed, and how far it is."""
    return JSONResponse(await run_in_threadpool(lambda: _describe_job(find_target(request))))


def _describe_job(target: Target) -> dict[str, Any]:
    """Return the job of a printer in OctoPrint's words."""
    queue, status = target.services.queue, target.status
    name = size = seconds = None
    if target.printer.job is not None:
        job = queue.find_job(target.printer.job)
        facts = queue.read_facts(job.file)
        name, size = job.name, queue.find_file(job.file).size
        seconds = facts.seconds if facts else None
    done, total = status.get("done"), status.get("total")
    return {
        "job": {
            "file": {
                "name": name,
                "path": name,
                "display": name,
                "size": size,
                "origin": "local",
                "date": None,
            },
            "estimatedPrintTime": seconds,
            "filament": None,
        },
        "progress": {
            "completion": round(100 * done / total, 2) if done is not None and total else None,
            "filepos": None,
            "printTime": None,
            "printTimeLeft": None,
        },
        "state": _describe_state(target)["text"],
    }


def _change_print(request: Request, body: dict[str, Any]) -> None:
    """Pause, resume or cancel the print."""
    target = find_target(request)
    target.access.require("control", target.printer.name)
    command, action = str(body.get("command", "")), str(body.get("action") or "toggle")
    if command == "pause" and (
        action == "resume" or (action == "toggle" and _describe_state(target)["flags"]["paused"])
    ):
        command = "resume"
    if command not in _COMMANDS:
        raise ProblemError(
            409,
            f"the command {command[:40]!r} is not supported",
            "Start jobs in the queue; see printer-slicer queue",
        )
    if command == "cancel" and target.printer.job is not None:
        target.services.queue.cancel_job(target.printer.job)
        return
    target.services.send_command(target.printer.name, _COMMANDS[command])


def _send_gcode(request: Request, body: dict[str, Any]) -> None:
    """Send G-code to the printer between the commands of its print; `M112` is the emergency stop, as in OctoPrint."""
    target = find_target(request)
    target.access.require("control", target.printer.name)
    commands = body.get("commands", [body.get("command")])
    if not isinstance(commands, list) or not all(isinstance(one, str) for one in commands):
        raise ProblemError(400, "the body contains no command", 'Send {"commands": ["..."]} as JSON')
    if len(commands) > _MAX_COMMANDS:
        raise ProblemError(400, f"more than {_MAX_COMMANDS} commands", "Send them in several requests")
    for command in commands:
        target.services.send_command(target.printer.name, f"say {command}")


def _connect(request: Request, body: dict[str, Any]) -> None:
    """Accept that a program wants to connect; the queue opens the port for each print."""
    target = find_target(request)
    target.access.require("control", target.printer.name)
    if body.get("command") != "connect":
        raise ProblemError(409, "the queue opens and closes the port itself", "Add a job to print")


def _make_routes(prefix: str) -> list[BaseRoute]:
    """Return all routes below a prefix."""
    table = (
        ("version", _get_version, "GET"),
        ("server", _get_server, "GET"),
        ("settings", _get_settings, "GET"),
        ("login", _log_in, "POST"),
        ("currentuser", _log_in, "GET"),
        ("printerprofiles", _get_profiles, "GET"),
        ("connection", _get_connection, "GET"),
        ("connection", make_command(_connect), "POST"),
        ("printer", _get_printer, "GET"),
        ("job", _get_job, "GET"),
        ("job", make_command(_change_print), "POST"),
        ("printer/command", make_command(_send_gcode), "POST"),
        ("files", list_files, "GET"),
        ("files/local", list_files, "GET"),
        ("files/local", upload, "POST"),
        ("files/local/{path:path}", get_file, "GET"),
        ("files/local/{path:path}", delete_file, "DELETE"),
        ("files/local/{path:path}", make_command(start_file), "POST"),
    )
    return [Route(f"{prefix}/api/{path}", run, methods=[method]) for path, run, method in table]


OCTOPRINT_ROUTES: Final = (*_make_routes(""), *_make_routes("/printers/{printer}"))
"""The routes of the interface, for one printer and for each of several."""
