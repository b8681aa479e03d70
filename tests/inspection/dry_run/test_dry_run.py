"""The dry run: what is executed is what was sent, what is wrong is named, and what is right passes."""

from __future__ import annotations

import json
import re
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.cli.verdicts import collect_verdict_facts
from printer_slicer.errors import VerificationError
from printer_slicer.inspection.dry_run.comparison import Comparison
from printer_slicer.inspection.dry_run.judging import Verdict
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.jobs import Job
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.profile import Profile, load_profile, profile_with
from printer_slicer.slice_jobs import job_from
from printer_slicer.stream.events import Accepted, Event, Finished, Identified

PARTS = Path(__file__).parents[3] / "sample_parts"
PROFILE = load_profile("marlin_220", "pla", "standard")
READY = "M104 S210\nG28\nM109 S210\nG90\nM83\n"
"""What a file needs so that it may move and extrude."""
DONE = "M104 S0\n"
"""And what it needs so that nothing stays hot."""


def scaled(folder: Path, x: float, y: float, z: float) -> Path:
    """The box with other edges, mm."""
    box = load_mesh(PARTS / "box.stl")
    path = folder / f"box_{x:g}_{y:g}_{z:g}.stl"
    export_stl(Mesh(box.triangles * np.array([x, y, z]) / box.size), path)
    return path


def rehearsed(folder: Path, text: str | bytes, profile: Profile = PROFILE) -> Verdict:
    """The verdict on a G-code text."""
    path = folder / "job.gcode"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return dry_run(job_from(path, profile), profile)


# Parts that are sliced here


@pytest.mark.parametrize("name", ["cone", "bridge", "sheared_prism"])
def test_sample_parts_are_executed_as_sent_and_laid_at_the_heights_of_the_plan(name: str) -> None:
    profile = load_profile("marlin_220", "pla", "adaptive", {"thinnest_layer": 0.3})
    job = job_from(PARTS / f"{name}.stl", profile)
    verdict = dry_run(job, profile)
    assert job.program is not None
    tops = [round(float(top), 4) for top in job.program.plan.top[job.program.printed]]

    assert verdict.problems == ()
    assert (verdict.executed, verdict.commands) == (len(job.commands), len(job.commands))
    assert [z for z in verdict.heights if z in tops] == tops
    assert verdict.simulated_seconds == pytest.approx(job.seconds, rel=0.01)
    assert verdict.total_seconds > verdict.simulated_seconds
    assert verdict.report.filament == pytest.approx(job.program.filament_used, abs=25)  # the prime line


@pytest.mark.parametrize(
    "changes",
    [
        {"relative_extrusion": False},
        {"printer.z_hop": 0.4},
        {"baud": 19200},
        {"receive_buffer": 64},
        {"retract_length": 0},
        {"perimeters": 0},
        {"infill_density": 0},
        {"infill_density": 1},
        {"brim_width": 3},
        {"brim_width": 3, "brim_type": "ears", "brim_gap": 0.1},
        {"raft_height": 0.8},
        {"raft_height": 0.8, "skirt_height": 10000, "raft_gap": 0.2},
        {"skirt_height": 0.5, "skirt_min_length": 50},
        {"skirt_loops": 0},
        {"corner": "junction_deviation"},
        {"corner": "square_corner", "minimum_cruise_ratio": 0.5},
        {"flow_ratio": 1.2},
        {"resolution": 0},
        {"planner.kind": "area", "planner.aligned": True},
        {"min_layer_time": 60},
        {"speeds.travel": 500},
        {"start_gcode": "G28\nM109 S{nozzle_temperature}\n", "end_gcode": "M104 S0\n"},
    ],
    ids=lambda changes: ",".join(f"{key}={value}".partition("\n")[0] for key, value in changes.items()),
)
def test_settings_do_not_break_the_rehearsal(changes: dict[str, object], tmp_path: Path) -> None:
    profile = profile_with(PROFILE, changes)
    verdict = dry_run(job_from(scaled(tmp_path, 8, 8, 1), profile), profile)

    assert verdict.problems == ()


def test_a_printer_with_its_origin_in_the_middle_of_the_bed_prints_inside_it(tmp_path: Path) -> None:
    profile = profile_with(
        PROFILE, {"origin": "centre", "start_gcode": "G28\nM109 S210\n", "end_gcode": "M104 S0\n"}
    )
    verdict = dry_run(job_from(scaled(tmp_path, 8, 8, 1), profile), profile)

    assert verdict.problems == ()
    assert verdict.report.extrusion_min is not None
    assert verdict.report.extrusion_min[0] < 0 < verdict.report.extrusion_max[0]  # type: ignore[index]


