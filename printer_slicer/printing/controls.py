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
from printer_slicer.printing import wishes
from printer_slicer.printing.conductor import Conductor, Ticket
from printer_slicer.stream.events import Event
from printer_slicer.stream.link_meter import LinkSeen

__all__ = ["Controls", "Done", "Listen", "Options"]

_PATIENCE = 10.0
_SOON = 1.5
"""Timeout for a status request, s; then the last known status is returned."""
_CONNECTING = "the port to open and the printer to answer"
_BUSY = "the print process, which is writing to its port or gets no CPU time"


class Controls:
    """The handle of a print: make one, give it to `print_job`, call it from any other thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._early: deque[Ticket] = deque()
        self._conductor: Conductor | None = None
        self._wake: Callable[[], None] = lambda: None
        self._waits_for = _CONNECTING
        self._known: dict[str, Any] = {}
        self.wanted = Flag()
        """Set when something is wanted while there is no printer to tell it to."""

    def bind(
        self,
        conductor: Conductor | None,
        wake: Callable[[], None] = lambda: None,
        *,
        waits_for: str = _CONNECTING,
    ) -> None:
        """Send commands to this conductor from now on, starting with those that came early.

        Args:
            conductor: None if there is none for now.
            wake: wakes the thread that runs it.
            waits_for: what the print is waiting for without a conductor.
        """
        with self._lock:
            if self._conductor is not None and conductor is None:
                self._known = self._conductor.status()
            self._waits_for = waits_for
            self._conductor, self._wake = conductor, wake
            while conductor is not None and self._early:
                conductor.want(self._early.popleft())
            self.wanted.clear()

    def want(self, ticket: Ticket) -> None:
        """Wish, and do not wait."""
        with self._lock:
            if self._conductor is None:
                self._early.append(ticket)
                self.wanted.set()
                return
            self._conductor.want(ticket)
            wake = self._wake
        wake()

    @property
    def wants_end(self) -> bool:
        """Whether somebody who was not heard yet wants the print to end."""
        with self._lock:
            return any(isinstance(ticket.wish, wishes.Cancel | wishes.Stop) for ticket in self._early)

    def ask(self, wish: wishes.Wish, timeout: float = _PATIENCE) -> str:
        """Wish, and wait for the answer.

        Raises:
            UsageError: it cannot be granted, or nobody answers.
        """
        answered, answers = Flag(), list[str | UsageError]()

        def done(answer: str | UsageError) -> None:
            """The session has answered."""
            answers.append(answer)
            answered.set()

        self.want(Ticket(wish, done))
        if not answered.wait(timeout):
            raise UsageError("the print does not answer", remedy="is the printer connected?")
        if isinstance(answers[0], UsageError):
            raise answers[0]
        return answers[0]

    def pause(self, *, now: bool = False, cold: bool = False, park: bool = True) -> None:
        """Pause, see `wishes.Pause`."""
        self.ask(wishes.Pause(now=now, cold=cold, park=park))

    def resume(self) -> None:
        """Go on."""
        self.ask(wishes.Resume())

    def cancel(self) -> None:
        """Drop the rest, run the end script."""
        self.ask(wishes.Cancel())

    def cancel_object(self, name: str) -> None:
        """Print no more of one thing on the plate."""
        self.ask(wishes.CancelObject(name))

    def speed(self, percent: float) -> None:
        """Percent of the file's speeds."""
        self.ask(wishes.Speed(percent))

    def flow(self, percent: float) -> None:
        """Percent of the file's filament."""
        self.ask(wishes.Flow(percent))

    def heat(self, heater: str, celsius: float) -> None:
        """Another temperature for nozzle or bed."""
        self.ask(wishes.SetTemperature(heater, celsius))

    def baby_step(self, mm: float) -> None:
        """Nozzle up, or down."""
        self.ask(wishes.BabyStep(mm))

    def say(self, command: str) -> None:
        """One line of G-code."""
        self.ask(wishes.Say(command))

    def answer(self, choice: int) -> None:
        """A button of the printer's question."""
        self.ask(wishes.Answer(choice))

    def status(self) -> dict[str, Any]:
        """How it stands."""
        return dict(json.loads(self.ask(wishes.Status())))

    def status_soon(self, timeout: float = _SOON) -> dict[str, Any]:
        """Return the status; if the print cannot answer, the last known status and what it is waiting for.

        Args:
            timeout: s to wait for the print.
        """
        with self._lock:
            waits_for = "" if self._conductor is not None else self._waits_for
        if not waits_for:
            try:
                self._known = dict(json.loads(self.ask(wishes.Status(), timeout)))
            except UsageError:
                waits_for = _BUSY
            else:
                return self._known
        return self._known | {"state": "waiting", "waits_for": waits_for}

    def stop(self) -> None:
        """Emergency stop; it waits for nothing."""
        self.want(Ticket(wishes.Stop()))


Listen = Callable[[Event], None]


@dataclass(frozen=True, slots=True)
class Done:
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
    link: LinkSeen


class Options(TypedDict, total=False):
    """What may be wanted of a print besides job and port; see `print_job`."""

    on_event: Listen
    checkpoint: Path | None
    controls: Controls | None
    shelf: Path | None
    discard: bool
    reconnect: float
    dtr: bool | None
    allow: Callable[[bytes], str]
    guard: float | None
