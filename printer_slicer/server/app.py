"""The web application: routes of the interface, uploads, the feed, sign-in and the page."""

from __future__ import annotations

import asyncio
import re
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from secrets import token_hex
from shutil import rmtree
from typing import Final

from anyio import CapacityLimiter
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from printer_slicer.errors import PrinterSlicerError
from printer_slicer.input_files import MODEL_SUFFIXES
from printer_slicer.preview.viewer_files import make_view_policy
from printer_slicer.print_queue import QueuedFile
from printer_slicer.print_queue.file_store import check_free_space
from printer_slicer.server.access import Access
from printer_slicer.server.api import OPERATIONS
from printer_slicer.server.assets import ASSET_ROUTES
from printer_slicer.server.feed import Feed, FeedPosition
from printer_slicer.server.guard import RequestGuard
from printer_slicer.server.json_values import decode_json, encode_json
from printer_slicer.server.moonraker import MOONRAKER_ROUTES
from printer_slicer.server.octoprint import OCTOPRINT_ROUTES
from printer_slicer.server.openapi import describe_interface
from printer_slicer.server.operations import (
    SESSION_COOKIE,
    Operation,
    read_key,
    require_access,
    run_operation,
)
from printer_slicer.server.problems import Problem, ProblemError, make_problem_error, respond_with_problem
from printer_slicer.server.receiving import MAX_SLOW_REQUESTS, read_body, receive_upload, run_slow_work
from printer_slicer.server.services import Services
from printer_slicer.server.slicing import SliceCommand, SliceRequest, SliceTask
from printer_slicer.server.uploads import FormReader, check_gcode_name

__all__ = ["make_app"]

_MAX_SOCKETS: Final = 50
_MAX_SOCKETS_PER_ADDRESS: Final = 20
_ONE_RANGE: Final = re.compile(r"bytes=(\d{1,18}-\d{0,18}|-\d{1,18})")
_TICK: Final = 0.2  # s between messages to one browser
_PING: Final = 5.0  # s between looks whether the key or session still exists


def make_app(services: Services) -> Starlette:
    """Return the application; it closes the services when it stops."""
    feed = Feed(services)

    @asynccontextmanager
    async def run(_: Starlette) -> AsyncIterator[None]:
        feed.start()
        yield
        feed.close()

    routes: list[BaseRoute] = [_make_route(operation) for operation in OPERATIONS]
    routes += [
        Route("/v1/files", _upload_file, methods=["POST"]),
        Route("/v1/files/{file}/content", _download_file),
        Route("/v1/files/{file}/view", _view_file),
        Route("/v1/files/{file}/preview", _send_preview),
        Route("/v1/slices", _slice_model, methods=["POST"]),
        Route("/v1/plans", _plan_model, methods=["POST"]),
        Route("/v1/session", _sign_in, methods=["POST"]),
        Route("/v1/openapi.json", _describe_interface),
        Route("/sign-in", _open_link),
        WebSocketRoute("/v1/feed", _serve_feed),
        *ASSET_ROUTES,
        *OCTOPRINT_ROUTES,
        *MOONRAKER_ROUTES,
    ]
    app = Starlette(
        routes=routes,
        middleware=[Middleware(RequestGuard, settings=services.guard)],
        exception_handlers={
            ProblemError: _handle_problem,
            PrinterSlicerError: _handle_error,
            404: _handle_missing,
            405: _handle_method,
            500: _handle_fault,
        },
        lifespan=run,
    )
    app.state.services, app.state.feed, app.state.sockets = services, feed, Counter[str]()
    app.state.slow_work = CapacityLimiter(MAX_SLOW_REQUESTS)
    return app


def _make_route(operation: Operation) -> Route:
    """Return the route of an operation."""

    async def answer(request: Request) -> Response:
        return await run_operation(operation, request)

    return Route(operation.path, answer, methods=[operation.method], name=operation.summary)


async def _upload_file(request: Request) -> Response:
    """Store a file of G-code, and answer with what is known of it."""
    services: Services = request.app.state.services
    await run_in_threadpool(require_access, request, "upload")

    def store(form: FormReader) -> QueuedFile:
        name = form.find_file()
        check_gcode_name(name)
        return services.queue.add_file(name, form.read_file())

    file = await receive_upload(request, store)
    facts = await run_slow_work(request, services.reader.read, file.id)
    return Response(encode_json((file, facts)), 201, media_type="application/json")


