"""Find profiles by display name, by model, or by some words of these, in any spelling."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Final, NamedTuple

from printer_slicer.name_search import AT_THE_END, IN_ORDER, rank_match, split_name
from printer_slicer.profile.folders import profile_paths, profile_root

__all__ = ["ProfileMatch", "display_name", "find_profiles", "suggest_profiles"]

_NAME: Final = re.compile(r'^name = "([^"\n]*)"', re.MULTILINE)
_MODEL: Final = re.compile(r'^model = "([^"\n]*)"', re.MULTILINE)
_LEAST_SIMILARITY: Final = 0.8  # minimum similarity of a suggestion, 0 to 1
_MOST_SHOWN: Final = 5  # profiles in a message


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


def display_name(path: Path) -> str:
    """Return the `name` setting in a profile's file; empty if it is inherited."""
    return _read_names(path)[1]


def find_profiles(kind: str, text: str, folders: Sequence[Path] = ()) -> list[ProfileMatch]:
    """Return the profiles that match a text, the best match first.

    Args:
        kind: `printer`, `material` or `quality`.
        text: as typed, such as "Ender 3".
        folders: searched first.
    """
    query_words = split_name(text)
    known = {name: _read_names(path) for name, path in profile_paths(kind, folders).items()}
    ranked = []
    for name, names in known.items():
        ranks = [rank for one in names if (rank := rank_match(query_words, split_name(one)))]
        ranked += [(min(ranks), name)] if ranks else []
    ranked.sort()
    kinds = [rank[0] for rank, _ in ranked]
    is_only = len(kinds) == 1 and kinds[0] < IN_ORDER
    is_best = len(kinds) > 1 and kinds[0] <= AT_THE_END and kinds[1] > kinds[0]
    is_sure = (is_only or is_best) and any(word.isalpha() for word in query_words)
    return [
        ProfileMatch(name, known[name][1] or name, is_sure and i == 0) for i, (_, name) in enumerate(ranked)
    ]


def suggest_profiles(kind: str, text: str, folders: Sequence[Path] = ()) -> str:
    """Return a question ("Did you mean ...?") for a name that selects no profile; empty if none is similar."""
    matches = find_profiles(kind, text, folders)
    if matches:
        shown = [f"{one.name} ({one.display_name})" for one in matches[:_MOST_SHOWN]]
        more = " and more" if len(matches) > _MOST_SHOWN else ""
        return f"Did you mean {', '.join(shown)}{more}?"
    query_words, paths = split_name(text), profile_paths(kind, folders)
    contained = [
        (len(words), name)
        for name, path in paths.items()
        for words in map(split_name, _read_names(path))
        if len(words) > 1 and (rank := rank_match(words, query_words)) and rank[0] < IN_ORDER
    ]
    near = (
        [max(contained)[1]]
        if contained
        else get_close_matches(text.lower(), paths, n=1, cutoff=_LEAST_SIMILARITY)
    )
    return f"Did you mean {near[0]!r}?" if near else ""


def _read_names(path: Path) -> tuple[str, str, str]:
    """Read the display name and the model of a profile; return its file name, display name and model.

    Only the model of a shipped profile counts: an imported profile of the same machine must not make it ambiguous.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    shown, model = _NAME.search(text), _MODEL.search(text)
    is_shipped = path.parent.parent == profile_root()
    return path.stem, shown[1] if shown else "", model[1] if model and is_shipped else ""
