"""Upload to a Duet with RepRapFirmware, standalone or with a single-board computer.

Source: the RepRapFirmware wiki, "HTTP requests" (`rr_...`), and Duet Software Framework, "REST API" (`/machine/...`).
"""

from __future__ import annotations

from typing import Final
from urllib.parse import quote
from zlib import crc32

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_duet"]

_DEFAULT_FOLDER: Final = "gcodes"
_CHUNK: Final = 1 << 20


def send_to_duet(connection: Connection, upload: Upload) -> str:
    """Upload to the folder of jobs; return the path on the server.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    folder = upload.folder.strip("/") or _DEFAULT_FOLDER
    place = f"0:/{folder}/{upload.name}"
    answer = connection.ask("GET", "/rr_connect", params={"password": connection.key or "reprap"})
    if answer.status_code == 404:
        _upload_to_framework(connection, upload, place)
        return place
    if answer.status_code != 200:
        raise refused(connection, answer, "the request for a session failed")
    answered = connection.said(answer)
    if answered.get("err") != 0:
        raise _no_session(connection, answered.get("err"))
    if "sessionKey" in answered:
        connection.head({"X-Session-Key": str(answered["sessionKey"])})
    try:
        _upload_standalone(connection, upload, place)
    finally:
        connection.ask("GET", "/rr_disconnect")
    return place


def _upload_standalone(connection: Connection, upload: Upload, place: str) -> None:
    """Upload to a standalone board with a checksum, and start the print with M32."""
    query = {"name": place, "crc32": f"{_checksum(upload):08x}"}
    answer = connection.upload("POST", "/rr_upload", upload, params=query)
    if answer.status_code != 200:
        raise refused(connection, answer, f"{upload.name} was not accepted")
    if connection.said(answer).get("err") != 0:
        raise PortError(
            f"{connection.url}: {upload.name} was not accepted",
            remedy="Check the free space of its SD card, then try again",
        )
    if upload.start:
        started = connection.ask("GET", "/rr_gcode", params={"gcode": f'M32 "{place}"'})
        if started.status_code != 200:
            raise refused(connection, started, f"{place} was uploaded, but the print did not start")


def _upload_to_framework(connection: Connection, upload: Upload, place: str) -> None:
    """Upload through the Duet Software Framework of a single-board computer."""
    answer = connection.ask("GET", "/machine/connect", params={"password": connection.key or "reprap"})
    if answer.status_code != 200:
        raise refused(connection, answer, "the request for a session failed")
    connection.head({"X-Session-Key": str(connection.said(answer).get("sessionKey", ""))})
    done = connection.upload("PUT", f"/machine/file/{quote(place)}", upload)
    if done.status_code not in {200, 201}:
        raise refused(connection, done, f"{upload.name} was not accepted")
    if upload.start:
        started = connection.ask("POST", "/machine/code", content=f'M32 "{place}"'.encode())
        if started.status_code != 200:
            raise refused(connection, started, f"{place} was uploaded, but the print did not start")


def _checksum(upload: Upload) -> int:
    total = 0
    with upload.path.open("rb") as file:
        while data := file.read(_CHUNK):
            total = crc32(data, total)
    return total


def _no_session(connection: Connection, code: object) -> PortError:
    if code == 1:
        return PortError(
            f"{connection.url}: the password is wrong", remedy="Pass it with --key-file or PRINTER_SLICER_KEY"
        )
    if code == 2:
        return PortError(
            f"{connection.url}: all sessions are in use",
            remedy="Close some of its web pages, or try again later",
        )
    return PortError(f"{connection.url}: it opens no session (err {code})", remedy="Check its web page")
