"""The command `queue` with the queue of a server."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from printer_slicer.cli import main
from tests.server.client import GCODE
from tests.server.live import LiveServer, run_live_server


@pytest.fixture
def live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveServer]:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path / "other"))
    monkeypatch.chdir(tmp_path)
    with run_live_server(tmp_path) as server:
        (tmp_path / "key").write_text(server.key)
        (tmp_path / "part.gcode").write_bytes(GCODE)
        yield server


def test_all_actions_work_on_the_queue_of_a_server(
    live: LiveServer, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*words: str) -> dict[str, Any]:
        server = ("--server", f"http://localhost:{live.port}", "--key-file", "key", "--json")
        assert main(["queue", *words, *server]) == 0
        facts: dict[str, Any] = json.loads(capsys.readouterr().out)
        return facts

    jobs = run("add", "part.gcode", "--copies", "2", "--printer", "left")["jobs"]
    assert [job["name"] for job in jobs] == ["part.gcode"] * 2
    first, second = (str(job["id"]) for job in jobs)
    run("move", second, "first")
    assert [job.id for job in live.queue.snapshot().jobs] == [int(second), int(first)]
    run("hold", first)
    assert live.queue.find_job(int(first)).state == "held"
    assert "held" in run("explain", first)["summary"]
    run("release", first)
    run("cancel", first)
    assert live.queue.find_job(int(first)).state == "cancelled"
    run("clear-bed", "left")
    run("load", "left", "petg")
    listed = run("list", "--all")
    assert (listed["printers"][0]["bed"], listed["printers"][0]["material"]) == ("clear", "petg")
    assert [job["id"] for job in listed["ended"]] == [int(first)]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("explain", "77"), "there is no job 77"),
        (("clear-bed", "a/b"), "nothing at this address"),
        (("run",), "--server does not work with run"),
        (("list", "--all", "--key-file", "none"), "none: cannot be read"),
    ],
)
def test_what_the_server_rejects_is_explained(
    live: LiveServer, words: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    server = ("--server", f"http://localhost:{live.port}", "--key-file", "key")
    assert main(["queue", *words[:2], *server, *words[2:]]) != 0
    assert told in capsys.readouterr().err


def test_a_wrong_key_is_explained(live: LiveServer, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["queue", "list", "--server", f"localhost:{live.port}"]) != 0
    assert "the request has no key" in capsys.readouterr().err
