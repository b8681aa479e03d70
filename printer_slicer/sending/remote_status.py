"""The status of a printer behind a print server."""

from __future__ import annotations

from typing import Any, Literal

from printer_slicer.values import Struct

__all__ = ["RemoteState", "RemoteStatus", "parse_share"]

RemoteState = Literal["idle", "printing", "paused", "offline", "error"]


class RemoteStatus(Struct, frozen=True):
    """The status of a printer behind a print server.

    Attributes:
        state: what the printer does; `offline` if the server is not connected to it.
        file: path of the file that it prints, or has printed last; empty if unknown.
        share: share of the file that was printed, 0 to 1; None if unknown.
        is_complete: whether the file was printed to its end; None while it is printed, or if unknown.
        message: what the server says about its state; empty if nothing.
    """

    state: RemoteState
    file: str = ""
    share: float | None = None
    is_complete: bool | None = None
    message: str = ""


def parse_share(value: Any, whole: float = 1.0) -> float | None:
    """Return a share from 0 to 1 of a number that is `whole` at the end; None if the value is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return min(max(value / whole, 0.0), 1.0)
