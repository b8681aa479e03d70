"""Faults written down in a small TOML file, and what is said of a file that cannot be used.

seed = 7                  # optional; --seed goes before it

[[fault]]
kind = "flip"             # see the table in `faults`
rate = 1e-4

[[fault]]
kind = "hang"
line = 1500               # or layer, z, time; without one of them from the beginning
seconds = 5
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from math import inf, isfinite
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.sim.faults import KINDS, Fault
from printer_slicer.toml_text import TomlError, parse_toml

__all__ = ["read_script"]

_WAYS: Final = ("to printer", "to host", "both")
_KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("flip", "drop", "insert", "duplicate"), ("rate", "count", "way", "seconds")),
    "burst": ("bytes", "way"),
    "lose_reply": ("rate", "count", "seconds"),
    "disconnect": ("seconds",),
    "hang": ("seconds",),
    "brown_out": (),
    "heater": ("heater", "state", "seconds"),
    "sensor": ("heater", "reads", "seconds"),
    "endstop": ("axis", "seconds"),
    "clog": ("share", "seconds"),
    "runout": (),
}
"""What can be said of each kind, besides when."""

_NEEDED: Final[Mapping[str, str]] = {
    **dict.fromkeys(("flip", "drop", "insert", "duplicate"), "rate"),
    "heater": "state",
    "sensor": "reads",
}
_MOMENTS: Final = ("line", "layer", "z", "time")


def _number(low: float, high: float, *, whole: bool = False) -> tuple[str, Callable[[Any], bool]]:
    """A number between two: what it is in words, and whether a value is one."""
    kinds = (int,) if whole else (int, float)
    words = f"a {'whole ' if whole else ''}number from {low:g} to {high:g}"
    return (
        words,
        lambda value: (
            isinstance(value, kinds)
            and not isinstance(value, bool)
            and isfinite(value)
            and low <= value <= high
        ),
    )


def _one_of(*names: str) -> tuple[str, Callable[[Any], bool]]:
    """One of some words."""
    return "one of " + ", ".join(f'"{name}"' for name in names), lambda value: value in names


_VALUES: Final[Mapping[str, tuple[str, Callable[[Any], bool]]]] = {
    "line": _number(0, 1e9, whole=True),
    "layer": _number(1, 1e6, whole=True),
    "z": _number(0, 1e4),
    "time": _number(0, 1e8),
    "seconds": _number(0, 1e8),
    "rate": _number(0, 1),
    "count": _number(1, 1e9, whole=True),
    "bytes": _number(1, 1e6, whole=True),
    "way": _one_of(*_WAYS),
    "heater": _one_of("bed", *(f"E{n}" for n in range(10))),
    "state": _one_of("off", "on"),
    "reads": _number(-300, 2000),
    "axis": _one_of("x", "y", "z"),
    "share": _number(0, 1),
}


def read_script(text: str, name: str) -> tuple[list[Fault], int | None]:
    """The faults of a script, in order, and its seed if it names one.

    Args:
        text: TOML.
        name: of the file, for messages.

    Raises:
        UsageError: it cannot be used; says where, and what would be right.
    """
    try:
        script = parse_toml(text)
    except TomlError as error:
        raise UsageError(
            f"{name} is no TOML: {error}", remedy="look at that line; text stands in quotes"
        ) from error
    for key in script.keys() - {"fault", "seed"}:
        raise UsageError(
            f"{name}: {key} is unknown", remedy=_meant(key, ("seed", "fault"), "known are seed and [[fault]]")
        )
    seed = script.get("seed")
    if seed is not None and (not isinstance(seed, int) or isinstance(seed, bool)):
        raise UsageError(f"{name}: seed is {seed!r}", remedy="a seed is a whole number")
    faults = script.get("fault", [])
    if not isinstance(faults, list) or not all(isinstance(one, dict) for one in faults):
        raise UsageError(
            f"{name}: fault is no list of tables", remedy="begin each fault with a line [[fault]]"
        )
    return [_fault(one, f"{name}: fault {n}") for n, one in enumerate(faults, start=1)], seed


def _fault(keys: dict[str, Any], place: str) -> Fault:
    """One fault, checked."""
    kind = keys.get("kind")
    if kind is None:
        raise UsageError(f"{place}: kind is missing", remedy=f"kinds are {', '.join(KINDS)}")
    if kind not in KINDS:
        raise UsageError(
            f"{place}: kind is {kind!r}", remedy=_meant(str(kind), KINDS, f"kinds are {', '.join(KINDS)}")
        )
    known = (*_MOMENTS, *_KEYS[kind])
    place = f"{place} ({kind})"
    for key, value in keys.items():
        if key != "kind":
            _check(key, value, known, place)
    moments = [key for key in _MOMENTS if key in keys]
    if len(moments) > 1:
        raise UsageError(
            f"{place}: {moments[0]} and {moments[1]}", remedy="say one moment: line, layer, z or time"
        )
    needed = _NEEDED.get(kind)
    if needed is not None and needed not in keys:
        raise UsageError(f"{place}: {needed} is missing", remedy=f"{needed} is {_VALUES[needed][0]}")
    lasting = {"seconds": keys.get("seconds", inf)} if "seconds" in known else {}
    return Fault(**{**keys, **lasting})


def _check(key: str, value: object, known: tuple[str, ...], place: str) -> None:
    """Whether a key may stand there, with this value."""
    if key not in known:
        raise UsageError(
            f"{place}: {key} is unknown", remedy=_meant(key, known, f"known are kind, {', '.join(known)}")
        )
    words, right = _VALUES[key]
    if not right(value):
        raise UsageError(f"{place}: {key} is {value!r}", remedy=f"{key} is {words}")


def _meant(word: str, known: tuple[str, ...], otherwise: str) -> str:
    """What a person may have meant."""
    close = get_close_matches(word, known, n=1)
    return f"did you mean {close[0]}? {otherwise}" if close else otherwise
