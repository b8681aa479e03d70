"""Firmwares that are not Marlin 2.0: how each is recognised, asked, and believed."""

from __future__ import annotations

import pytest
from conversation import HOT, Conversation, first, lines_of, moves, printing

from printer_slicer.errors import UsageError
from printer_slicer.firmware import WIRE_DIALECTS, get_wire_dialect, match_wire_dialect
from printer_slicer.gcode.lexer import parse
from printer_slicer.stream.events import Finished, Halted, Identified, Probe, ResendRequested
from printer_slicer.stream.framing import compute_checksum, frame_with_crc
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.replies import LineError, Resend, parse_replies
from printer_slicer.stream.states import State
from printer_slicer.stream.unacked_line import LineFate, UnackedLine, is_repeatable
from printer_slicer.stream.window import Window

REPRAP = "FIRMWARE_NAME: RepRapFirmware for Duet 2 WiFi/Ethernet FIRMWARE_VERSION: 3.4.6 ELECTRONICS: Duet"
REPETIER = "FIRMWARE_NAME:Repetier_1.0.4 FIRMWARE_URL:https://github.com/repetier PROTOCOL_VERSION:1.0"
ADVANCED = (
    "FIRMWARE_NAME:Marlin bugfix-2.1.x (date) SOURCE_CODE_URL:x",
    "Cap:EMERGENCY_PARSER:1",
    "ok N1 P15 B3",
)
MARLIN_2_1_3 = "FIRMWARE_NAME:Marlin 2.1.3 (Apr 20 2025) SOURCE_CODE_URL:x"


def crc(number: int, command: str) -> bytes:
    return frame_with_crc(number, command.encode())


def meet(commands: list[str], *introduction: str, **wishes: object) -> tuple[Conversation, list[bytes]]:
    """A conversation with a firmware that introduces itself so, and the first lines of the job."""
    streamer = Streamer([c.encode() for c in commands], **wishes)  # type: ignore[arg-type]
    talk = Conversation(streamer)
    talk.waits(0.0)
    talk.says("ok")
    talk.says(*introduction)
    return talk, talk.says(HOT)


# The table.


@pytest.mark.parametrize(
    ("firmware", "name"),
    [
        ("Marlin 1.1.9 (Github)", "marlin_1"),
        ("Marlin V1.0.2; Sprinter/grbl mashup for gen6", "marlin_1"),
        ("Marlin 2.0.9.3 (Dec 25 2021)", "marlin"),
        ("Marlin bugfix-2.1.x (Jan  7 2023)", "marlin"),
        ("Marlin 2.1.2.5", "marlin"),
        ("Marlin 2.1.3 (Apr 20 2025)", "marlin_2_1_3"),
        ("Marlin 2.2.0", "marlin_2_1_3"),
        ("Prusa-Firmware 3.13.3 based on Marlin", "prusa"),
        ("Prusa-Firmware-Buddy 5.1.0", "marlin"),
        ("RepRapFirmware for Duet 3 MB6HC", "reprapfirmware"),
        ("Klipper", "klipper"),
        ("Repetier_1.0.4", "repetier"),
        ("Smoothieware,", "smoothie"),
        ("", "marlin"),
        ("Something nobody knows", "marlin"),
    ],
)
def test_a_firmware_is_recognised_by_its_name(firmware: str, name: str) -> None:
    assert match_wire_dialect(firmware) == name


@pytest.mark.parametrize("name", WIRE_DIALECTS)
def test_its_request_for_a_line_is_understood(name: str) -> None:
    asked = [reply for line in WIRE_DIALECTS[name].resend_request for reply in parse_replies(line.encode())]
    wanted = [r.number for r in asked if isinstance(r, Resend)]
    wanted += [r.expected_line for r in asked if isinstance(r, LineError)]

    assert set(wanted) == ({7} if WIRE_DIALECTS[name].resend_request else set())


def test_an_unknown_dialect_is_refused_with_the_names_of_the_known_ones() -> None:
    with pytest.raises(UsageError, match="unknown wire dialect 'merlin'\n  Choose one of: prusa, "):
        Streamer([], dialect="merlin")
    assert get_wire_dialect("prusa") is WIRE_DIALECTS["prusa"]


