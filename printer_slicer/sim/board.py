"""The state of the simulated printer between two commands, and what every command needs of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf, pi
from typing import TYPE_CHECKING, Final, Literal

from printer_slicer.motion.positioning_mode import PositioningMode
from printer_slicer.sim.card import SdCard
from printer_slicer.sim.heaters import Heaters
from printer_slicer.sim.machine import AXES, Machine, Position
from printer_slicer.sim.mover import Mover

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.switches import FrontEnd
    from printer_slicer.sim.tally import Tally

__all__ = ["MOST_UNSENT", "Board", "Steps"]

Steps = Iterator[float]
"""A command that takes time: yields the moment (s) at which it wants to go on, ends when it is done."""


_COUNTING: Final[dict[str, Literal["either", "apart"]]] = {
    "marlin_legacy": "either",
    "klipper": "either",
    "repetier": "either",
    "prusa": "apart",
    "reprapfirmware": "apart",
}
"""How other flavours than Marlin 2's and Smoothie's read G90 and M82."""

MOST_UNSENT: Final = 4096
"""Lines kept for a host that does not read; reports that come by themselves are left out beyond them."""


class Board:
    """Position, modes, heaters and voice of the printer.

    Attributes:
        now: s, the moment that is being simulated.
        out: what was said and not sent yet.
        ok_tail: what the ok of the command being executed ends with.
        last_line: number of the last line that was read.
        renumber: line number that M110 asks for.
        inject: puts a command of the firmware's own behind the one being executed.
        muted: so many of the next commands get no ok.
        due: when the next alarm rings, s; see `alarm`.
        position: where the plan ends: x, y, z from the endstops, and e as the program counts it; mm.
        offset: logical minus machine coordinates of x, y, z from G92 and M206, mm.
        home_offset: the part of it set by M206, which homing keeps.
        filament: mm fed since power-on, as planned.
        unit: mm per unit of the program.
        volumetric: E counts cubes of the program's unit, of a filament of `diameter` mm.
        flow_ratio: of M221.
        e_ratio: mm of filament for a unit of E that is a length; see `reckon_e`.
        feed: mm/s asked for last.
        retraction: of G10 and G11: mm back, mm/s back, mm/s forward, mm more forward.
        retracted: whether G10 was the last of them.
        homed: x, y, z.
        loose: axes whose motors were off since they were homed.
        guarded: all axes are homed and the soft endstops are on.
        heaters: all of them.
        hot: the hotend is known to stay hot enough until something changes.
        spool_end: mm of filament fed at which the spool is empty.
        clogged: share of the filament fed that does not come out of the nozzle.
        stuck_endstops: axes whose endstop never closes.
        card: the card in the reader; it is empty, and nobody asks for it, where there is no reader.
        waiting: cleared by M108 to end a wait.
        busy_with: what the printer says it is busy with.
        stops: how often M410 threw the planned moves away.
        killed: why the firmware halted.
        shut_down: why Klipper takes no more moves.
        reset: restarts the firmware.
    """

    def __init__(self, machine: Machine, front_end: FrontEnd, tally: Tally, card: SdCard, now: float) -> None:
        self.machine, self.front_end, self.tally = machine, front_end, tally
        self.now = now
        self.out: list[str] = []
        self.last_line = 0
        self.renumber: int | None = None
        self.inject: Callable[[str], None] = lambda _: None
        self.reset: Callable[[], None] = lambda: None
        self.killed = self.shut_down = self.ok_tail = ""
        self.due = inf
        self._alarms: dict[str, tuple[float, Callable[[], None]]] = {}
        self.limits: MotionLimits = machine.limits
        self.steps: Axes = machine.steps
        self.mover = Mover(machine.limits, machine.first_move_delay, tally, front_end.ahead_seconds)
        self.heaters = Heaters(machine, now)
        self._clogged_from = 0.0
        self.clogged = 0.0
        self.spool_end = machine.filament_left
        self.stuck_endstops: set[int] = set()
        self.card = card
        self.coldest_extrusion = machine.coldest_extrusion
        self.cold_allowed = self.hot = False
        self.position: Axes = (0.0, 0.0, 0.0, 0.0)
        self.offset: Position = (0.0, 0.0, 0.0)
        self.home_offset: Position = (0.0, 0.0, 0.0)
        self.filament = 0.0
        self.counting = PositioningMode(_COUNTING.get(front_end.flavour, "together"))
        self.relative = self.relative_e = self.retracted = False
        self.unit = 1.0
        self.feed, self.diameter = 25.0, machine.filament_diameter
        self.retraction = (0.0, 25.0, 25.0, 0.0)
        self.speed_ratio = self.flow_ratio = self.e_ratio = 1.0
        self.homed = [False, False, False]
        self.loose: set[int] = set()
        self.soft_endstops = True
        self.guarded = self.warned_unhomed = self.waiting = self.volumetric = False
        self.stops = self.muted = 0
        self.busy_seconds = front_end.busy_seconds
        self.busy_with = "processing"
        self.timer_seconds = 0.0
        self.timer_began: float | None = None

    def say(self, line: str) -> None:
        """Say one line."""
        self.out.append(line + "\n")

    def report(self, line: str) -> None:
        """Say a line that nobody asked for just now; it is left out while nobody listens."""
        if len(self.out) < MOST_UNSENT:
            self.say(line)

    def alarm(self, name: str, when: float, act: Callable[[], None]) -> None:
        """Have `act` called at `when`, s, instead of what was called so before; infinity: not at all."""
        self._alarms[name] = (when, act)
        self.due = max(min(moment for moment, _ in self._alarms.values()), self.now)

    def ring(self) -> None:
        """Do what is due now."""
        for name, (when, act) in list(self._alarms.items()):
            if when <= self.now and not self.killed:
                self._alarms[name] = (inf, act)
                act()
        self.due = min(moment for moment, _ in self._alarms.values())

    def repeat(self, name: str, seconds: float, say: Callable[[], str]) -> None:
        """Report something every so many s; 0: never."""

        def act() -> None:
            """Say it, and come back."""
            self.report(say())
            self.alarm(name, self.now + seconds, act)

        self.alarm(name, self.now + seconds if seconds > 0.0 else inf, act)

    def violated(self, what: str) -> None:
        """Note that the command being executed did `what`."""
        self.tally.violated(what)

    def unknown(self, text: str) -> None:
        """Answer a command the firmware does not know."""
        if self.front_end.unknown:
            self.say(self.front_end.unknown.format(text=text))
        self.violated("unknown command")

    def act(self, action: str) -> None:
        """Tell the host what was done or is wanted, where the firmware does so."""
        if self.front_end.host_actions:
            self.say(f"//action:{action}")

    def notify(self, text: str) -> None:
        """Show something on the display, and to the host where the firmware does so."""
        if self.front_end.prompts:
            self.say(f"//action:notification {text}")

    @property
    def hotend(self) -> Heater:
        """Of the extruder in use."""
        return self.heaters.hotend

    @property
    def bed(self) -> Heater:
        """Warms the bed."""
        return self.heaters.bed

    @property
    def busy_report(self) -> str:
        """What is said while a command takes its time."""
        return f"echo:busy: {self.busy_with}"

    def settle(self) -> None:
        """Let the plastic that was fed since the last time take its heat along, evenly."""
        if not self.heaters.steady:
            self.heaters.settle(self.mover.position(self.now)[3], self.now)

    def aim(self, heater: Heater, target: float) -> None:
        """Give a heater another target, °C."""
        self.settle()
        heater.set_target(target, self.now)
        self.heaters.aimed(heater, self.now)
        self._heat_changed()

    def upset(self, name: str) -> None:
        """Something is wrong with the heater of this name, or right again."""
        self.heaters.upset(name, self.now)
        self._heat_changed()

    def _heat_changed(self) -> None:
        self.hot = False
        self.alarm("heaters", self.heaters.due, self._look)

    def _look(self) -> None:
        """Halt when a heater is out of control."""
        if self.shut_down:
            return
        self.settle()
        wrong = self.heaters.wrong(self.now)
        if wrong is None:
            self.alarm("heaters", self.heaters.due, self._look)
            return
        name, what = wrong
        for line in self.front_end.overheated:
            self.say(line.format(what=what, heater=name))
        self.kill(f"Err: {what.removesuffix(' triggered')}" if "TEMP" in what else what)

    def temperatures(self) -> str:
        """`T:.. /.. B:.. /.. @:.. B@:..`, as every report has it."""
        self.settle()
        told = self.heaters.told(self.front_end.language, self.now)
        self.alarm("heaters", self.heaters.due, self._look)
        return told

    def place(self) -> str:
        """Where the plan ends, as the program sees it, and where the motors are, in steps."""
        x, y, z, e = self.position
        logical = (x + self.offset[0], y + self.offset[1], z + self.offset[2], e)
        if self.front_end.language == "virtual":
            a, b, c = (round(at * per_mm) for at, per_mm in zip((x, y, z), self.steps[:3], strict=True))
            words = " ".join(
                f"{letter}:{round(value, 4)}" for letter, value in zip(AXES, logical, strict=True)
            )
            return f"{words} Count: A:{a} B:{b} C:{c}"
        decimals = self.front_end.decimals
        words = " ".join(
            f"{letter}:{value:.{decimals}f}" for letter, value in zip(AXES, logical, strict=True)
        )
        if self.front_end.language == "klipper":
            return words
        steps = [
            round(at * per_mm)
            for at, per_mm in zip(self.mover.position(self.now)[:3], self.steps[:3], strict=True)
        ]
        return f"{words} Count X:{steps[0]} Y:{steps[1]} Z:{steps[2]}"

    def guard(self) -> None:
        """Find out anew whether moves are kept inside the machine."""
        self.guarded = self.soft_endstops and all(self.homed)

    def reckon_e(self) -> None:
        """Find out anew how much filament an E feeds."""
        area = pi * self.diameter**2 / 4.0
        self.e_ratio = self.flow_ratio * (self.unit**2 / area if self.volumetric else 1.0)

    def set_limits(self, limits: MotionLimits) -> None:
        """Move by other limits from the next command on."""
        self.limits = limits
        self.mover.set_limits(limits)

    def warm_enough(self) -> bool:
        """Whether the extruder may turn."""
        if self.cold_allowed:
            self.hot = True
            return True
        self.settle()
        warm = self.hotend.reading(self.now) >= self.coldest_extrusion
        # A heater goes straight to its target, so it will not cross the limit on the way, unless something is wrong.
        self.hot = warm and self.hotend.target >= self.coldest_extrusion and not self.hotend.disturbed
        return warm

    def stop_timer(self) -> None:
        """Let the print timer stand."""
        if self.timer_began is not None:
            self.timer_seconds += self.now - self.timer_began
            self.timer_began = None

    def planned_pause(self, seconds: float) -> Steps:
        """Let the planner stand still for so long, in its turn."""
        mover, stops = self.mover, self.stops
        mover.advance(self.now)
        while mover.room <= 0:
            yield mover.ends
            if self.stops != stops:
                return
        x, y, z, _ = self.position
        mover.hold(seconds, (x, y, z, self.filament), self.now)

    def drained(self) -> Steps:
        """Wait until everything planned was executed."""
        self.mover.advance(self.now)
        self.mover.expects_stop = True
        while self.mover.busy:
            yield self.mover.ends

    def until(self, moment: float) -> Steps:
        """Wait for a moment, s, however often somebody looks in between."""
        while self.now < moment:
            yield moment

    def stop_moving(self) -> None:
        """Stop at once; the moves planned are lost, the position is where the motors are."""
        self.settle()
        (x, y, z, _), unfed = self.mover.stop(self.now)
        self.stops += 1
        self.position = (x, y, z, self.position[3] - unfed)
        self.filament -= unfed
        self.tally.filament_fed -= unfed

    def kill(self, reason: str) -> None:
        """Halt for good: heaters off, nothing moves, nothing is answered. Klipper goes on answering."""
        for line in self.front_end.killed:
            self.say(line.format(reason=reason))
        self.act("poweroff")
        for heater in self.heaters.all():
            self.aim(heater, 0.0)
        self.stop_moving()
        self.waiting = False
        self.card.stop()
        self.tally.killed = reason
        if self.front_end.language == "klipper":
            self.shut_down = reason
        else:
            self.killed = reason

    def homing_failed(self, axis: str) -> None:
        """An endstop never closed: halt, or switch the motors off and go on, as the firmware does."""
        self.violated("an endstop never closed")
        if not self.front_end.homing_failed:
            self.kill("Homing Failed")
            return
        self.say(self.front_end.homing_failed.format(axis=axis))
        self.homed = [False, False, False]
        self.guard()

    def take_over(self, old: Board) -> None:
        """Be the same machine as the board before the reset: its warmth, its spool, its faults."""
        for heater, before in zip(self.heaters.all(), old.heaters.all(), strict=True):
            heater.cool_from(before, old.now)
        self.spool_end = old.spool_end - old.filament
        self.clogged, self._clogged_from = old.clogged, old._clogged_from
        self.stuck_endstops = old.stuck_endstops
        for name in self.heaters.guards:
            self.upset(name)

    def clog(self, share: float) -> None:
        """From now on so much of the filament that is fed does not come out of the nozzle."""
        fed = self.tally.filament_fed
        self.tally.filament_missing += (fed - self._clogged_from) * self.clogged
        self._clogged_from, self.clogged = fed, share
        if self.tally.track is not None:
            self.tally.track.keep_back(share)

    def spool_ended(self) -> None:
        """The filament has run out: a sensor has it changed, without one the nozzle lays nothing from now on."""
        self.spool_end = inf
        self.tally.runouts += 1
        if self.machine.runout_sensor:
            self.act(f"paused filament_runout {self.heaters.tool}")
            self.inject("M600")
        else:
            self.violated("out of filament")
            self.clog(1.0)

    def loaded(self) -> None:
        """There is a new spool."""
        self.spool_end = self.filament + self.machine.filament_left
        if self.clogged == 1.0:
            self.clog(0.0)
