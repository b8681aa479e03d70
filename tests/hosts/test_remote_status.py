"""What print servers say about their prints, and how these are cancelled; answers as in the published descriptions."""

from __future__ import annotations

from typing import Any

import pytest
from small_servers import fixed

from printer_slicer.errors import PortError, UsageError
from printer_slicer.sending import RemoteStatus, cancel_remote_print, read_remote_status

Answers = dict[str, tuple[int, Any]]


def octoprint(state: str, completion: float | None, **more: Any) -> Answers:
    job = {"file": {"name": "b.gcode", "path": "parts/b.gcode"}}
    return {"/api/job": (200, {"job": job, "progress": {"completion": completion}, "state": state, **more})}


def moonraker(state: str, progress: float = 0.0, message: str = "") -> Answers:
    status = {
        "print_stats": {"state": state, "filename": "parts/b.gcode", "message": message},
        "virtual_sdcard": {"progress": progress},
    }
    query = "/printer/objects/query?print_stats&virtual_sdcard"
    return {query: (200, {"result": {"eventtime": 1.5, "status": status}})}


def prusalink(state: str, job: dict[str, Any] | None) -> Answers:
    found = (204, None) if job is None else (200, job)
    return {"/api/v1/status": (200, {"printer": {"state": state}}), "/api/v1/job": found}


def duet(status: str, **job: Any) -> Answers:
    return {
        "/rr_connect?password=secret": (200, {"err": 0}),
        "/rr_disconnect": (200, {"err": 0}),
        "/rr_model?key=state": (200, {"key": "state", "result": {"status": status}}),
        "/rr_model?key=job": (200, {"key": "job", "result": job}),
    }


def machine(status: str, **job: Any) -> Answers:
    return {
        "/machine/connect?password=secret": (200, {"sessionKey": "42"}),
        "/machine/model": (200, {"state": {"status": status}, "job": job}),
    }


FILE = {"fileName": "0:/gcodes/b.gcode", "size": 200}
LINK = {"id": 7, "progress": 25.0, "file": {"name": "B~1.GCO", "display_name": "b.gcode"}}


@pytest.mark.parametrize(
    ("kind", "says", "status"),
    [
        (
            "octoprint",
            octoprint("Printing", 25.0),
            RemoteStatus("printing", "parts/b.gcode", 0.25, None, "Printing"),
        ),
        (
            "octoprint",
            octoprint("Paused", 25.0),
            RemoteStatus("paused", "parts/b.gcode", 0.25, None, "Paused"),
        ),
        (
            "octoprint",
            octoprint("Operational", 100.0),
            RemoteStatus("idle", "parts/b.gcode", 1.0, True, "Operational"),
        ),
        (
            "octoprint",
            octoprint("Operational", 40.0),
            RemoteStatus("idle", "parts/b.gcode", 0.4, False, "Operational"),
        ),
        (
            "octoprint",
            octoprint("Offline after error", None, error="Too many resends"),
            RemoteStatus("offline", "parts/b.gcode", None, None, "Too many resends"),
        ),
        (
            "octoprint",
            {"/api/job": (200, {"job": {"file": None}, "progress": None, "state": "Error"})},
            RemoteStatus("error", "", None, None, "Error"),
        ),
        (
            "moonraker",
            moonraker("printing", 0.5),
            RemoteStatus("printing", "parts/b.gcode", 0.5, None, "printing"),
        ),
        (
            "moonraker",
            moonraker("complete", 1.0),
            RemoteStatus("idle", "parts/b.gcode", 1.0, True, "complete"),
        ),
        ("moonraker", moonraker("cancelled"), RemoteStatus("idle", "parts/b.gcode", 0.0, False, "cancelled")),
        (
            "moonraker",
            moonraker("error", message="Move out of range"),
            RemoteStatus("error", "parts/b.gcode", 0.0, False, "Move out of range"),
        ),
        (
            "moonraker",
            {"/printer/objects/query?print_stats&virtual_sdcard": (503, None)},
            RemoteStatus("offline", message="Klipper is not ready"),
        ),
        (
            "prusalink",
            prusalink("PRINTING", LINK),
            RemoteStatus("printing", "b.gcode", 0.25, None, "PRINTING"),
        ),
        (
            "prusalink",
            prusalink("ATTENTION", LINK),
            RemoteStatus("paused", "b.gcode", 0.25, None, "ATTENTION"),
        ),
        ("prusalink", prusalink("FINISHED", None), RemoteStatus("idle", "", None, True, "FINISHED")),
        ("prusalink", prusalink("STOPPED", None), RemoteStatus("idle", "", None, False, "STOPPED")),
        ("prusalink", prusalink("IDLE", None), RemoteStatus("idle", message="IDLE")),
        (
            "duet",
            duet("processing", file=FILE, filePosition=50),
            RemoteStatus("printing", "0:/gcodes/b.gcode", 0.25, None, "processing"),
        ),
        (
            "duet",
            duet("idle", file={}, lastFileName="0:/gcodes/b.gcode", lastFileAborted=False),
            RemoteStatus("idle", "0:/gcodes/b.gcode", None, True, "idle"),
        ),
        (
            "duet",
            duet("idle", file={}, lastFileName="0:/gcodes/b.gcode", lastFileCancelled=True),
            RemoteStatus("idle", "0:/gcodes/b.gcode", None, False, "idle"),
        ),
        ("duet", duet("halted"), RemoteStatus("error", message="halted")),
        (
            "duet",
            machine("paused", file=FILE, filePosition=100),
            RemoteStatus("paused", "0:/gcodes/b.gcode", 0.5, None, "paused"),
        ),
    ],
)
def test_the_status_of_a_server(kind: str, says: Answers, status: RemoteStatus) -> None:
    with fixed(says) as seen:
        assert read_remote_status(kind, seen.url, key="secret") == status


