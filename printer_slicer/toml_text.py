"""TOML that anybody may have written: parsed within limits, with the line of every fault and of every key.

Python's parser has no limits: a key of 20 000 parts takes it gigabytes, brackets in brackets end in a RecursionError,
and whole numbers may have any number of digits.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, Final

__all__ = ["MOST_BYTES", "TomlError", "key_lines", "parse_toml"]

MOST_BYTES: Final = 1 << 20
"""Of a file; the longest one that is shipped has 10 kB."""
MOST_PARTS: Final = 32
"""Parts of a dotted key, and tables or lists in each other."""
LONGEST_KEY: Final = 200
LONGEST_TEXT: Final = 1 << 16
"""Characters of a key, and of a value."""
LARGEST: Final = 2**63 - 1
"""Whole number that TOML asks programs to read."""

_KEY = r"(?:[A-Za-z0-9_-]+|\"[^\"\n]*\"|'[^'\n]*')"
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*\[\[?[ \t]*({_DOTTED})[ \t]*\]\]?")
_SETTING = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# What may hold line breaks or signs that mean nothing there, and the brackets between which breaks mean nothing.
_WORD = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+"{3,5}|\'\'\'(?:[^\']|\'(?!\'\'))*+\'{3,5}'
    r'|"(?:\\.|[^"\\\n])*+"|\'[^\'\n]*+\'|#[^\n]*+|[\[{]|[\]}]|\n',
    re.DOTALL,
)
_MANY_PARTS = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}")
_MANY_DIGITS = re.compile(r"(?:\d_?){4000}")


class TomlError(ValueError):
    """What is wrong with a text.

    Attributes:
        line: from 1.
        reason: in words.
    """

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(f"line {line}: {reason}")
        self.line, self.reason = line, reason


def parse_toml(text: str) -> dict[str, Any]:
    """What a text means.

    Raises:
        TomlError: it is no TOML, or goes beyond a limit: `MOST_BYTES` characters, `MOST_PARTS` of a key or in each
            other, `LONGEST_KEY`, `LONGEST_TEXT`, `LARGEST`.
    """
    if len(text) > MOST_BYTES:
        raise TomlError(1, f"over {MOST_BYTES} characters")
    if any(line.count(".") >= MOST_PARTS for line in text.splitlines()):
        _check_dotted_keys(text)
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).partition(" (at ")
        found = re.match(r"line (\d+)", place)
        raise TomlError(int(found[1]) if found else text.count("\n") + 1, reason[:300]) from None
    except RecursionError:
        raise _too_deep(_line_of_depth(text)) from None
    except ValueError:  # of Python's limit of the digits of a number
        found = _MANY_DIGITS.search(text)
        raise _too_large(text.count("\n", 0, found.start()) + 1 if found else 1) from None
    fault = _beyond_limits(values)
    if fault:
        key, reason = fault
        lines = key_lines(text)
        while key not in lines and "." in key:
            key = key.rpartition(".")[0]
        raise TomlError(lines.get(key, 1), reason)
    return values


def _too_deep(line: int) -> TomlError:
    return TomlError(line, f"over {MOST_PARTS} tables or lists in each other")


def _too_large(line: int) -> TomlError:
    return TomlError(line, f"a whole number beyond {LARGEST}")


def _check_dotted_keys(text: str) -> None:
    """Refuse keys of many parts before they are parsed."""
    bare = _WORD.sub(lambda found: _without_meaning(found[0]), text)
    found = _MANY_PARTS.search(bare)
    if found:
        raise _too_deep(bare.count("\n", 0, found.start()) + 1)


def _without_meaning(word: str) -> str:
    """As many lines, with a key in place of a text and nothing in place of a comment."""
    return word if len(word) == 1 else "_" * (word[0] != "#") + "\n" * word.count("\n")


def _line_of_depth(text: str) -> int:
    """The line where too many brackets are open for the first time."""
    depth = 0
    for found in _WORD.finditer(text):
        depth += (found[0] in "[{") - (found[0] in "]}")
        if depth > MOST_PARTS:
            return text.count("\n", 0, found.start()) + 1
    return 1


def _beyond_limits(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """The dotted key of the first value that is beyond a limit, and what is wrong with it."""
    left: list[tuple[str, int, Any]] = [("", 0, values)]
    while left:
        key, depth, value = left.pop()
        if depth > MOST_PARTS:
            return key, _too_deep(1).reason
        if isinstance(value, dict):
            long = next((name for name in value if len(name) > LONGEST_KEY), None)
            if long is not None:
                return key, f"a key of {len(long)} characters; at most {LONGEST_KEY} are read"
            left += [(f"{key}.{name}" if key else name, depth + 1, one) for name, one in value.items()]
        elif isinstance(value, list):
            left += [(key, depth + 1, one) for one in value]
        elif isinstance(value, str) and len(value) > LONGEST_TEXT:
            return key, f"a text of {len(value)} characters; at most {LONGEST_TEXT} are read"
        elif isinstance(value, int) and not -LARGEST - 1 <= value <= LARGEST:
            return key, _too_large(1).reason
    return None


def key_lines(text: str) -> dict[str, int]:
    """Dotted key, or table -> the line, from 1, where it is first named, of the text of a valid TOML file.

    Tables of a list `[[many]]` are `many[0]`, `many[1]` and so on, and `many` is where the list begins. Keys of tables
    between braces are not told apart from their table.
    """
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    table, line, counted = "", 1, 0
    for start, statement in _statements(text):
        header, setting = _HEADER.match(statement), _SETTING.match(statement)
        line += text.count("\n", counted, start)
        counted = start
        if header:
            table = _numbered(_plain(header[1]), counts, new=statement.lstrip().startswith("[["))
            lines.setdefault(_listed(table), line)
            lines.setdefault(table, line)
        elif setting:
            key = _plain(setting[1])
            lines.setdefault(f"{table}.{key}" if table else key, line)
    return lines


def _numbered(name: str, counts: dict[str, int], *, new: bool) -> str:
    """The name of a table with the numbers of the lists that it is in: those of their last tables.

    Args:
        name: as it is written.
        counts: how many tables each list has by now; one more if there is a new one.
        new: whether this is one more table of a list of that name.
    """
    found, parts = "", name.split(".")
    for k, part in enumerate(parts):
        found = f"{found}.{part}" if found else part
        if new and k == len(parts) - 1:
            counts[found] = counts.get(found, 0) + 1
        found += f"[{counts[found] - 1}]" if found in counts else ""
    return found


def _listed(table: str) -> str:
    """The list of a table that is one of a list; another table as it is."""
    return table.rpartition("[")[0] if table.endswith("]") else table


def _plain(key: str) -> str:
    """A dotted key without quotes and blanks."""
    return ".".join(part.strip().strip("\"'") for part in re.findall(_KEY, key))


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Where each begins, and its text: a line, or several where a value goes over several."""
    begin, depth = 0, 0
    for word in _WORD.finditer(text):
        sign = word[0]
        if sign in "[{":
            depth += 1
        elif sign in "]}":
            depth = max(depth - 1, 0)
        elif sign == "\n" and depth == 0:
            yield begin, text[begin : word.start()]
            begin = word.end()
    yield begin, text[begin:]
