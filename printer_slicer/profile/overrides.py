"""Overrides: settings for single objects or height ranges, as tables and as text."""

# Annotations are not postponed: msgspec needs their values, and evaluates texts one by one.
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final

from printer_slicer.profile.base import Settings, make_meta
from printer_slicer.profile.renamed import replace_former_name

__all__ = ["HIGHEST", "Override", "format_overrides", "has_height_range", "parse_override"]

HIGHEST: Final = 10000.0  # mm
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TYPED = re.compile(
    rf"(?:(?P<object>.*?):)??(?:(?P<low>{_NUMBER}):(?P<high>{_NUMBER}):)?(?P<key>[\w.]+)=(?P<value>.*)"
)


class Override(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings for one object, for a height range, or for a height range of one object."""

    object: Annotated[str, make_meta("name of the object in the input file; empty: all objects")] = ""
    low: Annotated[
        float, make_meta("lower end of the height range, measured from the bed", "mm", ge=0, le=HIGHEST)
    ] = 0
    high: Annotated[
        float, make_meta("upper end of the height range, measured from the bed", "mm", gt=0, le=HIGHEST)
    ] = HIGHEST
    set: Annotated[dict[str, bool | int | float | str], make_meta("settings and their values")]

    @property
    def is_everywhere(self) -> bool:
        """Whether the override applies to all heights."""
        return self.low == 0 and self.high == HIGHEST

    def format_place(self) -> str:
        """Format the object and the height range to which the override applies."""
        heights = "" if self.is_everywhere else f"{self.low:.10g}:{self.high:.10g}"
        return ":".join(part for part in (self.object, heights) if part)


def parse_override(text: str) -> dict[str, Any]:
    """Parse OBJECT:KEY=VALUE, LOW:HIGH:KEY=VALUE or OBJECT:LOW:HIGH:KEY=VALUE as a table.

    Raises:
        ValueError: the text has none of these forms.
    """
    found = _TYPED.fullmatch(text.strip())
    if not found or not (found["object"] or found["low"]):
        raise ValueError(text)
    table: dict[str, Any] = {"set": {replace_former_name(found["key"], text.strip()): found["value"].strip()}}
    if found["object"]:
        table["object"] = found["object"].strip()
    if found["low"]:
        table |= {"low": float(found["low"]), "high": float(found["high"])}
    return table


def has_height_range(text: str) -> bool:
    """Return whether a rule starts with a height range."""
    return bool(re.match(rf"\s*{_NUMBER}:{_NUMBER}:", text))


def format_overrides(tables: Sequence[Mapping[str, Any]]) -> str:
    """Format overrides as text for `parse_override`, one rule for each setting."""
    return "; ".join(_format_rules(tables))


def _format_rules(tables: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the text of one rule for each setting of each override."""
    for table in tables:
        where = Override(**{**table, "set": {}}).format_place()
        for key, value in table["set"].items():
            shown = str(value).lower() if isinstance(value, bool) else value
            yield f"{where}:{key}={shown}"
