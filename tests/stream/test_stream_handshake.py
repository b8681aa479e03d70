"""Meeting the printer."""

from __future__ import annotations

from conversation import HOT, INTRODUCTION, Conversation, again, first, printing

from printer_slicer.stream.events import Halted, Identified
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.states import State

GREETING = b"\nN0 M110 N0*125"


def connecting(*, bytewise: bool, commands: tuple[bytes, ...] = (b"G28", b"G90")) -> Conversation:
    talk = Conversation(Streamer(commands), bytewise=bytewise)
    assert talk.waits(0.0) == [GREETING]
    return talk


def test_the_count_begins_anew_then_the_printer_says_who_it_is_then_the_job_begins(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)

    assert talk.says("ok") == [first(1, "M115")]
    assert talk.says(*INTRODUCTION) == [first(2, "M105")]
    assert talk.says(HOT) == [first(3, "G28"), first(4, "G90")]
    (identified,) = talk.happened(Identified)
    assert identified == Identified("Marlin 2.1", (("EMERGENCY_PARSER", False),))
    assert not identified.has_capability("EMERGENCY_PARSER")
    assert not identified.has_capability("ADVANCED_OK")


def test_a_printer_that_does_not_answer_is_greeted_every_second_and_given_up_after_half_a_minute(
    bytewise: bool,
) -> None:
    talk = connecting(bytewise=bytewise)

    assert talk.waits(3.5) == [GREETING] * 3
    assert len(talk.waits(26.0)) == 26
    assert talk.waits(1.0) == []
    assert talk.streamer.state is State.HALTED
    (halted,) = talk.happened(Halted)
    assert "no printer answered" in halted.reason


def test_a_board_that_resets_when_the_port_opens_is_greeted_again_as_soon_as_it_starts(
    bytewise: bool,
) -> None:
    talk = connecting(bytewise=bytewise)

    assert talk.says("start", "Marlin 2.1") == [GREETING]
    assert talk.says("ok") == [first(1, "M115")]


def test_an_ok_that_came_before_the_greeting_is_not_its_answer() -> None:
    streamer = Streamer([b"G28"])
    streamer.receive(b"ok\n", 100.0)

    assert streamer.state is State.CONNECTING


def test_an_ok_with_temperatures_answers_another_host(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)

    assert talk.says("ok T:20.0 /0.0 B:20.0 /0.0 @:0 B@:0") == []
    assert talk.streamer.state is State.CONNECTING


def test_a_greeting_that_arrived_damaged_is_said_again_and_the_ok_of_the_refusal_is_no_answer(
    bytewise: bool,
) -> None:
    talk = connecting(bytewise=bytewise)

    assert talk.says("Error:checksum mismatch, Last Line: 7", "Resend: 8", "ok") == [GREETING]
    assert talk.streamer.state is State.CONNECTING
    assert talk.says("ok") == [first(1, "M115")]


def test_an_ok_left_over_from_a_second_greeting_does_not_answer_line_1(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)
    talk.waits(1.0)

    assert talk.says("ok") == [first(1, "M115")]
    assert talk.says("ok") == []
    assert talk.says(*INTRODUCTION) == [first(2, "M105")]
    assert talk.says(HOT) == [first(3, "G28"), first(4, "G90")]


def test_a_printer_that_tells_temperatures_apart_from_the_ok_is_understood_too(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)
    talk.says("ok")
    talk.says(*INTRODUCTION)

    assert talk.says("ok", "T:20.0 /0.0 B:20.0 /0.0 @:0 B@:0") == [first(3, "G28"), first(4, "G90")]


def test_a_printer_that_does_not_name_itself_is_asked_and_then_believed(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)
    talk.says("ok")

    assert talk.says("ok") == []
    assert talk.waits(3.0) == [again(2, "M105")]
    assert talk.says("ok T:20.0 /0.0") == [first(3, "M115")]
    assert talk.says("ok") == [first(4, "M115")]
    assert talk.says("ok") == [first(5, "G28")]
    assert talk.happened(Identified) == [Identified("", ())]


def test_a_printer_that_kept_its_old_count_is_greeted_again(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)
    talk.says("ok")

    refusal = "Error:Line Number is not Last Line Number+1, Last Line: 5000", "Resend: 5001", "ok"
    assert talk.says(*refusal) == [GREETING]
    assert talk.says("ok") == [first(1, "M115")]


def test_a_printer_that_starts_while_it_is_asked_who_it_is_is_greeted_again(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)
    talk.says("ok")

    assert talk.says("start") == [GREETING]
    assert talk.streamer.state is State.CONNECTING


def test_cancelling_before_the_printer_answered_ends_it(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)

    talk.streamer.cancel([b"M104 S0"])

    assert talk.waits(5.0) == []
    assert talk.happened(Halted) == [Halted("cancelled before anything was printed", 0)]


def test_what_the_printer_says_of_itself_later_changes_nothing(bytewise: bool) -> None:
    talk, _ = printing(["M115", "G90"], bytewise=bytewise)

    talk.says("FIRMWARE_NAME:Other", "Cap:EMERGENCY_PARSER:1", "ok")

    (identified,) = talk.happened(Identified)
    assert identified == Identified("Marlin 2.1", (("EMERGENCY_PARSER", False),))


def test_a_printer_that_is_busy_when_it_is_met_gets_more_time(bytewise: bool) -> None:
    talk = connecting(bytewise=bytewise)

    for _ in range(60):
        talk.waits(2.0)
        talk.says("echo:busy: processing")
    assert talk.streamer.state is State.CONNECTING
    assert talk.says("ok") == [first(1, "M115")]


def test_a_printer_that_says_it_is_busy_before_it_is_greeted_is_greeted_all_the_same() -> None:
    streamer = Streamer([])
    streamer.receive(b"echo:busy: processing\n", 1.0)

    assert streamer.send(1.0) == GREETING + b"\n"
