"""The printer at a TCP port: hosts come and go, and whole prints come through, as plain bytes and by RFC 2217."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
import serial

from printer_slicer.errors import PortError
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.rfc2217 import Rfc2217Server
from printer_slicer.sim.statistics import Report
from printer_slicer.sim.tcp_server import serve_tcp
from printer_slicer.stream.events import Event as Told
from printer_slicer.stream.events import Finished
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import open_port
from printer_slicer.stream.session import run
from tests.waiting import LAST_RESORT

# pyserial's own end of RFC 2217 starts its thread in a way that is out of date.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name).*:DeprecationWarning")

ROOT = Path(__file__).parents[2]
JOB = [b"G28", b"G90", b"M83"] + [b"G1 X%d Y%d E0.1 F9000" % (n % 60, n % 41) for n in range(400)]
DOORS = [("socket", None), ("rfc2217", Rfc2217Server)]


class Served:
    """Where a printer is, what it has executed, and its account at the end."""

    def __init__(self) -> None:
        self.address = ""
        self.executed: list[str] = []
        self.reports: list[Report] = []
        self.unplugged = Event()


@contextmanager
def served(telnet: Any = None, *, speed: float = 0.0) -> Iterator[Served]:
    """A printer at a free port for as long as the block runs."""
    stop, ready = Event(), Event()
    there = Served()

    def opened(address: str) -> None:
        there.address = address
        ready.set()

    def serve() -> None:
        machine = replace(Machine(), coldest_extrusion=0.0)
        report = serve_tcp(
            lambda: SimulatedPrinter(machine, on_executed=there.executed.append, boots=False),
            ("127.0.0.1", 0),
            speed=speed,
            telnet=telnet,
            unplugged=there.unplugged.is_set,
            stop=stop.is_set,
            ready=opened,
        )
        there.reports.append(report)

    thread = Thread(target=serve)
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        yield there
    finally:
        stop.set()
        thread.join(LAST_RESORT)
    assert not thread.is_alive()


def clock() -> float:
    import time

    return time.monotonic()


def ask(connection: socket.socket, line: str) -> bytes:
    """Send a line and read up to its ok."""
    connection.sendall(f"{line}\n".encode())
    heard = b""
    while not heard.endswith(b"ok\n"):
        piece = connection.recv(4096)
        assert piece, f"sent away after {line!r}"
        heard += piece
    return heard


def sent_away(connection: socket.socket) -> bool:
    """Whether the other end closes the connection."""
    try:
        while connection.recv(4096):
            pass
    except ConnectionResetError:
        pass
    return True


def connected(there: Served) -> socket.socket:
    host, _, port = there.address.rpartition(":")
    return socket.create_connection((host, int(port)), timeout=LAST_RESORT)


@pytest.mark.parametrize(("scheme", "telnet"), DOORS)
def test_a_job_is_printed_to_its_end_and_exactly(scheme: str, telnet: Any) -> None:
    told: list[Told] = []
    with served(telnet) as there, closing(open_port(f"{scheme}://{there.address}", 115_200)) as port:
        run(Streamer(JOB), port, clock, on_event=told.append)

    assert isinstance(told[-1], Finished)
    assert told[-1].verified is not False
    assert [text.encode() for text in there.executed if text.encode() in set(JOB)] == JOB
    assert there.reports[0].line_errors == 0


def test_a_host_that_goes_and_comes_back_meets_the_printer_as_it_was() -> None:
    with served() as there:
        with connected(there) as first:
            assert ask(first, "G92 X12").endswith(b"ok\n")
        with connected(there) as second:
            assert ask(second, "M114").startswith(b"X:12.00 ")


def test_a_second_host_is_sent_away_while_the_first_is_there() -> None:
    with served() as there, connected(there) as first:
        ask(first, "M118 hello")
        with connected(there) as second:
            assert sent_away(second)
        assert ask(first, "M118 still here") == b"still here\nok\n"


def test_a_pulled_cable_sends_the_host_away_until_it_is_back() -> None:
    with served(speed=1.0) as there:
        with connected(there) as first:
            ask(first, "M118 hello")
            there.unplugged.set()
            assert sent_away(first)
        there.unplugged.clear()
        with connected(there) as again:
            assert ask(again, "M118 back") == b"back\nok\n"


def test_a_host_that_never_reads_does_not_stop_the_printer() -> None:
    with served() as there:
        with connected(there) as deaf:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            deaf.sendall(b"M503\n" * 2000)
        with connected(there) as other:
            while b"alive\n" not in ask(other, "M118 alive"):
                pass  # what was meant for the deaf one comes first


def test_what_is_no_rfc_2217_sends_the_host_away_and_the_next_one_is_welcome() -> None:
    telnet, unfinished = b"\xff\xfa\x2c", b"\x01\x00"
    with served(Rfc2217Server) as there:
        for nonsense in (telnet + unfinished + b"\xff\xf0", telnet + b"\x01" * 5000):
            with connected(there) as odd:
                odd.sendall(nonsense)
                assert sent_away(odd)
        with serial.serial_for_url(f"rfc2217://{there.address}", 115_200, timeout=LAST_RESORT) as port:
            port.write(b"M118 a\xffb\n")
            assert port.readline() == b"a\xffb\n"
            port.baudrate = 250_000
            assert port.baudrate == 250_000


def test_an_address_that_is_taken_is_refused_with_a_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(PortError) as caught:
        serve_tcp(lambda: SimulatedPrinter(Machine()), other.getsockname()[:2])

    assert "cannot listen at 127.0.0.1:" in str(caught.value)
    assert "Choose a free port" in caught.value.remedy


def test_the_door_over_tcp_needs_nothing_that_windows_does_not_have() -> None:
    code = (
        "import sys\n"
        "for name in ('pty', 'tty', 'termios', 'fcntl', 'grp', 'pwd'): sys.modules[name] = None\n"
        "import printer_slicer.sim.tcp_server, printer_slicer.sim.server_loop, printer_slicer.cli.commands.sim\n"
        "import printer_slicer.sim.fault_script\n"
        "assert 'printer_slicer.sim.pty_server' not in sys.modules\n"
        "assert 'serial' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=LAST_RESORT,
        check=False,
    )

    assert (done.returncode, done.stderr) == (0, "")
