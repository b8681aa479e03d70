"""Who else has a device open, as far as the system shows it; those of other people are not to be seen.

Source: Linux's documentation of /proc/PID/fd and /proc/PID/comm. Where there is no such thing, nobody is found.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["holders"]


def holders(device: str, proc: Path = Path("/proc")) -> Iterator[tuple[int, str]]:
    """Number and name of each other process that has a device open, named as links lead to it."""
    for folder in sorted(proc.glob("[0-9]*")):
        if folder.name == str(os.getpid()):
            continue
        # Processes come and go, and those of others do not show what they have open.
        with contextlib.suppress(OSError):
            if any(_leads(link, device) for link in (folder / "fd").iterdir()):
                yield int(folder.name), (folder / "comm").read_text(errors="replace").strip()


def _leads(link: Path, device: str) -> bool:
    try:
        return str(link.readlink()) == device
    except OSError:
        return False
