"""Upload to PrusaLink. Source: the OpenAPI description in its repository (`/api/v1/storage`, `/api/v1/files`)."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_prusalink"]


def send_to_prusalink(connection: Connection, upload: Upload) -> str:
    """Upload to the first writable storage; return the path on the server. A file of the same name is replaced.

    With a user the key is a password for digest authentication; without one it is an API key.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    if connection.user:
        connection.digest()
    elif connection.key:
        connection.head({"X-Api-Key": connection.key})
    answer = connection.ask("GET", "/api/v1/storage")
    if answer.status_code != 200:
        raise refused(connection, answer, "the request for its storage failed")
    place = f"{_storage(connection, connection.said(answer)).strip('/')}/{upload.place}"
    headers = {
        "Content-Type": "text/x.gcode",
        "Overwrite": "?1",
        "Print-After-Upload": "?1" if upload.start else "?0",
    }
    done = connection.upload("PUT", f"/api/v1/files/{quote(place)}", upload, headers=headers)
    if done.status_code not in {200, 201}:
        raise refused(connection, done, f"{upload.name} was not accepted")
    return place


def _storage(connection: Connection, said: dict[str, Any]) -> str:
    """Return the path of the first writable storage."""
    for storage in said.get("storage_list", ()):
        if storage.get("available", False) and not storage.get("read_only", False):
            return str(storage["path"])
    raise PortError(
        f"{connection.url}: it has no writable storage", remedy="Plug a USB drive into the printer"
    )
