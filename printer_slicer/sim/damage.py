"""What a bad cable does to bytes, at random."""

from __future__ import annotations

from typing import Literal, Protocol

__all__ = ["Chance", "Damage", "Direction"]

Direction = Literal["to printer", "to host"]


class Chance(Protocol):
    """A source of chance, such as a seeded `random.Random`."""

    def random(self) -> float:
        """A number from 0 to below 1."""

    def randrange(self, stop: int, /) -> int:
        """A whole number from 0 to below `stop`."""


class Damage:
    """Bytes flipped, dropped and inserted at random.

    Every byte is hit independently of all others, so several can be hit in one line, and nothing comes in
    bursts; no byte is repeated, delayed or overtaken, and a written chunk is never lost as a whole. A flip
    turns one of the eight bits, an insertion puts any of the 256 bytes in front. The checksum of a line is
    one exclusive or: two flips of the same bit, or two equal bytes lost, pass it, so altered lines can be
    executed; how many to expect follows from the rates.

    Attributes:
        flipped, dropped, inserted: how many bytes so far, both directions together.
    """

    def __init__(self, chance: Chance, *, flip: float = 0.0, drop: float = 0.0, insert: float = 0.0) -> None:
        self.flipped = self.dropped = self.inserted = 0
        self._chance = chance
        self._flip = flip
        self._drop = drop
        self._insert = insert

    def __call__(self, data: bytes, direction: Direction) -> bytes:
        """What arrives of `data`; both directions are treated alike."""
        del direction
        whole = self._flip + self._drop + self._insert
        out = bytearray()
        for byte in data:
            drawn = self._chance.random()
            if drawn >= whole:
                out.append(byte)
            elif drawn < self._flip:
                self.flipped += 1
                out.append(byte ^ 1 << self._chance.randrange(8))
            elif drawn < self._flip + self._drop:
                self.dropped += 1
            else:
                self.inserted += 1
                out += bytes((self._chance.randrange(256), byte))
        return bytes(out)
