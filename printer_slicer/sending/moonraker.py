"""Upload a file to Moonraker.

Source: documentation of Moonraker, "External API: File management, Server administration, Authorization".
"""

from __future__ import annotations

from hashlib import file_digest

from printer_slicer.errors import PortError
from printer_slicer.sending.connection import Connection, Upload, make_rejection_error

__all__ = ["send_to_moonraker"]


def send_to_moonraker(connection: Connection, upload: Upload) -> str:
    """Upload a file, with its checksum, to the folder `gcodes` of Moonraker; return its path there.

    Raises:
        PortError: the upload or the start of the print failed.
    """
    if connection.key:
        connection.set_headers({"X-Api-Key": connection.key})
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
