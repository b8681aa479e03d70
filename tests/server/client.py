"""A client of a server in the same process, and bodies of uploads as slicers send them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from starlette.testclient import TestClient

from printer_slicer.print_queue import PrintQueue
from printer_slicer.server.access import AccessStore
from printer_slicer.server.app import make_app
from printer_slicer.server.guard import GuardSettings
from printer_slicer.server.services import Services

GCODE = b"G28\nM104 S200\nG1 Z0.2 F600\nG1 X20 Y20 F6000\nM109 S200\nG1 X60 E2 F1200\nM104 S0\n"
PAGE = {"origin": "http://testserver", "x-printer-slicer": "1"}
ServerClient = TestClient


@contextmanager
def open_client(
    queue: PrintQueue, access: AccessStore, job_store: Path, key: str = ""
) -> Iterator[ServerClient]:
    guard = GuardSettings(frozenset({"testserver"}))
    with TestClient(
        make_app(Services(queue, access, guard, job_store)), raise_server_exceptions=True
    ) as client:
        if key:
            client.headers["x-api-key"] = key
        yield client


def form(*parts: tuple[str, str | None, bytes], boundary: str = "----x") -> dict[str, Any]:
    """Body and headers of a multipart form with parts (field, file name or None, content)."""
    body = b""
    for name, filename, content in parts:
        more = (
            "" if filename is None else f'; filename="{filename}"\r\nContent-Type: application/octet-stream'
        )
        head = f'--{boundary}\r\nContent-Disposition: form-data; name="{name}"{more}\r\n\r\n'
        body += head.encode() + content + b"\r\n"
    body += f"--{boundary}--\r\n".encode()
    return {"content": body, "headers": {"content-type": f"multipart/form-data; boundary={boundary}"}}
