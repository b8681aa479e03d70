"""Compare names as people type them: without maker, nozzle, hyphens or capital letters."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

__all__ = ["ENDS_ALIKE", "IN_ORDER", "match_rank", "name_words", "without_nozzle"]

_WORD: Final = re.compile(r"[^\W\d_]+|\d+")
_NOZZLE: Final = re.compile(r",?\s*\(?\b\d+(?:\.\d+)?\s*(?:mm\s*)?nozzle\)?", re.IGNORECASE)

_EXACT, ENDS_ALIKE, _CONTAINS, IN_ORDER, _BEGINNINGS = range(5)


def name_words(text: str, *, with_nozzle: bool = False) -> list[str]:
    """Split a name into lower-case words and numbers: `Ender3 V2` and `Ender-3 v2` are the same.

    Args:
        text: the name.
        with_nozzle: whether to keep the diameter of a nozzle.
    """
    text = text.casefold()
    return _WORD.findall(text if with_nozzle else without_nozzle(text))


def without_nozzle(name: str) -> str:
    """Return a name without the diameter of a nozzle, such as `Ender-3 (0.4 mm nozzle)`."""
    return _NOZZLE.sub("", name).strip()


def match_rank(asked: Sequence[str], words: Sequence[str]) -> tuple[int, int] | None:
    """Rank how well a name matches typed words; lower is better, None is no match.

    Args:
        asked: words that were typed.
        words: words of the name.

    Returns:
        How the words match (equal; equal but for words in front, such as the maker: `ENDS_ALIKE`; contained together;
        contained in the same order; beginnings of words in the same order), and how many words the name has more.
    """
    size, more = len(asked), len(words) - len(asked)
    if not asked or more < 0:
        return None
    if list(words) == list(asked):
        return _EXACT, 0
    starts = [i for i in range(more + 1) if list(words[i : i + size]) == list(asked)]
    if starts:
        return (ENDS_ALIKE if starts[-1] == more else _CONTAINS), more
    left = iter(words)
    if all(word in left for word in asked):
        return IN_ORDER, more
    left = iter(words)
    is_begun = all(any(one.startswith(word) for one in left) for word in asked)
    return (_BEGINNINGS, more) if is_begun else None
