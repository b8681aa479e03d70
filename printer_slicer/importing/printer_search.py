"""Find a printer of a bundle by a name as people type it: without vendor, nozzle or hyphens."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Final

__all__ = ["find_printers", "without_nozzle"]

_NOZZLE: Final = re.compile(r"\s*\(?\b(\d+\.\d+)\s*(?:mm)?\s*nozzle\)?", re.IGNORECASE)
_WORD: Final = re.compile(r"[^\W\d_]+|\d+")
_Words = list[str]


def without_nozzle(name: str) -> str:
    """Return the name of a printer without its nozzle diameter.

    Args:
        name: such as `Creality Ender-3 V2 (0.4 mm nozzle)`.
    """
    return _NOZZLE.sub("", name).strip()


def find_printers(wanted: str, names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the printers that match a name best; empty if none does.

    Args:
        wanted: the name as typed.
        names: printer -> its other names, such as that of its model.
    """
    sought = _words(wanted)
    for full in (False, True):
        known = {
            printer: [_words(one if full else without_nozzle(one)) for one in (printer, *others)]
            for printer, others in names.items()
        }
        for matches in _MATCHES:
            found = [
                name for name, all_words in known.items() if any(matches(sought, one) for one in all_words)
            ]
            if sought and found:
                return found
    return []


def _words(text: str) -> _Words:
    """Split a name into words and numbers: `Ender3 V2` and `Ender-3 v2` are the same."""
    return _WORD.findall(text.casefold())


def _ends_with(sought: _Words, known: _Words) -> bool:
    return known[-len(sought) :] == sought


def _contains(sought: _Words, known: _Words) -> bool:
    return any(known[at : at + len(sought)] == sought for at in range(len(known)))


def _begins_words(sought: _Words, known: _Words) -> bool:
    return all(any(word.startswith(one) for word in known) for one in sought)


_MATCHES: Final[tuple[Callable[[_Words, _Words], bool], ...]] = (
    lambda sought, known: sought == known,
    _ends_with,
    _contains,
    _begins_words,
)
"""Ways in which a typed name matches, the best first."""
