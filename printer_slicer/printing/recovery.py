"""Resume a print on a printer that has lost its state: the commands sent before the rest of the job.

soften the nozzle - restore z from the journal - lift over the part - home x and y - heat - prime beside the part -
come down outside of it - move to the position - lower - restore filament, modes and speed - rest of the job
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from printer_slicer.errors import PrintError
from printer_slicer.gcode.state import ModalState
from printer_slicer.jobs import Job
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.job_store import Print
from printer_slicer.printing.journal import LOST, JournalData, dataclass_from_json, read_journal
from printer_slicer.printing.machine_state import PrintState, number
from printer_slicer.printing.move_geometry import remaining_move, state_at
from printer_slicer.printing.objects import LiveJob, find_object_spans
from printer_slicer.printing.parking import ParkedState, parking_position, parse_parked_state, restore_modes
from printer_slicer.printing.power_loss_position import find_stop_position
from printer_slicer.printing.reattach import ResumePlan, rebuild
from printer_slicer.printing.resume_approach import extruded_points, find_approach
from printer_slicer.stream.protocol import RESET_REASON

__all__ = ["Point", "RecoveryPlan", "find_recovery_point", "plan_recovery", "recovery_script"]

_SOFT: Final = 150.0
"""Temperature at which the nozzle comes loose from the part without oozing, °C."""

_OVER: Final = 1.0
"""Height above the layer at which the nozzle approaches from outside, mm."""

_COLD: Final = "The job sets no nozzle temperature: heat nozzle and bed by hand first."

_REMEDY: Final = "Start again with printer-slicer print --discard-unfinished"


@dataclass(frozen=True, slots=True)
class Point:
    """Position at which a print resumes.

    Attributes:
        entries: number of job entries that are not sent again.
        stand: machine state at this position.
        replay: commands to send first, such as the rest of a move.
    """

    entries: int
    stand: ModalState
    replay: tuple[bytes, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it for the journal."""
        replay = [command.decode("latin-1") for command in self.replay]
        return {"entries": self.entries, "stand": asdict(self.stand), "replay": replay}


@dataclass(frozen=True, slots=True)
class RecoveryPlan(ResumePlan):
    """Plan of a recovery, see `ResumePlan`.

    Attributes:
        told: the steps as text.
    """

    told: str = ""


def plan_recovery(print_: Print, job: Job) -> RecoveryPlan:
    """Plan the recovery of a print whose printer has lost its state.

    Raises:
        PrintError: recovery is impossible: nothing was printed, or the position of the nozzle is unknown.
    """
    journal_data = read_journal(print_.folder)
    lost = _lost(journal_data, same_boot=print_.same_boot)
    live = rebuild(
        journal_data, journal_data.line, job.commands, find_object_spans(job.text), print_.setup.flavour
    )
    point = find_recovery_point(journal_data, live, lost, print_.setup)
    modes = live.modes
    if None in modes.machine.offset[:2]:
        raise PrintError(f"{job.name}: the origin set by its G92 is unknown", remedy=_REMEDY)
    if not point.stand.known or modes.box is None:
        raise PrintError(f"{job.name}: nothing has been printed yet", remedy=_REMEDY)
    script = recovery_script(job, point, modes, print_.setup)
    steps = _describe_steps(job, point, modes, print_.setup)
    rest = LiveJob(job.commands, find_object_spans(job.text), point.entries)
    rest.modes, rest.followed = modes, point.entries
    for name in live.cancelled:
        rest.cancel(name, point.entries)
    return RecoveryPlan(
        point.entries,
        rest,
        "recovering",
        None,
        0.0,
        tuple(command.decode("latin-1") for command in (*script, *point.replay)),
        point.as_json(),
        steps,
    )


def _describe_steps(job: Job, point: Point, modes: PrintState, setup: HostSettings) -> str:
    """Describe the steps of `recovery_script`."""
    machine, (x, y, z) = modes.machine, point.stand.place
    steps = [f"warm the nozzle to {min(_SOFT, machine.hotend):g} °C"] if machine.hotend else []
    steps += [f"set z to {z:g} mm", "lift", "home x and y only"]
    wanted = (("nozzle", machine.hotend), ("bed", machine.bed), ("chamber", machine.chamber))
    heats = [f"the {name} to {celsius:g} °C" for name, celsius in wanted if celsius]
    steps += [f"heat {' and '.join(heats)}"] if heats else []
    if modes.mesh:
        steps.append(f"load the stored bed mesh ({modes.mesh.decode('latin-1')})")
    steps += ["prime beside the part"] if machine.hotend >= setup.coldest else []
    layer = job.layer_of(point.entries)
    place = f"continue at x {x:.1f} y {y:.1f}" + (f" in layer {layer}" if layer else "")
    done = f"after {point.entries} of {len(job.commands)} commands."
    cold = "" if machine.hotend else f" {_COLD}"
    return f"Recovery: {', '.join(steps)}, and {place}, {done}{cold}"


