"""Whoever asks how a print stands gets an answer soon, also from a print that waits for something else."""

from __future__ import annotations

import json
import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from printer_slicer import printing
from printer_slicer.deprecation import accept_former_option
from printer_slicer.errors import PortError
from printer_slicer.printing.commands import Abort
from printer_slicer.printing.control_socket import send_control_command
from printer_slicer.printing.controls import Controls, PrintResult
from printer_slicer.printing.print_controller import Request
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.states import State

KNOWN = {"state": "printing", "done": 7, "total": 9}


class Deaf:
    """Print that never answers requests, or always does if `deaf` is false."""

    def __init__(self, *, deaf: bool = True) -> None:
        self.tickets: list[Request] = []
        self._deaf = deaf

    def status(self) -> dict[str, Any]:
        return dict(KNOWN)

    def submit(self, request: Request) -> None:
        self.tickets.append(request)
        if not self._deaf:
            request.done(json.dumps(self.status()))


def test_a_print_that_hears_tells_how_it_stands() -> None:
    controls = Controls()
    controls.bind(Deaf(deaf=False))  # type: ignore[arg-type]

    assert controls.status_soon() == KNOWN


def test_before_there_is_a_printer_one_learns_what_is_waited_for() -> None:
    controls = Controls()

    assert controls.status_soon() == {
        "state": "waiting",
        "waits_for": "the port to open and the printer to answer",
    }


def test_while_the_printer_is_away_one_learns_that_and_how_it_stood() -> None:
    controls = Controls()
    controls.bind(Deaf())  # type: ignore[arg-type]
    controls.bind(None, waits_for="the printer to come back")

    assert controls.status_soon() == KNOWN | {"state": "waiting", "waits_for": "the printer to come back"}


def test_a_print_that_is_busy_is_not_waited_for() -> None:
    controls, deaf = Controls(), Deaf()
    controls.bind(deaf)  # type: ignore[arg-type]
    told = controls.status_soon(timeout=0.01)

    assert len(deaf.tickets) == 1
    assert "writing to its port" in told["waits_for"]


@pytest.mark.skipif(sys.platform == "win32", reason="sockets have no names there")
def test_a_process_that_stands_still_is_named(tmp_path: Path) -> None:
    with pytest.raises(PortError, match="does not respond yet: it is waiting for the serial port"):
        send_control_command(tmp_path, "status")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "s"))
        listener.listen()
        (tmp_path / "control.json").write_text(json.dumps({"path": str(tmp_path / "s")}), encoding="utf-8")
        with pytest.raises(PortError, match=r"does not respond in 0\.01 s: it is stopped"):
            send_control_command(tmp_path, "status", timeout=0.01)


def test_former_names_work_with_a_warning() -> None:
    controls = Controls()
    deaf = Deaf()
    controls.bind(deaf)  # type: ignore[arg-type]
    with pytest.warns(FutureWarning, match=r"Controls\.want is now called Controls\.submit"):
        controls.want(Request(Abort()))
    assert len(deaf.tickets) == 1
    with pytest.warns(
        FutureWarning, match=r"printing\.Done is now called printer_slicer\.printing\.PrintResult"
    ):
        assert printing.Done is PrintResult
    with pytest.warns(FutureWarning, match="handle_actions"):
        assert Streamer([b"M105"], obeys=False).state is State.CONNECTING
    options: dict[str, Any] = {"shelf": 1}
    with pytest.warns(FutureWarning, match="shelf is now called job_store"):
        accept_former_option(options, "shelf", "job_store")
    assert options == {"job_store": 1}
