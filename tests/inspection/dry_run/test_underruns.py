"""What a link makes of a job, held against the simulated printer at the end of a simulated cable."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import cos, pi, sin
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode import read_moves
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.inspection.dry_run.underruns import UnderrunReport, _dwell_seconds, find_underruns
from printer_slicer.jobs import Job
from printer_slicer.link_model import SerialLink
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile, load_profile
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.statistics import Report
from printer_slicer.slice_jobs import job_from
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run
from tests.effort import crossed

PARTS = Path(__file__).parents[3] / "sample_parts"


def with_acceleration(value: float) -> Profile:
    names = ("acceleration", "travel_acceleration", "max_acceleration_x", "max_acceleration_y")
    return load_profile(
        None, None, None, {"printer.jerk_xy": 20} | {f"printer.{name}": value for name in names}
    )


PROFILE = with_acceleration(3000)
ABRUPT = with_acceleration(100_000)
"""Does not slow down when lines run short: it stands still at once."""


def circle(chord: float, speed: float, lines: int, radius: float = 20.0) -> list[bytes]:
    """Round and round in chords of one length, mm, at a speed, mm/s."""
    commands = [b"M302 S0", b"G28", b"M83", b"G1 Z0.3 F300", b"G1 X120 Y100 F6000", b"G1 F%d" % (speed * 60)]
    for i in range(1, lines + 1):
        angle = i * chord / radius % (2 * pi)
        commands.append(
            b"G1 X%.3f Y%.3f E%.5f" % (100 + radius * cos(angle), 100 + radius * sin(angle), 0.033 * chord)
        )
    return commands


def expected(commands: list[bytes], link: SerialLink, profile: Profile = PROFILE) -> UnderrunReport:
    return find_underruns(commands, read_moves(commands), limits_of(profile.printer), link)


def simulated(commands: list[bytes], link: SerialLink, profile: Profile = PROFILE) -> Report:
    """What the simulated printer counts when the streamer sends the job over a cable of this kind."""
    printer = SimulatedPrinter(
        machine_of(profile.printer), simulated_firmware_for(profile.printer), boots=False
    )
    port = VirtualPort(printer, baud=link.baud, latency=link.latency_back)
    streamer = Streamer(
        commands,
        limits=limits_of(profile.printer),
        window_lines=link.window_lines,
        window_bytes=link.window_bytes,
    )
    run(streamer, port, port.now, longest_wait=60.0)
    return printer.report()


def both_ways(baud: int, latency: float, window: int = 2) -> SerialLink:
    """The simulated cable has the same latency in both directions."""
    return SerialLink(baud, latency, latency, window_lines=window)


def assert_same(told: UnderrunReport, counted: Report, share: float = 0.02) -> None:
    """The host's expectation is what the printer counted."""
    assert told.stalls == pytest.approx(counted.underruns, rel=share, abs=3)
    assert told.stalled_seconds == pytest.approx(counted.underrun_seconds, rel=share, abs=0.03)
    assert told.moving_seconds == pytest.approx(counted.motion_seconds, rel=share)


@pytest.mark.parametrize(
    ("profile", "baud", "wire"),
    crossed([PROFILE, ABRUPT], [57_600, 115_200, 250_000], list(product([0.001, 0.016], [1, 2]))),
)
def test_it_tells_what_the_simulated_printer_counts(
    profile: Profile, baud: int, wire: tuple[float, int]
) -> None:
    latency, window = wire
    link = both_ways(baud, latency, window)
    commands = circle(0.2, 60, 1500)

    assert_same(expected(commands, link, profile), simulated(commands, link, profile))


def test_there_are_cases_of_every_kind() -> None:
    commands = circle(0.2, 60, 1500)
    stands = expected(commands, both_ways(57_600, 0.001), ABRUPT)
    brakes = expected(commands, both_ways(57_600, 0.001))
    quick = expected(commands, both_ways(250_000, 0.001))

    assert stands.stalls > 200
    assert brakes.stalls == 0
    assert brakes.seconds > 1.5 * brakes.ideal_seconds
    assert len(stands.underruns) == len(brakes.underruns) == 1
    assert quick.ok
    assert quick.seconds == pytest.approx(quick.ideal_seconds, rel=0.02)


