"""Control a print that a streamer sends: pauses, user commands, prompts of the printer, temperatures.

Like the streamer, it has no I/O, clock or thread; `session.run` calls `advance`, `record_events` and `on_event`.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from math import inf
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.gcode.state import FULL_FAN_SPEED, ModalState
from printer_slicer.printing import commands
from printer_slicer.printing.command_gcode import GCODE_COMMANDS, changes_position, format_command
from printer_slicer.printing.commands import PrintCommand
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.journal import Journal
from printer_slicer.printing.machine_state import SCRIPT_ENTRY
from printer_slicer.printing.move_geometry import build_remaining_move, find_nearest_move, interpolate_state
from printer_slicer.printing.objects import LiveJob
from printer_slicer.printing.parking import (
    ParkedState,
    build_end_script,
    build_parking_script,
    build_return_script,
    find_parking_position,
    make_parked_state,
    sum_extrusion,
)
from printer_slicer.stream import events as stream_events
from printer_slicer.stream.events import Identified, Prompt, Reading, Temperature
from printer_slicer.stream.framing import check_commands
from printer_slicer.stream.heater_watchdog import HeaterWatchdog
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.replies import Position, UnknownCommand, parse_replies
from printer_slicer.stream.send_history import PROBE_COMMAND
from printer_slicer.stream.states import State
from printer_slicer.values import Struct, replace

__all__ = ["AUTOREPORT_COMMAND", "PrintController", "PrintPhase", "Prompts", "Request", "TemperaturePoll"]

_MAX_PATH_DISTANCE: Final = 0.5  # mm between the reported stop position and the commanded path

_WAITS_FOR_PERSON: Final = find_codes(Effect.WAITS_FOR_PERSON)
_STOP_TIMEOUT: Final = 20.0  # s that M410 and the position query after it may take


class PrintController:
    """Controls a print that one streamer sends.

    Args:
        streamer: created with `handle_actions=False` and the same entries as `job`.
        job: the entries as they are sent.
        setup: settings of the printer.
        journal: journal for a later resume; None: no journal.
        listen: called with each event of the streamer and of the controller.
        allow: returns why a command typed by a user is rejected, empty if it is allowed.

    Attributes:
        phase: current phase of the print.
        parked: state to which the nozzle returns; None while the print is running.
        prompts: prompts of the printer.
        temperatures: last reported temperatures.
        watchdog: heater watchdog.
        halted: whether an emergency stop was sent.
        end_requests: number of requests to end the print.
        ended: the event that ended the print, None before it.
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
        self.temperatures = TemperaturePoll()
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
        self._now = self._extruded = 0.0
        self._pause = commands.Pause()
        self._reported_position: tuple[float, float, float, float] | None = None
        self._stop_due, self._stop_sent = inf, 0
        self._restore: tuple[ParkedState | None, float, tuple[str, ...], bool] | None = None
        self._scripted: deque[bytes] = deque()
        self._handlers = self._make_command_handlers()

    def _make_command_handlers(self) -> dict[type, Callable[[Any], str]]:
        """Return the handler method for each kind of command."""
        return {
            **dict.fromkeys(GCODE_COMMANDS, self._on_gcode_command),
            commands.Pause: self._on_pause,
            commands.Resume: self._on_resume,
            commands.Cancel: lambda _: self.cancel(),
            commands.CancelObject: self._on_cancel_object,
            commands.Answer: self._on_answer,
            commands.Status: lambda _: json.dumps(self.status()),
            commands.Abort: lambda _: self.halt(),
        }

    def status(self) -> dict[str, Any]:
        """Return the status of the print as a JSON object."""
        status = {"state": self._state, "speed_percent": self.speed, "flow_percent": self.flow}
        status |= {"done": self._streamer.acknowledged, "total": len(self._job)}
        modal = self._job.print_state.modal
        status |= {"position": [modal.x, modal.y, modal.z]}
        status |= {"fan_percent": round(self._job.print_state.machine.fan / FULL_FAN_SPEED * 100)}
        return status | self.temperatures.as_json() | self._job.as_json() | self.prompts.as_json()

    # Called by the session.

    def submit(self, request: Request) -> None:
        """Queue a request for the next call of `advance`. May be called by any thread."""
        self._requests.append(request)

    def advance(self, now: float) -> None:
        """Execute requests and continue the current phase."""
        self._now = now
        if self._restore is not None and self._streamer.state is State.STREAMING:
            self._continue_restored_print()
        while self._requests:
            request = self._requests.popleft()
            try:
                request.done(self._handlers[type(request.command)](request.command))
            except UsageError as error:
                request.done(error)
        if self.phase is PrintPhase.STOPPING:
            self._discard_planned_moves()
        elif self.phase is PrintPhase.PARKING and self._streamer.is_idle:
            self._change_phase(PrintPhase.PAUSED)
        elif self.phase is PrintPhase.RETURNING and not self._streamer.injected_count:
            self._resume_job()
        if now >= self.temperatures.next_query_at:
            self._query_temperatures()
        if alarm := self.watchdog.check_silence(now):
            self._listen(stream_events.StreamWarning(str(alarm)))

    def record_events(self, events: Sequence[stream_events.Event]) -> None:
        """Record events in the journal before the corresponding bytes are written."""
        journal = self._journal
        for event in events:
            if isinstance(event, stream_events.LineSent):
                self._job.follow(event.entries - (not event.command))
                if event.command:
                    self.watchdog.on_sent(event.command, self._now)
                    self._job.print_state.follow(event.command, self._find_entry_number(event.command))
                if journal:
                    journal.record_line(event.number, event.entries, event.command)
            elif isinstance(event, stream_events.Accepted):
                self._job.follow(event.acknowledged)
                if journal:
                    journal.record_accepted(
                        self._streamer.accepted_line_number, event.acknowledged, self._now
                    )
        if journal and journal.failure and not self._warned:
            self._warned = True
            self._listen(
                stream_events.StreamWarning(
                    f"the journal cannot be written ({journal.failure}): the print continues, but it cannot be resumed"
                )
            )

    def _find_entry_number(self, command: bytes) -> int:
        """Return the entry number of a command that is not from the job: -1 for a user, SCRIPT_ENTRY for the host."""
        if self._scripted and self._scripted[0] == strip(command):
            self._scripted.popleft()
            return SCRIPT_ENTRY
        return -1

    def _send_script(self, script: Sequence[bytes]) -> None:
        """Send commands of the host ahead of the job."""
        for command in script:
            self._scripted.append(command)
            self._streamer.inject(command)

    def on_event(self, event: stream_events.Event) -> None:
        """Process an event of the streamer and pass it to the listener."""
        if isinstance(event, stream_events.LineSent):
            return
        if warning := self.watchdog.on_event(event, self._now):
            self._listen(stream_events.StreamWarning(str(warning)))
        if isinstance(event, stream_events.Identified):
            self._on_identified(event)
        elif isinstance(event, stream_events.Temperature):
            self.temperatures.on_report(event, self._now)
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
        """Report no more events, because the listener has failed."""
        self._listen = lambda _: None

    def cancel(self) -> str:
        """Cancel the job and run the end script; return the result for the user."""
        self.end_requests += 1
        if self._streamer.state is State.CANCELLING:
            return "already cancelling"
        if self.phase is PrintPhase.STOPPING or self._waits_for_user:
            self._streamer.send_at_once(b"M108")
        print_state = self._job.follow(self._streamer.n_entries_taken)
        if self._journal:
            self._journal.record_state({"phase": "cancelling", "parked": None})
        self._scripted.clear()
        self._streamer.cancel(
            build_end_script(print_state, self._setup, find_parking_position(self._setup, print_state))
        )
        self.phase = PrintPhase.RUNNING
        self._listen(stream_events.Stopping())
        return "cancelled"

    def halt(self) -> str:
        """Halt the printer at once with M112; return the result for the user."""
        self.end_requests += 1
        self.halted = True
        self._streamer.emergency_stop()
        return "emergency stop sent"

    # Pausing.

    def _on_pause(self, command: commands.Pause) -> str:
        """Pause the print; discard the planned moves if the user wants that and the firmware can do it."""
        if not self._is_printing:
            raise UsageError(
                f"cannot pause: the print is {self._state}", remedy="Run printer-slicer control status"
            )
        self._streamer.pause()
        self._pause = command
        if (
            command.now
            and self._setup.firmware.has_quick_stop
            and self._job.follow(self._streamer.n_entries_taken).has_comparable_positions
        ):
            self._reported_position = None
            self._stop_due, self._stop_sent = self._now + _STOP_TIMEOUT, 0
            self._change_phase(PrintPhase.STOPPING)
            return "stopping"
        self._start_parking(self._make_parked_state(self._job.follow(self._streamer.n_entries_taken).modal))
        return "pausing after the planned moves"

    def _discard_planned_moves(self) -> None:
        """Discard the planned moves with M410 once no line is in flight; then find out where the nozzle stopped."""
        streamer = self._streamer
        if not self._stop_sent and streamer.is_idle:
            self._streamer.send_at_once(b"M410")
            streamer.inject(b"M400")
            streamer.inject(b"M114")
            self._stop_sent, self._stop_due = 1, self._now + _STOP_TIMEOUT
        elif self._stop_sent and self._reported_position and streamer.is_idle:
            self._on_stop_position(self._reported_position)
        elif self._stop_sent and self._now >= self._stop_due:
            self._listen(stream_events.StreamWarning("the printer does not report where it stopped"))
            self._start_parking(self._make_parked_state(self._job.print_state.modal))

    def _on_stop_position(self, position: tuple[float, float, float, float]) -> None:
        """Park the nozzle after an immediate stop; save the moves that were not executed for the resume."""
        print_state = self._job.follow(self._streamer.n_entries_taken)
        steps = list(print_state.recent)
        index, fraction, distance = find_nearest_move(steps, position)
        if distance > _MAX_PATH_DISTANCE:
            self._listen(
                stream_events.StreamWarning(f"the printer stopped {distance:.2f} mm away from its path")
            )
        replay = [build_remaining_move(steps[index], fraction)] if fraction < 1.0 else []
        replay += [step.command for step in steps[index + 1 :]]
        print_state.recent = deque(steps[: index + 1], print_state.recent.maxlen)
        here = interpolate_state(steps[index], fraction)
        print_state.stop_at(here)
        self._start_parking(
            replace(self._make_parked_state(here), replay=tuple(one.decode("latin-1") for one in replay))
        )

    def _make_parked_state(self, modal: ModalState) -> ParkedState:
        """Return the parked state for the current pause; the nozzle will return to `modal`."""
        return make_parked_state(
            modal, self._job.print_state, self._setup, self._pause, self._streamer.n_entries_taken
        )

    def _start_parking(self, parked: ParkedState) -> None:
        """Record the parked state, and send the commands that park the nozzle."""
        self.parked = parked
        script = build_parking_script(parked, self._job.print_state, self._setup)
        self._extruded = 0.0
        self._record_phase(PrintPhase.PARKING)
        self._extruded = sum_extrusion(script)
        self._send_script(script)
        self._change_phase(PrintPhase.PARKING)

    def _on_resume(self, _: commands.Resume) -> str:
        """Resume the print; if the printer itself waits for the user, make it continue."""
        if self._waits_for_user and self.phase is PrintPhase.RUNNING:
            self._streamer.send_at_once(b"M108")
            return "resumed the printer"
        if (
            self.phase is PrintPhase.RUNNING and self._streamer.state is State.PAUSED
        ):  # the printer has paused by itself
            self._streamer.inject(self._setup.firmware.resume_command)
            self._streamer.resume()
            return "resumed the printer"
        if self.phase in {PrintPhase.RUNNING, PrintPhase.RETURNING, PrintPhase.STOPPING}:
            raise UsageError(
                f"cannot resume: the print is {self._state}", remedy="Run printer-slicer control status"
            )
        self.return_to_part(self._extruded)
        return "resuming"

    def return_to_part(self, extruded: float) -> None:
        """Return the nozzle to the part, and resume the print.

        Args:
            extruded: filament extruded since parking, mm; negative if retracted.
        """
        parked = self.parked
        assert parked is not None
        self._extruded = extruded
        self._record_phase(PrintPhase.RETURNING)
        back = build_return_script(parked, self._setup, extruded, inches=self._job.print_state.machine.inches)
        self._send_script(back + [text.encode("latin-1") for text in parked.replay])
        self._change_phase(PrintPhase.RETURNING)

    def restore_print(
        self, parked: ParkedState | None, extruded: float, replay: Sequence[str], *, stays_paused: bool
    ) -> None:
        """Prepare to continue a paused or parking print of a previous host, once the printer is connected.

        Args:
            parked: state to which the nozzle returns; None: the nozzle is on the part already.
            extruded: filament extruded since parking, mm.
            replay: discarded moves that must still be sent.
            stays_paused: whether the print stays paused.
        """
        self._restore = (parked, extruded, tuple(replay), stays_paused)

    def _continue_restored_print(self) -> None:
        """Continue the print of a previous host, as prepared by `restore_print`."""
        assert self._restore is not None
        parked, self._extruded, replay, stays_paused = self._restore
        self._restore = None
        self.parked = parked and replace(parked, replay=replay)
        self._streamer.pause()
        if parked and stays_paused:
            self._record_phase(PrintPhase.PARKING)
            self._change_phase(PrintPhase.PAUSED)
        elif parked:
            self.return_to_part(self._extruded)
        else:
            self._send_script([text.encode("latin-1") for text in replay])
            self._change_phase(PrintPhase.RETURNING)

    def _resume_job(self) -> None:
        """Continue the job after the nozzle has returned."""
        self.parked = None
        self._record_phase(PrintPhase.RUNNING)
        self._streamer.resume()
        self._change_phase(PrintPhase.RUNNING)

    def _change_phase(self, phase: PrintPhase) -> None:
        """Change the phase, and report a pause or a resume."""
        self.phase = phase
        if phase is PrintPhase.PAUSED:
            self._listen(stream_events.Paused("resume, or cancel"))
        elif phase is PrintPhase.RUNNING:
            self._listen(stream_events.Resumed())

    def _record_phase(self, phase: PrintPhase) -> None:
        """Record a phase and the parked state in the journal."""
        if self._journal:
            parked = self.parked.as_json() if self.parked else None
            state = {"phase": phase.value, "pushed": self._extruded, "line": self._streamer.next_line_number}
            self._journal.record_state({**state, "parked": parked, "recovering_at": None})

    # Other commands.

    def _on_cancel_object(self, command: commands.CancelObject) -> str:
        """Cancel an object on the plate."""
        job = self._job
        name = job.cancel_object(command.name, self._streamer.n_entries_taken)
        cancel = self._setup.firmware.cancel_object_command
        if cancel is not None and job.marked_for_klipper:
            job.cancelled.discard(name)
            self._inject_user_command(cancel(name))
        elif self._journal:
            self._journal.record_state({"cancelled": sorted(job.cancelled), "cancelled_at": job.cancelled_at})
        self._listen(stream_events.StreamWarning(f"object {name} cancelled"))
        return f"object {name} cancelled"

    def _on_gcode_command(self, command: Any) -> str:
        """Send the G-code of a command, and remember the value that it sets."""
        if isinstance(command, commands.Say) and not self._allows_moves and changes_position(command.gcode):
            raise UsageError(
                f"{command.gcode}: moves the printer or changes its coordinates, which would spoil the print",
                remedy="Pause the print without 'here', send the command, then resume: the nozzle returns",
            )
        answer = self._inject_user_command(format_command(command, self._setup.firmware, self._identity))
        if isinstance(command, commands.Speed):
            self.speed = command.percent
        elif isinstance(command, commands.Flow):
            self.flow = command.percent
        elif isinstance(command, commands.SetTemperature) and self.parked and command.heater == "nozzle":
            self.parked = replace(self.parked, hotend=command.celsius)
        return answer

    def _on_answer(self, command: commands.Answer) -> str:
        """Press a button of the prompt that the printer shows."""
        if self.prompts.shown is None:
            raise UsageError("the printer has no open prompt", remedy="Run printer-slicer control status")
        self._streamer.send_at_once(b"M876 S%d" % command.choice)
        return "answered"

    def _inject_user_command(self, command: bytes) -> str:
        """Send a command of a user ahead of the job, if it is allowed; return the result for the user."""
        if self._streamer.state not in {State.STREAMING, State.PAUSED}:
            raise UsageError(
                f"cannot send a command: the print is {self._state}", remedy="Wait until the print is running"
            )
        if reason := self._allow(command):
            raise UsageError(
                f"{command.decode(errors='replace')}: {reason}",
                remedy="Start the print with --allow NAME to permit this command",
            )
        check_commands([command])
        self._streamer.inject(command)
        return f"sent {command.decode(errors='replace')}"

    @property
    def _state(self) -> str:
        """Return the phase of the print, or the state of the streamer while the print is running."""
        return self.phase.value if self.phase is not PrintPhase.RUNNING else self._streamer.state.value

    @property
    def _is_printing(self) -> bool:
        """Return whether the job is being sent and no other phase is active."""
        return self.phase is PrintPhase.RUNNING and self._streamer.state is State.STREAMING

    @property
    def _allows_moves(self) -> bool:
        """Return whether the print is paused, and the position is restored when it is resumed."""
        if self.phase is PrintPhase.PAUSED:
            return self.parked is not None and self.parked.park
        is_paused_by_printer = self._streamer.state is State.PAUSED
        return self.phase is PrintPhase.RUNNING and is_paused_by_printer

    # Requests of the printer.

    def _on_action(self, action: stream_events.Action) -> None:
        """Handle a request of the printer to pause, resume, cancel or show a prompt."""
        word, _, rest = action.name.partition(" ")
        if word in {"pause", "filament_runout", "out_of_filament"} and self._is_printing:
            if word != "pause":
                self._listen(stream_events.StreamWarning("filament runout: load new filament, then resume"))
            self._on_pause(commands.Pause())
        elif word == "paused" and self._is_printing:
            # The printer has parked by itself, and returns by itself.
            self._streamer.pause()
            self._listen(stream_events.Paused(rest or "the printer waits for the user"))
        elif word in {"resume", "resumed"} and self.phase is PrintPhase.RUNNING:
            self._streamer.resume()
            if word == "resumed":
                self._listen(stream_events.Resumed())
        elif word == "resume" and self.phase in {PrintPhase.PARKING, PrintPhase.PAUSED}:
            self.return_to_part(self._extruded)
        elif word == "cancel":
            self.cancel()
        elif word.startswith("prompt_") and (prompt := self.prompts.on_action(word, rest)) is not None:
            self._listen(prompt)

    def _on_message(self, message: stream_events.Message) -> None:
        """Extract a reported position or an unknown command from a message."""
        for reply in parse_replies(message.text.encode()):
            if isinstance(reply, Position) and reply.e is not None:
                self._reported_position = reply.x, reply.y, reply.z, reply.e
            elif isinstance(reply, UnknownCommand):
                self._on_unknown(parse(reply.command)[0])

    def _on_unknown(self, word: bytes) -> None:
        """Pause if the firmware does not know a command that should wait for the user."""
        if word in _WAITS_FOR_PERSON and self._is_printing:
            advice = "change the filament, then resume" if word == b"M600" else "resume when ready"
            self._listen(
                stream_events.StreamWarning(f"the firmware does not support {word.decode()}: {advice}")
            )
            self._on_pause(commands.Pause())

    # Temperatures.

    def _on_identified(self, identified: stream_events.Identified) -> None:
        self._identity = identified
        if self.temperatures.on_identified(identified, self._now):
            self._streamer.inject(AUTOREPORT_COMMAND)

    def _query_temperatures(self) -> None:
        """Query temperatures if nothing else is queued."""
        self.temperatures.postpone(self._now)
        if self._streamer.state in {State.STREAMING, State.PAUSED} and not self._streamer.injected_count:
            self._streamer.inject(PROBE_COMMAND)


