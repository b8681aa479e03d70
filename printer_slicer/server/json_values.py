"""Encode values as JSON, decode and check them, and describe their types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

__all__ = ["decode_json", "describe_types", "encode_json"]


def encode_json(value: Any) -> bytes:
    """Return a value as JSON; structs become objects."""
    return msgspec.json.encode(value)


def decode_json(data: bytes, kind: Any) -> Any:
    """Return a value of a type.

    Raises:
        ValueError: the data is no JSON, or not of this type; the message says where.
    """
    try:
        return msgspec.json.decode(data, type=kind)
    except msgspec.DecodeError as error:
        raise ValueError(str(error)) from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def describe_types(kinds: Sequence[Any]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the JSON schema of each type, and those to which they refer as `#/components/schemas/NAME`."""
    schemas, components = msgspec.json.schema_components(kinds, ref_template="#/components/schemas/{name}")
    return list(schemas), components
