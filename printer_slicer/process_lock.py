"""A lock file that one process holds, and that the system releases when the process ends."""

from __future__ import annotations

from pathlib import Path
from typing import Final

__all__ = ["ProcessLock"]

_POLL_INTERVAL: Final = 0.01  # s


class ProcessLock:
    """A lock that at most one process holds. Any thread of the process may release it.

    Args:
        path: the lock file, which is created; its folder exists.
    """

    def __init__(self, path: Path) -> None:
        from filelock import FileLock  # noqa: PLC0415 - slow

        self._lock = FileLock(path, mode=0o600, thread_local=False)

    def acquire(self, timeout: float = 0.0) -> bool:
        """Lock the file for this process; return False if another process holds it for longer than `timeout`, s.

        Raises:
            OSError: the lock is not a file.
        """
        from filelock import Timeout  # noqa: PLC0415 - slow

        try:
            self._lock.acquire(timeout=timeout, poll_interval=_POLL_INTERVAL)
        except Timeout:
            return False
        return True

    def release(self) -> None:
        """Release the lock."""
        self._lock.release()

    def is_held(self) -> bool:
        """Return whether another process holds the lock at this moment.

        Raises:
            OSError: the lock is not a file.
        """
        if not self.acquire():
            return True
        self.release()
        return False
