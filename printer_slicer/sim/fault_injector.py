"""The interface between a simulated printer and the faults injected into it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

__all__ = ["FaultInjector"]


class FaultInjector(Protocol):
    """Injects faults into a printer at given times; see `faults.Faults`.

    Attributes:
        due: time of the next fault that starts at a given time, s.
    """

    due: float

    def attach_to(self, printer: Any) -> None:
        """Attach the faults to a printer."""

    def wrap_callback(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Return a callback for executed commands that also detects faults due at a line or layer."""

    def inject_due_faults(self, now: float) -> None:
        """Inject all faults that are due at `now`, s."""
