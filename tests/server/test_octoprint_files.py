"""Files and commands in OctoPrint's interface, as phone apps use them."""

from __future__ import annotations

from printer_slicer.print_queue import PrintQueue
from printer_slicer.server.access import AccessStore
from tests.server.client import GCODE, ServerClient, form

API = "/printers/left/api"
NAME = "a b <b>.gcode"


def upload(server: ServerClient) -> None:
    assert server.post(f"{API}/files/local", **form(("file", NAME, GCODE))).status_code == 201


def test_files_are_listed_started_and_deleted(server: ServerClient, queue: PrintQueue) -> None:
    assert server.get(f"{API}/files").json()["files"] == []
    upload(server)
    (file,) = server.get(f"{API}/files").json()["files"]
    assert (file["name"], file["size"], file["type"]) == (NAME, len(GCODE), "machinecode")
    assert server.get(file["refs"]["download"]).content == GCODE
    assert server.get(file["refs"]["resource"]).json() == file
    started = server.post(file["refs"]["resource"], json={"command": "select", "print": True})
    assert started.status_code == 204
    (job,) = queue.snapshot().jobs
    assert (job.name, job.printer) == (NAME, "left")
    assert server.get(file["refs"]["resource"]).json()["gcodeAnalysis"]["estimatedPrintTime"] > 0
    assert server.delete(file["refs"]["resource"]).status_code == 422  # the job needs it
    queue.cancel_job(job.id)
    assert server.delete(file["refs"]["resource"]).status_code == 204
    assert server.get(f"{API}/files").json()["files"] == []
    assert server.get(file["refs"]["resource"]).status_code == 404


def test_a_key_for_one_printer_deletes_no_files(server: ServerClient, access: AccessStore) -> None:
    upload(server)
    _, text = access.create_key("slicer", frozenset({"read", "upload", "print"}), "left")
    answer = server.delete(f"{API}/files/local/{NAME}", headers={"x-api-key": text})
    assert answer.status_code == 403


def test_the_version_names_a_printer_that_does_not_exist(server: ServerClient) -> None:
    assert server.get(f"{API}/version").status_code == 200
    assert server.get("/api/version").status_code == 200
    answer = server.get("/printers/lef/api/version")
    assert answer.status_code == 404
    assert "no printer lef" in answer.text


def test_gcode_needs_a_print_and_the_scope(server: ServerClient, access: AccessStore) -> None:
    path = f"{API}/printer/command"
    assert server.post(path, json={"commands": ["M117 x"]}).status_code == 409
    assert server.post(path, json={"commands": "M117 x"}).status_code == 400
    assert server.post(path, json={"commands": ["M117 x"] * 51}).status_code == 400
    _, text = access.create_key("slicer", frozenset({"read", "upload", "print"}))
    assert server.post(path, json={"command": "M117"}, headers={"x-api-key": text}).status_code == 403
    assert server.post(f"{API}/connection", json={"command": "connect"}).status_code == 204
    assert server.post(f"{API}/connection", json={"command": "disconnect"}).status_code == 409
