"""A world with printers, a person, a queue, and processes that are killed anywhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import Any
from unittest.mock import patch

from printer_slicer.errors import UsageError
from printer_slicer.print_queue import supervisor as supervising
from printer_slicer.print_queue.file_facts import FileFacts
from printer_slicer.print_queue.matching import PrinterTraits
from printer_slicer.print_queue.queue_store import PrintQueue
from printer_slicer.print_queue.records import JobRequest, QueuedJob, RunOutcome
from printer_slicer.print_queue.run_folder import (
    READY_FILE,
    RunResult,
    lock_run,
    read_instructions,
    try_to_claim,
    write_result,
)
from printer_slicer.print_queue.supervisor import Supervisor
from printer_slicer.process_lock import ProcessLock

PRINTERS = """
[left]
port = "/dev/left"
profile = "marlin_220"
groups = ["both"]
[right]
port = "/dev/right"
profile = "marlin_220"
groups = ["both"]
"""
TRAITS = PrinterTraits((0, 0, 0), (200, 200, 200), "marlin", 0.4, "PLA", "pla")
FACTS = FileFacts(low=(1, 1, 0.2), high=(20, 20, 10), flavour="marlin", nozzle=0.4, material="PLA")


MEMORY = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
"""A folder in memory: thousands of transactions are not to wait for a disk."""


def make_folder() -> Path:
    """A new folder, which the caller removes."""
    return Path(mkdtemp(prefix="queue-", dir=MEMORY))


class Killed(BaseException):
    """The supervisor is killed here."""


class World:
    """What really happens, as opposed to what the queue knows.

    Attributes:
        parts: printers with a part on the bed.
        prints: job -> how often its first byte was sent since a person released it last.
        processes: the living processes of runs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        (folder / "printers.toml").write_text(PRINTERS, encoding="utf-8")
        self.parts: set[str] = set()
        self.prints: Counter[int] = Counter()
        self.processes: list[Process] = []
        self._kill_after = -1
        self.queue = PrintQueue(folder / "queue", folder / "printers.toml")
        self.file = self.queue.add_file("part.gcode", [b"G28\n"]).id
        self.queue.store_facts(self.file, FACTS)
        self.queue.list_printers()
        self._supervise()

    def close(self) -> None:
        """Kill what lives."""
        for process in list(self.processes):
            process.die()
        self.queue.close()

    # The supervisor and its death.

    def step(self, kill_after: int = -1) -> None:
        """Let the supervisor look once; it is killed after so many steps, and another one begins.

        Args:
            kill_after: number of steps, of which each call that changes something has one before and one after.
        """
        self._kill_after = kill_after
        with self._patched():
            try:
                self._supervisor.step()
            except Killed:
                self.restart()
        self._kill_after = -1

    def restart(self) -> None:
        """Kill the supervisor: another process opens the same folder, and knows no processes."""
        self._kill_after = -1
        self.queue.close()
        self.queue = PrintQueue(self._folder / "queue", self._folder / "printers.toml")
        self._supervise()

    def _supervise(self) -> None:
        with patch.object(supervising, "default_job_store", lambda: self._folder / "prints"):
            self._supervisor = Supervisor(self.queue, launch=self._killable(self._launch))
        self._supervisor.recover()

    @contextmanager
    def _patched(self) -> Iterator[None]:
        """The calls that change something may be the last ones of the supervisor."""
        queue = self.queue
        with (
            patch.object(supervising, "create_run_folder", self._killable(supervising.create_run_folder)),
            patch.object(supervising, "try_to_claim", self._killable(supervising.try_to_claim)),
            patch.object(supervising, "read_traits", lambda *_: TRAITS),
            patch.object(supervising, "send_control_command", self._ask_to_cancel),
            patch.object(queue, "begin_run", self._killable(self._begin_run)),
            patch.object(queue, "mark_printing", self._killable(queue.mark_printing)),
            patch.object(queue, "end_run", self._killable(queue.end_run)),
        ):
            yield

    def _killable(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def killable(*arguments: Any) -> Any:
            self._tick()
            result = call(*arguments)
            self._tick()
            return result

        return killable

    def _tick(self) -> None:
        if self._kill_after == 0:
            raise Killed
        self._kill_after -= 1

    def _begin_run(self, run: str, job: int, printer: str) -> bool:
        """No job is started before another one that stands before it and could be printed here, too."""
        for one in self.waiting():
            if one.id == job:
                break
            assert one.state != "ready" or one.printer not in {"", "both", printer}, "the order is not kept"
        return PrintQueue.begin_run(self.queue, run, job, printer)

    def _launch(self, folder: Path) -> Process:
        process = Process(self, folder)
        self.processes.append(process)
        return process

    def _ask_to_cancel(self, folder: Path, line: str, timeout: float) -> None:
        """The control socket of a print."""
        for process in self.processes:
            if process.folder.name == folder.name and line == "cancel" and timeout:
                process.is_cancelled = True

    # A person.

    def waiting(self) -> list[QueuedJob]:
        """The jobs that have not ended, in order."""
        return list(self.queue.snapshot().jobs)

    def add(self, printer: str = "", *, held: bool = False, first: bool = False) -> int:
        """Add a job; return its number."""
        request = JobRequest(printer=printer, held=held, first=first)
        return self.queue.add_jobs(self.file, request)[0].id

    def clear_bed(self, printer: str) -> None:
        """Take the part off, if nothing is printing there, and say so."""
        with suppress(UsageError):
            self.queue.set_bed(printer, "clear")
            assert not [one for one in self.processes if one.printer == printer and one.has_begun]
            self.parts.discard(printer)

    def release(self, job: int) -> None:
        """Release a job, which may be printed once more if it had ended."""
        before = self.queue.find_job(job).state
        with suppress(UsageError):
            self.queue.release_job(job)
            if before != "held":
                self.prints[job] = 0


class Process:
    """The process of a run, as `run_print` does it, one action at a time.

    Attributes:
        folder: the folder of the run.
        printer: name of the printer.
        has_begun: whether the first byte was sent.
        is_cancelled: whether the print was asked to end.
    """

    def __init__(self, world: World, folder: Path) -> None:
        self._world, self.folder = world, folder
        instructions = read_instructions(folder)
        self.printer = instructions.printer["name"]
        self.has_begun = self.is_cancelled = False
        self._lock: ProcessLock | None = None
        self._actions = iter((self._take_lock, self._claim, self._begin, self._report_ready))
        self._is_alive = True

    def poll(self) -> int | None:
        """As that of `subprocess.Popen`."""
        return None if self._is_alive else 1

    def advance(self, outcome: RunOutcome) -> None:
        """Do the next action; the print ends with this outcome if there is none left."""
        action = next(self._actions, None)
        if action is not None:
            action()
            return
        write_result(self.folder, RunResult("cancelled" if self.is_cancelled else outcome))
        self.die()

    def die(self) -> None:
        """End the process, wherever it is."""
        self._is_alive = False
        if self._lock is not None:
            self._lock.release()
        self._world.processes.remove(self)

    def _take_lock(self) -> None:
        self._lock = lock_run(self.folder)
        assert self._lock is not None

    def _claim(self) -> None:
        if not try_to_claim(self.folder):
            self.die()

    def _begin(self) -> None:
        """The first byte is sent."""
        self.has_begun = True
        job = next(run.job for run in self._world.queue.list_active_runs() if run.id == self.folder.name)
        assert self.printer not in self._world.parts, "there is a part on the bed"
        assert not self._world.prints[job], "the job is printed twice"
        self._world.parts.add(self.printer)
        self._world.prints[job] += 1

    def _report_ready(self) -> None:
        (self.folder / READY_FILE).write_text("{}", encoding="utf-8")
