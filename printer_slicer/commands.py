"""Split a G-code text into commands, and read layers and roles from its comments."""

from __future__ import annotations

import errno
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Final, overload

from printer_slicer.errors import UsageError
from printer_slicer.gcode.lexer import strip
from printer_slicer.input_files import read_input
from printer_slicer.stream.framing import check_commands
from printer_slicer.values import Struct

__all__ = [
    "Commands",
    "GcodeText",
    "check_sendable",
    "find_lines",
    "read_text",
    "reject_binary_gcode",
    "split_gcode",
]

_MAX_BYTES: Final = 1 << 29  # of G-code
_BLOCK_BYTES: Final = 1 << 19  # bytes of a text that are split at a time
_ALWAYS_FITS: Final = 60  # bytes; commands up to this length can always be sent
_MOVES: Final = frozenset({b"G1 ", b"G0 "})
_BLANK: Final = ord(" ")
_BREAK: Final = b"\n"
_ROLES: Final = (b"TYPE:", b" FEATURE:")
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"


class Commands(Sequence[bytes]):
    """The commands of a G-code text, without comments, surrounding blanks, line numbers and checksums.

    Commands are split off only when they are read, so they take no memory besides the text.

    Args:
        text: G-code.
        begins: (byte offset, command index) of the start of each block of the text, and of its end.
    """

    __slots__ = ("_block", "_block_commands", "_block_offsets", "_first_commands", "_text")

    def __init__(self, text: bytes, begins: Sequence[tuple[int, int]]) -> None:
        self._text = text
        self._block_offsets = tuple(place for place, _ in begins)
        self._first_commands = tuple(first for _, first in begins)
        self._block, self._block_commands = -1, list[bytes]()

    def __len__(self) -> int:
        return self._first_commands[-1]

    @overload
    def __getitem__(self, which: int) -> bytes: ...
    @overload
    def __getitem__(self, which: slice) -> list[bytes]: ...
    def __getitem__(self, which: int | slice) -> bytes | list[bytes]:
        if isinstance(which, slice):
            first, last, step = which.indices(len(self))
            return (
                self._read_range(first, last) if step == 1 else [self[at] for at in range(first, last, step)]
            )
        at = which + len(self) if which < 0 else which
        if not 0 <= at < len(self):
            raise IndexError(which)
        block = self._find_block(at)
        return self._read_block(block)[at - self._first_commands[block]]

    def __iter__(self) -> Iterator[bytes]:
        return chain.from_iterable(map(self._read_block, range(len(self._block_offsets) - 1)))

    def __repr__(self) -> str:
        return f"<{len(self)} commands>"

    def _find_block(self, at: int) -> int:
        """Return the block that contains a command."""
        return bisect_right(self._first_commands, at) - 1

    def _read_range(self, first: int, last: int) -> list[bytes]:
        """Return the commands from `first` up to `last`."""
        found: list[bytes] = []
        while first < last:
            block = self._find_block(first)
            begin = self._first_commands[block]
            found += self._read_block(block)[first - begin : last - begin]
            first = self._first_commands[block + 1]
        return found

    def _read_block(self, block: int) -> list[bytes]:
        """Return the commands of a block; the last block is cached, because commands are mostly read in order."""
        if block != self._block:
            lines = self._text[self._block_offsets[block] : self._block_offsets[block + 1]].split(_BREAK)
            self._block_commands = list(filter(None, _strip_lines(lines)))
            self._block = block
        return self._block_commands


def _strip_lines(lines: list[bytes]) -> list[bytes]:
    """Return the command in each line, empty if it has none.

    Nine of ten lines are plain moves; they need no `strip`.
    """
    return [
        line if line[:3] in _MOVES and b";" not in line and line[-1] > _BLANK else strip(line)
        for line in lines
    ]


class GcodeText(Struct, frozen=True, eq=False):
    """The commands of a G-code text, and the layers and roles that its comments name.

    Attributes:
        commands: in the order of the text.
        marks: command index -> layer counted from 1, from `;LAYER_CHANGE` or `;LAYER:` comments.
        roles: command index -> name of the role from there on, from `;TYPE:` or `; FEATURE:` comments.
        suspect: indices of commands that are long or contain a line break or zero byte.
    """

    commands: Commands
    marks: dict[int, int]
    roles: dict[int, str]
    suspect: list[int]


