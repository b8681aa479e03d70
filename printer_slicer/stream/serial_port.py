"""Serial ports and their look-alikes: opening, errors with a way out, what is plugged in, and who has it open.

The only file of the host that imports pyserial. Addresses are names of devices (`/dev/ttyACM0`, `COM3`) or URLs that
pyserial understands (`socket://host:port`, `rfc2217://host:port`, `loop://`).
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import sys
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Final

import serial
from serial.tools import list_ports as serial_list

from printer_slicer.errors import PortError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from serial.tools.list_ports_common import ListPortInfo

__all__ = ["PortInfo", "SerialPort", "find_again", "holders", "identity", "list_ports", "open_port"]

if sys.platform != "win32":
    import termios

_BY_ID: Final = Path("/dev/serial/by-id")
_WRITE_TIMEOUT: Final = 5.0
_CHUNK: Final = 4096

_OVER_TELNET: Final = "rfc2217://"
_GLANCE: Final = 0.02
"""s; over RFC 2217 every change of the timeout settles all settings of the port anew, so it stays this short one."""


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A serial port of this computer.

    Attributes:
        device: its name, such as `/dev/ttyACM0`; may be another one after the cable was pulled.
        by_id: a name that stays with the board, "" if there is none.
        description: what the board says it is.
        vid, pid: USB vendor and product, None if it is not on USB.
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
        """The name to open it by: the lasting one if there is one."""
        return self.by_id or self.device


def list_ports(by_id: Path = _BY_ID) -> list[PortInfo]:
    """The serial ports of this computer, those on USB first: a printer hardly ever is on another.

    Args:
        by_id: folder of lasting names, links to the devices.
    """
    names = _lasting_names(by_id)
    ports = [_port_info(port, names) for port in serial_list.comports()]
    return sorted(ports, key=lambda port: (port.vid is None, port.device))


def _lasting_names(folder: Path) -> dict[str, str]:
    """Device to lasting name."""
    if not folder.is_dir():
        return {}
    return {str(link.resolve()): str(link) for link in sorted(folder.iterdir())}


def _port_info(port: ListPortInfo, names: dict[str, str]) -> PortInfo:
    return PortInfo(
        device=port.device,
        by_id=names.get(str(Path(port.device).resolve()), ""),
        description=port.description or "",
        vid=port.vid,
        pid=port.pid,
        serial=port.serial_number or "",
    )


def identity(address: str, ports: Sequence[PortInfo] | None = None) -> PortInfo | None:
    """What is known about the board behind a device name; None for a URL, and for a device that is no USB board."""
    there = list_ports() if ports is None else ports
    real = os.path.realpath(address)
    return next((port for port in there if real in {os.path.realpath(port.device), port.by_id}), None)


def find_again(board: PortInfo, ports: Sequence[PortInfo] | None = None) -> str:
    """Where a board is now, empty if it is not there: its device may have another name after the cable was pulled.

    Args:
        board: as `identity` knew it.
        ports: what is plugged in; None looks.
    """
    there = list_ports() if ports is None else ports
    for port in there:
        if board.vid is not None and (port.vid, port.pid, port.serial) == (
            board.vid,
            board.pid,
            board.serial,
        ):
            return port.device
    return ""


def open_port(address: str, baud: int = 115200, *, dtr: bool | None = None) -> SerialPort:
    """The port behind an address, for this program alone.

    Args:
        address: device, lasting name, or URL.
        baud: its speed.
        dtr: the wanted level of the line that resets many boards when it rises; None: as the system does, which raises
            it. It is not let fall at the end, so the next one who opens the port resets nothing.

    Raises:
        PortError: it does not exist, is in use, may not be opened, or cannot do this speed.
    """
    # Nobody else can write into a TCP connection, and its handler would ignore the wish.
    exclusive = None if "://" in address else True
    try:
        port = serial.serial_for_url(
            address,
            baudrate=baud,
            timeout=_GLANCE if address.startswith(_OVER_TELNET) else 0,
            # pyserial's RFC 2217 refuses one; what it writes goes into a socket.
            write_timeout=None if address.startswith(_OVER_TELNET) else _WRITE_TIMEOUT,
            exclusive=exclusive,
            do_not_open=True,
        )
        if dtr is not None:
            port.dtr = dtr
        port.open()
    except (serial.SerialException, OSError, ValueError, TypeError) as error:
        raise _refused(address, error) from error
    # The usual 16 ms of a USB-UART would cost two thirds of the speed. Not every port has the switch.
    with contextlib.suppress(AttributeError, NotImplementedError, OSError, ValueError):
        port.set_low_latency_mode(True)
    _keep_dtr(port)
    return SerialPort(port, address)


def _keep_dtr(port: serial.Serial) -> None:
    """Let DTR stay when the port is closed, or its owner killed: a printer must not be reset by a host that goes."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(AttributeError, OSError, ValueError, termios.error):
        modes = termios.tcgetattr(port.fileno())
        modes[2] &= ~termios.HUPCL
        termios.tcsetattr(port.fileno(), termios.TCSANOW, modes)


