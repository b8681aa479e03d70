"""Streaming: the window, the errors, the questions, and who is believed when answers are lost or damaged."""

from __future__ import annotations

import pytest
from conversation import HOT, Conversation, again, first, moves, printing

from printer_slicer.errors import UsageError
from printer_slicer.stream.events import (
    Accepted,
    Busy,
    Halted,
    Message,
    Probe,
    ResendRequested,
    Temperature,
)
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.send_history import SendHistory
from printer_slicer.stream.states import ENDED, TRANSITIONS, State, Trigger


def refusal(wanted: int, *, why: str = "checksum mismatch") -> tuple[str, str, str]:
    return f"Error:{why}, Last Line: {wanted - 1}", f"Resend: {wanted}", "ok"


def refused_for_its_number(wanted: int) -> tuple[str, str, str]:
    return refusal(wanted, why="Line Number is not Last Line Number+1")


# The window.


def test_two_lines_are_in_flight_and_each_ok_lets_one_more_go(bytewise: bool) -> None:
    talk, out = printing(moves(4), bytewise=bytewise)

    assert out == [first(3, "G1 X1"), first(4, "G1 X2")]
    assert talk.waits(0.5) == []
    assert talk.says("ok") == [first(5, "G1 X3")]
    assert talk.says("ok", "ok") == [first(6, "G1 X4")]


def test_no_more_bytes_are_in_flight_than_the_smallest_receive_buffer_holds(bytewise: bool) -> None:
    long = "M117 " + "x" * 60
    talk, out = printing([long, long, "G90"], bytewise=bytewise)

    assert out == [first(3, long)]
    assert talk.says("ok") == [first(4, long), first(5, "G90")]


def test_a_wider_window_is_used_when_asked_for() -> None:
    streamer = Streamer([c.encode() for c in moves(6)], window_lines=4, window_bytes=1000)
    _, out = printing([], streamer=streamer)

    assert out == [first(n + 2, f"G1 X{n}") for n in (1, 2, 3, 4)]


def test_comments_and_empty_lines_are_not_sent_and_count_as_done(bytewise: bool) -> None:
    job = ["; start", "", "G28 ; home", "  ", "G90", "; end"]
    talk, out = printing(job, bytewise=bytewise)

    assert out == [first(3, "G28"), first(4, "G90")]
    assert talk.streamer.acknowledged == 0
    talk.says("ok")
    assert talk.streamer.acknowledged == 3
    assert talk.says("ok") == [first(5, "M400")]
    assert talk.streamer.acknowledged == 6
    assert talk.happened(Accepted)[-1] == Accepted(6)


def test_a_job_that_can_never_be_sent_is_refused_before_anything_is() -> None:
    with pytest.raises(UsageError, match="line 2 is 101 bytes long"):
        Streamer([b"G28", b"M117 " + b"x" * 96])
    with pytest.raises(UsageError, match="line break"):
        Streamer([b"G28\nG90"])


def test_an_ok_for_nothing_is_ignored(bytewise: bool) -> None:
    talk, _ = printing(["G28"], bytewise=bytewise)
    talk.streamer.pause()

    assert talk.says("ok", "ok", "ok") == []
    assert talk.streamer.acknowledged == 1


# Errors that the printer finds.


@pytest.mark.parametrize(
    "request_line", ["Resend: 4", "Resend:4", "Resend: N4", "Resend:N4", "rs 4", "rs N4 Expected 4 got 10"]
)
def test_every_way_to_ask_for_a_line_is_understood(request_line: str, bytewise: bool) -> None:
    talk, _ = printing(moves(4), bytewise=bytewise)
    talk.says("ok")

    out = talk.says(request_line, "ok", request_line, "ok")

    assert out == [again(4, "G1 X2")]
    assert talk.happened(ResendRequested) == [ResendRequested(4)]


def test_firmware_that_refuses_every_line_behind_the_bad_one_gets_them_once(bytewise: bool) -> None:
    talk, _ = printing(moves(4), bytewise=bytewise)

    assert talk.says(*refusal(3)) == []
    assert talk.says(*refused_for_its_number(3)) == [again(3, "G1 X1")]
    assert talk.says("ok") == [again(4, "G1 X2")]
    assert talk.says("ok") == [first(5, "G1 X3")]
    assert talk.happened(ResendRequested) == [ResendRequested(3)]


