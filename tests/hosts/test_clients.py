"""Other people's hosts print to our simulated printer, served as the command `sim` serves it, to the end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from printer_slicer.sending import Upload, send
from tests.hosts.others import KEY, octoprint, program
from tests.waiting import LAST_RESORT, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "sample_parts"
FAST = ("--set", "printer.link_lines_per_second=0")


@pytest.fixture(scope="module")
def gcode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole small part, from heating to the end G-code."""
    path = tmp_path_factory.mktemp("job") / "bridge.gcode"
    ours("slice", PARTS / "bridge.stl", "-o", path, *FAST, "--quality", "standard")
    return path


def ours(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Our command, to its end."""
    command = [sys.executable, "-m", "printer_slicer", *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=LAST_RESORT, cwd=ROOT)


class Simulated:
    """A `sim` that runs."""

    def __init__(self, process: subprocess.Popen[str], report: Path) -> None:
        self._process = process
        self._report = report

    def verdict(self) -> dict[str, Any]:
        """End it; what it makes of the print."""
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(LAST_RESORT)
        return dict(json.loads(self._report.read_text())["verdict"])


@contextmanager
def sim(link: Path, gcode: Path, report: Path) -> Iterator[Simulated]:
    """The simulated printer behind `link`, as fast as hosts can send; it expects this file."""
    flags = ["--pty", link, "--speed", "0", "--expect", gcode, "--report", report, *FAST]
    command = [sys.executable, "-m", "printer_slicer", "sim", *map(str, flags)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT
    ) as process:
        assert process.stdout is not None
        try:
            assert "simulated" in process.stdout.readline()
            yield Simulated(process, report)
        finally:
            process.terminate()
            process.wait(LAST_RESORT)


def assert_printed(verdict: dict[str, Any]) -> None:
    """All of the file was executed once and in order, and laid what it should."""
    assert verdict["problems"] == []
    assert verdict["executed_equals_sent"] is True
    assert verdict["executed"] == verdict["commands"] > 1000
    assert verdict["printer"]["line_errors"] == 0


def test_printruns_printcore_prints_to_the_end(tmp_path: Path, gcode: Path) -> None:
    python = program("printrun", "python")
    link = tmp_path / "printer"
    with sim(link, gcode, tmp_path / "report.json") as printer:
        script = ROOT / "benchmarks" / "drive_printcore.py"
        bare = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        command = list(map(str, (python, script, link, gcode, 200)))
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=LAST_RESORT, check=False, env=bare
        )

        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout.splitlines()[-1])["done"] is True
        assert_printed(printer.verdict())


def asked(url: str, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
    """One request to OctoPrint."""
    data = None if body is None else json.dumps(body).encode()
    headers = {"X-Api-Key": KEY, "Content-Type": "application/json"}
    with urllib.request.urlopen(
        urllib.request.Request(url + path, data, headers), timeout=LAST_RESORT
    ) as answer:
        text = answer.read()
    return dict(json.loads(text)) if text else {}


def test_octoprint_prints_to_the_end_what_we_sent_it(tmp_path: Path, gcode: Path) -> None:
    link = tmp_path / "printer"
    program("octoprint", "octoprint")
    with (
        sim(link, gcode, tmp_path / "report.json") as printer,
        octoprint(
            tmp_path / "octoprint", more=f"serial: {{additionalPorts: [{link}], autoconnect: false}}\n"
        ) as url,
    ):

        def state() -> str:
            return str(asked(url, "/api/job")["state"])

        connect = {"command": "connect", "port": str(link), "baudrate": 115200, "save": False}
        asked(url, "/api/connection", connect)
        until(lambda: state() == "Operational", state)
        # The door we send through starts it, too.
        send(Upload(gcode, gcode.name, start=True), "octoprint", url, key=KEY)
        until(lambda: state() == "Printing", state)
        until(lambda: state() not in {"Printing", "Finishing"}, state)
        told = asked(url, "/api/job")

        assert told["state"] == "Operational"
        assert told["progress"]["completion"] == 100
        asked(url, "/api/connection", {"command": "disconnect"})
        assert_printed(printer.verdict())
