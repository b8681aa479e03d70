"""Choose where tasks run: in processes on this machine, on a cluster, or in an executor of the user."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Final, NamedTuple

from printer_slicer.batching.pool import ProcessExecutor, slice_and_report
from printer_slicer.batching.running import Submit, send_task
from printer_slicer.batching.tasks import BatchResult, BatchTask
from printer_slicer.process_limits import ProcessLimits

__all__ = ["Workers", "count_processors", "open_workers", "use_executor"]

_PER_WORKER: Final = 2  # tasks that are submitted at the same time
_UNKNOWN: Final = 32  # the same, for all workers of an executor that does not tell their number


class Workers(NamedTuple):
    """Where tasks run.

    Attributes:
        submit: starts a task.
        count_pending: how many tasks may be submitted at the same time.
        share_disk: whether workers write into the folder of the batch themselves.
    """

    submit: Submit
    count_pending: Callable[[], int]
    share_disk: bool


def count_processors() -> int:
    """Return on how many processors this process may run."""
    allowed: Callable[[int], set[int]] | None = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


@contextmanager
def open_workers(n_processes: int, cluster: str, limits: ProcessLimits) -> Iterator[Workers]:
    """Start processes, or connect to a cluster; both end with the context, at once if it fails.

    Args:
        n_processes: on this machine.
        cluster: address of a Dask scheduler; empty: this machine.
        limits: of each process.

    Raises:
        UsageError: the cluster cannot be used.
    """
    if cluster:
        from printer_slicer.batching.cluster import ClusterExecutor  # noqa: PLC0415 - slow

        remote = ClusterExecutor(cluster, limits)
        executor: Executor = remote
        workers = Workers(remote.submit_task, lambda: _PER_WORKER * remote.count_threads(), False)
    else:
        executor = ProcessExecutor(n_processes, limits)
        submit = partial(executor.submit, slice_and_report)
        workers = Workers(submit, lambda: _PER_WORKER * n_processes, True)
    try:
        yield workers
    except BaseException:
        executor.shutdown(cancel_futures=True)
        raise
    executor.shutdown()


def use_executor(executor: Executor) -> Workers:
    """Return workers that use an executor of the user.

    Executors of `concurrent.futures` run on this machine, so they read the files of models. Others get their content.
    """
    from printer_slicer.batching.slicing import slice_task  # noqa: PLC0415 - slow

    is_local = isinstance(executor, ProcessPoolExecutor | ThreadPoolExecutor | ProcessExecutor)

    def start(task: BatchTask) -> Future[BatchResult]:
        """Start a task on this machine, or one that has all it needs."""
        return executor.submit(slice_task, task)

    def submit(task: BatchTask) -> Future[BatchResult]:
        """Start a task."""
        return start(task) if is_local else send_task(task, start)

    count = getattr(executor, "_max_workers", None)
    if client := getattr(executor, "_client", None):
        from printer_slicer.batching.cluster import ThreadCounter  # noqa: PLC0415 - slow

        counter = ThreadCounter(client)
        return Workers(submit, lambda: _PER_WORKER * counter.count(), False)
    n_pending = _PER_WORKER * count if isinstance(count, int) else _UNKNOWN
    return Workers(submit, lambda: n_pending, is_local)
