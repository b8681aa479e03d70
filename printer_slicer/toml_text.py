"""Parse untrusted TOML within limits, and find the lines of errors and keys.

Python's parser has no limits: a key of 20 000 parts takes gigabytes, nested brackets raise RecursionError,
and integers may have any number of digits.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, Final

__all__ = ["MAX_BYTES", "TomlError", "find_key_lines", "parse_toml"]

MAX_BYTES: Final = 1 << 20
"""Size limit of a file; the largest shipped profile has 10 kB."""
MAX_PARTS: Final = 32
"""Limit for the number of parts in a dotted key, and for the depth of nested tables or lists."""
LONGEST_KEY: Final = 200
LONGEST_TEXT: Final = 1 << 16
"""Limits for the lengths of keys and of text values, characters."""
LARGEST: Final = 2**63 - 1
"""Largest integer that TOML requires programs to read."""

_KEY = r"(?:[A-Za-z0-9_-]+|\"[^\"\n]*\"|'[^'\n]*')"
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*\[\[?[ \t]*({_DOTTED})[ \t]*\]\]?")
_SETTING = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# Strings, comments, brackets and line breaks: brackets inside strings and comments have no meaning, and neither have
# line breaks inside strings or between brackets.
_WORD = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+"{3,5}|\'\'\'(?:[^\']|\'(?!\'\'))*+\'{3,5}'
    r'|"(?:\\.|[^"\\\n])*+"|\'[^\'\n]*+\'|#[^\n]*+|[\[{]|[\]}]|\n',
    re.DOTALL,
)
_MANY_PARTS = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MAX_PARTS}}}")
_MANY_DIGITS = re.compile(r"(?:\d_?){4000}")


class TomlError(ValueError):
    """Raised when a TOML text is invalid or exceeds a limit.

    Attributes:
        line: line number, counted from 1.
        reason: the problem.
    """

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(f"line {line}: {reason}")
        self.line, self.reason = line, reason


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text.

    Raises:
        TomlError: the text is invalid or exceeds a limit: `MAX_BYTES` characters, `MAX_PARTS` of a key or
            nesting levels, `LONGEST_KEY`, `LONGEST_TEXT`, `LARGEST`.
    """
    if len(text) > MAX_BYTES:
        raise TomlError(1, f"over {MAX_BYTES} characters")
    if any(line.count(".") >= MAX_PARTS for line in text.splitlines()):
        _check_dotted_keys(text)
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason, _, place = str(error).partition(" (at ")
        found = re.match(r"line (\d+)", place)
        raise TomlError(int(found[1]) if found else text.count("\n") + 1, reason[:300]) from None
    except RecursionError:
        raise _make_nesting_error(_find_too_deep_line(text)) from None
    except ValueError:  # Python limits the digits of a number
        found = _MANY_DIGITS.search(text)
        raise _make_integer_error(text.count("\n", 0, found.start()) + 1 if found else 1) from None
    fault = _find_value_beyond_limits(values)
    if fault:
        key, reason = fault
        lines = find_key_lines(text)
        while key not in lines and "." in key:
            key = key.rpartition(".")[0]
        raise TomlError(lines.get(key, 1), reason)
    return values


def _make_nesting_error(line: int) -> TomlError:
    """Return the error for a text with too many levels."""
    return TomlError(line, f"more than {MAX_PARTS} nested tables or lists")


def _make_integer_error(line: int) -> TomlError:
    """Return the error for an integer that is too large."""
    return TomlError(line, f"an integer larger than {LARGEST}")


def _check_dotted_keys(text: str) -> None:
    """Reject keys with too many parts; called before parsing."""
    bare = _WORD.sub(lambda found: _blank_string_or_comment(found[0]), text)
    found = _MANY_PARTS.search(bare)
    if found:
        raise _make_nesting_error(bare.count("\n", 0, found.start()) + 1)


def _blank_string_or_comment(word: str) -> str:
    """Replace a string by `_` and a comment by nothing, without changing the number of lines."""
    return word if len(word) == 1 else "_" * (word[0] != "#") + "\n" * word.count("\n")


def _find_too_deep_line(text: str) -> int:
    """Return the number of the first line with too many open brackets."""
    depth = 0
    for found in _WORD.finditer(text):
        depth += (found[0] in "[{") - (found[0] in "]}")
        if depth > MAX_PARTS:
            return text.count("\n", 0, found.start()) + 1
    return 1


def _find_value_beyond_limits(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the dotted key of the first value that exceeds a limit, and the reason."""
    pending: list[tuple[str, int, Any]] = [("", 0, values)]
    while pending:
        key, depth, value = pending.pop()
        if depth > MAX_PARTS:
            return key, _make_nesting_error(1).reason
        if isinstance(value, dict):
            long = next((name for name in value if len(name) > LONGEST_KEY), None)
            if long is not None:
                return key, f"a key of {len(long)} characters; at most {LONGEST_KEY} are allowed"
            pending += [(f"{key}.{name}" if key else name, depth + 1, one) for name, one in value.items()]
        elif isinstance(value, list):
            pending += [(key, depth + 1, one) for one in value]
        elif isinstance(value, str) and len(value) > LONGEST_TEXT:
            return key, f"a string of {len(value)} characters; at most {LONGEST_TEXT} are allowed"
        elif isinstance(value, int) and not -LARGEST - 1 <= value <= LARGEST:
            return key, _make_integer_error(1).reason
    return None


def find_key_lines(text: str) -> dict[str, int]:
    """Map each dotted key and table of a valid TOML text to the line, from 1, where it is first named.

    Tables of a list `[[many]]` are called `many[0]`, `many[1]` and so on, and `many` is the line where the list begins.
    Keys of inline tables are not included.
    """
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    table, line, previous_start = "", 1, 0
    for start, statement in _split_statements(text):
        header, setting = _HEADER.match(statement), _SETTING.match(statement)
        line += text.count("\n", previous_start, start)
        previous_start = start
        if header:
            table = _add_list_indices(
                _normalize_key(header[1]), counts, new=statement.lstrip().startswith("[[")
            )
            lines.setdefault(_remove_list_index(table), line)
            lines.setdefault(table, line)
        elif setting:
            key = _normalize_key(setting[1])
            lines.setdefault(f"{table}.{key}" if table else key, line)
    return lines


def _add_list_indices(name: str, counts: dict[str, int], *, new: bool) -> str:
    """Return the name of a table with the indices of the lists that contain it.

    Args:
        name: name of the table, as in the file.
        counts: number of tables in each list so far; changed in place for a new table.
        new: whether this is a new table in the list of that name.
    """
    found, parts = "", name.split(".")
    for k, part in enumerate(parts):
        found = f"{found}.{part}" if found else part
        if new and k == len(parts) - 1:
            counts[found] = counts.get(found, 0) + 1
        found += f"[{counts[found] - 1}]" if found in counts else ""
    return found


def _remove_list_index(table: str) -> str:
    """Return the name of the list that a table belongs to; other names are returned unchanged."""
    return table.rpartition("[")[0] if table.endswith("]") else table


def _normalize_key(key: str) -> str:
    """Return a dotted key without quotes and spaces."""
    return ".".join(part.strip().strip("\"'") for part in re.findall(_KEY, key))


def _split_statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield the start position and the text of each statement; a statement may span several lines."""
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
