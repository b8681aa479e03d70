"""What may be wanted of a print, and what it comes to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from printer_slicer.printing.controls import Controls
from printer_slicer.stream.events import Event
from printer_slicer.stream.link_meter import LinkSeen

__all__ = ["Done", "Listen", "Options"]

Listen = Callable[[Event], None]


@dataclass(frozen=True, slots=True)
class Done:
    """A print that came to its end.

    Attributes:
        commands: of the job, all acknowledged.
        seconds: from the first byte to the last answer.
        verified: the printer says that it is where the job ends; None where it cannot be compared.
        link: what the cable was like.
    """

    commands: int
    seconds: float
    verified: bool | None
    link: LinkSeen


class Options(TypedDict, total=False):
    """What may be wanted of a print besides job and port; see `print_job`."""

    on_event: Listen
    checkpoint: Path | None
    controls: Controls | None
    shelf: Path | None
    discard: bool
    reconnect: float
    dtr: bool | None
    allow: Callable[[bytes], str]
    guard: float | None