class SerialPort:
    """A transport over an open port of pyserial."""

    def __init__(self, port: serial.Serial, address: str) -> None:
        self._port = port
        self._address = address
        self._descriptor = _descriptor(port)
        self._ear, self._bell = os.pipe() if self._descriptor is not None else (-1, -1)
        if self._bell >= 0:
            os.set_blocking(self._ear, False)
            os.set_blocking(self._bell, False)

    def wake(self) -> None:
        """End a `read` that waits, now or the next one. May be called by any thread, and by a signal handler."""
        if self._bell >= 0:
            # A full pipe wakes as well.
            with contextlib.suppress(BlockingIOError, OSError):
                os.write(self._bell, b"!")
        else:
            with contextlib.suppress(AttributeError, OSError, ValueError, TypeError):
                self._port.cancel_read()

    def write(self, data: bytes) -> None:
        """Hand over all bytes.

        Raises:
            PortError: the printer is gone, or takes nothing for 5 s.
        """
        with self._gone():
            self._port.write(data)

    def read(self, timeout: float) -> bytes:
        """What has come, as soon as there is something, empty after `timeout` seconds without.

        Raises:
            PortError: the printer is gone.
        """
        with self._gone():
            if self._descriptor is not None:
                # Changing pyserial's own timeout would configure the port anew, each time.
                ready, _, _ = select.select([self._descriptor, self._ear], [], [], timeout)
                if self._ear in ready:
                    os.read(self._ear, _CHUNK)
                return bytes(self._port.read(_CHUNK)) if self._descriptor in ready else b""
            first = self._first_byte(timeout)
            return first + bytes(self._port.read(self._port.in_waiting)) if first else b""

    def _first_byte(self, timeout: float) -> bytes:
        """A byte that has come within `timeout` seconds, or none."""
        if not self._address.startswith(_OVER_TELNET):
            self._port.timeout = timeout
            return bytes(self._port.read(1))
        until = monotonic() + timeout
        first = bytes(self._port.read(1)) if timeout > 0.0 or self._port.in_waiting else b""
        while not first and monotonic() < until:
            first = bytes(self._port.read(1))
        return first

    def close(self) -> None:
        """Let go of the port."""
        self._descriptor = None
        for end in {self._ear, self._bell} - {-1}:
            os.close(end)
        self._ear = self._bell = -1
        # A port whose cable was pulled may complain; there is nothing left to lose.
        with contextlib.suppress(OSError, ValueError):
            self._port.close()

    @contextlib.contextmanager
    def _gone(self) -> Iterator[None]:
        try:
            yield
        except serial.SerialTimeoutException as error:
            message = f"{self._address} takes no bytes"
            raise PortError(message, remedy="switch the printer off and on, and look at the cable") from error
        except (OSError, TypeError, ValueError) as error:
            # pyserial says OSError for a pulled plug, TypeError or ValueError for a port that is closed.
            message = f"{self._address} is gone: {error}"
            raise PortError(message, remedy="look at cable and power of the printer") from error


def _descriptor(port: serial.Serial) -> int | None:
    """A file descriptor that `select` can wait for, None where there is none."""
    try:
        descriptor = port.fileno()
        select.select([descriptor], [], [], 0.0)
    except (AttributeError, OSError, ValueError):
        return None
    return int(descriptor)


def _refused(address: str, error: Exception) -> PortError:
    """Why a port cannot be opened, and the way out."""
    code = getattr(error, "errno", None)
    if code in {errno.EACCES, errno.EPERM}:
        remedy = "sudo usermod -aG dialout $USER (on Arch: uucp), then log in again"
        return PortError(f"{address}: you may not open it", remedy=remedy)
    if code in {errno.EBUSY, errno.EAGAIN}:
        remedy = "close the other program: a slicer, a monitor, a second copy of this one"
        owner = next(
            (f"{name} (process {number})" for number, name in holders(os.path.realpath(address))), ""
        )
        return PortError(f"{address} is in use by {owner or 'another program'}", remedy=remedy)
    if code in {errno.ENOENT, errno.ENODEV, errno.ENXIO}:
        return PortError(f"there is no port {address}", remedy=_what_is_there(list_ports()))
    if code == errno.ENOTTY or "Inappropriate ioctl" in str(error):
        return PortError(f"{address} is not a serial port", remedy=_what_is_there(list_ports()))
    if "://" in address:
        remedy = "an address on the network is socket://HOST:PORT or rfc2217://HOST:PORT"
        # pyserial passes on what goes wrong inside it when the number of the port is missing.
        reason = "the port number is missing" if "NoneType" in str(error) else error
        return PortError(f"{address} cannot be opened: {reason}", remedy=remedy)
    return PortError(f"{address} cannot be opened: {error}", remedy="look at the name and the speed")


def _what_is_there(ports: list[PortInfo]) -> str:
    if not ports:
        return "no serial port was found: look at cable and power"
    return "found: " + ", ".join(port.address for port in ports)


def holders(device: str, proc: Path = Path("/proc")) -> Iterator[tuple[int, str]]:
    """Number and name of each other process that has a device open, named as links lead to it.

    Those of other people are not to be seen, and nobody is found where there is no such folder. Source: Linux's
    documentation of /proc/PID/fd and /proc/PID/comm.
    """
    for folder in sorted(proc.glob("[0-9]*")):
        if folder.name == str(os.getpid()):
            continue
        # Processes come and go, and those of others do not show what they have open.
        with contextlib.suppress(OSError):
            if any(_leads(link, device) for link in (folder / "fd").iterdir()):
                yield int(folder.name), (folder / "comm").read_text(errors="replace").strip()


def _leads(link: Path, device: str) -> bool:
    try:
        return str(link.readlink()) == device
    except OSError:
        return False
