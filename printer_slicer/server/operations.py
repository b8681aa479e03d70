"""What an operation of the web interface is: a function with a method, a path and a permission."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from printer_slicer.errors import PrinterSlicerError
from printer_slicer.server.access import Access, Permission
from printer_slicer.server.guard import check_same_origin
from printer_slicer.server.json_values import decode_json, encode_json
from printer_slicer.server.problems import Problem, ProblemError, describe_error
from printer_slicer.server.services import Services
from printer_slicer.values import Struct

__all__ = [
    "SESSION_COOKIE",
    "CheckedRequest",
    "Operation",
    "find_access",
    "make_problem_error",
    "run_operation",
]

_MAX_BODY: int = 64 * 1024
SESSION_COOKIE = "printer_slicer_session"


class CheckedRequest(Struct, frozen=True):
    """A request that was checked.

    Attributes:
        services: queue, keys and workers.
        access: who sent it.
        path: parameters in the path.
        query: parameters behind the question mark.
        body: the decoded body; None without one.
    """

    services: Services
    access: Access
    path: Mapping[str, Any]
    query: Mapping[str, str]
    body: Any = None

    def require(self, permission: Permission, printer: str = "") -> None:
        """Check that the sender may do something, on a printer if one is given.

        Raises:
            ProblemError: it may not.
        """
        if not self.access.allows(permission, printer):
            where = f" on printer {printer}" if printer else ""
            raise ProblemError(
                403, f"this key does not allow {permission}{where}", "Use a key with this permission"
            )


class Operation(Struct, frozen=True):
    """A function of the web interface.

    Attributes:
        method: of HTTP.
        path: with parameters in braces.
        permission: what the sender must be allowed.
        summary: what it does, for people.
        run: carries it out, in a thread; what it returns becomes JSON, None an empty response.
        body: type of the body; None if it has none.
        result: type of the result, for the description of the interface.
    """

    method: str
    path: str
    permission: Permission
    summary: str
    run: Callable[[CheckedRequest], Any]
    body: type | None = None
    result: Any = None


def find_access(request: Request, services: Services) -> Access:
    """Return who sent a request.

    Raises:
        ProblemError: it has no valid key and no session, or another site may have sent it.
    """
    text = request.headers.get("x-api-key") or ""
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    if not text and scheme.lower() == "bearer":
        text = token.strip()
    if text:
        access = services.access.find_key(text)
    else:
        access = services.access.find_session(request.cookies.get(SESSION_COOKIE, ""))
        problem = check_same_origin(request.method, request.headers, services.guard) if access else None
        if problem is not None:
            raise ProblemError(problem.status, problem.title, problem.remedy)
    if access is None:
        what = "the key is unknown" if text else "the request has no key"
        raise ProblemError(401, what, "Create a key, see docs/server.md")
    return access


async def run_operation(operation: Operation, request: Request) -> Response:
    """Check a request, carry it out in a thread, and return the response.

    Raises:
        ProblemError: it cannot be carried out.
    """
    data = b"" if operation.body is None else await _read_body(request)
    return await run_in_threadpool(_run_in_thread, operation, request, data)


def _run_in_thread(operation: Operation, request: Request, data: bytes) -> Response:
    """Check a request whose body was read, carry it out, and return the response."""
    services: Services = request.app.state.services
    access = find_access(request, services)
    body = None if operation.body is None else _decode_body(data, operation.body)
    call = CheckedRequest(services, access, request.path_params, dict(request.query_params), body)
    call.require(operation.permission)
    try:
        result = operation.run(call)
    except PrinterSlicerError as error:
        raise make_problem_error(describe_error(error)) from None
    if result is None:
        return Response(status_code=204)
    status = 201 if operation.method == "POST" and operation.result is not None else 200
    return Response(encode_json(result), status, media_type="application/json")


def make_problem_error(problem: Problem) -> ProblemError:
    """Return a problem as an exception."""
    return ProblemError(problem.status, problem.title, problem.remedy)


async def _read_body(request: Request) -> bytes:
    """Read the body of a request.

    Raises:
        ProblemError: it is too large.
    """
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > _MAX_BODY:
            raise ProblemError(413, f"the body is larger than {_MAX_BODY // 1024} kB", "Send less")
    return body


def _decode_body(data: bytes, kind: type) -> Any:
    """Decode the body of a request.

    Raises:
        ProblemError: it is not of this type.
    """
    try:
        return decode_json(data or b"{}", kind)
    except ValueError as error:
        raise ProblemError(400, f"the body is not valid: {error}", "See /v1/openapi.json") from None
