"""The printer's questions to a person, put together from `//action:prompt_...`, and the host's for temperatures."""

from __future__ import annotations

from math import inf
from typing import Any, Final

from printer_slicer.stream.events import Identified, Prompt, Reading, Temperature

__all__ = ["REPORT", "Prompts", "Thermometer"]

REPORT: Final = b"M155 S2"
"""Tells a firmware that can to report temperatures by itself."""

_POLL: Final = 5.0
"""s between two questions for temperatures, where the firmware does not report them by itself."""


class Prompts:
    """Attributes: `shown` is the question that waits for an answer, None without one."""

    def __init__(self) -> None:
        self.shown: Prompt | None = None
        self._text = ""
        self._buttons: list[str] = []

    def as_json(self) -> dict[str, Any]:
        """For the status."""
        shown = self.shown
        return {"prompt": {"text": shown.text, "buttons": shown.buttons} if shown else None}

    def hear(self, word: str, rest: str) -> Prompt | None:
        """One action of the printer; what a person shall see now, an empty prompt when the question is over."""
        if word == "prompt_begin":
            self._text, self._buttons = rest, []
        elif word in {"prompt_choice", "prompt_button"}:
            self._buttons.append(rest)
        elif word == "prompt_show":
            self.shown = Prompt(self._text, tuple(self._buttons))
            return self.shown
        elif word == "prompt_end" and self.shown:
            self.shown = None
            return Prompt("", ())
        return None


class Thermometer:
    """When to ask for temperatures.

    Attributes:
        readings: as reported last.
        due: when to ask, s; infinite where that is not needed.
    """

    def __init__(self) -> None:
        self.readings: tuple[Reading, ...] = ()
        self.due = inf
        self._reports = False

    def as_json(self) -> dict[str, Any]:
        """For the status."""
        return {"temperatures": {one.name: [one.actual, one.target] for one in self.readings}}

    def identified(self, who: Identified, now: float) -> bool:
        """Who the printer is; whether to tell it to report by itself."""
        self._reports = who.can("AUTOREPORT_TEMP")
        self.wait(now)
        return self._reports

    def read(self, temperature: Temperature, now: float) -> None:
        """A report came."""
        self.readings = temperature.readings
        self.wait(now)

    def wait(self, now: float) -> None:
        """Ask later."""
        self.due = inf if self._reports else now + _POLL
