"""The operations of `/v1`, except uploads and the feed."""

from __future__ import annotations

from typing import Any, Final

from printer_slicer.print_queue import (
    Explanation,
    FileFacts,
    PrintRun,
    QueuedFile,
    QueuedJob,
    QueueSnapshot,
    explain_job,
)
from printer_slicer.print_queue.records import WAITING_STATES
from printer_slicer.server.access import ANY_PRINTER, ApiKey
from printer_slicer.server.bodies import (
    Account,
    BedBody,
    CommandBody,
    JobBody,
    JobDetails,
    KeyBody,
    MaterialBody,
    MoveBody,
    NewKey,
    PreviewLayers,
    PrinterInfo,
    ProfileNames,
)
from printer_slicer.server.operations import CheckedRequest, Operation
from printer_slicer.server.slicing import SliceTask, check_profile_name
from printer_slicer.server.temperatures import TemperatureSample
from printer_slicer.values import replace

__all__ = ["OPERATIONS"]

_MAX_EXPLANATIONS: Final = 50
_MAX_FILES: Final = 200


def _get_account(call: CheckedRequest) -> Account:
    return Account(call.access.name, tuple(sorted(call.access.scopes)), call.access.printer)


def _list_keys(call: CheckedRequest) -> tuple[ApiKey, ...]:
    return call.services.access.list_keys()


def _create_key(call: CheckedRequest) -> NewKey:
    body: KeyBody = call.body
    if body.printer:
        call.services.queue.find_printer(body.printer)  # fails if there is none
    return NewKey(*call.services.access.create_key(body.name, body.scopes, body.printer))


def _delete_key(call: CheckedRequest) -> None:
    call.services.access.delete_key(call.path["key"])


def _end_session(call: CheckedRequest) -> None:
    call.services.access.end_session(call.access.session)


def _get_queue(call: CheckedRequest) -> QueueSnapshot:
    return call.services.queue.snapshot()


def _explain_queue(call: CheckedRequest) -> tuple[Explanation, ...]:
    queue = call.services.queue
    waiting = [job.id for job in queue.snapshot().jobs if job.state in WAITING_STATES]
    return tuple(explain_job(queue, job) for job in waiting[:_MAX_EXPLANATIONS])


def _list_history(call: CheckedRequest) -> tuple[tuple[QueuedJob, PrintRun | None], ...]:
    queue = call.services.queue
    return tuple((job, next(reversed(queue.list_runs(job.id)), None)) for job in queue.list_ended_jobs())


def _list_files(call: CheckedRequest) -> tuple[tuple[QueuedFile, FileFacts | None], ...]:
    queue = call.services.queue
    return tuple((file, queue.read_facts(file.id)) for file in queue.list_files(_MAX_FILES))


def _get_file(call: CheckedRequest) -> tuple[QueuedFile, FileFacts]:
    file = call.services.queue.find_file(call.path["file"])
    return file, call.services.reader.read(file.id)


def _delete_file(call: CheckedRequest) -> None:
    call.access.require("print", ANY_PRINTER)
    call.services.delete_file(call.path["file"])


def _list_layers(call: CheckedRequest) -> PreviewLayers:
    return PreviewLayers(**call.services.reader.read_layers(call.path["file"]))


def _add_jobs(call: CheckedRequest) -> tuple[QueuedJob, ...]:
    body: JobBody = call.body
    call.access.require("print", body.printer)
    call.services.reader.read(body.file)
    request = replace(body, printer=body.printer or call.access.printer)
    return call.services.queue.add_jobs(body.file, request, request_id=call.request_id)


def _list_slices(call: CheckedRequest) -> tuple[SliceTask, ...]:
    return call.services.slicer.list_tasks()


def _get_slice(call: CheckedRequest) -> SliceTask:
    return call.services.slicer.find(call.path["task"])


def _cancel_slice(call: CheckedRequest) -> SliceTask:
    return call.services.slicer.cancel(call.path["task"])


def _get_job(call: CheckedRequest) -> JobDetails:
    queue = call.services.queue
    job = queue.find_job(call.path["job"])
    return JobDetails(job, queue.find_file(job.file), queue.read_facts(job.file), queue.list_runs(job.id))


def _explain_job(call: CheckedRequest) -> Explanation:
    return explain_job(call.services.queue, call.path["job"])


def _find_own_job(call: CheckedRequest) -> QueuedJob:
    """Return the job in the path, which the sender may change."""
    job = call.services.queue.find_job(call.path["job"])
    call.access.require("print", job.printer or ANY_PRINTER)
    return job


def _move_job(call: CheckedRequest) -> QueueSnapshot:
    job = _find_own_job(call)
    call.services.queue.move_job(job.id, call.body.before)
    return call.services.queue.snapshot()


def _hold_job(call: CheckedRequest) -> QueuedJob:
    job = _find_own_job(call)
    call.services.queue.hold_job(job.id)
    return call.services.queue.find_job(job.id)


def _release_job(call: CheckedRequest) -> QueuedJob:
    job = _find_own_job(call)
    call.services.queue.release_job(job.id)
    return call.services.queue.find_job(job.id)


def _cancel_job(call: CheckedRequest) -> QueuedJob:
    return call.services.queue.cancel_job(_find_own_job(call).id)


def _list_profiles(_: CheckedRequest) -> ProfileNames:
    from printer_slicer.profile.folders import find_profile_paths  # noqa: PLC0415 - slow

    return ProfileNames(*(tuple(find_profile_paths(kind)) for kind in ("printer", "material", "quality")))