class PrintPhase(Enum):
    """Phase of a print between running and paused.

    phase       next
    running     parking (pause), stopping (pause now)
    stopping    parking, after the printer has reported its position
    parking     paused, after the nozzle has left the part
    paused      returning (resume)
    returning   running, after the nozzle is back at its position
    """

    RUNNING = "printing"
    STOPPING = "stopping"
    PARKING = "parking"
    PAUSED = "paused"
    RETURNING = "returning"


class Request(Struct):
    """A request to execute a command.

    Attributes:
        command: the command.
        done: called with the result: a text for the user, or the error.
    """

    command: PrintCommand
    done: Callable[[str | UsageError], None] = lambda _: None


AUTOREPORT_COMMAND: Final = b"M155 S2"
"""Command that makes the firmware report temperatures by itself."""

_POLL_INTERVAL: Final = 5.0
"""Interval of temperature queries, if the firmware does not report by itself, s."""


class Prompts:
    """Collects the text and buttons of prompts that the printer shows to the user.

    Attributes:
        shown: the open prompt, None if there is none.
    """

    def __init__(self) -> None:
        self.shown: Prompt | None = None
        self._text = ""
        self._buttons: list[str] = []

    def as_json(self) -> dict[str, Any]:
        """Return the text and buttons of the open prompt, as part of the status."""
        shown = self.shown
        return {"prompt": {"text": shown.text, "buttons": shown.buttons} if shown else None}

    def on_action(self, word: str, rest: str) -> Prompt | None:
        """Process an action command; return the prompt to show, an empty prompt when it is closed, else None."""
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
    """Stores the last temperature readings, and schedules the next temperature query.

    Attributes:
        readings: last reported temperatures.
        next_query_at: time of the next query, s; infinite if the firmware reports by itself.
    """

    def __init__(self) -> None:
        self.readings: tuple[Reading, ...] = ()
        self.next_query_at = inf
        self._reports = False

    def as_json(self) -> dict[str, Any]:
        """Return the last temperature readings, as part of the status."""
        return {"temperatures": {one.name: [one.actual, one.target] for one in self.readings}}

    def on_identified(self, identified: Identified, now: float) -> bool:
        """Process the capabilities of the firmware; return whether to send `AUTOREPORT_COMMAND`."""
        self._reports = identified.has_capability("AUTOREPORT_TEMP")
        self.postpone(now)
        return self._reports

    def on_report(self, temperature: Temperature, now: float) -> None:
        """Store the readings of a temperature report, and postpone the next query."""
        self.readings = temperature.readings
        self.postpone(now)

    def postpone(self, now: float) -> None:
        """Postpone the next temperature query, because temperatures were just reported or queried."""
        self.next_query_at = inf if self._reports else now + _POLL_INTERVAL
