"""In which line of a TOML file a key is set; the library that reads them does not tell."""

from __future__ import annotations

import re
from collections.abc import Iterator

__all__ = ["key_lines"]

_KEY = r"(?:[A-Za-z0-9_-]+|\"[^\"\n]*\"|'[^'\n]*')"
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*\[\[?[ \t]*({_DOTTED})[ \t]*\]\]?")
_SETTING = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# What may hold line breaks or signs that mean nothing there, and the brackets between which breaks mean nothing.
_WORD = re.compile(
    r'"""(?:\\.|(?!""")[\s\S])*"""+|\'\'\'[\s\S]*?\'\'\'+|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|[\[{]|[\]}]|\n'
)


def key_lines(text: str) -> dict[str, int]:
    """Dotted key, or table -> the line, from 1, where it is first named, of the text of a valid TOML file.

    Tables of a list `[[many]]` are `many[0]`, `many[1]` and so on, and `many` is where the list begins. Keys of tables
    between braces are not told apart from their table.
    """
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    table = ""
    for start, statement in _statements(text):
        header, setting = _HEADER.match(statement), _SETTING.match(statement)
        line = text.count("\n", 0, start) + 1
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
