"""Faults of cables and firmwares; each is a function of the bytes on their way, drawn from a seed."""

from __future__ import annotations

import re
from random import Random  # noqa: TID251 - seeded

from benchmarks.wire_lab import Fault
from printer_slicer.sim.link import CableNoise, Direction

__all__ = [
    "doubled_oks",
    "flip_bytes",
    "garbage",
    "glued_oks",
    "inserted_newlines",
    "lost_newlines",
    "lost_oks",
    "noise_burst",
    "pieces",
    "repeated_requests",
]

_OK = re.compile(rb"ok[^\n]*\n")
_REQUEST = re.compile(rb"(?:Resend:|rs )[^\n]*\n")


def flip_bytes(chance: Random, way: Direction, *, flip: float = 0.0, drop: float = 0.0) -> Fault:
    """Flip or drop bytes in one direction."""
    damage = CableNoise(chance, flip=flip, drop=drop)
    return lambda data, direction: damage(data, direction) if direction == way else data


def _replace_some(chance: Random, way: Direction, share: float, old: bytes, new: bytes) -> Fault:
    """Replace `old` by `new` in a share of the places."""

    def fault(data: bytes, direction: Direction) -> bytes:
        if direction != way or old not in data:
            return data
        parts = data.split(old)
        out = parts[0]
        for part in parts[1:]:
            out += (new if chance.random() < share else old) + part
        return out

    return fault


def lost_newlines(chance: Random) -> Fault:
    """Lose one line break to the printer in a hundred."""
    return _replace_some(chance, "to printer", 0.01, b"\n", b"")


def inserted_newlines(chance: Random) -> Fault:
    """Break one line in a hundred in two, but not between its number and its command.

    Between them, it would leave a line without a number. Most firmware executes such a line, and no host can prevent
    that.
    """

    def fault(data: bytes, way: Direction) -> bytes:
        at = chance.randrange(1, len(data) + 1)
        if way == "to host" or chance.random() > 0.01 or b" " in data[at - 1 : at + 1]:
            return data
        return data[:at] + b"\n" + data[at:]

    return fault


def _change_oks(chance: Random, share: float, change: bytes) -> Fault:
    """Replace a share of the oks by `change`, in which `@` stands for the ok."""

    def one(match: re.Match[bytes]) -> bytes:
        return change.replace(b"@", match[0]) if chance.random() < share else match[0]

    return lambda data, way: _OK.sub(one, data) if way == "to host" else data


def lost_oks(chance: Random) -> Fault:
    """Lose one ok in a hundred, with its line break."""
    return _change_oks(chance, 0.01, b"")


def doubled_oks(chance: Random) -> Fault:
    """Send one ok in fifty twice."""
    return _change_oks(chance, 0.02, b"@@")


def glued_oks(chance: Random) -> Fault:
    """Put one ok in fifty after other words, without a line break between them."""
    return _change_oks(chance, 0.02, b"echo:some words@")


def pieces(chance: Random) -> Fault:
    """Put a line break into the middle of one ok in a hundred."""
    return _change_oks(chance, 0.01, b"o\nk\n")


def garbage(chance: Random) -> Fault:
    """Insert a few random bytes in front of one answer in fifty."""

    def fault(data: bytes, way: Direction) -> bytes:
        if way == "to printer" or chance.random() > 0.02:
            return data
        return chance.randbytes(chance.randrange(1, 40)).replace(b"\n", b"?") + data

    return fault


def noise_burst(chance: Random) -> Fault:
    """Insert ten thousand bytes of noise in front of one answer in five hundred."""

    def fault(data: bytes, way: Direction) -> bytes:
        if way == "to printer" or chance.random() > 0.002:
            return data
        return chance.randbytes(10_000) + b"\n" + data

    return fault


def repeated_requests(chance: Random, times: int) -> Fault:
    """Damage bytes, and repeat every resend request several times."""
    damage = flip_bytes(chance, "to printer", flip=2e-4)

    def fault(data: bytes, way: Direction) -> bytes:
        if way == "to printer":
            return damage(data, way)
        return _REQUEST.sub(lambda match: match[0] * times, data)

    return fault
