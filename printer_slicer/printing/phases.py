"""Where a print is between running and waiting, and wishes on their way.

phase       leads to
running     leaving (pause), stopping (pause now)
stopping    leaving, when the printer has said where it stopped
leaving     waiting, when it is off the part
waiting     returning (resume)
returning   running, when it is back at its place
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from printer_slicer.errors import UsageError
from printer_slicer.printing.wishes import Wish

__all__ = ["PrintPhase", "Ticket"]


class PrintPhase(Enum):
    """Where a print is between running and waiting."""

    RUNNING = "printing"
    STOPPING = "stopping"
    LEAVING = "parking"
    WAITING = "paused"
    RETURNING = "returning"


@dataclass(slots=True)
class Ticket:
    """A wish on its way.

    Attributes:
        wish: what is wanted.
        done: called with what became of it: words for a person, or the error.
    """

    wish: Wish
    done: Callable[[str | UsageError], None] = lambda _: None
