"""The host's half of the conversation, without port, clock or thread: bytes and times in, bytes and events out.

The owner calls `send` and writes what it gives, waits until bytes arrive or `wakeup` is reached, and hands the
bytes to `receive`. `events` tells what happened.

What makes it safe to lose any byte in either direction: lines carry numbers, a number stands for one line for
ever, and the printer takes them in order only. So nothing is ever repeated on suspicion. When an answer is missing
or cannot be read, the streamer sends the *next* number, a harmless question for the temperatures: a printer that
lacks a line says which, one that lacks none answers, and both end the doubt.

At most two lines are in flight, fewer bytes than the smallest receive buffer holds, and for a while only one
after each error: Marlin empties its buffer on an error, and the tail of a line that was arriving just then would
be read as a line without number, which needs no checksum.

Source: Marlin documentation "Host keepalive", "M110", "M105", "M115"; conversations with real firmware.
"""

from __future__ import annotations

from collections import deque
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.stream import replies
from printer_slicer.stream.burst import Burst, Verdict
from printer_slicer.stream.events import (
    Accepted,
    Action,
    Asked,
    Busy,
    Event,
    Finished,
    Halted,
    Identified,
    Message,
    ResendAsked,
    Spot,
    Temperature,
)
from printer_slicer.stream.framing import check_commands, strip
from printer_slicer.stream.ledger import ASK, Ledger
from printer_slicer.stream.patience import Patience
from printer_slicer.stream.states import ENDED, TRANSITIONS, State, Trigger
from printer_slicer.stream.tracker import Tracker, parse
from printer_slicer.stream.watch import Watch

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from printer_slicer.motion.rules import Limits

__all__ = ["Streamer"]

_RESTART_COUNT: Final = b"\nN0 M110 N0*125\n"
_EMERGENCY: Final = b"\nM112\n"
_GREET_AGAIN: Final = 1.0
_CAREFUL_LINES: Final = 300
"""Lines sent one at a time after an error."""

_LONGEST_REPLY: Final = 1024
_SAME_PLACE: Final = 0.05
"""mm; the printer says two decimals of single-precision numbers."""

_MOST_LOOKS: Final = 3
_CAUSE_WITHIN: Final = 1.0
"""s before "halted" in which the printer has said why."""


