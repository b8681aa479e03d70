"""Duet with RepRapFirmware, by itself or with a single-board computer.

Source: the RepRapFirmware wiki, "HTTP requests" (`rr_...`), and Duet Software Framework, "REST API" (`/machine/...`).
"""

from __future__ import annotations

from typing import Final
from urllib.parse import quote
from zlib import crc32

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_duet"]

_USUAL: Final = "gcodes"
_CHUNK: Final = 1 << 20


def send_to_duet(connection: Connection, upload: Upload) -> str:
    """Upload to the folder of G-codes; the path there.

    Raises:
        PortError: it cannot be done.
    """
    folder = upload.folder.strip("/") or _USUAL
    place = f"0:/{folder}/{upload.name}"
    answer = connection.ask("GET", "/rr_connect", params={"password": connection.key or "reprap"})
    if answer.status_code == 404:
        _by_computer(connection, upload, place)
        return place
    if answer.status_code != 200:
        raise refused(connection, answer, "asked for a session")
    told = connection.said(answer)
    if told.get("err") != 0:
        raise _no_session(connection, told.get("err"))
    if "sessionKey" in told:
        connection.head({"X-Session-Key": str(told["sessionKey"])})
    try:
        _by_itself(connection, upload, place)
    finally:
        connection.ask("GET", "/rr_disconnect")
    return place


def _by_itself(connection: Connection, upload: Upload, place: str) -> None:
    """Upload with a checksum, then M32."""
    query = {"name": place, "crc32": f"{_checksum(upload):08x}"}
    answer = connection.upload("POST", "/rr_upload", upload, params=query)
    if answer.status_code != 200:
        raise refused(connection, answer, f"{upload.name} was not taken")
    if connection.said(answer).get("err") != 0:
        raise PortError(
            f"{connection.url}: {upload.name} was not taken", remedy="is there room on the card? try again"
        )
    if upload.start:
        started = connection.ask("GET", "/rr_gcode", params={"gcode": f'M32 "{place}"'})
        if started.status_code != 200:
            raise refused(connection, started, f"{place} is there, but is not printed")


def _by_computer(connection: Connection, upload: Upload, place: str) -> None:
    """The same with the software framework."""
    answer = connection.ask("GET", "/machine/connect", params={"password": connection.key or "reprap"})
    if answer.status_code != 200:
        raise refused(connection, answer, "asked for a session")
    connection.head({"X-Session-Key": str(connection.said(answer).get("sessionKey", ""))})
    done = connection.upload("PUT", f"/machine/file/{quote(place)}", upload)
    if done.status_code not in {200, 201}:
        raise refused(connection, done, f"{upload.name} was not taken")
    if upload.start:
        started = connection.ask("POST", "/machine/code", content=f'M32 "{place}"'.encode())
        if started.status_code != 200:
            raise refused(connection, started, f"{place} is there, but is not printed")


def _checksum(upload: Upload) -> int:
    total = 0
    with upload.path.open("rb") as file:
        while data := file.read(_CHUNK):
            total = crc32(data, total)
    return total


def _no_session(connection: Connection, code: object) -> PortError:
    if code == 1:
        return PortError(
            f"{connection.url}: the password is wrong", remedy="give it with --key-file or PRINTER_SLICER_KEY"
        )
    if code == 2:
        return PortError(
            f"{connection.url}: has no session left", remedy="close some of its pages, or wait a little"
        )
    return PortError(f"{connection.url}: gives no session (err {code})", remedy="look at its page")
