"""Stream a job to a printer, without port, clock or thread: bytes come in, bytes and events go out.

The owner calls `send` and writes the result, waits until bytes arrive or the time of `wakeup`, and passes received
bytes to `receive`. `events` returns what happened.

Lost bytes in either direction do no harm: lines carry numbers, a number is never reused, and the printer accepts lines
only in order. A line is resent only if the printer requests it. If an answer is missing or unreadable, the streamer
sends the *next* number with a probe, a harmless temperature query. A printer that lacks a line then requests it; one
that lacks none answers. Both replies show which lines arrived.

See `window` for the number of lines in flight, `firmware` for the differences between firmwares, and `unacked_line` for
firmwares that ignore line numbers.

Source: Marlin documentation, "M105", "M110", "M114", "M115", "Host keepalive"; recorded answers of real firmware.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.deprecation import warn_renamed
from printer_slicer.firmware import DEFAULT_WIRE_DIALECT, get_wire_dialect
from printer_slicer.stream import events as stream_events
from printer_slicer.stream import replies
from printer_slicer.stream.ack_tracker import AckTracker
from printer_slicer.stream.framing import check_commands, find_max_command_length
from printer_slicer.stream.handshake import Handshake
from printer_slicer.stream.send_history import PROBE_COMMAND
from printer_slicer.stream.send_queue import SendQueue
from printer_slicer.stream.states import ENDED, TRANSITIONS, State, Trigger
from printer_slicer.stream.unacked_line import LineFate
from printer_slicer.stream.window import Window

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from printer_slicer.motion.rules import MotionLimits

__all__ = ["RESET_REASON", "Streamer"]

RESET_REASON: Final = "the printer was reset"
"""Start of the reason that is reported if a printer reset halts the print."""

_MAX_REPLY_BYTES: Final = 1024
_CAUSE_SECONDS: Final = 1.0
"""A message counts as the cause of a halt if it arrived within this time before it, s, and after the last ok."""

_EMERGENCY: Final = b"\nM112\n"
_NO_MESSAGE: Final = (-inf, "")


class Streamer:
    """Streams a job so that the printer executes every line once and in order, or reports why that failed.

    Args:
        commands: the job, one command per entry; entries may be comments or empty.
        limits: motion limits of the machine, used for response timeouts. None: timeouts are much longer.
        window_lines: limit of lines in flight; more only where it is safe, see `window`.
        window_bytes: limit of bytes in flight; the smallest common receive buffer holds one more.
        baud: baud rate. Replies faster than it allows show that the link is native USB. None: not checked.
        dialect: key of `WIRE_DIALECTS`; None: chosen by the reported firmware.
        connect_timeout: s until a printer that never answers counts as missing.
        give_up: s until a printer that answers no probe counts as unresponsive.
        handle_actions: whether to pause and resume when the printer requests it; otherwise the owner does so.
        first: number of job entries that the printer has already received.
        obeys: former name of `handle_actions`.

    Raises:
        UsageError: an entry can never be sent, or the dialect is unknown.
    """

    def __init__(  # noqa: PLR0913 - independent options with default values
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
        obeys: bool | None = None,
    ) -> None:
        self._dialect = get_wire_dialect(dialect or DEFAULT_WIRE_DIALECT)
        self._handshake = Handshake(connect_timeout, dialect)
        self._window_rules = (window_lines, window_bytes, baud)
        self._give_up = give_up
        self._queue = SendQueue(commands, limits, self._dialect.max_line_bytes)
        self._tracker = AckTracker(Window(*self._window_rules), give_up)
        self._queue.n_entries_taken = self._acknowledged = first
        self._state = State.CONNECTING
        self._ended = False
        self._events: list[stream_events.Event] = []
        self._urgent = b""
        self._numbered_job = self._n_received_before = first
        self._handles_actions = handle_actions if obeys is None else _read_former_obeys(obeys)
        self._partial = b""
        self._last_message: tuple[float, str] = _NO_MESSAGE
        self._handlers: Mapping[type, Callable[[Any, float], None]] = {
            replies.Ok: self._on_ok,
            replies.Resend: self._on_resend,
            replies.LineError: self._on_line_error,
            replies.Wait: self._on_wait,
            replies.Started: self._on_started,
            replies.Stopped: self._on_stopped,
            replies.UnknownCommand: self._on_unknown,
            replies.LastLine: self._on_last_line,
            replies.Identity: self._on_identity,
            replies.Capability: self._on_identity,
            replies.Position: self._on_position,
            replies.Garbled: self._on_garbled,
            stream_events.Temperature: self._on_temperature,
            stream_events.Busy: self._on_busy,
            stream_events.Action: self._on_action,
            stream_events.Message: self._on_message,
        }

    @property
    def state(self) -> State:
        """Return the current state of the streamer."""
        return self._state

    @property
    def done(self) -> bool:
        """Return whether the print has ended and nothing is left to send."""
        return self._ended and not self._urgent

    @property
    def acknowledged(self) -> int:
        """Return the number of job entries that the printer has accepted and that need not be sent again."""
        return self._acknowledged

    @property
    def n_entries_taken(self) -> int:
        """Return the number of job entries that were given a line number or skipped."""
        return self._queue.n_entries_taken

    @property
    def accepted_line_number(self) -> int:
        """Return the number of the last accepted line, as counted by the serial protocol."""
        return self._tracker.history.accepted

    @property
    def next_line_number(self) -> int:
        """Return the lowest line number that is not used yet."""
        return self._tracker.history.next_number

    @property
    def injected_count(self) -> int:
        """Return the number of injected commands that have no line number yet."""
        return self._queue.injected_count

    @property
    def is_idle(self) -> bool:
        """Return whether no line is in flight and no injected command is queued."""
        return not self._tracker.history.n_in_flight and not self._queue.injected_count

    def events(self) -> list[stream_events.Event]:
        """Return the events since the last call, in order."""
        events, self._events = self._events, []
        return events

    def pause(self) -> None:
        """Pause the job until `resume`; lines in flight are still executed."""
        self._apply_trigger(Trigger.PAUSE)

    def resume(self) -> None:
        """Resume the job after `pause`."""
        self._apply_trigger(Trigger.RESUME)

    def inject(self, command: bytes) -> None:
        """Queue a command ahead of the rest of the job; it is also sent while paused.

        Raises:
            UsageError: the command can never be sent.
        """
        self._queue.inject(command)

    def cancel(self, end_script: Sequence[bytes] = ()) -> None:
        """Drop the rest of the job and the injected commands, send the end script instead, and finish.

        A command that waits for a heater or a user is interrupted.

        Raises:
            UsageError: a command of the script can never be sent.
        """
        check_commands(end_script)
        if self._apply_trigger(Trigger.CANCEL):
            self._queue.cancel(end_script)
            if self._ended:
                self._events.append(
                    stream_events.Halted("cancelled before anything was printed", self._acknowledged)
                )

    def emergency_stop(self) -> None:
        """Halt the printer with M112, which is sent ahead of all queued lines; nothing is sent after it."""
        self._urgent = _EMERGENCY
        self._halt("emergency stop")

    def send_at_once(self, command: bytes) -> None:
        """Send M108, M410 or M876 without a number and ahead of all queued lines.

        Firmware handles these commands early.

        Raises:
            UsageError: the command can never be sent.
        """
        check_commands([command])
        if not self._ended and self._state is not State.CONNECTING:
            self._tracker.record_unnumbered_command()
            self._urgent += b"\n%s\n" % command

    def receive(self, data: bytes, now: float) -> None:
        """Process bytes that were received at `now`, s."""
        before = self._acknowledged
        *lines, self._partial = (self._partial + data).split(b"\n")
        if len(self._partial) > _MAX_REPLY_BYTES:
            lines.append(self._partial)
            self._partial = b""
        for line in lines:
            for reply in replies.parse_replies(line.rstrip(b"\r")):
                if not self._ended:
                    self._handlers[type(reply)](reply, now)
        if self._acknowledged > before:
            # An event that ends the print comes last.
            self._events.insert(len(self._events) - self._ended, stream_events.Accepted(self._acknowledged))

    def send(self, now: float) -> bytes:
        """Return the bytes to write now; may be empty."""
        urgent, self._urgent = self._urgent, b""
        if self._ended:
            return urgent
        if self._state is State.CONNECTING:
            return urgent + self._connect(now)
        if self._tracker.resends.is_active and not self._go_back_if_settled(now):
            return urgent
        out = [urgent]
        if self._state is State.CANCELLING:
            out.append(self._tracker.break_wait(now))
        if self._tracker.is_overdue(now):
            out.append(self._make_probe(now))
        while self._prepare_next_line(now):
            out.append(self._tracker.history.send_next(now))
        return b"".join(out)

    def wakeup(self) -> float | None:
        """Return when to call `send` even if nothing arrives, s; None for never."""
        if self._urgent:
            return 0.0
        if self._ended:
            return None
        due = (
            self._handshake.next_request_at
            if self._state is State.CONNECTING
            else self._tracker.next_action_at
        )
        if self._state is State.CANCELLING and due is not None:
            due = max(min(due, self._tracker.next_break_at), 0.0)
        return due if due is not None and isfinite(due) else None

    # Sending.

    def _connect(self, now: float) -> bytes:
        """Return the handshake request to write now; halt if no printer has answered in time."""
        if self._handshake.has_timed_out(now):
            self._halt("no printer answered: check the port, the baud rate and the cable")
            return b""
        return self._handshake.send(now)

    def _go_back_if_settled(self, now: float) -> bool:
        """Go back to the requested line once all resend requests are in; return whether to send now."""
        tracker, resends = self._tracker, self._tracker.resends
        if not resends.is_settled(now):
            return False
        if resends.claimed_line is not None:
            # The resend request after this error was lost, but the error has named the line.
            tracker.on_resend(None, now)
            self._check_lost_count(now)
        wanted = resends.requested_line
        if wanted is None:
            return not self._ended
        if not resends.finish():
            self._halt(f"the printer keeps rejecting line {wanted}")
            return False
        self._acknowledged = min(
            self._acknowledged, max(tracker.go_back(wanted, now), self._n_received_before)
        )
        self._events.append(stream_events.ResendRequested(wanted))
        return True

    def _make_probe(self, now: float) -> bytes:
        """Return the bytes of a probe, or halt if the printer has answered no probe for too long."""
        tracker, history = self._tracker, self._tracker.history
        if tracker.timer.is_unresponsive(history.oldest, now):
            self._halt("the printer has stopped answering")
            return b""
        self._events.append(stream_events.Probe(history.cursor))
        if not self._dialect.checks_line_numbers and self._state is not State.IDENTIFYING:
            tracker.unacked = tracker.unacked or self._queue.make_unacked_line()
            return tracker.query_position(tracker.unacked, now)
        if tracker.can_query_last_line:
            return tracker.query_last_line(now)
        if history.cursor == history.next_number:
            self._assign_number(PROBE_COMMAND)
        return tracker.send_probe(now)

    def _prepare_next_line(self, now: float) -> bool:
        """Return whether a line may be sent now; if none has a number yet, assign one to the next command."""
        tracker = self._tracker
        if self._ended or self._state is State.CONNECTING:
            return False
        if tracker.history.cursor < tracker.history.next_number:
            return tracker.can_resend()
        max_length = find_max_command_length(tracker.history.next_number, tracker.find_max_line_length())
        command = self._take_next_command(max_length, now) if max_length > 0 else None
        if command is None:
            return False
        self._assign_number(command)
        return True

    def _take_final_query(self, now: float) -> bytes | None:
        """Return the next of the queries that end the print; None while an answer is due, and at the end."""
        tracker = self._tracker
        if tracker.expects_temperatures(now):
            return None
        if not tracker.clear_expected_temperatures():
            self._queue.restart_final_queries()
        command = self._queue.take_final_query()
        if command is None:
            self._apply_trigger(Trigger.FINISH)
            self._events.append(self._queue.make_finished_event(self._acknowledged))
        return command

    def _take_next_command(self, max_length: int, now: float) -> bytes | None:
        """Return the next command of at most `max_length` bytes to send; None if none may be sent now."""
        queue, idle = self._queue, not self._tracker.history.n_in_flight
        if self._state is State.IDENTIFYING:
            return self._handshake.choose_query(self._tracker.history.next_number) if idle else None
        command = queue.take_injected_command(max_length)
        if command is None and (self._state is State.STREAMING or self._state is State.CANCELLING):
            command = queue.take_job_command(max_length)
            if command is None and idle:
                self._accept_all()
        if command is None and self._state is State.FINISHING and idle:
            command = self._take_final_query(now)
        return command

    def _accept_all(self) -> None:
        """Mark all job entries as accepted, since only comments are left, and start to finish the print."""
        if self._queue.n_entries_taken > self._acknowledged:
            self._acknowledged = self._queue.n_entries_taken
            self._events.append(stream_events.Accepted(self._acknowledged))
        self._queue.restart_final_queries()
        self._apply_trigger(Trigger.ACCEPTED)

    def _assign_number(self, command: bytes) -> None:
        """Assign the next line number to a command; report it if it is not simply the next job entry."""
        entries = self._queue.n_entries_taken
        if entries != self._numbered_job + 1:
            inserted = b"" if entries > self._numbered_job else command
            self._events.append(stream_events.LineSent(self._tracker.history.next_number, entries, inserted))
        self._numbered_job = entries
        self._tracker.add_line(command, self._queue.n_entries_taken, self._queue.track_command(command))

    # Receiving.

    def _on_ok(self, ok: replies.Ok, now: float) -> None:
        if self._state is State.CONNECTING:
            self._on_handshake_ok(ok)
            return
        tracker, self._last_message = self._tracker, _NO_MESSAGE
        if tracker.unacked is not None:
            self._on_ok_of_unacked(ok, now)
            return
        is_conclusive = tracker.is_conclusive(ok)
        # An ok may be left over from the handshake; only the name of the firmware proves that line 1 arrived.
        proven = is_conclusive or self._handshake.firmware is not None or tracker.timer.probes
        if self._state is State.IDENTIFYING and not (proven or tracker.history.accepted):
            return
        number = tracker.match_ok(ok, now)
        self._check_lost_count(now)
        if tracker.has_executed_stray and self._state is not State.IDENTIFYING:
            self._halt(
                "the printer executed something that was not sent: the rest of a line whose start was lost"
            )
        if number is None:
            return
        self._accept(number, now, is_conclusive=is_conclusive)

    def _accept(self, number: int, now: float, *, is_conclusive: bool) -> None:
        """Mark the lines up to `number` as accepted; the last query of the handshake starts the job."""
        self._acknowledged = max(
            self._acknowledged, self._tracker.accept(number, now, is_conclusive=is_conclusive)
        )
        if self._state is State.IDENTIFYING and self._handshake.choose_query(number + 1) is None:
            self._apply_trigger(Trigger.IDENTIFIED)
            self._tracker.history.mark_certainly_accepted(1)
            self._dialect = self._handshake.dialect
            parser = self._handshake.has_capability("EMERGENCY_PARSER")
            self._tracker.set_dialect(self._dialect, emergency_parser=parser)
            self._queue.set_dialect(self._dialect)
            self._events.append(self._handshake.make_identified_event())

    def _on_ok_of_unacked(self, ok: replies.Ok, now: float) -> None:
        """Handle an ok while it is unknown whether the line in flight was executed."""
        tracker = self._tracker
        unacked, number = tracker.unacked, tracker.history.accepted + 1
        assert unacked is not None
        if not ok.has_temperatures:
            unacked.on_bare_ok()
            return
        fate = unacked.resolve_fate()
        if fate is LineFate.EXECUTED:
            self._accept(number, now, is_conclusive=True)
        elif fate is LineFate.LOST:
            tracker.go_back(number, now)
            self._events.append(stream_events.ResendRequested(number))
        elif fate is LineFate.UNKNOWN:
            command = tracker.history.oldest.command.decode(errors="replace")
            self._halt(f"it is unknown whether the printer executed line {number}: {command}")
        elif fate is LineFate.UNDECIDED:
            tracker.timer.on_answer(now)
            tracker.timer.schedule_probe(now)

    def _on_handshake_ok(self, ok: replies.Ok) -> None:
        if self._tracker.resends.ignore_next_ok:
            self._tracker.resends.ignore_next_ok = False
        elif self._handshake.has_started and not ok.has_temperatures:
            self._apply_trigger(Trigger.GREETED)

    def _on_resend(self, resend: replies.Resend, now: float) -> None:
        if self._state is State.CONNECTING:
            self._tracker.resends.ignore_next_ok = True
            self._handshake.restart(now)
        elif self._tracker.unacked is None:
            self._tracker.on_resend(resend.number, now)
            self._check_lost_count(now)

    def _check_lost_count(self, now: float) -> None:
        """If the printer has lost count of the lines, treat it like a printer that was reset."""
        tracker = self._tracker
        if tracker.lost_count is not None:
            evidence = f"it requests line {tracker.lost_count}, but line {tracker.history.cursor} is next"
            self._on_reset(evidence, now)
            # The ok of this rejection is still to come; it must not count as an answer to the handshake.
            self._tracker.resends.ignore_next_ok = tracker.resends.ignore_next_ok

    def _on_line_error(self, error: replies.LineError, now: float) -> None:
        if self._state is not State.CONNECTING and self._tracker.unacked is None:
            self._tracker.resends.on_error(error.expected_line, now)
        self._events.append(stream_events.Message(error.text))

    def _on_wait(self, _: replies.Wait, now: float) -> None:
        self._tracker.on_idle(now)

    def _on_started(self, _: replies.Started, now: float) -> None:
        self._on_reset("it has restarted", now)

    def _on_reset(self, evidence: str, now: float) -> None:
        """Handle a reset of the printer: repeat the handshake if nothing was printed, otherwise halt."""
        self._apply_trigger(Trigger.RESTARTED)
        if self._ended:
            self._events.append(stream_events.Halted(f"{RESET_REASON}: {evidence}", self._acknowledged))
        else:
            self._tracker = AckTracker(Window(*self._window_rules), self._give_up)
            self._handshake.restart(now)

    def _on_stopped(self, stopped: replies.Stopped, now: float) -> None:
        when, cause = self._last_message
        because = f" ({cause})" if cause and now - when <= _CAUSE_SECONDS else ""
        self._halt(f"the printer stopped: {stopped.text}{because}")

    def _on_unknown(self, unknown: replies.UnknownCommand, now: float) -> None:
        self._on_text(unknown, now)
        received = unknown.command
        if not received or not any(
            command.startswith(received) for command in self._tracker.history.list_commands_in_flight()
        ):
            # The printer read part of a line as a separate line: the next ok answers none of the sent lines.
            if self._tracker.unacked is not None:
                self._tracker.unacked.on_stray_command()
            self._tracker.on_stray_reply(now, may_reject=True)

    def _on_identity(self, reply: replies.Identity | replies.Capability, _: float) -> None:
        if self._state is State.IDENTIFYING:
            self._handshake.on_reply(reply)

    def _on_position(self, position: replies.Position, now: float) -> None:
        self._queue.position = (position.x, position.y, position.z)
        if self._tracker.unacked is not None:
            self._tracker.unacked.position = (position.x, position.y, position.z, position.e)
        self._on_text(position, now)

    def _on_last_line(self, line: replies.LastLine, now: float) -> None:
        number = self._tracker.on_last_line(line.number, now) if self._state is not State.CONNECTING else None
        if number is not None:
            self._accept(number, now, is_conclusive=True)

    def _on_garbled(self, garbled: replies.Garbled, now: float) -> None:
        self._on_text(garbled, now)
        self._tracker.on_stray_reply(now, may_reject=garbled.may_reject)

    def _on_temperature(self, temperature: stream_events.Temperature, now: float) -> None:
        if temperature.waiting:
            self._tracker.timer.on_answer(now)
        elif self._handshake.dialect.ok_when_read:
            number = self._tracker.match_temperature_report()
            if number is not None:
                self._accept(number, now, is_conclusive=True)
        self._events.append(temperature)

    def _on_busy(self, busy: stream_events.Busy, now: float) -> None:
        self._handshake.on_busy(now)
        self._tracker.timer.on_busy(now)
        self._events.append(busy)

    def _on_action(self, action: stream_events.Action, _: float) -> None:
        if self._handles_actions and action.name in {"pause", "paused"}:
            self.pause()
        elif self._handles_actions and action.name in {"resume", "resumed"}:
            self.resume()
        self._events.append(action)

    def _on_text(self, reply: replies.ReplyWithText, _: float) -> None:
        self._events.append(stream_events.Message(reply.text))

    def _on_message(self, message: stream_events.Message, now: float) -> None:
        self._last_message = (now, message.text)
        self._events.append(message)

    def _apply_trigger(self, trigger: Trigger) -> bool:
        """Change the state by a trigger; return False if the current state does not allow the trigger."""
        state = TRANSITIONS[self._state].get(trigger)
        if state is None:
            return False
        self._state = state
        self._ended = state in ENDED
        return True

    def _halt(self, reason: str) -> None:
        """End the print early and report why."""
        if self._apply_trigger(Trigger.HALT):
            self._events.append(stream_events.Halted(reason, self._acknowledged))


def _read_former_obeys(obeys: bool) -> bool:
    """Return the value of the former keyword `obeys`, with a warning."""
    warn_renamed("Streamer(obeys=)", "Streamer(handle_actions=)", stacklevel=4)
    return obeys
