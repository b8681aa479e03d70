"""Processes that slice: limits hold, and a process that ends costs one task."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from threading import Event
from typing import Any

import pytest

import printer_slicer as ps
from printer_slicer.batching.executors import open_workers
from printer_slicer.batching.pool import (
    ProcessExecutor,
    ProcessLimits,
    describe_lost_process,
    slice_and_report,
)
from printer_slicer.batching.running import run_batch, send_task
from printer_slicer.batching.slicing import slice_task
from printer_slicer.batching.tasks import BatchTask, read_task_model
from tests.parts import box
from tests.waiting import until


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


def run_script(text: str, **more: Any) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True, **more)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_does_not_reach_a_process_that_starts() -> None:
    script = """
import os, signal
from printer_slicer.batching.pool import ProcessExecutor
with ProcessExecutor(1) as executor:
    future = executor.submit(abs, -5)
    try:
        os.killpg(0, signal.SIGINT)
    except KeyboardInterrupt:
        print(future.result(60))
"""
    with run_script(script, stderr=subprocess.PIPE, start_new_session=True) as running:
        assert running.communicate() == ("5\n", "")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_processes_end_with_the_one_that_started_them() -> None:
    script = """
import os
from time import sleep
from printer_slicer.batching.pool import ProcessExecutor
executor = ProcessExecutor(1)
print(executor.submit(os.getpid).result(60), flush=True)
executor.submit(sleep, 600).result()
"""
    with run_script(script, stderr=subprocess.DEVNULL) as running:
        assert running.stdout is not None
        state = Path(f"/proc/{running.stdout.readline().strip()}/stat")
        running.kill()
    until(lambda: not state.exists() or state.read_text().split()[2] == "Z")


@pytest.mark.parametrize("change", ["changed", "removed"])
def test_a_model_that_changes_before_it_is_sliced_costs_its_task(tmp_path: Path, change: str) -> None:
    path = tmp_path / "box.stl"
    ps.export_stl(box((5, 5, 2)), path)
    task = BatchTask("box", read_task_model(path), ps.load_profile())
    path.unlink()
    if change == "changed":
        ps.export_stl(box((6, 5, 2)), path)

    said = "has changed since the batch began" if change == "changed" else "No such file"
    assert said in slice_task(task).problem
    assert said in send_task(task, lambda _: Future()).result(0).problem
