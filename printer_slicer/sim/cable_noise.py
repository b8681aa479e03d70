"""Random transmission errors on a cable."""

from __future__ import annotations

from typing import Literal, Protocol

__all__ = ["CableNoise", "Direction", "RandomSource"]

Direction = Literal["to printer", "to host"]


class RandomSource(Protocol):
    """A random number generator, such as a seeded `random.Random`."""

    def random(self) -> float:
        """Return a random number from 0 (inclusive) to 1 (exclusive)."""

    def randrange(self, stop: int, /) -> int:
        """Return a random integer from 0 to `stop` - 1."""


class CableNoise:
    """Adds random errors to the bytes on a cable: flipped bits, lost bytes and inserted bytes.

    Each byte is affected independently. Bytes are never repeated, delayed or reordered. A flip inverts one bit. An
    insertion adds a random byte before a byte. The line checksum is a plain XOR. It does not detect two flips of the
    same bit or the loss of two equal bytes, so damaged lines can be executed.

    Attributes:
        flipped, dropped, inserted: number of flipped, dropped and inserted bytes so far, in both directions.
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
        """Return `data` with random errors; the error rates are equal in both directions of the cable."""
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
