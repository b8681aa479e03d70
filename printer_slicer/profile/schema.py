"""JSON Schema of the three kinds of profile files, for editors that complete and check TOML as it is typed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from printer_slicer.profile.folders import SCHEMAS
from printer_slicer.profile.reading import KINDS

__all__ = ["directive", "schema_name", "schema_of", "schema_text"]

_DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"


def schema_of(kind: str) -> dict[str, Any]:
    """The schema of a file of one kind: `printer`, `material` or `quality`.

    Nothing is required, as everything may be inherited.
    """
    (_, parts) = msgspec.json.schema_components([KINDS[kind]], ref_template="#/$defs/{name}")
    definitions = {name: _told(part) for name, part in parts.items()}
    own = definitions.pop(KINDS[kind].__name__)
    parent = {"type": "string", "description": f"the {kind} that this one is like, by name or path"}
    own["properties"] = {"inherits": parent, **own["properties"]}
    for group in (own, *definitions.values()):
        if not {"low", "high"} <= set(
            group.get("required", ())
        ):  # what is listed is not inherited item by item
            group.pop("required", None)
    own["title"] = f"{kind} profile of printer_slicer"
    return {"$schema": _DRAFT, **own, **({"$defs": definitions} if definitions else {})}


def _told(part: Any) -> Any:
    """A part of a schema in which descriptions tell units, and none are empty."""
    if isinstance(part, list):
        return [_told(item) for item in part]
    if not isinstance(part, Mapping):
        return part
    plain = {key: _told(value) for key, value in part.items() if not (key == "description" and value == "")}
    unit = plain.pop("unit", "")
    if unit and isinstance(plain.get("description"), str):
        plain["description"] += f" [{unit}]"
    return plain


def schema_name(kind: str) -> str:
    """The name of its file."""
    return f"{kind}.schema.json"


def schema_text(kind: str) -> str:
    """The text of its file."""
    return json.dumps(schema_of(kind), indent=1, ensure_ascii=False) + "\n"


def directive(kind: str, folder: Path | None = None) -> str:
    """The line that tells an editor where the schema is: beside the folders of profiles, or in `folder`."""
    where = f"../{SCHEMAS}" if folder is None else folder.absolute().as_uri()
    return f"#:schema {where}/{schema_name(kind)}"
