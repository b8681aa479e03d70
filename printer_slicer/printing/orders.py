"""Wishes that are one command each, in the words of the firmware."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.firmware import Firmware
from printer_slicer.printing import wishes
from printer_slicer.stream.events import Identified

__all__ = ["ORDERS", "order_of"]


def _baby_step(wish: wishes.BabyStep, firmware: Firmware, who: Identified | None) -> bytes:
    if who is not None and ("BABYSTEPPING", False) in who.capabilities:
        raise UsageError("this firmware has no baby-steps", remedy="build it with BABYSTEPPING")
    return firmware.baby_step_command(wish.mm)


ORDERS: Final[Mapping[type, Callable[[Any, Firmware, Identified | None], bytes]]] = {
    wishes.Speed: lambda wish, *_: b"M220 S%d" % round(wish.percent),
    wishes.Flow: lambda wish, *_: b"M221 S%d" % round(wish.percent),
    wishes.SetTemperature: lambda wish, *_: (
        {"nozzle": b"M104 S%g", "bed": b"M140 S%g"}[wish.heater] % wish.celsius
    ),
    wishes.SetFan: lambda wish, *_: b"M106 S%d" % round(wish.percent * 255 / 100),
    wishes.Say: lambda wish, *_: wish.command.encode("utf-8", "replace"),
    wishes.BabyStep: _baby_step,
}
"""Kind of wish to command: the wish, the firmware, and what it says that it can do."""


def order_of(wish: wishes.Wish, firmware: Firmware, who: Identified | None) -> bytes:
    """The command that grants a wish of one of these kinds.

    Raises:
        UsageError: the firmware cannot.
    """
    return ORDERS[type(wish)](wish, firmware, who)
