"""What keeps a printer from being printed to: the port as the system has it, and the printer behind it.

The port is looked at without opening it: whose it is, who holds it, how long a chip waits. Where the system does not
say, nothing is said. Then the printer: who it is, what it can do, how fast lines go, by commands that change nothing.
These are dwells of no time (`G4 P0.000...`), as long as the lines of a print, numbered and checked as those are.
Nothing heats, nothing moves. On boards that reset when their port is opened, opening it does so, as printing would.

Source: Linux's documentation of `latency_timer` (ftdi_sio) and of /proc/PID/fd.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median, quantiles
from typing import Final, Literal

from printer_slicer.stream.events import Accepted, Event, Halted, Identified, Temperature
from printer_slicer.stream.framing import frame
from printer_slicer.stream.link_meter import LinkMeter, LinkStatistics, MeteredTransport
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import holders
from printer_slicer.stream.session import Transport, run

if sys.platform != "win32":
    import grp

__all__ = ["PortCheck", "PortState", "PrinterDiagnosis", "diagnose_printer", "state_of"]


@dataclass(frozen=True, slots=True)
class PortCheck:
    """One thing that was looked at.

    Attributes:
        name: of it, such as `permission`.
        state: `good`; `warn` where a print may suffer; `bad` where none can begin.
        what: was found.
        remedy: what to do about it, "" where nothing needs to be done.
    """

    name: str
    state: Literal["good", "warn", "bad"]
    what: str
    remedy: str = ""


_SLOW_TIMER: Final = 2
"""ms of a latency timer from which on every answer is late; 1 is the least."""


_PSEUDO: Final = "/dev/pts/"


@dataclass(frozen=True, slots=True)
class PortState:
    """What the system says of a port.

    Attributes:
        address: as it was named.
        device: what that leads to.
        exists: whether there is such a thing.
        is_port: whether it is a device that bytes can go through.
        may_open: whether this person may.
        group: that owns it, "" if not known.
        in_group: whether this person is one of them.
        latency_timer: ms that its chip waits for more bytes, None where there is none.
        holders: who else has it open: number and name of each process that can be seen.
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

    def checks(self) -> Iterator[PortCheck]:
        """What is made of it."""
        if not self.exists:
            yield PortCheck(
                "port",
                "bad",
                f"there is no {self.address}",
                "look at cable and power; `printer-slicer ports`",
            )
            return
        if not self.is_port:
            yield PortCheck(
                "port", "bad", f"{self.address} is no serial port", "`printer-slicer ports` lists them"
            )
            return
        leads = f" ({self.device})" if self.device != self.address else ""
        yield PortCheck("port", "good", f"{self.address}{leads} is there")
        yield self._permission()
        yield self._held()
        if self.latency_timer is not None:
            yield self._latency()

    def _permission(self) -> PortCheck:
        if self.may_open:
            return PortCheck("permission", "good", "you may open it")
        remedy = "log in again, so that the group counts"
        if not self.in_group and self.group:
            remedy = f"sudo usermod -aG {self.group} $USER, then log in again"
        return PortCheck(
            "permission", "bad", f"you may not open it; it belongs to the group {self.group}", remedy
        )

    def _held(self) -> PortCheck:
        if not self.holders:
            return PortCheck("in use", "good", "no other program is seen to have it open")
        who = ", ".join(f"{name} ({pid})" for pid, name in self.holders)
        known = {"ModemManager": "sudo systemctl disable --now ModemManager"}
        remedy = next((known[name] for _, name in self.holders if name in known), "close it there")
        return PortCheck("in use", "bad", f"held by {who}", remedy)

    def _latency(self) -> PortCheck:
        timer = self.latency_timer or 0
        if timer < _SLOW_TIMER:
            return PortCheck("latency timer", "good", f"{timer} ms")
        return PortCheck(
            "latency timer",
            "warn",
            f"{timer} ms: every answer may wait so long",
            "`print` asks for low latency when it opens the port; "
            f"by hand: echo 1 | sudo tee /sys/class/tty/{Path(self.device).name}/device/latency_timer",
        )


