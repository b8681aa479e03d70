"""Compare names as people type them: the maker, the nozzle, hyphens and capital letters do not matter."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

__all__ = ["AT_THE_END", "EXACT", "IN_ORDER", "rank_match", "remove_nozzle", "split_name"]

_WORD: Final = re.compile(r"[^\W\d_]+|\d+")
_NOZZLE: Final = re.compile(r",?\s*\(?\b\d+(?:\.\d+)?\s*(?:mm\s*)?nozzle\)?", re.IGNORECASE)

EXACT, AT_THE_END, _CONTAINS, IN_ORDER, _PREFIXES = range(5)


def split_name(text: str, *, with_nozzle: bool = False) -> list[str]:
    """Split a name into lower-case words and numbers, so that `Ender3 V2` and `Ender-3 v2` give the same list.

    Args:
        text: the name.
        with_nozzle: whether to keep the diameter of a nozzle.
    """
    text = text.casefold()
    return _WORD.findall(text if with_nozzle else remove_nozzle(text))


def remove_nozzle(name: str) -> str:
    """Remove the nozzle diameter from a name: `Ender-3 (0.4 mm nozzle)` becomes `Ender-3`."""
    return _NOZZLE.sub("", name).strip()


def rank_match(typed: Sequence[str], words: Sequence[str]) -> tuple[int, int] | None:
    """Rank how well a name matches typed words; a lower rank is better, None means no match.

    Args:
        typed: words that were typed.
        words: words of the name.

    Returns:
        The kind of match and the number of additional words in the name. The kinds, best first: all words are equal
        (`EXACT`); the name ends with the typed words, after the maker for example (`AT_THE_END`); it contains them
        side by side; it contains them in this order (`IN_ORDER`); they are the beginnings of words in this order.
    """
    size, more = len(typed), len(words) - len(typed)
    if not typed or more < 0:
        return None
    if list(words) == list(typed):
        return EXACT, 0
    starts = [i for i in range(more + 1) if list(words[i : i + size]) == list(typed)]
    if starts:
        return (AT_THE_END if starts[-1] == more else _CONTAINS), more
    left = iter(words)
    if all(word in left for word in typed):
        return IN_ORDER, more
    left = iter(words)
    is_begun = all(any(one.startswith(word) for one in left) for word in typed)
    return (_PREFIXES, more) if is_begun else None
