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
    attach = Resync(50)
    assert attach.send(0.0) == FAR
    attach.receive(REFUSAL, 0.1)
    assert attach.line == 42
    return attach


def test_the_refusal_names_the_line_and_two_questions_find_the_place() -> None:
    attach = found()
    assert attach.questions() == ((43, b"M105"), (44, b"M114"))
    assert attach.send(0.2) == b""  # repeated refusals may still come
    assert attach.wakeup() == pytest.approx(0.4)

    assert attach.send(0.4) == question(43, b"M105")
    attach.receive(HOT, 0.5)
    assert attach.send(0.5) == question(44, b"M114")
    attach.receive(THERE + b"ok\n", 0.6)

    assert (attach.done, attach.line, attach.position) == (True, 42, (10.0, 20.0, 0.3))
    assert attach.temperature is not None
    assert attach.temperature.readings[0].actual == 200.0
    assert (attach.reason, attach.wakeup(), attach.send(9.0)) == ("", None, b"")


def test_before_the_line_is_known_there_is_nothing_to_ask_it_by() -> None:
    assert Resync(50).questions() == ()


def test_one_refusal_that_says_the_number_once_is_asked_again() -> None:
    """A number that came once may have been damaged on its way."""
    attach = Resync(50)
    attach.send(0.0)
    attach.receive(b"Resend: 48\n", 0.1)
    assert attach.line is None
    assert attach.send(2.0) == FAR
    attach.receive(REFUSAL, 2.1)
    assert attach.line == 42


def test_answers_to_lines_from_before_are_passed_over() -> None:
    attach = Resync(50)
    attach.send(0.0)
    attach.receive(b"ok\nok\n" + HOT * 6 + REFUSAL, 0.1)

    assert (attach.line, attach.reason) == (42, "")
    attach.receive(REFUSAL + b"ok\n", 0.2)  # of the same question, sent twice
    assert attach.send(0.3) == b""
    attach.send(0.6)
    attach.receive(b"ok\n", 0.7)  # without temperatures: no answer to the first question
    assert attach.send(1.0) == b""
    assert attach.send(2.7) == question(43, b"M105")


def test_firmware_that_takes_any_number_cannot_be_asked() -> None:
    attach = Resync(50)
    for turn in range(8):
        assert not attach.done
        attach.send(2.0 * turn)
        attach.receive(HOT, 2.0 * turn + 0.1)

    assert (attach.done, attach.line) == (True, None)
    assert attach.reason == "its firmware does not count lines"


def test_an_answer_that_was_lost_is_seen_by_the_number_that_is_wanted_next() -> None:
    attach = found()
    attach.send(0.5)
    attach.receive(b"Resend: 44\nok\n", 3.0)
    assert attach.send(3.0) == question(44, b"M114")
    attach.receive(b"ok\n", 3.1)  # the place itself was lost: the ok is not enough
    assert not attach.done
    attach.send(5.1)
    attach.receive(b"Resend: 45\n", 5.2)

    assert (attach.done, attach.position) == (True, None)


def test_a_question_that_was_lost_is_asked_again() -> None:
    attach = found()
    attach.send(0.5)
    attach.receive(b"Resend: 43\n", 1.0)
    assert attach.send(1.3) == question(43, b"M105")


def test_a_printer_that_counts_on_without_us_is_left_alone() -> None:
    attach = found()
    attach.send(0.5)
    attach.receive(b"Resend: 70\n", 1.0)

    assert (attach.done, attach.reason) == (True, "it wants line 70, after it wanted line 43")


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (b"start\n", "it has just started: it was reset"),
        (b"Error:Printer halted. kill() called!\n", "it has stopped: "),
    ],
)
def test_a_printer_that_lost_its_state_says_so(said: bytes, reason: str) -> None:
    attach = found()
    attach.send(0.5)
    attach.receive(said + HOT, 1.0)

    assert attach.done
    assert attach.reason.startswith(reason)


def test_silence_ends_after_thirty_seconds_and_reports_that_come_by_themselves_are_no_sign_of_life() -> None:
    attach = Resync(50)
    attach.send(0.0)
    for now in range(2, 30, 2):
        attach.receive(b" T:200.0 /200.0 B:60.0 /60.0 @:40 B@:20\n", float(now))
        assert attach.send(float(now)) == FAR
    assert attach.send(30.0) == b""
    assert (attach.done, attach.reason) == (True, "the printer does not answer")


def test_a_busy_printer_is_waited_for_and_not_asked_meanwhile() -> None:
    attach = found()
    assert attach.send(0.4) == question(43, b"M105")
    for now in range(2, 100, 2):
        attach.receive(b"echo:busy: processing\n", now - 0.1)
        assert attach.send(float(now)) == b""
    attach.receive(HOT, 100.0)
    assert attach.send(100.0) == question(44, b"M114")


def test_a_busy_printer_that_was_not_asked_yet_is_asked_in_time() -> None:
    attach = found()
    attach.receive(b"echo:busy: processing\nT:180.0 /200.0 B:60.0 /60.0 @:40 B@:20 W:3\n", 0.2)
    assert attach.send(0.4) == question(43, b"M105")


@pytest.mark.parametrize("noise", [b"\xff\x00\xfe\x80\n", b"x" * 5000 + b"\n", b"\r\n\n"])
def test_noise_between_the_answers_does_no_harm(noise: bytes) -> None:
    attach = Resync(50)
    attach.send(0.0)
    for data in (noise, REFUSAL[:30], REFUSAL[30:], noise):
        attach.receive(data, 0.1)
    assert attach.line == 42
