"""Prints on print servers: when they are uploaded, and how their end is known."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from printer_slicer.errors import PortError, PrintError, UsageError
from printer_slicer.print_queue.printers import PrinterEntry, parse_printers
from printer_slicer.print_queue.remote_print import RemotePrinter, print_remotely
from printer_slicer.print_queue.run_folder import RunInstructions, RunResult, create_run_folder, read_report
from printer_slicer.print_queue.run_print import run_print
from printer_slicer.sending import RemoteStatus
from printer_slicer.values import as_dict
from tests.hosts.small_servers import fixed

ENTRY = PrinterEntry(name="far", port="moonraker:http://voron.local", profile="voron_0_2")
IDLE = RemoteStatus("idle", "other.gcode", 1.0, is_complete=True)
PRINTING = RemoteStatus("printing", "parts/run.gcode", 0.5)
DONE = RemoteStatus("idle", "parts/run.gcode", 1.0, is_complete=True)
STOPPED = RemoteStatus("idle", "run.gcode", 0.5, is_complete=False, message="cancelled")
BROKEN = RemoteStatus("error", "run.gcode", message="Move out of range")

NAMELESS = RemoteStatus("idle", is_complete=True)
UNCLEAR = "the server does not report how the print ended: "


class Server(RemotePrinter):
    """A printer whose server gives these answers, one after the other, and the last one for ever."""

    def __init__(self, *answers: RemoteStatus | PortError, accepts: bool = True) -> None:
        super().__init__(ENTRY)
        self._answers: Iterator[RemoteStatus | PortError] = iter(answers)
        self._last = answers[-1]
        self._accepts = accepts
        self.sent: list[str] = []
        self.cancellations = 0

    def read_status(self) -> RemoteStatus:
        answer = next(self._answers, self._last)
        if isinstance(answer, PortError):
            raise answer
        return answer

    def send(self, path: Path, name: str) -> None:
        self.sent.append(name)
        if not self._accepts:
            raise PortError("no answer in time")

    def cancel(self) -> None:
        self.cancellations += 1
        raise PortError("it is being cancelled")


def printed(server: Server, is_cancelled: Callable[[], bool] = lambda: False) -> RunResult:
    return print_remotely(
        server,
        Path("part.gcode"),
        "run.gcode",
        is_cancelled=is_cancelled,
        on_start=lambda: None,
        interval=0,
        timeout=0.05,
    )


@pytest.mark.parametrize(
    ("answers", "result"),
    [
        ([IDLE, IDLE, PRINTING, DONE], RunResult("done")),
        ([IDLE, PRINTING, PortError("gone"), PortError("gone"), PRINTING, DONE], RunResult("done")),
        ([IDLE, DONE], RunResult("done")),
        ([IDLE, PRINTING, STOPPED], RunResult("failed", "the server says: cancelled")),
        ([IDLE, PRINTING, BROKEN], RunResult("failed", "the server says: Move out of range")),
        ([NAMELESS, RemoteStatus("printing"), NAMELESS], RunResult("done")),
        # what was printed before says nothing of what is printed now
        ([IDLE, IDLE], RunResult("failed", UNCLEAR)),
        ([NAMELESS], RunResult("failed", UNCLEAR)),
        ([IDLE, PRINTING, RemoteStatus("printing", "x.gcode")], RunResult("failed", UNCLEAR)),
        (
            [IDLE, PRINTING, RemoteStatus("offline", message="Closed")],
            RunResult("failed", f"{UNCLEAR}Closed"),
        ),
    ],
)
def test_the_end_of_a_print_is_what_the_server_says(
    answers: list[RemoteStatus | PortError], result: RunResult
) -> None:
    server = Server(*answers)

    assert printed(server) == result
    assert server.sent == ["run.gcode"]


@pytest.mark.parametrize("answer", [PRINTING, BROKEN, RemoteStatus("offline"), PortError("nobody there")])
def test_nothing_is_uploaded_to_a_printer_that_is_not_ready(answer: RemoteStatus | PortError) -> None:
    server = Server(answer)

    with pytest.raises(PortError):
        printed(server)

    assert server.sent == []


def test_an_upload_without_an_answer_may_have_begun() -> None:
    """So it is not started once more on another printer."""
    with pytest.raises(PrintError, match="no answer in time"):
        printed(Server(IDLE, accepts=False))


def test_a_cancelled_print_is_cancelled_on_the_server() -> None:
    server = Server(IDLE, PRINTING, PRINTING, STOPPED)

    assert printed(server, lambda: True) == RunResult("cancelled", "cancelled on the server")
    assert server.cancellations == 3


def test_the_key_is_read_from_its_file(tmp_path: Path) -> None:
    (tmp_path / "key").write_text("secret\n", encoding="utf-8")
    table = {
        "port": "octoprint:http://o.local:5000",
        "profile": "prusa_mk3s",
        "key_file": str(tmp_path / "key"),
    }

    (entry,) = parse_printers({"far": table})

    assert entry.server == ("octoprint", "http://o.local:5000")
    assert RemotePrinter(entry)
    with pytest.raises(UsageError, match="the key cannot be read"):
        RemotePrinter(parse_printers({"far": table | {"key_file": str(tmp_path / "none")}})[0])
    with pytest.raises(UsageError, match="key_file is for print servers only"):
        parse_printers({"far": table | {"port": "/dev/ttyUSB0"}})


def test_a_run_on_a_server_reports_its_end(tmp_path: Path) -> None:
    (tmp_path / "part.gcode").write_text("G28\nG1 X1 F600\n", encoding="utf-8")
    folder = tmp_path / "run"
    query = "/printer/objects/query?print_stats&virtual_sdcard"
    status = {"print_stats": {"state": "standby"}}
    says = {
        query: (200, {"result": {"status": status}}),
        "/server/info": (200, {"result": {"klippy_state": "ready"}}),
    }
    says["/server/files/upload"] = (201, {"item": {"path": "run.gcode"}, "print_started": True})
    with fixed(says) as seen:
        entry = as_dict(PrinterEntry(name="far", port=f"moonraker:{seen.url}", profile="voron_0_2"))
        create_run_folder(
            folder,
            RunInstructions(
                "part.gcode", str(tmp_path / "part.gcode"), entry, "pla", (), str(tmp_path / "prints")
            ),
        )
        status["print_stats"] = {"state": "complete", "filename": "run.gcode"}

        code = run_print(folder)

    assert (code, read_report(folder).result) == (0, RunResult("done"))
    assert json.loads((folder / "ready.json").read_text(encoding="utf-8"))["folder"] == str(folder)
    assert "POST /server/files/upload" in seen.requests
