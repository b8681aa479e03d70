"""A request for one printer by the interface of another server, and the file that it may bring."""

from __future__ import annotations

from typing import Any, Final

from starlette.requests import Request

from printer_slicer.print_queue import JobRequest, PrinterState, QueuedFile
from printer_slicer.server.access import Access
from printer_slicer.server.operations import find_access, read_request_id
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.receiving import receive_upload, run_slow_work
from printer_slicer.server.services import Services
from printer_slicer.server.uploads import FormReader, check_gcode_name
from printer_slicer.values import Struct

__all__ = ["QUEUED", "Target", "find_target", "queue_job", "receive_file"]

QUEUED: Final = "queued: it starts when the printer is idle and its bed was declared clear"
_TRUE: Final = frozenset({"true", "1", "yes", "y", "on"})


class Target(Struct, frozen=True):
    """A request for a printer: who sent it, and the state of the printer."""

    services: Services
    access: Access
    printer: PrinterState
    status: dict[str, Any]


def find_target(request: Request) -> Target:
    """Return the printer of a request.

    Raises:
        ProblemError: it has no key, there is no such printer, or the printer is not named although there are several.
    """
    services: Services = request.app.state.services
    access = find_access(request)
    printers = {one.name: one for one in services.queue.snapshot().printers}
    name = request.path_params.get("printer") or access.printer
    name = name or (next(iter(printers)) if len(printers) == 1 else "")
    if not name:
        names = ", ".join(printers) or "none"
        raise ProblemError(
            404,
            f"the address names no printer; printers: {names}",
            "Use the address .../printers/NAME in the slicer",
        )
    if name not in printers:
        raise ProblemError(404, f"there is no printer {name}", f"Use one of: {', '.join(printers)}")
    if not access.allows("read", name):
        raise ProblemError(403, f"this key is not for printer {name}", "Use the key of this printer")
    return Target(services, access, printers[name], request.app.state.feed.find_status(name))


async def receive_file(request: Request, target: Target) -> tuple[QueuedFile, bool]:
    """Store the file of a form, and queue a job for it if the form wants it; return the file, and whether it does.

    Raises:
        ProblemError: the key does not allow it, or the form has no file of G-code.
    """
    target.access.require("upload")

    def store(form: FormReader) -> tuple[QueuedFile, dict[str, str]]:
        name = form.find_file()
        check_gcode_name(name)
        return target.services.queue.add_file(name, form.read_file()), form.fields

    file, fields = await receive_upload(request, store)
    wants_print = fields.get("print", "").strip().lower() in _TRUE
    if wants_print:
        target.access.require("print", target.printer.name)
        await run_slow_work(request, queue_job, target, file, read_request_id(request, target.access))
    return file, wants_print


def queue_job(target: Target, file: QueuedFile, request_id: str = "") -> None:
    """Add a job for a file that was uploaded, once for each id of a request."""
    facts = target.services.reader.read(file.id)
    if facts.problem:
        raise ProblemError(415, facts.problem, "Upload another file")
    target.services.queue.add_jobs(file.id, JobRequest(printer=target.printer.name), request_id=request_id)
