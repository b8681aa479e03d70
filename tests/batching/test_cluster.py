"""A Dask cluster gives the same files as this machine, also if a worker is killed."""

from __future__ import annotations

import platform
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import ClassVar

import pytest

import printer_slicer as ps
from printer_slicer.batching import cluster
from printer_slicer.batching.executors import open_workers
from printer_slicer.batching.running import WrongWorkerError, run_batch
from printer_slicer.batching.tasks import BatchTask, Combination, TaskModel, list_tasks
from printer_slicer.errors import UsageError
from printer_slicer.process_limits import ProcessLimits
from tests.parts import box


def describe(**changes: object) -> dict[str, dict[str, object]]:
    own = {"python": platform.python_version(), "printer_slicer": ps.__version__, "can_start": True}
    return {"tcp://worker:1": own | changes}


def test_a_worker_that_does_not_fit_is_named() -> None:
    cluster._check_workers(describe(), "tcp://a:1")
    for changes, said in (
        ({"python": "3.8.1"}, "worker tcp://worker:1 has python 3.8.1"),
        ({"printer_slicer": "0.0.1"}, "has printer_slicer 0.0.1"),
        ({"can_start": False}, "may not start processes"),
    ):
        with pytest.raises(UsageError, match=said):
            cluster._check_workers(describe(**changes), "tcp://a:1")
    with pytest.raises(UsageError, match="no workers"):
        cluster._check_workers({}, "tcp://a:1")


def start(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-m", "dask", *words, "--no-dashboard"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@contextmanager
def running_cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Yield the address of a scheduler with two workers, and the workers."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    processes = [start("scheduler", "--host", "127.0.0.1", "--port", str(port))]
    processes += [start("worker", address, "--no-nanny", "--nthreads", "1") for _ in range(2)]
    try:
        with distributed.Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


class Processes:
    """Instead of processes: counts how often they are started and ended."""

    started: ClassVar[list[ProcessLimits]] = []
    ended: ClassVar[list[ProcessLimits]] = []

    def __init__(self, n_processes: int, limits: ProcessLimits) -> None:
        assert n_processes == 3
        self.limits = limits
        Event().wait(0.01)  # others start theirs at the same time
        self.started.append(limits)

    def submit(self, *_: object) -> Future[ProcessLimits]:
        future: Future[ProcessLimits] = Future()
        future.set_result(self.limits)
        return future

    def shutdown(self, wait: bool) -> None:
        assert not wait
        self.ended.append(self.limits)


def test_a_worker_has_one_set_of_processes_with_the_limits_of_the_batch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    worker = SimpleNamespace(state=SimpleNamespace(nthreads=3))
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    monkeypatch.setattr(cluster, "ProcessExecutor", Processes)
    monkeypatch.setattr(cluster, "_processes", {})
    task = BatchTask("box", TaskModel("box.stl", "", 1), ps.load_profile())
    small, large = ProcessLimits(max_bytes=1), ProcessLimits(max_bytes=2)

    with ThreadPoolExecutor(3) as threads:
        found = threads.map(lambda _: cluster._slice_on_worker(task, small, ps.__version__), range(3))
        assert list(found) == [small] * 3
    assert Processes.started == [small]
    assert cluster._slice_on_worker(task, large, ps.__version__) == large  # type: ignore[comparison-overlap]
    assert (Processes.started, Processes.ended) == ([small, large], [small])
    monkeypatch.setattr(cluster, "_REJECT_SECONDS", 0.0)
    with pytest.raises(WrongWorkerError, match=r"not 0\.0\.1"):
        cluster._slice_on_worker(task, large, "0.0.1")


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_files_though_a_worker_is_killed(tmp_path: Path) -> None:
    paths = [tmp_path / f"box{size}.stl" for size in range(4, 12)]
    for size, path in enumerate(paths, start=4):
        ps.export_stl(box((size, 5, 2)), path)
    tasks = list_tasks(paths, [Combination({}, ps.load_profile())])
    local, far, told = tmp_path / "local", tmp_path / "far", list[str]()
    for folder in (local, far):
        folder.mkdir()
    with open_workers(1, "", ProcessLimits()) as workers:
        run_batch(tasks, workers, local)
    with running_cluster() as (address, processes), open_workers(0, address, ProcessLimits()) as workers:

        def tell(result: ps.BatchResult, *, is_kept: bool) -> None:
            assert not is_kept
            told.append(result.task)
            if len(told) == 2:
                processes[0].send_signal(signal.SIGKILL)

        run_batch(tasks, workers, far, tell=tell)

    assert sorted(told) == sorted(task.name for task in tasks)
    for path in paths:
        name = f"{path.stem}.gcode"
        assert (local / name).read_bytes() == (far / name).read_bytes()
