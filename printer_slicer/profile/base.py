"""The base class of all groups of settings, and the metadata of a setting: meaning, unit and bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import Meta, Struct

from printer_slicer.deprecation import warn_renamed
from printer_slicer.profile.renamed import RENAMED

__all__ = ["ANYWHERE", "EACH_HEIGHT", "EACH_OBJECT", "HEIGHT", "OBJECT", "Settings", "make_meta"]

HEIGHT = "height"
OBJECT = "object"
ANYWHERE = (OBJECT, HEIGHT)
EACH_OBJECT = (OBJECT,)
EACH_HEIGHT = (HEIGHT,)

_FORMER_ATTRIBUTES = {old.rpartition(".")[2]: new.rpartition(".")[2] for old, new in RENAMED.items()}


def make_meta(meaning: str, unit: str = "", *, own: tuple[str, ...] = (), **bounds: Any) -> Meta:
    """Return the metadata of one setting.

    Args:
        meaning: a phrase that stands alone, for help and documents.
        unit: its unit.
        own: `OBJECT`, `HEIGHT` or both, if it can be overridden for objects or for height ranges.
        bounds: bounds of its value, as in `msgspec.Meta`.
    """
    shown = {"unit": unit} if unit else None
    return Meta(description=meaning, extra={"unit": unit, "own": own}, extra_json_schema=shown, **bounds)


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base class of all groups of settings; instances are frozen, and unknown keys are an error."""

    if not TYPE_CHECKING:  # else every name would seem to exist

        def __getattr__(self, name: str) -> Any:
            """Return a setting by its former name, with a warning."""
            kind = type(self).__name__
            new = _FORMER_ATTRIBUTES.get(name, name)
            if new == name or new not in self.__struct_fields__:
                raise AttributeError(f"{kind!r} object has no attribute {name!r}", name=name, obj=self)
            warn_renamed(f"{kind}.{name}", f"{kind}.{new}")
            return getattr(self, new)
