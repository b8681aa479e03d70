"""A memory card in the printer: files, the one that is printed, the one that is written.

Names are kept in capitals, as on the cards' own file system, and looked for without regard to case.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["CAPACITY", "SdCard", "shortened"]

CAPACITY: Final = 256 * 1024 * 1024
"""Bytes that a card holds: what is written beyond is lost, and told."""


class SdCard:
    """A card, and what the firmware does with it.

    Attributes:
        files: contents by name, in the order in which they came.
        present: the firmware has the card in use.
        selected: name of the file that M23 chose; empty for none.
        at: bytes of it that were read.
        printing: lines are taken from it.
        writing: name of the file that lines are written to; empty for none.
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
        """Choose a file for printing; whether there is one of this name."""
        self.stop()
        self.selected = name if self.present and name in self.files else ""
        self.at = 0
        return bool(self.selected)

    def stop(self) -> None:
        """Print no more of it for now."""
        self.printing = False

    def next(self) -> str | None:
        """The next command of the file that is printed, without comment; None at its end."""
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
        """Write what comes to a file."""
        self.writing = name
        self._written = []
        self._room = CAPACITY - sum(map(len, self.files.values()))

    def write(self, text: str) -> bool:
        """One more line of it; False when the card is full."""
        if self._room <= len(text):
            return False
        self._room -= len(text) + 1
        self._written.append(text)
        return True

    def end(self) -> None:
        """The file is complete."""
        text = "".join(f"{line}\n" for line in self._written)
        self.files[self.writing] = text.encode("latin-1")
        self.writing = ""
        self._written = []


def shortened(name: str) -> str:
    """A name as a card keeps it: capitals, eight letters and three."""
    # Only ASCII letters have a capital that is one byte as well.
    plain = "".join(letter.upper() if letter.isascii() else "_" for letter in name.rpartition("/")[2])
    stem, dot, kind = plain.replace(" ", "").rpartition(".")
    return f"{stem[:8]}.{kind[:3]}" if dot else kind[:8]