def test_firmware_that_empties_its_buffer_gets_them_once_after_a_moment(bytewise: bool) -> None:
    talk, _ = printing(moves(4), bytewise=bytewise)

    assert talk.says(*refusal(3)) == []
    assert talk.waits(0.15) == []
    assert talk.waits(0.1) == [again(3, "G1 X1")]
    assert talk.says("ok") == [again(4, "G1 X2")]


def test_firmware_that_says_no_ok_after_a_resend_gets_them_once_too(bytewise: bool) -> None:
    talk, _ = printing(moves(4), bytewise=bytewise)

    assert talk.says(*refusal(3)[:2], *refused_for_its_number(3)[:2]) == []
    assert talk.waits(0.25) == [again(3, "G1 X1")]
    assert talk.says("ok") == [again(4, "G1 X2")]


def test_another_firmware_names_the_expected_line(bytewise: bool) -> None:
    talk, _ = printing(moves(4), bytewise=bytewise)
    talk.says("ok")

    out = talk.says(
        "Error: expected line 4 got 5", "Resend:4", "ok", "Error: expected line 4 got 5", "Resend:4", "ok"
    )

    assert out == [again(4, "G1 X2")]


def test_an_ok_that_comes_between_belongs_to_the_line_before_the_bad_one(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)

    assert talk.says(*refusal(4)) == [again(4, "G1 X2")]
    assert talk.streamer.acknowledged == 0
    assert talk.says("ok") == []
    assert talk.streamer.acknowledged == 1
    assert talk.says("ok") == [first(5, "G1 X3")]


def test_after_an_error_lines_go_one_by_one_for_three_hundred_lines(bytewise: bool) -> None:
    talk, _ = printing(moves(400), bytewise=bytewise)
    talk.says(*refusal(3), *refused_for_its_number(3))

    sent = [len(talk.says("ok")) for _ in range(310)]

    assert sent[:299] == [1] * 299
    assert sent[299] == 2
    assert sent[300:] == [1] * 10


