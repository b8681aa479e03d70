"""What `print` would refuse in the G-code of imported printers, found before anything is printed with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing import Imported, Note
from printer_slicer.inspection.lint.scan import scan
from printer_slicer.macros import Value, read_template, with_other_names
from printer_slicer.profile import Profile, load_profile, profile_from, settings_of
from printer_slicer.profile.reading import flatten

__all__ = ["with_macro_notes"]

_MACROS: Final = ("start_gcode", "before_layer_gcode", "layer_gcode", "pause_gcode", "end_gcode")


def with_macro_notes(made: Sequence[Imported]) -> list[Imported]:
    """The profiles, printers among them with a note for each command that is refused unless somebody allows it.

    Args:
        made: the profiles of a file; a material among them says what temperatures stand for.
    """
    usual = settings_of(load_profile())
    kinds = [one.kind for one in made]
    known = {one.kind: _without_own(one.values) for one in made if kinds.count(one.kind) == 1}
    return [replace(one, notes=(*one.notes, *_notes(one, usual | known))) for one in made]


def _without_own(values: Mapping[str, Any]) -> dict[str, Any]:
    """Settings without those of single objects, which are judged when there are objects."""
    return {key: value for key, value in values.items() if key != "overrides"}


def _notes(one: Imported, others: Mapping[str, Mapping[str, Any]]) -> Iterator[Note]:
    """What is refused in the macros of one profile."""
    if one.kind != "printer" or not any(one.values.get(name) for name in _MACROS):
        return
    values = {**others, "printer": one.values}
    profile = profile_from(values)
    names: dict[str, Value] = {}
    for kind, part in values.items():
        for key, value in flatten(part):
            if isinstance(value, (bool, int, float, str)):
                names[f"{kind}.{key}"] = value
                names.setdefault(key, value)
    known = with_other_names(names)
    for name in _MACROS:
        commands = list(_commands(str(one.values.get(name, "")), known))
        yield from _refused(commands, profile, f"{one.source}: {name}")


def _refused(commands: Sequence[bytes], profile: Profile, place: str) -> Iterator[Note]:
    for found in scan(commands, profile, moves=()):
        if found.is_error:
            text = f"{found.command}: {found.message}; {found.reason}: `print` refuses it without --allow {found.code}"
            yield Note(place, text)


def _commands(macro: str, names: Mapping[str, Value]) -> Iterator[bytes]:
    """The commands of a macro, of every branch that may be taken, with values where they are known, 0 elsewhere."""
    try:
        lines = read_template(macro, "").possible_lines(names)
    except ProfileError:  # which the import has told
        return
    for line in lines:
        if command := line.partition(";")[0].strip():
            yield command.encode("ascii", "replace")