def test_a_printer_without_a_heated_bed_is_never_asked_to_heat_it(tmp_path: Path) -> None:
    cold = {"max_bed_temperature": 0, "bed_temperature": 0, "first_layer_bed_temperature": 0}
    profile = profile_with(PROFILE, cold)
    verdict = dry_run(job_from(scaled(tmp_path, 8, 8, 1), profile), profile)

    assert verdict.problems == ()


def test_a_part_as_wide_as_the_bed_is_printed_inside_it_or_refused(tmp_path: Path) -> None:
    """Skirt and brim need room too: a part that passes as small enough must not lead the nozzle off the bed."""
    profile = profile_with(
        PROFILE, {"bed_x": 40, "bed_y": 40, "start_gcode": "G28\nM109 S210\n", "end_gcode": "M104 S0\n"}
    )
    verdict = dry_run(job_from(scaled(tmp_path, 39.5, 39.5, 0.6), profile), profile)

    assert verdict.problems == ()


def test_a_part_as_high_as_the_printer_is_printed(tmp_path: Path) -> None:
    low = profile_with(PROFILE, {"bed_z": 20, "min_layer_time": 0})
    verdict = dry_run(job_from(scaled(tmp_path, 6, 6, 20), low), low)

    assert verdict.problems == ()


def test_the_same_job_gives_the_same_verdict_every_time(tmp_path: Path) -> None:
    job = job_from(scaled(tmp_path, 8, 8, 1), PROFILE)

    assert dry_run(job, PROFILE) == dry_run(job, PROFILE)


def test_a_sliced_job_and_its_text_from_a_file_come_to_the_same(tmp_path: Path) -> None:
    job = job_from(scaled(tmp_path, 8, 8, 1), PROFILE)
    here, there = dry_run(job, PROFILE), rehearsed(tmp_path, job.text)

    assert there.ok
    assert (there.heights, there.report) == (here.heights, here.report)


def test_what_is_executed_has_the_digest_of_the_commands() -> None:
    job = job_from(PARTS / "box.stl", PROFILE)
    comparison = Comparison(job.commands)
    for command in job.commands:
        comparison(command.decode("latin-1"))

    assert comparison.executed == len(job.commands)
    assert comparison.digest == sha256(b"".join(command + b"\n" for command in job.commands)).hexdigest()


def test_the_verdict_can_be_written_as_json(tmp_path: Path) -> None:
    job = job_from(scaled(tmp_path, 8, 8, 1), PROFILE)
    verdict = dry_run(job, PROFILE)

    assert (
        json.loads(json.dumps(collect_verdict_facts(verdict, job, PROFILE), allow_nan=False))["job"]
        == verdict.job
    )


def test_the_host_tells_what_happens(tmp_path: Path) -> None:
    job = job_from(scaled(tmp_path, 8, 8, 1), PROFILE)
    heard: list[Event] = []
    dry_run(job, PROFILE, on_event=heard.append)
    accepted = [event.acknowledged for event in heard if isinstance(event, Accepted)]

    assert sum(isinstance(event, Identified) for event in heard) == 1
    assert accepted == sorted(set(accepted))
    assert isinstance(heard[-1], Finished)
    assert heard[-1].acknowledged == len(job.commands)
    assert heard[-1].verified is True


# G-code of others: what is fine must pass


@pytest.mark.parametrize(
    "text",
    [
        "G1 X50 Y50 Z0.2 F3000\nG1 X60 E1\n",
        "M82\nG92 E0\nG1 X50 Y50 Z0.2 F3000\nG1 X60 E1\nG1 X50 E2\n",
        "M203 X20 Y20 ; slower axes\nM201 X100 Y100\nG1 X100 Y100 F9000\nG1 X0 Y0\n",
        "M205 X1 Y1\n" + "".join(f"G1 X{i % 50} Y{i % 7} F6000\n" for i in range(60)),
        "M204 P300 T200\nG1 X100 F9000\nG1 X0\n",
        "M220 S50\nG1 X100 F6000\nG1 X0\n",
        "G1 X50 Y50 Z0.2 F3000\nG2 X60 Y50 I5 J0 E1\nG3 X50 Y50 I-5 J0\n",
        "G1 X50 Y50 F3000\nG2 X60 Y50 R5\n",
        "G20\nG1 X1 Y1 F100\nG21\n",
        "G91\nG1 X5 Y5 F3000\nG90\n",
        "M117 Größe 5 µm\nG1 X50 F3000\n",
        "M73 P0 R5\nT0\nM106 S255\nM107\nG1 X50 F3000\n",
        "G92 X10\nG1 X60 F3000\n",
        "G4 S3\nG4 P1500\n",
        "M400\nM114\nM105\nM115\nG1 X5 F3000\n",
        "G28 X\nG28 Y Z\nG1 X5 F3000\n",
        "G1X50Y50Z0.2F3000\nG1X60E1\n",
        "G1 X 50 Y 50 F 3000\n",
        "G0 X50 F3000\nG01 X60\nG00 X50\n",
        "M302 P1\nG1 E5 F300\n",
    ],
    ids=lambda text: text[:24].replace("\n", " | "),
)
def test_sound_gcode_of_others_passes(text: str, tmp_path: Path) -> None:
    verdict = rehearsed(tmp_path, READY + text + DONE)

    assert verdict.problems == ()
    assert verdict.modelled_seconds == pytest.approx(verdict.simulated_seconds, rel=0.01)


