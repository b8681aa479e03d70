"""Upload a file to Moonraker, and read and cancel its print.

Source: documentation of Moonraker, "External API: File management, Printer administration, Server administration,
Authorization".
"""

from __future__ import annotations

from hashlib import file_digest
from typing import Final

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error, read_status_json
from printer_slicer.sending.remote_status import RemoteState, RemoteStatus, parse_share

__all__ = ["cancel_on_moonraker", "read_moonraker_status", "send_to_moonraker"]

_STATES: Final[dict[str, RemoteState]] = {"printing": "printing", "paused": "paused", "error": "error"}
"""State of Klipper's `print_stats` -> our state; the printer is idle in all others."""


def send_to_moonraker(connection: Connection, upload: Upload) -> str:
    """Upload a file, with its checksum, to the folder `gcodes` of Moonraker; return its path there.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    _log_in(connection)
    info = connection.request("GET", "/server/info")
    if info.status_code != 200:
        raise make_rejection_error(connection, info, "the version query failed")
    state = connection.parse_json(info).get("result")
    if not isinstance(state, dict) or "klippy_state" not in state:
        raise PortError(
            f"{connection.url}: the server at this address is not Moonraker",
            remedy="Check the address and the kind of server after --to",
        )
    if upload.start and state["klippy_state"] != "ready":
        raise PortError(
            f"{connection.url}: Klipper is not ready ({state['klippy_state']}), so the print cannot start",
            remedy="Check the web page of the server, or leave out --print to upload only",
        )
    with upload.path.open("rb") as file:
        checksum = file_digest(file, "sha256").hexdigest()
    fields = {
        "root": "gcodes",
        "path": upload.folder.strip("/"),
        "print": "true" if upload.start else "false",
        "checksum": checksum,
    }
    answer = connection.upload_form(
        "/server/files/upload", upload, {key: value for key, value in fields.items() if value}
    )
    if answer.status_code not in {200, 201}:
        raise make_rejection_error(connection, answer, f"{upload.name} was not accepted")
    answered = connection.parse_json(answer)
    answered = answered.get("result", answered)
    place = str(answered.get("item", {}).get("path", upload.server_path))
    if upload.start and not answered.get("print_started", False):
        raise PortError(
            f"{connection.url}: {place} was uploaded, but the print did not start",
            remedy="Check whether another print is running",
        )
    return place


def read_moonraker_status(connection: Connection) -> RemoteStatus:
    """Read what the printer behind Moonraker does.

    Raises:
        PortError: Moonraker does not answer, or rejects the key.
    """
    _log_in(connection)
    answer = connection.request("GET", "/printer/objects/query?print_stats&virtual_sdcard")
    if answer.status_code == 503:
        return RemoteStatus("offline", message="Klipper is not ready")
    found = (read_status_json(connection, answer).get("result") or {}).get("status") or {}
    statistics = found.get("print_stats") or {}
    text = str(statistics.get("state", ""))
    ended = text in {"complete", "cancelled", "error"}
    return RemoteStatus(
        _STATES.get(text, "idle"),
        file=str(statistics.get("filename") or ""),
        share=parse_share((found.get("virtual_sdcard") or {}).get("progress")),
        is_complete=text == "complete" if ended else None,
        message=str(statistics.get("message") or text),
    )


def cancel_on_moonraker(connection: Connection) -> None:
    """Cancel the print that runs in Moonraker.

    Raises:
        PortError: Moonraker does not answer, rejects the key, or prints nothing.
    """
    _log_in(connection)
    answer = connection.request("POST", "/printer/print/cancel")
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the print was not cancelled")


def _log_in(connection: Connection) -> None:
    """Send the API key with all further requests."""
    if connection.key:
        connection.set_headers({"X-Api-Key": connection.key})
