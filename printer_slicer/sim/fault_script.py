"""Read fault scripts, which are TOML files that list the faults to inject.

seed = 7                  # optional; --seed overrides it

[[fault]]
kind = "flip"             # see the table in `faults`
rate = 1e-4

[[fault]]
kind = "hang"
line = 1500               # or layer, z or time; without any of them, the fault acts from the start
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
"""Keys of each kind of fault, besides the keys that say when the fault starts."""

_REQUIRED_KEY: Final[Mapping[str, str]] = {
    **dict.fromkeys(("flip", "drop", "insert", "duplicate"), "rate"),
    "heater": "state",
    "sensor": "temperature",
}
_OLD_NAMES: Final[Mapping[str, str]] = {"way": "direction", "reads": "temperature"}
"""Names that keys had until version 0.2, with their present names."""
_START_KEYS: Final = ("line", "layer", "z", "time")


def _make_number_check(low: float, high: float, *, whole: bool = False) -> tuple[str, Callable[[Any], bool]]:
    """Return a description of the numbers within bounds, and a function that checks a number."""
    kinds = (int,) if whole else (int, float)
    description = f"a {'whole ' if whole else ''}number from {low:g} to {high:g}"
    return (
        description,
        lambda value: (
            isinstance(value, kinds)
            and not isinstance(value, bool)
            and isfinite(value)
            and low <= value <= high
        ),
    )


def _make_choice_check(*names: str) -> tuple[str, Callable[[Any], bool]]:
    """Return a description of the allowed words, and a function that checks a word."""
    return "one of " + ", ".join(f'"{name}"' for name in names), lambda value: value in names


_VALUE_CHECKS: Final[Mapping[str, tuple[str, Callable[[Any], bool]]]] = {
    "line": _make_number_check(0, 1e9, whole=True),
    "layer": _make_number_check(1, 1e6, whole=True),
    "z": _make_number_check(0, 1e4),
    "time": _make_number_check(0, 1e8),
    "seconds": _make_number_check(0, 1e8),
    "rate": _make_number_check(0, 1),
    "count": _make_number_check(1, 1e9, whole=True),
    "bytes": _make_number_check(1, 1e6, whole=True),
    "direction": _make_choice_check(*_DIRECTIONS),
    "heater": _make_choice_check("bed", *(f"E{n}" for n in range(10))),
    "state": _make_choice_check("off", "on"),
    "temperature": _make_number_check(-300, 2000),
    "axis": _make_choice_check("x", "y", "z"),
    "share": _make_number_check(0, 1),
}


def read_script(text: str, name: str) -> tuple[list[Fault], int | None]:
    """Return the faults of a script in their order, and the random seed of the script or None.

    Args:
        text: text of the script, TOML.
        name: name of the file, for messages.

    Raises:
        UsageError: the script is invalid; the message says where, and the remedy says what is valid.
    """
    try:
        script = parse_toml(text)
    except TomlError as error:
        raise UsageError(
            f"{name} is not TOML: {error}", remedy="Check that line; text values need quotes"
        ) from error
    for key in script.keys() - {"fault", "seed"}:
        raise UsageError(
            f"{name}: unknown key {key}",
            remedy=_suggest_word(key, ("seed", "fault"), "Known keys: seed, [[fault]]"),
        )
    seed = script.get("seed")
    if seed is not None and (not isinstance(seed, int) or isinstance(seed, bool)):
        raise UsageError(f"{name}: seed is {seed!r}, which is not an integer", remedy="Use an integer")
    faults = script.get("fault", [])
    if not isinstance(faults, list) or not all(isinstance(one, dict) for one in faults):
        raise UsageError(
            f"{name}: fault is not a list of tables", remedy="Start each fault with the line [[fault]]"
        )
    return [_parse_fault(one, f"{name}: fault {n}") for n, one in enumerate(faults, start=1)], seed


def _parse_fault(keys: dict[str, Any], place: str) -> Fault:
    """Check the keys of one fault and return it."""
    keys = {_OLD_NAMES.get(key, key): value for key, value in keys.items()}
    kind = keys.get("kind")
    if kind is None:
        raise UsageError(f"{place}: kind is missing", remedy=f"Kinds: {', '.join(KINDS)}")
    if kind not in KINDS:
        raise UsageError(
            f"{place}: unknown kind {kind!r}",
            remedy=_suggest_word(str(kind), KINDS, f"Kinds: {', '.join(KINDS)}"),
        )
    known = (*_START_KEYS, *_KEYS[kind])
    place = f"{place} ({kind})"
    for key, value in keys.items():
        if key != "kind":
            _check_key(key, value, known, place)
    moments = [key for key in _START_KEYS if key in keys]
    if len(moments) > 1:
        raise UsageError(
            f"{place}: {moments[0]} and {moments[1]} exclude each other",
            remedy="Use only one of line, layer, z and time",
        )
    required = _REQUIRED_KEY.get(kind)
    if required is not None and required not in keys:
        raise UsageError(
            f"{place}: {required} is missing", remedy=f"{required} is {_VALUE_CHECKS[required][0]}"
        )
    lasting = {"seconds": keys.get("seconds", inf)} if "seconds" in known else {}
    return Fault(**{**keys, **lasting})


def _check_key(key: str, value: object, known: tuple[str, ...], place: str) -> None:
    """Raise an error if a key of a fault is unknown or its value is invalid."""
    if key not in known:
        raise UsageError(
            f"{place}: unknown key {key}",
            remedy=_suggest_word(key, known, f"Known keys: kind, {', '.join(known)}"),
        )
    description, is_valid = _VALUE_CHECKS[key]
    if not is_valid(value):
        raise UsageError(f"{place}: {key} is {value!r}", remedy=f"{key} is {description}")


def _suggest_word(word: str, known: tuple[str, ...], otherwise: str) -> str:
    """Return a remedy that suggests the closest known word; return `otherwise` if no word is close."""
    close = get_close_matches(word, known, n=1)
    return f"Did you mean {close[0]}? {otherwise}" if close else otherwise