def test_a_wish_counts_more_than_what_the_firmware_says() -> None:
    talk, out = meet(["G28", "G90"], *ADVANCED, dialect="reprapfirmware")

    assert out == [crc(3, "G28")]
    (who,) = talk.happened(Identified)
    assert isinstance(who, Identified)
    assert who.dialect == "reprapfirmware"
    assert "silently" in who.advice


def test_the_crc_is_that_of_the_firmwares_own_dictionary() -> None:
    assert crc(100, "G0 X100 F6000") == b"N100 G0 X100 F6000*51369"
    assert crc(7, "M114") == b"N7 M114*%05d" % int(crc(7, "M114").rpartition(b"*")[2])
    assert len(crc(7, "M114").rpartition(b"*")[2]) == 5


def test_lines_are_as_long_as_the_firmware_can_read() -> None:
    long = b"M117 " + b"x" * 120

    Streamer([long], dialect="klipper")
    with pytest.raises(UsageError, match="125 bytes"):
        Streamer([long], dialect="smoothie")


# The window.


def accept(talk: Conversation, count: int, say: str = "ok") -> list[int]:
    """Lines sent for each of so many oks."""
    return [len(talk.says(say)) for _ in range(count)]


def test_more_than_two_lines_go_out_where_a_tail_is_refused_and_no_error_was_seen() -> None:
    talk, out = meet(moves(900), "FIRMWARE_NAME:Prusa-Firmware 3.13.3 based on Marlin", "ok")

    assert len(out) == 2
    sent = accept(talk, 300)
    assert sum(sent) == 301  # one more in flight, and one command place kept free
    talk.says("Error:checksum mismatch, Last Line: 302", "Resend: 303", "ok")
    talk.waits(1.0)
    after = accept(talk, 800)
    assert max(after) <= 2
    assert talk.streamer._tracker.history.n_in_flight <= 2


def test_more_than_two_lines_never_go_out_where_a_tail_would_be_executed() -> None:
    talk, _ = printing(moves(900))

    assert accept(talk, 800) == [1] * 800


def advanced(talk: Conversation, count: int, planner: int) -> int:
    """Lines sent for so many numbered oks that tell so many free places of the planner."""
    begin = talk.streamer._tracker.history.accepted + 1
    return sum(len(talk.says(f"ok N{begin + i} P{planner} B3")) for i in range(count))


def test_more_go_out_when_numbered_oks_tell_that_the_planner_runs_dry() -> None:
    talk, out = meet(moves(3000), *ADVANCED)
    assert len(out) == 2

    assert advanced(talk, 700, planner=15) == 702  # four places, and a parser that sees M112 behind them
    assert talk.streamer._tracker.history.n_in_flight == 4


def test_a_full_planner_needs_no_more_than_two() -> None:
    talk, _ = meet(moves(3000), *ADVANCED)
    advanced(talk, 10, planner=15)

    assert advanced(talk, 700, planner=2) == 700


def test_a_port_that_is_quicker_than_its_speed_allows_is_none() -> None:
    window = Window(2, 127, 115_200)
    window.set_dialect(WIRE_DIALECTS["marlin"], emergency_parser=False)
    for _ in range(3):
        window.on_probe_answer(17, 0.001)
    window.on_accepted(200)

    assert (window.lines, window.size) == (3, 6 * 96)
    window.on_probe_answer(17, 0.1)
    window.on_accepted(200)
    assert window.lines == 2


def test_without_a_speed_no_port_is_too_quick() -> None:
    window = Window(2, 127)
    window.set_dialect(WIRE_DIALECTS["marlin"], emergency_parser=False)
    for _ in range(9):
        window.on_probe_answer(17, 0.0)
    window.on_accepted(400)

    assert window.lines == 2


def test_an_ok_without_number_among_numbered_ones_ends_the_print() -> None:
    talk, _ = meet(moves(9), *ADVANCED)

    assert talk.says("ok P14 B3") == []
    (halted,) = talk.happened(Halted)
    assert isinstance(halted, Halted)
    assert "something that was not sent" in halted.reason


