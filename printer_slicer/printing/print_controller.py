"""What happens around the stream of a job: pauses, wishes of people, the printer's own questions, temperatures.

Without I/O, clock or thread, like the streamer that it steers; `session.run` calls `on_turn`, `record` and `hear`.
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
from printer_slicer.stream.send_history import ASK
from printer_slicer.stream.states import State

__all__ = ["REPORT", "PrintController", "PrintPhase", "Prompts", "Request", "TemperaturePoll"]

_OFF_PATH: Final = 0.5  # mm between where the printer says that it stopped and the commanded path.

_WAITS_FOR_PERSON: Final = commands_that(Effect.WAITS_FOR_PERSON)
_GIVE_UP: Final = 20.0  # s that M410 and the question behind it may take.


class PrintController:
    """Steers one streamer.

    Args:
        streamer: made with `obeys=False` and the same entries as `job`.
        job: the entries as they are sent.
        setup: the printer.
        journal: where to note what must survive; None for nowhere.
        listen: is told what happens, the streamer's events and some more.
        allow: a reason why a command that a person typed is refused, empty if it is not.

    Attributes:
        phase: where the print is.
        parked: what it comes back to, while it is not running.
        prompts: the question of the printer.
        heat: temperatures as reported last.
        watchdog: what it knows of the heaters.
        halted: whether the printer was told to halt.
        wished_end: how often somebody wanted the end.
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
        self.halted = self._waits_for_person = self._warned = False
        self.end_requests = 0
        self.ended: stream_events.Finished | stream_events.Halted | None = None
        self.speed = self.flow = 100.0
        self._streamer = streamer
        self._job = job
        self._setup, self._journal = setup, journal
        self._listen = listen
        self._allow = allow
        self._tickets: deque[Request] = deque()
        self._can: stream_events.Identified | None = None
        self._now = self._pushed = 0.0
        self._pause = commands.Pause()
        self._said_place: tuple[float, float, float, float] | None = None
        self._stop_due, self._stop_sent = inf, 0
        self._restore: tuple[ParkedState | None, float, tuple[str, ...], bool] | None = None
        self._scripted: deque[bytes] = deque()
        self._handlers = self._command_handlers()

    def _command_handlers(self) -> dict[type, Callable[[Any], str]]:
        """What grants each kind of wish."""
        return {
            **dict.fromkeys(GCODE_COMMANDS, self._on_order),
            commands.Pause: self._on_pause,
            commands.Resume: self._on_resume,
            commands.Cancel: lambda _: self.cancel(),
            commands.CancelObject: self._on_object,
            commands.Answer: self._on_answer,
            commands.Status: lambda _: json.dumps(self.status()),
            commands.Stop: lambda _: self.halt(),
        }

    def status(self) -> dict[str, Any]:
        """How it stands, as JSON holds it."""
        own = {"state": self._state, "speed_percent": self.speed, "flow_percent": self.flow}
        own |= {"done": self._streamer.acknowledged, "total": len(self._job)}
        return own | self.heat.as_json() | self._job.as_json() | self.prompts.as_json()

    # What the session calls.

    def want(self, request: Request) -> None:
        """A wish, granted at the next turn. May be called by any thread."""
        self._tickets.append(request)

    def on_turn(self, now: float) -> None:
        """Grant what is wished, and go on with what was begun."""
        self._now = now
        if self._restore is not None and self._streamer.state is State.STREAMING:
            self._take_over()
        while self._tickets:
            request = self._tickets.popleft()
            try:
                request.done(self._handlers[type(request.command)](request.command))
            except UsageError as error:
                request.done(error)
        if self.phase is PrintPhase.STOPPING:
            self._stop_moving()
        elif self.phase is PrintPhase.LEAVING and self._streamer.idle:
            self._change(PrintPhase.WAITING)
        elif self.phase is PrintPhase.RETURNING and not self._streamer.injected:
            self._go_on()
        if now >= self.heat.due:
            self._poll()
        if alarm := self.watchdog.check(now):
            self._listen(stream_events.StreamWarning(str(alarm)))

    def record(self, events: Sequence[stream_events.Event]) -> None:
        """Note what must be known before the bytes that go with it are written."""
        journal = self._journal
        for event in events:
            if isinstance(event, stream_events.LineSent):
                self._job.follow(event.job - (not event.command))
                if event.command:
                    self.watchdog.sent(event.command, self._now)
                    self._job.modes.follow(event.command, self._author(event.command))
                if journal:
                    journal.numbered(event.number, event.job, event.command)
            elif isinstance(event, stream_events.Accepted):
                self._job.follow(event.acknowledged)
                if journal:
                    journal.accepted(self._streamer.accepted_line, event.acknowledged, self._now)
        if journal and journal.failed and not self._warned:
            self._warned = True
            self._listen(
                stream_events.StreamWarning(
                    f"no journal ({journal.failed}): it goes on, but could not be resumed"
                )
            )

    def _author(self, command: bytes) -> int:
        """Who wants a command that is not of the job: -1 a person, else a script of ours."""
        if self._scripted and self._scripted[0] == strip(command):
            self._scripted.popleft()
            return SCRIPT
        return -1

    def _perform(self, script: Sequence[bytes]) -> None:
        """Send commands ahead of the job that belong to it from now on."""
        for command in script:
            self._scripted.append(command)
            self._streamer.inject(command)

    def hear(self, event: stream_events.Event) -> None:
        """Act on what the streamer tells, and pass it on."""
        if isinstance(event, stream_events.LineSent):
            return
        if warning := self.watchdog.heard(event, self._now):
            self._listen(stream_events.StreamWarning(str(warning)))
        if isinstance(event, stream_events.Identified):
            self._identified(event)
        elif isinstance(event, stream_events.Temperature):
            self.heat.read(event, self._now)
        elif isinstance(event, stream_events.Message):
            self._on_message(event)
        elif isinstance(event, stream_events.Busy):
            self._waits_for_person = event.reason.startswith("paused for")
        elif isinstance(event, stream_events.Accepted):
            self._waits_for_person = False
        elif isinstance(event, stream_events.Finished | stream_events.Halted):
            self.ended = event
        self._listen(event)
        if isinstance(event, stream_events.Action):
            self._on_action(event)

    # Ends.

    def mute(self) -> None:
        """Tell nobody any more: the listener has failed."""
        self._listen = lambda _: None

    def cancel(self) -> str:
        """Drop the rest of the job, and run the end script."""
        self.end_requests += 1
        if self._streamer.state is State.CANCELLING:
            return "already cancelling"
        if self.phase is PrintPhase.STOPPING or self._waits_for_person:
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
        """Emergency stop."""
        self.end_requests += 1
        self.halted = True
        self._streamer.emergency_stop()
        return "the printer was told to halt"

    # Pausing.

    def _on_pause(self, command: commands.Pause) -> str:
        if not self._prints:
            raise UsageError(f"it cannot pause: it is {self._state}", remedy="wait, or see `status`")
        self._streamer.pause()
        self._pause = command
        if (
            command.now
            and self._setup.firmware.has_quick_stop
            and self._job.follow(self._streamer.taken).comparable
        ):
            self._said_place = None
            self._stop_due, self._stop_sent = self._now + _GIVE_UP, 0
            self._change(PrintPhase.STOPPING)
            return "stopping"
        self._leave(self._parked(self._job.follow(self._streamer.taken).stand))
        return "pausing behind the planned moves"

    def _stop_moving(self) -> None:
        """Throw the planned moves away once nothing is in flight that could be planned behind them."""
        streamer = self._streamer
        if not self._stop_sent and streamer.idle:
            self._streamer.send_at_once(b"M410")
            streamer.inject(b"M400")
            streamer.inject(b"M114")
            self._stop_sent, self._stop_due = 1, self._now + _GIVE_UP
        elif self._stop_sent and self._said_place and streamer.idle:
            self._stopped_at(self._said_place)
        elif self._stop_sent and self._now >= self._stop_due:
            self._listen(stream_events.StreamWarning("the printer does not say where it stopped"))
            self._leave(self._parked(self._job.modes.stand))

    def _stopped_at(self, place: tuple[float, float, float, float]) -> None:
        """Find out what of the planned moves was not made."""
        modes = self._job.follow(self._streamer.taken)
        steps = list(modes.recent)
        index, share, off = nearest(steps, place)
        if off > _OFF_PATH:
            self._listen(stream_events.StreamWarning(f"it stopped {off:.2f} mm off its path"))
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
        self._note_phase(PrintPhase.LEAVING)
        self._pushed = extruded_length(script)
        self._perform(script)
        self._change(PrintPhase.LEAVING)

    def _on_resume(self, _: commands.Resume) -> str:
        if self._waits_for_person and self.phase is PrintPhase.RUNNING:
            self._streamer.send_at_once(b"M108")
            return "told the printer to go on"
        if self.phase is PrintPhase.RUNNING and self._streamer.state is State.PAUSED:  # it paused by itself
            self._streamer.inject(self._setup.firmware.resume_command)
            self._streamer.resume()
            return "told the printer to go on"
        if self.phase in {PrintPhase.RUNNING, PrintPhase.RETURNING, PrintPhase.STOPPING}:
            raise UsageError(f"it cannot resume: it is {self._state}", remedy="see `status`")
        self.return_to_part(self._pushed)
        return "resuming"

    def return_to_part(self, pushed: float) -> None:
        """Return to the place that was left, and go on.

        Args:
            pushed: mm of filament since then; negative for what is pulled back.
        """
        parked = self.parked
        assert parked is not None
        self._pushed = pushed
        self._note_phase(PrintPhase.RETURNING)
        back = return_to_part(parked, self._setup, pushed, inches=self._job.modes.machine.inches)
        self._perform(back + [text.encode("latin-1") for text in parked.replay])
        self._change(PrintPhase.RETURNING)

    def restore(
        self, parked: ParkedState | None, pushed: float, replay: Sequence[str], *, waits: bool
    ) -> None:
        """Take over a print that another host left while it was paused, or on its way, once it is connected.

        Args:
            parked: what it comes back to; None: it is there.
            pushed: mm of filament since it was left.
            replay: thrown-away moves that are still to be made.
            waits: whether it goes on waiting for a person.
        """
        self._restore = (parked, pushed, tuple(replay), waits)

    def _take_over(self) -> None:
        assert self._restore is not None
        parked, self._pushed, replay, waits = self._restore
        self._restore = None
        self.parked = parked and replace(parked, replay=replay)
        self._streamer.pause()
        if parked and waits:
            self._note_phase(PrintPhase.LEAVING)
            self._change(PrintPhase.WAITING)
        elif parked:
            self.return_to_part(self._pushed)
        else:
            self._perform([text.encode("latin-1") for text in replay])
            self._change(PrintPhase.RETURNING)

    def _go_on(self) -> None:
        self.parked = None
        self._note_phase(PrintPhase.RUNNING)
        self._streamer.resume()
        self._change(PrintPhase.RUNNING)

    def _change(self, phase: PrintPhase) -> None:
        self.phase = phase
        if phase is PrintPhase.WAITING:
            self._listen(stream_events.Paused("resume, or cancel"))
        elif phase is PrintPhase.RUNNING:
            self._listen(stream_events.Resumed())

    def _note_phase(self, phase: PrintPhase) -> None:
        if self._journal:
            parked = self.parked.as_json() if self.parked else None
            state = {"phase": phase.value, "pushed": self._pushed, "line": self._streamer.next_line}
            self._journal.state({**state, "parked": parked, "recovering_at": None})

    # Other wishes.

    def _on_object(self, command: commands.CancelObject) -> str:
        job = self._job
        name = job.cancel(command.name, self._streamer.taken)
        cancel = self._setup.firmware.cancel_object_command
        if cancel is not None and job.marked_for_klipper:
            job.cancelled.discard(name)
            self._inject(cancel(name))
        elif self._journal:
            self._journal.state({"cancelled": sorted(job.cancelled), "cancelled_at": job.cancelled_at})
        self._listen(stream_events.StreamWarning(f"{name} is not printed any further"))
        return f"{name} is given up"

    def _on_order(self, command: Any) -> str:
        answer = self._inject(gcode_for(command, self._setup.firmware, self._can))
        if isinstance(command, commands.Speed):
            self.speed = command.percent
        elif isinstance(command, commands.Flow):
            self.flow = command.percent
        elif isinstance(command, commands.SetTemperature) and self.parked and command.heater == "nozzle":
            self.parked = replace(self.parked, hotend=command.celsius)
        return answer

    def _on_answer(self, command: commands.Answer) -> str:
        if self.prompts.shown is None:
            raise UsageError("the printer asks nothing", remedy="see `status`")
        self._streamer.send_at_once(b"M876 S%d" % command.choice)
        return "answered"

    def _inject(self, command: bytes) -> str:
        if self._streamer.state not in {State.STREAMING, State.PAUSED}:
            raise UsageError(f"not now: it is {self._state}", remedy="wait until it prints")
        if reason := self._allow(command):
            raise UsageError(
                f"{command.decode(errors='replace')}: {reason}", remedy="allow it by name, or leave it"
            )
        check_commands([command])
        self._streamer.inject(command)
        return f"sent {command.decode(errors='replace')}"

    @property
    def _state(self) -> str:
        return self.phase.value if self.phase is not PrintPhase.RUNNING else self._streamer.state.value

    @property
    def _prints(self) -> bool:
        """Lines of the job go out, and nobody has asked for anything else."""
        return self.phase is PrintPhase.RUNNING and self._streamer.state is State.STREAMING

    # The printer's wishes.

    def _on_action(self, action: stream_events.Action) -> None:
        word, _, rest = action.name.partition(" ")
        if word in {"pause", "filament_runout", "out_of_filament"} and self._prints:
            if word != "pause":
                self._listen(
                    stream_events.StreamWarning("the filament has run out: put in a new one, then resume")
                )
            self._on_pause(commands.Pause())
        elif word == "paused" and self._prints:
            # It has parked by itself, and comes back by itself.
            self._streamer.pause()
            self._listen(stream_events.Paused(rest or "the printer waits for a person"))
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
                self._said_place = reply.x, reply.y, reply.z, reply.e
            elif isinstance(reply, Unknown):
                self._on_unknown(parse(reply.command)[0])

    def _on_unknown(self, word: bytes) -> None:
        """The firmware does not know a command: one that waits for a person is the host's to do."""
        if word in _WAITS_FOR_PERSON and self._prints:
            what = "change the filament, then resume" if word == b"M600" else "resume when ready"
            self._listen(stream_events.StreamWarning(f"{word.decode()} is not known here: {what}"))
            self._on_pause(commands.Pause())

    # Temperatures.

    def _identified(self, who: stream_events.Identified) -> None:
        self._can = who
        if self.heat.identified(who, self._now):
            self._streamer.inject(REPORT)

    def _poll(self) -> None:
        """Ask for temperatures, where that delays nothing and the last question was answered."""
        self.heat.wait(self._now)
        if self._streamer.state in {State.STREAMING, State.PAUSED} and not self._streamer.injected:
            self._streamer.inject(ASK)


