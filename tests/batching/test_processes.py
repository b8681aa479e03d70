"""Processes that slice: limits hold, and a process that ends costs one task."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Event

import pytest

import printer_slicer as ps
from printer_slicer.batching.executors import open_workers
from printer_slicer.batching.pool import (
    ProcessExecutor,
    ProcessLimits,
    describe_lost_process,
    slice_and_report,
)
from printer_slicer.batching.running import run_batch
from printer_slicer.batching.tasks import BatchTask, read_task_model
from tests.parts import box


def end_process(how: int) -> None:
    os.kill(os.getpid(), how)


def take_memory(n_bytes: int) -> int:
    return len(bytearray(n_bytes))


def sleep_long(seconds: float) -> None:
    Event().wait(seconds)


@pytest.fixture(scope="module")
def executor() -> Iterator[ProcessExecutor]:
    with ProcessExecutor(1, ProcessLimits(max_seconds=3, max_bytes=2 << 30)) as made:
        yield made


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_killed_process_costs_its_task_only(executor: ProcessExecutor) -> None:
    lost = executor.submit(end_process, signal.SIGKILL)
    after = executor.submit(abs, -5)

    assert describe_lost_process(lost.exception(60)) == "its process was killed by signal 9"  # type: ignore[arg-type]
    assert after.result(60) == 5


def test_a_task_that_takes_too_long_is_stopped(executor: ProcessExecutor) -> None:
    assert isinstance(executor.submit(sleep_long, 600).exception(60), TimeoutError)
    assert executor.submit(abs, -5).result(60) == 5


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the address space")
def test_memory_is_limited(executor: ProcessExecutor) -> None:
    assert isinstance(executor.submit(take_memory, 4 << 30).exception(60), MemoryError)
    assert executor.submit(take_memory, 1 << 20).result(60) == 1 << 20


def test_stages_are_told_with_their_task(tmp_path: Path) -> None:
    path, told = tmp_path / "box.stl", list[tuple[str, str]]()
    ps.export_stl(box((5, 5, 2)), path)
    task = BatchTask("box", read_task_model(path), ps.load_profile())
    with ProcessExecutor(1, tell_stage=lambda *given: told.append(given)) as made:
        assert not made.submit(slice_and_report, task).result(60).problem

    assert {name for name, _ in told} == {"box"}
    stages = [stage for _, stage in told]
    assert stages[0] == "loading"
    assert "planning" in stages


def test_the_number_of_processes_does_not_change_a_byte(tmp_path: Path) -> None:
    paths = [tmp_path / f"box{size}.stl" for size in (4, 5, 6)]
    for path, size in zip(paths, (4, 5, 6), strict=True):
        ps.export_stl(box((size, 5, 2)), path)
    tasks = [BatchTask(path.stem, read_task_model(path), ps.load_profile()) for path in paths]
    found = []
    for n in (1, 2):
        folder = tmp_path / str(n)
        folder.mkdir()
        with open_workers(n, "", ProcessLimits()) as workers:
            results = run_batch(tasks, workers, folder)
        found.append([(one.task, [file.sha256 for file in one.files]) for one in results])
    assert found[0] == found[1]
    assert (tmp_path / "1" / "box4.gcode").read_bytes() == (tmp_path / "2" / "box4.gcode").read_bytes()
