"""Resume a print on a printer that has lost its state: commands that are sent before the rest of the job.

warm the nozzle - restore z from the journal - lift over the part - home x and y - heat - prime beside the part -
move down beside the part - move to the position - lower - restore filament, modes and speed - rest of the job
"""

from __future__ import annotations

from typing import Any, Final

from printer_slicer.errors import PrintError
from printer_slicer.gcode.state import ModalState
from printer_slicer.jobs import Job
from printer_slicer.printing.host_settings import HostSettings
from printer_slicer.printing.job_store import Print
from printer_slicer.printing.journal import LOST, JournalData, read_journal, restore_struct
from printer_slicer.printing.machine_state import PrintState, format_number
from printer_slicer.printing.move_geometry import build_remaining_move, interpolate_state
from printer_slicer.printing.objects import LiveJob, find_object_spans
from printer_slicer.printing.parking import (
    ParkedState,
    build_restore_script,
    find_parking_position,
    parse_parked_state,
)
from printer_slicer.printing.power_loss_position import find_stop_position
from printer_slicer.printing.reattach import ResumePlan, rebuild_job
from printer_slicer.printing.resume_approach import find_approach_point, sample_extrusions
from printer_slicer.stream.protocol import RESET_REASON
from printer_slicer.values import Struct, as_dict

__all__ = ["RecoveryPlan", "RecoveryPoint", "build_recovery_script", "find_recovery_point", "plan_recovery"]

_SOFTENING_TEMPERATURE: Final = 150.0
"""Temperature at which the nozzle detaches from the part without oozing, °C."""

_APPROACH_HEIGHT: Final = 1.0
"""Height above the layer at which the nozzle approaches from beside the part, mm."""

_COLD_NOZZLE_ADVICE: Final = "The job sets no nozzle temperature: heat nozzle and bed by hand first."

_REMEDY: Final = "Start again with printer-slicer print --discard-unfinished"