@pytest.mark.parametrize(
    ("kind", "says", "asked"),
    [
        ("octoprint", {"/api/job": (204, None)}, ["POST /api/job"]),
        ("moonraker", {"/printer/print/cancel": (200, {"result": "ok"})}, ["POST /printer/print/cancel"]),
        (
            "prusalink",
            prusalink("PRINTING", LINK) | {"/api/v1/job/7": (204, None)},
            ["GET /api/v1/job", "DELETE /api/v1/job/7"],
        ),
        (
            "duet",
            duet("processing")
            | {"/rr_gcode?gcode=M25": (200, {"buff": 240}), "/rr_gcode?gcode=M0": (200, {"buff": 240})},
            [
                "GET /rr_connect?password=secret",
                "GET /rr_gcode?gcode=M25",
                "GET /rr_gcode?gcode=M0",
                "GET /rr_disconnect",
            ],
        ),
        (
            "duet",
            machine("processing") | {"/machine/code": (200, None)},
            [
                "GET /rr_connect?password=secret",
                "GET /machine/connect?password=secret",
                "POST /machine/code",
                "POST /machine/code",
            ],
        ),
    ],
)
def test_a_print_on_a_server_is_cancelled(kind: str, says: Answers, asked: list[str]) -> None:
    with fixed(says) as seen:
        cancel_remote_print(kind, seen.url, key="secret")

    assert seen.requests == asked


@pytest.mark.parametrize("kind", ["octoprint", "moonraker", "prusalink", "duet"])
def test_a_server_that_refuses_is_an_error(kind: str) -> None:
    forbidden = {
        "/api/job": (403, None),
        "/printer/objects/query?print_stats&virtual_sdcard": (401, None),
        "/printer/print/cancel": (401, None),
        "/api/v1/status": (401, None),
        "/api/v1/job": (401, None),
        "/rr_connect?password=secret": (403, None),
    }
    with fixed(forbidden) as seen:
        for ask in (read_remote_status, cancel_remote_print):
            with pytest.raises(PortError, match="the key was rejected"):
                ask(kind, seen.url, key="secret")


def test_nothing_to_cancel_is_said() -> None:
    with fixed(prusalink("IDLE", None)) as seen, pytest.raises(PortError, match="nothing is printed"):
        cancel_remote_print("prusalink", seen.url)


def test_an_unknown_kind_of_server_is_refused() -> None:
    with pytest.raises(UsageError, match="unknown kind of server"):
        read_remote_status("repetier", "http://localhost")
