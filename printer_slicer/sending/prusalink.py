"""Upload a file to PrusaLink, and read and cancel its print.

Source: the OpenAPI description in its repository (`/api/v1/storage`, `/api/v1/files`, `/api/v1/job`, `/api/v1/status`).
"""

from __future__ import annotations

from typing import Any, Final
from urllib.parse import quote

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error, read_status_json
from printer_slicer.sending.remote_status import RemoteState, RemoteStatus, parse_share

__all__ = ["cancel_on_prusalink", "read_prusalink_status", "send_to_prusalink"]

_STATES: Final[dict[str, RemoteState]] = {
    "PRINTING": "printing",
    "BUSY": "printing",
    "PAUSED": "paused",
    "ATTENTION": "paused",
    "ERROR": "error",
}
"""State of the printer -> our state; the printer is idle in all others."""


def send_to_prusalink(connection: Connection, upload: Upload) -> str:
    """Upload a file to the first writable storage of PrusaLink; return the path of the file there.

    A file of the same name is replaced. With a user name, the key is a password for digest authentication.
    Without a user name, the key is an API key.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    _log_in(connection)
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


def read_prusalink_status(connection: Connection) -> RemoteStatus:
    """Read what the printer behind PrusaLink does.

    Raises:
        PortError: PrusaLink does not answer, or rejects the key.
    """
    _log_in(connection)
    answer = connection.request("GET", "/api/v1/status")
    found = read_status_json(connection, answer)
    text = str((found.get("printer") or {}).get("state", ""))
    job = _read_job(connection)
    return RemoteStatus(
        _STATES.get(text, "idle"),
        file=str((job.get("file") or {}).get("display_name") or (job.get("file") or {}).get("name") or ""),
        share=parse_share(job.get("progress"), 100),
        is_complete={"FINISHED": True, "STOPPED": False, "ERROR": False}.get(text),
        message=text,
    )


def cancel_on_prusalink(connection: Connection) -> None:
    """Cancel the print that runs in PrusaLink.

    Raises:
        PortError: PrusaLink does not answer, rejects the key, or prints nothing.
    """
    _log_in(connection)
    if (number := _read_job(connection).get("id")) is None:
        raise PortError(f"{connection.url}: nothing is printed", remedy="Check the printer")
    answer = connection.request("DELETE", f"/api/v1/job/{quote(str(number))}")
    if answer.status_code != 204:
        raise make_rejection_error(connection, answer, "the print was not cancelled")


def _read_job(connection: Connection) -> dict[str, Any]:
    """Read the job of the printer; empty if it has none."""
    answer = connection.request("GET", "/api/v1/job")
    if answer.status_code == 204:
        return {}
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the job could not be read")
    return connection.parse_json(answer)


def _log_in(connection: Connection) -> None:
    """Use the password, or send the API key, with all further requests."""
    if connection.user:
        connection.use_digest_authentication()
    elif connection.key:
        connection.set_headers({"X-Api-Key": connection.key})
