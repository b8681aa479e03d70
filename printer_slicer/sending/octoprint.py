"""Upload to OctoPrint. Source: its documentation, "REST API: File operations", "Version information"."""

from __future__ import annotations

from typing import Final

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_octoprint"]

_BUSY: Final = ("Printing", "Starting", "Sending", "Paus", "Resum", "Cancel", "Finish", "Transfer")
_NOT_CONNECTED: Final = ("Offline", "Closed", "Opening", "Detecting", "Connecting")
"""Prefixes of the states of OctoPrint's `PrinterInterface`."""


def send_to_octoprint(connection: Connection, upload: Upload) -> str:
    """Upload to the folder of uploads; return the path on the server.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    if connection.key:
        connection.head({"X-Api-Key": connection.key})
    version = connection.ask("GET", "/api/version")
    if version.status_code != 200:
        raise refused(connection, version, "the version query failed")
    if "api" not in connection.said(version):
        raise PortError(
            f"{connection.url}: the server there is not OctoPrint", remedy="Check the kind after --to"
        )
    fields = {"path": upload.folder.strip("/"), "print": "true" if upload.start else "false"}
    answer = connection.form("/api/files/local", upload, fields)
    if answer.status_code != 201:
        raise refused(connection, answer, f"{upload.name} was not accepted")
    answered = connection.said(answer)
    place = str(answered.get("files", {}).get("local", {}).get("path", upload.place))
    if upload.start and not answered.get("effectivePrint", True):
        raise PortError(
            f"{connection.url}: {place} was uploaded, but the print did not start",
            remedy=_remedy(connection),
        )
    return place


def _remedy(connection: Connection) -> str:
    """Return a remedy for a print that did not start, from the state of OctoPrint's job."""
    answer = connection.ask("GET", "/api/job")
    state = str(connection.said(answer).get("state", "")) if answer.status_code == 200 else ""
    if state.startswith(_BUSY):
        return f"Start it in OctoPrint when the current print has ended ({state})"
    if not state or state.startswith(_NOT_CONNECTED):
        return "Connect OctoPrint to its printer and start the print there"
    return f"Check the printer in OctoPrint (its state is {state!r}) and start the print there"