def _list_printers(call: CheckedRequest) -> tuple[PrinterInfo, ...]:
    entries = call.services.queue.list_printers()
    return tuple(
        PrinterInfo(one.name, one.profile, one.groups, one.webcam, one.webcam_interval) for one in entries
    )


def _list_temperatures(call: CheckedRequest) -> tuple[TemperatureSample, ...]:
    return call.services.temperatures.list_samples(call.path["printer"])


def _set_bed(call: CheckedRequest) -> QueueSnapshot:
    printer = call.path["printer"]
    call.access.require("control", printer)
    call.services.queue.set_bed(printer, call.body.bed)
    return call.services.queue.snapshot()


def _set_material(call: CheckedRequest) -> QueueSnapshot:
    printer = call.path["printer"]
    call.access.require("control", printer)
    check_profile_name(call.body.material)
    call.services.queue.set_material(printer, call.body.material)
    return call.services.queue.snapshot()


def _command_print(call: CheckedRequest) -> dict[str, Any]:
    printer = call.path["printer"]
    call.access.require("control", printer)
    return call.services.send_command(printer, call.body.command)


_JOB: Final = "/v1/jobs/{job:job_number}"
_PRINTER: Final = "/v1/printers/{printer}"

OPERATIONS: Final = (
    Operation(
        "GET", "/v1/me", "read", "who sends this request, and what is allowed", _get_account, None, Account
    ),
    Operation("DELETE", "/v1/session", "read", "sign out", _end_session),
    Operation("GET", "/v1/keys", "admin", "list the keys", _list_keys, None, tuple[ApiKey, ...]),
    Operation("POST", "/v1/keys", "admin", "create a key", _create_key, KeyBody, NewKey),
    Operation("DELETE", "/v1/keys/{key}", "admin", "delete a key and end its sessions", _delete_key),
    Operation(
        "GET",
        "/v1/queue",
        "read",
        "printers, waiting jobs and running prints",
        _get_queue,
        None,
        QueueSnapshot,
    ),
    Operation(
        "GET",
        "/v1/explanations",
        "read",
        "why the first waiting jobs wait",
        _explain_queue,
        None,
        tuple[Explanation, ...],
    ),
    Operation(
        "GET",
        "/v1/history",
        "read",
        "the last jobs that ended, each with its last run",
        _list_history,
        None,
        tuple[tuple[QueuedJob, PrintRun | None], ...],
    ),
    Operation(
        "GET",
        "/v1/files",
        "read",
        "the files that were added last, with what is known of them",
        _list_files,
        None,
        tuple[tuple[QueuedFile, FileFacts | None], ...],
    ),
    Operation(
        "GET",
        "/v1/files/{file}",
        "read",
        "what is known of a file",
        _get_file,
        None,
        tuple[QueuedFile, FileFacts],
        is_slow=True,
    ),
    Operation("DELETE", "/v1/files/{file}", "print", "delete a file that no waiting job needs", _delete_file),
    Operation(
        "GET", "/v1/files/{file}/layers", "read", "the layers of a file", _list_layers, None, PreviewLayers
    ),
    Operation(
        "GET", "/v1/slices", "read", "the models that were sliced", _list_slices, None, tuple[SliceTask, ...]
    ),
    Operation("GET", "/v1/slices/{task}", "read", "how far a model is sliced", _get_slice, None, SliceTask),
    Operation("DELETE", "/v1/slices/{task}", "upload", "cancel slicing", _cancel_slice, None, SliceTask),
    Operation(
        "POST",
        "/v1/jobs",
        "print",
        "add jobs for a file",
        _add_jobs,
        JobBody,
        tuple[QueuedJob, ...],
        is_slow=True,
    ),
    Operation("GET", _JOB, "read", "a job with its file and runs", _get_job, None, JobDetails),
    Operation("GET", f"{_JOB}/explanation", "read", "why a job waits", _explain_job, None, Explanation),
    Operation("PUT", f"{_JOB}/place", "print", "move a job in the queue", _move_job, MoveBody, QueueSnapshot),
    Operation("PUT", f"{_JOB}/hold", "print", "hold a job until it is released", _hold_job, None, QueuedJob),
    Operation("DELETE", f"{_JOB}/hold", "print", "release a job", _release_job, None, QueuedJob),
    Operation(
        "DELETE", _JOB, "print", "cancel a job, also while it is printed", _cancel_job, None, QueuedJob
    ),
    Operation("GET", "/v1/profiles", "read", "names of the profiles", _list_profiles, None, ProfileNames),
    Operation(
        "GET",
        "/v1/printers",
        "read",
        "what printers.toml says of the printers",
        _list_printers,
        None,
        tuple[PrinterInfo, ...],
    ),
    Operation(
        "GET",
        f"{_PRINTER}/temperatures",
        "read",
        "temperatures of the last 24 hours",
        _list_temperatures,
        None,
        tuple[TemperatureSample, ...],
    ),
    Operation(
        "PUT", f"{_PRINTER}/bed", "control", "declare the state of a bed", _set_bed, BedBody, QueueSnapshot
    ),
    Operation(
        "PUT",
        f"{_PRINTER}/material",
        "control",
        "name the loaded material",
        _set_material,
        MaterialBody,
        QueueSnapshot,
    ),
    Operation(
        "POST",
        f"{_PRINTER}/command",
        "control",
        "send a command to the print",
        _command_print,
        CommandBody,
        None,
    ),
)
"""All operations with a method, a path and a scope."""
