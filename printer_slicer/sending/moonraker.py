"""Moonraker. Source: its documentation, "External API: File management, Server administration, Authorization"."""

from __future__ import annotations

from hashlib import file_digest

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, refused

__all__ = ["send_to_moonraker"]


def send_to_moonraker(connection: Connection, upload: Upload) -> str:
    """Upload to the folder of G-codes, with a checksum; the path there.

    Raises:
        PortError: it cannot be done.
    """
    if connection.key:
        connection.head({"X-Api-Key": connection.key})
    info = connection.ask("GET", "/server/info")
    if info.status_code != 200:
        raise refused(connection, info, "asked who it is")
    state = connection.said(info).get("result")
    if not isinstance(state, dict) or "klippy_state" not in state:
        raise PortError(f"{connection.url}: what answers there is no Moonraker", remedy="check --to")
    if upload.start and state["klippy_state"] != "ready":
        raise PortError(
            f"{connection.url}: Klipper is not ready ({state['klippy_state']}), so nothing can be printed",
            remedy="look at its page; without --print the file is only uploaded",
        )
    with upload.path.open("rb") as file:
        checksum = file_digest(file, "sha256").hexdigest()
    fields = {
        "root": "gcodes",
        "path": upload.folder.strip("/"),
        "print": "true" if upload.start else "false",
        "checksum": checksum,
    }
    answer = connection.form(
        "/server/files/upload", upload, {key: value for key, value in fields.items() if value}
    )
    if answer.status_code not in {200, 201}:
        raise refused(connection, answer, f"{upload.name} was not taken")
    told = connection.said(answer)
    told = told.get("result", told)
    place = str(told.get("item", {}).get("path", upload.place))
    if upload.start and not told.get("print_started", False):
        raise PortError(
            f"{connection.url}: {place} is there, but is not printed", remedy="is another print running?"
        )
    return place
