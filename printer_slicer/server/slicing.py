"""Slice models that were uploaded, or compare their layer plans: one task after the other, in processes with limits.

Models are sliced as by `batch`, in a process that lasts while tasks wait; the G-code goes to the store of the queue.
Plans are compared by the command `plan`, whose messages tell the stage.
"""

from __future__ import annotations

import json
import re
import secrets
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from threading import Lock
from time import time
from typing import TYPE_CHECKING, Any, Final, Literal

from printer_slicer.batching.pool import ProcessExecutor
from printer_slicer.errors import PrinterSlicerError, UsageError
from printer_slicer.input_files import read_pieces
from printer_slicer.print_queue import PrintQueue
from printer_slicer.print_queue.records import clean_name
from printer_slicer.server.workers import LIMITS, FileReader
from printer_slicer.values import Struct, replace

if TYPE_CHECKING:
    from printer_slicer.batching.tasks import BatchResult

__all__ = ["SliceCommand", "SliceRequest", "SliceTask", "Slicer", "check_profile_name"]

SliceCommand = Literal["slice", "plan"]

_DAY: Final = 86400.0  # s
_MAX_TASKS: Final = 100  # tasks that are remembered
_KEY: Final = re.compile(r"[a-z][a-z0-9_.]{0,60}")
_PROFILE_NAME: Final = re.compile(r"[A-Za-z0-9](?!.*\.toml$)[\w .+-]{0,79}")
_STAGE: Final = re.compile(r"\s*[\d.]+ s  (.+)")
_OWN_NAME: Final = re.compile(r" model\.\w+")  # of the file, which users do not know
_USAGE: Final = 2  # exit code of the command


def check_profile_name(name: str) -> None:
    """Check that a text from outside names a profile, and is not the path of a file.

    Raises:
        UsageError: it is not a name.
    """
    if not _PROFILE_NAME.fullmatch(name):
        raise UsageError(
            f"{name[:40]!r} is not the name of a profile", remedy="See printer-slicer profiles list"
        )


class SliceRequest(Struct, frozen=True):
    """How a model is sliced.

    Attributes:
        printer: name of the printer in printers.toml.
        quality: name of the quality profile; empty: the default.
        settings: changed settings, as for `--set`.
        copies: number of copies.
    """

    printer: str
    quality: str = ""
    settings: Mapping[str, str] = {}
    copies: int = 1


class SliceTask(Struct, frozen=True):
    """A model that is sliced, or whose layer plans are compared.

    Attributes:
        id: random text.
        name: name of the model.
        printer: name of the printer.
        command: `slice` or `plan`.
        state: `waiting`, `slicing`, `done`, `failed` or `cancelled`.
        stage: what it does at the moment, such as `planning`.
        message: what went wrong, or the warnings, one per line.
        files: ids of the G-code files, one per plate.
        facts: what `slice --json` tells of each file, or what `plan --json` tells as `plans`.
    """

    id: str
    name: str
    printer: str
    command: SliceCommand = "slice"
    state: Literal["waiting", "slicing", "done", "failed", "cancelled"] = "waiting"
    stage: str = ""
    message: str = ""
    files: tuple[str, ...] = ()
    facts: tuple[Mapping[str, Any], ...] = ()


