"""Upload a file to OctoPrint.

Source: documentation of OctoPrint, "REST API: File operations", "Version information".
"""

from __future__ import annotations

from typing import Final

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error

__all__ = ["send_to_octoprint"]

_BUSY_STATES: Final = ("Printing", "Starting", "Sending", "Paus", "Resum", "Cancel", "Finish", "Transfer")
_OFFLINE_STATES: Final = ("Offline", "Closed", "Opening", "Detecting", "Connecting")
"""Prefixes of the states in which OctoPrint's `PrinterInterface` is busy or not connected."""


def send_to_octoprint(connection: Connection, upload: Upload) -> str:
    """Upload a file to the upload folder of OctoPrint; return the path of the file in OctoPrint.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    if connection.key:
        connection.set_headers({"X-Api-Key": connection.key})
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