# The count, asked by M110 alone.


def silent(talk: Conversation) -> list[bytes]:
    return lines_of(b"".join(line + b"\n" for line in talk.waits(31.5)))


def test_the_count_is_asked_first_and_settles_a_lost_ok() -> None:
    talk, _ = meet(moves(9), MARLIN_2_1_3, "ok")

    assert talk.waits(31.5)[0] == b"\nM110"
    assert talk.says("echo: M110 N4") == [first(5, "G1 X3"), first(6, "G1 X4")]
    assert talk.streamer.acknowledged == 2
    assert talk.says("ok") == []
    assert talk.says("ok") == [first(7, "G1 X5")]


def test_the_count_brings_a_lost_line_out() -> None:
    talk, _ = meet(moves(9), MARLIN_2_1_3, "ok")
    talk.waits(31.5)

    assert talk.says("echo: M110 N3", "ok") == [b"\n" + first(4, "G1 X2")]
    assert talk.happened(ResendRequested) == [ResendRequested(4)]
    assert talk.streamer.acknowledged == 1


def test_a_count_that_cannot_be_is_asked_about_by_the_next_line() -> None:
    talk, _ = meet(moves(9), MARLIN_2_1_3, "ok")
    talk.waits(31.5)

    assert talk.says("echo: M110 N0", "ok") == []
    assert talk.waits(1.0) == [b"\n" + first(5, "M105")]
    assert talk.says("echo: M110 N0", "echo: M110 N4") == []
    assert len(talk.happened(Probe)) == 2


def test_an_ok_too_many_before_the_count_is_told_does_no_harm() -> None:
    talk, _ = meet(moves(9), MARLIN_2_1_3, "ok")
    talk.waits(31.5)
    talk.says("ok", "ok")  # of both lines, late

    assert talk.says("ok") == []  # taken for the one to the question
    assert talk.says("echo: M110 N4", "ok") == []
    assert talk.streamer.acknowledged == 2
    assert talk.says("ok") == [first(7, "G1 X5")]


def test_a_count_before_the_greeting_means_nothing() -> None:
    streamer = Streamer([])
    streamer.receive(b"echo: M110 N4\n", 0.0)

    assert streamer.state is State.CONNECTING


# Where numbers are not looked at.

PLACE = "X:{}.000 Y:0.000 Z:0.000 E:0.000"


def doubting(*commands: str) -> tuple[Conversation, list[bytes]]:
    """A print on RepRapFirmware whose last line got no answer."""
    talk, _ = meet(["G90", "M82", "G92 X0 Y0 Z0 E0", *commands], REPRAP, "ok")
    talk.says("ok")
    talk.says("ok")
    sent = talk.says("ok")
    assert sent == [crc(6, commands[0])]
    return talk, talk.waits(31.5)


def test_one_line_is_in_flight_and_the_position_tells_what_became_of_it() -> None:
    talk, asked = doubting("M83", "G1 X1 E1", "G1 X2 E1")
    assert asked[:2] == [b"\n" + crc(7, "M114"), crc(7, "M105")]
    talk.says("ok", PLACE.format(0), "ok")

    assert talk.says(HOT) == [crc(7, "G1 X1 E1")]
    assert talk.waits(31.5)[:2] == [b"\n" + crc(8, "M114"), crc(8, "M105")]
    talk.says(PLACE.format(0), "ok")
    assert talk.says(HOT) == [b"\n" + crc(7, "G1 X1 E1")]
    assert talk.waits(31.5)[:1] == [b"\n" + crc(8, "M114")]
    talk.says("X:1.000 Y:0.000 Z:0.000 E:1.000", "ok")
    assert talk.says(HOT) == [crc(8, "G1 X2 E1")]
    assert talk.streamer.acknowledged == 5


def test_requests_errors_and_late_temperatures_do_not_confuse_it() -> None:
    talk, _ = doubting("G1 X1")
    talk.says("rs 6", "Error:checksum mismatch, Last Line: 5", PLACE.format(1), "ok")

    assert talk.says(HOT) == [crc(7, "M400")]
    assert talk.says(HOT) == []
    assert talk.streamer.acknowledged == 4


