"""Serial ports: open them with clear errors, list them, and find the processes that use them.

This is the only module of the host that imports pyserial. Addresses are device names (`/dev/ttyACM0`, `COM3`) or URLs
that pyserial supports (`socket://host:port`, `rfc2217://host:port`, `loop://`).
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import sys
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Final

import serial
from serial.tools import list_ports as serial_list

from printer_slicer.errors import PortError
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from serial.tools.list_ports_common import ListPortInfo

__all__ = [
    "PortInfo",
    "SerialPort",
    "find_device_of_board",
    "find_port_info",
    "find_processes_using",
    "list_ports",
    "open_port",
]

if sys.platform != "win32":
    import termios

_BY_ID: Final = Path("/dev/serial/by-id")
_WRITE_TIMEOUT: Final = 5.0
_MAX_READ_BYTES: Final = 4096

_RFC2217: Final = "rfc2217://"
_RFC2217_TIMEOUT: Final = 0.02
"""Fixed short timeout, s: over RFC 2217 every change of the timeout negotiates all settings of the port again."""


class PortInfo(Struct, frozen=True):
    """A serial port of this computer.

    Attributes:
        device: device name, such as `/dev/ttyACM0`; it may change after the cable was unplugged.
        by_id: persistent name of the board, "" if there is none.
        description: description reported by the board.
        vid, pid: USB vendor and product id, None if it is not a USB port.
        serial: serial number of the board, "" if it has none.
    """

    device: str
    by_id: str
    description: str
    vid: int | None
    pid: int | None
    serial: str

    @property
    def address(self) -> str:
        """Return the address to open: the persistent name if the board has one, else the device name."""
        return self.by_id or self.device


def list_ports(by_id: Path = _BY_ID) -> list[PortInfo]:
    """List the serial ports of this computer, USB ports first.

    Args:
        by_id: folder of persistent names, which are links to the devices.
    """
    names = _read_persistent_names(by_id)
    ports = [_make_port_info(port, names) for port in serial_list.comports()]
    return sorted(ports, key=lambda port: (port.vid is None, port.device))


def _read_persistent_names(folder: Path) -> dict[str, str]:
    """Read the persistent name of each device from a folder of links."""
    if not folder.is_dir():
        return {}
    return {str(link.resolve()): str(link) for link in sorted(folder.iterdir())}


def _make_port_info(port: ListPortInfo, names: dict[str, str]) -> PortInfo:
    """Convert a port found by pyserial; `names` holds the persistent name of each device."""
    return PortInfo(
        device=port.device,
        by_id=names.get(str(Path(port.device).resolve()), ""),
        description=port.description or "",
        vid=port.vid,
        pid=port.pid,
        serial=port.serial_number or "",
    )


def find_port_info(address: str, ports: Sequence[PortInfo] | None = None) -> PortInfo | None:
    """Find the port with an address; return None for a URL or an unknown device."""
    connected = list_ports() if ports is None else ports
    real = os.path.realpath(address)
    return next((port for port in connected if real in {os.path.realpath(port.device), port.by_id}), None)


def find_device_of_board(board: PortInfo, ports: Sequence[PortInfo] | None = None) -> str:
    """Find the current device name of a board; return an empty text if the board is not connected.

    The name may have changed after the cable was unplugged.

    Args:
        board: the board, as returned by `find_port_info`.
        ports: connected ports; None lists them.
    """
    connected = list_ports() if ports is None else ports
    for port in connected:
        if board.vid is not None and (port.vid, port.pid, port.serial) == (
            board.vid,
            board.pid,
            board.serial,
        ):
            return port.device
    return ""


def open_port(address: str, baud: int = 115200, *, dtr: bool | None = None) -> SerialPort:
    """Open a serial port for exclusive use.

    Args:
        address: device, persistent name, or URL.
        baud: baud rate.
        dtr: level of the DTR line, whose rising edge resets many boards; None: the default of the system, which raises
            it. DTR is not dropped on close, so opening the port again does not reset the board.

    Raises:
        PortError: the port does not exist, is in use, may not be opened, or does not support this baud rate.
    """
    # A TCP connection is always exclusive, and its handler ignores this setting.
    exclusive = None if "://" in address else True
    try:
        port = serial.serial_for_url(
            address,
            baudrate=baud,
            timeout=_RFC2217_TIMEOUT if address.startswith(_RFC2217) else 0,
            # pyserial's RFC 2217 port rejects a write timeout; it writes into a socket.
            write_timeout=None if address.startswith(_RFC2217) else _WRITE_TIMEOUT,
            exclusive=exclusive,
            do_not_open=True,
        )
        if dtr is not None:
            port.dtr = dtr
        port.open()
    except (serial.SerialException, OSError, ValueError, TypeError) as error:
        raise _make_open_error(address, error) from error
    # The default latency timer of 16 ms would cost two thirds of the throughput. Not every port supports this mode.
    with contextlib.suppress(AttributeError, NotImplementedError, OSError, ValueError):
        port.set_low_latency_mode(True)
    _preserve_dtr(port)
    return SerialPort(port, address)


def _preserve_dtr(port: serial.Serial) -> None:
    """Keep the level of DTR when the port is closed, so that the printer is not reset."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(AttributeError, OSError, ValueError, termios.error):
        modes = termios.tcgetattr(port.fileno())
        modes[2] &= ~termios.HUPCL
        termios.tcsetattr(port.fileno(), termios.TCSANOW, modes)