def state_of(address: str, *, proc: Path = Path("/proc"), ttys: Path = Path("/sys/class/tty")) -> PortState:
    """Ask the system about a port.

    Args:
        address: its name, or a link to it.
        proc: where the system tells of processes.
        ttys: where it tells of serial devices.
    """
    path = Path(address)
    exists = path.exists()
    device = os.path.realpath(path) if exists else address
    is_port = exists and stat.S_ISCHR(path.stat().st_mode)
    may = exists and os.access(path, os.R_OK | os.W_OK)
    group, member = _group(path) if exists else ("", False)
    return PortState(
        address,
        device,
        exists,
        is_port,
        may,
        group,
        member,
        _timer(device, ttys),
        tuple(_holders(device, proc)),
    )


def _group(path: Path) -> tuple[str, bool]:
    if sys.platform == "win32":
        return "", True
    number = path.stat().st_gid
    try:
        name = grp.getgrgid(number).gr_name
    except KeyError:
        name = str(number)
    return name, number in {os.getegid(), *os.getgroups()}


def _timer(device: str, ttys: Path) -> int | None:
    try:
        return int((ttys / Path(device).name / "device" / "latency_timer").read_text())
    except (OSError, ValueError):
        return None


def _holders(device: str, proc: Path) -> Iterator[tuple[int, str]]:
    """Other processes that have the device open; who serves a pseudo-terminal holds it."""
    return iter(()) if device.startswith(_PSEUDO) else holders(device, proc)


_LINE: Final = b"G4 P0.000000000000000000000"  # 38 bytes with number, checksum and line break
_ALONE: Final = 60
_ABREAST: Final = 240
_PATIENCE: Final = 15.0  # s for a printer to answer at all
_LATE: Final = 0.008  # s of an answer over what its bytes take: a latency timer, or a hub
_SLOW: Final = 0.7  # of the lines that the wire could bring
_WORTH: Final = (
    "EMERGENCY_PARSER",
    "AUTOREPORT_TEMP",
    "HOST_ACTION_COMMANDS",
    "PROMPT_SUPPORT",
    "ARCS",
    "SDCARD",
)


