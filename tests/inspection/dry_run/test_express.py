"""Lines that only take their times, against the same lines sent byte by byte through host, cable and firmware."""

from __future__ import annotations

from dataclasses import asdict
from math import cos, sin
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.inspection.deposition.marks import Defect
from printer_slicer.inspection.dry_run.fast_runner import FastRunner
from printer_slicer.inspection.dry_run.judging import Verdict
from printer_slicer.inspection.dry_run.machines import machine_of
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.jobs import Job
from printer_slicer.link_model import SerialLink
from printer_slicer.profile import Profile, load_profile, profile_with
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.slice_jobs import job_from, job_of
from printer_slicer.stream.events import Accepted, Event, Finished
from printer_slicer.stream.protocol import Streamer
from tests.effort import crossed
from tests.parts import cone

PROFILE = load_profile("marlin_220", "pla", "standard", {"speeds.travel": 150})
READY = ["M104 S210", "G28", "M109 S210", "G90", "M83", "G1 Z0.2 F600"]


def job_of_lines(folder: Path, lines: list[str], profile: Profile) -> Job:
    """The job that some lines are."""
    path = folder / "job.gcode"
    path.write_text("\n".join(lines) + "\n")
    return job_from(path, profile)


def curve(step: float, count: int, feed: int) -> list[str]:
    """Short moves around a circle that a slow link cannot bring in time."""
    places = ((110 + 40 * cos(i * step / 40), 110 + 40 * sin(i * step / 40)) for i in range(count))
    return [f"G1 F{feed}", *(f"G1 X{x:.3f} Y{y:.3f} E0.01" for x, y in places)]


def leaves(value: Any, name: str = "") -> dict[str, Any]:
    """All numbers and texts of nested values by their names."""
    if isinstance(value, dict):
        return {
            key: leaf
            for part, inner in value.items()
            for key, leaf in leaves(inner, f"{name}.{part}").items()
        }
    if isinstance(value, (list, tuple)):
        return {
            key: leaf for at, inner in enumerate(value) for key, leaf in leaves(inner, f"{name}.{at}").items()
        }
    return {name: value}


def same(quick: Verdict, slow: Verdict, *, seconds: float = 1e-6) -> None:
    """Assert that two verdicts are the same, their times to rounding."""
    one, other = leaves(facts(quick)), leaves(facts(slow))
    late = abs(quick.total_seconds - slow.total_seconds)

    assert one.keys() == other.keys()
    wrong = [
        (name, value, other[name])
        for name, value in one.items()
        if not alike(name, value, other[name], seconds, late)
    ]
    assert wrong == []


PEAK_FLOW = f".deposition.peak.{Defect._fields.index('amount')}"


MACHINE = machine_of(PROFILE.printer)
FASTEST = {
    ".report.peak_hotend": MACHINE.hotend.power / MACHINE.hotend.heat_capacity,
    ".report.peak_bed": MACHINE.bed.power / MACHINE.bed.heat_capacity,
}
"""°C in a second that a heater can gain: one that still warms up at the end becomes hotter in a longer print."""


def alike(name: str, value: Any, other: Any, seconds: float, late: float) -> bool:
    """Whether two facts of the same name are the same, of prints of which one took so many seconds longer."""
    if (
        name.startswith(".deposition.peak.") and name != PEAK_FLOW
    ):  # which of many with the same flow, to rounding
        return True
    if name in FASTEST:  # how hot it became is looked at now and then, and less often here
        looked_at = 0.05 if name == ".report.peak_hotend" else 1e-4
        return bool(value == pytest.approx(other, abs=looked_at + FASTEST[name] * late))
    if (
        name == ".total_seconds"
    ):  # so long may take what a host asks in silences, and of a place that is another one
        seconds = max(seconds, 0.25)
    return bool(value == (pytest.approx(other, rel=1e-6, abs=seconds) if isinstance(value, float) else other))


