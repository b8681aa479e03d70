"""Upload a file to a Duet with RepRapFirmware, standalone or with a single-board computer.

Source: the RepRapFirmware wiki, "HTTP requests" (`rr_...`), and Duet Software Framework, "REST API" (`/machine/...`).
"""

from __future__ import annotations

from typing import Final
from urllib.parse import quote
from zlib import crc32

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error

__all__ = ["send_to_duet"]

_DEFAULT_FOLDER: Final = "gcodes"
_CHUNK: Final = 1 << 20


def send_to_duet(connection: Connection, upload: Upload) -> str:
    """Upload a file to the job folder of a Duet; return the path of the file on the Duet.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    folder = upload.folder.strip("/") or _DEFAULT_FOLDER
    place = f"0:/{folder}/{upload.name}"
    answer = connection.request("GET", "/rr_connect", params={"password": connection.key or "reprap"})
    if answer.status_code == 404:
        _upload_to_framework(connection, upload, place)
        return place
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the request for a session failed")
    answered = connection.parse_json(answer)
    if answered.get("err") != 0:
        raise _make_session_error(connection, answered.get("err"))
    if "sessionKey" in answered:
        connection.set_headers({"X-Session-Key": str(answered["sessionKey"])})
    try:
        _upload_standalone(connection, upload, place)
    finally:
        connection.request("GET", "/rr_disconnect")
    return place


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
    answer = connection.request("GET", "/machine/connect", params={"password": connection.key or "reprap"})
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the request for a session failed")
    connection.set_headers({"X-Session-Key": str(connection.parse_json(answer).get("sessionKey", ""))})
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