class RecoveryPoint(Struct, frozen=True):
    """Point at which a print resumes after the printer has lost its state.

    Attributes:
        entries: number of job entries that are not sent again.
        stand: machine state at this position.
        replay: commands to send first, such as the rest of a move.
    """

    entries: int
    stand: ModalState
    replay: tuple[bytes, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the point as a JSON object for the journal."""
        replay = [command.decode("latin-1") for command in self.replay]
        return {"entries": self.entries, "stand": as_dict(self.stand), "replay": replay}


class RecoveryPlan(ResumePlan, Struct, frozen=True):
    """Resume plan for a printer that has lost its state, with a description of the steps.

    Attributes:
        steps: description of the steps for the user.
    """

    steps: str = ""


def plan_recovery(print_: Print, job: Job) -> RecoveryPlan:
    """Plan the recovery of a print whose printer has lost its state.

    Raises:
        PrintError: recovery is impossible: nothing was printed, or the position of the nozzle is unknown.
    """
    journal_data = read_journal(print_.folder)
    lost_at = _find_loss_time(journal_data, is_same_boot=print_.is_same_boot)
    live = rebuild_job(
        journal_data, journal_data.line, job.commands, find_object_spans(job.text), print_.setup.flavour
    )
    point = find_recovery_point(journal_data, live, lost_at, print_.setup)
    print_state = live.print_state
    if None in print_state.machine.offset[:2]:
        raise PrintError(f"{job.name}: the origin that its G92 commands set is unknown", remedy=_REMEDY)
    if not point.stand.known or print_state.bounding_box is None:
        raise PrintError(f"{job.name}: nothing has been printed yet", remedy=_REMEDY)
    script = build_recovery_script(job, point, print_state, print_.setup)
    steps = _describe_steps(job, point, print_state, print_.setup)
    rest = LiveJob(job.commands, find_object_spans(job.text), point.entries)
    rest.print_state, rest.followed = print_state, point.entries
    for name in live.cancelled:
        rest.cancel_object(name, point.entries)
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


def _describe_steps(job: Job, point: RecoveryPoint, print_state: PrintState, setup: HostSettings) -> str:
    """Describe the steps of `build_recovery_script` for the user."""
    machine, (x, y, z) = print_state.machine, point.stand.place
    steps = (
        [f"warm the nozzle to {min(_SOFTENING_TEMPERATURE, machine.hotend):g} °C"] if machine.hotend else []
    )
    steps += [f"set z to {z:g} mm", "lift", "home x and y only"]
    wanted = (("nozzle", machine.hotend), ("bed", machine.bed), ("chamber", machine.chamber))
    heats = [f"the {name} to {celsius:g} °C" for name, celsius in wanted if celsius]
    steps += [f"heat {' and '.join(heats)}"] if heats else []
    if print_state.mesh:
        steps.append(f"load the stored bed mesh ({print_state.mesh.decode('latin-1')})")
    steps += ["prime beside the part"] if machine.hotend >= setup.coldest else []
    layer = job.layer_of(point.entries)
    place = f"continue at x {x:.1f} y {y:.1f}" + (f" in layer {layer}" if layer else "")
    done = f"after {point.entries} of {len(job.commands)} commands."
    cold = "" if machine.hotend else f" {_COLD_NOZZLE_ADVICE}"
    return f"Recovery: {', '.join(steps)}, and {place}, {done}{cold}"


def _find_loss_time(journal_data: JournalData, *, is_same_boot: bool) -> float | None:
    """Return when the printer lost its state, s; None if it had finished all planned moves before."""
    if journal_data.stopped is not None and journal_data.reason.startswith(LOST):
        return journal_data.stopped
    if journal_data.stopped is None and is_same_boot:
        return None
    # No answers, a reset noticed late, or a power loss of the computer: assume a time just after the last answer.
    return journal_data.accepted[-1][1] if journal_data.accepted else None


def find_recovery_point(
    journal_data: JournalData, job: LiveJob, lost_at: float | None, setup: HostSettings
) -> RecoveryPoint:
    """Find the point at which the printer lost its state, and the rest of the interrupted moves.

    Args:
        journal_data: the journal.
        job: the job entries as they were sent; its print state is advanced to the last accepted entry.
        lost_at: time at which the printer lost its state, s; None: after it had finished all planned moves.
        setup: settings of the printer.
    """
    if values := journal_data.states.get("recovering_at"):
        replay = tuple(text.encode("latin-1") for text in values["replay"])
        job.follow(int(values["entries"]))
        return RecoveryPoint(int(values["entries"]), restore_struct(ModalState, values["stand"]), replay)
    if values := journal_data.states.get("parked"):
        job.follow(journal_data.entries)
        parked: ParkedState = parse_parked_state(values)
        machine = job.print_state.machine
        machine.hotends[machine.tool], machine.bed = parked.hotend, parked.bed
        return RecoveryPoint(
            parked.entries, parked.stand, tuple(text.encode("latin-1") for text in parked.replay)
        )
    print_state = job.follow(journal_data.entries)
    steps = [step for step in print_state.recent if step.entry < journal_data.entries]
    if not steps:
        return RecoveryPoint(journal_data.entries, print_state.modal)
    noticed_at = journal_data.stopped if journal_data.reason.startswith(RESET_REASON) else None
    index, fraction = find_stop_position(
        steps, journal_data.accepted, lost_at, setup.limits, noticed_at=noticed_at
    )
    step = steps[index]
    stand = interpolate_state(step, fraction)
    rest = [build_remaining_move(step, fraction)] if fraction < 1.0 else []
    for later in steps[index + 1 :]:
        if later.entry >= 0:
            entries = later.entry
            break
        rest.append(later.command)
    else:
        entries = journal_data.entries
    return RecoveryPoint(entries, stand, tuple(rest))


def build_recovery_script(
    job: Job, point: RecoveryPoint, print_state: PrintState, setup: HostSettings
) -> list[bytes]:
    """Return the commands that recover the printer, to be sent before the rest of the job."""
    x, y, z = point.stand.place
    machine = print_state.machine
    highest = z if print_state.highest_z is None else max(print_state.highest_z, z)
    safe = max(min(highest + setup.lift, setup.top), z)
    spot = find_parking_position(setup, print_state)
    spot_xy = format_number(spot[0]), format_number(spot[1])
    origin = machine.offset[:2]
    lift = b" F%d" % (setup.lift_speed * 60)
    travel = b" F%d" % (setup.travel_speed * 60)
    script = [b"G21", *_build_setting_commands(print_state), b"M140 S%s" % format_number(machine.bed)]
    script += [b"M141 S%s" % format_number(machine.chamber)] if machine.chamber else []
    softening = format_number(min(_SOFTENING_TEMPERATURE, machine.hotend))
    script += [b"M109 S%s" % softening] if machine.hotend else []
    script += [setup.firmware.set_z_command(z)] if setup.firmware.set_z_command is not None else []
    script += [b"G90", b"G92 Z%s" % format_number(z), b"G1 Z%s" % format_number(safe) + lift, b"G28 X Y"]
    if origin != (0.0, 0.0):
        # Homing has restored the origin of the machine, but the job uses a different origin.
        corner = [format_number(one - by) for one, by in zip(spot, origin, strict=True) if by is not None]
        script += [b"G1 X%s Y%s" % tuple(corner) + travel, b"G92 X%s Y%s" % spot_xy]
    script += [print_state.mesh] if print_state.mesh else []
    script += [b"G1 X%s Y%s" % spot_xy + travel]
    script += [b"M190 S%s" % format_number(machine.bed)] if machine.bed else []
    if machine.hotend:
        script.append(b"M109 S%s" % format_number(machine.hotend))
    is_warm = machine.hotend >= setup.coldest
    if is_warm:
        prime = [b"M83", b"G1 E%s F300" % format_number(setup.purge + setup.retract)]
        script += [*prime, b"G1 E-%s F%d" % (format_number(setup.retract), setup.retract_speed * 60)]
    script += [b"M106 S%d" % machine.fan if machine.fan else b"M107", *machine.fans.values()]
    beside = find_approach_point(sample_extrusions(job, point.entries, setup), (x, y, z), setup)
    if beside is not None:
        script.append(
            b"G1 X%s Y%s" % (format_number(round(beside[0], 3)), format_number(round(beside[1], 3))) + travel
        )
        script.append(b"G1 Z%s" % format_number(min(z + _APPROACH_HEIGHT, safe)) + lift)
    script += [
        b"G1 X%s Y%s" % (format_number(x), format_number(y)) + travel,
        b"G1 Z%s" % format_number(z) + lift,
    ]
    forward = setup.retract - point.stand.pulled
    if is_warm and forward:
        script.append(b"G1 E%s F%d" % (format_number(forward), setup.deretract_speed * 60))
    return script + build_restore_script(point.stand)


def _build_setting_commands(print_state: PrintState) -> list[bytes]:
    """Return the commands that restore the tool and the persistent settings."""
    script = [print_state.machine.tool_command] if print_state.machine.tool_command else []
    for command, inches in print_state.sticky.values():
        script += [b"G20", command, b"G21"] if inches else [command]
    return script
