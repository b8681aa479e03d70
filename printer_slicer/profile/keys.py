"""Which settings there are, by their dotted names, and which one somebody may have meant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Final

from msgspec import Struct

from printer_slicer.errors import ProfileError
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.planners import HeightRange
from printer_slicer.profile.reading import KINDS, SettingsSource
from printer_slicer.profile.renamed import current_name
from printer_slicer.profile.settings import (
    PLANNER_SETTINGS,
    Accelerations,
    OptimalPlanner,
    PrinterAccelerations,
    PrinterSpeeds,
    Speeds,
)

__all__ = ["ENTRIES", "INNER", "is_setting", "keys_of", "nearest", "resolved"]

INNER: Final[Mapping[str, Mapping[str, type[Struct]]]] = {
    "printer": {"speeds": PrinterSpeeds, "accelerations": PrinterAccelerations},
    "material": {},
    "quality": {"speeds": Speeds, "accelerations": Accelerations},
}
"""The tables of each section. A key without a section refers to the quality: `speeds.travel`."""

ENTRIES: Final[Mapping[str, type[Struct]]] = {"overrides": Override, "planner.ranges": HeightRange}
"""Settings that are lists of tables: what these may hold."""
_ALIKE: Final = 0.75  # of 1, from where on a name is near
_SHORT: Final = 2  # letters, of which nobody can tell what they begin


def keys_of(kind: str, values: Mapping[str, Any]) -> list[str]:
    """All keys that may be set in a section as it stands: the planner's own settings depend on its kind."""
    inner = INNER[kind]
    keys = [name for name in KINDS[kind].__struct_fields__ if name not in ("planner", *inner)]
    if kind == "quality":
        table = values.get("planner")
        chosen = table.get("kind", "optimal") if isinstance(table, dict) else "optimal"
        planner = PLANNER_SETTINGS.get(str(chosen), OptimalPlanner)
        keys += [f"planner.{name}" for name in ("kind", *planner.__struct_fields__)]
    return keys + [f"{table}.{name}" for table, owner in inner.items() for name in owner.__struct_fields__]


def is_setting(key: str) -> bool:
    """Return whether a key is the present or a former name of a setting, with or without its section."""
    key = current_name(key.removesuffix("+"))
    section, _, rest = key.partition(".")
    names = [(kind, name) for kind in KINDS for name in keys_of(kind, {})]
    names += [
        ("quality", f"planner.{name}") for one in PLANNER_SETTINGS.values() for name in one.__struct_fields__
    ]
    if section in KINDS:
        return any((section, rest) == one for one in names)
    return any(key in (name, name.removeprefix("planner.")) for _, name in names)


def nearest(key: str, known: Sequence[str]) -> str:
    """The name that is most like a key, of the same group if there is such a group; empty where none is near."""
    table, _, leaf = key.rpartition(".")
    known = sorted(known, key=len, reverse=True)  # of names that end alike the shortest is offered
    same = [one for one in known if one.rpartition(".")[0] == table]
    leaves, all_leaves = ({one.rpartition(".")[2]: one for one in among} for among in (same, known))
    if leaf in all_leaves:
        return all_leaves[leaf]
    for among in (leaves, all_leaves):
        near = get_close_matches(leaf, among, n=1, cutoff=_ALIKE)
        begun = [one for one in among if one.startswith(leaf) and len(leaf) > _SHORT]
        if near or len(begun) == 1:
            return among[near[0] if near else begun[0]]
    near = [] if same else get_close_matches(key, known, n=1, cutoff=_ALIKE)
    return near[0] if near else ""


def resolved(sources: Mapping[str, SettingsSource], key: str) -> tuple[str, str]:
    """Which section and key a change means: `quality.perimeters`, or `perimeters` where only one section has it.

    Settings of the chosen planner may be named alone, too: `smooth` for `quality.planner.smooth`.

    Raises:
        ProfileError: none has it, or several have.
    """
    known = [(kind, path) for kind, source in sources.items() for path in keys_of(kind, source.values)]
    exact = [(kind, path) for kind, path in known if f"{kind}.{path}" == key]
    matches = exact or [(kind, path) for kind, path in known if path == key]
    if key.partition(".")[0] in INNER["quality"]:
        matches = [one for one in matches if one[0] == "quality"] or matches
    matches = matches or [("quality", path) for _, path in known if path == f"planner.{key}"]
    if len(matches) == 1:
        return matches[0]
    if matches:
        choices = ", ".join(f"{kind}.{path}" for kind, path in matches)
        raise ProfileError(f"{key}: more than one section has this key", remedy=f"say which: {choices}")
    leaf = key.rpartition(".")[2]
    having = [kind for kind, struct in PLANNER_SETTINGS.items() if leaf in struct.__struct_fields__]
    if having and key in (leaf, f"planner.{leaf}", f"quality.planner.{leaf}"):
        raise ProfileError(
            f"{key}: the chosen planner has no such setting",
            remedy=f"it belongs to: {', '.join(f'--planner {kind}' for kind in having)}",
        )
    group = [path for _, path in known if path.startswith(f"{key.removeprefix('quality.')}.")]
    if group:
        raise ProfileError(f"{key}: is a group of settings", remedy=f"name one: {', '.join(group)}")
    names = sorted({f"{kind}.{path}" for kind, path in known} | {path for _, path in known})
    near = nearest(key, names)
    hint = f"did you mean {near!r}? " if near else ""
    raise ProfileError(
        f"{key}: no such setting", remedy=f"{hint}`printer-slicer profiles settings` lists all"
    )
