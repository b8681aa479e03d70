"""G-code to other people's print servers: upload, and start if wanted.

Each kind of server is a row of `SERVERS`; what they have in common, the connection and its errors, is in `connection`.
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
    """Upload a file to a print server; where it is there.

    Args:
        upload: what.
        kind: of server, a key of `SERVERS`.
        url: of its page; without a scheme http is meant.
        key: API key, or password; empty: none.
        user: whose password it is.
        timeout: s that the server may be silent.

    Raises:
        UsageError: there is no such kind, or the file or its name cannot be sent.
        PortError: the server is not there, is another one, refuses the key or the file, or does not start it.
    """
    if kind not in SERVERS:
        raise UsageError(f"--to {kind}: no such kind of server", remedy=f"kinds are {', '.join(SERVERS)}")
    upload.open().close()  # before anybody is asked for a session
    with Connection(url, kind, key=key, user=user, timeout=timeout) as connection:
        return SERVERS[kind](connection, upload)
