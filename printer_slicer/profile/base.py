"""What all settings are made of: a meaning, a unit, bounds; and groups in which a misspelt key is an error."""

from __future__ import annotations

from typing import Any

from msgspec import Meta, Struct

__all__ = ["ANYWHERE", "EACH_HEIGHT", "EACH_OBJECT", "HEIGHT", "OBJECT", "Settings", "meta"]

HEIGHT = "height"
OBJECT = "object"
ANYWHERE = (OBJECT, HEIGHT)
EACH_OBJECT = (OBJECT,)
EACH_HEIGHT = (HEIGHT,)


def meta(meaning: str, unit: str = "", *, own: tuple[str, ...] = (), **bounds: Any) -> Meta:
    """The meaning, the unit and the bounds of one setting; `own`: whether objects and heights may have another."""
    shown = {"unit": unit} if unit else None
    return Meta(description=meaning, extra={"unit": unit, "own": own}, extra_json_schema=shown, **bounds)


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all groups of settings: frozen, and a misspelt key is an error."""
