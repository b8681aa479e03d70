"""Reject requests before any route sees them: unknown host, foreign origin, too many or too large headers.

A browser sends cookies with requests that other sites make it send. So a request with a cookie that changes something
must come from the page itself: its `Origin` or `Sec-Fetch-Site` says so, and it has the header that only scripts of the
page can add. The list of hosts stops other sites that let their own name point to this computer (DNS rebinding).
"""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from printer_slicer.server.problems import Problem, respond_with_problem
from printer_slicer.values import Struct

__all__ = ["PAGE_HEADER", "GuardSettings", "RequestGuard", "check_same_origin", "make_page_policy"]

PAGE_HEADER: Final = "x-printer-slicer"
"""Header of requests that scripts of the page send; other sites cannot add it."""

_MAX_HEADERS: Final = 100
_MAX_HEADER_BYTES: Final = 16 * 1024
_SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
_HEADERS: Final[dict[str, str]] = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "x-frame-options": "DENY",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
        "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "cache-control": "no-store",
}
_SHARING_HEADERS: Final[dict[str, str]] = {
    "access-control-allow-methods": "GET, POST, PUT, DELETE",
    "access-control-allow-headers": "authorization, content-type, idempotency-key, x-api-key",
    "access-control-max-age": "600",
    "vary": "origin",
}


def make_page_policy(pictures: Iterable[str]) -> str:
    """Return the content security policy of the page, which shows pictures from these addresses, too."""
    origins = sorted({"{0.scheme}://{0.netloc}".format(urlsplit(one)) for one in pictures})
    return _HEADERS["content-security-policy"].replace(
        " blob:;", f"{''.join(f' {one}' for one in ['blob:', *origins])};"
    )


class GuardSettings(Struct, frozen=True):
    """Which hosts and other origins are accepted.

    Attributes:
        hosts: names and addresses under which browsers may call the server, lower case, without port.
        origins: other origins whose pages may use the interface with a key, such as `https://farm.example`.
        proxy: address of the reverse proxy whose forwarded headers count; empty: none.
    """

    hosts: frozenset[str]
    origins: frozenset[str] = frozenset()
    proxy: str = ""


class RequestGuard:
    """ASGI middleware that rejects requests by their head, and adds the security headers to all responses."""

    def __init__(self, app: ASGIApp, settings: GuardSettings) -> None:
        self._app, self._settings = app, settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        problem = _check_head(scope, self._settings)
        shared = _list_sharing_headers(scope, self._settings)
        if problem is None and shared and scope["method"] == "OPTIONS":
            await Response(status_code=204)(scope, receive, _add_headers(send, shared))
        elif problem is None:
            await self._app(scope, receive, _add_headers(send, shared))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": problem.detail})
        else:
            await respond_with_problem(problem, scope["path"])(scope, receive, _add_headers(send, {}))


def _check_head(scope: Scope, settings: GuardSettings) -> Problem | None:
    """Return why the head of a request is not accepted; None if it is."""
    raw = scope["headers"]
    if len(raw) > _MAX_HEADERS or sum(len(name) + len(value) for name, value in raw) > _MAX_HEADER_BYTES:
        return Problem(431, "the headers of the request are too large", "Send fewer headers")
    headers = Headers(raw=raw)
    hosts = headers.getlist("host")
    if len(hosts) != 1 or _get_host_name(hosts[0]) not in settings.hosts:
        name = _get_host_name(hosts[0]) if len(hosts) == 1 else ""
        remedy = f"Restart the server with --host {name}" if name else "Send one Host header"
        return Problem(421, "the server is not known by this host name", remedy)
    origin = headers.get("origin")
    if scope["type"] == "websocket" and origin and not _is_own_origin(origin, hosts[0]):
        return Problem(403, "the request comes from the page of another site", "Open the page of this server")
    return None


def _list_sharing_headers(scope: Scope, settings: GuardSettings) -> dict[str, str]:
    """Return the headers with which a page of another accepted origin may read the response; empty for all others.

    Such a page sends a key. It never gets the cookie of a session.
    """
    origin = Headers(raw=scope["headers"]).get("origin", "").lower()
    if scope["type"] != "http" or origin not in settings.origins:
        return {}
    return _SHARING_HEADERS | {"access-control-allow-origin": origin}


def check_same_origin(method: str, headers: Headers) -> Problem | None:
    """Return why a request with a cookie is not accepted, because another site may have sent it; None if it is."""
    if method in _SAFE_METHODS:
        return None
    origin, site = headers.get("origin"), headers.get("sec-fetch-site")
    is_own = _is_own_origin(origin, headers.get("host", "")) if origin else site == "same-origin"
    if is_own and PAGE_HEADER in headers:
        return None
    return Problem(
        403, "the request does not come from the page of this server", "Open the page, or use a key"
    )


def _is_own_origin(origin: str, host: str) -> bool:
    """Return whether an origin is that of the page."""
    return urlsplit(origin).netloc.lower() == host.lower()


def _get_host_name(host: str) -> str:
    """Return the name in a Host header: lower case, without port; empty if it is invalid."""
    try:
        name = (urlsplit(f"//{host}").hostname or "").rstrip(".")
        urlsplit(f"//{host}").port  # noqa: B018 - raises if the port is invalid
    except ValueError:
        return ""
    if "@" in host or "/" in host:
        return ""
    try:
        return str(ip_address(name))
    except ValueError:
        return name


def _add_headers(send: Send, more: dict[str, str]) -> Send:
    """Return a function that sends messages, with the security and other headers in the first one of a response."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in (_HEADERS | more).items():
                headers.setdefault(name, value)
        await send(message)

    return send_with_headers
