"""A G-code text as commands, one after the other, and what its comments say between them."""

from __future__ import annotations

import errno
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Final, overload

from printer_slicer.errors import UsageError
from printer_slicer.gcode.lexer import strip
from printer_slicer.input_files import read_input
from printer_slicer.stream.framing import check_commands

__all__ = ["Commands", "GcodeText", "check_sendable", "lines_of", "read_text", "split_gcode"]

_MOST_BYTES: Final = 1 << 29  # of G-code
_AT_ONCE: Final = 1 << 19  # bytes of a text that are taken apart together
_ALWAYS_FITS: Final = 60  # bytes: shorter commands need no closer look
_MOVES: Final = frozenset({b"G1 ", b"G0 "})
_BLANK: Final = ord(" ")
_BREAK: Final = b"\n"
_ROLES: Final = (b"TYPE:", b" FEATURE:")
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"


class Commands(Sequence[bytes]):
    """The commands of a text, read from it when somebody asks: they take no memory beside it.

    Without comments, blanks around them, line numbers and checksums.

    Args:
        text: G-code.
        begins: (byte, command) at which pieces of the text begin, and its end.
    """

    __slots__ = ("_begins", "_firsts", "_piece", "_some", "_text")

    def __init__(self, text: bytes, begins: Sequence[tuple[int, int]]) -> None:
        self._text = text
        self._begins = tuple(place for place, _ in begins)
        self._firsts = tuple(first for _, first in begins)
        self._piece, self._some = -1, list[bytes]()

    def __len__(self) -> int:
        return self._firsts[-1]

    @overload
    def __getitem__(self, which: int) -> bytes: ...
    @overload
    def __getitem__(self, which: slice) -> list[bytes]: ...
    def __getitem__(self, which: int | slice) -> bytes | list[bytes]:
        if isinstance(which, slice):
            first, last, step = which.indices(len(self))
            return self._between(first, last) if step == 1 else [self[at] for at in range(first, last, step)]
        at = which + len(self) if which < 0 else which
        if not 0 <= at < len(self):
            raise IndexError(which)
        piece = self._piece_of(at)
        return self._read(piece)[at - self._firsts[piece]]

    def __iter__(self) -> Iterator[bytes]:
        return chain.from_iterable(map(self._read, range(len(self._begins) - 1)))

    def __repr__(self) -> str:
        return f"<{len(self)} commands>"

    def _piece_of(self, at: int) -> int:
        """Which piece holds a command."""
        return bisect_right(self._firsts, at) - 1

    def _between(self, first: int, last: int) -> list[bytes]:
        """Commands that follow each other."""
        found: list[bytes] = []
        while first < last:
            piece = self._piece_of(first)
            begin = self._firsts[piece]
            found += self._read(piece)[first - begin : last - begin]
            first = self._firsts[piece + 1]
        return found

    def _read(self, piece: int) -> list[bytes]:
        """The commands of a piece; those that were read last are kept, for mostly they are wanted one by one."""
        if piece != self._piece:
            lines = self._text[self._begins[piece] : self._begins[piece + 1]].split(_BREAK)
            self._some = list(filter(None, _stripped(lines)))
            self._piece = piece
        return self._some


def _stripped(lines: list[bytes]) -> list[bytes]:
    """The command in each line, empty where there is none; nine lines of ten are moves with nothing to take off."""
    return [
        line if line[:3] in _MOVES and b";" not in line and line[-1] > _BLANK else strip(line)
        for line in lines
    ]


@dataclass(frozen=True, slots=True, eq=False)
class GcodeText:
    """What a text holds.

    Attributes:
        commands: one after the other.
        marks: command index -> layer counted from 1, from `;LAYER_CHANGE` or `;LAYER:` comments.
        roles: command index -> what beads are called from there on, from `;TYPE:` or `; FEATURE:` comments.
        odd: commands that are long, or hold what ends a line.
    """

    commands: Commands
    marks: dict[int, int]
    roles: dict[int, str]
    odd: list[int]


