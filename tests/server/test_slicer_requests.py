"""Requests of slicers on a socket, reconstructed: nothing was recorded from a running slicer.

Requests, fields and their order follow a reading of the sources of PrusaSlicer 2.9, OrcaSlicer and Cura's OctoPrint
plug-in. Boundaries, versions and the headers of libcurl and Qt are examples in the form that these libraries use.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.server.client import GCODE
from tests.server.live import LiveServer, add_job, read_all, run_live_server, status_of, supervise
from tests.waiting import until

CURL = "------------------------8d1bf5f2a61a91d1"
QT = "boundary_.oOo._MTk1OTI3ODQ4NA==MTY4MTY5Mjc3Nw==MjEzODQ1MjE5OA=="


@pytest.fixture
def live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveServer]:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))
    with run_live_server(tmp_path) as server:
        yield server


def request(live: LiveServer, line: str, headers: str, body: bytes = b"") -> bytes:
    """Send a request as a slicer does, and return the response; `Connection: close` alone is added."""
    head = f"{line} HTTP/1.1\r\nHost: localhost\r\n{headers}Connection: close\r\n"
    head += f"Content-Length: {len(body)}\r\n" if body else ""
    return live.talk(head.encode() + b"\r\n" + body)


def parse(response: bytes) -> Any:
    """The JSON in a response."""
    return json.loads(response.split(b"\r\n\r\n", 1)[1])


def curl_part(name: str, value: bytes, more: str = "") -> bytes:
    """A part of a form as libcurl sends it."""
    head = f'--{CURL}\r\nContent-Disposition: form-data; name="{name}"{more}\r\n\r\n'
    return head.encode() + value + b"\r\n"


def test_prusa_slicer_uploads_to_octoprint(live: LiveServer) -> None:
    headers = f"User-Agent: PrusaSlicer/2.9.2\r\nAccept: */*\r\nX-Api-Key: {live.key}\r\n"
    version = parse(request(live, "GET /printers/left/api/version", headers))
    assert version["api"]
    assert version["text"].startswith("OctoPrint")
    body = curl_part("print", b"true") + curl_part("path", b"")
    more = '; filename="Benchy 0.2mm.gcode"\r\nContent-Type: application/octet-stream'
    body += curl_part("file", GCODE, more) + f"--{CURL}--\r\n".encode()
    headers += f"Content-Type: multipart/form-data; boundary={CURL}\r\n"
    response = request(live, "POST /printers/left/api/files/local", headers, body)
    assert status_of(response) == 201, response
    assert parse(response)["effectivePrint"] is False
    (job,) = live.queue.snapshot().jobs
    assert (job.name, job.printer) == ("Benchy 0.2mm.gcode", "left")


def test_a_large_upload_of_curl_asks_whether_to_go_on(live: LiveServer) -> None:
    more = '; filename="part.gcode"\r\nContent-Type: application/octet-stream'
    content = GCODE * 20_000
    body = curl_part("print", b"false") + curl_part("path", b"") + curl_part("file", content, more)
    body += f"--{CURL}--\r\n".encode()
    headers = (
        "POST /printers/left/api/files/local HTTP/1.1\r\nHost: localhost\r\nUser-Agent: PrusaSlicer/2.9.2\r\n"
        f"Accept: */*\r\nX-Api-Key: {live.key}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n"
        f"Content-Type: multipart/form-data; boundary={CURL}\r\nExpect: 100-continue\r\n\r\n"
    )
    with live.connect() as connection:
        connection.sendall(headers.encode())
        assert connection.recv(1000).startswith(b"HTTP/1.1 100 ")
        connection.sendall(body)
        assert status_of(read_all(connection)) == 201
    wrong = headers.replace(live.key, "ps_wrong_key")
    response = live.talk(wrong.encode())
    assert status_of(response) == 401  # before the body


def test_prusa_slicer_uploads_to_moonraker(live: LiveServer) -> None:
    headers = f"User-Agent: PrusaSlicer/2.9.2\r\nAccept: */*\r\nX-Api-Key: {live.key}\r\n"
    info = request(live, "GET /printers/left/server/info", headers)
    assert b'\r\n\r\n{"result":{' in info
    body = curl_part("root", b"gcodes") + curl_part("path", b"") + curl_part("print", b"true")
    more = '; filename="part.gcode"\r\nContent-Type: application/octet-stream'
    body += curl_part("file", GCODE, more) + f"--{CURL}--\r\n".encode()
    headers += f"Content-Type: multipart/form-data; boundary={CURL}\r\n"
    response = request(live, "POST /printers/left/server/files/upload", headers, body)
    assert status_of(response) == 201
    assert parse(response)["item"]["path"] == "part.gcode"


def test_cura_connects_polls_and_uploads(live: LiveServer) -> None:
    headers = (
        f"User-Agent: cura/5.7.0 OctoPrintPlugin/3.7.3\r\nX-Api-Key: {live.key}\r\nAccept-Encoding: gzip, deflate\r\n"
        "Accept-Language: en-GB,*\r\n"
    )
    as_json = headers + "Content-Type: application/json\r\n"
    prefix = "/printers/left/api"
    for path in ("settings", "version", "printerprofiles", "job"):
        assert status_of(request(live, f"GET {prefix}/{path}", headers)) == 200, path
    assert status_of(request(live, f"POST {prefix}/login", as_json, b'{"passive": true}')) == 200
    state = parse(request(live, f"GET {prefix}/printer", headers))["state"]
    wanted = {"operational", "paused", "pausing", "printing", "cancelling", "error", "ready", "closedOrError"}
    assert wanted <= state["flags"].keys()
    parts = (("path", "", b""), ("file", '; filename="UMS3_part.gcode"', GCODE), ("select", "", b"true"))
    body = b"".join(
        f'--{QT}\r\nContent-Disposition: form-data; name="{name}"{more}\r\n\r\n'.encode() + value + b"\r\n"
        for name, more, value in (*parts, ("print", "", b"true"))
    )
    form = headers + f'Content-Type: multipart/form-data; boundary="{QT}"\r\nMIME-Version: 1.0\r\n'
    response = request(live, f"POST {prefix}/files/local", form, body + f"--{QT}--\r\n".encode())
    assert status_of(response) == 201
    location = next(one for one in response.split(b"\r\n") if one.lower().startswith(b"location: "))
    assert b"/api/files/local/UMS3_part.gcode" in location
    assert len(live.queue.snapshot().jobs) == 1
    response = request(live, f"POST {prefix}/job", as_json, b'{"command": "pause"}')
    assert status_of(response) == 409  # nothing is printed yet


def test_an_app_sends_gcode_and_the_emergency_stop_during_a_print(live: LiveServer) -> None:
    job = add_job(live.queue, b"G28\nM83\nM109 S200\nG1 X20 Y20 Z0.2 E1 F1200\nG4 S600\nM104 S0\n")
    path = "POST /printers/left/api/printer/command"
    headers = f"X-Api-Key: {live.key}\r\nContent-Type: application/json\r\n"
    with supervise(live.queue):
        until(lambda: live.queue.find_job(job).state == "printing")
        assert status_of(request(live, path, headers, b'{"command": "M117 hello"}')) == 204
        for refused in (b'{"commands": ["M104 S900"]}', b'{"command": "M117 a\\nM104 S200"}'):
            assert status_of(request(live, path, headers, refused)) == 409, refused
        homing = request(live, path, headers, b'{"command": "G28"}')
        assert status_of(homing) == 409
        assert b'"remedy": "Pause the print' in homing
        assert status_of(request(live, path, headers, b'{"command": "M112"}')) == 204
        until(lambda: live.queue.find_job(job).state != "printing")
    assert "emergency stop" in live.queue.find_job(job).message
