"""The account of a link: rate, latency, repeats and waits, against a simulated cable whose truth is known."""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi, sin
from random import Random  # noqa: TID251 - seeded

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import PortError
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.sim.firmwares import MARLIN_2_1, MARLIN_2_1_ADVANCED, SimulatedFirmware
from printer_slicer.sim.link import CableNoise, VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.statistics import Report
from printer_slicer.stream.events import Event, PoorLink, ResendRequested
from printer_slicer.stream.link_meter import LinkMeter, LinkStatistics, MeteredTransport, check_link_quality
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

LIMITS = MotionLimits(
    max_speed=(500.0, 500.0, 50.0, 500.0),
    max_acceleration=(1e5, 1e5, 1e4, 1e5),
    acceleration=1e5,
    travel_acceleration=1e5,
    retract_acceleration=1e5,
    corner="junction_deviation",
    junction_deviation=0.1,
    jerk=(10.0, 10.0, 0.4, 5.0),
    square_corner_velocity=5.0,
)


def circle(lines: int, chord: float = 0.2, speed: float = 60.0) -> list[bytes]:
    commands = [b"G28", b"M83", b"G1 X120 Y100 F6000", b"G1 F%d" % (speed * 60)]
    for i in range(1, lines + 1):
        angle = i * chord / 20 % (2 * pi)
        commands.append(b"G1 X%.3f Y%.3f E.0066" % (100 + 20 * cos(angle), 100 + 20 * sin(angle)))
    return commands


def seen(
    commands: list[bytes],
    *,
    baud: int = 115_200,
    latency: float = 0.001,
    firmware: SimulatedFirmware = MARLIN_2_1,
    window: int = 2,
    flip: float = 0.0,
) -> tuple[LinkStatistics, Report]:
    """What a meter makes of a print over a cable of this kind, and what the printer counted."""
    printer = SimulatedPrinter(Machine(limits=LIMITS, coldest_extrusion=0.0), firmware, boots=False)
    damage = CableNoise(Random(7), flip=flip) if flip else None
    port = VirtualPort(printer, baud=baud, latency=latency, noise=damage)
    meter = LinkMeter(LIMITS)
    streamer = Streamer(commands, limits=LIMITS, window_lines=window)
    run(streamer, MeteredTransport(port, meter, port.now), port.now, on_event=meter.on_event)
    return meter.statistics(), printer.report()


@pytest.mark.parametrize("firmware", [MARLIN_2_1, MARLIN_2_1_ADVANCED], ids=["plain", "advanced"])
@pytest.mark.parametrize("baud", [57_600, 115_200])
def test_what_it_counts_is_what_the_printer_counts(firmware: SimulatedFirmware, baud: int) -> None:
    told, counted = seen(circle(1500), baud=baud, firmware=firmware)

    assert told.lines == counted.lines - 1  # one has no number: the greeting
    assert (told.resends, told.resent_lines, told.lost_answers) == (0, 0, 0)
    assert told.underruns == pytest.approx(counted.underruns, rel=0.1, abs=3)
    assert told.underrun_seconds == pytest.approx(counted.underrun_seconds, rel=0.1, abs=0.05)


def test_a_link_that_is_quick_enough_is_not_waited_for() -> None:
    told, counted = seen(circle(1500), baud=500_000)

    assert (told.underruns, counted.underruns) == (0, 0)
    assert 220 < told.lines_per_second < 300  # the way to the circle takes its time, too


@pytest.mark.parametrize("latency", [0.001, 0.004, 0.016])
def test_latency_is_the_way_there_and_back_and_the_line_on_the_wire(latency: float) -> None:
    """One line in flight, moves so short that the planner is never full."""
    told, _ = seen(circle(500, chord=0.05, speed=400.0), latency=latency, window=1)
    line = len("N1000 G1 X100.000 Y100.000 E.0066*99\n") * 10 / 115_200

    assert told.latency == pytest.approx(2 * latency + line + 3 * 10 / 115_200, rel=0.1)
    assert told.latency_95 == pytest.approx(told.latency, rel=0.1)


def test_answers_that_a_full_planner_holds_back_are_no_latency() -> None:
    """Moves of 10 mm at 20 mm/s: half a second each."""
    long = [b"G28", b"G1 F1200", *[b"G1 X%d Y50" % (50 + 10 * (i % 2)) for i in range(60)]]
    told, _ = seen(long)

    assert told.latency_95 is not None
    assert told.latency_95 < 0.02
    assert told.underruns == 0


def test_time_that_commands_take_for_themselves_does_not_make_the_link_slow() -> None:
    waits = [*circle(600), b"G4 S100", *circle(600)[1:]]
    told, _ = seen(waits, baud=57_600)
    plain, _ = seen(circle(1200), baud=57_600)

    assert told.seconds < 30
    assert told.lines_per_second == pytest.approx(plain.lines_per_second, rel=0.1)


