"""Control a print around the streamer: pauses, commands of users, prompts of the printer, temperatures.

Like the streamer, it has no I/O, clock or thread; `session.run` calls `on_turn`, `record` and `hear`.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import inf
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.gcode.state import ModalState
from printer_slicer.printing import commands
from printer_slicer.printing.command_gcode import GCODE_COMMANDS, gcode_for
from printer_slicer.printing.commands import PrintCommand
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.journal import Journal
from printer_slicer.printing.machine_state import SCRIPT
from printer_slicer.printing.move_geometry import nearest, remaining_move, state_at
from printer_slicer.printing.objects import LiveJob
from printer_slicer.printing.parking import (
    ParkedState,
    end_script,
    extruded_length,
    leave,
    park_state,
    parking_position,
    return_to_part,
)
from printer_slicer.stream import events as stream_events
from printer_slicer.stream.events import Identified, Prompt, Reading, Temperature
from printer_slicer.stream.framing import check_commands
from printer_slicer.stream.heater_watchdog import HeaterWatchdog
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.replies import Position, Unknown, read_reply
from printer_slicer.stream.send_history import PROBE_COMMAND
from printer_slicer.stream.states import State

__all__ = ["REPORT", "PrintController", "PrintPhase", "Prompts", "Request", "TemperaturePoll"]

_OFF_PATH: Final = 0.5  # mm between the reported stop position and the commanded path

_WAITS_FOR_PERSON: Final = commands_that(Effect.WAITS_FOR_PERSON)
_GIVE_UP: Final = 20.0  # s that M410 and the position query after it may take


class PrintController:
    """Controls one streamer.

    Args:
        streamer: created with `handle_actions=False` and the same entries as `job`.
        job: the entries as they are sent.
        setup: the printer.
        journal: journal for a later resume; None: no journal.
        listen: called with the events of the streamer and some more.
        allow: returns why a command typed by a user is rejected, empty if it is allowed.

    Attributes:
        phase: current phase of the print.
        parked: state to return to, while the print is not running.
        prompts: prompts of the printer.
        heat: last reported temperatures.
        watchdog: heater watchdog.
        halted: whether the printer was told to halt.
        end_requests: number of requests to end the print.
        ended: the last event, once there is one.
    """

    def __init__(
        self,
        streamer: Streamer,
        job: LiveJob,
        setup: HostSettings,
        *,
        journal: Journal | None = None,
        listen: Callable[[stream_events.Event], None] = lambda _: None,
        allow: Callable[[bytes], str] = lambda _: "",
    ) -> None:
        self.phase = PrintPhase.RUNNING
        self.parked: ParkedState | None = None
        self.prompts = Prompts()
        self.heat = TemperaturePoll()
        self.watchdog = HeaterWatchdog()
        self.halted = self._waits_for_user = self._warned = False
        self.end_requests = 0
        self.ended: stream_events.Finished | stream_events.Halted | None = None
        self.speed = self.flow = 100.0
        self._streamer = streamer
        self._job = job
        self._setup, self._journal = setup, journal
        self._listen = listen
        self._allow = allow
        self._requests: deque[Request] = deque()
        self._identity: stream_events.Identified | None = None
        self._now = self._pushed = 0.0
        self._pause = commands.Pause()
        self._reported_position: tuple[float, float, float, float] | None = None
        self._stop_due, self._stop_sent = inf, 0
        self._restore: tuple[ParkedState | None, float, tuple[str, ...], bool] | None = None
        self._scripted: deque[bytes] = deque()
        self._handlers = self._command_handlers()

    def _command_handlers(self) -> dict[type, Callable[[Any], str]]:
        """Return the handler of each kind of command."""
        return {
            **dict.fromkeys(GCODE_COMMANDS, self._on_gcode_command),
            commands.Pause: self._on_pause,
            commands.Resume: self._on_resume,
            commands.Cancel: lambda _: self.cancel(),
            commands.CancelObject: self._on_object,
            commands.Answer: self._on_answer,
            commands.Status: lambda _: json.dumps(self.status()),
            commands.Stop: lambda _: self.halt(),
        }

    def status(self) -> dict[str, Any]:
        """Return the status for JSON."""
        own = {"state": self._state, "speed_percent": self.speed, "flow_percent": self.flow}
        own |= {"done": self._streamer.acknowledged, "total": len(self._job)}
        return own | self.heat.as_json() | self._job.as_json() | self.prompts.as_json()

    # Called by the session.

    def submit(self, request: Request) -> None:
        """Queue a request for the next turn. May be called by any thread."""
        self._requests.append(request)

    def on_turn(self, now: float) -> None:
        """Execute requests and continue the current phase."""
        self._now = now
        if self._restore is not None and self._streamer.state is State.STREAMING:
            self._restore_state()
        while self._requests:
            request = self._requests.popleft()
            try:
                request.done(self._handlers[type(request.command)](request.command))
            except UsageError as error:
                request.done(error)
        if self.phase is PrintPhase.STOPPING:
            self._stop_moving()
        elif self.phase is PrintPhase.LEAVING and self._streamer.is_idle:
            self._change(PrintPhase.WAITING)
        elif self.phase is PrintPhase.RETURNING and not self._streamer.injected_count:
            self._go_on()
        if now >= self.heat.due:
            self._poll()
        if alarm := self.watchdog.check(now):
            self._listen(stream_events.StreamWarning(str(alarm)))

    def record(self, events: Sequence[stream_events.Event]) -> None:
        """Record events in the journal before the corresponding bytes are written."""
        journal = self._journal
        for event in events:
            if isinstance(event, stream_events.LineSent):
                self._job.follow(event.entries - (not event.command))
                if event.command:
                    self.watchdog.on_sent(event.command, self._now)
                    self._job.modes.follow(event.command, self._origin(event.command))
                if journal:
                    journal.numbered(event.number, event.entries, event.command)
            elif isinstance(event, stream_events.Accepted):
                self._job.follow(event.acknowledged)
                if journal:
                    journal.accepted(self._streamer.accepted_line, event.acknowledged, self._now)
        if journal and journal.failed and not self._warned:
            self._warned = True
            self._listen(
                stream_events.StreamWarning(
                    f"the journal cannot be written ({journal.failed}): the print continues, but cannot be resumed"
                )
            )

    def _origin(self, command: bytes) -> int:
        """Return the origin of a command that is not from the job: -1 for a user, SCRIPT for the host."""
        if self._scripted and self._scripted[0] == strip(command):
            self._scripted.popleft()
            return SCRIPT
        return -1

    def _send_script(self, script: Sequence[bytes]) -> None:
        """Send commands of the host ahead of the job."""
        for command in script:
            self._scripted.append(command)
            self._streamer.inject(command)

    def hear(self, event: stream_events.Event) -> None:
        """Process an event of the streamer and pass it to the listener."""
        if isinstance(event, stream_events.LineSent):
            return
        if warning := self.watchdog.on_event(event, self._now):
            self._listen(stream_events.StreamWarning(str(warning)))
        if isinstance(event, stream_events.Identified):
            self._identified(event)
        elif isinstance(event, stream_events.Temperature):
            self.heat.read(event, self._now)
        elif isinstance(event, stream_events.Message):
            self._on_message(event)
        elif isinstance(event, stream_events.Busy):
            self._waits_for_user = event.reason.startswith("paused for")
        elif isinstance(event, stream_events.Accepted):
            self._waits_for_user = False
        elif isinstance(event, stream_events.Finished | stream_events.Halted):
            self.ended = event
        self._listen(event)
        if isinstance(event, stream_events.Action):
            self._on_action(event)

    # Ends.

    def stop_reporting(self) -> None:
        """Stop reporting events, because the listener has failed."""
        self._listen = lambda _: None

    def cancel(self) -> str:
        """Cancel the job and run the end script."""
        self.end_requests += 1
        if self._streamer.state is State.CANCELLING:
            return "already cancelling"
        if self.phase is PrintPhase.STOPPING or self._waits_for_user:
            self._streamer.send_at_once(b"M108")
        modes = self._job.follow(self._streamer.taken)
        if self._journal:
            self._journal.state({"phase": "cancelling", "parked": None})
        self._scripted.clear()
        self._streamer.cancel(end_script(modes, self._setup, parking_position(self._setup, modes)))
        self.phase = PrintPhase.RUNNING
        self._listen(stream_events.Stopping())
        return "cancelled"

    def halt(self) -> str:
        """Halt the printer with M112."""
        self.end_requests += 1
        self.halted = True
        self._streamer.emergency_stop()
        return "emergency stop sent"

    # Pausing.

    def _on_pause(self, command: commands.Pause) -> str:
        if not self._is_printing:
            raise UsageError(
                f"cannot pause: the print is {self._state}", remedy="Wait, or run `control status`"
            )
        self._streamer.pause()
        self._pause = command
        if (
            command.now
            and self._setup.firmware.has_quick_stop
            and self._job.follow(self._streamer.taken).comparable
        ):
            self._reported_position = None
            self._stop_due, self._stop_sent = self._now + _GIVE_UP, 0
            self._change(PrintPhase.STOPPING)
            return "stopping"
        self._leave(self._parked(self._job.follow(self._streamer.taken).stand))
        return "pausing after the planned moves"

    def _stop_moving(self) -> None:
        """Discard the planned moves (M410) once no line in flight could be planned after them."""
        streamer = self._streamer
        if not self._stop_sent and streamer.is_idle:
            self._streamer.send_at_once(b"M410")
            streamer.inject(b"M400")
            streamer.inject(b"M114")
            self._stop_sent, self._stop_due = 1, self._now + _GIVE_UP
        elif self._stop_sent and self._reported_position and streamer.is_idle:
            self._on_stopped(self._reported_position)
        elif self._stop_sent and self._now >= self._stop_due:
            self._listen(stream_events.StreamWarning("the printer does not report where it stopped"))
            self._leave(self._parked(self._job.modes.stand))

    def _on_stopped(self, place: tuple[float, float, float, float]) -> None:
        """Determine which planned moves were not executed."""
        modes = self._job.follow(self._streamer.taken)
        steps = list(modes.recent)
        index, share, off = nearest(steps, place)
        if off > _OFF_PATH:
            self._listen(stream_events.StreamWarning(f"the printer stopped {off:.2f} mm away from its path"))
        replay = [remaining_move(steps[index], share)] if share < 1.0 else []
        replay += [step.command for step in steps[index + 1 :]]
        modes.recent = deque(steps[: index + 1], modes.recent.maxlen)
        here = state_at(steps[index], share)
        modes.stop_at(here)
        self._leave(replace(self._parked(here), replay=tuple(one.decode("latin-1") for one in replay)))

    def _parked(self, stand: ModalState) -> ParkedState:
        return park_state(stand, self._job.modes, self._setup, self._pause, self._streamer.taken)

    def _leave(self, parked: ParkedState) -> None:
        self.parked = parked
        script = leave(parked, self._job.modes, self._setup)
        self._pushed = 0.0
        self._record_phase(PrintPhase.LEAVING)
        self._pushed = extruded_length(script)
        self._send_script(script)
        self._change(PrintPhase.LEAVING)

    def _on_resume(self, _: commands.Resume) -> str:
        if self._waits_for_user and self.phase is PrintPhase.RUNNING:
            self._streamer.send_at_once(b"M108")
            return "told the printer to continue"
        if (
            self.phase is PrintPhase.RUNNING and self._streamer.state is State.PAUSED
        ):  # the printer paused by itself
            self._streamer.inject(self._setup.firmware.resume_command)
            self._streamer.resume()
            return "told the printer to continue"
        if self.phase in {PrintPhase.RUNNING, PrintPhase.RETURNING, PrintPhase.STOPPING}:
            raise UsageError(f"cannot resume: the print is {self._state}", remedy="Run `control status`")
        self.return_to_part(self._pushed)
        return "resuming"

    def return_to_part(self, pushed: float) -> None:
        """Return to the part and resume.

        Args:
            pushed: mm of filament extruded since parking; negative for retracted.
        """
        parked = self.parked
        assert parked is not None
        self._pushed = pushed
        self._record_phase(PrintPhase.RETURNING)
        back = return_to_part(parked, self._setup, pushed, inches=self._job.modes.machine.inches)
        self._send_script(back + [text.encode("latin-1") for text in parked.replay])
        self._change(PrintPhase.RETURNING)

    def restore(
        self, parked: ParkedState | None, pushed: float, replay: Sequence[str], *, waits: bool
    ) -> None:
        """Take over a paused or parking print from another host once the printer is connected.

        Args:
            parked: state to return to; None: the printer is already there.
            pushed: mm of filament extruded since parking.
            replay: discarded moves that are still to be made.
            waits: whether the print stays paused.
        """
        self._restore = (parked, pushed, tuple(replay), waits)

    def _restore_state(self) -> None:
        assert self._restore is not None
        parked, self._pushed, replay, waits = self._restore
        self._restore = None
        self.parked = parked and replace(parked, replay=replay)
        self._streamer.pause()
        if parked and waits:
            self._record_phase(PrintPhase.LEAVING)
            self._change(PrintPhase.WAITING)
        elif parked:
            self.return_to_part(self._pushed)
        else:
            self._send_script([text.encode("latin-1") for text in replay])
            self._change(PrintPhase.RETURNING)

    def _go_on(self) -> None:
        self.parked = None
        self._record_phase(PrintPhase.RUNNING)
        self._streamer.resume()
        self._change(PrintPhase.RUNNING)

    def _change(self, phase: PrintPhase) -> None:
        self.phase = phase
        if phase is PrintPhase.WAITING:
            self._listen(stream_events.Paused("resume, or cancel"))
        elif phase is PrintPhase.RUNNING:
            self._listen(stream_events.Resumed())

    def _record_phase(self, phase: PrintPhase) -> None:
        if self._journal:
            parked = self.parked.as_json() if self.parked else None
            state = {"phase": phase.value, "pushed": self._pushed, "line": self._streamer.next_line}
            self._journal.state({**state, "parked": parked, "recovering_at": None})

    # Other commands.

    def _on_object(self, command: commands.CancelObject) -> str:
        job = self._job
        name = job.cancel(command.name, self._streamer.taken)
        cancel = self._setup.firmware.cancel_object_command
        if cancel is not None and job.marked_for_klipper:
            job.cancelled.discard(name)
            self._inject(cancel(name))
        elif self._journal:
            self._journal.state({"cancelled": sorted(job.cancelled), "cancelled_at": job.cancelled_at})
        self._listen(stream_events.StreamWarning(f"object {name} cancelled"))
        return f"object {name} cancelled"

    def _on_gcode_command(self, command: Any) -> str:
        answer = self._inject(gcode_for(command, self._setup.firmware, self._identity))
        if isinstance(command, commands.Speed):
            self.speed = command.percent
        elif isinstance(command, commands.Flow):
            self.flow = command.percent
        elif isinstance(command, commands.SetTemperature) and self.parked and command.heater == "nozzle":
            self.parked = replace(self.parked, hotend=command.celsius)
        return answer

    def _on_answer(self, command: commands.Answer) -> str:
        if self.prompts.shown is None:
            raise UsageError("the printer has no open prompt", remedy="Run `control status`")
        self._streamer.send_at_once(b"M876 S%d" % command.choice)
        return "answered"

    def _inject(self, command: bytes) -> str:
        if self._streamer.state not in {State.STREAMING, State.PAUSED}:
            raise UsageError(
                f"cannot send a command: the print is {self._state}", remedy="Wait until the print is running"
            )
        if reason := self._allow(command):
            raise UsageError(
                f"{command.decode(errors='replace')}: {reason}",
                remedy="Use --allow NAME when you start the print to permit it",
            )
        check_commands([command])
        self._streamer.inject(command)
        return f"sent {command.decode(errors='replace')}"

    @property
    def _state(self) -> str:
        return self.phase.value if self.phase is not PrintPhase.RUNNING else self._streamer.state.value

    @property
    def _is_printing(self) -> bool:
        """Return whether the job is being sent and no other phase is active."""
        return self.phase is PrintPhase.RUNNING and self._streamer.state is State.STREAMING

    # Requests of the printer.

    def _on_action(self, action: stream_events.Action) -> None:
        word, _, rest = action.name.partition(" ")
        if word in {"pause", "filament_runout", "out_of_filament"} and self._is_printing:
            if word != "pause":
                self._listen(stream_events.StreamWarning("filament runout: load new filament, then resume"))
            self._on_pause(commands.Pause())
        elif word == "paused" and self._is_printing:
            # It has parked by itself, and returns by itself.
            self._streamer.pause()
            self._listen(stream_events.Paused(rest or "the printer waits for the user"))
        elif word in {"resume", "resumed"} and self.phase is PrintPhase.RUNNING:
            self._streamer.resume()
            if word == "resumed":
                self._listen(stream_events.Resumed())
        elif word == "resume" and self.phase in {PrintPhase.LEAVING, PrintPhase.WAITING}:
            self.return_to_part(self._pushed)
        elif word == "cancel":
            self.cancel()
        elif word.startswith("prompt_") and (prompt := self.prompts.hear(word, rest)) is not None:
            self._listen(prompt)

    def _on_message(self, message: stream_events.Message) -> None:
        for reply in read_reply(message.text.encode()):
            if isinstance(reply, Position) and reply.e is not None:
                self._reported_position = reply.x, reply.y, reply.z, reply.e
            elif isinstance(reply, Unknown):
                self._on_unknown(parse(reply.command)[0])

    def _on_unknown(self, word: bytes) -> None:
        """Pause for a command that the firmware does not know and that waits for the user."""
        if word in _WAITS_FOR_PERSON and self._is_printing:
            what = "change the filament, then resume" if word == b"M600" else "resume when ready"
            self._listen(
                stream_events.StreamWarning(f"the firmware does not support {word.decode()}: {what}")
            )
            self._on_pause(commands.Pause())

    # Temperatures.

    def _identified(self, who: stream_events.Identified) -> None:
        self._identity = who
        if self.heat.identified(who, self._now):
            self._streamer.inject(REPORT)

    def _poll(self) -> None:
        """Query temperatures if nothing else is queued."""
        self.heat.wait(self._now)
        if self._streamer.state in {State.STREAMING, State.PAUSED} and not self._streamer.injected_count:
            self._streamer.inject(PROBE_COMMAND)


class PrintPhase(Enum):
    """Phase of a print between running and paused.

    phase       next
    running     leaving (pause), stopping (pause now)
    stopping    leaving, after the printer has reported its position
    leaving     waiting, after the nozzle has left the part
    waiting     returning (resume)
    returning   running, after the nozzle is back at its position
    """

    RUNNING = "printing"
    STOPPING = "stopping"
    LEAVING = "parking"
    WAITING = "paused"
    RETURNING = "returning"


@dataclass(slots=True)
class Request:
    """A queued command.

    Attributes:
        command: the command.
        done: called with the result, a text for users or the error.
    """

    command: PrintCommand
    done: Callable[[str | UsageError], None] = lambda _: None


REPORT: Final = b"M155 S2"
"""Command that makes the firmware report temperatures by itself."""

_POLL: Final = 5.0
"""Interval of temperature queries, if the firmware does not report by itself, s."""


class Prompts:
    """Prompts of the printer.

    Attributes:
        shown: the open prompt, None if there is none.
    """

    def __init__(self) -> None:
        self.shown: Prompt | None = None
        self._text = ""
        self._buttons: list[str] = []

    def as_json(self) -> dict[str, Any]:
        """Return this part of the status."""
        shown = self.shown
        return {"prompt": {"text": shown.text, "buttons": shown.buttons} if shown else None}

    def hear(self, word: str, rest: str) -> Prompt | None:
        """Process an action of the printer; return the prompt to show, an empty one when it is closed, else None."""
        if word == "prompt_begin":
            self._text, self._buttons = rest, []
        elif word in {"prompt_choice", "prompt_button"}:
            self._buttons.append(rest)
        elif word == "prompt_show":
            self.shown = Prompt(self._text, tuple(self._buttons))
            return self.shown
        elif word == "prompt_end" and self.shown:
            self.shown = None
            return Prompt("", ())
        return None


class TemperaturePoll:
    """Temperature readings, and when to query them.

    Attributes:
        readings: last reported temperatures.
        due: time of the next query, s; infinite if the firmware reports by itself.
    """

    def __init__(self) -> None:
        self.readings: tuple[Reading, ...] = ()
        self.due = inf
        self._reports = False

    def as_json(self) -> dict[str, Any]:
        """Return this part of the status."""
        return {"temperatures": {one.name: [one.actual, one.target] for one in self.readings}}

    def identified(self, who: Identified, now: float) -> bool:
        """Process the capabilities; return whether to make the firmware report by itself."""
        self._reports = who.has_capability("AUTOREPORT_TEMP")
        self.wait(now)
        return self._reports

    def read(self, temperature: Temperature, now: float) -> None:
        """Process a temperature report."""
        self.readings = temperature.readings
        self.wait(now)

    def wait(self, now: float) -> None:
        """Postpone the next query."""
        self.due = inf if self._reports else now + _POLL
