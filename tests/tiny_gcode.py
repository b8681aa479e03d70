"""A minimal reader of G-code that shares no code with the package: one line at a time, floats, no arcs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

__all__ = ["Step", "body", "commands", "steps"]


@dataclass
class Step:
    """One move: where it ends, what was fed by then, and the comments and other commands before it."""

    command: str
    xyz: tuple[float, float, float]
    fed: float
    feed: float
    words: dict[str, float]
    notes: list[str] = field(default_factory=list)


def commands(text: bytes) -> list[bytes]:
    """Lines without comments and blanks."""
    stripped = (line.split(b";")[0].strip() for line in text.splitlines())
    return [line for line in stripped if line]


def body(text: bytes) -> bytes:
    """What lies between the start of counting and the settings: all of the moves if end G-code is empty."""
    return text.rpartition(b"\nG92 E0\n")[2].partition(b"; settings\n")[0]


def steps(text: bytes, start: tuple[float, float, float], *, relative: bool) -> Iterator[Step]:
    """The moves of a text that only says G0, G1 and comments, M104, M106, M107, M140."""
    x, y, z = start
    fed, feed = 0.0, 0.0
    notes: list[str] = []
    for line in text.decode("ascii").splitlines():
        code, _, rest = line.partition(" ")
        if code not in ("G0", "G1"):
            notes.append(line)
            continue
        words = {word[0]: float(word[1:]) for word in rest.split()}
        x, y, z = words.get("X", x), words.get("Y", y), words.get("Z", z)
        feed = words.get("F", feed)
        if "E" in words:
            fed = fed + words["E"] if relative else words["E"]
        yield Step(code, (x, y, z), fed, feed / 60, words, notes)
        notes = []
