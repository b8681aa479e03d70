"""A printer that lost its power in the middle of a part: where it is taken up, and how the nozzle comes there."""

from __future__ import annotations

from pathlib import Path
from random import Random  # noqa: TID251 - seeded

import pytest
from printed import HEAT, scribble, tower
from rig import PROFILE, SETUP, Rig, warm, way

from printer_slicer.errors import PrintError
from printer_slicer.inspection.dry_run.machines import machine_of
from printer_slicer.jobs import build_job
from printer_slicer.printing.job_store import PortAddress, Print, create_print
from printer_slicer.printing.journal import LOST
from printer_slicer.printing.recovery import RecoveryPlan, plan_recovery
from printer_slicer.sim.firmwares import MARLIN_2_1, MARLIN_2_1_ADVANCED
from printer_slicer.sim.machine import Machine
from printer_slicer.stream.events import Finished
from tests.effort import crossed, few_of


class PowerLoss(Exception):  # noqa: N818
    """The printer is off."""


def lose_power(
    text: str, folder: Path, entries: int, *, advanced: bool = False, machine: Machine | None = None
) -> tuple[Rig, Print]:
    """Print until the printer loses its power, soon after it has taken so many commands; what the host keeps."""
    job = build_job("part.gcode", text.encode(), limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)
    print_ = create_print(folder, job.name, job.text, PortAddress("/dev/none", 250_000), SETUP)
    firmware = MARLIN_2_1_ADVANCED if advanced else MARLIN_2_1
    rig = Rig(text, firmware, folder=print_.folder, machine=machine or machine_of(PROFILE.printer))
    rig.connect()
    first: list[float] = []

    def watch(now: float) -> None:
        if rig.streamer.acknowledged >= entries and not first:
            first.append(now)
        if first and now >= first[0] + 0.37:
            raise PowerLoss

    with pytest.raises(PowerLoss):
        rig.run(watch)
    rig.made  # noqa: B018 - up to this moment
    rig.printer._state.stop_moving()
    assert rig.journal
    rig.journal.record_end(f"{LOST}gone", rig.port.now())
    rig.journal.close()
    print_.release()
    return rig, print_


def recovered(
    text: str, folder: Path, entries: int, *, advanced: bool = False
) -> tuple[Rig, Rig, RecoveryPlan]:
    """Both halves of a print, and what was done between."""
    before, print_ = lose_power(text, folder, entries, advanced=advanced)
    job = build_job("part.gcode", text.encode(), limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)
    found = plan_recovery(print_, job)
    after = Rig(text, folder=print_.folder)
    after.connect(found)
    after.run()
    return before, after, found


@pytest.mark.parametrize(("seed", "advanced"), crossed(range(15), [False, True]))
def test_gap_and_double_extrusion_are_at_most_1_mm(seed: int, advanced: bool, tmp_path: Path) -> None:
    chance = Random(seed)
    text = tower(6) if seed % 2 else scribble(seed, 150, relative=bool(seed % 4))
    whole = Rig(text)
    whole.connect()
    whole.run()

    before, after, _ = recovered(text, tmp_path, chance.randrange(40, 140), advanced=advanced)

    lost_or_twice = way(before.beads) + way(after.beads) - way(whole.beads)
    assert isinstance(after.events[-1], Finished)
    assert abs(lost_or_twice) <= 1.0
    # And the second half begins where the first one ended, not only after as much of it.
    assert before.beads
    x, y, *_ = before.beads[-1][1]
    bx, by, *_ = after.beads[0][0]
    assert ((x - bx) ** 2 + (y - by) ** 2) ** 0.5 <= 1.0 or abs(lost_or_twice) <= 0.2


@pytest.mark.parametrize("seed", few_of(range(10), 4))
def test_the_nozzle_touches_nothing_on_its_way(seed: int, tmp_path: Path) -> None:
    text = tower(12)
    before, after, found = recovered(text, tmp_path, Random(seed).randrange(40, 300))
    first = after.made.index(
        next(p for p in after.made if p[0][:3] == after.beads[0][0][:3] or p == after.beads[0])
    )
    z = before.made[-1][1][2]
    lines = after.of_job()
    homing = next(line for line in lines if line.startswith("G28"))

    assert homing == "G28 X Y"
    assert lines.index(next(line for line in lines if line.startswith("G92 Z"))) < lines.index(homing)
    top = max((end[2] for _, end in before.beads), default=0.0)
    inside = [
        end
        for _, end in after.made[:first]
        # The firmware counts z from where it was switched on.
        if ((end[0] - 100) ** 2 + (end[1] - 100) ** 2) ** 0.5 < 16.0 and end[2] + z < top - 1e-6
    ]
    assert inside == []
    assert z >= 0
    assert found.steps


