"""Streaming: what may take its time, and what can be said of the place where it ends."""

from __future__ import annotations

import pytest
from conversation import HOT, LIMITS, Conversation, printing

from printer_slicer.stream.events import Finished, Probe
from printer_slicer.stream.protocol import Streamer


def test_a_busy_printer_is_not_asked_between_its_reports_however_quick_the_answer_should_be(
    bytewise: bool,
) -> None:
    streamer = Streamer([b"G90", b"G91"], limits=LIMITS)
    talk, _ = printing([], streamer=streamer, bytewise=bytewise)

    for _ in range(30):
        assert talk.says("echo:busy: processing") == []
        assert talk.waits(2.0) == []
    talk.says("echo:busy: processing")
    assert talk.waits(2.4) == []
    assert len(talk.waits(0.2)) == 1


def test_a_macro_may_take_its_time_and_one_that_only_sets_something_may_not(bytewise: bool) -> None:
    streamer = Streamer([b"START_PRINT EXTRUDER_TEMP=210", b"G90"], limits=LIMITS)
    talk, _ = printing([], streamer=streamer, bytewise=bytewise)
    for _ in range(300):
        assert talk.says("B:45.0 /60.0 T0:150.0 /210.0") == []
        assert talk.waits(2.0) == []
    talk.says("ok")

    quick = Streamer([b"SET_PRESSURE_ADVANCE ADVANCE=0.05", b"G90"], limits=LIMITS)
    talk, _ = printing([], streamer=quick, bytewise=bytewise)
    assert len(talk.waits(1.0)) == 1


@pytest.mark.parametrize("last", ["END_PRINT", "G27 P2", "G80"])
def test_where_a_command_ends_that_names_no_place_nobody_can_compare(last: str, bytewise: bool) -> None:
    talk, _ = printing(["G1 X5 Y5 Z5", last], bytewise=bytewise)
    talk.says("ok", "ok")  # both, and the question for the end of the motion goes out
    talk.says("ok")
    talk.says(HOT)
    talk.says("X:0.00 Y:200.00 Z:30.00 E:0.00 Count X:0 Y:0 Z:0", "ok")

    (end,) = talk.happened(Finished)
    assert isinstance(end, Finished)
    assert end.verified is None


# How soon a lost answer is missed.


def after_answers(seconds: float, answers: int = 150) -> Conversation:
    """Moves of a tenth of a millimetre are under way, each answered after so many s."""
    job = [f"G1 X{10 + index % 2 / 10:.1f} F3000" for index in range(400)]
    streamer = Streamer([line.encode() for line in job], limits=LIMITS, window_lines=1)
    talk, _ = printing(job, streamer=streamer)
    for _ in range(answers):
        assert talk.waits(seconds) == []
        talk.says("ok")
    return talk


def seconds_until_asked(talk: Conversation) -> float:
    """How long nothing is said until the host asks."""
    begun = talk.now
    while not talk.happened(Probe):
        due = talk.streamer.wakeup()
        assert due is not None
        talk.waits(due - talk.now + 1e-6)
    return talk.now - begun


def test_a_quick_printer_is_asked_soon_when_the_motion_of_what_is_in_flight_is_short() -> None:
    assert seconds_until_asked(after_answers(0.003)) < 0.35


def test_a_printer_that_is_not_known_yet_or_slow_gets_its_time() -> None:
    assert seconds_until_asked(after_answers(0.003, answers=20)) > 0.8
    assert seconds_until_asked(after_answers(0.4)) > 0.8


def test_an_answer_not_three_times_as_slow_as_one_before_is_never_missed() -> None:
    talk = after_answers(0.002)
    for seconds in (0.05, 0.1, 0.2, 0.002, 0.5, 0.002, 0.8):
        assert talk.waits(seconds) == []
        talk.says("ok")

    assert talk.happened(Probe) == []


def test_a_long_move_is_waited_for_as_before() -> None:
    talk = after_answers(0.003)
    job = talk.streamer
    job.inject(b"G1 X200 F600")
    talk.says("ok")
    talk.says("ok")

    assert seconds_until_asked(talk) > 19.0
