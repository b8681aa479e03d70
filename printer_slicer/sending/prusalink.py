"""PrusaLink. Source: the OpenAPI description in its repository (`/api/v1/storage`, `/api/v1/files`)."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_prusalink"]


def send_to_prusalink(connection: Connection, upload: Upload) -> str:
    """Upload to the first storage that can be written to, over a file of that name; the path there.

    With a user the key is a password, shown by digest; without it is an API key.

    Raises:
        PortError: it cannot be done.
    """
    if connection.user:
        connection.digest()
    elif connection.key:
        connection.head({"X-Api-Key": connection.key})
    answer = connection.ask("GET", "/api/v1/storage")
    if answer.status_code != 200:
        raise refused(connection, answer, "asked for its storage")
    place = f"{_storage(connection, connection.said(answer)).strip('/')}/{upload.place}"
    headers = {
        "Content-Type": "text/x.gcode",
        "Overwrite": "?1",
        "Print-After-Upload": "?1" if upload.start else "?0",
    }
    done = connection.upload("PUT", f"/api/v1/files/{quote(place)}", upload, headers=headers)
    if done.status_code not in {200, 201}:
        raise refused(connection, done, f"{upload.name} was not taken")
    return place


def _storage(connection: Connection, said: dict[str, Any]) -> str:
    """Path of a storage that can be written to."""
    for storage in said.get("storage_list", ()):
        if storage.get("available", False) and not storage.get("read_only", False):
            return str(storage["path"])
    raise PortError(
        f"{connection.url}: has no storage to write to", remedy="plug a USB drive into the printer"
    )
