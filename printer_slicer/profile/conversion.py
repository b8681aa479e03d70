"""What was read as settings with types and bounds; what is wrong with it, by file, line, key and bound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.profile.keys import keys_of, nearest
from printer_slicer.profile.reading import KINDS, Source
from printer_slicer.profile.settings import PLANNER_SETTINGS
from printer_slicer.profile.tables import choices_of

__all__ = ["Fault", "converted", "fault_of"]

_TELLS = "`printer-slicer profiles settings` tells type, unit and bounds"


class Fault(NamedTuple):
    """What is wrong with one setting.

    Attributes:
        place: the file with the line, or what was typed.
        path: the key within its section; empty for all of it.
        problem: what is wrong, with key and value.
        remedy: what to do.
    """

    place: str
    path: str
    problem: str
    remedy: str

    def error(self) -> ProfileError:
        """The same as an error."""
        return ProfileError(f"{self.place}: {self.problem}", remedy=self.remedy)


def converted(kind: str, source: Source) -> Any:
    """One section as a struct.

    Raises:
        ProfileError: naming place, key and bound.
    """
    made = _attempt(kind, source.values)
    if isinstance(made, msgspec.ValidationError):
        raise _fault(kind, source, made).error() from None
    return made


def _attempt(kind: str, values: Mapping[str, Any]) -> Any:
    """The struct, or what the library says is wrong."""
    try:
        return msgspec.convert(values, KINDS[kind], strict=False)
    except msgspec.ValidationError as error:
        return error


def fault_of(kind: str, source: Source) -> Fault | None:
    """What is wrong with a section first; None where nothing is."""
    made = _attempt(kind, source.values)
    return _fault(kind, source, made) if isinstance(made, msgspec.ValidationError) else None


def _fault(kind: str, source: Source, error: msgspec.ValidationError) -> Fault:
    problem, _, where = str(error).partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    if "unknown field" in problem:
        return _unknown(kind, source, f"{path}.{problem.split('`')[1]}".lstrip("."))
    if "missing required field" in problem:
        path = f"{path}.{problem.split('`')[1]}".lstrip(".")
    given, choices = _given(source.values, path), choices_of(KINDS[kind], path)
    if path == "planner.kind":
        choices = ", ".join(PLANNER_SETTINGS)
    what = f"{kind}.{path}" if path else kind
    remedy = f"choose one of: {choices}" if choices else _TELLS
    if "missing" in problem:
        problem, remedy = "is missing", f'set it, such as {path} = "..."' if path == "name" else _TELLS
    return Fault(source.place(path), path, f"{what}: {problem.replace('`', '')}{given}", remedy)


def _unknown(kind: str, source: Source, path: str) -> Fault:
    """A key that there is not: what is like it, or what there is."""
    known = keys_of(kind, source.values)
    near = nearest(path, known)
    elsewhere = [other for other in KINDS if other != kind and path in keys_of(other, {})]
    remedy = f"did you mean {near!r}?" if near else f"known: {', '.join(known)}"
    if elsewhere:
        remedy = f"it belongs into a {elsewhere[0]} profile"
    return Fault(source.place(path), path, f"{kind}.{path}: no such setting", remedy)


def _given(values: Mapping[str, Any], path: str) -> str:
    """The offending value for the message; nothing where the problem already quotes it or a key is missing."""
    found: Any = values
    for key in path.split("."):
        if not isinstance(found, Mapping) or key not in found:
            return ""
        found = found[key]
    return "" if isinstance(found, Mapping) else f"; it is {found!r}"