def facts(verdict: Verdict) -> dict[str, Any]:
    """Return everything but the height map, and the questions that a host asks in long silences."""
    found = asdict(verdict)
    timeline = found["deposition"]["timeline"]
    timeline.update({name: timeline[name].tolist() for name in ("speed", "command")})
    del found["deposition"]["plate"], found["report"]["lines"], found["report"]["digest"]
    return found


@pytest.mark.parametrize(
    ("baud", "way"),
    crossed([9600, 38400, 115200, 1_000_000], [(0.05, 6000), (0.3, 3000), (1.5, 9000), (20.0, 4800)]),
)
def test_a_curve_is_executed_as_over_the_wire(baud: int, way: tuple[float, int], tmp_path: Path) -> None:
    step, feed = way
    job = job_of_lines(tmp_path, [*READY, *curve(step, 400, feed), "M104 S0"], PROFILE)
    quick, slow = (dry_run(job, PROFILE, baud=baud, every_byte=every) for every in (False, True))

    same(quick, slow)


def test_most_of_a_curve_is_reckoned_at_once(tmp_path: Path) -> None:
    """Else the comparison would compare the slow way with itself."""
    job = job_of_lines(tmp_path, [*READY, *curve(1.5, 2000, 3000), "M104 S0"], PROFILE)
    printer = SimulatedPrinter(machine_of(PROFILE.printer))
    port = VirtualPort(printer, baud=115200, latency=0.001)
    express = FastRunner(printer, port, SerialLink(115200, 0.001, 0.001), lambda _: None)
    express.run_handshake(Streamer(job.commands[:1]))

    assert express.execute(job.commands, lambda _: None) == len(job.commands)
    assert express.batched > len(job.commands) - 60


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"relative_extrusion": False},
        {"corner": "junction_deviation"},
        {"corner": "square_corner"},
        {"printer.z_hop": 0.4, "travel_acceleration": 1500},
        {"firmware_retraction": True},
        {"arc_tolerance": 0.02},
        {"accelerations.external_perimeter": 500},
        {"receive_buffer": 64},
        {"flavour": "prusa"},
        {"flavour": "reprapfirmware"},
        {"flavour": "klipper", "minimum_cruise_ratio": 0.5, "corner": "square_corner"},
    ],
    ids=str,
)
def test_a_sliced_part_is_executed_as_over_the_wire(changes: dict[str, object]) -> None:
    profile = profile_with(PROFILE, changes)
    job = job_of(cone(4.0, 1.0), profile_with(profile, {"thinnest_layer": 0.3, "infill_density": 0.05}))
    quick, slow = (dry_run(job, profile, every_byte=every) for every in (False, True))

    same(quick, slow, seconds=1e-3)


MOVES = st.builds(
    "G1 X{} Y{}{}{}".format,
    st.floats(60, 160).map("{:.2f}".format),
    st.floats(60, 160).map("{:.2f}".format),
    st.sampled_from(["", " E0.5", " E0.05", " E-1"]),
    st.sampled_from(["", "", "", " F1200", " F9000", " F60000"]),
)
NEAR = st.lists(
    st.sampled_from(["G1 X100.1 Y100", "G1 X100 Y100.1", "G1 X100 Y100 E0.01", "G1 X100"]), min_size=1
)
BETWEEN = st.sampled_from(
    [
        *("M204 P400 T900", "M106 S127", "M107", "M73 P5 R1", "M117 here", "G92 E0", "M104 S215", "M104 S60"),
        *(
            "M140 S50",
            "G4 P300",
            "M400",
            "M205 X5 Y5",
            "M220 S60",
            "M221 S120",
            "M200 D1.75",
            "M84",
            "G91",
            "G90",
            "M82",
            "M83",
        ),
        *("G92 X100", "M114"),
        *("G1 X500", "G1 E300", "G2 X110 Y110 I5 J5 E0.1", "G28 X", "M9999", "T0", "M155 S1", "M18"),
    ]
)


