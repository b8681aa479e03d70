"""Moves: how long they take, when they are answered, where they end and what they lay."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from hashlib import sha256
from math import hypot, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_console import COLD_OK, NIMBLE, Console

from printer_slicer.motion.rules import Block, compute_block_times, make_block
from printer_slicer.sim.firmwares import KLIPPER, MARLIN_2_1_ADVANCED
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.statistics import Statistics
from tests.effort import examples

LIMITS = Machine().limits


def blocks(points: list[tuple[float, float]], speed: float) -> list[Block]:
    """The moves from one point to the next, beginning at 0, 0."""
    pairs = zip([(0.0, 0.0), *points], points, strict=False)
    made = [make_block(LIMITS, (x - a, y - b, 0.0, 0.0), speed) for (a, b), (x, y) in pairs]
    return [block for block in made if block is not None]


def place(console: Console) -> dict[str, float]:
    """X, Y, Z and E as M114 says them."""
    words = console.say("M114")[0].split(" Count")[0].split()
    return {word[0]: float(word[2:]) for word in words}


@settings(max_examples=examples(40))
@given(
    points=st.lists(st.tuples(st.floats(0.0, 200.0), st.floats(0.0, 200.0)), min_size=1, max_size=40),
    speed=st.sampled_from([20.0, 60.0, 200.0]),
)
def test_a_fed_planner_takes_as_long_as_the_plan_of_the_whole(
    points: list[tuple[float, float]], speed: float
) -> None:
    points = [(round(x, 1), round(y, 1)) for x, y in points]
    console = Console()
    console.do(f"G1 F{speed * 60:.0f}")
    console.do(*[f"G1 X{x} Y{y}" for x, y in points], "M400")

    # Moves shorter than the braking distance make the sixteen blocks of the firmware a little slower.
    expected = sum(compute_block_times(blocks(points, speed), LIMITS))
    assert expected - 1e-9 <= console.printer.report().motion_seconds <= expected * 1.02 + 1e-9
    assert console.printer.report().underruns == 0


def test_long_moves_take_exactly_as_long_as_planned_on_the_clock_too() -> None:
    points = [(100.0, 0.0), (100.0, 100.0), (0.0, 100.0), (0.0, 0.0)]
    console = Console()
    console.do("G1 F6000", *[f"G1 X{x} Y{y}" for x, y in points], "M400")

    assert console.now == pytest.approx(sum(compute_block_times(blocks(points, 100.0), LIMITS)), rel=1e-12)


def test_a_full_planner_holds_back_the_ok_until_a_move_is_made() -> None:
    # Recorded: 30 moves of 0.2 s pasted at once; the first oks within 3 ms, then one every 0.20 s.
    console = Console(machine=NIMBLE)

    at_once = console.say(*[f"G1 X{n} F300" for n in range(1, 31)])
    later = [seconds for seconds, line in console.wait(20.0) if line == "ok"]

    assert at_once == ["ok"] * 15
    assert len(later) == 15
    assert later == pytest.approx([0.2 * n for n in range(1, 16)], abs=0.01)


def test_a_standing_machine_waits_a_moment_for_more_moves_unless_there_are_three() -> None:
    one, three = Console(), Console()
    one.do("G1 X5 F300", "M400")
    three.do("G1 X1 F300", "G1 X2", "G1 X5", "M400")

    assert one.now == pytest.approx(three.now + 0.1)


def test_m400_is_answered_when_everything_was_made_with_busy_meanwhile() -> None:
    console = Console(machine=NIMBLE)
    console.do("G1 X50 F600")

    assert console.say("M400") == []
    heard = console.wait(10.0)
    assert heard[-1][0] == pytest.approx(5.0, abs=0.01)
    assert heard[-1][1] == "ok"
    assert [line for _, line in heard[:-1]] == ["echo:busy: processing"] * 2


def test_a_planner_that_runs_dry_between_moves_is_counted_as_starved() -> None:
    console = Console(machine=NIMBLE)
    for n in range(1, 6):
        console.do(f"G1 X{n} F600")
        console.wait(0.5)

    report = console.printer.report()
    assert report.underruns == 4
    assert report.underrun_seconds == pytest.approx(4 * (0.5 - report.motion_seconds / 5))


def test_standing_still_on_purpose_or_for_long_is_no_starvation() -> None:
    console = Console(machine=NIMBLE)
    console.do("G1 X10 F600", "M400", "G1 X20", "G4 P100", "G1 X30")
    console.wait(60.0)
    console.do("G1 X40", "M109 S50", "G1 X50", "M400")

    assert console.printer.report().underruns == 0


def test_m114_tells_the_end_of_the_plan_and_the_steps_of_now() -> None:
    console = Console(machine=NIMBLE)
    console.do("G1 X50 F600")
    console.wait(2.5)

    words = console.say("M114")[0].split()
    assert words[0] == "X:50.00"
    assert int(words[5][2:]) == pytest.approx(25.0 * 80.0, rel=0.01)
    console.wait(10.0)
    assert console.say("M114")[0].split()[5] == "X:4000"


def test_moves_are_absolute_or_relative_and_g90_and_g91_rule_the_extruder_too() -> None:
    console = Console(machine=COLD_OK)
    console.do("G91", "G1 X10 E1", "G1 X10 E1")
    assert place(console) == {"X": 20.0, "Y": 0.0, "Z": 0.0, "E": 2.0}

    console.do("M82", "G1 X10 E1")
    assert place(console) == {"X": 30.0, "Y": 0.0, "Z": 0.0, "E": 1.0}

    console.do("G90", "M83", "G1 X5 E1")
    assert place(console) == {"X": 5.0, "Y": 0.0, "Z": 0.0, "E": 2.0}

    console.do("G90", "G1 X6 E0.5")
    assert place(console) == {"X": 6.0, "Y": 0.0, "Z": 0.0, "E": 0.5}


def test_g92_shifts_what_the_program_sees_and_homing_takes_it_back() -> None:
    console = Console()
    console.do("G1 X10 Y10", "G92 X0", "G1 X5 Y20", "M400")
    assert place(console) == {"X": 5.0, "Y": 20.0, "Z": 0.0, "E": 0.0}
    assert console.say("M114")[0].endswith("Count X:1200 Y:1600 Z:0")

    console.do("G28 X")
    assert place(console) == {"X": 0.0, "Y": 20.0, "Z": 0.0, "E": 0.0}


def test_inches_are_understood() -> None:
    console = Console()
    console.do("G20", "G1 X2", "G21")

    assert place(console)["X"] == 50.8


@pytest.mark.parametrize("text", ["G1 X10 Y5 F600", "G1 F600 Y5 X10", "G1X10Y5F600", "G0 X+10. Y5.0 F600 S3"])
def test_the_order_and_spacing_of_words_does_not_matter(text: str) -> None:
    console = Console(machine=NIMBLE)
    console.do(text, "M400")

    assert place(console) == {"X": 10.0, "Y": 5.0, "Z": 0.0, "E": 0.0}
    assert console.now == pytest.approx(sum(compute_block_times(blocks([(10.0, 5.0)], 10.0), LIMITS)))


def test_an_e_behind_a_number_is_an_axis_and_not_an_exponent() -> None:
    console = Console(machine=COLD_OK)
    console.do("G1 X10E5")

    assert place(console) == {"X": 10.0, "Y": 0.0, "Z": 0.0, "E": 5.0}


def test_feed_and_flow_ratios_and_new_limits_change_time_and_filament() -> None:
    def seconds(*setup: str) -> float:
        console = Console(machine=NIMBLE)
        console.do(*setup, "G1 X200 F6000", "M400")
        return console.printer.report().motion_seconds

    plain = seconds()

    assert seconds("M220 S50") == pytest.approx(2.0 * plain, rel=0.05)
    assert seconds("M203 X50") == pytest.approx(2.0 * plain, rel=0.05)
    assert seconds("M201 X100") > seconds("M204 T500") > seconds("M204 S1000") > plain
    assert seconds("M204 P100 R100") == plain

    console = Console(machine=COLD_OK)
    console.do("M221 S50", "M83", "G1 X10 E2")
    assert console.say("M221") == ["echo:E0 Flow: 50%", "ok"]
    assert console.printer.report().filament == pytest.approx(1.0)


AREA = pi * 1.75**2 / 4


@pytest.mark.parametrize(
    ("before", "fed"),
    [
        (["M200 D1.75"], 10 / AREA),
        (["M200 D1.75", "M200 S0"], 10),
        (["M200 D1.75", "M200 D0"], 10),
        (["M200 D1.75", "M200 D0", "M200 S1"], 10 / AREA),
        (["M200 S1"], 10 / AREA),
        (["M200 D0." + 200 * "0" + "1"], 10),
        (["M200"], 10),
        (["M200 D1.75", "M221 S50"], 5 / AREA),
        (["G20", "M200 S1"], 10 * 25.4**3 / AREA),
        (["M200 S1", "G20", "G21"], 10 / AREA),
    ],
    ids=str,
)
def test_e_may_be_a_volume(before: list[str], fed: float) -> None:
    console = Console(machine=replace(COLD_OK, longest_extrusion=1e9))
    console.do(*before, "G1 E10 F100000", "M400")

    assert console.printer.report().filament_fed == pytest.approx(fed)


def test_firmware_retraction_is_a_length_whatever_e_is() -> None:
    console = Console(machine=COLD_OK)
    console.do("M207 S4", "M200 D1.75", "M221 S50", "G10", "G11", "M400")

    assert console.printer.report().filament_retracted == pytest.approx(4)


@pytest.mark.parametrize(("setup", "speed"), [("M207 S4 F240", 4.0), ("M207 S4 F480", 8.0)])
def test_firmware_retraction_has_its_speed_in_mm_per_minute(setup: str, speed: float) -> None:
    console = Console(machine=COLD_OK)
    console.do(setup, "M208 F60000", "G10", "M400")
    retracted = console.printer.report().motion_seconds

    assert retracted == pytest.approx(4 / speed, rel=0.3)


def test_klipper_does_not_know_e_as_a_volume() -> None:
    console = Console(replace(MARLIN_2_1_ADVANCED, dialect="klipper"), COLD_OK)
    console.do("M200 D1.75", "G1 E10", "M400")

    assert console.printer.report().filament_fed == 10
    assert console.printer.report().violation_counts["unknown command"] == 1


def test_a_larger_junction_deviation_makes_corners_faster() -> None:
    def seconds(*setup: str) -> float:
        console = Console(machine=NIMBLE)
        console.do(*setup, "G1 X50 F6000", "G1 Y50", "G1 X0", "M400")
        return console.printer.report().motion_seconds

    assert seconds("M205 J0.1") < seconds() == seconds("M205 J0")


@given(
    radius=st.floats(1.0, 50.0).map(lambda r: round(r, 3)),
    clockwise=st.booleans(),
    turn=st.sampled_from(["half", "full"]),
)
def test_an_arc_is_as_long_as_the_circle_it_follows(radius: float, clockwise: bool, turn: str) -> None:
    code = "G2" if clockwise else "G3"
    console = Console(machine=NIMBLE)
    console.do("G1 X100 Y100 F6000", "M400")
    before = console.printer.report().motion_seconds
    goal = f"X{100 + 2 * radius:.3f} " if turn == "half" else ""
    console.do(f"{code} {goal}I{radius} J0 F60", "M400")

    way = radius * pi * (1 if turn == "half" else 2)
    assert console.printer.report().motion_seconds - before == pytest.approx(way, rel=0.01)
    assert place(console)["X"] == pytest.approx(100 + (2 * radius if turn == "half" else 0), abs=0.01)


@pytest.mark.parametrize(
    ("radius", "share"), [("R10", 0.25), ("R-10", 0.75)], ids=["the short way", "the long way"]
)
@pytest.mark.parametrize("code", ["G2", "G3"])
def test_an_arc_by_radius_takes_the_way_that_its_sign_says(code: str, radius: str, share: float) -> None:
    console = Console(machine=COLD_OK)
    console.do("G1 X100 Y100 F6000", "M400")
    before = console.printer.report().motion_seconds
    console.do(f"{code} X110 Y110 {radius} E5 F60", "M400")

    report = console.printer.report()
    assert report.motion_seconds - before == pytest.approx(2 * pi * 10 * share, rel=0.01)
    assert report.filament == pytest.approx(5.0)
    assert report.extrusion_min is not None
    assert report.extrusion_max is not None
    bulges = {
        ("G2", "R10"): (100, 100, 110, 110),
        ("G3", "R10"): (100, 100, 110, 110),
        ("G2", "R-10"): (90, 100, 110, 120),
        ("G3", "R-10"): (100, 90, 120, 110),
    }
    assert (*report.extrusion_min[:2], *report.extrusion_max[:2]) == pytest.approx(
        bulges[code, radius], abs=0.02
    )


def test_an_arc_without_a_centre_is_refused() -> None:
    console = Console()

    assert console.say("G2 X10 Y10") == ["Error:G2/G3 bad parameters", "ok"]
    assert console.say("G2 R5") == ["Error:G2/G3 bad parameters", "ok"]


def test_a_move_out_of_the_machine_stops_at_its_edge_and_is_noted() -> None:
    console = Console()
    console.do("G28", "G1 X250 Y10 F6000", "G1 Z-1", "M400")

    assert place(console) == {"X": 200.0, "Y": 10.0, "Z": 0.0, "E": 0.0}
    assert console.printer.report().violations == (
        (2, "out of the machine: X 250.000, stopped at 200.000: G1 X250 Y10 F6000"),
        (3, "out of the machine: Z -1.000, stopped at 0.000: G1 Z-1"),
    )


@pytest.mark.parametrize("before", [[], ["G28", "M211 S0"]])
def test_without_guard_a_slip_of_a_number_ends_all_the_same(before: list[str]) -> None:
    console = Console()
    console.do(*before)
    console.do("G1 X" + 90 * "1", "M400")

    assert console.do("M114")[0].startswith("X:1200.00 Y:0.00")
    assert "out of the machine: X 1000000000.000, stopped at 1200.000" in str(
        console.printer.report().violations
    )


def test_soft_endstops_can_be_switched_off() -> None:
    console = Console()
    console.do("G28", "M211 S0", "G1 X250")

    assert place(console)["X"] == 250.0
    assert console.say("M211")[0].startswith("echo:Soft endstops: Off")


def test_moving_before_homing_is_noted_once_and_done() -> None:
    console = Console()
    console.do("G1 X250", "G1 X260")

    assert place(console)["X"] == 260.0
    assert console.printer.report().violations == ((1, "moved before homing: G1 X250"),)


@pytest.mark.parametrize(
    ("off", "again", "noted"),
    [
        ("M84", [], True),
        ("M18", [], True),
        ("M84 X", ["G28 Y"], True),
        ("M84 S60", [], False),
        ("M84 E", [], False),
        ("M84 X Y", ["G28 X", "G28 Y"], False),
        ("M84", ["G28"], False),
    ],
)
def test_laying_plastic_after_the_motors_were_off_is_noted_once(
    off: str, again: list[str], noted: bool
) -> None:
    console = Console(machine=COLD_OK)
    console.do("M302 P1", "G28", "G1 X10 E1", off, "G1 Z50", *again, "G1 X20 E2", "G1 X30 E3", "M400")
    texts = [one.text for one in console.printer.report().violations]

    assert texts == (["moved before homing, after the motors were off: G1 X20 E2"] if noted else [])


def test_klipper_forgets_the_homing_with_the_motors() -> None:
    console = Console(KLIPPER)
    console.do("G28", "G1 X10 Y10 Z5 F3000", "M84 X")

    assert console.do("G1 Y20") == ["!! Must home axis first: 10.000 20.000 5.000 [0.000]", "ok"]
    assert console.do("G28", "G1 Y20") == ["ok", "ok"]


def test_turning_the_extruder_is_no_move_that_needs_homing() -> None:
    console = Console(machine=COLD_OK)
    console.do("M302 P1", "G1 E-2")

    assert console.printer.report().n_violations == 0


def test_an_unbelievably_long_extrusion_is_refused() -> None:
    console = Console(machine=COLD_OK)

    assert console.say("G1 X10 E300") == ["echo: too long extrusion prevented", "ok"]
    assert console.printer.report().filament == 0.0


def test_violations_are_listed_up_to_a_bound_and_counted_beyond() -> None:
    console = Console()
    console.say(*["M9999"] * 1200)

    report = console.printer.report()
    assert report.n_violations == 1200
    assert len(report.violations) == 1000


def test_the_account_of_what_was_laid() -> None:
    console = Console(machine=COLD_OK)
    console.do("G28", "M83", "G1 Z0.2 F300", "G1 X10 Y10 F6000", "G1 X30 E1 F1200", "G1 E-2 F1800")
    console.do("G1 Z0.4", "G1 X5", "G1 E2", "G1 Y50 E3", "M400")

    report = console.printer.report()
    assert report.layers == (0.2, 0.4)
    assert report.extrusion_min == (5.0, 10.0, 0.2)
    assert report.extrusion_max == (30.0, 50.0, 0.4)
    assert report.filament_fed == pytest.approx(6.0)
    assert report.filament_retracted == pytest.approx(2.0)
    assert report.filament == pytest.approx(4.0)
    # 1 mm of filament over 20 mm of way at 20 mm/s is 1 mm/s; 3 over 40 at 30 is 2.25 mm/s.
    assert report.peak_flow == pytest.approx(2.25 * pi * 1.75**2 / 4)
    assert report.print_seconds == report.motion_seconds
    assert report.lines == 11


def test_the_digest_is_that_of_the_executed_commands() -> None:
    console = Console()
    lines = [f"G1 X{n % 100}" for n in range(1500)]
    console.do(*lines)

    assert console.executed == lines
    assert console.printer.report().digest == sha256("".join(f"{x}\n" for x in lines).encode()).hexdigest()


def test_memory_does_not_grow_with_the_print() -> None:
    def grown(n_lines: int) -> int:
        tracemalloc.start()
        console = Console(machine=COLD_OK)
        console.executed = None  # type: ignore[assignment]
        console.printer._on_executed = None
        for n in range(n_lines):
            console.do(f"G1 X{n % 200} Y{n * 7 % 200} E{n * 0.01:.3f} F12000")
        size = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
        return size

    assert grown(6000) < grown(1500) + 20_000


def test_a_long_way_round_is_as_long_as_its_sides() -> None:
    console = Console(machine=NIMBLE)
    console.do("G28", "G1 X30 Y40 F600", "M400")

    assert console.printer.report().motion_seconds == pytest.approx(hypot(30.0, 40.0) / 10.0, abs=0.01)


def test_jerk_machines_tell_their_jerk() -> None:
    console = Console(machine=replace(Machine(), limits=replace(LIMITS, corner="jerk")))
    console.do("M205 X8 E3")

    assert "  M205 B20000.00 S0.00 T0.00 X8.00 Y10.00 Z0.30 E3.00" in console.say("M503 S0")


def test_an_arc_that_m410_finds_waiting_is_lost_from_there_on() -> None:
    console = Console(MARLIN_2_1_ADVANCED, NIMBLE)
    console.do("G1 X100 Y100 F6000", "M400")
    began = console.printer.report().motion_seconds
    console.say("G3 I20 F600")
    console.wait(5.0)
    console.say("M410")
    console.wait(60.0)

    assert console.printer.report().motion_seconds - began == pytest.approx(5.0, abs=0.01)
    place_of_stop = place(console)
    assert hypot(place_of_stop["X"] - 120.0, place_of_stop["Y"] - 100.0) == pytest.approx(20.0, abs=0.1)


def test_an_arc_outside_the_machine_is_pressed_against_it() -> None:
    console = Console()
    console.do("G28", "G2 I-5 J-5 F3000", "M400")

    assert place(console) == {"X": 0.0, "Y": 0.0, "Z": 0.0, "E": 0.0}
    assert console.printer.report().n_violations > 20
    # Of the circle only the two pieces beyond the corner, up to 2.07 mm along either edge and back, are left.
    assert console.printer.report().motion_seconds < 1.0


@pytest.mark.parametrize(
    ("command", "waits"),
    [
        ("M84", True),
        ("M18", True),
        ("M900 K0.05", True),
        ("M84 S60", False),
        ("M17", False),
        ("M73 P50", False),
    ],
)
def test_commands_that_wait_for_standstill(command: str, waits: bool) -> None:
    console = Console(machine=NIMBLE)
    console.do("G1 X50 F600")

    assert console.say(command) == ([] if waits else ["ok"])
    console.wait(10.0)
    assert console.executed == ["G1 X50 F600", command]


def test_steps_per_mm_change_what_is_counted() -> None:
    console = Console()
    console.do("M92 X100", "G1 X10 F6000", "M400")

    assert console.say("M114")[0].endswith("Count X:1000 Y:0 Z:0")
    assert console.say("M503")[1:4] == [
        "echo:  G21 ; (mm)",
        "echo:; Steps per unit:",
        "echo:  M92 X100.00 Y80.00 Z400.00 E500.00",
    ]


def test_a_spiral_lists_a_bounded_number_of_layers() -> None:
    statistics = Statistics()
    for n in range(21_000):
        statistics.add_extrusion((0.0, 0.0, n * 0.01, 0.0), (1.0, 0.0, n * 0.01 + 0.01, 0.0))

    report = statistics.report(filament_area=1.0, peak_hotend=0.0, peak_bed=0.0)
    assert len(report.layers) == 20_000
    assert report.extrusion_max is not None
    assert report.extrusion_max[2] == pytest.approx(210.0)


def test_klipper_plans_some_seconds_ahead_however_many_moves_there_is_room_for() -> None:
    """The host may count on an answer to M400 after those seconds, not after a thousand moves."""
    console = Console(KLIPPER, replace(COLD_OK, limits=replace(LIMITS, planner_blocks=1000)))
    console.do("G28", "G1 X10 Y10 F600")
    began = console.now
    console.do(*[f"G1 X{20 if nth % 2 else 10}" for nth in range(100)])  # a second each

    assert console.now - began > 90.0
    last = console.now
    console.do("M400")
    assert console.now - last < 6.0


def test_klipper_refuses_a_move_with_a_letter_alone() -> None:
    """As heard: `G1 Z.2.3` is answered by "Unable to parse move"."""
    console = Console(KLIPPER, COLD_OK)
    console.do("G28", "G1 X10 Y10 F6000")
    for line in ("G1 X Y5", "G1 Z.2.3", "G1 X1 F"):
        assert console.do(line) == [f"!! Unable to parse move '{line}'", "ok"]
    assert place(console)["X"] == place(console)["Y"] == 10.0


@pytest.mark.parametrize("dialect", ["prusa", "repetier", "smoothie"])
def test_firmware_that_reads_as_c_does_takes_a_letter_alone_for_zero(dialect: str) -> None:
    console = Console(replace(MARLIN_2_1_ADVANCED, dialect=dialect), COLD_OK)
    console.do("G28", "G1 X10 Y10 F6000", "G1 X Y5")

    assert (place(console)["X"], place(console)["Y"]) == (0.0, 5.0)


def test_marlin_passes_over_a_letter_alone() -> None:
    console = Console(MARLIN_2_1_ADVANCED, COLD_OK)
    console.do("G28", "G1 X10 Y10 F6000", "G1 X Y5")

    assert (place(console)["X"], place(console)["Y"]) == (10.0, 5.0)
