"""Upload G-code to print servers such as OctoPrint, and start the print on request.

`SERVERS` holds one upload function for each kind of server. The module `connection` makes the HTTP requests.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from printer_slicer.errors import UsageError
from printer_slicer.sending.connection import Connection, Upload
from printer_slicer.sending.duet import send_to_duet
from printer_slicer.sending.moonraker import send_to_moonraker
from printer_slicer.sending.octoprint import send_to_octoprint
from printer_slicer.sending.prusalink import send_to_prusalink

__all__ = ["SERVERS", "Upload", "send"]

SERVERS: Final[Mapping[str, Callable[[Connection, Upload], str]]] = {
    "octoprint": send_to_octoprint,
    "moonraker": send_to_moonraker,
    "prusalink": send_to_prusalink,
    "duet": send_to_duet,
}


def send(
    upload: Upload,
    kind: str,
    url: str,
    *,
    key: str = "",
    user: str = "",
    timeout: float = 30.0,
) -> str:
    """Upload a file to a print server; return the path of the file on the server.

    Args:
        upload: the file and its destination.
        kind: kind of server, a key of `SERVERS`.
        url: address of the web page of the server; the default scheme is http.
        key: API key or password; empty: none.
        user: user name that belongs to the password; empty: none.
        timeout: time without an answer after which an error is raised, s.

    Raises:
        UsageError: the kind is unknown, or the file or its name cannot be sent.
        PortError: the server cannot be reached, is of another kind, rejects the key or the file, or does not start the
            print.
    """
    if kind not in SERVERS:
        raise UsageError(
            f"--to {kind}: unknown kind of server", remedy=f"Choose one of: {', '.join(SERVERS)}"
        )
    upload.open().close()  # fails before a session is opened if the file cannot be read
    with Connection(url, kind, key=key, user=user, timeout=timeout) as connection:
        return SERVERS[kind](connection, upload)
