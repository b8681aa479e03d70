"""What a simulated printer asks of whoever plants faults in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

__all__ = ["Trouble"]


class Trouble(Protocol):
    """Faults that wait for their moment: see `faults.Faults`.

    Attributes:
        due: when one strikes without the printer doing anything, s.
    """

    due: float

    def take(self, printer: Any) -> None:
        """Strike this printer."""

    def watch(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Something to call with each command that begins."""

    def strike(self, now: float) -> None:
        """Let everything strike whose time has come."""
