"""A connection to a print server, and what can go wrong with it. The only file that knows httpx."""

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
_SHOWN: Final = 200  # characters of what a server says


@dataclass(frozen=True, slots=True)
class Upload:
    """What to send.

    Attributes:
        path: of the file.
        name: what it is called there.
        folder: where, "" for the usual place.
        start: whether it shall be printed.
        on_progress: is told how many bytes are on their way, of how many.
    """

    path: Path
    name: str
    folder: str = ""
    start: bool = False
    on_progress: Callable[[int, int], None] = lambda _done, _all: None

    def __post_init__(self) -> None:
        if not self.name or "/" in self.name or "\\" in self.name or not self.name.isprintable():
            raise UsageError(f"{self.name!r}: no name for a file", remedy="name it with --name part.gcode")
        if ".." in Path(self.folder).parts or not self.folder.isprintable():
            raise UsageError(
                f"--folder {self.folder!r}: no folder", remedy="for example --folder parts/small"
            )

    @property
    def place(self) -> str:
        """Folder and name."""
        return "/".join(part for part in (self.folder.strip("/"), self.name) if part)

    def open(self) -> CountedFile:
        """The file, whose reading is told.

        Raises:
            UsageError: it cannot be read.
        """
        try:
            return CountedFile(self.path, self.on_progress)
        except OSError as error:
            raise UsageError(
                f"{self.path}: cannot be read: {error.strerror}", remedy="check name and permissions"
            ) from None


class CountedFile:
    """A file that tells how much of it was read."""

    def __init__(self, path: Path, on_progress: Callable[[int, int], None]) -> None:
        self._file = path.open("rb")
        self.size = os.fstat(self._file.fileno()).st_size
        self._tell = on_progress

    def read(self, size: int = -1) -> bytes:
        """Some of it."""
        data = self._file.read(size)
        self._tell(self._file.tell(), self.size)
        return data

    def __iter__(self) -> Iterator[bytes]:
        while data := self.read(_CHUNK):
            yield data

    def fileno(self) -> int:
        """Of the file."""
        return self._file.fileno()

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """The place."""
        return self._file.tell()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Connection:
    """Requests to one server, whose errors name it and say what to do.

    Args:
        url: of its page.
        kind: of server, for messages.
        key: API key, or password.
        user: whose.
        timeout: s that it may be silent.

    Raises:
        UsageError: the address is none.
    """

    def __init__(self, url: str, kind: str, *, key: str = "", user: str = "", timeout: float = 30.0) -> None:
        whole = url if "://" in url else f"http://{url}"
        self.kind, self.url, self.key, self.user = kind, whole.rstrip("/"), key, user
        if odd := next((one for one in key if not (one.isascii() and one.isprintable())), ""):
            raise UsageError(
                f"the key holds {odd!r}, which no key does",
                remedy="look at the file, the flag or the variable PRINTER_SLICER_KEY that it is from",
            )
        try:
            parsed = httpx.URL(self.url)
        except (httpx.InvalidURL, ValueError, TypeError):
            parsed = httpx.URL("")
        if parsed.scheme not in {"http", "https"} or not parsed.host:
            raise UsageError(f"{url}: no address of a server", remedy="for example http://octopi.local")
        self._client = httpx.Client(base_url=self.url, timeout=timeout, follow_redirects=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()

    def digest(self) -> None:
        """Show name and password as RFC 7616 wants it, from now on."""
        self._client.auth = httpx.DigestAuth(self.user, self.key)

    def head(self, headers: Mapping[str, str]) -> None:
        """Send these headers with every request from now on."""
        self._client.headers.update(headers)

    def ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        """One request; its answer, whatever it is.

        Raises:
            PortError: there is none.
        """
        try:
            return self._client.request(method, path, **more)
        except httpx.ConnectError as error:
            raise PortError(
                f"{self.url}: nobody answers there: {_reason(error)}",
                remedy="is the server on, the address right, and the port, such as http://voron.local:7125?",
            ) from None
        except httpx.TimeoutException:
            raise PortError(
                f"{self.url}: no answer in time", remedy="look at the network, or give it --timeout 120"
            ) from None
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise PortError(
                f"{self.url}: the connection broke: {_reason(error)}",
                remedy="a server that has no room, or refuses the file, may cut it: look at its page, try again",
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
        """The file as the body of a request, streamed."""
        with upload.open() as file:
            all_headers = {**(headers or {}), "Content-Length": str(file.size)}
            return self.ask(method, path, content=iter(file), headers=all_headers, params=params)

    def form(self, path: str, upload: Upload, fields: Mapping[str, str]) -> httpx.Response:
        """The file and some fields as a form, streamed."""
        with upload.open() as file:
            files = {"file": (upload.name, file, "application/octet-stream")}
            return self.ask("POST", path, data=dict(fields), files=files)

    def said(self, answer: httpx.Response) -> dict[str, Any]:
        """The object that an answer holds.

        Raises:
            PortError: it is none of this kind of server.
        """
        try:
            found = answer.json()
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise PortError(
                f"{self.url}: what answers there is no {self.kind}",
                remedy="check the address, or what --to says",
            )
        return found


def refused(connection: Connection, answer: httpx.Response, what: str) -> PortError:
    """The error for an answer that is no success."""
    code = answer.status_code
    said = _words(answer)
    message = f"{connection.url}: {what}: {code} {answer.reason_phrase}" + (f": {said}" if said else "")
    if code in {401, 403}:
        with_one = "this key is not taken" if connection.key else "a key is wanted"
        remedy = (
            f"{with_one}: make one on the server's page, and give it with --key-file or PRINTER_SLICER_KEY"
        )
    elif code in {301, 302, 307, 308}:
        remedy = f"it has moved to {answer.headers.get('location', 'another address')}: use that one"
    elif code == 404:
        remedy = f"is it {connection.kind}, and is the address that of its page?"
    elif code == 409:
        remedy = "the printer is busy, or a file of that name is in use: wait, or take another --name"
    elif code in {413, 507}:
        remedy = "there is no room for the file: delete some there"
    elif code == 415:
        remedy = "the server takes no such file: does the name end in .gcode?"
    else:
        remedy = "look at the server's own log"
    return PortError(message, remedy=remedy)


def _words(answer: httpx.Response) -> str:
    """What a server says of an error, in one line: never its whole page."""
    if "html" in answer.headers.get("content-type", ""):
        return ""
    try:
        told = answer.json()
    except ValueError:
        told = answer.text
    for name in ("error", "message", "title"):
        told = told.get(name, told) if isinstance(told, dict) else told
    return " ".join(str(told).split())[:_SHOWN]


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
