"""Find profiles by display name, by model, by aliases, or by some words of these, in any spelling."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Final, NamedTuple

from printer_slicer.name_search import AT_THE_END, EXACT, IN_ORDER, rank_match, split_name
from printer_slicer.profile.folders import find_profile_paths, find_shipped_profiles

__all__ = [
    "ProfileMatch",
    "find_profile_by_display_name",
    "find_profiles",
    "read_display_name",
    "suggest_profiles",
]

_NAME: Final = re.compile(r'^name = "([^"\n]*)"', re.MULTILINE)
_MODEL: Final = re.compile(r'^model = "([^"\n]*)"', re.MULTILINE)
_ALIASES: Final = re.compile(r"^aliases = \[([^\]]*)\]", re.MULTILINE)
_IDENTICAL, _SAME_WORDS = -2, -1  # better than the kinds of `rank_match`, which ignore the nozzle
_GENERIC: Final = re.compile(r"generic\s+", re.IGNORECASE)  # maker of materials in other slicers
_EQUIVALENTS: Final = {"quality": {"fast": "draft", "speed": "draft", "normal": "standard", "detail": "fine"}}
"""Words of other slicers -> names of shipped profiles, for suggestions only."""
_MIN_SIMILARITY: Final = 0.8  # minimum similarity of a suggestion, 0 to 1
_MAX_SHOWN: Final = 5  # profiles in a message


class ProfileMatch(NamedTuple):
    """A profile that matches a text.

    Attributes:
        name: the name that selects it.
        display_name: its `name` setting.
        is_sure: whether every other profile matches less well.
    """

    name: str
    display_name: str
    is_sure: bool


class _ProfileNames(NamedTuple):
    """The names of a profile.

    Attributes:
        file_name: name of its file, without the suffix.
        display_name: its `name` setting; empty if it is inherited.
        others: its aliases and its model.
        is_shipped: whether it belongs to this program.
    """

    file_name: str
    display_name: str
    others: tuple[str, ...]
    is_shipped: bool

    def list_all(self) -> list[str]:
        """Return all names that are not empty."""
        return [name for name in (self.file_name, self.display_name, *self.others) if name]


def read_display_name(path: Path) -> str:
    """Return the `name` setting in a profile's file; empty if it is inherited."""
    return _read_names(path).display_name


def find_profiles(kind: str, text: str, folders: Sequence[Path] = ()) -> list[ProfileMatch]:
    """Return the profiles that match a text, the best match first.

    If several names have all words of the text and no others except a nozzle, display names of the user's own
    profiles come first, then shipped profiles, then file names of the user's own profiles.

    Args:
        kind: `printer`, `material` or `quality`.
        text: as typed, such as "Ender 3".
        folders: searched first.
    """
    known = {name: _read_names(path) for name, path in find_profile_paths(kind, folders).items()}
    if kind == "material" and not any(_rank_profile(text, names) for names in known.values()):
        text = _GENERIC.sub("", text)
    ranked = sorted((rank, name) for name, names in known.items() if (rank := _rank_profile(text, names)))
    ranks = [rank for rank, _ in ranked]
    is_only = len(ranks) == 1 and ranks[0][0] < IN_ORDER
    is_best = len(ranks) > 1 and ranks[0][0] <= AT_THE_END and ranks[1][:2] > ranks[0][:2]
    is_sure = (is_only or is_best) and any(word.isalpha() for word in split_name(text))
    return [
        ProfileMatch(name, known[name].display_name or name, is_sure and i == 0)
        for i, (_, name) in enumerate(ranked)
    ]


def _rank_profile(text: str, names: _ProfileNames) -> tuple[int, int, int] | None:
    """Rank how well a profile matches a text; lower is better, None is no match.

    Returns:
        The kind of match, the precedence among exact matches, and the number of additional words.
    """
    ranks = []
    for name in names.list_all():
        if found := _rank_name(text, name):
            precedence = 1 if names.is_shipped else 2 if name == names.file_name else 0
            ranks.append((found[0], precedence if found[0] <= EXACT else 0, found[1]))
    return min(ranks, default=None)


def _rank_name(text: str, name: str) -> tuple[int, int] | None:
    """Rank how well a name matches a text: identical names and words first, then the ranks of `rank_match`."""
    if text.strip().casefold() == name.casefold():
        return _IDENTICAL, 0
    words = split_name(text, with_nozzle=True)
    if words and words == split_name(name, with_nozzle=True):
        return _SAME_WORDS, 0
    before_at = name.partition("@")[0]  # after it, presets of OrcaSlicer name the printer that they are for
    return rank_match(split_name(text), split_name(before_at))


def suggest_profiles(kind: str, text: str, folders: Sequence[Path] = ()) -> str:
    """Return a question ("Did you mean ...?") for a name that selects no profile; empty if none is similar."""
    matches = find_profiles(kind, text, folders)
    if matches:
        matches = matches[:1] if matches[0].is_sure else matches
        shown = [f"{one.name} ({one.display_name})" for one in matches[:_MAX_SHOWN]]
        more = " and more" if len(matches) > _MAX_SHOWN else ""
        return f"Did you mean {', '.join(shown)}{more}?"
    paths = find_profile_paths(kind, folders)
    if equivalent := _EQUIVALENTS.get(kind, {}).get(text.strip().casefold()):
        return f"Did you mean {equivalent!r}?"
    if contained := _find_contained_name(kind, split_name(text), paths):
        return f"Similar printer: {contained!r}" if kind == "printer" else f"Did you mean {contained!r}?"
    near = get_close_matches(text.lower(), paths, n=1, cutoff=_MIN_SIMILARITY)
    return f"Did you mean {near[0]!r}?" if near else ""


def _find_contained_name(kind: str, typed: Sequence[str], paths: Mapping[str, Path]) -> str:
    """Return the profile whose name has the most of the typed words; empty if there is none.

    Printers must share at least two words, because single ones are names of makers.
    """
    contained = [
        (len(words), name)
        for name, path in paths.items()
        for words in map(split_name, _read_names(path).list_all())
        if len(words) > (kind == "printer") and (rank := rank_match(words, typed)) and rank[0] < IN_ORDER
    ]
    return max(contained, default=(0, ""))[1]


def _read_names(path: Path) -> _ProfileNames:
    """Read the names of a profile.

    Only the model of a shipped profile counts: an imported profile of the same machine must not make it ambiguous.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    shown, model, aliases = _NAME.search(text), _MODEL.search(text), _ALIASES.search(text)
    is_shipped = path.parent.parent == find_shipped_profiles()
    others = re.findall(r'"([^"\n]*)"', aliases[1]) if aliases else []
    others += [model[1]] if model and is_shipped else []
    return _ProfileNames(path.stem, shown[1] if shown else "", tuple(others), is_shipped)


def find_profile_by_display_name(kind: str, name: str, folders: Sequence[Path] = ()) -> str:
    """Return the name that selects the profile with a given display name; empty if there is no such profile."""
    for typed, path in find_profile_paths(kind, folders).items():
        if read_display_name(path) == name:
            return typed
    return ""
