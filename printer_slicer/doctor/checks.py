"""What was looked at, and what is made of it: plain values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["PortCheck"]


@dataclass(frozen=True, slots=True)
class PortCheck:
    """One thing that was looked at.

    Attributes:
        name: of it, such as `permission`.
        state: `good`; `warn` where a print may suffer; `bad` where none can begin.
        what: was found.
        remedy: what to do about it, "" where nothing needs to be done.
    """

    name: str
    state: Literal["good", "warn", "bad"]
    what: str
    remedy: str = ""
