"""Upload a file to a Duet, and read and cancel its print: standalone, or with a single-board computer.

Source: the RepRapFirmware wiki, "HTTP requests" (`rr_...`), and Duet Software Framework, "REST API" (`/machine/...`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final
from urllib.parse import quote
from zlib import crc32

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error, read_status_json
from printer_slicer.sending.remote_status import RemoteState, RemoteStatus, parse_share

__all__ = ["cancel_on_duet", "read_duet_status", "send_to_duet"]

_DEFAULT_FOLDER: Final = "gcodes"
_CHUNK: Final = 1 << 20
_STATES: Final[dict[str, RemoteState]] = {
    **dict.fromkeys(
        ("processing", "resuming", "changingTool", "busy", "cancelling", "simulating"), "printing"
    ),
    **dict.fromkeys(("paused", "pausing"), "paused"),
    **dict.fromkeys(("off", "disconnected", "starting", "updating"), "offline"),
    "halted": "error",
}
"""`state.status` of the object model -> our state; the printer is idle in all others."""


def send_to_duet(connection: Connection, upload: Upload) -> str:
    """Upload a file to the job folder of a Duet; return the path of the file on the Duet.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    folder = upload.folder.strip("/") or _DEFAULT_FOLDER
    place = f"0:/{folder}/{upload.name}"
    with _open_session(connection) as is_standalone:
        if is_standalone:
            _upload_standalone(connection, upload, place)
        else:
            _upload_to_framework(connection, upload, place)
    return place


def read_duet_status(connection: Connection) -> RemoteStatus:
    """Read what a Duet does.

    Raises:
        PortError: the Duet does not answer, or rejects the password.
    """
    with _open_session(connection) as is_standalone:
        if is_standalone:
            state, job = (
                _read_model(connection, f"/rr_model?key={key}").get("result") for key in ("state", "job")
            )
        else:
            model = _read_model(connection, "/machine/model")
            state, job = model.get("state"), model.get("job")
    return _make_status(state or {}, job or {})


def _read_model(connection: Connection, path: str) -> dict[str, Any]:
    """Read the object model, or a part of it."""
    answer = connection.request("GET", path)
    return read_status_json(connection, answer)


def _make_status(state: dict[str, Any], job: dict[str, Any]) -> RemoteStatus:
    """Return the status that `state` and `job` of the object model describe."""
    text = str(state.get("status", ""))
    file = job.get("file") or {}
    is_active = _STATES.get(text, "idle") in {"printing", "paused"}
    last = str(job.get("lastFileName") or "")
    aborted = bool(job.get("lastFileAborted") or job.get("lastFileCancelled"))
    return RemoteStatus(
        _STATES.get(text, "idle"),
        file=str(file.get("fileName") or "") if is_active else last,
        share=parse_share(job.get("filePosition"), file.get("size") or 1) if is_active else None,
        is_complete=None if is_active or not last else not aborted,
        message=text,
    )


def cancel_on_duet(connection: Connection) -> None:
    """Cancel the print that runs on a Duet: pause it (M25), then end it (M0).

    Raises:
        PortError: the Duet does not answer, or rejects the password.
    """
    with _open_session(connection) as is_standalone:
        for code in ("M25", "M0"):
            answer = (
                connection.request("GET", "/rr_gcode", params={"gcode": code})
                if is_standalone
                else connection.request("POST", "/machine/code", content=code.encode())
            )
            if answer.status_code != 200:
                raise make_rejection_error(connection, answer, "the print was not cancelled")


@contextmanager
def _open_session(connection: Connection) -> Iterator[bool]:
    """Open a session within a `with` block; yield whether the Duet works without a single-board computer.

    Raises:
        PortError: the Duet does not answer, rejects the password, or has no free session.
    """
    password = {"password": connection.key or "reprap"}
    answer = connection.request("GET", "/rr_connect", params=password)
    if is_framework := answer.status_code == 404:
        answer = connection.request("GET", "/machine/connect", params=password)
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the request for a session failed")
    answered = connection.parse_json(answer)
    if is_framework:
        connection.set_headers({"X-Session-Key": str(answered.get("sessionKey", ""))})
        yield False
        return
    if answered.get("err") != 0:
        raise _make_session_error(connection, answered.get("err"))
    if "sessionKey" in answered:
        connection.set_headers({"X-Session-Key": str(answered["sessionKey"])})
    try:
        yield True
    finally:
        connection.request("GET", "/rr_disconnect")


def _upload_standalone(connection: Connection, upload: Upload, place: str) -> None:
    """Upload a file, with its checksum, to a standalone Duet; start the print with M32 if requested."""
    query = {"name": place, "crc32": f"{_compute_file_checksum(upload):08x}"}
    answer = connection.upload_file("POST", "/rr_upload", upload, params=query)
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, f"{upload.name} was not accepted")
    if connection.parse_json(answer).get("err") != 0:
        raise PortError(
            f"{connection.url}: {upload.name} was not accepted",
            remedy="Check the free space of the SD card, then try again",
        )
    if upload.start:
        started = connection.request("GET", "/rr_gcode", params={"gcode": f'M32 "{place}"'})
        if started.status_code != 200:
            raise make_rejection_error(
                connection, started, f"{place} was uploaded, but the print did not start"
            )


def _upload_to_framework(connection: Connection, upload: Upload, place: str) -> None:
    """Upload a file through the Duet Software Framework; start the print with M32 if requested."""
    done = connection.upload_file("PUT", f"/machine/file/{quote(place)}", upload)
    if done.status_code not in {200, 201}:
        raise make_rejection_error(connection, done, f"{upload.name} was not accepted")
    if upload.start:
        started = connection.request("POST", "/machine/code", content=f'M32 "{place}"'.encode())
        if started.status_code != 200:
            raise make_rejection_error(
                connection, started, f"{place} was uploaded, but the print did not start"
            )


def _compute_file_checksum(upload: Upload) -> int:
    """Return the CRC-32 of the file to upload."""
    total = 0
    with upload.path.open("rb") as file:
        while data := file.read(_CHUNK):
            total = crc32(data, total)
    return total


def _make_session_error(connection: Connection, code: object) -> PortError:
    """Return the exception for a Duet that opens no session and answers error code `code` instead."""
    if code == 1:
        return PortError(
            f"{connection.url}: the password is wrong",
            remedy="Pass the password with --key-file or PRINTER_SLICER_KEY",
        )
    if code == 2:
        return PortError(
            f"{connection.url}: all sessions are in use",
            remedy="Close other web pages of the printer, or try again later",
        )
    return PortError(
        f"{connection.url}: the printer did not open a session (error {code})",
        remedy="Check the web page of the printer",
    )
