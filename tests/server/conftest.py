"""A server on a new queue with two simulated printers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from printer_slicer.print_queue import PrintQueue, open_queue
from printer_slicer.server.access import SCOPES, AccessStore
from tests.server.client import ServerClient, open_client

PRINTERS = """
[left]
port = "sim:"
profile = "marlin_220"

[right]
port = "sim:"
profile = "marlin_220"
material = "petg"
"""


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[PrintQueue]:
    (tmp_path / "printers.toml").write_text(PRINTERS)
    queue = open_queue(tmp_path / "queue", tmp_path / "printers.toml")
    yield queue
    queue.close()


@pytest.fixture
def access(tmp_path: Path) -> Iterator[AccessStore]:
    store = AccessStore(tmp_path / "access.db")
    yield store
    store.close()


@pytest.fixture
def server(queue: PrintQueue, access: AccessStore, tmp_path: Path) -> Iterator[ServerClient]:
    _, key = access.create_key("tests", SCOPES)
    with open_client(queue, access, tmp_path / "prints", key) as client:
        yield client