async def _find_readable_file(request: Request) -> QueuedFile:
    """Return the file in the path of a request whose sender may read it."""
    services: Services = request.app.state.services
    await run_in_threadpool(require_access, request, "read")
    try:
        file = await run_in_threadpool(services.queue.find_file, request.path_params["file"])
    except PrinterSlicerError as error:
        raise make_problem_error(error, 404) from None
    path = services.queue.files.find_path(file.id)
    if path.is_symlink() or not await run_in_threadpool(services.queue.files.contains, file.id):
        raise ProblemError(404, f"the content of {file.name} is missing", "Upload the file again")
    return file


async def _download_file(request: Request) -> Response:
    """Answer with the content of a file, which browsers save and never show. Several ranges mean the whole file."""
    file = await _find_readable_file(request)
    path = request.app.state.services.queue.files.find_path(file.id)
    if not _ONE_RANGE.fullmatch(request.headers.get("range", "")):
        request.scope["headers"] = [pair for pair in request.scope["headers"] if pair[0] != b"range"]
    return FileResponse(path, media_type="application/octet-stream", filename=file.name)


async def _view_file(request: Request) -> Response:
    """Answer with a page that shows the layers and moves of a file."""
    file = await _find_readable_file(request)
    page = await run_slow_work(request, request.app.state.services.reader.make_page, file.id)
    policy = f"{make_view_policy()}; frame-ancestors 'none'"
    return Response(page, media_type="text/html", headers={"content-security-policy": policy})


async def _send_preview(request: Request) -> Response:
    """Answer with the preview of a file, for viewers; it is always compressed."""
    file = await _find_readable_file(request)
    preview = await run_in_threadpool(request.app.state.services.reader.make_preview, file.id)
    headers = {"content-encoding": "gzip"}
    return Response(preview, media_type="application/octet-stream", headers=headers)


async def _slice_model(request: Request) -> Response:
    """Slice a model that arrives in a form; the other fields are those of `SliceRequest`, settings as JSON."""
    return await _add_task(request, "slice")


async def _plan_model(request: Request) -> Response:
    """Compare the layer plans of a model; the form is that of `/v1/slices`."""
    return await _add_task(request, "plan")


async def _add_task(request: Request, command: SliceCommand) -> Response:
    """Add a task for a model that arrives in a form."""
    services: Services = request.app.state.services
    await run_in_threadpool(require_access, request, "upload")
    task = await receive_upload(request, lambda form: _store_model(services, form, command))
    return Response(encode_json(task), 201, media_type="application/json")


def _store_model(services: Services, form: FormReader, command: SliceCommand) -> SliceTask:
    """Store a model in a folder of its own, and add a task for it."""
    name = form.find_file()
    ending = next((one for one in MODEL_SUFFIXES if name.lower().endswith(one)), "")
    if not ending:
        raise ProblemError(
            415, "the file is not a model", f"Upload a file that ends with {', '.join(MODEL_SUFFIXES)}"
        )
    folder = services.slicer.folder / token_hex(16)
    folder.mkdir(parents=True, mode=0o700)
    try:
        model = folder / f"model{ending}"
        _write_model(model, form)
        fields = form.fields
        settings = decode_json((fields.get("settings") or "{}").encode(), dict[str, str])
        copies = decode_json((fields.get("copies") or "1").encode(), int)
        wanted = SliceRequest(fields.get("printer", ""), fields.get("quality", ""), settings, copies)
        return services.slicer.add(model, name, wanted, command)
    except BaseException as error:
        rmtree(folder, ignore_errors=True)
        if isinstance(error, ValueError):
            raise ProblemError(
                400, f"a field of the form is not valid: {error}", "See /v1/openapi.json"
            ) from None
        raise


def _write_model(path: Path, form: FormReader) -> None:
    """Write the file of a form.

    Raises:
        ProblemError: it cannot be written, or too little space is free.
    """
    try:
        with path.open("wb") as file:
            for piece in form.read_file():
                check_free_space(path.parent)
                file.write(piece)
    except OSError as error:
        raise ProblemError(
            422, f"the model cannot be stored: {error.strerror or error}", "Free some disk space"
        ) from None


async def _sign_in(request: Request) -> Response:
    """Begin a session with a key."""
    body = await read_body(request)
    try:
        text = str(decode_json(body, dict[str, str])["key"])
    except (ValueError, KeyError):
        raise ProblemError(400, "the body has no key", 'Send {"key": "..."}') from None
    return await _begin_session(request, text, Response(status_code=204))