class PrintPhase(Enum):
    """Where a print is between running and waiting.

    phase       leads to
    running     leaving (pause), stopping (pause now)
    stopping    leaving, when the printer has said where it stopped
    leaving     waiting, when it is off the part
    waiting     returning (resume)
    returning   running, when it is back at its place
    """

    RUNNING = "printing"
    STOPPING = "stopping"
    LEAVING = "parking"
    WAITING = "paused"
    RETURNING = "returning"


@dataclass(slots=True)
class Request:
    """A wish on its way.

    Attributes:
        wish: what is wanted.
        done: called with what became of it: words for a person, or the error.
    """

    command: PrintCommand
    done: Callable[[str | UsageError], None] = lambda _: None


REPORT: Final = b"M155 S2"
"""Tells a firmware that can to report temperatures by itself."""

_POLL: Final = 5.0
"""s between two questions for temperatures, where the firmware does not report them by itself."""


class Prompts:
    """Attributes: `shown` is the question that waits for an answer, None without one."""

    def __init__(self) -> None:
        self.shown: Prompt | None = None
        self._text = ""
        self._buttons: list[str] = []

    def as_json(self) -> dict[str, Any]:
        """For the status."""
        shown = self.shown
        return {"prompt": {"text": shown.text, "buttons": shown.buttons} if shown else None}

    def hear(self, word: str, rest: str) -> Prompt | None:
        """One action of the printer; what a person shall see now, an empty prompt when the question is over."""
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
    """When to ask for temperatures.

    Attributes:
        readings: as reported last.
        due: when to ask, s; infinite where that is not needed.
    """

    def __init__(self) -> None:
        self.readings: tuple[Reading, ...] = ()
        self.due = inf
        self._reports = False

    def as_json(self) -> dict[str, Any]:
        """For the status."""
        return {"temperatures": {one.name: [one.actual, one.target] for one in self.readings}}

    def identified(self, who: Identified, now: float) -> bool:
        """Who the printer is; whether to tell it to report by itself."""
        self._reports = who.can("AUTOREPORT_TEMP")
        self.wait(now)
        return self._reports

    def read(self, temperature: Temperature, now: float) -> None:
        """A report came."""
        self.readings = temperature.readings
        self.wait(now)

    def wait(self, now: float) -> None:
        """Ask later."""
        self.due = inf if self._reports else now + _POLL
