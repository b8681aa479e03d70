"""OctoPrint. Source: its documentation, "REST API: File operations", "Version information"."""

from __future__ import annotations

from typing import Final

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_octoprint"]

_BUSY: Final = ("Printing", "Starting", "Sending", "Paus", "Resum", "Cancel", "Finish", "Transfer")
_APART: Final = ("Offline", "Closed", "Opening", "Detecting", "Connecting")
"""First words of the states of OctoPrint's `PrinterInterface`, by meaning."""


def send_to_octoprint(connection: Connection, upload: Upload) -> str:
    """Upload to the folder of uploads; the path there.

    Raises:
        PortError: it cannot be done.
    """
    if connection.key:
        connection.head({"X-Api-Key": connection.key})
    version = connection.ask("GET", "/api/version")
    if version.status_code != 200:
        raise refused(connection, version, "asked who it is")
    if "api" not in connection.said(version):
        raise PortError(f"{connection.url}: what answers there is no OctoPrint", remedy="check --to")
    fields = {"path": upload.folder.strip("/"), "print": "true" if upload.start else "false"}
    answer = connection.form("/api/files/local", upload, fields)
    if answer.status_code != 201:
        raise refused(connection, answer, f"{upload.name} was not taken")
    told = connection.said(answer)
    place = str(told.get("files", {}).get("local", {}).get("path", upload.place))
    if upload.start and not told.get("effectivePrint", True):
        raise PortError(
            f"{connection.url}: {place} is there, but is not printed",
            remedy=_reason(connection),
        )
    return place


def _reason(connection: Connection) -> str:
    """Say why OctoPrint does not print, with a remedy, from the state of its job."""
    answer = connection.ask("GET", "/api/job")
    state = str(connection.said(answer).get("state", "")) if answer.status_code == 200 else ""
    if state.startswith(_BUSY):
        return f"it is busy with another print ({state}): start this one in OctoPrint afterwards"
    if not state or state.startswith(_APART):
        return "connect OctoPrint to its printer and start the print there"
    return f"its printer is {state!r}: check it in OctoPrint and start the print there"
