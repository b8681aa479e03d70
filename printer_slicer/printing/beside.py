"""What runs beside a print: the journal's way to the disk, the door for other processes, the guard of the heaters."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event as Flag
from threading import Thread

from printer_slicer.printing.controls import Controls
from printer_slicer.printing.journal import Journal
from printer_slicer.printing.shelf import Print

__all__ = ["answering", "guarded_by", "synced"]

_SYNC = 1.0
"""s between two times that the journal is brought to the disk."""


@contextmanager
def synced(journal: Journal) -> Iterator[None]:
    """Bring the journal to the disk once a second, where that delays no line."""
    stop = Flag()

    def work() -> None:
        """Until the print has ended."""
        while not stop.wait(_SYNC):
            journal.sync()

    thread = Thread(target=work, name="journal", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextmanager
def answering(print_: Print, controls: Controls) -> Iterator[None]:
    """Let other processes of this user have wishes."""
    from printer_slicer.printing.door import open_door  # noqa: PLC0415 - sockets are only needed here

    with open_door(print_.folder, controls, print_.name):
        yield


@contextmanager
def guarded_by(print_: Print, seconds: float) -> Iterator[None]:
    """Let the heaters go off if this process dies and nobody takes the print up within some seconds; 0: let them be."""
    if seconds <= 0:
        yield
        return
    from printer_slicer.printing.guard import guarded  # noqa: PLC0415 - another process is only needed here

    with guarded(print_.folder, seconds):
        yield