def test_what_cannot_be_known_ends_the_print() -> None:
    talk, _ = doubting("G2 X0 Y0 I5 F6000")
    for _ in range(3):
        assert talk.says(HOT) == []
        talk.waits(1.0)

    (halted,) = talk.happened(Halted)
    assert isinstance(halted, Halted)
    assert halted.reason == "it is unknown whether the printer executed line 6: G2 X0 Y0 I5 F6000"
    assert halted.acknowledged == 3


def test_a_doubt_about_a_question_waits_for_the_answer_behind_its_own() -> None:
    talk, _ = doubting("M105", "G1 X1")

    assert talk.says(HOT) == []
    assert talk.says(PLACE.format(0), "ok") == []
    assert talk.says(HOT) == [b"\n" + crc(6, "M105")]


def test_a_printer_without_a_word_is_given_up_in_doubt_too() -> None:
    talk, _ = doubting("G1 X1")
    talk.waits(200.0)

    assert talk.happened(Halted) == [Halted("the printer has stopped answering", 3)]


@pytest.mark.parametrize(
    ("command", "relative", "same"),
    [
        (b"M106 S255", False, True),
        (b"T1", False, True),
        (b"G1 X5 Y5", False, True),
        (b"G1 X5 E1", True, False),
        (b"G2 X5 I2", False, False),
        (b"M600", False, False),
        (b"G10", False, False),
    ],
)
def test_some_commands_are_the_same_twice(command: bytes, relative: bool, same: bool) -> None:
    assert is_repeatable(parse(command)[0], relative=relative) is same


def test_a_position_that_fits_both_or_neither_tells_nothing() -> None:
    before, after = (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, None)
    unacked = UnackedLine(before, after, repeatable=False)

    for place in ((5.0, 0.0, 0.0, 0.0), None):
        unacked.position = place
        assert unacked.resolve_fate() is LineFate.UNDECIDED
    unacked.on_bare_ok()
    unacked.on_bare_ok()
    assert unacked.resolve_fate() is LineFate.EXECUTED
    assert UnackedLine(before, before, repeatable=True).resolve_fate() is LineFate.LOST


# Where an ok means read.

REPORT = "T:200.0 /200.0 B:60.0 /60.0 @:40 B@:20"


def test_temperatures_apart_from_their_ok_settle_what_was_lost() -> None:
    talk = Conversation(Streamer([b"G1 X1", b"G1 X2"]))
    talk.waits(0.0)
    talk.says("ok")

    # The ok of line 1 came before the name, and was not believed; the temperatures are those of line 2.
    assert talk.says("ok", REPETIER) == []
    assert talk.waits(3.5) == [b"\n" + first(2, "M105")]
    assert talk.says("ok", REPORT) == [first(3, "G1 X1")]


def test_a_printer_with_nothing_to_do_answers_the_question_that_it_is_asked() -> None:
    talk = Conversation(Streamer([b"G1 X1", b"G1 X2"]))
    talk.waits(0.0)
    talk.says("ok")
    talk.says(REPETIER, "ok")
    assert talk.says("ok", REPORT) == [first(3, "G1 X1"), first(4, "G1 X2")]
    talk.waits(1.0)

    talk.says("ok", "wait")
    assert talk.waits(0.5) == [b"\n" + first(5, "M105")]
    assert talk.says("ok", REPORT) == [first(6, "M400")]
    talk.waits(1.0)
    talk.says("ok", "wait")
    assert talk.streamer.acknowledged == 2


def test_the_end_waits_for_the_temperatures_and_asks_again_when_they_are_lost() -> None:
    talk = Conversation(Streamer([]))
    talk.waits(0.0)
    talk.says("ok")
    talk.says(REPETIER, "ok")

    assert talk.says("ok", REPORT) == [first(3, "M400")]
    assert talk.says("ok") == [first(4, "M105")]
    assert talk.says("ok") == []
    assert talk.waits(40.0) == [first(5, "M400")]
    assert talk.says("ok") == [first(6, "M105")]
    assert talk.says("ok", REPORT) == [first(7, "M114")]
    talk.says("X:0.00 Y:0.00 Z:0.00 E:0.00", "ok")
    assert len(talk.happened(Finished)) == 1