@given(
    st.lists(
        st.one_of(
            st.lists(MOVES, min_size=1, max_size=120),
            NEAR.map(lambda few: few * 20),
            st.tuples(BETWEEN).map(list),
        ),
        max_size=8,
    ),
    st.sampled_from([19200, 115200, 250000]),
)
def test_any_job_is_executed_as_over_the_wire(
    tmp_path_factory: pytest.TempPathFactory, pieces: list[list[str]], baud: int
) -> None:
    lines = [*READY, *(line for piece in pieces for line in piece)]
    job = job_of_lines(tmp_path_factory.getbasetemp(), lines, PROFILE)
    quick, slow = (dry_run(job, PROFILE, baud=baud, every_byte=every) for every in (False, True))

    # The answers to G92 are taken for as long as they are where the plan ends.
    same(quick, slow, seconds=2e-3)


@pytest.mark.parametrize("heat", ["M140 S50", "M104 S240"])
@pytest.mark.parametrize("baud", [19200, 115200])
def test_a_heater_that_still_warms_up_at_the_end_is_as_hot_as_the_print_is_long(
    heat: str, baud: int, tmp_path: Path
) -> None:
    """The questions of a host that waits take up to a quarter of a second, and are left out by the fast way."""
    job = job_of_lines(tmp_path, [*READY, "G1 X60 Y101", heat, "G91", "G1 X60 Y60", "G1 X60 Y60"], PROFILE)
    quick, slow = (dry_run(job, PROFILE, baud=baud, every_byte=every) for every in (False, True))

    assert quick.total_seconds != slow.total_seconds
    same(quick, slow, seconds=2e-3)


def test_of_stops_as_long_as_each_other_the_first_is_named(tmp_path: Path) -> None:
    """Lines that come again and again stop the machine for as long each time, but for rounding."""
    moves = {"x": "G1 X100.1 Y100", "y": "G1 X100 Y100.1", "e": "G1 X100 Y100 E0.01", "-": "G1 X100"}
    before, again = "xxxxx-xxxxxxxyxxxxxxxxxxx-xe", "xe-e--xxxxxxxyx-xxxxxxxxxxx-xe"
    pieces = [*before * 20, *"e" * 20, None, *again * 20]
    lines = [*READY, *("G1 E300" if piece is None else moves[piece] for piece in pieces)]
    job = job_of_lines(tmp_path, lines, PROFILE)
    quick, slow = (dry_run(job, PROFILE, baud=19200, every_byte=every) for every in (False, True))

    for verdict in (quick, slow):
        most = max(seconds for _, seconds in verdict.report.underrun_list)
        assert sum(seconds > most - 1e-6 for _, seconds in verdict.report.underrun_list) > 1
    same(quick, slow, seconds=2e-3)


def test_an_answer_may_come_behind_a_line_that_says_busy(tmp_path: Path) -> None:
    """A command that waits for a place for some milliseconds more than twelve seconds is answered late."""
    first, then = ["G1 X60.00 Y60.00", *["G1 X100.1 Y100"] * 20], ["G1 X100 Y100 E0.01"] * 2
    lines = [*READY, *first, "G1 X500", *[*then, "G1 X100.1 Y100"] * 20]
    job = job_of_lines(tmp_path, lines, PROFILE)
    quick, slow = (dry_run(job, PROFILE, baud=19200, every_byte=every) for every in (False, True))

    same(quick, slow)


def test_the_host_is_told_how_it_goes(tmp_path: Path) -> None:
    job = job_of_lines(tmp_path, [*READY, *curve(1.5, 20_000, 6000), "M104 S0"], PROFILE)
    heard: list[Event] = []
    dry_run(job, PROFILE, on_event=heard.append)
    accepted = [event.acknowledged for event in heard if isinstance(event, Accepted)]

    assert accepted == sorted(set(accepted))
    assert accepted[-1] == len(job.commands)
    assert isinstance(heard[-1], Finished)
    assert heard[-1].verified is True
