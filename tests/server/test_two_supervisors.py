"""A server whose queue another process runs takes over when that process ends."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer.print_queue import open_queue
from printer_slicer.print_queue.supervisor import is_supervised, lock_queue
from printer_slicer.server import running
from tests.server.live import PRINTERS
from tests.waiting import until


def test_the_server_takes_over_when_the_other_process_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))
    monkeypatch.setattr(running, "_LOCK_INTERVAL", 0.01)
    (tmp_path / "printers.toml").write_text(PRINTERS)
    queue, said = open_queue(tmp_path / "queue", tmp_path / "printers.toml"), list[str]()
    with lock_queue(queue):
        supervisor = running.RunningSupervisor(queue, said.append)
        supervisor.__enter__()
        until(lambda: said)
    try:
        until(lambda: is_supervised(queue))
    finally:
        supervisor.__exit__()
        queue.close()
    (text,) = said
    assert "then this server does" in text
