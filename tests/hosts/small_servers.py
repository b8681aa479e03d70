"""Small servers that follow the documentation of PrusaLink and Duet boards, whose real software needs hardware.

Made from the published descriptions alone: PrusaLink's OpenAPI file, the RepRapFirmware wiki's "HTTP requests", the
REST API of the Duet Software Framework, and RFC 7616 for digest authentication.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import md5
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit
from zlib import crc32

__all__ = ["Seen", "duet", "fixed", "prusalink"]

_REALM, _NONCE = "Administrator", "d4c6a9"


@dataclass
class Seen:
    """What a server got, and how it behaves.

    Attributes:
        files: place -> content.
        started: places.
        key: that it wants.
        user: whose password the key is, for digest; "" for an API key.
        full: it has no room.
        by_computer: a Duet with a single-board computer.
        no_session: why a Duet gives no session, as it numbers its reasons.
        says: path -> status and object, for a server that always says the same.
    """

    url: str = ""
    key: str = "secret"
    user: str = ""
    full: bool = False
    by_computer: bool = False
    no_session: int = 0
    says: dict[str, tuple[int, Any]] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    started: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


class Handler(BaseHTTPRequestHandler):
    """What both have in common."""

    protocol_version = "HTTP/1.1"
    seen: Seen

    def log_message(self, *_: Any) -> None:
        """Nothing."""

    def body(self) -> bytes:
        return self.rfile.read(int(self.headers.get("Content-Length", 0)))

    def say(self, code: int, told: Any = None, **headers: str) -> None:
        data = b"" if told is None else json.dumps(told).encode()
        self.send_response(code)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def do_GET(self) -> None:
        self.handle_all()

    do_POST = do_PUT = do_DELETE = do_GET  # noqa: N815 - the names that http.server calls

    def handle_all(self) -> None:
        raise NotImplementedError


class PrusaLink(Handler):
    """Storage and upload."""

    def handle_all(self) -> None:
        """One request."""
        data = self.body()
        self.seen.requests.append(f"{self.command} {self.path}")
        if not self.allowed():
            digest = f'Digest realm="{_REALM}", nonce="{_NONCE}", algorithm=MD5, qop="auth"'
            self.say(401, {"title": "Unauthorized"}, WWW_Authenticate=digest)
        elif (self.command, self.path) == ("GET", "/api/v1/storage"):
            stores = [
                {
                    "path": "/local",
                    "name": "PrusaLink gcodes",
                    "type": "LOCAL",
                    "read_only": True,
                    "available": True,
                },
                {
                    "path": "/usb",
                    "name": "usb",
                    "type": "USB",
                    "read_only": False,
                    "available": not self.seen.full,
                },
            ]
            self.say(200, {"storage_list": stores})
        elif self.command == "PUT" and self.path.startswith("/api/v1/files/usb/"):
            self.put(unquote(self.path.removeprefix("/api/v1/files")), data)
        else:
            self.say(404, {"title": "Not Found"})

    def put(self, place: str, data: bytes) -> None:
        if not place.endswith(".gcode"):
            self.say(415, {"title": "Unsupported Media Type"})
        elif place in self.seen.files and self.headers["Overwrite"] != "?1":
            self.say(409, {"title": "Conflict"})
        else:
            self.seen.files[place] = data
            if self.headers["Print-After-Upload"] == "?1":
                self.seen.started.append(place)
            self.say(201)

    def allowed(self) -> bool:
        if not self.seen.user:
            return self.headers.get("X-Api-Key") == self.seen.key
        told = dict(re.findall(r'(\w+)="?([^",]+)"?', self.headers.get("Authorization", "")))
        if told.get("username") != self.seen.user or told.get("uri") != self.path:
            return False

        def hashed(*parts: str) -> str:
            return md5(":".join(parts).encode()).hexdigest()

        own = hashed(self.seen.user, _REALM, self.seen.key)
        request = hashed(self.command, self.path)
        wanted = hashed(own, _NONCE, told["nc"], told["cnonce"], told["qop"], request)
        return told.get("response") == wanted


class Duet(Handler):
    """`rr_` requests, or those of the software framework."""

    def handle_all(self) -> None:
        """One request."""
        data, parts = self.body(), urlsplit(self.path)
        query = {name: values[0] for name, values in parse_qs(parts.query).items()}
        self.seen.requests.append(f"{self.command} {parts.path}")
        if self.seen.by_computer:
            self.machine(unquote(parts.path), query, data)
        elif parts.path == "/rr_connect":
            wrong = self.seen.no_session or int(query.get("password") != self.seen.key)
            self.say(200, {"err": wrong, "sessionTimeout": 8000})
        elif parts.path == "/rr_upload" and self.command == "POST":
            good = not self.seen.full and int(query["crc32"], 16) == crc32(data)
            if good:
                self.seen.files[query["name"]] = data
            self.say(200, {"err": 0 if good else 1})
        elif parts.path == "/rr_gcode":
            self.seen.started.append(query["gcode"].removeprefix("M32 ").strip('"'))
            self.say(200, {"buff": 240})
        else:
            self.say(200, {"err": 0}) if parts.path == "/rr_disconnect" else self.say(404)

    def machine(self, path: str, query: dict[str, str], data: bytes) -> None:
        if path == "/machine/connect":
            good = query.get("password") == self.seen.key
            self.say(200, {"sessionKey": "42"}) if good else self.say(403)
        elif self.headers.get("X-Session-Key") != "42":
            self.say(404 if path.startswith("/rr_") else 403)
        elif path.startswith("/machine/file/") and self.command == "PUT":
            self.seen.files[path.removeprefix("/machine/file/")] = data
            self.say(201)
        elif path == "/machine/code":
            self.seen.started.append(data.decode().removeprefix("M32 ").strip('"'))
            self.say(200)
        else:
            self.say(404)


class Fixed(Handler):
    """The same answers, whatever is asked."""

    def handle_all(self) -> None:
        """One request."""
        self.body()
        self.seen.requests.append(f"{self.command} {self.path}")
        self.say(*self.seen.says.get(self.path, (404, None)))


@contextmanager
def _served(kind: type[Handler], seen: Seen) -> Iterator[Seen]:
    handler = type("Own", (kind,), {"seen": seen})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    seen.url = f"http://127.0.0.1:{server.server_address[1]}"
    try:
        yield seen
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def prusalink(**how: Any) -> Any:
    """A PrusaLink."""
    return _served(PrusaLink, Seen(**how))


def duet(**how: Any) -> Any:
    """A Duet board."""
    return _served(Duet, Seen(**how))


def fixed(says: dict[str, tuple[int, Any]]) -> Any:
    """A server with a fixed answer to each path."""
    return _served(Fixed, Seen(says=says))
