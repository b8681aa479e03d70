"""The SD card of the simulated printer: its files, the one being printed, the one being written.

File names are stored in upper case, as on FAT, and searched without regard to case.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["CAPACITY", "SdCard", "shortened"]

CAPACITY: Final = 256 * 1024 * 1024
"""Bytes that a card holds; writing beyond is an error."""


class SdCard:
    """An SD card and its use by the firmware.

    Attributes:
        files: contents by name, in the order of their creation.
        present: whether the card is mounted.
        selected: file selected by M23; empty for none.
        at: bytes of it that were read.
        printing: whether the file is being printed.
        writing: file being written; empty for none.
    """

    def __init__(self, files: Mapping[str, bytes] | None = None) -> None:
        self.files = {shortened(name): bytes(data) for name, data in (files or {}).items()}
        self.present = True
        self.selected = self.writing = ""
        self.at = 0
        self.printing = False
        self._written: list[str] = []
        self._room = 0

    @property
    def size(self) -> int:
        """Bytes of the selected file."""
        return len(self.files.get(self.selected, b""))

    def select(self, name: str) -> bool:
        """Select a file for printing; return whether it exists."""
        self.stop()
        self.selected = name if self.present and name in self.files else ""
        self.at = 0
        return bool(self.selected)

    def stop(self) -> None:
        """Pause the print of the file."""
        self.printing = False

    def next(self) -> str | None:
        """Return the next command of the printed file, without comment; None at its end."""
        data = self.files.get(self.selected, b"")
        while self.printing and self.at < len(data):
            end = data.find(b"\n", self.at)
            end = len(data) if end < 0 else end
            line = data[self.at : end].partition(b";")[0].strip()
            self.at = min(end + 1, len(data))
            if line:
                return line.decode("latin-1")
        return None

    def begin(self, name: str) -> None:
        """Start writing a file."""
        self.writing = name
        self._written = []
        self._room = CAPACITY - sum(map(len, self.files.values()))

    def write(self, text: str) -> bool:
        """Write a line; return False if the card is full."""
        if self._room <= len(text):
            return False
        self._room -= len(text) + 1
        self._written.append(text)
        return True

    def end(self) -> None:
        """Finish writing the file."""
        text = "".join(f"{line}\n" for line in self._written)
        self.files[self.writing] = text.encode("latin-1")
        self.writing = ""
        self._written = []


def shortened(name: str) -> str:
    """Return a name in 8.3 form and upper case."""
    # Only ASCII letters have a capital that is one byte as well.
    plain = "".join(letter.upper() if letter.isascii() else "_" for letter in name.rpartition("/")[2])
    stem, dot, kind = plain.replace(" ", "").rpartition(".")
    return f"{stem[:8]}.{kind[:3]}" if dot else kind[:8]