def test_resends_and_questions_are_counted() -> None:
    told, counted = seen(circle(2000), flip=2e-4)

    assert counted.line_errors > 5
    assert told.resends == pytest.approx(counted.resends, abs=3)  # some requests are damaged on their way
    assert told.resent_lines >= told.resends
    assert told.lines >= 2000
    assert told.lost_answers > 0


@given(st.lists(st.binary(max_size=40)), st.lists(st.binary(max_size=40)))
def test_any_bytes_are_taken(there: list[bytes], back: list[bytes]) -> None:
    meter = LinkMeter(LIMITS)
    for i, data in enumerate([*there, b"N3 G1 X5 F300*9\n", b"N4 G1 X1*9\n"]):
        meter.on_sent(data, i)
    for i, data in enumerate([*back, b"\nok\nok N9\nResend: 2\nok\nok\nok\n"]):
        meter.on_received(data, 1000.0 + i)
    told = meter.statistics()

    assert told.lines >= 0
    assert str(told)


def test_nothing_seen_is_said_as_such() -> None:
    told = LinkMeter().statistics()

    assert (told.lines, told.lines_per_second, told.latency) == (0, 0.0, None)
    assert "latency unknown" in str(told)


def test_it_does_not_matter_how_bytes_are_cut() -> None:
    meters = LinkMeter(LIMITS), LinkMeter(LIMITS)
    for meter in meters:
        for number in range(1, 6):
            meter.on_sent(b"N%d G1 X%d F600*99\n" % (number, number), float(number))
    answers = b"ok\nok N2\n T:20 /0\nResend: 4\nok\nok\n"
    meters[0].on_received(answers, 10.0)
    for byte in answers:
        meters[1].on_received(bytes([byte]), 10.0)

    assert meters[0].statistics() == meters[1].statistics()
    assert meters[0].statistics().lines == 3


def test_an_ok_that_names_its_line_counts_even_right_behind_a_request() -> None:
    meter = LinkMeter(LIMITS)
    for number in (1, 2):
        meter.on_sent(b"N%d G1 X%d F600*99\n" % (number, number), float(number))
    meter.on_received(b"Resend: 2\nok N1 P15 B3\n", 3.0)
    assert meter.statistics().lines == 1


def test_without_limits_it_counts_and_does_not_judge_stalls() -> None:
    meter = LinkMeter()
    for number, command in enumerate([b"G28", b"G1 X5 F600", b"G4 P100"], 1):
        meter.on_sent(b"N%d %s*99\n" % (number, command), float(number))
        meter.on_received(b"ok\n", number + 0.5)
    told = meter.statistics()
    assert (told.lines, told.underruns, told.underrun_seconds) == (3, 0, 0.0)


def test_what_it_listens_to_is_closed_with_it() -> None:
    port = VirtualPort(SimulatedPrinter(Machine(), MARLIN_2_1), latency=0.001)
    MeteredTransport(port, LinkMeter(), port.now).close()
    with pytest.raises(PortError):
        port.write(b"M105\n")


# What is told of a bad cable.


def test_a_sound_cable_is_not_warned_of() -> None:
    assert seen(circle(2000))[0].warning is None
    assert check_link_quality(100_000, 20, 20) is None
    assert check_link_quality(10, 5, 5) is None


def test_a_bad_cable_is_warned_of_while_printing_and_at_the_end() -> None:
    printer = SimulatedPrinter(Machine(limits=LIMITS, coldest_extrusion=0.0), MARLIN_2_1, boots=False)
    port = VirtualPort(printer, baud=115_200, latency=0.001, noise=CableNoise(Random(7), flip=1e-3))
    meter, told, resends = LinkMeter(LIMITS), list[PoorLink](), list[Event]()

    def hear(event: Event) -> None:
        meter.on_event(event)
        resends.extend([event] if isinstance(event, ResendRequested) else [])
        told.extend(meter.find_new_warnings())

    run(
        Streamer(circle(4000), limits=LIMITS),
        MeteredTransport(port, meter, port.now),
        port.now,
        on_event=hear,
    )
    last = meter.statistics().warning

    assert last is not None
    assert last.resends == len(resends) > 20
    assert last.resends_per_1000 == pytest.approx(1000 * last.resends / last.lines, rel=1e-3)
    assert f"{last.resends} resends" in last.text
    assert "per 1000 lines" in last.text
    assert "undetected damage is likely" in last.text
    assert "Use a short cable" in last.text
    assert told
    assert told[0].lines < last.lines / 2
    # Each one tells of at least twice as much as the one before.
    counts = [one.resends + one.lost_answers for one in told]
    assert all(after >= 2 * before for before, after in pairwise(counts))


@given(st.integers(0, 10**6), st.integers(0, 5000), st.integers(0, 5000))
def test_hundreds_of_resends_or_lost_answers_never_end_without_a_word(
    lines: int, resends: int, lost: int
) -> None:
    found = check_link_quality(lines, resends, lost)

    assert (found is not None) >= (max(resends, lost) >= 100)
    if found is not None:
        assert found.undetected >= round(resends / 256, 3)
        assert ("undetected damage is likely" in found.text) == (found.undetected >= 0.25)
