"""Controls of a running print, for other threads and processes; what may be wanted of a print, and what it comes to."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event as Flag
from threading import Lock
from typing import Any, TypedDict

from printer_slicer.errors import UsageError
from printer_slicer.printing import commands
from printer_slicer.printing.print_controller import PrintController, Request
from printer_slicer.stream.events import Event
from printer_slicer.stream.link_meter import LinkStatistics

__all__ = ["Controls", "Listen", "PrintOptions", "PrintResult"]

_PATIENCE = 10.0
_SOON = 1.5
"""Timeout for a status request, s; then the last known status is returned."""
_CONNECTING = "the port to open and the printer to answer"
_BUSY = "the print process, which is writing to its port or gets no CPU time"


class Controls:
    """The handle of a print: make one, give it to `print_job`, call it from any other thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._early: deque[Request] = deque()
        self._conductor: PrintController | None = None
        self._wake: Callable[[], None] = lambda: None
        self._waits_for = _CONNECTING
        self._known: dict[str, Any] = {}
        self.wanted = Flag()
        """Set when something is wanted while there is no printer to tell it to."""

    def bind(
        self,
        controller: PrintController | None,
        wake: Callable[[], None] = lambda: None,
        *,
        waits_for: str = _CONNECTING,
    ) -> None:
        """Send commands to this conductor from now on, starting with those that came early.

        Args:
            controller: None if there is none for now.
            wake: wakes the thread that runs it.
            waits_for: what the print is waiting for without a conductor.
        """
        with self._lock:
            if self._conductor is not None and controller is None:
                self._known = self._conductor.status()
            self._waits_for = waits_for
            self._conductor, self._wake = controller, wake
            while controller is not None and self._early:
                controller.want(self._early.popleft())
            self.wanted.clear()

    def want(self, request: Request) -> None:
        """Wish, and do not wait."""
        with self._lock:
            if self._conductor is None:
                self._early.append(request)
                self.wanted.set()
                return
            self._conductor.want(request)
            wake = self._wake
        wake()

    @property
    def has_end_request(self) -> bool:
        """Whether somebody who was not heard yet wants the print to end."""
        with self._lock:
            return any(
                isinstance(request.command, commands.Cancel | commands.Stop) for request in self._early
            )

    def ask(self, command: commands.PrintCommand, timeout: float = _PATIENCE) -> str:
        """Wish, and wait for the answer.

        Raises:
            UsageError: it cannot be granted, or nobody answers.
        """
        answered, answers = Flag(), list[str | UsageError]()

        def done(answer: str | UsageError) -> None:
            """The session has answered."""
            answers.append(answer)
            answered.set()

        self.want(Request(command, done))
        if not answered.wait(timeout):
            raise UsageError("the print does not answer", remedy="is the printer connected?")
        if isinstance(answers[0], UsageError):
            raise answers[0]
        return answers[0]

    def pause(self, *, now: bool = False, cold: bool = False, park: bool = True) -> None:
        """Pause, see `commands.Pause`."""
        self.ask(commands.Pause(now=now, cold=cold, park=park))

    def resume(self) -> None:
        """Go on."""
        self.ask(commands.Resume())

    def cancel(self) -> None:
        """Drop the rest, run the end script."""
        self.ask(commands.Cancel())

    def cancel_object(self, name: str) -> None:
        """Print no more of one thing on the plate."""
        self.ask(commands.CancelObject(name))

    def speed(self, percent: float) -> None:
        """Percent of the file's speeds."""
        self.ask(commands.Speed(percent))

    def flow(self, percent: float) -> None:
        """Percent of the file's filament."""
        self.ask(commands.Flow(percent))

    def heat(self, heater: str, celsius: float) -> None:
        """Another temperature for nozzle or bed."""
        self.ask(commands.SetTemperature(heater, celsius))

    def baby_step(self, mm: float) -> None:
        """Nozzle up, or down."""
        self.ask(commands.BabyStep(mm))

    def say(self, gcode: str) -> None:
        """One line of G-code."""
        self.ask(commands.Say(gcode))

    def answer(self, choice: int) -> None:
        """A button of the printer's question."""
        self.ask(commands.Answer(choice))

    def status(self) -> dict[str, Any]:
        """How it stands."""
        return dict(json.loads(self.ask(commands.Status())))

    def status_soon(self, timeout: float = _SOON) -> dict[str, Any]:
        """Return the status; if the print cannot answer, the last known status and what it is waiting for.

        Args:
            timeout: s to wait for the print.
        """
        with self._lock:
            waits_for = "" if self._conductor is not None else self._waits_for
        if not waits_for:
            try:
                self._known = dict(json.loads(self.ask(commands.Status(), timeout)))
            except UsageError:
                waits_for = _BUSY
            else:
                return self._known
        return self._known | {"state": "waiting", "waits_for": waits_for}

    def stop(self) -> None:
        """Emergency stop; it waits for nothing."""
        self.want(Request(commands.Stop()))


Listen = Callable[[Event], None]


@dataclass(frozen=True, slots=True)
class PrintResult:
    """A print that came to its end.

    Attributes:
        commands: of the job, all acknowledged.
        seconds: from the first byte to the last answer.
        verified: the printer says that it is where the job ends; None where it cannot be compared.
        link: what the cable was like.
    """

    commands: int
    seconds: float
    verified: bool | None
    link: LinkStatistics


class PrintOptions(TypedDict, total=False):
    """What may be wanted of a print besides job and port; see `print_job`."""

    on_event: Listen
    checkpoint: Path | None
    controls: Controls | None
    job_store: Path | None
    discard: bool
    reconnect: float
    dtr: bool | None
    allow: Callable[[bytes], str]
    guard: float | None