def split_gcode(text: bytes, piece: int = _AT_ONCE) -> GcodeText:
    """What a G-code text holds.

    Args:
        text: with line breaks of any kind.
        piece: bytes that are taken apart together.
    """
    marks: dict[int, int] = {}
    roles: dict[int, str] = {}
    begins: list[tuple[int, int]] = []
    odd: list[int] = []
    count = layer = 0
    kinds: tuple[bytes, ...] = (b"LAYER_CHANGE", b"LAYER:")
    for place, lines in _pieces(text, piece):
        begins.append((place, count))
        commands = _stripped(lines)
        for before, index in enumerate(index for index, command in enumerate(commands) if not command):
            _, _, comment = lines[index].partition(b";")
            if comment.startswith(_ROLES):
                roles[count + index - before] = comment.partition(b":")[2].decode("utf-8", "replace").strip()
            elif comment.startswith(kinds):
                kinds = tuple(kind for kind in kinds if comment.startswith(kind))  # some files hold both
                layer += 1
                marks[count + index - before] = layer
        commands = list(filter(None, commands))
        odd += [count + index for index in _odd(commands)]
        count += len(commands)
    return GcodeText(Commands(text, [*begins, (len(text), count)]), marks, roles, odd)


def _odd(commands: list[bytes]) -> Iterator[int]:
    """Commands that are long, or hold what ends a line."""
    everything = b"".join(commands)
    if b"\r" in everything or b"\0" in everything or max(map(len, commands), default=0) > _ALWAYS_FITS:
        for index, command in enumerate(commands):
            if len(command) > _ALWAYS_FITS or b"\r" in command or b"\0" in command:
                yield index


def _pieces(text: bytes, size: int) -> Iterator[tuple[int, list[bytes]]]:
    """The lines of a text, some at a time, and where these begin."""
    at = len(_BYTE_ORDER_MARK) if text.startswith(_BYTE_ORDER_MARK) else 0
    while at < len(text):
        end = text.find(_BREAK, at + size) + 1 or len(text)
        yield at, text[at:end].split(_BREAK)
        at = end


def check_sendable(name: str, text: bytes, told: GcodeText) -> None:
    """Look for a command that no printer can get.

    Raises:
        UsageError: there is one; it names the line of the text.
    """
    for index in told.odd:
        try:
            check_commands([told.commands[index]])
        except UsageError as error:
            what = str(error).splitlines()[0].removeprefix("line 1 ")
            line = lines_of(text, [index])[0]
            raise UsageError(f"{name}: line {line} {what}", remedy=error.remedy) from None


def lines_of(text: bytes, commands: Sequence[int], piece: int = _AT_ONCE) -> list[int]:
    """The lines of a text, counted from 1, that hold its commands with these indices; 0 where there is none."""
    wanted, found = set(commands), dict.fromkeys(commands, 0)
    done = index = 0
    for _, lines in _pieces(text, piece):
        if not wanted:
            break
        for number, command in enumerate(_stripped(lines), done + 1):
            if command:
                if index in wanted:
                    found[index] = number
                    wanted.remove(index)
                index += 1
        done += len(lines) - 1  # behind the last break of a piece nothing is left
    return [found[one] for one in commands]


def read_text(path: Path) -> bytes:
    """The bytes of a G-code file.

    Raises:
        UsageError: it is not there, or cannot be read.
    """
    try:
        return read_input(path, _MOST_BYTES)
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file", remedy="check the path") from None
    except IsADirectoryError:
        raise UsageError(f"{path}: is a folder", remedy="name a file in it") from None
    except TimeoutError as error:
        raise UsageError(
            f"{path}: {error.strerror}", remedy="start the program that writes to it first"
        ) from None
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            raise UsageError(
                f"{path}: longer than {_MOST_BYTES >> 20} MiB, the limit for G-code",
                remedy="print the part in pieces, or with thicker layers",
            ) from None
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path}: cannot be read: {reason}", remedy="check name and permissions") from None
