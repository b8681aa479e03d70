"""Local socket by which other processes of the same user control a running print.

Each connection carries one request: a line for `commands.parse_command`, answered with one line of JSON. On systems
with Unix sockets only the owner can open the socket. Elsewhere it is a TCP port on the loopback interface, and each
request starts with a secret token from a file that only the owner can read.

The request `watch` is answered with the status again and again, see `status_feed`; `watch N` asks for the console lines
after number N.
"""

from __future__ import annotations

import hmac
import json
import os
import secrets
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from printer_slicer.errors import PortError, UsageError
from printer_slicer.printing.commands import PrintCommand, Status, parse_command

if TYPE_CHECKING:
    from printer_slicer.printing.controls import Controls
    from printer_slicer.printing.status_feed import StatusFeed

__all__ = ["connect_to_print", "raise_if_rejected", "send_control_command", "serve_control_socket"]

_ADDRESS_FILE = "control.json"
_MAX_CHUNK_BYTES = 4096
_TIMEOUT = 12.0
_MAX_PATH_BYTES = 100  # bytes; some systems limit socket paths to 104
_WATCH = "watch"
_HAS_UNIX = hasattr(socket, "AF_UNIX") and os.name == "posix"


@contextmanager
def serve_control_socket(
    folder: Path, controls: Controls, name: str, feed: StatusFeed | None = None
) -> Iterator[None]:
    """Answer control requests within a `with` block, or none if no socket can be opened.

    Args:
        folder: private folder of the print; it holds the address.
        controls: controls of the print.
        name: name of the job.
        feed: sends the status to watchers; None: requests to watch are rejected.
    """
    try:
        listener, address = _open_listener(folder)
        _write_private_file(folder / _ADDRESS_FILE, json.dumps(address))
    except OSError:
        yield
        return
    service = _ControlService(controls, name, address.get("token", ""), feed)
    thread = Thread(target=_accept_connections, args=(listener, service), name="control", daemon=True)
    thread.start()
    try:
        yield
    finally:
        # Closing does not wake `accept`; shutting down does, on every system that has Unix sockets.
        with suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(_TIMEOUT)
        with suppress(OSError):
            Path(address["path"]).unlink() if "path" in address else None
        with suppress(OSError):
            (folder / _ADDRESS_FILE).unlink()


def _open_listener(folder: Path) -> tuple[socket.socket, dict[str, Any]]:
    """Open a listening socket; return it with its address."""
    if not _HAS_UNIX:
        listener = socket.create_server(("127.0.0.1", 0))
        return listener, {"port": listener.getsockname()[1], "token": secrets.token_urlsafe(32)}
    path = folder / "control.sock"
    if len(os.fsencode(path)) > _MAX_PATH_BYTES:
        path = Path(tempfile.mkdtemp(prefix="printer-slicer-")) / "control.sock"
    with suppress(FileNotFoundError):
        path.unlink()  # left by a killed process: this process has locked the print, so no process listens there
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        before = os.umask(0o177)
        try:
            listener.bind(str(path))
        finally:
            os.umask(before)
        listener.listen(8)
    except OSError:
        listener.close()
        raise
    return listener, {"path": str(path)}


