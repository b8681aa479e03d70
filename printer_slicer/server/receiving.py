"""Receive uploads: a thread reads the form while it arrives, so nothing is kept in memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

import anyio
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from printer_slicer.server.problems import ProblemError
from printer_slicer.server.uploads import FormReader

__all__ = ["MAX_UPLOAD", "receive_upload"]

MAX_UPLOAD: Final = 512 * 1024 * 1024
"""Largest upload, bytes."""

_SILENCE: Final = 30.0  # s without a byte, after which an upload is ended
_Result = TypeVar("_Result")


async def receive_upload(
    request: Request, store: Callable[[FormReader], _Result], *, most: int = MAX_UPLOAD
) -> _Result:
    """Run a function in a thread that reads a form while it arrives, and return its result.

    Raises:
        ProblemError: the upload is too large, is no form, or stops.
    """
    announced = request.headers.get("content-length", "0")
    too_large = ProblemError(
        413, f"the upload is larger than {most >> 20} MB", "Slice it with fewer details, or split it"
    )
    if not announced.isdecimal() or int(announced) > most:
        raise too_large
    chunks, received = request.stream().__aiter__(), 0

    async def receive() -> bytes:
        """Return the next piece of the body."""
        nonlocal received
        try:
            with anyio.fail_after(_SILENCE):
                chunk: bytes = await anext(chunks, b"")
        except TimeoutError:
            raise ProblemError(408, f"nothing arrived for {_SILENCE:g} s", "Send the file again") from None
        received += len(chunk)
        if received > most:
            raise too_large
        return chunk

    def work() -> _Result:
        """Read the form; runs in a thread."""
        form = FormReader(request.headers.get("content-type", ""), lambda: anyio.from_thread.run(receive))
        return store(form)

    return await run_in_threadpool(work)
