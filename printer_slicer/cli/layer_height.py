"""A layer height on the command line: which planner it selects and which options contradict it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NoReturn

from printer_slicer.cli.dials import DIALS
from printer_slicer.errors import UsageError

__all__ = ["apply_layer_height"]

_RANGES: Final = ("planner.ranges", "planner.ranges+", "ranges")


def apply_layer_height(changes: dict[str, object]) -> None:
    """Select the planner for a layer height: uniform, or optimal if ranges have a layer height of their own.

    Args:
        changes: setting -> value from the command line; the planner and its heights are added.

    Raises:
        UsageError: the named planner, one of its settings or a list of heights contradicts the layer height.
    """
    named = {key.removeprefix("quality."): value for key, value in changes.items()}
    if "layer_height" not in named:
        return
    height = named["layer_height"]
    if listed := named.get("layer_heights"):
        raise UsageError(
            f"layer height {height}: uniform layers have one height, --heights {listed} names others",
            remedy="leave out one of the two",
        )
    ranged = any(key in named for key in _RANGES)
    planner = named.get("planner.kind")
    against = list(_contradictions(changes))
    fits = "optimal" if ranged else "uniform"
    if against or planner not in (None, fits):
        _refuse(height, planner, against, fits)
    changes["quality.planner.kind"] = fits
    if ranged:
        changes["quality.layer_heights"] = height


def _contradictions(changes: Mapping[str, object]) -> Iterator[str]:
    """Yield the options for planners that choose heights; ranges with a layer height of their own do not count."""
    from printer_slicer.profile.planners import PLANNER_SETTINGS
    from printer_slicer.profile.quality import Quality

    flags = {dial.setting: flag for flag, dial in DIALS.items()}
    own = {name for kind in PLANNER_SETTINGS.values() for name in kind.__struct_fields__}
    own -= set(Quality.__struct_fields__)
    for key, value in changes.items():
        short = key.removeprefix("quality.")
        if short in _RANGES:
            if "tolerance" in str(value):
                yield f"--range {value}" if key.endswith("+") else f"--set {key}"
        elif short in own or (short.startswith("planner.") and short != "planner.kind"):
            yield flags.get(key, f"--set {key}")


def _refuse(height: object, planner: object, against: list[str], fits: str) -> NoReturn:
    """Report what contradicts the layer height.

    Raises:
        UsageError: always.
    """
    if not against and fits == "optimal":
        raise UsageError(
            f"layer height {height}: the {planner} planner has no ranges; only --planner optimal has",
            remedy=f"leave out --planner {planner}",
        )
    if not against:
        raise UsageError(
            f"layer height {height}: the {planner} planner chooses heights itself; only --planner uniform takes one",
            remedy=f"leave out one of the two, or limit the heights: --heights 0.1:{height}",
        )
    others = [*([f"--planner {planner}"] if planner not in (None, "uniform") else []), *against]
    rest = "the layer height, or all the others" if len(others) > 1 else f"{others[0]}, or the layer height"
    raise UsageError(
        f"layer height {height} and {', '.join(others)} contradict each other: layers are either uniform or chosen by "
        "a planner",
        remedy=f"leave out {rest}; --heights 0.1:{height} limits chosen heights, --range LOW:HIGH:layer_height=MM sets "
        "another height in part of a print",
    )
