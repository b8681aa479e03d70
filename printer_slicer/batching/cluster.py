"""Slice on several machines with Dask: models travel as bytes, files of G-code come back.

Each worker of Dask slices in processes of its own, so that limits hold and a task that fails costs only itself.
"""

from __future__ import annotations

import platform
from concurrent.futures import Executor, Future
from contextlib import suppress
from importlib.util import find_spec
from multiprocessing import current_process
from threading import Event, Lock
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.batching.pool import ProcessExecutor, slice_and_report
from printer_slicer.batching.running import WrongWorkerError, send_task
from printer_slicer.batching.tasks import BatchResult, BatchTask
from printer_slicer.errors import OutputError, UsageError
from printer_slicer.process_limits import ProcessLimits
from printer_slicer.version import VERSION

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["ClusterExecutor", "ThreadCounter"]

_CONNECT_SECONDS: Final = 15.0
_RECONNECT_SECONDS: Final = 600.0
_POLL_SECONDS: Final = 0.2
_COUNT_SECONDS: Final = 5.0
_REJECT_SECONDS: Final = 5.0
_lock: Final = Lock()
_processes: Final[dict[ProcessLimits, ProcessExecutor]] = {}
"""In a worker of Dask: the processes that slice, at most one executor."""


class ClusterExecutor(Executor):
    """Runs tasks on the workers of a Dask scheduler.

    Args:
        address: of the scheduler, such as `tcp://10.0.0.5:8786`.
        limits: of each process that slices.

    Raises:
        UsageError: Dask is not installed, the scheduler does not answer, or a worker does not fit.
    """

    def __init__(self, address: str, limits: ProcessLimits) -> None:
        if find_spec("distributed") is None:
            raise UsageError(
                "slicing on a cluster needs Dask", remedy="Install it: pip install 'printer-slicer[cluster]'"
            )
        from distributed import Client  # noqa: PLC0415 - slow

        self._address, self._limits = address, limits
        try:
            self._client: Client = Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise UsageError(
                f"{address}: no scheduler answers ({error})",
                remedy="Start one with `dask scheduler`, or check the address",
            ) from None
        _check_workers(_describe_workers(self._client), address)
        self._counter = ThreadCounter(self._client)
        self._executor: Executor = self._client.get_executor(pure=False)  # type: ignore[no-untyped-call]

    def count_threads(self) -> int:
        """Return how many tasks the workers run at the same time, at least 1."""
        return self._counter.count()

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a function on a worker.

        Raises:
            OutputError: the scheduler has been away for too long.
        """
        self._wait_for_scheduler()
        return self._executor.submit(fn, *args, **kwargs)

    def submit_task(self, task: BatchTask) -> Future[BatchResult]:
        """Slice on a worker.

        Raises:
            OutputError: the scheduler has been away for too long.
        """
        return send_task(task, lambda sent: self.submit(_slice_on_worker, sent, self._limits, VERSION))

    def _wait_for_scheduler(self) -> None:
        """Wait until the client is connected, as after a restart of the scheduler."""
        end = monotonic() + _RECONNECT_SECONDS
        while self._client.status != "running":
            if monotonic() > end or self._client.status == "closed":
                raise OutputError(
                    f"{self._address}: the connection to the scheduler is lost",
                    remedy="Start it again, then continue the batch",
                )
            Event().wait(_POLL_SECONDS)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect from the scheduler; its workers go on."""
        self._executor.shutdown(wait=wait and not cancel_futures)
        self._client.close()  # type: ignore[no-untyped-call]


class ThreadCounter:
    """Counts the threads of the workers that a Dask client has; workers may join and leave.

    Args:
        client: connected to a scheduler.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._n_threads, self._next = 1, 0.0

    def count(self) -> int:
        """Return the number of threads, at least 1; the scheduler is asked every few seconds."""
        if monotonic() > self._next and self._client.status == "running":
            with suppress(OSError):  # the connection was just lost
                self._n_threads = max(sum(self._client.nthreads().values()), 1)  # type: ignore[no-untyped-call]
            self._next = monotonic() + _COUNT_SECONDS
        return self._n_threads


def _describe_worker() -> dict[str, Any]:
    """Return the versions on a worker, and whether it may start processes."""
    return {
        "python": platform.python_version(),
        "printer_slicer": VERSION,
        "can_start": not current_process().daemon,
    }


def _describe_workers(client: Client) -> dict[str, dict[str, Any]]:
    """Return what each worker has.

    Raises:
        UsageError: one cannot tell, because it does not have this package.
    """
    try:
        return client.run(_describe_worker)  # type: ignore[no-any-return]
    except Exception as error:  # noqa: BLE001 - whatever a worker raises
        raise UsageError(
            f"a worker cannot import this package: {error}",
            remedy="Install the same version on all machines",
        ) from None


def _check_workers(workers: dict[str, dict[str, Any]], address: str) -> None:
    """Check that there are workers, and that they have the versions of this machine.

    Raises:
        UsageError: there is none, or one does not fit.
    """
    if not workers:
        raise UsageError(f"{address}: the scheduler has no workers", remedy="Start some with `dask worker`")
    own = _describe_worker()
    for name, found in sorted(workers.items()):
        for what in ("python", "printer_slicer"):
            # G-code does not depend on the last number of Python's version.
            theirs, ours = (
                text[what].rpartition(".")[0] if what == "python" else text[what] for text in (found, own)
            )
            if theirs != ours:
                raise UsageError(
                    f"worker {name} has {what} {found[what]}, this machine has {own[what]}",
                    remedy="Install the same version on all machines",
                )
        if not found["can_start"]:
            raise UsageError(
                f"worker {name} may not start processes",
                remedy="Start `dask worker` with its option no-nanny",
            )


def _slice_on_worker(task: BatchTask, limits: ProcessLimits, version: str) -> BatchResult:
    """Slice in a process of this worker.

    Raises:
        WrongWorkerError: this worker joined later, and has another version of this package.
    """
    if version != VERSION:
        Event().wait(_REJECT_SECONDS)  # meanwhile, this worker gets no other task
        raise WrongWorkerError(f"the worker has printer_slicer {VERSION}, not {version}")
    result: BatchResult = _start_in_process(task, limits).result()
    return result


def _start_in_process(task: BatchTask, limits: ProcessLimits) -> Future[BatchResult]:
    """Slice in a process of this worker; the processes last as long as the worker, or until the limits change."""
    from distributed import get_worker  # noqa: PLC0415 - slow

    with _lock:  # tasks run in several threads
        if limits not in _processes:
            for other in _processes.values():
                other.shutdown(wait=False)
            _processes.clear()
            _processes[limits] = ProcessExecutor(get_worker().state.nthreads, limits)
        return _processes[limits].submit(slice_and_report, task)
