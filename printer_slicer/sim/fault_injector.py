"""The interface between a simulated printer and the faults injected into it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

__all__ = ["FaultInjector"]


class FaultInjector(Protocol):
    """Injects faults into a simulated printer; implemented by `faults.Faults`.

    Attributes:
        due: time of the next fault that starts at a given time, s.
    """

    due: float

    def attach_to(self, printer: Any) -> None:
        """Connect these faults to the printer that they act on."""

    def wrap_callback(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Return a callback for executed commands that also detects faults that must start now."""

    def inject_due_faults(self, now: float) -> None:
        """Inject all faults whose start time has come at `now`, s."""
