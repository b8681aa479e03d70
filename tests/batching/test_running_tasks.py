"""Every task gets exactly one result, whatever happens to its workers."""

from __future__ import annotations

import errno
import os
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from hashlib import sha256
from pathlib import Path
from threading import Timer

import pytest
from hypothesis import given
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.batching.executors import Workers
from printer_slicer.batching.manifest import MANIFEST, lock_folder, read_manifest
from printer_slicer.batching.running import WrongWorkerError, run_batch, run_tasks
from printer_slicer.batching.tasks import BatchResult, BatchTask, SlicedFile, TaskModel, fail_task
from printer_slicer.errors import OutputError
from printer_slicer.values import replace

PROFILE = ps.load_profile()


def make_task(name: str, size: int = 1) -> BatchTask:
    return BatchTask(name, TaskModel(f"{name}.stl", f"hash of {name}", size, f"{name}.stl"), PROFILE)


class Fates:
    """Starts tasks that end as it was told: `done`, `lost`, `late`, `cancelled` or `rejected`, one after the other."""

    def __init__(self, fates: dict[str, list[str]]) -> None:
        self.fates, self.started = fates, list[str]()

    def submit(self, task: BatchTask) -> Future[BatchResult]:
        self.started.append(task.name)
        fate = (self.fates.get(task.name) or ["done"]).pop(0) if self.fates.get(task.name) else "done"
        future: Future[BatchResult] = Future()
        if fate == "cancelled":
            future.cancel()
            future.set_running_or_notify_cancel()
        elif fate == "lost":
            future.set_exception(OSError("the worker is gone"))
        elif fate == "rejected":
            future.set_exception(WrongWorkerError("the worker has another version"))
        elif fate == "late":
            future.set_exception(TimeoutError())
        else:
            future.set_result(fail_task(task, ""))
        return future


FATE = st.sampled_from(["done", "lost", "late", "cancelled", "rejected"])


@given(st.lists(st.lists(FATE, max_size=5), max_size=8), st.integers(1, 5))
def test_every_task_has_one_result(fates: list[list[str]], n_pending: int) -> None:
    names = [f"part{at}" for at in range(len(fates))]
    expected = {}
    for name, own in zip(names, fates, strict=True):
        kept = [one for one in own if one not in {"cancelled", "rejected"}] + ["done", "done"]
        fails = kept[0] == "late" or (kept[0] == "lost" and kept[1] != "done")
        expected[name] = fails
    run = Fates({name: [*own] for name, own in zip(names, fates, strict=True)})

    results = list(run_tasks([make_task(name) for name in names], run.submit, lambda: n_pending))

    assert sorted(one.task for one in results) == names
    assert {one.task: bool(one.problem) for one in results} == expected


def test_the_largest_models_start_first_and_few_wait() -> None:
    waiting: list[Future[BatchResult]] = []
    order: list[str] = []

    def submit(task: BatchTask) -> Future[BatchResult]:
        order.append(task.name)
        future: Future[BatchResult] = Future()
        waiting.append(future)
        if len(waiting) == 2:  # both places are taken: the first one ends
            waiting.pop(0).set_result(fail_task(task, ""))
        return future

    tasks = [make_task("small", 1), make_task("large", 9), make_task("middle", 5)]
    results = run_tasks(tasks, submit, lambda: 2)
    next(results)
    assert order == ["large", "middle"]
    results.close()
    assert all(one.cancelled() for one in waiting)


def test_the_reasons_tell_what_happened() -> None:
    run = Fates({"a": ["late"], "b": ["lost", "lost"]})
    results = {
        one.task: one.problem for one in run_tasks([make_task("a"), make_task("b")], run.submit, lambda: 2)
    }

    assert results["a"] == "slicing took longer than 3600 s"
    assert "in 2 attempts" in results["b"]
    assert run.started.count("b") == 2


def slicing(task: BatchTask, folder: Path) -> BatchResult:
    """Return a result with one file, which is written."""
    text = f"; {task.name}\n".encode()
    (folder / f"{task.name}.gcode").write_bytes(text)
    return replace(
        fail_task(task, ""),
        files=(SlicedFile(f"{task.name}.gcode", sha256(text).hexdigest(), len(text), {}),),
    )