@pytest.mark.parametrize(
    "text",
    [
        "N1 G28*18\nN2 G1 X5 F3000*" + str(0x4F) + "\n",
        "G28\nM110 N0\nG1 X5 F3000\n",
        "M110 N0\nG28\n",
    ],
    ids=["numbers and checksums", "M110 in the middle", "M110 first"],
)
def test_a_file_with_its_own_line_numbers_is_executed_as_sent(text: str, tmp_path: Path) -> None:
    verdict = rehearsed(tmp_path, text)

    assert verdict.identical
    assert verdict.problems == ()


def test_gcode_for_klipper_passes_on_a_printer_with_klipper(tmp_path: Path) -> None:
    profile = load_profile("corexy_klipper", "pla", "standard")
    text = (
        "SET_VELOCITY_LIMIT ACCEL=3000\nSET_PRESSURE_ADVANCE ADVANCE=0.04\n" + READY + "G1 X50 F3000\n" + DONE
    )

    assert rehearsed(tmp_path, text, profile).problems == ()


# What is wrong is named, with its line


WRONG = [
    ("leaves the bed in x", READY + "G1 X500 F3000\n", "X500"),
    ("leaves the bed in y", READY + "G1 Y-5 F3000\n", "Y-5"),
    ("leaves the machine in z", READY + "G1 Z500 F300\n", "Z500"),
    ("extrudes cold", "G28\nG1 X5 E5 F3000\n", "E5"),
    ("extrudes after cooling down", READY + "M109 R50\nG1 X5 E5 F3000\n", "E5"),
    ("moves before homing", "G1 X50 F3000\n", "X50"),
    ("moves before all axes are homed", "G28 X\nG1 Y50 F3000\n", "Y50"),
    ("is too hot for the nozzle", READY + "M104 S500\n", "M104 S500"),
    ("is too hot for the bed", READY + "M140 S180\n", "M140 S180"),
    ("asks for what nobody knows", READY + "M9999\n", "M9999"),
    ("is no G-code", "hello world\n", "hello world"),
    ("wants another extruder", READY + "T1\n", "T1"),
]


