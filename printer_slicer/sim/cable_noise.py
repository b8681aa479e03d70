"""Random transmission errors of a cable."""

from __future__ import annotations

from typing import Literal, Protocol

__all__ = ["CableNoise", "Direction", "RandomSource"]

Direction = Literal["to printer", "to host"]


class RandomSource(Protocol):
    """A random number generator, such as a seeded `random.Random`."""

    def random(self) -> float:
        """Return a number from 0 to below 1."""

    def randrange(self, stop: int, /) -> int:
        """Return an integer from 0 to below `stop`."""


class CableNoise:
    """Random bit flips, lost bytes and inserted bytes.

    Each byte is affected independently. Bytes are never repeated, delayed or reordered. A flip inverts one bit, an
    insertion puts a random byte in front. The line checksum is a plain XOR: two flips of the same bit, or two lost
    equal bytes, are not detected, so altered lines can be executed.

    Attributes:
        flipped, dropped, inserted: number of bytes so far, both directions together.
    """

    def __init__(
        self, chance: RandomSource, *, flip: float = 0.0, drop: float = 0.0, insert: float = 0.0
    ) -> None:
        self.flipped = self.dropped = self.inserted = 0
        self._chance = chance
        self._flip = flip
        self._drop = drop
        self._insert = insert

    def __call__(self, data: bytes, direction: Direction) -> bytes:
        """Return what arrives of `data`; both directions are treated alike."""
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
