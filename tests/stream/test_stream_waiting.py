"""Streaming: what may take its time, and what can be said of the place where it ends."""

from __future__ import annotations

import pytest
from conversation import HOT, LIMITS, printing

from printer_slicer.stream.events import Finished
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