@pytest.mark.parametrize(("text", "culprit"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_a_file_that_cannot_be_printed_is_refused_and_the_command_is_quoted(
    text: str, culprit: str, tmp_path: Path
) -> None:
    verdict = rehearsed(tmp_path, text)

    assert not verdict.ok
    assert any(culprit in problem for problem in verdict.problems)


@pytest.mark.parametrize(("text", "culprit"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_the_line_that_a_problem_names_is_the_line_of_the_file(
    text: str, culprit: str, tmp_path: Path
) -> None:
    padded = "; a long header\n\n" * 20 + text.replace("\n", " ; a comment\n;LAYER_CHANGE\n")
    line = next(i for i, line in enumerate(padded.splitlines(), start=1) if culprit in line)
    verdict = rehearsed(tmp_path, padded)

    assert any(re.match(rf"line {line}\b", problem) for problem in verdict.problems), verdict.problems


def test_a_file_that_halts_the_printer_says_so(tmp_path: Path) -> None:
    verdict = rehearsed(tmp_path, READY + "M112\nG1 X5 F3000\n")

    assert not verdict.ok
    assert not verdict.identical
    assert any("halted" in problem for problem in verdict.problems)
    line = (READY + "M112").count("\n") + 1
    assert f"line {line}: emergency stop: M112" in verdict.problems


@pytest.mark.parametrize("text", ["M0\n", "M1 press the button\n", "M0 S0\n"])
def test_a_file_that_waits_for_a_person_does_not_wait_for_ever(text: str, tmp_path: Path) -> None:
    path = tmp_path / "pause.gcode"
    path.write_text(READY + text + "G1 X5 F3000\n", encoding="utf-8")
    job, heard = job_from(path, PROFILE), 0

    def listen(_: Event) -> None:
        nonlocal heard
        heard += 1
        if heard > 5000:  # reports of a printer that is busy; nobody will ever press its button
            raise TimeoutError("it would wait for ever")

    verdict = dry_run(job, PROFILE, on_event=listen)

    assert verdict.commands == len(job.commands)


def test_many_problems_are_counted_and_not_all_told(tmp_path: Path) -> None:
    verdict = rehearsed(tmp_path, READY + "".join(f"G1 X{500 + i} F3000\n" for i in range(100)))

    assert len(verdict.problems) < 30
    assert any("times)" in problem for problem in verdict.problems)
    assert verdict.report.n_violations >= 100


def test_a_foreign_file_that_melts_too_much_plastic_is_found(tmp_path: Path) -> None:
    verdict = rehearsed(tmp_path, READY + "G1 X50 Y50 Z0.2 F3000\nG1 X60 E20 F6000\n")

    assert any("mm³/s" in problem for problem in verdict.problems)


def test_another_job_than_the_one_executed_is_not_identical() -> None:
    comparison = Comparison((b"G28", b"G1 X5"))
    for text in ("G28", "G1 X6", "G1 X5"):
        comparison(text)

    assert comparison.executed == 2
    assert comparison.unexpected == [(1, "G1 X6")]


@given(st.lists(st.sampled_from(["G28", "G1 X5", "G1 X6", "M105", "M400"]), max_size=8))
def test_a_comparison_counts_what_comes_in_order_and_tells_what_does_not(lines: list[str]) -> None:
    job = ("G28", "G1 X5", "M400", "G1 X5")
    comparison = Comparison(tuple(line.encode() for line in job))
    for line in lines:
        comparison(line)
    done = [job[at] for at in range(comparison.due) if at not in comparison.skipped]
    rest = iter(lines)

    assert comparison.executed == len(done)
    assert all(line in rest for line in done)  # in order, others between
    assert comparison.digest == sha256("".join(f"{line}\n" for line in done).encode()).hexdigest()
    assert comparison.n_unexpected <= len(lines) - comparison.executed
    assert all(text not in ("M105", "M400") for _, text in comparison.unexpected)


# Any commands at all


COMMANDS = st.lists(
    st.sampled_from(
        ["G28", "G1 X5", "G1 X9 Y9 F1200", "G1 Z1", "G91", "G90", "G1 E1", "M106 S9", "G4 P5", "M83"]
    ),
    min_size=1,
    max_size=12,
)


@given(COMMANDS)
def test_whatever_is_sent_is_executed_once_and_in_order(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str]
) -> None:
    verdict = rehearsed(tmp_path_factory.getbasetemp(), "\n".join(lines))

    assert verdict.identical
    assert verdict.executed == len(lines)
    assert not [
        problem
        for problem in verdict.problems
        if "the host stopped" in problem or "unexpected command" in problem
    ]


# The machine of a profile


def test_the_machine_has_the_bed_the_limits_and_the_heaters_of_the_profile() -> None:
    printer = PROFILE.printer
    machine = machine_of(printer)

    assert list(machine.box_min) == [0, 0, 0]
    assert machine.box_max[:2] == (printer.bed_x, printer.bed_y)
    assert machine.box_max[2] >= printer.bed_z
    assert machine.hotend.highest == printer.max_nozzle_temperature
    assert machine.bed.highest == printer.max_bed_temperature
    assert machine.limits.max_speed == (
        printer.max_speed_x,
        printer.max_speed_y,
        printer.max_speed_z,
        printer.max_speed_e,
    )


def test_a_bed_with_its_origin_in_the_middle_reaches_as_far_to_both_sides() -> None:
    machine = machine_of(profile_with(PROFILE, {"origin": "centre"}).printer)

    assert machine.box_min[:2] == (-PROFILE.printer.bed_x / 2, -PROFILE.printer.bed_y / 2)
    assert machine.box_max[:2] == (PROFILE.printer.bed_x / 2, PROFILE.printer.bed_y / 2)


def test_only_klipper_takes_extended_words() -> None:
    assert simulated_firmware_for(load_profile("corexy_klipper").printer).ignores_extended
    assert not simulated_firmware_for(PROFILE.printer).ignores_extended


def test_a_job_can_be_rehearsed_on_a_bed_so_large_that_it_heats_slowly(tmp_path: Path) -> None:
    large = profile_with(PROFILE, {"bed_x": 1000, "bed_y": 1000})
    job: Job = job_from(scaled(tmp_path, 8, 8, 0.6), large)

    assert dry_run(job, large).problems == ()


def test_a_job_of_weeks_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "slip.gcode"
    path.write_text("G28\nG4 S3000000\nM104 S0\n")
    profile = load_profile()

    with pytest.raises(VerificationError, match=r"slip\.gcode: 35 days of motion and waiting") as caught:
        dry_run(job_from(path, profile), profile)

    assert "dwells" in caught.value.remedy
