"""How a print stands: its state, how far it is, what its owner wants of it, and what there is to tell him.

The part of the streamer that its owner sees; how lines go out and answers come in is in `protocol`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.stream import events as told
from printer_slicer.stream.framing import check_commands
from printer_slicer.stream.states import ENDED, TRANSITIONS, State, Trigger

if TYPE_CHECKING:
    from collections.abc import Sequence

    from printer_slicer.stream.flight import Flight
    from printer_slicer.stream.script import Script

__all__ = ["Standing"]

_EMERGENCY: Final = b"\nM112\n"


class Standing:
    """One print.

    Args:
        script: what is to be sent.
        flight: the lines on their way.
        first: entries of the job that the printer has already.
    """

    def __init__(self, script: Script, flight: Flight, first: int) -> None:
        self._script = script
        self._flight = flight
        self._script.taken = self._acknowledged = first
        self._state = State.CONNECTING
        self._ended = False
        self._events: list[told.Event] = []
        self._urgent = b""

    @property
    def state(self) -> State:
        """What it is doing."""
        return self._state

    @property
    def done(self) -> bool:
        """Whether nothing is left to send or to wait for."""
        return self._ended and not self._urgent

    @property
    def acknowledged(self) -> int:
        """Entries of the job that the printer took: `commands[:acknowledged]` need not be sent again."""
        return self._acknowledged

    @property
    def taken(self) -> int:
        """Entries of the job that have a line number, or were passed over."""
        return self._script.taken

    @property
    def accepted_line(self) -> int:
        """Number of the last line that the printer took."""
        return self._flight.ledger.accepted

    @property
    def next_line(self) -> int:
        """The next number that no line has yet."""
        return self._flight.ledger.top

    @property
    def injected(self) -> int:
        """Injected commands that have no line number yet."""
        return self._script.injected

    @property
    def idle(self) -> bool:
        """Whether nothing is in flight, and nothing injected waits."""
        return not self._flight.ledger.in_flight and not self._script.injected

    def events(self) -> list[told.Event]:
        """What happened since the last call, in order."""
        events, self._events = self._events, []
        return events

    def pause(self) -> None:
        """Send no more of the job until `resume`; lines in flight are not taken back."""
        self._apply(Trigger.PAUSE)

    def resume(self) -> None:
        """Go on after `pause`."""
        self._apply(Trigger.RESUME)

    def inject(self, command: bytes) -> None:
        """Send a command ahead of the rest of the job, also while paused.

        Raises:
            UsageError: it can never be sent.
        """
        self._script.inject(command)

    def cancel(self, end_script: Sequence[bytes] = ()) -> None:
        """Drop the rest of the job, send the end script instead, and finish.

        A line that waits for heat or for a person waits no longer.

        Raises:
            UsageError: a command of the script can never be sent.
        """
        check_commands(end_script)
        if self._apply(Trigger.CANCEL):
            self._script.cancel(end_script)
            if self._ended:
                self._events.append(told.Halted("cancelled before anything was printed", self._acknowledged))

    def emergency_stop(self) -> None:
        """Kill the printer: M112 goes out ahead of everything, and nothing after it."""
        self._urgent = _EMERGENCY
        self._halt("emergency stop")

    def urge(self, command: bytes) -> None:
        """Send a command without number ahead of everything: M108, M410 or M876, which firmware looks at early.

        Raises:
            UsageError: it can never be sent.
        """
        check_commands([command])
        if not self._ended and self._state is not State.CONNECTING:
            self._flight.expect_unnumbered()
            self._urgent += b"\n%s\n" % command

    def _apply(self, trigger: Trigger) -> bool:
        """Whether the trigger has an effect in this state, which it then has."""
        state = TRANSITIONS[self._state].get(trigger)
        if state is None:
            return False
        self._state = state
        self._ended = state in ENDED
        return True

    def _halt(self, reason: str) -> None:
        if self._apply(Trigger.HALT):
            self._events.append(told.Halted(reason, self._acknowledged))