class SerialPort:
    """Byte stream to and from a printer over an open pyserial port."""

    def __init__(self, port: serial.Serial, address: str) -> None:
        self._port = port
        self._address = address
        self._selectable_descriptor = _find_selectable_descriptor(port)
        self._wake_reader, self._wake_writer = (
            os.pipe() if self._selectable_descriptor is not None else (-1, -1)
        )
        if self._wake_writer >= 0:
            os.set_blocking(self._wake_reader, False)
            os.set_blocking(self._wake_writer, False)

    def wake(self) -> None:
        """Interrupt the current or the next `read`. May be called by any thread and by a signal handler."""
        if self._wake_writer >= 0:
            # A full pipe wakes the reader as well.
            with contextlib.suppress(BlockingIOError, OSError):
                os.write(self._wake_writer, b"!")
        else:
            with contextlib.suppress(AttributeError, OSError, ValueError, TypeError):
                self._port.cancel_read()

    def write(self, data: bytes) -> None:
        """Write all bytes.

        Raises:
            PortError: the connection is lost, or the printer accepts no data for 5 s.
        """
        with self._translate_port_errors():
            self._port.write(data)

    def read(self, timeout: float) -> bytes:
        """Return received bytes; empty if none arrive within `timeout` seconds.

        Raises:
            PortError: the connection is lost.
        """
        with self._translate_port_errors():
            if self._selectable_descriptor is not None:
                # `select` is used, because changing the timeout of pyserial would reconfigure the port each time.
                ready, _, _ = select.select([self._selectable_descriptor, self._wake_reader], [], [], timeout)
                if self._wake_reader in ready:
                    os.read(self._wake_reader, _MAX_READ_BYTES)
                return (
                    bytes(self._port.read(_MAX_READ_BYTES)) if self._selectable_descriptor in ready else b""
                )
            first = self._read_first_byte(timeout)
            return first + bytes(self._port.read(self._port.in_waiting)) if first else b""

    def _read_first_byte(self, timeout: float) -> bytes:
        """Return one byte; empty if none arrives within `timeout` seconds."""
        if not self._address.startswith(_RFC2217):
            self._port.timeout = timeout
            return bytes(self._port.read(1))
        until = monotonic() + timeout
        first = bytes(self._port.read(1)) if timeout > 0.0 or self._port.in_waiting else b""
        while not first and monotonic() < until:
            first = bytes(self._port.read(1))
        return first

    def close(self) -> None:
        """Close the port."""
        self._selectable_descriptor = None
        for end in {self._wake_reader, self._wake_writer} - {-1}:
            os.close(end)
        self._wake_reader = self._wake_writer = -1
        # A port whose cable was unplugged may raise an error, which does not matter any more.
        with contextlib.suppress(OSError, ValueError):
            self._port.close()

    @contextlib.contextmanager
    def _translate_port_errors(self) -> Iterator[None]:
        """Turn errors of pyserial within a `with` block into `PortError`."""
        try:
            yield
        except serial.SerialTimeoutException as error:
            message = f"{self._address}: the printer accepts no data"
            raise PortError(message, remedy="Switch the printer off and on, and check the cable") from error
        except (OSError, TypeError, ValueError) as error:
            # pyserial raises OSError for an unplugged cable, TypeError or ValueError for a closed port.
            is_gone = "reports readiness" in str(error)  # what pyserial raises if a read returns nothing
            reason = "the device is gone, or another program reads from it" if is_gone else error
            message = f"{self._address}: connection lost: {reason}"
            raise PortError(message, remedy="Check the cable and power of the printer") from error


