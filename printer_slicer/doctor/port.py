"""A serial port as the system has it, without opening it: whose it is, who holds it, how long a chip waits.

Source: Linux's documentation of `latency_timer` (ftdi_sio) and of /proc/PID/fd. Where the system does not say, nothing
is said.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from printer_slicer.doctor.checks import PortCheck
from printer_slicer.stream.serial_port import holders

if sys.platform != "win32":
    import grp

__all__ = ["PortState", "state_of"]

_SLOW: Final = 2
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
        if timer < _SLOW:
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
