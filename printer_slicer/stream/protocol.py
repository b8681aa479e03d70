"""The streaming protocol, without port, clock or thread: bytes in, bytes and events out.

The owner calls `send` and writes what it gives, waits until bytes arrive or `wakeup` is reached, and hands
the bytes to `receive`. `events` tells what happened.

What makes it safe to lose any byte in either direction: lines carry numbers, a line number is never reused, and the
printer takes lines in order only. No line is resent unless the printer asks for it. When an answer is missing or cannot
be read, the streamer sends the *next* number, a harmless question for the temperatures: a printer that lacks a line
says which, one that lacks none answers. Both replies settle which lines arrived.

See `window` for the number of lines in flight, `firmware` for the differences between firmwares, and `doubt` for
firmwares that ignore line numbers.

Source: Marlin documentation, "M105", "M110", "M114", "M115", "Host keepalive"; what real firmware answered.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.firmware import DEFAULT_WIRE_DIALECT, get_wire_dialect
from printer_slicer.stream import events as told
from printer_slicer.stream import replies
from printer_slicer.stream.ack_tracker import AckTracker
from printer_slicer.stream.framing import check_commands, command_room
from printer_slicer.stream.handshake import Handshake
from printer_slicer.stream.send_history import ASK
from printer_slicer.stream.send_queue import SendQueue
from printer_slicer.stream.states import ENDED, TRANSITIONS, State, Trigger
from printer_slicer.stream.unacked_line import LineFate
from printer_slicer.stream.window import Window

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from printer_slicer.motion.rules import MotionLimits

__all__ = ["RESET", "Streamer"]

RESET: Final = "the printer was reset"
"""First words of the reason for such a stop."""

_LONGEST_REPLY: Final = 1024
_CAUSE_WITHIN: Final = 1.0
"""Seconds before "halted" in which messages since the last ok explain the halt."""

_EMERGENCY: Final = b"\nM112\n"
_NOTHING_SAID: Final = (-inf, "")


class Streamer:
    """Streams a job so that the printer executes every line once and in order, or reports why that failed.

    Args:
        commands: the job, one command an entry; comments and blank entries may stand among them.
        limits: of the machine, to know how long an answer may take. Without them questions come much later.
        window_lines: lines in flight; more only where it cannot do harm, see `window`.
        window_bytes: most bytes in flight; the smallest receive buffer in use holds one more.
        baud: baud rate. Replies that are faster than it allows show that the link is native USB. None: not checked.
        dialect: name of the firmware's dialect, a key of `WIRE_DIALECTS`; None goes by what it says.
        connect_timeout: s until a printer that never answers is given up.
        give_up: s until a printer that answers no question any more is given up.
        obeys: whether it pauses and goes on as the printer asks; else that is its owner's to do.
        first: entries of the job that the printer has already, from before.

    Raises:
        UsageError: an entry can never be sent, or there is no such dialect.
    """

    def __init__(  # noqa: PLR0913 - each is a choice of its own, and all have names
        self,
        commands: Sequence[bytes],
        *,
        limits: MotionLimits | None = None,
        window_lines: int = 2,
        window_bytes: int = 127,
        baud: int | None = None,
        dialect: str | None = None,
        connect_timeout: float = 30.0,
        give_up: float = 30.0,
        handle_actions: bool = True,
        first: int = 0,
    ) -> None:
        self._dialect = get_wire_dialect(dialect or DEFAULT_WIRE_DIALECT)
        self._greeting = Handshake(connect_timeout, dialect)
        self._window_rules = (window_lines, window_bytes, baud)
        self._give_up = give_up
        self._script = SendQueue(commands, limits, self._dialect.max_line_bytes)
        self._flight = AckTracker(Window(*self._window_rules), give_up)
        self._script.taken = self._acknowledged = first
        self._state = State.CONNECTING
        self._ended = False
        self._events: list[told.Event] = []
        self._urgent = b""
        self._numbered_job = self._first = first
        self._obeys = handle_actions
        self._partial = b""
        self._said: tuple[float, str] = _NOTHING_SAID
        self._handlers: Mapping[type, Callable[[Any, float], None]] = {
            replies.Ok: self._on_ok,
            replies.Resend: self._on_resend,
            replies.LineError: self._on_line_error,
            replies.Wait: self._on_wait,
            replies.Started: self._on_started,
            replies.Stopped: self._on_stopped,
            replies.Unknown: self._on_unknown,
            replies.LastLine: self._on_last_line,
            replies.Identity: self._on_introduction,
            replies.Capability: self._on_introduction,
            replies.Position: self._on_position,
            replies.Garbled: self._on_garbled,
            told.Temperature: self._on_temperature,
            told.Busy: self._on_busy,
            told.Action: self._on_action,
            told.Message: self._on_message,
        }

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

    def send_at_once(self, command: bytes) -> None:
        """Send a command without number ahead of everything: M108, M410 or M876, which firmware looks at early.

        Raises:
            UsageError: it can never be sent.
        """
        check_commands([command])
        if not self._ended and self._state is not State.CONNECTING:
            self._flight.expect_unnumbered()
            self._urgent += b"\n%s\n" % command

    def receive(self, data: bytes, now: float) -> None:
        """Take what arrived."""
        before = self._acknowledged
        *lines, self._partial = (self._partial + data).split(b"\n")
        if len(self._partial) > _LONGEST_REPLY:
            lines.append(self._partial)
            self._partial = b""
        for line in lines:
            for reply in replies.read_reply(line.rstrip(b"\r")):
                if not self._ended:
                    self._handlers[type(reply)](reply, now)
        if self._acknowledged > before:
            # The end, if this was it, is told last.
            self._events.insert(len(self._events) - self._ended, told.Accepted(self._acknowledged))

    def send(self, now: float) -> bytes:
        """What to write now; may be empty."""
        urgent, self._urgent = self._urgent, b""
        if self._ended:
            return urgent
        if self._state is State.CONNECTING:
            return urgent + self._greet(now)
        if self._flight.burst.active and not self._go_back(now):
            return urgent
        out = [urgent]
        if self._state is State.CANCELLING:
            out.append(self._flight.break_wait(now))
        if self._flight.overdue(now):
            out.append(self._ask(now))
        while self._has_next(now):
            out.append(self._flight.ledger.take(now))
        return b"".join(out)

    def wakeup(self) -> float | None:
        """When to call `send` even if nothing arrives; None for never."""
        if self._urgent:
            return 0.0
        if self._ended:
            return None
        due = self._greeting.due if self._state is State.CONNECTING else self._flight.due
        if self._state is State.CANCELLING and due is not None:
            due = max(min(due, self._flight.break_due), 0.0)
        return due if due is not None and isfinite(due) else None

    # Sending.

    def _greet(self, now: float) -> bytes:
        if self._greeting.late(now):
            self._halt("no printer answered: wrong port, speed or cable?")
            return b""
        return self._greeting.send(now)

    def _go_back(self, now: float) -> bool:
        """Whether sending may go on: the error has settled, and what the printer wants is next."""
        flight, burst = self._flight, self._flight.burst
        if not burst.ready(now):
            return False
        if burst.claim is not None:
            # The request behind this error never came; the error has named the line too.
            flight.request(None, now)
            self._check_count(now)
        wanted = burst.wanted
        if wanted is None:
            return not self._ended
        if not burst.end():
            self._halt(f"the printer does not accept line {wanted}, whatever is sent")
            return False
        self._acknowledged = min(self._acknowledged, max(flight.go_back(wanted, now), self._first))
        self._events.append(told.ResendAsked(wanted))
        return True

    def _ask(self, now: float) -> bytes:
        """Ask which line the printer wants, or what became of the only one in flight."""
        flight, ledger = self._flight, self._flight.ledger
        if flight.watch.given_up(ledger.oldest, now):
            self._halt("the printer has stopped answering")
            return b""
        self._events.append(told.Probe(ledger.cursor))
        if not self._dialect.checks_line_numbers and self._state is not State.IDENTIFYING:
            flight.doubt = flight.doubt or self._script.doubt()
            return flight.ask_where(flight.doubt, now)
        if flight.can_count:
            return flight.ask_count(now)
        if ledger.cursor == ledger.top:
            self._number(ASK)
        return flight.ask(now)

    def _has_next(self, now: float) -> bool:
        """Whether a line may go out now; gives the next command its number if need be."""
        flight = self._flight
        if self._ended or self._state is State.CONNECTING:
            return False
        if flight.ledger.cursor < flight.ledger.top:
            return flight.repeats()
        room = command_room(flight.ledger.top, flight.room())
        command = self._next_command(room, now) if room > 0 else None
        if command is None:
            return False
        self._number(command)
        return True

    def _at_the_end(self, now: float) -> bytes | None:
        """The next question when all is sent and accepted; None while an answer is awaited, and behind the last one."""
        flight = self._flight
        if flight.owes(now):
            return None
        if not flight.told():
            self._script.reopen()
        command = self._script.next_of_closing()
        if command is None:
            self._apply(Trigger.FINISH)
            self._events.append(self._script.finished(self._acknowledged))
        return command

    def _next_command(self, room: int, now: float) -> bytes | None:
        """The next command to get a number, None if there is none now that has at most `room` bytes."""
        script, idle = self._script, not self._flight.ledger.in_flight
        if self._state is State.IDENTIFYING:
            return self._greeting.question(self._flight.ledger.top) if idle else None
        command = script.next_injected(room)
        if command is None and (self._state is State.STREAMING or self._state is State.CANCELLING):
            command = script.next_of_job(room)
            if command is None and idle:
                self._accept_all()
        if command is None and self._state is State.FINISHING and idle:
            command = self._at_the_end(now)
        return command

    def _accept_all(self) -> None:
        """The printer took the last line; comments may stand behind it."""
        if self._script.taken > self._acknowledged:
            self._acknowledged = self._script.taken
            self._events.append(told.Accepted(self._acknowledged))
        self._script.reopen()
        self._apply(Trigger.ACCEPTED)

    def _number(self, command: bytes) -> None:
        job = self._script.taken
        if job != self._numbered_job + 1:
            own = b"" if job > self._numbered_job else command
            self._events.append(told.LineSent(self._flight.ledger.top, job, own))
        self._numbered_job = job
        self._flight.add(command, self._script.taken, self._script.follow(command))

    # Receiving.

    def _on_ok(self, ok: replies.Ok, now: float) -> None:
        if self._state is State.CONNECTING:
            self._on_greeting(ok)
            return
        flight, self._said = self._flight, _NOTHING_SAID
        if flight.doubt is not None:
            self._on_ok_in_doubt(ok, now)
            return
        settled = flight.settles(ok)
        # An ok may be left over from the greeting; only the name of the firmware proves that line 1 arrived.
        proven = settled or self._greeting.firmware is not None or flight.watch.asked
        if self._state is State.IDENTIFYING and not (proven or flight.ledger.accepted):
            return
        number = flight.belongs_to(ok, now)
        self._check_count(now)
        if flight.strayed and self._state is not State.IDENTIFYING:
            self._halt(
                "the printer executed something that was not sent: the rest of a line whose beginning got lost"
            )
        if number is None:
            return
        self._accept(number, now, settled=settled)

    def _accept(self, number: int, now: float, *, settled: bool) -> None:
        """The printer took the lines up to `number`."""
        self._acknowledged = max(self._acknowledged, self._flight.accept(number, now, settled=settled))
        if self._state is State.IDENTIFYING and self._greeting.question(number + 1) is None:
            self._apply(Trigger.IDENTIFIED)
            self._flight.ledger.prove(1)
            self._dialect = self._greeting.dialect
            parser = self._greeting.can("EMERGENCY_PARSER")
            self._flight.set_dialect(self._dialect, emergency_parser=parser)
            self._script.set_dialect(self._dialect)
            self._events.append(self._greeting.identified())

    def _on_ok_in_doubt(self, ok: replies.Ok, now: float) -> None:
        """An answer while nobody knows whether the line in flight was executed."""
        flight = self._flight
        doubt, number = flight.doubt, flight.ledger.accepted + 1
        assert doubt is not None
        if not ok.heat:
            doubt.bare_ok()
            return
        fate = doubt.closed()
        if fate is LineFate.EXECUTED:
            self._accept(number, now, settled=True)
        elif fate is LineFate.LOST:
            flight.go_back(number, now)
            self._events.append(told.ResendAsked(number))
        elif fate is LineFate.NEVER_KNOWN:
            said = flight.ledger.oldest.command.decode(errors="replace")
            self._halt(f"nobody can know whether line {number} was executed: {said}")
        elif fate is LineFate.OPEN:
            flight.watch.answered(now)
            flight.watch.suspect(now)

    def _on_greeting(self, ok: replies.Ok) -> None:
        if self._flight.burst.swallow:
            self._flight.burst.swallow = False
        elif self._greeting.begun and not ok.heat:
            self._apply(Trigger.GREETED)

    def _on_resend(self, resend: replies.Resend, now: float) -> None:
        if self._state is State.CONNECTING:
            self._flight.burst.swallow = True
            self._greeting.forget(now)
        elif self._flight.doubt is None:
            self._flight.request(resend.number, now)
            self._check_count(now)

    def _check_count(self, now: float) -> None:
        flight = self._flight
        if flight.lost_count is not None:
            evidence = f"it wants line {flight.lost_count}, and line {flight.ledger.cursor} is next"
            self._restarted(evidence, now)
            # The ok of this refusal is still to come; it must not pass for an answer to a greeting.
            self._flight.burst.swallow = flight.burst.swallow

    def _on_line_error(self, error: replies.LineError, now: float) -> None:
        if self._state is not State.CONNECTING and self._flight.doubt is None:
            self._flight.burst.error(error.wanted, now)
        self._events.append(told.Message(error.text))

    def _on_wait(self, _: replies.Wait, now: float) -> None:
        self._flight.idle(now)

    def _on_started(self, _: replies.Started, now: float) -> None:
        self._restarted("it has just started", now)

    def _restarted(self, evidence: str, now: float) -> None:
        """The printer knows nothing any more: begin anew if nothing was printed, else never."""
        self._apply(Trigger.RESTARTED)
        if self._ended:
            self._events.append(told.Halted(f"{RESET}: {evidence}", self._acknowledged))
        else:
            self._flight = AckTracker(Window(*self._window_rules), self._give_up)
            self._greeting.forget(now)

    def _on_stopped(self, stopped: replies.Stopped, now: float) -> None:
        when, cause = self._said
        because = f" ({cause})" if cause and now - when <= _CAUSE_WITHIN else ""
        self._halt(f"the printer stopped: {stopped.text}{because}")

    def _on_unknown(self, unknown: replies.Unknown, now: float) -> None:
        self._on_text(unknown, now)
        said = unknown.command
        if not said or not any(command.startswith(said) for command in self._flight.ledger.commands()):
            # It read the remains of a line as a line of its own: the ok behind this answers none of ours.
            if self._flight.doubt is not None:
                self._flight.doubt.misread()
            self._flight.stray(now, refusal=True)

    def _on_introduction(self, said: replies.Identity | replies.Capability, _: float) -> None:
        if self._state is State.IDENTIFYING:
            self._greeting.hear(said)

    def _on_position(self, position: replies.Position, now: float) -> None:
        self._script.position = (position.x, position.y, position.z)
        if self._flight.doubt is not None:
            self._flight.doubt.place = (position.x, position.y, position.z, position.e)
        self._on_text(position, now)

    def _on_last_line(self, line: replies.LastLine, now: float) -> None:
        number = self._flight.count(line.number, now) if self._state is not State.CONNECTING else None
        if number is not None:
            self._accept(number, now, settled=True)

    def _on_garbled(self, garbled: replies.Garbled, now: float) -> None:
        self._on_text(garbled, now)
        self._flight.stray(now, refusal=garbled.refusal)

    def _on_temperature(self, temperature: told.Temperature, now: float) -> None:
        if temperature.waiting:
            self._flight.watch.answered(now)
        elif self._greeting.dialect.ok_when_read:
            number = self._flight.reported()
            if number is not None:
                self._accept(number, now, settled=True)
        self._events.append(temperature)

    def _on_busy(self, busy: told.Busy, now: float) -> None:
        self._greeting.busy(now)
        self._flight.watch.busy(now)
        self._events.append(busy)

    def _on_action(self, action: told.Action, _: float) -> None:
        if self._obeys and action.name in {"pause", "paused"}:
            self.pause()
        elif self._obeys and action.name in {"resume", "resumed"}:
            self.resume()
        self._events.append(action)

    def _on_text(self, said: replies.WithText, _: float) -> None:
        self._events.append(told.Message(said.text))

    def _on_message(self, said: told.Message, now: float) -> None:
        self._said = (now, said.text)
        self._events.append(said)

    def _apply(self, trigger: Trigger) -> bool:
        """Apply a trigger; return False if it is not valid in the current state."""
        state = TRANSITIONS[self._state].get(trigger)
        if state is None:
            return False
        self._state = state
        self._ended = state in ENDED
        return True

    def _halt(self, reason: str) -> None:
        if self._apply(Trigger.HALT):
            self._events.append(told.Halted(reason, self._acknowledged))
