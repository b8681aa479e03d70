"""Files in OctoPrint's interface: upload, list, start and delete them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from shutil import disk_usage
from typing import Any, Final
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from printer_slicer.print_queue import PrintQueue, QueuedFile
from printer_slicer.server.access import ANY_PRINTER
from printer_slicer.server.json_values import decode_json
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.receiving import read_body, run_slow_work
from printer_slicer.server.targets import QUEUED, find_target, queue_job, receive_file

__all__ = ["delete_file", "get_file", "list_files", "make_command", "start_file", "upload"]

_MAX_FILES: Final = 200


def make_command(run: Callable[[Request, dict[str, Any]], None]) -> Callable[[Request], Awaitable[Response]]:
    """Return the route of a command, which a function carries out in a thread."""

    async def answer(request: Request) -> Response:
        """Carry out the command in the body."""
        try:
            body = decode_json(await read_body(request), dict[str, Any])
        except ValueError:
            raise ProblemError(400, "the body is not a command", 'Send {"command": "..."} as JSON') from None
        await run_slow_work(request, run, request, body)
        return Response(status_code=204)

    return answer


async def upload(request: Request) -> Response:
    """Store a file, and queue a job for it if the form says `print=true`; it waits there, so nothing is printed yet."""
    target = await run_in_threadpool(find_target, request)
    file, wants_print = await receive_file(request, target)
    local = {"name": file.name, "path": file.name, "display": file.name, "origin": "local"}
    refs = _list_addresses(request, file)
    body = {
        "files": {"local": local | {"refs": refs}},
        "done": True,
        "effectiveSelect": False,
        "effectivePrint": False,
    }
    if wants_print:
        body["message"] = QUEUED
    return JSONResponse(body, 201, {"location": refs["resource"]})


def _list_addresses(request: Request, file: QueuedFile) -> dict[str, str]:
    """Return the addresses of a file: of what is known of it, and of its content."""
    base = str(request.base_url).rstrip("/")
    prefix = request.url.path.partition("/api/")[0]
    resource = f"{base}{prefix}/api/files/local/{quote(file.name)}"
    return {"resource": resource, "download": f"{base}/v1/files/{file.id}/content"}


async def list_files(request: Request) -> Response:
    """Answer with the files that were added last."""
    return JSONResponse(await run_in_threadpool(_list_files, request))


def _list_files(request: Request) -> dict[str, Any]:
    """Return the files that were added last, in OctoPrint's words."""
    queue = find_target(request).services.queue
    files = [_describe_file(request, queue, file) for file in queue.list_files(_MAX_FILES)]
    space = disk_usage(queue.folder)
    return {"files": files, "free": space.free, "total": space.total}


def _describe_file(request: Request, queue: PrintQueue, file: QueuedFile) -> dict[str, Any]:
    """Return a file in OctoPrint's words."""
    facts = queue.read_facts(file.id)
    found = {
        "name": file.name,
        "path": file.name,
        "display": file.name,
        "origin": "local",
        "type": "machinecode",
        "typePath": ["machinecode", "gcode"],
        "size": file.size,
        "date": int(file.added),
        "refs": _list_addresses(request, file),
    }
    if facts is None or facts.problem:
        return found
    filament = {"tool0": {"length": facts.filament}}
    return found | {"gcodeAnalysis": {"estimatedPrintTime": facts.seconds, "filament": filament}}


async def get_file(request: Request) -> Response:
    """Answer with what is known of the newest file with the name in the path."""

    def describe() -> dict[str, Any]:
        """Return the file."""
        queue = find_target(request).services.queue
        return _describe_file(request, queue, _find_newest(queue, request))

    return JSONResponse(await run_in_threadpool(describe))


async def delete_file(request: Request) -> Response:
    """Delete the newest file with the name in the path, unless a waiting job needs it."""

    def delete() -> None:
        """Delete the file."""
        target = find_target(request)
        target.access.require("print", ANY_PRINTER)
        target.services.delete_file(_find_newest(target.services.queue, request).id)

    await run_in_threadpool(delete)
    return Response(status_code=204)


def start_file(request: Request, body: dict[str, Any]) -> None:
    """Queue a job for the newest file with the name in the path."""
    target = find_target(request)
    target.access.require("print", target.printer.name)
    if body.get("command") != "select":
        raise ProblemError(400, "only the command select is supported", "Upload the file again to print it")
    file = _find_newest(target.services.queue, request)
    if body.get("print") is True:
        queue_job(target, file)


def _find_newest(queue: PrintQueue, request: Request) -> QueuedFile:
    """Return the newest file with the name in the path of a request.

    Raises:
        ProblemError: there is none.
    """
    name = str(request.path_params["path"]).rsplit("/", 1)[-1]
    found = [file for file in queue.list_files() if file.name == name]
    if not found:
        raise ProblemError(404, "there is no file with this name", "Upload it")
    return max(found, key=lambda file: file.added)
