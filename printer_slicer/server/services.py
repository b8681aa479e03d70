"""What all requests share: the queue, the keys, the worker processes and the settings of the server."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from printer_slicer.errors import PrinterSlicerError
from printer_slicer.print_queue import PrintQueue
from printer_slicer.printing.control_socket import raise_if_rejected, send_control_command
from printer_slicer.server.access import AccessStore
from printer_slicer.server.guard import GuardSettings
from printer_slicer.server.problems import ProblemError, make_problem_error
from printer_slicer.server.slicing import Slicer
from printer_slicer.server.temperatures import TemperatureHistory
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
        self.temperatures = TemperatureHistory()

    def send_command(self, printer: str, command: str) -> dict[str, Any]:
        """Send a command to the print that runs on a printer, and return its answer.

        Raises:
            ProblemError: nothing is printed, or the print does not answer or rejects the command.
        """
        runs = [run for run in self.queue.list_active_runs() if run.printer == printer]
        if not runs:
            raise ProblemError(409, f"printer {printer} is not printing", "Start a job first")
        try:
            answer = send_control_command(self.job_store / runs[0].id, command)
            raise_if_rejected(answer)
        except PrinterSlicerError as error:
            raise make_problem_error(error, 409) from None
        return answer

    def delete_file(self, file: str) -> None:
        """Delete a file and what was made of it, unless a waiting job needs it.

        Raises:
            UsageError: there is no such file, or a job needs it.
        """
        self.queue.delete_file(file)
        self.reader.delete_pages(file)

    def close(self) -> None:
        """Cancel what is being sliced, and close the databases."""
        self.slicer.close()
        self.queue.close()
        self.access.close()
