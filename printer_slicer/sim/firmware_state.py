"""The state of the simulated firmware between commands, with operations that commands share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf, pi
from typing import TYPE_CHECKING, Final, Literal

from printer_slicer.motion.positioning_mode import PositioningMode
from printer_slicer.sim.heaters import Heaters
from printer_slicer.sim.machine import AXES, Machine, Position
from printer_slicer.sim.motion_queue import MotionQueue
from printer_slicer.sim.sd_card import SdCard

if TYPE_CHECKING:
    from printer_slicer.motion.rules import Axes, MotionLimits
    from printer_slicer.sim.heater import Heater
    from printer_slicer.sim.simulated_firmware import SimulatedFirmware
    from printer_slicer.sim.statistics import Statistics

__all__ = ["MOST_UNSENT", "FirmwareState", "Steps"]

Steps = Iterator[float]
"""A command that takes time: yields the time (s) at which to continue it, and returns when it is done."""


_COUNTING: Final[dict[str, Literal["either", "apart"]]] = {
    "marlin_legacy": "either",
    "klipper": "either",
    "repetier": "either",
    "prusa": "apart",
    "reprapfirmware": "apart",
}
"""How the dialects other than those of Marlin 2 and Smoothieware interpret G90 and M82."""

MOST_UNSENT: Final = 4096
"""Output lines kept for a host that does not read. Automatic reports are dropped beyond that."""


class FirmwareState:
    """Position, modes, heaters and pending output of the simulated printer.

    Attributes:
        now: simulated time, s.
        out: output lines that were not sent yet.
        ok_tail: text to append to the ok of the current command.
        last_line: number of the last line that was read.
        renumber: line number set by M110.
        inject: queues a command of the firmware behind the current one.
        muted: number of next commands that get no ok.
        due: time of the next alarm, s; see `set_alarm`.
        position: end of the planned motion: x, y, z from the endstops, e as the program counts it; mm.
        offset: logical minus machine coordinates of x, y, z from G92 and M206, mm.
        home_offset: the part of it set by M206, which homing keeps.
        filament: mm fed since power-on, as planned.
        unit: mm per unit of the program.
        volumetric: E counts volume, of a filament of `diameter` mm.
        flow_ratio: of M221.
        e_ratio: mm of filament per unit of E; see `update_e_ratio`.
        feed: last feed rate, mm/s.
        retraction: of G10 and G11: length (mm), speed (mm/s), recover speed (mm/s), extra recover length (mm).
        retracted: whether the last of G10 and G11 was G10.
        homed: whether x, y, z are homed.
        unhomed_motors: axes whose motors were switched off since homing.
        clips_moves: whether moves are clipped: all axes are homed and the software endstops are on.
        heaters: of the machine.
        hot: whether the hotend stays hot enough until something changes.
        spool_end: mm of filament fed at which the spool is empty.
        clogged: share of the filament fed that does not come out of the nozzle.
        stuck_endstops: axes whose endstop never closes.
        card: the SD card; unused without a reader.
        waiting: whether a command waits; M108 clears it.
        busy_with: activity named in busy reports.
        stops: number of quick stops (M410).
        killed: why the firmware halted; empty while it runs.
        shut_down: why Klipper is shut down; empty while it runs.
        reset: restarts the firmware.
    """

    def __init__(
        self, machine: Machine, firmware: SimulatedFirmware, statistics: Statistics, card: SdCard, now: float
    ) -> None:
        self.machine, self.firmware, self.statistics = machine, firmware, statistics
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
        self.motion_queue = MotionQueue(
            machine.limits, machine.first_move_delay, statistics, firmware.ahead_seconds
        )
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
        self.counting = PositioningMode(_COUNTING.get(firmware.dialect, "together"))
        self.relative = self.relative_e = self.retracted = False
        self.unit = 1.0
        self.feed, self.diameter = 25.0, machine.filament_diameter
        self.retraction = (0.0, 25.0, 25.0, 0.0)
        self.speed_ratio = self.flow_ratio = self.e_ratio = 1.0
        self.homed = [False, False, False]
        self.unhomed_motors: set[int] = set()
        self.soft_endstops = True
        self.clips_moves = self.warned_unhomed = self.waiting = self.volumetric = False
        self.stops = self.muted = 0
        self.busy_seconds = firmware.busy_seconds
        self.busy_with = "processing"
        self.timer_seconds = 0.0
        self.timer_began: float | None = None

    def say(self, line: str) -> None:
        """Send one line to the host."""
        self.out.append(line + "\n")

    def report(self, line: str) -> None:
        """Send an automatic report; drop it if the host does not read."""
        if len(self.out) < MOST_UNSENT:
            self.say(line)

    def set_alarm(self, name: str, when: float, act: Callable[[], None]) -> None:
        """Call `act` at the time `when`, s, replacing the earlier alarm of this name; infinity cancels it."""
        self._alarms[name] = (when, act)
        self.due = max(min(moment for moment, _ in self._alarms.values()), self.now)

    def run_due_alarms(self) -> None:
        """Run the alarms that are due."""
        for name, (when, act) in list(self._alarms.items()):
            if when <= self.now and not self.killed:
                self._alarms[name] = (inf, act)
                act()
        self.due = min(moment for moment, _ in self._alarms.values())

    def report_every(self, name: str, seconds: float, say: Callable[[], str]) -> None:
        """Send a report at an interval, s; 0 stops it."""

        def act() -> None:
            """Send the report and set the next alarm."""
            self.report(say())
            self.set_alarm(name, self.now + seconds, act)

        self.set_alarm(name, self.now + seconds if seconds > 0.0 else inf, act)

    def record_violation(self, what: str) -> None:
        """Record that the current command did something a real printer would reject or suffer from."""
        self.statistics.record_violation(what)

    def unknown(self, text: str) -> None:
        """Reply to an unknown command."""
        if self.firmware.unknown:
            self.say(self.firmware.unknown.format(text=text))
        self.record_violation("unknown command")

    def act(self, action: str) -> None:
        """Send an action command to the host, if the firmware supports them."""
        if self.firmware.host_actions:
            self.say(f"//action:{action}")

    def notify(self, text: str) -> None:
        """Show a message on the display, and send it to the host if the firmware does so."""
        if self.firmware.prompts:
            self.say(f"//action:notification {text}")

    @property
    def hotend(self) -> Heater:
        """The hotend of the active extruder."""
        return self.heaters.hotend

    @property
    def bed(self) -> Heater:
        """The heater of the bed."""
        return self.heaters.bed

    @property
    def busy_report(self) -> str:
        """The report sent while a command takes time."""
        return f"echo:busy: {self.busy_with}"

    def apply_flow_cooling(self) -> None:
        """Account for the heat taken by the filament since the last call."""
        if not self.heaters.steady:
            self.heaters.apply_flow_cooling(self.motion_queue.position(self.now)[3], self.now)

    def set_target_of(self, heater: Heater, target: float) -> None:
        """Set the target of a heater, °C."""
        self.apply_flow_cooling()
        heater.set_target(target, self.now)
        self.heaters.target_set(heater, self.now)
        self._heat_changed()

    def disturb(self, name: str) -> None:
        """Note that a heater was broken or repaired."""
        self.heaters.disturb(name, self.now)
        self._heat_changed()

    def _heat_changed(self) -> None:
        self.hot = False
        self.set_alarm("heaters", self.heaters.due, self._look)

    def _look(self) -> None:
        """Halt if a heater is out of control."""
        if self.shut_down:
            return
        self.apply_flow_cooling()
        wrong = self.heaters.wrong(self.now)
        if wrong is None:
            self.set_alarm("heaters", self.heaters.due, self._look)
            return
        name, what = wrong
        for line in self.firmware.overheated:
            self.say(line.format(what=what, heater=name))
        self.kill(f"Err: {what.removesuffix(' triggered')}" if "TEMP" in what else what)

    def temperatures(self) -> str:
        """Return `T:.. /.. B:.. /.. @:.. B@:..`, as in every temperature report."""
        self.apply_flow_cooling()
        told = self.heaters.told(self.firmware.language, self.now)
        self.set_alarm("heaters", self.heaters.due, self._look)
        return told

    def position_report(self) -> str:
        """Return the planned position in program coordinates, and the motor position in steps, as M114 does."""
        x, y, z, e = self.position
        logical = (x + self.offset[0], y + self.offset[1], z + self.offset[2], e)
        if self.firmware.language == "virtual":
            a, b, c = (round(at * per_mm) for at, per_mm in zip((x, y, z), self.steps[:3], strict=True))
            words = " ".join(
                f"{letter}:{round(value, 4)}" for letter, value in zip(AXES, logical, strict=True)
            )
            return f"{words} Count: A:{a} B:{b} C:{c}"
        decimals = self.firmware.decimals
        words = " ".join(
            f"{letter}:{value:.{decimals}f}" for letter, value in zip(AXES, logical, strict=True)
        )
        if self.firmware.language == "klipper":
            return words
        steps = [
            round(at * per_mm)
            for at, per_mm in zip(self.motion_queue.position(self.now)[:3], self.steps[:3], strict=True)
        ]
        return f"{words} Count X:{steps[0]} Y:{steps[1]} Z:{steps[2]}"

    def update_clipping(self) -> None:
        """Update whether moves are clipped to the printable area."""
        self.clips_moves = self.soft_endstops and all(self.homed)

    def update_e_ratio(self) -> None:
        """Update the length of filament per unit of E."""
        area = pi * self.diameter**2 / 4.0
        self.e_ratio = self.flow_ratio * (self.unit**2 / area if self.volumetric else 1.0)

    def set_limits(self, limits: MotionLimits) -> None:
        """Use other motion limits from the next command on."""
        self.limits = limits
        self.motion_queue.set_limits(limits)

    def is_warm_enough(self) -> bool:
        """Return whether extrusion is allowed at the current temperature."""
        if self.cold_allowed:
            self.hot = True
            return True
        self.apply_flow_cooling()
        warm = self.hotend.reading(self.now) >= self.coldest_extrusion
        # A heater approaches its target monotonically, so it cannot drop below the limit unless it is broken.
        self.hot = warm and self.hotend.target >= self.coldest_extrusion and not self.hotend.disturbed
        return warm

    def stop_timer(self) -> None:
        """Stop the print timer."""
        if self.timer_began is not None:
            self.timer_seconds += self.now - self.timer_began
            self.timer_began = None

    def planned_pause(self, seconds: float) -> Steps:
        """Queue a pause, s, behind the planned moves."""
        motion_queue, stops = self.motion_queue, self.stops
        motion_queue.advance(self.now)
        while motion_queue.room <= 0:
            yield motion_queue.ends
            if self.stops != stops:
                return
        x, y, z, _ = self.position
        motion_queue.hold(seconds, (x, y, z, self.filament), self.now)

    def wait_for_moves(self) -> Steps:
        """Wait until all planned moves are executed."""
        self.motion_queue.advance(self.now)
        self.motion_queue.expects_stop = True
        while self.motion_queue.busy:
            yield self.motion_queue.ends

    def until(self, moment: float) -> Steps:
        """Wait until a time, s."""
        while self.now < moment:
            yield moment

    def stop_moving(self) -> None:
        """Stop at once: planned moves are lost, and the position is that of the motors."""
        self.apply_flow_cooling()
        (x, y, z, _), unfed = self.motion_queue.stop(self.now)
        self.stops += 1
        self.position = (x, y, z, self.position[3] - unfed)
        self.filament -= unfed
        self.statistics.filament_fed -= unfed

    def kill(self, reason: str) -> None:
        """Halt the firmware: heaters off, no motion, no replies. Klipper still replies."""
        for line in self.firmware.killed:
            self.say(line.format(reason=reason))
        self.act("poweroff")
        for heater in self.heaters.all():
            self.set_target_of(heater, 0.0)
        self.stop_moving()
        self.waiting = False
        self.card.stop()
        self.statistics.killed = reason
        if self.firmware.language == "klipper":
            self.shut_down = reason
        else:
            self.killed = reason

    def homing_failed(self, axis: str) -> None:
        """Handle an endstop that never triggers: halt, or switch the motors off, depending on the firmware."""
        self.record_violation("an endstop never closed")
        if not self.firmware.homing_failed:
            self.kill("Homing Failed")
            return
        self.say(self.firmware.homing_failed.format(axis=axis))
        self.homed = [False, False, False]
        self.update_clipping()

    def inherit_hardware(self, old: FirmwareState) -> None:
        """Keep the hardware of the state before a reset: temperatures, spool, faults."""
        for heater, before in zip(self.heaters.all(), old.heaters.all(), strict=True):
            heater.cool_from(before, old.now)
        self.spool_end = old.spool_end - old.filament
        self.clogged, self._clogged_from = old.clogged, old._clogged_from
        self.stuck_endstops = old.stuck_endstops
        for name in self.heaters.protections:
            self.disturb(name)

    def set_clogged_share(self, share: float) -> None:
        """Set the share of fed filament that does not come out of the nozzle from now on."""
        fed = self.statistics.filament_fed
        self.statistics.filament_missing += (fed - self._clogged_from) * self.clogged
        self._clogged_from, self.clogged = fed, share
        if self.statistics.move_log is not None:
            self.statistics.move_log.keep_back(share)

    def run_out_of_filament(self) -> None:
        """Handle the end of the filament: with a sensor it is changed, without one nothing comes out from now on."""
        self.spool_end = inf
        self.statistics.runouts += 1
        if self.machine.runout_sensor:
            self.act(f"paused filament_runout {self.heaters.tool}")
            self.inject("M600")
        else:
            self.record_violation("out of filament")
            self.set_clogged_share(1.0)

    def load_filament(self) -> None:
        """Load a new spool."""
        self.spool_end = self.filament + self.machine.filament_left
        if self.clogged == 1.0:
            self.set_clogged_share(0.0)
