"""Describe the interface as OpenAPI 3.1, from the operations and the types of their bodies and results."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from printer_slicer.server.json_values import describe_types
from printer_slicer.server.operations import Operation
from printer_slicer.version import VERSION

__all__ = ["describe_interface"]


def describe_interface(operations: Sequence[Operation]) -> dict[str, Any]:
    """Return the description of operations, ready for JSON."""
    kinds = [kind for one in operations for kind in (one.body, one.result) if kind is not None]
    schemas, components = describe_types(kinds)
    schema_of = dict(zip(map(id, kinds), schemas, strict=True))
    paths: dict[str, dict[str, Any]] = {}
    for one in operations:
        path = re.sub(r":\w+}", "}", one.path)
        paths.setdefault(path, {})[one.method.lower()] = _describe_operation(one, path, schema_of)
    keys = {
        "key": {"type": "apiKey", "in": "header", "name": "X-Api-Key"},
        "bearer": {"type": "http", "scheme": "bearer"},
    }
    return {
        "openapi": "3.1.0",
        "info": {"title": "printer-slicer", "version": VERSION},
        "paths": paths,
        "components": {"schemas": components, "securitySchemes": keys},
        "security": [{"key": []}, {"bearer": []}],
    }


def _describe_operation(one: Operation, path: str, schema_of: dict[int, dict[str, Any]]) -> dict[str, Any]:
    """Return the description of an operation."""
    described: dict[str, Any] = {
        "summary": one.summary,
        "description": f"Needs the scope {one.scope}.",
    }
    names = re.findall(r"{(\w+)}", path)
    if names:
        described["parameters"] = [
            {"name": name, "in": "path", "required": True, "schema": {"type": "string"}} for name in names
        ]
    if one.body is not None:
        described["requestBody"] = {"content": {"application/json": {"schema": schema_of[id(one.body)]}}}
    content = {} if one.result is None else {"application/json": {"schema": schema_of[id(one.result)]}}
    problem = {"description": "problem details with a remedy", "content": {"application/problem+json": {}}}
    described["responses"] = {"2XX": {"description": "done", "content": content}, "4XX": problem}
    return described