def _find_selectable_descriptor(port: serial.Serial) -> int | None:
    """Return a file descriptor that `select` can wait for, None if there is none."""
    try:
        descriptor = port.fileno()
        select.select([descriptor], [], [], 0.0)
    except (AttributeError, OSError, ValueError):
        return None
    return int(descriptor)


def _make_open_error(address: str, error: Exception) -> PortError:
    """Return the error for a port that cannot be opened, with a remedy."""
    code = getattr(error, "errno", None)
    if code in {errno.EACCES, errno.EPERM}:
        remedy = "Run sudo usermod -aG dialout $USER (on Arch: uucp), then log in again"
        return PortError(f"{address}: permission denied", remedy=remedy)
    if code in {errno.EBUSY, errno.EAGAIN}:
        remedy = "Close the other program: a slicer, a serial monitor, or another print"
        owner = next(
            (
                f"{name} (process {number})"
                for number, name in find_processes_using(os.path.realpath(address))
            ),
            "",
        )
        return PortError(f"{address} is in use by {owner or 'another program'}", remedy=remedy)
    if code in {errno.ENOENT, errno.ENODEV, errno.ENXIO}:
        return PortError(f"there is no port {address}", remedy=_describe_available_ports(list_ports()))
    if code == errno.ENOTTY or "Inappropriate ioctl" in str(error):
        return PortError(f"{address} is not a serial port", remedy=_describe_available_ports(list_ports()))
    if "://" in address:
        remedy = "Use socket://HOST:PORT or rfc2217://HOST:PORT for an address on the network"
        # pyserial raises an internal error if the port number is missing.
        reason = "the port number is missing" if "NoneType" in str(error) else error
        return PortError(f"{address} cannot be opened: {reason}", remedy=remedy)
    return PortError(f"{address} cannot be opened: {error}", remedy="Check the port name and the baud rate")


def _describe_available_ports(ports: list[PortInfo]) -> str:
    """Return a remedy that lists the available ports."""
    if not ports:
        return "No serial port was found. Check the cable and power"
    return "Available ports: " + ", ".join(port.address for port in ports)


def find_processes_using(device: str, proc: Path = Path("/proc")) -> Iterator[tuple[int, str]]:
    """Yield the id and name of each other process that has a device open.

    Processes of other users are not visible, and systems without `proc` yield none. Source: Linux documentation of
    /proc/PID/fd and /proc/PID/comm.

    Args:
        device: resolved path of the device.
        proc: folder of the process file system.
    """
    for folder in sorted(proc.glob("[0-9]*")):
        if folder.name == str(os.getpid()):
            continue
        # Processes may end meanwhile, and those of other users do not show their open files.
        with contextlib.suppress(OSError):
            if any(_is_link_to(link, device) for link in (folder / "fd").iterdir()):
                yield int(folder.name), (folder / "comm").read_text(errors="replace").strip()


def _is_link_to(link: Path, device: str) -> bool:
    """Return whether a symbolic link points to a device; False if the link cannot be read."""
    try:
        return str(link.readlink()) == device
    except OSError:
        return False