def split_gcode(text: bytes, block_bytes: int = _BLOCK_BYTES) -> GcodeText:
    """Split a G-code text into commands, and read the layers and roles in its comments.

    Args:
        text: with line breaks of any kind.
        block_bytes: number of bytes to process at a time.
    """
    marks: dict[int, int] = {}
    roles: dict[int, str] = {}
    begins: list[tuple[int, int]] = []
    suspect: list[int] = []
    count = layer = 0
    kinds: tuple[bytes, ...] = (b"LAYER_CHANGE", b"LAYER:")
    for place, lines in _split_into_blocks(text, block_bytes):
        begins.append((place, count))
        commands = _strip_lines(lines)
        for before, index in enumerate(index for index, command in enumerate(commands) if not command):
            _, _, comment = lines[index].partition(b";")
            if comment.startswith(_ROLES):
                roles[count + index - before] = comment.partition(b":")[2].decode("utf-8", "replace").strip()
            elif comment.startswith(kinds):
                kinds = tuple(kind for kind in kinds if comment.startswith(kind))  # some files have both
                layer += 1
                marks[count + index - before] = layer
        commands = list(filter(None, commands))
        suspect += [count + index for index in _find_suspect_commands(commands)]
        count += len(commands)
    return GcodeText(Commands(text, [*begins, (len(text), count)]), marks, roles, suspect)


def _find_suspect_commands(commands: list[bytes]) -> Iterator[int]:
    """Yield the indices of commands that are long or contain a line break or zero byte."""
    everything = b"".join(commands)
    if b"\r" in everything or b"\0" in everything or max(map(len, commands), default=0) > _ALWAYS_FITS:
        for index, command in enumerate(commands):
            if len(command) > _ALWAYS_FITS or b"\r" in command or b"\0" in command:
                yield index


def _split_into_blocks(text: bytes, size: int) -> Iterator[tuple[int, list[bytes]]]:
    """Yield the byte offset and the lines of each block of a text."""
    at = len(_BYTE_ORDER_MARK) if text.startswith(_BYTE_ORDER_MARK) else 0
    while at < len(text):
        end = text.find(_BREAK, at + size) + 1 or len(text)
        yield at, text[at:end].split(_BREAK)
        at = end


def check_sendable(name: str, text: bytes, split: GcodeText) -> None:
    """Check that every command can be sent over a serial line.

    Raises:
        UsageError: a command cannot be sent; the message names the line of the text.
    """
    for index in split.suspect:
        try:
            check_commands([split.commands[index]])
        except UsageError as error:
            what = str(error).splitlines()[0].removeprefix("line 1 ")
            line = find_lines(text, [index])[0]
            raise UsageError(f"{name}: line {line} {what}", remedy=error.remedy) from None


def find_lines(text: bytes, commands: Sequence[int], block_bytes: int = _BLOCK_BYTES) -> list[int]:
    """Return the line numbers, from 1, of the commands with these indices; 0 for an index out of range."""
    wanted, found = set(commands), dict.fromkeys(commands, 0)
    done = index = 0
    for _, lines in _split_into_blocks(text, block_bytes):
        if not wanted:
            break
        for number, command in enumerate(_strip_lines(lines), done + 1):
            if command:
                if index in wanted:
                    found[index] = number
                    wanted.remove(index)
                index += 1
        done += len(lines) - 1  # the text after the last line break of a block is empty
    return [found[one] for one in commands]


def reject_binary_gcode(text: bytes, name: str) -> None:
    """Reject the binary format of PrusaSlicer.

    Args:
        text: the file, or its beginning.
        name: name of the file, for the message.

    Raises:
        UsageError: the file is binary G-code.
    """
    if text.startswith(b"GCDE"):
        raise UsageError(
            f"{name}: this is binary G-code", remedy="Export plain G-code, or convert it with bgcode"
        )


def read_text(path: Path) -> bytes:
    """Read a G-code file.

    Raises:
        UsageError: the file is missing or cannot be read.
    """
    try:
        return read_input(path, _MAX_BYTES)
    except FileNotFoundError:
        raise UsageError(f"{path}: no such file", remedy="Check the path") from None
    except IsADirectoryError:
        raise UsageError(f"{path}: is a folder, not a file", remedy="Give the path of a file in it") from None
    except TimeoutError as error:
        raise UsageError(
            f"{path}: {error.strerror}", remedy="Start the program that writes to the pipe first"
        ) from None
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            raise UsageError(
                f"{path}: the file is longer than {_MAX_BYTES >> 20} MiB, the limit for G-code",
                remedy="Divide the part into several prints, or use thicker layers",
            ) from None
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path}: cannot be read: {reason}", remedy="Check name and permissions") from None