def test_it_comes_from_outside_the_part(tmp_path: Path) -> None:
    text = tower(12)
    _, after, found = recovered(text, tmp_path, 200)
    script = [line for line in found.replay if line.startswith("G1 X")]
    x, y = (
        (float(word[1:]) for word in script[-2].split()[1:3] if word[0] in "XY")
        if len(script) > 1
        else (0, 0)
    )
    outside = ((x - 100) ** 2 + (y - 100) ** 2) ** 0.5

    assert outside > 14.9
    assert isinstance(after.events[-1], Finished)


def test_heat_fan_and_settings_are_said_again(tmp_path: Path) -> None:
    text = tower(6).replace("G92 E0\n", "G92 E0\nM204 P800 T1200\nM220 S95\n", 1)
    _, _, found = recovered(text, tmp_path, 80)
    script = list(found.replay)

    assert {
        "M140 S60",
        "M190 S60",
        "M109 S200",
        "M106 S128",
        "M204 P800 T1200",
        "M220 S95",
        "G28 X Y",
    } <= set(script)
    assert script.index("M109 S150") < script.index("G28 X Y") < script.index("M109 S200")


def test_chamber_bed_and_other_fans_are_as_they_were(tmp_path: Path) -> None:
    text = tower(6).replace("G92 E0\n", "G92 E0\nM141 S40\nM420 S1 Z10\nM106 P1 S200\n", 1)
    _, _, found = recovered(text, tmp_path, 80)
    script = list(found.replay)

    assert script.index("M141 S40") < script.index("G28 X Y") < script.index("M420 S1 Z10")
    assert "M106 P1 S200" in script
    assert "heat the nozzle to 200 °C and the bed to 60 °C and the chamber to 40 °C" in found.steps
    assert "M420 S1 Z10" in found.steps


def test_the_origin_of_the_program_is_where_it_was(tmp_path: Path) -> None:
    """Homing forgets it."""
    text = tower(6).replace("G92 E0\n", "G92 E0\nG1 X50 Y50 F6000\nG92 X40 Y60\n", 1)
    whole = Rig(text)
    whole.connect()
    whole.run()
    before, after, found = recovered(text, tmp_path, 80)

    assert isinstance(after.events[-1], Finished)
    assert abs(way(before.beads) + way(after.beads) - way(whole.beads)) <= 1.0
    assert after.beads[-1][1][:2] == pytest.approx(whole.beads[-1][1][:2], abs=0.01)
    script = list(found.replay)
    assert script.index("G28 X Y") < next(i for i, line in enumerate(script) if line.startswith("G92 X"))


def test_an_origin_that_was_moved_from_an_unknown_place_cannot_be_recovered(tmp_path: Path) -> None:
    """A job that calls the place where it finds the nozzle zero, as some do without homing."""
    text = tower(3).replace("G28\n", "G92 X100 Y100\n")
    _, print_ = lose_power(text, tmp_path, 40)
    job = build_job("part.gcode", text.encode(), limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)
    with pytest.raises(PrintError) as caught:
        plan_recovery(print_, job)

    assert str(caught.value) == (
        "part.gcode: the origin that its G92 commands set is unknown\n"
        "  Start again with printer-slicer print --discard-unfinished"
    )


def test_before_anything_was_printed_there_is_nothing_to_recover(tmp_path: Path) -> None:
    text = tower(3)
    job = build_job("part.gcode", text.encode(), limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)
    print_ = create_print(tmp_path, job.name, job.text, PortAddress("/dev/none", 250_000), SETUP)

    with pytest.raises(PrintError, match="nothing has been printed yet"):
        plan_recovery(print_, job)


@pytest.mark.parametrize("heat", ["", "M104 S120\n", HEAT], ids=["none", "below the softening", "usual"])
def test_only_what_is_done_is_told(heat: str, tmp_path: Path) -> None:
    text = tower(6).replace(HEAT, heat)
    _, print_ = lose_power(text, tmp_path, 80, machine=warm(machine_of(PROFILE.printer)))
    job = build_job("part.gcode", text.encode(), limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)
    found = plan_recovery(print_, job)
    heated = [line for line in found.replay if line.startswith("M109")]

    assert ("warm the nozzle" in found.steps) == bool(heated)
    assert all(f"{line.partition('S')[2]} °C" in found.steps for line in heated)
    assert ("prime" in found.steps) == any("E15" in line for line in found.replay)
    assert ("by hand" in found.steps) == (not heated)
    assert " 0 °C" not in found.steps