@given(
    chord=st.sampled_from([0.1, 0.3, 0.5, 1.0]),
    speed=st.integers(20, 150),
    baud=st.sampled_from([57_600, 115_200, 250_000, 500_000]),
    latency=st.sampled_from([0.0, 0.001, 0.008]),
    profile=st.sampled_from([PROFILE, ABRUPT]),
)
def test_they_agree_on_any_circle(
    chord: float, speed: int, baud: int, latency: float, profile: Profile
) -> None:
    link = both_ways(baud, latency)
    commands = circle(chord, speed, 400)

    assert_same(expected(commands, link, profile), simulated(commands, link, profile), 0.03)


@pytest.fixture(scope="module")
def vase() -> Job:
    return job_from(PARTS / "vase.stl", load_profile())


@pytest.mark.parametrize("baud", [9600, 38_400])
def test_they_agree_on_a_sliced_part(vase: Job, baud: int) -> None:
    link, commands = both_ways(baud, 0.002), list(vase.commands[:1500])
    profile = load_profile()
    told, counted = expected(commands, link, profile), simulated(commands, link, profile)

    assert_same(told, counted)
    assert told.ok == (baud != 9600)


def test_a_stretch_knows_where_it_is_and_what_would_be_enough() -> None:
    slow = [b"G1 X%d Y100 E1 F1800" % (60 + 50 * (i % 2)) for i in range(200)]
    commands = [*circle(0.2, 60, 10), *slow, b"G1 F3600", *circle(0.2, 60, 800)[6:], *slow]
    link = both_ways(57_600, 0.001)
    told = find_underruns(
        commands, read_moves(commands), limits_of(ABRUPT.printer), link, {0: 1, 150: 2, 600: 3}
    )
    (stretch,) = told.underruns

    assert 200 < stretch.first < stretch.last <= 820 + 200
    assert stretch.layer == 2
    assert stretch.lines_per_second_needed == pytest.approx(300, rel=0.15)
    assert stretch.lines_per_second_available == pytest.approx(link.lines_per_second(38), rel=0.1)
    assert told.seconds - told.ideal_seconds == pytest.approx(stretch.seconds, rel=0.1)


@given(st.integers(9600, 1_000_000), st.floats(0, 0.02))
def test_a_quicker_link_is_never_worse(baud: int, latency: float) -> None:
    commands = circle(0.2, 80, 300)
    link = both_ways(baud, latency)
    one = expected(commands, link)
    other = expected(
        commands, replace(link, baud=2 * baud, latency_out=latency / 2, latency_back=latency / 2)
    )

    assert other.seconds <= one.seconds + 1e-6
    assert one.ideal_seconds == pytest.approx(other.ideal_seconds)


def test_an_arc_is_one_line_for_many_moves() -> None:
    """A full circle as an arc does not starve a planner that its chords do."""
    chords = circle(0.2, 60, 628)
    arc = [*chords[:6], *[b"G3 X120 Y100 I-20 J0 E4"] * 2]
    link = both_ways(38_400, 0.001)

    assert not expected(chords, link).ok
    assert expected(arc, link).ok
    assert_same(expected(arc, link), simulated(arc, link))


def test_the_rate_of_a_link_is_that_of_the_wire_or_of_the_answers() -> None:
    assert SerialLink(115_200, window_lines=8, window_bytes=1000).lines_per_second(38) == pytest.approx(
        303, abs=1
    )
    assert SerialLink(115_200, latency_back=0.016, window_lines=1).lines_per_second(38) == pytest.approx(
        51, abs=1
    )


@pytest.mark.parametrize("wait", [b"M116", b"M191 S40", b"g4 p1", b"PAUSE", b"M125"])
def test_the_machine_stands_still_for_every_command_that_waits(wait: bytes) -> None:
    assert _dwell_seconds(wait) is not None
