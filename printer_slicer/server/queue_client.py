"""The queue of a server on another computer, with the methods of `PrintQueue` that the command `queue` needs."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from printer_slicer.errors import UsageError
from printer_slicer.print_queue.explanation import Explanation
from printer_slicer.print_queue.file_facts import FileFacts
from printer_slicer.print_queue.records import (
    BedState,
    JobRequest,
    PrinterState,
    QueuedFile,
    QueuedJob,
    QueueSnapshot,
    clean_name,
)
from printer_slicer.sending.connection import Connection, Upload
from printer_slicer.server.json_values import decode_json
from printer_slicer.values import as_dict

__all__ = ["QueueClient"]

_TIMEOUT: Final = 120.0  # s; the server reads a file before it answers


class QueueClient:
    """The queue of a server. All methods are as those of `PrintQueue`.

    Args:
        url: address of the server.
        key: key with the scopes `read` and `upload`, and `print` or `control`.

    Raises:
        UsageError: the address is invalid; of all methods: the server rejects the request.
        PortError: of all methods: the server does not answer.
    """

    def __init__(self, url: str, key: str) -> None:
        self._connection = Connection(url, "printer-slicer", key=key, timeout=_TIMEOUT)
        self._connection.set_headers({"X-Api-Key": key})

    def close(self) -> None:
        """Close the connection."""
        self._connection.__exit__(None, None, None)

    def upload(self, path: Path) -> QueuedFile:
        """Store a file, which the server reads."""
        upload = Upload(path, clean_name(path.name))
        answer = self._connection.upload_form("/v1/files", upload, {})
        file, facts = self._decode(answer, tuple[QueuedFile, FileFacts])
        self._facts[file.id] = facts
        return file  # type: ignore[no-any-return]

    def read_facts(self, file_id: str) -> FileFacts | None:
        """Return what the server knows of a file; None if it is not among the last ones."""
        return self._facts.get(file_id)

    def add_jobs(self, file_id: str, request: JobRequest) -> tuple[QueuedJob, ...]:
        """Add jobs for a file."""
        headers = {"Idempotency-Key": secrets.token_hex(16)}
        body = as_dict(request) | {"file": file_id}
        return self._call("POST", "/v1/jobs", tuple[QueuedJob, ...], body, headers)  # type: ignore[no-any-return]

    def snapshot(self) -> QueueSnapshot:
        """Return the queue."""
        return self._call("GET", "/v1/queue", QueueSnapshot)  # type: ignore[no-any-return]

    def list_printers(self) -> Sequence[PrinterState]:
        """Return the printers."""
        return self.snapshot().printers

    def list_ended_jobs(self, most: int = 100) -> tuple[QueuedJob, ...]:
        """Return the jobs that have ended, the last added first."""
        ended = self._call("GET", "/v1/history", tuple[tuple[QueuedJob, Any], ...])
        return tuple(job for job, _ in ended)[:most]

    def find_job(self, job: int) -> QueuedJob:
        """Return a job."""
        return self.explain(job).job

    def explain(self, job: int) -> Explanation:
        """Explain why a job waits."""
        return self._call("GET", f"/v1/jobs/{job}/explanation", Explanation)  # type: ignore[no-any-return]

    def move_job(self, job: int, before: int | None = None) -> None:
        """Move a waiting job before another one, or to the end."""
        self._call("PUT", f"/v1/jobs/{job}/place", Any, {"before": before})

    def hold_job(self, job: int) -> None:
        """Hold a job."""
        self._call("PUT", f"/v1/jobs/{job}/hold", Any)

    def release_job(self, job: int) -> None:
        """Release a job."""
        self._call("DELETE", f"/v1/jobs/{job}/hold", Any)

    def cancel_job(self, job: int) -> None:
        """Cancel a job; the server ends its print."""
        self._call("DELETE", f"/v1/jobs/{job}", Any)

    def set_bed(self, printer: str, bed: BedState) -> None:
        """Declare the state of a bed."""
        self._call("PUT", f"/v1/printers/{quote(printer, safe='')}/bed", Any, {"bed": bed})

    def set_material(self, printer: str, material: str) -> None:
        """Name the loaded material."""
        self._call("PUT", f"/v1/printers/{quote(printer, safe='')}/material", Any, {"material": material})

    @cached_property
    def _facts(self) -> dict[str, FileFacts | None]:
        """What is known of the files that were added last, by their ids."""
        listed = self._call("GET", "/v1/files", tuple[tuple[QueuedFile, FileFacts | None], ...])
        return {file.id: facts for file, facts in listed}

    def _call(
        self,
        method: str,
        path: str,
        kind: Any,
        body: dict[str, Any] | None = None,
        headers: dict[str, str] | None = None,
    ) -> Any:
        """Send a request, and return its decoded result."""
        return self._decode(self._connection.request(method, path, json=body, headers=headers), kind)

    def _decode(self, answer: Any, kind: Any) -> Any:
        """Return the result in an answer.

        Raises:
            UsageError: the server has rejected the request, or is of another kind.
        """
        if answer.status_code < 400:
            try:
                return decode_json(answer.content, kind)
            except ValueError:
                raise UsageError(
                    f"{self._connection.url} is not the address of printer-slicer serve",
                    remedy="Check the address",
                ) from None
        try:
            problem = decode_json(answer.content, dict[str, Any])
        except ValueError:
            problem = {}
        detail = str(problem.get("detail", f"the server answered with status {answer.status_code}"))
        raise UsageError(detail, remedy=str(problem.get("remedy") or "Check address and key"))
