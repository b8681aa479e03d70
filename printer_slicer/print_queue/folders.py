"""Where the queue of this user is stored."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from printer_slicer.printing.job_store import default_job_store

__all__ = ["DATABASE_FILE", "default_queue_folder", "has_default_queue"]

DATABASE_FILE: Final = "queue.sqlite"
"""Name of the database in the folder of a queue."""


def default_queue_folder() -> Path:
    """Return the folder of the queue: beside the stored prints, see `default_job_store`."""
    return default_job_store().parent / "queue"


def has_default_queue() -> bool:
    """Return whether this user has a queue."""
    return (default_queue_folder() / DATABASE_FILE).is_file()
