"""Receive the bodies of requests: small ones whole, uploads in pieces while they arrive.

A thread reads the form of an upload while it arrives, so nothing is kept in memory. This and other slow work has
threads of its own, so that it never keeps other requests waiting.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from functools import partial
from typing import Final, ParamSpec, TypeVar

import anyio
import anyio.to_thread
from starlette.requests import Request

from printer_slicer.server.problems import ProblemError
from printer_slicer.server.uploads import FormReader

__all__ = ["MAX_SLOW_REQUESTS", "MAX_UPLOAD", "read_body", "receive_upload", "run_slow_work"]

MAX_UPLOAD: Final = 512 * 1024 * 1024
"""Largest upload, bytes."""

MAX_SLOW_REQUESTS: Final = 16
"""Uploads and other slow requests that are carried out at the same time; more wait."""

_MAX_BODY: Final = 64 * 1024  # bytes of a body that is no upload
_SILENCE: Final = 30.0  # s without a byte, after which a request is ended
_BODY_TIME: Final = 30.0  # s for a body that is no upload
_LENGTH_DIGITS: Final = 18

_Result = TypeVar("_Result")
_Arguments = ParamSpec("_Arguments")


async def run_slow_work(
    request: Request,
    work: Callable[_Arguments, _Result],
    *arguments: _Arguments.args,
    **keywords: _Arguments.kwargs,
) -> _Result:
    """Run a function that may take long in a thread, and return its result."""
    task = partial(work, *arguments, **keywords)
    return await anyio.to_thread.run_sync(task, limiter=request.app.state.slow_work)


async def read_body(request: Request) -> bytes:
    """Read a body that is small.

    Raises:
        ProblemError: it is too large, or does not arrive in time.
    """
    body = b""
    try:
        with anyio.fail_after(_BODY_TIME):
            async for chunk in request.stream():
                body += chunk
                if len(body) > _MAX_BODY:
                    raise ProblemError(413, f"the body is larger than {_MAX_BODY // 1024} kB", "Send less")
    except TimeoutError:
        raise ProblemError(408, f"the body did not arrive within {_BODY_TIME:g} s", "Send it again") from None
    return body


async def receive_upload(
    request: Request, store: Callable[[FormReader], _Result], *, most: int = MAX_UPLOAD
) -> _Result:
    """Run a function in a thread that reads a form while it arrives, and return its result.

    Raises:
        ProblemError: the upload is too large, is no form, or stops.
    """
    announced = request.headers.get("content-length", "0")
    if not announced.isdecimal() or len(announced) > _LENGTH_DIGITS or int(announced) > most:
        raise _too_large(most)
    pieces = _receive_pieces(request, most)

    async def receive() -> bytes:
        """Return the next piece of the body; empty at its end."""
        return await anext(pieces, b"")

    def work() -> _Result:
        """Read the form; runs in a thread."""
        form = FormReader(request.headers.get("content-type", ""), lambda: anyio.from_thread.run(receive))
        return store(form)

    return await run_slow_work(request, work)


async def _receive_pieces(request: Request, most: int) -> AsyncIterator[bytes]:
    """Yield the pieces of a body.

    Raises:
        ProblemError: the body is larger than `most` bytes, or stops.
    """
    chunks, received = request.stream().__aiter__(), 0
    while True:
        try:
            with anyio.fail_after(_SILENCE):
                chunk: bytes = await anext(chunks, b"")
        except TimeoutError:
            raise ProblemError(408, f"nothing arrived for {_SILENCE:g} s", "Send the file again") from None
        received += len(chunk)
        if received > most:
            raise _too_large(most)
        if not chunk:
            return
        yield chunk


def _too_large(most: int) -> ProblemError:
    """Return the error of an upload that is too large."""
    return ProblemError(
        413, f"the upload is larger than {most >> 20} MB", "Slice it with fewer details, or split it"
    )
