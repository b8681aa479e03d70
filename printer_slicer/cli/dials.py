"""Flags that are short names of settings; what they mean is what the settings say, read when somebody asks."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final, NamedTuple

from printer_slicer.cli.values import seconds

__all__ = ["DIALS", "Dial", "add_dials"]

OPTIMAL: Final = " (--planner optimal)"


class Dial(NamedTuple):
    """A flag: the setting that it stands for, what is typed, and what is to be told beside the setting's meaning."""

    setting: str
    metavar: str
    more: str = ""

    @property
    def help(self) -> str:
        """What it means, from where the setting is declared."""
        meaning, choices = _meanings()[self.setting]
        return meaning + (f": {choices}" if choices else "") + self.more


DIALS: Final[Mapping[str, Dial]] = {
    "--layer-height": Dial("quality.layer_height", "MM", "; ranges may have their own layer_height"),
    "--planner": Dial("quality.planner.kind", "NAME"),
    "--tolerance": Dial("quality.tolerance", "MM"),
    "--first-layer": Dial("quality.first_layer_height", "MM"),
    "--containment": Dial("quality.containment", "NAME"),
    "--objective": Dial("quality.planner.objective", "NAME", OPTIMAL),
    "--error-price": Dial("quality.planner.error_price", "S", OPTIMAL),
    "--snap": Dial("quality.planner.snap_tolerance", "MM", OPTIMAL),
    "--max-step": Dial("quality.planner.max_step", "MM", OPTIMAL),
    "--max-layers": Dial("quality.planner.max_layers", "N", OPTIMAL),
    "--time-budget": Dial("quality.planner.time_budget", "TIME", ", as 90m, 1h30m, 5400" + OPTIMAL),
}
_READERS: Final[Mapping[str, Callable[[str], object]]] = {"--time-budget": seconds}


@cache
def _meanings() -> Mapping[str, tuple[str, str]]:
    """Setting -> meaning, and the words of which it is one; settings of a planner without its name."""
    from printer_slicer.profile.tables import settings_table

    rows = [row for row in settings_table() if "[" not in row.key or "[optimal]" in row.key]
    return {row.key.replace("[optimal]", ""): (row.meaning, row.choices) for row in rows}


class _Lazy(argparse._StoreAction):  # noqa: SLF001 - what `action="store"` is has no other name
    """A flag whose help is made when it is read: parsing need not load the settings."""

    def __init__(self, *given: Any, dial: Dial, **named: Any) -> None:
        self._dial = dial
        super().__init__(*given, **named)

    @property
    def help(self) -> str:
        """What --help says."""
        return self._dial.help.replace("%", "%%")

    @help.setter  # noqa: A003 - argparse's name for it
    def help(self, _: object) -> None:
        """Stays what the setting says."""


def add_dials(parser: argparse.ArgumentParser) -> None:
    """Flags that decide where layers end, and what differs from place to place."""
    group = parser.add_argument_group("layer heights")
    for flag, dial in DIALS.items():
        group.add_argument(
            flag,
            action=_Lazy,
            dial=dial,
            metavar=dial.metavar,
            dest=f"dial {dial.setting}",
            type=_READERS.get(flag, str),
        )
    group.add_argument(
        "--heights",
        metavar="LIST",
        dest="dial heights",
        help="the only heights: 0.1,0.2,0.3 or LOW:HIGH or LOW:HIGH:STEP, in mm",
    )
    group = parser.add_argument_group("places of their own")
    group.add_argument(
        "--range",
        metavar="LOW:HIGH:KEY=VALUE",
        action="append",
        default=[],
        help="between two heights in mm another setting, or tolerance=MM or layer_height=MM; may be repeated",
    )
    group.add_argument(
        "--set-for",
        metavar="OBJECT:KEY=VALUE",
        action="append",
        default=[],
        help="another setting for one of several objects; may be repeated",
    )
