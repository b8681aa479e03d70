"""Watchers of a running print, and prints that outlive whoever started them or listens to them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

from tests.cli.command_line import USUAL, typed
from tests.waiting import LAST_RESORT, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

from plugged import after, served

from benchmarks.killing import of_job
from printer_slicer.printing.control_socket import connect_to_print, serve_control_socket
from printer_slicer.printing.controls import Controls
from printer_slicer.printing.host_settings import make_host_settings
from printer_slicer.printing.job_store import PortAddress, create_print, load_print
from printer_slicer.printing.status_feed import MAX_CONSOLE_LINES, MAX_WATCHERS, StatusFeed
from printer_slicer.profile import load_profile
from printer_slicer.stream.events import Busy, Finished, Message, Paused

LINES = ["G28", "G90", "G1 Z1 F600", *(f"G1 X{10 + i % 60} Y{10 + i % 7} F6000" for i in range(600))]


class Watched:
    """A feed with one status, and its watchers."""

    def __init__(self) -> None:
        self.status: dict[str, Any] = {"state": "printing", "done": 0}
        self.feed = StatusFeed(lambda: dict(self.status))
        self.ends: list[socket.socket] = []

    def watch(self, last_line: int = 0) -> socket.socket:
        mine, theirs = socket.socketpair()
        mine.settimeout(LAST_RESORT)
        self.ends.append(mine)
        self.feed.add(theirs, "job", last_line)
        return mine


@pytest.fixture
def watched() -> Iterator[Watched]:
    made = Watched()
    yield made
    made.feed.close()
    for end in made.ends:
        end.close()


def messages(connection: socket.socket) -> Generator[dict[str, Any], None, None]:
    with connection.makefile("rb") as file:
        for line in file:
            yield json.loads(line)


def test_a_printer_that_is_busy_for_long_does_not_fill_the_console(watched: Watched) -> None:
    for event in (Message("heating"), *[Busy("processing")] * 600, Message("ready"), Busy("processing")):
        watched.feed.on_event(event)
    first = next(messages(watched.watch()))
    assert [text for _, _, text in first["console"]] == ["heating", "processing", "ready", "processing"]


def test_the_first_message_is_the_whole_status_and_later_ones_are_changes(watched: Watched) -> None:
    reading = messages(watched.watch())
    first = next(reading)
    watched.status["done"] = 7
    second = next(reading)

    assert first["status"] == {"state": "printing", "done": 0, "resends": 0}
    assert second["changes"] == {"done": 7}
    assert second["seq"] > first["seq"]


def test_a_hundred_changes_in_one_tick_are_one_message(watched: Watched) -> None:
    reading = messages(watched.watch())
    next(reading)
    begun = monotonic()
    said = []
    for done in range(1, 101):
        watched.status["done"] = done
    while not said or said[-1]["changes"].get("done") != 100:
        said.append(next(reading))

    assert len(said) <= 2 + 6 * (monotonic() - begun)


def test_a_new_watcher_gets_the_last_500_console_lines_and_an_old_one_those_it_lacks(
    watched: Watched,
) -> None:
    for number in range(700):
        watched.feed.on_event(Message(f"line {number}"))
    new, old = next(messages(watched.watch())), next(messages(watched.watch(699)))

    assert len(new["console"]) == MAX_CONSOLE_LINES
    assert old["console"] == [[700, "message", "line 699"]]


def test_an_urgent_event_does_not_wait_for_the_tick() -> None:
    status = {"state": "printing"}
    feed = StatusFeed(lambda: dict(status), interval=LAST_RESORT)
    mine, theirs = socket.socketpair()
    feed.add(theirs, "job")
    reading = messages(mine)
    next(reading)
    status["state"] = "paused"
    feed.on_event(Paused("the door is open"))
    said = next(reading)
    feed.close()
    reading.close()
    mine.close()

    assert said["changes"] == {"state": "paused"}
    assert said["console"] == [[1, "paused", "the door is open"]]


def test_a_watcher_that_reads_nothing_is_cut_off_and_the_others_are_served(watched: Watched) -> None:
    slow = watched.watch()
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    reading = messages(watched.watch())
    next(reading)

    def is_alone() -> bool:
        for _ in range(300):
            watched.feed.on_event(Message("x" * 500))
        next(reading)
        return len(watched.feed._watchers) == 1

    until(is_alone)


def test_the_end_is_the_last_message(watched: Watched) -> None:
    reading = messages(watched.watch())
    next(reading)
    watched.feed.on_event(Finished(7, False, None, (0.0, 0.0, 0.0), True))
    watched.feed.close()

    assert list(reading)[-1]["ended"] == {"cancelled": False, "verified": True, "reason": ""}


def test_too_many_watchers_are_rejected(watched: Watched) -> None:
    kept = [watched.watch() for _ in range(MAX_WATCHERS)]
    assert watched.watch().recv(1) == b""
    assert len(kept) == MAX_WATCHERS


def test_the_control_socket_offers_watch(tmp_path: Path, watched: Watched) -> None:
    setup = make_host_settings(load_profile())
    held = create_print(tmp_path / "prints", "job.gcode", b"G28\n", PortAddress("port", 1), setup)
    with (
        serve_control_socket(held.folder, Controls(), held.name, watched.feed),
        connect_to_print(held.folder, "watch 0") as connection,
    ):
        reading = messages(connection)
        assert next(reading)["ok"]
        reading.close()
    held.delete()


def test_a_print_of_a_given_name_cannot_begin_twice(tmp_path: Path) -> None:
    from printer_slicer.errors import OutputError

    setup = make_host_settings(load_profile())
    given = ("job.gcode", b"G28\n", PortAddress("port", 1), setup)
    held = create_print(tmp_path / "prints", *given, folder_name="run-1")
    with pytest.raises(OutputError):
        create_print(tmp_path / "prints", *given, folder_name="run-1")

    assert load_print(held.folder) is not None
    held.delete()


@pytest.fixture
def gcode(tmp_path: Path) -> Path:
    path = tmp_path / "job.gcode"
    path.write_text("\n".join(LINES) + "\n", encoding="utf-8")
    return path


def test_a_print_goes_on_when_whoever_reads_its_output_is_killed(gcode: Path, tmp_path: Path) -> None:
    """The parent reads a pipe and gets SIGKILL; the child is in the parent's group."""
    executed = after(100)
    env = {**os.environ, **USUAL, "PRINTER_SLICER_STATE": str(tmp_path / "state")}
    words = ["print", str(gcode), "--port", str(tmp_path / "port"), "--printer", "marlin_220", "--json"]
    code = (
        "import subprocess, sys\n"
        "child = subprocess.Popen([sys.executable, '-m', 'printer_slicer', *sys.argv[1:]], stdout=subprocess.PIPE)\n"
        "for line in child.stdout: pass"
    )
    with served(tmp_path / "port", executed=executed) as lines:
        parent = subprocess.Popen([sys.executable, "-c", code, *words], env=env, stdin=subprocess.DEVNULL)
        until(lambda: len(of_job(lines)) > 100)
        parent.send_signal(signal.SIGKILL)
        parent.wait(LAST_RESORT)
        executed.go_on()
        until(lambda: len(of_job(lines)) >= len(LINES))
        until(lambda: not any((tmp_path / "state" / "prints").iterdir()))

    assert of_job(lines)[: len(LINES)] == LINES


def test_a_detached_print_returns_when_it_can_be_controlled(
    gcode: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path / "state"))
    executed, log = after(100), tmp_path / "print.log"
    port = tmp_path / "port"
    with served(port, executed=executed) as lines:
        started = typed(
            *("print", gcode, "--port", port, "--printer", "marlin_220", "--json", "--detach", "--log", log)
        )
        facts = json.loads(started.out.splitlines()[-1])
        status = typed("control", "status", "--json")
        executed.go_on()
        until(lambda: len(of_job(lines)) >= len(LINES))
        until(lambda: '"finished"' in log.read_text(encoding="utf-8"))

    assert (started.code, status.code) == (0, 0)
    assert Path(facts["folder"]).parent == tmp_path / "state" / "prints"
    assert of_job(lines)[: len(LINES)] == LINES


def test_a_detached_print_that_does_not_begin_says_why(gcode: Path, tmp_path: Path) -> None:
    outcome = typed(
        *("print", gcode, "--port", tmp_path / "nowhere", "--printer", "marlin_220", "--detach"),
        *("--log", tmp_path / "log"),
    )

    assert outcome.code == 4
    assert "nowhere" in outcome.err
