"""Slice models that were uploaded, or compare their layer plans: one task after the other, in processes with limits.

The process runs the command `slice` or `plan`, so a model becomes the same G-code as on the command line. Its messages
tell the stage; the result of `slice` are files in the store of the queue.
"""

from __future__ import annotations

import json
import re
import secrets
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from threading import Lock
from typing import Any, Final, Literal

from printer_slicer.errors import UsageError
from printer_slicer.input_files import read_pieces
from printer_slicer.print_queue import PrintQueue
from printer_slicer.print_queue.records import clean_name
from printer_slicer.server.workers import FileReader
from printer_slicer.values import Struct, replace

__all__ = ["MODEL_ENDINGS", "SliceCommand", "SliceRequest", "SliceTask", "Slicer", "check_profile_name"]

MODEL_ENDINGS: Final = (".stl", ".3mf", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ".stp")
"""Endings of the names of models."""

SliceCommand = Literal["slice", "plan"]

_MAX_TASKS: Final = 100  # tasks that are remembered
_KEY: Final = re.compile(r"[a-z][a-z0-9_.]{0,60}")
_PROFILE_NAME: Final = re.compile(r"[A-Za-z0-9](?!.*\.toml$)[\w .+-]{0,79}")
_STAGE: Final = re.compile(r"\s*[\d.]+ s  (.+)")
_OWN_NAME: Final = re.compile(r" model\.\w+")  # of the file, which users do not know
_USAGE: Final = 2  # exit code of the command


def check_profile_name(name: str) -> None:
    """Check that a text from outside names a profile, and is not the path of a file.

    Raises:
        UsageError: it is no name.
    """
    if not _PROFILE_NAME.fullmatch(name):
        raise UsageError(f"{name[:40]!r} is no name of a profile", remedy="See printer-slicer profiles list")


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
        facts: what the command tells with `--json`, without paths: one entry per file, or of `plan` one with `plans`.
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
        self.folder = queue.folder / "models"
        """Folder of the models, each in a folder of its own until it is sliced."""

    def close(self) -> None:
        """Cancel all tasks."""
        for task in self.list_tasks():
            self.cancel(task.id)
        self._pool.shutdown()

    def add(
        self, model: Path, name: str, request: SliceRequest, command: SliceCommand = "slice"
    ) -> SliceTask:
        """Add a task for a model in a folder of its own, which is deleted afterwards.

        Raises:
            UsageError: there is no such printer, or a setting has an impossible name.
        """
        arguments = self._list_arguments(request)
        task = SliceTask(secrets.token_hex(8), clean_name(name), request.printer, command)
        with self._lock:
            while len(self._tasks) >= _MAX_TASKS:
                ended = (key for key, one in self._tasks.items() if one.state not in {"waiting", "slicing"})
                oldest = next(ended, None)
                if oldest is None:
                    raise UsageError(
                        "too many models wait", remedy="Wait until some are sliced, or cancel them"
                    )
                del self._tasks[oldest]
            self._tasks[task.id] = task
        self._pool.submit(self._run, task.id, model, arguments)
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
            return self._tasks[task]

    def _list_arguments(self, request: SliceRequest) -> list[str]:
        """Return the options of the command."""
        entries = {entry.name: entry for entry in self._queue.list_printers()}
        if request.printer not in entries:
            raise UsageError(
                f"there is no printer {request.printer or 'without a name'}",
                remedy=f"Choose one of: {', '.join(entries)}",
            )
        if not 1 <= request.copies <= 200:
            raise UsageError(f"{request.copies} copies", remedy="Choose 1 to 200 copies")
        wrong = [key for key in request.settings if not _KEY.fullmatch(key)]
        if wrong:
            raise UsageError(
                f"{wrong[0][:40]!r} is no setting", remedy="See printer-slicer profiles settings"
            )
        if request.quality:
            check_profile_name(request.quality)
        entry = entries[request.printer]
        state = next(one for one in self._queue.snapshot().printers if one.name == request.printer)
        options = [("printer", entry.profile), ("material", state.material), ("copies", request.copies)]
        options += [("quality", request.quality)] if request.quality else []
        options += [("set", f"{key}={value}") for key, value in request.settings.items()]
        return [f"--{name}={value}" for name, value in options]

    def _change(self, task: str, **values: Any) -> bool:
        """Change a task that was not cancelled; return whether it was changed."""
        with self._lock:
            if self._tasks[task].state == "cancelled":
                return False
            self._tasks[task] = replace(self._tasks[task], **values)
            return True

    def _run(self, task: str, model: Path, arguments: Sequence[str]) -> None:
        """Slice a model, and store the G-code."""
        try:
            if self._change(task, state="slicing", stage="starting"):
                self._work(task, model, arguments)
        except Exception as error:  # noqa: BLE001 - a fault of one task must not stop the others
            self._change(task, state="failed", stage="", message=f"the server has a fault: {error}")
        finally:
            with self._lock:
                self._processes.pop(task, None)
            rmtree(model.parent, ignore_errors=True)

    def _work(self, task: str, model: Path, arguments: Sequence[str]) -> None:
        """Run the command of a task, and store its result."""
        found = self.find(task)
        output = model.parent / "sliced"
        output.mkdir()
        written = ["-o", f"{output}/{model.stem}.gcode"] if found.command == "slice" else []
        words = [found.command, str(model), *written, "--json", "--verbose", *arguments]
        code, text, lines = self._run_command(task, words)
        text = text.replace(str(model), found.name).replace(model.name, found.name)
        if code:
            text = text.removeprefix("printer-slicer: ") or "the model needs more time or memory than allowed"
            self._change(task, state="failed", stage="", message=text)
            return
        facts = [_parse_facts(line, model, found.name) for line in lines.splitlines()]
        if found.command == "plan":
            facts = [{"plans": one["plans"]} for one in facts]
        paths = [Path(one.pop("output")) for one in facts if "output" in one]
        files = tuple(self._store(path, len(paths), found.name) for path in paths)
        self._change(task, state="done", stage="", files=files, facts=tuple(facts), message=text)

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
