"""What an operation of the web interface is: a function with a method, a path and a scope."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.convertors import Convertor, register_url_convertor
from starlette.requests import Request
from starlette.responses import Response

from printer_slicer.server.access import Access, KeyScope
from printer_slicer.server.guard import check_same_origin
from printer_slicer.server.json_values import decode_json, encode_json
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.receiving import read_body, run_slow_work
from printer_slicer.server.services import Services
from printer_slicer.values import Struct

__all__ = [
    "SESSION_COOKIE",
    "CheckedRequest",
    "Operation",
    "find_access",
    "read_key",
    "read_request_id",
    "require_access",
    "run_operation",
]

_MAX_REQUEST_ID: int = 200
SESSION_COOKIE = "printer_slicer_session"


class _JobNumberConvertor(Convertor[int]):
    """The number of a job in a path: `{NAME:job_number}`."""

    regex = "[0-9]{1,18}"

    def convert(self, value: str) -> int:
        """Return the number."""
        return int(value)

    def to_string(self, value: int) -> str:
        """Return the digits."""
        return str(value)


register_url_convertor("job_number", _JobNumberConvertor())


class CheckedRequest(Struct, frozen=True):
    """A request that was checked.

    Attributes:
        services: queue, keys and workers.
        access: who sent it.
        path: parameters in the path.
        query: parameters behind the question mark.
        body: the decoded body; None without one.
        request_id: of the header `Idempotency-Key`, see `read_request_id`.
    """

    services: Services
    access: Access
    path: Mapping[str, Any]
    query: Mapping[str, str]
    body: Any = None
    request_id: str = ""


class Operation(Struct, frozen=True):
    """A function of the web interface.

    Attributes:
        method: of HTTP.
        path: with parameters in braces.
        scope: what the sender must be allowed.
        summary: what it does, for people.
        run: carries it out, in a thread; what it returns becomes JSON, None an empty response.
        body: type of the body; None if it has none.
        result: type of the result, for the description of the interface.
        is_slow: whether it may take long.
    """

    method: str
    path: str
    scope: KeyScope
    summary: str
    run: Callable[[CheckedRequest], Any]
    body: type | None = None
    result: Any = None
    is_slow: bool = False


def find_access(request: Request) -> Access:
    """Return who sent a request.

    Raises:
        ProblemError: it has no valid key and no session, or another site may have sent it.
    """
    services: Services = request.app.state.services
    text = read_key(request.headers)
    if text:
        access = services.access.find_key(text)
    else:
        access = services.access.find_session(request.cookies.get(SESSION_COOKIE, ""))
        problem = check_same_origin(request.method, request.headers) if access else None
        if problem is not None:
            raise ProblemError(problem.status, problem.detail, problem.remedy)
    if access is None:
        what = "the key is unknown" if text else "the request has no key"
        raise ProblemError(401, what, "Create a key: printer-slicer serve --new-key NAME")
    return access


def read_key(headers: Mapping[str, str]) -> str:
    """Return the key in the headers of a request; empty without one."""
    text = headers.get("x-api-key") or ""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if not text and scheme.lower() == "bearer" else text


def require_access(request: Request, scope: KeyScope) -> Access:
    """Return who sent a request, and may do something.

    Raises:
        ProblemError: it has no valid key and no session, another site may have sent it, or it is not allowed.
    """
    access = find_access(request)
    access.require(scope)
    return access


async def run_operation(operation: Operation, request: Request) -> Response:
    """Check a request, carry it out in a thread, and return the response.

    Raises:
        ProblemError: it cannot be carried out.
    """
    data = b"" if operation.body is None else await read_body(request)
    if operation.is_slow:
        return await run_slow_work(request, _run_in_thread, operation, request, data)
    return await run_in_threadpool(_run_in_thread, operation, request, data)


def _run_in_thread(operation: Operation, request: Request, data: bytes) -> Response:
    """Check a request whose body was read, carry it out, and return the response."""
    access = require_access(request, operation.scope)
    body = None if operation.body is None else _decode_body(data, operation.body)
    call = CheckedRequest(
        request.app.state.services,
        access,
        request.path_params,
        dict(request.query_params),
        body,
        read_request_id(request, access),
    )
    result = operation.run(call)
    if result is None:
        return Response(status_code=204)
    status = 201 if operation.method == "POST" and operation.result is not None else 200
    return Response(encode_json(result), status, media_type="application/json")


def read_request_id(request: Request, access: Access) -> str:
    """Return the id that the sender gave to a request in the header `Idempotency-Key`; empty without one.

    Raises:
        ProblemError: it is too long.
    """
    given = request.headers.get("idempotency-key", "")
    if len(given) > _MAX_REQUEST_ID:
        raise ProblemError(400, f"the idempotency key is longer than {_MAX_REQUEST_ID} letters", "Shorten it")
    return f"{access.name}: {given}" if given else ""


def _decode_body(data: bytes, kind: type) -> Any:
    """Decode the body of a request.

    Raises:
        ProblemError: it is not of this type.
    """
    try:
        return decode_json(data or b"{}", kind)
    except ValueError as error:
        raise ProblemError(400, f"the body is not valid: {error}", "See /v1/openapi.json") from None