class Streamer:
    """Brings every line of a job to the printer once and in order, or says why not.

    Args:
        commands: the job, one command an entry; comments and blank entries may stand among them.
        limits: of the machine, to know how long an answer may take. Without them questions come much later.
        window_lines: most lines in flight.
        window_bytes: most bytes in flight; the smallest receive buffer in use holds one more.
        connect_timeout: s until a printer that never answers is given up.
        give_up: s until a printer that answers no question any more is given up.

    Raises:
        UsageError: an entry can never be sent.
    """

    def __init__(
        self,
        commands: Sequence[bytes],
        *,
        limits: Limits | None = None,
        window_lines: int = 2,
        window_bytes: int = 127,
        connect_timeout: float = 30.0,
        give_up: float = 30.0,
    ) -> None:
        check_commands(commands)
        self._commands = commands
        self._taken = 0
        self._acknowledged = 0
        self._end_script: deque[bytes] | None = None
        self._injected: deque[bytes] = deque()
        self._window = (window_lines, window_bytes)
        self._connect_timeout = connect_timeout
        self._give_up = give_up
        self._patience = Patience(limits)
        self._tracker = Tracker()
        self._state = State.CONNECTING
        self._events: list[Event] = []
        self._partial = b""
        self._urgent = b""
        self._opened: float | None = None
        self._greet_at = -inf
        self._said: tuple[float, str] = (-inf, "")
        self._handlers: Mapping[type, Callable[[Any, float], None]] = {
            replies.Ok: self._on_ok,
            replies.Resend: self._on_resend,
            replies.LineError: self._on_line_error,
            replies.Wait: self._on_wait,
            replies.Started: self._on_started,
            replies.Stopped: self._on_stopped,
            replies.Unknown: self._on_unknown,
            replies.Identity: self._on_identity,
            replies.Capability: self._on_capability,
            replies.Position: self._on_position,
            replies.Garbled: self._on_garbled,
            Temperature: self._on_temperature,
            Busy: self._on_busy,
            Action: self._on_action,
            Message: self._on_message,
        }
        self._begin()

    def _begin(self) -> None:
        """Line numbers start anew; nothing of the job has been sent."""
        self._ledger = Ledger()
        self._burst = Burst()
        self._watch = Watch(self._give_up)
        self._requested: int | None = None
        self._careful = 0
        self._firmware: str | None = None
        self._capabilities: dict[str, bool] = {}
        self._motion_ended = False
        self._looks = 0
        self._position: Spot | None = None

    # What the owner may know.

    @property
    def state(self) -> State:
        """What it is doing."""
        return self._state

    @property
    def done(self) -> bool:
        """Whether nothing is left to send or to wait for."""
        return self._state in ENDED and not self._urgent

    @property
    def acknowledged(self) -> int:
        """Entries of the job that the printer took: `commands[:acknowledged]` need not be sent again."""
        return self._acknowledged

    def events(self) -> list[Event]:
        """What happened since the last call, in order."""
        events, self._events = self._events, []
        return events

    # What the owner may want.

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
        check_commands([command])
        self._injected.append(command)
        self._motion_ended = False

    def cancel(self, end_script: Sequence[bytes] = ()) -> None:
        """Drop the rest of the job, send the end script instead, and finish.

        Raises:
            UsageError: a command of the script can never be sent.
        """
        check_commands(end_script)
        if not self._apply(Trigger.CANCEL):
            return
        if self._state is State.HALTED:
            self._events.append(Halted("cancelled before anything was printed", self._acknowledged))
            return
        self._end_script = deque(end_script)
        self._injected.clear()

    def emergency_stop(self) -> None:
        """Kill the printer: M112 goes out ahead of everything, and nothing after it."""
        self._urgent = _EMERGENCY
        self._halt("emergency stop")

    # The three methods of a peer.

    def receive(self, data: bytes, now: float) -> None:
        """Take what arrived."""
        before = self._acknowledged
        *lines, self._partial = (self._partial + data).split(b"\n")
        if len(self._partial) > _LONGEST_REPLY:
            lines.append(self._partial)
            self._partial = b""
        for line in lines:
            for reply in replies.read_reply(line.rstrip(b"\r")):
                if self._state not in ENDED:
                    self._handlers[type(reply)](reply, now)
        if self._acknowledged > before:
            self._events.append(Accepted(self._acknowledged))

    def send(self, now: float) -> bytes:
        """What to write now; may be empty."""
        urgent, self._urgent = self._urgent, b""
        if self._state is State.CONNECTING:
            return urgent + self._greet(now)
        if self._burst.active:
            if not self._burst.ready(now):
                return urgent
            self._go_back(now)
        out = [urgent]
        if self._state not in ENDED and self._ledger.in_flight and now >= self._watch.due(self._ledger.oldest):
            out.append(self._ask(now))
        while self._has_next() and self._fits():
            out.append(self._ledger.take(now))
        return b"".join(out)

    def wakeup(self) -> float | None:
        """When to call `send` even if nothing arrives; None for never."""
        if self._urgent:
            return -inf
        if self._state in ENDED:
            return None
        if self._state is State.CONNECTING:
            return self._greet_at
        due = inf
        if self._burst.active:
            due = self._burst.until
        elif self._ledger.in_flight:
            due = self._watch.due(self._ledger.oldest)
        return due if isfinite(due) else None

    # Sending.

    def _greet(self, now: float) -> bytes:
        """Set the line numbers, again and again: a board that resets when the port opens hears nothing at first."""
        if self._opened is None:
            self._opened = now
        if now >= self._opened + self._connect_timeout:
            self._halt(f"no printer answered within {self._connect_timeout:g} s: wrong port, speed or cable?")
            return b""
        if now < self._greet_at:
            return b""
        self._greet_at = now + _GREET_AGAIN
        return _RESTART_COUNT

    def _go_back(self, now: float) -> None:
        """The error has settled: what the printer wants goes out next."""
        burst, ledger = self._burst, self._ledger
        if burst.claim is not None:
            self._on_resend(replies.Resend(burst.claim), now)
        wanted = burst.wanted
        if wanted is None:
            return
        if not burst.end():
            self._halt(f"the printer does not accept line {wanted}, whatever is sent")
            return
        self._acknowledged = min(self._acknowledged, ledger.rewind(wanted))
        self._requested = wanted
        self._careful = _CAREFUL_LINES
        self._watch.answered(now, settled=True)
        self._events.append(ResendAsked(wanted))

    def _ask(self, now: float) -> bytes:
        """Ask which line the printer wants, by sending one that it should want."""
        if self._watch.given_up(now):
            self._halt(f"the printer has stopped answering: nothing for {self._give_up:g} s")
            return b""
        ledger = self._ledger
        if ledger.cursor == ledger.top:
            self._number(ASK)
        self._careful = _CAREFUL_LINES
        self._burst.swallow = False
        self._watch.ask(now)
        self._events.append(Asked(ledger.cursor))
        return ledger.take(now, break_first=True)

    def _fits(self) -> bool:
        """Whether the next line may join those in flight."""
        ledger = self._ledger
        lines, size = self._window
        if not ledger.in_flight or ledger.cursor == self._requested:
            return True
        if ledger.in_flight >= (1 if self._careful else lines):
            return False
        return ledger.bytes_in_flight + len(ledger.next.text) + 1 <= size

    def _has_next(self) -> bool:
        """Whether there is a line to send; gives the next command its number if need be."""
        ledger = self._ledger
        if self._state in ENDED:
            return False
        if ledger.cursor < ledger.top:
            return True
        if ledger.in_flight >= self._window[0]:
            return False
        command = self._next_command()
        if command is None:
            return False
        self._number(command)
        return True

    def _next_command(self) -> bytes | None:
        """The next command to get a number, None if there is none now."""
        if self._state is State.IDENTIFYING:
            return b"M115" if self._ledger.top == 1 else None
        command = self._next_of(self._injected)
        if command is None and self._state in {State.STREAMING, State.CANCELLING}:
            command = self._next_of_job() if self._end_script is None else self._next_of(self._end_script)
            if command is None and not self._ledger.in_flight:
                self._acknowledged = self._taken
                self._motion_ended = False
                self._apply(Trigger.ACCEPTED)
        if command is None and self._state is State.FINISHING and not self._ledger.in_flight:
            command = self._next_of_closing()
        return command

    def _next_of_job(self) -> bytes | None:
        while self._taken < len(self._commands):
            command = strip(self._commands[self._taken])
            self._taken += 1
            if command:
                return command
        return None

    @staticmethod
    def _next_of(commands: deque[bytes]) -> bytes | None:
        while commands:
            command = strip(commands.popleft())
            if command:
                return command
        return None

    def _next_of_closing(self) -> bytes | None:
        """Wait for the end of the motion, then ask where the printer is: it can only know if it has it all."""
        if not self._motion_ended:
            self._motion_ended = True
            self._looks = 0
            return b"M400"
        # A report may be lost or damaged: look again before believing that something is wrong.
        if self._looks == 0 or (self._looks < _MOST_LOOKS and not self._verified()):
            self._looks += 1
            self._position = None
            return b"M114"
        self._apply(Trigger.FINISH)
        self._events.append(
            Finished(
                acknowledged=self._acknowledged,
                cancelled=self._end_script is not None,
                position=self._position,
                expected=self._tracker.position,
                verified=self._verified(),
            )
        )
        return None

    def _verified(self) -> bool | None:
        """Whether the printer is where the commands lead, None if that cannot be said."""
        expected = self._tracker.position
        if self._position is None:
            return None
        known = [(is_at, to_be) for is_at, to_be in zip(self._position, expected, strict=True) if to_be is not None]
        if not known:
            return None
        return all(is_at is not None and abs(is_at - to_be) <= _SAME_PLACE for is_at, to_be in known)

    def _number(self, command: bytes) -> None:
        word, values = parse(command)
        move = self._tracker.follow(word, values)
        self._ledger.add(command, self._taken, self._patience.allow(word, values, move))

    # Receiving.

    def _on_ok(self, ok: replies.Ok, now: float) -> None:
        ledger, burst = self._ledger, self._burst
        if self._state is State.CONNECTING:
            self._on_greeting(ok)
            return
        if ok.number is not None:
            if ledger.accepted < ok.number < ledger.cursor:
                self._accept(ok.number, now, settled=True)
            return
        asked = ledger.find(ASK) if ok.heat else None
        if asked is not None:
            burst.swallow = False
            self._accept(asked, now, settled=True)
            return
        if burst.claim is not None:
            # The request between the error and this ok was lost; the error has named the line too.
            self._on_resend(replies.Resend(burst.claim), now)
        if burst.swallow:
            burst.swallow = False
            return
        oldest = ledger.accepted + 1
        refused = burst.wanted is not None and oldest >= burst.wanted
        # An ok may be left over from the greeting; only the name of the firmware proves that line 1 arrived.
        stale = self._state is State.IDENTIFYING and self._firmware is None and not self._watch.asked
        if ledger.in_flight and not refused and not stale:
            self._accept(oldest, now)

    def _on_greeting(self, ok: replies.Ok) -> None:
        if self._burst.swallow:
            self._burst.swallow = False
        elif self._opened is not None and not ok.heat:
            self._apply(Trigger.GREETED)

    def _accept(self, number: int, now: float, *, settled: bool = False) -> None:
        ledger = self._ledger
        self._careful = max(0, self._careful - (number - ledger.accepted))
        self._acknowledged = max(self._acknowledged, ledger.accept(number))
        self._burst.calm(number)
        self._watch.answered(now, settled=settled or not ledger.in_flight)
        if self._apply(Trigger.IDENTIFIED):
            ledger.prove(1)
            self._events.append(Identified(self._firmware or "", tuple(self._capabilities.items())))

    def _on_resend(self, resend: replies.Resend, now: float) -> None:
        if self._state is State.CONNECTING:
            self._burst.swallow = True
            self._greet_at = now
            return
        verdict = self._burst.request(resend.number, self._ledger, now)
        if verdict is Verdict.ASK:
            self._watch.suspect(now)
        elif verdict is Verdict.LOST_COUNT:
            self._restarted(f"it wants line {resend.number}, and line {self._ledger.cursor} is next", now)

    def _on_line_error(self, error: replies.LineError, now: float) -> None:
        if self._state is not State.CONNECTING:
            self._burst.error(error.wanted, now)
        self._events.append(Message(error.text))

    def _on_wait(self, _: replies.Wait, now: float) -> None:
        if self._ledger.in_flight:
            self._watch.idle(self._ledger.oldest, now)

    def _on_started(self, _: replies.Started, now: float) -> None:
        self._restarted("it has just started", now)

    def _restarted(self, evidence: str, now: float) -> None:
        """The printer knows nothing any more: begin anew if nothing was printed, else never."""
        self._apply(Trigger.RESTARTED)
        if self._state is State.HALTED:
            self._events.append(Halted(f"the printer was reset: {evidence}", self._acknowledged))
        else:
            self._begin()
            self._greet_at = now

    def _on_stopped(self, stopped: replies.Stopped, now: float) -> None:
        told, cause = self._said
        because = f" ({cause})" if cause and now - told <= _CAUSE_WITHIN else ""
        self._halt(f"the printer stopped: {stopped.text}{because}")

    def _on_unknown(self, unknown: replies.Unknown, now: float) -> None:
        self._say(unknown.text, now)
        if self._ledger.in_flight and not self._ledger.sent(unknown.command):
            # It read the remains of a line as a line of its own: the ok behind this answers none of ours.
            self._burst.swallow = True
            self._watch.suspect(now)

    def _on_identity(self, identity: replies.Identity, _: float) -> None:
        if self._state is State.IDENTIFYING:
            self._firmware = identity.firmware

    def _on_capability(self, capability: replies.Capability, _: float) -> None:
        if self._state is State.IDENTIFYING:
            self._capabilities[capability.name] = capability.enabled

    def _on_position(self, position: replies.Position, now: float) -> None:
        self._position = (position.x, position.y, position.z)
        self._say(position.text, now)

    def _on_garbled(self, garbled: replies.Garbled, now: float) -> None:
        self._say(garbled.text, now)
        if self._ledger.in_flight:
            self._burst.swallow = self._burst.swallow or garbled.refusal
            self._watch.suspect(now)

    def _on_temperature(self, temperature: Temperature, now: float) -> None:
        if temperature.waiting:
            self._watch.answered(now)
        self._events.append(temperature)

    def _on_busy(self, busy: Busy, now: float) -> None:
        self._watch.busy(now)
        self._events.append(busy)

    def _on_action(self, action: Action, _: float) -> None:
        if action.name in {"pause", "paused"}:
            self.pause()
        elif action.name in {"resume", "resumed"}:
            self.resume()
        self._events.append(action)

    def _on_message(self, message: Message, now: float) -> None:
        self._say(message.text, now)

    def _say(self, text: str, now: float) -> None:
        self._said = (now, text)
        self._events.append(Message(text))

    # Changing state.

    def _apply(self, trigger: Trigger) -> bool:
        """Whether the trigger has an effect in this state, which it then has."""
        state = TRANSITIONS[self._state].get(trigger)
        if state is None:
            return False
        self._state = state
        return True

    def _halt(self, reason: str) -> None:
        if self._apply(Trigger.HALT):
            self._events.append(Halted(reason, self._acknowledged))
