"""Commands taken apart as any firmware may read them: more suspicious than the reader of moves.

Case does not matter, blanks are free, and some firmwares execute a second command that stands in the same line. A
letter may come twice: then all its values count, for firmwares differ in which one they take.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

__all__ = ["LintCommand", "read_commands", "takes_text", "unusual"]

_NUMBER: Final = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_CODE: Final = re.compile(r"([GMTD]) *(-?[0-9]+)(?:\.[0-9]+)?")
_FURTHER: Final = re.compile(r"[GM] *[0-9]+")
_WORD: Final = re.compile(rf"([A-Z]) *({_NUMBER})?")
_SETTING: Final = re.compile(rf"\b([A-Z_][A-Z_0-9]*) *= *['\"]?({_NUMBER})?")
_NAME: Final = re.compile(r"@?[A-Z_][A-Z_0-9]+")
_QUOTED: Final = re.compile(r'"[^"]*"?')
_ASIDE: Final = re.compile(r"\([^)]*\)?")
_NUMBERED: Final = re.compile(r"N[0-9]+ *")
_EXPONENT: Final = re.compile(r"[0-9]E[-+]?[0-9]|0X[0-9A-F]")

_TEXTS: Final = frozenset(
    {"M16", "M23", "M28", "M30", "M32", "M33", "M36", "M37", "M38", "M98", "M117", "M118", "M291"}
    | {"M486", "M550", "M551", "M862", "M928", *(f"M{n}" for n in range(810, 820))}
)
"""Commands with free text behind them."""

_PLAIN_WORD: Final = r" *[XYZEFIJR] *[-+]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)"
_ORDINARY: Final = re.compile(rf"(?m)^(?!G[0-3](?:{_PLAIN_WORD})++ *$).+$".encode())
"""Matches a line that is not a plain move, or has a word that is not a letter and a number."""

_AT_ONCE: Final = 1 << 15


@dataclass(frozen=True, slots=True)
class LintCommand:
    """One command of a line.

    Attributes:
        code: letter and number, `M104`; of a command of words its name, `SET_PIN`; "" for anything else.
        text: the line it stands in, capitals.
        words: letter -> all its numbers, none for a letter alone.
        settings: NAME -> number, of NAME=number.
        further: whether it is not the first of its line.
        rest: the text after the code up to the next command, without quoted and bracketed texts.
    """

    code: str
    text: str
    words: dict[str, list[float]] = field(default_factory=dict)
    settings: dict[str, float] = field(default_factory=dict)
    further: bool = False
    rest: str = ""

    def most(self, letters: str) -> float | None:
        """The largest number behind any of the letters, None without one."""
        values = [value for letter in letters for value in self.words.get(letter, ())]
        return max(values, default=None)

    @property
    def vague(self) -> bool:
        """Whether its numbers may be read in more ways than one: expressions, exponents, hexadecimals."""
        return _is_vague(self.text)


@lru_cache(maxsize=8)
def _is_vague(text: str) -> bool:
    """Whether a line is; asked once for a line, however many commands stand in it."""
    return "{" in text or _EXPONENT.search(text) is not None


def unusual(commands: Sequence[bytes]) -> Iterator[tuple[int, bytes]]:
    """The commands that are no plain moves, and their places: looked for in many of them at once."""
    for begin in range(0, len(commands), _AT_ONCE):
        text = b"\n".join(commands[begin : begin + _AT_ONCE])
        index, at = begin, 0
        for found in _ORDINARY.finditer(text):
            index += text.count(b"\n", at, found.start())
            at = found.start()
            yield index, found.group()


def takes_text(code: str) -> bool:
    """Whether free text stands behind a command (M117)."""
    return code in _TEXTS


def read_commands(line: bytes) -> Iterator[LintCommand]:
    """The commands that firmware may find in a line."""
    text = line.decode("latin-1").strip().upper()
    text = _NUMBERED.sub("", text, count=1) if text.startswith("N") else text
    match = _CODE.match(text)
    if match is None:
        yield _of_words(text)
        return
    code = f"{match[1]}{int(match[2])}"
    rest = _ASIDE.sub(" ", _QUOTED.sub(" ", text[match.end() :]))
    if code in _TEXTS:
        yield LintCommand(code, text, _words(rest))
        return
    found = list(_FURTHER.finditer(rest))
    own = rest[: found[0].start()] if found else rest
    yield LintCommand(code, text, _words(own), rest=own)
    ends = [*(one.start() for one in found), len(rest)][1:]
    for one, end in zip(found, ends, strict=True):
        name = one.group().replace(" ", "")
        own = rest[one.end() : end]
        yield LintCommand(f"{name[0]}{int(name[1:])}", text, _words(own), further=True, rest=own)


def _words(text: str) -> dict[str, list[float]]:
    words: dict[str, list[float]] = {}
    for letter, number in _WORD.findall(text):
        values = words.setdefault(letter, [])
        if number:
            values.append(float(number))
    return words


def _of_words(text: str) -> LintCommand:
    """A command of words, or something that is none."""
    match = _NAME.match(text)
    settings = {name: float(number) for name, number in _SETTING.findall(text) if number}
    return LintCommand(match[0] if match else "", text, settings=settings)