class Slicer:
    """Slices models, one at a time.

    Args:
        queue: the queue, whose store gets the files.
        reader: reads the facts of the files.
    """

    def __init__(self, queue: PrintQueue, reader: FileReader) -> None:
        self._queue, self._reader, self._lock = queue, reader, Lock()
        self._pool = ThreadPoolExecutor(1, "slicer")
        self._tasks: dict[str, SliceTask] = {}
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._futures: dict[str, Future[BatchResult]] = {}
        self._executor: ProcessExecutor | None = None
        self.folder = queue.folder / "models"
        """Folder of the models, each in a folder of its own until it is sliced."""
        self._delete_old_models()

    def _delete_old_models(self) -> None:
        """Delete the models that a killed server has left a day ago or earlier."""
        for path in self.folder.glob("*"):
            with suppress(OSError):
                if path.stat().st_mtime < time() - _DAY:
                    rmtree(path)

    def close(self) -> None:
        """Cancel all tasks."""
        for task in self.list_tasks():
            self.cancel(task.id)
        self._pool.shutdown()
        self._end_executor()

    def add(
        self, model: Path, name: str, request: SliceRequest, command: SliceCommand = "slice"
    ) -> SliceTask:
        """Add a task for a model in a folder of its own, which is deleted afterwards.

        Raises:
            UsageError: there is no such printer, or a setting has an impossible name.
        """
        names = self._choose_profiles(request)
        task = SliceTask(secrets.token_hex(8), clean_name(name), request.printer, command)
        with self._lock:
            while len(self._tasks) >= _MAX_TASKS:
                ended = (key for key, one in self._tasks.items() if one.state not in {"waiting", "slicing"})
                oldest = next(ended, None)
                if oldest is None:
                    raise UsageError(
                        "too many models are waiting", remedy="Wait until some are sliced, or cancel them"
                    )
                del self._tasks[oldest]
            self._tasks[task.id] = task
        self._pool.submit(self._run, task.id, model, request, names)
        return task

    def list_tasks(self) -> tuple[SliceTask, ...]:
        """Return all tasks that are remembered, the oldest first."""
        with self._lock:
            return tuple(self._tasks.values())

    def find(self, task: str) -> SliceTask:
        """Return a task.

        Raises:
            UsageError: there is none with this id.
        """
        with self._lock:
            if task not in self._tasks:
                raise UsageError("there is no such slicing task", remedy="Upload the model again")
            return self._tasks[task]

    def cancel(self, task: str) -> SliceTask:
        """Cancel a task that waits or is being sliced.

        Raises:
            UsageError: there is none with this id.
        """
        found = self.find(task)
        with self._lock:
            if found.state in {"waiting", "slicing"}:
                self._tasks[task] = replace(self._tasks[task], state="cancelled", stage="")
            if task in self._processes:
                self._processes[task].kill()
            future = self._futures.get(task)
        if future is not None:
            future.cancel()
        with self._lock:
            return self._tasks[task]

    def _choose_profiles(self, request: SliceRequest) -> dict[str, str]:
        """Check a request, and return its printer, material and quality; without a quality, the default."""
        entries = {entry.name: entry for entry in self._queue.list_printers()}
        if request.printer not in entries:
            raise UsageError(
                f"there is no printer {request.printer!r}",
                remedy=f"Choose one of: {', '.join(entries)}",
            )
        if not 1 <= request.copies <= 200:
            raise UsageError(f"cannot slice {request.copies} copies", remedy="Choose 1 to 200 copies")
        wrong = [key for key in request.settings if not _KEY.fullmatch(key)]
        if wrong:
            raise UsageError(
                f"{wrong[0][:40]!r} is not a setting", remedy="See printer-slicer profiles settings"
            )
        if request.quality:
            check_profile_name(request.quality)
        entry = entries[request.printer]
        state = next(one for one in self._queue.snapshot().printers if one.name == request.printer)
        names = {"printer": entry.profile, "material": state.material}
        return names | ({"quality": request.quality} if request.quality else {})

    def _change(self, task: str, **values: Any) -> bool:
        """Change a task that was not cancelled; return whether it was changed."""
        with self._lock:
            if self._tasks[task].state == "cancelled":
                return False
            self._tasks[task] = replace(self._tasks[task], **values)
            return True

    def _run(self, task: str, model: Path, request: SliceRequest, names: Mapping[str, str]) -> None:
        """Slice a model, and store the G-code, or compare its plans."""
        try:
            if self._change(task, state="slicing", stage="starting"):
                work = self._slice if self.find(task).command == "slice" else self._plan
                work(task, model, request, names)
        except Exception as error:  # noqa: BLE001 - a fault of one task must not stop the others
            self._change(task, state="failed", stage="", message=f"internal error of the server: {error}")
        finally:
            with self._lock:
                self._processes.pop(task, None)
                self._futures.pop(task, None)
            rmtree(model.parent, ignore_errors=True)
            if all(one.state != "waiting" for one in self.list_tasks()):
                self._end_executor()

    def _end_executor(self) -> None:
        """End the process that slices, because it needs much memory."""
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None

    def _slice(self, task: str, model: Path, request: SliceRequest, names: Mapping[str, str]) -> None:
        """Slice a model, and store its G-code."""
        from printer_slicer.batching.tasks import read_task_model  # noqa: PLC0415 - most servers only print
        from printer_slicer.server.model_slicing import UploadedModel, slice_upload  # noqa: PLC0415 - the same

        name, output = self.find(task).name, model.parent / "sliced"
        output.mkdir()
        file = replace(read_task_model(model), name=name)
        upload = UploadedModel(task, file, names, request.settings, request.copies, str(output))
        if self._executor is None:
            self._executor = ProcessExecutor(1, LIMITS, self._note_stage)
        future = self._executor.submit(slice_upload, upload)
        with self._lock:
            self._futures[task] = future
        result = self._wait_for(future)
        text = (
            (result.problem or "\n".join(result.warnings)).replace(str(model), name).replace(model.name, name)
        )
        if result.problem:
            self._change(task, state="failed", stage="", message=text)
            return
        files = tuple(self._store(output / one.name, len(result.files), name) for one in result.files)
        facts = tuple(one.facts for one in result.files)
        self._change(task, state="done", stage="", files=files, facts=facts, message=text)

    def _note_stage(self, task: str, stage: str) -> None:
        """Note a stage that the process tells."""
        with suppress(KeyError):  # the task was forgotten
            self._change(task, stage=stage)

    def _wait_for(self, future: Future[BatchResult]) -> BatchResult:
        """Return the result of a task; a process that ended is a problem, too."""
        from printer_slicer.batching.tasks import BatchResult  # noqa: PLC0415 - most servers only print

        try:
            return future.result()
        except PrinterSlicerError as error:
            problem = str(error)
        except (CancelledError, OSError):  # also if it took too long, or its process was killed
            problem = "the model needs more time or memory than allowed"
        return BatchResult("", "", "", "", problem=problem)

    def _plan(self, task: str, model: Path, request: SliceRequest, names: Mapping[str, str]) -> None:
        """Compare the layer plans of a model."""
        found = self.find(task)
        options = [*names.items(), ("copies", request.copies)]
        options += [("set", f"{key}={value}") for key, value in request.settings.items()]
        words = ["plan", str(model), *(f"--{key}={value}" for key, value in options)]
        words += [f"--{name}" for name in ("json", "verbose")]
        code, text, line = self._run_command(task, words)
        text = text.replace(str(model), found.name).replace(model.name, found.name)
        if code:
            text = text.removeprefix("printer-slicer: ") or "the model needs more time or memory than allowed"
            self._change(task, state="failed", stage="", message=text)
            return
        facts = ({"plans": _parse_facts(line, model, found.name)["plans"]},)
        self._change(task, state="done", stage="", facts=facts, message=text)

    def _run_command(self, task: str, words: Sequence[str]) -> tuple[int, str, str]:
        """Run a command, and follow its stages; return its exit code, its other messages, and its output."""
        command = [sys.executable, "-m", "printer_slicer.server.limited_command", *words]
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen(command, text=True, errors="replace", **pipes) as process:  # type: ignore[call-overload] # noqa: S603 - no shell
            with self._lock:
                self._processes[task] = process
            messages = self._follow(task, process)
            output = process.stdout.read()
        return process.returncode, "\n".join(messages), output

    def _follow(self, task: str, process: Any) -> list[str]:
        """Note each stage that the command reports; return its other messages."""
        messages = []
        for line in process.stderr:
            stage = _STAGE.fullmatch(line.rstrip("\n"))
            if stage is not None:
                self._change(task, stage=_OWN_NAME.sub("", stage[1]))
            elif line.strip():
                messages.append(line.rstrip())
        return messages[-20:]

    def _store(self, path: Path, n_plates: int, model: str) -> str:
        """Add a file of G-code to the store, and read its facts; return its id."""
        base = model.rsplit(".", 1)[0]
        number = path.stem.rsplit("-", 1)[-1]
        name = f"{base}-{number}.gcode" if n_plates > 1 else f"{base}.gcode"
        stored = self._queue.add_file(name, read_pieces(path))
        with suppress(UsageError):
            self._reader.read(stored.id)
        return stored.id


def _parse_facts(line: str, model: Path, name: str) -> dict[str, Any]:
    """Return a line of JSON as a value in which the model has its name instead of its path."""
    shown = json.dumps(name)[1:-1]
    for own in (str(model), model.name):
        line = line.replace(json.dumps(own)[1:-1], shown)
    facts: dict[str, Any] = json.loads(line)
    return facts