def test_a_skipped_line_has_an_ok_that_answers_nothing() -> None:
    talk, _ = printing(moves(9))

    assert talk.says("skip 3", "ok") == []
    assert talk.streamer.acknowledged == 0


@pytest.mark.parametrize("noise", [b"", b"\xff\x00\xfe"])
@pytest.mark.parametrize(
    "banner",
    [b"start", b"Brown out Reset", b"Smoothie", b"RepRapFirmware for Duet 2 version 3.4 is up and running."],
)
def test_every_way_to_say_that_it_has_just_begun_ends_the_print(banner: bytes, noise: bytes) -> None:
    talk, _ = printing(moves(9))

    assert talk.says_bytes((b"" if b" is " in banner else noise) + banner + b"\nok\n") == []
    assert talk.streamer.state is State.HALTED


def test_a_storm_of_requests_without_ok_is_obeyed_a_few_times_and_then_ends_the_print() -> None:
    talk, _ = printing(moves(9))
    repeats = []
    for _ in range(60):
        talk.says("Resend: 3")
        repeats += talk.waits(0.1)

    assert 1 <= len(repeats) <= 10
    assert talk.streamer.state is State.HALTED
    (halted,) = talk.happened(Halted)
    assert isinstance(halted, Halted)
    assert "keeps rejecting line 3" in halted.reason


def test_remains_that_say_nothing_are_not_taken_for_the_answer_to_a_line() -> None:
    talk, _ = printing(moves(9))

    assert talk.says('echo:Unknown command: ""', "ok") == []
    assert talk.streamer.acknowledged == 0


def test_a_count_that_never_comes_leaves_no_ok_to_be_passed_over() -> None:
    talk, _ = meet(moves(9), MARLIN_2_1_3, "ok")
    assert talk.waits(32.5) == [b"\nM110", b"\n" + first(5, "M105")]

    assert talk.says(HOT) == [first(6, "G1 X3")]
    assert talk.says("echo: M110 N5", "ok") == [first(7, "G1 X4")]
    assert talk.streamer.acknowledged == 3


def test_silence_behind_a_repeat_is_asked_about_with_the_next_repeat() -> None:
    talk, _ = printing(moves(9))
    talk.says("Resend: 3", "ok")
    assert talk.waits(0.5) == [b"\n" + first(3, "G1 X1")]

    assert talk.waits(33.0)[:1] == [b"\n" + first(4, "G1 X2")]


def test_noise_while_nothing_is_in_flight_changes_nothing() -> None:
    talk, _ = printing(moves(9))
    talk.streamer.pause()
    talk.says("ok", "ok")

    assert talk.says_bytes(b"\xff\x00\x01\n") == []
    assert talk.waits(60.0) == []


def test_the_remains_of_a_question_are_answered_too_and_tell_nothing_of_the_line() -> None:
    talk, _ = doubting("M83", "G1 X1 E1")
    talk.says(PLACE.format(0), "ok", 'echo:Unknown command: "\x0e7 M105"', "ok")

    # Two bare oks, but M83 may have been lost: it goes out again.
    assert talk.says(HOT) == [b"\n" + crc(6, "M83")]
    assert talk.streamer.acknowledged == 3


def test_a_long_line_has_a_checksum_of_all_its_bytes() -> None:
    assert compute_checksum(b"x" * 301) == ord("x")
    assert compute_checksum(b"x" * 300 + b"y") == ord("y")


@pytest.mark.parametrize(
    ("said", "stops"), [(b"!!", True), (b"!! Move out of range", True), (b"!!\xefok", False)]
)
def test_exclamation_marks_end_the_print_only_where_words_or_nothing_follow(said: bytes, stops: bool) -> None:
    talk, _ = printing(moves(9))
    talk.says_bytes(said + b"\n")

    assert (talk.streamer.state is State.HALTED) is stops
