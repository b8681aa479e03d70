"""Upload G-code to print servers such as OctoPrint, start the print on request, read its status, and cancel it.

`SERVERS` holds one upload function for each kind of server. The module `connection` makes the HTTP requests.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from printer_slicer.errors import UsageError
from printer_slicer.sending.connection import Connection, Upload
from printer_slicer.sending.duet import cancel_on_duet, read_duet_status, send_to_duet
from printer_slicer.sending.moonraker import cancel_on_moonraker, read_moonraker_status, send_to_moonraker
from printer_slicer.sending.octoprint import cancel_on_octoprint, read_octoprint_status, send_to_octoprint
from printer_slicer.sending.prusalink import cancel_on_prusalink, read_prusalink_status, send_to_prusalink
from printer_slicer.sending.remote_status import RemoteStatus

__all__ = ["SERVERS", "RemoteStatus", "Upload", "cancel_remote_print", "read_remote_status", "send"]

SERVERS: Final[Mapping[str, Callable[[Connection, Upload], str]]] = {
    "octoprint": send_to_octoprint,
    "moonraker": send_to_moonraker,
    "prusalink": send_to_prusalink,
    "duet": send_to_duet,
}

_STATUS_READERS: Final[Mapping[str, Callable[[Connection], RemoteStatus]]] = {
    "octoprint": read_octoprint_status,
    "moonraker": read_moonraker_status,
    "prusalink": read_prusalink_status,
    "duet": read_duet_status,
}
_CANCELLERS: Final[Mapping[str, Callable[[Connection], None]]] = {
    "octoprint": cancel_on_octoprint,
    "moonraker": cancel_on_moonraker,
    "prusalink": cancel_on_prusalink,
    "duet": cancel_on_duet,
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
    _check_kind(kind)
    upload.open().close()  # fails before a session is opened if the file cannot be read
    with Connection(url, kind, key=key, user=user, timeout=timeout) as connection:
        return SERVERS[kind](connection, upload)


def read_remote_status(
    kind: str, url: str, *, key: str = "", user: str = "", timeout: float = 10.0
) -> RemoteStatus:
    """Read what the printer behind a print server does; arguments as for `send`.

    Raises:
        UsageError: the kind or the address is invalid.
        PortError: the server cannot be reached, is of another kind, or rejects the key.
    """
    _check_kind(kind)
    with Connection(url, kind, key=key, user=user, timeout=timeout) as connection:
        return _STATUS_READERS[kind](connection)


def cancel_remote_print(kind: str, url: str, *, key: str = "", user: str = "", timeout: float = 10.0) -> None:
    """Cancel the print that runs on a print server; arguments as for `send`.

    Raises:
        UsageError: the kind or the address is invalid.
        PortError: the server cannot be reached, rejects the key, or prints nothing.
    """
    _check_kind(kind)
    with Connection(url, kind, key=key, user=user, timeout=timeout) as connection:
        _CANCELLERS[kind](connection)


def _check_kind(kind: str) -> None:
    """Check a kind of server.

    Raises:
        UsageError: it is unknown.
    """
    if kind not in SERVERS:
        raise UsageError(
            f"--to {kind}: unknown kind of server", remedy=f"Choose one of: {', '.join(SERVERS)}"
        )
