"""The state of the simulated firmware between commands, and the operations that several commands use."""

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

__all__ = ["MAX_UNSENT_LINES", "FirmwareState", "Steps"]

Steps = Iterator[float]
"""The steps of a command that takes time: each step yields the time, s, at which the command continues."""


_POSITIONING: Final[dict[str, Literal["either", "apart"]]] = {
    "marlin_legacy": "either",
    "klipper": "either",
    "repetier": "either",
    "prusa": "apart",
    "reprapfirmware": "apart",
}
"""How G90 and M82 affect E in each dialect; "together" applies to dialects that are not listed."""

MAX_UNSENT_LINES: Final = 4096
"""Maximum number of output lines kept for a host that does not read; further reports are dropped."""


class FirmwareState:
    """The state of the simulated firmware: position, modes, heaters and pending output.

    Attributes:
        now: simulated time, s.
        out: output lines that have not been sent yet.
        ok_tail: text to append to the ok of the current command.
        last_line: number of the last line that was read.
        renumber: new line number from M110; None without one.
        inject: function that queues a command of the firmware itself behind the current one.
        muted: number of following commands that get no ok.
        due: time of the next alarm, s; see `set_alarm`.
        position: end of the planned motion: x, y, z from the endstops, e as the program counts it; mm.
        offset: logical minus machine coordinates of x, y, z from G92 and M206, mm.
        home_offset: the part of `offset` that M206 set and homing keeps, mm.
        filament: mm of filament fed since power-on, at the end of the planned motion.
        unit: mm per unit of the program.
        volumetric: whether E counts volume, of a filament of `diameter` mm.
        flow_ratio: flow override of M221, 1 for 100 %.
        e_ratio: mm of filament per unit of E; see `update_e_ratio`.
        feed: last feed rate, mm/s.
        retraction: settings of G10 and G11: length (mm), speed (mm/s), recover speed (mm/s), extra recover length (mm).
        retracted: whether G10 was executed and not yet followed by G11.
        homed: whether x, y, z are homed.
        unhomed_motors: axes whose motors were switched off since homing.
        clips_moves: whether moves are clipped: all axes are homed and the software endstops are on.
        heaters: heaters of the machine.
        hot: whether the hotend is known to stay hot enough for extrusion until a command or fault changes this.
        spool_end: mm of filament fed at which the spool is empty.
        clogged: share of the filament fed that does not come out of the nozzle.
        stuck_endstops: axes whose endstop never triggers.
        card: the SD card; unused without a reader.
        waiting: whether a command waits for a heater or a person; M108 ends the wait.
        busy_with: activity that busy reports name.
        stops: number of quick stops (M410).
        killed: why the firmware halted; empty while it runs.
        shut_down: why Klipper is shut down; empty while it runs.
        reset: function that restarts the firmware.
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
        self.positioning = PositioningMode(_POSITIONING.get(firmware.dialect, "together"))
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

    def send_line(self, line: str) -> None:
        """Send one line of text to the host."""
        self.out.append(line + "\n")

    def send_report(self, line: str) -> None:
        """Send an automatic report; drop it if the host has not read the earlier output."""
        if len(self.out) < MAX_UNSENT_LINES:
            self.send_line(line)

    def set_alarm(self, name: str, when: float, action: Callable[[], None]) -> None:
        """Call `action` at the time `when`, s, instead of the earlier alarm of this name; infinity cancels it."""
        self._alarms[name] = (when, action)
        self.due = max(min(moment for moment, _ in self._alarms.values()), self.now)

    def run_due_alarms(self) -> None:
        """Run the alarms that are due."""
        for name, (when, action) in list(self._alarms.items()):
            if when <= self.now and not self.killed:
                self._alarms[name] = (inf, action)
                action()
        self.due = min(moment for moment, _ in self._alarms.values())

    def report_every(self, name: str, seconds: float, format_report: Callable[[], str]) -> None:
        """Send a report every `seconds`; 0 stops the report of this name."""

        def send_and_repeat() -> None:
            """Send the report, and set the alarm for the next report."""
            self.send_report(format_report())
            self.set_alarm(name, self.now + seconds, send_and_repeat)

        self.set_alarm(name, self.now + seconds if seconds > 0.0 else inf, send_and_repeat)

    def record_violation(self, text: str) -> None:
        """Record that a real printer would reject the current command or be harmed by it."""
        self.statistics.record_violation(text)

    def reply_unknown_command(self, text: str) -> None:
        """Send the firmware's reply to an unknown command."""
        if self.firmware.unknown_reply:
            self.send_line(self.firmware.unknown_reply.format(text=text))
        self.record_violation("unknown command")

    def send_action(self, action: str) -> None:
        """Send an action command (`//action:`) to the host if the firmware supports such commands."""
        if self.firmware.host_actions:
            self.send_line(f"//action:{action}")

    def show_message(self, text: str) -> None:
        """Show a message on the display; firmwares with host prompts also send it to the host."""
        if self.firmware.prompts:
            self.send_line(f"//action:notification {text}")

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
        """The report that the firmware sends while a command takes time."""
        return f"echo:busy: {self.busy_with}"

    def apply_flow_cooling(self) -> None:
        """Cool the hotend by the heat that flowing filament has carried away since the last call."""
        if not self.heaters.steady:
            self.heaters.apply_flow_cooling(self.motion_queue.position(self.now)[3], self.now)

    def set_heater_target(self, heater: Heater, target: float) -> None:
        """Set the target temperature of a heater, °C."""
        self.apply_flow_cooling()
        heater.set_target(target, self.now)
        self.heaters.record_target(heater, self.now)
        self._schedule_heater_check()

    def record_heater_fault(self, name: str) -> None:
        """Record that the fault injection has broken or repaired a heater."""
        self.heaters.record_fault(name, self.now)
        self._schedule_heater_check()

    def _schedule_heater_check(self) -> None:
        """Set the alarm for the next check of the heaters after a change of a target or fault."""
        self.hot = False
        self.set_alarm("heaters", self.heaters.next_check_time, self._check_heaters)

    def _check_heaters(self) -> None:
        """Halt the firmware if a heater is out of control; else set the alarm for the next check."""
        if self.shut_down:
            return
        self.apply_flow_cooling()
        fault = self.heaters.find_fault(self.now)
        if fault is None:
            self.set_alarm("heaters", self.heaters.next_check_time, self._check_heaters)
            return
        name, what = fault
        for line in self.firmware.heater_fault_messages:
            self.send_line(line.format(what=what, heater=name))
        self.kill(f"Err: {what.removesuffix(' triggered')}" if "TEMP" in what else what)

    def format_temperature_report(self) -> str:
        """Return all temperatures in the format of the firmware, such as `T:.. /.. B:.. /.. @:.. B@:..`."""
        self.apply_flow_cooling()
        report = self.heaters.format_temperatures(self.firmware.language, self.now)
        self.set_alarm("heaters", self.heaters.next_check_time, self._check_heaters)
        return report

    def format_position_report(self) -> str:
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
        """Update `clips_moves` after a change of homing or of the software endstops."""
        self.clips_moves = self.soft_endstops and all(self.homed)

    def update_e_ratio(self) -> None:
        """Update `e_ratio` after a change of units, flow or volumetric extrusion."""
        area = pi * self.diameter**2 / 4.0
        self.e_ratio = self.flow_ratio * (self.unit**2 / area if self.volumetric else 1.0)

    def set_limits(self, limits: MotionLimits) -> None:
        """Set the motion limits for the following commands."""
        self.limits = limits
        self.motion_queue.set_limits(limits)

    def is_hot_enough_to_extrude(self) -> bool:
        """Return whether the current temperature of the hotend allows extrusion; update `hot`."""
        if self.cold_allowed:
            self.hot = True
            return True
        self.apply_flow_cooling()
        warm = self.hotend.sensor_reading(self.now) >= self.coldest_extrusion
        # A heater approaches its target monotonically, so it cannot drop below the limit unless it is broken.
        self.hot = warm and self.hotend.target >= self.coldest_extrusion and not self.hotend.has_fault
        return warm

    def stop_timer(self) -> None:
        """Stop the print timer."""
        if self.timer_began is not None:
            self.timer_seconds += self.now - self.timer_began
            self.timer_began = None

    def queue_pause(self, seconds: float) -> Steps:
        """Queue a pause of `seconds` behind the planned moves."""
        motion_queue, stops = self.motion_queue, self.stops
        motion_queue.advance(self.now)
        while motion_queue.free_places <= 0:
            yield motion_queue.ends
            if self.stops != stops:
                return
        x, y, z, _ = self.position
        motion_queue.push_pause(seconds, (x, y, z, self.filament), self.now)

    def wait_for_moves(self) -> Steps:
        """Wait until all planned moves are executed."""
        self.motion_queue.advance(self.now)
        self.motion_queue.expects_stop = True
        while self.motion_queue.is_busy:
            yield self.motion_queue.ends

    def wait_until(self, moment: float) -> Steps:
        """Wait until the time `moment`, s."""
        while self.now < moment:
            yield moment

    def stop_moving(self) -> None:
        """Stop at once: discard the planned moves, and continue from the position of the motors."""
        self.apply_flow_cooling()
        (x, y, z, _), unfed = self.motion_queue.stop(self.now)
        self.stops += 1
        self.position = (x, y, z, self.position[3] - unfed)
        self.filament -= unfed
        self.statistics.filament_fed -= unfed

    def kill(self, reason: str) -> None:
        """Halt the firmware: no heating, motion or replies, except Klipper's reply that it is shut down."""
        for line in self.firmware.halt_messages:
            self.send_line(line.format(reason=reason))
        self.send_action("poweroff")
        for heater in self.heaters.all_heaters():
            self.set_heater_target(heater, 0.0)
        self.stop_moving()
        self.waiting = False
        self.card.stop()
        self.statistics.killed = reason
        if self.firmware.language == "klipper":
            self.shut_down = reason
        else:
            self.killed = reason

    def handle_homing_failure(self, axis: str) -> None:
        """React to an endstop that never triggers: depending on the firmware, halt or switch motors off."""
        self.record_violation("an endstop never closed")
        if not self.firmware.homing_failed_message:
            self.kill("Homing Failed")
            return
        self.send_line(self.firmware.homing_failed_message.format(axis=axis))
        self.homed = [False, False, False]
        self.update_clipping()

    def inherit_hardware(self, old: FirmwareState) -> None:
        """Copy the temperatures, the spool and the hardware faults from the state before a reset."""
        for heater, before in zip(self.heaters.all_heaters(), old.heaters.all_heaters(), strict=True):
            heater.inherit_temperature(before, old.now)
        self.spool_end = old.spool_end - old.filament
        self.clogged, self._clogged_from = old.clogged, old._clogged_from
        self.stuck_endstops = old.stuck_endstops
        for name in self.heaters.protections:
            self.record_heater_fault(name)

    def set_clogged_share(self, share: float) -> None:
        """Set which share of the fed filament does not come out of the nozzle from now on."""
        fed = self.statistics.filament_fed
        self.statistics.filament_missing += (fed - self._clogged_from) * self.clogged
        self._clogged_from, self.clogged = fed, share
        if self.statistics.move_log is not None:
            self.statistics.move_log.set_clogged_share(share)

    def run_out_of_filament(self) -> None:
        """Handle the end of the spool: with a sensor, request a filament change; else stop extruding."""
        self.spool_end = inf
        self.statistics.runouts += 1
        if self.machine.runout_sensor:
            self.send_action(f"paused filament_runout {self.heaters.tool}")
            self.inject("M600")
        else:
            self.record_violation("out of filament")
            self.set_clogged_share(1.0)

    def load_filament(self) -> None:
        """Load a new spool."""
        self.spool_end = self.filament + self.machine.filament_left
        if self.clogged == 1.0:
            self.set_clogged_share(0.0)
