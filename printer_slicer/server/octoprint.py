"""The interface of OctoPrint, as far as slicers and phone apps use it, for each printer under `/printers/NAME/api`.

With a key for one printer, or with a single printer, the same interface is at `/api`. A file that arrives with
`print=true` becomes a job of the queue for this printer. It starts at once if the printer is idle and its bed was
declared clear; otherwise it waits, and the queue tells why.
"""

from __future__ import annotations

from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from printer_slicer.server.octoprint_commands import (
    change_bed,
    change_print,
    change_tool,
    connect,
    move_head,
    send_gcode,
)
from printer_slicer.server.octoprint_files import (
    delete_file,
    get_file,
    list_files,
    make_command,
    start_file,
    upload,
)
from printer_slicer.server.octoprint_state import describe_job, describe_state, list_temperatures
from printer_slicer.server.operations import find_access
from printer_slicer.server.targets import find_target
from printer_slicer.version import VERSION

__all__ = ["OCTOPRINT_ROUTES"]

_VERSION: Final = "1.11.0"  # of the interface that is imitated


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
    printer = (await run_in_threadpool(find_target, request)).printer
    stream, snapshot = ("", printer.webcam) if printer.webcam_interval else (printer.webcam, "")
    return JSONResponse(
        {
            "api": {"enabled": True},
            "appearance": {"name": "printer-slicer"},
            "feature": {"sdSupport": False},
            "plugins": {},
            "webcam": {"webcamEnabled": bool(printer.webcam), "streamUrl": stream, "snapshotUrl": snapshot},
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
        "state": describe_state(target)["text"],
        "port": "",
        "baudrate": None,
        "printerProfile": "_default",
    }
    return JSONResponse(
        {"current": current, "options": {"ports": [], "baudrates": [], "printerProfiles": []}}
    )


async def _get_printer(request: Request) -> Response:
    """Answer with state and temperatures."""
    target = await run_in_threadpool(find_target, request)
    temperatures = list_temperatures(target.status)
    return JSONResponse(
        {"temperature": temperatures, "sd": {"ready": False}, "state": describe_state(target)}
    )


async def _get_tools(request: Request) -> Response:
    """Answer with the temperatures of the nozzles."""
    target = await run_in_threadpool(find_target, request)
    temperatures = list_temperatures(target.status)
    return JSONResponse({name: one for name, one in temperatures.items() if name.startswith("tool")})


async def _get_bed(request: Request) -> Response:
    """Answer with the temperature of the bed."""
    target = await run_in_threadpool(find_target, request)
    temperatures = list_temperatures(target.status)
    return JSONResponse({name: one for name, one in temperatures.items() if name == "bed"})


async def _get_job(request: Request) -> Response:
    """Answer with the job that is printed, and how far it is."""
    return JSONResponse(await run_in_threadpool(lambda: describe_job(find_target(request))))


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
        ("connection", make_command(connect), "POST"),
        ("printer", _get_printer, "GET"),
        ("job", _get_job, "GET"),
        ("job", make_command(change_print), "POST"),
        ("printer/command", make_command(send_gcode), "POST"),
        ("printer/tool", _get_tools, "GET"),
        ("printer/tool", make_command(change_tool), "POST"),
        ("printer/bed", _get_bed, "GET"),
        ("printer/bed", make_command(change_bed), "POST"),
        ("printer/printhead", make_command(move_head), "POST"),
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
