"""Models that are uploaded and sliced."""

from __future__ import annotations

import json
import os
from concurrent.futures import Future
from pathlib import Path
from threading import Event
from time import time
from types import SimpleNamespace
from typing import Any

import pytest
from pebble import ProcessExpired

import printer_slicer as ps
from printer_slicer.batching.pool import ProcessExecutor
from printer_slicer.batching.tasks import BatchResult
from printer_slicer.print_queue import PrintQueue
from printer_slicer.server.slicing import Slicer
from printer_slicer.server.workers import FileReader
from tests.parts import box
from tests.server.client import ServerClient, form
from tests.waiting import until

ENDED = {"done", "failed", "cancelled"}


def wait_for_end(server: ServerClient, task: str) -> dict[str, Any]:
    pause = Event()
    for _ in range(1200):
        found: dict[str, Any] = server.get(f"/v1/slices/{task}").json()
        if found["state"] in ENDED:
            return found
        pause.wait(0.05)
    raise AssertionError(found)


def model(tmp_path: Path) -> bytes:
    ps.export_stl(box((8, 8, 2)), tmp_path / "box.stl")
    return (tmp_path / "box.stl").read_bytes()


def test_a_model_becomes_a_file_that_can_be_queued(
    server: ServerClient, queue: PrintQueue, tmp_path: Path
) -> None:
    settings = json.dumps({"infill_density": "0.1"}).encode()
    sent = form(
        ("printer", None, b"right"), ("settings", None, settings), ("file", "a b.stl", model(tmp_path))
    )
    answer = server.post("/v1/slices", **sent)
    assert answer.status_code == 201, answer.text
    task = wait_for_end(server, answer.json()["id"])
    assert task["state"] == "done", task
    (facts,) = task["facts"]
    assert facts["layers"] > 5
    assert task["name"] == "a b.stl"
    assert str(tmp_path) not in json.dumps(task)
    (file,) = queue.list_files()
    assert file.name == "a b.gcode"
    assert task["files"] == [file.id]
    facts = queue.read_facts(file.id)
    assert facts is not None
    assert facts.material == "PETG"
    until(lambda: not list((queue.folder / "models").iterdir()))
    assert server.post("/v1/jobs", json={"file": file.id}).status_code == 201


def test_a_model_that_cannot_be_sliced_says_why(server: ServerClient, queue: PrintQueue) -> None:
    answer = server.post("/v1/slices", **form(("printer", None, b"left"), ("file", "x.stl", b"solid x\n")))
    task = wait_for_end(server, answer.json()["id"])
    assert task["state"] == "failed"
    assert "x.stl" in task["message"]
    assert str(queue.folder) not in task["message"]
    until(lambda: not list((queue.folder / "models").iterdir()))


@pytest.mark.parametrize(
    ("name", "fields", "status"),
    [
        ("x.gcode", {"printer": b"left"}, 415),
        ("x.stl.exe", {"printer": b"left"}, 415),
        ("x.stl", {"printer": b"none"}, 422),
        ("x.stl", {}, 422),
        ("x.stl", {"printer": b"left", "settings": b"[1]"}, 400),
        ("x.stl", {"printer": b"left", "settings": b'{"--output": "x"}'}, 422),
        ("x.stl", {"printer": b"left", "copies": b"-1"}, 422),
        ("x.stl", {"printer": b"left", "copies": b"many"}, 400),
    ],
)
def test_a_wrong_request_is_rejected_and_leaves_nothing(
    server: ServerClient, queue: PrintQueue, tmp_path: Path, name: str, fields: dict[str, bytes], status: int
) -> None:
    parts = [(key, None, value) for key, value in fields.items()]
    answer = server.post("/v1/slices", **form(*parts, ("file", name, model(tmp_path))))
    assert answer.status_code == status, answer.text
    assert answer.json()["remedy"]
    folder = queue.folder / "models"
    assert not folder.exists() or not list(folder.iterdir())


