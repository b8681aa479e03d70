"""The threads of the server that follow the queue: they go on after other processes and errors."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from printer_slicer.errors import OutputError
from printer_slicer.print_queue import PrintQueue, open_queue
from printer_slicer.print_queue.supervisor import is_supervised, lock_queue
from printer_slicer.server import running
from printer_slicer.server.access import AccessStore
from printer_slicer.server.demo import open_demo_folder
from tests.server.client import open_client
from tests.server.live import PRINTERS
from tests.waiting import until


def test_the_server_takes_over_when_the_other_process_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))
    monkeypatch.setattr(running, "_LOCK_INTERVAL", 0.01)
    (tmp_path / "printers.toml").write_text(f'{PRINTERS}[wrong]\nport = "sim:"\nprofile = "nonesuch"\n')
    queue, said = open_queue(tmp_path / "queue", tmp_path / "printers.toml"), list[str]()
    with lock_queue(queue):
        supervisor = running.RunningSupervisor(queue, said.append)
        supervisor.__enter__()
        until(lambda: said)
    try:
        until(lambda: is_supervised(queue))
        until(lambda: len(said) == 2)
    finally:
        supervisor.__exit__()
        queue.close()
    assert "then this server does" in said[0]
    assert said[1].startswith("wrong: there is no printer profile nonesuch")


def test_the_feed_tells_why_the_printers_cannot_be_read(
    queue: PrintQueue, access: AccessStore, tmp_path: Path
) -> None:
    _, key = access.create_key("tests", ["read"])
    with (
        open_client(queue, access, tmp_path / "prints", key) as client,
        client.websocket_connect("/v1/feed", headers={"x-api-key": key}) as feed,
    ):
        assert '"kind":"queue"' in feed.receive_text()
        file = tmp_path / "printers.toml"
        text = file.read_text()
        file.write_text("[left\n")
        problem = json.loads(feed.receive_text())
        assert problem["kind"] == "problem"
        assert "line 1" in problem["detail"]
        assert problem["remedy"] == "Correct this line"
        file.write_text(text)
        assert '"kind":"queue"' in feed.receive_text()


def test_the_feed_tells_that_a_printer_was_removed(
    queue: PrintQueue, access: AccessStore, tmp_path: Path
) -> None:
    _, key = access.create_key("tests", ["read"])
    with (
        open_client(queue, access, tmp_path / "prints", key) as client,
        client.websocket_connect("/v1/feed", headers={"x-api-key": key}) as feed,
    ):
        message = json.loads(feed.receive_text())
        assert [one["name"] for one in message["queue"]["printers"]] == ["left", "right"]
        file = tmp_path / "printers.toml"
        file.write_text(file.read_text().partition("[right]")[0])
        message = json.loads(feed.receive_text())
        assert [one["name"] for one in message["queue"]["printers"]] == ["left"]


def test_the_feed_goes_on_after_an_error_of_the_database(
    queue: PrintQueue, access: AccessStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = [OutputError("disk I/O error", remedy="Check the disk")]
    wait = queue.wait_for_change

    def fail_once(revision: int, timeout: float) -> int:
        if errors:
            raise errors.pop()
        return wait(revision, timeout)

    monkeypatch.setattr(queue, "wait_for_change", fail_once)
    _, key = access.create_key("tests", ["read"])
    with (
        open_client(queue, access, tmp_path / "prints", key) as client,
        client.websocket_connect("/v1/feed", headers={"x-api-key": key}) as feed,
    ):
        until(lambda: not errors and '"bed":"unknown"' in feed.receive_text())
        queue.set_bed("left", "clear")
        assert '"bed":"clear"' in feed.receive_text()


@pytest.mark.skipif(sys.platform == "win32", reason="SIGTERM ends a process there")
@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP"])
def test_the_prints_of_the_demo_end_with_it(tmp_path: Path, number: str) -> None:
    command = [sys.executable, "-m", "printer_slicer", "serve", "--demo", "--listen", "127.0.0.1:0"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        said = next(line for line in lines if "serving at" in line)
        process.send_signal(getattr(signal, number))
        process.stdout.read()
    assert "ends the server and its prints" in said
    assert list(tmp_path.glob("printer-slicer-demo-*")) == []


def test_a_demo_deletes_the_folders_of_killed_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    killed, other = tmp_path / "printer-slicer-demo-killed", tmp_path / "printer-slicer-demo-other"
    for folder in (killed, other):
        folder.mkdir()
    (killed / "demo.lock").touch()

    with open_demo_folder() as folder:
        assert not killed.exists()
        assert other.exists()  # it may be one that has not locked its folder yet
        assert folder.exists()
    assert not folder.exists()
