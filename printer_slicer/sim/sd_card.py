"""The SD card of the simulated printer: its files, and the print from one of them.

File names are stored in upper case, as on FAT, and searched without regard to case.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["CAPACITY", "SdCard", "shorten_file_name"]

CAPACITY: Final = 256 * 1024 * 1024
"""Capacity of a card, bytes; a write beyond it fails."""


class SdCard:
    """An SD card with files: one of them can be printed, and one can be written.

    Attributes:
        files: contents of the files by name, in the order of their creation.
        present: whether the card is mounted.
        selected: name of the file selected by M23; empty without one.
        at: number of bytes of this file that were read.
        printing: whether this file is being printed.
        writing: name of the file that is being written; empty without one.
    """

    def __init__(self, files: Mapping[str, bytes] | None = None) -> None:
        self.files = {shorten_file_name(name): bytes(data) for name, data in (files or {}).items()}
        self.present = True
        self.selected = self.writing = ""
        self.at = 0
        self.printing = False
        self._written: list[str] = []
        self._free_bytes = 0

    @property
    def size(self) -> int:
        """Size of the selected file, bytes."""
        return len(self.files.get(self.selected, b""))

    def select_file(self, name: str) -> bool:
        """Select a file for printing; return whether it exists."""
        self.stop()
        self.selected = name if self.present and name in self.files else ""
        self.at = 0
        return bool(self.selected)

    def stop(self) -> None:
        """Stop reading commands from the selected file."""
        self.printing = False

    def next_command(self) -> str | None:
        """Return the next command of the selected file, without comment; None at the end of the file."""
        data = self.files.get(self.selected, b"")
        while self.printing and self.at < len(data):
            end = data.find(b"\n", self.at)
            end = len(data) if end < 0 else end
            line = data[self.at : end].partition(b";")[0].strip()
            self.at = min(end + 1, len(data))
            if line:
                return line.decode("latin-1")
        return None

    def begin_file(self, name: str) -> None:
        """Create an empty file on the card and open it for writing."""
        self.writing = name
        self._written = []
        self._free_bytes = CAPACITY - sum(map(len, self.files.values()))

    def write_line(self, text: str) -> bool:
        """Write a line to the open file; return False if the card is full."""
        if self._free_bytes <= len(text):
            return False
        self._free_bytes -= len(text) + 1
        self._written.append(text)
        return True

    def end_file(self) -> None:
        """Close the file that is being written."""
        text = "".join(f"{line}\n" for line in self._written)
        self.files[self.writing] = text.encode("latin-1")
        self.writing = ""
        self._written = []


def shorten_file_name(name: str) -> str:
    """Return a file name in 8.3 form and upper case."""
    # Outside ASCII, the capital of a letter may not exist in Latin-1.
    plain = "".join(letter.upper() if letter.isascii() else "_" for letter in name.rpartition("/")[2])
    stem, dot, kind = plain.replace(" ", "").rpartition(".")
    return f"{stem[:8]}.{kind[:3]}" if dot else kind[:8]