def _lost(journal_data: JournalData, *, same_boot: bool) -> float | None:
    """Return when the printer lost its state, s; None: long after the host ended, so all planned moves were made."""
    if journal_data.stopped is not None and journal_data.reason.startswith(LOST):
        return journal_data.stopped
    if journal_data.stopped is None and same_boot:
        return None
    # No answers, a late noticed reset, or a computer without power: assume a time just after the last answer.
    return journal_data.accepted[-1][1] if journal_data.accepted else None


def find_recovery_point(
    journal_data: JournalData, job: LiveJob, lost: float | None, setup: HostSettings
) -> Point:
    """Return the position at which the printer lost its state, and the rest of the interrupted moves.

    Args:
        journal_data: the journal.
        job: the entries as they were sent; it is followed up to the last accepted entry.
        lost: when the printer lost its state, s; None: after it had finished all planned moves.
        setup: settings of the printer.
    """
    if values := journal_data.states.get("recovering_at"):
        replay = tuple(text.encode("latin-1") for text in values["replay"])
        job.follow(int(values["entries"]))
        return Point(int(values["entries"]), dataclass_from_json(ModalState, values["stand"]), replay)
    if values := journal_data.states.get("parked"):
        job.follow(journal_data.entries)
        parked: ParkedState = parse_parked_state(values)
        machine = job.modes.machine
        machine.hotends[machine.tool], machine.bed = parked.hotend, parked.bed
        return Point(parked.entries, parked.stand, tuple(text.encode("latin-1") for text in parked.replay))
    modes = job.follow(journal_data.entries)
    steps = [step for step in modes.recent if step.entry < journal_data.entries]
    if not steps:
        return Point(journal_data.entries, modes.stand)
    noticed = journal_data.stopped if journal_data.reason.startswith(RESET_REASON) else None
    index, share = find_stop_position(steps, journal_data.accepted, lost, setup.limits, noticed=noticed)
    step = steps[index]
    stand = state_at(step, share)
    rest = [remaining_move(step, share)] if share < 1.0 else []
    for later in steps[index + 1 :]:
        if later.entry >= 0:
            entries = later.entry
            break
        rest.append(later.command)
    else:
        entries = journal_data.entries
    return Point(entries, stand, tuple(rest))


def recovery_script(job: Job, point: Point, modes: PrintState, setup: HostSettings) -> list[bytes]:
    """Return the commands before the rest of the job."""
    x, y, z = point.stand.place
    machine = modes.machine
    safe = max(min((z if modes.highest is None else max(modes.highest, z)) + setup.lift, setup.top), z)
    spot = parking_position(setup, modes)
    origin = machine.offset[:2]
    lift = b" F%d" % (setup.lift_speed * 60)
    travel = b" F%d" % (setup.travel_speed * 60)
    script = [b"G21", *_settings(modes), b"M140 S%s" % number(machine.bed)]
    script += [b"M141 S%s" % number(machine.chamber)] if machine.chamber else []
    script += [b"M109 S%s" % number(min(_SOFT, machine.hotend))] if machine.hotend else []
    script += [setup.firmware.set_z_command(z)] if setup.firmware.set_z_command is not None else []
    script += [b"G90", b"G92 Z%s" % number(z), b"G1 Z%s" % number(safe) + lift, b"G28 X Y"]
    if origin != (0.0, 0.0):
        # Homing has restored the origin of the machine; the job uses its own.
        corner = [number(one - by) for one, by in zip(spot, origin, strict=True) if by is not None]
        script += [
            b"G1 X%s Y%s" % tuple(corner) + travel,
            b"G92 X%s Y%s" % (number(spot[0]), number(spot[1])),
        ]
    script += [modes.mesh] if modes.mesh else []
    script += [b"G1 X%s Y%s" % (number(spot[0]), number(spot[1])) + travel]
    script += [b"M190 S%s" % number(machine.bed)] if machine.bed else []
    if machine.hotend:
        script.append(b"M109 S%s" % number(machine.hotend))
    warm = machine.hotend >= setup.coldest
    if warm:
        prime = [b"M83", b"G1 E%s F300" % number(setup.purge + setup.retract)]
        script += [*prime, b"G1 E-%s F%d" % (number(setup.retract), setup.retract_speed * 60)]
    script += [b"M106 S%d" % machine.fan if machine.fan else b"M107", *machine.fans.values()]
    beside = find_approach(extruded_points(job, point.entries, setup), (x, y, z), setup)
    if beside is not None:
        script.append(b"G1 X%s Y%s" % (number(round(beside[0], 3)), number(round(beside[1], 3))) + travel)
        script.append(b"G1 Z%s" % number(min(z + _OVER, safe)) + lift)
    script += [b"G1 X%s Y%s" % (number(x), number(y)) + travel, b"G1 Z%s" % number(z) + lift]
    forward = setup.retract - point.stand.pulled
    if warm and forward:
        script.append(b"G1 E%s F%d" % (number(forward), setup.deretract_speed * 60))
    return script + restore_modes(point.stand)


def _settings(modes: PrintState) -> list[bytes]:
    """Return the persistent settings as commands."""
    script = [modes.machine.tool_command] if modes.machine.tool_command else []
    for command, inches in modes.sticky.values():
        script += [b"G20", command, b"G21"] if inches else [command]
    return script
