"""The two requests of Moonraker with which slicers upload files.

Nothing else of it is imitated: its pages expect the objects of Klipper.
"""

from __future__ import annotations

from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from printer_slicer.server.targets import QUEUED, find_target, receive_file

__all__ = ["MOONRAKER_ROUTES"]

_VERSION: Final = "v0.9.3"  # of the interface that is imitated


async def _get_info(request: Request) -> Response:
    """Answer with the version; `result` is the first member, as slicers expect."""
    await run_in_threadpool(find_target, request)
    result = {
        "klippy_connected": True,
        "klippy_state": "ready",
        "moonraker_version": _VERSION,
        "warnings": [],
    }
    return JSONResponse({"result": result})


async def _upload(request: Request) -> Response:
    """Store a file, and queue a job for it if the form says `print=true`."""
    target = await run_in_threadpool(find_target, request)
    file, wants_print = await receive_file(request, target)
    item = {"path": file.name, "root": "gcodes", "size": file.size, "modified": file.added}
    body = {"item": item, "print_started": False, "print_queued": wants_print, "action": "create_file"}
    if wants_print:
        body["message"] = QUEUED
    return JSONResponse(body, 201)


MOONRAKER_ROUTES: Final = tuple(
    Route(f"{prefix}/server/{path}", run, methods=[method])
    for prefix in ("", "/printers/{printer}")
    for path, run, method in (("info", _get_info, "GET"), ("files/upload", _upload, "POST"))
)
"""The routes, for one printer and for each of several."""
