"""Control a running print from other threads. Also: the options and the result of a print."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from pathlib import Path
from threading import Event as Flag
from threading import Lock
from typing import Any, TypedDict

from printer_slicer.deprecation import accept_former_arguments, renamed_attribute, renamed_method
from printer_slicer.errors import UsageError
from printer_slicer.printing import commands
from printer_slicer.printing.print_controller import PrintController, Request
from printer_slicer.stream.events import Event
from printer_slicer.stream.link_meter import LinkStatistics
from printer_slicer.values import Struct

__all__ = ["Controls", "EventListener", "PrintOptions", "PrintResult"]

_TIMEOUT = 10.0
_STATUS_TIMEOUT = 1.5
"""Time after which a status request returns the last known status, s."""
_PRINTER_CONNECTION = "the port to open and the printer to answer"
_BUSY_PROCESS = "the print process, which is writing to its port or gets no CPU time"


class Controls:
    """Controls a running print: pass an instance to `print_job`, and call its methods from other threads."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._queued_requests: deque[Request] = deque()
        self._controller: PrintController | None = None
        self._wake: Callable[[], None] = lambda: None
        self._waits_for = _PRINTER_CONNECTION
        self._last_status: dict[str, Any] = {}
        self.requested = Flag()
        """Flag that is set when a command is submitted while no printer is connected."""

    @accept_former_arguments(conductor="controller")
    def bind(
        self,
        controller: PrintController | None,
        wake: Callable[[], None] = lambda: None,
        *,
        waits_for: str = _PRINTER_CONNECTION,
    ) -> None:
        """Send commands to this controller from now on; commands that are still queued come first.

        Args:
            controller: the controller; None while there is none.
            wake: wakes the thread that runs the controller.
            waits_for: what the print is waiting for while there is no controller.
        """
        with self._lock:
            if self._controller is not None and controller is None:
                self._last_status = self._controller.status()
            self._waits_for = waits_for
            self._controller, self._wake = controller, wake
            while controller is not None and self._queued_requests:
                controller.submit(self._queued_requests.popleft())
            self.requested.clear()

    @accept_former_arguments(ticket="request")
    def submit(self, request: Request) -> None:
        """Submit a request without waiting for its result."""
        with self._lock:
            if self._controller is None:
                self._queued_requests.append(request)
                self.requested.set()
                return
            self._controller.submit(request)
            wake = self._wake
        wake()

    @property
    def has_end_request(self) -> bool:
        """Return whether a queued request would end the print."""
        with self._lock:
            return any(
                isinstance(request.command, commands.Cancel | commands.Abort)
                for request in self._queued_requests
            )

    @accept_former_arguments(wish="command")
    def ask(self, command: commands.PrintCommand, timeout: float = _TIMEOUT) -> str:
        """Submit a command and wait for its result.

        Raises:
            UsageError: the command cannot be executed, or the print process does not respond.
        """
        answered, answers = Flag(), list[str | UsageError]()

        def store_answer(answer: str | UsageError) -> None:
            """Store the answer of the controller."""
            answers.append(answer)
            answered.set()

        self.submit(Request(command, store_answer))
        if not answered.wait(timeout):
            raise UsageError(
                "the print process does not respond", remedy="Check that the printer is connected"
            )
        if isinstance(answers[0], UsageError):
            raise answers[0]
        return answers[0]

    def pause(self, *, now: bool = False, cold: bool = False, park: bool = True) -> None:
        """Pause the print, see `commands.Pause`."""
        self.ask(commands.Pause(now=now, cold=cold, park=park))

    def resume(self) -> None:
        """Resume the print."""
        self.ask(commands.Resume())

    def cancel(self) -> None:
        """Cancel the print and run the end script."""
        self.ask(commands.Cancel())

    def cancel_object(self, name: str) -> None:
        """Cancel one object on the plate, by its name or number."""
        self.ask(commands.CancelObject(name))

    def speed(self, percent: float) -> None:
        """Set the speed, in percent of the speeds in the file."""
        self.ask(commands.Speed(percent))

    def flow(self, percent: float) -> None:
        """Set the flow, in percent of the flow in the file."""
        self.ask(commands.Flow(percent))

    def heat(self, heater: str, celsius: float) -> None:
        """Set the target temperature, °C, of a heater: nozzle or bed."""
        self.ask(commands.SetTemperature(heater, celsius))

    def baby_step(self, mm: float) -> None:
        """Move the nozzle and all following moves up by `mm`, down if negative."""
        self.ask(commands.BabyStep(mm))

    @accept_former_arguments(command="gcode")
    def say(self, gcode: str) -> None:
        """Send one line of G-code."""
        self.ask(commands.Say(gcode))

    def answer(self, choice: int) -> None:
        """Press button number `choice` of the printer's prompt; the first button is 0."""
        self.ask(commands.Answer(choice))

    def status(self) -> dict[str, Any]:
        """Return the status of the print."""
        return dict(json.loads(self.ask(commands.Status())))

    def status_soon(self, timeout: float = _STATUS_TIMEOUT) -> dict[str, Any]:
        """Return the status; after a timeout, return the last known status and what the print waits for.

        Args:
            timeout: s to wait for the print.
        """
        with self._lock:
            waits_for = "" if self._controller is not None else self._waits_for
        if not waits_for:
            try:
                self._last_status = dict(json.loads(self.ask(commands.Status(), timeout)))
            except UsageError:
                waits_for = _BUSY_PROCESS
            else:
                return self._last_status
        return self._last_status | {"state": "waiting", "waits_for": waits_for}

    def read_status(self) -> dict[str, Any]:
        """Return the status at once, without waiting for the print; called by the feed for watchers."""
        with self._lock:
            controller, waits_for = self._controller, self._waits_for
        if controller is None:
            return self._last_status | {"state": "waiting", "waits_for": waits_for}
        return controller.status() | {"waits_for": ""}

    def abort(self) -> None:
        """Halt the printer at once with M112."""
        self.submit(Request(commands.Abort()))

    def stop(self) -> None:
        """Halt the printer; former name of `abort`, without a warning that could delay or prevent it."""
        self.abort()

    want = renamed_method("Controls.want", "Controls.submit")
    wanted = renamed_attribute("Controls.wanted", "Controls.requested")
    wants_end = renamed_attribute("Controls.wants_end", "Controls.has_end_request")


EventListener = Callable[[Event], None]


class PrintResult(Struct, frozen=True):
    """Result of a completed print.

    Attributes:
        commands: number of commands of the job; all were acknowledged.
        seconds: time from the first byte to the last answer.
        verified: whether the printer reports the end position of the job; None if it cannot be compared.
        link: statistics of the link.
    """

    commands: int
    seconds: float
    verified: bool | None
    link: LinkStatistics


class PrintOptions(TypedDict, total=False):
    """Options of a print; see `print_job`."""

    on_event: EventListener
    checkpoint: Path | None
    controls: Controls | None
    job_store: Path | None
    discard: bool
    reconnect: float
    dtr: bool | None
    allow: Callable[[bytes], str]
    guard: float | None
    folder_name: str
    on_ready: Callable[[Path], None]