@dataclass(frozen=True, slots=True)
class PrinterDiagnosis:
    """What a printer said, and how fast. Times in s.

    Attributes:
        firmware: as it names itself; "" if it does not.
        capabilities: as it says them.
        temperatures: heater, °C.
        baud: of the port.
        answer, answer_95: from a line to its ok with one line in flight: half of them, and 95 %, took no longer; None
            where too few were answered.
        lines_per_second: with two in flight; None likewise.
        wire: lines/s that the wire could bring.
        link: of all of it.
        halted: why it ended early; "" if it did not.
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

    def checks(self) -> Iterator[PortCheck]:
        """What is made of it."""
        if self.halted:
            remedy = "is it the right port, speed (--baud), and cable? is the printer on?"
            yield PortCheck("printer", "bad", self.halted, remedy)
            return
        yield PortCheck("printer", "good", self.firmware or "answers, and does not say who it is")
        yield from self._capabilities()
        if self.temperatures:
            told = ", ".join(f"{name} {value:g} °C" for name, value in self.temperatures)
            yield PortCheck("temperatures", "good", told)
        yield from self._speed()

    def _capabilities(self) -> Iterator[PortCheck]:
        known = dict(self.capabilities)
        if not known:
            yield PortCheck("capabilities", "good", "it tells none")
            return
        has = [name for name in _WORTH if known.get(name)]
        lacks = [name for name in _WORTH if known.get(name) is False]
        yield PortCheck(
            "capabilities", "good", f"{', '.join(has) or 'none of note'}; not {', '.join(lacks) or 'lacking'}"
        )
        protected = known.get("THERMAL_PROTECTION")
        if protected is False:
            yield PortCheck(
                "thermal protection",
                "bad",
                "the firmware says that it has none: a heater that runs away is stopped by nobody",
                "build it with THERMAL_PROTECTION_HOTENDS and THERMAL_PROTECTION_BED, and stay with it until then",
            )
        elif protected:
            yield PortCheck("thermal protection", "good", "yes")

    def _speed(self) -> Iterator[PortCheck]:
        if self.answer is None or self.answer_95 is None or self.lines_per_second is None:
            yield PortCheck("line rate", "warn", "too few lines were answered to tell", "try again")
            return
        over = self.answer - (1 / self.wire)
        said = f"{self.answer * 1000:.1f} ms, 95 % within {self.answer_95 * 1000:.1f} ms"
        if over > _LATE:
            yield PortCheck(
                "answers",
                "warn",
                f"{said}: late",
                "look at the chip's latency timer, a hub, or a busy computer",
            )
        else:
            yield PortCheck("answers", "good", said)
        rate = f"{self.lines_per_second:.0f} lines/s with two in flight, the wire could bring {self.wire:.0f}"
        slow = self.lines_per_second < _SLOW * self.wire
        advice = (
            f"check files with `printer-slicer check FILE --link {self.baud} --latency {over * 1000:.0f}`; "
            f"slice for it: --set printer.link_lines_per_second={int(0.95 * self.lines_per_second)}"
        )
        yield PortCheck("line rate", "warn" if slow else "good", rate, advice if slow else "")
        if self.link.resends or self.link.lost_answers:
            yield PortCheck(
                "errors",
                "warn",
                f"{self.link.resends} lines were asked for again, {self.link.lost_answers} answers were missing",
                "a better or shorter cable, another port, no hub",
            )
        else:
            yield PortCheck("errors", "good", f"none in {self.link.lines} lines")


def diagnose_printer(
    transport: Transport,
    clock: Callable[[], float],
    *,
    baud: int,
    on_event: Callable[[Event], None] = lambda _: None,
) -> PrinterDiagnosis:
    """Talk to the printer at the other end of an open port.

    Args:
        transport: to it.
        clock: s.
        baud: of the port, for what the wire could bring.
        on_event: is told what happens.

    Raises:
        PortError: the port went away.
    """
    meter = LinkMeter()
    listener = _Listener(clock, on_event, meter)
    metered = MeteredTransport(transport, meter, clock)
    alone = _times(metered, clock, listener, lines=_ALONE, window=1)
    abreast = [] if listener.halted else _times(metered, clock, listener, lines=_ABREAST, window=2)
    waits = sorted(after - before for before, after in pairwise(alone))
    rate = (len(abreast) - 1) / (abreast[-1] - abreast[0]) if len(abreast) > 10 else None
    return PrinterDiagnosis(
        firmware=listener.firmware,
        capabilities=listener.capabilities,
        temperatures=listener.temperatures,
        baud=baud,
        answer=median(waits) if len(waits) > 10 else None,
        answer_95=quantiles(waits, n=20)[-1] if len(waits) > 10 else None,
        lines_per_second=rate,
        wire=baud / 10 / (len(frame(100, _LINE)) + 1),
        link=meter.statistics(),
        halted=listener.halted,
    )


def _times(
    transport: Transport, clock: Callable[[], float], listener: _Listener, *, lines: int, window: int
) -> list[float]:
    """When each line of one conversation was answered."""
    listener.times = []
    streamer = Streamer([_LINE] * lines, window_lines=window, connect_timeout=_PATIENCE)
    run(streamer, transport, clock, on_event=listener)
    return listener.times


class _Listener:
    """Keeps what is worth telling."""

    def __init__(
        self, clock: Callable[[], float], on_event: Callable[[Event], None], meter: LinkMeter
    ) -> None:
        self._clock, self._tell, self._meter = clock, on_event, meter
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
        self._tell(event)
