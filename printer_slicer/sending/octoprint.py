"""Upload a file to OctoPrint, and read and cancel its print.

Source: documentation of OctoPrint, "REST API: File operations", "Job operations", "Version information".
"""

from __future__ import annotations

from typing import Final

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error, read_status_json
from printer_slicer.sending.remote_status import RemoteState, RemoteStatus, parse_share

__all__ = ["cancel_on_octoprint", "read_octoprint_status", "send_to_octoprint"]

_BUSY_STATES: Final = ("Printing", "Starting", "Sending", "Paus", "Resum", "Cancel", "Finish", "Transfer")
_OFFLINE_STATES: Final = ("Offline", "Closed", "Opening", "Detecting", "Connecting")
"""Prefixes of the states in which OctoPrint's `PrinterInterface` is busy or not connected."""


def send_to_octoprint(connection: Connection, upload: Upload) -> str:
    """Upload a file to the upload folder of OctoPrint; return the path of the file in OctoPrint.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    _log_in(connection)
    version = connection.request("GET", "/api/version")
    if version.status_code != 200:
        raise make_rejection_error(connection, version, "the version query failed")
    if "api" not in connection.parse_json(version):
        raise PortError(
            f"{connection.url}: the server at this address is not OctoPrint",
            remedy="Check the address and the kind of server after --to",
        )
    fields = {"path": upload.folder.strip("/"), "print": "true" if upload.start else "false"}
    answer = connection.upload_form("/api/files/local", upload, fields)
    if answer.status_code != 201:
        raise make_rejection_error(connection, answer, f"{upload.name} was not accepted")
    answered = connection.parse_json(answer)
    place = str(answered.get("files", {}).get("local", {}).get("path", upload.server_path))
    if upload.start and not answered.get("effectivePrint", True):
        raise PortError(
            f"{connection.url}: {place} was uploaded, but the print did not start",
            remedy=_choose_remedy(connection),
        )
    return place


def _choose_remedy(connection: Connection) -> str:
    """Return the remedy for a print that did not start, depending on the state of OctoPrint."""
    answer = connection.request("GET", "/api/job")
    state = str(connection.parse_json(answer).get("state", "")) if answer.status_code == 200 else ""
    if state.startswith(_BUSY_STATES):
        return f"Start the print in OctoPrint when the current print has ended ({state})"
    if not state or state.startswith(_OFFLINE_STATES):
        return "Connect OctoPrint to its printer and start the print there"
    return f"Check the printer in OctoPrint (its state is {state!r}) and start the print there"


def read_octoprint_status(connection: Connection) -> RemoteStatus:
    """Read what the printer behind OctoPrint does.

    Raises:
        PortError: OctoPrint does not answer, or rejects the key.
    """
    _log_in(connection)
    answer = connection.request("GET", "/api/job")
    found = read_status_json(connection, answer)
    text = str(found.get("state", ""))
    share = parse_share((found.get("progress") or {}).get("completion"), 100)
    state: RemoteState = "idle"
    if text.startswith(("Paus", "Resum")):
        state = "paused"
    elif text.startswith(_BUSY_STATES):
        state = "printing"
    elif text.startswith(_OFFLINE_STATES):
        state = "offline"
    elif "rror" in text:
        state = "error"
    return RemoteStatus(
        state,
        file=str(((found.get("job") or {}).get("file") or {}).get("path") or ""),
        share=share,
        is_complete=None if share is None or state in {"printing", "paused"} else share == 1,
        message=str(found.get("error") or text),
    )


def cancel_on_octoprint(connection: Connection) -> None:
    """Cancel the print that runs in OctoPrint.

    Raises:
        PortError: OctoPrint does not answer, rejects the key, or prints nothing.
    """
    _log_in(connection)
    answer = connection.request("POST", "/api/job", json={"command": "cancel"})
    if answer.status_code != 204:
        raise make_rejection_error(connection, answer, "the print was not cancelled")


def _log_in(connection: Connection) -> None:
    """Send the API key with all further requests."""
    if connection.key:
        connection.set_headers({"X-Api-Key": connection.key})
