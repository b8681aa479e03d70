"""The folder of a run: how the process that prints and the supervisor agree on whether a print has begun and ended.

    run.json      what to print; written before the process starts
    lock          locked by the process from its start to its end
    claim         created once, by the process before it opens the port, or by a supervisor that finds no process
    ready.json    written by the process when the print can be controlled
    cancel        created when a person asks for the end of a print on a print server
    result.json   written by the process at its end
    log           its output

Whoever creates the claim decides: the process prints, or the supervisor knows that it never will.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from typing import Any, Final, Literal, NamedTuple, get_args

from printer_slicer.errors import OutputError
from printer_slicer.print_queue.records import RunOutcome
from printer_slicer.process_lock import ProcessLock
from printer_slicer.saving import save, sync_folder
from printer_slicer.values import Struct, as_dict

__all__ = [
    "LOG_FILE",
    "READY_FILE",
    "RunInstructions",
    "RunReport",
    "RunResult",
    "create_run_folder",
    "is_end_requested",
    "lock_run",
    "read_instructions",
    "read_report",
    "request_end",
    "try_to_claim",
    "write_result",
]

READY_FILE: Final = "ready.json"
LOG_FILE: Final = "log"
_INSTRUCTIONS_FILE, _LOCK_FILE, _CLAIM_FILE, _RESULT_FILE = "run.json", "lock", "claim", "result.json"
_CANCEL_FILE: Final = "cancel"
_LOCK_TIMEOUT: Final = 30.0  # s; others hold the lock only to see whether it is free


class RunInstructions(Struct, frozen=True):
    """What a run prints.

    Attributes:
        name: name of the job.
        file: path of the G-code.
        printer: the keys of the printer in printers.toml, and its name.
        material: name of the loaded material.
        allow: names of findings that do not prevent the print.
        job_store: folder of the stored prints.
    """

    name: str
    file: str
    printer: dict[str, Any]
    material: str
    allow: tuple[str, ...]
    job_store: str


class RunResult(Struct, frozen=True):
    """How a run ended.

    Attributes:
        outcome: how it ended.
        message: why it ended so.
        findings: names of the findings that prevented the print.
    """

    outcome: RunOutcome
    message: str = ""
    findings: tuple[str, ...] = ()


class RunReport(NamedTuple):
    """What the folder of a run says.

    Attributes:
        state: `unclaimed`: no process runs, and none has claimed the run; `starting`; `printing`: the print can be
            controlled; `ended`.
        result: how it ended; None before.
    """

    state: Literal["unclaimed", "starting", "printing", "ended"]
    result: RunResult | None = None


def lock_run(folder: Path) -> ProcessLock | None:
    """Lock a run for the process that prints it; return None if another process has locked it."""
    lock = ProcessLock(folder / _LOCK_FILE)
    return lock if lock.acquire(_LOCK_TIMEOUT) else None


def create_run_folder(folder: Path, instructions: RunInstructions) -> None:
    """Create the folder of a new run.

    Raises:
        OutputError: it cannot be created.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder.mkdir(mode=0o700)
        save(folder / _INSTRUCTIONS_FILE, json.dumps(as_dict(instructions)).encode())
    except OSError as error:
        rmtree(folder, ignore_errors=True)
        raise OutputError(
            f"{folder}: the folder of the print cannot be created: {error.strerror}",
            remedy="Free some disk space, or check the permissions",
        ) from None


def read_instructions(folder: Path) -> RunInstructions:
    """Read what a run prints.

    Raises:
        OSError: the file is missing.
        ValueError: the file is damaged.
    """
    values = json.loads((folder / _INSTRUCTIONS_FILE).read_bytes())
    return RunInstructions(**values | {"allow": tuple(values["allow"])})


def try_to_claim(folder: Path) -> bool:
    """Claim a run; return False if it has been claimed before, by this process or another.

    A folder that does not exist counts as claimed by this process: no process can print from it.
    """
    try:
        handle = os.open(folder / _CLAIM_FILE, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return False
    except FileNotFoundError:
        return True
    try:
        os.write(handle, str(os.getpid()).encode())
        os.fsync(handle)
    finally:
        os.close(handle)
    sync_folder(folder)
    return True


def request_end(folder: Path) -> None:
    """Ask the process of a run to cancel its print on a print server."""
    with suppress(OSError):
        (folder / _CANCEL_FILE).touch(mode=0o600)


def is_end_requested(folder: Path) -> bool:
    """Return whether a person has asked for the end of the print."""
    return (folder / _CANCEL_FILE).exists()


def write_result(folder: Path, result: RunResult) -> None:
    """Write how a run ended; the file appears complete or not at all."""
    save(folder / _RESULT_FILE, json.dumps(as_dict(result)).encode())


def _parse_result(content: bytes) -> RunResult:
    """Return how a run ended from the content of its file.

    Raises:
        ValueError, TypeError: the content is damaged.
    """
    values: dict[str, Any] = json.loads(content)
    return RunResult(**values | {"findings": tuple(values.get("findings", ()))})


def read_report(folder: Path) -> RunReport:
    """Return what the folder says about the run at this moment."""
    if _is_locked(folder):
        return RunReport("printing" if (folder / READY_FILE).exists() else "starting")
    if (result := _read_result(folder)) is not None:
        return RunReport("ended", result)
    if not (folder / _CLAIM_FILE).exists():
        return RunReport("unclaimed")
    return RunReport("ended", RunResult("lost", "the print process ended without a result"))


def _is_locked(folder: Path) -> bool:
    """Return whether a process has locked the run."""
    path = folder / _LOCK_FILE
    return path.exists() and ProcessLock(path).is_held()


def _read_result(folder: Path) -> RunResult | None:
    """Read how a run ended; None if it has written no valid result."""
    with suppress(OSError, ValueError, TypeError):
        result = _parse_result((folder / _RESULT_FILE).read_bytes())
        if result.outcome in get_args(RunOutcome):
            return result
    return None
