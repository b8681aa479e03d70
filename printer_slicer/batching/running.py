"""Run tasks with any executor: the largest models first, few at a time, and once more if a worker was lost."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from printer_slicer.batching.manifest import Manifest, lock_folder, read_manifest
from printer_slicer.batching.pool import describe_lost_process
from printer_slicer.batching.tasks import BatchResult, BatchTask, describe_error, fail_task
from printer_slicer.errors import UsageError
from printer_slicer.saving import save
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.batching.executors import Workers

__all__ = ["Submit", "Tell", "WrongWorkerError", "run_batch", "run_tasks", "send_task"]

Submit = Callable[[BatchTask], "Future[BatchResult]"]
"""Starts a task."""

_MAX_ATTEMPTS: Final = 2
_MAX_REJECTIONS: Final = 20
_RECOUNT_SECONDS: Final = 5.0


class WrongWorkerError(Exception):
    """A worker cannot run a task that others can, such as one that has another version of this package."""


def run_tasks(
    tasks: Iterable[BatchTask], submit: Submit, count_pending: Callable[[], int]
) -> Iterator[BatchResult]:
    """Yield the result of each task when it is there; every task has exactly one.

    A task whose worker was lost is started once more. If the iteration ends early, tasks that have not ended are
    cancelled.

    Args:
        tasks: any number.
        submit: starts a task; its future fails with `TimeoutError` if the task took too long, and with any other error
            if its worker was lost.
        count_pending: how many tasks may be submitted at the same time; asked again every few seconds, because workers
            may join.
    """
    waiting = deque(sorted(tasks, key=lambda task: -task.model.size))
    attempts, rejections = Counter[str](), Counter[str]()
    pending: dict[Future[BatchResult], BatchTask] = {}
    try:
        while waiting or pending:
            while waiting and len(pending) < count_pending():
                task = waiting.popleft()
                attempts[task.name] += 1
                pending[_submit(task, submit)] = task
            done, _ = wait(pending, _RECOUNT_SECONDS, return_when=FIRST_COMPLETED)
            for future in done:
                task = pending.pop(future)
                is_rejected = not future.cancelled() and isinstance(future.exception(), WrongWorkerError)
                rejections[task.name] += is_rejected
                # A scheduler that starts again cancels all tasks.
                if future.cancelled() or (is_rejected and rejections[task.name] < _MAX_REJECTIONS):
                    attempts[task.name] -= 1
                result = _read_result(future, task, is_last=attempts[task.name] >= _MAX_ATTEMPTS)
                if result is None:
                    waiting.append(task)
                else:
                    yield result
    finally:
        for future in pending:
            future.cancel()


def _submit(task: BatchTask, submit: Submit) -> Future[BatchResult]:
    """Start a task; a broken executor is an error of the task, so that the results of the others are not lost."""
    try:
        return submit(task)
    except BrokenExecutor as error:
        future: Future[BatchResult] = Future()
        future.set_exception(error)
        return future


def _read_result(future: Future[BatchResult], task: BatchTask, *, is_last: bool) -> BatchResult | None:
    """Return the result of a task that ended; None if its worker was lost and it can be started again."""
    error = CancelledError() if future.cancelled() else future.exception()
    if error is None:
        return future.result()
    if isinstance(error, CancelledError):
        return None
    if isinstance(error, TimeoutError):
        problem = f"slicing took longer than {task.max_seconds:g} s"
    elif is_last and isinstance(error, WrongWorkerError):
        problem = str(error)
    elif is_last:
        problem = f"{describe_lost_process(error)}, in {_MAX_ATTEMPTS} attempts; it may need more memory"
    else:
        return None
    return fail_task(task, problem)


def send_task(task: BatchTask, submit: Submit) -> Future[BatchResult]:
    """Start a task on another machine, with the content of its model; one that cannot be read costs only its task."""
    try:
        sent = replace(task, model=task.model.with_content(), folder="")
    except UsageError as error:
        future: Future[BatchResult] = Future()
        future.set_result(fail_task(task, describe_error(error)))
        return future
    return submit(sent)


class Tell(Protocol):
    """A function that receives each result."""

    def __call__(self, result: BatchResult, *, is_kept: bool) -> None:
        """Take a result; `is_kept` if it is that of an earlier run."""


def _tell_nobody(result: BatchResult, *, is_kept: bool) -> None:
    """Ignore a result."""


def run_batch(
    tasks: Sequence[BatchTask],
    workers: Workers,
    folder: Path | None,
    *,
    resumes: bool = False,
    tell: Tell = _tell_nobody,
) -> tuple[BatchResult, ...]:
    """Run tasks, and note each result in the manifest of a folder.

    Args:
        tasks: with unique names.
        workers: where they run.
        folder: for the files of G-code, and the manifest; None: the results contain the files.
        resumes: whether tasks that the manifest has, with unchanged files, are not run again.
        tell: called with each result when it is there.

    Returns:
        The result of each task, in the order of the tasks.

    Raises:
        OutputError: a file cannot be written, or another batch writes into the folder.
    """
    with lock_folder(folder) if folder is not None else nullcontext():
        return _run_batch(tasks, workers, folder, resumes=resumes, tell=tell)


def _run_batch(
    tasks: Sequence[BatchTask], workers: Workers, folder: Path | None, *, resumes: bool, tell: Tell
) -> tuple[BatchResult, ...]:
    """Run tasks, and note each result in the manifest of a folder that no other batch uses."""
    earlier = read_manifest(folder) if folder is not None and resumes else {}
    found = {
        task.name: one for task in tasks if (one := earlier.pop(task.name, None)) and one.key == task.key
    }
    manifest = Manifest(folder, [*earlier.values(), *found.values()]) if folder is not None else None
    for result in found.values():
        tell(result, is_kept=True)
    where = str(folder) if folder is not None and workers.share_disk else ""
    rest = [replace(task, folder=where) for task in tasks if task.name not in found]
    try:
        for result in run_tasks(rest, workers.submit, workers.count_pending):
            stored = _store_files(result, folder)
            if manifest is not None:
                manifest.add(stored)
            found[result.task] = stored
            tell(stored, is_kept=False)
    finally:
        if manifest is not None:
            manifest.close()
    return tuple(found[task.name] for task in tasks)


def _store_files(result: BatchResult, folder: Path | None) -> BatchResult:
    """Write the files that a worker returned, unless the result keeps them."""
    if folder is None or not any(one.content for one in result.files):
        return result
    for one in result.files:
        save(folder / one.name, one.read())
    return replace(result, files=tuple(replace(one, content=b"") for one in result.files))