def test_a_task_can_be_cancelled(server: ServerClient, tmp_path: Path) -> None:
    sent = form(("printer", None, b"left"), ("copies", None, b"40"), ("file", "a.stl", model(tmp_path)))
    task = server.post("/v1/slices", **sent).json()["id"]
    assert server.delete(f"/v1/slices/{task}").json()["state"] == "cancelled"
    assert wait_for_end(server, task)["state"] == "cancelled"


def test_the_layer_plans_of_a_model_are_compared(
    server: ServerClient, queue: PrintQueue, tmp_path: Path
) -> None:
    sent = form(("printer", None, b"left"), ("file", "a.stl", model(tmp_path)))
    task = wait_for_end(server, server.post("/v1/plans", **sent).json()["id"])
    assert (task["state"], task["command"]) == ("done", "plan"), task
    plans = task["facts"][0]["plans"]
    assert len(plans) >= 2
    assert {"plan", "layers", "seconds", "max_error_mm"} <= set(plans[0])
    assert (task["files"], queue.list_files()) == ([], ())


def test_the_profiles_and_printers_have_names(server: ServerClient) -> None:
    profiles = server.get("/v1/profiles").json()
    assert "marlin_220" in profiles["printer"]
    assert {"pla", "petg"} <= set(profiles["material"])
    assert {"standard", "draft"} <= set(profiles["quality"])
    printers = server.get("/v1/printers").json()
    assert [one["name"] for one in printers] == ["left", "right"]
    assert "port" not in printers[0]


def test_each_plate_becomes_a_file(server: ServerClient, queue: PrintQueue, tmp_path: Path) -> None:
    ps.export_stl(box((90, 90, 0.4)), tmp_path / "box.stl")
    settings = json.dumps({"planner.kind": "uniform", "layer_height": "0.2"}).encode()
    fields = (("printer", None, b"left"), ("copies", None, b"5"), ("settings", None, settings))
    sent = form(*fields, ("file", 'a"b.stl', (tmp_path / "box.stl").read_bytes()))
    task = wait_for_end(server, server.post("/v1/slices", **sent).json()["id"])
    assert task["state"] == "done", task
    assert len(task["files"]) == len(task["facts"]) == 2
    assert [queue.find_file(file).name for file in task["files"]] == ['a"b-1.gcode', 'a"b-2.gcode']
    assert [facts["plate"] for facts in task["facts"]] == [1, 2]


def test_models_that_a_killed_server_has_left_are_deleted(queue: PrintQueue) -> None:
    for name, age in (("old", 2 * 86400), ("new", 0)):
        folder = queue.folder / "models" / name
        folder.mkdir(parents=True)
        (folder / "model.stl").write_bytes(b"solid")
        os.utime(folder, (time() - age, time() - age))
    Slicer(queue, FileReader(queue)).close()
    assert [one.name for one in (queue.folder / "models").iterdir()] == ["new"]


def test_a_model_is_rejected_when_the_disk_is_nearly_full(
    server: ServerClient, queue: PrintQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "printer_slicer.print_queue.file_store.disk_usage", lambda _: SimpleNamespace(free=1000)
    )
    answer = server.post("/v1/slices", **form(("printer", None, b"left"), ("file", "x.stl", b"solid")))
    assert (answer.status_code, "are free" in answer.text) == (422, True)
    assert list((queue.folder / "models").iterdir()) == []


def test_a_process_that_was_killed_is_no_fault_of_the_server(
    server: ServerClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lose(*_: object) -> Future[BatchResult]:
        future: Future[BatchResult] = Future()
        future.set_exception(ProcessExpired("Abnormal termination", code=-9))
        return future

    monkeypatch.setattr(ProcessExecutor, "submit", lose)
    sent = form(("printer", None, b"left"), ("file", "a.stl", model(tmp_path)))
    task = wait_for_end(server, server.post("/v1/slices", **sent).json()["id"])

    assert task["state"] == "failed"
    assert task["message"] == "the model needs more time or memory than allowed"