def _write_private_file(path: Path, text: str) -> None:
    """Write a file that only its owner can read."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)


class _ControlService:
    """What answers the requests: the controls, the name of the job, the secret token, and the feed for watchers."""

    def __init__(self, controls: Controls, name: str, token: str, feed: StatusFeed | None) -> None:
        self.controls, self.name, self.token, self.feed = controls, name, token, feed

    def answer(self, connection: socket.socket) -> None:
        """Read one request, execute its command, and send the answer."""
        watches = False
        try:
            with suppress(OSError, ValueError):
                connection.settimeout(_TIMEOUT)
                line = _read_line(connection)
                if self.token:
                    received_token, _, line = line.partition(" ")
                    if not hmac.compare_digest(received_token.encode(), self.token.encode()):
                        return
                word, _, last_line = line.partition(" ")
                if word == _WATCH and self.feed is not None:
                    number = int(last_line or 0)
                    watches = True
                    self.feed.add(connection, self.name, number)
                else:
                    connection.sendall(json.dumps(self._execute(line)).encode() + b"\n")
        finally:
            if not watches:
                connection.close()

    def _execute(self, line: str) -> dict[str, Any]:
        """Execute the command in a line, and return the answer."""
        try:
            answer = _execute_command(self.controls, parse_command(line))
        except UsageError as error:
            return {"ok": False, "job": self.name, "answer": str(error)}
        return {"ok": True, "job": self.name, "answer": answer}


def _accept_connections(listener: socket.socket, service: _ControlService) -> None:
    """Accept connections until the socket is closed."""
    while True:
        try:
            connection, _ = listener.accept()
        except OSError:
            return
        # One thread per connection, so that an idle connection does not delay an emergency stop.
        Thread(target=service.answer, args=(connection,), daemon=True).start()


def _execute_command(controls: Controls, command: PrintCommand) -> str:
    """Execute a command and return its result; a status request is answered soon, even by a busy print.

    Raises:
        UsageError: the command cannot be executed.
    """
    return json.dumps(controls.status_soon()) if isinstance(command, Status) else controls.ask(command)


def _read_line(connection: socket.socket) -> str:
    """Read one line from a connection, and return it without its line break.

    Raises:
        ValueError: the line is incomplete or too long.
    """
    data = b""
    while not data.endswith(b"\n"):
        part = connection.recv(_MAX_CHUNK_BYTES)
        if not part or len(data) > 1 << 20:
            raise ValueError("a line is incomplete or too long")
        data += part
    return data.decode("utf-8").rstrip("\n")


def send_control_command(folder: Path, line: str, timeout: float = _TIMEOUT) -> dict[str, Any]:
    """Send a command to a running print; return the JSON object that it answers: ok, job and answer.

    Args:
        folder: folder of the print.
        line: the command.
        timeout: timeout, s.

    Raises:
        PortError: the print process does not respond.
    """
    try:
        with connect_to_print(folder, line, timeout) as connection:
            return dict(json.loads(_read_line(connection)))
    except TimeoutError:
        raise _make_timeout_error(timeout) from None
    except (OSError, ValueError) as error:
        raise _make_connection_error(error) from None


def raise_if_rejected(answer: dict[str, Any]) -> None:
    """Raise the error that a print has answered, if it has not carried out the command.

    Raises:
        UsageError: the print has rejected the command.
    """
    if not answer["ok"]:
        message, _, remedy = str(answer["answer"]).partition("\n  ")
        raise UsageError(message, remedy=remedy)


def connect_to_print(folder: Path, line: str, timeout: float = _TIMEOUT) -> socket.socket:
    """Connect to a running print, and send a request; return the socket from which the answer can be read.

    Args:
        folder: folder of the print.
        line: the request: a command, or `watch`.
        timeout: timeout of the socket, s.

    Raises:
        PortError: the print process does not respond.
    """
    if not (folder / _ADDRESS_FILE).exists():
        raise PortError(
            "the print process does not respond yet: it is waiting for the serial port or the printer",
            remedy="Try again in a few seconds. If the print process has ended, run printer-slicer resume",
        )
    try:
        address = json.loads((folder / _ADDRESS_FILE).read_text(encoding="utf-8"))
        if "path" in address:
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            connection.settimeout(timeout)
            connection.connect(address["path"])
        else:
            connection = socket.create_connection(("127.0.0.1", address["port"]), timeout=timeout)
            line = f"{address['token']} {line}"
        connection.sendall(line.encode() + b"\n")
    except TimeoutError:
        raise _make_timeout_error(timeout) from None
    except (OSError, ValueError, KeyError) as error:
        raise _make_connection_error(error) from None
    return connection


def _make_timeout_error(timeout: float) -> PortError:
    """Return the error of a print process that does not answer in time."""
    return PortError(
        f"the print process does not respond in {timeout:g} s: it is stopped, or the computer is busy",
        remedy="Try again. If the print process has ended, run printer-slicer resume",
    )


def _make_connection_error(error: Exception) -> PortError:
    """Return the error of a print process that does not answer."""
    return PortError(
        f"the print process does not respond: {error}",
        remedy="If the print process has ended, run printer-slicer resume",
    )
