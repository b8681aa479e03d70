"""Whether overrides make sense: keys that there are, that may differ there, and values that suit all others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.keys import nearest
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.tables import Row, settings_table

__all__ = ["override_faults"]

_WORDS: Final = {OBJECT: "objects", HEIGHT: "heights"}


def override_faults(profile: Profile) -> Iterator[tuple[str, str]]:
    """What is wrong with the overrides of a profile by itself: problem and remedy."""
    rows = {row.key: row for row in settings_table()} if profile.quality.overrides else {}
    for one in profile.quality.overrides:
        if one.is_everywhere and not one.object:
            yield (
                "an override is for no object and no heights",
                "name one of them, or set it for all with --set",
            )
        if one.high <= one.low:
            yield f"{one.where()}: from {one.low:g} to {one.high:g} mm is nothing", "name the lower end first"
        for key in one.set:
            yield from _of_key(one, key, rows)
    if profile.quality.overrides and profile.quality.spiral:
        yield (
            "a spiral has the same settings everywhere",
            "set quality.spiral to false, or leave the overrides out",
        )


def _of_key(one: Override, key: str, rows: Mapping[str, Row]) -> Iterator[tuple[str, str]]:
    """What is wrong with one setting of an override."""
    what = {OBJECT} if one.object else set()
    what |= set() if one.is_everywhere else {HEIGHT}
    allowed = [row.key for row in rows.values() if what <= set(row.own)]
    found = [row for row in rows.values() if key in (row.key, row.key.partition(".")[2])]
    where = f"{one.where()}:{key}"
    if not found:
        near = nearest(key, [*allowed, *(name.partition(".")[2] for name in allowed)])
        hint = f"did you mean {near!r}? " if near else ""
        yield f"{where}: no such setting", f"{hint}`printer-slicer profiles settings` lists all"
    elif found[0].key not in allowed:
        places = " and ".join(_WORDS[one] for one in sorted(what, reverse=True))
        near = ", ".join(name.partition(".")[2] for name in allowed)
        yield f"{where}: {found[0].key} is the same for all {places}", f"of their own they can have: {near}"
