"""The model of the link, held against the simulated printer at the end of a simulated cable."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import link_model
from printer_slicer.gcode import read_moves
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.inspection.dry_run.underruns import make_timed_job
from printer_slicer.link_model import LinkRun, SerialLink, compute_lateness
from printer_slicer.motion.planner_clock import PlannerClock
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile, load_profile
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.statistics import Report
from printer_slicer.stream.framing import frame
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

BEFORE = 4
"""Number of the first command of a job among those that the printer executes, from 1: the host greets it first."""

SAME_SECONDS = 1e-6
"""s by which model and simulated printer may differ for one standstill, and for all of the motion."""

READY = [b"M302 S0", b"G28", b"M83", b"G1 Z0.3 F300", b"G1 X120 Y100 F6000"]


def profile_of(acceleration: float, corner: str = "jerk") -> Profile:
    names = ("acceleration", "travel_acceleration", "max_acceleration_x", "max_acceleration_y")
    wanted = {"printer.jerk_xy": 20, "printer.corner": corner}
    return load_profile(None, None, None, wanted | {f"printer.{name}": acceleration for name in names})


def chords(step: float, speed: int, count: int) -> list[bytes]:
    """Round and round in chords of one length, mm, at a speed, mm/s."""
    angles = [i * step / 20 % (2 * pi) for i in range(1, count + 1)]
    places = [(100 + 20 * cos(one), 100 + 20 * sin(one)) for one in angles]
    return [b"G1 F%d" % (60 * speed), *(b"G1 X%.3f Y%.3f E%.5f" % (x, y, step / 30) for x, y in places)]


PIECES = st.one_of(
    st.builds(chords, st.sampled_from([0.1, 0.2, 0.5, 2.0]), st.integers(20, 150), st.integers(1, 250)),
    st.sampled_from(
        [
            [b"G4 P150"],
            [b"M400"],
            [b"G1 E-1 F2400", b"G1 X60 Y60 F9000", b"G1 E1 F2400"],
            [b"M204 P700 T900"],
            [b"M201 X900 Y800", b"M203 X70 Y90", b"M205 X4 Y4"],
            [b"M106 S100", b"M73 P3 R10", b"M117 some text that takes its time on the wire"] * 12,
            [b"G3 X120 Y100 I-20 J0 E4"],
            [b"G1 X150 Y150 F3000", b"G1 X60 Y60"] * 3,
        ]
    ),
)
PROGRAMS = st.lists(PIECES, min_size=1, max_size=7).map(lambda pieces: [*READY, *chain.from_iterable(pieces)])
LINKS = st.builds(
    lambda baud, latency, lines, size: SerialLink(baud, latency, latency, lines, size),
    st.sampled_from([9600, 38_400, 57_600, 115_200, 250_000]),
    st.sampled_from([0.0, 0.001, 0.008]),
    st.integers(1, 2),
    st.sampled_from([63, 95, 127]),
)
PROFILES = st.sampled_from([profile_of(3000), profile_of(100_000), profile_of(1500, "junction_deviation")])


class WatchedClock(PlannerClock):
    """Keeps where the machine stood still: the line whose move had not come, and for how long, s."""

    stood: list[tuple[int, float]]

    def _start_moving(self, at: float) -> None:
        before = self.stalls, self.stalled_seconds
        super()._start_moving(at)
        if self.stalls > before[0]:
            self.__dict__.setdefault("stood", []).append((self.labels[0], self.stalled_seconds - before[1]))


def modelled(commands: Sequence[bytes], link: SerialLink, profile: Profile) -> LinkRun:
    limits = limits_of(profile.printer)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(link_model, "PlannerClock", WatchedClock)
        return LinkRun(make_timed_job(commands, read_moves(commands), limits), link, limits).run()


def simulated(commands: Sequence[bytes], link: SerialLink, profile: Profile) -> Report:
    """What the simulated printer counts when the streamer sends the job, byte by byte, over such a cable."""
    printer = SimulatedPrinter(
        machine_of(profile.printer), simulated_firmware_for(profile.printer), boots=False
    )
    port = VirtualPort(printer, baud=link.baud, latency=link.latency_back)
    limits = limits_of(profile.printer)
    streamer = Streamer(
        commands, limits=limits, window_lines=link.window_lines, window_bytes=link.window_bytes
    )
    run(streamer, port, port.now, longest_wait=60.0)
    return printer.report()


def assert_same(told: LinkRun, counted: Report) -> None:
    """Whether, where and how long the machine stands still, and how long it moves."""
    stood = getattr(told.clock, "stood", [])
    assert told.clock.stalls == counted.underruns
    assert [line + BEFORE for line, _ in stood[:1000]] == [command for command, _ in counted.underrun_list]
    assert [seconds for _, seconds in stood[:1000]] == pytest.approx(
        [seconds for _, seconds in counted.underrun_list], abs=SAME_SECONDS
    )
    assert told.clock.moving_seconds == pytest.approx(counted.motion_seconds, abs=SAME_SECONDS)


@given(PROGRAMS, LINKS, PROFILES)
def test_model_and_simulated_printer_starve_alike(
    commands: list[bytes], link: SerialLink, profile: Profile
) -> None:
    assert_same(modelled(commands, link, profile), simulated(commands, link, profile))


def test_examples_starve_and_do_not_and_are_batched() -> None:
    """Else the comparison would say nothing."""
    commands = [*READY, *chords(0.2, 60, 3000)]
    slow, quick = (
        modelled(commands, SerialLink(baud, 0.001), profile_of(100_000)) for baud in (57_600, 250_000)
    )

    assert slow.clock.stalls > 400
    assert quick.clock.stalls == 0
    assert quick.batched > 2800


@given(PROGRAMS, LINKS, PROFILES, st.integers(1, 6))
def test_lines_at_once_take_the_times_of_lines_one_by_one(
    commands: list[bytes], link: SerialLink, profile: Profile, window: int
) -> None:
    link = SerialLink(link.baud, link.latency_out, link.latency_back, window, 3 * link.window_bytes)
    batched = modelled(commands, link, profile)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(link_model, "can_batch", lambda _: False)
        single = modelled(commands, link, profile)

    assert single.batched == 0
    assert batched.clock.stalls == single.clock.stalls
    np.testing.assert_allclose(batched.begins, single.begins, rtol=0, atol=SAME_SECONDS)
    assert batched.end == pytest.approx(single.end, abs=SAME_SECONDS)
    assert batched.clock.moving_seconds == pytest.approx(single.clock.moving_seconds, abs=SAME_SECONDS)


def test_all_limits_that_change_before_a_move_hold() -> None:
    changes = [b"M201 X900 Y800", b"M203 X30 Y30", b"M205 X4 Y4"]
    commands = [*READY[:-1], *changes, READY[-1], *chords(0.5, 80, 300)]
    link, profile = SerialLink(250_000, 0.001), profile_of(3000)

    assert_same(modelled(commands, link, profile), simulated(commands, link, profile))


@given(
    st.lists(st.binary(min_size=1, max_size=60).map(lambda text: text.hex().encode()), min_size=1),
    st.integers(0, 10**6),
)
@settings(deadline=None)
def test_sizes_are_those_of_the_lines_that_are_sent(commands: list[bytes], first: int) -> None:
    sizes, reserved_sizes = link_model.compute_line_sizes(commands, first)
    numbers = range(
        first + link_model.HANDSHAKE_LINES + 1, first + link_model.HANDSHAKE_LINES + 1 + len(commands)
    )

    assert sizes.tolist() == [
        len(frame(number, one)) + 1 for number, one in zip(numbers, commands, strict=True)
    ]
    assert (reserved_sizes >= sizes).all()
    assert (reserved_sizes <= sizes + 2).all()


@given(st.lists(st.tuples(st.floats(0, 0.5), st.floats(0, 0.5)), min_size=1, max_size=60))
def test_lateness_grows_by_the_lines_and_shrinks_by_the_moves(pairs: list[tuple[float, float]]) -> None:
    seconds, takes = np.array(pairs).T
    late = compute_lateness(np.cumsum(seconds) - seconds, takes)
    expected = [0.0]
    for lasts, lines in zip(seconds[:-1].tolist(), takes[1:].tolist(), strict=True):
        expected.append(max(expected[-1] + lines - lasts, 0.0))

    assert late.tolist() == pytest.approx(expected, abs=1e-9)