async def _open_link(request: Request) -> Response:
    """Begin a session with the token of a link, which works once; then the page asks to sign in."""
    try:
        return await _begin_session(
            request, request.query_params.get("token", ""), RedirectResponse("/", 303)
        )
    except ProblemError:
        return RedirectResponse("/", 303)


async def _begin_session(request: Request, text: str, response: Response) -> Response:
    """Add the cookie of a new session to a response."""
    services: Services = request.app.state.services
    secret = await run_in_threadpool(services.access.sign_in, text)
    if secret is None:
        raise ProblemError(
            401, "the key is unknown, or the link was used or is too old", "Restart the server for a new link"
        )
    secure = request.url.scheme == "https"
    response.set_cookie(SESSION_COOKIE, secret, httponly=True, samesite="strict", secure=secure, path="/")
    return response


async def _describe_interface(_: Request) -> Response:
    """Answer with the description of the interface."""
    return Response(encode_json(describe_interface(OPERATIONS)), media_type="application/json")


async def _serve_feed(websocket: WebSocket) -> None:
    """Send the status to a browser until it leaves or its session ends."""
    services: Services = websocket.app.state.services
    access = await run_in_threadpool(_find_reader, websocket, services)
    address = websocket.client.host if websocket.client else ""
    sockets: Counter[str] = websocket.app.state.sockets
    is_full = sockets.total() >= _MAX_SOCKETS or sockets[address] >= _MAX_SOCKETS_PER_ADDRESS
    if access is None or is_full:
        await websocket.close(1013 if access else 1008, "too many connections" if access else "sign in first")
        return
    await websocket.accept()
    sockets[address] += 1
    reader = asyncio.create_task(_wait_for_end(websocket))
    try:
        await _send_changes(websocket, services, reader)
    except (WebSocketDisconnect, RuntimeError):
        pass  # the browser has gone
    finally:
        reader.cancel()
        sockets[address] -= 1


def _find_reader(connection: HTTPConnection, services: Services) -> Access | None:
    """Return what the key or session of a socket allows now; None if it does not allow to read."""
    key = read_key(connection.headers)
    secret = connection.cookies.get(SESSION_COOKIE, "")
    access = services.access.find_key(key) if key else services.access.find_session(secret)
    return access if access and access.allows("read") else None


async def _send_changes(websocket: WebSocket, services: Services, reader: asyncio.Task[None]) -> None:
    """Send what changes, at most five times a second."""
    feed: Feed = websocket.app.state.feed
    position = FeedPosition()
    while not reader.done():
        if _find_reader(websocket, services) is None:
            await websocket.close(1008, "the session has ended, or the key was deleted")
            return
        messages, position = feed.list_messages(position)
        for message in messages:
            await websocket.send_text(message.decode())
        await asyncio.sleep(_TICK)
        await feed.wait(position, _PING)


async def _wait_for_end(websocket: WebSocket) -> None:
    """Read and ignore what a browser sends, until it leaves."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass


async def _handle_problem(request: Request, error: Exception) -> Response:
    """Answer a request that cannot be carried out."""
    assert isinstance(error, ProblemError)
    headers = {"www-authenticate": "Bearer"} if error.problem.status == 401 else None
    return respond_with_problem(error.problem, request.url.path, headers)


async def _handle_error(request: Request, error: Exception) -> Response:
    """Answer a request that failed with an error of this project."""
    assert isinstance(error, PrinterSlicerError)
    return await _handle_problem(request, make_problem_error(error))


async def _handle_missing(request: Request, _: Exception) -> Response:
    """Answer a request for something that does not exist."""
    problem = Problem(404, "there is nothing at this address", "See /v1/openapi.json")
    return respond_with_problem(problem, request.url.path)


async def _handle_method(request: Request, _: Exception) -> Response:
    """Answer a request with a method that an address does not have."""
    detail = f"the method {request.method} is not allowed at this address"
    return respond_with_problem(Problem(405, detail, "See /v1/openapi.json"), request.url.path)


async def _handle_fault(request: Request, _: Exception) -> Response:
    """Answer a request that failed because of a fault of the server."""
    problem = Problem(500, "the server has a fault", "See what it printed, and report it")
    return respond_with_problem(problem, request.url.path)