class Writing:
    """Workers that write one file per task, and count."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.started = folder, list[str]()

    def workers(self) -> Workers:
        def submit(task: BatchTask) -> Future[BatchResult]:
            self.started.append(task.name)
            future: Future[BatchResult] = Future()
            future.set_result(slicing(task, self.folder))
            return future

        return Workers(submit, lambda: 2, True)


def test_a_batch_goes_on_where_it_ended(tmp_path: Path) -> None:
    tasks = [make_task(name) for name in "abcd"]
    first = Writing(tmp_path)
    results = run_batch(tasks, first.workers(), tmp_path)
    assert [one.task for one in results] == list("abcd")

    (tmp_path / "b.gcode").write_text("changed")
    (tmp_path / "c.gcode").unlink()
    manifest = tmp_path / MANIFEST
    lines = sorted(manifest.read_text().splitlines())
    manifest.write_text("\n".join(lines)[:-20])  # the machine stopped while the line of d was written
    again = Writing(tmp_path)
    assert run_batch(tasks, again.workers(), tmp_path, resumes=True) == results
    assert sorted(again.started) == ["b", "c", "d"]
    assert len(read_manifest(tmp_path)) == 4


@pytest.mark.parametrize("resumes", [False, True])
def test_other_settings_are_sliced_again(tmp_path: Path, resumes: bool) -> None:
    run_batch([make_task("a")], Writing(tmp_path).workers(), tmp_path)
    other = replace(make_task("a"), profile=ps.load_profile(changes={"perimeters": "4"}))
    again = Writing(tmp_path)
    run_batch([other], again.workers(), tmp_path, resumes=resumes)
    assert again.started == ["a"]


def test_failed_tasks_are_tried_again(tmp_path: Path) -> None:
    run = Fates({"a": ["late"]})
    workers = Workers(run.submit, lambda: 1, True)
    assert run_batch([make_task("a")], workers, tmp_path)[0].problem
    assert not run_batch([make_task("a")], workers, tmp_path, resumes=True)[0].problem


def test_parts_with_equal_content_are_kept_too(tmp_path: Path) -> None:
    first = make_task("left-lid")
    tasks = [first, replace(first, name="right-lid")]
    results = run_batch(tasks, Writing(tmp_path).workers(), tmp_path)
    again = Writing(tmp_path)
    assert run_batch(tasks, again.workers(), tmp_path, resumes=True) == results
    assert not again.started


def test_the_manifest_keeps_parts_that_are_not_in_this_run(tmp_path: Path) -> None:
    tasks = [make_task("a"), make_task("b")]
    run_batch(tasks, Writing(tmp_path).workers(), tmp_path)
    run_batch(tasks[:1], Writing(tmp_path).workers(), tmp_path, resumes=True)
    again = Writing(tmp_path)
    run_batch(tasks, again.workers(), tmp_path, resumes=True)
    assert not again.started


def test_a_full_disk_leaves_the_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = [make_task("a"), make_task("b")]
    run_batch(tasks, Writing(tmp_path).workers(), tmp_path)

    def fill_disk(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fill_disk)
        with pytest.raises(OutputError, match="No space left"):
            run_batch(tasks, Writing(tmp_path).workers(), tmp_path, resumes=True)
    assert len(read_manifest(tmp_path)) == 2


def test_one_batch_writes_into_a_folder(tmp_path: Path) -> None:
    writing = Writing(tmp_path)
    with lock_folder(tmp_path), pytest.raises(OutputError, match="another batch"):
        run_batch([make_task("a")], writing.workers(), tmp_path)
    assert not writing.started
    assert run_batch([make_task("a")], writing.workers(), tmp_path)


def test_workers_that_join_get_tasks() -> None:
    counts, started = iter([1, 1, 3, 3, 3, 3, 3]), list[Future[BatchResult]]()

    def submit(task: BatchTask) -> Future[BatchResult]:
        future: Future[BatchResult] = Future()
        if not started:
            future.set_result(fail_task(task, ""))
        started.append(future)
        return future

    results = run_tasks([make_task(name) for name in "abcdef"], submit, lambda: next(counts))
    next(results)
    assert len(started) == 1
    Timer(0.05, lambda: started[-1].set_result(fail_task(make_task("b"), ""))).start()
    next(results)
    assert len(started) == 4
    results.close()


def test_a_broken_executor_costs_the_rest_only() -> None:
    def submit(task: BatchTask) -> Future[BatchResult]:
        if task.name != "a":
            raise BrokenProcessPool("a process was terminated")
        future: Future[BatchResult] = Future()
        future.set_result(fail_task(task, ""))
        return future

    tasks = [make_task(name) for name in "abc"]
    problems = {one.task: one.problem for one in run_tasks(tasks, submit, lambda: 1)}
    assert not problems["a"]
    assert "a process was terminated" in problems["b"]
    assert "a process was terminated" in problems["c"]


def test_a_task_that_all_workers_reject_fails() -> None:
    run = Fates({"a": ["rejected"] * 99})
    (result,) = run_tasks([make_task("a")], run.submit, lambda: 1)
    assert "the worker has another version" in result.problem
    assert len(run.started) < 30
