"""Ports: pseudo-terminals, sockets and loops instead of printers, real errors of the system, and their remedies."""

from __future__ import annotations

import errno
import os
import pty
import socket
import threading
import tty
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
import serial
from serial.tools.list_ports_common import ListPortInfo

from printer_slicer.errors import PortError
from printer_slicer.stream import serial_port
from printer_slicer.stream.serial_port import PortInfo, SerialPort, list_ports, open_port


@contextmanager
def terminal() -> Iterator[tuple[int, str]]:
    """The printer's end of a pseudo-terminal, and the name of the other."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield master, os.ttyname(slave)
    finally:
        os.close(slave)
        os.close(master)


def test_bytes_pass_both_ways_through_a_device() -> None:
    with terminal() as (printer, name), closing(open_port(name)) as port:
        port.write(b"N0 M110 N0*125\n")
        assert os.read(printer, 100) == b"N0 M110 N0*125\n"

        os.write(printer, b"ok\n")
        assert port.read(1.0) == b"ok\n"
        assert port.read(0.0) == b""


def test_a_device_can_be_opened_only_once() -> None:
    with (
        terminal() as (_, name),
        closing(open_port(name)),
        pytest.raises(PortError, match="in use by another program") as caught,
    ):
        open_port(name)

    assert "Close the other program" in caught.value.remedy


def test_a_printer_that_vanishes_while_it_is_read_is_reported() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    port = open_port(os.ttyname(slave))
    os.close(slave)
    os.close(master)

    with pytest.raises(PortError, match="connection lost") as caught:
        port.read(1.0)
    assert "cable" in caught.value.remedy
    with pytest.raises(PortError, match="connection lost"):
        port.write(b"M105\n")
    port.close()


def test_a_closed_port_neither_reads_nor_writes_and_can_be_closed_again() -> None:
    with terminal() as (_, name):
        port = open_port(name)
        port.close()
        port.close()

        with pytest.raises(PortError):
            port.read(0.0)
        with pytest.raises(PortError):
            port.write(b"M105\n")


def test_a_printer_that_takes_nothing_is_reported() -> None:
    with terminal() as (_, name):
        inner = serial.Serial(name, timeout=0, write_timeout=0.01)
        with closing(SerialPort(inner, name)) as port, pytest.raises(PortError, match="accepts no data"):
            port.write(b"x" * 1_000_000)


def test_bytes_pass_both_ways_through_a_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"socket://127.0.0.1:{server.getsockname()[1]}"

        def printer() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"heard " + connection.recv(100))

        thread = threading.Thread(target=printer)
        thread.start()
        with closing(open_port(address)) as port:
            port.write(b"M105\n")
            heard = b""
            while not heard.endswith(b"\n"):
                heard += port.read(5.0)
            thread.join()

            assert heard == b"heard M105\n"
            with pytest.raises(PortError, match="connection lost"):
                port.read(5.0)


def test_a_port_without_a_descriptor_is_read_by_its_own_timeout() -> None:
    with closing(open_port("loop://")) as port:
        assert port.read(0.01) == b""
        port.write(b"ok\nok\n")
        assert port.read(1.0) == b"ok\nok\n"


def test_a_missing_port_is_reported_with_those_that_exist() -> None:
    with pytest.raises(PortError, match="there is no port /dev/does-not-exist") as caught:
        open_port("/dev/does-not-exist")

    assert "Available ports" in caught.value.remedy


def test_a_port_that_cannot_do_what_is_asked_is_reported() -> None:
    with pytest.raises(PortError, match="cannot be opened"):
        open_port("socket://127.0.0.1:1")
    with pytest.raises(PortError, match="cannot be opened"):
        open_port("nonsense://here")
    with terminal() as (_, name), pytest.raises(PortError, match="cannot be opened"):
        open_port(name, baud=-1)


@pytest.mark.parametrize(
    ("code", "message", "remedy"),
    [
        (errno.EACCES, "permission denied", "dialout"),
        (errno.EBUSY, "in use by another program", "Close the other program"),
        (errno.ENODEV, "there is no port", "Available ports"),
        (errno.EIO, "cannot be opened", "baud rate"),
    ],
)
def test_every_refusal_of_the_system_has_a_remedy(code: int, message: str, remedy: str) -> None:
    error = serial_port._make_open_error("/dev/ttyACM0", serial.SerialException(code, os.strerror(code)))

    assert message in str(error)
    assert remedy in error.remedy


def test_ports_are_listed_by_their_persistent_names(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM0"
    device.touch()
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-Printer_42").symlink_to(device)

    raw = ListPortInfo(str(device))
    raw.description, raw.vid, raw.pid, raw.serial_number = "Printer", 0x2C99, 0x0002, "42"
    names = serial_port._read_persistent_names(by_id)
    info = serial_port._make_port_info(raw, names)

    assert info == PortInfo(str(device), str(by_id / "usb-Printer_42"), "Printer", 0x2C99, 2, "42")
    assert info.address == info.by_id


def test_a_port_without_a_lasting_name_is_opened_by_its_device(tmp_path: Path) -> None:
    info = serial_port._make_port_info(
        ListPortInfo("/dev/ttyS0"), serial_port._read_persistent_names(tmp_path / "none")
    )

    assert info.address == "/dev/ttyS0"
    assert info.vid is None
    assert info.serial == ""


def test_the_list_of_ports_of_this_computer_can_be_made() -> None:
    ports = list_ports()

    assert ports == sorted(ports, key=lambda port: (port.vid is None, port.device))


def test_the_remedy_for_a_missing_port_names_the_ports_that_exist() -> None:
    found = [PortInfo("/dev/ttyACM0", "", "", None, None, "")]

    assert serial_port._describe_available_ports(found) == "Available ports: /dev/ttyACM0"
    assert "No serial port was found" in serial_port._describe_available_ports([])