def test_the_same_request_again_after_the_repeat_goes_back_again(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.says("ok")

    assert talk.says(*refusal(4)) == [again(4, "G90")]
    assert talk.says(*refusal(4)) == [again(4, "G90")]


def test_ten_equal_requests_end_it_with_a_reason(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.says("ok")

    repeats = [talk.says(*refusal(4)) for _ in range(10)]

    assert repeats == [[again(4, "G90")]] * 9 + [[]]
    assert talk.streamer.state is State.HALTED
    assert talk.happened(Halted) == [
        Halted("the printer keeps rejecting line 4", 1),
    ]


def test_a_request_for_the_next_line_means_that_all_others_arrived(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90", "G91"], bytewise=bytewise)

    assert talk.says(*refusal(5)) == [first(5, "G91")]


# Requests that arrive damaged, or never.


def test_a_lost_request_is_read_from_its_error(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.says("ok")

    assert talk.says("Error:checksum mismatch, Last Line: 3", "ok") == [again(4, "G90")]


def test_an_error_alone_is_enough_after_a_moment(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.says("ok")

    assert talk.says("Error:checksum mismatch, Last Line: 3") == []
    assert talk.waits(0.3) == [again(4, "G90")]


def test_an_error_alone_that_names_a_surprising_line_is_asked_about(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.says("ok")

    assert talk.says("Error:checksum mismatch, Last Line: 83") == []
    assert talk.waits(0.6) == [again(5, "M105")]
    assert talk.says(*refused_for_its_number(4)) == []
    assert talk.waits(0.3) == [again(4, "G90")]


def test_an_error_and_a_request_that_disagree_are_asked_about(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90", "G91"], bytewise=bytewise)

    assert talk.says("Error:checksum mismatch, Last Line: 1", "Resend: 4", "ok") == []
    assert talk.waits(0.4) == [again(5, "M105")]
    assert talk.happened(Probe) == [Probe(5)]
    assert talk.says(*refused_for_its_number(3)) == []
    assert talk.waits(0.3) == [again(3, "G28")]


@pytest.mark.parametrize("remains", ["Resenf: 4", "esend: 4", "Resend: ", "Rsnd: 4", "R\x05send: 4"])
def test_an_ok_behind_the_remains_of_a_request_acknowledges_nothing(remains: str, bytewise: bool) -> None:
    talk, _ = printing(["G28"], bytewise=bytewise)

    assert talk.says(remains, "ok") == []
    assert talk.streamer.acknowledged == 0
    assert talk.waits(0.5) == [again(4, "M105")]
    assert talk.says(*refused_for_its_number(3)) == []
    assert talk.waits(0.3) == [again(3, "G28")]


def test_a_request_with_its_ok_glued_on_counts_for_both(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.says("ok")

    assert talk.says("Resend: 4ok") == [again(4, "G90")]


def test_a_refusal_taken_for_an_ok_is_found_out_by_the_next_line_and_taken_back(bytewise: bool) -> None:
    talk, _ = printing(moves(3), bytewise=bytewise)
    talk.says("ok", "ok")
    assert talk.streamer.acknowledged == 2

    talk.says(*refused_for_its_number(4))

    assert talk.waits(0.3) == [again(4, "G1 X2")]
    assert talk.streamer.acknowledged == 1


# Resets.


def refusals_of_line_1(talk: Conversation) -> None:
    talk.says(*refused_for_its_number(1), *refused_for_its_number(1))


def test_a_printer_that_was_reset_gets_nothing_more(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    for _ in range(3):
        talk.says("ok")

    refusals_of_line_1(talk)

    assert talk.waits(60.0) == []
    assert talk.streamer.done
    (halted,) = talk.happened(Halted)
    assert halted == Halted("the printer was reset: it requests line 1, but line 8 is next", 3)


def test_a_printer_that_starts_in_the_middle_gets_nothing_more(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)

    assert talk.says("start", "ok", "ok") == []
    assert talk.happened(Halted) == [Halted("the printer was reset: it has restarted", 0)]


def test_the_end_is_told_last_also_if_it_comes_with_an_answer(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)

    talk.says("ok", "start", "ok")

    assert talk.events[-2:] == [Accepted(1), Halted("the printer was reset: it has restarted", 1)]


def test_a_reset_that_is_told_without_an_error_is_believed_the_second_time(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)

    assert talk.says("Resend:1", "ok") == []
    assert talk.streamer.state is State.STREAMING
    assert talk.waits(0.4) == [again(5, "M105")]
    assert talk.says("Resend:1", "ok") == []
    assert talk.streamer.state is State.HALTED


def test_a_doubt_does_not_outlive_the_next_ok(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)

    talk.says("Resend:1", "ok")
    talk.says("ok")
    talk.says("Resend:1", "ok")

    assert talk.streamer.state is State.STREAMING


@pytest.mark.parametrize("wanted", [3, 40, 9000])
def test_a_line_long_accepted_or_never_made_cannot_be_sent(wanted: int, bytewise: bool) -> None:
    talk, _ = printing(moves(60), bytewise=bytewise)
    for _ in range(30):
        talk.says("ok")

    assert talk.says(*refused_for_its_number(wanted)) == []
    assert talk.streamer.state is State.HALTED


def test_a_reset_told_only_by_its_errors_is_found_out_too(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)

    talk.says("Error:No Checksum with line number, Last Line: 0")
    assert talk.waits(0.6) == [again(5, "M105")]
    talk.says("Error:Line Number is not Last Line Number+1, Last Line: 0")
    talk.waits(0.3)

    assert talk.streamer.state is State.HALTED


# Silence.


def test_silence_is_answered_by_questions_with_new_numbers_and_then_given_up(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    begun = talk.now

    assert talk.waits(29.0) == []
    questions = talk.waits(2000.0)

    assert questions == [again(n, "M105") for n in range(5, 11)]
    (halted,) = talk.happened(Halted)
    assert halted == Halted("the printer has stopped answering", 0)
    assert talk.streamer.done
    assert begun < talk.now


def test_the_answer_to_a_question_accepts_everything_before_it(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    assert talk.waits(31.5) == [again(5, "M105")]

    assert talk.says(HOT) == [first(6, "G1 X3")]
    assert talk.streamer.acknowledged == 2


def test_a_question_is_also_answered_by_naming_the_lost_line(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    talk.waits(31.5)
    talk.says("ok")

    assert talk.says(*refused_for_its_number(4)) == []
    assert talk.waits(0.3) == [again(4, "G1 X2")]
    assert talk.says("ok") == [again(5, "M105")]


def test_a_busy_printer_that_answers_all_questions_at_once_accepts_no_line_too_many(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    assert len(talk.waits(34.5)) == 3

    assert talk.says("ok", "ok") == []
    assert talk.says(HOT) == [first(8, "G1 X3")]
    assert talk.says(HOT, HOT) == []
    assert talk.streamer.acknowledged == 2


def test_an_ok_with_temperatures_long_after_a_question_counts_as_any_other(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    talk.waits(31.5)
    talk.says(HOT)
    talk.waits(1.0)

    assert talk.says(HOT) == [first(7, "G1 X4")]


def test_a_question_in_the_job_is_answered_like_one_of_ours(bytewise: bool) -> None:
    talk, _ = printing(["G90", "M105", "G91"], bytewise=bytewise)

    assert talk.says(HOT) == [first(5, "G91")]
    assert talk.streamer.acknowledged == 2


def test_a_busy_printer_is_not_asked(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)

    for _ in range(300):
        assert talk.waits(2.0) == []
        assert talk.says("echo:busy: processing") == []
    assert len(talk.happened(Busy)) == 300
    assert talk.says("X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0", "ok") == []


def test_a_printer_that_says_when_it_is_busy_is_asked_sooner_when_it_says_nothing(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    talk.waits(2.0)
    talk.says("echo:busy: processing")

    assert talk.waits(4.9) == []
    assert talk.waits(0.2) == [again(5, "M105")]


def test_a_printer_that_says_it_seldom_gets_longer(bytewise: bool) -> None:
    talk, _ = printing(["G28", "G90"], bytewise=bytewise)
    for _ in range(3):
        talk.says("echo:busy: processing")
        talk.waits(4.5)
    talk.says("echo:busy: processing")

    assert talk.waits(11.0) == []
    assert talk.waits(0.5) == [again(5, "M105")]


def test_a_printer_that_heats_and_says_so_is_not_asked(bytewise: bool) -> None:
    talk, _ = printing(["M109 S200"], bytewise=bytewise)

    for _ in range(3000):
        assert talk.waits(1.0) == []
        talk.says(" T:52.44 /60.00 B:32.08 /40.00 @:38 B@:0 W:?")
    assert talk.happened(Temperature)[-1].waiting


def test_temperatures_that_come_by_themselves_do_not_hide_a_lost_ok(bytewise: bool) -> None:
    talk, _ = printing(["G90", "G91"], bytewise=bytewise)

    out = []
    for _ in range(33):
        out += talk.waits(1.0)
        talk.says(" T:52.44 /60.00 B:32.08 /40.00 @:38 B@:0")

    assert out[0] == again(5, "M105")


def test_an_idle_printer_has_lost_what_is_in_flight(bytewise: bool) -> None:
    talk, _ = printing(["G90"], bytewise=bytewise)

    assert talk.says("wait") == []
    assert talk.waits(1.0) == []
    talk.says("wait")
    assert talk.waits(0.4) == [again(4, "M105")]


def test_an_idle_printer_without_a_line_in_flight_is_just_idle(bytewise: bool) -> None:
    talk, _ = printing(["G90"], bytewise=bytewise)
    talk.streamer.pause()
    talk.says("ok")

    assert talk.says("wait") == []
    assert talk.waits(5.0) == []


def test_a_printer_that_waits_for_a_person_is_never_given_up(bytewise: bool) -> None:
    talk, _ = printing(["M0", "G90"], bytewise=bytewise)

    assert talk.waits(86400.0) == []
    talk.says("\x01\x02\x03 noise on the line")
    assert len(talk.waits(86400.0)) == 6
    assert talk.streamer.state is State.STREAMING


@pytest.mark.parametrize("remains", ["o", "k", "oj", "okok", "ok\x07"])
def test_the_remains_of_an_ok_are_asked_about_soon(remains: str, bytewise: bool) -> None:
    talk, _ = printing(["G90"], bytewise=bytewise)

    assert talk.says(remains) == []
    assert talk.waits(0.25) == []
    assert talk.waits(0.1) == [again(4, "M105")]


# More than a plain ok.


def test_an_ok_with_a_number_accepts_all_up_to_it(bytewise: bool) -> None:
    talk, _ = printing(moves(6), bytewise=bytewise)

    assert talk.says("ok N4 P15 B3") == [first(5, "G1 X3"), first(6, "G1 X4")]
    assert talk.streamer.acknowledged == 2


@pytest.mark.parametrize("number", [0, 1, 2, 5, 999])
def test_an_ok_with_a_number_that_is_not_in_flight_means_nothing(number: int, bytewise: bool) -> None:
    talk, _ = printing(moves(6), bytewise=bytewise)

    assert talk.says(f"ok N{number} P15 B3") == []
    assert talk.streamer.acknowledged == 0


def test_an_ok_with_a_number_ends_a_request_that_it_contradicts(bytewise: bool) -> None:
    talk, _ = printing(moves(6), bytewise=bytewise)

    talk.says("Resend: 3")
    assert talk.says("ok N4 P15 B3") == [first(5, "G1 X3"), first(6, "G1 X4")]


def test_an_unknown_command_of_the_job_is_answered_like_any_other(bytewise: bool) -> None:
    talk, _ = printing(["M9999", "M117 hello", "G90"], bytewise=bytewise)

    assert talk.says('echo:Unknown command: "M9999"', "ok") == [first(5, "G90")]
    assert talk.says('// Unknown command:"M117"', "ok") == []
    assert talk.streamer.acknowledged == 2


def test_an_unknown_command_that_nobody_sent_is_the_remains_of_a_line(bytewise: bool) -> None:
    talk, _ = printing(["G1 X10"], bytewise=bytewise)

    assert talk.says('echo:Unknown command: "2 G1 X10"', "ok") == []
    assert talk.streamer.acknowledged == 0
    assert talk.waits(0.4) == [again(4, "M105")]


def test_ten_thousand_bytes_of_noise_are_survived(bytewise: bool) -> None:
    talk, _ = printing(moves(3), bytewise=bytewise)

    noise = bytes((17 * i + i // 256) % 256 for i in range(10_000)).replace(b"\n", b"?")
    assert talk.says_bytes(noise + b"\n") == []
    assert talk.waits(0.5) == [again(5, "M105")]
    assert talk.says(HOT) == [first(6, "G1 X3")]


def test_text_in_any_script_is_passed_on(bytewise: bool) -> None:
    talk, _ = printing(["M118 Größe"], bytewise=bytewise)

    talk.says("Größe", "ok")

    assert Message("Größe") in talk.events
    assert talk.streamer.acknowledged == 1


# The printer stops.


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (
            ("echo:Homing Failed", "Error:Printer halted. kill() called!"),
            "kill() called! (echo:Homing Failed)",
        ),
        (("Error:MINTEMP triggered, system stopped! Heater_ID: E0",), "MINTEMP triggered"),
        (("!! Must home axis first: 10.000 0.000 0.000 [0.000]", "ok"), "Must home axis first"),
        (("// Klipper state: Shutdown", "ok"), "Klipper state: Shutdown"),
        (("fatal: driver overheated",), "driver overheated"),
    ],
)
def test_a_printer_that_stops_ends_it_with_its_own_words(
    said: tuple[str, ...], reason: str, bytewise: bool
) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)

    assert talk.says(*said, "ok") == []
    (halted,) = talk.happened(Halted)
    assert reason in halted.reason
    assert halted.acknowledged == 0


def test_words_from_long_before_are_not_taken_for_the_cause(bytewise: bool) -> None:
    talk, _ = printing(moves(9), bytewise=bytewise)
    talk.says("echo:something else")
    talk.waits(10.0)

    talk.says("Error:Printer halted. kill() called!")

    assert talk.happened(Halted) == [Halted("the printer stopped: Error:Printer halted. kill() called!", 0)]


# The table of states.


def test_every_state_is_in_the_table_and_only_the_last_two_have_no_way_out() -> None:
    assert set(TRANSITIONS) == set(State)
    assert {State.DONE, State.HALTED} == ENDED


def test_every_state_that_is_not_an_end_can_be_halted_and_every_state_can_be_reached() -> None:
    assert all(TRANSITIONS[state][Trigger.HALT] is State.HALTED for state in set(State) - ENDED)
    reached = {target for ways in TRANSITIONS.values() for target in ways.values()}
    assert reached == set(State)


def test_a_printer_that_lost_count_never_gets_the_job_again() -> None:
    after = {state for state in set(State) - ENDED if TRANSITIONS[state][Trigger.RESTARTED] is State.HALTED}
    assert after == set(State) - ENDED - {State.CONNECTING, State.IDENTIFYING}


def test_a_ledger_forgets_old_lines() -> None:
    history = SendHistory()
    for number in range(1, 1001):
        history.add_line(b"G1 X%d" % number, number, 1.0)
        history.send_next(0.0)
        history.accept(number)

    assert len(history._lines) < 64
    assert history.proven == 1000 - 16
