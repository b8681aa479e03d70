"""An executor whose tasks run in separate processes: if one takes too long or is killed, only its task fails."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process, resource_tracker
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.freed_memory import keep_freed_memory
from printer_slicer.process_limits import ProcessLimits, limit_process

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from pebble import ProcessPool

    from printer_slicer.batching.tasks import BatchResult, BatchTask

__all__ = ["ProcessExecutor", "describe_lost_process", "slice_and_report"]

_THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_MAX_STAGE: Final = 200
"""Characters of a name; below 4096 bytes, what a process writes at once reaches the pipe undivided."""
_stages: Connection | None = None
"""In a process of the pool: the pipe to which it writes the names of its stages."""


_USUAL: Final = ProcessLimits()


class ProcessExecutor(Executor):
    """Runs functions in processes that were started afresh, so that they share nothing with this one.

    If a process ends, its task fails with `pebble.ProcessExpired` and another process takes its place. After
    `max_seconds`, a process is killed, and its task fails with `TimeoutError`.

    Args:
        n_processes: how many tasks run at the same time.
        limits: of each process.
        tell_stage: called with the name of a task and the name of each stage that it starts, in a thread.
    """

    def __init__(
        self,
        n_processes: int,
        limits: ProcessLimits = _USUAL,
        tell_stage: Callable[[str, str], None] | None = None,
    ) -> None:
        from pebble import ProcessPool  # noqa: PLC0415 - slow

        context = get_context("spawn")
        self._limits = limits
        self._reader: Connection | None = None
        self._writer: Connection | None = None
        if tell_stage is not None:
            self._reader, self._writer = context.Pipe(duplex=False)
            Thread(target=_follow_stages, args=(self._reader, tell_stage), daemon=True).start()
        self._pool: ProcessPool = ProcessPool(
            n_processes, initializer=_prepare, initargs=(limits, self._writer), context=context
        )

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a function in one of the processes; cancelling the future kills it."""
        with (
            _hold_interrupts()
        ):  # the first task starts the processes, and they inherit which signals are held
            return self._pool.schedule(fn, args=args, kwargs=kwargs, timeout=self._limits.max_seconds)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, after the tasks that were submitted or at once."""
        if cancel_futures:
            self._pool.stop()  # type: ignore[no-untyped-call]
        else:
            self._pool.close()  # type: ignore[no-untyped-call]
        if wait:
            self._pool.join()
        for end in (self._writer, self._reader):
            if end is not None:
                end.close()


def _follow_stages(reader: Connection, tell: Callable[[str, str], None]) -> None:
    """Pass on what the processes tell, until the pipe is closed."""
    with suppress(EOFError, OSError):
        while True:
            task, _, stage = reader.recv_bytes().decode().partition("\n")
            tell(task, stage)


@contextmanager
def _hold_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back in this thread; where systems can."""
    if os.name != "posix":
        yield
        return
    resource_tracker.ensure_running()  # multiprocessing starts this process first, and would end the holding
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """End this process as soon as the one that started it has ended, even in the middle of a task."""
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


def _prepare(limits: ProcessLimits, stages: Connection | None) -> None:
    """Set the limits of a new process, before it imports numpy."""
    global _stages  # noqa: PLW0603 - what a process knows from its start
    _stages = stages
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    # Ctrl-C reaches all processes, and the first one ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()
    keep_freed_memory()
    limit_process(limits)


def slice_and_report(task: BatchTask) -> BatchResult:
    """Slice in a process of the pool, and tell each stage."""
    from printer_slicer.batching.slicing import slice_task  # noqa: PLC0415 - after `_prepare`

    return slice_task(task, lambda stage: _tell_stage(task.name, stage))


def _tell_stage(task: str, stage: str) -> None:
    """Tell that a stage starts.

    All processes write to one pipe without a lock: a process that is killed could not release it.
    """
    if _stages is not None:
        with suppress(OSError):
            _stages.send_bytes(f"{task[-_MAX_STAGE:]}\n{stage[:_MAX_STAGE]}".encode())


def describe_lost_process(error: BaseException) -> str:
    """Say how a process ended, such as `by signal 9`."""
    code = getattr(error, "exitcode", None)
    if isinstance(code, int) and code < 0:
        return f"its process was killed by signal {-code}"
    return "its process ended" if isinstance(code, int) else f"{type(error).__name__}: {error}".rstrip(": ")
