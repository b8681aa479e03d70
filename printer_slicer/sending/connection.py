"""Connect to a print server by HTTP, and report errors; no other module imports httpx."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import httpx

from printer_slicer.errors import PortError, UsageError
from printer_slicer.values import Struct

__all__ = ["Connection", "CountedFile", "Upload", "make_rejection_error", "read_status_json"]

_CHUNK: Final = 1 << 16
_MAX_ERROR_LENGTH: Final = 200  # maximum length of a server's error message, characters


class Upload(Struct, frozen=True):
    """A file to upload, with its destination on the server.

    Attributes:
        path: local path of the file.
        name: file name on the server.
        folder: folder on the server; empty: the default folder.
        start: whether to start the print after the upload.
        on_progress: function that is called with the number of bytes sent and the size of the file.
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
                remedy="Use --name to choose another name, such as part.gcode",
            )
        if ".." in Path(self.folder).parts or not self.folder.isprintable():
            raise UsageError(
                f"--folder {self.folder!r} is not a valid folder", remedy="Use a path such as parts/small"
            )

    @property
    def server_path(self) -> str:
        """Return the path of the file on the server: folder and name, joined by a slash."""
        return "/".join(part for part in (self.folder.strip("/"), self.name) if part)

    def open(self) -> CountedFile:
        """Open the file so that reading it reports the progress.

        Raises:
            UsageError: the file cannot be read.
        """
        try:
            return CountedFile(self.path, self.on_progress)
        except OSError as error:
            raise UsageError(
                f"{self.path}: cannot be read: {error.strerror}",
                remedy="Check the name and permissions of the file",
            ) from None


class CountedFile:
    """A binary file that reports how many of its bytes were read."""

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
        """Return the file descriptor."""
        return self._file.fileno()

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move the read position of the file; return the new position."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the read position in the file."""
        return self._file.tell()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Connection:
    """HTTP connection to one print server, whose error messages contain the server and a remedy.

    Args:
        url: address of the web page of the server.
        kind: kind of server, for messages.
        key: API key or password; empty: none.
        user: user name that belongs to the password; empty: none.
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

    def use_digest_authentication(self) -> None:
        """Use digest authentication (RFC 7616) for all further requests."""
        self._client.auth = httpx.DigestAuth(self.user, self.key)

    def set_headers(self, headers: Mapping[str, str]) -> None:
        """Send the given headers with all further requests."""
        self._client.headers.update(headers)

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        """Send a request; return the answer, even if the answer has an error status.

        Raises:
            PortError: the server does not answer.
        """
        try:
            return self._client.request(method, path, **options)
        except httpx.ConnectError as error:
            raise PortError(
                f"{self.url}: cannot connect to the server: {_describe_error(error)}",
                remedy="Check that the server is running, and check address and port, such as http://voron.local:7125",
            ) from None
        except httpx.TimeoutException:
            raise PortError(
                f"{self.url}: no answer in time",
                remedy="Check the network, or allow more time with --timeout 120",
            ) from None
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise PortError(
                f"{self.url}: the connection was lost: {_describe_error(error)}",
                remedy="Check on the web page of the server whether its disk is full, then try again",
            ) from None

    def upload_file(
        self,
        method: str,
        path: str,
        upload: Upload,
        *,
        headers: Mapping[str, str] | None = None,
        params: Mapping[str, str] | None = None,
    ) -> httpx.Response:
        """Send a file as the body of a request, in chunks; return the answer."""
        with upload.open() as file:
            all_headers = {**(headers or {}), "Content-Length": str(file.size)}
            return self.request(method, path, content=iter(file), headers=all_headers, params=params)

    def upload_form(self, path: str, upload: Upload, fields: Mapping[str, str]) -> httpx.Response:
        """Send a form with a file and the given fields, in chunks; return the answer."""
        with upload.open() as file:
            files = {"file": (upload.name, file, "application/octet-stream")}
            return self.request("POST", path, data=dict(fields), files=files)

    def parse_json(self, answer: httpx.Response) -> dict[str, Any]:
        """Return the JSON object in the body of an answer.

        Raises:
            PortError: the answer is not a JSON object, so the server is of another kind.
        """
        try:
            found = answer.json()
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise PortError(
                f"{self.url}: the server at this address is not {self.kind}",
                remedy="Check the address and the kind of server after --to",
            )
        return found


def read_status_json(connection: Connection, answer: httpx.Response) -> dict[str, Any]:
    """Return the JSON object of an answer to a request for the status.

    Raises:
        PortError: the server rejected the request, or the answer is no JSON object.
    """
    if answer.status_code != 200:
        raise make_rejection_error(connection, answer, "the status could not be read")
    return connection.parse_json(answer)


def make_rejection_error(connection: Connection, answer: httpx.Response, problem: str) -> PortError:
    """Return the exception for an answer with an error status; `problem` says what failed."""
    code = answer.status_code
    detail = _read_error_message(answer)
    message = f"{connection.url}: {problem}: {code} {answer.reason_phrase}" + (
        f": {detail}" if detail else ""
    )
    if code in {401, 403}:
        message += "; the key was rejected" if connection.key else "; a key is required"
        remedy = (
            "Create a key on the web page of the server and pass it with --key-file or PRINTER_SLICER_KEY"
        )
    elif code in {301, 302, 307, 308}:
        remedy = (
            f"Use the address to which the server has moved: {answer.headers.get('location', 'not named')}"
        )
    elif code == 404:
        remedy = f"Check that the server is {connection.kind} and that the address is that of its web page"
    elif code == 409:
        remedy = "Wait until the printer is idle and no file with this name is in use, or use another --name"
    elif code in {413, 507}:
        remedy = "Delete other files on the server, which has no space for this file"
    elif code == 415:
        remedy = "Use --name to give the file a name that ends in .gcode"
    else:
        remedy = "Read the log of the server"
    return PortError(message, remedy=remedy)


def _read_error_message(answer: httpx.Response) -> str:
    """Return the error message in an answer as one line; empty for an HTML page."""
    if "html" in answer.headers.get("content-type", ""):
        return ""
    try:
        found = answer.json()
    except ValueError:
        found = answer.text
    for name in ("error", "message", "title"):
        found = found.get(name, found) if isinstance(found, dict) else found
    return " ".join(str(found).split())[:_MAX_ERROR_LENGTH]


def _describe_error(error: Exception) -> str:
    """Return the message of an error, or its type if it has no message."""
    return str(error) or type(error).__name__
