"""Measure `batch`: processes, memory, and a Dask cluster whose worker is killed and whose scheduler is restarted.

    python -m benchmarks.batching speed|memory|cluster|faults [--models FOLDER] [--parts N] [--rounds N]

`speed` compares one and two processes, and slicing in this process without any pool. `memory` slices 1000 times in one
process. `cluster` compares one and two workers. `faults` kills a worker with signal 9, then restarts the scheduler,
and compares all files with those of a local run.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from threading import Event, Thread
from time import monotonic
from typing import Final

import printer_slicer as ps
from benchmarks.functional_parts import PARTS, write_parts
from benchmarks.processes import SAMPLES, WORK, machine_note
from printer_slicer.batching.executors import open_workers
from printer_slicer.batching.running import run_batch
from printer_slicer.batching.slicing import slice_task
from printer_slicer.batching.tasks import BatchResult, BatchTask, Combination, list_tasks
from printer_slicer.process_limits import ProcessLimits

_SCALES: Final = (1.0, 0.8, 0.9, 1.1)
_REAL: Final = ("bp_case.stl", "crazyradio.stl", "ringing_tower.stl", "benchy.stl")
_REPEATS: Final = 1000
_LIMITS: Final = ProcessLimits()


def main(argv: Sequence[str] | None = None) -> int:
    """Run one of the measurements, and print its figures."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.batching", description=__doc__.splitlines()[0]
    )
    parser.add_argument("what", choices=_MEASUREMENTS)
    parser.add_argument("--models", type=Path, help="folder with more models")
    parser.add_argument("--parts", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args(argv)
    print(machine_note())
    _MEASUREMENTS[arguments.what](_make_tasks(arguments.models, arguments.parts), arguments.rounds)
    return 0


def _make_tasks(models: Path | None, count: int) -> list[BatchTask]:
    """Return tasks for real and generated parts; some occur in several sizes."""
    folder = WORK / "batch"
    paths = [*sorted(SAMPLES.glob("*.stl")), *write_parts(WORK, list(PARTS))]
    paths += [models / name for name in _REAL if models is not None and (models / name).exists()]
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for scale in _SCALES:
        for path in paths:
            target = folder / f"{path.stem}_{scale:g}.stl"
            if not target.exists():
                ps.export_stl(ps.transform(ps.load_mesh(path), scale=scale), target)
            found.append(target)
    return list_tasks(found[:count], [Combination({}, ps.load_profile())])


class _Run:
    """Wall and CPU time of a run, s, and its results."""

    def __init__(self, tasks: Sequence[BatchTask], n_processes: int, cluster: str = "") -> None:
        begun, used = monotonic(), _measure_cpu()
        if n_processes or cluster:
            with open_workers(n_processes, cluster, _LIMITS) as workers:
                self.results = run_batch(tasks, workers, None)
        else:
            self.results = tuple(slice_task(task) for task in tasks)
        self.wall, self.cpu = monotonic() - begun, _measure_cpu() - used


def _measure_cpu() -> float:
    """Return the CPU time of this process and of those that ended, s."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def _list_digests(results: Sequence[BatchResult]) -> list[tuple[str, str, tuple[str, ...]]]:
    """Return name, problem and hashes of each result."""
    return [(one.task, one.problem, tuple(file.sha256 for file in one.files)) for one in results]


def _measure_speed(tasks: Sequence[BatchTask], rounds: int) -> None:
    """Compare one and two processes, and this process, in turn."""
    runs: dict[int, list[_Run]] = {0: [], 1: [], 2: []}
    for _ in range(rounds):
        for n_processes, own in runs.items():
            own.append(_Run(tasks, n_processes))
            print(f"{n_processes} processes: {own[-1].wall:.1f} s, CPU {own[-1].cpu:.1f} s", flush=True)
    assert len({tuple(_list_digests(run.results)) for own in runs.values() for run in own}) == 1
    gain = median(one.wall / two.wall for one, two in zip(runs[1], runs[2], strict=True))
    print(f"{len(tasks)} parts: two processes {gain:.2f} times as fast as one; equal digests")
    for n_processes in (1, 2):
        more = median(run.cpu / base.cpu for run, base in zip(runs[n_processes], runs[0], strict=True))
        print(f"CPU of {n_processes} processes: {more:.3f} of that of this process without a pool")


def _measure_memory(tasks: Sequence[BatchTask], _rounds: int) -> None:
    """Slice many times in one process, and print its memory."""
    small = sorted(tasks, key=lambda task: task.model.size)[:8]
    with open_workers(1, "", _LIMITS) as workers:
        for done in range(_REPEATS):
            workers.submit(small[done % len(small)]).result()
            if done % 100 == 99:
                print(f"{done + 1} tasks: {_read_memory():.0f} MB", flush=True)


def _read_memory() -> float:
    """Return the memory of the process of the pool, MB."""
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    sizes = [int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in children]
    return max(sizes) * os.sysconf("SC_PAGESIZE") / 1e6


class _Cluster:
    """A scheduler and workers of Dask as processes."""

    def __init__(self, n_workers: int) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self._port}"
        self.scheduler = self.start_scheduler()
        self.workers = [self.start_worker() for _ in range(n_workers)]

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        """Start a scheduler at the address."""
        return _start("scheduler", "--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard")

    def start_worker(self) -> subprocess.Popen[bytes]:
        """Start a worker."""
        return _start("worker", self.address, "--no-nanny", "--nthreads", "1", "--no-dashboard")

    def stop(self) -> None:
        """End all processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def _start(*words: str) -> subprocess.Popen[bytes]:
    """Start a process of Dask."""
    nothing = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-m", "dask", *words], **nothing)  # type: ignore[call-overload, no-any-return]


@contextmanager
def _start_cluster(n_workers: int) -> Iterator[_Cluster]:
    """Start a cluster whose workers are there, and end it."""
    from distributed import Client

    cluster = _Cluster(n_workers)
    try:
        with Client(cluster.address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(n_workers, timeout=60)
        yield cluster
    finally:
        cluster.stop()


def _measure_cluster(tasks: Sequence[BatchTask], rounds: int) -> None:
    """Compare one and two workers, in turn."""
    walls: dict[int, list[float]] = {1: [], 2: []}
    digests = set()
    for _ in range(rounds):
        for n_workers, own in walls.items():
            with _start_cluster(n_workers) as cluster:
                run = _Run(tasks, 0, cluster.address)
            own.append(run.wall)
            digests.add(tuple(_list_digests(run.results)))
            print(f"{n_workers} workers: {run.wall:.1f} s", flush=True)
    gain = median(one / two for one, two in zip(walls[1], walls[2], strict=True))
    print(
        f"{len(tasks)} parts: two workers {gain:.2f} times as fast as one; equal digests: {len(digests) == 1}"
    )


def _test_faults(tasks: Sequence[BatchTask], _rounds: int) -> None:
    """Kill a worker, then restart the scheduler, and compare the files with those of a local run."""
    local = _list_digests(_Run(tasks, 1).results)
    with _start_cluster(2) as cluster, ExitStack() as stack:
        done, told = Event(), list[str]()
        thread = Thread(target=partial(_disturb, cluster, done, told))
        thread.start()
        stack.callback(thread.join)
        stack.callback(done.set)
        with open_workers(0, cluster.address, _LIMITS) as workers:
            results = run_batch(tasks, workers, None, tell=lambda result, **_: told.append(result.task))
    assert sorted(told) == sorted(task.name for task in tasks), "every part once"
    assert _list_digests(results) == local, "equal bytes"
    print(f"{len(tasks)} parts: each told once, bytes equal to the local run")


def _disturb(cluster: _Cluster, done: Event, told: Sequence[str]) -> None:
    """Kill a worker after a quarter of the tasks, and restart the scheduler and the workers after half of them."""
    while len(told) < 4 and not done.wait(0.1):
        pass
    cluster.workers[0].send_signal(signal.SIGKILL)
    print(f"worker killed after {len(told)} results", flush=True)
    while len(told) < 10 and not done.wait(0.1):
        pass
    if done.is_set():
        return
    cluster.scheduler.kill()
    cluster.scheduler.wait()
    print(f"scheduler killed after {len(told)} results", flush=True)
    done.wait(3)
    cluster.scheduler = cluster.start_scheduler()
    done.wait(5)
    alive = [one for one in cluster.workers if one.poll() is None]
    print(f"scheduler started again; {len(alive)} of the workers are alive", flush=True)
    cluster.workers.append(cluster.start_worker())


_MEASUREMENTS: Final = {
    "speed": _measure_speed,
    "memory": _measure_memory,
    "cluster": _measure_cluster,
    "faults": _test_faults,
}

if __name__ == "__main__":
    sys.exit(main())
