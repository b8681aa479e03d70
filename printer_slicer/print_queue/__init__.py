"""Queue of print jobs: which job starts on which printer, and only on a bed that a person has declared clear.

The queue owns no port. Each print is a process of its own, which outlives the supervisor that started it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.print_queue.explanation import Explanation, PrinterMatch, explain_job
    from printer_slicer.print_queue.file_facts import FileFacts, read_file_facts
    from printer_slicer.print_queue.queue_store import PrintQueue, open_queue
    from printer_slicer.print_queue.records import (
        JobRequest,
        PrinterState,
        PrintRun,
        QueuedFile,
        QueuedJob,
        QueueSnapshot,
    )
    from printer_slicer.print_queue.supervisor import Supervisor

_HOMES = {
    "Explanation": "explanation",
    "PrinterMatch": "explanation",
    "explain_job": "explanation",
    "FileFacts": "file_facts",
    "read_file_facts": "file_facts",
    "PrintQueue": "queue_store",
    "open_queue": "queue_store",
    "JobRequest": "records",
    "PrinterState": "records",
    "PrintRun": "records",
    "QueuedFile": "records",
    "QueuedJob": "records",
    "QueueSnapshot": "records",
    "Supervisor": "supervisor",
}

__all__ = [
    "Explanation",
    "FileFacts",
    "JobRequest",
    "PrintQueue",
    "PrintRun",
    "PrinterMatch",
    "PrinterState",
    "QueueSnapshot",
    "QueuedFile",
    "QueuedJob",
    "Supervisor",
    "explain_job",
    "open_queue",
    "read_file_facts",
]


__getattr__ = lazy_names(__name__, _HOMES)
