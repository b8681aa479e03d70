"""Errors of the web interface as problem details (RFC 9457), each with what helps; for slicers as plain text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from starlette.responses import Response

from printer_slicer.errors import PrinterSlicerError
from printer_slicer.values import Struct

__all__ = ["Problem", "ProblemError", "make_problem_error", "respond_with_problem"]

_SLICER_PATH: Final = re.compile(
    r"(/printers/[^/]+)?/(api|server)/"
)  # of OctoPrint's and Moonraker's interfaces


class Problem(Struct, frozen=True):
    """Why a request failed.

    Attributes:
        status: status code of HTTP.
        detail: what is wrong, without the first capital, for people.
        remedy: what helps; empty if nothing is known.
    """

    status: int
    detail: str
    remedy: str = ""


class ProblemError(Exception):
    """A request cannot be carried out."""

    def __init__(self, status: int, detail: str, remedy: str = "") -> None:
        super().__init__(detail)
        self.problem = Problem(status, detail, remedy)


def make_problem_error(error: PrinterSlicerError, status: int = 422) -> ProblemError:
    """Return an error of this project as a problem."""
    return ProblemError(status, str(error.args[0]), error.remedy)


def respond_with_problem(problem: Problem, path: str, headers: Mapping[str, str] | None = None) -> Response:
    """Return a response with a problem: as JSON, or as a sentence to slicers, which show the body as it is.

    Args:
        problem: what is wrong.
        path: path of the request.
        headers: further headers.
    """
    if _SLICER_PATH.match(path):
        detail = problem.detail[:1].upper() + problem.detail[1:]
        text = f"{detail}. {problem.remedy}." if problem.remedy else f"{detail}."
        return Response(text, problem.status, headers, media_type="text/plain")
    body: dict[str, Any] = {
        "status": problem.status,
        "title": HTTPStatus(problem.status).phrase,
        "detail": problem.detail,
    }
    if problem.remedy:
        body["remedy"] = problem.remedy
    content = json.dumps(body).encode()
    return Response(content, problem.status, headers, media_type="application/problem+json")
