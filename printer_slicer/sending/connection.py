"""HTTP connection to a print server, and its errors. The only module that imports httpx."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import httpx

from printer_slicer.errors import PortError, UsageError

__all__ = ["Connection", "CountedFile", "Upload", "refused"]

_CHUNK: Final = 1 << 16
_SHOWN: Final = 200  # characters of a server's error message


@dataclass(frozen=True, slots=True)
class Upload:
    """A file to upload, and its destination.

    Attributes:
        path: path of the file.
        name: file name on the server.
        folder: folder on the server, "" for the default folder.
        start: whether to start the print.
        on_progress: called with the number of bytes sent and the size of the file.
    """

    path: Path
    name: str
    folder: str = ""
    start: bool = False
    on_progress: Callable[[int, int], None] = lambda _done, _all: None

    def __post_init__(self) -> None:
        if not self.name or "/" in self.name or "\\" in self.name or not self.name.isprintable():
            raise UsageError(
                f"{self.name!r} is not a valid file name",
                remedy="Use --name to choose another, such as part.gcode",
            )
        if ".." in Path(self.folder).parts or not self.folder.isprintable():
            raise UsageError(
                f"--folder {self.folder!r} is not a valid folder", remedy="Use a path such as parts/small"
            )

    @property
    def place(self) -> str:
        """Return folder and name, joined by a slash."""
        return "/".join(part for part in (self.folder.strip("/"), self.name) if part)

    def open(self) -> CountedFile:
        """Open the file; reading it reports progress.

        Raises:
            UsageError: the file cannot be read.
        """
        try:
            return CountedFile(self.path, self.on_progress)
        except OSError as error:
            raise UsageError(
                f"{self.path}: cannot be read: {error.strerror}", remedy="Check its name and permissions"
            ) from None


class CountedFile:
    """File that reports how much of it was read."""

    def __init__(self, path: Path, on_progress: Callable[[int, int], None]) -> None:
        self._file = path.open("rb")
        self.size = os.fstat(self._file.fileno()).st_size
        self._on_progress = on_progress

    def read(self, size: int = -1) -> bytes:
        """Read up to `size` bytes, and report the progress."""
        data = self._file.read(size)
        self._on_progress(self._file.tell(), self.size)
        return data

    def __iter__(self) -> Iterator[bytes]:
        while data := self.read(_CHUNK):
            yield data

    def fileno(self) -> int:
        """Return the descriptor of the file."""
        return self._file.fileno()

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move to a position."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the position."""
        return self._file.tell()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Connection:
    """Connection to one server; its errors name the server and a remedy.

    Args:
        url: address of its web page.
        kind: kind of server, for messages.
        key: API key or password.
        user: user of the password.
        timeout: time without an answer after which an error is raised, s.

    Raises:
        UsageError: the address or the key is invalid.
    """

    def __init__(self, url: str, kind: str, *, key: str = "", user: str = "", timeout: float = 30.0) -> None:
        whole = url if "://" in url else f"http://{url}"
        self.kind, self.url, self.key, self.user = kind, whole.rstrip("/"), key, user
        if odd := next((one for one in key if not (one.isascii() and one.isprintable())), ""):
            raise UsageError(
                f"the key contains {odd!r}, which is not allowed in a key",
                remedy="Check --key-file, --key or the variable PRINTER_SLICER_KEY",
            )
        try:
            parsed = httpx.URL(self.url)
        except (httpx.InvalidURL, ValueError, TypeError):
            parsed = httpx.URL("")
        if parsed.scheme not in {"http", "https"} or not parsed.host:
            raise UsageError(
                f"{url} is not the address of a server", remedy="Use an address such as http://octopi.local"
            )
        self._client = httpx.Client(base_url=self.url, timeout=timeout, follow_redirects=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()

    def digest(self) -> None:
        """Use digest authentication (RFC 7616) for all further requests."""
        self._client.auth = httpx.DigestAuth(self.user, self.key)

    def head(self, headers: Mapping[str, str]) -> None:
        """Send these headers with all further requests."""
        self._client.headers.update(headers)

    def ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        """Send a request; return the answer, whatever its status.

        Raises:
            PortError: there is no answer.
        """
        try:
            return self._client.request(method, path, **more)
        except httpx.ConnectError as error:
            raise PortError(
                f"{self.url}: cannot connect: {_reason(error)}",
                remedy="Check that the server is running, and check address and port, such as http://voron.local:7125",
            ) from None
        except httpx.TimeoutException:
            raise PortError(
                f"{self.url}: no answer in time", remedy="Check the network, or use --timeout 120"
            ) from None
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise PortError(
                f"{self.url}: the connection was lost: {_reason(error)}",
                remedy="Check on its web page whether its disk is full or it rejects the file, then try again",
            ) from None

    def upload(
        self,
        method: str,
        path: str,
        upload: Upload,
        *,
        headers: Mapping[str, str] | None = None,
        params: Mapping[str, str] | None = None,
    ) -> httpx.Response:
        """Send the file as the body of a request, in chunks; return the answer."""
        with upload.open() as file:
            all_headers = {**(headers or {}), "Content-Length": str(file.size)}
            return self.ask(method, path, content=iter(file), headers=all_headers, params=params)

    def form(self, path: str, upload: Upload, fields: Mapping[str, str]) -> httpx.Response:
        """Send the file and some fields as a form, in chunks; return the answer."""
        with upload.open() as file:
            files = {"file": (upload.name, file, "application/octet-stream")}
            return self.ask("POST", path, data=dict(fields), files=files)

    def said(self, answer: httpx.Response) -> dict[str, Any]:
        """Return the JSON object of an answer.

        Raises:
            PortError: the answer is not a JSON object, so the server is of another kind.
        """
        try:
            found = answer.json()
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise PortError(
                f"{self.url}: the server there is not {self.kind}",
                remedy="Check the address and the kind after --to",
            )
        return found


def refused(connection: Connection, answer: httpx.Response, what: str) -> PortError:
    """Return the error for an answer with an error status."""
    code = answer.status_code
    said = _error_text(answer)
    message = f"{connection.url}: {what}: {code} {answer.reason_phrase}" + (f": {said}" if said else "")
    if code in {401, 403}:
        message += "; the key was rejected" if connection.key else "; a key is required"
        remedy = (
            "Create a key on the web page of the server and pass it with --key-file or PRINTER_SLICER_KEY"
        )
    elif code in {301, 302, 307, 308}:
        remedy = f"Use the address to which it has moved: {answer.headers.get('location', 'not named')}"
    elif code == 404:
        remedy = f"Check that the server is {connection.kind} and that the address is that of its web page"
    elif code == 409:
        remedy = (
            "Wait until the printer is idle and the file of this name is not in use, or use another --name"
        )
    elif code in {413, 507}:
        remedy = "Delete files on the server, because it has no space for this one"
    elif code == 415:
        remedy = "Use --name with a name that ends in .gcode"
    else:
        remedy = "Read the log of the server"
    return PortError(message, remedy=remedy)


def _error_text(answer: httpx.Response) -> str:
    """Return the error message of a server in one line; empty for an HTML page."""
    if "html" in answer.headers.get("content-type", ""):
        return ""
    try:
        found = answer.json()
    except ValueError:
        found = answer.text
    for name in ("error", "message", "title"):
        found = found.get(name, found) if isinstance(found, dict) else found
    return " ".join(str(found).split())[:_SHOWN]


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
