"""Look up settings by dotted key, and suggest keys for misspelt ones."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from typing import Any, Final

from msgspec import Struct

from printer_slicer.errors import ProfileError
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.planners import HeightRange
from printer_slicer.profile.reading import KINDS, SettingsSource
from printer_slicer.profile.renamed import find_current_name
from printer_slicer.profile.settings import (
    PLANNER_SETTINGS,
    Accelerations,
    OptimalPlanner,
    PrinterAccelerations,
    PrinterSpeeds,
    Speeds,
)
from printer_slicer.texts import find_similar_words

__all__ = [
    "INNER_TABLES",
    "TABLE_LISTS",
    "find_nearest_key",
    "find_section",
    "is_setting",
    "list_section_keys",
    "resolve_key",
]

INNER_TABLES: Final[Mapping[str, Mapping[str, type[Struct]]]] = {
    "printer": {"speeds": PrinterSpeeds, "accelerations": PrinterAccelerations},
    "material": {},
    "quality": {"speeds": Speeds, "accelerations": Accelerations},
}
"""Section -> tables inside it. A key of a table without a section, such as `speeds.travel`, refers to the quality."""

TABLE_LISTS: Final[Mapping[str, type[Struct]]] = {"overrides": Override, "planner.ranges": HeightRange}
"""Setting that is a list of tables -> type of these tables."""
_MIN_SIMILARITY: Final = (
    0.75  # minimum similarity of a suggestion, 0 to 1, if its words are similar one by one
)
_MIN_SIMILARITY_OF_WHOLE: Final = 0.85  # minimum similarity of any other suggestion
_LONGEST_SHORT_PREFIX: Final = 2  # letters; prefixes up to this length give no suggestion


def list_section_keys(kind: str, values: Mapping[str, Any]) -> list[str]:
    """Return all keys of a section; the kind of planner in `values` determines the planner's keys."""
    table = values.get("planner")
    chosen = table.get("kind", "optimal") if isinstance(table, dict) else "optimal"
    return list(_make_section_keys(kind, str(chosen)))


@cache  # G-code names some hundred settings, and each is looked up in these keys
def _make_section_keys(kind: str, planner_kind: str) -> tuple[str, ...]:
    """Return all keys of a section, with those of this planner if it is the quality."""
    inner = INNER_TABLES[kind]
    keys = [name for name in KINDS[kind].__struct_fields__ if name not in ("planner", *inner)]
    if kind == "quality":
        planner = PLANNER_SETTINGS.get(planner_kind, OptimalPlanner)
        keys += [f"planner.{name}" for name in ("kind", *planner.__struct_fields__)]
    keys += [f"{table}.{name}" for table, owner in inner.items() for name in owner.__struct_fields__]
    return tuple(keys)


def is_setting(key: str) -> bool:
    """Return whether a key is the current or a former name of a setting, with or without its section."""
    return bool(find_section(key))


def find_section(key: str) -> str:
    """Return the section in the key of a setting, or the first section that has the setting; empty if none has it.

    Args:
        key: the current or a former name of the setting, with or without its section.
    """
    key = find_current_name(key.removesuffix("+"))
    section, _, rest = key.partition(".")
    names = [(kind, name) for kind in KINDS for name in list_section_keys(kind, {})]
    names += [
        ("quality", f"planner.{name}") for one in PLANNER_SETTINGS.values() for name in one.__struct_fields__
    ]
    if section in KINDS:
        return section if (section, rest) in names else ""
    sections = [kind for kind, name in names if key in (name, name.removeprefix("planner."))]
    return "quality" if section in INNER_TABLES["quality"] and sections else next(iter(sections), "")


def find_nearest_key(key: str, known: Sequence[str]) -> str:
    """Return the known name that is most similar to a key; empty if no name is similar.

    Names of the key's own group are preferred.
    """
    table, _, leaf = key.rpartition(".")
    known = sorted(known, key=len, reverse=True)  # of names with the same ending, suggest the shortest
    same = [one for one in known if one.rpartition(".")[0] == table]
    leaves, all_leaves = ({one.rpartition(".")[2]: one for one in candidates} for candidates in (same, known))
    if leaf in all_leaves:
        return all_leaves[leaf]
    for candidates in (leaves, all_leaves):
        near = _find_similar(leaf, candidates)
        longer = [one for one in candidates if one.startswith(leaf) and len(leaf) > _LONGEST_SHORT_PREFIX]
        if near or len(longer) == 1:
            return candidates[near[0] if near else longer[0]]
    near = [] if same else _find_similar(key, known)
    return near[0] if near else ""


def _find_similar(key: str, known: Collection[str]) -> list[str]:
    """Return the known names that are similar to a key, the most similar first.

    One different word makes another setting: `print_temperature` is not a misspelt `bed_temperature`.
    """
    near = find_similar_words(key, known, cutoff=_MIN_SIMILARITY)
    spelt = find_similar_words(key, near, cutoff=_MIN_SIMILARITY_OF_WHOLE)
    words = key.split("_")
    return [
        name
        for name in near
        if name in spelt
        or (
            len(words) == len(others := name.split("_"))
            and all(
                find_similar_words(word, [other], cutoff=_MIN_SIMILARITY)
                for word, other in zip(words, others, strict=True)
            )
        )
    ]


def resolve_key(sources: Mapping[str, SettingsSource], key: str) -> tuple[str, str]:
    """Return section and key of a setting from `quality.perimeters`, or from `perimeters` if only one section has it.

    A setting of the chosen planner can also be written without its table: `smooth` for `quality.planner.smooth`.

    Raises:
        ProfileError: no section has the key, or several have it.
    """
    section, _, rest = key.partition(".")
    if section in sources and rest in list_section_keys(section, sources[section].values):
        return section, rest
    known = [
        (kind, path) for kind, source in sources.items() for path in list_section_keys(kind, source.values)
    ]
    matches = [(kind, path) for kind, path in known if path == key]
    if section in INNER_TABLES["quality"]:
        matches = [one for one in matches if one[0] == "quality"] or matches
    matches = matches or [("quality", path) for _, path in known if path == f"planner.{key}"]
    if len(matches) == 1:
        return matches[0]
    if matches:
        choices = ", ".join(f"{kind}.{path}" for kind, path in matches)
        raise ProfileError(
            f"{key}: more than one section has this setting", remedy=f"Choose one of: {choices}"
        )
    raise _explain_unknown_key(key, known)


def _explain_unknown_key(key: str, known: Sequence[tuple[str, str]]) -> ProfileError:
    """Make an error, with a remedy, for a key that no section has.

    Args:
        key: the key.
        known: section and key of all settings.
    """
    leaf = key.rpartition(".")[2]
    planner_kinds = [kind for kind, struct in PLANNER_SETTINGS.items() if leaf in struct.__struct_fields__]
    if planner_kinds and key in (leaf, f"planner.{leaf}", f"quality.planner.{leaf}"):
        planners = " or ".join(f'`planner.kind="{kind}"`' for kind in planner_kinds)
        return ProfileError(
            f"{key}: the chosen planner has no such setting", remedy=f"Use it with {planners}"
        )
    group = [path for _, path in known if path.startswith(f"{key.removeprefix('quality.')}.")]
    if group:
        return ProfileError(
            f"{key}: this is a group of settings", remedy=f"Choose one of: {', '.join(group)}"
        )
    names = sorted({f"{kind}.{path}" for kind, path in known} | {path for _, path in known})
    near = find_nearest_key(key, names)
    hint = f"Did you mean {near!r}? " if near else ""
    return ProfileError(f"{key}: no such setting", remedy=f"{hint}`ps.find_settings()` lists all settings")
