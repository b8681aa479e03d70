"""Upload a file to PrusaLink.

Source: the OpenAPI description in its repository (`/api/v1/storage`, `/api/v1/files`).
"""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error

__all__ = ["send_to_prusalink"]


def send_to_prusalink(connection: Connection, upload: Upload) -> str:
    """Upload a file to the first writable storage of PrusaLink; return the path of the file there.

    A file of the same name is replaced. With a user name, the key is a password for digest authentication.
    Without a user name, the key is an API key.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    if connection.user:
        connection.use_digest_authentication()
    elif connection.key:
        connection.set_headers({"X-Api-Key": connection.key})
    answer = connection.request("GET", "/api/v1/storage")
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the list of storages could not be read")
    place = f"{_find_storage(connection, connection.parse_json(answer)).strip('/')}/{upload.server_path}"
    headers = {
        "Content-Type": "text/x.gcode",
        "Overwrite": "?1",
        "Print-After-Upload": "?1" if upload.start else "?0",
    }
    done = connection.upload_file("PUT", f"/api/v1/files/{quote(place)}", upload, headers=headers)
    if done.status_code not in {200, 201}:
        raise make_rejection_error(connection, done, f"{upload.name} was not accepted")
    return place


def _find_storage(connection: Connection, listing: dict[str, Any]) -> str:
    """Return the path of the first writable storage in the server's listing."""
    for storage in listing.get("storage_list", ()):
        if storage.get("available", False) and not storage.get("read_only", False):
            return str(storage["path"])
    raise PortError(
        f"{connection.url}: the printer has no writable storage", remedy="Plug a USB drive into the printer"
    )
