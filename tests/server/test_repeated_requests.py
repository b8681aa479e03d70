"""Requests that are sent again, because the answer was lost."""

from __future__ import annotations

from pathlib import Path

from printer_slicer.print_queue import JobRequest, PrintQueue, open_queue
from tests.server.client import GCODE, ServerClient, form


def test_a_request_that_is_sent_again_adds_no_second_job(server: ServerClient, queue: PrintQueue) -> None:
    file = queue.add_file("part.gcode", [GCODE])
    body, headers = {"file": file.id, "copies": 2}, {"idempotency-key": "abc"}
    first = server.post("/v1/jobs", json=body, headers=headers).json()
    again = server.post("/v1/jobs", json=body, headers=headers)
    assert (again.status_code, again.json()) == (201, first)
    assert len(queue.snapshot().jobs) == 2
    assert server.post("/v1/jobs", json=body | {"copies": 1}, headers=headers).status_code == 422
    assert server.post("/v1/jobs", json=body, headers={"idempotency-key": "x" * 300}).status_code == 400
    assert len(server.post("/v1/jobs", json=body).json()) == 2
    assert len(queue.snapshot().jobs) == 4


def test_an_upload_that_is_sent_again_is_printed_once(server: ServerClient, queue: PrintQueue) -> None:
    server.headers["idempotency-key"] = "abc"
    for _ in range(2):
        sent = form(("print", None, b"true"), ("file", "part.gcode", GCODE))
        assert server.post("/printers/left/api/files/local", **sent).status_code == 201
    assert len(queue.snapshot().jobs) == 1


def test_a_request_is_known_after_a_restart(queue: PrintQueue, tmp_path: Path) -> None:
    file = queue.add_file("part.gcode", [GCODE])
    jobs = queue.add_jobs(file.id, JobRequest(), request_id="abc")
    queue.cancel_job(jobs[0].id)
    queue.close()
    restarted = open_queue(tmp_path / "queue", tmp_path / "printers.toml")
    (job,) = restarted.add_jobs(file.id, JobRequest(), request_id="abc")
    assert (job.id, job.state) == (jobs[0].id, "cancelled")
    restarted.close()
