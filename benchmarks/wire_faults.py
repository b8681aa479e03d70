"""Faults of cables and firmwares, each a function of the bytes on their way, drawn from a seed."""

from __future__ import annotations

import re
from random import Random  # noqa: TID251 - seeded

from benchmarks.wire_lab import Fault
from printer_slicer.sim.link import CableNoise, Direction

__all__ = [
    "doubled_oks",
    "flips",
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


def flips(chance: Random, way: Direction, *, flip: float = 0.0, drop: float = 0.0) -> Fault:
    """Bytes flipped or dropped in one direction."""
    damage = CableNoise(chance, flip=flip, drop=drop)
    return lambda data, direction: damage(data, direction) if direction == way else data


def _changed(chance: Random, way: Direction, share: float, old: bytes, new: bytes) -> Fault:
    """A share of the places where `old` stands get `new` instead."""

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
    """One line break to the printer in a hundred is lost."""
    return _changed(chance, "to printer", 0.01, b"\n", b"")


def inserted_newlines(chance: Random) -> Fault:
    """One line in a hundred is broken in two, but not between its number and its command.

    There it would leave a line without number, which most firmware executes, and no host can prevent that.
    """

    def fault(data: bytes, way: Direction) -> bytes:
        at = chance.randrange(1, len(data) + 1)
        if way == "to host" or chance.random() > 0.01 or b" " in data[at - 1 : at + 1]:
            return data
        return data[:at] + b"\n" + data[at:]

    return fault


def _oks(chance: Random, share: float, change: bytes) -> Fault:
    """A share of the oks becomes `change`, in which `@` is the ok."""

    def one(match: re.Match[bytes]) -> bytes:
        return change.replace(b"@", match[0]) if chance.random() < share else match[0]

    return lambda data, way: _OK.sub(one, data) if way == "to host" else data


def lost_oks(chance: Random) -> Fault:
    """One ok in a hundred is lost, with its line break."""
    return _oks(chance, 0.01, b"")


def doubled_oks(chance: Random) -> Fault:
    """One ok in fifty comes twice."""
    return _oks(chance, 0.02, b"@@")


def glued_oks(chance: Random) -> Fault:
    """One ok in fifty stands behind other words, without a line break between."""
    return _oks(chance, 0.02, b"echo:some words@")


def pieces(chance: Random) -> Fault:
    """An ok in a hundred has its line break in the middle."""
    return _oks(chance, 0.01, b"o\nk\n")


def garbage(chance: Random) -> Fault:
    """A few bytes of anything in front of one answer in fifty."""

    def fault(data: bytes, way: Direction) -> bytes:
        if way == "to printer" or chance.random() > 0.02:
            return data
        return chance.randbytes(chance.randrange(1, 40)).replace(b"\n", b"?") + data

    return fault


def noise_burst(chance: Random) -> Fault:
    """Ten thousand bytes of noise in front of one answer in five hundred."""

    def fault(data: bytes, way: Direction) -> bytes:
        if way == "to printer" or chance.random() > 0.002:
            return data
        return chance.randbytes(10_000) + b"\n" + data

    return fault


def repeated_requests(chance: Random, times: int) -> Fault:
    """Damage, and every request for a line comes several times."""
    damage = flips(chance, "to printer", flip=2e-4)

    def fault(data: bytes, way: Direction) -> bytes:
        if way == "to printer":
            return damage(data, way)
        return _REQUEST.sub(lambda match: match[0] * times, data)

    return fault
