"""Settings that some objects, or some heights, have of their own: as they are written, and as they are typed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final

from printer_slicer.profile.base import Settings, meta
from printer_slicer.profile.renamed import warn_of

__all__ = ["HIGHEST", "Override", "as_text", "from_text", "has_heights"]

HIGHEST: Final = 10000.0  # mm
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TYPED = re.compile(
    rf"(?:(?P<object>.*?):)??(?:(?P<low>{_NUMBER}):(?P<high>{_NUMBER}):)?(?P<key>[\w.]+)=(?P<value>.*)"
)


class Override(Settings, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of one object, of the layers between two heights, or of these layers of that object."""

    object: Annotated[str, meta("name of the object in the input file; empty: all objects")] = ""
    low: Annotated[
        float, meta("lower end of the height range, measured from the bed", "mm", ge=0, le=HIGHEST)
    ] = 0
    high: Annotated[
        float, meta("upper end of the height range, measured from the bed", "mm", gt=0, le=HIGHEST)
    ] = HIGHEST
    set: Annotated[dict[str, bool | int | float | str], meta("settings and their values")]

    @property
    def is_everywhere(self) -> bool:
        """Whether it is for all heights."""
        return self.low == 0 and self.high == HIGHEST

    def where(self) -> str:
        """The object and the heights, as they are typed."""
        heights = "" if self.is_everywhere else f"{self.low:.10g}:{self.high:.10g}"
        return ":".join(part for part in (self.object, heights) if part)


def from_text(text: str) -> dict[str, Any]:
    """OBJECT:KEY=VALUE, LOW:HIGH:KEY=VALUE or OBJECT:LOW:HIGH:KEY=VALUE as a table.

    Raises:
        ValueError: it is none of these.
    """
    found = _TYPED.fullmatch(text.strip())
    if not found or not (found["object"] or found["low"]):
        raise ValueError(text)
    table: dict[str, Any] = {"set": {warn_of(found["key"], text.strip()): found["value"].strip()}}
    if found["object"]:
        table["object"] = found["object"].strip()
    if found["low"]:
        table |= {"low": float(found["low"]), "high": float(found["high"])}
    return table


def has_heights(text: str) -> bool:
    """Whether a rule begins with two heights."""
    return bool(re.match(rf"\s*{_NUMBER}:{_NUMBER}:", text))


def as_text(tables: Sequence[Mapping[str, Any]]) -> str:
    """The text that `from_text` reads back, one piece for each setting."""
    return "; ".join(_pieces(tables))


def _pieces(tables: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for table in tables:
        where = Override(**{**table, "set": {}}).where()
        for key, value in table["set"].items():
            told = str(value).lower() if isinstance(value, bool) else value
            yield f"{where}:{key}={told}"
