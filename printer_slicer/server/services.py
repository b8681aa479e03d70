"""What all requests share: the queue, the keys, the worker processes and the settings of the server."""

from __future__ import annotations

from pathlib import Path

from printer_slicer.print_queue import PrintQueue
from printer_slicer.server.access import AccessStore
from printer_slicer.server.guard import GuardSettings
from printer_slicer.server.slicing import Slicer
from printer_slicer.server.workers import FileReader

__all__ = ["Services"]


class Services:
    """What all requests share.

    Args:
        queue: files, jobs and printers.
        access: keys and sessions.
        guard: accepted hosts and origins.
        job_store: folder with one folder for each print, where its control socket is.
    """

    def __init__(self, queue: PrintQueue, access: AccessStore, guard: GuardSettings, job_store: Path) -> None:
        self.queue, self.access, self.guard, self.job_store = queue, access, guard, job_store
        self.reader = FileReader(queue)
        self.slicer = Slicer(queue, self.reader)

    def close(self) -> None:
        """Cancel what is being sliced, and close the databases."""
        self.slicer.close()
        self.queue.close()
        self.access.close()
