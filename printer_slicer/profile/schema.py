"""JSON Schema of the three kinds of profile files, for editors that complete and check TOML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from inspect import cleandoc
from pathlib import Path
from typing import Any, Final

import msgspec

from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.folders import SCHEMAS
from printer_slicer.profile.lists import LISTS
from printer_slicer.profile.reading import KINDS
from printer_slicer.profile.tables import list_setting_definitions

__all__ = ["format_schema", "format_schema_directive", "make_schema", "make_schema_name"]

_DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"


def make_schema(kind: str) -> dict[str, Any]:
    """Return the schema of a file of one kind: `printer`, `material` or `quality`.

    No setting is required in a file that inherits from another one.
    """
    schema, definitions = _build_components(kind)
    parent = {"type": "string", "description": f"the {kind} profile to inherit from, by name or path"}
    aliases = {"type": "array", "items": {"type": "string"}, "description": f"other names of the {kind}"}
    schema["properties"] = {"inherits": parent, "aliases": aliases, **schema["properties"]}
    without_parent: dict[str, Any] = {"required": schema.pop("required")}
    if kind == "quality":
        without_parent["properties"] = {"planner": {"required": ["kind"]}}
        definitions["Override"] |= _build_override_rules(schema, definitions)
    for group in (schema, *definitions.values()):
        if not {"low", "set"} & set(group.get("required", ())):  # items of lists are not inherited one by one
            group.pop("required", None)
    schema |= {
        "title": f"{kind} profile of printer_slicer",
        "if": {"not": {"required": ["inherits"]}},
        "then": without_parent,
    }
    return {"$schema": _DRAFT, **schema, **({"$defs": definitions} if definitions else {})}


def _build_components(kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Build the schema of a kind and the schemas of its groups of settings; lists may also be written as text."""
    _, parts = msgspec.json.schema_components([KINDS[kind]], ref_template="#/$defs/{name}")
    for part in parts.values():
        if "description" in part:  # a docstring; only newer versions of msgspec remove its indentation
            part["description"] = cleandoc(part["description"])
    definitions = {name: _add_units(part) for name, part in parts.items()}
    for name, group in definitions.items():
        prefix = "planner." if name == "OptimalPlanner" else ""
        for key, value in group["properties"].items():
            if prefix + key in LISTS:
                listed = {"type": value.pop("type"), "items": value.pop("items")}
                value["anyOf"] = [listed, {"type": "string"}]
    return definitions.pop(KINDS[kind].__name__), definitions


def _build_override_rules(quality: Mapping[str, Any], groups: Mapping[str, Any]) -> dict[str, Any]:
    """Build the schema of overrides, which need an object or a height range and allow only some settings."""
    kinds = {"quality": quality, "material": _build_components("material")[0]}
    known: dict[str, Any] = {}
    schema: dict[str, set[str]] = {OBJECT: set(), HEIGHT: set()}
    for row in list_setting_definitions():
        kind, *tables, leaf = row.key.split(".")
        group = groups[tables[0].capitalize()] if row.own and tables else kinds.get(kind, {})
        for name in (row.key, row.key.partition(".")[2]) if row.own else ():
            known[name] = group["properties"][leaf]
            for place in row.own:
                schema[place].add(name)
    rules = [
        {
            "if": {"required": [flag]},
            "then": {"properties": {"set": {"propertyNames": {"enum": sorted(names)}}}},
        }
        for flag, names in (("object", schema[OBJECT]), ("low", schema[HEIGHT]), ("high", schema[HEIGHT]))
    ]
    setting = {
        "type": "object",
        "description": "settings and their values",
        "properties": known,
        "additionalProperties": False,
    }
    return {
        "properties": {**groups["Override"]["properties"], "set": setting},
        "anyOf": [{"required": [flag]} for flag in ("object", "low", "high")],
        "allOf": rules,
    }


def _add_units(part: Any) -> Any:
    """Append units to the descriptions in a schema and drop empty descriptions; return the new schema."""
    if isinstance(part, list):
        return [_add_units(item) for item in part]
    if not isinstance(part, Mapping):
        return part
    plain = {
        key: _add_units(value) for key, value in part.items() if not (key == "description" and value == "")
    }
    unit = plain.pop("unit", "")
    if unit and isinstance(plain.get("description"), str):
        plain["description"] += f" [{unit}]"
    return plain


def make_schema_name(kind: str) -> str:
    """Return the name of the schema file."""
    return f"{kind}.schema.json"


def format_schema(kind: str) -> str:
    """Format the schema of a kind as the text of its file."""
    return json.dumps(make_schema(kind), indent=1, ensure_ascii=False) + "\n"


def format_schema_directive(kind: str, folder: Path | None = None) -> str:
    """Format the comment that tells editors where the schema is: beside the folders of profiles, or in `folder`."""
    where = f"../{SCHEMAS}" if folder is None else folder.absolute().as_uri()
    return f"#:schema {where}/{make_schema_name(kind)}"
