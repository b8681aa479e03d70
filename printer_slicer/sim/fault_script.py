"""Read fault scripts: TOML files with faults to inject.

seed = 7                  # optional; --seed overrides it

[[fault]]
kind = "flip"             # see the table in `faults`
rate = 1e-4

[[fault]]
kind = "hang"
line = 1500               # or layer, z, time; without any of them from the start
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

_DIRECTIONS: Final = ("to printer", "to host", "both")
_KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("flip", "drop", "insert", "duplicate"), ("rate", "count", "direction", "seconds")),
    "burst": ("bytes", "direction"),
    "lose_reply": ("rate", "count", "seconds"),
    "disconnect": ("seconds",),
    "hang": ("seconds",),
    "brown_out": (),
    "heater": ("heater", "state", "seconds"),
    "sensor": ("heater", "temperature", "seconds"),
    "endstop": ("axis", "seconds"),
    "clog": ("share", "seconds"),
    "runout": (),
}
"""Keys of each kind, besides its start."""

_NEEDED: Final[Mapping[str, str]] = {
    **dict.fromkeys(("flip", "drop", "insert", "duplicate"), "rate"),
    "heater": "state",
    "sensor": "temperature",
}
_OLD_NAMES: Final[Mapping[str, str]] = {"way": "direction", "reads": "temperature"}
"""Names of keys until version 0.2."""
_MOMENTS: Final = ("line", "layer", "z", "time")


def _number(low: float, high: float, *, whole: bool = False) -> tuple[str, Callable[[Any], bool]]:
    """Return the description and the check of a number within bounds."""
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
    """Return the description and the check of a choice of words."""
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
    "direction": _one_of(*_DIRECTIONS),
    "heater": _one_of("bed", *(f"E{n}" for n in range(10))),
    "state": _one_of("off", "on"),
    "temperature": _number(-300, 2000),
    "axis": _one_of("x", "y", "z"),
    "share": _number(0, 1),
}


def read_script(text: str, name: str) -> tuple[list[Fault], int | None]:
    """Return the faults of a script, in order, and its seed if it has one.

    Args:
        text: TOML.
        name: of the file, for messages.

    Raises:
        UsageError: the script is invalid; the message says where, and what is valid.
    """
    try:
        script = parse_toml(text)
    except TomlError as error:
        raise UsageError(
            f"{name} is not TOML: {error}", remedy="Check that line; text needs quotes"
        ) from error
    for key in script.keys() - {"fault", "seed"}:
        raise UsageError(
            f"{name}: unknown key {key}",
            remedy=_suggest(key, ("seed", "fault"), "Known keys: seed, [[fault]]"),
        )
    seed = script.get("seed")
    if seed is not None and (not isinstance(seed, int) or isinstance(seed, bool)):
        raise UsageError(f"{name}: seed is {seed!r}", remedy="Use an integer")
    faults = script.get("fault", [])
    if not isinstance(faults, list) or not all(isinstance(one, dict) for one in faults):
        raise UsageError(
            f"{name}: fault is not a list of tables", remedy="Start each fault with a line [[fault]]"
        )
    return [_fault(one, f"{name}: fault {n}") for n, one in enumerate(faults, start=1)], seed


def _fault(keys: dict[str, Any], place: str) -> Fault:
    """Return one fault after checking its keys."""
    keys = {_OLD_NAMES.get(key, key): value for key, value in keys.items()}
    kind = keys.get("kind")
    if kind is None:
        raise UsageError(f"{place}: kind is missing", remedy=f"Kinds: {', '.join(KINDS)}")
    if kind not in KINDS:
        raise UsageError(
            f"{place}: unknown kind {kind!r}", remedy=_suggest(str(kind), KINDS, f"Kinds: {', '.join(KINDS)}")
        )
    known = (*_MOMENTS, *_KEYS[kind])
    place = f"{place} ({kind})"
    for key, value in keys.items():
        if key != "kind":
            _check(key, value, known, place)
    moments = [key for key in _MOMENTS if key in keys]
    if len(moments) > 1:
        raise UsageError(
            f"{place}: both {moments[0]} and {moments[1]}", remedy="Use only one of line, layer, z and time"
        )
    needed = _NEEDED.get(kind)
    if needed is not None and needed not in keys:
        raise UsageError(f"{place}: {needed} is missing", remedy=f"{needed} is {_VALUES[needed][0]}")
    lasting = {"seconds": keys.get("seconds", inf)} if "seconds" in known else {}
    return Fault(**{**keys, **lasting})


def _check(key: str, value: object, known: tuple[str, ...], place: str) -> None:
    """Check a key of a fault and its value."""
    if key not in known:
        raise UsageError(
            f"{place}: unknown key {key}",
            remedy=_suggest(key, known, f"Known keys: kind, {', '.join(known)}"),
        )
    words, right = _VALUES[key]
    if not right(value):
        raise UsageError(f"{place}: {key} is {value!r}", remedy=f"{key} is {words}")


def _suggest(word: str, known: tuple[str, ...], otherwise: str) -> str:
    """Return a remedy with the closest known word."""
    close = get_close_matches(word, known, n=1)
    return f"Did you mean {close[0]}? {otherwise}" if close else otherwise
