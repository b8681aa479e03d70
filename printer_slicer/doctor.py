"""Diagnose connection problems: check a serial port and the printer behind it.

The port is checked without opening it: its permissions, the processes that have it open, and the latency timer of its
chip. Facts that the system does not report are left out. Then the printer reports its firmware and capabilities. The
line rate is measured with commands that change nothing: dwells of zero length (`G4 P0.000...`), as long as the lines of
a print, with line numbers and checksums. Nothing heats or moves. Some boards reset when the port is opened, as they do
for a print.

Source: Linux's documentation of `latency_timer` (ftdi_sio) and of /proc/PID/fd.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median, quantiles
from typing import Final, Literal

from printer_slicer.stream.events import Accepted, Event, Halted, Identified, Temperature
from printer_slicer.stream.framing import frame
from printer_slicer.stream.link_meter import LinkMeter, LinkStatistics, MeteredTransport
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import find_processes_using
from printer_slicer.stream.session import Transport, run
from printer_slicer.values import Struct

if sys.platform != "win32":
    import grp

__all__ = ["PortCheck", "PortState", "PrinterDiagnosis", "diagnose_printer", "read_port_state"]


class PortCheck(Struct, frozen=True):
    """The result of one check.

    Attributes:
        name: name of the check, such as `permission`.
        state: `good`; `warn` if a print may have problems; `bad` if no print can start.
        what: finding, in words.
        remedy: action that solves the problem; empty if there is none.
    """

    name: str
    state: Literal["good", "warn", "bad"]
    what: str
    remedy: str = ""


_SLOW_TIMER_MS: Final = 2
"""Period of the latency timer from which on answers count as delayed, ms; chips allow at least 1 ms."""


_PSEUDO_TERMINALS: Final = "/dev/pts/"


class PortState(Struct, frozen=True):
    """The state of a port as the system reports it.

    Attributes:
        address: address that the user gave.
        device: path of the device after all symbolic links are followed.
        exists: whether the device exists.
        is_port: whether it is a character device.
        may_open: whether the current user may open it.
        group: group that owns the device; empty if unknown.
        in_group: whether the current user is in this group.
        latency_timer: time that the USB chip waits for more bytes, ms; None if it has no such timer.
        holders: id and name of each other visible process that has the device open.
    """

    address: str
    device: str
    exists: bool
    is_port: bool
    may_open: bool
    group: str
    in_group: bool
    latency_timer: int | None
    holders: tuple[tuple[int, str], ...]

    def run_checks(self) -> Iterator[PortCheck]:
        """Check the port, and yield the result of each check."""
        if not self.exists:
            yield PortCheck(
                "port",
                "bad",
                f"{self.address} does not exist",
                "Check cable and power; run `printer-slicer ports` to list the ports",
            )
            return
        if not self.is_port:
            yield PortCheck(
                "port",
                "bad",
                f"{self.address} is not a serial port",
                "Run `printer-slicer ports` to list the ports",
            )
            return
        device = f" ({self.device})" if self.device != self.address else ""
        yield PortCheck("port", "good", f"{self.address}{device} exists")
        yield self._check_permission()
        yield self._check_use()
        if self.latency_timer is not None:
            yield self._check_latency_timer()

    def _check_permission(self) -> PortCheck:
        """Check whether the current user may open the port."""
        if self.may_open:
            return PortCheck("permission", "good", "you have permission to open the port")
        remedy = "Log out and in again, so that your membership in the group takes effect"
        if not self.in_group and self.group:
            remedy = f"Run sudo usermod -aG {self.group} $USER, then log out and in again"
        return PortCheck(
            "permission",
            "bad",
            f"you have no permission to open the port, which belongs to the group {self.group}",
            remedy,
        )

    def _check_use(self) -> PortCheck:
        """Check whether other processes have the port open."""
        if not self.holders:
            return PortCheck("in use", "good", "no other visible process has the port open")
        who = ", ".join(f"{name} ({pid})" for pid, name in self.holders)
        known = {"ModemManager": "Run sudo systemctl disable --now ModemManager"}
        remedy = next(
            (known[name] for _, name in self.holders if name in known), "Close the programs that use the port"
        )
        return PortCheck("in use", "bad", f"the port is open in {who}", remedy)

    def _check_latency_timer(self) -> PortCheck:
        """Check whether the latency timer of the USB chip delays answers."""
        timer = self.latency_timer or 0
        if timer < _SLOW_TIMER_MS:
            return PortCheck("latency timer", "good", f"{timer} ms")
        return PortCheck(
            "latency timer",
            "warn",
            f"{timer} ms: each answer may be delayed by this time",
            "`print` sets a low latency when it opens the port. "
            f"To set it by hand: echo 1 | sudo tee /sys/class/tty/{Path(self.device).name}/device/latency_timer",
        )


def read_port_state(
    address: str, *, proc: Path = Path("/proc"), ttys: Path = Path("/sys/class/tty")
) -> PortState:
    """Return the state of a port as the system reports it, without opening it.

    Args:
        address: path of the device, or a symbolic link to it.
        proc: folder with the processes of the system.
        ttys: folder with the serial devices of the system.
    """
    path = Path(address)
    exists = path.exists()
    device = os.path.realpath(path) if exists else address
    is_port = exists and stat.S_ISCHR(path.stat().st_mode)
    may = exists and os.access(path, os.R_OK | os.W_OK)
    group, member = _read_group(path) if exists else ("", False)
    return PortState(
        address,
        device,
        exists,
        is_port,
        may,
        group,
        member,
        _read_latency_timer(device, ttys),
        tuple(_find_holders(device, proc)),
    )


def _read_group(path: Path) -> tuple[str, bool]:
    """Return the group that owns a device, and whether the current user is in it."""
    if sys.platform == "win32":
        return "", True
    number = path.stat().st_gid
    try:
        name = grp.getgrgid(number).gr_name
    except KeyError:
        name = str(number)
    return name, number in {os.getegid(), *os.getgroups()}


def _read_latency_timer(device: str, ttys: Path) -> int | None:
    """Return the period of the latency timer of a device, ms; None if it has no such timer."""
    try:
        return int((ttys / Path(device).name / "device" / "latency_timer").read_text())
    except (OSError, ValueError):
        return None


def _find_holders(device: str, proc: Path) -> Iterator[tuple[int, str]]:
    """Yield id and name of the other processes that have a device open, except for pseudo-terminals.

    The server of a pseudo-terminal always has it open.
    """
    return iter(()) if device.startswith(_PSEUDO_TERMINALS) else find_processes_using(device, proc)


_TEST_LINE: Final = b"G4 P0.000000000000000000000"  # 38 bytes with number, checksum and line break
_SINGLE_LINES: Final = 60  # number of lines sent with one line in flight
_PAIRED_LINES: Final = 240  # number of lines sent with two lines in flight
_CONNECT_TIMEOUT: Final = 15.0  # s
_SLOW_ANSWER: Final = 0.008
"""Time without transmission, s, beyond which an answer is slow, for example because of a latency timer or a hub."""

_MIN_RATE_RATIO: Final = 0.7  # minimum line rate, as a fraction of the rate that the baud rate allows
_USED_CAPABILITIES: Final = (
    "EMERGENCY_PARSER",
    "AUTOREPORT_TEMP",
    "HOST_ACTION_COMMANDS",
    "PROMPT_SUPPORT",
    "ARCS",
    "SDCARD",
)


class PrinterDiagnosis(Struct, frozen=True):
    """The reports of a printer and its response times, s.

    Attributes:
        firmware: name of the firmware; empty if it reports none.
        capabilities: reported capabilities.
        temperatures: name and temperature of each heater, °C.
        baud: baud rate of the port.
        answer, answer_95: median and 95th percentile of the time from a line to its acknowledgement, with one line in
            flight; None if too few lines were acknowledged.
        lines_per_second: line rate with two lines in flight; None if too few lines were acknowledged.
        wire: line rate that the baud rate allows, lines/s.
        link: statistics of the whole conversation.
        halted: reason why the conversation ended early; empty if it did not.
    """

    firmware: str
    capabilities: tuple[tuple[str, bool], ...]
    temperatures: tuple[tuple[str, float], ...]
    baud: int
    answer: float | None
    answer_95: float | None
    lines_per_second: float | None
    wire: float
    link: LinkStatistics
    halted: str

    def run_checks(self) -> Iterator[PortCheck]:
        """Check the reports and response times of the printer, and yield the result of each check."""
        if self.halted:
            remedy = "Check the port, the baud rate (--baud), the cable, and whether the printer is on"
            yield PortCheck("printer", "bad", self.halted, remedy)
            return
        yield PortCheck(
            "printer", "good", self.firmware or "the printer answers, but does not report its firmware"
        )
        yield from self._check_capabilities()
        if self.temperatures:
            readings = ", ".join(f"{name} {value:g} °C" for name, value in self.temperatures)
            yield PortCheck("temperatures", "good", readings)
        yield from self._check_speed()

    def _check_capabilities(self) -> Iterator[PortCheck]:
        """Check the capabilities and the thermal protection."""
        known = dict(self.capabilities)
        if not known:
            yield PortCheck("capabilities", "good", "the firmware reports no capabilities")
            return
        has = [name for name in _USED_CAPABILITIES if known.get(name)]
        lacks = [name for name in _USED_CAPABILITIES if known.get(name) is False]
        yield PortCheck(
            "capabilities",
            "good",
            f"{', '.join(has) or 'none that `print` uses'}" + (f"; not {', '.join(lacks)}" if lacks else ""),
        )
        protected = known.get("THERMAL_PROTECTION")
        if protected is False:
            yield PortCheck(
                "thermal protection",
                "bad",
                "the firmware reports no thermal protection, so nothing stops a heater that overheats",
                "Build the firmware with THERMAL_PROTECTION_HOTENDS and THERMAL_PROTECTION_BED; "
                "do not leave the printer unattended",
            )
        elif protected:
            yield PortCheck("thermal protection", "good", "enabled")

    def _check_speed(self) -> Iterator[PortCheck]:
        """Check response time, line rate and transmission errors."""
        if self.answer is None or self.answer_95 is None or self.lines_per_second is None:
            yield PortCheck(
                "line rate",
                "warn",
                "too few lines were acknowledged to measure the line rate",
                "Run `printer-slicer doctor` again",
            )
            return
        over = self.answer - (1 / self.wire)
        times = f"{self.answer * 1000:.1f} ms, 95 % within {self.answer_95 * 1000:.1f} ms"
        if over > _SLOW_ANSWER:
            yield PortCheck(
                "answers",
                "warn",
                f"{times}, which is slow",
                "Check the latency timer of the USB chip, USB hubs and the load of the computer",
            )
        else:
            yield PortCheck("answers", "good", times)
        rate = f"{self.lines_per_second:.0f} lines/s with two lines in flight; the baud rate allows {self.wire:.0f}"
        slow = self.lines_per_second < _MIN_RATE_RATIO * self.wire
        advice = (
            f"Check files with `printer-slicer check FILE --link {self.baud} --latency {over * 1000:.0f}`. "
            f"Slice with --set printer.link_lines_per_second={int(0.95 * self.lines_per_second)}"
        )
        yield PortCheck("line rate", "warn" if slow else "good", rate, advice if slow else "")
        if self.link.resends or self.link.lost_answers:
            yield PortCheck(
                "errors",
                "warn",
                f"{self.link.resends} resends, {self.link.lost_answers} lost acknowledgements",
                "Use a better or shorter cable, another USB port, and no hub",
            )
        else:
            yield PortCheck("errors", "good", f"no errors in {self.link.lines} lines")


def diagnose_printer(
    transport: Transport,
    clock: Callable[[], float],
    *,
    baud: int,
    on_event: Callable[[Event], None] = lambda _: None,
) -> PrinterDiagnosis:
    """Query the printer at an open port, and measure its response times.

    Args:
        transport: the open port.
        clock: monotonic time, s.
        baud: baud rate of the port, for the line rate that it allows.
        on_event: function that is called with each event of the stream.

    Raises:
        PortError: the connection is lost.
    """
    meter = LinkMeter()
    listener = _Listener(clock, on_event, meter)
    metered = MeteredTransport(transport, meter, clock)
    single = _measure_ack_times(metered, clock, listener, lines=_SINGLE_LINES, window=1)
    paired = (
        [] if listener.halted else _measure_ack_times(metered, clock, listener, lines=_PAIRED_LINES, window=2)
    )
    waits = sorted(after - before for before, after in pairwise(single))
    rate = (len(paired) - 1) / (paired[-1] - paired[0]) if len(paired) > 10 else None
    return PrinterDiagnosis(
        firmware=listener.firmware,
        capabilities=listener.capabilities,
        temperatures=listener.temperatures,
        baud=baud,
        answer=median(waits) if len(waits) > 10 else None,
        answer_95=quantiles(waits, n=20)[-1] if len(waits) > 10 else None,
        lines_per_second=rate,
        wire=baud / 10 / (len(frame(100, _TEST_LINE)) + 1),
        link=meter.statistics(),
        halted=listener.halted,
    )


def _measure_ack_times(
    transport: Transport, clock: Callable[[], float], listener: _Listener, *, lines: int, window: int
) -> list[float]:
    """Send test lines in a new session; return the time at which each was acknowledged, s."""
    listener.times = []
    streamer = Streamer([_TEST_LINE] * lines, window_lines=window, connect_timeout=_CONNECT_TIMEOUT)
    run(streamer, transport, clock, on_event=listener)
    return listener.times


class _Listener:
    """Collects the facts for the diagnosis from the events of a stream."""

    def __init__(
        self, clock: Callable[[], float], on_event: Callable[[Event], None], meter: LinkMeter
    ) -> None:
        self._clock, self._on_event, self._meter = clock, on_event, meter
        self.times: list[float] = []
        self.firmware, self.halted = "", ""
        self.capabilities: tuple[tuple[str, bool], ...] = ()
        self.temperatures: tuple[tuple[str, float], ...] = ()

    def __call__(self, event: Event) -> None:
        self._meter.on_event(event)
        if isinstance(event, Accepted):
            self.times.append(self._clock())
        elif isinstance(event, Identified):
            self.firmware, self.capabilities = event.firmware, event.capabilities
        elif isinstance(event, Temperature):
            self.temperatures = tuple((one.name, one.actual) for one in event.readings)
        elif isinstance(event, Halted):
            self.halted = event.reason
        self._on_event(event)
