"""HTTP connections with limits, so that clients that send slowly or without an end cannot use up the server.

uvicorn waits for the head of a request without a time limit, and its parser keeps a head of any length in memory.
"""

from __future__ import annotations

import asyncio
from typing import Final

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

__all__ = ["MAX_CONNECTIONS", "LimitedConnection"]

MAX_CONNECTIONS: Final = 200
"""Connections and requests at the same time; more get status 503."""

_MAX_PER_ADDRESS: Final = 100  # connections, so that one computer leaves some for others
_HEAD_TIMEOUT: Final = 15.0  # s for the head of a request
_WRITE_TIMEOUT: Final = 60.0  # s in which a client reads nothing of a response
_MAX_UNWANTED: Final = 16 * 1024 * 1024  # bytes that a client may still send after the response
_MAX_UNPARSED: Final = 64 * 1024  # bytes in a row that complete no head and are no content


class LimitedConnection(HttpToolsProtocol):
    """A connection that is closed if a head is too slow or too long, or if the client stops reading a response."""

    _head_timer: asyncio.TimerHandle | None = None
    _write_timer: asyncio.TimerHandle | None = None
    _unparsed = _unwanted = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin a connection; one too many of an address is closed at once."""
        super().connection_made(transport)
        if self._is_one_too_many():
            transport.abort()
        else:
            self._wait_for_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """End a connection."""
        _cancel(self._head_timer)
        _cancel(self._write_timer)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse what has arrived; close the connection if a head or trailer has no end."""
        self._unparsed += len(data)
        super().data_received(data)
        if self._unparsed > _MAX_UNPARSED and not self.transport.is_closing():
            self.transport.abort()

    def on_headers_complete(self) -> None:
        """Begin to answer a request."""
        _cancel(self._head_timer)
        self._unparsed = 0
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Add a piece of the content of a request."""
        self._unparsed = 0
        if self.cycle.response_complete:
            self._unwanted += len(body)
            if self._unwanted > _MAX_UNWANTED:
                self.transport.abort()
        super().on_body(body)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._wait_for_head()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Wait until the client reads."""
        _cancel(self._write_timer)
        self._write_timer = self.loop.call_later(_WRITE_TIMEOUT, self.transport.abort)
        super().pause_writing()

    def resume_writing(self) -> None:
        """Go on, because the client has read."""
        _cancel(self._write_timer)
        super().resume_writing()

    def _wait_for_head(self) -> None:
        """Close the connection if no head arrives in time."""
        _cancel(self._head_timer)
        self._head_timer = self.loop.call_later(_HEAD_TIMEOUT, self.transport.abort)

    def _is_one_too_many(self) -> bool:
        """Return whether its address has too many connections; that of the reverse proxy may have any number."""
        address = self.client[0] if self.client else ""
        if self.config.proxy_headers and address == self.config.forwarded_allow_ips:
            return False
        clients = [getattr(one, "client", None) for one in self.connections]
        return [client[0] for client in clients if client].count(address) > _MAX_PER_ADDRESS


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    """Cancel a timer, if there is one."""
    if timer is not None:
        timer.cancel()
