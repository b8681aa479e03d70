"""Finding a printer again: what is asked, what its answers mean, and when it is given up."""

from __future__ import annotations

import pytest

from printer_slicer.stream.framing import frame
from printer_slicer.stream.resync import Resync

FAR = b"\n%s\n" % frame(100_050, b"M105")
REFUSAL = b"Error:Line Number is not Last Line Number+1, Last Line: 42\nResend: 43\nok\n"
HOT = b"ok T:200.0 /200.0 B:60.0 /60.0 @:40 B@:20\n"
THERE = b"X:10.00 Y:20.00 Z:0.30 E:5.00 Count X:800 Y:1600 Z:120\n"


def question(number: int, command: bytes) -> bytes:
    return b"\n%s\n" % frame(number, command)


def found() -> Resync:
    """Of a printer that has named its line."""
    resync = Resync(50)
    assert resync.send(0.0) == FAR
    resync.receive(REFUSAL, 0.1)
    assert resync.line == 42
    return resync


def test_the_refusal_names_the_line_and_two_questions_find_the_place() -> None:
    resync = found()
    assert resync.queries() == ((43, b"M105"), (44, b"M114"))
    assert resync.send(0.2) == b""  # repeated refusals may still come
    assert resync.wakeup() == pytest.approx(0.4)

    assert resync.send(0.4) == question(43, b"M105")
    resync.receive(HOT, 0.5)
    assert resync.send(0.5) == question(44, b"M114")
    resync.receive(THERE + b"ok\n", 0.6)

    assert (resync.done, resync.line, resync.position) == (True, 42, (10.0, 20.0, 0.3))
    assert resync.temperature is not None
    assert resync.temperature.readings[0].actual == 200.0
    assert (resync.reason, resync.wakeup(), resync.send(9.0)) == ("", None, b"")


def test_before_the_line_is_known_there_is_nothing_to_ask_it_by() -> None:
    assert Resync(50).queries() == ()


def test_one_refusal_that_says_the_number_once_is_asked_again() -> None:
    """A number that came once may have been damaged on its way."""
    resync = Resync(50)
    resync.send(0.0)
    resync.receive(b"Resend: 48\n", 0.1)
    assert resync.line is None
    assert resync.send(2.0) == FAR
    resync.receive(REFUSAL, 2.1)
    assert resync.line == 42


def test_answers_to_lines_from_before_are_passed_over() -> None:
    resync = Resync(50)
    resync.send(0.0)
    resync.receive(b"ok\nok\n" + HOT * 6 + REFUSAL, 0.1)

    assert (resync.line, resync.reason) == (42, "")
    resync.receive(REFUSAL + b"ok\n", 0.2)  # of the same question, sent twice
    assert resync.send(0.3) == b""
    resync.send(0.6)
    resync.receive(b"ok\n", 0.7)  # without temperatures: no answer to the first question
    assert resync.send(1.0) == b""
    assert resync.send(2.7) == question(43, b"M105")


def test_firmware_that_takes_any_number_cannot_be_asked() -> None:
    resync = Resync(50)
    for turn in range(8):
        assert not resync.done
        resync.send(2.0 * turn)
        resync.receive(HOT, 2.0 * turn + 0.1)

    assert (resync.done, resync.line) == (True, None)
    assert resync.reason == "the firmware does not check line numbers"


def test_an_answer_that_was_lost_is_seen_by_the_number_that_is_wanted_next() -> None:
    resync = found()
    resync.send(0.5)
    resync.receive(b"Resend: 44\nok\n", 3.0)
    assert resync.send(3.0) == question(44, b"M114")
    resync.receive(b"ok\n", 3.1)  # the place itself was lost: the ok is not enough
    assert not resync.done
    resync.send(5.1)
    resync.receive(b"Resend: 45\n", 5.2)

    assert (resync.done, resync.position) == (True, None)


def test_a_question_that_was_lost_is_asked_again() -> None:
    resync = found()
    resync.send(0.5)
    resync.receive(b"Resend: 43\n", 1.0)
    assert resync.send(1.3) == question(43, b"M105")


def test_a_printer_that_counts_on_without_us_is_left_alone() -> None:
    resync = found()
    resync.send(0.5)
    resync.receive(b"Resend: 70\n", 1.0)

    assert (resync.done, resync.reason) == (True, "the printer requests line 70 after line 43")


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (b"start\n", "the printer was reset"),
        (b"Error:Printer halted. kill() called!\n", "the printer has stopped: "),
    ],
)
def test_a_printer_that_lost_its_state_says_so(said: bytes, reason: str) -> None:
    resync = found()
    resync.send(0.5)
    resync.receive(said + HOT, 1.0)

    assert resync.done
    assert resync.reason.startswith(reason)


def test_silence_ends_after_thirty_seconds_and_reports_that_come_by_themselves_are_no_sign_of_life() -> None:
    resync = Resync(50)
    resync.send(0.0)
    for now in range(2, 30, 2):
        resync.receive(b" T:200.0 /200.0 B:60.0 /60.0 @:40 B@:20\n", float(now))
        assert resync.send(float(now)) == FAR
    assert resync.send(30.0) == b""
    assert (resync.done, resync.reason) == (True, "the printer does not answer")


def test_a_busy_printer_is_waited_for_and_not_asked_meanwhile() -> None:
    resync = found()
    assert resync.send(0.4) == question(43, b"M105")
    for now in range(2, 100, 2):
        resync.receive(b"echo:busy: processing\n", now - 0.1)
        assert resync.send(float(now)) == b""
    resync.receive(HOT, 100.0)
    assert resync.send(100.0) == question(44, b"M114")


def test_a_busy_printer_that_was_not_asked_yet_is_asked_in_time() -> None:
    resync = found()
    resync.receive(b"echo:busy: processing\nT:180.0 /200.0 B:60.0 /60.0 @:40 B@:20 W:3\n", 0.2)
    assert resync.send(0.4) == question(43, b"M105")


@pytest.mark.parametrize("noise", [b"\xff\x00\xfe\x80\n", b"x" * 5000 + b"\n", b"\r\n\n"])
def test_noise_between_the_answers_does_no_harm(noise: bytes) -> None:
    resync = Resync(50)
    resync.send(0.0)
    for data in (noise, REFUSAL[:30], REFUSAL[30:], noise):
        resync.receive(data, 0.1)
    assert resync.line == 42
