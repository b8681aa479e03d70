"""The state of the simulated printer between two commands, and what every command needs of it."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import TYPE_CHECKING

from printer_slicer.sim.heater import Heater
from printer_slicer.sim.machine import AXES, Machine, Position
from printer_slicer.sim.mover import Mover

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes, Limits
    from printer_slicer.sim.front_end import FrontEnd
    from printer_slicer.sim.tally import Tally

__all__ = ["Board", "Steps"]

Steps = Iterator[float]
"""A command that takes time: yields the moment (s) at which it wants to go on, ends when it is done."""


class Board:
    """Position, modes, heaters and voice of the printer.

    Attributes:
        now: s, the moment that is being simulated.
        out: what was said and not sent yet.
        ok_tail: what the ok of the command being executed ends with.
        last_line: number of the last line that was read.
        renumber: line number that M110 asks for.
        position: where the plan ends: x, y, z from the endstops, and e as the program counts it; mm.
        offset: what G92 adds to x, y, z as the program sees them, mm.
        filament: mm fed since power-on, as planned.
        unit: mm per unit of the program.
        feed: mm/s asked for last.
        retraction: of G10 and G11: mm back, mm/s back, mm/s forward, mm more forward.
        retracted: whether G10 was the last of them.
        homed: x, y, z.
        guarded: all axes are homed and the soft endstops are on.
        hot: the hotend is known to stay hot enough until something changes.
        waiting: cleared by M108 to end a wait.
        busy_with: what the printer says it is busy with.
        stops: how often M410 threw the planned moves away.
        killed: why the firmware halted.
    """

    def __init__(self, machine: Machine, front_end: FrontEnd, tally: Tally, now: float) -> None:
        self.machine = machine
        self.front_end = front_end
        self.tally = tally
        self.now = now
        self.out: list[str] = []
        self.ok_tail = ""
        self.last_line = 0
        self.renumber: int | None = None
        self.killed = ""
        self.limits: Limits = machine.limits
        self.steps: Axes = machine.steps
        self.mover = Mover(machine.limits, machine.first_move_delay, tally)
        self.hotend = Heater(machine.hotend, machine.ambient)
        self.bed = Heater(machine.bed, machine.ambient)
        self.coldest_extrusion = machine.coldest_extrusion
        self.cold_allowed = False
        self.hot = False
        self.position: Axes = (0.0, 0.0, 0.0, 0.0)
        self.offset: Position = (0.0, 0.0, 0.0)
        self.filament = 0.0
        self.relative = False
        self.relative_e = False
        self.unit = 1.0
        self.feed = 25.0
        self.retraction = (0.0, 25.0, 25.0, 0.0)
        self.retracted = False
        self.speed_ratio = 1.0
        self.flow_ratio = 1.0
        self.homed = [False, False, False]
        self.soft_endstops = True
        self.guarded = False
        self.warned_unhomed = False
        self.waiting = False
        self.stops = 0
        self.busy_seconds = front_end.busy_seconds
        self.busy_with = "processing"
        self.report_seconds = 0.0
        self.next_report = inf
        self.timer_seconds = 0.0
        self.timer_began: float | None = None

    def say(self, line: str) -> None:
        """Say one line."""
        self.out.append(line + "\n")

    def violated(self, what: str) -> None:
        """Note that the command being executed did `what`."""
        self.tally.violated(what)

    def unknown(self, text: str) -> None:
        """Answer a command the firmware does not know."""
        self.say(self.front_end.unknown.format(text=text))
        self.violated("unknown command")

    def temperatures(self) -> str:
        """`T:.. /.. B:.. /.. @:.. B@:..`, as every report has it."""
        now = self.now
        hotend, bed = self.hotend, self.bed
        if self.front_end.klipper_words:
            return (
                f"B:{bed.temperature(now):.1f} /{bed.target:.1f}"
                f" T0:{hotend.temperature(now):.1f} /{hotend.target:.1f}"
            )
        return (
            f"T:{hotend.temperature(now):.2f} /{hotend.target:.2f}"
            f" B:{bed.temperature(now):.2f} /{bed.target:.2f}"
            f" @:{round(hotend.power_ratio(now) * 127)} B@:{round(bed.power_ratio(now) * 127)}"
        )

    def place(self) -> str:
        """Where the plan ends, as the program sees it, and where the motors are, in steps."""
        x, y, z, e = self.position
        logical = (x + self.offset[0], y + self.offset[1], z + self.offset[2], e)
        decimals = self.front_end.decimals
        words = " ".join(
            f"{letter}:{value:.{decimals}f}" for letter, value in zip(AXES, logical, strict=True)
        )
        if self.front_end.klipper_words:
            return words
        steps = [
            round(at * per_mm)
            for at, per_mm in zip(self.mover.position(self.now)[:3], self.steps[:3], strict=True)
        ]
        return f"{words} Count X:{steps[0]} Y:{steps[1]} Z:{steps[2]}"

    def guard(self) -> None:
        """Find out anew whether moves are kept inside the machine."""
        self.guarded = self.soft_endstops and all(self.homed)

    def set_limits(self, limits: Limits) -> None:
        """Move by other limits from the next command on."""
        self.limits = limits
        self.mover.set_limits(limits)

    def warm_enough(self) -> bool:
        """Whether the extruder may turn."""
        if self.cold_allowed:
            self.hot = True
            return True
        warm = self.hotend.temperature(self.now) >= self.coldest_extrusion
        # A heater goes straight to its target, so it will not cross the limit on the way.
        self.hot = warm and self.hotend.target >= self.coldest_extrusion
        return warm

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
        (x, y, z, _), unfed = self.mover.stop(self.now)
        self.stops += 1
        self.position = (x, y, z, self.position[3] - unfed)
        self.filament -= unfed
        self.tally.filament_fed -= unfed

    def kill(self, reason: str) -> None:
        """Halt for good: heaters off, nothing moves, nothing is answered."""
        for line in self.front_end.killed:
            self.say(line.format(reason=reason))
        if self.front_end.host_actions:
            self.say("//action:poweroff")
        self.hotend.set_target(0.0, self.now)
        self.bed.set_target(0.0, self.now)
        self.stop_moving()
        self.killed = self.tally.killed = reason
