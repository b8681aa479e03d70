"""The interface between a simulated printer and the faults injected into it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

__all__ = ["FaultInjector"]


class FaultInjector(Protocol):
    """Injects faults into a printer at given times; see `faults.Faults`.

    Attributes:
        due: time of the next fault that depends on time only, s.
    """

    due: float

    def take(self, printer: Any) -> None:
        """Attach to a printer."""

    def watch(self, on_executed: Callable[[str], None] | None) -> Callable[[str], None]:
        """Wrap the callback for executed commands to detect faults tied to lines or layers."""

    def strike(self, now: float) -> None:
        """Inject all faults that are due."""
